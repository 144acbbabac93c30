"""
RasterJIT itself with every index checked against its array, to see what that would cost.

No index leaves an array: a lane of the tests draws everything with these checks, so that pictures
can be drawn without.
"""

from __future__ import annotations

from benchmarks.contestants import Prepared
from benchmarks.contestants.rasterjit_ import available, prepare_picture
from benchmarks.contestants.rasterjit_ import refuses_all_but_colors as draws
from benchmarks.scenes import Scene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "RasterJIT, checked bounds"


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {"NUMBA_BOUNDSCHECK": "1"}


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw, its kernels compiled or loaded by a first picture."""
    return prepare_picture(scene, threads)
