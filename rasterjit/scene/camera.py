"""
Cameras: where the eye is, how the view is projected, and what a stored depth means.

World and view space are right-handed with y up; a camera looks down its -z. No pose mirrors: every
constructor, converter and file reader refuses one of a determinant below 0. Every camera answers
the five questions of :class:`Camera`, which is all that the renderer knows about it.

The stored depth is reversed (nearer is bigger): near / w for a perspective camera, which is linear
on screen and keeps float32's relative precision at any distance, and -(1 + z_ndc) / 2 for a
parallel one, which float32 keeps to a share of the distance from the near plane, however far the
far plane is.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.scene import transforms
from rasterjit.scene.arrays import Float64
from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.pixel_projection import Projecting
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.validation import (
    MAX_TILED_SIZE,
    VectorLike,
    boolean,
    bounded_number,
    finite_array,
    finite_number,
    number_array,
    picture_size,
    positive_number,
    triple,
)
from rasterjit.scene.vectors import length

DepthCoefficients = tuple[float, float, float]

DEFAULT_NEAR = 0.1
"""Near plane of a perspective where none is given, if that cuts nothing in view; scene units."""

DEFAULT_FAR = 1000.0
"""Far plane of a parallel camera where none is given, if that cuts nothing in view; scene units."""

MAX_PLANE_STEPS = 40
"""Most times that a near plane that is not given is halved, or a far plane doubled: to 9e-14 and
1e15 scene units."""

_MIN_HEIGHT = 1e-300
"""Least height of what a parallel projection shows: its scale is finite at every aspect."""

_VOLUME_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
"""Largest rounding of the volume that three unit vectors span: six products of three."""


@runtime_checkable
class Camera(Protocol):
    """Protocol of cameras: matrices, eye, and conversion of depth."""

    def view_matrix(self) -> Matrix:
        """Return ``view_from_world``, (4, 4) float64."""

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """Return ``clip_from_view``, (4, 4) float64, for an image of (width, height) pixels."""

    def eye_position(self) -> Float64:
        """Return the eye, (3,) float64, world space."""

    def depth_coefficients(self) -> DepthCoefficients:
        """
        Return (c0, c1, c2) of the stored depth, (c0 + c1 * z_clip + c2 * w_clip) / w_clip.

        Bigger is nearer.
        """

    def view_depth(self, stored: ArrayLike) -> Float64:
        """
        Convert stored depth to scene units along the viewing axis.

        Parameters
        ----------
        stored : array_like of float, any shape

        Returns
        -------
        float64, the same shape
            Positive in front of the eye. A stored 0 is the near plane of a parallel camera and
            infinity for a perspective one; the caller marks the pixels that hold nothing.
        """


class Bounded(Protocol):
    """Protocol of objects with a bounding sphere."""

    def bounding_sphere(self) -> tuple[ArrayLike, float]:
        """Return the centre, (3,), and the radius in world space."""


@suggests_replace
@dataclass(frozen=True)
class PerspectiveCamera(Projecting):
    """
    Camera with a vertical field of view.

    Parameters
    ----------
    eye, target, up : (3,) array_like, world space
        Where it is, the point it looks at and which way is up; kept as tuples of float.
    fov_y : float, degrees
        Vertical field of view, strictly between 0 and 180.
    near : float, optional, scene units
        Distance of the near plane. Default: rendering chooses 0.1, halved as often as it takes to
        cut nothing in view, at most 40 times; ``frame.plan.camera`` has it. With a depth format of
        fixed range (unorm16, unorm24, float32) it stays so far away that the format tells apart
        what is in view. Rendering refuses a given one below 1e-13 of ``far`` if something lies
        beyond ``far``, and one so small that ``Quality.depth_format`` cannot hold the depth of what
        is in view (by default below 1.2e-38 of the farthest distance). It warns of faces that a
        given one cuts.
    far : float, scene units
        Distance of the far plane; may be ``math.inf``.
    min_aspect : float
        In pictures narrower than this (width over height), what is seen from left to right stays
        what it is at this aspect, and the vertical field of view grows: nothing is cut off at the
        sides. Default 0: ``fov_y`` holds in all pictures.
    pixel_aspect : float
        Width over height of what a pixel stands for: the horizontal field of view is that of a
        picture so many times as wide.

    Raises
    ------
    ValueError
        If ``target`` equals ``eye``, ``up`` is zero or parallel to the line of sight, ``fov_y`` is
        outside (0, 180), ``near`` is not above 0, ``far`` is not above ``near``, ``min_aspect`` is
        outside 0..131072, ``pixel_aspect`` is outside 1e-6..1e6, or a number is not finite.
    """

    eye: VectorLike
    target: VectorLike
    up: VectorLike = (0.0, 1.0, 0.0)
    fov_y: float = 45.0
    near: float | None = None
    far: float = math.inf
    min_aspect: float = 0.0
    pixel_aspect: float = 1.0

    def __post_init__(self) -> None:
        _store_pose(self)
        transforms.lens_matrix(self.fov_y, 1.0, default_near(self.near, self.far), self.far)
        store(
            self,
            fov_y=float(self.fov_y),
            near=None if self.near is None else float(self.near),
            far=float(self.far),
            min_aspect=bounded_number("min_aspect", self.min_aspect, 0.0, MAX_TILED_SIZE),
            pixel_aspect=bounded_number("pixel_aspect", self.pixel_aspect, 1e-6, 1e6),
        )

    @property
    def frustum(self) -> tuple[Any, ...]:
        """The fields other than the pose: field of view, planes and aspects."""
        return self.fov_y, self.near, self.far, self.min_aspect, self.pixel_aspect

    def view_matrix(self) -> Matrix:
        """Return ``view_from_world``, (4, 4) float64."""
        return self._view_from_world.copy()

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """
        Return ``clip_from_view``, (4, 4) float64, for an image of (width, height) pixels.

        Without a far plane that is more than 1e13 times as far as the near one. A near plane that
        is not given is at 0.1, or halved to lie before ``far``.
        """
        width, height = picture_size("size", size)
        aspect, near = width / height * self.pixel_aspect, default_near(self.near, self.far)
        matrix = transforms.lens_matrix(self.fov_y, aspect, near, self.far)
        if aspect < self.min_aspect:
            matrix[:2] *= aspect / self.min_aspect
        return matrix

    def eye_position(self) -> Float64:
        """Return the eye, (3,) float64, world space."""
        return np.array(self.eye)

    def depth_coefficients(self) -> DepthCoefficients:
        """Return (near, 0, 0): the stored depth is near / w."""
        return default_near(self.near, self.far), 0.0, 0.0

    def view_depth(self, stored: ArrayLike) -> Float64:
        """Return near / ``stored``, float64, scene units; infinite where ``stored`` is 0."""
        with np.errstate(divide="ignore"):
            return default_near(self.near, self.far) / number_array("stored", stored)


@suggests_replace
@dataclass(frozen=True)
class OrthographicCamera(Projecting):
    """
    Camera with parallel lines of sight.

    Parameters
    ----------
    eye, target, up : (3,) array_like, world space
        Where it is, the point it looks at and which way is up; kept as tuples of float.
    height : float, scene units
        What the image shows from its bottom to its top.
    near : float, scene units
        Distance of the near plane, finite; may be negative (behind the eye).
    far : float, optional, scene units
        Distance of the far plane, finite. Default: rendering chooses 1000, doubled as often as it
        takes to cut nothing in view, at most 40 times; ``frame.plan.camera`` has it.
    min_aspect : float
        In pictures narrower than this (width over height), what is seen from left to right stays
        what it is at this aspect, and more than ``height`` is shown. Default 0: never more.

    Raises
    ------
    ValueError
        If ``target`` equals ``eye``, ``up`` is zero or parallel to the line of sight, ``height`` is
        not above 0, ``far`` is not above ``near``, ``min_aspect`` is outside 0..131072, or a
        number is not finite.
    """

    eye: VectorLike
    target: VectorLike
    up: VectorLike = (0.0, 1.0, 0.0)
    height: float = 2.0
    near: float = 0.0
    far: float | None = None
    min_aspect: float = 0.0

    def __post_init__(self) -> None:
        _store_pose(self)
        height = positive_number("height", self.height)
        if height < _MIN_HEIGHT:
            raise ValueError(f"height must be at least {_MIN_HEIGHT:g}, got {height!r}")
        transforms.orthographic(-1.0, 1.0, -1.0, 1.0, self.near, default_far(self.far, self.near))
        far = None if self.far is None else float(self.far)
        store(self, height=height, near=float(self.near), far=far)
        store(self, min_aspect=bounded_number("min_aspect", self.min_aspect, 0.0, MAX_TILED_SIZE))

    def view_matrix(self) -> Matrix:
        """Return ``view_from_world``, (4, 4) float64."""
        return self._view_from_world.copy()

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """
        Return ``clip_from_view``, (4, 4) float64, for an image of (width, height) pixels.

        A far plane that is not given is at 1000, or doubled to lie behind ``near``.
        """
        width, height = picture_size("size", size)
        aspect = width / height
        top = self.height / 2.0 * max(1.0, self.min_aspect / aspect)
        right, far = top * aspect, default_far(self.far, self.near)
        return transforms.orthographic(-right, right, -top, top, self.near, far)

    def eye_position(self) -> Float64:
        """Return the eye, (3,) float64, world space."""
        return np.array(self.eye)

    def depth_coefficients(self) -> DepthCoefficients:
        """Return (0, -1/2, -1/2): the stored depth is -(1 + z_ndc) / 2."""
        return 0.0, -0.5, -0.5

    def view_depth(self, stored: ArrayLike) -> Float64:
        """Return the depth, float64, scene units: ``near`` at 0, ``far`` at -1."""
        t = -number_array("stored", stored)
        return self.near * (1.0 - t) + default_far(self.far, self.near) * t


@suggests_replace
@dataclass(frozen=True, eq=False)
class MatrixCamera(Projecting):
    """
    Camera given by its view and projection matrix.

    Parameters
    ----------
    view_from_world : (4, 4) array_like
        Affine: its last row is (0, 0, 0, 1). Depth is in world units if it does not scale. It
        must not mirror: a determinant below 0 mostly comes of an axis that was negated by mistake.
    clip_from_view : (4, 4) array_like
        OpenGL's NDC: -1 at the near plane. It is a perspective if w depends on the view-space
        position, else a parallel projection. It may hold the view as well, with
        ``view_from_world`` the identity. It may mirror: its first row negated turns the picture's
        left into its right.
    size : (int, int), optional
        Width and height, pixels, of the image that ``clip_from_view`` is for. Images of another
        aspect are refused: they would show it stretched. Those of the same aspect, sides being
        rounded to whole pixels, show it larger or smaller. Default: it is used as it is for any
        image. ``dataclasses.replace(camera, size=None)`` makes one that is.
    is_near_open : bool
        Whether ``clip_from_view``, a pinhole's, has its near plane where it is because none was
        given: rendering then halves its distance as `PerspectiveCamera` says.

    Raises
    ------
    ValueError
        If a matrix is not 4x4 and finite, ``view_from_world`` is not affine, is singular or
        mirrors, ``clip_from_view`` has no centre of projection (perspective), or is parallel with a
        w that is not above 0 or a z that does not depend on the position, or a side of ``size`` is
        not in 1..131072; or if ``is_near_open`` is set for what is no pinhole along view
        space's z axis.
    """

    view_from_world: Float64
    clip_from_view: Float64
    size: tuple[int, int] | None = None
    is_near_open: bool = False

    if TYPE_CHECKING:
        # Reading gives arrays; the constructor takes what can be made one.
        def __init__(
            self,
            view_from_world: ArrayLike,
            clip_from_view: ArrayLike,
            size: tuple[int, int] | None = None,
            is_near_open: bool = False,
        ) -> None: ...

    def __post_init__(self) -> None:
        view = finite_array("view_from_world", self.view_from_world, (4, 4)).copy()
        clip = finite_array("clip_from_view", self.clip_from_view, (4, 4)).copy()
        if view[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise ValueError(
                f"view_from_world must have last row (0, 0, 0, 1), got {view[3].tolist()}"
            )
        for matrix in (view, clip):
            matrix.flags.writeable = False
        size = None if self.size is None else picture_size("size", self.size)
        store(self, view_from_world=view, clip_from_view=clip, size=size)
        if _are_coplanar(view[:3, :3]):
            raise ValueError("view_from_world must not be singular")
        if mirrors(view):
            raise ValueError(
                "view_from_world must not mirror, got a determinant below 0 for "
                f"{view[:3, :3].tolist()}; clip_from_view with its first row negated mirrors the "
                "picture"
            )
        if self._is_perspective:
            if _are_coplanar(clip[[0, 1, 3], :3]):
                raise ValueError(
                    "clip_from_view must have one centre of projection; if it was made of cx and "
                    "cy, or of shift_x and shift_y, these lie too far beside the picture"
                )
        elif clip[3, 3] <= 0.0:
            raise ValueError(f"clip_from_view must give w above 0, got {float(clip[3, 3])!r}")
        elif not clip[2, :3].any():
            raise ValueError("clip_from_view must give a z that depends on the position")
        self.__dict__["_eye"] = self._compute_eye()
        if boolean("is_near_open", self.is_near_open) and _pinhole_planes(clip) is None:
            raise ValueError(
                "is_near_open must be False where clip_from_view is no pinhole along view space's "
                f"z axis, got {self.is_near_open!r}"
            )

    @classmethod
    def from_intrinsics(
        cls,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        size: tuple[int, int],
        *,
        view_from_world: ArrayLike | None = None,
        near: float | None = None,
        far: float = math.inf,
    ) -> MatrixCamera:
        """
        Return the camera of a calibrated pinhole.

        A point (x, y, z) in view space, y up and z towards the viewer, lands on the pixel
        coordinates (cx - fx x / z, cy + fy y / z), screen y down.

        Parameters
        ----------
        fx, fy : float, pixels
            Focal lengths.
        cx, cy : float, pixels
            Principal point, where the centre of pixel (column i, row j) is at (i + 0.5, j + 0.5).
        size : (width, height) of int, pixels
            The image the calibration is for; it may lie off the principal point. Rendering at
            another size of the same aspect rescales the picture; another aspect is refused.
        view_from_world : (4, 4) array_like, optional
            The pose; the identity if not given.
        near : float, optional, scene units
            Distance of the near plane. Default: chosen as `PerspectiveCamera` says.
        far : float, scene units
            Distance of the far plane; may be ``math.inf``, else it is at most 1e13 times ``near``.

        Raises
        ------
        ValueError
            If ``fx`` or ``fy`` is not above 0, ``near`` is not above 0, ``far`` is not above
            ``near`` or more than 1e13 times as far, a side is not in 1..16384, or a number is not
            finite.

        Notes
        -----
        OpenCV puts the centre of the first pixel at (0, 0): add 0.5 to its ``cx`` and ``cy``. Its
        camera has y down and z forward: with its 4x4 pose ``camera_from_world``,
        ``view_from_world = compose(scale((1, -1, -1)), camera_from_world)``.
        """
        width, height = picture_size("size", size)
        clip = np.zeros((4, 4))
        clip[0, 0] = 2.0 * positive_number("fx", fx) / width
        clip[1, 1] = 2.0 * positive_number("fy", fy) / height
        clip[0, 2] = 1.0 - 2.0 * finite_number("cx", cx) / width
        clip[1, 2] = 2.0 * finite_number("cy", cy) / height - 1.0
        clip[2, 2:] = transforms.perspective_depth(default_near(near, far), far)
        clip[3, 2] = -1.0
        view = transforms.identity() if view_from_world is None else view_from_world
        return cls(view, clip, (width, height), near is None)

    def view_matrix(self) -> Matrix:
        """Return ``view_from_world``, (4, 4) float64."""
        return self.view_from_world.copy()

    def projection_matrix(self, size: tuple[int, int]) -> Matrix:
        """
        Return ``clip_from_view``, (4, 4) float64.

        Raises
        ------
        ValueError
            If the image that it is for has another aspect than ``size``.
        """
        width, height = picture_size("size", size)
        if self.size is not None:
            made_width, made_height = self.size
            # Sides of one image times any factor are each less than a pixel off.
            if abs(width * made_height - height * made_width) >= made_width + made_height:
                raise ValueError(
                    f"size must have the aspect of {made_width} x {made_height}, which the camera "
                    f"is made for, got {width} x {height}; make it for that size, or stretch its "
                    f"picture with dataclasses.replace(camera, size=({width}, {height}))"
                )
        return self.clip_from_view.copy()

    def eye_position(self) -> Float64:
        """
        Return the eye, (3,) float64, world space.

        For a perspective it is the centre of projection, where clip x, y and w vanish together;
        for a parallel projection the origin of view space.
        """
        eye: Float64 = self.__dict__["_eye"]
        return eye.copy()

    def depth_coefficients(self) -> DepthCoefficients:
        """
        Return (c, 0, 0) for a perspective and (0, -1/2, -1/2) for a parallel projection.

        ``c`` is w on the near plane, along view space's z axis, or 1 where that has no positive
        value.
        """
        if not self._is_perspective:
            return 0.0, -0.5, -0.5
        (z_scale, z_offset), (w_scale, w_offset) = self.clip_from_view[2:, 2:].tolist()
        if z_scale + w_scale != 0.0:
            near_z = -(z_offset + w_offset) / (z_scale + w_scale)
            near_w = w_scale * near_z + w_offset
            if 0.0 < near_w < math.inf:
                return near_w, 0.0, 0.0
        return 1.0, 0.0, 0.0

    def view_depth(self, stored: ArrayLike) -> Float64:
        """
        Return the depth, float64, scene units, along the direction in which it grows.

        It is measured from the plane w = 0 through the eye for a perspective, and from the origin
        of view space for a parallel projection.
        """
        depth = number_array("stored", stored)
        z_row, w_row = self.clip_from_view[2:].tolist()
        if self._is_perspective:
            constant = self.depth_coefficients()[0]
            with np.errstate(divide="ignore"):
                return constant / depth / length(w_row[:3])
        ndc_z = -2.0 * depth - 1.0
        return (ndc_z * w_row[3] - z_row[3]) / length(z_row[:3])

    def _compute_eye(self) -> Float64:
        """Return the eye; raise ``ValueError`` if the matrices lead beyond float64's range."""
        rows = self.view_from_world[:3].copy()
        try:
            if self._is_perspective:
                # In view space first, where it mostly is the origin: a product of both matrices
                # would lose digits far from the world's origin.
                with np.errstate(over="ignore", invalid="ignore"):
                    rows[:, 3] -= _solve_origin(self.clip_from_view[[0, 1, 3]])
            eye = _solve_origin(rows)
            is_finite = bool(np.isfinite(eye).all())
        except ValueError:
            is_finite = False
        if not is_finite:
            raise ValueError(
                "view_from_world and clip_from_view must have a finite product and a finite eye"
            )
        return eye

    @property
    def _is_perspective(self) -> bool:
        """Whether w depends on the view-space position."""
        # `any` of an array takes four times as long.
        x, y, z, _ = self.clip_from_view[3].tolist()
        return x != 0.0 or y != 0.0 or z != 0.0


