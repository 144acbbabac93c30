"""
Cull lights: decide which reach visible objects, and which cast shadows there, and why.

Lights are tested against the boxes around the objects. A light is culled if it is black or surely
reaches no object in view, and casts no shadows if surely nothing lies between. The others become
rows that kernels read; shadow maps are fitted once visible faces are known.
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
from rasterjit.pipeline.records import Lighting, PyrenderObjects
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera, PerspectiveCamera
from rasterjit.scene.environment import Environment
from rasterjit.scene.light import (
    MAX_MAP_TEXELS,
    AmbientLight,
    DirectionalLight,
    Light,
    PointLight,
    Shadow,
    SpotLight,
    unit_vector,
)
from rasterjit.scene.reference_shader import DepthMap, ReferenceShading
from rasterjit.scene.scene import Scene
from rasterjit.survey.batched_views import ViewGroup
from rasterjit.survey.blocked_lights import Enclosures
from rasterjit.survey.object_transforms import Boxes

CastingLight: TypeAlias = DirectionalLight | PointLight | SpotLight
"""Lights with a direction or position: each has a row, and may cast shadows."""

MAX_LIGHT_DISTANCE = 1e18
"""Coordinates of a light relative to the eye are clamped to this: their squares stay finite in
float32, and no light of an allowed intensity is seen from there."""

MIN_CONE = 2.0**-41
"""Least 1 - cosine of a cone's outer angle (9.5e-7 radians): a few roundings of a direction in
float32, so that any cone lights its axis."""

MIN_CONE_RAMP = 2.0**-21
"""Least relative difference of 1 - cosine of a cone's angles, if both are the same: what float32
resolves, and less than `LIGHT_ROUNDING`."""

MAX_SINGLE_MAP_ANGLE = 60.0
"""Largest angle from the axis, degrees, of spot lights with one shadow map; wider ones get six."""

FILTER_TEXELS = 6.0
"""Largest radius of a shadow filter, texels, if the map covers more than is visible."""

MAX_PAIRS = 1 << 20
"""Most pairs of objects that are tested; with more, a caster is assumed."""

FIRST_BOXES, BOXES_GROWTH = 4, 8
"""Number of boxes compared with all others at first, and its growth for each next chunk: mostly the
first chunk overlaps."""

LIGHT_ROUNDING = 2.0**-16
"""Margin of a light's reach, relative to coordinates and cosines: above the rounding of the
light that kernels see, which is float32."""

SQRT_HALF = math.sqrt(0.5)

BYTES_PER_TEXEL = 4

MIN_SIDE_SINE = 0.1
"""Least sine of the angle between a direction and an axis that the build_basis is built from."""

NO_CONE = (0.0, 0.0, 0.0, 0.0, 1.0)
"""Axis, scale and offset of light without a cone."""

HEADLIGHT_DIRECTION = (-0.3, -0.5, -1.0)
"""Direction of the default light in view space: over the viewer's right shoulder."""
HEADLIGHT_INTENSITY = 0.9
HEADLIGHT_AMBIENT = 0.1
"""The default light's two parts add up to 1, so a white surface facing it is white."""


class PlannedLights(NamedTuple):
    """The lights that reach visible objects."""

    lights: tuple[Light, ...]
    """The lights, without the shadows that are not visible."""
    numbers: tuple[int, ...]
    """Number of each in the scene; empty for the headlight."""
    notes: tuple[str, ...]
    """Why lights were culled."""
    shadow_notes: tuple[str, ...]
    """Why shadows were culled."""

    @property
    def have_shadows(self) -> bool:
        """Whether any light casts shadows."""
        return any(getattr(light, "shadow", None) is not None for light in self.lights)

    def has_all(self, lights: Sequence[Light]) -> bool:
        """Tell whether all given lights are planned, as for any other camera."""
        return (
            len(self.lights) == len(lights)
            and all(map(operator.is_, self.lights, lights))
            and not any(map(_depends_on_view, lights))
        )


def _depends_on_view(light: Any) -> bool:
    """Tell whether culling a light or its shadow depends on the visible objects."""
    if isinstance(light, SpotLight) or getattr(light, "range", None) is not None:
        return True
    return getattr(light, "shadow", None) is not None


