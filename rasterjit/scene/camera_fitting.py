"""Choose where a camera stands: around a scene, or in plain numbers for those that people move."""

from __future__ import annotations

import inspect
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.scene import point_bounds, transforms
from rasterjit.scene import validation as check
from rasterjit.scene.camera import (
    Bounded,
    Camera,
    Float64,
    MatrixCamera,
    OrthographicCamera,
    PerspectiveCamera,
)
from rasterjit.scene.hooks import call_above
from rasterjit.scene.point_bounds import Chunks, ScenePoints
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.vectors import dot, length

if TYPE_CHECKING:
    import trimesh

    from rasterjit.scene.mesh import Mesh

Vector = tuple[float, float, float]
AnyCamera = PerspectiveCamera | OrthographicCamera | MatrixCamera

Projection: TypeAlias = Literal["perspective", "orthographic"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)
"""Which camera is made."""

DIRECTION: Vector = (-0.4, 0.6, 1.0)
"""
From the scene towards the camera that fits it, for y up: from the left, and from above.

High enough to see into open boxes. Handles, spouts and flanks stand clear of the rest.
"""

FIELD_OF_VIEW = 28.0
"""Vertical, degrees, of the perspective of such a camera: a long lens, which distorts little."""

COORDINATE_SHARE = 2.0**-30
"""Least distance as a share of the largest coordinate: float64 still tells eye from target."""

NEAREST = 1e-4
"""Least near plane, in radii of the scene or in distances from its centre, the larger."""

CLEARANCE = 0.01
"""
Share of its distance by which a near plane is nearer than the scene, and a far plane farther.

Well above the rounding of vertices, and less than a bit of depth precision.
"""

_DISTANCE_IN_RADII = 2.0
"""Distance of a fitted parallel camera, whose picture does not depend on it."""

_MIN_EXTENT = 2.0**-6
"""Least half extent that a parallel camera shows, in radii: of what is seen as a point."""

_NEAREST = 1e-6
"""Least near plane of a camera that fits a sphere, as a share of its distance: reached only when a
field of view close to 180 degrees puts the eye on the sphere."""

_MIN_RADIUS = 2.0**-40
"""Least radius framed, as a share of the centre's largest coordinate: float64 then still places
the eye to one part in 4000 of its distance."""


class Ball(NamedTuple):
    """The sphere around a scene, world space."""

    center: Vector
    radius: float
    scene: Bounded | None = None
    """What is in it: a camera fits that, if it is known."""

    @classmethod
    def around(cls, scene: Bounded) -> Ball:
        """Return the bounding sphere of a scene; of radius 1 around a single point."""
        if isinstance(scene, cls):
            return scene
        center, radius = scene.bounding_sphere()
        x, y, z = np.asarray(center, dtype=np.float64).tolist()
        return cls((x, y, z), float(radius) or 1.0, scene)

    def bounding_sphere(self) -> tuple[Vector, float]:
        """Return the centre, (3,), and the radius in world space."""
        return self.center, self.radius


def frame_of(up: ArrayLike) -> Matrix:
    """Return the shortest rotation, (4, 4), that takes y to ``up``; z up makes -y the front."""
    x, y, z = transforms.unit_vector("up", up).tolist()
    # The axis is the cross product of y and up; its length is the sine.
    sine = math.sqrt(x * x + z * z)
    axis = (z, 0.0, -x) if sine > 0.0 else (1.0, 0.0, 0.0)
    return transforms.rotate(axis, transforms.arc_tangent(sine, y))


