"""
How to draw: compiled functions over arrays and records, nothing else.

=================  ===============================================================
file               stage
=================  ===============================================================
``clipping``       triangles -> pieces inside the near plane and the guard band
``projection``     model or clip positions -> snapped screen vertices
``setup``          faces -> survivors and the tiles they reach
``binning``        surviving triangles -> one list for each tile
``visibility``     per tile: coverage and depth test -> depth and face number
``interpolation``  visible pixels -> weights, positions, normals, uv
``shading``        visible pixels -> linear colour (calls ``lighting``)
``resolve``        linear colour -> sRGB ``uint8``
``wireframe``      edges -> clipped lines between pixels
``lines``          Bresenham lines into a colour array
``primitives``     the classic immediate-mode fills and curves
=================  ===============================================================

Kernels never validate and never raise; their callers cast dtype, contiguity and writability.
"""
