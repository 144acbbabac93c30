"""Cameras that go around a scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit import transforms
from rasterjit.scene.camera import (
    Bounded,
    OrthographicCamera,
    PerspectiveCamera,
    fit_camera,
    orbit_direction,
)
from rasterjit.validation import bounded_number, finite_number, positive_number
from rasterjit.viewpoint import frame_of

FULL_TURN = 360.0
"""Degrees."""


def turntable(
    scene: Bounded,
    *,
    seconds: float = 1.0,
    azimuth: float = 31.0,
    elevation: float = 23.0,
    fov_y: float = 45.0,
    up: ArrayLike = (0.0, 1.0, 0.0),
    zoom: float = 1.0,
    projection: Literal["perspective", "orthographic"] = "perspective",
    aspect: float = 1.0,
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
        Width over height of the pictures.

    Raises
    ------
    ValueError
        If ``seconds`` is not above 0, or what `rasterjit.fit_camera` refuses.
    """
    period = positive_number("seconds", seconds)
    start = finite_number("azimuth", azimuth)
    height = bounded_number("elevation", elevation, -90.0, 90.0)
    frame = frame_of(up)
    sphere = measured(scene)

    def camera_at(time: float) -> PerspectiveCamera | OrthographicCamera:
        """Return the camera at a time, seconds."""
        turned = start + FULL_TURN * (finite_number("time", time) / period)
        # Ninety degrees above the camera is up for it, at the poles as well.
        return fit_camera(
            sphere,
            transforms.apply(frame, orbit_direction(turned, height)),
            fov_y,
            up=transforms.apply(frame, orbit_direction(turned, height + FULL_TURN / 4.0)),
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


def measured(scene: Bounded) -> Bounded:
    """Return the sphere around a scene, measured once; what has none is for a fit to refuse."""
    return _Sphere(*scene.bounding_sphere()) if hasattr(scene, "bounding_sphere") else scene
