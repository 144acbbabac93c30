"""
Edges of faces, lines and strips, lit as faces are.

Lines are one pixel wide, cut off at their ends and not joined, as OpenGL's are with several samples
a pixel. Of faces that are culled no edges are drawn; an edge between two others is drawn once.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.constants import GLTF
from rasterjit.compat.pyrender.primitive import Primitive, finite
from rasterjit.scene import transforms
from rasterjit.scene.camera import MatrixCamera
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.normals import dot_rows, unit_rows
from rasterjit.scene.validation import read_only
from rasterjit.scene.vectors import cross, dot

Float64 = NDArray[np.float64]

LINE_MODES = (GLTF.LINES, GLTF.LINE_LOOP, GLTF.LINE_STRIP)
"""Modes of primitives that are lines."""

WIDTH = 1.0
"""Of lines, pixels."""

DEPTH_PLACE = 0.5, 0.5
"""
Where Mesa takes depths and attributes of lines from, with several samples a pixel: half a pixel to
the right of each and above it, which is below in pictures that are drawn upside down.
"""

NORMAL_COLOR = 0.1, 0.1, 1.0
"""What normals are drawn in, shares of 255."""

NORMAL_LENGTH = 0.05
"""Of normals, of their primitive's scale."""


class LitLines(Lines):
    """
    Lines that have normals and texture coordinates, so that any material will do.

    Parameters
    ----------
    points : (V, 3) array_like
    segments : (S, 2) array_like of int
    normals : (V, 3) array_like, optional
        Of any length; they change along segments.
    uv : (V, 2) array_like, optional
    colors : (V, 4) array_like, optional
    material : Material
    depth_place : (float, float)
        Where depths and attributes are taken from: how far to the right of each sample and below
        it, pixels.

    Raises
    ------
    ValueError
        If an array has the wrong shape.
    """

    def __init__(
        self,
        points: Any,
        segments: Any,
        *,
        normals: Any = None,
        uv: Any = None,
        colors: Any = None,
        material: Material,
        depth_place: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        super().__init__(
            points, segments, colors=colors, width=WIDTH, caps="butt", material=material,
            on_invalid="drop",
        )  # fmt: skip
        self._depth_place = depth_place
        # What lines have none of by themselves, checked as that of faces is.
        own = Mesh(points, [[0, 0, 0]], normals=normals, uv=uv, on_invalid="drop")
        self._normals = self._vertex_normals = own.normals
        self._uv = own.uv

    @property
    def links(self) -> NDArray[np.int32]:
        """(S, 2) int32: -1, for nothing is joined."""
        if self._links is None:
            self._links = np.full((len(self), 2), -1, np.int32)
        return self._links

    @staticmethod
    def _check_material(name: str, value: Any) -> None:
        Mesh._check_material(name, value)

    def picked(self, is_picked: NDArray[np.bool_]) -> LitLines:
        """Return some of the segments, (S,) bool, of the same points."""
        some = copy.copy(self)
        some._faces = read_only(self._faces[is_picked])
        some._links = some._bounds = None
        return some

    def shown_by(self, material: Material) -> LitLines:
        """Return the lines under another material."""
        if self._material == material:
            return self
        other = copy.copy(self)
        other.material = material
        return other


class _Edges:
    """The edges of a primitive's faces."""

    def __init__(self, primitive: Primitive, look: Material) -> None:
        faces = primitive.faces()
        self._segments, self._of_faces = _edges_between(faces)
        self._planes = _planes_of(primitive.positions.astype(np.float64)[faces])
        self._all = _lit_lines(primitive, self._segments, look, DEPTH_PLACE)
        self._eye: Float64 | None = None
        self._drawn: tuple[NDArray[np.bool_], LitLines] | None = None

    def all_of_them(self, look: Material) -> LitLines:
        """Return all edges."""
        self._all = self._all.shown_by(look)
        return self._all

    def of_front_faces(self, look: Material, clip_from_model: Float64) -> LitLines | None:
        """Return the edges of faces that are seen counterclockwise, or None without any."""
        eye = _eye_of(clip_from_model)
        if self._eye is None or not np.array_equal(self._eye, eye):
            self._pick(eye)
            self._eye = eye
        if self._drawn is None:
            return None
        self._drawn = self._drawn[0], self._drawn[1].shown_by(look)
        return self._drawn[1]

    def _pick(self, eye: Float64) -> None:
        """Find what is drawn where the eye is here, (4,); with w 0 it is infinitely far away."""
        # Which side of a plane it is on.
        (a, b, c, d), (x, y, z, w) = self._planes, eye
        is_front = ((a * x + b * y) + c * z) + d * w > 0.0
        is_picked = np.zeros(len(self._segments), np.bool_)
        is_picked[self._of_faces[is_front]] = True
        if not is_picked.any():
            self._drawn = None
        elif self._drawn is None or not np.array_equal(self._drawn[0], is_picked):
            self._drawn = is_picked, self._all.picked(is_picked)


def edges_of(
    primitive: Primitive, place: Float64, look: Material, camera: MatrixCamera | None
) -> LitLines | None:
    """
    Return the edges of a primitive's triangles, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    place : (4, 4) float64
        ``world_from_model``.
    look : Material
    camera : MatrixCamera, optional
        What culls faces; without it all have edges.
    """
    key = "edges", look.shading
    if key not in primitive._drawn:
        primitive._drawn[key] = _Edges(primitive, look)
    edges: _Edges = primitive._drawn[key]
    if camera is None:
        return edges.all_of_them(look)
    clip_from_model = transforms.compose(camera.clip_from_view, camera.view_from_world, place)
    return edges.of_front_faces(look, clip_from_model)


def lines_of(
    primitive: Primitive, look: Material, depth_place: tuple[float, float] = DEPTH_PLACE
) -> LitLines | None:
    """
    Return the lines of a primitive of lines, a loop or a strip, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    look : Material
    depth_place : (float, float)
        Where depths and attributes are taken from; see `LitLines`.
    """
    segments = _segments_of(primitive)
    if not len(segments):
        return None
    key = "lines", look.shading, depth_place
    known = primitive._drawn.get(key) or _lit_lines(primitive, segments, look, depth_place)
    primitive._drawn[key] = known.shown_by(look)
    return primitive._drawn[key]


def _lit_lines(
    primitive: Primitive,
    segments: NDArray[np.int64],
    look: Material,
    depth_place: tuple[float, float],
) -> LitLines:
    """Return lines between vertices of a primitive."""
    return LitLines(
        primitive.positions, segments, normals=finite(primitive.normals),
        uv=finite(primitive.texcoord_0), colors=primitive.colors(look.shading == "pbr"),
        material=look, depth_place=depth_place,
    )  # fmt: skip


def normals_of(
    primitive: Primitive, of_vertices: bool, of_faces: bool, color: NDArray[np.float32]
) -> Lines | None:
    """
    Return a primitive's normals as lines, in model space; None without any.

    Parameters
    ----------
    primitive : Primitive
    of_vertices, of_faces : bool
        Of which there are normals. Points have those of vertices.
    color : (4,) float32, linear
    """
    if primitive.normals is None:
        return None
    starts, ways = [], []
    faces, positions = primitive.faces(), primitive.positions.astype(np.float64)
    if of_vertices or not len(faces):
        starts.append(positions)
        ways.append(unit_rows(primitive.normals.astype(np.float64)))
    if of_faces and len(faces):
        a, b, c = np.moveaxis(positions[faces], 1, 0)
        starts.append((a + b + c) / 3.0)
        ways.append(unit_rows(np.cross(b - a, c - a)))
    if not starts:
        return None
    first = np.concatenate(starts)
    last = first + NORMAL_LENGTH * float(primitive.scale) * np.concatenate(ways)
    numbers = np.arange(len(first))
    return Lines(
        np.concatenate([first, last]), np.stack([numbers, numbers + len(first)], axis=1),
        colors=np.tile(color, (len(first), 1)), width=WIDTH, caps="butt", on_invalid="drop",
    )  # fmt: skip


def turns(camera: MatrixCamera, place: Float64) -> bool:
    """
    Tell whether front faces are seen clockwise, so that OpenGL takes them for back faces.

    It goes by the picture alone: mirrored poses and projections turn faces over.
    """
    clip = camera.clip_from_view
    # What grows with depth: w of a perspective, else z.
    deep = 3 if clip[3, :3].any() else 2
    return (_volume(clip[[0, 1, deep], :3]) > 0.0) != (_volume(place[:3, :3]) < 0.0)


def _segments_of(primitive: Primitive) -> NDArray[np.int64]:
    """Return the numbers of the points at the ends of each segment, (S, 2)."""
    numbers = primitive.order()
    if primitive.mode == GLTF.LINES:
        return numbers[: len(numbers) // 2 * 2].reshape(-1, 2)
    ends = np.roll(numbers, -1) if primitive.mode == GLTF.LINE_LOOP else numbers[1:]
    return np.stack([numbers[: len(ends)], ends], axis=1)


def _edges_between(
    faces: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return each edge once, (E, 2), in the order of faces, and the edges of each face, (F, 3)."""
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = ends.min(axis=1).astype(np.int64), ends.max(axis=1).astype(np.int64)
    _, first, inverse = np.unique(
        low * (int(high.max(initial=0)) + 1) + high, return_index=True, return_inverse=True
    )
    order = np.argsort(first, kind="stable")
    ranks = np.empty_like(order)
    ranks[order] = np.arange(len(order))
    return ends[first[order]], ranks[inverse].reshape(-1, 3)


def _planes_of(corners: Float64) -> Float64:
    """Return the planes of triangles, (F, 3, 3), whose product with a point is a volume, (4, F)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    return np.stack([*normals.T, -dot_rows(normals, a)])


def _eye_of(clip_from_model: Float64) -> list[float]:
    """
    Return the point that clip x, y and w take to 0, four numbers, homogeneous.

    Its product with a plane is the determinant of clip x, y and w of three of its points, which is
    above 0 where they are seen counterclockwise.
    """
    rows = clip_from_model[[0, 1, 3]]
    return [(1.0, -1.0)[k % 2] * _volume(np.delete(rows, k, axis=1)) for k in range(4)]


def _volume(rows: Float64) -> float:
    """Return the signed volume that three vectors, (3, 3), span."""
    a, b, c = rows.tolist()
    return dot(a, cross(b, c))
