"""Draw colour bars: which colour of a picture stands for which value, with ticks and labels."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from decimal import ROUND_DOWN, Decimal
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.text_layout import draw_text, measure_text_width
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.scalar_field import ColorScale
from rasterjit.scene.validation import index_below

PAPER, INK = (255, 255, 255), (0, 0, 0)
"""Colours of the background, and of text and lines."""

FONT_SIZE_SHARE, MIN_FONT_SIZE = 1 / 30, 10
"""Font size as a share of the height of the picture, and the least font size, pixels."""

MIN_TICK_SPACING = 3
"""Distance of ticks, in font sizes."""

TICK_STEPS = (1, 2, 5, 10, 20)
"""Distances of ticks, times a power of ten; the first with few enough ticks is taken."""

MAX_DIGITS = 6
"""Numbers with more digits before or behind the point have a power of ten or an offset."""

MIN_EXPONENT = -4
"""Power of ten of the largest tick below which ticks are written with a power of ten."""


def find_scale(scales: Sequence[ColorScale | None], node: int | None) -> ColorScale:
    """
    Return the scale of a node, or the scale that all nodes with scalars share.

    Raises
    ------
    ValueError
        If there is none, or several without a node.
    """
    if node is not None:
        scale = scales[index_below("node", node, len(scales))]
        if scale is None:
            raise ValueError(f"node must be one whose mesh has scalars, got {node}")
        return scale
    present = [scale for scale in scales if scale is not None]
    if not present:
        raise ValueError("there is no colour bar: no mesh of the scene has scalars")
    if any(not scale.equals(present[0]) for scale in present):
        raise ValueError(
            "node must say whose colour bar it is, where meshes have several maps or ranges; give "
            "them one colormap and range for one bar, got None"
        )
    nan_scales = [scale for scale in present if scale.nan_color is not None]
    lines = dict.fromkeys(line for scale in present for line in scale.lines)
    return (nan_scales or present)[0]._replace(lines=tuple(lines))


def draw_colorbar(
    scale: ColorScale, height: int, title: str = "", font: str | os.PathLike[str] | None = None
) -> NDArray[np.uint8]:
    """
    Draw the colour bar of a scale, the highest value on top, with contours as lines across it.

    Where ticks have many digits, or are far from 1, a note above the bar has the factor of the
    numbers beside it, ``1e-7``, and the offset to add then, ``+1e9``.

    Parameters
    ----------
    scale : ColorScale
    height : int
        Pixels.
    title : str
        Above the bar.
    font : str or path, optional
        As `Label` takes it.

    Returns
    -------
    (height, W, 4) uint8
        sRGB, opaque; W follows from the labels.
    """
    from PIL import Image, ImageDraw

    # Choose ticks; a note above the bar shortens it, so they are chosen again.
    font_size = max(MIN_FONT_SIZE, round(FONT_SIZE_SHARE * height))
    low, high = scale.range
    top, bottom = font_size * (3 if title else 1), height - font_size
    if scale.nan_color is not None:
        bottom -= 2 * font_size
    ticks = find_ticks(low, high, _max_intervals(bottom - top, font_size))
    labels, note = format_ticks(ticks)
    if note:
        top += 2 * font_size
        ticks = find_ticks(low, high, _max_intervals(bottom - top, font_size))
        labels, note = format_ticks(ticks)
    bottom = max(bottom, top + 1)
    length, left, right = bottom - top, font_size, font_size + round(1.2 * font_size)
    if len(ticks) < 2 and high > low and length >= 2 * font_size:
        # A bar too short for round numbers says where it ends.
        ticks, note = [low, high], ""
        labels = [f"{end:.{MAX_DIGITS}g}" for end in ticks]
    # Find the width that the labels need.
    side_texts = [*labels, *(["NaN"] if scale.nan_color is not None else [])]
    text_left = right + font_size
    text_right = max(
        text_left + max(measure_text_width(text, font_size, font) for text in side_texts),
        left + max(measure_text_width(text, font_size, font) for text in (title, note)),
    )
    image = Image.new("RGB", (text_right + font_size, height), PAPER)
    pen = ImageDraw.Draw(image)
    # Draw the bar and its contours.
    heights = (length - 0.5 - np.arange(length)) / length
    entries = scale.colormap.entries(low + heights * (high - low), low, high)
    pixels = np.array(image)
    pixels[top:bottom, left:right] = _blend_over_paper(scale.colormap.codes[entries])[:, np.newaxis]
    image.paste(Image.fromarray(pixels))
    for level, color in scale.lines:
        y = bottom - 1 - round(_fraction(level, low, high) * (length - 1))
        pen.line((left, y, right - 1, y), fill=tuple(opaque_codes(color)[:3].tolist()))
    pen.rectangle((left - 1, top - 1, right, bottom), outline=INK)
    # Draw the ticks and the box of NaN, then all texts.
    captions: list[tuple[str, tuple[float, float], tuple[float, float]]] = []
    for tick, label in zip(ticks, labels, strict=True):
        y = bottom - 1 - round(_fraction(tick, low, high) * (length - 1))
        pen.line((right + 1, y, right + font_size // 2, y), fill=INK)
        captions.append((label, (text_left, y), (0.0, 0.5)))
    if scale.nan_color is not None:
        box = (left - 1, bottom + font_size, right, bottom + 2 * font_size)
        pen.rectangle(box, fill=tuple(opaque_codes(scale.nan_color)[:3].tolist()), outline=INK)
        captions.append(("NaN", (text_left, (box[1] + box[3]) // 2), (0.0, 0.5)))
    if title:
        captions.append((title, (left, font_size), (0.0, 0.0)))
    if note:
        captions.append((note, (left, top - 2 * font_size), (0.0, 0.0)))
    picture = np.full((height, image.width, 4), 255, np.uint8)
    picture[..., :3] = np.array(image)
    for text, position, anchor in captions:
        draw_text(picture[..., :3], text, position, font_size, INK, anchor=anchor, font=font)
    return picture


def append_bar(picture: NDArray[np.uint8], bar: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture, (H, W, 4), with a bar of its height to the right of it."""
    return np.concatenate([picture, bar], axis=1)


