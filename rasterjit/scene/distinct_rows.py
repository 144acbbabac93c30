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
    words = [_words(column) for column in columns]
    count = len(words[0])
    # Hashes with numbers below are sorted much faster than the numbers by hashes, and none is equal
    # to another, so that the order is the same on every CPU.
    shift = np.uint64(count.bit_length())
    keys = _hash_rows(words) >> shift
    keys <<= shift
    keys |= np.arange(count, dtype=np.uint64)
    keys.sort()
    order = (keys & ((np.uint64(1) << shift) - np.uint64(1))).astype(np.int64)
    keys >>= shift
    begins = _steps([keys], None)
    new = _steps(words, order)
    mixed = new & ~begins
    if mixed.any():
        # Rows that differ share a hash: sort these by the rows themselves.
        run = np.cumsum(begins) - 1
        places = np.flatnonzero(np.isin(run, run[mixed]))
        rows = order[places]
        order[places] = rows[np.lexsort((*(word[rows] for word in words), run[places]))]
        new = _steps(words, order)
    # Number by first appearance, which keeps the mesh's own locality.
    first = order[new]
    appears = np.zeros(count, dtype=bool)
    appears[first] = True
    rank = (np.cumsum(appears) - 1)[first]
    row_of_each = np.empty(count, dtype=np.int64)
    row_of_each[order] = rank[np.cumsum(new) - 1]
    return row_of_each, np.flatnonzero(appears)


def _words(column: NDArray[Any]) -> NDArray[Any]:
    """Return numbers of which equal ones have the same bits as whole numbers."""
    if column.dtype.kind != "f":
        return column
    # Adding zero turns -0 into 0.
    return (column + column.dtype.type(0.0)).view(f"u{column.dtype.itemsize}")


def _hash_rows(words: list[NDArray[Any]]) -> NDArray[np.uint64]:
    """Mix the words of each row into one of 64 bits (multiply and xor-shift, as in SplitMix64)."""
    key = np.zeros(len(words[0]), dtype=np.uint64)
    for word in words:
        key ^= word.astype(np.uint64)
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(29)
    return key


def _steps(words: list[NDArray[Any]], order: Int64 | None) -> Bool:
    """Mark the rows, in an order, that differ from the one before; the first does."""
    differ = np.zeros(len(words[0]), dtype=bool)
    differ[:1] = True
    for word in words:
        sorted_words = word if order is None else word[order]
        differ[1:] |= sorted_words[1:] != sorted_words[:-1]
    return differ
