"""
OpenGL on a CPU, writing one colour: the least that Mesa's llvmpipe can be asked to draw.

For scenes without colours: it tells what writing 32-bit face numbers costs Mesa.
"""

from __future__ import annotations

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import needs, refusal
from benchmarks.contestants.opengl import ONE_COLOR_SHADER, Triangles, available, environment
from benchmarks.scenes import LineScene, Scene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "Mesa llvmpipe, one colour"

UNABLE = dict.fromkeys(
    ("lines", "edges", "colors", "lighting"), "it stands beside scenes without colours only"
)


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, UNABLE)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        raise ValueError(f"cannot draw {needs(scene)}: {draws(scene)}")
    return Triangles(scene, ONE_COLOR_SHADER)
