"""Pictures beside each other: the original's, the adapter's, and the difference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

CELL = 280, 210
BAR = 16
GROUPS = 2
"""Scenes in a row."""
GAIN = 8.0
"""Differences are shown so many times as large."""


def draw_sheet(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Write one picture of all rows that have two pictures: theirs, ours, difference, for each."""
    shown = [row for row in rows if not isinstance(row["theirs"], str)]
    if not shown:
        return
    high = -(-len(shown) // GROUPS)
    sheet = Image.new("RGB", (GROUPS * (3 * CELL[0] + 8), high * (CELL[1] + BAR)), "white")
    pen = ImageDraw.Draw(sheet)
    for number, row in enumerate(shown):
        left, top = number % GROUPS * (3 * CELL[0] + 8), number // GROUPS * (CELL[1] + BAR)
        pen.text(
            (left + 2, top + 2),
            f"{row['scene']} {row['flag']}: pyrender, here, difference x 8",
            "black",
        )
        theirs = visible(row["theirs"])
        cells = [theirs]
        if not isinstance(row["ours"], str):
            ours = visible(row["ours"])
            cells += [ours, np.minimum(np.abs(theirs.astype(float) - ours) * GAIN, 255.0)]
        for place, cell in enumerate(cells):
            picture = Image.fromarray(cell.astype(np.uint8)).resize(CELL, Image.Resampling.BOX)
            sheet.paste(picture, (left + place * CELL[0], top + BAR))
    sheet.save(path)


def visible(picture: dict[str, NDArray[Any]]) -> NDArray[Any]:
    """Return a picture to look at: colours, over grey squares if there is alpha, or depth."""
    if "color" not in picture:
        depth = picture["depth"]
        farthest = max(float(depth.max()), 1e-9)
        grey = np.where(depth > 0.0, 255.0 * (1.0 - 0.8 * depth / farthest), 0.0)
        return np.repeat(grey[..., None], 3, axis=2)
    color = picture["color"].astype(float)
    if color.shape[2] == 3:
        return color
    rows, columns = np.indices(color.shape[:2]) // 16
    squares = np.where((rows + columns) % 2, 160.0, 200.0)[..., None]
    alpha = color[..., 3:] / 255.0
    return color[..., :3] * alpha + squares * (1.0 - alpha)