NO_LIGHTS = PlannedLights((), (), (), ())


def plan_lights(
    lights: Sequence[Light], boxes: Boxes, casts_shadow: NDArray[np.bool_], enclosures: Enclosures
) -> PlannedLights:
    """
    Cull the lights: return those that reach visible objects, and why others do not.

    Parameters
    ----------
    lights : sequence of Light
    boxes : Boxes
        Around the objects.
    casts_shadow : (O,) bool
        Which objects cast shadows.
    enclosures : Enclosures
        Objects that may block lights that cast shadows.

    Raises
    ------
    ValueError
        If the shadow maps have too many texels together; the message names the lights.
    """
    kept, numbers, notes, shadow_notes = [], [], [], []
    light_scene = _LightScene(boxes, casts_shadow, enclosures)
    for n, light in enumerate(lights):
        reason, lit = _cull_light(light, light_scene)
        if reason:
            notes.append(f"light {n}: {reason}")
            continue
        if isinstance(light, AmbientLight) or light.shadow is None:
            pass
        elif not light_scene.is_shaded(light, light.shadow, lit):
            shadow_notes.append(f"light {n}: nothing lies between it and what is seen")
            light = replace(light, shadow=None)
        kept.append(light)
        numbers.append(n)
    planned = PlannedLights(tuple(kept), tuple(numbers), tuple(notes), tuple(shadow_notes))
    _check_map_texels(planned)
    return planned


def _cull_light(light: Any, light_scene: _LightScene) -> tuple[str, NDArray[np.bool_] | None]:
    """Return why a light is culled, or "" and the objects that it reaches, None for all."""
    if light.intensity == 0.0:
        return "its intensity is 0", None
    if not any(light.color):
        return "it is black", None
    lit = None
    if getattr(light, "range", None) is not None:
        lit = light_scene.in_range(light)
        if not lit.any():
            return f"its range of {light.range:g} ends before all that is seen", None
    if isinstance(light, SpotLight):
        lit = light_scene.in_cone(light) if lit is None else lit & light_scene.in_cone(light)
        if not lit.any():
            return "nothing in view is in its cone", None
    if getattr(light, "shadow", None) is not None:
        blocker = light_scene.blocking_object(light)
        if blocker is not None:
            return f"object {blocker} is closed around the camera, and keeps it out", None
    return "", lit


def _check_map_texels(planned: PlannedLights) -> None:
    """Raise ``ValueError`` if the shadow maps have too many texels together."""
    total, maps = 0, []
    for n, light in zip(planned.numbers, planned.lights, strict=True):
        shadow = getattr(light, "shadow", None)
        if shadow is not None:
            count = 6 if has_cube(light) else 1
            total += count * shadow.size * shadow.size
            maps.append(f"light {n} ({count} of {shadow.size} x {shadow.size})")
    if total > MAX_MAP_TEXELS:
        raise ValueError(
            f"the shadow maps of all lights must have at most {MAX_MAP_TEXELS:,} texels together "
            f"({MAX_MAP_TEXELS * BYTES_PER_TEXEL / 1e9:.1f} GB), got {total:,} "
            f"({total * BYTES_PER_TEXEL / 1e9:.1f} GB): {', '.join(maps)}; take a smaller "
            "shadow.size or quality.shadow_size, or fewer shadows"
        )


def has_cube(light: Light) -> bool:
    """Tell whether the shadow map of a light is a cube map."""
    is_wide = isinstance(light, SpotLight) and light.outer_angle > MAX_SINGLE_MAP_ANGLE
    return is_wide or isinstance(light, PointLight)


