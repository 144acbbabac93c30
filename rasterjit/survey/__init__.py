"""Look at the scene once: what is there, where, what is in view, and all of it as arrays."""
