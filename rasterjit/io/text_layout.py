"""
Lay out text and rasterize it, with coverage by the exact area of flattened outlines.

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

from rasterjit.io.fonts import Float64, Font, find_font, find_font_with
from rasterjit.scene.warning import REPEATED, warn_caller

SUBPIXEL_POSITIONS = 4
"""Horizontal subpixel positions of a glyph."""

PADDING_SHARE = 0.25
"""Padding of a box around its text on each side, as a share of the font size."""

LEFT_SHARES = {"left": 0.0, "center": 0.5, "right": 1.0}
"""Share of a line's free width that lies to its left."""

MAX_OVERHANG_PIXELS = 2
"""Pixels by which the last glyph may reach beyond the width of its text."""

MAX_LISTED = 8
"""Most missing characters that a warning lists."""

RIGHT_TO_LEFT_CLASSES = ("R", "AL")
"""Bidirectional classes of letters of Unicode: Hebrew and the like, Arabic and the like."""

MAX_CACHED_LAYOUTS = 1024
"""Layouts in the cache."""

MAX_CACHED_GLYPHS = 1024
"""Rasterized glyphs in the cache, each of one size and subpixel position."""


class GlyphPosition(NamedTuple):
    """A glyph of a text and its position."""

    font: Font
    glyph: int
    column: int
    """Pixel column of its origin, from the left of the text."""
    subpixel: int
    """Position in that pixel, of `SUBPIXEL_POSITIONS`."""
    row: int
    """First pixel row below the baseline, from the top of the text."""


class Layout(NamedTuple):
    """The positions of the glyphs of a text."""

    width: int
    """Pixels."""
    height: int
    """Pixels."""
    glyphs: tuple[GlyphPosition, ...]
    missing: str
    """Characters that no font has."""
    rtl: str
    """Characters of right-to-left scripts, which are laid out from left to right."""


class GlyphBitmap(NamedTuple):
    """The coverage of a glyph's pixels."""

    left: int
    """First column, relative to the pixel of its origin."""
    top: int
    """First row, relative to the baseline; below 0: above it."""
    coverage: NDArray[np.uint8]
    """(R, C): 0..255 for each pixel."""


def lay_out(
    text: str, size: float, align: str = "left", font: str | os.PathLike[str] | None = None
) -> Layout:
    """
    Return the positions of the glyphs of a text.

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
        See `rasterjit.io.fonts.find_font`.
    """
    return _lay_out(unicodedata.normalize("NFC", text), size, align, find_font(font))


def warn_of_missing(layout: Layout) -> None:
    """Warn of characters that no font has, and of right-to-left scripts."""
    if layout.rtl:
        warn_caller(
            f"texts run from left to right, and characters are not joined: {layout.rtl[0]!r} "
            f"(U+{ord(layout.rtl[0]):04X}) is of a script that runs from right to left",
            kind=REPEATED,
        )
    if layout.missing:
        listed = ", ".join(f"{one!r} (U+{ord(one):04X})" for one in layout.missing[:MAX_LISTED])
        more = f" and {len(layout.missing) - MAX_LISTED} more" * (len(layout.missing) > MAX_LISTED)
        warn_caller(
            f"no font has {listed}{more}: drawn as empty boxes. Give font= a file or a name that "
            "has them, or install one: Matplotlib brings DejaVu Sans, Debian has fonts-noto-cjk",
            kind=REPEATED,
        )


@functools.lru_cache(maxsize=MAX_CACHED_LAYOUTS)
def _lay_out(text: str, size: float, align: str, font: Font) -> Layout:
    """Return the positions of the glyphs of a text in Unicode's normal form C."""
    lines = text.replace("\t", "    ").split("\n")
    missing: dict[str, None] = {}
    scale = size / font.em
    ascent = math.ceil(scale * font.ascent)
    pitch = max(1, math.floor(scale * (font.ascent + font.descent + font.line_gap) + 0.5))
    rows, starts_of_rows = [], []
    for line in lines:
        characters = [
            " " if unicodedata.category(one) == "Zs" else one
            for one in line
            if unicodedata.category(one) not in ("Cc", "Cf")
        ]
        glyphs = [_find_glyph(one, font, missing) for one in characters]
        # Where each character begins, and the last one ends, units of the font.
        starts = [0.0]
        for n, (used, glyph) in enumerate(glyphs):
            following = glyphs[n + 1] if n + 1 < len(glyphs) else None
            kern = used.kerning(glyph, following[1]) if following and following[0] is used else 0
            starts.append(starts[-1] + (used.advance(glyph) + kern) * (font.em / used.em))
        rows.append(glyphs)
        starts_of_rows.append(starts)
    widths = [scale * used[-1] for used in starts_of_rows]
    width = math.ceil(max(widths))
    layout = []
    for number, glyphs in enumerate(rows):
        start = LEFT_SHARES[align] * (width - widths[number])
        for (used, glyph), offset in zip(glyphs, starts_of_rows[number][:-1], strict=True):
            subpixels = math.floor(SUBPIXEL_POSITIONS * (start + scale * offset) + 0.5)
            column, subpixel = divmod(subpixels, SUBPIXEL_POSITIONS)
            layout.append(GlyphPosition(used, glyph, column, subpixel, ascent + number * pitch))
    height = ascent + math.ceil(scale * font.descent) + (len(lines) - 1) * pitch
    rtl = [one for one in text if unicodedata.bidirectional(one) in RIGHT_TO_LEFT_CLASSES]
    return Layout(width, height, tuple(layout), "".join(missing), "".join(dict.fromkeys(rtl)))


