"""Find pairs of things that meet, by a grid of cells and a kernel that goes through their lists."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rasterjit.runtime.threads import Workers
from rasterjit.scene.arrays import Float64, Int32, Int64

THINGS_PER_TASK = 1 << 12
"""Edges or faces of one call of a kernel."""

PAIRS_PER_THING = 8
"""Pairs that there is room for at first, for each edge or face."""

CELLS_PER_BOX = 8
"""Most entries of the cells' lists, and most cells, for each box; and 4096 more."""

SHIFTS = range(12, 31)
"""Binary logarithms of the width of a cell: the first that fits."""


class Cells(NamedTuple):
    """Boxes by the cells of a grid that they may meet."""

    starts: Int64
    """(C+1,): where the list of each cell begins; x runs fastest."""
    lists: Int32
    """(L,): the boxes of each cell, ascending."""
    counts: tuple[int, ...]
    """Number of cells along each axis."""
    shift: int
    """Cells are ``2**shift`` units wide."""
    ranges: Int64
    """(N, 2, D): the first and the last cell of each box along each axis."""


def sort_into_cells(low: Int32, high: Int32, extent: tuple[int, ...]) -> Cells:
    """
    List the boxes that may meet each cell of a grid.

    Parameters
    ----------
    low, high : (N, D) int32
        Least and greatest coordinates of each box, which may lie outside the grid.
    extent : tuple of int
        Of the grid, from 0, along each of D axes.
    """
    room = CELLS_PER_BOX * len(low) + 4096
    for shift in SHIFTS:
        sides = [(side - 1 >> shift) + 1 for side in extent]
        firsts = np.maximum(low.astype(np.int64) >> shift, 0)
        lasts = np.minimum(high.astype(np.int64) >> shift, np.array(sides) - 1)
        spans = np.maximum(lasts - firsts + 1, 0)
        counts, cell_count = np.ones(len(low), np.int64), 1
        for axis, side in enumerate(sides):
            counts, cell_count = counts * spans[:, axis], cell_count * side
        if cell_count <= room and int(counts.sum()) <= room:
            break
    # List the cells of each box, then the boxes of each cell.
    numbers = np.repeat(np.arange(len(counts)), counts)
    rest = np.arange(len(numbers)) - np.repeat(np.cumsum(counts) - counts, counts)
    cells, stride = np.zeros(len(numbers), np.int64), 1
    for axis, side in enumerate(sides):
        rest, along = np.divmod(rest, np.maximum(spans[numbers, axis], 1))
        cells, stride = cells + stride * (firsts[numbers, axis] + along), stride * side
    order = np.argsort(cells, kind="stable")
    starts = np.searchsorted(cells[order], np.arange(cell_count + 1)).astype(np.int64)
    lists = np.ascontiguousarray(numbers[order].astype(np.int32))
    return Cells(starts, lists, tuple(sides), shift, np.stack([firsts, lasts], axis=1))


def find_pairs(
    kernel: Callable[..., int], count: int, arguments: tuple[Any, ...], sizes: tuple[int, int],
    workers: Workers,
) -> tuple[Int32, Float64]:  # fmt: skip
    """
    Return the pairs that a kernel finds, (M, 2), and the values of each, (M, K).

    Parameters
    ----------
    kernel : Kernel
        Called with a range of things, the arguments, stamps, room for pairs and values, and their
        count; returns one past the last thing whose pairs had room.
    count : int
        Number of things.
    arguments : tuple
    sizes : (int, int)
        How many others there are, and K.
    workers : Workers
    """

    def find(first: int) -> list[tuple[Int32, Float64]]:
        stop, found = min(first + THINGS_PER_TASK, count), []
        stamps, number = np.full(sizes[0], -1, np.int32), np.zeros(1, np.int64)
        room = PAIRS_PER_THING * (stop - first)
        while first < stop:
            pairs, values = np.empty((room, 2), np.int32), np.empty((room, sizes[1]))
            first = kernel((first, stop), *arguments, stamps, pairs, values, number)
            found.append((pairs[: number[0]], values[: number[0]]))
            # What had no room is looked at anew.
            stamps.fill(-1)
            room *= 2
        return found

    parts = [
        part
        for found in workers.run(find, [(n,) for n in range(0, count, THINGS_PER_TASK)])
        for part in found
    ]
    return (
        np.concatenate([np.empty((0, 2), np.int32), *(pairs for pairs, _ in parts)]),
        np.concatenate([np.empty((0, sizes[1])), *(values for _, values in parts)]),
    )
