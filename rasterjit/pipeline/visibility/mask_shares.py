"""
Show the share of a mask's texels that are there, where pixels are larger than texels.

There the mip levels of a mask hold shares (``mip_levels``), and a sample is there or not. If shares
were compared with one number, thin leaves would vanish and dense ones grow together [1]_. So the
cutoff varies from place to place, and takes every value from 0 to 1 equally often: then a share of
samples is there that the texels say themselves, whatever lies around, by any filter [2]_.

Places are the cells of a lattice on the texture, two to a texel of the finer level, so that the
same place gets the same cutoff however the picture is cut, and samples of a pixel get different
ones. Of each 2 x 2 texels one gets a cutoff from each quarter of 0..1, in an order that a hash of
the block decides; so do blocks of blocks, and the four cells of a texel. That keeps shares even of
few pixels, be there one sample in each or some [3]_.

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
from rasterjit.pipeline.surface.listing import whole_vectors
from rasterjit.pipeline.surface.texture_lookup import SHOWN
from rasterjit.pipeline.surface.textures import FIRST_LEVEL, LEVEL_COUNT
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, helper

ALPHA = 3
"""The channel of colours."""

CELLS = 2.0
"""Cells of the lattice along a texel of the finer level that is read; `cutoff_of_cell` knows."""

FARTHEST_CELL = float(1 << 30)
"""Cells beyond have the cutoff of the first."""

BLOCKS = 3
"""Blocks of texels, each of 2 x 2 smaller ones, in which cutoffs are even: 64 strata."""

LOW_BITS = 0x7FFFFFFF
"""What is kept of a product, so that the next fits int64."""

LEAST_SHARE = np.float32(1.0 / 256.0)
"""Shares below this are none, and so near to 1 are all: what rounding made."""


@helper
def hashed(column, row, salt):
    """Return 31 bits, int64, that look random, of a block's place, less than 2**31 each."""
    mixed = (column * 0x2545F491 + row * 0x1B873593 + salt * 0x3C6EF372) & LOW_BITS
    mixed = ((mixed ^ (mixed >> 15)) * 0x2C1B3C6D) & LOW_BITS
    mixed = ((mixed ^ (mixed >> 12)) * 0x297A2D39) & LOW_BITS
    return mixed ^ (mixed >> 15)


@helper
def quarter_of(column, row):
    """Return which of four cells one is; those next to each other in order lie across."""
    right, up = column & 1, row & 1
    return ((right ^ up) << 1) | up


@helper
def cutoff_of_cell(column, row):
    """Return the cutoff of a cell of the lattice, float32, between 0 and 1."""
    strata, own = np.int64(0), quarter_of(column, row)
    for n in range(1, BLOCKS + 1):
        turned = hashed(column >> (n + 1), row >> (n + 1), np.int64(n)) >> 8
        strata = (strata << 2) | (quarter_of(column >> n, row >> n) ^ own ^ (turned & 3))
        own = np.int64(0)
    rest = hashed(column, row, np.int64(0)) >> 15
    exact = np.float32((strata << 16) | rest) * np.float32(2.0 ** -(2 * BLOCKS + 16))
    return LEAST_SHARE + (np.float32(1.0) - LEAST_SHARE - LEAST_SHARE) * exact


@helper
def cell_on_axis(u, size):
    """Return the cell of the lattice that holds a coordinate, int64."""
    cell = np.floor(CELLS * u * np.float64(size))
    return np.int64(np.int32(cell if abs(cell) < FARTHEST_CELL else 0.0))


@disjoint_helper
def compare_with_share(alphas, u, v, widths, heights, levels, coarser, first, cutoff):
    """
    Replace what a mask shows by alphas that are above the cutoff or not.

    On level 0, where texels are as large as pixels, they stay as they are, and the cutoff is the
    material's. Towards level 1 it spreads over all values.
    """
    one, none = np.float32(1.0), np.float32(0.0)
    for n in range(alphas.shape[0]):
        way = min(np.float32(levels[n] - first) + coarser[n], one)
        # Squared, edges of large leaves stay smooth longest.
        far = way * way
        own = cutoff_of_cell(cell_on_axis(u[n], widths[n]), cell_on_axis(v[n], heights[n]))
        alpha = alphas[n]
        is_there = alpha >= cutoff + far * (own - cutoff)
        shown = max(alpha, cutoff) if is_there else min(alpha, cutoff)
        alphas[n] = shown + far * ((one if is_there else none) - shown)


@helper
def keep_share(count, cutoff, textures, owner, kind, places, lookup):
    """
    Replace what a mask shows at samples of one object, right after its lookup.

    Parameters
    ----------
    count : int
    cutoff : float32
        Of the texture's alpha alone.
    textures : Textures
    owner, kind : int
        Row of its table.
    places, lookup : arrays
        As `texture_lookup.show_textures` takes them.
    """
    numbers, shares, colors = lookup
    row, size = textures.table[owner, kind], whole_vectors(count)
    first = row[FIRST_LEVEL]
    texture_lookup.take_levels(
        size, 0, (first, first + row[LEVEL_COUNT] - 1), textures.levels, numbers
    )
    u, v = texture_lookup.places_seen(0, size, owner, kind, textures, places)
    compare_with_share(
        part(colors, SHOWN + ALPHA, 0, size), u, v, part(numbers, texture_lookup.WIDTH, 0, size),
        part(numbers, texture_lookup.HEIGHT, 0, size), part(numbers, texture_lookup.LEVEL, 0, size),
        part(shares, texture_lookup.COARSER, 0, size), np.int32(first), cutoff,
    )  # fmt: skip
