"""Watch what shades a frame: the stages that run, and what makes lists of them."""

from __future__ import annotations

from contextlib import contextmanager
from unittest import mock

import numpy as np

from rasterjit.pipeline.surface.gather_samples import list_samples
from rasterjit.pipeline.surface.sample_block import (
    COUNT_ELEMENTS,
    KIND,
    SEGMENT_COUNT,
    START,
    STOP,
    Block,
)
from rasterjit.rendering.pass_runner import BLOCK, THREAD_BLOCK, Shading
from rasterjit.runtime.jit import stage
from rasterjit.runtime.stage_runner import StageList, Step
from rasterjit.runtime.state_block import int64, view_block_arrays


def name_of(stage):
    """Return the name of a stage."""
    return stage.__name__


@contextmanager
def lists_run(runs=True):
    """Collect the names of the stages of each list that runs; without ``runs``, run none."""
    lists, run = [], StageList.run

    def note(own, block, kind):
        lists.append([name_of(step.stage) for step in own.steps()])
        if runs:
            run(own, block, kind)

    with mock.patch.object(StageList, "run", note):
        yield lists


@contextmanager
def bands_shaded():
    """Collect the bands of rows that are shaded: a `Shading` and what its ``shade`` is given."""
    bands, shade = [], Shading.shade

    def note(own, faces, first_row, linear, color, background=None):
        shade(own, faces, first_row, linear, color, background)
        bands.append((own, faces, first_row, linear, color))

    with mock.patch.object(Shading, "shade", note):
        yield bands


@stage
def count_samples(block: Block, count, kinds: int64[::1]):
    """Add how many samples lie in spans, and how many in mixed segments."""
    for k in range(block.counts[SEGMENT_COUNT]):
        segment = block.segments[k]
        kinds[segment[KIND]] += segment[STOP] - segment[START]


def samples_listed(faces):
    """
    Return how many samples of an image of faces, (R, W) int32, lie in spans and in mixed segments.

    All faces belong to one object.
    """
    kinds, count = np.zeros(2, np.int64), int(faces.max()) + 1
    listed = (
        faces, 0, len(faces), np.zeros((count, 3), np.int32), np.array([0, count]),
        np.zeros(4, np.float32), 0, np.empty((len(faces), 0, 4), np.float32),
        np.empty((len(faces), 0), np.uint32),
    )  # fmt: skip
    THREAD_BLOCK.block[:COUNT_ELEMENTS] = 0
    steps = [Step(list_samples, listed), Step(count_samples, (kinds,))]
    StageList(steps).run(THREAD_BLOCK.block, BLOCK)
    return tuple(kinds.tolist())


def block_at_hand():
    """Return the arrays of this thread's block of samples, a `Block`."""
    return view_block_arrays(BLOCK, THREAD_BLOCK.block)
