"""Number the distinct rows of a table, such as positions at which several vertices lie."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.arrays import Bool, Int64


def distinct_rows(*columns: NDArray[Any]) -> tuple[Int64, Int64]:
    """
    Number the distinct rows in order of first appearance.

    Parameters
    ----------
    *columns : (N,) float or int
        -0 and 0 are one, NaNs with the same bits are one.

    Returns
    -------
    row_of_each : (N,) int64
        Number of the distinct row that each row is.
    first_of_row : (R,) int64
        Where each of them appears first, ascending.
    """
    bits = [_bit_patterns(column) for column in columns]
    count = len(bits[0])
    # Hashes with numbers below are sorted much faster than the numbers by hashes, and none is equal
    # to another, so that the order is the same on every CPU.
    shift = np.uint64(count.bit_length())
    keys = _hash_rows(bits) >> shift
    keys <<= shift
    keys |= np.arange(count, dtype=np.uint64)
    keys.sort()
    order = (keys & ((np.uint64(1) << shift) - np.uint64(1))).astype(np.int64)
    keys >>= shift
    starts_hash = _mark_changes([keys], None)
    starts_row = _mark_changes(bits, order)
    is_collision = starts_row & ~starts_hash
    if is_collision.any():
        # Rows that differ share a hash: sort these by the rows themselves.
        run = np.cumsum(starts_hash) - 1
        positions = np.flatnonzero(np.isin(run, run[is_collision]))
        ids = order[positions]
        order[positions] = ids[np.lexsort((*(word[ids] for word in bits), run[positions]))]
        starts_row = _mark_changes(bits, order)
    # Number by first appearance, which keeps the mesh's own locality.
    first = order[starts_row]
    is_first = np.zeros(count, dtype=bool)
    is_first[first] = True
    rank = (np.cumsum(is_first) - 1)[first]
    row_of_each = np.empty(count, dtype=np.int64)
    row_of_each[order] = rank[np.cumsum(starts_row) - 1]
    return row_of_each, np.flatnonzero(is_first)


def _bit_patterns(column: NDArray[Any]) -> NDArray[Any]:
    """Return a column as integers, equal where its numbers are equal: -0 becomes 0."""
    if column.dtype.kind != "f":
        return column
    # Adding zero turns -0 into 0.
    return (column + column.dtype.type(0.0)).view(f"u{column.dtype.itemsize}")


def _hash_rows(columns: list[NDArray[Any]]) -> NDArray[np.uint64]:
    """Hash each row to 64 bits (multiply and xor-shift, as in SplitMix64)."""
    key = np.zeros(len(columns[0]), dtype=np.uint64)
    for column in columns:
        key ^= column.astype(np.uint64)
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(29)
    return key


def _mark_changes(columns: list[NDArray[Any]], order: Int64 | None) -> Bool:
    """Mark the first row of an order and those that differ from the one before, (N,) bool."""
    changes = np.zeros(len(columns[0]), dtype=bool)
    changes[:1] = True
    for column in columns:
        values = column if order is None else column[order]
        changes[1:] |= values[1:] != values[:-1]
    return changes
