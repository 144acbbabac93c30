"""
A process that drives the package ``rasterjit`` of another folder.

``python -m benchmarks.compare_worker draw FOLDER SCENE THREADS`` draws the scene, says so, and then
answers every line on standard input with the seconds of one picture, by the wall clock and of the
processor, as JSON. ``... loops FOLDER`` answers the name of a loop of `benchmarks.loops` with the
milliseconds of a step. ``... code FOLDER`` draws a small scene of each kind and prints the seconds
that its first pictures took, compiling included, and the instructions of every kernel that was
compiled.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.assembly import kernels
from benchmarks.public_api import drawer, small_scenes
from benchmarks.scenes import find_scene
from benchmarks.worker import WARM_SECONDS


def use_package(folder: str) -> None:
    """Import ``rasterjit`` from a folder; what was imported before is this checkout's."""
    sys.path.insert(0, folder)
    import rasterjit

    if Path(rasterjit.__file__).resolve().parent.parent != Path(folder).resolve():
        raise RuntimeError(f"rasterjit comes from {rasterjit.__file__}, not from {folder}")


def digest(arrays: list[Any]) -> str:
    """Return a hash of the bits of a picture."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array))
    return found.hexdigest()


def serve(scene: str, threads: str) -> None:
    """Draw once for every line of standard input."""
    draw = drawer(find_scene(scene), int(threads))
    draw()
    started = time.perf_counter()
    picture = draw()
    seconds = time.perf_counter() - started
    print(json.dumps({"seconds": seconds, "picture": digest(picture)}), flush=True)
    del picture
    for _ in sys.stdin:
        if seconds < WARM_SECONDS:
            draw()
        started, processor = time.perf_counter(), time.process_time()
        draw()
        answer = {
            "total": time.perf_counter() - started,
            "processor": time.process_time() - processor,
        }
        print(json.dumps(answer), flush=True)


def turn_loops() -> None:
    """Run the loop that each line of standard input names."""
    # What it imports, imports the package.
    from benchmarks.loops import Turns

    turns = Turns()
    print(json.dumps({}), flush=True)
    for name in sys.stdin:
        print(json.dumps({"ms": turns.measure(name.strip())}), flush=True)


def show_code() -> None:
    """Print what compiling took and what came out."""
    drawers = [drawer(scene, 1) for scene in small_scenes()]
    started = time.perf_counter()
    for draw in drawers:
        draw()
    seconds = time.perf_counter() - started
    print(json.dumps({"seconds": seconds, "kernels": kernels()}))


def main(task: str, folder: str, *arguments: str) -> None:
    """Do one of the tasks."""
    use_package(folder)
    if task == "draw":
        serve(*arguments)
    elif task == "loops":
        turn_loops()
    else:
        show_code()


if __name__ == "__main__":
    main(*sys.argv[1:])
