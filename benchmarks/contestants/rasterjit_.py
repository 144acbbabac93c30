"""RasterJIT: the stages of a render up to the visibility buffer, and ``Framebuffer.draw_lines``."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "RasterJIT"

SUBPIXEL_BITS = 8
"""OpenGL's grid in Mesa, and RasterJIT's default."""

NEARER_IS_LESS = (0.0, -1.0, 0.0)
"""Stored depth ``-z / w``: greater is nearer, as OpenGL's ``<`` has it."""


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    return None if find_spec("rasterjit") else "the package rasterjit is not installed"


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    return Triangles(scene, threads)


class Triangles:
    """Transform, projection, clipping, set-up, binning and visibility."""

    def __init__(self, scene: TriangleScene, threads: int) -> None:
        from rasterjit import plan, stages
        from rasterjit.kernels.records import Objects

        self._stages = stages
        self._positions = scene.positions.astype(np.float64)
        self._faces = scene.faces
        self._vertex_starts = np.array([0, len(scene.positions)], np.int64)
        self._objects = Objects(np.array([0, len(scene.faces)], np.int64), np.zeros(1, np.int8))
        self._relative_from_model = np.eye(4)[np.newaxis]
        self._clip_from_relative = scene.clip_from_model
        self._viewport = plan.viewport_of(scene.size, SUBPIXEL_BITS)
        self._workers = stages.Workers(threads)

    def draw(self) -> None:
        """Find the visible face and its depth at every pixel."""
        vertices = self._stages.ModelVertices(
            self._positions,
            self._vertex_starts,
            self._relative_from_model,
            self._clip_from_relative,
        )
        self._coverage = self._stages.find_visible(
            vertices,
            self._faces,
            self._objects,
            NEARER_IS_LESS,
            self._viewport,
            self._workers,
            lambda stage: None,
        )

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the face at every pixel; it is a NumPy array already."""
        return {"face_id": self._coverage.face_id}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        face_id = self._coverage.face_id
        return {"covered": face_id >= 0, "face_id": face_id}


class Lines:
    """All lines in one call; one thread, for they are drawn in order."""

    def __init__(self, scene: LineScene) -> None:
        import rasterjit as rj

        self._scene = scene
        self._framebuffer = rj.Framebuffer(*scene.size)

    def draw(self) -> None:
        """Clear and draw."""
        self._framebuffer.clear((0, 0, 0, 0))
        self._framebuffer.draw_lines(self._scene.ends, self._scene.colors)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; it is a NumPy array already."""
        return {"color": self._framebuffer.color}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        color = self._framebuffer.color
        return {"covered": color[:, :, 3] > 0, "color": color}