def default_near(near: float | None, far: float) -> float:
    """Return the near plane of a perspective; by default 0.1, halved to lie before ``far``."""
    if near is not None:
        return near
    near_plane = DEFAULT_NEAR
    while isinstance(far, (int, float)) and 0.0 < far <= near_plane:
        near_plane /= 2.0
    return near_plane


def default_far(far: float | None, near: float) -> float:
    """Return the far plane of a parallel camera; by default 1000, doubled to lie behind."""
    if far is not None:
        return far
    far_plane = DEFAULT_FAR
    while isinstance(near, (int, float)) and far_plane <= near < math.inf:
        far_plane *= 2.0
    return far_plane


class NearFar(NamedTuple):
    """Near and far plane of a camera, and whether rendering may move them."""

    near: float
    """Distance along the viewing axis, scene units."""
    far: float
    """May be infinite."""
    is_near_open: bool = False
    """Whether rendering may halve the distance of the near plane, as none was given."""
    is_far_open: bool = False
    """Whether rendering may double that of the far plane."""
    near_steps: int | None = None
    """Times rendering halved it; ``None`` where the near plane was given, or is still open."""
    far_steps: int | None = None


def near_far(camera: Camera | None) -> NearFar | None:
    """Return near and far plane of a camera; ``None`` if its matrix has none."""
    steps = getattr(camera, "_steps", (None, None))
    if isinstance(camera, PerspectiveCamera):
        near = default_near(camera.near, camera.far)
        return NearFar(near, camera.far, camera.near is None, False, *steps)
    if isinstance(camera, OrthographicCamera):
        far = default_far(camera.far, camera.near)
        return NearFar(camera.near, far, False, camera.far is None, *steps)
    if isinstance(camera, MatrixCamera):
        planes = _pinhole_planes(camera.clip_from_view)
        return None if planes is None else NearFar(*planes, camera.is_near_open, False, *steps)
    return None


