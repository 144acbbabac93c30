"""glTF files: their JSON and buffers, meshes and materials, and the scene they describe."""
