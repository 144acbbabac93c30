"""Lights of a scene; the renderer adds a headlight if there are none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from numpy.typing import ArrayLike

from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGB, ColorLike, rgb
from rasterjit.scene.validation import VectorLike, bounded_number, one_of, positive_number, triple

Vector: TypeAlias = tuple[float, float, float]
"""Three floats: a world-space position, a unit direction, or linear RGB."""

ShadowFilter: TypeAlias = Literal["hard", "pcf", "soft"]
SHADOW_FILTERS: tuple[ShadowFilter, ...] = get_args(ShadowFilter)
"""Ways of reading a shadow map."""

MIN_MAP_SIZE, MAX_MAP_SIZE = 16, 8192
"""Limits of the side of a shadow map, texels."""

MAX_MAP_TEXELS = 1 << 30
"""Most texels of all shadow maps of a frame together, 4 bytes each."""

MAX_BIAS = 100.0
"""Largest bias, texels: beyond it nothing of a shadow would be left where things touch."""

MAX_SUN_ANGLE = 90.0
"""Largest angle that a light infinitely far away is seen under, degrees."""


@suggests_replace
@dataclass(frozen=True)
class Shadow:
    """
    Shadows of a light, cast by a depth map.

    The map is fitted to what the camera sees and what can cast a shadow there. A point light has up
    to six, one for each side of a cube. What is blended casts no shadow,
    unless its alpha is 1 all over.

    Parameters
    ----------
    size : int, texels
        Side of the map, 16..8192. Doubling it halves the steps of a shadow's edge and takes four
        times the memory. All maps of a frame have at most 2**30 texels together, of 4 bytes each
        (4.3 GB): sixteen of 8192, six for each point light. Rendering raises ``ValueError`` for
        more.
    filter : {"pcf", "hard", "soft"}
        ``"hard"``: one comparison, edges in steps of a texel. ``"pcf"``: 3 x 3 comparisons, each
        between four texels by their weight (percentage-closer filtering), an edge three texels
        wide. ``"soft"``: the penumbra of a light that is as large as ``light_size`` says
        (percentage-closer soft shadows): narrow at contact, wider with distance.
    light_size : float, optional
        For ``"soft"`` only, and needed there, above 0. Diameter of a point or spot light, scene
        units; the angle that a directional light is seen under, degrees (the sun: 0.53).
    bias : float, texels
        How far in front of a surface something must lie to cast a shadow on it, 0..100, in texels
        of the map along the light times one plus the slope of the surface to the light (of which 8
        counts at most). Each comparison is with the surface's own plane, so little is needed: more
        hides the steps of coarse curved surfaces, and moves the shadow away from what casts it.

    Raises
    ------
    ValueError
        If the size, the filter or the bias is not one of these, or ``light_size`` is absent where
        it is needed or given where it is not.

    References
    ----------
    .. [1] L. Williams, "Casting Curved Shadows on Curved Surfaces", SIGGRAPH 1978.
    .. [2] W. Reeves, D. Salesin, R. Cook, "Rendering Antialiased Shadows with Depth Maps",
       SIGGRAPH 1987.
    .. [3] R. Fernando, "Percentage-Closer Soft Shadows", SIGGRAPH 2005 sketches.
    """

    size: int = 1024
    filter: ShadowFilter = "pcf"
    light_size: float | None = None
    bias: float = 0.5

    def __post_init__(self) -> None:
        one_of("filter", self.filter, SHADOW_FILTERS)
        size = bounded_number("size", self.size, MIN_MAP_SIZE, MAX_MAP_SIZE)
        if size != int(size) or isinstance(self.size, bool):
            raise ValueError(f"size must be a whole number of texels, got {self.size!r}")
        store(self, size=int(size))
        store(self, bias=bounded_number("bias", self.bias, 0.0, MAX_BIAS))
        if self.filter == "soft":
            if self.light_size is None:
                raise ValueError("light_size must be above 0 where filter is 'soft', got None")
            store(self, light_size=positive_number("light_size", self.light_size))
        elif self.light_size is not None:
            raise ValueError(
                f"light_size must be None where filter is {self.filter!r}, got {self.light_size!r}"
            )


@suggests_replace
@dataclass(frozen=True)
class AmbientLight:
    """
    Light that reaches every surface alike.

    Parameters
    ----------
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as linear RGB, alpha dropped.
    intensity : float
        Factor on the colour, at least 0.

    Raises
    ------
    ValueError
        If the colour is not one, or the intensity is not in 0..1e30.
    """

    color: Converted[ColorLike, RGB] = Converted("white")
    intensity: float = 0.1

    def __post_init__(self) -> None:
        _check_color_and_intensity(self)


@suggests_replace
@dataclass(frozen=True)
class DirectionalLight:
    """
    Light from infinitely far away, as from the sun.

    Parameters
    ----------
    direction : (3,) array_like
        World-space direction in which the light travels; stored with unit length.
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as linear RGB, alpha dropped.
    intensity : float
        Factor on the colour, at least 0. A white surface facing a white light of intensity 1 is
        white.
    shadow : Shadow, optional
        Default: it casts none.

    Raises
    ------
    ValueError
        If the direction is zero or not finite, the colour is not one, the intensity is not in
        0..1e30, or the shadow is none or has a ``light_size`` above 90 degrees.
    """

    direction: VectorLike = (0.0, 0.0, -1.0)
    color: Converted[ColorLike, RGB] = Converted("white")
    intensity: float = 1.0
    shadow: Shadow | None = None

    def __post_init__(self) -> None:
        store(self, direction=unit_vector("direction", self.direction))
        _check_color_and_intensity(self)
        _check_shadow(self)
        if self.shadow is not None and self.shadow.light_size is not None:
            bounded_number("shadow.light_size", self.shadow.light_size, 0.0, MAX_SUN_ANGLE)


@suggests_replace
@dataclass(frozen=True)
class PointLight:
    """
    Light from one point in all directions, falling off with the square of the distance.

    Parameters
    ----------
    position : (3,) array_like
        World-space position, in scene units.
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as linear RGB, alpha dropped.
    intensity : float
        Factor on the colour at a distance of one scene unit, at least 0; at distance d it is
        ``intensity / d**2``.
    range : float, optional, scene units
        Where the light ends, above 0: it is multiplied by ``1 - (d / range)**4``, at least 0.
        Default: it has no end.
    shadow : Shadow, optional
        Default: it casts none.

    Raises
    ------
    ValueError
        If the position is not finite, the colour is not one, the intensity is not in 0..1e30, the
        range is not above 0, or the shadow is none.

    References
    ----------
    glTF 2.0 extension KHR_lights_punctual.
    """

    position: VectorLike
    color: Converted[ColorLike, RGB] = Converted("white")
    intensity: float = 1.0
    range: float | None = None
    shadow: Shadow | None = None

    def __post_init__(self) -> None:
        store(self, position=triple("position", self.position))
        _check_color_and_intensity(self)
        _check_range(self)
        _check_shadow(self)


@suggests_replace
@dataclass(frozen=True)
class SpotLight:
    """
    Light from one point into a cone, falling off with the square of the distance.

    Parameters
    ----------
    position : (3,) array_like
        World-space position, in scene units.
    direction : (3,) array_like
        World-space direction of the cone's axis, away from the light; stored with unit length.
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as linear RGB, alpha dropped.
    intensity : float
        Factor on the colour on the axis at a distance of one scene unit, at least 0; at distance d
        it is ``intensity / d**2``.
    inner_angle, outer_angle : float, degrees
        Angles from the axis, ``0 <= inner <= outer <= 90`` and outer above 0: full light inside
        the inner one, none outside the outer one, between them the square of a ramp in the cosine.
        Beams narrower than 5e-5 degrees are as wide as that.
    range : float, optional, scene units
        Where the light ends, as for `PointLight`.
    shadow : Shadow, optional
        Default: it casts none.

    Raises
    ------
    ValueError
        If the position or direction is not finite or the direction is zero, the colour is not one,
        the intensity is not in 0..1e30, an angle is out of bounds, the inner angle is above the
        outer one, the range is not above 0, or the shadow is none.

    References
    ----------
    glTF 2.0 extension KHR_lights_punctual, its angles in degrees.
    """

    position: VectorLike
    direction: VectorLike = (0.0, 0.0, -1.0)
    color: Converted[ColorLike, RGB] = Converted("white")
    intensity: float = 1.0
    inner_angle: float = 0.0
    outer_angle: float = 45.0
    range: float | None = None
    shadow: Shadow | None = None

    def __post_init__(self) -> None:
        store(self, position=triple("position", self.position))
        store(self, direction=unit_vector("direction", self.direction))
        _check_color_and_intensity(self)
        inner = bounded_number("inner_angle", self.inner_angle, 0.0, MAX_CONE_ANGLE)
        outer = bounded_number("outer_angle", self.outer_angle, 0.0, MAX_CONE_ANGLE)
        if outer == 0.0:
            raise ValueError(f"outer_angle must be above 0, got {self.outer_angle!r}")
        if inner > outer:
            raise ValueError(
                "inner_angle must be at most outer_angle, got inner_angle "
                f"{self.inner_angle!r} and outer_angle {self.outer_angle!r}"
            )
        store(self, inner_angle=inner, outer_angle=outer)
        _check_range(self)
        _check_shadow(self)


MAX_CONE_ANGLE = 90.0
"""Largest angle of a spot light from its axis, degrees."""

MAX_RADIANCE = 1e30
"""Largest intensity, radiance and emission: products with a surface and its highlight, and sums of
some, stay finite in float32."""

Light: TypeAlias = AmbientLight | DirectionalLight | PointLight | SpotLight
"""Any light a scene takes."""


def _check_color_and_intensity(light: Any) -> None:
    """Store the light's colour as linear RGB and its intensity as a float at least 0."""
    store(light, color=rgb("color", light.color))
    store(light, intensity=bounded_number("intensity", light.intensity, 0.0, MAX_RADIANCE))


def _check_range(light: Any) -> None:
    """Store the light's range as a float above 0, or ``None``."""
    if light.range is not None:
        store(light, range=positive_number("range", light.range))


def _check_shadow(light: Any) -> None:
    """Raise ``ValueError`` if the light's shadow is something else."""
    if light.shadow is not None and not isinstance(light.shadow, Shadow):
        raise ValueError(f"shadow must be a Shadow or None, got {light.shadow!r}")


def unit_vector(name: str, value: ArrayLike) -> Vector:
    """Return ``value`` scaled to unit length, or raise ``ValueError`` if it has none."""
    x, y, z = triple(name, value)
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0.0:
        raise ValueError(f"{name} must not be the zero vector, got {value!r}")
    # Scale first: squares of very long or very short vectors overflow or vanish.
    x, y, z = x / largest, y / largest, z / largest
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)
