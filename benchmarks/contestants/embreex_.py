"""
Embree through embreex: the first face that the ray through each pixel's centre meets.

Primary visibility by tracing rays: the tree over the faces is built and the rays are made
beforehand. Rays are traced on one thread.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import refusal
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "Embree (embreex)"

UNABLE = {
    "lines": "rays meet no lines",
    "edges": "rays meet no lines",
    "colors": "it finds faces, not colours",
    "lighting": "it finds faces, not colours",
    "instances": "embreex has no instances",
    "views": "every view has rays of its own",
    "culling": "rays meet back faces too",
}


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("embreex") is None:
        return 'the package embreex is not installed (pip install ".[bench]")'
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, UNABLE)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        raise ValueError(UNABLE["lines"])
    return FirstHits(scene)


def pixel_rays(scene: TriangleScene) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where the rays through the pixels start, on the near plane, and where they go."""
    width, height = scene.size
    x = (np.arange(width) + 0.5) / width * 2.0 - 1.0
    y = 1.0 - (np.arange(height) + 0.5) / height * 2.0
    points = np.ones((height, width, 4))
    points[:, :, 0], points[:, :, 1] = x, y[:, np.newaxis]
    model_from_clip, ends = np.linalg.inv(scene.clip_from_model), []
    for points[:, :, 2] in (-1.0, 1.0):
        found = points.reshape(-1, 4) @ model_from_clip.T
        ends.append(found[:, :3] / found[:, 3:])
    start, end = ends
    return start.astype(np.float32), (end - start).astype(np.float32)


class FirstHits:
    """The faces in Embree's tree, and a ray for each pixel."""

    def __init__(self, scene: TriangleScene) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        self._tree = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._tree, scene.positions, scene.faces)
        self._origins, self._directions = pixel_rays(scene)
        self._shape = scene.size[::-1]

    def draw(self) -> None:
        """Trace all rays."""
        self._faces = self._tree.run(self._origins, self._directions, query="INTERSECT")

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the face at every pixel."""
        return {"face_id": self._faces.reshape(self._shape)}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        face_id = self.read()["face_id"].astype(np.int32)
        return {"covered": face_id >= 0, "face_id": face_id}
