"""Labels: text that stands at a point of a scene, in pixels."""

from __future__ import annotations

import os
import unicodedata
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGBA, ColorLike, rgba
from rasterjit.scene.validation import VectorLike

Anchor: TypeAlias = Literal[
    "center", "left", "right", "top", "bottom",
    "top-left", "top-right", "bottom-left", "bottom-right",
]  # fmt: skip
ANCHORS: tuple[Anchor, ...] = get_args(Anchor)
"""Points of a text that may lie at its position."""

MAX_FONT_SIZE = 512.0
"""Largest size of a font, pixels."""

MAX_CHARACTERS = 1000
"""Most characters of a text."""

MAX_OFFSET = 65536.0
"""Largest offset of a text from its position, pixels."""


@suggests_replace
@dataclass(frozen=True)
class Label:
    """
    A text at a point, drawn over the finished picture.

    ``scene.add(label)`` makes a node that carries it, and moves with its parents; a node that has
    a mesh may carry one as well (``node.label = label``). It is part of the output ``"color"``
    alone: numbers, depth, coverage and ``"linear"`` know nothing of it, and cameras are not fitted
    to it; a scene of labels alone cannot be rendered. It is as large as the finished picture's
    pixels, however many samples these have, and upright under any lens.

    The font is Aileron Regular, which Pillow brings: the characters of ASCII and a few more.
    Others come from the first font that has them: DejaVu Sans, which Matplotlib brings, then those
    of the system; what no font has is an empty box, with a warning. Outlines are drawn without
    hints, kerned, by the area that they cover, in the package itself: pixels follow from the font
    alone, on every machine that has it. Texts are moved to whole pixels, and each character to
    quarters of one; they run from left to right, without the ligatures of Arabic or Indic scripts.

    Parameters
    ----------
    position : (3,) array_like
        Model space of its node, in scene units: world space, if that stands at the origin. Nothing
        is drawn where it is behind the camera, or where the lens sees nothing.
    text : str
        With line breaks between its lines; up to 1000 characters, no other control characters but
        tabs.
    size : float
        Of an em, about a line's height, pixels of the finished picture; above 0, at most 512.
    anchor : str
        The point of the text that lies at the position: ``"center"``, ``"left"``, ``"right"``,
        ``"top"``, ``"bottom"``, ``"top-left"``, ``"top-right"``, ``"bottom-left"`` or
        ``"bottom-right"``. With ``"left"`` the text begins there, and runs to the right. Its lines
        begin below each other, end so, or have one middle, as it says.
    color : colour
        Of the text; with its alpha.
    background : colour, optional
        Of a box behind the text, a quarter of ``size`` larger on each side; with its alpha.
    hidden : bool
        Whether what is in front of the position hides the text: all of it, where the nearest
        surface at the position's pixel, see-through or not, is nearer by more than a pixel is wide
        there; and where the position is out of the picture. Else nothing hides it. Of points and
        lines, their centres and their farther ends count.
    offset : (float, float)
        How far the text is moved to the right and down, pixels.
    font : str or path, optional
        A font file (.ttf, .ttc; .otf with fontTools installed), or the name of a font that
        Matplotlib brings or the system has, such as ``"DejaVu Serif"``. One that is not there is an
        error when the label is drawn.

    Raises
    ------
    ValueError
        If the position is not three finite numbers, the text empty, too long or with control
        characters, the size not above 0 or too large, the anchor unknown, or a colour is none.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/teapot.obj")
    >>> node = scene.add(rj.Label((0.0, 3.15, 0.0), "lid", anchor="bottom"), name="lid")
    >>> node
    Node('lid', 0 children, label 'lid')
    """

    position: VectorLike
    text: str
    size: float = 14.0
    anchor: Anchor = "center"
    color: Converted[ColorLike, RGBA] = Converted("black")
    background: Converted[ColorLike | None, RGBA | None] = Converted(None)
    hidden: bool = False
    offset: tuple[float, float] = (0.0, 0.0)
    font: str | os.PathLike[str] | None = None

    def __post_init__(self) -> None:
        store(self, position=check.triple("position", self.position))
        store(self, text=_check_text(self.text), size=_check_size(self.size))
        store(self, anchor=check.one_of("anchor", self.anchor, ANCHORS))
        store(self, color=rgba("color", self.color))
        store(self, hidden=check.boolean("hidden", self.hidden))
        store(self, offset=_check_offset(self.offset), font=_check_font(self.font))
        if self.background is not None:
            store(self, background=rgba("background", self.background))


def check_label(value: Any) -> Label | None:
    """Return a label or None, or raise ``ValueError``."""
    if value is not None and not isinstance(value, Label):
        raise ValueError(f"label must be a Label or None, got {check.brief(value)}")
    return value


def _check_text(value: Any) -> str:
    """Return a text, or raise ``ValueError``."""
    if not isinstance(value, str):
        raise ValueError(f"text must be a string, got {check.brief(value)}")
    if not value.strip():
        raise ValueError(f"text must have a character that is seen, got {check.short_repr(value)}")
    if len(value) > MAX_CHARACTERS:
        raise ValueError(f"text must have at most {MAX_CHARACTERS} characters, got {len(value)}")
    for character in value:
        if character not in "\n\t" and _is_control(character):
            raise ValueError(
                "text must have no control characters but line breaks and tabs, and no surrogates, "
                f"got {character!a}"
            )
    return value


def _is_control(character: str) -> bool:
    """Tell whether a character controls, is half of one, or is none, as XML refuses them."""
    return unicodedata.category(character) in ("Cc", "Cs") or character in "\ufffe\uffff"


def _check_size(value: Any) -> float:
    """Return a size in pixels, or raise ``ValueError``."""
    size = check.positive_number("size", value)
    if size > MAX_FONT_SIZE:
        raise ValueError(f"size must be at most {MAX_FONT_SIZE:g} pixels, got {value!r}")
    return size


def _check_font(value: Any) -> str | None:
    """Return the name of a font, or raise ``ValueError``; drawing finds whether it exists."""
    if value is None:
        return None
    if not isinstance(value, str | os.PathLike) or not str(value).strip():
        raise ValueError(
            f"font must be the name of a font or of its file, got {check.brief(value)}"
        )
    return os.fspath(value)


def _check_offset(value: Any) -> tuple[float, float]:
    """Return an offset in pixels, or raise ``ValueError``."""
    right, down = check.finite_array("offset", value, (2,)).tolist()
    if max(abs(right), abs(down)) > MAX_OFFSET:
        raise ValueError(
            f"offset must be at most {MAX_OFFSET:g} pixels each way, got {(right, down)}"
        )
    return right, down
