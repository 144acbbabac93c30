"""
Animate cameras, transforms and morph weights: by key frames, or around a scene.

SciPy draws the curves. ``"linear"`` joins the keys by straight lines and turns at a constant speed
(spherical linear interpolation of quaternions); ``"smooth"`` goes through the same keys without a
jolt: natural cubic splines, and splines of rotations with a continuous angular acceleration. Before
the first key and after the last a track stands still.

References
----------
Ken Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985.
Ken Shoemake and Tom Duff, "Matrix animation and polar decomposition", Graphics Interface 1992.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import camera_fitting, transforms
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.camera import Bounded, OrthographicCamera, PerspectiveCamera
from rasterjit.scene.keyframes import Animation
from rasterjit.scene.mesh import Mesh, copy_field, set_face_values
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import (
    bounded_number,
    brief,
    finite_array,
    finite_number,
    one_of,
    positive_number,
)

Float64 = NDArray[np.float64]
Interpolation: TypeAlias = Literal["linear", "smooth"]
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
Curve = Callable[[float], Any]

FULL_TURN = 360.0
"""Degrees."""

MEASURED_TIMES = 33
"""Of an animation, from its beginning to its end."""


class _Track(Guarded):
    """Keys at times, and what is common to all that goes between them."""

    _FIELDS = ("times", "keys", "interpolation", "mesh")

    def __init__(self, times: ArrayLike, keys: Sequence[Any], interpolation: Interpolation) -> None:
        self.times = _key_times(times)
        self.keys = tuple(keys)
        self.interpolation = one_of("interpolation", interpolation, INTERPOLATIONS)
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
        """Return the time, and the key if it is that of one, or is before or after all."""
        time = finite_number("time", time)
        time = min(max(time, float(self.times[0])), float(self.times[-1]))
        nearest = int(np.searchsorted(self.times, time))
        return time, self.keys[nearest] if self.times[nearest] == time else None


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
            raise ValueError(f"cameras must be a sequence of cameras, got {brief(cameras)}")
        super().__init__(times, cameras, interpolation)
        kind = type(self.keys[0])
        if kind not in (PerspectiveCamera, OrthographicCamera):
            raise ValueError(
                "cameras must be PerspectiveCamera or OrthographicCamera, got "
                f"{brief(self.keys[0])}"
            )
        for camera in self.keys:
            if type(camera) is not kind:
                raise ValueError(
                    f"cameras must be of one kind, got {kind.__name__} and {brief(camera)}"
                )
        views = np.array([camera.view_matrix()[:3, :3] for camera in self.keys])
        targets = np.array([camera.target for camera in self.keys])
        eyes = np.array([camera.eye for camera in self.keys])
        distances = np.sqrt(np.square(eyes - targets).sum(axis=1))
        self._target = _curve(self.times, targets, interpolation)
        self._turn = _turning(self.times, views.transpose(0, 2, 1), interpolation)
        self._log_distance = _monotone(self.times, np.log(distances), interpolation)
        names = {field.name for field in dataclasses.fields(kind)} - {"eye", "target", "up"}
        self._numbers = {name: self._number(name) for name in sorted(names)}

    def __call__(self, time: float) -> PerspectiveCamera | OrthographicCamera:
        """Return the camera at a time, seconds; at the time of a key, that key."""
        time, key = self._key_at(time)
        if key is not None:
            return key
        axes = self._turn(time)
        target = self._target(time)
        numbers = {name: curve(time) for name, curve in self._numbers.items()}
        eye = target + np.exp(self._log_distance(time)) * axes[:, 2]
        return type(self.keys[0])(eye, target, axes[:, 1], **numbers)

    def _number(self, name: str) -> Curve:
        """Return the curve of one of the cameras' numbers, or of what none of them gives."""
        given = [getattr(camera, name) for camera in self.keys]
        if all(value is None for value in given):
            return lambda time: None
        if any(value is None for value in given):
            raise ValueError(f"cameras must all have a {name}, or none, got {given}")
        values = np.array(given)
        if (values == values[0]).all():
            return lambda time: float(values[0])
        if not np.isfinite(values).all():
            raise ValueError(f"cameras must all have a finite {name}, or none, got {values}")
        curve = _monotone(self.times, values, self.interpolation)
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
        matrices = finite_array("transforms", transforms, (None, 4, 4)).copy()
        super().__init__(times, matrices, interpolation)
        if not (matrices[:, 3] == (0.0, 0.0, 0.0, 1.0)).all():
            raise ValueError("transforms must have last rows (0, 0, 0, 1)")
        polar = _scipy("linalg").polar
        rotations, stretches = [], []
        for matrix in matrices:
            rotation, stretch = polar(matrix[:3, :3])
            # What mirrors goes into the stretch.
            sign = np.sign(_determinant(rotation))
            rotations.append(sign * rotation)
            stretches.append(sign * stretch)
        self._turn = _turning(self.times, np.array(rotations), interpolation)
        self._stretch = _curve(self.times, np.array(stretches), interpolation)
        self._offset = _curve(self.times, matrices[:, :3, 3], interpolation)

    def __call__(self, time: float) -> Float64:
        """Return the transform, (4, 4) float64, at a time; at that of a key, that key."""
        time, key = self._key_at(time)
        if key is not None:
            return key.copy()
        matrix = np.eye(4)
        matrix[:3, :3] = self._turn(time) @ self._stretch(time)
        matrix[:3, 3] = self._offset(time)
        return matrix


