"""
Camera controls: `Orbit` turns around a scene, `Fly` moves through it.

Both are immutable: an event or a time goes in, a new state comes out. They use no window, clock or
thread, so the same events and times always give the same camera.

Events are the dictionaries of ``rendercanvas``: ``event_type`` with ``x``, ``y``, ``button``,
``modifiers``, ``dx``, ``dy`` or ``key``; x right, y down, in pixels from the top left corner.

Motion does not depend on the frame rate: a step of 0.1 s moves a camera as ten steps of 0.01 s do,
up to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from rasterjit.scene import transforms
from rasterjit.scene.attribute_guard import suggests_replace
from rasterjit.scene.camera import Bounded, Camera, PerspectiveCamera
from rasterjit.scene.camera_fitting import (
    MIN_DISTANCE_RATIO,
    PLANE_MARGIN,
    BoundingSphere,
    CameraPose,
    Vector,
    fit_camera,
    lerp,
    make_camera_at,
    move_by,
    orbit_direction,
    pixel_size,
    rotate_y_to,
    subtract,
    to_triple,
)
from rasterjit.scene.validation import finite_number, positive_number
from rasterjit.scene.vectors import cross, dot, length

Event = dict[str, Any]

SMOOTHING_SECONDS = 0.03
"""Seconds in which a camera goes 63 % of the way to its goal."""

TURN_DEGREES_PER_SECOND = 90.0
"""Degrees that an arrow key turns in each second that it is held."""

DEGREES_PER_HEIGHT = 180.0
"""Degrees that dragging across the height of the picture turns."""

ZOOM_EXPONENT_PER_UNIT = 0.001
"""Exponent of the zoom for each unit of a wheel; a notch is about 100 units."""

ZOOM_PER_KEY = 0.8
"""What the key ``+`` multiplies the distance by."""

MIN_DISTANCE, MAX_DISTANCE = 1e-4, 1e3
"""Range of an orbit's distance, in radii of the scene."""

SHIFT_FACTOR = 4.0
"""What Shift multiplies the speed by."""

CROSSING_SECONDS = 3.0
"""Seconds to fly through the whole scene at the initial speed."""

MAX_PITCH = 89.0
"""Largest pitch when flying, degrees."""

REST_RATIO = 2e-4
"""Distance from the goal below which a camera rests, over the distance of the target: about a tenth
of a pixel."""

REST_DEGREES = 0.02
"""Angle from the goal below which a camera rests, degrees."""

MAX_ZOOM = 4.0
"""Largest zoom factor of one event."""

TURN_KEYS = {
    "ArrowLeft": (-1.0, 0.0), "ArrowRight": (1.0, 0.0),
    "ArrowUp": (0.0, 1.0), "ArrowDown": (0.0, -1.0),
}  # fmt: skip
"""Signs of azimuth and elevation by key, for an orbit."""

MOVE_KEYS = {
    "w": (0.0, 0.0, 1.0), "s": (0.0, 0.0, -1.0), "a": (-1.0, 0.0, 0.0), "d": (1.0, 0.0, 0.0),
    "q": (0.0, -1.0, 0.0), "e": (0.0, 1.0, 0.0),
    "ArrowUp": (0.0, 0.0, 1.0), "ArrowDown": (0.0, 0.0, -1.0),
    "ArrowLeft": (-1.0, 0.0, 0.0), "ArrowRight": (1.0, 0.0, 0.0),
}  # fmt: skip
"""Directions (right, up, forward) by key, for flying."""


class OrbitPose(NamedTuple):
    """Pose of an orbiting camera; angles in degrees, as `orbit_direction` takes them."""

    target: Vector
    """World space."""
    distance: float
    """From target to eye, scene units."""
    azimuth: float
    elevation: float

    def lerp(self, goal: OrbitPose, t: float) -> OrbitPose:
        """Interpolate linearly from this pose, at t = 0, to another, at 1."""
        return OrbitPose(
            lerp(self.target, goal.target, t),
            self.distance + t * (goal.distance - self.distance),
            self.azimuth + t * (goal.azimuth - self.azimuth),
            self.elevation + t * (goal.elevation - self.elevation),
        )


