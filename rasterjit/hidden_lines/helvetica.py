"""Helvetica, which every reader of PDF has: widths of its characters, and their codes."""

from __future__ import annotations

import unicodedata

ASCENT = 0.77
"""Height of a line above its baseline, as a share of the size."""

PITCH = 1.15
"""Distance of baselines, as a share of the size."""

WIDTHS = (
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556,
    556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667,
    611, 778, 722, 278, 500, 667, 556, 833, 722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667,
    667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500,
    222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
)  # fmt: skip
"""Of the characters from the blank to the tilde, thousandths of the size."""

OTHER_WIDTHS = {
    "\u00a0": 278, "€": 556, "…": 1000, "‘": 222, "’": 222, "“": 333, "”": 333, "•": 350,
    "–": 556, "—": 1000, "°": 400, "±": 584, "×": 584, "÷": 584, "²": 333, "³": 333, "¹": 333,
    "·": 278, "µ": 556, "½": 834, "¼": 834, "¾": 834, "ß": 611, "æ": 889, "Æ": 1000, "ø": 611,
    "Ø": 778, "œ": 944, "Œ": 1000, "§": 556, "«": 556, "»": 556, "‰": 1000, "™": 1000, "©": 737,
    "®": 737, "ì": 278, "í": 278, "î": 278, "ï": 278, "¿": 611, "¡": 333, "Ð": 722, "Þ": 667,
    "þ": 556, "ð": 556, "‹": 333, "›": 333, "ª": 370, "º": 365, "¬": 584, "¯": 333, "¨": 333,
    "´": 333, "¸": 333, "ˆ": 333, "˜": 333, "‚": 222, "„": 333, "¦": 260, "¶": 537,
}  # fmt: skip
"""Of characters that are not those with an accent; all else is 556 wide, as digits are."""


def measure_width(text: str) -> float:
    """Return the width of a line of text, as a share of the size."""
    return sum(map(_find_width, text)) / 1000.0


def _find_width(character: str) -> int:
    """Return the width of a character, thousandths of the size."""
    if character in OTHER_WIDTHS:
        return OTHER_WIDTHS[character]
    number = ord(unicodedata.normalize("NFD", character)[0]) - ord(" ")
    return WIDTHS[number] if 0 <= number < len(WIDTHS) else 556


def has_characters(text: str) -> bool:
    """Tell whether the font has all characters of a text in PDF."""
    return text.encode("cp1252", "ignore").decode("cp1252") == text
