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

from rasterjit.io.text_layout import draw_text, text_width
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.scalar_field import ColorScale
from rasterjit.scene.validation import index_below

PAPER, INK = (255, 255, 255), (0, 0, 0)
"""Colours of the background, and of text and lines."""

FONT_SHARE, MIN_FONT = 1 / 30, 10
"""Font size as a share of the height of the picture, and the least font size, pixels."""

LINES_PER_TICK = 3
"""Lines of text for each tick, at least."""

STEPS = (1, 2, 5, 10, 20)
"""Ticks lie at multiples of one of these times a power of ten, the first that are few enough."""

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
    given = [scale for scale in scales if scale is not None]
    if not given:
        raise ValueError("there is no colour bar: no mesh of the scene has scalars")
    if any(not scale.equals(given[0]) for scale in given):
        raise ValueError(
            "node must say whose colour bar it is, where meshes have several maps or ranges; give "
            "them one colormap and range for one bar, got None"
        )
    nan_scales = [scale for scale in given if scale.nan_color is not None]
    lines = dict.fromkeys(line for scale in given for line in scale.lines)
    return (nan_scales or given)[0]._replace(lines=tuple(lines))


def draw_colorbar(
    scale: ColorScale, height: int, title: str = "", font: str | os.PathLike[str] | None = None
) -> NDArray[np.uint8]:
    """
    Draw the colour bar of a scale, the highest value on top, with contours as lines across it.

    Where ticks have many digits, or are far from 1, what is above the bar says what to multiply the
    numbers beside it with, ``1e-7``, and what to add then, ``+1e9``.

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

    size = max(MIN_FONT, round(FONT_SHARE * height))
    low, high = scale.range
    top, bottom = size * (3 if title else 1), height - size
    if scale.nan_color is not None:
        bottom -= 2 * size
    ticks = _ticks_of(low, high, bottom - top, size)
    labels, note = format_ticks(ticks)
    if note:
        top += 2 * size
        ticks = _ticks_of(low, high, bottom - top, size)
        labels, note = format_ticks(ticks)
    bottom = max(bottom, top + 1)
    length, left, right = bottom - top, size, size + round(1.2 * size)
    if len(ticks) < 2 and high > low and length >= 2 * size:
        # A short bar without room for round numbers says where it ends.
        ticks, note = [low, high], ""
        labels = [f"{end:.{MAX_DIGITS}g}" for end in ticks]
    texts = [*labels, *(["NaN"] if scale.nan_color is not None else [])]
    widest = max(text_width(text, size, font) for text in texts)
    text_left = right + size
    width = (
        max(text_left + widest, left + max(text_width(one, size, font) for one in (title, note)))
        + size
    )
    image = Image.new("RGB", (width, height), PAPER)
    pen = ImageDraw.Draw(image)
    # The bar itself, entry by entry.
    heights = (length - 0.5 - np.arange(length)) / length
    entries = scale.colormap.entries(low + heights * (high - low), low, high)
    pixels = np.array(image)
    pixels[top:bottom, left:right] = _over_paper(scale.colormap.codes[entries])[:, np.newaxis]
    image.paste(Image.fromarray(pixels))
    for level, color in scale.lines:
        y = bottom - 1 - round(_fraction(level, low, high) * (length - 1))
        pen.line((left, y, right - 1, y), fill=tuple(opaque_codes(color)[:3].tolist()))
    pen.rectangle((left - 1, top - 1, right, bottom), outline=INK)
    captions: list[tuple[str, tuple[float, float], tuple[float, float]]] = []
    for tick, label in zip(ticks, labels, strict=True):
        y = bottom - 1 - round(_fraction(tick, low, high) * (length - 1))
        pen.line((right + 1, y, right + size // 2, y), fill=INK)
        captions.append((label, (text_left, y), (0.0, 0.5)))
    if scale.nan_color is not None:
        box = (left - 1, bottom + size, right, bottom + 2 * size)
        nan = tuple(opaque_codes(scale.nan_color)[:3].tolist())
        pen.rectangle(box, fill=nan, outline=INK)
        middle = (box[1] + box[3]) // 2
        captions.append(("NaN", (text_left, middle), (0.0, 0.5)))
    if title:
        captions.append((title, (left, size), (0.0, 0.0)))
    if note:
        captions.append((note, (left, top - 2 * size), (0.0, 0.0)))
    picture = np.full((height, width, 4), 255, np.uint8)
    picture[..., :3] = np.array(image)
    for text, position, anchor in captions:
        draw_text(picture[..., :3], text, position, size, INK, anchor=anchor, font=font)
    return picture


def append_bar(picture: NDArray[np.uint8], bar: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture, (H, W, 4), with a bar of its height to the right of it."""
    return np.concatenate([picture, bar], axis=1)


