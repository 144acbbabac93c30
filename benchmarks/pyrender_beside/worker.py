"""
A process that draws with the original or with the adapter, as it is told line by line.

``python -m benchmarks.pyrender_beside.worker egl|osmesa|rasterjit`` answers each line of JSON with
one: ``draw`` writes colour and depth to a file, ``warm`` times a second picture, both of a scene
and a renderer that are kept, ``cold`` a first one of scene, renderer and meshes made anew.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from typing import Any

import numpy as np

from benchmarks.pyrender_beside.scenes import POINT_SIZES, SCENES, SIZE

ORIGINAL = ("egl", "osmesa")

if len(sys.argv) > 1 and sys.argv[1] in ORIGINAL:
    # Read when the original is imported.
    os.environ["PYOPENGL_PLATFORM"] = sys.argv[1]


def module_of(contestant: str) -> Any:
    """Return the module that has pyrender's names."""
    return importlib.import_module(
        "pyrender" if contestant in ORIGINAL else "rasterjit.compat.pyrender"
    )


class Held:
    """A scene with its renderer."""

    def __init__(self, module: Any, name: str, size: tuple[int, int] = SIZE) -> None:
        self.scene = SCENES[name](module)
        self.renderer = module.OffscreenRenderer(*size, point_size=POINT_SIZES.get(name, 1.0))
        self.flags = module.RenderFlags

    def draw(self, flag: str) -> dict[str, Any]:
        """Return the arrays of a picture."""
        bits = 0
        for part in flag.split("|"):
            bits |= int(getattr(self.flags, part))
        numbers = None
        if bits & int(self.flags.SEG):
            nodes = sorted(
                self.scene.mesh_nodes, key=lambda n: tuple(self.scene.get_pose(n).ravel())
            )
            numbers = {node: (40 * n + 40) % 256 for n, node in enumerate(nodes)}
        found = self.renderer.render(self.scene, bits, numbers)
        if bits & int(self.flags.DEPTH_ONLY):
            return {"depth": found}
        return {"color": found[0], "depth": found[1]}


def release(held: dict[str, Held]) -> None:
    """Let what is kept go."""
    for one in held.values():
        one.renderer.delete()
    held.clear()


def answer(module: Any, held: dict[str, Held], order: dict[str, Any]) -> dict[str, Any]:
    """Do what one line asks for."""
    name, flag = order["scene"], order["flag"]
    if order["task"] == "cold":
        # Deleting a renderer of the original's ends what others share with it.
        release(held)
        started = time.perf_counter()
        made = Held(module, name)
        made.draw(flag)
        made.renderer.delete()
        return {"seconds": time.perf_counter() - started}
    if name not in held:
        release(held)
        held[name] = Held(module, name)
    made = held[name]
    if order["task"] == "draw":
        picture = made.draw(flag)
        camera = made.scene.main_camera_node.camera
        np.savez(order["to"], near=camera.znear, far=camera.zfar or np.inf, **picture)
        return {"drawn": sorted(picture)}
    made.draw(flag)
    started = time.perf_counter()
    made.draw(flag)
    return {"seconds": time.perf_counter() - started}


def main(contestant: str) -> None:
    """Serve until standard input ends."""
    module = module_of(contestant)
    held: dict[str, Held] = {}
    print(json.dumps({"module": module.__name__}), flush=True)
    for line in sys.stdin:
        try:
            found = answer(module, held, json.loads(line))
        except Exception as error:
            # A picture that failed halfway leaves OpenGL as it was then.
            release(held)
            text = str(error).strip().split("\n")[0]
            found = {"error": f"{type(error).__name__}: {text}"}
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
