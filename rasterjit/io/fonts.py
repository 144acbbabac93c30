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

ARE_WORDS, ARE_OFFSETS, HAS_SCALE = 1, 2, 8
HAS_MORE, HAS_TWO_SCALES, HAS_MATRIX = 32, 64, 128
"""Flags of a component of a composite glyph; the first two are of its arguments."""

MAX_COMPONENT_DEPTH = 8
"""How deep composite glyphs may nest; deeper ones are left out."""

MAX_COMPONENTS = 4096
"""Parts of a composite glyph, with those of its parts: a short file could name endless ones."""

MAX_SUBTABLES = 64
"""Subtables of cmap, of which each may name all characters; fonts have a few."""

MAX_TABLE_READS = 1 << 23
"""Numbers of GPOS that are read at most, and pairs of kern."""

X_ADVANCE_BIT = 4
"""The bit of a value record of GPOS that moves what follows."""

COLLECTION_SIGNATURE = b"ttcf"
"""First bytes of files that hold several fonts."""

FONT_SUFFIXES = (".ttf", ".ttc", ".otf", ".otc")

FALLBACK_FONTS = ("DejaVuSans.ttf",)
"""Fonts searched first for characters that a font lacks; then all others of the system."""

PLACEHOLDER_FONTS = (
    "lastresort", "adobeblank", "unifont", "cmex", "cmmi", "cmr", "cmss", "cmsy", "cmtt", "cmb",
    "stix",
)  # fmt: skip
"""Beginnings of names of fonts that have boxes or symbols in place of characters."""

MAX_CHARACTERS = 0x110000
"""Number of Unicode code points."""

MAX_FONT_BYTES = 1 << 28
"""Most bytes of a font file."""

Float64 = NDArray[np.float64]


