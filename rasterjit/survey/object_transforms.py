"""
Compute the objects' transforms and bounding boxes, and cull them against the view frustum.

An object is out of view where the box around it surely lies beyond one of the six planes. Unsure
objects count as in view.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.geometry import scene_placement
from rasterjit.pipeline.geometry.depth_range import RELATIVE_ERROR
from rasterjit.pipeline.geometry.scene_placement import (
    CLIP_BOUNDS,
    CULLING_MARGIN,
    ENDS,
    HALF_DEPTHS,
    HIGH,
    LOW,
)
from rasterjit.pipeline.records import Objects
from rasterjit.scene.camera import Camera, MatrixCamera, OrthographicCamera, PerspectiveCamera
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import dot_rows
from rasterjit.scene.validation import finite_array

Float64 = NDArray[np.float64]

CORNER_ENDS = np.array([[n & 1, n >> 1 & 1, n >> 2 & 1] for n in range(8)])
"""(8, 3): the end of the box, 0 low or 1 high, at which each corner lies, by axis."""

KNOWN_CAMERAS = frozenset((PerspectiveCamera, OrthographicCamera, MatrixCamera))
"""Cameras whose poses are checked on construction; not subclasses."""


MAX_AXIS_DIFFERENCE = 2.0**-12
"""Largest difference of an object's axes that counts as uniform scale: of their squared lengths,
relative to the largest, and of their dot products. Light on normals is then off by 1/16 of an 8-bit
code."""


class BoxMeasures(NamedTuple):
    """Positions of object boxes relative to a view's planes; (N, O) of N views for each (O,)."""

    inside: Float64
    """Largest distance inside of each plane in a box, clip space: far at 2, near at 5, (6, O)."""
    half_depths: Float64
    """Half the distance between the ends of each axis to the far and near plane, (2, 3, O)."""
    clip_bounds: Float64
    """Upper bound of |w| plus each of |x|, |y| and |z| in clip space, (3, O)."""
    is_beside: NDArray[np.bool_]
    """Which boxes are all beyond a side of the view, or empty, (O,)."""
    in_view: NDArray[np.bool_]
    """Which boxes may be visible: not all beyond a plane of the view volume, (O,)."""
    ends: Float64
    """Low and high corner of a box around all, (6,) or (N, 6), world axes, relative to the eye."""

    def select_views(self, views: int | list[int]) -> BoxMeasures:
        """Return the measures of one of N views, or of some."""
        return BoxMeasures._make(
            part[views] if part is self.ends else part[..., views, :] for part in self
        )

    def may_cross(self, near: float | Float64, far: float | Float64) -> NDArray[np.bool_]:
        """Tell which objects may cross a plane; arguments as `Boxes.may_cross`, or (N, 1)."""
        with np.errstate(invalid="ignore", over="ignore"):
            at_far, at_near = self.inside[2::3] - 2.0 * np.add.reduce(self.half_depths, axis=1)
            error = CULLING_MARGIN * self.clip_bounds[2]
            is_between = (at_far >= far + error) & (at_near >= near + error)
        return ~(is_between | self.is_beside)

    def compute_max_w(self) -> Float64:
        """Return an upper bound of clip-space w in view, of each view."""
        return np.where(self.in_view, self.clip_bounds[0], 0.0).max(axis=-1, initial=0.0)


def measure_boxes(
    bounds: Float64, relative_from_model: Float64, clip_from_relative: Float64
) -> BoxMeasures:
    """
    Test the boxes of objects against the planes of N views.

    Parameters
    ----------
    bounds : (O, 2, 3) float64
        Low and high corner of each object, model space; NaN for one without a finite face.
    relative_from_model : (N, O, 4, 4) float64
        To world axes with the origin at the eye.
    clip_from_relative : (N, 4, 4) float64
    """
    shape = relative_from_model.shape[:2]
    measures = np.empty((scene_placement.MEASURES, *shape))
    flags, ends = np.empty((scene_placement.FLAGS, *shape), np.uint8), np.empty((shape[0], ENDS))
    scene_placement.measure_boxes(
        bounds, relative_from_model, clip_from_relative, measures, flags, ends,
        np.empty((3, scene_placement.BOX_COLUMNS)), np.empty(4),
    )  # fmt: skip
    half_depths = measures[HALF_DEPTHS:CLIP_BOUNDS].reshape(2, 3, *shape)
    is_beside, in_view = flags.view(np.bool_)
    return BoxMeasures(
        measures[:HALF_DEPTHS], half_depths, measures[CLIP_BOUNDS:], is_beside, in_view, ends
    )


