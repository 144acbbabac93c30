"""
Show what voxels a mesh fills: boxes that are seen through, over the mesh.

https://github.com/mikedh/trimesh/blob/fdf2de11c5d6/examples/voxel.py
"""

import trimesh

mesh = trimesh.load("models/teapot.obj", force="mesh")
voxels = mesh.voxelized(mesh.extents.max() / 32)
frames = []
for colors in ((1, 1, 1, 0.3), (0, 1, 0, 0.3)):
    scene = mesh.scene()
    scene.add_geometry(voxels.as_boxes(colors=colors))
    frames.append(scene.save_image(resolution=(640, 480)))
