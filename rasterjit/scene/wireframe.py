"""Wireframes: the edges of all faces, drawn over the faces or alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGBA, ColorLike, rgba
from rasterjit.scene.validation import line_width, one_of

WireframeMode: TypeAlias = Literal["overlay", "only"]
WIREFRAME_MODES: tuple[WireframeMode, ...] = get_args(WireframeMode)
"""Lines over the faces, or lines alone."""


@suggests_replace
@dataclass(frozen=True)
class Wireframe:
    """
    Ask for the edges of every face to be drawn, over the 8-bit colour.

    Lines are one pixel wide, by Bresenham between the pixels that hold the vertices, or smooth with
    ``Quality(lines="coverage")``; more samples do not change them. Lines of any other width are
    smooth in any quality. No other output than ``"color"`` shows them.

    Parameters
    ----------
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as a tuple of four floats, linear
        RGBA. Lines are opaque: its alpha is not read.
    mode : {"overlay", "only"}
        ``"overlay"`` draws the visible edges over the shaded faces, where any nearer face hides an
        edge, transparent or not; ``"only"`` draws every edge and no face.
    width : float
        Of the lines, pixels, 0.1..64.

    Raises
    ------
    ValueError
        If the colour is not one, the mode is unknown or the width is out of range.
    """

    color: Converted[ColorLike, RGBA] = Converted("black")
    mode: WireframeMode = "overlay"
    width: float = 1.0

    def __post_init__(self) -> None:
        one_of("mode", self.mode, WIREFRAME_MODES)
        store(self, color=rgba("color", self.color))
        store(self, width=line_width("width", self.width))