def count_plane_steps(camera: Camera) -> tuple[int, int]:
    """Return how often rendering has halved the near plane of a camera and doubled its far one."""
    near, far = getattr(camera, "_steps", (None, None))
    return near or 0, far or 0


def move_planes(camera: Camera, near_steps: int = 0, far_steps: int = 0) -> Camera:
    """Return a copy of a camera with its open planes moved so many steps from the defaults."""
    planes = near_far(camera)
    if planes is None or not (planes.is_near_open or planes.is_far_open):
        return camera
    if type(camera) in (PerspectiveCamera, OrthographicCamera, MatrixCamera):
        # `copy.copy` does the same, and takes five times as long.
        moved = object.__new__(type(camera))
        moved.__dict__.update(camera.__dict__)
    else:
        # A subclass may keep more than fields, in slots.
        moved = copy.copy(camera)
    if planes.is_far_open:
        store(moved, far=planes.far * (1 << far_steps), _steps=(None, far_steps))
        return moved
    near = planes.near / (1 << near_steps)
    store(moved, _steps=(near_steps, None))
    if isinstance(camera, PerspectiveCamera):
        store(moved, near=near)
        return moved
    store(moved, is_near_open=False)
    if near_steps and isinstance(moved, MatrixCamera):
        clip = moved.clip_from_view.copy()
        clip[2, 2:] = transforms.perspective_depth(near, planes.far)
        clip.flags.writeable = False
        store(moved, clip_from_view=clip)
    return moved


