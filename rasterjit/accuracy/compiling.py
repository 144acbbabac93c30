"""
Compile beside: another process draws the last qualities while this one draws the first.

Every quality may need kernels of its own, and compilers hold Python's lock, so two threads are no
faster than one. Two processes are: they meet in the disk cache, and somewhere in the middle.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import BinaryIO, NamedTuple

from rasterjit.kernels.jit import cache_folder
from rasterjit.render import Renderer
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.workers import available_processors

COLD = 3.0
"""Seconds to compile the first frames above which they were not in the disk cache: the others are
not likely to be there either. Loading them takes about a tenth."""

OTHER_PROCESS = """
import os, sys, threading
sys.path[:] = sys.argv[1:]
from rasterjit.accuracy import compiling
job = compiling.read_job(sys.stdin.buffer)
threading.Thread(target=lambda: sys.stdin.buffer.read() or os._exit(1), daemon=True).start()
compiling.draw(job)
"""
"""
What the other process runs: it finds the modules where this one does, and nowhere else.

It ends with this one, however that ends: nobody else holds the other end of its standard input.
"""


class Job(NamedTuple):
    """What is drawn, in order, to compile what it needs."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    qualities: list[Quality]
    outputs: list[tuple[str, ...]]
    """Of the frames that are drawn in each quality."""


def draw(job: Job) -> None:
    """Draw all frames of a job; nobody looks at them."""
    with Renderer(job.size, threads=1) as renderer:
        for quality in job.qualities:
            renderer.quality = quality
            for outputs in job.outputs:
                renderer.render(job.scene, job.camera, outputs=outputs)


def read_job(stream: BinaryIO) -> Job:
    """Return the job that another process sent."""
    return pickle.load(stream)


def is_worthwhile(compile_seconds: float, threads: int | None) -> bool:
    """
    Tell whether another process helps.

    Parameters
    ----------
    compile_seconds : float
        What the first frames took to compile, or to load.
    threads : int or None
        What the user allows; with 1 everything is left to this process.
    """
    return (
        compile_seconds > COLD
        and threads != 1
        and available_processors() > 1
        and cache_folder() is not None
        and bool(sys.executable)
        and not getattr(sys, "frozen", False)
        and not sys.flags.isolated
    )


@contextmanager
def beside(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    qualities: Sequence[Quality],
    outputs: Sequence[tuple[str, ...]],
) -> Iterator[None]:
    """
    Draw a scene in another process as long as this context lasts, from the last quality on.

    A scene or camera that cannot be sent to another process is left to this one.
    """
    try:
        job = pickle.dumps(Job(scene, camera, size, list(qualities)[::-1], list(outputs)))
    except (pickle.PicklingError, AttributeError, TypeError):
        yield
        return
    other = subprocess.Popen(
        [sys.executable, "-c", OTHER_PROCESS, *sys.path],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        # If it has failed already, this process compiles everything.
        with suppress(OSError):
            other.stdin.write(job)
            other.stdin.flush()
        yield
    finally:
        other.kill()
        with suppress(OSError):
            other.communicate()
