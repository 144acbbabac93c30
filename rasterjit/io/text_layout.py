"""
Lay out texts, and cover pixels with them: by the exact area of flattened outlines.

Each character's coverage is found once for a size and a quarter of a pixel, and kept. A character
that the font lacks comes from another one that has it; one that none has is an empty box.
"""

from __future__ import annotations

import functools
import math
import os
import unicodedata
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.fonts import Float64, Font, font_for, font_named
from rasterjit.scene.warning import EACH_FRAME, warn_caller

QUARTERS = 4
"""Places of a character between two pixels."""

PADDING = 0.25
"""How far a box reaches beyond its text on each side, as a share of the size."""

ALIGNED = {"left": 0.0, "center": 0.5, "right": 1.0}
"""Share of what a line is narrower than its text that lies to its left."""

PAST = 2
"""Pixels by which the last character may reach beyond the width of its text."""

MAX_NAMED = 8
"""Missing characters that a warning names."""

RIGHT_TO_LEFT = ("R", "AL")
"""Bidirectional classes of letters of Unicode: Hebrew and the like, Arabic and the like."""

MAX_LAYOUTS = 1024
"""Texts whose layout is kept."""

MAX_GLYPHS = 1024
"""Characters kept, each of one size and place."""


class PlacedGlyph(NamedTuple):
    """A character of a text."""

    font: Font
    glyph: int
    column: int
    """Pixel that its origin is in, from the left of the text."""
    quarter: int
    """Where in that pixel, quarters."""
    row: int
    """First pixel row below the base line, from the top of the text."""


class Layout(NamedTuple):
    """Where the characters of a text stand."""

    width: int
    """Pixels."""
    height: int
    """Pixels."""
    placed: tuple[PlacedGlyph, ...]
    missing: str
    """Characters that no font has."""
    turned: str
    """Characters of scripts that run from right to left, which stand from left to right."""


class Glyph(NamedTuple):
    """The pixels of a character."""

    left: int
    """Columns from the pixel of its origin to the first."""
    top: int
    """Rows from the base line to the first; below 0: above it."""
    cover: NDArray[np.uint8]
    """(R, C): the share of each pixel, of 255."""


def lay_out(
    text: str, size: float, align: str = "left", font: str | os.PathLike[str] | None = None
) -> Layout:
    """
    Return where the characters of a text stand.

    Parameters
    ----------
    text : str
        With line breaks between its lines. Tabs are four spaces; other signs that nobody sees are
        left out. It runs from left to right.
    size : float
        Of an em, pixels.
    align : {"left", "center", "right"}
        Where lines of different widths meet.
    font : str, path or None
        See `rasterjit.io.fonts.font_named`.
    """
    return _lay_out(unicodedata.normalize("NFC", text), size, align, font_named(font))


def warn_of_missing(layout: Layout) -> None:
    """Warn of characters of a text that no font has, and of those that stand the wrong way."""
    if layout.turned:
        warn_caller(
            f"texts run from left to right, and characters are not joined: {layout.turned[0]!r} "
            f"(U+{ord(layout.turned[0]):04X}) is of a script that runs from right to left",
            kind=EACH_FRAME,
        )
    if layout.missing:
        named = ", ".join(f"{one!r} (U+{ord(one):04X})" for one in layout.missing[:MAX_NAMED])
        more = f" and {len(layout.missing) - MAX_NAMED} more" * (len(layout.missing) > MAX_NAMED)
        warn_caller(
            f"no font has {named}{more}: drawn as empty boxes. Give font= a file or a name that "
            "has them, or install one: Matplotlib brings DejaVu Sans, Debian has fonts-noto-cjk",
            kind=EACH_FRAME,
        )


