"""
Cull lights: decide which reach visible objects, and which cast shadows there, and why.

Planning knows the boxes around the objects. A light is culled if it is black or surely reaches no
object in view, and casts no shadows if surely nothing lies between. The others become rows that
kernels read; shadow maps are fitted when it is known what is seen.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.lighting.blinn_phong import LIGHT_COLUMNS
from rasterjit.pipeline.records import Imitated, Lighting
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera, PerspectiveCamera
from rasterjit.scene.environment import Environment
from rasterjit.scene.light import (
    MAX_TEXELS,
    AmbientLight,
    DirectionalLight,
    Light,
    PointLight,
    Shadow,
    SpotLight,
    unit_vector,
)
from rasterjit.scene.reference_shader import DepthMap, Imitation
from rasterjit.survey.batched_views import Group
from rasterjit.survey.blocked_lights import Enclosures
from rasterjit.survey.object_transforms import Boxes

CastingLight: TypeAlias = DirectionalLight | PointLight | SpotLight
"""Lights that come from somewhere: they have a row each, and may cast shadows."""

FARTHEST_LIGHT = 1e18
"""Coordinates of a light relative to the eye are clamped to this: their squares stay finite in
float32, and no light of an allowed intensity is seen from there."""

NARROWEST_CONE = 2.0**-41
"""Cones end no nearer to their axis, as one less the cosine: 9.5e-7 radians, a few roundings of a
direction in float32, so that there is light on the axis whatever the angle."""

NARROWEST_RAMP = 2.0**-21
"""Where the angles of a cone are the same its light ends over so much of one less the cosine: what
float32 tells, and less than what a light reaches is widened by."""

WIDEST_MAP = 60.0
"""Spot lights wider than so many degrees from their axis get six maps, as point lights do."""

FILTER_TEXELS = 6.0
"""Texels that a filter looks aside at most, of a map that is fitted to more than is seen."""

MAX_PAIRS = 1 << 20
"""Pairs of objects that are looked at: in scenes of more, something always lies between."""

FIRST_ROWS, MORE_ROWS = 4, 8
"""Objects compared with all others at first, and the factor for each next try. Mostly the first
finds something."""

LIGHT_ROUNDING = 2.0**-16
"""Widening of what a light reaches, as a share of coordinates and of cosines: above that of the
light that kernels see, which is float32."""

DIAGONAL = math.sqrt(0.5)

TEXEL_BYTES = 4

ALONG = 0.1
"""Sine of the angle to the direction below which an axis says too little about what is aside."""

NO_CONE = (0.0, 0.0, 0.0, 0.0, 1.0)
"""Axis, scale and offset of light that goes all ways."""

HEADLIGHT_DIRECTION = (-0.3, -0.5, -1.0)
"""Direction of the default light in view space: over the viewer's right shoulder."""
HEADLIGHT_INTENSITY = 0.9
HEADLIGHT_AMBIENT = 0.1
"""The default light's two parts add up to 1, so a white surface facing it is white."""


class PlannedLights(NamedTuple):
    """The lights that reach visible objects."""

    lights: tuple[Light, ...]
    """As the scene has them; one that casts no shadow there has none."""
    numbers: tuple[int, ...]
    """Which of the scene's lights each is; empty for the headlight."""
    notes: tuple[str, ...]
    """Why others were left out."""
    shadow_notes: tuple[str, ...]
    """Why lights that could cast shadows do not."""

    @property
    def have_shadows(self) -> bool:
        """Whether any of them casts shadows."""
        return any(getattr(light, "shadow", None) is not None for light in self.lights)

    def are_all_of(self, lights: Sequence[Light]) -> bool:
        """Tell whether these are some lights, none left out, and reach all whatever is seen."""
        return (
            len(self.lights) == len(lights)
            and all(map(operator.is_, self.lights, lights))
            and not any(map(_depends_on_view, lights))
        )


def _depends_on_view(light: Any) -> bool:
    """Tell whether what a light reaches, and its shadows, depend on what is seen."""
    if isinstance(light, SpotLight) or getattr(light, "range", None) is not None:
        return True
    return getattr(light, "shadow", None) is not None


NO_LIGHTS = PlannedLights((), (), (), ())


