"""
Compute the mip levels of a picture: plain, weighted by alpha, or of a mask.

Texels of a level are means, by area, of the texels below them; the use of alpha selects the values:

- Plain: of all four channels, each by itself.
- Weighted: of red, green and blue times alpha, and of alpha [1]_. Readers divide a mix of such
  texels by the mixed alpha, so that the colour of clear texels has no weight.
- Mask: a texel is solid or a hole, by the cutoff. A level's alpha is the share of solid texels, and
  its colour is their mean. Means of alpha would lose that share from level to level, once they are
  compared with the cutoff [2]_. A hole takes the colour of the nearest solid texel, so that no
  filter shows the colour of a hole.

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

_TEXELS_PER_BAND = 1 << 16
"""Texels processed at once: as float64, 2 MB."""

_LEVELS_AT_ONCE = 4
"""Levels computed from a band: a whole level in float64 has a 256th of the texels."""


def level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    """Return (width, height) of each mip level: halved, rounded down, until both are 1."""
    count = max(width, height).bit_length()
    return [(max(1, width >> k), max(1, height >> k)) for k in range(count)]


def halve(
    image: NDArray[Any], axis: int, size: int | None = None, first_mean: int = 0
) -> NDArray[Any]:
    """
    Halve an image along an axis: return means by area, float64.

    Parameters
    ----------
    image : (H, W, C) float
    axis : {0, 1}
    size : int, optional
        Texels of the whole picture along it, if the image is but a band of that.
    first_mean : int
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
        index = np.arange(first_mean, first_mean + count, dtype=np.float64).reshape(-1, 1, 1)
        middle = np.float64(half) * rows[1::2].astype(np.float64)
        means = ((half - index) * rows[0:-1:2] + middle + (index + 1.0) * rows[2::2]) / size
    return np.moveaxis(means, 0, axis)


