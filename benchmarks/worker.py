"""
A process that holds one contestant and one scene, and draws when told to.

``python -m benchmarks.worker CONTESTANT SCENE THREADS PICTURE`` prepares, warms up, saves the
picture as ``.npz``, says how long a picture takes, and then answers every line on standard input
with one line of JSON. To ``picture`` it saves the last picture anew and answers nothing; to any
other it draws, and answers with the seconds of drawing, of drawing and reading back, and of
processor time over all threads.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import TextIO

import numpy as np

from benchmarks.contestants import Prepared, contestant
from benchmarks.scenes import find_scene

WARM_SECONDS = 1.0
"""A contestant that needs longer than this for a picture draws no second one to warm up."""


def timed(prepared: Prepared) -> dict[str, float]:
    """Draw and read back once; return the seconds."""
    started, processor = time.perf_counter(), time.process_time()
    prepared.draw()
    drawn = time.perf_counter()
    prepared.read()
    ended = time.perf_counter()
    return {
        "draw": drawn - started,
        "total": ended - started,
        "processor": time.process_time() - processor,
    }


def answer_pipe() -> TextIO:
    """Return the standard output, which from now on shows nobody else's text."""
    pipe = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return pipe


def main(key: str, scene_name: str, threads: str, picture: str) -> None:
    """
    Serve until standard input ends.

    Each answer is the second of two pictures, unless one takes long: threads and caches that slept
    while the others had their turn are slow to start, and that is not the work of this one.
    """
    answers = answer_pipe()
    prepared = contestant(key).prepare(find_scene(scene_name), int(threads))
    seconds = timed(prepared)["total"]
    if seconds < WARM_SECONDS:
        seconds = timed(prepared)["total"]
    np.savez(picture, **prepared.picture())
    print(json.dumps({"seconds": seconds}), file=answers, flush=True)
    for command in sys.stdin:
        if command.strip() == "picture":
            np.savez(picture, **prepared.picture())
            print("{}", file=answers, flush=True)
            continue
        if seconds < WARM_SECONDS:
            timed(prepared)
        print(json.dumps(timed(prepared)), file=answers, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
