"""
Pictures as text for terminals: by kitty's graphics, by sixels, or by half blocks.

References
----------
Kitty: "Terminal graphics protocol". Sixels: DEC, "VT330/VT340 Programmer Reference Manual, volume
2: Graphics Programming", chapter 14.
"""

from __future__ import annotations

import base64
import zlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

CHUNK = 4096
"""Characters of a picture in one command of kitty's, at most."""

COLORS = 256
"""Of a picture in sixels, at most."""

BAND = 6
"""Rows of pixels in one row of sixels."""

FIRST_SIXEL = 63
"""Code of the character for a column of a band without any pixel."""

PERCENT = 100
"""Sixels take colours as whole percents."""

SHORTEST_RUN = 4
"""Equal sixels from which on their number is shorter than they are."""

CUBE_SIDE, FIRST_OF_CUBE = 6, 16
"""Steps of red, green and blue among the 256 numbered colours, and the number of black."""

CUBE_LEVELS = np.array([0, 95, 135, 175, 215, 255])
FIRST_GREY, GREY_LEVELS = 232, np.arange(8, 239, 10)
"""Of the numbered colours as xterm has them, sRGB; and the number of the darkest grey."""

CUBE_BORDERS, GREY_BORDERS = ((some[1:] + some[:-1]) / 2.0 for some in (CUBE_LEVELS, GREY_LEVELS))
"""Between levels: what lies below is nearer to the darker one."""

HALF_BLOCK = "▄"


def kitty(picture: NDArray[np.uint8], number: int, cells: tuple[int, int]) -> str:
    """
    Return the commands that show a picture below the text, from where the cursor is.

    Parameters
    ----------
    picture : (H, W, 3) uint8, sRGB
    number : int
        What the terminal calls the picture, above 0.
    cells : (int, int)
        Columns and rows that it covers.
    """
    height, width = picture.shape[:2]
    data = base64.b64encode(zlib.compress(picture.tobytes(), 1)).decode()
    chunks = [data[start : start + CHUNK] for start in range(0, len(data), CHUNK)]
    last = len(chunks) - 1
    # Transmit and show (a=T) RGB (f=24), packed (o=z), without an answer (q=2), below the text
    # (z=-1), without moving the cursor (C=1).
    head = f"a=T,f=24,o=z,q=2,z=-1,C=1,i={number},s={width},v={height},c={cells[0]},r={cells[1]},"
    return "".join(
        f"\x1b_G{'' if k else head}m={int(k < last)};{chunk}\x1b\\"
        for k, chunk in enumerate(chunks)
    )


def forget_kitty(number: int) -> str:
    """Return the command that takes a picture away."""
    return f"\x1b_Ga=d,d=I,q=2,i={number}\x1b\\"


