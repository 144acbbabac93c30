"""
OpenGL on a CPU blending layers that were sorted beforehand, back to front.

It is the least that Mesa's llvmpipe can be asked to do for transparency, and right only where an
order of whole meshes is: no two cross, and somebody has sorted them, which is not timed.
"""

from __future__ import annotations

from dataclasses import replace

from benchmarks.contestants import Prepared
from benchmarks.contestants.opengl import available, environment
from benchmarks.contestants.opengl_effects import Picture
from benchmarks.effects_scenes import EffectScene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "Mesa llvmpipe, sorted"


def draws(scene: EffectScene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return None if scene.parts[0].colors is not None else "it stands beside layers only"


def prepare(scene: EffectScene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    return Sorted(scene) if scene.alpha == "blend" else Picture(scene)


class Sorted(Picture):
    """Layers, the farthest first."""

    def __init__(self, scene: EffectScene) -> None:
        parts = sorted(scene.parts, key=lambda part: -float(part.positions[0, 2]))
        super().__init__(replace(scene, parts=tuple(parts)))

    def draw(self) -> None:
        """Clear, blend, and wait until llvmpipe has finished."""
        context = self.context
        self.framebuffer.use()
        context.viewport = (0, 0, *self.scene.size)
        self.framebuffer.clear(0.0, 0.0, 0.0, 0.0)
        context.enable_only(context.BLEND)
        context.blend_func = (
            context.SRC_ALPHA, context.ONE_MINUS_SRC_ALPHA,
            context.ONE, context.ONE_MINUS_SRC_ALPHA,
        )  # fmt: skip
        for array in self.arrays:
            array.render(context.TRIANGLES)
        context.finish()
