"""Programs that others published, drawn by what they were written for and by RasterJIT."""
