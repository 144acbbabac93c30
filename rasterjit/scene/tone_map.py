"""Tone mapping: curves from unbounded linear light to the range of a screen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.validation import bounded_number, one_of

Curve: TypeAlias = Literal["none", "reinhard", "aces", "neutral"]
CURVES: tuple[Curve, ...] = get_args(Curve)
"""Names of the tone curves."""

MAX_STOPS = 126.0
"""Largest exposure either way: float32 holds its power of two, and one over it."""

WHITE_RANGE = 1e-6, 1e12
"""Least and largest white, if it is not infinite: one over its square is finite in float32."""


@suggests_replace
@dataclass(frozen=True)
class ToneMap:
    """
    Map linear colour into 0..1 before it is encoded as sRGB.

    It acts on the output ``"color"`` of surfaces and of an environment seen as background. A
    background that is given as a colour is shown as given, and the output ``"linear"`` stays
    linear in the light of the scene.

    - ``"none"``: the exposure alone; what is above 1 is cut off.
    - ``"reinhard"``: each colour is scaled so that its luminance L becomes
      L (1 + L / white²) / (1 + L). White is the least luminance that becomes 1.
    - ``"aces"``: Stephen Hill's fit of the Academy's reference rendering transform and that for an
      sRGB display.
    - ``"neutral"``: Khronos PBR Neutral, which keeps base colours as they are.

    Parameters
    ----------
    curve : {"neutral", "aces", "reinhard", "none"}
        Name of the tone curve, applied to exposed light; ``"none"`` without exposure changes
        nothing.
    exposure : float, stops
        Light is multiplied by 2**exposure first; in -126..126.
    white : float, linear
        Luminance that becomes white; ``inf`` leaves everything below it. Curve reinhard alone.

    Raises
    ------
    ValueError
        If the curve is unknown, the exposure is not in -126..126, or ``white`` is neither inf nor
        in 1e-6..1e12 or is given for another curve.

    References
    ----------
    .. [1] E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, "Photographic Tone Reproduction for
       Digital Images", SIGGRAPH 2002, equation 4.
    .. [2] S. Hill, "ACES fitted", in M. Pettineo's BakingLab, 2016.
    .. [3] The Khronos Group, "Khronos PBR Neutral Tone Mapper", 2024.
    """

    curve: Curve = "neutral"
    exposure: float = 0.0
    white: float = math.inf

    def __post_init__(self) -> None:
        one_of("curve", self.curve, CURVES)
        store(self, exposure=bounded_number("exposure", self.exposure, -MAX_STOPS, MAX_STOPS))
        if not (isinstance(self.white, float) and self.white == math.inf):
            if self.curve != "reinhard":
                raise ValueError(f"white must be inf for curve {self.curve!r}, got {self.white!r}")
            store(self, white=bounded_number("white", self.white, *WHITE_RANGE))

    @property
    def is_neutral(self) -> bool:
        """Whether it changes nothing."""
        return self.curve == "none" and self.exposure == 0.0
