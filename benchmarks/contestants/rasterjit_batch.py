"""
RasterJIT's ``render_batch``: all views of a scene in one call, into arrays that are there before.

Each picture is kept, in its place of one array, where others leave the last.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.rasterjit_ import (
    available,
    decode_srgb,
    environment,
    make_scene,
    refuses_all_but_colors,
)
from benchmarks.contestants.screen import matrices
from benchmarks.scenes import Scene, TriangleScene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "RasterJIT render_batch"


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refuses_all_but_colors(scene)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw, its kernels compiled or loaded by a first batch."""
    if not isinstance(scene, TriangleScene):
        raise ValueError("a batch draws meshes")
    ready = Views(scene, threads)
    ready.draw()
    return ready


class Views:
    """``rasterjit.render_batch``, from a scene to sRGB."""

    def __init__(self, scene: TriangleScene, threads: int) -> None:
        import rasterjit as rj

        self._render, self._scene, self._threads = rj.render_batch, make_scene(scene), threads
        self._size, self._cull = scene.size, scene.cull
        self._cameras = [rj.MatrixCamera(np.eye(4), matrix) for matrix in matrices(scene)]
        width, height = scene.size
        self._color = np.empty((len(self._cameras), height, width, 4), np.uint8)

    def draw(self) -> None:
        """Render every view; the array is NumPy's, so that it is read back as well."""
        self._render(
            self._scene, self._cameras, size=self._size, background="transparent",
            cull=self._cull, out={"color": self._color}, threads=self._threads,
        )  # fmt: skip

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the last picture."""
        return {"color": self._color[-1]}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared; colours decoded from sRGB."""
        color = self._color[-1]
        return {"covered": color[:, :, 3] > 0, "color_linear": decode_srgb(color[:, :, :3])}