def yield_lower_levels(image: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield the levels below an image, (H, W, C), each of float64, until one texel is left."""
    for _ in level_sizes(image.shape[1], image.shape[0])[1:]:
        image = halve(halve(image, 0), 1)
        yield image


def allocate_levels(sizes: list[tuple[int, int]]) -> NDArray[np.float32]:
    """Return an array for the texels of levels of given (width, height), (N, 4), row by row."""
    return np.empty((sum(width * height for width, height in sizes), 4), np.float32)


def split_levels(
    texels: NDArray[np.float32], sizes: list[tuple[int, int]]
) -> list[NDArray[np.float32]]:
    """Return views of the levels, (h, w, 4) each, of the texels of all levels."""
    levels, start = [], 0
    for width, height in sizes:
        levels.append(texels[start : start + width * height].reshape(height, width, 4))
        start += width * height
    return levels


def split_bands(height: int, width: int) -> Iterator[slice]:
    """Yield slices of rows that fit a core's cache."""
    step = max(1, _TEXELS_PER_BAND // width)
    for begin in range(0, height, step):
        yield slice(begin, min(begin + step, height))


def fill_levels(levels: list[NDArray[Any]], read_rows: Callable[[slice], NDArray[Any]]) -> None:
    """
    Write all levels below a picture, channel by channel, band by band.

    Parameters
    ----------
    levels : list of (h, w, 4) float32
        Written but for the first, which may be of another type.
    read_rows : callable
        Returns some rows of the first level, (h, W, 4) float.
    """
    # Several levels at once, of which only the last is stored whole in float64.
    for base in range(0, len(levels) - 1, _LEVELS_AT_ONCE):
        last = min(base + _LEVELS_AT_ONCE, len(levels) - 1)
        height, width = levels[last].shape[:2]
        whole = np.empty((height, width, 4))
        for band in split_bands(height, width << 2 * (last - base)):
            whole[band] = _compute_band(levels, base, read_rows, last, band)
        read_rows = whole.__getitem__


def _compute_band(
    levels: list[NDArray[Any]],
    base: int,
    read_rows: Callable[[slice], NDArray[Any]],
    level: int,
    band: slice,
) -> NDArray[Any]:
    """Compute rows of a level, float64, from a level above; write them and all levels between."""
    if level == base:
        return read_rows(band)
    size = len(levels[level - 1])
    needed = slice(2 * band.start, 2 * band.stop + size % 2) if size > 1 else slice(0, 1)
    image = _compute_band(levels, base, read_rows, level - 1, needed)
    means = halve(halve(image, 0, size, band.start), 1)
    levels[level][band] = means
    return means


def compute_weighted_levels(image: NDArray[np.float32], has_levels: bool) -> NDArray[np.float32]:
    """Return the texels of an image and its levels, with colours times alpha, (N, 4)."""
    height, width = image.shape[:2]

    def weighted(rows: slice) -> NDArray[np.float64]:
        """Return rows with colours times alpha."""
        texel_rows = image[rows].astype(np.float64)
        texel_rows[:, :, :3] *= texel_rows[:, :, 3:]
        return texel_rows

    sizes = level_sizes(width, height) if has_levels else [(width, height)]
    texels = allocate_levels(sizes)
    levels = split_levels(texels, sizes)
    for rows in split_bands(height, width):
        levels[0][rows] = weighted(rows)
    fill_levels(levels, weighted)
    return read_only(texels)


def compute_mask_levels(
    image: NDArray[np.float32], cutoff: float, has_levels: bool
) -> NDArray[np.float32]:
    """
    Return the texels of a mask, (N, 4): those of the image, and the shares of its levels.

    Parameters
    ----------
    image : (H, W, 4) float32, linear
        Its alpha is kept: that of level 0 is compared with the cutoff.
    cutoff : float
        Texels of less alpha are holes.
    has_levels : bool
    """
    weighted = image.astype(np.float64)
    weighted[:, :, 3] = image[:, :, 3] >= np.float32(cutoff)
    weighted[:, :, :3] *= weighted[:, :, 3:]
    levels = [image.copy()]
    _fill_holes(levels[0], weighted[:, :, 3] > 0.0)
    for level in yield_lower_levels(weighted) if has_levels else ():
        coverage = level[:, :, 3:]
        colors = np.divide(level, coverage, out=np.zeros_like(level), where=coverage > 0.0)
        colors[:, :, 3:] = coverage
        _fill_holes(colors, coverage[:, :, 0] > 0.0)
        levels.append(colors.astype(np.float32))
    return read_only(np.concatenate([level.reshape(-1, 4) for level in levels]))


def _fill_holes(image: NDArray[Any], is_there: NDArray[np.bool_]) -> None:
    """Fill holes, in place, with the colour of a near texel that is none."""
    if is_there.all() or not is_there.any():
        return
    height, width = is_there.shape
    # The nearest in the same row and in the same column: the nearer of both, if there is one.
    column, row_distance = _nearest_in_row(is_there)
    row, column_distance = (values.T for values in _nearest_in_row(is_there.T))
    use_row = row_distance <= column_distance
    rows = np.where(use_row, np.arange(height)[:, np.newaxis], row)
    columns = np.where(use_row, column, np.arange(width))
    is_reachable = np.minimum(row_distance, column_distance) < height + width
    holes = ~is_there & is_reachable
    image[holes, :3] = image[rows[holes], columns[holes], :3]
    # What is left has neither; the rows that hold any texel are whole now.
    row, _ = _nearest_in_row(is_reachable.T)
    image[~is_reachable, :3] = image[row.T[~is_reachable], np.nonzero(~is_reachable)[1], :3]


def _nearest_in_row(is_there: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the column of the nearest marked texel in each row, and its distance (large: none)."""
    height, width = is_there.shape
    unreachable = 2 * (height + width)
    index = np.broadcast_to(np.arange(width, dtype=np.int32), is_there.shape)
    before = np.maximum.accumulate(np.where(is_there, index, np.int32(-unreachable)), axis=1)
    after = np.where(is_there, index, np.int32(width + unreachable))[:, ::-1]
    after = np.minimum.accumulate(after, axis=1)[:, ::-1]
    use_before = index - before <= after - index
    return np.where(use_before, before, after), np.where(use_before, index - before, after - index)
