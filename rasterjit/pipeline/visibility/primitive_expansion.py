"""
Expand lines and points into screen-space triangles ("pieces"), which are rasterized instead.

A segment is a face (a, b, b), a point a face (i, i, i), without area. Their pieces follow those of
clipped faces, as triangles with their own vertices, so later stages, from coverage to transparency,
need no special case. Vertices of segments and points get a ``CLIPPED`` outcode: then pieces are
drawn in the face's place, and weights come from clip positions (see ``barycentric``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry.setup import GUARD, INVALID
from rasterjit.pipeline.records import Faces, ScreenVertices, Viewport
from rasterjit.runtime.threads import Workers
from rasterjit.scene.vectors import cross, dot, length


class LineRule(NamedTuple):
    """Drawing rules for the segments of an object."""

    links: NDArray[np.int32]
    """(S, 2): the segments before and after that each is joined to; -1 for none."""
    dashes: NDArray[np.float64]
    """(D,): lengths of dash, gap, dash, gap ..., in the unit of the widths; (0,) where solid."""
    is_round: bool
    """Whether caps are round; else butt."""
    depth_offset: tuple[float, float] = (0.0, 0.0)
    """Offset, right and down, from a sample to where depth and attributes are evaluated, pixels."""


class PointRule(NamedTuple):
    """Drawing rules for the points of an object."""

    shape: str
    """``square``, ``disc`` or ``sphere``."""


class Primitive(NamedTuple):
    """An object whose faces are segments or points."""

    kind: str
    """``lines`` or ``points``."""
    number: int
    """Index of the object in the scene."""
    vertices: tuple[int, int]
    """The first vertex, and one past the last."""
    faces: tuple[int, int]
    """The first face, and one past the last."""
    sizes: NDArray[np.float64]
    """(1,) or (N,): widths of segments or sizes of points, shared or each."""
    is_world: bool
    """Whether sizes are in model space, else in pixels."""
    rule: LineRule | PointRule


class Primitives(NamedTuple):
    """The objects of a picture whose faces are segments or points, and how large they are in it."""

    objects: tuple[Primitive, ...]
    """In the order of their faces."""
    scales: NDArray[np.float64]
    """(O,): largest scale factor of each object's transform."""
    pixels: float
    """Drawn pixels for each pixel of sizes."""
    units: float
    """Pixels of the drawn picture per world unit across the view, at w = 1."""
    positions: NDArray[np.float64] | NDArray[np.float32]
    """(V, 3), model space."""
    lengths: tuple[float, float]
    """Columns and rows per world unit along each, at w = 1."""

    @property
    def kinds(self) -> frozenset[str]:
        """Kinds of the objects."""
        return frozenset(one.kind for one in self.objects)

    def find(self, number: int) -> Primitive | None:
        """Return an object by its number in the scene; None if its faces are triangles."""
        return next((one for one in self.objects if one.number == number), None)

    def pixels_per_size(self, one: Primitive) -> float:
        """Return the factor from an object's sizes to pixels; at w = 1 for sizes in model space."""
        return self.units * float(self.scales[one.number]) if one.is_world else self.pixels


def collect_primitives(
    objects: tuple[Primitive, ...],
    relative_from_model: NDArray[np.float64],
    positions: NDArray[Any],
    clip_from_relative: NDArray[np.float64],
    size: tuple[int, int],
    pixels: float = 1.0,
) -> Primitives | None:
    """
    Collect the lines and points of a picture, and their scale factors; None without any.

    Parameters
    ----------
    objects : tuple of Primitive
        The objects whose faces are segments or points.
    relative_from_model : (O, 3 or 4, 4) float64
    positions : (V, 3) float64 or float32, model space
        The positions that are projected.
    clip_from_relative : (4, 4) float64
        From world axes with the origin at the eye.
    size : (int, int)
        Width and height of the whole picture, pixels.
    pixels : float
        Drawn pixels for each pixel of sizes.
    """
    if not objects:
        return None
    m = relative_from_model
    with np.errstate(over="ignore"):
        # A fixed order of additions, for every CPU.
        lengths = np.sqrt(
            (m[:, 0, :3] * m[:, 0, :3] + m[:, 1, :3] * m[:, 1, :3]) + m[:, 2, :3] * m[:, 2, :3]
        )
    width, height = size
    units = 0.5 * math.sqrt(_measure_facing_area(clip_from_relative) * width * height)
    across = find_pixels_per_unit(clip_from_relative, size)
    return Primitives(objects, lengths.max(axis=1), pixels, units, positions, across)


def find_pixels_per_unit(
    clip_from_relative: NDArray[np.float64], size: tuple[int, int]
) -> tuple[float, float]:
    """Return the pixels per world unit along columns and along rows, at w = 1."""
    right, up, _, deep = (row[:3] for row in np.asarray(clip_from_relative).tolist())
    return _measure_perpendicular(right, deep) * size[0] / 2.0, _measure_perpendicular(
        up, deep
    ) * size[1] / 2.0