def plan_lights(
    lights: Sequence[Light], boxes: Boxes, casts: NDArray[np.bool_], enclosures: Enclosures
) -> PlannedLights:
    """
    Return the lights that reach what is seen, and what became of the others.

    Parameters
    ----------
    lights : sequence of Light
    boxes : Boxes
        Around the objects.
    casts : (O,) bool
        Which objects cast shadows.
    enclosures : Enclosures
        What may keep the light of those that cast shadows out.

    Raises
    ------
    ValueError
        If the shadow maps have too many texels together; the message names the lights.
    """
    kept, numbers, notes, shadow_notes = [], [], [], []
    scenery = _Scenery(boxes, casts, enclosures)
    for n, light in enumerate(lights):
        reason, reached = _reason_against(light, scenery)
        if reason:
            notes.append(f"light {n}: {reason}")
            continue
        if isinstance(light, AmbientLight) or light.shadow is None:
            pass
        elif not scenery.is_shaded(light, light.shadow, reached):
            shadow_notes.append(f"light {n}: nothing lies between it and what is seen")
            light = replace(light, shadow=None)
        kept.append(light)
        numbers.append(n)
    planned = PlannedLights(tuple(kept), tuple(numbers), tuple(notes), tuple(shadow_notes))
    _check_maps(planned)
    return planned


def _reason_against(light: Any, scenery: _Scenery) -> tuple[str, NDArray[np.bool_] | None]:
    """Return why a light reaches nothing that is seen, or "" and what it reaches if not all."""
    if light.intensity == 0.0:
        return "its intensity is 0", None
    if not any(light.color):
        return "it is black", None
    reached = None
    if getattr(light, "range", None) is not None:
        reached = scenery.in_range(light)
        if not reached.any():
            return f"its range of {light.range:g} ends before all that is seen", None
    if isinstance(light, SpotLight):
        reached = scenery.in_cone(light) if reached is None else reached & scenery.in_cone(light)
        if not reached.any():
            return "nothing in view is in its cone", None
    if getattr(light, "shadow", None) is not None:
        wall = scenery.wall_against(light)
        if wall is not None:
            return f"object {wall} is closed around the camera, and keeps it out", None
    return "", reached


def _check_maps(planned: PlannedLights) -> None:
    """Raise ``ValueError`` if the shadow maps have too many texels together."""
    total, listed = 0, []
    for n, light in zip(planned.numbers, planned.lights, strict=True):
        shadow = getattr(light, "shadow", None)
        if shadow is not None:
            count = 6 if has_cube(light) else 1
            total += count * shadow.size * shadow.size
            listed.append(f"light {n} ({count} of {shadow.size} x {shadow.size})")
    if total > MAX_TEXELS:
        raise ValueError(
            f"the shadow maps of all lights must have at most {MAX_TEXELS:,} texels together "
            f"({MAX_TEXELS * TEXEL_BYTES / 1e9:.1f} GB), got {total:,} "
            f"({total * TEXEL_BYTES / 1e9:.1f} GB): {', '.join(listed)}; take a smaller "
            "shadow.size or quality.shadow_size, or fewer shadows"
        )


def has_cube(light: Light) -> bool:
    """Tell whether a light that casts shadows has six maps."""
    wide = isinstance(light, SpotLight) and light.outer_angle > WIDEST_MAP
    return wide or isinstance(light, PointLight)


class _Scenery:
    """Receivers and casters of light, as boxes relative to the eye."""

    def __init__(self, boxes: Boxes, casts: NDArray[np.bool_], enclosures: Enclosures) -> None:
        self._boxes = boxes
        self.casts = casts
        self.eye = boxes.eye
        self._enclosures = enclosures

    @cached_property
    def is_unsure(self) -> NDArray[np.bool_]:
        """Whether it is not known how far an object reaches, though it may be seen, (O,)."""
        return self._boxes.in_view & ~self._boxes.is_known

    @cached_property
    def ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Low and high corner along the world's axes, (O, 3) each."""
        return ends_of(self._boxes.corners)

    def in_range(self, light: Any) -> NDArray[np.bool_]:
        """Tell of each object, (O,), whether it may be seen and a light's range reaches it."""
        return self._boxes.in_view & _is_in_range(light, self.eye, *self.ends) | self.is_unsure

    def in_cone(self, light: SpotLight) -> NDArray[np.bool_]:
        """Tell of each object, (O,), whether it may be seen and meets a light's cone."""
        in_cone = _is_in_cone(light, self.eye, self._boxes.corners)
        return self._boxes.in_view & in_cone | self.is_unsure

    def wall_against(self, light: Any) -> int | None:
        """Return the object that is closed between what is seen and a light, if any."""
        low, high = self.ends
        if isinstance(light, DirectionalLight):
            return self._enclosures.between(-np.array(light.direction), False, low, high)
        return self._enclosures.between(np.array(light.position) - self.eye, True, low, high)

    def is_shaded(self, light: Any, shadow: Shadow, reached: NDArray[np.bool_] | None) -> bool:
        """Tell whether anything may lie between a light and what it reaches, (O,) or all."""
        receives = self._boxes.in_view if reached is None else reached
        is_solid = self.casts & ~self._boxes.is_flat
        if self.is_unsure.any() or (receives & is_solid).any():
            # What has an inside may shade itself.
            return True
        casters = np.flatnonzero(self.casts & self._boxes.is_known)
        receivers = np.flatnonzero(receives)
        if len(receivers) * len(casters) > MAX_PAIRS:
            return True
        low, high = self.ends
        if isinstance(light, DirectionalLight):
            corners = along(axes_of(light.direction), self._boxes.corners)
            low, high = corners.min(axis=1), corners.max(axis=1)
        # What lies between a surface and the light meets the box around both.
        first, last = low[receivers], high[receivers]
        if isinstance(light, DirectionalLight):
            nearest = low[casters, 2].min(initial=np.inf)
            room = _room_aside(shadow, first[:, :2], last[:, :2])
            room += half_tangent(shadow) * max(last[:, 2].max(initial=-np.inf) - nearest, 0.0)
            first[:, 2] = -np.inf
        else:
            place = np.array(light.position) - self.eye
            first, last = np.minimum(first, place), np.maximum(last, place)
            room = _room_aside(shadow, first, last) + (shadow.light_size or 0.0) / 2.0
        first, last = first - room, last + room
        return _meets_another(first, last, receivers, low[casters], high[casters], casters)