class Boxes:
    """
    The bounding boxes of a scene's objects, relative to a camera's eye.

    Parameters
    ----------
    bounds : (O, 2, 3) float64
        Low and high corner of each object, model space; NaN for one without a finite face.
    eye : (3,) float64, world space
    relative_from_model : (O, 4, 4) float64
        To world axes with the origin at the eye.
    clip_from_relative : (4, 4) float64
    measures : BoxMeasures, optional
        Of these boxes, if known.
    overhang : ((O,) bool, float, float), optional
        Which objects extend beyond their boxes on the screen, and by which share of half its width
        and height.

    Attributes
    ----------
    eye : (3,) float64, world space
    """

    def __init__(
        self, bounds: Float64, eye: Float64, relative_from_model: Float64,
        clip_from_relative: Float64, measures: BoxMeasures | None = None,
        overhang: tuple[NDArray[np.bool_], float, float] | None = None,
    ) -> None:  # fmt: skip
        self.eye, self._bounds = eye, bounds
        self.relative_from_model = relative_from_model
        self._clip_from_relative, self._known_measures = clip_from_relative, measures
        self._overhang = overhang

    @cached_property
    def in_view(self) -> NDArray[np.bool_]:
        """Which objects may be in view, (O,): those not all beyond a plane."""
        if self._overhang is None:
            return self._measures.in_view
        wide_measures = self._measure(self.widen_projection(self._clip_from_relative))
        return self._measures.in_view | (self._overhang[0] & wide_measures.in_view)

    def widen_projection(self, clip_from_relative: Float64) -> Float64:
        """Return a projection, (4, 4), that also shows boxes whose overhang is in view."""
        wide = clip_from_relative.copy()
        if self._overhang is not None:
            wide[0] /= 1.0 + self._overhang[1]
            wide[1] /= 1.0 + self._overhang[2]
        return wide

    def estimate_max_w(self) -> float:
        """Return a coarse upper bound of clip-space w, by the scene's box; NaN or inf: unknown."""
        a, b, c, d = map(abs, self._clip_from_relative[3].tolist())
        left, bottom, back, right, top, front = self._measures.ends.tolist()
        x_term, y_term = a * max(-left, right), b * max(-bottom, top)
        return (x_term + y_term + c * max(-back, front) + d) * (1.0 + CULLING_MARGIN)

    def are_between(self, row: Sequence[float], near: float, far: float) -> bool:
        """
        Tell whether the box around all surely lies between two planes; see `is_between`.

        ``row`` takes points relative to the eye.
        """
        ends = self._measures.ends.tolist()
        return is_between(ends[LOW:HIGH], ends[HIGH:], row, near, far)

    @cached_property
    def _measures(self) -> BoxMeasures:
        """Distances of the boxes from the planes of the view."""
        return self._known_measures or self._measure(self._clip_from_relative)

    def _measure(self, clip_from_relative: Float64) -> BoxMeasures:
        """Return the distances of the boxes from the planes of a view, (4, 4)."""
        matrices = self.relative_from_model[np.newaxis], clip_from_relative[np.newaxis]
        return measure_boxes(self._bounds, *matrices).select_views(0)

    def may_cross(self, near: float, far: float) -> NDArray[np.bool_]:
        """
        Tell which objects may reach beyond the near or the far plane within the sides of the view.

        Parameters
        ----------
        near, far : float
            Required distance inside of each plane, clip space; -inf -> anywhere.

        Returns
        -------
        (O,) bool
        """
        return self._measures.may_cross(near, far)

    @cached_property
    def corners(self) -> Float64:
        """Corners, (O, 8, 3), in world axes, relative to the eye."""
        return transform_boxes(self._bounds, self.relative_from_model)

    @cached_property
    def is_known(self) -> NDArray[np.bool_]:
        """Which boxes have finite corners, (O,)."""
        return np.isfinite(self.corners).all(axis=(1, 2))

    @cached_property
    def is_flat(self) -> NDArray[np.bool_]:
        """Which boxes have no volume, (O,)."""
        return (self._bounds[:, 0] == self._bounds[:, 1]).any(axis=1)

    def compute_max_w(self) -> float:
        """Return an upper bound of clip-space w in view."""
        return float(self._measures.clip_bounds[0, self.in_view].max(initial=0.0))

    def compute_w_ranges(
        self, row: Float64, chosen: NDArray[np.bool_] | None = None
    ) -> tuple[Float64, Float64, Float64]:
        """
        Return the range of clip-space w of the vertices of some objects, (N,) each.

        Parameters
        ----------
        row : (4,) float64
            The last one of ``clip_from_relative``.
        chosen : (O,) bool, optional
            Which objects. Default: those in view.

        Returns
        -------
        low, high : (N,)
            Bounds of all vertices; NaN where the box says nothing.
        within : (N,)
            Upper bound of the least w of a vertex, as each side of a box touches one.
        """
        chosen = self.in_view if chosen is None else chosen
        low, high = self._bounds[chosen].transpose(1, 0, 2)
        m = self.relative_from_model[chosen]
        with np.errstate(invalid="ignore", over="ignore"):
            model_row = (row[0] * m[:, 0] + row[1] * m[:, 1]) + row[2] * m[:, 2]
            middle = model_row[:, :3] * (low / 2.0 + high / 2.0)
            half = np.abs(model_row[:, :3]) * (high / 2.0 - low / 2.0)
            center, radius = middle.sum(axis=1) + (model_row[:, 3] + row[3]), half.sum(axis=1)
            error = CULLING_MARGIN * self._measures.clip_bounds[0, chosen]
            max_w = center + (radius + error)
            return center - (radius + error), max_w, max_w - 2.0 * half.max(axis=1)

    def compute_max_distance(self) -> float:
        """Return an upper bound of the distance from the eye of boxes in view, scene units."""
        return float(compute_max_distance(self.corners, self.in_view))


