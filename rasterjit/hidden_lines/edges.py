"""
Find the edges of a scene that a line drawing shows, before any is hidden.

Vertices of one object at one position count as one, so that seams of normals or texture coordinates
are no boundaries; faces with the same corners count as one.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rasterjit.pipeline.geometry.setup import CLIPPED, INVALID
from rasterjit.pipeline.records import Geometry, Objects, Placement
from rasterjit.scene.arrays import Bool, Float64, Int32, Int64
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.edge_twins import edge_keys
from rasterjit.scene.normals import compute_area_vectors, dot_rows, safe_scale
from rasterjit.scene.transforms import sine_cosine
from rasterjit.survey.cache import SceneCache

LineKind: TypeAlias = Literal[
    "section", "boundary", "silhouette", "crease", "intersection", "line", "wireframe"
]
KINDS: tuple[LineKind, ...] = get_args(LineKind)
"""Kinds of edges; one that is of several is of the first."""

DEFAULT_KINDS: tuple[LineKind, ...] = (
    "section", "boundary", "silhouette", "crease", "intersection", "line",
)  # fmt: skip
"""All but the wireframe."""


class FeatureEdges(NamedTuple):
    """Edges that are drawn as lines, each with its kind."""

    vertices: Int32
    """(E, 2), vertex numbers of the packed scene."""
    kinds: Int64
    """(E,): index in `KINDS`."""
    objects: Int64
    """(E,), as in the packed scene."""
    is_turned_away: Bool
    """(E,): whether all faces at the edge are culled."""


class SurfaceFaces(NamedTuple):
    """The faces whose edges are looked at, without repeats."""

    corners: Int64
    """(F, 3), one vertex for each position."""
    objects: Int64
    windings: Int64
    """(F,): sign of the edge function on the screen, 0 of a face seen edge-on."""
    normals: Float64
    """(F, 3), twice the face's area long."""
    is_drawn: Bool
    """(F,): whether the face, or one with the same corners, is not culled."""
    positions: Float64
    """(V, 3): of all vertices, relative to the eye, world axes."""
    merged: Int64
    """(V,): the vertex that stands for all of an object at one position."""
    vertex_objects: Int64
    """(V,)."""
    reaches: Float64
    """(F,): largest coordinate of the corners about the object's own origin, along world axes."""


def find_edges(
    cache: SceneCache, faces: SurfaceFaces, kinds: tuple[str, ...], crease_angle: float
) -> FeatureEdges:
    """
    Find the edges of some kinds; intersections are none of them.

    Parameters
    ----------
    cache : SceneCache
    faces : SurfaceFaces
    kinds : tuple of str
        Of `KINDS`.
    crease_angle : float
        By how much a crease turns at least, degrees.
    """
    parts = [_find_lines(cache)] if "line" in kinds else []
    if len(faces.corners):
        cut, whole = _cut_edges(cache, faces.merged)
        parts.append(_classify(faces, kinds, crease_angle, cut, whole))
        if "section" in kinds:
            parts.append(_find_cap_corners(parts[-1], cut, faces.vertex_objects))
    return join_parts(parts)


def join_parts(parts: list[FeatureEdges]) -> FeatureEdges:
    """Return all edges of several tables."""
    none = np.empty(0, np.int64)
    empty = FeatureEdges(np.empty((0, 2), np.int32), none, none, np.empty(0, bool))
    return FeatureEdges(*(np.concatenate(arrays) for arrays in zip(empty, *parts, strict=True)))


def _find_lines(cache: SceneCache) -> FeatureEdges:
    """Return the segments of lines."""
    arrays = cache.shapes.arrays
    faces = np.zeros(len(arrays.faces), bool)
    for primitive in arrays.primitives:
        faces[slice(*primitive.faces)] = primitive.kind == "lines"
    vertices = np.ascontiguousarray(arrays.faces[faces][:, :2])
    return FeatureEdges(
        vertices, np.full(len(vertices), KINDS.index("line")),
        cache.shapes.object_numbers[:-1][faces].astype(np.int64), np.zeros(len(vertices), bool),
    )  # fmt: skip


