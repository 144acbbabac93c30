"""
Find the depth of a picture by a ray for each pixel.

https://github.com/mikedh/trimesh/blob/09bee644b7fe/examples/raytrace.py
"""

import numpy as np
import trimesh

mesh = trimesh.load("models/torus_knot.obj", force="mesh")
scene = mesh.scene()
scene.camera.resolution = [640, 480]
scene.camera.fov = 60 * (scene.camera.resolution / scene.camera.resolution.max())
origins, vectors, pixels = scene.camera_rays()
points, ray_of_hit, _ = mesh.ray.intersects_location(origins, vectors, multiple_hits=False)
depth = trimesh.util.diagonal_dot(points - origins[0], vectors[ray_of_hit])
picture = np.full(scene.camera.resolution, np.inf)
picture[tuple(pixels[ray_of_hit].T)] = depth
depths = [picture.T[::-1]]
