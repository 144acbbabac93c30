"""Draw contact sheets: pictures side by side, with a line of text under each."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.text_layout import draw_text
from rasterjit.outputs.colorbar import append_bar, draw_colorbar, merge_scales, read_bar_title
from rasterjit.outputs.frame import Frame, LayeredFrame
from rasterjit.scene.color import ColorLike, linear_color, opaque_codes
from rasterjit.scene.scalar_field import ColorScale
from rasterjit.scene.validation import brief, index_below, sequence, string, strings

if TYPE_CHECKING:
    from PIL import Image

FONT_SIZE_PX, LINE_HEIGHT_PX = 13, 20
"""Height of text, and of its line."""

ARGUMENT_LIMIT = 1 << 16
"""Upper bound, excluded, of ``gap`` and ``columns``."""

MIN_LIGHT_PAPER = 128
"""Least mean of a background's sRGB codes for black text."""


def grid(
    pictures: Iterable[Any],
    columns: int | None = None,
    *,
    labels: Sequence[str] | None = None,
    gap: int = 8,
    background: ColorLike = "white",
    font: str | os.PathLike[str] | None = None,
    colorbar: bool | str = False,
    unit: str = "",
) -> Image.Image:
    """
    Arrange pictures in rows, as a contact sheet.

    Parameters
    ----------
    pictures : iterable of Frame, (H, W, 4), (H, W, 3) or (H, W) uint8, or Image
        Frames, arrays of sRGB codes with or without alpha or of grey levels, pictures of Pillow.
        Each keeps its size and stands in the middle of a cell; cells are as large as the largest.
    columns : int, optional
        Pictures in a row. Default: as many as make the sheet nearly square.
    labels : sequence of str, optional
        A line of text under each picture; too long ones are cut off.
    gap : int
        Pixels between cells and around them.
    background : color
        Of the sheet; also what transparent pixels show.
    font : str or path, optional
        Of the labels and the bar, as `Label` takes it.
    colorbar : bool or str
        Whether the colour bar that all pictures share stands to the right of them; or its title.
        They are frames then, and their scalars have one colormap, norm and range.
    unit : str
        Of the bar; see `Frame.colorbar`.

    Returns
    -------
    PIL.Image.Image
        RGB. A notebook shows it; ``.save("sheet.png")`` writes it, ``.show()`` opens it.

    Raises
    ------
    ValueError
        If there is no picture, one is something else, there are not as many labels, or the pictures
        have no colour bar in common.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/teapot.obj")
    >>> views = [rj.render(scene, rj.fit_camera(scene, rj.orbit_direction(a, 20)), size=(160, 120))
    ...          for a in range(0, 360, 60)]
    >>> rj.grid(views, columns=3, labels=[f"{a}°" for a in range(0, 360, 60)]).save("around.png")
    """
    from PIL import Image

    if isinstance(pictures, (Frame, Image.Image)):
        raise ValueError(f"pictures must be a sequence of pictures, got one, {brief(pictures)}")
    given = list(sequence("pictures", pictures))
    images = [_to_rgba(picture, k) for k, picture in enumerate(given)]
    if not images:
        raise ValueError("pictures must hold at least one, got none")
    if labels is not None:
        labels = strings("labels", labels)
        if len(labels) != len(images):
            raise ValueError(f"labels must be {len(images)}, one a picture, got {len(labels)}")
    if string("unit", unit) and colorbar is False:
        raise ValueError(f"unit must be '' where there is no colorbar, got {unit!r}")
    # Choose the size of cells and the number of columns.
    gap = index_below("gap", gap, ARGUMENT_LIMIT)
    width, height = (max(image.size[axis] for image in images) for axis in (0, 1))
    text_height = LINE_HEIGHT_PX if labels is not None else 0
    if columns is None:
        columns = math.ceil(math.sqrt(len(images) * (height + text_height) / width))
        columns = min(max(columns, 1), len(images))
    if index_below("columns", columns, ARGUMENT_LIMIT) == 0:
        raise ValueError("columns must be at least 1, got 0")
    rows = math.ceil(len(images) / columns)
    # Place pictures and labels on the sheet.
    paper = linear_color("background", background)
    paper_color = tuple(opaque_codes(paper)[:3].tolist())
    sheet = Image.new(
        "RGB",
        (columns * (width + gap) + gap, rows * (height + text_height + gap) + gap),
        paper_color,
    )
    text_color = (0, 0, 0) if sum(paper_color) / 3 >= MIN_LIGHT_PAPER else (255, 255, 255)
    for number, image in enumerate(images):
        row, column = divmod(number, columns)
        left, top = gap + column * (width + gap), gap + row * (height + text_height + gap)
        corner = left + (width - image.width) // 2, top + (height - image.height) // 2
        sheet.paste(image, corner, image)
        if labels is not None:
            strip = np.full((LINE_HEIGHT_PX, width, 3), paper_color, np.uint8)
            center = width / 2, LINE_HEIGHT_PX / 2
            draw_text(
                strip, labels[number], center, FONT_SIZE_PX, text_color, anchor=(0.5, 0.5),
                font=font,
            )  # fmt: skip
            sheet.paste(Image.fromarray(strip), (left, top + height))
    if colorbar is False:
        return sheet
    scale = join_scales(given)
    title = read_bar_title(colorbar)
    bar = draw_colorbar(scale, sheet.height, title, font, unit=unit, font_size=FONT_SIZE_PX)
    return Image.fromarray(append_bar(np.asarray(sheet.convert("RGBA")), bar)).convert("RGB")


def join_scales(frames: Iterable[Any], first: int = 0) -> ColorScale:
    """
    Return the scale of the scalars of all frames, or raise ``ValueError`` without one.

    ``first`` is the number of the first of them in messages.
    """
    scales = []
    for n, frame in enumerate(frames, first):
        if not isinstance(frame, Frame):
            raise ValueError(
                f"colorbar must be False but for frames, got {brief(frame)} as number {n}"
            )
        scales += [one for one in frame.plan.facts.inventory.color_scales if one is not None]
    try:
        return merge_scales(scales)
    except ValueError:
        raise ValueError(
            "colorbar must be False where frames have no scalars, or not one colormap, norm and "
            "range for all: give them a range=(low, high)"
        ) from None


def _to_rgba(picture: Any, number: int) -> Image.Image:
    """Return a picture as RGBA; ``number`` is for messages."""
    from PIL import Image

    if isinstance(picture, Image.Image):
        return picture.convert("RGBA")
    if isinstance(picture, Frame) and not isinstance(picture, LayeredFrame):
        picture = picture.color
    codes: NDArray[np.uint8] | Any = picture
    is_codes = isinstance(codes, np.ndarray) and codes.dtype == np.uint8 and codes.size > 0
    if not is_codes or not (codes.ndim == 2 or (codes.ndim == 3 and codes.shape[2] in (3, 4))):
        raise ValueError(
            f"pictures[{number}] must be a frame, a picture of Pillow, or uint8 codes (H, W), "
            f"(H, W, 3) or (H, W, 4), got {brief(picture)}"
        )
    return Image.fromarray(np.ascontiguousarray(codes)).convert("RGBA")
