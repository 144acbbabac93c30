"""Ambient occlusion: dim ambient light in corners."""

from __future__ import annotations

from dataclasses import dataclass

from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.validation import bounded_number, positive_number

DEFAULT_RADIUS_RATIO = 0.15
"""Default radius, as a share of the radius of a sphere around the scene."""


@suggests_replace
@dataclass(frozen=True)
class AmbientOcclusion:
    """
    Dim ambient light where near surfaces occlude it.

    It is found on the screen, from the depth and the faces that are seen: what the camera does not
    see occludes nothing. It dims ambient light and the light of an environment, no other; a scene
    without either is not changed by it, nor are objects that are lit at their vertices (Gouraud).
    A pixel has one share, that of the nearest surface at its centre, transparent or not: whatever
    else it shows gets the same.

    Parameters
    ----------
    radius : float, scene units, optional
        How far away something still occludes. Default: 0.15 times the radius of a sphere around
        the scene.
    strength : float
        From 0, which changes nothing, to 1.

    Raises
    ------
    ValueError
        If the radius is not above 0 or the strength is not in 0..1.
    """

    radius: float | None = None
    strength: float = 1.0

    def __post_init__(self) -> None:
        if self.radius is not None:
            store(self, radius=positive_number("radius", self.radius))
        store(self, strength=bounded_number("strength", self.strength, 0.0, 1.0))
