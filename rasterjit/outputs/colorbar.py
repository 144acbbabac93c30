"""Draw colour bars: which colour of a picture stands for which value, with ticks and labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.color import opaque_codes
from rasterjit.scene.field import ColorScale
from rasterjit.scene.validation import index_below

if TYPE_CHECKING:
    from PIL import ImageFont

PAPER, INK = (255, 255, 255), (0, 0, 0)
"""The colours of a bar's ground, and of its text and lines."""

FONT_SHARE, LEAST_FONT = 1 / 30, 10
"""How high text is, of the height of the bar's picture; and its least height, pixels."""

LINES_PER_TICK = 3
"""Most ticks: one for so many lines of text."""

STEPS = (1, 2, 5, 10, 20)
"""Ticks lie at multiples of one of these times a power of ten, the first that are few enough."""

PLAIN_DIGITS = 6
"""Numbers of more digits before or behind the point are written with a power of ten."""


def scale_of(scales: Sequence[ColorScale | None], node: int | None) -> ColorScale:
    """
    Return the scale of a node, or that of all nodes that have one.

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
    found = [scale for scale in scales if scale is not None]
    if not found:
        raise ValueError("there is no colour bar: no mesh of the scene has scalars")
    if any(not scale.same(found[0]) for scale in found):
        raise ValueError(
            "node must say whose colour bar it is, where meshes have several maps or ranges; give "
            "them one colormap and range for one bar, got None"
        )
    with_nan = [scale for scale in found if scale.nan_color is not None]
    return with_nan[0] if with_nan else found[0]


def draw_colorbar(scale: ColorScale, height: int, title: str = "") -> NDArray[np.uint8]:
    """
    Draw the bar of a scale, the highest value on top.

    Parameters
    ----------
    scale : ColorScale
    height : int
        Pixels.
    title : str
        Above the bar.

    Returns
    -------
    (height, W, 4) uint8
        sRGB, opaque; W follows from the labels.
    """
    from PIL import Image, ImageDraw, ImageFont

    size = max(LEAST_FONT, round(FONT_SHARE * height))
    font = ImageFont.load_default(size)
    top, bottom = size * (3 if title else 1), height - size
    if scale.nan_color is not None:
        bottom -= 2 * size
    bottom = max(bottom, top + 1)
    length, left, right = bottom - top, size, size + round(1.2 * size)
    low, high = scale.range
    ticks = find_ticks(low, high, max(1, length // (LINES_PER_TICK * size)))
    labels = write_ticks(ticks)
    if len(ticks) < 2 and high > low and length >= 2 * size:
        # A short bar without room for round numbers says where it ends.
        ticks, labels = [low, high], [f"{end:.{PLAIN_DIGITS}g}" for end in (low, high)]
    texts = [*labels, *(["NaN"] if scale.nan_color is not None else [])]
    widest = max(_width(font, text) for text in texts)
    text_left = right + size
    width = max(text_left + widest, left + _width(font, title)) + size
    image = Image.new("RGB", (width, height), PAPER)
    pen = ImageDraw.Draw(image)
    # The bar itself, entry by entry.
    places = (length - 0.5 - np.arange(length)) / length
    entries = scale.colormap.entries(low + places * (high - low), low, high)
    pixels = np.array(image)
    pixels[top:bottom, left:right] = _on_paper(scale.colormap.codes[entries])[:, np.newaxis]
    image.paste(Image.fromarray(pixels))
    pen.rectangle((left - 1, top - 1, right, bottom), outline=INK)
    for tick, label in zip(ticks, labels, strict=True):
        share = (tick - low) / (high - low) if high > low else 0.5
        y = bottom - 1 - round(share * (length - 1))
        pen.line((right + 1, y, right + size // 2, y), fill=INK)
        pen.text((text_left, y), label, fill=INK, font=font, anchor="lm")
    if scale.nan_color is not None:
        box = (left - 1, bottom + size, right, bottom + 2 * size)
        nan = tuple(opaque_codes(scale.nan_color)[:3].tolist())
        pen.rectangle(box, fill=nan, outline=INK)
        middle = (box[1] + box[3]) // 2
        pen.text((text_left, middle), "NaN", fill=INK, font=font, anchor="lm")
    if title:
        pen.text((left, size), title, fill=INK, font=font, anchor="lt")
    drawn = np.full((height, width, 4), 255, np.uint8)
    drawn[..., :3] = np.array(image)
    return drawn


def beside(picture: NDArray[np.uint8], bar: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture, (H, W, 4), with a bar of its height to the right of it."""
    return np.concatenate([picture, bar], axis=1)


def find_ticks(low: float, high: float, most: int) -> list[float]:
    """
    Return where a range has ticks: round numbers, at least one, ``most + 1`` at most.

    ``low`` alone where the range has no width, or is too narrow for round numbers.
    """
    width = high - low
    if width <= 0.0:
        return [low]
    if not width / most > 0.0:
        return [low]
    # From text, so that each is rounded once.
    steps = [float(f"{factor}e{exponent_of(width / most)}") for factor in STEPS]
    if not (steps[0] > 0.0 and math.isfinite(max(abs(low), abs(high)) / steps[0])):
        return [low]
    counts = (math.floor(high / step) - math.ceil(low / step) + 1 for step in steps)
    fitting = (step for step, count in zip(steps, counts, strict=True) if count <= most + 1)
    step = next(fitting, steps[-1])
    ticks = [n * step for n in range(math.ceil(low / step), math.floor(high / step) + 1)]
    # So that 3 * 0.1 is 0.3.
    digits = -exponent_of(step)
    rounded = [round(tick, digits) + 0.0 for tick in ticks]
    held = [tick for tick in rounded if low <= tick <= high]
    return list(dict.fromkeys(held)) or [low]


def exponent_of(value: float) -> int:
    """Return the power of ten of a number's first digit, as it is written; 0 for 0."""
    return Decimal(repr(value)).adjusted() if value else 0


def write_ticks(ticks: Sequence[float]) -> list[str]:
    """Return ticks as text, all in one way, with as many digits as tell them apart."""
    largest = max(abs(tick) for tick in ticks)
    if len(ticks) == 1:
        return [f"{ticks[0]:.{PLAIN_DIGITS}g}"]
    # Differences are off by their last bits: 3e-9 - 2e-9 is below 1e-9.
    step = float(f"{min(b - a for a, b in pairwise(ticks)):.6g}")
    digits = max(0, -exponent_of(step))
    if exponent_of(largest) < PLAIN_DIGITS and digits <= PLAIN_DIGITS:
        return [f"{tick:.{digits}f}" for tick in ticks]
    places = max(0, exponent_of(largest) - exponent_of(step))
    return [f"{tick:.{places}e}" if tick else "0" for tick in ticks]


def _width(font: ImageFont.FreeTypeFont | ImageFont.ImageFont, text: str) -> int:
    """Return how wide a text is, pixels."""
    return math.ceil(font.getlength(text)) if text else 0


def _on_paper(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return sRGB codes, (N, 3), of colours with an alpha, (N, 4), mixed with the paper."""
    shares = codes[:, 3:].astype(np.float64) / 255.0
    mixed: NDArray[Any] = shares * codes[:, :3] + (1.0 - shares) * np.array(PAPER)
    return np.floor(mixed + 0.5).astype(np.uint8)