@suggests_replace
@dataclass(frozen=True)
class Orbit:
    """
    A camera that turns around a target, never over a pole.

    Dragging turns; with another button, or with Shift, it pans. The wheel zooms to what is under
    the cursor. Arrow keys turn, ``+`` and ``-`` zoom, F fits, R returns to the start.

    Parameters
    ----------
    sphere : BoundingSphere
        What `fit` shows.
    pose, goal, home : OrbitPose
        The current pose, the one that it moves to, and the initial one.
    fov_y : float, degrees
        Vertical field of view.
    up : (3,) tuple of float, world space
    smoothing : float, seconds
        Time in which it goes 63 % of the way to the goal.
    held_keys : frozenset of str
        Keys that are down.
    drag : str
        ``"turn"``, ``"pan"`` or ``""``: what moving the pointer does.
    pointer : (float, float)
        Where the pointer was, pixels.
    """

    sphere: BoundingSphere
    pose: OrbitPose
    goal: OrbitPose
    home: OrbitPose
    fov_y: float = 45.0
    up: Vector = (0.0, 1.0, 0.0)
    smoothing: float = SMOOTHING_SECONDS
    held_keys: frozenset[str] = frozenset()
    drag: str = ""
    pointer: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def from_camera(
        cls,
        camera: Camera,
        scene: Bounded,
        up: ArrayLike = (0.0, 1.0, 0.0),
        size: tuple[int, int] = (1, 1),
    ) -> Orbit:
        """
        Return the orbit that starts at a camera, without its roll.

        Parameters
        ----------
        camera : Camera
            A parallel one becomes a perspective that shows as much of the plane through the target.
        scene : object with ``bounding_sphere()``
            It turns around the point on the line of sight that is nearest to its centre.
        up : (3,) array_like, world space
        size : (width, height)
            Of the picture, pixels: the vertical field of view of some cameras depends on it.

        Raises
        ------
        ValueError
            If ``up`` is zero, or the scene has no bounds.
        """
        sphere = BoundingSphere.around(scene)
        upward = to_triple(transforms.unit_vector("up", up))
        start = CameraPose.of(camera, size)
        if start.height is None:
            distance = depth = _compute_pivot_distance(sphere, start.eye, start.forward)
        else:
            distance = 0.5 * start.height * transforms.focal_length(start.fov_y)
            depth = dot(subtract(sphere.center, start.eye), start.forward)
        target = move_by(start.eye, start.forward, depth)
        pose = OrbitPose(target, distance, *start.azimuth_and_elevation(upward))
        return cls(sphere, pose, pose, pose, start.fov_y, upward)

    def handle(self, event: Event, size: tuple[int, int], depth: float | None = None) -> Orbit:
        """
        Return the state after an event.

        Parameters
        ----------
        event : dict
        size : (width, height)
            Of the picture, in the event's pixels.
        depth : float, optional
            Scene units along the viewing axis of what is under the cursor; a wheel zooms to it.
            Default: that of the target.
        """
        kind = event["event_type"]
        if kind in ("key_down", "key_up"):
            return self._handle_key(event["key"], kind, size)
        if kind == "wheel":
            factor = _compute_wheel_zoom(event)
            return self.zoom(factor, (event["x"], event["y"]), size, depth)
        if kind not in ("pointer_down", "pointer_move", "pointer_up"):
            return self
        is_pan = event.get("button") in (2, 3) or "Shift" in event.get("modifiers", ())
        state, dx, dy = _follow_pointer(self, event, "pan" if is_pan else "turn")
        if self.drag == "turn":
            degrees_per_pixel = DEGREES_PER_HEIGHT / size[1]
            return state.turn(-dx * degrees_per_pixel, dy * degrees_per_pixel)
        return state.pan(dx, dy, size) if self.drag == "pan" else state

    def advance(self, seconds: float) -> Orbit:
        """Return the state after a time; the pose follows the goal, which held keys turn."""
        signs = _sum_directions(TURN_KEYS, self.held_keys)
        azimuth_rate, elevation_rate = (TURN_DEGREES_PER_SECOND * sign for sign in signs)
        to_pole = _compute_time_to_pole(self.goal.elevation, elevation_rate)
        if to_pole < seconds:
            # The rate changes at the pole: two steps make the motion exact for any frame rate.
            state = self._glide(to_pole, azimuth_rate, elevation_rate)
            return state._glide(seconds - to_pole, azimuth_rate, 0.0)
        return self._glide(seconds, azimuth_rate, elevation_rate)

    def camera(self) -> PerspectiveCamera:
        """Return the current camera; its near plane is before the scene or near the eye."""
        target, distance, azimuth, elevation = self.pose
        _, upward, to_eye = _compute_axes(self.up, azimuth, elevation)
        eye = move_by(target, to_eye, distance)
        return make_camera_at(eye, target, upward, self.fov_y, self.sphere)

    @property
    def is_resting(self) -> bool:
        """Whether no further motion would be visible."""
        pose, goal = self.pose, self.goal
        shift = length(subtract(pose.target, goal.target)) + abs(pose.distance - goal.distance)
        angle = abs(pose.azimuth - goal.azimuth) + abs(pose.elevation - goal.elevation)
        is_near = shift <= REST_RATIO * goal.distance and angle <= REST_DEGREES
        return is_near and not any(key in TURN_KEYS for key in self.held_keys)

    @property
    def is_home(self) -> bool:
        """Whether the goal is the initial pose."""
        return self.goal == self.home

    def at_home(self) -> Orbit:
        """Return the state at rest in its initial pose."""
        return replace(self, pose=self.home, goal=self.home)

    def at_rest(self) -> Orbit:
        """Return the state at rest at the goal."""
        return replace(self, pose=self.goal)

    def turn(self, azimuth: float, elevation: float) -> Orbit:
        """Turn the goal by angles, degrees; it stops at the poles."""
        goal = self.goal
        return self._with_goal(
            azimuth=goal.azimuth + finite_number("azimuth", azimuth),
            elevation=_clamp(goal.elevation + finite_number("elevation", elevation), 90.0),
        )

    def pan(self, dx: float, dy: float, size: tuple[int, int]) -> Orbit:
        """Pan the goal: what is at the target's distance moves by (dx, dy) pixels."""
        pixel = pixel_size(self.goal.distance, self.fov_y, size)
        right, upward, _ = self._axes()
        target = move_by(self.goal.target, right, -pixel * finite_number("dx", dx))
        return self._with_goal(target=move_by(target, upward, pixel * finite_number("dy", dy)))

    def zoom(
        self,
        factor: float,
        cursor: tuple[float, float],
        size: tuple[int, int],
        depth: float | None = None,
    ) -> Orbit:
        """
        Zoom the goal about the point under the cursor.

        Parameters
        ----------
        factor : float
            What distances are multiplied by; above 0.
        cursor : (x, y), pixels
        size : (width, height), pixels
        depth : float, optional
            Scene units along the viewing axis of what is under the cursor; default: the target's.

        Raises
        ------
        ValueError
            If ``factor`` is not above 0.
        """
        goal = self.goal
        low, high = self._find_distance_range()
        distance = min(max(goal.distance * positive_number("factor", factor), low), high)
        factor = distance / goal.distance
        if depth is None or not math.isfinite(depth):
            depth = goal.distance
        # The point under the cursor, world space.
        pixel = pixel_size(depth, self.fov_y, size)
        right, upward, to_eye = self._axes()
        point = move_by(goal.target, to_eye, goal.distance - depth)
        point = move_by(point, right, pixel * (cursor[0] - 0.5 * size[0]))
        point = move_by(point, upward, pixel * (0.5 * size[1] - cursor[1]))
        # Eye and target move towards it by the same factor, so it stays under the cursor.
        return self._with_goal(target=lerp(point, goal.target, factor), distance=distance)

    def fit(self, size: tuple[int, int]) -> Orbit:
        """Set the goal to show the whole scene from the same direction."""
        _, upward, to_eye = self._axes()
        fitted = fit_camera(self.sphere, to_eye, self.fov_y, up=upward, aspect=size[0] / size[1])
        eye = to_triple(fitted.eye)
        distance = _compute_pivot_distance(self.sphere, eye, subtract((0.0, 0.0, 0.0), to_eye))
        return self._with_goal(target=move_by(eye, to_eye, -distance), distance=distance)

    def reset(self) -> Orbit:
        """Set the goal to the initial pose."""
        return replace(self, goal=self.home)

    def _handle_key(self, key: str, kind: str, size: tuple[int, int]) -> Orbit:
        """Return the state after a key went down or up."""
        if kind == "key_up":
            return replace(self, held_keys=self.held_keys - {key})
        center = 0.5 * size[0], 0.5 * size[1]
        if key in TURN_KEYS:
            return replace(self, held_keys=self.held_keys | {key})
        if key in ("+", "="):
            return self.zoom(ZOOM_PER_KEY, center, size)
        if key in ("-", "_"):
            return self.zoom(1.0 / ZOOM_PER_KEY, center, size)
        if key in ("f", "F"):
            return self.fit(size)
        return self.reset() if key in ("r", "R", "Home") else self

    def _glide(self, seconds: float, azimuth_rate: float, elevation_rate: float) -> Orbit:
        """Return the state after a time in which the goal turns at constant rates."""
        goal, pose = self.goal, self.pose
        decay = math.exp(-seconds / self.smoothing)
        new_goal = goal._replace(
            azimuth=goal.azimuth + azimuth_rate * seconds,
            elevation=_clamp(goal.elevation + elevation_rate * seconds, 90.0),
        )
        # Behind a goal that moves, the lag tends to rate x smoothing.
        lag = self.smoothing * (1.0 - decay)
        new_pose = pose.lerp(goal, 1.0 - decay)._replace(
            azimuth=new_goal.azimuth + decay * (pose.azimuth - goal.azimuth) - azimuth_rate * lag,
            elevation=new_goal.elevation
            + decay * (pose.elevation - goal.elevation)
            - elevation_rate * lag,
        )
        return replace(self, pose=new_pose, goal=new_goal)

    def _with_goal(self, **changes: Any) -> Orbit:
        """Return the state with another goal."""
        return replace(self, goal=self.goal._replace(**changes))

    def _axes(self) -> tuple[Vector, Vector, Vector]:
        """Return right, up and the direction from target to eye, at the goal, world space."""
        return _compute_axes(self.up, self.goal.azimuth, self.goal.elevation)

    def _find_distance_range(self) -> tuple[float, float]:
        """Return the range of distances, scene units."""
        max_coordinate = max(map(abs, self.sphere.center))
        low = max(MIN_DISTANCE * self.sphere.radius, MIN_DISTANCE_RATIO * max_coordinate)
        return low, max(MAX_DISTANCE * self.sphere.radius, self.goal.distance, 2.0 * low)


