"""Lights: what shines, in linear light; a scene without any gets a headlight from the renderer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

from numpy.typing import ArrayLike

from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.validation import bounded_number, triple

Vector: TypeAlias = tuple[float, float, float]
"""Three floats: a world-space position, a unit direction, or linear RGB."""


@dataclass(frozen=True)
class AmbientLight:
    """
    Light that reaches every surface alike.

    Parameters
    ----------
    color : str or array_like
        Any colour of `rasterjit.scene.color.linear_color`; stored as linear RGB, alpha dropped.
    intensity : float
        Factor on the colour, at least 0.

    Raises
    ------
    ValueError
        If the colour is not one, or the intensity is not in 0..1e9.
    """

    color: ColorLike = "white"
    intensity: float = 0.1

    def __post_init__(self) -> None:
        _check_color_and_intensity(self)


@dataclass(frozen=True)
class DirectionalLight:
    """
    Light from infinitely far away, as from the sun.

    Parameters
    ----------
    direction : (3,) array_like
        World-space direction in which the light travels; stored with unit length.
    color : str or array_like
        Any colour of `rasterjit.scene.color.linear_color`; stored as linear RGB, alpha dropped.
    intensity : float
        Factor on the colour, at least 0. A white surface facing a white light of intensity 1 is
        white.

    Raises
    ------
    ValueError
        If the direction is zero or not finite, the colour is not one, or the intensity is not in
        0..1e9.
    """

    direction: ArrayLike = (0.0, 0.0, -1.0)
    color: ColorLike = "white"
    intensity: float = 1.0

    def __post_init__(self) -> None:
        _store(self, "direction", _unit_vector("direction", self.direction))
        _check_color_and_intensity(self)


@dataclass(frozen=True)
class PointLight:
    """
    Light from one point in all directions, falling off with the square of the distance.

    Parameters
    ----------
    position : (3,) array_like
        World-space position, in scene units.
    color : str or array_like
        Any colour of `rasterjit.scene.color.linear_color`; stored as linear RGB, alpha dropped.
    intensity : float
        Factor on the colour at a distance of one scene unit, at least 0; at distance d it is
        ``intensity / d**2``.

    Raises
    ------
    ValueError
        If the position is not finite, the colour is not one, or the intensity is not in
        0..1e9.

    References
    ----------
    glTF 2.0 extension KHR_lights_punctual, range property absent.
    """

    position: ArrayLike
    color: ColorLike = "white"
    intensity: float = 1.0

    def __post_init__(self) -> None:
        _store(self, "position", triple("position", self.position))
        _check_color_and_intensity(self)


BRIGHTEST = 1e9
"""Largest intensity: products of a light, a surface and a falloff stay finite in float32."""

Light: TypeAlias = AmbientLight | DirectionalLight | PointLight
"""Any light a scene takes."""


def _check_color_and_intensity(light: Any) -> None:
    """Store the light's colour as linear RGB and its intensity as a float at least 0."""
    _store(light, "color", tuple(linear_color("color", light.color)[:3].tolist()))
    _store(light, "intensity", bounded_number("intensity", light.intensity, 0.0, BRIGHTEST))


def _unit_vector(name: str, value: ArrayLike) -> Vector:
    """Return ``value`` scaled to unit length, or raise ``ValueError`` if it has none."""
    x, y, z = triple(name, value)
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0.0:
        raise ValueError(f"{name} must not be the zero vector, got {value!r}")
    # Scale first: squares of very long or very short vectors overflow or vanish.
    x, y, z = x / largest, y / largest, z / largest
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)


def _store(light: Any, field: str, value: Any) -> None:
    """Set a field of a frozen dataclass while it is being made."""
    object.__setattr__(light, field, value)
