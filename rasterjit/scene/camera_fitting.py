"""Fit cameras to scenes, and compute the poses of cameras that a user moves."""

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
from rasterjit.scene.hooks import call_higher_level
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
"""Kinds of cameras that `fit_camera` returns."""

DEFAULT_DIRECTION: Vector = (-0.4, 0.6, 1.0)
"""
Direction from the scene towards a fitted camera, for y up: to the left and above of the front.

Open boxes show their inside; handles and spouts at the sides are not hidden.
"""

DEFAULT_FOV_Y = 28.0
"""Vertical field of view of a fitted camera, degrees: narrow, so perspective distorts little."""

MIN_DISTANCE_RATIO = 2.0**-30
"""Least distance of eye and target over their largest coordinate: float64 tells them apart."""

MIN_NEAR_RATIO = 1e-4
"""Least distance of the near plane over the larger of the scene's radius and its distance."""

PLANE_MARGIN = 0.01
"""
By what fraction of its distance a near plane is nearer than the scene, and a far plane farther.

Well above the rounding of vertices; it costs less than a bit of depth precision.
"""

_PARALLEL_DISTANCE = 2.0
"""Distance of a fitted parallel camera, in radii; its picture does not depend on it."""

_MIN_EXTENT = 2.0**-6
"""Least half extent that a parallel camera shows, in radii: lines seen from an end have none."""

_MIN_SPHERE_NEAR = 1e-6
"""Least near plane of a camera that fits a sphere, over the distance of the centre: reached only if
a field of view close to 180 degrees puts the eye on the sphere."""

_MIN_RADIUS = 2.0**-40
"""Least radius that is fitted, over the largest coordinate of the centre: float64 then still places
the eye to one part in 4000 of its distance."""


class BoundingSphere(NamedTuple):
    """Bounding sphere of a scene, world space."""

    center: Vector
    radius: float
    scene: Bounded | None = None
    """The scene, if known: cameras are fitted to its points, not to the sphere."""

    @classmethod
    def around(cls, scene: Bounded) -> BoundingSphere:
        """Return the bounding sphere of a scene; of radius 1 around a single point."""
        if isinstance(scene, cls):
            return scene
        center, radius = scene.bounding_sphere()
        x, y, z = np.asarray(center, dtype=np.float64).tolist()
        return cls((x, y, z), float(radius) or 1.0, scene)

    def bounding_sphere(self) -> tuple[Vector, float]:
        """Return the centre, (3,), and the radius in world space."""
        return self.center, self.radius


def rotate_y_to(up: ArrayLike) -> Matrix:
    """Return the smallest rotation, (4, 4), from y to ``up``; that to z makes -y the front."""
    x, y, z = transforms.unit_triple("up", up)
    # The axis is the cross product of y and up; its length is the sine.
    sine = math.sqrt(x * x + z * z)
    axis = (z, 0.0, -x) if sine > 0.0 else (1.0, 0.0, 0.0)
    return transforms.rotate(axis, transforms.arc_tangent(sine, y))


def default_camera(
    scene: Bounded, size: tuple[int, int], up: ArrayLike | None = None, *, steady: bool = False
) -> PerspectiveCamera:
    """
    Return the default camera of a picture: fitted to the scene, with the scene's ``up``.

    Parameters
    ----------
    scene : object with ``bounding_sphere()``
        Its ``up``, if it has one that is not None, says which way is up.
    size : (width, height)
        Of the picture, pixels.
    up : (3,) array_like, optional, world space
        Replaces the scene's.
    steady : bool
        As in `fit_camera`: for a scene that moves.

    Raises
    ------
    ValueError
        If ``up`` is zero, or the scene has no bounds.
    """
    up_vector = getattr(scene, "up", None) if up is None else up
    aspect = size[0] / size[1]
    if up_vector is None:
        return cast(PerspectiveCamera, fit_camera(scene, aspect=aspect, steady=steady))
    rotation = rotate_y_to(up_vector)
    direction = transforms.apply(rotation, DEFAULT_DIRECTION)
    upward = transforms.apply(rotation, (0.0, 1.0, 0.0))
    fitted = fit_camera(scene, direction, up=upward, aspect=aspect, steady=steady)
    return cast(PerspectiveCamera, fitted)


