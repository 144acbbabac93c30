"""
Compute the objects' transforms and bounding boxes, and cull them against the view frustum.

The only place where boxes are tested against the frustum.

An object is out of view where the box around it surely lies beyond one of the six planes. What is
not sure counts as in view.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.geometry.depth_range import SURE
from rasterjit.pipeline.records import Objects
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera, MatrixCamera, OrthographicCamera, PerspectiveCamera
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.validation import finite_array

Float64 = NDArray[np.float64]

ROUNDING = 2.0**-40
"""Distance beyond a plane required for culling, relative to the terms summed: far above float64's
rounding error. Snapping moves no vertex over the border of the picture."""

CORNERS = np.array([[n & 1, n >> 1 & 1, n >> 2 & 1] for n in range(8)])
"""Which end of its box each corner lies at, by axis."""

KNOWN_CAMERAS = frozenset((PerspectiveCamera, OrthographicCamera, MatrixCamera))
"""Cameras whose poses are checked on construction; not subclasses."""

LAST_ROW = [0.0, 0.0, 0.0, 1.0]
"""Of an affine matrix."""

FEW = 8
"""Most objects that are tested one by one in plain Python: NumPy takes longer."""

EVENNESS = 2.0**-12
"""Share by which the squared lengths of an object's axes may differ, and their cosines: light on
normals that are as much too long or too short is a sixteenth of a code of 8 bits off."""


_WITHOUT_ORIGIN = "is_nothing", "middles_and_axes", "_halves", "boxes", "reach", "_columns"
"""What `Extents` find out that is the same where objects are only shifted."""


class Extents:
    """
    World-space extents of a scene's objects, independent of the camera.

    Parameters
    ----------
    bounds : (O, 2, 3) float64
        Low and high corner of each object, model space; NaN for one without a finite face.
    world_from_model : (O, 4, 4) float64
        Or to anything else that is not turned or scaled against the world; (N, O, 4, 4) where
        objects stand elsewhere in each of N views: then all below has N before the last O.
    """

    def __init__(self, bounds: Float64, world_from_model: Float64) -> None:
        self.bounds = bounds
        self._world_from_model = world_from_model

    def moved(self, before: Places, after: Places) -> Extents:
        """Return those of the same objects elsewhere: themselves, if `move_objects` moved none."""
        if after is before:
            return self
        other, known = Extents(self.bounds, after.world_from_model), self.__dict__
        if after.normal_matrices is before.normal_matrices:
            # Only shifted.
            other.__dict__.update({name: known[name] for name in _WITHOUT_ORIGIN if name in known})
        return other

    @cached_property
    def is_nothing(self) -> NDArray[np.bool_]:
        """Which objects have no finite face, (O,)."""
        return np.isnan(self.bounds[:, 0, 0])

    @cached_property
    def middles_and_axes(self) -> tuple[Float64, Float64]:
        """
        Where the middles of boxes lie, and where from there their faces across each axis.

        Returns
        -------
        middles : (3, O)
            World axes, from the object's origin.
        axes : (3, 3, O)
            Of each axis of the model (second index), along the world's axes (first).
        """
        low, high = np.ascontiguousarray(self.bounds.transpose(1, 2, 0))
        with np.errstate(invalid="ignore", over="ignore"):
            middle, half = low / 2.0 + high / 2.0, high / 2.0 - low / 2.0
            x, y, z = self._columns.swapaxes(0, 1)
            middles = (x * middle[0] + y * middle[1]) + z * middle[2]
            return middles, self._columns * half.reshape(3, *(1,) * (x.ndim - 2), -1)

    @cached_property
    def _halves(self) -> Float64:
        """Half the sizes of boxes along the world's axes around those of objects, (3, O)."""
        return np.add.reduce(np.abs(self.middles_and_axes[1]), axis=1)

    @cached_property
    def around(self) -> tuple[Sequence[float], Sequence[float]]:
        """Low and high corner of a box around all, (3,) each, world space, but for rounding."""
        if len(self.bounds) > FEW:
            with np.errstate(invalid="ignore", over="ignore"):
                middles = self._world_from_model[:, :3, 3].T + self.middles_and_axes[0]
                low = np.fmin.reduce(middles - self._halves, axis=1, initial=math.inf)
                high = np.fmax.reduce(middles + self._halves, axis=1, initial=-math.inf)
            return low.tolist(), high.tolist()
        lows, highs = [(math.inf,) * 3], [(-math.inf,) * 3]
        origins = self._world_from_model[:, :3, 3].tolist()
        for (middle, half), origin in zip(self.boxes, origins, strict=True):
            # What is in no face has no box.
            if middle[0] == middle[0]:
                places = list(map(operator.add, origin, middle))
                lows.append(tuple(map(operator.sub, places, half)))
                highs.append(tuple(map(operator.add, places, half)))
        least, most = zip(*lows, strict=True), zip(*highs, strict=True)
        return list(map(min, least)), list(map(max, most))

    @cached_property
    def boxes(self) -> list[tuple[list[float], list[float]]]:
        """
        Of each object the middle of its box, and half the size of one around it.

        World axes; middles from the object's origin. For few objects: NumPy does many faster.
        """
        found = []
        columns = self._world_from_model[:, :3].tolist()
        for (low, high), rows in zip(self.bounds.tolist(), columns, strict=True):
            (p, a), (q, b), (r, c) = [
                (least / 2.0 + most / 2.0, most / 2.0 - least / 2.0)
                for least, most in zip(low, high, strict=True)
            ]
            found.append((
                [(x * p + y * q) + z * r for x, y, z, _ in rows],
                [abs(x) * a + abs(y) * b + abs(z) * c for x, y, z, _ in rows],
            ))  # fmt: skip
        return found

    @cached_property
    def reach(self) -> Float64:
        """What each coordinate along the world's axes has terms of, from the origin, (3, O)."""
        low, high = np.ascontiguousarray(self.bounds.transpose(1, 2, 0))
        with np.errstate(invalid="ignore", over="ignore"):
            farthest = np.abs(low / 2.0 + high / 2.0) + (high / 2.0 - low / 2.0)
            x, y, z = np.abs(self._columns).swapaxes(0, 1)
            return (x * farthest[0] + y * farthest[1]) + z * farthest[2]

    @cached_property
    def _columns(self) -> Float64:
        """Entries of the matrices but for the translation, (3, 3, O): row, column, object."""
        axes = self._world_from_model[..., :3, :3]
        return np.ascontiguousarray(axes.transpose(-2, -1, *range(axes.ndim - 2)))