def collect_faces(
    cache: SceneCache, geometry: Geometry, objects: Objects, placement: Placement
) -> SurfaceFaces:
    """Return the faces whose edges are looked at: triangles with three corners, none of a cap."""
    # Merge the vertices of an object at one position.
    vertex_starts = cache.shapes.arrays.vertex_starts
    vertex_objects = np.repeat(np.arange(len(vertex_starts) - 1), np.diff(vertex_starts))
    numbers, first_rows = distinct_rows(*placement.positions.T, vertex_objects)
    merged = first_rows[numbers]
    # Choose the faces.
    arrays, owners = cache.shapes.arrays, cache.shapes.object_numbers[:-1].astype(np.int64)
    is_wanted = np.ones(len(arrays.faces), bool)
    for primitive in arrays.primitives:
        is_wanted[slice(*primitive.faces)] = False
    if cache.cut is not None:
        # The outlines of caps are those of the cut.
        is_wanted &= cache.cut.face_numbers[:-1] < cache.cut.face_starts[-1]
    corners = merged[arrays.faces]
    a, b, c = corners.T
    is_wanted &= (a != b) & (b != c) & (c != a)
    is_wanted &= ~np.any(geometry.codes[arrays.faces] & INVALID, axis=1)
    corners, owners = corners[is_wanted], owners[is_wanted]
    windings = _find_windings(geometry, corners)
    is_drawn = windings * objects.culled_windings[owners] <= 0
    # Keep one of the faces with the same corners.
    if len(corners):
        same, firsts = distinct_rows(*np.sort(corners, axis=1).T)
        is_drawn = np.bincount(same, is_drawn, len(firsts)) > 0.0
        corners, owners, windings = corners[firsts], owners[firsts], windings[firsts]
    positions = _transform(placement, vertex_objects)
    used = positions[corners.ravel()] if len(corners) else np.ones((1, 3))
    scale = safe_scale(used.min(axis=0), used.max(axis=0))
    normals = compute_area_vectors(positions, corners.astype(np.int32), scale)
    reaches = _measure_reaches(placement, vertex_objects)[corners].max(axis=1)
    return SurfaceFaces(
        corners, owners, windings, normals, is_drawn, positions, merged, vertex_objects, reaches
    )


def _transform(placement: Placement, vertex_objects: Int64) -> Float64:
    """Return all vertices relative to the eye, (V, 3), world axes."""
    matrices, positions = placement.relative_from_model[vertex_objects], placement.positions
    return np.stack(
        [dot_rows(positions, matrices[:, k, :3]) + matrices[:, k, 3] for k in range(3)], 1
    )


def _measure_reaches(placement: Placement, vertex_objects: Int64) -> Float64:
    """Return bounds of the coordinates about the objects' origins, (V,), along world axes."""
    matrices = np.abs(placement.relative_from_model[vertex_objects, :3, :3])
    positions = np.abs(placement.positions)
    return np.stack([dot_rows(positions, matrices[:, k]) for k in range(3)]).max(axis=0)


