"""
Hashed alpha test for minified masks: preserve a mask's coverage where texels are below a pixel.

There mip levels of a mask hold coverage (``mip_levels``), but a sample is opaque or discarded. With
one cutoff, thin leaves would vanish and dense ones grow together [1]_. So the cutoff varies over
the texture, uniformly distributed in 0..1: the expected coverage is the texels' own, with any
filter [2]_.

Cutoffs belong to cells of a lattice on the texture, two per texel of the finer level: stable for
any division of the picture, and different for the samples of a pixel. They are stratified: of each
2 x 2 texels each has a cutoff from another quarter of 0..1, in an order hashed from the block; so
do blocks of blocks, and the four cells of a texel. That keeps coverage accurate over few pixels,
with one or several samples in each [3]_.

References
----------
.. [1] I. Castaño, "Computing Alpha Mipmaps", 2010.
.. [2] C. Wyman and M. McGuire, "Hashed Alpha Testing", I3D 2017.
.. [3] A. Ahmed and P. Wonka, "Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error via
   Hierarchical Ordering of Pixels", SIGGRAPH Asia 2020.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.surface import texture_lookup
from rasterjit.pipeline.surface.gather_samples import round_up_to_vectors
from rasterjit.pipeline.surface.texture_filters import FIRST_LEVEL, LEVEL_COUNT
from rasterjit.pipeline.surface.texture_lookup import TEXTURE_RED
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, helper

ALPHA = 3
"""Channel of colours."""

CELLS_PER_TEXEL = 2.0
"""Cells of the lattice along a texel of the finer mip level; `compute_cutoff` relies on it."""

MAX_CELL = float(1 << 30)
"""Coordinates beyond this cell use cell 0."""

BLOCK_LEVELS = 3
"""Levels of 2 x 2 blocks over which cutoffs are stratified: 64 strata."""

LOW_31_BITS = 0x7FFFFFFF
"""Mask for the low bits of a product, so that the next fits int64."""

MIN_COVERAGE = np.float32(1.0 / 256.0)
"""Coverage below this counts as 0, and within this of 1 as 1: rounding errors."""


@helper
def hash_block(column, row, salt):
    """Hash a block's column and row, each below 2**31, to 31 bits, int64."""
    bits = (column * 0x2545F491 + row * 0x1B873593 + salt * 0x3C6EF372) & LOW_31_BITS
    bits = ((bits ^ (bits >> 15)) * 0x2C1B3C6D) & LOW_31_BITS
    bits = ((bits ^ (bits >> 12)) * 0x297A2D39) & LOW_31_BITS
    return bits ^ (bits >> 15)


@helper
def get_quarter(column, row):
    """Return the index 0..3 of a cell in its 2 x 2 block; 0 and 1, 2 and 3 are diagonal."""
    right, up = column & 1, row & 1
    return ((right ^ up) << 1) | up


@helper
def compute_cutoff(column, row):
    """Return the cutoff of a cell of the lattice, float32, between 0 and 1."""
    strata, quarter = np.int64(0), get_quarter(column, row)
    for n in range(1, BLOCK_LEVELS + 1):
        hashed_bits = hash_block(column >> (n + 1), row >> (n + 1), np.int64(n)) >> 8
        strata = (strata << 2) | (get_quarter(column >> n, row >> n) ^ quarter ^ (hashed_bits & 3))
        quarter = np.int64(0)
    rest = hash_block(column, row, np.int64(0)) >> 15
    exact = np.float32((strata << 16) | rest) * np.float32(2.0 ** -(2 * BLOCK_LEVELS + 16))
    return MIN_COVERAGE + (np.float32(1.0) - MIN_COVERAGE - MIN_COVERAGE) * exact


@helper
def find_cell(u, size):
    """Return the cell of the lattice that holds a coordinate, int64."""
    cell = np.floor(CELLS_PER_TEXEL * u * np.float64(size))
    return np.int64(np.int32(cell if abs(cell) < MAX_CELL else 0.0))


@disjoint_helper
def apply_cell_cutoffs(alphas, u, v, widths, heights, levels, coarser, first, cutoff):
    """
    Replace a mask's filtered alphas by alphas above or below the cutoff, by the hashed test.

    On level 0, where texels are as large as pixels, alphas stay, and the cutoff is the material's.
    Towards level 1 cutoffs spread over 0..1.
    """
    one, none = np.float32(1.0), np.float32(0.0)
    for n in range(alphas.shape[0]):
        level = min(np.float32(levels[n] - first) + coarser[n], one)
        # Squared, edges of large leaves stay smooth longest.
        spread = level * level
        cell_cutoff = compute_cutoff(find_cell(u[n], widths[n]), find_cell(v[n], heights[n]))
        alpha = alphas[n]
        passes = alpha >= cutoff + spread * (cell_cutoff - cutoff)
        opaque = max(alpha, cutoff) if passes else min(alpha, cutoff)
        alphas[n] = opaque + spread * ((one if passes else none) - opaque)


@helper
def apply_hashed_alpha(count, cutoff, textures, owner, kind, uv_rows, lookup):
    """
    Apply `apply_cell_cutoffs` to samples of one object, right after the texture lookup.

    Parameters
    ----------
    count : int
    cutoff : float32
        Cutoff of the texture's alpha alone.
    textures : Textures
    owner, kind : int
        Row of the textures' table.
    uv_rows, lookup : arrays
        As `texture_lookup.look_up_textures` takes them.
    """
    ints, floats, colors = lookup
    row, size = textures.table[owner, kind], round_up_to_vectors(count)
    first = row[FIRST_LEVEL]
    texture_lookup.gather_levels(
        size, 0, first, first + row[LEVEL_COUNT] - 1, textures.levels, ints
    )
    u, v = texture_lookup.get_transformed_uv(0, size, owner, kind, textures, uv_rows)
    apply_cell_cutoffs(
        part(colors, TEXTURE_RED + ALPHA, 0, size), u, v,
        part(ints, texture_lookup.LEVEL_WIDTH, 0, size),
        part(ints, texture_lookup.LEVEL_HEIGHT, 0, size), part(ints, texture_lookup.LEVEL, 0, size),
        part(floats, texture_lookup.COARSER_WEIGHT, 0, size), np.int32(first), cutoff,
    )  # fmt: skip
