"""
Declare intrinsics: vector instructions that LLVM does not generate from loops, and raw reads.

A value is stored to neighbouring places; texels, four channels each, are copied and interpolated:
LLVM does not vectorize gather loops. A part of a row is a slice that compiles in a fraction of the
time, since its ends are not checked. Here stands what they do in Python; ``intrinsics_ir`` has the
machine code.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rasterjit.forks import lock
from rasterjit.runtime.jit import MACHINE_FUNCTION, helper, intrinsic, raise_call_error

LANES = 8
"""Values written at once: a 256-bit register of 32-bit numbers."""

CHANNELS = 4
"""Channels of a texel: a 128-bit register of 32-bit numbers."""

HALVES = 2
"""
Distance from texel to texel in rows of numbers, in halves of 8 bytes.

Addresses of x86-64 can scale an index by 8 without an extra instruction, but not by 16.
"""

_ADDING = lock()


@intrinsic
def spread(row: Any, start: Any, value: Any) -> None:
    """Write a value to ``LANES`` neighbouring places of a row; beyond its end is an error."""
    for lane in range(LANES):
        row[int(start) + lane] = value


@intrinsic
def part(rows: Any, number: Any, start: Any, stop: Any) -> Any:
    """Return the places ``start:stop`` of a row; beyond its ends is an error."""
    if not (0 <= number < rows.shape[0] and 0 <= start <= stop <= rows.shape[1]):
        raise IndexError("a part of a row ends beyond the row")
    return rows[number, start:stop]


@helper
def three_parts(rows, first, start, stop):
    """Return parts of three rows that follow each other."""
    return (
        part(rows, first, start, stop), part(rows, first + 1, start, stop),
        part(rows, first + 2, start, stop),
    )  # fmt: skip


@helper
def six_parts(rows, first, start, stop):
    """Return parts of six rows that follow each other."""
    return (*three_parts(rows, first, start, stop), *three_parts(rows, first + 3, start, stop))


@helper
def nine_parts(rows, first, start, stop):
    """Return parts of nine rows that follow each other."""
    return (*six_parts(rows, first, start, stop), *three_parts(rows, first + 6, start, stop))


class CodedTexels(NamedTuple):
    """The leading texels of an image that are stored as codes; integers are int64."""

    codes: Any
    """(B,) uint8: channel by channel, texel by texel."""
    first: Any
    """The first code of the picture."""
    step: Any
    """Codes from texel to texel."""
    others: Any
    """Codes from that of red to those of green, blue and alpha."""
    curves: Any
    """(K, 256) float32: the value of each code."""
    curve: Any
    """Where the curve of colours begins, in entries from the start of ``curves``."""
    alphas: Any
    """Where the curve of alpha begins."""
    end: Any
    """The first texel that is not coded, in `HALVES`."""


def _read_texels(texels: Any, first: Any, numbers: Any, coded: CodedTexels) -> Any:
    """Return texels, (N, CHANNELS), given by their distance from a first one in `HALVES`."""
    numbers = numbers.astype(np.int64)
    is_code = numbers < coded.end
    found = np.empty((len(numbers), CHANNELS), np.float32)
    found[~is_code] = texels[int(first) + numbers[~is_code] // HALVES]
    for n in np.flatnonzero(is_code):
        red = int(coded.first + numbers[n] // HALVES * coded.step)
        entries = [int(coded.codes[red + other]) for other in (0, *map(int, coded.others))]
        starts = (int(coded.curve),) * 3 + (int(coded.alphas),)
        found[n] = [
            coded.curves.reshape(-1)[start + entry]
            for start, entry in zip(starts, entries, strict=True)
        ]
    return found


@intrinsic
def copy_texels(texels: Any, first: Any, numbers: Any, coded: Any, colors: Any, n: Any) -> None:
    """Copy ``CHANNELS`` texels, as `mix_texels` takes them, to places ``n`` ... of four rows."""
    some = slice(int(n), int(n) + CHANNELS)
    for k, channel in enumerate(_read_texels(texels, first, numbers[some], CodedTexels(*coded)).T):
        colors[k][some] = channel


@intrinsic
def mix_texels(
    texels: Any, first: Any, corners: Any, coded: Any, shares: Any, is_far: Any, colors: Any,
    n: Any,
) -> None:  # fmt: skip
    """
    Mix texels for ``CHANNELS`` neighbouring samples.

    Parameters
    ----------
    texels : (N, CHANNELS) float32
    first : int
        The texel that texels are counted from.
    corners : tuple of four rows of int32
        For each sample the texels around it, in `HALVES`, lower left first, upper right last.
    coded : tuple
        Fields of `CodedTexels`: some texels are codes.
    shares : tuple of two rows of float32
        Weights of the texels to the right, and of those above.
    is_far : bool
        Whether to prefetch texels of samples further on, as the inner caches hold few of them.
    colors : tuple of four rows of float32
        Written, channel by channel, from place ``n`` on.
    """
    some = slice(int(n), int(n) + CHANNELS)
    a, b, c, d = (_read_texels(texels, first, row[some], CodedTexels(*coded)) for row in corners)
    right, up = (row[some, np.newaxis] for row in shares)
    lower, upper = a + right * (b - a), c + right * (d - c)
    for k, mixed in enumerate((lower + up * (upper - lower)).T):
        colors[k][some] = mixed


@intrinsic
def interpolate_uv_run(
    u: Any, v: Any, count: Any, edges: Any, steps: Any, factors: Any, first: Any, differences: Any
) -> None:
    """
    Write the texture coordinates of neighbouring samples of one face, in float64.

    Parameters
    ----------
    u, v : (N,) float64
        Written: ``count`` elements, and up to whole groups of ``LANES`` something behind them.
    count : int
        Samples, at least one.
    edges, steps : (3,) float64
        Edge functions at the first sample and their steps from one to the next: whole numbers, so
        that each sum on the face is exact.
    factors : (3,) float64
        Factors that turn edge functions into weights, up to their sum.
    first : (2,) float64
        Coordinates of the first vertex.
    differences : (4,) float64
        Differences in u and v from there to the second vertex, then to the third.
    """
    sample = np.arange(int(count), dtype=np.float64)
    parts = [(edges[k] + sample * steps[k]) * factors[k] for k in range(3)]
    over = 1.0 / (parts[0] + parts[1] + parts[2])
    second, third = parts[1] * over, parts[2] * over
    u[: len(sample)] = first[0] + second * differences[0] + third * differences[2]
    v[: len(sample)] = first[1] + second * differences[1] + third * differences[3]


@intrinsic
def draw_box(
    depths: Any, numbers: Any, first: Any, stride: Any, rows: Any, columns: Any, edges: Any,
    plane: Any, face: Any, is_mixed: Any,
) -> None:  # fmt: skip
    """
    Test a box of at most ``LANES`` columns of samples against three edges and the depth.

    Parameters
    ----------
    depths, numbers : (N,)
        A flat tile: stored depths, of float32, float64 or int32, and faces, int32. Where a sample
        lies inside and nearer than what is there, its depth and ``face`` are written.
    first, stride, rows, columns : int
        The first sample of the box, the way to the next row, and its size.
    edges : (9,), int32 or reals
        Three edge functions at the first sample, their steps across, their steps down; a sample is
        inside where none is negative. Those of lanes behind the columns may overflow.
    plane : (11,) reals
        Two edge functions at the first sample, their steps across, their steps down; the depth
        where both are 0, their weights in it, its least and its greatest value.
    face : int32
    is_mixed : bool
        Whether higher faces may have been drawn before: of equal depths that of the lower face is
        seen. Else the first is.
    """
    kind = type(plane[0])
    for row in range(int(rows)):
        for column in range(int(columns)):
            if any(edges[k] + column * edges[k + 3] + row * edges[k + 6] < 0 for k in range(3)):
                continue
            e0, e1 = (
                plane[k] + kind(column) * plane[k + 2] + kind(row) * plane[k + 4] for k in range(2)
            )
            depth = plane[6] + (e0 * plane[7] + e1 * plane[8])
            place = int(first + row * stride + column)
            _store_nearer(depths, numbers, place, depth, plane[9:], face, is_mixed)


@intrinsic
def fill_rows(
    depths: Any, numbers: Any, spans: Any, first: Any, stride: Any, rows: Any, before: Any,
    longest: Any, plane: Any, face: Any, is_mixed: Any,
) -> None:  # fmt: skip
    """
    Test the samples of each row from its begin, or from ``before``, to its end against the depth.

    Parameters
    ----------
    depths, numbers, face, is_mixed
        As `draw_box` takes them.
    spans : (begins, ends, depths)
        For each row: its first column, one past its last, and the depth at the first. There is room
        for whole groups of ``LANES`` rows.
    first, stride, rows : int
        The sample of column 0 of the first row, the way to the next row, and how many there are.
    before : int32
        Columns before it are left out.
    longest : int
        How many columns a row has at most.
    plane : (3,) reals
        The step of the depth, its least and its greatest value.
    """
    kind = type(plane[0])
    for row in range(int(rows)):
        begin, start = int(spans[0][row]), spans[2][row]
        for column in range(max(begin, int(before)), int(spans[1][row])):
            depth = start + kind(column - begin) * plane[0]
            place = int(first + row * stride + column)
            _store_nearer(depths, numbers, place, depth, plane[1:], face, is_mixed)


@intrinsic
def find_min_in_rows(values: Any, first: Any, stride: Any, rows: Any, left: Any, right: Any) -> Any:
    """
    Return the least value in some columns, of ``LANES``, of some rows.

    Parameters
    ----------
    values : (N,)
        Flat: float32, float64 or int32. All columns of each row lie in it.
    first, stride, rows : int
        Column 0 of the first row, the way to the next row, and how many there are.
    left, right : int32
        The first column and the last.

    Returns
    -------
    The greatest value of the type if there are no rows or columns.
    """
    starts = (int(first + row * stride) for row in range(int(rows)))
    some = [values[start + left : start + right + 1] for start in starts]
    greatest = np.iinfo(values.dtype).max if values.dtype.kind == "i" else np.inf
    return np.concatenate([np.full(1, greatest, values.dtype), *some]).min()


@intrinsic
def find_range_end(numbers: Any, start: Any, first: Any, end: Any) -> Any:
    """Return the first place from ``start`` on whose int32 is not in first..end - 1, or the end."""
    place = int(start)
    while place < len(numbers) and first <= numbers[place] < end:
        place += 1
    return place


@intrinsic
def blend_run(
    red: Any, green: Any, blue: Any, edges: Any, steps: Any, ratios: Any, corners: Any, base: Any
) -> None:
    """
    Write the colours of neighbouring samples of one face: a base times those of its vertices.

    Interpolates in float32, step by step as ``surface.float32_weights`` says, and holds what comes
    out to the range of the vertices' colours.

    Parameters
    ----------
    red, green, blue : (N,) float32
        Written; N is a multiple of ``LANES``.
    edges, steps : (3,) float64
        Edge functions at the first sample and their steps from one to the next: whole numbers, so
        that each sum on the face is exact.
    ratios : (2,) float32
        w of the first vertex over that of the others.
    corners : 3 of (3,) float32
        Red, green and blue of each vertex.
    base : (3,) float32
    """
    for n in range(len(red)):
        first, second, third = (np.float32(edges[k] + np.float64(n) * steps[k]) for k in range(3))
        second, third = second * ratios[0], third * ratios[1]
        over = np.float32(1.0) / (first + second + third)
        first, second, third = first * over, second * over, third * over
        for k, row in enumerate((red, green, blue)):
            own = [corner[k] for corner in corners]
            value = first * own[0] + second * own[1] + third * own[2]
            row[n] = base[k] * min(max(value, min(own)), max(own))


@intrinsic
def blend_clipped_run(
    red: Any, green: Any, blue: Any, memory: Any, odd: Any, width: Any, xs: Any, ws: Any,
    down: Any, corners: Any, base: Any,
) -> Any:  # fmt: skip
    """
    Do what `blend_run` does for a face that was clipped, whose weights are worked out in float64.

    Takes the steps of ``barycentric.compute_clipped_weights`` and ``divide_by_sum``.

    Parameters
    ----------
    red, green, blue : (N,) float32
        Written; N is a multiple of ``LANES``.
    memory : 4 of (N,) float64
        To work in.
    odd : float64
        Twice the column of the first sample in the whole picture, plus one.
    width : float64
        Columns of the whole picture.
    xs, ws : (3,) float64
        x and w of the vertices, clip space.
    down : (3,) float64
        y - Y w of the vertices, Y being that of the row in normalized device coordinates; all of
        them negated if that makes sums of weights positive.
    corners, base
        As `blend_run` takes them.

    Returns
    -------
    int32
        0 if all sums are positive; else what was written does not count.
    """
    odds = odd + 2.0 * np.arange(len(red), dtype=np.float64)
    x = odds / width - 1.0
    across = [xs[k] - x * ws[k] for k in range(3)]
    areas = [across[k - 2] * down[k - 1] - across[k - 1] * down[k - 2] for k in range(3)]
    memory[3][:] = 0.0
    for area, row in zip(areas, memory, strict=False):
        row[:] = np.where(area < 0.0, 0.0, area)
        memory[3][:] += row
    weights = [(row / memory[3]).astype(np.float32) for row in memory[:3]]
    for k, row in enumerate((red, green, blue)):
        own = [corner[k] for corner in corners]
        value = weights[0] * own[0] + weights[1] * own[1] + weights[2] * own[2]
        row[:] = base[k] * np.fmin(np.fmax(value, min(own)), max(own))
    return np.int32(not (areas[0] + areas[1] + areas[2] > 0.0).all())


@intrinsic
def encode_lanes(
    red: Any, green: Any, blue: Any, table: Any, first: Any, others: Any, color: Any
) -> None:
    """
    Write the codes of ``LANES`` neighbouring pixels.

    Parameters
    ----------
    red, green, blue : (N,) float32
    table : (2**16,) int32
        What to add to the lower half of a value's bits, for each upper half: bits 16 to 23 of the
        sum are the code.
    first : int
        The first pixel.
    others : uint32
        Bits of each pixel beside the three codes, which stand in its lowest bytes, red first.
    color : (N,) uint32
        Written.
    """
    some = slice(int(first), int(first) + LANES)
    pixels = np.full(LANES, others, np.uint32)
    for k, row in enumerate((red, green, blue)):
        bits = row[some].view(np.uint32)
        sums = table[bits >> 16].view(np.uint32) + (bits & 0xFFFF)
        pixels |= (sums >> 16 & 0xFF) << np.uint32(8 * k)
    color[some] = pixels


def _store_nearer(
    depths: Any, numbers: Any, sample: int, depth: Any, limits: Any, face: Any, is_mixed: bool
) -> None:
    """Write a clamped depth, and the face, if nearer than the sample's."""
    depth = limits[0] if depth < limits[0] else depth
    stored = depths.dtype.type(limits[1] if depth > limits[1] else depth)
    wins_tie = is_mixed and stored == depths[sample] and face < numbers[sample]
    if stored > depths[sample] or wins_tie:
        depths[sample], numbers[sample] = stored, face