def sixel(picture: NDArray[np.uint8]) -> str:
    """
    Return the command that shows a picture from where the cursor is, in its 256 best colours.

    Parameters
    ----------
    picture : (H, W, 3) uint8, sRGB
    """
    from PIL import Image

    image = Image.fromarray(picture).quantize(
        COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    palette = np.frombuffer(image.palette.tobytes(), dtype=np.uint8).reshape(-1, 3)
    return encode_sixels(np.asarray(image), palette)


def encode_sixels(numbers: NDArray[np.uint8], palette: NDArray[np.uint8]) -> str:
    """
    Return the command that shows a picture of numbered colours.

    Parameters
    ----------
    numbers : (H, W) uint8
    palette : (C, 3) uint8, sRGB
    """
    height, width = numbers.shape
    # Each pixel sets a bit of the sixel of its band, colour and column. Sorted by that, sixels
    # without a pixel are not there at all.
    rows, columns = np.divmod(np.arange(height * width), width)
    bands, bits = np.divmod(rows, BAND)
    places = (bands * COLORS + numbers.ravel()) * width + columns
    order = np.argsort(places, kind="stable")
    places, bits = places[order], bits[order]
    firsts = np.flatnonzero(np.r_[True, places[1:] != places[:-1]])
    sixels = np.add.reduceat(1 << bits, firsts)
    places = places[firsts]
    # Join equal neighbours to runs.
    lines, columns = np.divmod(places, width)
    is_first = (
        (lines[1:] != lines[:-1]) | (columns[1:] != columns[:-1] + 1) | (sixels[1:] != sixels[:-1])
    )
    firsts = np.flatnonzero(np.r_[True, is_first])
    counts = np.diff(np.r_[firsts, len(places)])
    runs = zip(
        *(one[firsts].tolist() for one in (lines, columns, sixels)), counts.tolist(), strict=True
    )
    used = np.unique(numbers)
    parts = [f'\x1bPq"1;1;{width};{height}']
    parts += [_color(int(number), palette[number]) for number in used]
    band, line, end = 0, -1, 0
    for run_line, start, bits_set, count in runs:
        if run_line != line:
            line, end = run_line, 0
            parts.append("-" * (line // COLORS - band) or "$")
            band = line // COLORS
            parts.append(f"#{line % COLORS}")
        if start > end:
            parts.append(_run(0, start - end))
        parts.append(_run(bits_set, count))
        end = start + count
    return "".join([*parts, "\x1b\\"])


def _color(number: int, color: NDArray[np.uint8]) -> str:
    """Return what gives a number its colour."""
    red, green, blue = ((int(code) * 2 * PERCENT + 255) // 510 for code in color)
    return f"#{number};2;{red};{green};{blue}"


@lru_cache(maxsize=4096)
def _run(bits: int, count: int) -> str:
    """Return equal sixels."""
    character = chr(FIRST_SIXEL + bits)
    return character * count if count < SHORTEST_RUN else f"!{count}{character}"


def half_blocks(picture: NDArray[np.uint8], is_true: bool = True) -> list[str]:
    """
    Return lines of half blocks, two rows of pixels in each.

    Parameters
    ----------
    picture : (H, W, 3) uint8, sRGB
        ``H`` is even.
    is_true : bool
        Whether the terminal knows all colours; else the nearest of 6 x 6 x 6 and of 24 greys.
    """
    if not is_true:
        return _indexed_blocks(picture)
    pairs = np.concatenate([picture[::2], picture[1::2]], axis=2)
    is_new = np.ones(pairs.shape[:2], dtype=bool)
    is_new[:, 1:] = (pairs[:, 1:] != pairs[:, :-1]).any(axis=2)
    lines = []
    for row, first in zip(pairs, is_new, strict=True):
        starts = np.flatnonzero(first)
        counts = np.diff(np.r_[starts, len(row)]).tolist()
        lines.append(
            "".join(
                f"\x1b[48;2;{a};{b};{c}m\x1b[38;2;{d};{e};{f}m{HALF_BLOCK * count}"
                for (a, b, c, d, e, f), count in zip(row[starts].tolist(), counts, strict=True)
            )
            + "\x1b[0m"
        )
    return lines


def _nearest_numbers(picture: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the numbers of the nearest colours, (H, W), of the cube and of the greys."""
    wanted = picture.astype(np.int64)
    steps = np.searchsorted(CUBE_BORDERS, wanted, side="right")
    red, green, blue = np.moveaxis(steps, 2, 0)
    grey = np.searchsorted(GREY_BORDERS, wanted.mean(axis=2), side="right")
    far = np.square(CUBE_LEVELS[steps] - wanted).sum(axis=2)
    grey_far = np.square(GREY_LEVELS[grey][:, :, None] - wanted).sum(axis=2)
    cube = FIRST_OF_CUBE + (red * CUBE_SIDE + green) * CUBE_SIDE + blue
    return np.where(grey_far < far, FIRST_GREY + grey, cube)


def _indexed_blocks(picture: NDArray[np.uint8]) -> list[str]:
    """Return lines of half blocks in numbered colours."""
    numbers = _nearest_numbers(picture)
    return [
        "".join(
            f"\x1b[48;5;{top}m\x1b[38;5;{bottom}m{HALF_BLOCK}"
            for top, bottom in zip(*pair.tolist(), strict=True)
        )
        + "\x1b[0m"
        for pair in numbers.reshape(-1, 2, picture.shape[1])
    ]