class _LightScene:
    """Receivers and casters of light, as boxes relative to the eye."""

    def __init__(self, boxes: Boxes, casts: NDArray[np.bool_], enclosures: Enclosures) -> None:
        self._boxes = boxes
        self.casts = casts
        self.eye = boxes.eye
        self._enclosures = enclosures

    @cached_property
    def is_unsure(self) -> NDArray[np.bool_]:
        """Whether each object may be visible but has no finite bounds, (O,)."""
        return self._boxes.in_view & ~self._boxes.is_known

    @cached_property
    def ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Low and high corner along the world's axes, (O, 3) each."""
        return bound_corners(self._boxes.corners)

    def in_range(self, light: Any) -> NDArray[np.bool_]:
        """Tell of each object, (O,), whether it may be seen and a light's range reaches it."""
        return self._boxes.in_view & _is_in_range(light, self.eye, *self.ends) | self.is_unsure

    def in_cone(self, light: SpotLight) -> NDArray[np.bool_]:
        """Tell of each object, (O,), whether it may be seen and meets a light's cone."""
        in_cone = _is_in_cone(light, self.eye, self._boxes.corners)
        return self._boxes.in_view & in_cone | self.is_unsure

    def blocking_object(self, light: Any) -> int | None:
        """Return the closed object that blocks a light from all that is visible, if any."""
        return _find_blocker(light, self.eye, self._enclosures, *self.ends)

    def is_shaded(self, light: Any, shadow: Shadow, lit: NDArray[np.bool_] | None) -> bool:
        """Tell whether any object may cast a shadow on those that a light reaches, (O,) or all."""
        is_receiver = self._boxes.in_view if lit is None else lit
        is_solid = self.casts & ~self._boxes.is_flat
        if self.is_unsure.any() or (is_receiver & is_solid).any():
            # Objects with a volume may shade themselves.
            return True
        casters = np.flatnonzero(self.casts & self._boxes.is_known)
        receivers = np.flatnonzero(is_receiver)
        if len(receivers) * len(casters) > MAX_PAIRS:
            return True
        low, high = self.ends
        if isinstance(light, DirectionalLight):
            corners = project_on_axes(build_basis(light.direction), self._boxes.corners)
            low, high = corners.min(axis=1), corners.max(axis=1)
        # A caster between a surface and the light overlaps the box around both.
        first, last = low[receivers], high[receivers]
        if isinstance(light, DirectionalLight):
            nearest = low[casters, 2].min(initial=np.inf)
            radius = _filter_radius(shadow, first[:, :2], last[:, :2])
            radius += compute_half_tangent(shadow) * max(
                last[:, 2].max(initial=-np.inf) - nearest, 0.0
            )
            first[:, 2] = -np.inf
        else:
            position = np.array(light.position) - self.eye
            first, last = np.minimum(first, position), np.maximum(last, position)
            radius = _filter_radius(shadow, first, last) + (shadow.light_size or 0.0) / 2.0
        first, last = first - radius, last + radius
        return _overlaps_another(first, last, receivers, low[casters], high[casters], casters)


