"""PyVista: a plotter off screen."""

import json
import sys

import pyvista as pv

view = json.loads(sys.argv[1])
plotter = pv.Plotter(off_screen=True, window_size=view["size"])
plotter.add_mesh(pv.read(view["model"]))
plotter.camera_position = (view["eye"], view["target"], (0.0, 1.0, 0.0))
plotter.camera.view_angle = view["fov_y"]
plotter.screenshot(view["picture"])
