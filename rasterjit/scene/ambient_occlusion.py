"""Ambient occlusion: dim ambient light in corners, in screen space."""

from __future__ import annotations

from dataclasses import dataclass

from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.validation import bounded_number, positive_number

DEFAULT_RADIUS_RATIO = 0.15
"""Default radius, over the radius of the scene's bounding sphere."""


@suggests_replace
@dataclass(frozen=True)
class AmbientOcclusion:
    """
    Dim ambient light where near surfaces occlude it.

    It is computed in screen space, from the depth and the faces that are seen: what the camera does
    not see occludes nothing. It dims ambient light and the light of an environment alone; scenes
    without them, and objects that are lit at their vertices (Gouraud), do not change. A pixel has
    one value, that of the nearest surface at its centre, transparent or not; all surfaces that the
    pixel shows are dimmed by it.

    Parameters
    ----------
    radius : float, scene units, optional
        Largest distance of an occluding surface. Default: 0.15 times the radius of the scene's
        bounding sphere.
    strength : float
        How much occluded light is dimmed: 0..1, where 0 changes nothing.

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