class BoxMeasures(NamedTuple):
    """Positions of object boxes relative to a view's planes; (N, O) of N views for each (O,)."""

    inside: Float64
    """How far inside of each plane a box reaches, clip space: far at 2, near at 5, (6, O)."""
    widths: Float64
    """By how much the far and the near plane tell the ends of each axis apart, (2, 3, O)."""
    reach: Float64
    """What |w| plus each of |x|, |y| and |z| is at most in clip space, (3, O)."""
    beside: NDArray[np.bool_]
    """Which boxes are all beyond a side of the view, or of nothing, (O,)."""
    in_view: NDArray[np.bool_]
    """Which may be seen: not all beyond a plane of the view volume, (O,)."""

    def of(self, views: int | list[int]) -> BoxMeasures:
        """Return those of one of N views, or of some."""
        return BoxMeasures(
            self.inside[..., views, :], self.widths[..., views, :], self.reach[..., views, :],
            self.beside[..., views, :], self.in_view[..., views, :],
        )  # fmt: skip

    def may_cross(self, near: float | Float64, far: float | Float64) -> NDArray[np.bool_]:
        """Tell which objects may cross a plane; takes what `Boxes.may_cross` does, or (N, 1)."""
        with np.errstate(invalid="ignore", over="ignore"):
            at_far, at_near = self.inside[2::3] - 2.0 * np.add.reduce(self.widths, axis=1)
            doubt = ROUNDING * self.reach[2]
            stays = (at_far >= far + doubt) & (at_near >= near + doubt)
        return ~(stays | self.beside)

    def largest_w(self) -> Float64:
        """Return a clip-space w that nothing in view is beyond, of each view."""
        return np.where(self.in_view, self.reach[0], 0.0).max(axis=-1, initial=0.0)


