"""
Find fonts, and read the outlines of their glyphs from the file itself [1]_.

So pixels follow from the font alone: not from the FreeType that a build of Pillow has, nor from
hints or layout engines. Outlines of TrueType are read here; those of PostScript (``CFF``) by
fontTools, which Matplotlib brings.

References
----------
.. [1] Apple, "TrueType Reference Manual", tables cmap, glyf, head, hhea, hmtx, kern, loca, name;
   Microsoft, "OpenType specification", table GPOS.
"""

from __future__ import annotations

import functools
import importlib.util
import io
import os
import struct
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property

ON_CURVE, SHORT_X, SHORT_Y, REPEATED, SAME_X, SAME_Y = 1, 2, 4, 8, 16, 32
"""Flags of a glyph's points; of a short one "same" means above 0."""

WORDS, OFFSETS, SCALE, MORE, TWO_SCALES, MATRIX = 1, 2, 8, 32, 64, 128
"""Flags of a part of a composite glyph."""

DEEPEST = 8
"""Composite glyphs in composite glyphs; deeper ones are left out."""

MAX_PARTS = 4096
"""Parts of a composite glyph, with those of its parts: a short file could name endless ones."""

MAX_SUBTABLES = 64
"""Subtables of cmap, of which each may name all characters; fonts have a few."""

MAX_NUMBERS = 1 << 23
"""Numbers of GPOS that are read, and pairs of kern."""

X_ADVANCE = 4
"""The bit of a value record of GPOS that moves what follows."""

COLLECTION = b"ttcf"
"""How files begin that hold several fonts."""

SUFFIXES = (".ttf", ".ttc", ".otf", ".otc")

FALLBACKS = ("DejaVuSans.ttf",)
"""Fonts that are looked in first for what a font lacks; then all others of the system."""

PLACEHOLDERS = (
    "lastresort", "adobeblank", "unifont", "cmex", "cmmi", "cmr", "cmss", "cmsy", "cmtt", "cmb",
    "stix",
)  # fmt: skip
"""How the names of fonts begin that have boxes or signs of their own in place of characters."""

MAX_CHARACTERS = 0x110000
"""Codes of Unicode."""

MAX_FILE = 1 << 28
"""Bytes that a font file may have at most."""

Float64 = NDArray[np.float64]