class MorphTrack(_Track):
    """
    A mesh whose vertices go from key to key.

    Parameters
    ----------
    times : (K,) array_like of float, seconds
        Growing.
    mesh : Mesh
        Gives faces, colours, texture coordinates and material.
    vertices : (K, V, 3) array_like, model space
        What its vertices are at each time.
    interpolation : {"linear", "smooth"}

    Notes
    -----
    Normals are those of the shape at the time: averages over the faces around each vertex.

    Raises
    ------
    ValueError
        If times or vertices are not such.
    ImportError
        If SciPy is not installed, which the extra ``rasterjit[animation]`` brings.
    """

    def __init__(
        self,
        times: ArrayLike,
        mesh: Mesh,
        vertices: ArrayLike,
        interpolation: Interpolation = "linear",
    ) -> None:
        if not isinstance(mesh, Mesh):
            raise ValueError(f"mesh must be a Mesh, got {brief(mesh)}")
        shapes = finite_array("vertices", vertices, (None, len(mesh.vertices), 3))
        super().__init__(times, shapes, interpolation)
        self.mesh = mesh
        self._curve = _curve(self.times, shapes, interpolation)

    def __call__(self, time: float) -> Mesh:
        """Return the mesh at a time, seconds; at the time of a key, its vertices."""
        time, key = self._key_at(time)
        mesh = self.mesh
        moved = Mesh(
            self._curve(time) if key is None else key,
            mesh.faces,
            colors=mesh.vertex_colors,
            uv=mesh.uv,
            uv1=mesh.uv1,
            attributes=mesh.vertex_attributes,
            material=mesh.material,
        )
        copy_field(moved, mesh)
        return set_face_values(moved, mesh.face_colors, mesh.face_attributes)


def _key_times(times: ArrayLike) -> Float64:
    """Return the times of keys, (K,) float64, or raise ``ValueError``."""
    found = finite_array("times", times, (None,)).copy()
    if not len(found) or not (np.diff(found) > 0.0).all():
        raise ValueError(f"times must be one or more growing numbers, got {found.tolist()}")
    return found


def _curve(times: Float64, values: Float64, interpolation: Interpolation) -> Curve:
    """Return a curve through rows of values: straight, or a natural cubic spline."""
    if len(times) == 1:
        return lambda time: values[0]
    interpolate = _scipy("interpolate")
    if interpolation == "linear":
        return interpolate.make_interp_spline(times, values, k=1)
    return interpolate.CubicSpline(times, values, bc_type="natural")


