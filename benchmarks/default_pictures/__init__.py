"""
A sheet of what RasterJIT, f3d and PyVista draw of seven objects where nobody says how.

``python -m benchmarks.default_pictures FOLDER --scans data.tar.gz --peers PYTHON`` writes
``sheet.png``, named, and for each reader ``sheet_SEED.png``, shuffled and unnamed, with its key in
``key_SEED.json``.
"""
