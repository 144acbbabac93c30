"""
Instructions that no loop compiles to, and what reads memory by its address.

A value is spread over neighbouring places; texels, four channels each, are copied and mixed: LLVM
makes no vector of a loop of so few steps. A part of a row is a slice that compiles in a fraction of
the time, since it asks nothing about its ends. Here stands what they do in Python; ``instructions``
has the machine's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.runtime.jit import MACHINE, helper, intrinsic, raise_failed

LANES = 8
"""Values written at once: a 256-bit register of 32-bit numbers."""

CHANNELS = 4
"""Channels of a texel: a 128-bit register of 32-bit numbers."""


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


@intrinsic
def copy_texel(texels: Any, number: Any, colors: Any, n: Any) -> None:
    """Copy a texel, channel by channel."""
    for k in range(CHANNELS):
        colors[CHANNELS * n + k] = texels[number, k]


@intrinsic
def mix_texels(texels: Any, numbers: Any, right: Any, up: Any, colors: Any, n: Any) -> None:
    """Mix four texels, channel by channel."""
    for k in range(CHANNELS):
        a, b, c, d = (texels[number, k] for number in numbers)
        lower, upper = a + right * (b - a), c + right * (d - c)
        colors[CHANNELS * n + k] = lower + up * (upper - lower)


@intrinsic
def mix_colors(colors: Any, others: Any, share: Any, n: Any) -> None:
    """Mix two colours, channel by channel."""
    for at in range(CHANNELS * n, CHANNELS * (n + 1)):
        colors[at] += share * (others[at] - colors[at])


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
def call_at(address: Any, state: Any, first: Any, stop: Any) -> Any:
    """Call ``int64 f(int64, int64, int64)`` at an address."""
    word = MACHINE(int(address))(int(state), int(first), int(stop))
    raise_failed()
    return word


@helper
def call_bound(words):
    """Call a kernel by the words of a ``jit.Bound``; return what it returns."""
    return call_at(words[0], words[1], np.int64(0), np.int64(0))


@intrinsic
def flat(array: Any) -> Any:
    """Return a contiguous array as one row, without a copy."""
    return array.reshape(-1)