def fit_upright(
    scene: Bounded, size: tuple[int, int], up: ArrayLike | None = None, *, steady: bool = False
) -> PerspectiveCamera:
    """
    Return the camera that a picture is seen from unless another is given.

    Parameters
    ----------
    scene : object with ``bounding_sphere()``
        Its ``up``, if it has one that is not None, says which way is up.
    size : (width, height)
        Of the picture, pixels.
    up : (3,) array_like, optional, world space
        Goes before the scene's.
    steady : bool
        As in `fit_camera`: for a scene that moves.

    Raises
    ------
    ValueError
        If ``up`` is zero, or the scene has no bounds.
    """
    chosen = getattr(scene, "up", None) if up is None else up
    aspect = size[0] / size[1]
    if chosen is None:
        return cast(PerspectiveCamera, fit_camera(scene, aspect=aspect, steady=steady))
    frame = frame_of(chosen)
    toward = transforms.apply(frame, DIRECTION)
    upward = transforms.apply(frame, (0.0, 1.0, 0.0))
    fitted = fit_camera(scene, toward, up=upward, aspect=aspect, steady=steady)
    return cast(PerspectiveCamera, fitted)


class CameraPose(NamedTuple):
    """Where a camera is and how it looks."""

    eye: Vector
    forward: Vector
    upward: Vector
    fov_y: float
    height: float | None
    """What a parallel camera shows from bottom to top, scene units."""

    @classmethod
    def of(cls, camera: Camera, size: tuple[int, int] = (1, 1)) -> CameraPose:
        """Return that of any camera, for an image of (width, height) pixels or its own."""
        view = camera.view_matrix()
        own = camera.size if isinstance(camera, MatrixCamera) else None
        projection = camera.projection_matrix(own or size)
        eye = triple_of(camera.eye_position())
        forward = triple_of(-transforms.unit_vector("view", view[2, :3]))
        upward = triple_of(transforms.unit_vector("view", view[1, :3]))
        focal = abs(float(projection[1, 1]))
        if not projection[3, :3].any():
            return cls(eye, forward, upward, 45.0, 2.0 / focal)
        return cls(eye, forward, upward, 2.0 * transforms.arc_tangent(1.0, focal), None)

    def angles(self, up: Vector) -> tuple[float, float]:
        """Return azimuth and elevation, degrees, of the direction it looks from."""
        frame = frame_of(up)[:3, :3].T
        x, y, z = (-dot(triple_of(row), self.forward) for row in frame)
        across = math.sqrt(x * x + z * z)
        elevation = transforms.arc_tangent(y, across)
        if across < COORDINATE_SHARE:
            # At a pole, what is up in the picture tells the azimuth.
            sign = -math.copysign(1.0, y)
            x, _, z = (sign * dot(triple_of(row), self.upward) for row in frame)
        return transforms.arc_tangent(x, z), elevation


def camera_at(
    eye: Vector, target: Vector, upward: Vector, fov_y: float, ball: Ball
) -> PerspectiveCamera:
    """Return the camera with a near plane before the scene, or near the eye."""
    distance = length(minus(ball.center, eye))
    near = near_plane(distance, ball.radius)
    return PerspectiveCamera(eye, target, upward, fov_y, near)


def near_plane(distance: float, radius: float) -> float:
    """Return a near plane before a sphere, given the distance of its centre, or near the eye."""
    return max((distance - radius) * (1.0 - CLEARANCE), NEAREST * distance, NEAREST * radius)


def pixel_size(depth: float, fov_y: float, size: tuple[int, int]) -> float:
    """Return the side of a pixel at a depth, scene units."""
    return 2.0 * depth / transforms.focal_length(fov_y) / size[1]