class Font:
    """
    A font.

    Parameters
    ----------
    data : bytes
        Its file.
    number : int
        Which font of a collection.

    Raises
    ------
    ValueError
        If it is no font.
    """

    def __init__(self, data: bytes, number: int = 0) -> None:
        try:
            start = struct.unpack(">I", data[12 + 4 * number : 16 + 4 * number])[0] if (
                data[:4] == COLLECTION) else 0  # fmt: skip
            (count,) = struct.unpack(">H", data[start + 4 : start + 6])
            self.tables: dict[str, bytes] = {}
            for n in range(count):
                at = start + 12 + 16 * n
                tag, _, first, size = struct.unpack(">4sIII", data[at : at + 16])
                self.tables[tag.decode("latin-1")] = data[first : first + size]
            (self.em,) = struct.unpack(">H", self.tables["head"][18:20])
            ascent, descent, gap = struct.unpack(">hhh", self.tables["hhea"][4:10])
            self.ascent, self.descent, self.gap = ascent, -descent, gap
            (self._advances,) = struct.unpack(">H", self.tables["hhea"][34:36])
            is_short = len(self.tables["hmtx"]) < 4 * max(self._advances, 1)
            if (
                is_short
                or "cmap" not in self.tables
                or not self.em
                or not {"glyf", "CFF ", "CFF2"} & self.tables.keys()
            ):
                raise ValueError
        except (struct.error, KeyError, ValueError):
            raise ValueError("not a TrueType or OpenType font") from None
        self._data, self._number = data, number

    @cached_property
    def characters(self) -> dict[int, int]:
        """The glyph of each character, by its code."""
        found: dict[int, int] = {}
        table = self.tables["cmap"]
        (count,) = struct.unpack(">H", table[2:4])
        starts: dict[int, None] = {}
        for n in range(count):
            platform, coding, start = struct.unpack(">HHI", table[4 + 8 * n : 12 + 8 * n])
            if platform not in (0, 3) or (platform == 3 and coding not in (1, 10)):
                continue  # Signs that stand at places of other characters, such as Symbol.
            # Each once, where it comes last: later ones win.
            starts.pop(start, None)
            starts[start] = None
        if len(starts) > MAX_SUBTABLES:
            raise ValueError(f"it has more than {MAX_SUBTABLES} tables of characters")
        for start in starts:
            (form,) = struct.unpack(">H", table[start : start + 2])
            if form == 4:
                found |= _segments(table[start:])
            elif form == 12:
                (groups,) = struct.unpack(">I", table[start + 12 : start + 16])
                rows = table[start + 16 : start + 16 + 12 * groups]
                ranges = np.frombuffer(rows[: len(rows) // 12 * 12], ">u4").astype(int)
                ranges = ranges.reshape(-1, 3)
                _check_ranges(ranges[:, 0], ranges[:, 1])
                for first, last, glyph in ranges.tolist():
                    found |= {code: glyph + code - first for code in range(first, last + 1)}
        return {code: glyph for code, glyph in found.items() if glyph}

    def advance(self, glyph: int) -> int:
        """Return how far the next glyph stands, units."""
        at = 4 * max(min(glyph, self._advances - 1), 0)
        return int(struct.unpack(">H", self.tables["hmtx"][at : at + 2])[0])

    def kerning(self, first: int, second: int) -> int:
        """Return how much farther apart two neighbours stand, units; below 0: closer."""
        for pairs in self._kerning:
            found = pairs(first, second)
            if found is not None:
                return found
        return 0

    @cached_property
    def _kerning(self) -> list[_Pairs]:
        """The tables of kerning; of GPOS, else of kern."""
        try:
            return _gpos_pairs(self.tables.get("GPOS", b"")) or _kern_pairs(
                self.tables.get("kern", b"")
            )
        except (struct.error, IndexError):
            return []

    def outline(self, glyph: int) -> list[Float64]:
        """
        Return the contours of a glyph.

        Returns
        -------
        list of (N, 3, 2) float64
            Quadratic curves, each from its first point to its last, bent by the one between; x
            right, y up, units. Empty for a damaged glyph.
        """
        try:
            if "glyf" not in self.tables:
                return self._postscript_outline(glyph)
            parts = iter(range(MAX_PARTS))
            return [_curves(points, is_on) for points, is_on in self._contours(glyph, parts)]
        except (struct.error, IndexError, ValueError):
            return []

    def _contours(
        self, glyph: int, parts: Iterator[int], depth: int = 0
    ) -> list[tuple[Float64, NDArray[np.bool_]]]:
        """Return the points of each contour, (N, 2), and which lie on it; ``parts`` may come."""
        (is_long,) = struct.unpack(">h", self.tables["head"][50:52])
        places = np.frombuffer(self.tables["loca"], ">u4" if is_long else ">u2").astype(int)
        places *= 1 if is_long else 2
        data = self.tables["glyf"][places[glyph] : places[glyph + 1]]
        count = struct.unpack(">h", data[:2])[0] if data else 0
        if count < 0:
            return self._parts(data, parts, depth)
        return _split_contours(data, count) if count else []

    def _parts(
        self, data: bytes, parts: Iterator[int], depth: int
    ) -> list[tuple[Float64, NDArray[np.bool_]]]:
        """Return the contours of a glyph that is made of others."""
        found: list[tuple[Float64, NDArray[np.bool_]]] = []
        at, flags = 10, MORE if depth < DEEPEST else 0
        while flags & MORE:
            if next(parts, None) is None:
                raise ValueError(f"it has more than {MAX_PARTS} parts")
            flags, glyph = struct.unpack(">HH", data[at : at + 4])
            size = 4 if flags & WORDS else 2
            move = struct.unpack(">hh" if flags & WORDS else ">bb", data[at + 4 : at + 4 + size])
            at += 4 + size
            kinds = ((SCALE, 1), (TWO_SCALES, 2), (MATRIX, 4))
            number = next((number for kind, number in kinds if flags & kind), 0)
            scales = np.frombuffer(data[at : at + 2 * number], ">i2") / 16384.0
            at += 2 * number
            matrix = scales.reshape(2, 2) if number == 4 else np.diag([*scales, 1.0, 1.0][:2])
            if number == 1:
                matrix = scales[0] * np.eye(2)
            offset = np.array(move if flags & OFFSETS else (0, 0), np.float64)
            found += [
                (points @ matrix + offset, is_on)
                for points, is_on in self._contours(glyph, parts, depth + 1)
            ]
        return found

    def _postscript_outline(self, glyph: int) -> list[Float64]:
        """Return the contours of a glyph whose curves are cubic, each as quadratic ones."""
        from fontTools.pens.recordingPen import DecomposingRecordingPen

        font = self._opened
        glyphs = font.getGlyphSet()
        pen = DecomposingRecordingPen(glyphs)
        glyphs[font.getGlyphName(glyph)].draw(pen)
        contours: list[list[Float64]] = []
        here = start = np.zeros(2)
        for step, given in pen.value:
            points = [np.array(one, np.float64) for one in given]
            if step == "moveTo":
                here = start = points[0]
                contours.append([])
            elif step == "lineTo":
                contours[-1].append(np.stack([here, (here + points[0]) / 2.0, points[0]]))
                here = points[0]
            elif step == "curveTo":
                contours[-1] += _quadratics(here, *points)
                here = points[-1]
            elif step == "closePath" and not np.array_equal(here, start):
                contours[-1].append(np.stack([here, (here + start) / 2.0, start]))
                here = start
        return [np.array(one) for one in contours if one]

    @cached_property
    def _opened(self) -> Any:
        """What fontTools made of the file."""
        from fontTools.ttLib import TTFont

        return TTFont(io.BytesIO(self._data), fontNumber=self._number, lazy=True)


class _Pairs:
    """
    Distances between neighbours: of glyphs that are listed, or of classes of glyphs.

    Parameters
    ----------
    listed : dict of (int, int) to int
        By pairs of glyphs, or of classes; units.
    covered : set of int, optional
        The first glyphs that classes tell of.
    firsts, seconds : dict of int to int
        Classes of glyphs; those that are not there have class 0.
    """

    def __init__(
        self,
        listed: dict[tuple[int, int], int],
        covered: set[int] | None = None,
        firsts: dict[int, int] | None = None,
        seconds: dict[int, int] | None = None,
    ) -> None:
        self._listed, self._covered = listed, covered
        self._firsts, self._seconds = firsts or {}, seconds or {}

    def __call__(self, first: int, second: int) -> int | None:
        """Return the distance of two glyphs, units; None if it is not told here."""
        if self._covered is None:
            return self._listed.get((first, second))
        if first not in self._covered:
            return None
        return self._listed.get((self._firsts.get(first, 0), self._seconds.get(second, 0)), 0)


def _kern_pairs(table: bytes) -> list[_Pairs]:
    """Return the horizontal pairs of the table kern, subtables of format 0."""
    found: dict[tuple[int, int], int] = {}
    if table[:2] == b"\0\0":
        at, left = 4, MAX_NUMBERS
        for _ in range(struct.unpack(">H", table[2:4])[0]):
            _, size, coverage = struct.unpack(">HHH", table[at : at + 6])
            if coverage & 0xFF07 == 1:
                (count,) = struct.unpack(">H", table[at + 6 : at + 8])
                left -= count
                if left < 0:
                    raise IndexError("too many pairs")
                pairs = struct.iter_unpack(">HHh", table[at + 14 : at + 14 + 6 * count])
                found |= {(first, second): units for first, second, units in pairs}
            at += size
    return [_Pairs(found)] if found else []


def _gpos_pairs(table: bytes) -> list[_Pairs]:
    """Return the pairs of the feature kern of the table GPOS."""
    if not table:
        return []
    words = _Words(table)
    features, lookups = words[6], words[8]
    chosen: dict[int, None] = {}
    for n in range(words[features]):
        record = features + 2 + 6 * n
        if table[record : record + 4] == b"kern":
            feature = features + words[record + 4]
            chosen |= dict.fromkeys(words[feature + 4 + 2 * k] for k in range(words[feature + 2]))
    found = []
    for lookup in (lookups + words[lookups + 2 + 2 * n] for n in chosen):
        for k in range(words[lookup + 4]):
            kind, start = words[lookup], lookup + words[lookup + 6 + 2 * k]
            if kind == 9:  # One that stands farther away than 16 bits tell.
                kind = words[start + 2]
                start += struct.unpack(">I", table[start + 4 : start + 8])[0]
            if kind == 2:
                found.append(_pair_positions(words, start))
    return found


def _pair_positions(words: _Words, start: int) -> _Pairs:
    """Return the pairs of one subtable."""
    form, covered = words[start], _coverage(words, start + words[start + 2])
    formats = words[start + 4], words[start + 6]
    sizes = [2 * bin(one & 0xFF).count("1") for one in formats]
    # Of the first glyph's values the advance counts; before it stand the two of its place.
    advance = 2 * bin(formats[0] & (X_ADVANCE - 1)).count("1")
    has_advance = bool(formats[0] & X_ADVANCE)
    listed: dict[tuple[int, int], int] = {}
    if not has_advance:
        return _Pairs(listed)
    if form == 1:
        for n, first in enumerate(covered):
            pairs = start + words[start + 10 + 2 * n]
            for k in range(words[pairs]):
                record = pairs + 2 + k * (2 + sum(sizes))
                listed[first, words[record]] = words.signed(record + 2 + advance)
        return _Pairs(listed)
    firsts, seconds = (_classes(words, start + words[start + at]) for at in (8, 10))
    count = words[start + 14]
    for one in range(words[start + 12]):
        for other in range(count):
            record = start + 16 + (one * count + other) * sum(sizes)
            if units := words.signed(record + advance):
                listed[one, other] = units
    return _Pairs(listed, set(covered), firsts, seconds)


class _Words:
    """The 16-bit numbers of a table, by their place in bytes."""

    def __init__(self, table: bytes) -> None:
        self._table, self._left = table, MAX_NUMBERS

    def __getitem__(self, at: int) -> int:
        """Return an unsigned one; ``IndexError`` after very many."""
        self._left -= 1
        if self._left < 0:
            raise IndexError("too many numbers")
        return int.from_bytes(self._table[at : at + 2], "big")

    def signed(self, at: int) -> int:
        """Return a signed one."""
        return int.from_bytes(self._table[at : at + 2], "big", signed=True)


def _coverage(words: _Words, start: int) -> list[int]:
    """Return the glyphs that a table tells of, in order."""
    count = words[start + 2]
    if words[start] == 1:
        return [words[start + 4 + 2 * n] for n in range(count)]
    return [glyph for first, last, _ in _ranges(words, start + 4, count)
            for glyph in range(first, last + 1)]  # fmt: skip


def _classes(words: _Words, start: int) -> dict[int, int]:
    """Return the class of each glyph that has one."""
    if words[start] == 1:
        first = words[start + 2]
        return {first + n: words[start + 6 + 2 * n] for n in range(words[start + 4])}
    return {glyph: number for first, last, number in _ranges(words, start + 4, words[start + 2])
            for glyph in range(first, last + 1)}  # fmt: skip


def _ranges(words: _Words, start: int, count: int) -> Iterator[tuple[int, int, int]]:
    """Yield the first and the last glyph of ranges, and what stands with them."""
    for at in range(start, start + 6 * count, 6):
        yield words[at], words[at + 2], words[at + 4]


def _segments(table: bytes) -> dict[int, int]:
    """Return the glyphs of a subtable of format 4 of cmap, by character."""
    found: dict[int, int] = {}
    size = len(table) // 2
    words = np.frombuffer(table[: 2 * size], ">u2").astype(int)
    segments = words[3] // 2
    ends, firsts = words[7 : 7 + segments], words[8 + segments : 8 + 2 * segments]
    steps, ranges = (words[8 + k * segments : 8 + (k + 1) * segments] for k in (2, 3))
    _check_ranges(firsts, ends)
    for k in range(segments):
        for code in range(firsts[k], ends[k] + 1):
            at = 8 + 3 * segments + k + ranges[k] // 2 + code - firsts[k]
            listed = 0 if ranges[k] == 0 or at >= len(words) else words[at]
            if ranges[k] == 0 or listed:
                found[code] = int((code if ranges[k] == 0 else listed) + steps[k]) & 0xFFFF
    return found


def _check_ranges(firsts: NDArray[np.int_], lasts: NDArray[np.int_]) -> None:
    """Raise ``ValueError`` if ranges of characters are more than all that there are."""
    if np.maximum(lasts - firsts + 1, 0).sum() > MAX_CHARACTERS:
        raise ValueError("its ranges of characters overlap")


def _quadratics(a: Float64, b: Float64, c: Float64, d: Float64) -> list[Float64]:
    """Return a cubic curve as four quadratic ones that begin, end and point as it does."""
    found = []
    for n in range(4):
        s, t = n / 4.0, (n + 1) / 4.0
        points = [_blossom(a, b, c, d, *at) for at in ((s, s, s), (s, s, t), (s, t, t), (t, t, t))]
        middle = (3.0 * (points[1] + points[2]) - points[0] - points[3]) / 4.0
        found.append(np.stack([points[0], middle, points[3]]))
    return found


def _blossom(
    a: Float64, b: Float64, c: Float64, d: Float64, r: float, s: float, t: float
) -> Float64:
    """Return a control point of a part of a cubic curve: de Casteljau's steps at r, s and t."""
    points = [a, b, c, d]
    for share in (r, s, t):
        points = [one + share * (other - one) for one, other in pairwise(points)]
    return points[0]


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


# Which fonts there are.


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
            "texts are drawn with the font that Pillow ships, and this Pillow was built without "
            f"FreeType ({error}), so it has none; that of PyPI has: pip install --force pillow"
        ) from error
    assert isinstance(found, ImageFont.FreeTypeFont)  # As it was asked for by its size.
    return Font(found.font_bytes)


def font_named(name: str | os.PathLike[str] | None) -> Font:
    """
    Return a font.

    Parameters
    ----------
    name : str, path or None
        A file, or the name of a font that Matplotlib brings or the system has: of its family, with
        or without its style ("DejaVu Sans", "Noto Sans CJK JP Bold"). None: the one Pillow ships.

    Raises
    ------
    ValueError
        If there is none.
    """
    if name is None:
        return shipped_font()
    if not isinstance(name, str | os.PathLike) or not str(name).strip():
        raise ValueError(f"font must be the name of a font or of its file, got {name!r}")
    path = Path(name)
    if path.suffix.lower() in SUFFIXES or len(path.parts) > 1:
        if not path.is_file():
            raise ValueError(f"font must be a file that is there, got {str(name)!r}")
        try:
            found = _opened(os.path.abspath(path))
            # Read now, so that a damaged table is named here.
            found.characters  # noqa: B018
        except (OSError, ValueError, struct.error, IndexError) as error:
            raise ValueError(f"font must be a font, got {str(name)!r}: {error}") from None
        return found
    wanted = _plain(str(name))
    # Most files are named as their font: look there first.
    for file in sorted(font_files(), key=lambda file: wanted not in _plain(file)):
        for number, names in enumerate(_names_of(file)):
            if wanted in names:
                return _opened(file, number)
    raise ValueError(
        f"font must be a file, or the name of a font that Matplotlib brings or the system has, got "
        f"{str(name)!r}"
    )


@functools.lru_cache(maxsize=1024)
def font_for(character: str, font: Font) -> Font | None:
    """Return the first font that has a character: the given one, Pillow's, or any other."""
    for one in (font, shipped_font()):
        if ord(character) in one.characters:
            return one
    for file in font_files():
        if _plain(Path(file).stem).startswith(PLACEHOLDERS):
            continue
        if ord(character) in _codes_of(file):
            found = _opened(file)
            if found.outline(found.characters[ord(character)]):
                return found
    return None


@functools.lru_cache(maxsize=1024)
def _codes_of(file: str) -> NDArray[np.int32]:
    """Return the codes of the characters that a font file has, (N,); none if it cannot be read."""
    try:
        # The font itself is not kept: there may be many, of many megabytes.
        return np.array(list(_opened.__wrapped__(file).characters), np.int32)
    except (OSError, ValueError, struct.error, IndexError):
        return np.empty(0, np.int32)


@functools.cache
def font_files() -> tuple[str, ...]:
    """Return the files of the fonts that Matplotlib brings and the system has, the best first."""
    home = Path.home() if "HOME" in os.environ or os.name == "nt" else Path()
    folders = [home / ".fonts", home / ".local/share/fonts", Path("/usr/local/share/fonts"),
               Path("/usr/share/fonts")]  # fmt: skip
    if sys.platform == "darwin":
        folders = [home / "Library/Fonts", Path("/Library/Fonts"), Path("/System/Library/Fonts")]
    elif os.name == "nt":
        folders = [Path(os.environ.get("WINDIR", "C:/Windows")) / "Fonts"]
    found = importlib.util.find_spec("matplotlib")
    if found is not None and found.submodule_search_locations:
        folders.insert(0, Path(found.submodule_search_locations[0]) / "mpl-data/fonts/ttf")
    files = [
        os.path.join(place, name)
        for folder in folders
        for place, _, names in sorted(os.walk(folder))
        for name in sorted(names)
        if name.lower().endswith(SUFFIXES)
    ]

    def rank(file: str) -> tuple[bool, bool]:
        name = os.path.basename(file)
        is_styled = any(style in name.lower() for style in ("bold", "italic", "oblique", "mono"))
        return name not in FALLBACKS, is_styled

    return tuple(sorted(dict.fromkeys(files), key=rank))


@functools.lru_cache(maxsize=8)
def _opened(file: str, number: int = 0) -> Font:
    """Return a font of a file; one of PostScript needs fontTools."""
    found = Font(_content(file), number)
    if "glyf" not in found.tables and importlib.util.find_spec("fontTools") is None:
        raise ValueError(
            "its outlines are PostScript's, which need fontTools: pip install fonttools"
        )
    return found


def _content(file: str) -> bytes:
    """Return a font file, or raise ``ValueError`` for one that is too large."""
    with open(file, "rb") as stream:
        data = stream.read(MAX_FILE + 1)
    if len(data) > MAX_FILE:
        raise ValueError(f"a font file may have {MAX_FILE:,} bytes at most")
    return data


@functools.lru_cache(maxsize=4096)
def _names_of(file: str) -> list[set[str]]:
    """Return the names of the fonts in a file: family, family with style, file; none if damaged."""
    try:
        data = _content(file)
        count = struct.unpack(">I", data[8:12])[0] if data[:4] == COLLECTION else 1
        return [{_plain(Path(file).stem)} | _names_in(Font(data, n)) for n in range(min(count, 64))]
    except (OSError, ValueError, struct.error):
        return []


def _names_in(font: Font) -> set[str]:
    """Return the names that a font gives itself; a regular one has its family's, too."""
    table = font.tables.get("name", b"")
    found: dict[int, str] = {}
    count, start = struct.unpack(">HH", table[2:6]) if table else (0, 0)
    for n in range(count):
        platform, _, _, kind, size, at = struct.unpack(">6H", table[6 + 12 * n : 18 + 12 * n])
        text = table[start + at : start + at + size]
        found.setdefault(
            kind, text.decode("utf-16-be" if platform in (0, 3) else "latin-1", "ignore")
        )
    names = {found[kind] for kind in (4, 6) if kind in found}
    if found.get(17, found.get(2, "Regular")) in ("Regular", "Book", "Roman", "Normal"):
        names |= {found[kind] for kind in (1, 16) if kind in found}
    return {_plain(name) for name in names}


def _plain(name: str) -> str:
    """Return a name as names are compared: small letters and digits."""
    return "".join(one for one in name.casefold() if one.isalnum())
