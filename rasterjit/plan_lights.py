"""
Decide which lights reach what is seen and which cast shadows there, and why.

What is known when a frame is planned are the boxes around the objects. A light is left out if it
surely reaches none that may be seen, and casts no shadows if surely nothing lies between. What is
left is the row of each light that kernels read; the maps are fitted when it is known what is seen.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import transforms
from rasterjit.kernels.lighting import LIGHT_COLUMNS
from rasterjit.kernels.records import Lighting
from rasterjit.plan_layers import is_see_through
from rasterjit.scene.camera import Camera
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Node, matrices_of

FARTHEST_LIGHT = 1e18
"""Coordinates of a light relative to the eye are held within it: their squares stay finite in
float32, and no light of an allowed intensity is seen from there."""

NARROWEST_RAMP = 0.001
"""Least difference of the cosines between which the light of a cone ends, by KHR_lights_punctual:
the edge of a cone whose angles are the same is no step."""

WIDEST_MAP = 60.0
"""Spot lights wider than so many degrees from their axis get six maps, as point lights do."""

MOST_PAIRS = 1 << 20
"""Pairs of objects that are looked at: in scenes of more, something always lies between."""

TEXEL_BYTES = 4

ALONG = 0.1
"""Sine of the angle to the direction below which an axis says too little about what is aside."""

NO_CONE = (0.0, 0.0, 0.0, 0.0, 1.0)
"""Axis, scale and offset of light that goes all ways."""


class PlannedLights(NamedTuple):
    """The lights that reach what is seen."""

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


def plan_lights(
    lights: Sequence[Light], nodes: Sequence[Node], camera: Camera, size: tuple[int, int]
) -> PlannedLights:
    """
    Return the lights that reach what is seen, and what became of the others.

    Parameters
    ----------
    lights : sequence of Light
    nodes : sequence of Node
    camera : Camera
    size : (int, int)
        Width and height of the picture, pixels.
    """
    kept, numbers, notes, shadow_notes = [], [], [], []
    ends = any(getattr(light, "range", None) is not None for light in lights)
    casts = any(getattr(light, "shadow", None) is not None for light in lights)
    if not (ends or casts):
        return PlannedLights(tuple(lights), tuple(range(len(lights))), (), ())
    scenery = _Boxes(nodes, camera, size)
    for n, light in enumerate(lights):
        if getattr(light, "range", None) is not None and not scenery.is_reached(light):
            notes.append(f"light {n}: its range of {light.range:g} ends before all that is seen")
            continue
        if getattr(light, "shadow", None) is not None and not scenery.is_shaded(light):
            shadow_notes.append(f"light {n}: nothing lies between it and what is seen")
            light = replace(light, shadow=None)
        kept.append(light)
        numbers.append(n)
    return PlannedLights(tuple(kept), tuple(numbers), tuple(notes), tuple(shadow_notes))


def describe_shadows(lights: Sequence[Light]) -> str:
    """Say how many maps of which size the lights have, and how large they are together."""
    maps: Counter[int] = Counter()
    for light in lights:
        shadow = getattr(light, "shadow", None)
        if shadow is not None:
            maps[shadow.size] += 6 if has_cube(light) else 1
    texels = sum(count * size * size for size, count in maps.items())
    listed = ", ".join(
        f"{count} map{'s' if count > 1 else ''} of {size} x {size}" for size, count in maps.items()
    )
    return f"{listed}, {texels * TEXEL_BYTES / 1e6:.1f} MB"


def has_cube(light: Light) -> bool:
    """Tell whether a light that casts shadows has six maps."""
    wide = isinstance(light, SpotLight) and light.outer_angle > WIDEST_MAP
    return wide or isinstance(light, PointLight)


def mesh_boxes(meshes: Sequence[Mesh]) -> NDArray[np.float64]:
    """Return the low and high corner of each object, (O, 2, 3), model space; NaN if it has none."""
    boxes: dict[Any, Any] = {}
    for mesh in meshes:
        if mesh not in boxes:
            try:
                boxes[mesh] = mesh.bounds()
            except ValueError:
                # No face has a finite vertex.
                boxes[mesh] = np.full((2, 3), np.nan)
    return np.array([boxes[mesh] for mesh in meshes])


def place_boxes(boxes: NDArray[np.float64], matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners, (O, 8, 3), of boxes (O, 2, 3) that matrices (O, 3, 4) put somewhere."""
    pick = np.array([[n & 1, n >> 1 & 1, n >> 2 & 1] for n in range(8)])
    corners = boxes[:, pick, np.arange(3)]
    x, y, z = (corners[:, :, k, np.newaxis] for k in range(3))
    m = matrices[:, np.newaxis, :3, :]
    with np.errstate(invalid="ignore", over="ignore"):
        return x * m[..., 0] + y * m[..., 1] + z * m[..., 2] + m[..., 3]


