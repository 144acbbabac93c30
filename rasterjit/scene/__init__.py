"""What to draw: meshes, materials, lights, cameras and the scene that holds them."""
