"""Lights: they shine along the -z of their node."""

from __future__ import annotations

import abc
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender import fields
from rasterjit.compat.pyrender.fields import Field, OwnedField
from rasterjit.compat.pyrender.utils import format_color_vector
from rasterjit.scene import light

_MAX_ANGLE = math.pi / 2.0 + 1e-9
"""Of cones, radians: rounding errors of a right angle are taken."""


class Light(abc.ABC):
    """
    What all lights have.

    Parameters
    ----------
    color : float or (3,) array_like, optional
        Linear RGB, whole numbers are shares of 255; default white.
    intensity : float, optional
        Factor on the colour; default 1.
    name : str, optional

    Raises
    ------
    TypeError, ValueError
        If the colour is none, or the intensity no number.
    """

    def __init__(
        self,
        color: ArrayLike | None = None,
        intensity: float | None = None,
        name: str | None = None,
    ) -> None:
        self.name = name
        self.color = np.ones(3) if color is None else color
        self.intensity = 1.0 if intensity is None else intensity
        self.shadow_texture = None

    name = Field(fields.to_text_or_none, "str or None: the light's name.")
    color = Field(lambda value: format_color_vector(value, 3), "(3,) float32: linear RGB.")
    intensity = Field(fields.to_number, "float: factor on the colour.")
    shadow_texture = Field(
        fields.keep_any, "As it was set, and without effect: shadow maps are not kept."
    )

    @abc.abstractmethod
    def convert(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `Light.radiance`."""

    @property
    def radiance(self) -> NDArray[np.float64]:
        """(3,) float64: colour times intensity."""
        return self.color * self.intensity


class DirectionalLight(Light):
    """Light from infinitely far away; takes what `Light` takes."""

    def convert(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `Light.radiance`."""
        return light.DirectionalLight(-pose[:3, 2], shadow=shadow)


class PointLight(Light):
    """
    Light from a point, falling off with the square of the distance.

    Parameters
    ----------
    color, intensity, name
        As `Light` takes them.
    range : float, optional, scene units
        Kept, and not applied, as in pyrender.
    """

    def __init__(
        self,
        color: ArrayLike | None = None,
        intensity: float | None = None,
        range: float | None = None,
        name: str | None = None,
    ) -> None:
        super().__init__(color, intensity, name)
        self.range = range

    range = Field(fields.to_positive_or_none, "float or None: a distance in scene units; kept.")

    def convert(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `Light.radiance`."""
        return light.PointLight(pose[:3, 3], shadow=shadow)


class SpotLight(Light):
    """
    Light from a point into a cone.

    Parameters
    ----------
    color, intensity, range, name
        As `PointLight` takes them.
    innerConeAngle, outerConeAngle : float, radians
        From the axis: where the light begins to fall off, and where it ends, at most pi / 2.

    Raises
    ------
    ValueError
        If an angle is out of range.
    """

    def __init__(
        self,
        color: ArrayLike | None = None,
        intensity: float | None = None,
        range: float | None = None,
        innerConeAngle: float = 0.0,
        outerConeAngle: float = math.pi / 4.0,
        name: str | None = None,
    ) -> None:
        super().__init__(color, intensity, name)
        self.outerConeAngle = outerConeAngle
        self.innerConeAngle = innerConeAngle
        self.range = range

    range = Field(fields.to_positive_or_none, "float or None: a distance in scene units; kept.")

    outerConeAngle = Field(
        lambda value: _check_angle(value, _MAX_ANGLE),
        "float: angle from the axis where it ends, radians.",
    )
    innerConeAngle = OwnedField(
        lambda light, value: _check_angle(value, light.outerConeAngle),
        "float: angle from the axis where the light begins to fall off, radians.",
    )

    def convert(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `Light.radiance`."""
        return light.SpotLight(
            pose[:3, 3],
            -pose[:3, 2],
            inner_angle=math.degrees(self.innerConeAngle),
            outer_angle=min(math.degrees(self.outerConeAngle), light.MAX_CONE_ANGLE),
            shadow=shadow,
        )


def _check_angle(value: float, most: float) -> float:
    """Return an angle in 0..most, radians, or raise ``ValueError``."""
    angle = fields.to_number(value)
    if not 0.0 <= angle <= most:
        raise ValueError(f"must be in 0..{most:g} radians, got {angle:g}")
    return angle
