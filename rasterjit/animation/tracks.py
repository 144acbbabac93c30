"""
Animate cameras, transforms and morph weights: by key frames, or around a scene.

SciPy makes the curves. ``"linear"`` joins the keys by straight lines and rotates at a constant
speed (spherical linear interpolation of quaternions); ``"smooth"`` uses natural cubic splines, and
splines of rotations with a continuous angular acceleration. Before the first key and after the last
a track is constant.

References
----------
Ken Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985.
Ken Shoemake and Tom Duff, "Matrix animation and polar decomposition", Graphics Interface 1992.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import camera_fitting, transforms
from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.camera import Bounded, OrthographicCamera, PerspectiveCamera, mirrors
from rasterjit.scene.keyframes import Animation
from rasterjit.scene.mesh import Mesh, replace_scalars, replace_vertices
from rasterjit.scene.scene import Scene

Float64 = NDArray[np.float64]
Interpolation: TypeAlias = Literal["linear", "smooth"]
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
Curve = Callable[[float], Any]

DEGREES_PER_TURN = 360.0

MEASURED_TIME_COUNT = 33
"""Number of times of an animation at which a scene is measured."""


class _Track(Guarded):
    """Keys at times: the base of all tracks."""

    _FIELDS = ("times", "keys", "interpolation", "mesh")

    def __init__(self, times: ArrayLike, keys: Sequence[Any], interpolation: Interpolation) -> None:
        self.times = _check_key_times(times)
        self.keys = tuple(keys)
        self.interpolation = check.one_of("interpolation", interpolation, INTERPOLATIONS)
        if len(self.keys) != len(self.times):
            raise ValueError(
                f"times and keys must be as many, got {len(self.times)} times and "
                f"{len(self.keys)} keys"
            )

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({len(self.keys)} keys in {self.times[0]:g}.."
            f"{self.times[-1]:g} s, {self.interpolation})"
        )

    def _key_at(self, time: float) -> tuple[float, Any]:
        """Return the time, clamped to those of the keys, and the key at that time or None."""
        time = check.finite_number("time", time)
        time = min(max(time, float(self.times[0])), float(self.times[-1]))
        number = int(np.searchsorted(self.times, time))
        return time, self.keys[number] if self.times[number] == time else None


class CameraTrack(_Track):
    """
    A camera that goes from key to key.

    What is looked at moves along one curve, the direction turns, and the distance changes by a
    constant factor a second between two keys. So a camera whose keys look at one point goes around
    it and looks at it all the time.

    Parameters
    ----------
    times : (K,) array_like of float, seconds
        Growing.
    cameras : sequence of K PerspectiveCamera, or of K OrthographicCamera
        All of one kind. ``far`` is infinite for all or for none; ``near`` and ``far`` are given by
        all or by none.
    interpolation : {"linear", "smooth"}

    Raises
    ------
    ValueError
        If times or cameras are not such.
    ImportError
        If SciPy is not installed, which the extra ``rasterjit[animation]`` brings.
    """

    def __init__(
        self,
        times: ArrayLike,
        cameras: Sequence[PerspectiveCamera | OrthographicCamera],
        interpolation: Interpolation = "linear",
    ) -> None:
        if not isinstance(cameras, Iterable):
            raise ValueError(f"cameras must be a sequence of cameras, got {check.brief(cameras)}")
        super().__init__(times, cameras, interpolation)
        kind = type(self.keys[0])
        if kind not in (PerspectiveCamera, OrthographicCamera):
            raise ValueError(
                "cameras must be PerspectiveCamera or OrthographicCamera, got "
                f"{check.brief(self.keys[0])}"
            )
        for camera in self.keys:
            if type(camera) is not kind:
                raise ValueError(
                    f"cameras must be of one kind, got {kind.__name__} and {check.brief(camera)}"
                )
        views = np.array([camera.view_matrix()[:3, :3] for camera in self.keys])
        targets = np.array([camera.target for camera in self.keys])
        eyes = np.array([camera.eye for camera in self.keys])
        distances = np.sqrt(np.square(eyes - targets).sum(axis=1))
        self._target = _make_curve(self.times, targets, interpolation)
        self._rotation = _make_rotation_curve(self.times, views.transpose(0, 2, 1), interpolation)
        self._log_distance = _make_monotone_curve(self.times, np.log(distances), interpolation)
        names = {field.name for field in dataclasses.fields(kind)} - {"eye", "target", "up"}
        self._numbers = {name: self._make_number_curve(name) for name in sorted(names)}

    def __call__(self, time: float) -> PerspectiveCamera | OrthographicCamera:
        """Return the camera at a time, seconds: a key at its own time."""
        time, key = self._key_at(time)
        if key is not None:
            return key
        axes = self._rotation(time)
        target = self._target(time)
        numbers = {name: curve(time) for name, curve in self._numbers.items()}
        eye = target + np.exp(self._log_distance(time)) * axes[:, 2]
        return type(self.keys[0])(eye, target, axes[:, 1], **numbers)

    def _make_number_curve(self, name: str) -> Curve:
        """Return the curve of a field of the cameras; of None if no camera sets the field."""
        fields = [getattr(camera, name) for camera in self.keys]
        if all(value is None for value in fields):
            return lambda time: None
        if any(value is None for value in fields):
            raise ValueError(f"cameras must all have a {name}, or none, got {fields}")
        values = np.array(fields)
        if (values == values[0]).all():
            return lambda time: float(values[0])
        if not np.isfinite(values).all():
            raise ValueError(f"cameras must all have a finite {name}, or none, got {values}")
        curve = _make_monotone_curve(self.times, values, self.interpolation)
        return lambda time: float(curve(time))


class TransformTrack(_Track):
    """
    A transform that goes from key to key.

    Each key is taken apart into a translation, a rotation and a stretch (its polar decomposition),
    so nothing shrinks while it turns. A turn goes the short way, by at most 180 degrees from key to
    key.

    Parameters
    ----------
    times : (K,) array_like of float, seconds
        Growing.
    transforms : (K, 4, 4) array_like
        ``parent_from_node``, affine, as `Node.transform` is: of a node without a parent its
        place in the world.
    interpolation : {"linear", "smooth"}

    Raises
    ------
    ValueError
        If times or transforms are not such.
    ImportError
        If SciPy is not installed, which the extra ``rasterjit[animation]`` brings.
    """

    def __init__(
        self, times: ArrayLike, transforms: ArrayLike, interpolation: Interpolation = "linear"
    ) -> None:
        matrices = check.finite_array("transforms", transforms, (None, 4, 4)).copy()
        super().__init__(times, matrices, interpolation)
        if not (matrices[:, 3] == (0.0, 0.0, 0.0, 1.0)).all():
            raise ValueError("transforms must have last rows (0, 0, 0, 1)")
        polar = _import_scipy("linalg").polar
        rotations, stretches = [], []
        for matrix in matrices:
            rotation, stretch = polar(matrix[:3, :3])
            # A reflection goes into the stretch.
            sign = -1.0 if mirrors(rotation) else 1.0
            rotations.append(sign * rotation)
            stretches.append(sign * stretch)
        self._rotation = _make_rotation_curve(self.times, np.array(rotations), interpolation)
        self._stretch = _make_curve(self.times, np.array(stretches), interpolation)
        self._offset = _make_curve(self.times, matrices[:, :3, 3], interpolation)

    def __call__(self, time: float) -> Float64:
        """Return the transform, (4, 4) float64, at a time: a key at its own time."""
        time, key = self._key_at(time)
        if key is not None:
            return key.copy()
        matrix = np.eye(4)
        matrix[:3, :3] = self._rotation(time) @ self._stretch(time)
        matrix[:3, 3] = self._offset(time)
        return matrix


class MorphTrack(_Track):
    """
    A mesh whose vertices or scalars go from key to key: a morph, or the steps of a simulation.

    Parameters
    ----------
    times : (K,) array_like of float, seconds
        Growing.
    mesh : Mesh
        Gives faces, colours, texture coordinates and material, and how scalars are shown.
    vertices : (K, V, 3) array_like, model space, optional
        What its vertices are at each time. Default: those of the mesh, all the time.
    scalars : (K, V) or (K, F) array_like, optional
        Its scalars at each time, all finite. Colour map, norm and range are those of the mesh's own
        scalars, the same at all times; if it has none, ``"viridis"`` and the range of all of these.
    interpolation : {"linear", "smooth"}

    Notes
    -----
    Normals are those of the shape at the time: averages over the faces around each vertex.

    Raises
    ------
    ValueError
        If times, vertices or scalars are not such, or neither is given.
    ImportError
        If SciPy is not installed, which the extra ``rasterjit[animation]`` brings.
    """

    def __init__(
        self,
        times: ArrayLike,
        mesh: Mesh,
        vertices: ArrayLike | None = None,
        interpolation: Interpolation = "linear",
        *,
        scalars: ArrayLike | None = None,
    ) -> None:
        check.instance_of("mesh", mesh, Mesh)
        if vertices is None and scalars is None:
            raise ValueError("vertices must be given where no scalars are")
        keys = []
        if vertices is not None:
            keys.append(check.finite_array("vertices", vertices, (None, len(mesh.vertices), 3)))
        if scalars is not None:
            values = check.finite_array("scalars", scalars, (None, None))
            if not values.size:
                raise ValueError(f"scalars must have rows of numbers, got shape {values.shape}")
            if mesh.field is None:
                mesh = mesh.with_scalars(values[0], range=(values.min(), values.max()))
            assert mesh.field is not None
            count = len(mesh.field.values)
            if values.shape[1] != count:
                raise ValueError(
                    f"scalars must have {count} columns, as the mesh has scalars, got "
                    f"{values.shape[1]}"
                )
            keys.append(values)
        if len(keys[0]) != len(keys[-1]):
            raise ValueError(
                f"scalars must be as many rows as vertices, {len(keys[0])}, got {len(keys[-1])}"
            )
        super().__init__(times, list(zip(*keys, strict=True)), interpolation)
        self.mesh = mesh
        self._curves = [_make_curve(self.times, key, interpolation) for key in keys]
        self._has_vertices = vertices is not None

    def __call__(self, time: float) -> Mesh:
        """Return the mesh at a time, seconds, with the arrays of a key at its own time."""
        time, key = self._key_at(time)
        arrays = [curve(time) for curve in self._curves] if key is None else [*key]
        mesh = replace_vertices(self.mesh, arrays.pop(0)) if self._has_vertices else self.mesh
        return replace_scalars(mesh, arrays[0]) if arrays else mesh


def _check_key_times(times: ArrayLike) -> Float64:
    """Return the times of keys, (K,) float64, or raise ``ValueError``."""
    key_times = check.finite_array("times", times, (None,)).copy()
    if not len(key_times) or not (np.diff(key_times) > 0.0).all():
        raise ValueError(f"times must be one or more growing numbers, got {key_times.tolist()}")
    return key_times


def _make_curve(times: Float64, values: Float64, interpolation: Interpolation) -> Curve:
    """Return a curve through rows of values: linear, or a natural cubic spline."""
    if len(times) == 1:
        return lambda time: values[0]
    interpolate = _import_scipy("interpolate")
    if interpolation == "linear":
        return interpolate.make_interp_spline(times, values, k=1)
    return interpolate.CubicSpline(times, values, bc_type="natural")


def _make_monotone_curve(times: Float64, values: Float64, interpolation: Interpolation) -> Curve:
    """Return a curve through values that is monotone between neighbours."""
    if len(times) == 1 or interpolation == "linear":
        return _make_curve(times, values, "linear")
    return _import_scipy("interpolate").PchipInterpolator(times, values)


def _make_rotation_curve(times: Float64, rotations: Float64, interpolation: Interpolation) -> Curve:
    """Return a curve of rotations, (3, 3), through keys, (K, 3, 3)."""
    if len(times) == 1:
        return lambda time: rotations[0]
    spatial = _import_scipy("spatial.transform")
    curve_type = spatial.Slerp if interpolation == "linear" else spatial.RotationSpline
    curve = curve_type(times, spatial.Rotation.from_matrix(rotations))
    return lambda time: curve(time).as_matrix()


def _import_scipy(name: str) -> Any:
    """Import a module of SciPy, or raise ``ImportError`` naming what to install."""
    from importlib import import_module

    with check.needs_extra("animation", "tracks between keys need SciPy"):
        return import_module(f"scipy.{name}")


def turntable(
    scene: Bounded,
    *,
    seconds: float = 1.0,
    azimuth: float = -22.0,
    elevation: float = 29.0,
    fov_y: float = camera_fitting.DEFAULT_FOV_Y,
    up: ArrayLike = (0.0, 1.0, 0.0),
    zoom: float = 1.0,
    projection: camera_fitting.Projection = "perspective",
    aspect: float = 1.0,
    animation: str | int | Animation | Sequence[str | int | Animation] | None = None,
) -> Callable[[float], PerspectiveCamera | OrthographicCamera]:
    """
    Return a camera that goes around a scene, as a function of time.

    Parameters
    ----------
    scene : Scene
        What it looks at, from a distance at which the whole of it is seen from every side. It is
        measured now: the camera keeps its distance whatever moves later.
    seconds : float
        How long one turn takes: at times 0 and ``seconds`` the camera is at one place.
    azimuth, elevation : float, degrees
        Where it begins, as in `rasterjit.orbit_direction`; the elevation is in -90..90.
    fov_y : float, degrees
        Vertical field of view at zoom 1.
    up : (3,) array_like, world space
        The axis it turns around; azimuth 0 then is at -y for z up.
    zoom : float
        How many times bigger the scene appears.
    projection : {"perspective", "orthographic"}
    aspect : float
        Width over height of the pictures; narrower ones cut nothing off either.
    animation : str, int, Animation or a sequence of them, optional
        Which of the scene's animations play meanwhile, as in `Scene.at`: it is measured at 33 times
        of it.

    Raises
    ------
    ValueError
        If ``seconds`` is not above 0, or what `rasterjit.fit_camera` refuses.
    """
    period = check.positive_number("seconds", seconds)
    start = check.finite_number("azimuth", azimuth)
    elevation = check.bounded_number("elevation", elevation, -90.0, 90.0)
    rotation = camera_fitting.rotate_y_to(up)
    sphere = measure_sphere(scene) if animation is None else _measure_animation(scene, animation)

    def direction(azimuth: float, elevation: float) -> Float64:
        return transforms.apply(rotation, camera_fitting.orbit_direction(azimuth, elevation))

    def camera_at(time: float) -> PerspectiveCamera | OrthographicCamera:
        """Return the camera at a time, seconds."""
        azimuth = start + DEGREES_PER_TURN * (check.finite_number("time", time) / period)
        # The direction ninety degrees above the camera's is up, at the poles as well.
        return camera_fitting.fit_camera(
            sphere, direction(azimuth, elevation), fov_y,
            up=direction(azimuth, elevation + DEGREES_PER_TURN / 4.0),
            zoom=zoom, projection=projection, aspect=aspect,
        )  # fmt: skip

    camera_at(0.0)
    return camera_at


def _measure_animation(scene: Bounded, animation: Any) -> Bounded:
    """Return a sphere around a scene at all times of an animation, measured at some of them."""
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene to play an animation, got {check.brief(scene)}")
    clips = scene._choose_animations(animation)
    duration = max((clip.duration for clip in clips), default=0.0)
    times = np.linspace(0.0, duration, MEASURED_TIME_COUNT).tolist()
    spheres = [scene.at(time, animation).bounding_sphere() for time in times]
    lows = np.array([center - radius for center, radius in spheres])
    highs = np.array([center + radius for center, radius in spheres])
    middle = (lows.min(axis=0) + highs.max(axis=0)) / 2.0
    radius = max(
        float(np.sqrt(np.square(center - middle).sum())) + radius for center, radius in spheres
    )
    return camera_fitting.BoundingSphere(camera_fitting.to_triple(middle), radius)


def measure_sphere(scene: Bounded) -> Bounded:
    """Measure the bounding sphere of a scene, or of anything else to draw, once."""
    return camera_fitting.BoundingSphere(*camera_fitting.as_bounded(scene).bounding_sphere())
