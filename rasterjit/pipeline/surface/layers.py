"""
Find what glTF's extensions lay over surfaces: rows of samples for varnish, cloth and own mirrors.

What these layers have in common is a few moves of rows. A layer is lit by the stages that light
every surface: its rows change places with those of the surface, the stages run, and the rows change
back.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.surface import samples as rows
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.pipeline.surface.samples import Block
from rasterjit.runtime.jit import stage
from rasterjit.runtime.state import float32, int64

MIST_RED = rows.BEFORE_RED
"""
Rows, three: what the fog before a surface shows by itself; nothing is lit any more by then.

What is behind is seen through all of the fog, that before the surface included.
"""


@stage
def fill_rows(block: Block, count, factors: float32[:, ::1], first: int64):
    """Write what each object has, (O, N), to N rows of its samples from ``first`` on."""
    for k in range(block.counts[rows.SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        for n in range(factors.shape[1]):
            for i in range(segment[rows.START], segment[rows.STOP]):
                block.samples[first + n, i] = factors[owner, n]


@stage
def copy_rows(block: Block, count, source: int64, target: int64, number: int64):
    """Copy some rows of samples, from ``source`` on, to those from ``target`` on."""
    for k in range(number):
        for n in range(count):
            block.samples[target + k, n] = block.samples[source + k, n]


@stage
def exchange_rows(block: Block, count, one: int64, other: int64, number: int64):
    """Let some rows of samples, from ``one`` on, change places with those from ``other`` on."""
    for k in range(number):
        for n in range(count):
            kept = block.samples[one + k, n]
            block.samples[one + k, n] = block.samples[other + k, n]
            block.samples[other + k, n] = kept


@stage
def scale_rows_by_textures(block: Block, count, first: int64, channel: int64, number: int64):
    """Multiply rows of samples by what the textures show from a channel on."""
    for k in range(number):
        for n in range(count):
            shown = block.colors[texture_lookup.SHOWN + channel + k, n]
            block.samples[first + k, n] *= shown
