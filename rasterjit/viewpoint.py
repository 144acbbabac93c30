"""Where a camera stands and looks, in plain numbers: what those that a person moves are made of."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rasterjit import transforms
from rasterjit.scene.camera import Bounded, Camera, PerspectiveCamera
from rasterjit.transforms import Matrix

Vector = tuple[float, float, float]

COORDINATE_SHARE = 2.0**-30
"""Least distance as a share of the largest coordinate: float64 still tells eye from target."""

NEAREST = 1e-4
"""Least near plane, in radii of the scene or in distances from its centre, the larger."""

CLEARANCE = 0.01
"""Share of its distance by which the near plane is nearer than the scene."""


class Ball(NamedTuple):
    """The sphere around a scene, world space."""

    center: Vector
    radius: float

    @classmethod
    def around(cls, scene: Bounded) -> Ball:
        """Return the bounding sphere of a scene; of radius 1 around a single point."""
        center, radius = scene.bounding_sphere()
        x, y, z = np.asarray(center, dtype=np.float64).tolist()
        return cls((x, y, z), float(radius) or 1.0)

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


class Sight(NamedTuple):
    """Where a camera is and how it looks."""

    eye: Vector
    forward: Vector
    upward: Vector
    fov_y: float
    height: float | None
    """What a parallel camera shows from bottom to top, scene units."""

    @classmethod
    def of(cls, camera: Camera) -> Sight:
        """Return that of any camera."""
        view = camera.view_matrix()
        projection = camera.projection_matrix((1, 1))
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
    before = (distance - ball.radius) * (1.0 - CLEARANCE)
    near = max(before, NEAREST * distance, NEAREST * ball.radius)
    return PerspectiveCamera(eye, target, upward, fov_y, near)


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


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def length(a: Vector) -> float:
    """Return the length."""
    return math.sqrt(dot(a, a))