def measure_boxes(
    extents: Extents, relative_from_model: Float64, clip_from_relative: Float64
) -> BoxMeasures:
    """
    Test the boxes of objects against the planes of a view, or of each of N.

    Parameters
    ----------
    extents : Extents
        Of the objects where they stand, in all views or in each.
    relative_from_model : (O, 4, 4), or (N, O, 4, 4) float64
        To world axes with the origin at the eye.
    clip_from_relative : (4, 4), or (N, 4, 4) float64
    """
    middles, axes = extents.middles_and_axes
    reach = extents.reach
    if relative_from_model.ndim == 3:
        origins, matrix = relative_from_model[:, :3, 3].T, clip_from_relative[..., np.newaxis]
    else:
        # Coordinates first: each entry is an array of all objects in all views.
        origins = relative_from_model[..., :3, 3].transpose(2, 0, 1)
        matrix = clip_from_relative.transpose(1, 2, 0)[..., np.newaxis]
        if middles.ndim == 2:
            middles, reach = middles[:, np.newaxis], reach[:, np.newaxis]
            axes = np.broadcast_to(axes[:, :, np.newaxis], (3, *origins.shape))
    with np.errstate(invalid="ignore", over="ignore"):
        points = np.concatenate((axes, (origins + middles)[:, np.newaxis]), axis=1)
        # A plane holds inside what has a x + b y + c z + d >= 0: rows w - x, w + x, and so on.
        w = matrix[3]
        planes = np.concatenate((w - matrix[:3], w + matrix[:3]))
        # Measure the corner of each box that lies farthest inside.
        onto = along(planes, points)
        halves = np.abs(onto[:, :3])
        inside = (onto[:, 3] + planes[:, 3]) + np.add.reduce(halves, axis=1)
        # Of both rows: what is drawn compares them, and they may nearly cancel.
        rows = np.abs(w) + np.abs(matrix[:3])
        most = along(rows, np.abs(origins) + reach) + rows[:, 3]
        # NaN counts as unsure.
        beyond = inside.reshape(2, 3, *inside.shape[1:]) < -ROUNDING * most
    across = np.logical_or.reduce(beyond, axis=0)
    beside = extents.is_nothing | across[0] | across[1]
    return BoxMeasures(inside, halves[2::3], most, beside, ~(beside | across[2]))


