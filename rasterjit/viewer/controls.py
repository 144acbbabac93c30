"""
Camera controls: `Orbit` turns around a scene, `Fly` moves through it.

Both are values: an event or a time goes in, another value comes out. They know no window, no clock
and no thread, so what a viewer shows after some events can be told beforehand.

Events are the dictionaries of ``rendercanvas``: ``event_type`` with ``x``, ``y``, ``button``,
``modifiers``, ``dx``, ``dy`` or ``key``; x right, y down, in pixels from the top left corner.

Time passes continuously: after 0.1 s a camera is where it is after ten times 0.01 s, up to
rounding, so the same hand moves it equally far at any rate of frames.
"""

from __future__ import annotations

import math
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
"""Degrees a second that a held arrow key turns."""

DEGREES_PER_HEIGHT = 180.0
"""Degrees that dragging across the height of the picture turns."""

ZOOM_EXPONENT_PER_UNIT = 0.001
"""Exponent of the zoom for each unit of a wheel; a notch has about 100."""

ZOOM_PER_KEY = 0.8
"""Factor of the distance for the key ``+``."""

MIN_DISTANCE, MAX_DISTANCE = 1e-4, 1e3
"""Range of an orbit's distance, in radii of the scene."""

SHIFT_FACTOR = 4.0
"""Factor of the speed with Shift."""

CROSSING_SECONDS = 3.0
"""Seconds to fly through the whole scene at the first speed."""

MAX_PITCH = 89.0
"""Largest pitch when flying, degrees."""

REST_SHARE = 2e-4
"""Distance from the goal at which a camera rests, as a share: a tenth of a pixel, about."""

REST_DEGREES = 0.02
"""Angle from the goal at which a camera rests, degrees."""

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
    """State of an orbiting camera; angles in degrees, as `orbit_direction` takes them."""

    target: Vector
    distance: float
    azimuth: float
    elevation: float

    def toward(self, goal: OrbitPose, share: float) -> OrbitPose:
        """Interpolate from this pose towards another."""
        return OrbitPose(
            lerp(self.target, goal.target, share),
            self.distance + share * (goal.distance - self.distance),
            self.azimuth + share * (goal.azimuth - self.azimuth),
            self.elevation + share * (goal.elevation - self.elevation),
        )


