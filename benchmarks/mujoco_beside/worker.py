"""
A process that draws models with MuJoCo or with the adapter, as it is told line by line.

``python -m benchmarks.mujoco_beside.worker egl|osmesa|rasterjit`` answers each line of JSON with
one: ``draw`` writes colour, depth and numbers to a file, ``time`` tells the processor time of a
frame, of all threads.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import numpy as np

ORIGINAL = "egl", "osmesa"

FRAMES = 3
"""That are timed at once."""

if len(sys.argv) > 1 and sys.argv[1] in ORIGINAL:
    # Read when MuJoCo is imported.
    os.environ["MUJOCO_GL"] = sys.argv[1]

from benchmarks.mujoco_beside.models import MODES, model_of, state_of  # noqa: E402


def kind_of(contestant: str) -> type:
    """Return the contestant's renderer."""
    if contestant == "rasterjit":
        from rasterjit.compat.mujoco import Renderer
    else:
        from mujoco import Renderer
    return Renderer


def render(renderer: Any, mode: str, data: Any, camera: int) -> Any:
    """Return a picture."""
    renderer.disable_depth_rendering()
    renderer.disable_segmentation_rendering()
    if mode != "color":
        getattr(renderer, f"enable_{mode}_rendering")()
    renderer.update_scene(data, camera)
    return renderer.render()


def answer(kind: type, held: dict[Any, Any], order: dict[str, Any]) -> dict[str, Any]:
    """Do what one line asks for."""
    name, size = order["scene"], tuple(order["size"])
    if (name, size) not in held:
        for _, renderer in held.values():
            renderer.close()
        held.clear()
        model = model_of(name)
        held[name, size] = state_of(model), kind(model, size[1], size[0])
    data, renderer = held[name, size]
    if order["task"] == "draw":
        camera = order["camera"]
        np.savez(order["to"], **{mode: render(renderer, mode, data, camera) for mode in MODES})
        return {"drawn": MODES}
    mode = order["flag"]
    render(renderer, mode, data, -1)
    started = time.process_time()
    for _ in range(FRAMES):
        render(renderer, mode, data, -1)
    return {"seconds": (time.process_time() - started) / FRAMES}


def main(contestant: str) -> None:
    """Serve until standard input ends."""
    kind, held = kind_of(contestant), {}
    print(json.dumps({"module": kind.__module__}), flush=True)
    for line in sys.stdin:
        try:
            found = answer(kind, held, json.loads(line))
        except Exception as error:
            found = {"error": f"{type(error).__name__}: {error}".split("\n")[0]}
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