def _pinhole_planes(clip: Float64) -> tuple[float, float] | None:
    """Return near and far plane of a pinhole along view space's z axis; ``None`` of others."""
    *_, (depth_x, depth_y, scale, offset), w_row = clip.tolist()
    if w_row != [0.0, 0.0, -1.0, 0.0] or depth_x != 0.0 or depth_y != 0.0:
        return None
    if not offset < 0.0 or not scale <= -1.0:
        return None
    near = offset / (scale - 1.0)
    return near, math.inf if scale == -1.0 else offset / (scale + 1.0)


def mirrors(pose: Float64) -> bool:
    """Tell whether a pose, (4, 4), mirrors: its determinant is below 0."""
    return _unit_volume(pose[:3, :3]) < -_VOLUME_ROUNDING


def check_camera(name: str, camera: Any) -> Camera:
    """Return ``camera`` if it is one, or raise ``ValueError``."""
    camera_types = PerspectiveCamera, OrthographicCamera, MatrixCamera
    # A protocol takes 20 microseconds to look for its methods.
    if not isinstance(camera, camera_types) and (
        isinstance(camera, type) or not isinstance(camera, Camera)
    ):
        raise ValueError(
            f"{name} must be a PerspectiveCamera, OrthographicCamera or MatrixCamera, got "
            f"{type(camera).__name__}"
        )
    return camera


