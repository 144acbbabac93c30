"""
Make the mip levels of a picture: plain, weighted by alpha, or of a mask.

Texels of a level are means, by area, of the texels below them. What alpha is for decides of what:

- Plain: of all four channels, each by itself.
- Weighted: of red, green and blue times alpha, and of alpha [1]_. Who has mixed such texels divides
  by the mixed alpha. So the colour of clear texels, which nobody sees, counts for nothing.
- Of a mask, a texel is there or it is a hole, by the cutoff. A level's alpha is the share of texels
  that are there, and its colour is their mean. Means of alpha would lose that share from level to
  level, once they are compared with the cutoff [2]_. A hole takes the colour of the nearest texel
  that is there: then no filter shows the colour of a hole, wherever in a pixel a sample lies.

References
----------
.. [1] T. Porter and T. Duff, "Compositing Digital Images", SIGGRAPH 1984.
.. [2] I. Castaño, "Computing Alpha Mipmaps", 2010.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.validation import read_only

_BAND = 1 << 16
"""Texels that are worked on at once: as float64, 2 MB."""

_AT_ONCE = 4
"""Levels made of a band at once: a level in float64 is whole when a 256th of the texels is left."""


def level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    """Return (width, height) of each mip level: halved, rounded down, until both are 1."""
    count = max(width, height).bit_length()
    return [(max(1, width >> k), max(1, height >> k)) for k in range(count)]


def halved(image: NDArray[Any], axis: int, size: int | None = None, begin: int = 0) -> NDArray[Any]:
    """
    Return half as many texels along an axis, float64: the means of the area of each.

    Parameters
    ----------
    image : (H, W, C) float
    axis : {0, 1}
    size : int, optional
        Texels of the whole picture along it, if the image is but a band of that.
    begin : int
        Of a band: the number of the first mean.
    """
    rows = np.moveaxis(image, axis, 0)
    size = len(rows) if size is None else size
    if size == 1:
        return image
    if size % 2 == 0:
        means = np.add(rows[0::2], rows[1::2], dtype=np.float64) / 2.0
    else:
        # Each covers 2 + 1/half texels: a part of the first, all of the second, a part of the last.
        half, count = size // 2, len(rows) // 2
        number = np.arange(begin, begin + count, dtype=np.float64).reshape(-1, 1, 1)
        whole = np.float64(half) * rows[1::2].astype(np.float64)
        means = ((half - number) * rows[0:-1:2] + whole + (number + 1.0) * rows[2::2]) / size
    return np.moveaxis(means, 0, axis)


def further_levels(image: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield the levels below an image, (H, W, C), each of float64, until one texel is left."""
    for _ in level_sizes(image.shape[1], image.shape[0])[1:]:
        image = halved(halved(image, 0), 1)
        yield image


def room_for(sizes: list[tuple[int, int]]) -> NDArray[np.float32]:
    """Return room for the texels of levels of these (width, height), (N, 4), row by row."""
    return np.empty((sum(width * height for width, height in sizes), 4), np.float32)


def split_levels(
    texels: NDArray[np.float32], sizes: list[tuple[int, int]]
) -> list[NDArray[np.float32]]:
    """Return the levels, (h, w, 4) each, of the texels of all of them."""
    levels, start = [], 0
    for width, height in sizes:
        levels.append(texels[start : start + width * height].reshape(height, width, 4))
        start += width * height
    return levels