class CameraPose(NamedTuple):
    """Eye, axes and projection of a camera."""

    eye: Vector
    forward: Vector
    upward: Vector
    fov_y: float
    height: float | None
    """Visible height of a parallel camera, scene units; None for a perspective."""

    @classmethod
    def of(cls, camera: Camera, size: tuple[int, int] = (1, 1)) -> CameraPose:
        """Return the pose of a camera, for an image of (width, height) or the camera's own size."""
        view = camera.view_matrix()
        camera_size = camera.size if isinstance(camera, MatrixCamera) else None
        projection = camera.projection_matrix(camera_size or size)
        eye = to_triple(camera.eye_position())
        forward = to_triple(-transforms.unit_vector("view", view[2, :3]))
        upward = to_triple(transforms.unit_vector("view", view[1, :3]))
        focal = abs(float(projection[1, 1]))
        if not projection[3, :3].any():
            # Parallel: any field of view will do.
            return cls(eye, forward, upward, 45.0, 2.0 / focal)
        return cls(eye, forward, upward, 2.0 * transforms.arc_tangent(1.0, focal), None)

    def azimuth_and_elevation(self, up: Vector) -> tuple[float, float]:
        """Return azimuth and elevation, degrees, of the direction from the target to the eye."""
        columns = rotate_y_to(up)[:3, :3].T
        x, y, z = (-dot(to_triple(column), self.forward) for column in columns)
        horizontal = math.sqrt(x * x + z * z)
        elevation = transforms.arc_tangent(y, horizontal)
        if horizontal < MIN_DISTANCE_RATIO:
            # Straight from above or below, only the upward direction has an azimuth.
            sign = -math.copysign(1.0, y)
            x, _, z = (sign * dot(to_triple(column), self.upward) for column in columns)
        return transforms.arc_tangent(x, z), elevation


def make_camera_at(
    eye: Vector, target: Vector, upward: Vector, fov_y: float, sphere: BoundingSphere
) -> PerspectiveCamera:
    """Return a perspective camera with a near plane before a sphere, or near an eye in it."""
    distance = length(subtract(sphere.center, eye))
    near = choose_near_plane(distance, sphere.radius)
    return PerspectiveCamera(eye, target, upward, fov_y, near)


def choose_near_plane(distance: float, radius: float) -> float:
    """Return a near plane before a sphere, given its centre's distance, or near an eye in it."""
    return max((distance - radius) * (1.0 - PLANE_MARGIN), MIN_NEAR_RATIO * max(distance, radius))


def pixel_size(depth: float, fov_y: float, size: tuple[int, int]) -> float:
    """Return the side of a pixel at a depth, both in scene units."""
    return 2.0 * depth / transforms.focal_length(fov_y) / size[1]