class Font:
    """
    A TrueType or OpenType font.

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
                data[:4] == COLLECTION_SIGNATURE) else 0  # fmt: skip
            (count,) = struct.unpack(">H", data[start + 4 : start + 6])
            self.tables: dict[str, bytes] = {}
            for n in range(count):
                at = start + 12 + 16 * n
                tag, _, first, size = struct.unpack(">4sIII", data[at : at + 16])
                self.tables[tag.decode("latin-1")] = data[first : first + size]
            (self.em,) = struct.unpack(">H", self.tables["head"][18:20])
            ascent, descent, gap = struct.unpack(">hhh", self.tables["hhea"][4:10])
            self.ascent, self.descent, self.line_gap = ascent, -descent, gap
            (self._advance_count,) = struct.unpack(">H", self.tables["hhea"][34:36])
            is_short = len(self.tables["hmtx"]) < 4 * max(self._advance_count, 1)
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
        glyphs: dict[int, int] = {}
        table = self.tables["cmap"]
        (count,) = struct.unpack(">H", table[2:4])
        starts: dict[int, None] = {}
        for n in range(count):
            platform, encoding, start = struct.unpack(">HHI", table[4 + 8 * n : 12 + 8 * n])
            if platform not in (0, 3) or (platform == 3 and encoding not in (1, 10)):
                continue  # Signs that stand at places of other characters, such as Symbol.
            # Each once, where it comes last: later ones win.
            starts.pop(start, None)
            starts[start] = None
        if len(starts) > MAX_SUBTABLES:
            raise ValueError(f"it has more than {MAX_SUBTABLES} tables of characters")
        for start in starts:
            (format_number,) = struct.unpack(">H", table[start : start + 2])
            if format_number == 4:
                glyphs |= _read_cmap_format_4(table[start:])
            elif format_number == 12:
                (groups,) = struct.unpack(">I", table[start + 12 : start + 16])
                rows = table[start + 16 : start + 16 + 12 * groups]
                ranges = np.frombuffer(rows[: len(rows) // 12 * 12], ">u4").astype(int)
                ranges = ranges.reshape(-1, 3)
                _check_ranges(ranges[:, 0], ranges[:, 1])
                for first, last, glyph in ranges.tolist():
                    glyphs |= {code: glyph + code - first for code in range(first, last + 1)}
        return {code: glyph for code, glyph in glyphs.items() if glyph}

    def advance(self, glyph: int) -> int:
        """Return the advance width of a glyph, font units."""
        at = 4 * max(min(glyph, self._advance_count - 1), 0)
        return int(struct.unpack(">H", self.tables["hmtx"][at : at + 2])[0])

    def kerning(self, first: int, second: int) -> int:
        """Return the kerning of two neighbours, font units; below 0: closer."""
        for pairs in self._kerning:
            distance = pairs(first, second)
            if distance is not None:
                return distance
        return 0

    @cached_property
    def _kerning(self) -> list[_KerningPairs]:
        """The kerning tables: of GPOS, else of kern."""
        try:
            return _read_gpos_pairs(self.tables.get("GPOS", b"")) or _read_kern_pairs(
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
                return self._read_postscript_outline(glyph)
            parts = iter(range(MAX_COMPONENTS))
            return [
                _make_curves(points, is_on) for points, is_on in self._read_contours(glyph, parts)
            ]
        except (struct.error, IndexError, ValueError):
            return []

    def _read_contours(
        self, glyph: int, parts: Iterator[int], depth: int = 0
    ) -> list[tuple[Float64, NDArray[np.bool_]]]:
        """Return the points of each contour, (N, 2), and which lie on it; ``parts`` limits them."""
        (is_long,) = struct.unpack(">h", self.tables["head"][50:52])
        offsets = np.frombuffer(self.tables["loca"], ">u4" if is_long else ">u2").astype(int)
        offsets *= 1 if is_long else 2
        data = self.tables["glyf"][offsets[glyph] : offsets[glyph + 1]]
        count = struct.unpack(">h", data[:2])[0] if data else 0
        if count < 0:
            return self._read_composite(data, parts, depth)
        return _split_contours(data, count) if count else []

    def _read_composite(
        self, data: bytes, parts: Iterator[int], depth: int
    ) -> list[tuple[Float64, NDArray[np.bool_]]]:
        """Return the contours of a composite glyph."""
        contours: list[tuple[Float64, NDArray[np.bool_]]] = []
        at, flags = 10, HAS_MORE if depth < MAX_COMPONENT_DEPTH else 0
        while flags & HAS_MORE:
            if next(parts, None) is None:
                raise ValueError(f"it has more than {MAX_COMPONENTS} parts")
            flags, glyph = struct.unpack(">HH", data[at : at + 4])
            arguments = struct.Struct(">hh" if flags & ARE_WORDS else ">bb")
            move = arguments.unpack_from(data, at + 4)
            at += 4 + arguments.size
            kinds = ((HAS_SCALE, 1), (HAS_TWO_SCALES, 2), (HAS_MATRIX, 4))
            number = next((number for kind, number in kinds if flags & kind), 0)
            scales = np.frombuffer(data[at : at + 2 * number], ">i2") / 16384.0
            at += 2 * number
            matrix = scales.reshape(2, 2) if number == 4 else np.diag([*scales, 1.0, 1.0][:2])
            if number == 1:
                matrix = scales[0] * np.eye(2)
            offset = np.array(move if flags & ARE_OFFSETS else (0, 0), np.float64)
            contours += [
                (points @ matrix + offset, is_on)
                for points, is_on in self._read_contours(glyph, parts, depth + 1)
            ]
        return contours

    def _read_postscript_outline(self, glyph: int) -> list[Float64]:
        """Return the contours of a glyph whose curves are cubic, each as quadratic ones."""
        from fontTools.pens.recordingPen import DecomposingRecordingPen

        font = self._fonttools_font
        glyphs = font.getGlyphSet()
        pen = DecomposingRecordingPen(glyphs)
        glyphs[font.getGlyphName(glyph)].draw(pen)
        contours: list[list[Float64]] = []
        here = start = np.zeros(2)
        for command, arguments in pen.value:
            points = [np.array(point, np.float64) for point in arguments]
            if command == "moveTo":
                here = start = points[0]
                contours.append([])
            elif command == "lineTo":
                contours[-1].append(np.stack([here, (here + points[0]) / 2.0, points[0]]))
                here = points[0]
            elif command == "curveTo":
                contours[-1] += _cubic_to_quadratics(here, *points)
                here = points[-1]
            elif command == "closePath" and not np.array_equal(here, start):
                contours[-1].append(np.stack([here, (here + start) / 2.0, start]))
                here = start
        return [np.array(point) for point in contours if point]

    @cached_property
    def _fonttools_font(self) -> Any:
        """The font as fontTools opens it."""
        from fontTools.ttLib import TTFont

        return TTFont(io.BytesIO(self._data), fontNumber=self._number, lazy=True)


class _KerningPairs:
    """
    Kerning of pairs of glyphs, or of pairs of classes of glyphs.

    Parameters
    ----------
    distances : dict of (int, int) to int
        Kerning by pairs of glyphs, or of classes; font units.
    coverage : set of int, optional
        First glyphs for which classes hold; None: pairs are of glyphs.
    firsts, seconds : dict of int to int
        Classes of glyphs; those that are not there have class 0.
    """

    def __init__(
        self,
        distances: dict[tuple[int, int], int],
        coverage: set[int] | None = None,
        firsts: dict[int, int] | None = None,
        seconds: dict[int, int] | None = None,
    ) -> None:
        self._distances, self._coverage = distances, coverage
        self._firsts, self._seconds = firsts or {}, seconds or {}

    def __call__(self, first: int, second: int) -> int | None:
        """Return the kerning of two glyphs, font units; None if this table has none."""
        if self._coverage is None:
            return self._distances.get((first, second))
        if first not in self._coverage:
            return None
        return self._distances.get((self._firsts.get(first, 0), self._seconds.get(second, 0)), 0)


def _read_kern_pairs(table: bytes) -> list[_KerningPairs]:
    """Return the horizontal pairs of the table kern, subtables of format 0."""
    distances: dict[tuple[int, int], int] = {}
    if table[:2] == b"\0\0":
        at, pairs_left = 4, MAX_TABLE_READS
        for _ in range(struct.unpack(">H", table[2:4])[0]):
            _, size, coverage = struct.unpack(">HHH", table[at : at + 6])
            if coverage & 0xFF07 == 1:
                (count,) = struct.unpack(">H", table[at + 6 : at + 8])
                pairs_left -= count
                if pairs_left < 0:
                    raise IndexError("too many pairs")
                pairs = struct.iter_unpack(">HHh", table[at + 14 : at + 14 + 6 * count])
                distances |= {(first, second): units for first, second, units in pairs}
            at += size
    return [_KerningPairs(distances)] if distances else []


def _read_gpos_pairs(table: bytes) -> list[_KerningPairs]:
    """Return the pairs of the kern feature of the table GPOS."""
    if not table:
        return []
    words = _Uint16Reader(table)
    features, lookups = words[6], words[8]
    numbers: dict[int, None] = {}
    for n in range(words[features]):
        record = features + 2 + 6 * n
        if table[record : record + 4] == b"kern":
            feature = features + words[record + 4]
            numbers |= dict.fromkeys(words[feature + 4 + 2 * k] for k in range(words[feature + 2]))
    tables = []
    for lookup in (lookups + words[lookups + 2 + 2 * n] for n in numbers):
        for k in range(words[lookup + 4]):
            kind, start = words[lookup], lookup + words[lookup + 6 + 2 * k]
            if kind == 9:  # One that stands farther away than 16 bits tell.
                kind = words[start + 2]
                start += struct.unpack(">I", table[start + 4 : start + 8])[0]
            if kind == 2:
                tables.append(_read_pair_subtable(words, start))
    return tables


def _read_pair_subtable(words: _Uint16Reader, start: int) -> _KerningPairs:
    """Return the pairs of a GPOS subtable of pair adjustments."""
    format_number, coverage = words[start], _read_coverage(words, start + words[start + 2])
    formats = words[start + 4], words[start + 6]
    sizes = [2 * bin(one & 0xFF).count("1") for one in formats]
    # Of the first glyph's values the advance counts; before it stand the two of its place.
    advance = 2 * bin(formats[0] & (X_ADVANCE_BIT - 1)).count("1")
    has_advance = bool(formats[0] & X_ADVANCE_BIT)
    distances: dict[tuple[int, int], int] = {}
    if not has_advance:
        return _KerningPairs(distances)
    if format_number == 1:
        for n, first in enumerate(coverage):
            pairs = start + words[start + 10 + 2 * n]
            for k in range(words[pairs]):
                record = pairs + 2 + k * (2 + sum(sizes))
                distances[first, words[record]] = words.signed(record + 2 + advance)
        return _KerningPairs(distances)
    firsts, seconds = (_read_classes(words, start + words[start + at]) for at in (8, 10))
    count = words[start + 14]
    for one in range(words[start + 12]):
        for other in range(count):
            record = start + 16 + (one * count + other) * sum(sizes)
            if units := words.signed(record + advance):
                distances[one, other] = units
    return _KerningPairs(distances, set(coverage), firsts, seconds)


class _Uint16Reader:
    """Reads 16-bit numbers of a table at byte offsets, up to a limit."""

    def __init__(self, table: bytes) -> None:
        self._table, self._reads_left = table, MAX_TABLE_READS

    def __getitem__(self, at: int) -> int:
        """Return an unsigned number; raise ``IndexError`` after `MAX_TABLE_READS`."""
        self._reads_left -= 1
        if self._reads_left < 0:
            raise IndexError("too many numbers")
        return int.from_bytes(self._table[at : at + 2], "big")

    def signed(self, at: int) -> int:
        """Return a signed number."""
        return int.from_bytes(self._table[at : at + 2], "big", signed=True)


def _read_coverage(words: _Uint16Reader, start: int) -> list[int]:
    """Return the glyphs of a coverage table, in order."""
    count = words[start + 2]
    if words[start] == 1:
        return [words[start + 4 + 2 * n] for n in range(count)]
    return [glyph for first, last, _ in _read_ranges(words, start + 4, count)
            for glyph in range(first, last + 1)]  # fmt: skip


def _read_classes(words: _Uint16Reader, start: int) -> dict[int, int]:
    """Return the class of each glyph of a class definition table."""
    if words[start] == 1:
        first = words[start + 2]
        return {first + n: words[start + 6 + 2 * n] for n in range(words[start + 4])}
    ranges = _read_ranges(words, start + 4, words[start + 2])
    return {glyph: number for first, last, number in ranges for glyph in range(first, last + 1)}


def _read_ranges(words: _Uint16Reader, start: int, count: int) -> Iterator[tuple[int, int, int]]:
    """Yield the first and the last glyph of each range, and its value."""
    for at in range(start, start + 6 * count, 6):
        yield words[at], words[at + 2], words[at + 4]


def _read_cmap_format_4(table: bytes) -> dict[int, int]:
    """Return the glyphs of a cmap subtable of format 4, by character."""
    glyphs: dict[int, int] = {}
    size = len(table) // 2
    words = np.frombuffer(table[: 2 * size], ">u2").astype(int)
    segments = words[3] // 2
    ends, firsts = words[7 : 7 + segments], words[8 + segments : 8 + 2 * segments]
    steps, ranges = (words[8 + k * segments : 8 + (k + 1) * segments] for k in (2, 3))
    _check_ranges(firsts, ends)
    for k in range(segments):
        for code in range(firsts[k], ends[k] + 1):
            at = 8 + 3 * segments + k + ranges[k] // 2 + code - firsts[k]
            distances = 0 if ranges[k] == 0 or at >= len(words) else words[at]
            if ranges[k] == 0 or distances:
                glyphs[code] = int((code if ranges[k] == 0 else distances) + steps[k]) & 0xFFFF
    return glyphs


def _check_ranges(firsts: NDArray[np.int_], lasts: NDArray[np.int_]) -> None:
    """Raise ``ValueError`` if ranges hold more characters than Unicode has."""
    if np.maximum(lasts - firsts + 1, 0).sum() > MAX_CHARACTERS:
        raise ValueError("its ranges of characters overlap")


def _cubic_to_quadratics(a: Float64, b: Float64, c: Float64, d: Float64) -> list[Float64]:
    """Approximate a cubic curve by four quadratic ones with the same ends and tangents."""
    curves = []
    for n in range(4):
        s, t = n / 4.0, (n + 1) / 4.0
        points = [
            _evaluate_blossom(a, b, c, d, *at)
            for at in ((s, s, s), (s, s, t), (s, t, t), (t, t, t))
        ]
        middle = (3.0 * (points[1] + points[2]) - points[0] - points[3]) / 4.0
        curves.append(np.stack([points[0], middle, points[3]]))
    return curves


def _evaluate_blossom(
    a: Float64, b: Float64, c: Float64, d: Float64, r: float, s: float, t: float
) -> Float64:
    """Return a control point of a part of a cubic curve: de Casteljau's steps at r, s and t."""
    points = [a, b, c, d]
    for share in (r, s, t):
        points = [one + share * (other - one) for one, other in pairwise(points)]
    return points[0]