def _store_pose(camera: PerspectiveCamera | OrthographicCamera) -> None:
    """Check eye, target and up together; store them as tuples of float, and the view matrix."""
    eye, target, up = (
        triple("eye", camera.eye), triple("target", camera.target), triple("up", camera.up)
    )  # fmt: skip
    view_from_world = transforms.look_at(eye, target, up)
    view_from_world.flags.writeable = False
    store(camera, eye=eye, target=target, up=up, _view_from_world=view_from_world)


def _solve_origin(rows: Float64) -> Float64:
    """Solve three affine equations, (3, 4), for the point, (3,), where all are 0."""
    square = transforms.identity()
    square[:3, :3] = rows[:, :3]
    inverse = transforms.normal_matrix(square).T
    x, y, z = (-rows[:, 3]).tolist()
    with np.errstate(over="ignore", invalid="ignore"):
        return ((inverse[:, 0] * x + inverse[:, 1] * y) + inverse[:, 2] * z) + 0.0


def _are_coplanar(rows: Float64) -> bool:
    """Tell whether three vectors, (3, 3), lie in a plane, to within the rounding of float64."""
    return abs(_unit_volume(rows)) <= _VOLUME_ROUNDING


def _unit_volume(rows: Float64) -> float:
    """Return the signed volume that three vectors, (3, 3), span when scaled to length one."""
    vectors = rows.tolist()
    if not all(map(any, vectors)):
        return 0.0
    (a, b, c), (d, e, f), (g, h, i) = (transforms.unit_numbers(*row) for row in vectors)
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