def triple_of(values: ArrayLike) -> Vector:
    """Return three numbers as a tuple of float."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def along(start: Vector, direction: Vector, length: float) -> Vector:
    """Return start + length * direction."""
    x, y, z = (a + length * b for a, b in zip(start, direction, strict=True))
    return x, y, z


def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def between(a: Vector, b: Vector, share: float) -> Vector:
    """Return a + share * (b - a)."""
    return along(a, minus(b, a), share)


def orbit_direction(
    azimuth: float, elevation: float, *, up: ArrayLike | None = None
) -> tuple[float, float, float]:
    """
    Return the unit vector from a target towards a camera that orbits it.

    Parameters
    ----------
    azimuth : float, degrees
        0 looks from +z; positive turns towards +x. Where z is up, 0 looks from -y.
    elevation : float, degrees
        0 is level; positive is above.
    up : (3,) array_like, world space, optional
        Default: y. For another, all turns with it by the smallest angle.

    Raises
    ------
    ValueError
        If an angle is not finite, or ``up`` is zero or not three finite numbers.
    """
    sin_a, cos_a = transforms.sine_cosine(check.finite_number("azimuth", azimuth))
    sin_e, cos_e = transforms.sine_cosine(check.finite_number("elevation", elevation))
    direction = sin_a * cos_e, sin_e, cos_a * cos_e
    if up is None:
        return direction
    x, y, z = transforms.apply(frame_of(up), direction).tolist()
    return x, y, z


def fit_camera(
    scene: Bounded | Mesh | trimesh.Trimesh | trimesh.Scene,
    direction: ArrayLike = DIRECTION,
    fov_y: float = FIELD_OF_VIEW,
    *,
    up: ArrayLike = (0.0, 1.0, 0.0),
    margin: float = 1.06,
    zoom: float = 1.0,
    projection: Projection = "perspective",
    aspect: float = 1.0,
    steady: bool = False,
) -> PerspectiveCamera | OrthographicCamera:
    """
    Return the camera that shows a scene as large as it fits into the picture, in its middle.

    Parameters
    ----------
    scene : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
        Or another object with ``bounding_sphere() -> (centre (3,), radius)``, whose sphere is then
        what is shown.
    direction : (3,) array_like, world space
        From the scene towards the camera, any length; see :func:`orbit_direction`.
    fov_y : float, degrees
        Vertical field of view of the perspective at zoom 1; sets how far away the camera is.
    up : (3,) array_like, world space
        If it is parallel to ``direction``, the camera takes world -z as up when it looks against
        ``up`` and +z when it looks along it (or +y, where z is parallel as well).
    margin : float
        The picture is this many times larger than the scene in it, at least 1: by default the
        scene touches 1 / 1.06 of the way from the middle to the border, either left and right or
        above and below, whichever is tighter.
    zoom : float
        How many times bigger the scene appears: narrows the field of view (or the height) and
        leaves the camera where it is.
    projection : {"perspective", "orthographic"}
    aspect : float
        Width over height of the image it is for. In a narrower one it shows more above and below
        (``min_aspect``) where the scene would be cut off at the sides.
    steady : bool
        Whether cameras from all directions are equally far from the middle of the scene's bounding
        box, so that it keeps its size where they go around it. They then fit the bounding sphere,
        with ``margin`` around that, and most scenes are smaller in the picture.

    Returns
    -------
    PerspectiveCamera or OrthographicCamera
        At zoom 1 the whole scene is in an image of any size, and at any zoom between the near and
        far plane.

    Raises
    ------
    ValueError
        If ``direction`` or ``up`` is zero, ``fov_y`` is outside (0, 180), ``margin`` is below 1,
        ``zoom`` or ``aspect`` is not above 0, the scene has no finite bounds, ``projection`` is
        unknown, or ``scene`` is nothing that can be drawn.

    Notes
    -----
    Fitted are all finite vertices that belong to a face, and balls of the sizes of points and lines
    that are measured in scene units. A single point is framed as a sphere of radius 1, and a scene
    too small for float64 beside its centre's coordinates as the smallest sphere that is not. The
    eye keeps 1/64 of the scene's radius from what is nearest to it, which matters where that is the
    tip of a cone or the end of a line; a parallel camera shows at least 1/32 of it.
    """
    # Arguments.
    check.one_of("projection", projection, PROJECTIONS)
    towards = transforms.unit_vector("direction", direction)
    upward = _upright(up, towards)
    focal = transforms.focal_length(fov_y)
    enlarged = check.finite_number("margin", margin)
    if enlarged < 1.0:
        raise ValueError(f"margin must be at least 1, got {enlarged!r}")
    magnified = check.positive_number("zoom", zoom)
    wide = check.positive_number("aspect", aspect)
    # What is to be seen, and from where.
    what = bounded(scene)
    chunks = None if check.true_or_false("steady", steady) else _chunks_of(what)
    center, radius, is_tiny = _sphere(what, chunks)
    is_parallel = projection == "orthographic"
    axes = transforms.look_at(towards, (0.0, 0.0, 0.0), upward)[:3, :3]
    # The nearest place from which all of it is seen.
    lens = _FittedLens(focal, enlarged, wide, is_parallel)
    if chunks is None or is_tiny or not math.isfinite(focal * enlarged / wide):
        placed = _place_for_sphere(lens)
    else:
        placed = _place_for_points(lens, ScenePoints(chunks, axes, center, radius))
    # That place in the world.
    right, upwards, back = axes
    with np.errstate(over="ignore", invalid="ignore"):
        middle = center + radius * (placed.x * right + placed.y * upwards)
        eye = middle + radius * placed.z * back
        target = middle + radius * placed.target * back
    # The camera there.
    shape: dict[str, float]
    if is_parallel:
        shape = {"height": radius * placed.height / magnified}
    else:
        shape = {"fov_y": _zoomed_fov(fov_y, magnified)}
    depths = {
        "near": radius * placed.near * (1.0 - CLEARANCE),
        "far": radius * placed.far * (1.0 + CLEARANCE),
    }
    if not all(map(math.isfinite, (*shape.values(), *depths.values(), *eye.tolist()))):
        raise ValueError(
            "scene, fov_y, margin, zoom and aspect must lead to finite distances, got a distance "
            f"of {radius * placed.z!r} and {shape} for what lies within {radius!r} of "
            f"{center.tolist()}"
        )
    kind = OrthographicCamera if is_parallel else PerspectiveCamera
    return kind(eye, target, upward, **shape, **depths, min_aspect=placed.min_aspect)


class _FittedLens(NamedTuple):
    """What a camera that fits shows."""

    focal: float
    """Of a pinhole: one over the slope that the picture shows above its middle."""
    margin: float
    aspect: float
    is_parallel: bool


class _FittedPlace(NamedTuple):
    """Where a camera that fits is, in its axes, in radii from the scene's centre."""

    x: float
    y: float
    z: float
    target: float
    """The z of the point it looks at."""
    height: float
    """What a parallel camera shows."""
    near: float
    far: float
    min_aspect: float