def compute_max_distance(corners: Float64, in_view: NDArray[np.bool_]) -> Float64:
    """
    Return the distance from the eye of the farthest corner of boxes in view, of each of N views.

    Parameters
    ----------
    corners : (O, 8, 3) or (N, O, 8, 3) float64
        World axes, relative to the eye.
    in_view : (O,) or (N, O) bool
        Which boxes count.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        x, y, z = np.moveaxis(corners, -1, 0)
        squares = (x * x + y * y) + z * z
    # A box that is not finite may extend to any distance.
    squares = np.where(np.isfinite(squares), squares, np.inf)
    squares = np.where(in_view[..., np.newaxis], squares, 0.0)
    return np.sqrt(squares.max(axis=(-2, -1), initial=0.0))


def is_between(
    low: Sequence[float], high: Sequence[float], row: Sequence[float], near: float, far: float
) -> bool:
    """
    Tell whether a box surely lies between two planes.

    Parameters
    ----------
    low, high : (3,)
        Corners of the box, world space.
    row : (4,)
        The depth of a point in world space is its dot product with (x, y, z, 1).
    near, far : float
        Depths of the planes.
    """
    a, b, c, d = row
    (left, bottom, back), (right, top, front) = low, high
    near_x, far_x = (a * left, a * right) if a > 0.0 else (a * right, a * left)
    near_y, far_y = (b * bottom, b * top) if b > 0.0 else (b * top, b * bottom)
    near_z, far_z = (c * back, c * front) if c > 0.0 else (c * front, c * back)
    error = abs(near_x) + abs(far_x) + abs(near_y) + abs(far_y) + abs(near_z) + abs(far_z) + abs(d)
    error *= RELATIVE_ERROR
    # NaN counts as unsure.
    return near_x + near_y + near_z + d >= near + error and far_x + far_y + far_z + d <= far - error


def dot_planes(planes: Float64, points: Float64) -> Float64:
    """Return a x + b y + c z of planes (P, 4) for coordinates x, y, z: (P, ...) of (3, ...)."""
    a, b, c = planes[:, :3].T.reshape(3, -1, *(1,) * (points.ndim - 1))
    return (a * points[0] + b * points[1]) + c * points[2]


def compute_mesh_boxes(meshes: Sequence[Mesh]) -> Float64:
    """Return the low and high corner of each object, (O, 2, 3), model space; NaN if it has none."""
    numbers: dict[Mesh, int] = {}
    which = [numbers.setdefault(mesh, len(numbers)) for mesh in meshes]
    return np.array([_mesh_bounds(mesh) for mesh in numbers]).reshape(-1, 2, 3)[which]


def _mesh_bounds(mesh: Mesh) -> Any:
    """Return the bounds of a mesh, NaN if no face has a finite vertex."""
    try:
        return mesh.bounds()
    except ValueError:
        return np.full((2, 3), np.nan)


def transform_boxes(boxes: Float64, matrices: Float64) -> Float64:
    """Return the corners, (O, 8, 3), of boxes (O, 2, 3) transformed by matrices (O, 3, 4)."""
    corners = boxes[:, CORNER_ENDS, np.arange(3)]
    x, y, z = (corners[:, :, k, np.newaxis] for k in range(3))
    m = matrices[:, np.newaxis, :3, :]
    with np.errstate(invalid="ignore", over="ignore"):
        return x * m[..., 0] + y * m[..., 1] + z * m[..., 2] + m[..., 3]


def bound_boxes(boxes: Float64, matrices: Float64) -> tuple[Float64, Float64]:
    """Return low and high, (3,), of a box around boxes (O, 2, 3) transformed by (O, 4, 4)."""
    corners = transform_boxes(boxes, matrices[:, :3]).reshape(-1, 3)
    # Objects without a finite face have no box.
    corners = corners[~np.isnan(corners).any(axis=1)]
    return corners.min(axis=0, initial=np.inf), corners.max(axis=0, initial=-np.inf)


class ViewTransforms(NamedTuple):
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


class ObjectTransforms(NamedTuple):
    """The objects' world transforms, independent of the camera."""

    world_from_model: NDArray[np.float64]
    """(O, 4, 4)."""
    normal_matrices: NDArray[np.float64]
    """(O, 3, 3), largest entry 1."""
    mirrored: NDArray[np.float64]
    """(O,): -1 where the transform turns faces inside out, else 1."""


