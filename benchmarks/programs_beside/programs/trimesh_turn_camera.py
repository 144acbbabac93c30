"""
Turn a scene's camera about it, and save a picture at each step.

https://github.com/mikedh/trimesh/blob/1cd6a79aa0e5/examples/offscreen_render.py
"""

import numpy as np
import trimesh

mesh = trimesh.load("models/teapot.obj", force="mesh")
scene = mesh.scene()
turn = trimesh.transformations.rotation_matrix(np.radians(10), [0, 1, 0], scene.centroid)
frames = []
for _ in range(4):
    pose, _ = scene.graph[scene.camera.name]
    scene.graph[scene.camera.name] = turn @ pose
    frames.append(scene.save_image(resolution=[1920, 1080], visible=True))
