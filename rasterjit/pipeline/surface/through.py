"""
Find how much light goes through surfaces, and how thick the bodies below them are.

As glTF's KHR_materials_transmission and KHR_materials_volume define it: red of a texture multiplies
``transmission``, green of another ``thickness``.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.surface import samples as rows
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.pipeline.surface.samples import Block
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, stage
from rasterjit.runtime.state import float32

TRANSMISSION, THICKNESS, IOR, MIRRORED, EDGE, INSIDE, PER_DISTANCE = 0, 1, 2, 3, 4, 5, 8
"""Columns of ``Surface.through``: MIRRORED is the share of light straight on that is mirrored, EDGE
a factor on all that is; INSIDE, three, the colour that light has which went through the body for a
distance, PER_DISTANCE one over that."""
COLUMNS = 9


@stage
def find_through(block: Block, count, factors: float32[:, ::1]):
    """
    Write how much light goes through each sample, and how thick the body below it is.

    Parameters
    ----------
    block : Block
        Writes rows TRANSMITTED and THICKNESS of ``through``.
    count : int
    factors : (O, 9) float32
        ``Surface.through``.
    """
    through = block.through
    for k in range(block.counts[rows.SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        share, thickness = factors[owner, TRANSMISSION], factors[owner, THICKNESS]
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            through[rows.TRANSMITTED, n], through[rows.THICKNESS, n] = share, thickness


@disjoint_helper
def multiply_row(shown, row):
    """Multiply a row by another."""
    for i in range(row.shape[0]):
        row[i] *= shown[i]


@stage
def scale_transmission_by_maps(block: Block, count):
    """Multiply how much light goes through by what the textures show in red."""
    shown = part(block.colors, texture_lookup.SHOWN, 0, count)
    multiply_row(shown, part(block.through, rows.TRANSMITTED, 0, count))


@stage
def scale_thickness_by_maps(block: Block, count):
    """Multiply how thick bodies are by what the textures show in green."""
    shown = part(block.colors, texture_lookup.SHOWN + 1, 0, count)
    multiply_row(shown, part(block.through, rows.THICKNESS, 0, count))
