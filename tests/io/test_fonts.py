"""Fonts of a few bytes that name their own parts again and again are read soon, or refused."""

from __future__ import annotations

import struct
import time

import pytest

from rasterjit.io.fonts import find_font

SQUARE = struct.pack(">h8xHH3B3h3h", 1, 2, 0, 1, 1, 1, 0, 100, 0, 0, 0, 100)
LETTER_A = (65, 65, 1)


def composite(part, count):
    """Return a glyph of so many times another one."""
    flags = [0x22] * (count - 1) + [2]
    return struct.pack(">h8x", -1) + b"".join(
        struct.pack(">HHbb", one, part, 0, 0) for one in flags
    )


def font(glyphs, subtables, group, **others):
    """Return a font whose subtables of cmap are one group of characters, at different places."""
    head, hhea = bytearray(54), bytearray(36)
    struct.pack_into(">H", head, 18, 1000)
    struct.pack_into(">h", head, 50, 1)
    struct.pack_into(">hhh24xH", hhea, 4, 800, -200, 0, 1)
    begins = [sum(map(len, glyphs[:n])) for n in range(len(glyphs) + 1)]
    one = struct.pack(">HHIIIIII", 12, 0, 28, 0, 1, *group)
    first = 4 + 8 * subtables
    places = [struct.pack(">HHI", 3, 10, first + n * len(one)) for n in range(subtables)]
    tables = {
        "head": bytes(head), "hhea": bytes(hhea), "hmtx": struct.pack(">HH", 500, 0),
        "loca": struct.pack(f">{len(begins)}I", *begins), "glyf": b"".join(glyphs),
        "cmap": struct.pack(">HH", 0, subtables) + b"".join(places) + one * subtables, **others,
    }  # fmt: skip
    at, listed = 12 + 16 * len(tables), b""
    for tag, content in tables.items():
        listed += struct.pack(">4sIII", tag.encode(), 0, at, len(content))
        at += len(content)
    return struct.pack(">IHHHH", 0x10000, len(tables), 0, 0, 0) + listed + b"".join(tables.values())


def test_parts_of_parts_of_glyphs_come_to_an_end(tmp_path):
    for count, has_outline in ((2, True), (20, False)):
        glyphs = [b"", *(composite(n + 1, count) for n in range(1, 9)), SQUARE]
        place = tmp_path / f"{count}.ttf"
        place.write_bytes(font(glyphs, 1, LETTER_A))
        before = time.thread_time()
        assert bool(find_font(place).outline(1)) == has_outline
        assert time.thread_time() - before < 10.0


def test_a_font_of_many_tables_of_all_characters_is_refused(tmp_path):
    place = tmp_path / "a.ttf"
    place.write_bytes(font([b"", SQUARE], 1000, (0, 0x10FFFF, 1)))
    with pytest.raises(ValueError, match=r"font must be a font, .* more than 64 tables"):
        find_font(place)


def test_pairs_of_kerning_come_to_an_end(tmp_path):
    place = tmp_path / "a.ttf"
    # A subtable without a size, which all begin with.
    kern = struct.pack(">HHHHHHHHH", 0, 0xFFFF, 0, 0, 1, 60_000, 0, 0, 0) + bytes(6 * 60_000)
    place.write_bytes(font([b"", SQUARE], 1, LETTER_A, kern=kern))
    before = time.thread_time()
    assert find_font(place).kerning(1, 1) == 0
    assert time.thread_time() - before < 20.0
