"""Eye-dome lighting: darken pixels that lie behind their neighbours on the screen."""

from __future__ import annotations

from dataclasses import dataclass

from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.validation import bounded_number

MAX_STRENGTH = 1000.0
"""Largest strength: a step of a thousandth of the depth is black."""

MAX_RADIUS = 64.0
"""Largest radius, pixels."""


@suggests_replace
@dataclass(frozen=True)
class EyeDome:
    """
    Ask for shading by depth alone, which needs neither lights nor normals: of point clouds [1]_.

    A pixel looks at the 8 pixels around it at a radius. Its light, lit or not, is multiplied by
    ``exp(-300 strength m)``, in which ``m`` is the mean over the 8 of
    ``max(0, log2(depth) - log2(depth there))``: what lies behind a neighbour is darkened, edges
    and slopes most, and the nearer of two stays as it is. Depths are distances from the eye along
    the viewing axis. That is the usual form, with the usual factor of 300 [2]_; there codes are
    multiplied, here light, which shows less of it: 0.4 there looks like 1 here.

    A parallel projection has no eye. There ``log2(depth) - log2(depth there)`` is
    ``(depth - depth there) / (D ln 2)`` with ``D = height / (2 tan(45°/2))``, in scene units: the
    distance from which a camera with a field of view of 45 degrees sees the height of the picture.
    So neither the place of the camera along its axis nor the scale of the scene counts.

    The background is neither darkened nor does it darken, nor do pixels beyond the picture's edge:
    they count as 0 among the 8. A pixel has one share, that of the nearest surface at its centre,
    transparent or not: whatever else it shows gets the same, and fog lies over it. Both colour and
    linear show it.

    Parameters
    ----------
    strength : float
        From 0, which changes nothing, to 1000.
    radius : float, pixels
        How far away the neighbours are, 1..64. They lie to the left and right, above and below,
        and on the diagonals at the same distance, all rounded to whole pixels: from 1 to 1.49 the
        8 pixels around.

    Raises
    ------
    ValueError
        If one of them is out of range.

    References
    ----------
    .. [1] C. Boucheny, "Visualisation scientifique de grands volumes de données : pour une approche
       perceptive", thesis, Université Joseph Fourier, Grenoble, 2009.
    .. [2] M. Schütz, "Potree: Rendering Large Point Clouds in Web Browsers", thesis, TU Wien, 2016.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/teapot.obj")
    >>> scene.eye_dome = rj.EyeDome(strength=0.5)
    """

    strength: float = 1.0
    radius: float = 1.4

    def __post_init__(self) -> None:
        store(self, strength=bounded_number("strength", self.strength, 0.0, MAX_STRENGTH))
        store(self, radius=bounded_number("radius", self.radius, 1.0, MAX_RADIUS))