def to_triple(values: ArrayLike) -> Vector:
    """Return three numbers as a tuple of float."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def move_by(start: Vector, direction: Vector, distance: float) -> Vector:
    """Return start + distance * direction."""
    x, y, z = (a + distance * b for a, b in zip(start, direction, strict=True))
    return x, y, z


def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def lerp(a: Vector, b: Vector, t: float) -> Vector:
    """Return a + t * (b - a)."""
    return move_by(a, subtract(b, a), t)


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
        Default: y. For another, the direction is rotated by the smallest rotation from y to it.

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
    x, y, z = transforms.apply(rotate_y_to(up), direction).tolist()
    return x, y, z


def fit_camera(
    scene: Bounded | Mesh | trimesh.Trimesh | trimesh.Scene,
    direction: ArrayLike = DEFAULT_DIRECTION,
    fov_y: float = DEFAULT_FOV_Y,
    *,
    up: ArrayLike = (0.0, 1.0, 0.0),
    margin: float = 1.06,
    zoom: float = 1.0,
    projection: Projection = "perspective",
    aspect: float = 1.0,
    steady: bool = False,
) -> PerspectiveCamera | OrthographicCamera:
    """
    Return a camera that shows the whole scene, as large as possible and centred in the picture.

    Parameters
    ----------
    scene : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
        Or another object with ``bounding_sphere() -> (centre (3,), radius)``: the camera shows that
        sphere.
    direction : (3,) array_like, world space
        From the scene towards the camera, any length; see :func:`orbit_direction`.
    fov_y : float, degrees
        Vertical field of view of the perspective at zoom 1; sets how far away the camera is.
    up : (3,) array_like, world space
        If it is parallel to ``direction``, the camera takes world -z as up when it looks against
        ``up`` and +z when it looks along it (or +y, where z is parallel as well).
    margin : float
        How many times larger the picture is than the scene in it, at least 1. By default the scene
        reaches 1 / 1.06 of the way from the middle to the border, left and right or above and
        below, whichever is tighter.
    zoom : float
        How many times larger the scene appears: narrows the field of view (or the height), and does
        not move the camera.
    projection : {"perspective", "orthographic"}
    aspect : float
        Width over height of the image. In a narrower image the camera shows more above and below
        (``min_aspect``) if the scene would be cut off at the sides.
    steady : bool
        Whether cameras from all directions are equally far from the centre of the scene's bounding
        box, so that its size does not change as they go around it. They fit the bounding sphere,
        with ``margin`` around that; most scenes are smaller in the picture.

    Returns
    -------
    PerspectiveCamera or OrthographicCamera
        At zoom 1 an image of any size shows the whole scene; at any zoom, the scene lies between
        the near and the far plane.

    Raises
    ------
    ValueError
        If ``direction`` or ``up`` is zero, ``fov_y`` is outside (0, 180), ``margin`` is below 1,
        ``zoom`` or ``aspect`` is not above 0, the scene has no finite bounds, ``projection`` is
        unknown, or ``scene`` is nothing that can be drawn.

    Notes
    -----
    The camera fits all finite vertices that belong to a face, and points and lines with their sizes
    if these are in scene units. A single point is fitted as a sphere of radius 1, and a scene that
    is too small for float64 beside its centre's coordinates as the smallest sphere that is not. The
    eye is at least 1/64 of the scene's radius from the nearest point, which matters if that is the
    tip of a cone or the end of a line; a parallel camera shows at least 1/32 of the radius.
    """
    # Arguments.
    check.one_of("projection", projection, PROJECTIONS)
    to_camera = transforms.unit_triple("direction", direction)
    upward = _replace_parallel_up(up, to_camera)
    focal = transforms.focal_length(fov_y)
    margin = check.finite_number("margin", margin)
    if margin < 1.0:
        raise ValueError(f"margin must be at least 1, got {margin!r}")
    zoom = check.positive_number("zoom", zoom)
    aspect = check.positive_number("aspect", aspect)
    # The scene's points or sphere, and the camera's axes.
    bounded_scene = as_bounded(scene)
    chunks = None if check.boolean("steady", steady) else _point_chunks(bounded_scene)
    center, radius, is_tiny = _find_framed_sphere(bounded_scene, chunks)
    is_parallel = projection == "orthographic"
    axes = transforms.look_at(to_camera, (0.0, 0.0, 0.0), upward)[:3, :3]
    # The nearest pose that sees all of it.
    options = _FitOptions(focal, margin, aspect, is_parallel)
    if chunks is None or is_tiny or not math.isfinite(focal * margin / aspect):
        fitted = _fit_sphere(options)
    else:
        fitted = _fit_points(options, ScenePoints(chunks, axes, center, radius))
    # Its eye and target in world space.
    right, up_axis, backward = axes
    with np.errstate(over="ignore", invalid="ignore"):
        on_axis = center + radius * (fitted.x * right + fitted.y * up_axis)
        eye = to_triple(on_axis + radius * fitted.z * backward)
        target = to_triple(on_axis + radius * fitted.target_z * backward)
    # The camera.
    extent: dict[str, float]
    if is_parallel:
        extent = {"height": radius * fitted.height / zoom}
    else:
        extent = {"fov_y": _zoom_fov(fov_y, zoom)}
    depths = {
        "near": radius * fitted.near * (1.0 - PLANE_MARGIN),
        "far": radius * fitted.far * (1.0 + PLANE_MARGIN),
    }
    if not all(map(math.isfinite, (*extent.values(), *depths.values(), *eye))):
        raise ValueError(
            "scene, fov_y, margin, zoom and aspect must lead to finite distances, got a distance "
            f"of {radius * fitted.z!r} and {extent} for what lies within {radius!r} of "
            f"{center.tolist()}"
        )
    camera_type = OrthographicCamera if is_parallel else PerspectiveCamera
    return camera_type(eye, target, upward, **extent, **depths, min_aspect=fitted.min_aspect)


class _FitOptions(NamedTuple):
    """Projection and margin that a fit is computed for."""

    focal: float
    """Focal length of a pinhole, in half heights of the picture."""
    margin: float
    aspect: float
    is_parallel: bool


class _FittedView(NamedTuple):
    """Pose and frustum of a fitted camera, in its axes, from the scene's centre, in radii."""

    x: float
    y: float
    z: float
    """Of the eye."""
    target_z: float
    height: float
    """Visible height of a parallel camera; NaN for a perspective."""
    near: float
    far: float
    min_aspect: float
    """Width over height below which the camera shows more above and below."""


def _fit_sphere(options: _FitOptions) -> _FittedView:
    """Fit the bounding sphere into the picture."""
    min_aspect, height = min(1.0, options.aspect), math.nan
    if options.is_parallel:
        distance, height = _PARALLEL_DISTANCE * options.margin, 2.0 * options.margin / min_aspect
    else:
        # The distance is one over the sine of half the angle across the narrower side.
        cotangent = options.focal / min_aspect
        distance = options.margin * math.sqrt(1.0 + cotangent * cotangent)
    near = max(distance - 1.0, distance * _MIN_SPHERE_NEAR)
    return _FittedView(0.0, 0.0, distance, 0.0, height, near, distance + 1.0, min_aspect)