class _Boxes:
    """The boxes around the objects, relative to the eye."""

    def __init__(self, nodes: Sequence[Node], camera: Camera, size: tuple[int, int]) -> None:
        self.eye = camera.eye_position()
        matrices = np.array(matrices_of(nodes))
        matrices[:, :3, 3] -= self.eye
        boxes = mesh_boxes([node.mesh for node in nodes])
        corners = place_boxes(boxes, matrices)
        usable = np.isfinite(corners).all(axis=(1, 2))
        self.corners = corners[usable]
        self.is_flat = (boxes[usable, 0] == boxes[usable, 1]).any(axis=1)
        self.casts = np.array([not is_see_through(node.mesh) for node in nodes])[usable]
        self.is_seen = ~self._are_outside(camera, size)

    def _are_outside(self, camera: Camera, size: tuple[int, int]) -> NDArray[np.bool_]:
        """Tell of each box whether it lies beyond one of the planes of the view volume."""
        view = transforms.compose(camera.view_matrix(), transforms.translate(self.eye))
        matrix = transforms.compose(camera.projection_matrix(size), view)
        x, y, z = (self.corners[..., k] for k in range(3))
        a, b, c, w = (m[0] * x + m[1] * y + m[2] * z + m[3] for m in matrix.tolist())
        beyond = [(side * part > w).all(axis=1) for part in (a, b, c) for side in (1.0, -1.0)]
        return np.logical_or.reduce(beyond)

    def is_reached(self, light: Any) -> bool:
        """Tell whether a light's range reaches a box that may be seen."""
        low, high = self.corners.min(axis=1), self.corners.max(axis=1)
        place = np.array(light.position) - self.eye
        x, y, z = np.maximum(np.maximum(low - place, place - high), 0.0).T / light.range
        return bool((self.is_seen & (x * x + y * y + z * z < 1.0)).any())

    def is_shaded(self, light: Any) -> bool:
        """Tell whether a box may lie between a light and one that may be seen."""
        if self.is_seen.sum() * len(self.corners) > MOST_PAIRS:
            return True
        # What lies between a surface and the light meets the box around both.
        if isinstance(light, DirectionalLight):
            corners = along(axes_of(light.direction), self.corners)
            low, high = corners.min(axis=1), corners.max(axis=1)
            first, last = low.copy(), high
            first[:, 2] = -np.inf
        else:
            place = np.array(light.position) - self.eye
            low, high = self.corners.min(axis=1), self.corners.max(axis=1)
            first, last = np.minimum(low, place), np.maximum(high, place)
        first, last = first[self.is_seen, np.newaxis], last[self.is_seen, np.newaxis]
        meets = ((low <= last) & (high >= first)).all(axis=2) & self.casts
        itself = np.nonzero(self.is_seen)[0]
        meets[np.arange(len(itself)), itself] &= ~self.is_flat[itself]
        return bool(meets.any())


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
        a, b, c = y * r - z * q, z * p - x * r, x * q - y * p
    across = transforms.unit_vector("axis", (a, b, c))
    p, q, r = across.tolist()
    return np.array([across, [y * r - z * q, z * p - x * r, x * q - y * p], [x, y, z]])


def along(axes: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coordinates of points, (..., 3), along three axes."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([x * a + y * b + z * c for a, b, c in axes.tolist()], axis=-1)


def lighting_of(lights: Sequence[Light], camera: Camera, highlights: int) -> Lighting:
    """
    Return the lights as rows, relative to the eye.

    Parameters
    ----------
    lights : sequence of Light
    camera : Camera
    highlights : int
        Number of objects with a specular highlight.
    """
    eye = camera.eye_position().tolist()
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
    )


def _row(light: Light, eye: Sequence[float]) -> list[float]:
    """Return one row of ``Lighting.lights``."""
    color = [part * light.intensity for part in light.color]
    if isinstance(light, DirectionalLight):
        x, y, z = light.direction
        row = [-x, -y, -z, 0.0, *color, *NO_CONE, 0.0]
    else:
        place = [at - origin for at, origin in zip(light.position, eye, strict=True)]
        row = [*place, 1.0, *color, *_cone(light), _ending(light.range)]
    return [max(-FARTHEST_LIGHT, min(FARTHEST_LIGHT, entry)) for entry in row]


def _cone(light: Light) -> tuple[float, float, float, float, float]:
    """Return axis, scale and offset of a light's cone."""
    if not isinstance(light, SpotLight):
        return NO_CONE
    _, inner = transforms.sine_cosine(light.inner_angle)
    _, outer = transforms.sine_cosine(light.outer_angle)
    scale = 1.0 / max(NARROWEST_RAMP, inner - outer)
    return (*light.direction, scale, -outer * scale)


def _ending(end: float | None) -> float:
    """Return one over the square of a range, 0 for none."""
    if end is None:
        return 0.0
    inverse = min(1.0 / end, FARTHEST_LIGHT)
    return inverse * inverse