class Boxes:
    """
    The bounding boxes of a scene's objects, relative to a camera's eye.

    Parameters
    ----------
    extents : Extents
        Of the objects where they stand.
    eye : (3,) float64, world space
    relative_from_model : (O, 4, 4) float64
        To world axes with the origin at the eye.
    clip_from_relative : (4, 4) float64
    measures : BoxMeasures, optional
        Of these boxes, if they are known.
    beyond : ((O,) bool, float, float), optional
        Which objects reach beyond their boxes in the picture, and by how much of half its width and
        height.

    Attributes
    ----------
    eye : (3,) float64, world space
    """

    def __init__(
        self, extents: Extents, eye: Float64, relative_from_model: Float64,
        clip_from_relative: Float64, measures: BoxMeasures | None = None,
        beyond: tuple[NDArray[np.bool_], float, float] | None = None,
    ) -> None:  # fmt: skip
        self.eye = eye
        self._extents, self._bounds = extents, extents.bounds
        self.relative_from_model = relative_from_model
        self._clip_from_relative, self._given = clip_from_relative, measures
        self._beyond = beyond

    @cached_property
    def in_view(self) -> NDArray[np.bool_]:
        """Which objects the camera may see, (O,): those not all beyond a plane."""
        if self._given is None and self._are_surely_in_view():
            return np.ones(len(self._bounds), np.bool_)
        if self._beyond is None:
            return self._measures.in_view
        wide = self.widened(self._clip_from_relative)
        around = measure_boxes(self._extents, self.relative_from_model, wide)
        return self._measures.in_view | (self._beyond[0] & around.in_view)

    def widened(self, clip_from_relative: Float64) -> Float64:
        """Return a projection, (4, 4), that shows all that is as large as in pixels."""
        wide = clip_from_relative.copy()
        if self._beyond is not None:
            wide[0] /= 1.0 + self._beyond[1]
            wide[1] /= 1.0 + self._beyond[2]
        return wide

    def _are_surely_in_view(self) -> bool:
        """Tell whether all boxes reach inside of every plane; of few, whether their middles do."""
        if len(self._bounds) > FEW:
            matrix, (middles, axes) = self._clip_from_relative, self._extents.middles_and_axes
            planes = np.concatenate((matrix[3] - matrix[:3], matrix[3] + matrix[:3]))
            # Boxes out of view are outside by ``ROUNDING``: however a product rounds, none is here.
            with np.errstate(invalid="ignore", over="ignore"):
                middles = self.relative_from_model[:, :3, 3].T + middles
                inside = planes[:, :3] @ middles + planes[:, 3:]
                halves = np.abs(planes[:, :3] @ axes.reshape(3, -1)).reshape(6, 3, -1)
                inside += np.add.reduce(halves, axis=1)
            # What is not a number is not inside.
            return bool(inside.min() >= 0.0)
        rows = self._clip_from_relative.tolist()
        origins = self.relative_from_model[:, :3, 3].tolist()
        for (middle, _), origin in zip(self._extents.boxes, origins, strict=True):
            x, y, z = map(operator.add, middle, origin)
            p, q, r, w = [a * x + b * y + c * z + d for a, b, c, d in rows]
            # What is not a number is not inside.
            if not (-w <= p <= w and -w <= q <= w and -w <= r <= w):
                return False
        return True

    def most_w(self) -> float:
        """Return a clip-space w that nothing is beyond, found fast; NaN or inf: any."""
        a, b, c, d = self._clip_from_relative[3].tolist()
        (left, bottom, back), (right, top, front) = self._extents.around
        x, y, z = self.eye.tolist()
        across, up = abs(a) * max(x - left, right - x), abs(b) * max(y - bottom, top - y)
        away = abs(c) * max(z - back, front - z)
        return (across + up + away + abs(d)) * (1.0 + ROUNDING)

    def are_between(self, row: Sequence[float], near: float, far: float) -> bool:
        """Tell whether all boxes lie between two planes, as the one around them surely does."""
        return is_between(*self._extents.around, row, near, far)

    @cached_property
    def _measures(self) -> BoxMeasures:
        """How the boxes lie to the planes of the view."""
        if self._given is not None:
            return self._given
        return measure_boxes(self._extents, self.relative_from_model, self._clip_from_relative)

    def may_cross(self, near: float, far: float) -> NDArray[np.bool_]:
        """
        Tell which objects may reach beyond the near or the far plane within the sides of the view.

        Parameters
        ----------
        near, far : float
            How far inside of each plane they must stay, in clip space; -inf -> anywhere.

        Returns
        -------
        (O,) bool
        """
        return self._measures.may_cross(near, far)

    @cached_property
    def corners(self) -> Float64:
        """Corners, (O, 8, 3), in world axes, relative to the eye."""
        return place_boxes(self._bounds, self.relative_from_model)

    @cached_property
    def is_known(self) -> NDArray[np.bool_]:
        """Which boxes have finite corners, (O,)."""
        return np.isfinite(self.corners).all(axis=(1, 2))

    @cached_property
    def is_flat(self) -> NDArray[np.bool_]:
        """Which boxes have no inside, (O,)."""
        return (self._bounds[:, 0] == self._bounds[:, 1]).any(axis=1)

    def largest_w(self) -> float:
        """Return a clip-space w that nothing in view is beyond."""
        return float(self._measures.reach[0, self.in_view].max(initial=0.0))

    def w_ranges(
        self, row: Float64, chosen: NDArray[np.bool_] | None = None
    ) -> tuple[Float64, Float64, Float64]:
        """
        Return between which clip-space w the vertices of some objects lie, (N,) each.

        Parameters
        ----------
        row : (4,) float64
            The last one of ``clip_from_relative``.
        chosen : (O,) bool, optional
            Which objects. Default: those in view.

        Returns
        -------
        low, high : (N,)
            None is below or above; not a number where the box says nothing.
        within : (N,)
            One at least is not above: each side of a box touches a vertex.
        """
        chosen = self.in_view if chosen is None else chosen
        low, high = self._bounds[chosen].transpose(1, 0, 2)
        m = self.relative_from_model[chosen]
        with np.errstate(invalid="ignore", over="ignore"):
            along = (row[0] * m[:, 0] + row[1] * m[:, 1]) + row[2] * m[:, 2]
            middle = along[:, :3] * (low / 2.0 + high / 2.0)
            half = np.abs(along[:, :3]) * (high / 2.0 - low / 2.0)
            center, reach = middle.sum(axis=1) + (along[:, 3] + row[3]), half.sum(axis=1)
            doubt = ROUNDING * self._measures.reach[0, chosen]
            above = center + (reach + doubt)
            return center - (reach + doubt), above, above - 2.0 * half.max(axis=1)

    def farthest(self) -> float:
        """Return a distance from the eye, scene units, that nothing in view is beyond."""
        corners = self.corners[self.in_view]
        with np.errstate(over="ignore"):
            x, y, z = (corners[..., k] for k in range(3))
            squares = (x * x + y * y) + z * z
        # A box that is not finite may reach any distance.
        squares = np.where(np.isfinite(squares), squares, np.inf)
        return float(np.sqrt(squares.max(initial=0.0)))