def _measure_perpendicular(row: list[float], deep: list[float]) -> float:
    """Return the length of a row's component perpendicular to the direction in which w grows."""
    square = dot(deep, deep)
    if square > 0.0:
        factor = dot(row, deep) / square
        row = [a - factor * b for a, b in zip(row, deep, strict=True)]
    return length(row)


def _measure_facing_area(clip_from_relative: NDArray[np.float64]) -> float:
    """Return the area in x and y, at w = 1, of a unit square facing the view."""
    columns, rows, _, deep = (row[:3].tolist() for row in np.asarray(clip_from_relative))
    normal = cross(columns, rows)
    size = length(deep)
    return abs(dot(normal, deep)) / size if size > 0.0 else length(normal)


class Projected(NamedTuple):
    """A picture's faces and projected vertices, before expansion."""

    faces: NDArray[np.int32]
    """(F, 3)."""
    clip_positions: NDArray[np.float64]
    """(V, 4), clip space."""
    codes: NDArray[np.uint8]
    """(V,), outcodes."""
    depth_coefficients: tuple[float, float, float]
    viewport: Viewport


class Expansion(NamedTuple):
    """The counted pieces of an object, and the function that writes them."""

    vertices: int
    pieces: int
    write: Callable[[int, ScreenVertices, NDArray[np.int32], NDArray[np.int32]], None]
    """Takes the number of the first vertex, the screen's vertices, and the arrays of pieces (P, 3)
    and of their faces (P,) to write."""


Expand = Callable[[Primitive, Primitives, Projected, Workers], Expansion]
"""Counts the pieces of an object."""


def find_gaps(runs: Sequence[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
    """Yield the gaps that ascending runs (first, one past the last) leave in ``range(count)``."""
    first = 0
    for start, end in runs:
        if start > first:
            yield first, start
        first = end
    if count > first:
        yield first, count


def expand_primitives(
    primitives: Primitives,
    expanders: dict[str, Expand],
    projected: Projected,
    cut: Faces,
    screen: ScreenVertices,
    allocate: Callable[[int], ScreenVertices],
    workers: Workers,
) -> tuple[Faces, ScreenVertices]:
    """
    Expand all segments and points into pieces.

    Parameters
    ----------
    primitives : Primitives
    expanders : dict
        The function that counts an object's pieces, by kind; kinds without one have no pieces.
    projected : Projected
    cut : Faces
        All faces, and the pieces of triangles that were clipped.
    screen : ScreenVertices
        The vertices, and those that clipping made; outcodes of vertices of segments and points are
        changed.
    allocate : callable
        Allocates memory for a number of vertices.
    workers : Workers

    Returns
    -------
    Faces
        The pieces of clipped faces, of segments and of points, in the order of the faces.
    ScreenVertices
        The vertices, followed by those of pieces.
    """
    expansions = [
        (one, expanders[one.kind](one, primitives, projected, workers))
        for one in primitives.objects
        if one.kind in expanders
    ]
    vertex_count = int(cut.pieces.max()) + 1 if len(cut.pieces) else len(projected.clip_positions)
    total_vertices = vertex_count + sum(expansion.vertices for _, expansion in expansions)
    if total_vertices > len(screen.codes):
        larger = allocate(total_vertices)
        for old, new in zip(screen, larger, strict=True):
            new[:vertex_count] = old[:vertex_count]
        screen = larger
    count = len(cut.pieces) + sum(expansion.pieces for _, expansion in expansions)
    pieces, piece_faces = np.empty((count, 3), np.int32), np.empty(count, np.int32)
    copied_pieces = next_piece = 0
    for one, expansion in expansions:
        stop = int(cut.piece_faces.searchsorted(one.faces[0]))
        next_piece = _copy_pieces(cut, copied_pieces, stop, pieces, piece_faces, next_piece)
        copied_pieces, object_pieces = stop, slice(next_piece, next_piece + expansion.pieces)
        screen.codes[vertex_count : vertex_count + expansion.vertices] = 0
        expansion.write(vertex_count, screen, pieces[object_pieces], piece_faces[object_pieces])
        vertex_count, next_piece = vertex_count + expansion.vertices, object_pieces.stop
    _copy_pieces(cut, copied_pieces, len(cut.pieces), pieces, piece_faces, next_piece)
    for one in primitives.objects:
        codes = screen.codes[slice(*one.vertices)]
        # Never outside: pieces extend beyond the vertices.
        codes[:] = np.where(codes & INVALID, INVALID, GUARD)
    return Faces(cut.faces, pieces, piece_faces), screen


def _copy_pieces(
    cut: Faces,
    first: int,
    stop: int,
    pieces: NDArray[np.int32],
    piece_faces: NDArray[np.int32],
    next_piece: int,
) -> int:
    """Copy pieces of clipped faces into the array of all; return the index of the next."""
    end = next_piece + stop - first
    pieces[next_piece:end] = cut.pieces[first:stop]
    piece_faces[next_piece:end] = cut.piece_faces[first:stop]
    return end
