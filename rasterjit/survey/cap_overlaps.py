"""
Give each point of a cutting plane to one cap, where solids of several objects overlap.

Of two caps that share an area the smaller one is seen, so that what is inside of something stands
out; of equally large ones that of the later object. The other loses the shared area, as geometry:
every view, sample and shadow finds one cap there. All outlines are laid over one another, those of
smaller caps with weights that a cap's own windings cannot reach, so that the winding number of each
triangle tells whose it is. Where an edge was split, a triangle without area closes the gap that
rounding leaves beside it: it belongs to the cap whose edge that is, which is seen there anyway.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rasterjit.scene.arrays import Float64, Int64
from rasterjit.scene.section import SectionPlane
from rasterjit.survey.cap_outlines import (
    OutlineFiller,
    VertexRecipe,
    count_net_edges,
    flatten_points,
)

SMALLER_WEIGHT = 2**20
"""Winding number of smaller caps; larger than that of a cap's own outline."""

AREA_DIGITS = 9
"""Digits to which areas of caps are compared."""

MIN_SHARED_AREA = 1e-7
"""Least area that a cap loses to another, relative to that one's: less is where parts touch."""

MIN_TRIANGLE = 2.0**-32
"""Least area of triangles that points are located in, relative to the largest of a cap."""

POINTS_AT_ONCE = 256
"""Points that are located in the triangles of a cap together: their number limits the memory."""


class Cap(NamedTuple):
    """The cap of an object in a plane."""

    world: Float64
    """(V, 3): its vertices, in the world but for `scale_caps`."""
    faces: Int64
    """(T, 3)."""
    recipe: VertexRecipe
    whole_count: int
    """Vertices of the object's mesh, from which the recipe starts."""
    area: float


def scale_caps(caps: Sequence[Cap]) -> list[Cap]:
    """Return caps moved and scaled together, to size 1: their areas neither overflow nor vanish."""
    if not caps:
        return []
    low = np.min([cap.world.min(axis=0) for cap in caps], axis=0)
    high = np.max([cap.world.max(axis=0) for cap in caps], axis=0)
    size = float((high / 2.0 - low / 2.0).max()) or 1.0
    center = low / 2.0 + high / 2.0
    return [cap._replace(world=(cap.world - center) / size) for cap in caps]


def resolve_overlaps(plane: SectionPlane, caps: Sequence[Cap]) -> list[Cap | str | None]:
    """
    Take from each cap of a plane what smaller ones cover.

    Returns
    -------
    list
        Of each cap itself if nothing covers it, another one, or ``None`` if nothing is left; a text
        that says why it stays whole if the outlines cannot be laid over one another.
    """
    flat = [flatten_points(cap.world, plane.normal) for cap in caps]
    lows = np.array([points.min(axis=0) for points in flat])
    highs = np.array([points.max(axis=0) for points in flat])
    ranks = [(float(f"{cap.area:.{AREA_DIGITS}g}"), -number) for number, cap in enumerate(caps)]
    order = np.array(sorted(range(len(caps)), key=ranks.__getitem__))
    results: list[Cap | str | None] = list(caps)
    slivers: list[list[Float64]] = [[] for _ in caps]
    for place, number in enumerate(order.tolist()):
        smaller = order[:place]
        low, high = (
            np.maximum(lows[smaller], lows[number]),
            np.minimum(highs[smaller], highs[number]),
        )
        covers = smaller[(high - low > 0.0).all(axis=1)].tolist()
        if covers and caps[number].area > 0.0:
            group = [number, *covers]
            results[number], beside = _subtract(
                plane, [caps[one] for one in group], [flat[one] for one in group]
            )
            for owner, corners in beside:
                slivers[group[owner]].append(corners)
    for number, parts in enumerate(slivers):
        result = results[number]
        if parts and isinstance(result, Cap):
            joined = np.concatenate(parts)
            results[number] = _add_slivers(plane, result, caps[number], joined, flat[number])
    return results


class CapVertices:
    """Vertices of caps in a plane; see `PlaneVertices`."""

    def __init__(self, plane: SectionPlane, world: Float64) -> None:
        self.planes: Sequence[SectionPlane] = (plane,)
        self.world = world
        self.position_ids = np.arange(len(world))
        self.distances = np.zeros((len(world), 1))

    def add_vertices(
        self, plane: int, start: Int64, end: Int64, along: Float64 | None = None
    ) -> None:
        """Add vertices between others."""
        assert along is not None
        first = self.world[start]
        new = first + along[:, np.newaxis] * (self.world[end] - first)
        count = len(self.world) + len(new)
        self.world = np.concatenate([self.world, new])
        self.position_ids = np.arange(count)
        self.distances = np.zeros((count, 1))


