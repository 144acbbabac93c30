"""What trimesh reads: its materials and textures, and its scenes."""
