"""
A process that holds one contestant and one scene, and draws when told to.

``python -m benchmarks.worker CONTESTANT SCENE THREADS PICTURE`` prepares, warms up, saves the
picture as ``.npz`` and then answers every line on standard input with one line of JSON: seconds of
drawing, of drawing and reading back, and of processor time over all threads.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np

from benchmarks.contestants import contestant
from benchmarks.scenes import SCENES

WARM_SECONDS = 1.0
"""A contestant that needs longer than this for a picture draws no second one to warm up."""


def main(key: str, scene_name: str, threads: str, picture: str) -> None:
    """Serve until standard input ends."""
    prepared = contestant(key).prepare(SCENES[scene_name](), int(threads))
    started = time.perf_counter()
    prepared.draw()
    if time.perf_counter() - started < WARM_SECONDS:
        prepared.draw()
    np.savez(picture, **prepared.picture())
    print(json.dumps({"ready": True}), flush=True)
    for _ in sys.stdin:
        started, processor = time.perf_counter(), time.process_time()
        prepared.draw()
        drawn = time.perf_counter()
        prepared.read()
        ended = time.perf_counter()
        seconds = {
            "draw": drawn - started,
            "total": ended - started,
            "processor": time.process_time() - processor,
        }
        print(json.dumps(seconds), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