@suggests_replace
@dataclass(frozen=True)
class Fly:
    """
    A camera that flies through a scene.

    W and S (or up and down) fly forward and back, A and D (or left and right) sideways, Q and E
    down and up, with Shift four times faster. Dragging looks around, the wheel sets the speed, F
    moves back until the whole scene is seen, R returns to the start.

    Parameters
    ----------
    sphere : BoundingSphere
        What `fit` shows.
    eye : (3,) tuple of float, world space
    azimuth, elevation : float, degrees
        Of the direction opposite to the view, as `orbit_direction` takes them.
    velocity : (3,) tuple of float, scene units a second
        Right, up and forward.
    speed : float, scene units a second
        What a held key accelerates it to.
    home : (eye, azimuth, elevation, speed)
        The initial state.
    fov_y : float, degrees
        Vertical field of view.
    up : (3,) tuple of float, world space
    smoothing : float, seconds
        Time in which it reaches 63 % of the speed.
    held_keys, drag, pointer
        As in `Orbit`; ``drag`` is ``"look"`` or ``""``.
    """

    sphere: BoundingSphere
    eye: Vector
    azimuth: float
    elevation: float
    velocity: Vector
    speed: float
    home: tuple[Vector, float, float, float]
    fov_y: float = 45.0
    up: Vector = (0.0, 1.0, 0.0)
    smoothing: float = SMOOTHING_SECONDS
    held_keys: frozenset[str] = frozenset()
    drag: str = ""
    pointer: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def from_camera(cls, camera: Camera, scene: Bounded, up: ArrayLike = (0.0, 1.0, 0.0)) -> Fly:
        """
        Return the flight that starts at a camera, without its roll.

        Takes what `Orbit.from_camera` takes; a parallel camera becomes the perspective that it does
        there.
        """
        start = CameraPose.of(camera)
        if start.height is not None:
            start = CameraPose.of(Orbit.from_camera(camera, scene, up).camera())
        sphere = BoundingSphere.around(scene)
        upward = to_triple(transforms.unit_vector("up", up))
        azimuth, elevation = start.azimuth_and_elevation(upward)
        elevation = _clamp(elevation, MAX_PITCH)
        speed = 2.0 * sphere.radius / CROSSING_SECONDS
        home = start.eye, azimuth, elevation, speed
        return cls(
            sphere, start.eye, azimuth, elevation, (0.0, 0.0, 0.0), speed, home, start.fov_y, upward
        )

    def handle(self, event: Event, size: tuple[int, int], depth: float | None = None) -> Fly:
        """Return the state after an event; takes what `Orbit.handle` takes."""
        kind = event["event_type"]
        if kind in ("key_down", "key_up"):
            return self._handle_key(event["key"], kind, size)
        if kind == "wheel":
            return replace(self, speed=self._clamp_speed(self.speed / _compute_wheel_zoom(event)))
        if kind not in ("pointer_down", "pointer_move", "pointer_up"):
            return self
        state, dx, dy = _follow_pointer(self, event, "look")
        degrees_per_pixel = self.fov_y / size[1]
        return state.look(-dx * degrees_per_pixel, dy * degrees_per_pixel) if self.drag else state

    def advance(self, seconds: float) -> Fly:
        """Return the state after a time; its velocity tends to what the held keys ask for."""
        goal = self._find_steered_velocity()
        decay = math.exp(-seconds / self.smoothing)
        lag = self.smoothing * (1.0 - decay)
        excess = subtract(self.velocity, goal)
        eye = self.eye
        for axis, goal_part, excess_part in zip(self._axes(), goal, excess, strict=True):
            eye = move_by(eye, axis, goal_part * seconds + excess_part * lag)
        return replace(self, eye=eye, velocity=move_by(goal, excess, decay))

    def camera(self) -> PerspectiveCamera:
        """Return the current camera; its near plane is before the scene or near the eye."""
        _, upward, forward = self._axes()
        return make_camera_at(
            self.eye,
            move_by(self.eye, forward, self.sphere.radius),
            upward,
            self.fov_y,
            self.sphere,
        )

    @property
    def is_resting(self) -> bool:
        """Whether no further motion would be visible."""
        is_slow = length(self.velocity) * self.smoothing <= REST_RATIO * self.sphere.radius
        return is_slow and not any(self._find_steered_velocity())

    @property
    def is_home(self) -> bool:
        """Whether the camera rests in its initial pose."""
        state = self.eye, self.azimuth, self.elevation
        return state == self.home[:3] and self.is_resting

    def at_home(self) -> Fly:
        """Return the state at rest in its initial pose."""
        return self.reset()

    def at_rest(self) -> Fly:
        """Return the state where the camera comes to a stop; held keys stay held."""
        eye = self.eye
        for axis, velocity in zip(self._axes(), self.velocity, strict=True):
            eye = move_by(eye, axis, velocity * self.smoothing)
        return replace(self, eye=eye, velocity=(0.0, 0.0, 0.0))

    def look(self, azimuth: float, elevation: float) -> Fly:
        """Turn the view by angles, degrees; a positive elevation turns it downwards."""
        return replace(
            self,
            azimuth=self.azimuth + finite_number("azimuth", azimuth),
            elevation=_clamp(self.elevation + finite_number("elevation", elevation), MAX_PITCH),
        )

    def fit(self, size: tuple[int, int]) -> Fly:
        """Move back until the whole scene is seen in the same direction."""
        _, upward, to_eye = _compute_axes(self.up, self.azimuth, self.elevation)
        fitted = fit_camera(self.sphere, to_eye, self.fov_y, up=upward, aspect=size[0] / size[1])
        return replace(self, eye=fitted.eye, velocity=(0.0, 0.0, 0.0))

    def reset(self) -> Fly:
        """Return the state at rest in its initial pose, with its initial speed."""
        eye, azimuth, elevation, speed = self.home
        return replace(
            self, eye=eye, azimuth=azimuth, elevation=elevation, speed=speed,
            velocity=(0.0, 0.0, 0.0),
        )  # fmt: skip

    def _handle_key(self, key: str, kind: str, size: tuple[int, int]) -> Fly:
        """Return the state after a key went down or up."""
        # With Shift, letters arrive in upper case.
        name = key.lower() if len(key) == 1 else key
        if kind == "key_up":
            return replace(self, held_keys=self.held_keys - {name})
        if name in MOVE_KEYS or name == "Shift":
            return replace(self, held_keys=self.held_keys | {name})
        if name == "f":
            return self.fit(size)
        return self.reset() if name in ("r", "Home") else self

    def _find_steered_velocity(self) -> Vector:
        """Return the velocity that the held keys ask for: right, up, forward."""
        right, upward, forward = _sum_directions(MOVE_KEYS, self.held_keys)
        total = length((right, upward, forward))
        if total == 0.0:
            return 0.0, 0.0, 0.0
        speed = self.speed * (SHIFT_FACTOR if "Shift" in self.held_keys else 1.0) / total
        return right * speed, upward * speed, forward * speed

    def _axes(self) -> tuple[Vector, Vector, Vector]:
        """Return right, up and forward, world space."""
        right, upward, to_eye = _compute_axes(self.up, self.azimuth, self.elevation)
        return right, upward, tuple(-part for part in to_eye)

    def _clamp_speed(self, speed: float) -> float:
        """Clamp a speed to a range that depends on the scene."""
        return min(max(speed, MIN_DISTANCE * self.sphere.radius), 1e2 * self.sphere.radius)