def _max_intervals(length: int, font_size: int) -> int:
    """Return how many intervals between ticks a bar has room for; both in pixels."""
    return max(1, length // (MIN_TICK_SPACING * font_size))


def _fraction(value: float, low: float, high: float) -> float:
    """Return the relative position of a value in a range, 0..1; 0.5 in an empty one."""
    return (value - low) / (high - low) if high > low else 0.5


def find_ticks(low: float, high: float, max_intervals: int) -> list[float]:
    """
    Return the ticks of a range: round numbers, at least one, ``max_intervals + 1`` at most.

    ``low`` alone where the range has no width, or is too narrow for round numbers.
    """
    min_step = (high - low) / max_intervals
    if not min_step > 0.0:
        return [low]
    # From text, so that each is rounded once.
    steps = [float(f"{factor}e{exponent_of(min_step)}") for factor in TICK_STEPS]
    if not (steps[0] > 0.0 and math.isfinite(max(abs(low), abs(high)) / steps[0])):
        return [low]
    counts = (math.floor(high / step) - math.ceil(low / step) + 1 for step in steps)
    sparse = (step for step, count in zip(steps, counts, strict=True) if count <= max_intervals + 1)
    step = next(sparse, steps[-1])
    ticks = [n * step for n in range(math.ceil(low / step), math.floor(high / step) + 1)]
    # So that 3 * 0.1 is 0.3.
    digits = -exponent_of(step)
    rounded = [round(tick, digits) + 0.0 for tick in ticks]
    inside = [tick for tick in rounded if low <= tick <= high]
    return list(dict.fromkeys(inside)) or [low]


def exponent_of(value: float) -> int:
    """Return the power of ten of a number's first decimal digit; 0 for 0."""
    return Decimal(repr(value)).adjusted() if value else 0


def format_ticks(ticks: Sequence[float]) -> tuple[list[str], str]:
    """
    Format ticks with as many digits as tell them apart; return a note of factor and offset.

    The note, as in Matplotlib, is the factor of the texts and then the offset: ``"1e-7"``,
    ``"+1e9"``, ``"1e-6+1"``; empty if the texts are the ticks themselves.
    """
    if len(ticks) == 1:
        return [f"{ticks[0]:.{MAX_DIGITS}g}"], ""
    # From text, so that each has the digits that it is written with.
    decimals = [Decimal(repr(tick)) for tick in ticks]
    # Differences are off by their last bits: 3e-9 - 2e-9 is below 1e-9.
    step_exponent = exponent_of(float(f"{min(b - a for a, b in pairwise(ticks)):.6g}"))
    offset = _shared_offset(decimals, step_exponent)
    shifted = [tick - offset for tick in decimals]
    largest_exponent = max(tick.adjusted() for tick in shifted if tick)
    has_factor = not MIN_EXPONENT <= largest_exponent < MAX_DIGITS or step_exponent < -MAX_DIGITS
    exponent = largest_exponent if has_factor else 0
    last_digit = Decimal(1).scaleb(min(0, step_exponent - exponent))
    texts = [f"{tick.scaleb(-exponent).quantize(last_digit):f}" for tick in shifted]
    note = f"1e{exponent}" if exponent else ""
    if offset:
        note += f"{offset.normalize():+}".replace("E+", "e").replace("E", "e")
    # Zero has no sign.
    return [text if float(text) else text.removeprefix("-") for text in texts], note


def _shared_offset(ticks: Sequence[Decimal], step_exponent: int) -> Decimal:
    """Return the offset that ticks share, if it has many more digits than their differences."""
    low, high = ticks[0], ticks[-1]
    if low * high <= 0 or max(abs(low), abs(high)).adjusted() - step_exponent < MAX_DIGITS:
        return Decimal(0)
    # Ticks less the offset have a digit more than their differences.
    exponent = (high - low).adjusted() + 1
    smallest = low if low > 0 else high
    return smallest.scaleb(-exponent).to_integral_value(ROUND_DOWN).scaleb(exponent)


def _blend_over_paper(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the sRGB codes, (N, 3), of colours with alpha, (N, 4), over the paper."""
    alpha = codes[:, 3:].astype(np.float64) / 255.0
    blended: NDArray[Any] = alpha * codes[:, :3] + (1.0 - alpha) * np.array(PAPER)
    return np.floor(blended + 0.5).astype(np.uint8)