def _find_glyph(character: str, font: Font, missing: dict[str, None]) -> tuple[Font, int]:
    """Return the font and the glyph of a character; note one that no font has."""
    glyph_font = find_font_with(character, font)
    if glyph_font is not None:
        return glyph_font, glyph_font.characters[ord(character)]
    if not character.isspace():
        missing[character] = None
    return font, 0


def measure_text_width(text: str, size: float, font: str | os.PathLike[str] | None = None) -> int:
    """Return the width of a line of text, pixels."""
    return lay_out(text, size, "left", font).width if text else 0


def draw_text(
    pixels: NDArray[np.uint8],
    text: str,
    position: tuple[float, float],
    size: float,
    color: Sequence[int],
    *,
    anchor: tuple[float, float] = (0.0, 0.0),
    font: str | os.PathLike[str] | None = None,
) -> None:
    """
    Draw a text over a picture, mixing its sRGB codes.

    Parameters
    ----------
    pixels : (H, W, 3) uint8
        Changed.
    text : str
    position : (float, float)
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
        for at, share, length in zip(position, anchor, (layout.width, layout.height), strict=True)
    )
    height, width = pixels.shape[:2]
    first, last = (max(left, 0), max(top, 0)), (
        min(left + layout.width + MAX_OVERHANG_PIXELS, width),
        min(top + layout.height, height),
    )  # fmt: skip
    if first[0] >= last[0] or first[1] >= last[1]:
        return
    window = (first[0] - left, first[1] - top, last[0] - first[0], last[1] - first[1])
    share = rasterize_text(layout, size, window)[..., np.newaxis]
    under = pixels[first[1] : last[1], first[0] : last[0]]
    under[...] = np.floor(under + share * (np.array(color, np.float64) - under) + 0.5)


def rasterize_text(layout: Layout, size: float, window: tuple[int, int, int, int]) -> Float64:
    """
    Return the coverage of the pixels in a window by a text.

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
    for one in layout.glyphs:
        glyph = rasterize_glyph(one.font, one.glyph, size, one.subpixel)
        column, row = one.column + glyph.left - left, one.row + glyph.top - top
        rows, columns = glyph.coverage.shape
        first_row, first_column = max(0, -row), max(0, -column)
        last_row, last_column = min(rows, height - row), min(columns, width - column)
        if first_row < last_row and first_column < last_column:
            total[
                row + first_row : row + last_row, column + first_column : column + last_column
            ] += glyph.coverage[first_row:last_row, first_column:last_column]
    return np.minimum(total, 255) / 255.0


@functools.lru_cache(maxsize=MAX_CACHED_GLYPHS)
def rasterize_glyph(font: Font, glyph: int, size: float, subpixel: int) -> GlyphBitmap:
    """Rasterize a glyph of a font size, pixels, at a subpixel position."""
    pieces = math.ceil(math.sqrt(size))
    shares = np.arange(pieces + 1)[:, np.newaxis, np.newaxis] / pieces
    ends = []
    for curves in font.outline(glyph):
        a, b, c = curves[:, 0], curves[:, 1], curves[:, 2]
        rest = 1.0 - shares
        points = (rest * rest * a + 2.0 * rest * shares * b) + shares * shares * c
        ends.append(np.concatenate([points[:-1], points[1:]], axis=2).reshape(-1, 4))
    if not ends:
        return GlyphBitmap(0, 0, np.zeros((0, 0), np.uint8))
    lines = np.concatenate(ends) * (size / font.em)
    lines[:, [0, 2]] += subpixel / SUBPIXEL_POSITIONS
    lines[:, [1, 3]] *= -1.0
    low, high = lines.reshape(-1, 2).min(axis=0), lines.reshape(-1, 2).max(axis=0)
    (left, top), (right, bottom) = np.floor(low).astype(int), np.ceil(high).astype(int)
    lines -= np.array([left, top, left, top], np.float64)
    shares_covered = rasterize_area(lines, (int(bottom - top), int(right - left)))
    codes = np.floor(255.0 * shares_covered + 0.5).astype(np.uint8)
    codes.flags.writeable = False
    return GlyphBitmap(int(left), int(top), codes)


def rasterize_area(lines: Float64, shape: tuple[int, int]) -> Float64:
    """
    Return the share of each pixel that lies inside closed outlines.

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
    pieces = _split_at_integers(_split_at_integers(lines, 1), 0)
    x0, y0, x1, y1 = pieces.T
    column = np.minimum(np.floor((x0 + x1) / 2.0).astype(int), columns - 1)
    row = np.minimum(np.floor((y0 + y1) / 2.0).astype(int), rows - 1)
    height = y1 - y0
    next_pixel = height * ((x0 + x1) / 2.0 - column)
    sums = np.zeros((rows, columns + 1))
    np.add.at(sums, (row, column), height - next_pixel)
    np.add.at(sums, (row, column + 1), next_pixel)
    around = np.abs(np.cumsum(sums, axis=1)[:, :columns])
    return np.minimum(around, 1.0)


def _split_at_integers(lines: Float64, axis: int) -> Float64:
    """Split lines, (N, 4), wherever x (axis 0) or y (axis 1) is a whole number."""
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
    pieces = np.empty((len(source), 4))
    pieces[:, axis], pieces[:, axis + 2] = (
        np.where(is_up, ends, starts),
        np.where(is_up, starts, ends),
    )
    pieces[:, other], pieces[:, other + 2] = np.where(is_up, far, near), np.where(is_up, near, far)
    return pieces