@intrinsic
def load_int64(address: Any) -> Any:
    """Return the word at an address."""
    raise NotImplementedError("machine code reads memory")


@intrinsic
def load_int32(address: Any) -> Any:
    """Return the 32-bit word at an address."""
    raise NotImplementedError("machine code reads memory")


@intrinsic
def store_int64(address: Any, value: Any) -> Any:
    """Write the word at an address."""
    raise NotImplementedError("machine code writes memory")


@intrinsic
def add_to_element_atomically(row: Any, place: Any, value: Any) -> Any:
    """Add to an element of a row of int64 that threads share, in one step; return what it was."""
    with _ADDING:
        before = row[place]
        row[place] += value
    return before


@intrinsic
def load_atomic(address: Any) -> Any:
    """Load the word at an address that other threads write, with acquire semantics."""
    raise NotImplementedError("machine code reads memory")


@intrinsic
def add_atomic(address: Any, value: Any) -> Any:
    """Add to the word at an address in one step; return what it was."""
    raise NotImplementedError("machine code writes memory")


@intrinsic
def compare_exchange(address: Any, expected: Any, value: Any) -> Any:
    """Write the word at an address if it is as expected, in one step; return what it was."""
    raise NotImplementedError("machine code writes memory")


@intrinsic
def pause_cpu() -> Any:
    """Hint to the processor that a loop waits for another thread."""
    raise NotImplementedError("machine code waits")


