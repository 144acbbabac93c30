"""Kernels that compile in no time, for tests of how they are compiled and kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rasterjit.runtime.intrinsics import call_at, flat, load_int64, store_int64
from rasterjit.runtime.jit import disjoint_helper, helper, kernel, raw_kernel


class Line(NamedTuple):
    slope: float
    offset: float


@helper
def at(line, x):
    return line.slope * x + line.offset


@disjoint_helper
def add(row, other, out):
    for n in range(len(row)):
        out[n] = row[n] + other[n]


@helper
def shared(line, row, out):
    for n in range(len(row)):
        out[n] = at(line, row[n])


@kernel
def draw_line(line, row, out):
    """Write ``slope * x + offset`` for each x."""
    shared(line, row, out)


@kernel
def add_lines(line, row, out):
    """Add the line to the row; return how many are positive."""
    count = 0
    shared(line, row, out)
    add(row, out, out)
    for n in range(len(out)):
        if out[n] > 0.0:
            count += 1
    return count


@kernel
def sum_image(image, out):
    """Write the sum of an image."""
    row = flat(image)
    out[0] = 0.0
    for n in range(len(row)):
        out[0] += row[n]


@kernel
def has_index(row, n):
    """Tell whether an element is positive; nobody looks whether it is there."""
    return row[n] > 0.0


@kernel
def call(words):
    """Call a kernel by its words; return what it returns."""
    return call_at(words[0], words[1], np.int64(0), np.int64(0))


@kernel
def count_up(row, number):
    """Add 1 to the first element; return the number."""
    row[0] += 1
    return number


@raw_kernel
def note_scratch(state, scratch, stop):
    """Write the address of the scratch memory to the state, and count calls in that memory."""
    store_int64(state, scratch)
    store_int64(scratch, load_int64(scratch) + 1)
    return np.int64(0)