@suggests_replace
@dataclass(frozen=True)
class Orbit:
    """
    A camera that turns around a target, never over a pole.

    Drag to turn; drag with another button, or with Shift, to pan; the wheel zooms to what is under
    the cursor; arrow keys turn, ``+`` and ``-`` zoom, F fits, R returns to the start.

    Parameters
    ----------
    ball : BoundingSphere
        What `fit` shows.
    pose, goal, home : OrbitPose
        Where it is, where it is going, and where it started.
    fov_y : float, degrees
        Vertical field of view.
    up : (3,) tuple of float, world space
    smoothing : float, seconds
        Time in which it goes 63 % of the way to the goal.
    held : frozenset of str
        Keys that are down.
    drag : str
        ``"turn"``, ``"pan"`` or ``""``: what moving the pointer does.
    pointer : (float, float)
        Where the pointer was, pixels.
    """

    ball: BoundingSphere
    pose: OrbitPose
    goal: OrbitPose
    home: OrbitPose
    fov_y: float = 45.0
    up: Vector = (0.0, 1.0, 0.0)
    smoothing: float = SMOOTHING_SECONDS
    held: frozenset[str] = frozenset()
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
            A parallel one becomes one that shows as much of the target's plane.
        scene : object with ``bounding_sphere()``
            It turns around the point on the line of sight that is nearest to its centre.
        up : (3,) array_like, world space
        size : (width, height)
            Of the picture, pixels: it starts with the vertical field of view that is seen there.

        Raises
        ------
        ValueError
            If ``up`` is zero, or the scene has no bounds.
        """
        ball = BoundingSphere.around(scene)
        upward = to_triple(transforms.unit_vector("up", up))
        view = CameraPose.of(camera, size)
        distance = _compute_pivot_distance(ball, view.eye, view.forward)
        if view.height is not None:
            distance = 0.5 * view.height * transforms.focal_length(view.fov_y)
        azimuth, elevation = view.azimuth_and_elevation(upward)
        target = move_by(view.eye, view.forward, distance)
        if view.height is not None:
            depth = dot(subtract(ball.center, view.eye), view.forward)
            target = move_by(view.eye, view.forward, depth)
        pose = OrbitPose(target, distance, azimuth, elevation)
        return cls(ball, pose, pose, pose, view.fov_y, upward)

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
            share = DEGREES_PER_HEIGHT / size[1]
            return state.turn(-dx * share, dy * share)
        return state.pan(dx, dy, size) if self.drag == "pan" else state

    def advance(self, seconds: float) -> Orbit:
        """Return the state after a time; the pose follows the goal, which held keys turn."""
        across, upward = _sum_directions(TURN_KEYS, self.held)
        rates = TURN_DEGREES_PER_SECOND * across, TURN_DEGREES_PER_SECOND * upward
        stop = _compute_time_to_pole(self.goal.elevation, rates[1])
        if stop < seconds:
            # Exact up to the pole and from there on, however the time is cut.
            return self._glide(stop, *rates)._glide(seconds - stop, rates[0], 0.0)
        return self._glide(seconds, *rates)

    def camera(self) -> PerspectiveCamera:
        """Return the current camera; its near plane is before the scene or near the eye."""
        target, distance, azimuth, elevation = self.pose
        _, upward, toward = _compute_axes(self.up, azimuth, elevation)
        eye = move_by(target, toward, distance)
        return make_camera_at(eye, target, upward, self.fov_y, self.ball)

    @property
    def is_resting(self) -> bool:
        """Whether the camera visibly rests."""
        pose, goal = self.pose, self.goal
        off = length(subtract(pose.target, goal.target)) + abs(pose.distance - goal.distance)
        angle = abs(pose.azimuth - goal.azimuth) + abs(pose.elevation - goal.elevation)
        is_near = off <= REST_SHARE * goal.distance and angle <= REST_DEGREES
        return is_near and not any(key in TURN_KEYS for key in self.held)

    @property
    def is_home(self) -> bool:
        """Whether the goal is the first pose."""
        return self.goal == self.home

    def at_home(self) -> Orbit:
        """Return the state at its first pose."""
        return replace(self, pose=self.home, goal=self.home)

    def at_rest(self) -> Orbit:
        """Return the state at the goal."""
        return replace(self, pose=self.goal)

    def turn(self, azimuth: float, elevation: float) -> Orbit:
        """Turn the goal by angles, degrees, as far as the poles."""
        goal = self.goal
        return self._with_goal(
            azimuth=goal.azimuth + finite_number("azimuth", azimuth),
            elevation=_clamp(goal.elevation + finite_number("elevation", elevation), 90.0),
        )

    def pan(self, dx: float, dy: float, size: tuple[int, int]) -> Orbit:
        """Pan the goal: what is at the target's distance moves by (dx, dy) pixels."""
        unit = pixel_size(self.goal.distance, self.fov_y, size)
        right, upward, _ = self._axes()
        target = move_by(self.goal.target, right, -unit * finite_number("dx", dx))
        return self._with_goal(target=move_by(target, upward, unit * finite_number("dy", dy)))

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
        low, high = self._get_distance_range()
        distance = min(max(goal.distance * positive_number("factor", factor), low), high)
        factor = distance / goal.distance
        away = goal.distance if depth is None or not math.isfinite(depth) else depth
        # The point under the cursor, as seen from the target.
        unit = pixel_size(away, self.fov_y, size)
        right, upward, toward = self._axes()
        point = move_by(goal.target, toward, goal.distance - away)
        point = move_by(point, right, unit * (cursor[0] - 0.5 * size[0]))
        point = move_by(point, upward, unit * (0.5 * size[1] - cursor[1]))
        # Eye and target both shrink towards it, so the direction to it stays.
        return self._with_goal(target=lerp(point, goal.target, factor), distance=distance)

    def fit(self, size: tuple[int, int]) -> Orbit:
        """Set the goal to show the whole scene from the same direction."""
        _, upward, toward = self._axes()
        fitted = fit_camera(self.ball, toward, self.fov_y, up=upward, aspect=size[0] / size[1])
        eye = to_triple(fitted.eye)
        distance = _compute_pivot_distance(self.ball, eye, subtract((0.0, 0.0, 0.0), toward))
        return self._with_goal(target=move_by(eye, toward, -distance), distance=distance)

    def reset(self) -> Orbit:
        """Set the goal to the first pose."""
        return replace(self, goal=self.home)

    def _handle_key(self, key: str, kind: str, size: tuple[int, int]) -> Orbit:
        """Return the state after a key went down or up."""
        if kind == "key_up":
            return replace(self, held=self.held - {key})
        center = 0.5 * size[0], 0.5 * size[1]
        if key in TURN_KEYS:
            return replace(self, held=self.held | {key})
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
        rest = math.exp(-seconds / self.smoothing)
        new_goal = goal._replace(
            azimuth=goal.azimuth + azimuth_rate * seconds,
            elevation=_clamp(goal.elevation + elevation_rate * seconds, 90.0),
        )
        # Behind a goal that moves, the lag tends to rate x smoothing.
        lag = self.smoothing * (1.0 - rest)
        new_pose = pose.toward(goal, 1.0 - rest)._replace(
            azimuth=new_goal.azimuth + rest * (pose.azimuth - goal.azimuth) - azimuth_rate * lag,
            elevation=new_goal.elevation
            + rest * (pose.elevation - goal.elevation)
            - elevation_rate * lag,
        )
        return replace(self, pose=new_pose, goal=new_goal)

    def _with_goal(self, **changes: Any) -> Orbit:
        """Return the state with another goal."""
        return replace(self, goal=self.goal._replace(**changes))

    def _axes(self) -> tuple[Vector, Vector, Vector]:
        """Return right, up and the direction from target to eye, at the goal, world space."""
        return _compute_axes(self.up, self.goal.azimuth, self.goal.elevation)

    def _get_distance_range(self) -> tuple[float, float]:
        """Return the range of distances."""
        coordinate = max(map(abs, self.ball.center))
        low = max(MIN_DISTANCE * self.ball.radius, MIN_DISTANCE_RATIO * coordinate)
        return low, max(MAX_DISTANCE * self.ball.radius, self.goal.distance, 2.0 * low)