def _split_contours(data: bytes, count: int) -> list[tuple[Float64, NDArray[np.bool_]]]:
    """Return the contours of a simple glyph: points, (N, 2), and which of them are on curve."""
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
        coordinate, coordinates = 0, []
        for flag in flags:
            if flag & short:
                coordinate += data[at] if flag & same else -data[at]
                at += 1
            elif not flag & same:
                coordinate += struct.unpack(">h", data[at : at + 2])[0]
                at += 2
            coordinates.append(coordinate)
        axes.append(coordinates)
    points = np.array(axes, np.float64).T
    is_on = np.array([bool(flag & ON_CURVE) for flag in flags])
    cuts = [end + 1 for end in ends[:-1]]
    return list(zip(np.split(points, cuts), np.split(is_on, cuts), strict=True))


def _make_curves(points: Float64, is_on: NDArray[np.bool_]) -> Float64:
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
def load_shipped_font() -> Font:
    """
    Return the font that Pillow ships.

    Raises
    ------
    ImportError
        If this Pillow was built without FreeType, and so without the font.
    """
    from PIL import ImageFont

    try:
        font = ImageFont.load_default(16)
    except ImportError as error:
        raise ImportError(
            "texts are drawn with the font that Pillow ships, and this Pillow was built without "
            f"FreeType ({error}), so it has none; that of PyPI has: pip install --force pillow"
        ) from error
    assert isinstance(font, ImageFont.FreeTypeFont)  # As it was asked for by its size.
    return Font(font.font_bytes)


