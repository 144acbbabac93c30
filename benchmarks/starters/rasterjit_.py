"""RasterJIT: load, render, save."""

import json
import sys

import rasterjit as rj

view = json.loads(sys.argv[1])
scene = rj.load(view["model"])
camera = rj.PerspectiveCamera(eye=view["eye"], target=view["target"], fov_y=view["fov_y"])
rj.render(scene, camera, size=view["size"]).save(view["picture"])
