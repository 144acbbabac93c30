"""
Look at a mesh along a diagonal.

https://github.com/mikedh/trimesh/blob/e73b01bf64c4/examples/save_image.ipynb
"""

import math

import trimesh

mesh = trimesh.load_mesh("models/torus_knot.obj")
scene = trimesh.Scene()
scene.add_geometry(mesh)
angle = math.radians(45)
turn = trimesh.transformations.euler_matrix(angle, angle, angle, "ryxz")
corners = trimesh.bounds.corners(scene.bounds)
scene.camera_transform = scene.camera.look_at(corners, rotation=turn)
frames = [scene.save_image()]
