"""
Set aside what is found in float32 while stages of float64 find the rest.

`set_aside_sure` hides the segments without doubtful samples from these stages, and `take_back_sure`
takes what they found of doubtful samples alone: see ``float32_planes``.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.surface import samples as row
from rasterjit.pipeline.surface.attributes import fill_row
from rasterjit.pipeline.surface.float32_planes import EXACT, FOREIGN, SURE, any_doubtful
from rasterjit.pipeline.surface.samples import (
    OWNER,
    PLACE_OWNER,
    SEGMENTS,
    START,
    STOP,
    VECTOR,
    Block,
)
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, helper, stage

KEPT, KEPT_ROWS = 0, 9
"""First of the rows of ``colors`` for colours, normals and points in float32, and their number."""

SET_ASIDE, HOW_EXACT, HOW_MANY = 0, 8, 9
"""Rows of ``numbers``: the eight columns of segments, what is found of each; how many there are."""

ALL_SURE, SOME_DOUBTFUL, ALL_FOREIGN = 0, 1, 2
"""What `HOW_EXACT` holds."""


@disjoint_helper
def keep(values, kept):
    """Copy a row."""
    for n in range(values.shape[0]):
        kept[n] = values[n]


@disjoint_helper
def restore(values, kept, exact):
    """Write what was kept where it is to be."""
    for n in range(values.shape[0]):
        own, before = values[n], kept[n]
        values[n] = own if exact[n] > SURE else before


@helper
def how_exact(s, e, block):
    """Return what is found in float64 of a segment."""
    if block.shares[EXACT, np.uintp(s)] == FOREIGN:
        return np.int32(ALL_FOREIGN)
    doubts = any_doubtful(part(block.shares, EXACT, s, e))
    return np.int32(SOME_DOUBTFUL if doubts != 0 else ALL_SURE)


@helper
def row_kept(k):
    """Return which row of samples is kept: colours, then normals and points."""
    return row.RED + k if k < 3 else row.NORMAL_X + k - 3


@helper
def run_of(k, total, numbers):
    """Return one past the last of the segments from ``k`` on that are as exact, and its samples."""
    first, start = numbers[HOW_EXACT, k], np.int64(numbers[SET_ASIDE + START, k])
    while k < total and numbers[HOW_EXACT, k] == first:
        k += np.uintp(1)
    return k, start, np.int64(numbers[SET_ASIDE + STOP, k - np.uintp(1)])


@helper
def end_kept(exact, s, e):
    """
    Return the end of what is kept of a run of segments.

    Stages that find others write behind the end of these, but not further than a vector.
    """
    return min(e, s + VECTOR) if exact == ALL_SURE else e


@stage
def set_aside_sure(block: Block, count):
    """
    Set aside what is found in float32, and hide segments of which all is.

    Stages up to `take_back_sure` find the others alone.
    """
    segments, numbers, samples = block.segments, block.numbers, block.samples
    left, total = np.int64(0), np.uintp(block.counts[SEGMENTS])
    numbers[HOW_MANY, 0] = np.int32(total)
    for k in range(total):
        for c in range(8):
            numbers[SET_ASIDE + c, k] = segments[k, c]
        exact = how_exact(np.int64(segments[k, START]), np.int64(segments[k, STOP]), block)
        numbers[HOW_EXACT, k] = exact
        if exact != ALL_SURE:
            if np.int64(k) != left:
                for c in range(8):
                    segments[left, c] = segments[k, c]
            left += 1
    block.counts[SEGMENTS] = left
    if left == 0:
        return
    k = np.uintp(0)
    while k < total:
        exact, (k, s, e) = numbers[HOW_EXACT, k], run_of(k, total, numbers)
        if exact != ALL_FOREIGN:
            e = end_kept(exact, s, e)
            for n in range(KEPT_ROWS):
                keep(part(samples, row_kept(n), s, e), part(block.colors, KEPT + n, s, e))


@stage
def take_back_sure(block: Block, count):
    """Put back what was set aside, where float32 is good enough; bring all segments back."""
    segments, numbers, samples = block.segments, block.numbers, block.samples
    total, has_changed = np.uintp(numbers[HOW_MANY, 0]), block.counts[SEGMENTS] > 0
    block.counts[SEGMENTS] = np.int64(total)
    k = np.uintp(0)
    while k < total:
        start, exact, (k, s, e) = k, numbers[HOW_EXACT, k], run_of(k, total, numbers)
        for i in range(start, k):
            for c in range(8):
                segments[i, c] = numbers[SET_ASIDE + c, i]
            if exact == ALL_SURE:
                # Textures are looked up by it.
                fill_row(
                    part(block.places, PLACE_OWNER, segments[i, START], segments[i, STOP]),
                    np.float64(segments[i, OWNER]),
                )  # fmt: skip
        if exact == ALL_FOREIGN or not has_changed:
            continue
        e = end_kept(exact, s, e)
        for n in range(KEPT_ROWS):
            values, kept = part(samples, row_kept(n), s, e), part(block.colors, KEPT + n, s, e)
            if exact == ALL_SURE or n < 3:
                keep(kept, values)
            else:
                restore(values, kept, part(block.shares, EXACT, s, e))