def is_between(
    low: Sequence[float], high: Sequence[float], row: Sequence[float], near: float, far: float
) -> bool:
    """
    Tell whether a box surely lies between two planes.

    Parameters
    ----------
    low, high : (3,)
        Its corners, world space.
    row : (4,)
        Times a point in world space and 1: its depth.
    near, far : float
        Depths of the planes.
    """
    a, b, c, d = row
    (left, bottom, back), (right, top, front) = low, high
    # Of each axis the end that is near.
    near_x, far_x = (a * left, a * right) if a > 0.0 else (a * right, a * left)
    near_y, far_y = (b * bottom, b * top) if b > 0.0 else (b * top, b * bottom)
    near_z, far_z = (c * back, c * front) if c > 0.0 else (c * front, c * back)
    doubt = abs(near_x) + abs(far_x) + abs(near_y) + abs(far_y) + abs(near_z) + abs(far_z) + abs(d)
    doubt *= SURE
    # NaN counts as unsure.
    return near_x + near_y + near_z + d >= near + doubt and far_x + far_y + far_z + d <= far - doubt


def along(planes: Float64, points: Float64) -> Float64:
    """
    Return a x + b y + c z of planes (P, 4) for coordinates x, y, z: (P, ...) of (3, ...).

    Planes (P, 4, *L) differ along the last axes of the coordinates, of lengths L or 1.
    """
    last = planes.shape[2:]
    ones = (1,) * (points.ndim - 1 - len(last))
    a, b, c = planes[:, :3].swapaxes(0, 1).reshape(3, -1, *ones, *last)
    return (a * points[0] + b * points[1]) + c * points[2]


def mesh_boxes(meshes: Sequence[Mesh]) -> Float64:
    """Return the low and high corner of each object, (O, 2, 3), model space; NaN if it has none."""
    numbers: dict[Mesh, int] = {}
    which = [numbers.setdefault(mesh, len(numbers)) for mesh in meshes]
    return np.array([_box_of(mesh) for mesh in numbers]).reshape(-1, 2, 3)[which]


