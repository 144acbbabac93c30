"""Trace texts as outlines, for characters that the fonts of readers of PDF lack."""

from __future__ import annotations

import numpy as np

from rasterjit.hidden_lines.graphics import TEXT_SHIFTS, Text
from rasterjit.io.text_layout import SUBPIXEL_POSITIONS, lay_out, warn_of_missing
from rasterjit.scene.arrays import Float64

LAYOUT_SCALE = 64.0
"""How many times as large texts are laid out: positions are rounded to quarters of a pixel."""


def trace_text(text: Text) -> list[Float64]:
    """
    Return the contours of a text's characters.

    Returns
    -------
    list of (N, 3, 2) float64
        Quadratic curves, each from its first point to its last, bent by the one between; points of
        the page, y down.
    """
    contours = []
    for (line, _), baseline in zip(text.lines, text.baselines, strict=True):
        if not line.strip():
            continue
        layout = lay_out(line, LAYOUT_SCALE * text.size, "left", text.font)
        warn_of_missing(layout)
        left = text.x - TEXT_SHIFTS[text.align] * layout.width / LAYOUT_SCALE
        for one in layout.glyphs:
            x = left + (one.column + one.subpixel / SUBPIXEL_POSITIONS) / LAYOUT_SCALE
            scale = text.size / one.font.em * np.array([1.0, -1.0])
            contours += [curves * scale + (x, baseline) for curves in one.font.outline(one.glyph)]
    return contours