def _place_for_sphere(lens: _FittedLens) -> _FittedPlace:
    """Return the place from which the bounding sphere is in the picture."""
    narrow, height = min(1.0, lens.aspect), math.nan
    if lens.is_parallel:
        distance, height = _DISTANCE_IN_RADII * lens.margin, 2.0 * lens.margin / narrow
    else:
        # One over the sine of half the angle across the narrower side.
        cotangent = lens.focal / narrow
        distance = lens.margin * math.sqrt(1.0 + cotangent * cotangent)
    near = max(distance - 1.0, distance * _NEAREST)
    return _FittedPlace(0.0, 0.0, distance, 0.0, height, near, distance + 1.0, narrow)


def _place_for_points(lens: _FittedLens, cloud: ScenePoints) -> _FittedPlace:
    """Return the place from which all points are in the picture, as large as they can be."""
    if lens.is_parallel:
        distance = _DISTANCE_IN_RADII * lens.margin
        x, y = point_bounds.fit_parallel(cloud)
        half = lens.margin * max(x.slope / lens.aspect, y.slope, _MIN_EXTENT)
        widest = lens.margin * x.slope / half
    else:
        focal, half = lens.margin * lens.focal, math.nan
        distance, (x, y) = point_bounds.fit_perspective(cloud, focal / lens.aspect, focal)
        widest = focal * x.slope
    # The planes have room for what turns, unless the eye is near the sphere, or in it.
    near = max(distance - 1.0, 0.5 * (distance - cloud.nearest))
    target = 0.5 * (cloud.nearest + cloud.farthest)
    narrow = min(widest, lens.aspect, float(check.MAX_WHOLE_SIZE))
    return _FittedPlace(
        x.offset, y.offset, distance, target, 2.0 * half, near, distance + 1.0, narrow
    )