def _subtract(
    plane: SectionPlane, caps: Sequence[Cap], flat: Sequence[Float64]
) -> tuple[Cap | str | None, list[tuple[int, Float64]]]:
    """
    Return what is left of the first cap without the others.

    Returns
    -------
    cap : Cap, str or None
        See `resolve_overlaps`.
    slivers : list of (int, (N, 3, 3) float64)
        Triangles without area that close gaps beside edges of a cap, given its number.
    """
    cap, own_count = caps[0], len(caps[0].world)
    vertices = CapVertices(plane, np.concatenate([one.world for one in caps]))
    filler = OutlineFiller(vertices, 0)
    found = filler.fill(*_overlay_outlines(caps, flat))
    if found is None:
        return "their outlines meet too often", []
    # Tell what is the cap's own by the winding numbers.
    is_sliver = np.arange(len(found)) >= len(found) - len(filler.slivers)
    is_own = ~is_sliver & (found[:, 3] < SMALLER_WEIGHT)
    is_lost = ~is_sliver & (found[:, 3] > SMALLER_WEIGHT) & (found[:, 3] % SMALLER_WEIGHT != 0)
    points = flatten_points(vertices.world, plane.normal)
    if not _is_covered(points, found[is_lost], caps, flat):
        return cap, []
    if not is_own.any():
        return None, []
    used, faces = np.unique(found[is_own, :3], return_inverse=True)
    old, new = used[used < own_count], used[used >= own_count]
    recipe, numbers = add_points(cap.recipe, cap, points[new], flat[0])
    left = cap._replace(
        world=vertices.world[used], faces=faces.reshape(-1, 3).astype(np.int64),
        recipe=recipe._replace(used=np.concatenate([cap.recipe.used[old], numbers])),
    )  # fmt: skip
    # Slivers beside what is left belong to the cap whose edge was split: it is seen there anyway.
    is_used = np.zeros(len(points), bool)
    is_used[used] = True
    is_beside = is_sliver & is_used[found[:, 1:3]].any(axis=1)
    owners = found[is_beside, 3] // SMALLER_WEIGHT
    is_fixed = np.array([one.area == 0.0 for one in caps])
    owners[(owners >= len(caps)) | is_fixed[owners.clip(max=len(caps) - 1)]] = 0
    corners = vertices.world[found[is_beside, :3]]
    return left, [(owner, corners[owners == owner]) for owner in np.unique(owners).tolist()]


def _is_covered(points: Float64, lost: Int64, caps: Sequence[Cap], flat: Sequence[Float64]) -> bool:
    """Tell whether the triangles that a cap would lose, (T, 4), are more than those of contacts."""
    # Caps grow with their numbers: where several cover a place, the sum tells a larger one.
    covers = np.minimum(lost[:, 3] // SMALLER_WEIGHT, len(caps) - 1)
    return any(
        _sum_areas(points, lost[covers == number])
        > MIN_SHARED_AREA * _sum_areas(flat[number], caps[number].faces)
        for number in np.unique(covers).tolist()
    )


def _add_slivers(plane: SectionPlane, left: Cap, cap: Cap, corners: Float64, flat: Float64) -> Cap:
    """Return what is left of a cap with more triangles, (N, 3, 3)."""
    points = corners.reshape(-1, 3)
    recipe, numbers = add_points(left.recipe, cap, flatten_points(points, plane.normal), flat)
    added = len(left.world) + np.arange(len(points)).reshape(-1, 3)
    return left._replace(
        world=np.concatenate([left.world, points]),
        faces=np.concatenate([left.faces, added]),
        recipe=recipe._replace(used=np.concatenate([recipe.used, numbers])),
    )


def _overlay_outlines(caps: Sequence[Cap], flat: Sequence[Float64]) -> tuple[Int64, Int64, Int64]:
    """Return the outlines of caps laid over one another: tails, heads, weights, (E,) each."""
    edges, first = [], 0
    for number, (cap, points) in enumerate(zip(caps, flat, strict=True)):
        tails, heads, sums = find_outline(cap.faces, points)
        weight = number * SMALLER_WEIGHT if number else 1
        edges.append(np.stack([tails + first, heads + first, sums * weight]))
        first += len(points)
    tails, heads, sums = np.concatenate(edges, axis=1)
    return tails, heads, sums


def find_outline(faces: Int64, flat: Float64) -> tuple[Int64, Int64, Int64]:
    """Return what `count_net_edges` does of triangles, all seen as counter-clockwise."""
    double_areas = _double_areas(flat, faces)
    faces = np.where((double_areas < 0.0)[:, np.newaxis], faces[:, ::-1], faces)
    faces = faces[double_areas != 0.0]
    return count_net_edges(faces.ravel(), np.roll(faces, -1, axis=1).ravel(), np.int64(1))


def _double_areas(points: Float64, faces: Int64) -> Float64:
    """Return twice the areas of triangles of points, (V, 2), above 0 if counter-clockwise, (T,)."""
    a, b, c = np.moveaxis(points[faces[:, :3]], 1, 0)
    b, c = b - a, c - a
    return b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]