@intrinsic
def call_at(address: Any, state: Any, first: Any, stop: Any) -> Any:
    """Call ``int64 f(int64, int64, int64)`` at an address."""
    word = MACHINE_FUNCTION(int(address))(int(state), int(first), int(stop))
    raise_call_error()
    return word


@helper
def call_bound(words):
    """Call a kernel by the words of a ``jit.Bound``; return what it returns."""
    return call_at(words[0], words[1], np.int64(0), np.int64(0))


@intrinsic
def store_bounds(xy: Any, a: Any, b: Any, c: Any, least: Any, most: Any, n: Any) -> None:
    """
    Write the least x and y of three vertices, and the greatest, to places 2 n and 2 n + 1 of rows.

    Parameters
    ----------
    xy : (V, 2) int32
        x and y of a vertex lie side by side, in places that follow each other.
    a, b, c : int
        The vertices.
    least, most : (N,) int32
        Written.
    n : int
    """
    corners, place = np.stack([xy[int(vertex)] for vertex in (a, b, c)]), 2 * int(n)
    least[place : place + 2], most[place : place + 2] = corners.min(axis=0), corners.max(axis=0)


@intrinsic
def copy_pair(pairs: Any, number: Any, row: Any, n: Any) -> None:
    """Copy one of some pairs of int32, (N, 2), that lie side by side, to 2 n and 2 n + 1."""
    row[2 * int(n) : 2 * int(n) + 2] = pairs[int(number)]


@intrinsic
def prefetch(row: Any, number: Any) -> None:
    """Prefetch the cache line of an element of a row."""


@intrinsic
def flat(array: Any) -> Any:
    """Return a contiguous array as one row, without a copy."""
    return array.reshape(-1)
