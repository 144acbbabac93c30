"""F3D by its Python bindings, off screen."""

import json
import sys

import f3d

view = json.loads(sys.argv[1])
f3d.Engine.autoload_plugins()
engine = f3d.Engine.create_egl() if hasattr(f3d.Engine, "create_egl") else f3d.Engine.create(True)
engine.window.size = tuple(view["size"])
engine.scene.add(view["model"])
camera = engine.window.camera
camera.position, camera.focal_point = view["eye"], view["target"]
camera.view_up, camera.view_angle = (0.0, 1.0, 0.0), view["fov_y"]
engine.window.render_to_image().save(view["picture"])