def zoom_camera(camera: AnyCamera, zoom: float) -> AnyCamera:
    """
    Return a camera at the same place that shows everything bigger.

    Parameters
    ----------
    camera : PerspectiveCamera, OrthographicCamera or MatrixCamera
    zoom : float
        How many times bigger: narrows the field of view or the height.

    Raises
    ------
    ValueError
        If ``zoom`` is not above 0, or leaves no field of view or height that a camera can have.
    """
    magnified = check.positive_number("zoom", zoom)
    if isinstance(camera, PerspectiveCamera):
        return replace(camera, fov_y=_zoomed_fov(camera.fov_y, magnified))
    if isinstance(camera, OrthographicCamera):
        return replace(camera, height=camera.height / magnified)
    clip = camera.clip_from_view.copy()
    clip[:2] *= magnified
    return replace(camera, clip_from_view=clip)


def _upright(up: ArrayLike, towards: Float64) -> Vector:
    """Return ``up``, or a replacement if it is parallel to the direction of the camera."""
    upward = transforms.unit_vector("up", up)
    if not transforms.are_parallel(upward, towards):
        return triple_of(up)
    (x, y, z), (a, b, c) = upward.tolist(), towards.tolist()
    above = x * a + y * b + z * c > 0.0
    fallback = (0.0, 0.0, -1.0 if above else 1.0)
    return (0.0, 1.0, 0.0) if transforms.are_parallel(fallback, towards) else fallback


def bounded(scene: Any) -> Bounded:
    """
    Return a scene, or what has a sphere as scenes do, as it is; other things to draw as a scene.

    Raises
    ------
    ValueError
        If it is none of these, or a trimesh object without faces.
    """
    # trimesh's objects have a property of this name, which is a mesh and needs SciPy.
    found = inspect.getattr_static(scene, "bounding_sphere", None)
    if found is None or isinstance(found, property):
        return call_above("as_scene", scene, "scene")
    return scene


def _chunks_of(scene: Bounded) -> Chunks | None:
    """Return what yields the points of a scene; None of what has a sphere alone."""
    known = scene.scene if isinstance(scene, Ball) else scene
    chunks = getattr(known, "_world_chunks", None)
    return None if chunks is None else point_bounds.kept(chunks)


def _sphere(scene: Bounded, chunks: Chunks | None) -> tuple[Float64, float, bool]:
    """
    Return the bounding sphere of a scene, or of its points, if they are given.

    Its radius is one that float64 can frame. The last value says whether the true one is smaller.
    """
    center, size = scene.bounding_sphere() if chunks is None else point_bounds.sphere_around(chunks)
    # Adding zero turns -0 into 0: which of the two a minimum gives depends on the CPU.
    center = check.vector("scene's center", center) + 0.0
    radius = check.finite_number("scene's radius", size)
    if radius < 0.0:
        raise ValueError(f"scene's radius must not be negative, got {radius!r}")
    smallest = float(np.abs(center).max()) * _MIN_RADIUS
    is_tiny = radius == 0.0 or radius < smallest
    return center, max(1.0 if radius == 0.0 else radius, smallest), is_tiny


def _zoomed_fov(fov_y: float, zoom: float) -> float:
    """Return the field of view, degrees, whose picture is ``zoom`` times bigger."""
    if zoom == 1.0:
        return float(fov_y)
    magnified = transforms.focal_length(fov_y) * zoom
    zoomed = 2.0 * transforms.arc_tangent(1.0, magnified) if magnified < math.inf else 0.0
    if not 0.0 < zoomed < 180.0:
        raise ValueError(f"zoom must leave a field of view within 0..180 degrees, got {zoom!r}")
    return zoomed