def _ticks_of(low: float, high: float, length: int, size: int) -> list[float]:
    """Return the ticks of a bar so long, beside text so high, pixels."""
    return find_ticks(low, high, max(1, length // (LINES_PER_TICK * size)))


def _fraction(value: float, low: float, high: float) -> float:
    """Return the relative position of a value in a range, 0..1; 0.5 in an empty one."""
    return (value - low) / (high - low) if high > low else 0.5


def find_ticks(low: float, high: float, limit: int) -> list[float]:
    """
    Return the ticks of a range: round numbers, at least one, ``limit + 1`` at most.

    ``low`` alone where the range has no width, or is too narrow for round numbers.
    """
    width = high - low
    if width <= 0.0:
        return [low]
    if not width / limit > 0.0:
        return [low]
    # From text, so that each is rounded once.
    steps = [float(f"{factor}e{exponent_of(width / limit)}") for factor in STEPS]
    if not (steps[0] > 0.0 and math.isfinite(max(abs(low), abs(high)) / steps[0])):
        return [low]
    counts = (math.floor(high / step) - math.ceil(low / step) + 1 for step in steps)
    fitting = (step for step, count in zip(steps, counts, strict=True) if count <= limit + 1)
    step = next(fitting, steps[-1])
    ticks = [n * step for n in range(math.ceil(low / step), math.floor(high / step) + 1)]
    # So that 3 * 0.1 is 0.3.
    digits = -exponent_of(step)
    rounded = [round(tick, digits) + 0.0 for tick in ticks]
    inside = [tick for tick in rounded if low <= tick <= high]
    return list(dict.fromkeys(inside)) or [low]


def exponent_of(value: float) -> int:
    """Return the power of ten of a number's first digit, as it is written; 0 for 0."""
    return Decimal(repr(value)).adjusted() if value else 0


def format_ticks(ticks: Sequence[float]) -> tuple[list[str], str]:
    """
    Format ticks with as many digits as tell them apart; return a note of factor and offset.

    The note says what number the texts are to be multiplied with, and what is to be added then:
    ``"1e-7"``, ``"+1e9"``, ``"1e-6+1"``, as Matplotlib has it; empty if they are the ticks.
    """
    if len(ticks) == 1:
        return [f"{ticks[0]:.{MAX_DIGITS}g}"], ""
    # From text, so that each has the digits that it is written with.
    exact = [Decimal(repr(tick)) for tick in ticks]
    # Differences are off by their last bits: 3e-9 - 2e-9 is below 1e-9.
    step = exponent_of(float(f"{min(b - a for a, b in pairwise(ticks)):.6g}"))
    offset = _offset_of(exact, step)
    rest = [tick - offset for tick in exact]
    largest = max(one.adjusted() for one in rest if one)
    power = 0
    if largest >= MAX_DIGITS or step < -MAX_DIGITS or largest < MIN_EXPONENT:
        power = largest
    digits = max(0, power - step)
    texts = [f"{one.scaleb(-power).quantize(Decimal(1).scaleb(-digits)):f}" for one in rest]
    note = f"1e{power}" if power else ""
    return [_unsigned_zero(text) for text in texts], note + (_signed(offset) if offset else "")


def _offset_of(ticks: Sequence[Decimal], step: int) -> Decimal:
    """Return the offset that ticks share, if it has many more digits than their differences."""
    low, high = ticks[0], ticks[-1]
    if low * high <= 0:
        return Decimal(0)
    if max(abs(low), abs(high)).adjusted() - step < MAX_DIGITS:
        return Decimal(0)
    # What is left has a digit more than the differences.
    power = (high - low).adjusted() + 1
    toward_zero = low if low > 0 else high
    return toward_zero.scaleb(-power).to_integral_value(ROUND_DOWN).scaleb(power)


def _signed(value: Decimal) -> str:
    """Return a number that is added, with its sign and without zeros behind."""
    return f"{value.normalize():+}".replace("E+", "e").replace("E", "e")


def _unsigned_zero(text: str) -> str:
    """Return a text of zero without its sign."""
    return text.removeprefix("-") if not float(text) else text


def _over_paper(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return sRGB codes, (N, 3), of colours with an alpha, (N, 4), mixed with the paper."""
    shares = codes[:, 3:].astype(np.float64) / 255.0
    mixed: NDArray[Any] = shares * codes[:, :3] + (1.0 - shares) * np.array(PAPER)
    return np.floor(mixed + 0.5).astype(np.uint8)