def _box_of(mesh: Mesh) -> Any:
    """Return the bounds of a mesh, NaN if no face has a finite vertex."""
    try:
        return mesh.bounds()
    except ValueError:
        return np.full((2, 3), np.nan)


def place_boxes(boxes: Float64, matrices: Float64) -> Float64:
    """Return the corners, (O, 8, 3), of boxes (O, 2, 3) that matrices (O, 3, 4) put somewhere."""
    corners = boxes[:, CORNERS, np.arange(3)]
    x, y, z = (corners[:, :, k, np.newaxis] for k in range(3))
    m = matrices[:, np.newaxis, :3, :]
    with np.errstate(invalid="ignore", over="ignore"):
        return x * m[..., 0] + y * m[..., 1] + z * m[..., 2] + m[..., 3]


def box_around(boxes: Float64, matrices: Float64) -> tuple[Float64, Float64]:
    """Return the corners, (3,), of a box around boxes (O, 2, 3) that matrices (O, 4, 4) place."""
    corners = place_boxes(boxes, matrices[:, :3]).reshape(-1, 3)
    # What is in no face has no box.
    corners = corners[~np.isnan(corners).any(axis=1)]
    return corners.min(axis=0, initial=np.inf), corners.max(axis=0, initial=-np.inf)


class Views(NamedTuple):
    """The matrices of all objects, relative to the eye for precision."""

    relative_from_model: NDArray[np.float64]
    """(O, 4, 4): world axes, origin at the eye."""
    clip_from_relative: NDArray[np.float64]
    """(4, 4)."""
    normal_matrices: NDArray[np.float64]
    """(O, 3, 3), largest entry 1."""
    mirrored: NDArray[np.float64]
    """(O,): -1 where the transform turns faces inside out, else 1."""
    toward_viewer: NDArray[np.float64]
    """(4,): a point p, relative to the eye, is seen along ``xyz - w p``."""
    screen_winding: int
    """1 if the camera shows counter-clockwise faces counter-clockwise, -1 if it mirrors."""


class Places(NamedTuple):
    """The objects' world transforms, independent of the camera."""

    world_from_model: NDArray[np.float64]
    """(O, 4, 4)."""
    normal_matrices: NDArray[np.float64]
    """(O, 3, 3), largest entry 1."""
    mirrored: NDArray[np.float64]
    """(O,): -1 where the transform turns faces inside out, else 1."""


def place_objects(matrices: Sequence[NDArray[np.float64]]) -> Places:
    """Return where objects stand, given ``world_from_model``, (4, 4), of each."""
    world_from_model = np.concatenate(matrices).reshape(-1, 4, 4)
    normals = transforms.normal_matrices(world_from_model)
    # So that normals keep a length near 1 in float32.
    largest = np.abs(normals).max(axis=(1, 2), keepdims=True)
    np.divide(normals, largest, out=normals, where=largest > 0.0)
    return Places(world_from_model, normals, _mirrored(world_from_model[:, :3, :3]))


def move_objects(
    known: Places, matrices: Sequence[NDArray[np.float64]], moved: Sequence[int]
) -> Places:
    """
    Return what `place_objects` does, given what it returned before some objects moved.

    Parameters
    ----------
    known : Places
        Left as they are.
    matrices : sequence of (4, 4) float64
        ``world_from_model`` of all objects.
    moved : sequence of int
        The numbers of those that moved.
    """
    if len(moved) == len(matrices):
        world_from_model = np.concatenate(matrices).reshape(-1, 4, 4)
    else:
        world_from_model = known.world_from_model.copy()
        for n in moved:
            world_from_model[n] = matrices[n]
    is_turned = world_from_model[:, :3, :3] != known.world_from_model[:, :3, :3]
    if not is_turned.any():
        # Only shifted: signs of zeros do not count.
        return known._replace(world_from_model=world_from_model)
    turned = np.flatnonzero(is_turned.any(axis=(1, 2))).tolist()
    places = Places(world_from_model, known.normal_matrices.copy(), known.mirrored.copy())
    if len(turned) > FEW:
        some = place_objects([matrices[n] for n in turned])
        places.normal_matrices[turned], places.mirrored[turned] = some[1:]
        return places
    for n in turned:
        rows = matrices[n].tolist()
        normals = transforms.normal_rows(rows)
        largest = max(abs(entry) for row in normals for entry in row)
        if largest > 0.0:
            normals = [[entry / largest for entry in row] for row in normals]
        places.normal_matrices[n] = normals
        places.mirrored[n] = -1.0 if _turn([row[:3] for row in rows[:3]]) < 0.0 else 1.0
    return places