@suggests_replace
@dataclass(frozen=True)
class Fly:
    """
    A camera that flies through a scene.

    W and S (or up and down) fly forward and back, A and D (or left and right) sideways, Q and E
    down and up, Shift four times faster; dragging looks around, the wheel sets the speed, F stands
    back until the whole scene is seen, R returns to the start.

    Parameters
    ----------
    ball : BoundingSphere
        What `fit` shows.
    eye : (3,) tuple of float, world space
    azimuth, elevation : float, degrees
        Of the direction that it looks from, as `orbit_direction` takes them.
    velocity : (3,) tuple of float, scene units a second
        Right, up and forward.
    speed : float, scene units a second
        What it is accelerated to.
    home : (eye, azimuth, elevation, speed)
        Where it started.
    fov_y : float, degrees
        Vertical field of view.
    up : (3,) tuple of float, world space
    smoothing : float, seconds
        Time in which it gets 63 % of the speed.
    held, drag, pointer
        As in `Orbit`; ``drag`` is ``"look"`` or ``""``.
    """

    ball: BoundingSphere
    eye: Vector
    azimuth: float
    elevation: float
    velocity: Vector
    speed: float
    home: tuple[Vector, float, float, float]
    fov_y: float = 45.0
    up: Vector = (0.0, 1.0, 0.0)
    smoothing: float = SMOOTHING_SECONDS
    held: frozenset[str] = frozenset()
    drag: str = ""
    pointer: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def from_camera(cls, camera: Camera, scene: Bounded, up: ArrayLike = (0.0, 1.0, 0.0)) -> Fly:
        """
        Return the flight that starts at a camera, without its roll.

        Takes what `Orbit.from_camera` takes; a parallel camera becomes one that stands where an
        orbit would begin.
        """
        sight = CameraPose.of(camera)
        if sight.height is not None:
            sight = CameraPose.of(Orbit.from_camera(camera, scene, up).camera())
        ball = BoundingSphere.around(scene)
        upward = to_triple(transforms.unit_vector("up", up))
        azimuth, elevation = sight.azimuth_and_elevation(upward)
        elevation = _clamp(elevation, MAX_PITCH)
        speed = 2.0 * ball.radius / CROSSING_SECONDS
        home = sight.eye, azimuth, elevation, speed
        return cls(
            ball, sight.eye, azimuth, elevation, (0.0, 0.0, 0.0), speed, home, sight.fov_y, upward
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
        share = self.fov_y / size[1]
        return state.look(-dx * share, dy * share) if self.drag else state

    def advance(self, seconds: float) -> Fly:
        """Return the state after a time; its velocity tends to what the held keys ask for."""
        target = self._steer()
        rest = math.exp(-seconds / self.smoothing)
        lag = self.smoothing * (1.0 - rest)
        excess = subtract(self.velocity, target)
        eye = self.eye
        for axis, velocity, more in zip(self._axes(), target, excess, strict=True):
            eye = move_by(eye, axis, velocity * seconds + more * lag)
        return replace(self, eye=eye, velocity=move_by(target, excess, rest))

    def camera(self) -> PerspectiveCamera:
        """Return the current camera; its near plane is before the scene or near the eye."""
        _, upward, forward = self._axes()
        return make_camera_at(
            self.eye, move_by(self.eye, forward, self.ball.radius), upward, self.fov_y, self.ball
        )

    @property
    def is_resting(self) -> bool:
        """Whether the camera visibly rests."""
        is_steered = any(map(abs, self._steer()))
        return (
            not is_steered
            and length(self.velocity) * self.smoothing <= REST_SHARE * self.ball.radius
        )

    @property
    def is_home(self) -> bool:
        """Whether the camera rests at its first position."""
        state = self.eye, self.azimuth, self.elevation
        return state == self.home[:3] and self.is_resting

    def at_home(self) -> Fly:
        """Return the state at its first position."""
        return self.reset()

    def at_rest(self) -> Fly:
        """Return the state when it has come to a stop; keys that are down stay down."""
        eye = self.eye
        for axis, velocity in zip(self._axes(), self.velocity, strict=True):
            eye = move_by(eye, axis, velocity * self.smoothing)
        return replace(self, eye=eye, velocity=(0.0, 0.0, 0.0))

    def look(self, azimuth: float, elevation: float) -> Fly:
        """Turn the view by angles, degrees; the elevation is that of the direction it looks from"""
        return replace(
            self,
            azimuth=self.azimuth + finite_number("azimuth", azimuth),
            elevation=_clamp(self.elevation + finite_number("elevation", elevation), MAX_PITCH),
        )

    def fit(self, size: tuple[int, int]) -> Fly:
        """Move back until the whole scene is seen in the same direction."""
        _, upward, forward = self._axes()
        toward = tuple(-part for part in forward)
        fitted = fit_camera(self.ball, toward, self.fov_y, up=upward, aspect=size[0] / size[1])
        return replace(self, eye=fitted.eye, velocity=(0.0, 0.0, 0.0))

    def reset(self) -> Fly:
        """Return to the first position."""
        eye, azimuth, elevation, speed = self.home
        return replace(
            self, eye=eye, azimuth=azimuth, elevation=elevation, speed=speed,
            velocity=(0.0, 0.0, 0.0),
        )  # fmt: skip

    def _handle_key(self, key: str, kind: str, size: tuple[int, int]) -> Fly:
        """Return the state after a key went down or up."""
        # With Shift, letters come in upper case.
        name = key.lower() if len(key) == 1 else key
        if kind == "key_up":
            return replace(self, held=self.held - {name})
        if name in MOVE_KEYS or name == "Shift":
            return replace(self, held=self.held | {name})
        if name == "f":
            return self.fit(size)
        return self.reset() if name in ("r", "Home") else self

    def _steer(self) -> Vector:
        """Return the velocity that the held keys ask for."""
        right, upward, forward = _sum_directions(MOVE_KEYS, self.held)
        total = length((right, upward, forward))
        if total == 0.0:
            return 0.0, 0.0, 0.0
        speed = self.speed * (SHIFT_FACTOR if "Shift" in self.held else 1.0) / total
        return right * speed, upward * speed, forward * speed

    def _axes(self) -> tuple[Vector, Vector, Vector]:
        """Return right, up and forward, world space."""
        right, upward, toward = _compute_axes(self.up, self.azimuth, self.elevation)
        return right, upward, tuple(-part for part in toward)

    def _clamp_speed(self, speed: float) -> float:
        """Clamp a speed to a range that depends on the scene."""
        return min(max(speed, MIN_DISTANCE * self.ball.radius), 1e2 * self.ball.radius)


Controls = Orbit | Fly


def _compute_axes(up: Vector, azimuth: float, elevation: float) -> tuple[Vector, Vector, Vector]:
    """Return right, up and the direction to the eye, world space, at angles in degrees."""
    frame = rotate_y_to(up)
    upward, toward = (
        to_triple(transforms.apply(frame, orbit_direction(azimuth, angle)))
        for angle in (elevation + 90.0, elevation)
    )
    return cross(upward, toward), upward, toward


def _follow_pointer(controls: Any, event: Event, drag: str) -> tuple[Any, float, float]:
    """
    Return the state after an event of the pointer, and by how many pixels, x and y, it moved.

    ``drag`` is what moving the pointer does after this one, if a button goes down.
    """
    kind, point = event["event_type"], (float(event["x"]), float(event["y"]))
    if kind == "pointer_down":
        return replace(controls, drag=drag, pointer=point), 0.0, 0.0
    # A release may come without the last move.
    dx, dy = point[0] - controls.pointer[0], point[1] - controls.pointer[1]
    drag = controls.drag if kind == "pointer_move" else ""
    return replace(controls, drag=drag, pointer=point), dx, dy


def _compute_wheel_zoom(event: Event) -> float:
    """Return the zoom factor of a wheel event."""
    turned = ZOOM_EXPONENT_PER_UNIT * float(event.get("dy", 0.0))
    return min(max(math.exp(min(turned, MAX_ZOOM)), 1.0 / MAX_ZOOM), MAX_ZOOM)


def _compute_time_to_pole(elevation: float, rate: float) -> float:
    """Return the time until a turning goal reaches a pole, seconds."""
    return (math.copysign(90.0, rate) - elevation) / rate if rate else math.inf


def _sum_directions(
    directions: dict[str, tuple[float, ...]], keys: frozenset[str]
) -> tuple[float, ...]:
    """Return the sum of the directions of the keys that are down."""
    held = [direction for key, direction in directions.items() if key in keys]
    size = len(next(iter(directions.values())))
    return tuple(math.fsum(one[axis] for one in held) for axis in range(size))


def _compute_pivot_distance(ball: BoundingSphere, eye: Vector, forward: Vector) -> float:
    """Return the distance from the eye to the pivot."""
    distance = dot(subtract(ball.center, eye), forward)
    # Behind or beside the scene: it turns around what is in front of the eye.
    return ball.radius if distance < PLANE_MARGIN * ball.radius else distance


def _clamp(angle: float, largest: float) -> float:
    """Clamp an angle to a range around 0."""
    return min(max(angle, -largest), largest)
