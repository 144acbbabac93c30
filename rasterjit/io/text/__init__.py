"""Readers of our own for OBJ with MTL, PLY, STL and OFF."""
