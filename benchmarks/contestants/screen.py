"""Scenes put on the screen beforehand, for contestants that take pixels; not timed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants.needs import EDGE_COLOR
from benchmarks.scenes import LineScene, TriangleScene

MIN_DETERMINANT = 1e-12
"""Of three rows of a matrix, below which they have no point in common."""


def screen_points(scene: TriangleScene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the vertices in pixels, y down, (V, 2), and their depths z / w, (V,)."""
    clip = scene.clip_positions()
    normalized = clip[:, :3] / clip[:, 3:]
    return (normalized[:, :2] * (1.0, -1.0) + 1.0) * 0.5 * np.array(scene.size), normalized[:, 2]


def far_to_near(faces: NDArray[np.int32], depths: NDArray[np.float64]) -> NDArray[np.int64]:
    """
    Return the order in which a painter draws faces: by the mean depth of their vertices, (F,).

    Of equal ones the later comes first, as a depth test with ``<`` has it.
    """
    mean = depths[faces].mean(axis=1)
    return np.lexsort((-np.arange(len(faces)), -mean))


def painted_faces(
    scene: TriangleScene,
) -> tuple[NDArray[np.float64], NDArray[np.uint8] | NDArray[np.int32]]:
    """
    Return what a painter draws, far faces first.

    Returns
    -------
    corners : (F, 3, 2) float64
        Pixels, y down, the centre of the first pixel at (0, 0).
    values : (F, 4) uint8, or (F,) int32 if the scene has no colours
        The mean colour of each face's corners, or its number, from 1.
    """
    points, depths = screen_points(scene)
    order = far_to_near(scene.faces, depths)
    corners = points[scene.faces[order]] - 0.5
    if scene.colors is None:
        return corners, (order + 1).astype(np.int32)
    return corners, face_colors(scene)[order]


def edge_lines(scene: TriangleScene) -> LineScene:
    """
    Return the edges of the faces, each once, as lines between the pixels of their ends.

    Edges that leave the picture are left out, for not everyone clips.
    """
    points, _ = screen_points(scene)
    ends = np.floor(points).astype(np.int64)[find_unique_edges(scene.faces)]
    ends = ends[((ends >= 0) & (ends < scene.size)).all(axis=(1, 2))].reshape(-1, 4)
    colors = np.tile(np.array(EDGE_COLOR, np.uint8), (len(ends), 2, 1))
    return LineScene(ends, colors, scene.size, len(ends))


def face_colors(scene: TriangleScene) -> NDArray[np.uint8]:
    """Return the mean colour of each face's vertices, (F, 4)."""
    if scene.colors is None:
        raise ValueError("the scene has no colours")
    return np.rint(scene.colors[scene.faces].mean(axis=1)).astype(np.uint8)


def find_unique_edges(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return every edge of the faces once, (N, 2), vertex numbers, the lower one first."""
    pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.ascontiguousarray(np.unique(pairs, axis=0), np.int32)


def model_vertices(scene: TriangleScene) -> NDArray[np.float32]:
    """Return the vertices of all instances in world space, (N V, 3), one mesh after the other."""
    if scene.instances is None:
        return scene.positions
    rotated = np.einsum("nij,vj->nvi", scene.instances[:, :3, :3], scene.positions)
    return (rotated + scene.instances[:, None, :3, 3]).reshape(-1, 3).astype(np.float32)


def all_faces(scene: TriangleScene) -> NDArray[np.int32]:
    """Return the faces of all instances, (N F, 3), as ``model_vertices`` numbers vertices."""
    if scene.instances is None:
        return scene.faces
    starts = np.arange(len(scene.instances), dtype=np.int32) * len(scene.positions)
    return (scene.faces + starts[:, None, None]).reshape(-1, 3)


def eye_of(clip_from_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the point, (3,), that a perspective matrix, (4, 4), takes to no place on the screen.

    Of a matrix without one, such as that of clip space itself, it is the origin.
    """
    rows = clip_from_world[[0, 1, 3]]
    if abs(np.linalg.det(rows[:, :3])) < MIN_DETERMINANT:
        return np.zeros(3)
    return np.linalg.solve(rows[:, :3], -rows[:, 3])


def matrices(scene: TriangleScene) -> NDArray[np.float64]:
    """Return the clip matrices of the pictures that are drawn one after the other, (K, 4, 4)."""
    return scene.clip_from_model[np.newaxis] if scene.views is None else scene.views