Controls = Orbit | Fly


def _compute_axes(up: Vector, azimuth: float, elevation: float) -> tuple[Vector, Vector, Vector]:
    """Return right, up and the direction to the eye, world space, at angles in degrees."""
    rotation = rotate_y_to(up)
    upward, to_eye = (
        to_triple(transforms.apply(rotation, orbit_direction(azimuth, angle)))
        for angle in (elevation + 90.0, elevation)
    )
    return cross(upward, to_eye), upward, to_eye


def _follow_pointer(controls: Any, event: Event, drag: str) -> tuple[Any, float, float]:
    """
    Return the state after a pointer event, and the pointer's motion, pixels, x and y.

    ``drag`` is what dragging does from now on, if the event is that a button goes down.
    """
    kind, point = event["event_type"], (float(event["x"]), float(event["y"]))
    if kind == "pointer_down":
        return replace(controls, drag=drag, pointer=point), 0.0, 0.0
    # A release may be at another position than the last move.
    dx, dy = point[0] - controls.pointer[0], point[1] - controls.pointer[1]
    drag = controls.drag if kind == "pointer_move" else ""
    return replace(controls, drag=drag, pointer=point), dx, dy


def _compute_wheel_zoom(event: Event) -> float:
    """Return the zoom factor of a wheel event."""
    exponent = ZOOM_EXPONENT_PER_UNIT * float(event.get("dy", 0.0))
    # Clamped before `exp`, which overflows.
    return min(max(math.exp(min(exponent, MAX_ZOOM)), 1.0 / MAX_ZOOM), MAX_ZOOM)


def _compute_time_to_pole(elevation: float, rate: float) -> float:
    """Return the time until a turning goal reaches a pole, seconds."""
    return (math.copysign(90.0, rate) - elevation) / rate if rate else math.inf


def _sum_directions(
    directions: Mapping[str, tuple[float, ...]], keys: frozenset[str]
) -> tuple[float, ...]:
    """Return the sum of the directions of the keys that are down."""
    chosen = [direction for key, direction in directions.items() if key in keys]
    axes = len(next(iter(directions.values())))
    return tuple(math.fsum(direction[axis] for direction in chosen) for axis in range(axes))


def _compute_pivot_distance(sphere: BoundingSphere, eye: Vector, forward: Vector) -> float:
    """Return the distance from the eye to the point that an orbit turns around."""
    distance = dot(subtract(sphere.center, eye), forward)
    # The scene is behind or beside the eye: the orbit turns around a point in front of it.
    return sphere.radius if distance < PLANE_MARGIN * sphere.radius else distance


def _clamp(angle: float, largest: float) -> float:
    """Clamp an angle to -largest .. largest."""
    return min(max(angle, -largest), largest)