def find_font(name: str | os.PathLike[str] | None) -> Font:
    """
    Return a font by its name or file.

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
        return load_shipped_font()
    if not isinstance(name, str | os.PathLike) or not str(name).strip():
        raise ValueError(f"font must be the name of a font or of its file, got {name!r}")
    path = Path(name)
    if path.suffix.lower() in FONT_SUFFIXES or len(path.parts) > 1:
        if not path.is_file():
            raise ValueError(f"font must be a file that is there, got {str(name)!r}")
        try:
            font = _open_font(os.path.abspath(path))
            # Read now, so that a damaged table is named here.
            font.characters  # noqa: B018
        except (OSError, ValueError, struct.error, IndexError) as error:
            raise ValueError(f"font must be a font, got {str(name)!r}: {error}") from None
        return font
    normalized = _normalize(str(name))
    # Most files are named as their font: look there first.
    for file in sorted(list_font_files(), key=lambda file: normalized not in _normalize(file)):
        for number, names in enumerate(_read_font_names(file)):
            if normalized in names:
                return _open_font(file, number)
    raise ValueError(
        f"font must be a file, or the name of a font that Matplotlib brings or the system has, got "
        f"{str(name)!r}"
    )


@functools.lru_cache(maxsize=1024)
def find_font_with(character: str, font: Font) -> Font | None:
    """Return the first font that has a character: the given one, Pillow's, or any other."""
    for one in (font, load_shipped_font()):
        if ord(character) in one.characters:
            return one
    for file in list_font_files():
        if _normalize(Path(file).stem).startswith(PLACEHOLDER_FONTS):
            continue
        if ord(character) in _read_character_codes(file):
            other = _open_font(file)
            if other.outline(other.characters[ord(character)]):
                return other
    return None


