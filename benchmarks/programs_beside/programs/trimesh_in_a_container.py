"""
Draw a ball in a container without a display, with a configuration of OpenGL's window.

https://github.com/mikedh/trimesh/blob/fdf2de11c5d6/examples/docker/render/render.py
"""

import trimesh
from pyglet import gl

scene = trimesh.creation.icosphere().scene()
window_conf = gl.Config(double_buffer=True, depth_size=24)
frames = [scene.save_image(resolution=[1920, 1080], window_conf=window_conf)]
