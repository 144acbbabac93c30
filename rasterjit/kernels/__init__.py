"""
How to draw: compiled functions over arrays and records, nothing else.

=================  ===============================================================
file               stage
=================  ===============================================================
``clipping``       triangles -> pieces inside the near plane and the guard band
``projection``     model or clip positions -> snapped screen vertices
``setup``          faces -> survivors and the tiles they reach
``binning``        surviving triangles -> one list for each tile
``occlusion``      large triangles -> the depth below which a tile hides all
``visibility``     per tile: coverage and depth test -> depth and face number
                   (calls ``batches``, which sets triangles up)
``interpolation``  visible pixels -> weights, positions, normals, uv
``shading``        visible pixels -> sRGB ``uint8`` and linear colour (calls
                   ``gathering``, ``runs``, ``stretches``, ``attributes``,
                   ``texturing``, ``lighting``)
``resolve``        linear colour -> sRGB ``uint8``
``outlines``       depth and faces -> the edges of shapes, as pixels; and
                   ``ambient_occlusion`` -> the ambient light that reaches them
                   (both call ``lenses``)
``diagnosis``      lists and frame -> what became of every face
``wireframe``      edges -> clipped lines between pixels
``lines``          Bresenham lines into a colour array
``line_bands``     many lines -> lists for bands of rows, and their pixels
``primitives``     the classic immediate-mode fills and curves
=================  ===============================================================

Kernels never validate and never raise; their callers cast dtype, contiguity and writability.
"""
