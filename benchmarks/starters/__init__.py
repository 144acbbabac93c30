"""
Programs that draw a first picture, one for each library, as its manual has it.

Each is a file that runs alone, in the library's own environment, and imports nothing of ours:
``python FILE VIEW``, where VIEW is JSON with the ``model`` (an OBJ file), the ``picture`` to write
(PNG), its ``size``, and a camera: ``eye``, ``target``, ``fov_y`` in degrees, y up. It ends with the
picture written, in any colours on a background of one colour.
"""
