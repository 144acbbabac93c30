"""OpenGL on a CPU, writing one colour: the least that Mesa's llvmpipe can be asked to draw."""

from __future__ import annotations

from benchmarks.contestants import Prepared
from benchmarks.contestants.opengl import Lines, Triangles, available, environment
from benchmarks.scenes import LineScene, Scene

__all__ = ["NAME", "available", "environment", "prepare"]

NAME = "Mesa llvmpipe, one colour"

COLOR_SHADER = """
#version 330
out vec4 color;
void main() { color = vec4(0.9, 0.6, 0.2, 1.0); }
"""


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    return Triangles(scene, COLOR_SHADER, 4, "f1")
