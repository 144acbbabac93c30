"""Draw colour bars: which colour of a picture stands for which value, with ticks and labels."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.text_layout import draw_text, measure_text_width
from rasterjit.outputs.ticks import MAX_DIGITS, Ticks, make_ticks
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.scalar_field import ColorScale
from rasterjit.scene.validation import brief, index_below, one_of

PAPER, INK = (255, 255, 255), (0, 0, 0)
"""Colours of the background, and of text and lines."""

FONT_SIZE_SHARE, MIN_FONT_SIZE = 1 / 30, 10
"""Font size as a share of the height of the picture, and the least font size, pixels."""

MIN_TICK_SPACING = 3
"""Distance of ticks, in font sizes."""

Extend: TypeAlias = Literal["neither", "min", "max", "both"]
EXTENDS: tuple[Extend, ...] = get_args(Extend)
"""Ends of a bar that are arrows: values beyond them are shown, too."""


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
    return merge_scales([scale for scale in scales if scale is not None])


def merge_scales(present: Sequence[ColorScale]) -> ColorScale:
    """
    Return the scale of all of some, with the contours of all.

    Raises
    ------
    ValueError
        If there is none, or they are several.
    """
    if not present:
        raise ValueError("there is no colour bar: no mesh of the scene has scalars")
    if any(not scale.equals(present[0]) for scale in present):
        raise ValueError(
            "node must say whose colour bar it is, where meshes have several maps, norms or "
            "ranges; give them one colormap, norm and range for one bar, got None"
        )
    nan_scales = [scale for scale in present if scale.nan_color is not None]
    lines = dict.fromkeys(line for scale in present for line in scale.lines)
    below, above = (any(ends) for ends in zip(*(scale.exceeds for scale in present), strict=True))
    return (nan_scales or present)[0]._replace(lines=tuple(lines), exceeds=(below, above))


class _Bar(NamedTuple):
    """Where a bar stands in its picture, pixels: its rectangle, and the heights of its arrows."""

    left: int
    right: int
    top: int
    bottom: int
    arrows: tuple[int, int]
    """Below and above the rectangle; 0 for none."""

    def row(self, fraction: float) -> int:
        """Return the row of a share of the range, 0 at the bottom to 1."""
        return self.bottom - 1 - round(fraction * (self.bottom - self.top - 1))


def draw_colorbar(
    scale: ColorScale,
    height: int,
    title: str = "",
    font: str | os.PathLike[str] | None = None,
    *,
    unit: str = "",
    extend: Extend | None = None,
    font_size: int | None = None,
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
    unit : str
        Behind the title in parentheses; behind the note where there is one.
    extend : {"neither", "min", "max", "both"}, optional
        Which ends are arrows. Default: those that values lie beyond.
    font_size : int, optional
        Pixels. Default: a share of the height.

    Returns
    -------
    (height, W, 4) uint8
        sRGB, opaque; W follows from the labels.
    """
    from PIL import Image, ImageDraw

    if font_size is None:
        font_size = max(MIN_FONT_SIZE, round(FONT_SIZE_SHARE * height))
    arrows = _find_arrows(scale, extend)
    bar, ticks, title = _fit_bar(scale, height, font_size, title, unit, arrows)
    # Find the width that the labels need.
    side_texts = [*ticks.texts, *(["NaN"] if scale.nan_color is not None else [])]
    text_left = bar.right + font_size
    text_right = max(
        text_left + max(measure_text_width(text, font_size, font) for text in side_texts),
        bar.left + max(measure_text_width(text, font_size, font) for text in (title, ticks.note)),
    )
    image = Image.new("RGB", (text_right + font_size, height), PAPER)
    pen = ImageDraw.Draw(image)
    # Draw the bar and its contours.
    pixels = np.array(image)
    pixels[bar.top : bar.bottom, bar.left : bar.right] = _bar_colors(scale, bar)[:, np.newaxis]
    image.paste(Image.fromarray(pixels))
    for level, color in scale.lines:
        y = bar.row(scale.norm.fraction(level))
        pen.line((bar.left, y, bar.right - 1, y), fill=tuple(opaque_codes(color)[:3].tolist()))
    _outline_bar(pen, scale, bar)
    # Draw the ticks and the box of NaN, then all texts.
    captions: list[tuple[str, tuple[float, float], tuple[float, float]]] = []
    for tick, label in zip(ticks.values, ticks.texts, strict=True):
        y = bar.row(scale.norm.fraction(tick))
        pen.line((bar.right + 1, y, bar.right + font_size // 2, y), fill=INK)
        captions.append((label, (text_left, y), (0.0, 0.5)))
    for tick in ticks.minors:
        y = bar.row(scale.norm.fraction(tick))
        pen.line((bar.right + 1, y, bar.right + font_size // 4, y), fill=INK)
    if scale.nan_color is not None:
        foot = bar.bottom + bar.arrows[0]
        box = (bar.left - 1, foot + font_size, bar.right, foot + 2 * font_size)
        pen.rectangle(box, fill=tuple(opaque_codes(scale.nan_color)[:3].tolist()), outline=INK)
        captions.append(("NaN", (text_left, (box[1] + box[3]) // 2), (0.0, 0.5)))
    if title:
        captions.append((title, (bar.left, font_size), (0.0, 0.0)))
    if ticks.note:
        note_top = bar.top - bar.arrows[1] - 2 * font_size
        captions.append((ticks.note, (bar.left, note_top), (0.0, 0.0)))
    picture = np.full((height, image.width, 4), 255, np.uint8)
    picture[..., :3] = np.array(image)
    for text, position, anchor in captions:
        draw_text(picture[..., :3], text, position, font_size, INK, anchor=anchor, font=font)
    return picture


def _find_arrows(scale: ColorScale, extend: Extend | None) -> tuple[bool, bool]:
    """Return whether a bar ends in an arrow below, and above."""
    if extend is None:
        return scale.exceeds
    one_of("extend", extend, EXTENDS)
    return extend in ("min", "both"), extend in ("max", "both")


def _fit_bar(
    scale: ColorScale,
    height: int,
    font_size: int,
    title: str,
    unit: str,
    has_arrows: tuple[bool, bool],
) -> tuple[_Bar, Ticks, str]:
    """Return the place of a bar, the ticks that it has room for, and its title with the unit."""
    arrows = int(has_arrows[0]) * font_size, int(has_arrows[1]) * font_size
    top, bottom = font_size * (3 if title else 1) + arrows[1], height - font_size - arrows[0]
    if scale.nan_color is not None:
        bottom -= 2 * font_size
    is_unit_alone = bool(unit) and not title
    top += 2 * font_size if is_unit_alone else 0
    ticks = make_ticks(scale, _max_intervals(bottom - top, font_size))
    # A note above the bar shortens it, so ticks are chosen again.
    if ticks.note and not is_unit_alone:
        top += 2 * font_size
        ticks = make_ticks(scale, _max_intervals(bottom - top, font_size))
    bottom = max(bottom, top + 1)
    low, high = scale.norm.range
    has_names = bool(scale.colormap.categories)
    if len(ticks.values) < 2 and high > low and not has_names and bottom - top >= 2 * font_size:
        # A bar too short for round numbers says where it ends.
        ticks = Ticks([low, high], [f"{end:.{MAX_DIGITS}g}" for end in (low, high)])
    if title and unit and not ticks.note:
        title = f"{title} ({unit})"
    else:
        ticks = ticks._replace(note=f"{ticks.note} {unit}".strip())
    return _Bar(font_size, font_size + round(1.2 * font_size), top, bottom, arrows), ticks, title


def _bar_colors(scale: ColorScale, bar: _Bar) -> NDArray[np.uint8]:
    """Return the colour of each row of a bar from the top, (L, 3) sRGB codes."""
    length = bar.bottom - bar.top
    heights = (length - 0.5 - np.arange(length)) / length
    colors = scale.colormap.codes
    if scale.norm.bounds:
        # Bounds are evenly spaced: each row has the colour of the middle between two.
        bounds = np.array(scale.norm.bounds)
        middles = (bounds[:-1] + bounds[1:]) / 2.0
        regions = np.floor(heights * len(middles)).astype(np.int64)
        ranks = np.clip(scale.norm.ranks(middles, len(colors)), -1, len(colors))
        ends = [opaque_codes(end) for end in (scale.colormap.under, scale.colormap.over)]
        colors = np.vstack([ends[0], colors, ends[1]])
        entries = 1 + ranks[regions]
    else:
        has_width = scale.norm.range[0] < scale.norm.range[1]
        entries = np.floor(heights * len(colors) * has_width)
    return _blend_over_paper(colors[entries.astype(np.int64)])


def _outline_bar(pen: Any, scale: ColorScale, bar: _Bar) -> None:
    """Draw the arrows of a bar in the colours of what lies beyond, and the outline of all."""
    middle, (below, above) = (bar.left + bar.right - 1) / 2.0, bar.arrows
    ends = (bar.bottom, below, scale.colormap.under), (bar.top - 1, -above, scale.colormap.over)
    for row, length, color in ends:
        if length:
            corners = [(bar.left - 1, row), (bar.right, row), (middle, row + length)]
            pen.polygon(corners, fill=tuple(opaque_codes(color)[:3].tolist()), outline=INK)
    pen.rectangle((bar.left - 1, bar.top - 1, bar.right, bar.bottom), outline=INK)


def read_bar_title(colorbar: bool | str) -> str:
    """Return the title of a colour bar that is asked for by True or the title itself."""
    if not isinstance(colorbar, (bool, str)):
        raise ValueError(f"colorbar must be True, False or a title, got {brief(colorbar)}")
    return colorbar if isinstance(colorbar, str) else ""


def append_bar(picture: NDArray[np.uint8], bar: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture, (H, W, 4), with a bar of its height to the right of it."""
    return np.concatenate([picture, bar], axis=1)


def _max_intervals(length: int, font_size: int) -> int:
    """Return how many intervals between ticks a bar has room for; both in pixels."""
    return max(1, length // (MIN_TICK_SPACING * font_size))


def _blend_over_paper(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the sRGB codes, (N, 3), of colours with alpha, (N, 4), over the paper."""
    alpha = codes[:, 3:].astype(np.float64) / 255.0
    blended: NDArray[Any] = alpha * codes[:, :3] + (1.0 - alpha) * np.array(PAPER)
    return np.floor(blended + 0.5).astype(np.uint8)