def _monotone(times: Float64, values: Float64, interpolation: Interpolation) -> Curve:
    """Return a curve through values that stays between each two neighbours."""
    if len(times) == 1 or interpolation == "linear":
        return _curve(times, values, "linear")
    return _scipy("interpolate").PchipInterpolator(times, values)


def _turning(times: Float64, rotations: Float64, interpolation: Interpolation) -> Curve:
    """Return the rotations, (3, 3), between those given, (K, 3, 3)."""
    if len(times) == 1:
        return lambda time: rotations[0]
    spatial = _scipy("spatial.transform")
    kind = spatial.Slerp if interpolation == "linear" else spatial.RotationSpline
    turn = kind(times, spatial.Rotation.from_matrix(rotations))
    return lambda time: turn(time).as_matrix()


def _determinant(matrix: Float64) -> float:
    """Return the determinant of a (3, 3) matrix."""
    return float(np.cross(matrix[0], matrix[1]) @ matrix[2])


def _scipy(name: str) -> Any:
    """Import a part of SciPy, or say what brings it."""
    from importlib import import_module

    try:
        return import_module(f"scipy.{name}")
    except ImportError:
        raise ImportError(
            'tracks between keys need SciPy; pip install "rasterjit[animation]"'
        ) from None


def turntable(
    scene: Bounded,
    *,
    seconds: float = 1.0,
    azimuth: float = -22.0,
    elevation: float = 29.0,
    fov_y: float = camera_fitting.FIELD_OF_VIEW,
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
    period = positive_number("seconds", seconds)
    start = finite_number("azimuth", azimuth)
    height = bounded_number("elevation", elevation, -90.0, 90.0)
    frame = camera_fitting.up_rotation(up)
    sphere = measured(scene) if animation is None else _measured_moving(scene, animation)

    def camera_at(time: float) -> PerspectiveCamera | OrthographicCamera:
        """Return the camera at a time, seconds."""
        turned = start + FULL_TURN * (finite_number("time", time) / period)
        # Ninety degrees above the camera is up for it, at the poles as well.
        return camera_fitting.fit_camera(
            sphere,
            transforms.apply(frame, camera_fitting.orbit_direction(turned, height)),
            fov_y,
            up=transforms.apply(
                frame, camera_fitting.orbit_direction(turned, height + FULL_TURN / 4.0)
            ),
            zoom=zoom,
            projection=projection,
            aspect=aspect,
        )

    camera_at(0.0)
    return camera_at


class _Sphere(NamedTuple):
    """What a scene measured."""

    center: NDArray[np.float64]
    radius: float

    def bounding_sphere(self) -> tuple[NDArray[np.float64], float]:
        """Return the centre, (3,), and the radius in world space."""
        return self.center, self.radius


def _measured_moving(scene: Bounded, animation: Any) -> Bounded:
    """Return a sphere around all that a scene's animations show, measured at some times."""
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene to play an animation, got {brief(scene)}")
    length = max((one.duration for one in scene._chosen_animations(animation)), default=0.0)
    times = np.linspace(0.0, length, MEASURED_TIMES).tolist()
    spheres = [scene.at(time, animation).bounding_sphere() for time in times]
    lows = np.array([center - radius for center, radius in spheres])
    highs = np.array([center + radius for center, radius in spheres])
    middle = (lows.min(axis=0) + highs.max(axis=0)) / 2.0
    reach = max(
        float(np.sqrt(np.square(center - middle).sum())) + radius for center, radius in spheres
    )
    return _Sphere(middle, reach)


def measured(scene: Bounded) -> Bounded:
    """Return the sphere around a scene, or another thing to draw, measured once."""
    return _Sphere(*camera_fitting.as_bounded(scene).bounding_sphere())
