"""Outlines: lines along silhouettes, borders of objects, and creases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGBA, ColorLike, rgba
from rasterjit.scene.validation import bounded_number, brief, line_width, one_of, sequence

EdgeKind: TypeAlias = Literal["silhouette", "object", "crease"]
EDGE_KINDS: tuple[EdgeKind, ...] = get_args(EdgeKind)
"""Kinds of edges that an outline may follow."""

HiddenLines: TypeAlias = Literal["none", "dashed"]
HIDDEN_LINES: tuple[HiddenLines, ...] = get_args(HiddenLines)
"""What may be drawn of hidden edges."""

MIN_DASH, MAX_DASH = 1.0, 1024.0
"""Least and largest length of a dash or a gap, pixels."""


@suggests_replace
@dataclass(frozen=True)
class Outline:
    """
    Ask for the edges of shapes to be drawn over the 8-bit colour.

    They are found between pixels, from the nearest faces at their centres, transparent or not. With
    ``Quality(lines="coverage")`` they are smooth, at any number of samples: the line runs along the
    edge itself, and covers the part of each pixel that lies within half a width of it. Else, whole
    pixels beside the edge are drawn. Around points and lines and in holes of masks, a smooth line
    may lie up to half a pixel beside the edge.

    Parameters
    ----------
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as a tuple of linear RGBA. Lines
        are opaque.
    width : float
        Of the lines, pixels, 0.1..64; those that are not smooth are rounded to whole pixels.
    edges : sequence of str
        Which edges. ``"silhouette"``: where a surface ends before a farther one, or before
        nothing. ``"object"``: where two objects meet. ``"crease"``: where two faces of one object
        meet at an angle.
    crease_angle : float
        By how much a crease turns at least, degrees, 0..180; in a plane it is 0.
    hidden : {"none", "dashed"}
        What is drawn of edges that surfaces hide: nothing, or dashes, half as wide and smooth in
        any quality. They are edges of faces: where a surface ends, turns away or bends; not where
        objects or faces pierce each other.
    dash : (float, float)
        Lengths of the dashes of hidden edges and of the gaps between them, pixels, 1..1024. They do
        not follow the width: for wide lines of print say ``dash=(4 * width, 3 * width)``.

    Raises
    ------
    ValueError
        If the colour is not one, the width, the angle or a length is out of range, or an edge or
        what is drawn of hidden ones is unknown.
    """

    color: Converted[ColorLike, RGBA] = Converted("black")
    width: float = 1.0
    edges: Sequence[EdgeKind] = EDGE_KINDS
    crease_angle: float = 40.0
    hidden: HiddenLines = "none"
    dash: Sequence[float] = (5.0, 4.0)

    def __post_init__(self) -> None:
        store(self, color=rgba("color", self.color), edges=_check_edges(self.edges))
        store(self, width=line_width("width", self.width))
        one_of("hidden", self.hidden, HIDDEN_LINES)
        store(self, dash=_check_dash(self.dash))
        store(self, crease_angle=bounded_number("crease_angle", self.crease_angle, 0.0, 180.0))


def _check_dash(value: Sequence[float]) -> tuple[float, float]:
    """Return the lengths of dashes and gaps, pixels, or raise ``ValueError``."""
    lengths = sequence("dash", value)
    if len(lengths) != 2:
        raise ValueError(f"dash must be the lengths of a dash and a gap, got {brief(value)}")
    dash, gap = (
        bounded_number(f"dash[{n}]", length, MIN_DASH, MAX_DASH) for n, length in enumerate(lengths)
    )
    return dash, gap


def _check_edges(value: Sequence[str]) -> tuple[str, ...]:
    """Return kinds of edges without repeats, or raise ``ValueError``."""
    kinds = (value,) if isinstance(value, str) else value
    listed = ", ".join(EDGE_KINDS)
    if not isinstance(kinds, (list, tuple, set, frozenset)) or not kinds:
        raise ValueError(f"edges must name at least one of {listed}; got {value!r}")
    for kind in kinds:
        if kind not in EDGE_KINDS:
            raise ValueError(f"edges has {kind!r}, which is unknown; possible are {listed}")
    return tuple(kind for kind in EDGE_KINDS if kind in kinds)