def _find_windings(geometry: Geometry, faces: Int64) -> Int64:
    """Return the signs of the faces' edge functions on the screen, (F,), exactly if unclipped."""
    points = geometry.xy[faces].astype(np.int64)
    (ax, ay), (bx, by), (cx, cy) = (points[:, k].T for k in range(3))
    windings = np.sign((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    is_clipped = np.any(geometry.codes[faces] & CLIPPED, axis=1)
    if is_clipped.any():
        # The determinant of x, y and w: w may be negative. The screen's y points down.
        x, y, _, w = np.moveaxis(geometry.clip_positions[faces[is_clipped]], 2, 0)
        crosses = [x[:, k - 2] * y[:, k - 1] - y[:, k - 2] * x[:, k - 1] for k in range(3)]
        determinant = (crosses[0] * w[:, 0] + crosses[1] * w[:, 1]) + crosses[2] * w[:, 2]
        windings[is_clipped] = -np.sign(determinant).astype(np.int64)
    return windings


def _cut_edges(cache: SceneCache, merged: Int64) -> tuple[Int64, Int64 | None]:
    """Return the keys of a section's edges, and those of all edges but inside a cut face."""
    if cache.cut is None:
        return np.empty(0, np.int64), None
    cut = [edge_keys(*merged[edges].T) for edges in cache.cut.edges]
    return np.unique(np.concatenate(cut)), np.unique(edge_keys(*merged[cache.edges].T))


def _find_cap_corners(found: FeatureEdges, cut: Int64, vertex_objects: Int64) -> FeatureEdges:
    """Return the edges of a section at which caps alone meet."""
    missing = np.setdiff1d(cut, edge_keys(*found.vertices.astype(np.int64).T))
    vertices = np.stack([missing >> 32, missing & 0xFFFFFFFF], axis=1)
    return FeatureEdges(
        vertices.astype(np.int32), np.zeros(len(missing), np.int64),
        vertex_objects[vertices[:, 0]], np.zeros(len(missing), bool),
    )  # fmt: skip


def find_neighbours(corners: Int64) -> Int32:
    """Return a face across each edge of faces, (F, 3), the first from corner 0 to 1, or -1."""
    keys = edge_keys(corners.ravel(), np.roll(corners, -1, axis=1).ravel())
    order = np.argsort(keys, kind="stable")
    is_same = keys[order][1:] == keys[order][:-1]
    before, after = order[:-1][is_same], order[1:][is_same]
    found = np.full(len(keys), -1, np.int32)
    found[after], found[before] = before // 3, after // 3
    return found.reshape(-1, 3)


def _classify(
    faces: SurfaceFaces,
    kinds: tuple[str, ...],
    crease_angle: float,
    cut: Int64,
    whole: Int64 | None,
) -> FeatureEdges:
    """Return the edges of faces that are of one of some kinds."""
    tails, heads = faces.corners.ravel(), np.roll(faces.corners, -1, axis=1).ravel()
    keys = edge_keys(tails, heads)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.append(True, np.diff(keys[order]) != 0))
    counts = np.diff(np.append(starts, len(keys)))
    edges = keys[order][starts]
    # Of the first two faces at each edge: windings and normals as if they were wound one way.
    first, second = order[starts], order[np.minimum(starts + 1, len(keys) - 1)]
    sign = np.where(tails[first] == tails[second], -1, 1)
    windings, normals = faces.windings, faces.normals
    is_front, is_other_front = windings[first // 3] > 0, sign * windings[second // 3] > 0
    one, other = normals[first // 3], normals[second // 3]
    _, min_cosine = sine_cosine(crease_angle)
    lengths = np.sqrt(dot_rows(one, one)) * np.sqrt(dot_rows(other, other))
    is_drawn = faces.is_drawn[order // 3]
    masks = {
        "section": np.isin(edges, cut),
        "boundary": counts == 1,
        "silhouette": (counts == 2) & (is_front != is_other_front),
        "crease": (counts > 2)
        | ((counts == 2) & (sign * dot_rows(one, other) < min_cosine * lengths)),
        "wireframe": np.ones(len(edges), bool) if whole is None else np.isin(edges, whole),
    }
    found = np.full(len(edges), -1)
    for number in reversed(range(len(KINDS))):
        if KINDS[number] in kinds and KINDS[number] in masks:
            found[masks[KINDS[number]]] = number
    if "section" not in kinds:
        found[masks["section"]] = -1
    is_found, is_shown = found >= 0, np.logical_or.reduceat(is_drawn, starts) | masks["section"]
    return FeatureEdges(
        np.stack([edges >> 32, edges & 0xFFFFFFFF], axis=1)[is_found].astype(np.int32),
        found[is_found], faces.objects[first // 3][is_found],
        ~is_shown[is_found],
    )  # fmt: skip
