"""
Draw the sharp edges of a white mesh as lines over it.

https://github.com/mikedh/trimesh/blob/4f863e61bd8d/examples/outlined.py
"""

import numpy as np
import trimesh

mesh = trimesh.creation.annulus(0.6, 1.0, 0.5)
sharp = mesh.face_adjacency_edges[mesh.face_adjacency_angles > np.radians(30)]
edges = trimesh.path.exchange.misc.edges_to_path(sharp, mesh.vertices.copy())
path = trimesh.path.Path3D(**edges)
mesh.visual.face_colors = [255, 255, 255, 255]
scene = trimesh.Scene([mesh, path])
scene.camera.resolution = (2000, 1000)
scene.camera_transform = scene.camera.look_at(
    points=mesh.vertices,
    rotation=trimesh.transformations.euler_matrix(np.pi / 3, 0, np.pi / 5),
)
frames = [scene.save_image()]