@functools.lru_cache(maxsize=MAX_LAYOUTS)
def _lay_out(text: str, size: float, align: str, font: Font) -> Layout:
    """Return where the characters of a text stand."""
    lines = text.replace("\t", "    ").split("\n")
    missing: dict[str, None] = {}
    scale = size / font.em
    ascent = math.ceil(scale * font.ascent)
    pitch = max(1, math.floor(scale * (font.ascent + font.descent + font.gap) + 0.5))
    found, units = [], []
    for line in lines:
        shown = [
            " " if unicodedata.category(one) == "Zs" else one
            for one in line
            if unicodedata.category(one) not in ("Cc", "Cf")
        ]
        glyphs = [_glyph(one, font, missing) for one in shown]
        # Where each character begins, and the last one ends, units of the font.
        starts = [0.0]
        for n, (own, glyph) in enumerate(glyphs):
            following = glyphs[n + 1] if n + 1 < len(glyphs) else None
            kern = own.kerning(glyph, following[1]) if following and following[0] is own else 0
            starts.append(starts[-1] + (own.advance(glyph) + kern) * (font.em / own.em))
        found.append(glyphs)
        units.append(starts)
    widths = [scale * own[-1] for own in units]
    width = math.ceil(max(widths))
    placed = []
    for number, glyphs in enumerate(found):
        start = ALIGNED[align] * (width - widths[number])
        for (own, glyph), place in zip(glyphs, units[number][:-1], strict=True):
            quarters = math.floor(QUARTERS * (start + scale * place) + 0.5)
            column, quarter = divmod(quarters, QUARTERS)
            placed.append(PlacedGlyph(own, glyph, column, quarter, ascent + number * pitch))
    height = ascent + math.ceil(scale * font.descent) + (len(lines) - 1) * pitch
    turned = [one for one in text if unicodedata.bidirectional(one) in RIGHT_TO_LEFT]
    return Layout(width, height, tuple(placed), "".join(missing), "".join(dict.fromkeys(turned)))


def _glyph(character: str, font: Font, missing: dict[str, None]) -> tuple[Font, int]:
    """Return the font and the glyph of a character; note one that no font has."""
    own = font_for(character, font)
    if own is not None:
        return own, own.characters[ord(character)]
    if not character.isspace():
        missing[character] = None
    return font, 0


def width_of(text: str, size: float, font: str | os.PathLike[str] | None = None) -> int:
    """Return how wide a line of text is, pixels; 0 without one."""
    return lay_out(text, size, "left", font).width if text else 0


def write(
    pixels: NDArray[np.uint8],
    text: str,
    place: tuple[float, float],
    size: float,
    color: Sequence[int],
    *,
    anchor: tuple[float, float] = (0.0, 0.0),
    font: str | os.PathLike[str] | None = None,
) -> None:
    """
    Write a text over a picture; codes are mixed.

    Parameters
    ----------
    pixels : (H, W, 3) uint8
        Changed.
    text : str
    place : (float, float)
        Column and row of its anchor, pixels.
    size : float
        Of an em, pixels.
    color : (3,) sequence of int
    anchor : (float, float)
        Share of its width and height that lies to the left of the anchor, and above it.
    font : str, path or None
    """
    layout = lay_out(text, size, "left", font)
    warn_of_missing(layout)
    left, top = (
        math.floor(at - share * length + 0.5)
        for at, share, length in zip(place, anchor, (layout.width, layout.height), strict=True)
    )
    height, width = pixels.shape[:2]
    first, last = (max(left, 0), max(top, 0)), (
        min(left + layout.width + PAST, width),
        min(top + layout.height, height),
    )  # fmt: skip
    if first[0] >= last[0] or first[1] >= last[1]:
        return
    window = (first[0] - left, first[1] - top, last[0] - first[0], last[1] - first[1])
    share = cover_text(layout, size, window)[..., np.newaxis]
    under = pixels[first[1] : last[1], first[0] : last[0]]
    under[...] = np.floor(under + share * (np.array(color, np.float64) - under) + 0.5)


def cover_text(layout: Layout, size: float, window: tuple[int, int, int, int]) -> Float64:
    """
    Return which share of the pixels in a window a text covers.

    Parameters
    ----------
    layout : Layout
    size : float
        Of an em, pixels.
    window : (int, int, int, int)
        First column and row, from the corner of the text, width and height: pixels.

    Returns
    -------
    (height, width) float64
        0..1, in steps of 1/255.
    """
    left, top, width, height = window
    total = np.zeros((height, width), np.int64)
    for one in layout.placed:
        glyph = cover_glyph(one.font, one.glyph, size, one.quarter)
        column, row = one.column + glyph.left - left, one.row + glyph.top - top
        rows, columns = glyph.cover.shape
        first_row, first_column = max(0, -row), max(0, -column)
        last_row, last_column = min(rows, height - row), min(columns, width - column)
        if first_row < last_row and first_column < last_column:
            total[
                row + first_row : row + last_row, column + first_column : column + last_column
            ] += glyph.cover[first_row:last_row, first_column:last_column]
    return np.minimum(total, 255) / 255.0


