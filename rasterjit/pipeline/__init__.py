"""
The stages of a frame: compiled functions over arrays and records.

=====================================  =========================================================
file                                   stage
=====================================  =========================================================
``geometry.projection``                model or clip positions -> snapped screen vertices
``geometry.clipping``                  triangles -> pieces inside the near and far planes and the
                                       guard band
``geometry.setup``                     faces -> survivors and the tiles they touch
``geometry.binning``                   surviving triangles -> one list for each tile
``visibility.hierarchical_z``          large triangles -> the depth that hides everything in a tile
``visibility.tile_rasterizer``         per tile: coverage and depth test -> depth, face number
                                       (calls ``geometry.triangle_batches``)
``visibility.alpha_test``              samples of alpha-tested faces -> those that pass the alpha
                                       test (called by ``tile_rasterizer`` and ``fragments``)
``visibility.visibility_pass``         calls the stages above: allocates, and shares the work
                                       among threads
``visibility.reversed_depth``          visible faces -> their reversed depth
``geometry.barycentric``               visible pixels -> weights, positions, normals, uv
``surface``                            visible pixels -> blocks of samples (``sample_block``):
                                       listed, then weights, attributes, textures, maps ...
``lighting``                           rows of samples -> their colours
``fragments``                          pixels that show several faces: find and blend these
``srgb_encoding``                      linear colour -> sRGB ``uint8``
``bresenham``                          Bresenham lines into a colour array
=====================================  =========================================================

Kernels never validate and never raise; their callers cast dtype, contiguity and writability.
"""