def ends_of(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return low and high corner along the world's axes, (..., 3) each, of boxes, (..., 8, 3)."""
    return corners.min(axis=-2), corners.max(axis=-2)


def _slack(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far off the corners of boxes, (..., 3), may be as kernels see them, (...)."""
    return LIGHT_ROUNDING * np.maximum(np.abs(low), np.abs(high)).max(axis=-1)


def _is_in_range(
    light: Any, eye: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """
    Tell of boxes, (..., O), whether a light's range reaches them.

    Takes the eye, (..., 3), and the corners of the boxes relative to it, (..., O, 3) each.
    """
    place = (np.array(light.position) - eye)[..., np.newaxis, :]
    slack = _slack(low, high) + LIGHT_ROUNDING * (np.abs(place).max(axis=-1) + light.range)
    with np.errstate(invalid="ignore", over="ignore"):
        gaps = np.maximum(low - place, place - high) - slack[..., np.newaxis]
        x, y, z = np.moveaxis(np.maximum(gaps, 0.0), -1, 0) / light.range
        return x * x + y * y + z * z < 1.0


def pyramid_of(
    light: SpotLight,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return a pyramid of eight sides around a light's cone.

    Returns
    -------
    axes : (3, 3) float64
        Unit vectors at right angles, the last along the cone: sides lean from it along the others,
        and half-way between these.
    lean : (2,) float64
        Sine and cosine of the angle between axis and sides.
    """
    _, cosine = transforms.sine_cosine(light.outer_angle)
    cosine = max(cosine - LIGHT_ROUNDING, 0.0)
    return axes_of(light.direction), np.array([math.sqrt(1.0 - cosine * cosine), cosine])


def _is_in_cone(
    light: SpotLight, eye: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """
    Tell of boxes, (..., O), whether they meet a light's cone.

    They do not if all corners lie behind the light, or beyond one side of a pyramid around the
    cone: then that is so of each face within.

    Takes the eye, (..., 3), and the corners of the boxes relative to it, (..., O, 8, 3).
    """
    place = (np.array(light.position) - eye)[..., np.newaxis, np.newaxis, :]
    axes, (sine, cosine) = pyramid_of(light)
    with np.errstate(invalid="ignore", over="ignore"):
        right, down, ahead = np.moveaxis(along(axes, corners - place), -1, 0)
        slack = np.maximum(np.abs(corners).max(axis=(-2, -1)), np.abs(place).max(axis=(-2, -1)))
        slack *= 2.0 * LIGHT_ROUNDING
        is_out = ahead.max(axis=-1) < -slack
        between = DIAGONAL * (right + down), DIAGONAL * (right - down)
        for aside in (right, down, *between):
            for turn in (1.0, -1.0):
                is_out |= (cosine * turn * aside - sine * ahead).min(axis=-1) > slack
    return ~is_out


def reach(lights: Sequence[Light], group: Group) -> NDArray[np.bool_]:
    """Tell of lights without shadows, (N, L), whether they reach what is seen: `plan_lights`."""
    reached = np.zeros((len(group.in_view), len(lights)), np.bool_)
    for n, light in enumerate(lights):
        if light.intensity == 0.0 or not any(light.color):
            continue
        is_reached = np.ones_like(group.in_view)
        if getattr(light, "range", None) is not None:
            is_reached &= _is_in_range(light, group.eyes, *ends_of(group.corners))
        if isinstance(light, SpotLight):
            is_reached &= _is_in_cone(light, group.eyes, group.corners)
        if is_reached.all():
            reached[:, n] = True
            continue
        lit = group.in_view & is_reached | group.is_unsure
        reached[:, n] = lit.any(axis=1)
    return reached


def _room_aside(shadow: Shadow, first: NDArray[np.float64], last: NDArray[np.float64]) -> float:
    """Return how far beside what it falls on a filter may find a shadow, scene units."""
    if shadow.filter == "hard" or not len(first):
        return 0.0
    return FILTER_TEXELS / shadow.size * float((last.max(axis=0) - first.min(axis=0)).max())


def half_tangent(shadow: Shadow) -> float:
    """Return the tangent of half the angle that a directional light is seen under."""
    if shadow.light_size is None:
        return 0.0
    sine, cosine = transforms.sine_cosine(shadow.light_size / 2.0)
    return sine / cosine


def _meets_another(
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    owners: NDArray[np.int64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    numbers: NDArray[np.int64],
) -> bool:
    """Tell whether any of N boxes (first, last) meets one of M (low, high) that is not its own."""
    start, rows = 0, FIRST_ROWS
    while start < len(first):
        part = slice(start, start + rows)
        meets = owners[part, np.newaxis] != numbers
        for k in range(3):
            meets &= low[:, k] <= last[part, k, np.newaxis]
            meets &= high[:, k] >= first[part, k, np.newaxis]
        if meets.any():
            return True
        start, rows = start + rows, rows * MORE_ROWS
    return False


def axes_of(
    direction: Sequence[float], right: Sequence[float] = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """
    Return three unit vectors, (3, 3), at right angles, the last of them the direction given.

    The first is the nearest to ``right`` that there is, unless that is along the direction.
    """
    x, y, z = direction
    a, b, c = right
    part = a * x + b * y + c * z
    a, b, c = a - part * x, b - part * y, c - part * z
    if max(abs(a), abs(b), abs(c)) < ALONG:
        # Take what is at right angles to the direction and to the axis farthest from it.
        least = min(abs(x), abs(y), abs(z))
        p, q, r = (float(abs(part) == least) for part in direction)
        if p == q == r:
            # All three are as far: their sum may be along it.
            p, q, r = 1.0, 0.0, 0.0
        a, b, c = y * r - z * q, z * p - x * r, x * q - y * p
    across = transforms.unit_vector("axis", (a, b, c))
    p, q, r = across.tolist()
    return np.array([across, [y * r - z * q, z * p - x * r, x * q - y * p], [x, y, z]])


def along(axes: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coordinates of points, (..., 3), along three axes."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([x * a + y * b + z * c for a, b, c in axes.tolist()], axis=-1)


def lighting_of(
    lights: Sequence[Light],
    camera: Camera,
    highlights: int,
    renormalizes: int = 1,
) -> Lighting:
    """
    Return the lights as rows, relative to the eye.

    Parameters
    ----------
    lights : sequence of Light
    camera : Camera
    highlights : int
        Number of objects with a specular highlight.
    renormalizes : int
        Not 0: interpolated normals are scaled to length one.
    """
    eye = np.asarray(camera.eye_position(), np.float64).tolist()
    rows, ambient = [], (0.0, 0.0, 0.0)
    for light in lights:
        if isinstance(light, AmbientLight):
            red, green, blue = (part * light.intensity for part in light.color)
            ambient = ambient[0] + red, ambient[1] + green, ambient[2] + blue
        else:
            rows.append(_row(light, eye))
    return Lighting(
        np.array(rows, np.float32).reshape(-1, LIGHT_COLUMNS),
        np.array(ambient, np.float32),
        np.int64(highlights) if highlights else None,
        renormalizes=renormalizes,
    )


def imitated_lighting(
    lighting: Lighting, imitation: Imitation, planned: PlannedLights, camera: Camera
) -> Lighting:
    """Return lights as rows with the brightness that they have in another program's shader."""
    eye = np.asarray(camera.eye_position(), np.float64).tolist()
    # Light from all around has no row.
    numbers = [
        n
        for n, light in zip(planned.numbers, planned.lights, strict=True)
        if not isinstance(light, AmbientLight)
    ]
    lighting.lights[:, 4:7] = imitation.radiance[numbers]
    faces_viewer, are_squares = (
        flags if flags.any() else None for flags in (imitation.faces_viewer, imitation.are_squares)
    )
    gains = imitation.gains if (imitation.gains != 1.0).any() else None
    taken = np.ascontiguousarray(imitation.taken[:, numbers])
    maps = tuple(
        (numbers.index(one.light), view_of_light(one, eye), one.depths)
        for one in imitation.maps
        if one.light in numbers
    )
    imitated = Imitated(taken, faces_viewer, are_squares, gains, maps)
    return lighting._replace(ambient=imitation.ambient, highlights=None, imitated=imitated)


def view_of_light(one: DepthMap, eye: Sequence[float]) -> NDArray[np.float32]:
    """
    Return how a light sees points relative to the eye, (20,) float32: its matrix, row by row.

    Behind that are p, q, r, s: what lies at NDC z is (p - q z) / (r - s z) away from it.
    """
    x, y, z = eye
    matrix = one.clip_from_world.copy()
    matrix[:, 3] += (matrix[:, 0] * x + matrix[:, 1] * y) + matrix[:, 2] * z
    (_, _, z_scale, z_offset), (_, _, w_scale, w_offset) = one.clip_from_view[2:]
    return np.array([*matrix.ravel(), z_offset, w_offset, z_scale, w_scale], np.float32)


def _row(light: CastingLight, eye: Sequence[float]) -> list[float]:
    """Return one row of ``Lighting.lights``."""
    color = [part * light.intensity for part in light.color]
    if isinstance(light, DirectionalLight):
        x, y, z = light.direction
        return [-x, -y, -z, 0.0, *color, *NO_CONE, 0.0]
    place = [
        max(-FARTHEST_LIGHT, min(FARTHEST_LIGHT, at - origin))
        for at, origin in zip(light.position, eye, strict=True)
    ]
    return [*place, 1.0, *color, *_cone(light), _ending(light.range)]


def _cone(light: Light) -> tuple[float, float, float, float, float]:
    """Return axis, scale and offset of a light's cone: full light inside, whatever the angles."""
    if not isinstance(light, SpotLight):
        return NO_CONE
    inner, outer = _versine(light.inner_angle), max(_versine(light.outer_angle), NARROWEST_CONE)
    outer = max(outer, inner * (1.0 + NARROWEST_RAMP))
    scale = 1.0 / (outer - inner)
    return (*light.direction, scale, outer * scale)


def _versine(angle: float) -> float:
    """Return one less the cosine of an angle in degrees, of which small ones lose nothing."""
    sine, _ = transforms.sine_cosine(angle / 2.0)
    return 2.0 * sine * sine


def _ending(end: float | None) -> float:
    """Return one over the square of a range, 0 for none."""
    if end is None:
        return 0.0
    inverse = min(1.0 / end, FARTHEST_LIGHT)
    return inverse * inverse


def most_light(lights: Sequence[Light], environment: Environment | None) -> float:
    """Return the largest light a white surface reflects; infinite with positional lights."""
    total = 0.0 if environment is None else environment.brightest
    for light in lights:
        if isinstance(light, PointLight | SpotLight):
            # That depends on how near it is.
            return math.inf
        total += light.intensity * max(light.color)
    return total


def headlight(camera: Camera) -> list[Light]:
    """Return the lights of a scene that has none."""
    ambient = AmbientLight(intensity=HEADLIGHT_AMBIENT)
    return [DirectionalLight(_headlight_way(camera), intensity=HEADLIGHT_INTENSITY), ambient]


def _headlight_way(camera: Camera) -> tuple[float, ...]:
    """Return the direction of the light of a scene that has none, of any length."""
    # The rows of the inverse transpose are the columns of the inverse.
    columns = transforms.normal_rows(np.asarray(camera.view_matrix(), np.float64).tolist())
    x, y, z = HEADLIGHT_DIRECTION
    return tuple([(a * x + b * y) + c * z for a, b, c in zip(*columns, strict=True)])


def headlight_row(camera: Camera, highlights: int, renormalizes: int = 1) -> Lighting:
    """Return `lighting_of` the `headlight` of a camera, without creating its lights again."""
    made = _any_headlight()
    rows = made.lights.copy()
    rows[0, :3] = [-x for x in unit_vector("direction", _headlight_way(camera))]
    count = np.int64(highlights) if highlights else None
    return made._replace(lights=rows, highlights=count, renormalizes=renormalizes)


@cache
def _any_headlight() -> Lighting:
    camera = PerspectiveCamera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    lighting = lighting_of(headlight(camera), camera, 0)
    # All frames share it.
    lighting.ambient.setflags(write=False)
    return lighting
