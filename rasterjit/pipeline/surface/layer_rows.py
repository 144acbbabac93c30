"""
Fill and swap the rows of material layers: clearcoat, sheen, dielectric specular, transmission.

A layer is lit by the same stages as the base material: its rows are swapped with those of the
surface, the stages run, and the rows are swapped back.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.jit import stage
from rasterjit.runtime.state_block import float32, int64

FOG_RED = rows.BEFORE_SPECULAR_RED
"""
Rows, three: light scattered by the fog in front of a surface, after lighting.

The background is seen through all of the fog, including that in front of the surface.
"""


@stage
def fill_rows(block: Block, count, factors: float32[:, ::1], first: int64):
    """Write per-object factors, (O, N), to N rows of samples from ``first`` on."""
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        for n in range(factors.shape[1]):
            for i in range(segment[rows.START], segment[rows.STOP]):
                block.samples[first + n, i] = factors[owner, n]


@stage
def copy_rows(block: Block, count, source: int64, target: int64, row_count: int64):
    """Copy ``row_count`` rows of samples, from ``source`` on, to those from ``target`` on."""
    for k in range(row_count):
        for n in range(count):
            block.samples[target + k, n] = block.samples[source + k, n]


@stage
def swap_rows(block: Block, count, first: int64, second: int64, row_count: int64):
    """Swap ``row_count`` rows of samples, from ``first`` on, with those from ``second`` on."""
    for k in range(row_count):
        for n in range(count):
            saved = block.samples[first + k, n]
            block.samples[first + k, n] = block.samples[second + k, n]
            block.samples[second + k, n] = saved


@stage
def multiply_rows_by_textures(block: Block, count, first: int64, channel: int64, row_count: int64):
    """Multiply ``row_count`` rows of samples by the textures' channels, from ``channel`` on."""
    for k in range(row_count):
        for n in range(count):
            texel = block.colors[texture_lookup.TEXTURE_RED + channel + k, n]
            block.samples[first + k, n] *= texel