def _mirrored(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return -1 for each 3x3 matrix of a negative determinant, (O,), else 1; see `_turn`."""
    largest = np.abs(matrices).max(axis=2, keepdims=True)
    scaled = np.divide(matrices, largest, out=np.zeros_like(matrices), where=largest > 0.0)
    (a, b, c), (d, e, f), (g, h, i) = scaled.transpose(1, 2, 0)
    determinants = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return np.where(determinants < 0.0, -1.0, 1.0)


def are_even(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which of some matrices, (N, 4, 4), scale alike along all axes, (N,)."""
    axes = matrices[:, :3, :3]
    largest = np.abs(axes).max(axis=(1, 2), keepdims=True)
    scaled = np.divide(axes, largest, out=np.zeros_like(axes), where=largest > 0.0)
    a, b, c = scaled.transpose(2, 0, 1)
    squares = np.stack([_products(a, a), _products(b, b), _products(c, c)])
    skews = np.abs(np.stack([_products(a, b), _products(b, c), _products(c, a)]))
    least, most = squares.min(axis=0), squares.max(axis=0)
    return (most - least <= EVENNESS * most) & (skews.max(axis=0) <= EVENNESS * most) & (most > 0.0)


def _products(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the dot product of each of N vectors with another, (N,)."""
    return one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1] + one[:, 2] * other[:, 2]


def unit_matrices(normal_matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return matrices of normals, (O, 3, 3), scaled so that the x axis keeps its length."""
    x = normal_matrices[:, :, 0]
    lengths = np.sqrt(_products(x, x))[:, np.newaxis, np.newaxis]
    return np.divide(
        normal_matrices, lengths, out=np.zeros_like(normal_matrices), where=lengths > 0.0
    )


def view_nodes(nodes: Sequence[Node], camera: Camera, size: tuple[int, int]) -> Views:
    """Return the matrices that take each object to the screen."""
    return view_places(place_objects([node.world_from_model for node in nodes]), camera, size)


def view_places(places: Places, camera: Camera, size: tuple[int, int]) -> Views:
    """Return the matrices that take objects at their places to the screen."""
    eye = finite_array("camera.eye_position()", camera.eye_position(), (3,))
    relative_from_model = places.world_from_model.copy()
    relative_from_model[:, :3, 3] -= eye
    return _view(relative_from_model, places.normal_matrices, places.mirrored, camera, size, eye)


def view_again(views: Views, camera: Camera, size: tuple[int, int]) -> Views:
    """Return the matrices of the same objects for another projection from the same eye."""
    eye = finite_array("camera.eye_position()", camera.eye_position(), (3,))
    return _view(
        views.relative_from_model, views.normal_matrices, views.mirrored, camera, size, eye
    )


def _view(
    relative_from_model: Float64, normal_matrices: Float64, mirrored: Float64, camera: Camera,
    size: tuple[int, int], eye: Float64,
) -> Views:  # fmt: skip
    """Return the matrices of objects, given those that the projection does not change."""
    x, y, z = eye.tolist()
    world_from_relative = [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], LAST_ROW]
    view_from_world, is_known = camera.view_matrix(), type(camera) in KNOWN_CAMERAS
    if not is_known:
        view_from_world = finite_array("camera.view_matrix()", view_from_world, (4, 4))
    view_from_world = view_from_world.tolist()
    view_from_relative = transforms.product_of(view_from_world, world_from_relative)
    if type(camera) is PerspectiveCamera:
        _, clip_from_view, screen_winding = _usual_projection(camera.frustum, size)
    else:
        _, clip_from_view, screen_winding = _projection(camera, size)
    toward_viewer = np.array(LAST_ROW)
    if not any(clip_from_view[3][:3]):
        # A parallel projection: depth grows with z in clip space; the viewer is the other way.
        a, b, c, _ = clip_from_view[2]
        columns = zip(*view_from_relative[:3], strict=True)
        toward_viewer[:3] = [-((a * x + b * y) + c * z) for x, y, z in columns][:3]
        toward_viewer[3] = 0.0
    handedness = screen_winding
    # Poses of known cameras do not mirror.
    if not is_known:
        handedness *= _turn([row[:3] for row in view_from_relative[:3]])
    return Views(
        relative_from_model,
        np.array(transforms.product_of(clip_from_view, view_from_relative)),
        normal_matrices,
        mirrored,
        toward_viewer,
        1 if handedness < 0.0 else -1,
    )


def projection_of(camera: Camera, size: tuple[int, int]) -> Float64:
    """Return ``camera.projection_matrix(size)``, not to be changed."""
    if type(camera) is PerspectiveCamera:
        return _usual_projection(camera.frustum, size)[0]
    if type(camera) is MatrixCamera and camera.size is None:
        return camera.clip_from_view
    return camera.projection_matrix(size)


def _projection(camera: Camera, size: tuple[int, int]) -> tuple[Float64, list[list[float]], float]:
    """Return ``clip_from_view``, its rows, and the sign of the turn to the screen's axes."""
    projection = camera.projection_matrix(size)
    matrix = finite_array("camera.projection_matrix()", projection, (4, 4))
    clip_from_view = matrix.tolist()
    *screen_axes, depth_row, away = (row[:3] for row in clip_from_view)
    turn = _turn([*screen_axes, away if any(away) else depth_row])
    return matrix, clip_from_view, turn


@lru_cache(256)
def _usual_projection(
    frustum: tuple[Any, ...], size: tuple[int, int]
) -> tuple[Float64, list[list[float]], float]:
    """Return that of perspective cameras of a frustum, which many have, for reading alone."""
    camera = PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), *frustum)
    return _projection(camera, size)


