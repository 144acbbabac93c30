"""Kernels that index arrays in every way that kernels may."""

from rasterjit.runtime.intrinsics import flat, part, spread
from rasterjit.runtime.jit import kernel
from rasterjit.runtime.state_block import float64, int32, int64, uint8


@kernel
def index(
    image: float64[:, :, ::1], strided: int32[:, :], places: int64[::1], small: uint8[::1],
    out: float64[::1],
):  # fmt: skip
    """Read and write elements: by signed and unsigned numbers, from the end, by constants."""
    i, j = places[0], places[1]
    out[0] = image[i, j, -1] + image[-1, 0, 1] + image[0, 1, 2] + image[-i, -j, 0]
    out[1] = strided[i, j] + strided[-1, -2] + strided[small[1], small[0]] + strided[1, 0]
    out[-1] = len(places) + strided.shape[0] * 10 + image.shape[2] * 100
    out[small[2]] = 7.0
    strided[0, -i] = 99
    image[i][j][0] = 5.0
    image[1, 0][1] += 2.0


@kernel
def cut(image: float64[:, :, ::1], strided: int32[:, :], ends: int64[::1], out: float64[::1]):
    """Take rows and slices, as NumPy does beyond their ends."""
    place = 0
    for i in range(len(ends)):
        for j in range(len(ends)):
            first, last = ends[i], ends[j]
            row = image[1, 2, first:last]
            rows = image[0, first:last]
            block = image[last:]
            out[place] = len(row) + 10 * len(rows) + 100 * len(block)
            for k in range(len(row)):
                out[place + 1] += row[k]
            for k in range(len(rows)):
                out[place + 1] += rows[k, 1]
            if len(block) > 0:
                out[place + 1] += block[0, 0, 0]
            place += 2
    line = strided[1]
    out[place] = line[-1] + line[0] + len(line)


@kernel
def share(image: float64[:, ::1], out: float64[::1]):
    """Write to parts of rows."""
    row = part(image, 1, 2, 6)
    row[0], row[len(row) - 1] = 3.0, 4.0
    spread(image[0], 1, 8.0)
    row = flat(image)
    out[0], out[1] = len(row), row[13]


@kernel
def fill_part(rows: float64[:, ::1], number: int64, start: int64, stop: int64):
    """Fill a part of a row."""
    own = part(rows, number, start, stop)
    for i in range(own.shape[0]):
        own[i] = 1.0
