"""How fast RasterJIT is beside other ways to draw the same pictures on a CPU."""