def has_wide_triangle(points: Float64, faces: Int64) -> bool:
    """Tell whether points can be located in triangles, (T, 3): some have an area."""
    size = float(np.ptp(points, axis=0).max())
    largest = float(np.abs(_double_areas(points, faces)).max(initial=0.0))
    return largest > MIN_TRIANGLE * size * size


def _sum_areas(points: Float64, faces: Int64) -> float:
    """Return the sum of the areas of triangles, (T, 3), of either winding."""
    return 0.5 * math.fsum(np.abs(_double_areas(points, faces)).tolist())


def _locate(points: Float64, corners: Float64, faces: Int64) -> tuple[Int64, Float64]:
    """
    Find points in triangles.

    Parameters
    ----------
    points : (N, 2) float64
    corners : (V, 2) float64
    faces : (T, 3) int64

    Returns
    -------
    owners : (N, 3) int64
        The corners of the triangle that each lies in, or is nearest to lying in.
    weights : (N, 3) float64
        Barycentric, the least one first; below 0 outside of all triangles.
    """
    double_areas = _double_areas(corners, faces)
    sizes = np.abs(double_areas)
    is_wide = sizes > MIN_TRIANGLE * sizes.max()
    faces, double_areas = faces[is_wide], double_areas[is_wide]
    owners, weights = np.zeros((len(points), 3), np.int64), np.zeros((len(points), 3))
    a, b, c = np.moveaxis(corners[faces], 1, 0)
    for start in range(0, len(points), POINTS_AT_ONCE):
        rows = slice(start, start + POINTS_AT_ONCE)
        asked = points[rows, np.newaxis]
        parts = np.stack(
            [_cross(q - asked, r - asked) / double_areas for q, r in ((b, c), (c, a), (a, b))],
            axis=-1,
        )
        best = parts.min(axis=-1).argmax(axis=1)
        chosen = parts[np.arange(len(best)), best]
        turn = (chosen.argmin(axis=1)[:, np.newaxis] + np.arange(3)) % 3
        owners[rows] = np.take_along_axis(faces[best], turn, axis=1)
        weights[rows] = np.take_along_axis(chosen, turn, axis=1)
    return owners, weights


def _cross(a: Float64, b: Float64) -> Float64:
    """Return the cross products of vectors, (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def add_points(
    recipe: VertexRecipe, cap: Cap, points: Float64, flat: Float64
) -> tuple[VertexRecipe, Int64]:
    """
    Return a recipe with new vertices, and their numbers in it.

    Parameters
    ----------
    recipe : VertexRecipe
        Of the cap, or of what others left of it.
    cap : Cap
        As it was cut.
    points : (N, 2) float64
        In the plane, each in a triangle of the cap or beside it.
    flat : (V, 2) float64
        The cap's vertices in the plane.
    """
    owners, weights = _locate(points, flat, cap.faces)
    corners = cap.recipe.used[owners]
    count, new = cap.whole_count + sum(len(start) for start, _, _ in recipe.steps), len(points)
    # A point of the side across from the corner of the least weight, then one on the line of both.
    sums = weights[:, 1] + weights[:, 2]
    shares = np.divide(weights[:, 2], sums, out=np.zeros_like(sums), where=sums != 0.0)
    beside = corners[:, 1], corners[:, 2], shares
    inside = corners[:, 0], count + np.arange(new), 1.0 - weights[:, 0]
    return recipe._replace(steps=(*recipe.steps, beside, inside)), count + new + np.arange(new)