def bands(height: int, width: int) -> Iterator[slice]:
    """Yield rows of a picture, a part that a core's cache holds at a time."""
    step = max(1, _BAND // width)
    for begin in range(0, height, step):
        yield slice(begin, min(begin + step, height))


def fill_levels(levels: list[NDArray[Any]], rows_of: Callable[[slice], NDArray[Any]]) -> None:
    """
    Write all levels below a picture, channel by channel, band by band.

    Parameters
    ----------
    levels : list of (h, w, 4) float32
        Written, but for the first, which may be of another type.
    rows_of : callable
        Returns some rows of the first level, (h, W, 4) float.
    """
    # Some levels at once, of which but the last is needed whole in float64.
    for base in range(0, len(levels) - 1, _AT_ONCE):
        last = min(base + _AT_ONCE, len(levels) - 1)
        height, width = levels[last].shape[:2]
        whole = np.empty((height, width, 4))
        for band in bands(height, width << 2 * (last - base)):
            whole[band] = _halved_band(levels, base, rows_of, last, band)
        rows_of = whole.__getitem__


def _halved_band(
    levels: list[NDArray[Any]],
    base: int,
    rows_of: Callable[[slice], NDArray[Any]],
    number: int,
    band: slice,
) -> NDArray[Any]:
    """Return rows of a level, float64, from those of a level above; write them and all between."""
    if number == base:
        return rows_of(band)
    size = len(levels[number - 1])
    needed = slice(2 * band.start, 2 * band.stop + size % 2) if size > 1 else slice(0, 1)
    image = _halved_band(levels, base, rows_of, number - 1, needed)
    means = halved(halved(image, 0, size, band.start), 1)
    levels[number][band] = means
    return means


def weighted_levels(image: NDArray[np.float32], has_levels: bool) -> NDArray[np.float32]:
    """Return the texels of an image, and those of its levels, with colours times alpha, (N, 4)."""
    height, width = image.shape[:2]

    def weighted(rows: slice) -> NDArray[np.float64]:
        """Return rows with colours times alpha."""
        found = image[rows].astype(np.float64)
        found[:, :, :3] *= found[:, :, 3:]
        return found

    sizes = level_sizes(width, height) if has_levels else [(width, height)]
    texels = room_for(sizes)
    levels = split_levels(texels, sizes)
    for rows in bands(height, width):
        levels[0][rows] = weighted(rows)
    fill_levels(levels, weighted)
    return read_only(texels)


def mask_levels(image: NDArray[np.float32], cutoff: float, has_levels: bool) -> NDArray[np.float32]:
    """
    Return the texels of a mask, (N, 4): those of the image, and the shares of its levels.

    Parameters
    ----------
    image : (H, W, 4) float32, linear
        Keeps its alpha: that of level 0 is compared with the cutoff as it is.
    cutoff : float
        Texels of less alpha are holes.
    has_levels : bool
    """
    own = image.astype(np.float64)
    own[:, :, 3] = image[:, :, 3] >= np.float32(cutoff)
    own[:, :, :3] *= own[:, :, 3:]
    levels = [image.copy()]
    _fill_holes(levels[0], own[:, :, 3] > 0.0)
    for level in further_levels(own) if has_levels else ():
        shares = level[:, :, 3:]
        shown = np.divide(level, shares, out=np.zeros_like(level), where=shares > 0.0)
        shown[:, :, 3:] = shares
        _fill_holes(shown, shares[:, :, 0] > 0.0)
        levels.append(shown.astype(np.float32))
    return read_only(np.concatenate([level.reshape(-1, 4) for level in levels]))


def _fill_holes(image: NDArray[Any], is_there: NDArray[np.bool_]) -> None:
    """Give holes, in place, the colour of a near texel that is there, if any is."""
    if is_there.all() or not is_there.any():
        return
    height, width = is_there.shape
    # The nearest in the same row and in the same column: the nearer of both, if there is one.
    column, across = _nearest(is_there)
    row, along = (part.T for part in _nearest(is_there.T))
    by_row = across <= along
    rows = np.where(by_row, np.arange(height)[:, np.newaxis], row)
    columns = np.where(by_row, column, np.arange(width))
    found = np.minimum(across, along) < height + width
    holes = ~is_there & found
    image[holes, :3] = image[rows[holes], columns[holes], :3]
    # What is left has neither; the rows that hold any texel are whole now.
    row, _ = _nearest(found.T)
    image[~found, :3] = image[row.T[~found], np.nonzero(~found)[1], :3]


def _nearest(is_there: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the nearest place in the same row that is there, and its distance, large without."""
    height, width = is_there.shape
    none = 2 * (height + width)
    here = np.broadcast_to(np.arange(width, dtype=np.int32), is_there.shape)
    before = np.maximum.accumulate(np.where(is_there, here, np.int32(-none)), axis=1)
    behind = np.where(is_there, here, np.int32(width + none))[:, ::-1]
    behind = np.minimum.accumulate(behind, axis=1)[:, ::-1]
    is_before = here - before <= behind - here
    return np.where(is_before, before, behind), np.where(is_before, here - before, behind - here)
