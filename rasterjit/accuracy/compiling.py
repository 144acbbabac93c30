"""
Compile beside: another process draws the last qualities while this one draws the first.

Every quality may need kernels of its own, and compilers hold Python's lock, so two threads are no
faster than one. Two processes are: they meet in the disk cache, and somewhere in the middle.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import BinaryIO, NamedTuple

from rasterjit.kernels.jit import cache_folder, is_cached
from rasterjit.kernels.shading import shade_rows
from rasterjit.render import Renderer
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.workers import available_processors

COLD = 3.0
"""Seconds of compiling that tell that the disk cache lacks more. Loading from it takes a tenth."""

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


class Companion:
    """
    Another process, started when it turns out to be of use, and ended with the context.

    Parameters
    ----------
    threads : int or None
        What the user allows; with 1 everything is left to this process.
    """

    def __init__(self, threads: int | None) -> None:
        self._is_possible = (
            threads != 1
            and available_processors() > 1
            and cache_folder() is not None
            and bool(sys.executable)
            and not getattr(sys, "frozen", False)
            and not sys.flags.isolated
        )
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Companion:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process is not None:
            self._process.kill()
            with suppress(OSError):
                self._process.communicate()

    def help(self, compile_seconds: float, find_job: Callable[[], Job]) -> None:
        """
        Start, unless it has been, if so many seconds of compiling tell that there is more of it.

        A scene or camera that cannot be sent to another process is left to this one.
        """
        is_cold = compile_seconds > COLD or not is_cached(shade_rows)
        if not is_cold or not self._is_possible or self._process is not None:
            return
        try:
            job = pickle.dumps(find_job())
        except (pickle.PicklingError, AttributeError, TypeError):
            self._is_possible = False
            return
        self._process = subprocess.Popen(
            [sys.executable, "-c", OTHER_PROCESS, *sys.path],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        # If it has failed already, this process compiles everything.
        with suppress(OSError):
            self._process.stdin.write(job)
            self._process.stdin.flush()
