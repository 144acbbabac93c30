"""
Compute eye-dome shading from the depth of neighbouring pixels, and darken samples by it.

Nearness is a number whose differences tell how far one depth lies before another: the logarithm of
the stored depth, which is proportional to one over the distance, or a multiple of the stored depth
of a parallel projection, which falls linearly with it. See `rasterjit.scene.eye_dome.EyeDome`.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.light_stages import read_interval
from rasterjit.pipeline.surface.sample_block import INTERVAL_COUNT, INTERVAL_FRAME_ROW, Block
from rasterjit.runtime.float_math import MIN_NORMAL, exp2, log2
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, kernel, stage
from rasterjit.runtime.state_block import float32, int64


@disjoint_helper
def write_log_depth_row(depth, nearness):
    """Write log2 of the stored depths of a row; -inf where nothing is."""
    nothing = np.float32(-np.inf)
    for i in range(nearness.shape[0]):
        log = log2(max(depth[i], MIN_NORMAL))
        nearness[i] = log if depth[i] > nothing else nothing


@kernel
def compute_nearness(depth: float32[:, ::1], rows: (int64, int64), nearness: float32[:, ::1]):
    """
    Find how near pixels are to the eye.

    Parameters
    ----------
    depth : (H, W) float32, stored depth
        -inf where nothing is.
    rows : (int, int)
        The first row, and one past the last.
    nearness : (H, W) float32
        Writes these rows: log2 of the depth; -inf where nothing is.
    """
    for row in range(rows[0], rows[1]):
        write_log_depth_row(depth[row], nearness[row])


@disjoint_helper
def add_nearer_neighbours(nearness, neighbour, total):
    """Add by how much neighbours are nearer."""
    zero = np.float32(0.0)
    for i in range(total.shape[0]):
        nearer = neighbour[i] - nearness[i]
        total[i] += nearer if nearer > zero else zero


@disjoint_helper
def write_shading_row(nearness, total, factor, shading):
    """Write the shares of light that are left; 1 where nothing is."""
    for i in range(shading.shape[0]):
        shade = exp2(-(factor * total[i]))
        shading[i] = shade if nearness[i] > np.float32(-np.inf) else np.float32(1.0)


@kernel
def compute_shading(
    nearness: float32[:, ::1], rows: (int64, int64), offsets: int64[:, ::1], factor: float32,
    shading: float32[:, ::1], total: float32[::1],
):  # fmt: skip
    """
    Find the share of its light that each pixel keeps.

    Parameters
    ----------
    nearness : (H, W) float32
        -inf where nothing is.
    rows : (int, int)
        The first row, and one past the last.
    offsets : (N, 2) int64
        How far to the right and down neighbours lie, pixels.
    factor : float32
        Halvings of the light for each unit of nearness that neighbours have more, in sum.
    shading : (H, W) float32
        Writes these rows, 0..1.
    total : (W,) float32
        This thread's own scratch.
    """
    height, width = nearness.shape
    for row in range(rows[0], rows[1]):
        for i in range(np.uintp(width)):
            total[i] = np.float32(0.0)
        for n in range(offsets.shape[0]):
            dx, source = offsets[n, 0], row + offsets[n, 1]
            begin, end = max(0, -dx), min(width, width - dx)
            if source < 0 or source >= height or begin >= end:
                continue
            add_nearer_neighbours(
                part(nearness, row, begin, end),
                part(nearness, source, begin + dx, end + dx), total[begin:end],
            )  # fmt: skip
        write_shading_row(nearness[row], total, factor, shading[row])


@stage
def darken_samples(block: Block, count, shading: float32[:, ::1], first: int64):
    """
    Multiply the colour of each sample by the share of its pixel.

    Parameters
    ----------
    block : Block
        Changes three rows of colours.
    count : int
    shading : (H, W) float32
        Of the frame, 0..1.
    first : int
        Number of the row of red; green and blue follow.
    """
    red, green, blue = block.samples[first], block.samples[first + 1], block.samples[first + 2]
    for k in range(block.counts[INTERVAL_COUNT]):
        _, column, start, stop = read_interval(block, k)
        row = block.intervals[k, INTERVAL_FRAME_ROW]
        shades = shading[row, column : column + stop - start]
        for i in range(np.uintp(stop - start)):
            n = np.uintp(start) + i
            red[n] = red[n] * shades[i]
            green[n] = green[n] * shades[i]
            blue[n] = blue[n] * shades[i]