@functools.lru_cache(maxsize=MAX_GLYPHS)
def cover_glyph(font: Font, glyph: int, size: float, quarter: int) -> Glyph:
    """Return the pixels of a glyph whose em has a size, and which stands at a quarter of one."""
    pieces = math.ceil(math.sqrt(size))
    shares = np.arange(pieces + 1)[:, np.newaxis, np.newaxis] / pieces
    ends = []
    for curves in font.outline(glyph):
        a, b, c = curves[:, 0], curves[:, 1], curves[:, 2]
        rest = 1.0 - shares
        points = (rest * rest * a + 2.0 * rest * shares * b) + shares * shares * c
        ends.append(np.concatenate([points[:-1], points[1:]], axis=2).reshape(-1, 4))
    if not ends:
        return Glyph(0, 0, np.zeros((0, 0), np.uint8))
    lines = np.concatenate(ends) * (size / font.em)
    lines[:, [0, 2]] += quarter / QUARTERS
    lines[:, [1, 3]] *= -1.0
    low, high = lines.reshape(-1, 2).min(axis=0), lines.reshape(-1, 2).max(axis=0)
    (left, top), (right, bottom) = np.floor(low).astype(int), np.ceil(high).astype(int)
    lines -= np.array([left, top, left, top], np.float64)
    shares_covered = cover_area(lines, (int(bottom - top), int(right - left)))
    codes = np.floor(255.0 * shares_covered + 0.5).astype(np.uint8)
    codes.flags.writeable = False
    return Glyph(int(left), int(top), codes)


def cover_area(lines: Float64, shape: tuple[int, int]) -> Float64:
    """
    Return the share of each pixel that lies inside of closed outlines.

    A piece of a line within one pixel covers, of its rows, all that lies to the right of it: a part
    of its own pixel, and the pixels behind it whole. The sums of all lines, those that go up
    counted below 0, are how often an outline goes around.

    Parameters
    ----------
    lines : (N, 4) float64
        From x, y to x, y, pixels; all inside of the picture.
    shape : (int, int)
        Rows and columns.

    Returns
    -------
    (rows, columns) float64
        0..1.
    """
    rows, columns = shape
    pieces = _cut(_cut(lines, 1), 0)
    x0, y0, x1, y1 = pieces.T
    column = np.minimum(np.floor((x0 + x1) / 2.0).astype(int), columns - 1)
    row = np.minimum(np.floor((y0 + y1) / 2.0).astype(int), rows - 1)
    height = y1 - y0
    behind = height * ((x0 + x1) / 2.0 - column)
    sums = np.zeros((rows, columns + 1))
    np.add.at(sums, (row, column), height - behind)
    np.add.at(sums, (row, column + 1), behind)
    around = np.abs(np.cumsum(sums, axis=1)[:, :columns])
    return np.minimum(around, 1.0)


def _cut(lines: Float64, axis: int) -> Float64:
    """Return lines, (N, 4), cut wherever x (axis 0) or y (axis 1) is a whole number."""
    a, b = lines[:, axis], lines[:, axis + 2]
    low, high = np.minimum(a, b), np.maximum(a, b)
    first = np.floor(low) + 1.0
    cuts = np.maximum(np.ceil(high) - first, 0.0).astype(int)
    source = np.repeat(np.arange(len(lines)), cuts + 1)
    # The number of each piece in its line, from the low end.
    number = np.arange(len(source)) - np.repeat(np.cumsum(cuts + 1) - (cuts + 1), cuts + 1)
    is_first, is_last = number == 0, number == cuts[source]
    starts = np.where(is_first, low[source], first[source] + number - 1.0)
    ends = np.where(is_last, high[source], first[source] + number)
    span = np.where(high > low, high - low, 1.0)[source]
    other = 1 - axis
    is_up = (a > b)[source]
    from_, to = (
        np.where(a > b, lines[:, other + 2], lines[:, other]),
        np.where(a > b, lines[:, other], lines[:, other + 2]),
    )
    from_, to = from_[source], to[source]
    near = np.where(is_first, from_, from_ + (to - from_) * ((starts - low[source]) / span))
    far = np.where(is_last, to, from_ + (to - from_) * ((ends - low[source]) / span))
    found = np.empty((len(source), 4))
    found[:, axis], found[:, axis + 2] = (
        np.where(is_up, ends, starts),
        np.where(is_up, starts, ends),
    )
    found[:, other], found[:, other + 2] = np.where(is_up, far, near), np.where(is_up, near, far)
    return found
