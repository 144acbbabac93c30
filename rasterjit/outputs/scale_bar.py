"""Draw scale bars: a line or an arrow of a round length in the units of the scene."""

from __future__ import annotations

import math
import os

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.text_layout import draw_text
from rasterjit.outputs.colorbar import INK, PAPER
from rasterjit.outputs.ticks import exponent_of
from rasterjit.scene.camera import Camera
from rasterjit.scene.validation import positive_number

MAX_LENGTH_SHARE = 0.35
"""Longest bar, as a share of the picture's width."""

FONT_SIZE_PX = 13
"""Height of text."""

MARGIN_PX, HEIGHT_PX = 8, 36
"""Distance of the bar from the left, and height of the strip."""


def draw_scale_bar(
    camera: Camera,
    size: tuple[int, int],
    unit: str,
    per_unit: float,
    depth: float | None,
    is_arrow: bool,
    font: str | os.PathLike[str] | None,
) -> NDArray[np.uint8]:
    """Draw a strip as wide as a picture with the longest round bar that has room; (h, W, 4)."""
    width = size[0]
    pixels = _pixels_per_scene_unit(camera, size, depth) * per_unit
    longest = MAX_LENGTH_SHARE * width / pixels if pixels > 0.0 else math.inf
    if not 0.0 < longest < math.inf:
        raise ValueError(
            f"per_unit must give the bar a length that a number can have, got {per_unit!r}"
        )
    value = _round_down(longest)
    # In narrow pictures the margin gives way to the bar.
    length, row = max(round(value * pixels), 1), HEIGHT_PX // 3
    left = min(MARGIN_PX, width - length)
    right = left + length - 1
    picture = np.full((HEIGHT_PX, width, 4), 255, np.uint8)
    picture[..., :3] = PAPER
    picture[row - 1 : row + 1, left : right + 1, :3] = INK
    if is_arrow:
        for step in range(min(6, right - left + 1)):
            half = (step + 1) // 2
            picture[row - 1 - half : row + 1 + half, right - step, :3] = INK
    else:
        picture[row - 4 : row + 4, [left, right], :3] = INK
    position = left, HEIGHT_PX * 3 / 4
    text = f"{value:g} {unit}".strip()
    draw_text(picture[..., :3], text, position, FONT_SIZE_PX, INK, anchor=(0.0, 0.5), font=font)
    return picture


def _round_down(length: float) -> float:
    """Return the greatest 1, 2 or 5 times a power of ten that is not above a length."""
    exponent = exponent_of(length)
    return max(value for factor in (1, 2, 5) if (value := float(f"{factor}e{exponent}")) <= length)


def _pixels_per_scene_unit(camera: Camera, size: tuple[int, int], depth: float | None) -> float:
    """Return how many pixels a scene unit across the view is long, at a depth."""
    if not hasattr(camera, "projection_matrix"):
        raise ValueError("there is no scale bar of a lens, whose scale differs all over")
    matrix = np.asarray(camera.projection_matrix(size), np.float64)
    is_parallel = not matrix[3, :3].any()
    if depth is None:
        if not is_parallel:
            raise ValueError(
                "depth must say where the scale is that of the bar, for the camera has a "
                "perspective; got None"
            )
        depth = 1.0
    ahead = -positive_number("depth", depth)
    w = matrix[3, 2] * ahead + matrix[3, 3]
    return float(abs(matrix[0, 0] / w) * size[0] / 2.0)
