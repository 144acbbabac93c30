"""Turn the lights of a scene into the rows that kernels read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rasterjit import transforms
from rasterjit.kernels.lighting import LIGHT_COLUMNS
from rasterjit.kernels.records import Lighting
from rasterjit.scene.camera import Camera
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, SpotLight

FARTHEST_LIGHT = 1e18
"""Coordinates of a light relative to the eye are held within it: their squares stay finite in
float32, and no light of an allowed intensity is seen from there."""

NARROWEST_RAMP = 0.001
"""Least difference of the cosines between which the light of a cone ends, by KHR_lights_punctual:
the edge of a cone whose angles are the same is no step."""

NO_CONE = (0.0, 0.0, 0.0, 0.0, 1.0)
"""Axis, scale and offset of light that goes all ways."""


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