def bound_corners(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return low and high corner along the world's axes, (..., 3) each, of boxes, (..., 8, 3)."""
    return corners.min(axis=-2), corners.max(axis=-2)


def _box_error(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the error of box corners, (..., 3), in the float32 of kernels, (...)."""
    return LIGHT_ROUNDING * np.maximum(np.abs(low), np.abs(high)).max(axis=-1)


def _is_in_range(
    light: Any, eye: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """
    Tell of boxes, (..., O), whether a light's range reaches them.

    Takes the eye, (..., 3), and the corners of the boxes relative to it, (..., O, 3) each.
    """
    position = (np.array(light.position) - eye)[..., np.newaxis, :]
    error = _box_error(low, high) + LIGHT_ROUNDING * (np.abs(position).max(axis=-1) + light.range)
    with np.errstate(invalid="ignore", over="ignore"):
        gaps = np.maximum(low - position, position - high) - error[..., np.newaxis]
        x, y, z = np.moveaxis(np.maximum(gaps, 0.0), -1, 0) / light.range
        return x * x + y * y + z * z < 1.0


def bound_cone(light: SpotLight) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    return build_basis(light.direction), np.array([math.sqrt(1.0 - cosine * cosine), cosine])


def _is_in_cone(
    light: SpotLight, eye: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """
    Tell of boxes, (..., O), whether they meet a light's cone.

    A box does not if all corners lie behind the light, or beyond one side of a pyramid around the
    cone.

    Takes the eye, (..., 3), and the corners of the boxes relative to it, (..., O, 8, 3).
    """
    position = (np.array(light.position) - eye)[..., np.newaxis, np.newaxis, :]
    axes, (sine, cosine) = bound_cone(light)
    with np.errstate(invalid="ignore", over="ignore"):
        right, down, ahead = np.moveaxis(project_on_axes(axes, corners - position), -1, 0)
        error = np.maximum(np.abs(corners).max(axis=(-2, -1)), np.abs(position).max(axis=(-2, -1)))
        error *= 2.0 * LIGHT_ROUNDING
        is_out = ahead.max(axis=-1) < -error
        diagonals = SQRT_HALF * (right + down), SQRT_HALF * (right - down)
        for across in (right, down, *diagonals):
            for sign in (1.0, -1.0):
                is_out |= (cosine * sign * across - sine * ahead).min(axis=-1) > error
    return ~is_out


def find_reaching_lights(lights: Sequence[Light], group: ViewGroup) -> NDArray[np.bool_]:
    """Tell whether lights reach visible objects, (N, L), as `plan_lights` does."""
    is_lit = np.zeros((len(group.in_view), len(lights)), np.bool_)
    for n, light in enumerate(lights):
        if light.intensity == 0.0 or not any(light.color):
            continue
        is_lit[:, n] = (_find_reached_objects(light, group) & group.in_view).any(axis=1)
    return is_lit


def _find_reached_objects(light: Light, group: ViewGroup) -> NDArray[np.bool_]:
    """Tell which objects in view a light may reach, (N, O); of others nothing is said."""
    is_reached = np.ones_like(group.in_view)
    if getattr(light, "range", None) is not None:
        is_reached &= _is_in_range(light, group.eyes, *bound_corners(group.corners))
    if isinstance(light, SpotLight):
        is_reached &= _is_in_cone(light, group.eyes, group.corners)
    return is_reached if is_reached.all() else is_reached | group.is_unsure


def are_all_shadows_cast(scene: Scene, group: ViewGroup) -> NDArray[np.bool_]:
    """
    Tell of each view, (N,), whether `plan_lights` surely keeps the shadows of all lights there.

    They are kept where a light reaches an object with a volume, which may shade itself, and no
    object may enclose the eye.
    """
    lights = [light for light in scene.lights if getattr(light, "shadow", None) is not None]
    is_solid = group.inventory.casts_shadows & (group.bounds[:, 0] < group.bounds[:, 1]).all(axis=1)
    is_cast = np.ones(len(group.in_view), np.bool_)
    for light in lights:
        is_lit = group.in_view & _find_reached_objects(light, group)
        is_cast &= (is_lit & is_solid).any(axis=1)
    # Find objects that enclose the eye: hardly any box holds the middle of the near plane.
    low, high = bound_corners(group.corners)
    middle = group.compute_near_middles()[:, np.newaxis]
    with np.errstate(invalid="ignore"):
        error = _box_error(low, high)[..., np.newaxis]
        # NaN counts as unsure.
        is_outside = np.any((middle < low - error) | (middle > high + error), axis=2)
    meshes = [node.mesh for node in scene.nodes]
    for n in np.flatnonzero(is_cast & ~np.all(is_outside, axis=1)).tolist():
        views = group.views.relative_from_model[n], group.views.clip_from_relative[n]
        enclosures, ends = Enclosures(meshes, group.inventory.is_wall, *views), (low[n], high[n])
        blockers = [_find_blocker(light, group.eyes[n], enclosures, *ends) for light in lights]
        is_cast[n] = all(blocker is None for blocker in blockers)
    return is_cast


def _find_blocker(
    light: Any, eye: NDArray[np.float64], enclosures: Enclosures, low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> int | None:  # fmt: skip
    """Return the closed object that blocks a light from all that is visible, if any."""
    if isinstance(light, DirectionalLight):
        return enclosures.find_separating_object(-np.array(light.direction), False, low, high)
    return enclosures.find_separating_object(np.array(light.position) - eye, True, low, high)


def _filter_radius(shadow: Shadow, first: NDArray[np.float64], last: NDArray[np.float64]) -> float:
    """Return the radius of a shadow filter, scene units."""
    if shadow.filter == "hard" or not len(first):
        return 0.0
    return FILTER_TEXELS / shadow.size * float((last.max(axis=0) - first.min(axis=0)).max())


def compute_half_tangent(shadow: Shadow) -> float:
    """Return the tangent of half the angular size of a directional light."""
    if shadow.light_size is None:
        return 0.0
    sine, cosine = transforms.sine_cosine(shadow.light_size / 2.0)
    return sine / cosine


def _overlaps_another(
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    owners: NDArray[np.int64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    numbers: NDArray[np.int64],
) -> bool:
    """Tell whether any of N boxes (first, last) overlaps one of M (low, high) of another object."""
    start, count = 0, FIRST_BOXES
    while start < len(first):
        chunk = slice(start, start + count)
        meets = owners[chunk, np.newaxis] != numbers
        for k in range(3):
            meets &= low[:, k] <= last[chunk, k, np.newaxis]
            meets &= high[:, k] >= first[chunk, k, np.newaxis]
        if meets.any():
            return True
        start, count = start + count, count * BOXES_GROWTH
    return False


def build_basis(
    direction: Sequence[float], right: Sequence[float] = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """
    Return an orthonormal basis, (3, 3) rows, whose last vector is the direction.

    The first is as near to ``right`` as possible, unless that is along the direction.
    """
    x, y, z = direction
    a, b, c = right
    values = a * x + b * y + c * z
    a, b, c = a - values * x, b - values * y, c - values * z
    if max(abs(a), abs(b), abs(c)) < MIN_SIDE_SINE:
        # Take what is at right angles to the direction and to the axis farthest from it.
        axis = min(abs(x), abs(y), abs(z))
        p, q, r = (float(abs(values) == axis) for values in direction)
        if p == q == r:
            # All three are as far: their sum may be along it.
            p, q, r = 1.0, 0.0, 0.0
        a, b, c = y * r - z * q, z * p - x * r, x * q - y * p
    across = transforms.unit_vector("axis", (a, b, c))
    p, q, r = across.tolist()
    return np.array([across, [y * r - z * q, z * p - x * r, x * q - y * p], [x, y, z]])


def project_on_axes(axes: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coordinates of points, (..., 3), along three axes."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([x * a + y * b + z * c for a, b, c in axes.tolist()], axis=-1)


def pack_lights(
    lights: Sequence[Light], camera: Camera, highlights: int, renormalizes: int = 1
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
            rows.append(_pack_light(light, eye))
    return Lighting(
        np.array(rows, np.float32).reshape(-1, LIGHT_COLUMNS),
        np.array(ambient, np.float32),
        np.int64(highlights) if highlights else None,
        renormalizes=renormalizes,
    )


def apply_reference_shading(
    lighting: Lighting, reference: ReferenceShading, planned: PlannedLights, camera: Camera
) -> Lighting:
    """Return lights as rows with the brightness of a reference shading."""
    eye = np.asarray(camera.eye_position(), np.float64).tolist()
    # Light from all around has no row.
    numbers = [
        n
        for n, light in zip(planned.numbers, planned.lights, strict=True)
        if not isinstance(light, AmbientLight)
    ]
    lighting.lights[:, 4:7] = reference.radiance[numbers]
    faces_viewer, are_squares = (
        flags if flags.any() else None for flags in (reference.faces_viewer, reference.are_squares)
    )
    gains = reference.gains if (reference.gains != 1.0).any() else None
    light_mask = np.ascontiguousarray(reference.light_mask[:, numbers])
    maps = tuple(
        (numbers.index(map.light), pack_light_view(map, eye), map.depths)
        for map in reference.maps
        if map.light in numbers
    )
    imitated = PyrenderObjects(light_mask, faces_viewer, are_squares, gains, maps)
    return lighting._replace(ambient=reference.ambient, highlights=None, pyrender=imitated)


def pack_light_view(depth_map: DepthMap, eye: Sequence[float]) -> NDArray[np.float32]:
    """
    Pack the projection of a light, (20,) float32: its matrix for points relative to the eye, p, q,
    r and s. The distance of a point at NDC z is (p - q z) / (r - s z).
    """
    x, y, z = eye
    matrix = depth_map.clip_from_world.copy()
    matrix[:, 3] += (matrix[:, 0] * x + matrix[:, 1] * y) + matrix[:, 2] * z
    (_, _, z_scale, z_offset), (_, _, w_scale, w_offset) = depth_map.clip_from_view[2:]
    return np.array([*matrix.ravel(), z_offset, w_offset, z_scale, w_scale], np.float32)


def _pack_light(light: CastingLight, eye: Sequence[float]) -> list[float]:
    """Return one row of ``Lighting.lights``."""
    color = [part * light.intensity for part in light.color]
    if isinstance(light, DirectionalLight):
        x, y, z = light.direction
        return [-x, -y, -z, 0.0, *color, *NO_CONE, 0.0]
    position = [
        max(-MAX_LIGHT_DISTANCE, min(MAX_LIGHT_DISTANCE, end - origin))
        for end, origin in zip(light.position, eye, strict=True)
    ]
    return [*position, 1.0, *color, *_pack_cone(light), _inverse_square_range(light.range)]


def _pack_cone(light: Light) -> tuple[float, float, float, float, float]:
    """Return axis, scale and offset of a light's cone."""
    if not isinstance(light, SpotLight):
        return NO_CONE
    inner = _compute_versine(light.inner_angle)
    outer = max(_compute_versine(light.outer_angle), MIN_CONE, inner * (1.0 + MIN_CONE_RAMP))
    scale = 1.0 / (outer - inner)
    return (*light.direction, scale, outer * scale)


def _compute_versine(angle: float) -> float:
    """Return 1 - cos of an angle in degrees, without cancellation for small ones."""
    half_sine, _ = transforms.sine_cosine(angle / 2.0)
    return 2.0 * half_sine * half_sine


def _inverse_square_range(max_distance: float | None) -> float:
    """Return 1 / range², or 0 without a range."""
    if max_distance is None:
        return 0.0
    inverse = min(1.0 / max_distance, MAX_LIGHT_DISTANCE)
    return inverse * inverse


def max_reflected_light(lights: Sequence[Light], environment: Environment | None) -> float:
    """Return the largest light a white surface reflects; infinite with positional lights."""
    total = 0.0 if environment is None else environment.brightest
    for light in lights:
        if isinstance(light, PointLight | SpotLight):
            # Their light grows without bound near the surface.
            return math.inf
        total += light.intensity * max(light.color)
    return total


def make_headlight(camera: Camera) -> list[Light]:
    """Return the default lights, for scenes without any."""
    direction = _compute_headlight_direction(camera)
    light = DirectionalLight(direction, intensity=HEADLIGHT_INTENSITY)
    return [light, AmbientLight(intensity=HEADLIGHT_AMBIENT)]


def _compute_headlight_direction(camera: Camera) -> tuple[float, ...]:
    """Return the direction of the default light in world space, of any length."""
    # The rows of the inverse transpose are the columns of the inverse.
    columns = transforms.normal_rows(np.asarray(camera.view_matrix(), np.float64).tolist())
    x, y, z = HEADLIGHT_DIRECTION
    return tuple([(a * x + b * y) + c * z for a, b, c in zip(*columns, strict=True)])


def pack_headlight(camera: Camera, highlights: int, renormalizes: int = 1) -> Lighting:
    """Return `pack_lights` of `make_headlight`, without creating the lights again."""
    row = _default_headlight()
    rows = row.lights.copy()
    rows[0, :3] = [-x for x in unit_vector("direction", _compute_headlight_direction(camera))]
    count = np.int64(highlights) if highlights else None
    return row._replace(lights=rows, highlights=count, renormalizes=renormalizes)


@cache
def _default_headlight() -> Lighting:
    camera = PerspectiveCamera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    lighting = pack_lights(make_headlight(camera), camera, 0)
    # All frames share it.
    lighting.ambient.setflags(write=False)
    return lighting