def transform_objects(matrices: Sequence[Float64] | Float64) -> ObjectTransforms:
    """Return the world transforms of objects, given ``world_from_model``, (4, 4), of each."""
    count = len(matrices)
    nothing = np.full((count, 4, 4), np.nan), np.empty((count, 3, 3)), np.empty(count)
    return move_objects(ObjectTransforms(*nothing), matrices, range(count))


def move_objects(
    old: ObjectTransforms, matrices: Sequence[Float64] | Float64, moved: Sequence[int]
) -> ObjectTransforms:
    """
    Return `transform_objects` of all objects, computing only those that moved.

    Parameters
    ----------
    old : ObjectTransforms
        Before the move; not changed.
    matrices : sequence of (4, 4) float64
        ``world_from_model`` of all objects.
    moved : sequence of int
        Numbers of the moved objects.
    """
    if len(moved) == len(matrices):
        world_from_model = np.concatenate(matrices).reshape(-1, 4, 4)
    else:
        world_from_model = old.world_from_model.copy()
        for n in moved:
            world_from_model[n] = matrices[n]
    moved_objects = ObjectTransforms(
        world_from_model, old.normal_matrices.copy(), old.mirrored.copy()
    )
    if scene_placement.transform_normals(
        world_from_model, *old[:1], *moved_objects[1:], np.empty((3, 3))
    ):
        return moved_objects
    return old._replace(world_from_model=world_from_model)


