"""
A process that runs public programs as they were written or changed, as it is told line by line.

``python -m benchmarks.programs_beside.worker original|rasterjit`` answers each line of JSON with
one: ``draw`` writes what a program drew to a file, ``time`` tells the processor time of its run.
"""

from __future__ import annotations

import io
import json
import os
import sys
import time
import warnings
from typing import Any

import numpy as np
from PIL import Image

KINDS = "frames", "depths", "numbers"

# Read when MuJoCo and dm_control are imported.
os.environ["MUJOCO_GL"] = "egl" if sys.argv[1:] == ["original"] else "disable"

from benchmarks.programs_beside.changes import change, read  # noqa: E402

AT_CORNERS = """
import pybullet as _pybullet

_image = _pybullet.getCameraImage
_pybullet.getCameraImage = lambda *given, **named: _image(
    *given, **{**named, "renderer": _pybullet.ER_TINY_RENDERER}
)
"""
"""Samples pixels where TinyRenderer does, so that pictures can be compared."""


def run(name: str, text: str) -> dict[str, Any]:
    """Run a program and return its variables."""
    found: dict[str, Any] = {"__name__": "__main__"}
    try:
        exec(compile(text, name, "exec"), found)
    finally:
        pybullet = sys.modules.get("pybullet")
        if pybullet is not None and pybullet.isConnected():
            pybullet.disconnect()
    return found


def as_array(picture: Any) -> Any:
    """Return colours (H, W, 3), depth or numbers (H, W) of what a program drew."""
    if isinstance(picture, bytes):
        picture = Image.open(io.BytesIO(picture)).convert("RGB")
    array = np.asarray(picture)
    return array[..., :3] if array.ndim == 3 else array


def answer(contestant: str, order: dict[str, Any]) -> dict[str, Any]:
    """Do what one line asks for."""
    name = order["scene"]
    text = read(name) if contestant == "original" else change(name)
    if contestant == "rasterjit" and order["task"] == "draw":
        text = text.replace("pybullet.install()\n", "pybullet.install()\n" + AT_CORNERS)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        started = time.process_time()
        found = run(name, text)
        taken = time.process_time() - started
    if order["task"] == "draw":
        arrays = {
            kind: np.stack([as_array(one) for one in found[kind]])
            for kind in KINDS
            if found.get(kind)
        }
        np.savez(order["to"], **arrays)
    ours = {str(one.message) for one in told if "not drawn" in str(one.message)}
    return {"seconds": taken, "told": sorted(ours)}


def main(contestant: str) -> None:
    """Serve until standard input ends; what programs print, also in C, goes to standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    print(json.dumps({"module": contestant}), file=answers, flush=True)
    for line in sys.stdin:
        try:
            found = answer(contestant, json.loads(line))
        except Exception as error:
            found = {"error": f"{type(error).__name__}: {error}".split("\n")[0]}
        print(json.dumps(found), file=answers, flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
