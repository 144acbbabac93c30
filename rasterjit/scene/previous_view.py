"""The previous view of a scene, for motion vectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rasterjit.scene.attribute_guard import suggests_replace
from rasterjit.scene.camera import Camera


@suggests_replace
@dataclass(frozen=True)
class PreviousView:
    """
    Scene and camera at an earlier time, for motion vectors.

    Parameters
    ----------
    scene : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene, optional
        As it was. It has the same objects in the same order, each with as many faces: face n then
        is face n now, wherever its vertices were. Default: as it is now.
    camera : Camera, optional
        As it was. Default: as it is now.

    Examples
    --------
    >>> import rasterjit as rj
    >>> cube = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> now = rj.PerspectiveCamera(eye=(0.2, 0, 4), target=(0.2, 0, 0))
    >>> before = rj.PreviousView(camera=rj.PerspectiveCamera(eye=(0, 0, 4), target=(0, 0, 0)))
    >>> frame = rj.render(cube, now, outputs=("motion", "motion_visible"), previous=before)
    """

    scene: Any = None
    camera: Camera | None = None
