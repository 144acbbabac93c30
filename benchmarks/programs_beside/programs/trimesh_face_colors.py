"""
Colour each flat part of a mesh, and draw the smallest box around it.

https://github.com/mikedh/trimesh/blob/1f531eea791d/examples/quick_start.ipynb
"""

import numpy as np
import trimesh

mesh = trimesh.creation.box((1.0, 2.0, 0.5)) + trimesh.creation.icosphere(radius=0.7)
mesh.apply_transform(trimesh.transformations.random_rotation_matrix(np.array([0.1, 0.4, 0.7])))
facets = sorted(mesh.facets, key=len)
for number, facet in enumerate(facets):
    mesh.visual.face_colors[facet] = [40 * number % 256, 90, 255 - 40 * number % 256, 255]
scene = trimesh.Scene(mesh)
box = mesh.bounding_box_oriented
box.visual.face_colors = [200, 60, 60, 90]
scene.add_geometry(box)
frames = [scene.save_image(resolution=(600, 600), visible=True)]