@functools.lru_cache(maxsize=1024)
def _read_character_codes(file: str) -> NDArray[np.int32]:
    """Return the codes of the characters that a font file has, (N,); none if it cannot be read."""
    try:
        # The font itself is not kept: there may be many, of many megabytes.
        return np.array(list(_open_font.__wrapped__(file).characters), np.int32)
    except (OSError, ValueError, struct.error, IndexError):
        return np.empty(0, np.int32)


@functools.cache
def list_font_files() -> tuple[str, ...]:
    """Return the files of the fonts that Matplotlib brings and the system has, the best first."""
    home = Path.home() if "HOME" in os.environ or os.name == "nt" else Path()
    folders = [home / ".fonts", home / ".local/share/fonts", Path("/usr/local/share/fonts"),
               Path("/usr/share/fonts")]  # fmt: skip
    if sys.platform == "darwin":
        folders = [home / "Library/Fonts", Path("/Library/Fonts"), Path("/System/Library/Fonts")]
    elif os.name == "nt":
        folders = [Path(os.environ.get("WINDIR", "C:/Windows")) / "Fonts"]
    matplotlib = importlib.util.find_spec("matplotlib")
    if matplotlib is not None and matplotlib.submodule_search_locations:
        folders.insert(0, Path(matplotlib.submodule_search_locations[0]) / "mpl-data/fonts/ttf")
    files = [
        os.path.join(root, name)
        for folder in folders
        for root, _, names in sorted(os.walk(folder))
        for name in sorted(names)
        if name.lower().endswith(FONT_SUFFIXES)
    ]

    def rank(file: str) -> tuple[bool, bool]:
        name = os.path.basename(file)
        is_styled = any(style in name.lower() for style in ("bold", "italic", "oblique", "mono"))
        return name not in FALLBACK_FONTS, is_styled

    return tuple(sorted(dict.fromkeys(files), key=rank))