def _fit_points(options: _FitOptions, points: ScenePoints) -> _FittedView:
    """Fit all points into the picture, as large as they can be."""
    if options.is_parallel:
        distance = _PARALLEL_DISTANCE * options.margin
        x, y = point_bounds.fit_parallel(points)
        half_height = options.margin * max(x.slope / options.aspect, y.slope, _MIN_EXTENT)
        scene_aspect = options.margin * x.slope / half_height
    else:
        focal, half_height = options.margin * options.focal, math.nan
        distance, (x, y) = point_bounds.fit_perspective(points, focal / options.aspect, focal)
        scene_aspect = focal * x.slope
    # The planes enclose the sphere, so that the scene may be rotated, if the eye is outside it.
    near = max(distance - 1.0, 0.5 * (distance - points.nearest))
    target_z = 0.5 * (points.nearest + points.farthest)
    min_aspect = min(scene_aspect, options.aspect, float(check.MAX_TILED_SIZE))
    return _FittedView(
        x.offset, y.offset, distance, target_z, 2.0 * half_height, near, distance + 1.0, min_aspect
    )


def zoom_camera(camera: AnyCamera, zoom: float) -> AnyCamera:
    """
    Return a camera in the same pose that shows everything larger.

    Parameters
    ----------
    camera : PerspectiveCamera, OrthographicCamera or MatrixCamera
    zoom : float
        How many times larger: narrows the field of view or the height.

    Raises
    ------
    ValueError
        If ``zoom`` is not above 0, or leaves no field of view or height that a camera can have.
    """
    zoom = check.positive_number("zoom", zoom)
    if isinstance(camera, PerspectiveCamera):
        return replace(camera, fov_y=_zoom_fov(camera.fov_y, zoom))
    if isinstance(camera, OrthographicCamera):
        return replace(camera, height=camera.height / zoom)
    clip = camera.clip_from_view.copy()
    clip[:2] *= zoom
    return replace(camera, clip_from_view=clip)


def _replace_parallel_up(up: ArrayLike, to_camera: Vector) -> Vector:
    """Return ``up``, or a replacement if it is parallel to the direction to the camera."""
    upward = transforms.unit_triple("up", up)
    if not transforms.are_parallel(upward, to_camera):
        return check.triple("up", up)
    is_above = dot(upward, to_camera) > 0.0
    fallback = (0.0, 0.0, -1.0 if is_above else 1.0)
    return (0.0, 1.0, 0.0) if transforms.are_parallel(fallback, to_camera) else fallback


def as_bounded(scene: Any) -> Bounded:
    """
    Return the input if it has ``bounding_sphere()``, else convert it to a scene.

    Raises
    ------
    ValueError
        If it cannot be converted, such as a trimesh object without faces.
    """
    # trimesh's objects have a property of this name, which is a mesh and needs SciPy.
    member = inspect.getattr_static(scene, "bounding_sphere", None)
    if member is None or isinstance(member, property):
        return call_higher_level("as_scene", scene, "scene")
    return scene


def _point_chunks(scene: Bounded) -> Chunks | None:
    """Return the points of a scene, world space; None if only a bounding sphere is known."""
    target = scene.scene if isinstance(scene, BoundingSphere) else scene
    chunks = getattr(target, "_world_chunks", None)
    return None if chunks is None else point_bounds.cache_points(chunks)


def _find_framed_sphere(scene: Bounded, chunks: Chunks | None) -> tuple[Float64, float, bool]:
    """
    Return centre and radius of a scene, or of its points if given, and whether it is tiny.

    The radius of a tiny scene is replaced by the least that float64 can fit a camera to.
    """
    center, size = (
        scene.bounding_sphere() if chunks is None else point_bounds.bound_points_by_sphere(chunks)
    )
    # Adding zero turns -0 into 0: which of them a minimum returns depends on the CPU.
    center = check.vector("scene's center", center) + 0.0
    radius = check.finite_number("scene's radius", size)
    if radius < 0.0:
        raise ValueError(f"scene's radius must not be negative, got {radius!r}")
    min_radius = float(np.abs(center).max()) * _MIN_RADIUS
    is_tiny = radius == 0.0 or radius < min_radius
    return center, max(1.0 if radius == 0.0 else radius, min_radius), is_tiny


def _zoom_fov(fov_y: float, zoom: float) -> float:
    """Return the field of view, degrees, in which everything is ``zoom`` times larger."""
    if zoom == 1.0:
        return float(fov_y)
    focal = transforms.focal_length(fov_y) * zoom
    zoomed = 2.0 * transforms.arc_tangent(1.0, focal) if focal < math.inf else 0.0
    if not 0.0 < zoomed < 180.0:
        raise ValueError(f"zoom must leave a field of view within 0..180 degrees, got {zoom!r}")
    return zoomed
