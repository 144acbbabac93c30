"""
Fill outlines in a plane: split them where they meet, and triangulate what they wind around.

Points of the plane are snapped to an integer grid (`pipeline.geometry.cap_triangulation`). Where
outlines cross, vertices are added; a triangle without area closes the gap that rounding leaves
beside an edge that was split.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry.cap_triangulation import fill_outlines, find_contacts
from rasterjit.scene.arrays import Float64, Int64
from rasterjit.scene.section import SectionPlane
from rasterjit.scene.vectors import cross

GRID_STEPS = 2.0**28
"""Steps of the grid of outlines, from the centre of a section to its farthest point."""

MAX_MERGE_STEPS = 4
"""Most steps of the grid between a crossing and the end of an edge that it is merged with."""

MAX_SPLITS = 16
"""Most times that outlines are split where they meet; rounding rarely makes new contacts."""


class VertexRecipe(NamedTuple):
    """Recipe by which a cut mesh's vertices are interpolated from the original's."""

    steps: tuple[tuple[Int64, Int64, Float64], ...]
    """Of each generation of vertices: start and end of their edges, and the fraction from start."""
    used: Int64
    """The vertices that are kept, of the mesh and all generations."""

    def interpolate(self, values: NDArray[Any]) -> NDArray[Any]:
        """Interpolate values of the original's vertices, (V, ...), to those of the cut mesh."""
        count, made = len(values), np.empty((0, *values.shape[1:]))

        def of(numbers: Int64) -> NDArray[Any]:
            found = np.empty((len(numbers), *values.shape[1:]))
            is_old = numbers < count
            found[is_old], found[~is_old] = values[numbers[is_old]], made[numbers[~is_old] - count]
            return found

        for start, end, along in self.steps:
            share, first = along.reshape(-1, *(1,) * (values.ndim - 1)), of(start)
            with np.errstate(invalid="ignore", over="ignore"):
                made = np.concatenate([made, first + share * (of(end) - first)])
        return of(self.used).astype(values.dtype)


class PlaneVertices(Protocol):
    """Vertices that outlines are made of; those where outlines cross are added."""

    planes: Sequence[SectionPlane]
    distances: Float64
    """(V, P): from the planes."""
    world: Float64
    """(V, 3)."""
    position_ids: Int64
    """(V,): the same where positions are."""

    def add_vertices(
        self, plane: int, start: Int64, end: Int64, along: Float64 | None = None
    ) -> None:
        """Add vertices in a plane, interpolated between others."""