@functools.lru_cache(maxsize=8)
def _open_font(file: str, number: int = 0) -> Font:
    """Return a font of a file; PostScript outlines need fontTools."""
    font = Font(_read_font_file(file), number)
    if "glyf" not in font.tables and importlib.util.find_spec("fontTools") is None:
        raise ValueError(
            "its outlines are PostScript's, which need fontTools: pip install fonttools"
        )
    return font


def _read_font_file(file: str) -> bytes:
    """Return a font file, or raise ``ValueError`` for one that is too large."""
    with open(file, "rb") as stream:
        data = stream.read(MAX_FONT_BYTES + 1)
    if len(data) > MAX_FONT_BYTES:
        raise ValueError(f"a font file may have {MAX_FONT_BYTES:,} bytes at most")
    return data


@functools.lru_cache(maxsize=4096)
def _read_font_names(file: str) -> list[set[str]]:
    """Return the names of each font in a file: family, style, file; none if it is damaged."""
    try:
        data = _read_font_file(file)
        count = struct.unpack(">I", data[8:12])[0] if data[:4] == COLLECTION_SIGNATURE else 1
        return [
            {_normalize(Path(file).stem)} | _read_names(Font(data, n))
            for n in range(min(count, 64))
        ]
    except (OSError, ValueError, struct.error):
        return []


def _read_names(font: Font) -> set[str]:
    """Return the names of a font's name table; a regular font has its family's, too."""
    table = font.tables.get("name", b"")
    strings: dict[int, str] = {}
    count, start = struct.unpack(">HH", table[2:6]) if table else (0, 0)
    for n in range(count):
        platform, _, _, kind, size, at = struct.unpack(">6H", table[6 + 12 * n : 18 + 12 * n])
        text = table[start + at : start + at + size]
        strings.setdefault(
            kind, text.decode("utf-16-be" if platform in (0, 3) else "latin-1", "ignore")
        )
    names = {strings[kind] for kind in (4, 6) if kind in strings}
    if strings.get(17, strings.get(2, "Regular")) in ("Regular", "Book", "Roman", "Normal"):
        names |= {strings[kind] for kind in (1, 16) if kind in strings}
    return {_normalize(name) for name in names}


def _normalize(name: str) -> str:
    """Return a name in lower case with letters and digits only, for comparison."""
    return "".join(one for one in name.casefold() if one.isalnum())