def have_uniform_scales(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which matrices, (N, 4, 4), scale all axes alike, but for `MAX_AXIS_DIFFERENCE`, (N,)."""
    axes = matrices[:, :3, :3]
    largest = np.abs(axes).max(axis=(1, 2), keepdims=True)
    scaled = np.divide(axes, largest, out=np.zeros_like(axes), where=largest > 0.0)
    a, b, c = scaled.transpose(2, 0, 1)
    squares = np.stack([dot_rows(a, a), dot_rows(b, b), dot_rows(c, c)])
    skews = np.abs(np.stack([dot_rows(a, b), dot_rows(b, c), dot_rows(c, a)]))
    least, most = squares.min(axis=0), squares.max(axis=0)
    return (
        (most - least <= MAX_AXIS_DIFFERENCE * most)
        & (skews.max(axis=0) <= MAX_AXIS_DIFFERENCE * most)
        & (most > 0.0)
    )


def normalize_normal_matrices(normal_matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return matrices of normals, (O, 3, 3), scaled so that the x axis keeps its length."""
    x = normal_matrices[:, :, 0]
    lengths = np.sqrt(dot_rows(x, x))[:, np.newaxis, np.newaxis]
    return np.divide(
        normal_matrices, lengths, out=np.zeros_like(normal_matrices), where=lengths > 0.0
    )


def transform_nodes_to_view(
    nodes: Sequence[Node], camera: Camera, size: tuple[int, int]
) -> ViewTransforms:
    """Return the transforms of nodes to a view."""
    return transform_to_view(
        transform_objects([node.world_from_model for node in nodes]), camera, size
    )


def transform_to_view(
    objects: ObjectTransforms, camera: Camera, size: tuple[int, int]
) -> ViewTransforms:
    """Return the transforms of objects to a view, given those to the world."""
    eye = finite_array("camera.eye_position()", camera.eye_position(), (3,))
    relative_from_model = objects.world_from_model.copy()
    relative_from_model[:, :3, 3] -= eye
    return _add_projection(
        relative_from_model, objects.normal_matrices, objects.mirrored, camera, size, eye
    )


def reproject_views(views: ViewTransforms, camera: Camera, size: tuple[int, int]) -> ViewTransforms:
    """Return the transforms of the same objects for another projection from the same eye."""
    eye = finite_array("camera.eye_position()", camera.eye_position(), (3,))
    return _add_projection(
        views.relative_from_model, views.normal_matrices, views.mirrored, camera, size, eye
    )


def _add_projection(
    relative_from_model: Float64, normal_matrices: Float64, mirrored: Float64, camera: Camera,
    size: tuple[int, int], eye: Float64,
) -> ViewTransforms:  # fmt: skip
    """Return the transforms of objects, given the parts that do not depend on the projection."""
    view_from_world, clip_from_view = camera.view_matrix(), compute_projection(camera, size)
    if type(camera) not in KNOWN_CAMERAS:
        view_from_world = finite_array("camera.view_matrix()", view_from_world, (4, 4))
        clip_from_view = finite_array("camera.projection_matrix()", clip_from_view, (4, 4))
    placed = place_views(eye[np.newaxis], np.array([view_from_world]), np.array([clip_from_view]))
    if not placed.is_finite[0]:
        raise ValueError(
            "the camera's view_matrix() and projection_matrix() must have a finite product, got "
            f"{placed.clip_from_relative[0].tolist()}"
        )
    return ViewTransforms(
        relative_from_model, placed.clip_from_relative[0], normal_matrices, mirrored,
        placed.toward_viewer[0], int(placed.screen_winding[0]),
    )  # fmt: skip


class PlacedViews(NamedTuple):
    """What of N views does not depend on objects."""

    clip_from_relative: Float64
    """(N, 4, 4)."""
    toward_viewer: Float64
    """(N, 4)."""
    screen_winding: NDArray[np.int64]
    """(N,): 1 or -1."""
    is_finite: NDArray[np.bool_]
    """(N,): whether the matrices of a view are; `transform_to_view` refuses others."""


def place_views(eyes: Float64, view_from_world: Float64, clip_from_view: Float64) -> PlacedViews:
    """Place N views, given eyes, (N, 3), world space, and matrices, (N, 4, 4)."""
    count = len(eyes)
    world_from_relative = np.zeros((count, 4, 4))
    world_from_relative[:] = np.eye(4)
    world_from_relative[:, :3, 3] = eyes
    matrices, toward_viewer = np.empty((2, count, 4, 4)), np.empty((count, 4))
    windings = np.empty(count, np.int64)
    scene_placement.place_views(
        world_from_relative, view_from_world, clip_from_view, *matrices, toward_viewer, windings
    )  # fmt: skip
    is_finite = np.isfinite(matrices).all(axis=(0, 2, 3))
    return PlacedViews(matrices[1], toward_viewer, windings, is_finite)


def compute_projection(camera: Camera, size: tuple[int, int]) -> Float64:
    """Return ``camera.projection_matrix(size)``, perhaps shared: read-only."""
    if type(camera) is PerspectiveCamera:
        return _cached_perspective(camera.frustum, size)
    if type(camera) is MatrixCamera and camera.size is None:
        return camera.clip_from_view
    return camera.projection_matrix(size)


@lru_cache(256)
def _cached_perspective(frustum: tuple[Any, ...], size: tuple[int, int]) -> Float64:
    """Return the projection of perspective cameras with a frustum, read-only."""
    camera = PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), *frustum)
    return camera.projection_matrix(size)


def cull_objects(
    cull: str, screen_winding: int, mirrored: Float64, face_starts: NDArray[np.int64],
    is_single_sided: NDArray[np.bool_], sideless: tuple[int, ...] = (),
) -> Objects:  # fmt: skip
    """
    Return the record of objects with their culled windings; see `find_culled_windings`.

    ``sideless`` are the numbers of objects of points and lines, whose faces are never culled.
    """
    windings = find_culled_windings(cull, screen_winding, mirrored, is_single_sided)
    windings[list(sideless)] = 0
    return Objects(face_starts, windings)


def find_culled_windings(
    cull: str, screen_winding: int | NDArray[np.int64], mirrored: Float64,
    is_single_sided: NDArray[np.bool_],
) -> NDArray[np.int8]:  # fmt: skip
    """
    Return the screen winding of the culled faces of each object, (O,): 1 clockwise, 0 none.

    Back faces of single-sided objects are culled unless ``cull`` is "front". Of N views (N, O), if
    ``screen_winding`` is (N, 1).
    """
    sign = {"none": 0, "back": 1, "front": -1}[cull]
    signs = sign if sign else is_single_sided
    return (signs * (screen_winding * mirrored)).astype(np.int8)