def count_net_edges(tails: Int64, heads: Int64, weights: Any) -> tuple[Int64, Int64, Int64]:
    """Return edges from lower to higher numbers with their net counts, where not 0."""
    weights = np.where(tails < heads, weights, -weights)
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    count = np.int64(high.max(initial=0)) + 1
    keys, inverse = np.unique(low * count + high, return_inverse=True)
    sums = np.zeros(len(keys), np.int64)
    np.add.at(sums, inverse.ravel(), weights)
    kept = (sums != 0) & (keys // count != keys % count)
    return keys[kept] // count, keys[kept] % count, sums[kept]


def plane_axes(normal: Any) -> tuple[Any, Any]:
    """Return two axes of the plane with a normal, at right angles and of one length."""
    x, y, z = normal
    # The coordinate axis farthest from the normal gives the first axis of the plane.
    axis_number = min(range(3), key=lambda k: abs((x, y, z)[k]))
    axis = tuple(float(k == axis_number) for k in range(3))
    across = cross(axis, (x, y, z))
    return across, cross((x, y, z), across)


def flatten_points(points: Float64, normal: Any) -> Float64:
    """Return points, (N, 3), on axes of the plane with a normal, (N, 2), seen from its tip."""
    return np.stack(
        [
            (a * points[:, 0] + b * points[:, 1]) + c * points[:, 2]
            for a, b, c in plane_axes(normal)
        ],
        axis=1,
    )


class OutlineFiller:
    """
    Filler of outlines in a plane.

    Parameters
    ----------
    cutter : PlaneVertices
        Vertices are added to it where outlines cross.
    plane : int
    """

    def __init__(self, cutter: PlaneVertices, plane: int) -> None:
        self.cutter, self.plane = cutter, plane
        self.slivers: list[tuple[int, int, int, int]] = []

    def fill(self, tails: Int64, heads: Int64, sums: Int64) -> Int64 | None:
        """Return triangles of vertices with multiplicities, (T, 4); None if not closed."""
        vertices, inverse = np.unique(np.concatenate([tails, heads]), return_inverse=True)
        grid = self._snap(vertices)
        low, high = inverse.ravel().reshape(2, -1)
        for _ in range(MAX_SPLITS):
            grid, vertices, low, high, sums = self._sort_points(grid, vertices, low, high, sums)
            edges = np.ascontiguousarray(np.stack([low, high, sums], axis=1))
            contacts = _find_edge_contacts(grid, edges)
            if not len(contacts):
                break
            grid, vertices, low, high, sums = self._split(contacts, grid, vertices, edges)
        triangles = _triangulate(grid, edges)
        if triangles is None:
            return None
        triangles[:, :3] = vertices[triangles[:, :3]]
        return np.concatenate([triangles, np.array(self.slivers, np.int64).reshape(-1, 4)])

    def _snap(self, vertices: Int64) -> Int64:
        """Snap vertices to the grid, (N, 2)."""
        points = self.cutter.world[vertices]
        points = points - (points.min(axis=0) / 2.0 + points.max(axis=0) / 2.0)
        flat = flatten_points(points, self.cutter.planes[self.plane].normal)
        size = float(np.abs(flat).max(initial=0.0)) or 1.0
        return np.rint(flat / size * GRID_STEPS).astype(np.int64)

    def _sort_points(
        self, grid: Int64, vertices: Int64, low: Int64, high: Int64, sums: Int64
    ) -> tuple[Int64, ...]:
        """Sort points by height, merging equal ones, and edges upward, by their start."""
        order = np.lexsort(grid.T)
        is_new = np.append(True, (grid[order][1:] != grid[order][:-1]).any(axis=1))
        numbers = np.empty(len(grid), np.int64)
        numbers[order] = np.cumsum(is_new) - 1
        chosen = order[is_new]
        # Points at one grid position are one vertex for later planes, too.
        position_ids, cutter = self.cutter.position_ids, self.cutter
        merged = np.arange(position_ids.max(initial=0) + 1)
        merged[position_ids[vertices]] = position_ids[vertices[chosen][numbers]]
        cutter.position_ids = merged[position_ids]
        low, high, sums = count_net_edges(numbers[low], numbers[high], sums)
        return grid[chosen], vertices[chosen], low, high, sums

    def _split(
        self, contacts: Int64, grid: Int64, vertices: Int64, edges: Int64
    ) -> tuple[Int64, ...]:
        """Split edges at their contacts; return points and edges."""
        number_by_position = {
            place: number for number, place in enumerate(map(tuple, grid.tolist()))
        }
        points = grid.tolist()
        inside: dict[int, set[int]] = {}
        crossings: list[tuple[int, int, float]] = []
        for edge, other, kind in contacts.tolist():
            if kind < 0:
                inside.setdefault(edge, set()).add(other)
                continue
            a, b = edges[edge, :2].tolist()
            c, d = edges[other, :2].tolist()
            start_area, end_area = (_double_signed_area(points, c, d, end) for end in (a, b))
            fraction = start_area / (start_area - end_area)
            x, y = (
                round(points[a][k] + fraction * (points[b][k] - points[a][k])) for k in range(2)
            )
            # Merge with near ends, or rounding would make new contacts endlessly.
            near_ends = (
                end
                for end in (a, b, c, d)
                if max(abs(points[end][0] - x), abs(points[end][1] - y)) <= MAX_MERGE_STEPS
            )
            number = next(near_ends, number_by_position.get((x, y), -1))
            if number < 0:
                number = number_by_position[x, y] = len(points)
                points.append([x, y])
                crossings.append((a, b, fraction))
            for one in (edge, other):
                if number not in edges[one, :2]:
                    inside.setdefault(one, set()).add(number)
        if crossings:
            first = len(self.cutter.distances)
            starts, ends, along = (np.array(part) for part in zip(*crossings, strict=True))
            self.cutter.add_vertices(
                self.plane, vertices[starts], vertices[ends], along.astype(np.float64)
            )
            vertices = np.append(vertices, np.arange(first, first + len(crossings)))
        rows = [row for n, row in enumerate(edges.tolist()) if n not in inside]
        for edge, points_inside in inside.items():
            a, b, count = edges[edge].tolist()
            keys = {n: _edge_sort_key(points, a, b, n) for n in points_inside}
            chain = [a, *sorted(points_inside, key=keys.__getitem__), b]
            rows += [(one, other, count) for one, other in pairwise(chain)]
            for one, other in pairwise(chain[1:]):
                triple = (a, other, one) if count > 0 else (a, one, other)
                vertex_ids = (int(vertices[n]) for n in triple)
                self.slivers.append((*vertex_ids, abs(count)))
        low, high, sums = np.array(rows, np.int64).reshape(-1, 3).T
        return np.array(points, np.int64), vertices, low, high, sums


def _double_signed_area(points: Sequence[Sequence[int]], a: int, b: int, c: int) -> int:
    """Return twice the area of a triangle, positive if counter-clockwise."""
    (x, y), (x_b, y_b), (x_c, y_c) = points[a], points[b], points[c]
    return (x_b - x) * (y_c - y) - (y_b - y) * (x_c - x)


def _edge_sort_key(points: Sequence[Sequence[int]], a: int, b: int, n: int) -> int:
    """Return a sort key that grows along an edge from a to b."""
    (x, y), (x_b, y_b), (x_n, y_n) = points[a], points[b], points[n]
    return (x_b - x) * (x_n - x) + (y_b - y) * (y_n - y)


def _find_edge_contacts(grid: Int64, edges: Int64) -> Int64:
    """Return the contacts of edges other than at their ends, (C, 3)."""
    capacity = 64
    while True:
        contacts = np.empty((capacity, 3), np.int64)
        count = find_contacts(grid, edges, np.empty(len(edges), np.int64), contacts)
        if count <= capacity:
            return contacts[:count]
        capacity = count


def _triangulate(grid: Int64, edges: Int64) -> Int64 | None:
    """Triangulate the area that edges enclose, (T, 4); None if they are not closed."""
    capacity = len(edges) + 4 * len(grid)
    triangles = np.empty((capacity, 4), np.int64)
    count = fill_outlines(
        grid, edges, np.empty(len(edges), np.int64), np.empty((4, len(edges)), np.int64),
        np.empty((3, capacity), np.int64), np.empty(2, np.int64), triangles,
    )  # fmt: skip
    return None if count < 0 else triangles[:count]
