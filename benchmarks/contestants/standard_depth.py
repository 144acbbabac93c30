"""
RasterJIT itself with depth from 0 (near) to 1 (far), to see what reversed depth costs.

It is a float32 as well, whose digits are spent near the eye: distant surfaces fight.
"""

from __future__ import annotations

from benchmarks.contestants import Prepared
from benchmarks.contestants.rasterjit_ import available, prepare_picture
from benchmarks.contestants.rasterjit_ import refuses_all_but_colors as draws
from benchmarks.scenes import Scene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "RasterJIT, standard depth"


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw, its kernels compiled or loaded by a first picture."""
    return prepare_picture(scene, threads, depth_format="float32")
