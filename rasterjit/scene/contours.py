"""Contours: lines along which a scalar field has one value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGBA, ColorLike, rgba

MAX_LEVELS = 4096
"""Most lines of one mesh, if their number is given."""

ContoursLike: TypeAlias = "int | ArrayLike | Contours"
"""How many lines, their values, or `Contours`."""


@suggests_replace
@dataclass(frozen=True)
class Contours:
    """
    Ask for the iso-lines of a mesh's scalars, in the place of the colours of its map.

    A line is straight within a face, under perspective too. It shows the pixels whose centre is at
    most half a width from it, measured on the screen, and exactly half a width on one side alone. A
    face of three equal scalars has no line. Lines are surfaces: lit, multiplied by ``base_color``
    and hidden as these are, in no other output than colours. Like all colours they are found once a
    pixel and face: 2 to 16 samples smooth the borders of faces, 64 and 256 lines too.

    Parameters
    ----------
    levels : int or (N,) array_like
        Their values; or how many lie inside the range, at equal steps from its ends and each other.
        A range without width has none inside.
    width : float
        Pixels, above zero. From 1 on, lines have no gaps within a face.
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as a tuple of four floats, linear
        RGBA. Lines are opaque: its alpha is not read.

    Raises
    ------
    ValueError
        If the levels are not 1 to 4096 in number or finite values, the width is not above zero, or
        the colour is not one.
    """

    levels: Any = 10
    width: float = 1.0
    color: Converted[ColorLike, RGBA] = Converted("black")

    def __post_init__(self) -> None:
        store(self, levels=_check_levels(self.levels), color=rgba("color", self.color))
        store(self, width=check.positive_number("width", self.width))

    def level_values(self, low: float, high: float) -> NDArray[np.float64]:
        """Return the values of the lines, ascending, (N,), given the range."""
        low, high = check.finite_number("low", low), check.finite_number("high", high)
        if not isinstance(self.levels, int):
            return np.unique(np.array(self.levels, np.float64))
        inside = low + (high - low) * (np.arange(1, self.levels + 1) / (self.levels + 1))
        return np.unique(inside[(inside > low) & (inside < high)])


def read_contours(value: ContoursLike) -> Contours:
    """Return `Contours`, converting a number of lines or their values."""
    return value if isinstance(value, Contours) else Contours(value)


def _check_levels(value: Any) -> int | tuple[float, ...]:
    """Return a number of levels, or their values, or raise ``ValueError``."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        if not 1 <= value <= MAX_LEVELS:
            raise ValueError(f"contours.levels must be 1 to {MAX_LEVELS} in number, got {value}")
        return int(value)
    if isinstance(value, (bool, float, str)) or value is None:
        raise ValueError(
            f"contours.levels must be a whole number or values, got {check.short_repr(value)}"
        )
    values = check.finite_array("contours.levels", value, (None,))
    if not len(values):
        raise ValueError(f"contours.levels must be one or more values, got {check.brief(value)}")
    return tuple(values.tolist())
