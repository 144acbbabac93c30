"""Surface stages: gather samples in blocks, and compute the inputs of lighting for them."""
