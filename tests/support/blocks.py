"""Run stages of shading on samples that a test makes."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.surface.sample_block import COUNT_ELEMENTS, MAX_SAMPLES, NEXT_COLUMN, Block
from rasterjit.rendering.pass_runner import BLOCK, THREAD_BLOCK
from rasterjit.runtime.jit import stage
from rasterjit.runtime.stage_runner import StageList, Step
from rasterjit.runtime.state_block import float32


@stage
def take_samples(block: Block, count, given: float32[:, ::1]):
    """Fill a block with the next columns of some rows; return how many there are, or -1."""
    first = block.counts[NEXT_COLUMN]
    stop = min(first + MAX_SAMPLES, np.int64(given.shape[1]))
    for row in range(given.shape[0]):
        for n in range(first, stop):
            block.samples[row, n - first] = given[row, n]
    block.counts[NEXT_COLUMN] = stop
    return stop - first if stop > first else np.int64(-1)


@stage
def give_samples(block: Block, count, taken: float32[:, ::1]):
    """Write the rows of a block to the columns that it was filled with."""
    first = block.counts[NEXT_COLUMN] - count
    for row in range(taken.shape[0]):
        for n in range(count):
            taken[row, first + n] = block.samples[row, n]


def run(samples, *steps):
    """Run stages, each a tuple of it and its arguments, on samples, (rows, N) float32; in place."""
    THREAD_BLOCK.block[:COUNT_ELEMENTS] = 0
    some = [Step(own, tuple(arguments)) for own, *arguments in steps]
    taken, given = Step(take_samples, (samples,)), Step(give_samples, (samples,))
    StageList([taken, *some, given]).run(THREAD_BLOCK.block, BLOCK)
