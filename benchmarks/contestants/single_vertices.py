"""
RasterJIT itself with float32 vertices, to see what float64 costs.

Far from the origin, and far from each other, vertices then lie up to pixels beside where they
belong.
"""

from __future__ import annotations

from benchmarks.contestants import Prepared
from benchmarks.contestants.rasterjit_ import available, prepare_picture
from benchmarks.contestants.rasterjit_ import refuses_all_but_colors as draws
from benchmarks.scenes import Scene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "RasterJIT, float32 vertices"


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw, its kernels compiled or loaded by a first picture."""
    return prepare_picture(scene, threads, precision="float32")