def _turn(rows: Sequence[Sequence[float]]) -> float:
    """Return the sign of a 3x3 determinant; rows are scaled first, so that none overflows."""
    scaled = []
    for row in rows:
        largest = max(map(abs, row))
        if largest == 0.0:
            return 0.0
        scaled.append([entry / largest for entry in row])
    (a, b, c), (d, e, f), (g, h, i) = scaled
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return math.copysign(1.0, determinant) if determinant != 0.0 else 0.0


def cull_objects(
    cull: str, screen_winding: int, mirrored: Float64, face_starts: NDArray[np.int64],
    is_single_sided: NDArray[np.bool_], sideless: tuple[int, ...] = (),
) -> Objects:  # fmt: skip
    """
    Return the winding of each object that is culled; see `culled_windings`.

    Takes the numbers of the objects that have no sides, of which none is.
    """
    turns = culled_windings(cull, screen_winding, mirrored, is_single_sided)
    turns[list(sideless)] = 0
    return Objects(face_starts, turns)


def culled_windings(
    cull: str, screen_winding: int | NDArray[np.int64], mirrored: Float64,
    is_single_sided: NDArray[np.bool_],
) -> NDArray[np.int8]:  # fmt: skip
    """
    Return the winding that is culled of each object (+1: clockwise), (O,).

    Single-sided objects lose their back faces, unless front faces are asked to be dropped. Of N
    views (N, O), if ``screen_winding`` is (N, 1).
    """
    sign = {"none": 0, "back": 1, "front": -1}[cull]
    signs = sign if sign else is_single_sided
    return (signs * (screen_winding * mirrored)).astype(np.int8)
