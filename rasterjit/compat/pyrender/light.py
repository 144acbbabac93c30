"""Lights: they shine along the -z of their node."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import light
from rasterjit.scene.validation import bounded_number, finite_array, positive_number

BRIGHTEST = 1e6


class Light:
    """
    What all lights have.

    Parameters
    ----------
    color : (3,) array_like, optional
        Linear RGB; default white.
    intensity : float, optional
        Factor on the colour; default 1. A white diffuse surface that faces a directional light of
        pi is white.
    name : str, optional

    Raises
    ------
    ValueError
        If the colour or the intensity is out of range.
    """

    def __init__(
        self,
        color: ArrayLike | None = None,
        intensity: float | None = None,
        name: str | None = None,
    ) -> None:
        self.color = np.ones(3) if color is None else color
        self.intensity = 1.0 if intensity is None else intensity
        self.name = name

    @property
    def color(self) -> NDArray[np.float64]:
        """(3,) float64: linear RGB."""
        return self._color

    @color.setter
    def color(self, value: ArrayLike) -> None:
        color = finite_array("color", np.atleast_1d(value)[:3], (3,))
        if color.min() < 0.0:
            raise ValueError(f"color must be at least 0, got {color.tolist()}")
        self._color = color

    @property
    def intensity(self) -> float:
        """Factor on the colour."""
        return self._intensity

    @intensity.setter
    def intensity(self, value: float) -> None:
        self._intensity = bounded_number("intensity", value, 0.0, BRIGHTEST)

    def placed(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `radiance`."""
        raise NotImplementedError(f"{type(self).__name__} shines nowhere")

    @property
    def radiance(self) -> NDArray[np.float64]:
        """(3,) float64: colour times intensity."""
        return self.color * self.intensity


class DirectionalLight(Light):
    """Light from infinitely far away; takes what `Light` takes."""

    def placed(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `radiance`."""
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
        self.range = None if range is None else positive_number("range", range)

    def placed(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `radiance`."""
        return light.PointLight(pose[:3, 3], shadow=shadow)


class SpotLight(PointLight):
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
        super().__init__(color, intensity, range, name)
        self.outerConeAngle = bounded_number("outerConeAngle", outerConeAngle, 0.0, math.pi / 2.0)
        self.innerConeAngle = bounded_number("innerConeAngle", innerConeAngle, 0.0, outerConeAngle)

    def placed(self, pose: NDArray[np.float64], shadow: light.Shadow | None) -> light.Light:
        """Return the light at a node's pose, of brightness 1: see `radiance`."""
        return light.SpotLight(
            pose[:3, 3],
            -pose[:3, 2],
            inner_angle=math.degrees(self.innerConeAngle),
            outer_angle=min(math.degrees(self.outerConeAngle), light.WIDEST_CONE),
            shadow=shadow,
        )
