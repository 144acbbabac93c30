"""
The outlines of the font that Pillow ships, read from its TrueType tables [1]_.

So pixels follow from the font alone: not from the FreeType that a build of Pillow has, nor from
hints or layout engines.

References
----------
.. [1] Apple, "TrueType Reference Manual", tables cmap, glyf, head, hhea, hmtx, loca.
"""

from __future__ import annotations

import functools
import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

ON_CURVE, SHORT_X, SHORT_Y, REPEATED, SAME_X, SAME_Y = 1, 2, 4, 8, 16, 32
"""Flags of a glyph's points; of a short one "same" means above 0."""

Float64 = NDArray[np.float64]


class Font(NamedTuple):
    """A font's tables."""

    tables: dict[str, bytes]
    em: int
    """Units of an em."""
    ascent: int
    """Above the base line, units."""
    descent: int
    """Below the base line, units; above 0."""
    gap: int
    """Between lines, units."""

    def glyph_of(self, character: str) -> int:
        """Return the number of a character's glyph, 0 if the font has none."""
        return _characters(self.tables["cmap"]).get(ord(character), 0)

    def advance(self, glyph: int) -> int:
        """Return how far the next glyph stands, units."""
        (count,) = struct.unpack(">H", self.tables["hhea"][34:36])
        at = 4 * min(glyph, count - 1)
        return int(struct.unpack(">H", self.tables["hmtx"][at : at + 2])[0])

    def outline(self, glyph: int) -> list[Float64]:
        """
        Return the contours of a glyph.

        Returns
        -------
        list of (N, 3, 2) float64
            Quadratic curves, each from its first point to its last, bent by the one between; x
            right, y up, units.
        """
        return [_curves(points, is_on) for points, is_on in self._contours(glyph)]

    def _contours(self, glyph: int) -> list[tuple[Float64, NDArray[np.bool_]]]:
        """Return the points of each contour, (N, 2), and which of them lie on it."""
        (is_long,) = struct.unpack(">h", self.tables["head"][50:52])
        places = np.frombuffer(self.tables["loca"], ">u4" if is_long else ">u2").astype(int)
        places *= 1 if is_long else 2
        data = self.tables["glyf"][places[glyph] : places[glyph + 1]]
        # No glyph of the font is made of others, which have a count below 0.
        count = struct.unpack(">h", data[:2])[0] if data else 0
        if count <= 0:
            return []
        return _split_contours(data, count)


@functools.cache
def shipped_font() -> Font:
    """
    Return the font that Pillow ships.

    Raises
    ------
    ImportError
        If this Pillow was built without FreeType, and so without the font.
    """
    from PIL import ImageFont

    try:
        found = ImageFont.load_default(16)
    except ImportError as error:
        raise ImportError(
            "labels are drawn with the font that Pillow ships, and this Pillow was built without "
            f"FreeType ({error}), so it has none; that of PyPI has: pip install --force pillow"
        ) from error
    return read_font(found.font_bytes)


def read_font(data: bytes) -> Font:
    """Return a TrueType font, given its file."""
    (count,) = struct.unpack(">H", data[4:6])
    tables = {}
    for n in range(count):
        tag, _, start, size = struct.unpack(">4sIII", data[12 + 16 * n : 28 + 16 * n])
        tables[tag.decode("latin-1")] = data[start : start + size]
    (em,) = struct.unpack(">H", tables["head"][18:20])
    ascent, descent, gap = struct.unpack(">hhh", tables["hhea"][4:10])
    return Font(tables, em, ascent, -descent, gap)


@functools.cache
def _characters(table: bytes) -> dict[int, int]:
    """Return the glyph of each character, by its code: subtables of format 4."""
    found: dict[int, int] = {}
    (count,) = struct.unpack(">H", table[2:4])
    for n in range(count):
        (start,) = struct.unpack(">I", table[8 + 8 * n : 12 + 8 * n])
        form, size = struct.unpack(">HH", table[start : start + 4])
        if form != 4:
            continue
        words = np.frombuffer(table[start : start + size // 2 * 2], ">u2").astype(int)
        segments = words[3] // 2
        ends, firsts = words[7 : 7 + segments], words[8 + segments : 8 + 2 * segments]
        steps, ranges = (words[8 + k * segments : 8 + (k + 1) * segments] for k in (2, 3))
        for k in range(segments):
            for code in range(firsts[k], ends[k] + 1):
                at = 8 + 3 * segments + k + ranges[k] // 2 + code - firsts[k]
                listed = 0 if ranges[k] == 0 or at >= len(words) else words[at]
                if ranges[k] == 0 or listed:
                    found[code] = int((code if ranges[k] == 0 else listed) + steps[k]) & 0xFFFF
    return found


def _split_contours(data: bytes, count: int) -> list[tuple[Float64, NDArray[np.bool_]]]:
    """Return the contours of a glyph: their points, (N, 2), and which of them lie on it."""
    ends = struct.unpack(f">{count}H", data[10 : 10 + 2 * count])
    total = ends[-1] + 1
    (skipped,) = struct.unpack(">H", data[10 + 2 * count : 12 + 2 * count])
    at = 12 + 2 * count + skipped
    flags: list[int] = []
    while len(flags) < total:
        flag, repeats = data[at], data[at + 1] if data[at] & REPEATED else 0
        at += 2 if flag & REPEATED else 1
        flags += [flag] * (1 + repeats)
    axes = []
    for short, same in ((SHORT_X, SAME_X), (SHORT_Y, SAME_Y)):
        place, places = 0, []
        for flag in flags:
            if flag & short:
                place += data[at] if flag & same else -data[at]
                at += 1
            elif not flag & same:
                place += struct.unpack(">h", data[at : at + 2])[0]
                at += 2
            places.append(place)
        axes.append(places)
    points = np.array(axes, np.float64).T
    is_on = np.array([bool(flag & ON_CURVE) for flag in flags])
    cuts = [end + 1 for end in ends[:-1]]
    return list(zip(np.split(points, cuts), np.split(is_on, cuts), strict=True))


def _curves(points: Float64, is_on: NDArray[np.bool_]) -> Float64:
    """Return a contour as quadratic curves, (N, 3, 2)."""
    # Between two points beside the curve lies one on it, in the middle.
    full, on = [], []
    for n in range(len(points)):
        full.append(points[n])
        on.append(bool(is_on[n]))
        after = (n + 1) % len(points)
        if not is_on[n] and not is_on[after]:
            full.append((points[n] + points[after]) / 2.0)
            on.append(True)
    first = on.index(True)
    full, on = full[first:] + full[:first], on[first:] + on[:first]
    full.append(full[0])
    curves, n = [], 0
    while n < len(on):
        if n + 1 < len(on) and not on[n + 1]:
            curves.append((full[n], full[n + 1], full[n + 2]))
            n += 2
        else:
            curves.append((full[n], (full[n] + full[n + 1]) / 2.0, full[n + 1]))
            n += 1
    return np.array(curves)
