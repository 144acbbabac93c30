"""
Resize an environment map, project it to harmonics, and filter it for rough surfaces.

Pictures are equirectangular, row by row from the top, channel by channel (planar). Every sum runs
in a fixed order, so the same picture gives the same bits everywhere.

The reflection of a surface of roughness r is a weighted mean around the mirror direction. A
direction at the cosine c has the weight ``c D(c)``; D is the GGX distribution with alpha = r**2,
assuming view = normal = mirror direction [1]_. Half vectors bisect the two directions, so their
squared cosine is (1 + c) / 2: the weight is rational in c.

References
----------
.. [1] B. Karis, "Real Shading in Unreal Engine 4", SIGGRAPH 2013 courses.
.. [2] R. Ramamoorthi, P. Hanrahan, "An Efficient Representation for Irradiance Environment Maps",
   SIGGRAPH 2001.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, float64, int64


@kernel
def average_columns(
    source: float32[:, :, ::1], source_edges: float64[::1], out_edges: float64[::1],
    out: float32[:, :, ::1],
):  # fmt: skip
    """
    Write a picture of fewer or more columns, each the mean of the source between its edges.

    Parameters
    ----------
    source : (R, W, 3) float32
    source_edges : (W+1,) float64
        Ascending; column n lies between edges n and n+1.
    out_edges : (V+1,) float64
        Edges of the columns of ``out``, over the same range.
    out : (R, V, 3) float32
        Written.
    """
    last = source.shape[1] - 1
    for row in range(source.shape[0]):
        first = 0
        for n in range(out.shape[1]):
            low, high = out_edges[n], out_edges[n + 1]
            while first < last and source_edges[first + 1] <= low:
                first += 1
            red, green, blue = 0.0, 0.0, 0.0
            column = first
            while column <= last and source_edges[column] < high:
                end = min(high, source_edges[column + 1])
                weight = (end - max(low, source_edges[column])) / (high - low)
                red += weight * source[row, column, 0]
                green += weight * source[row, column, 1]
                blue += weight * source[row, column, 2]
                column += 1
            out[row, n, 0], out[row, n, 1], out[row, n, 2] = red, green, blue


@disjoint_helper
def add_weighted(weight, source, out):
    """Add a row times a weight to another."""
    for i in range(out.shape[0]):
        out[i] += weight * source[i]


@helper
def compute_lobe_weight(c, alpha_squared):
    """Return a direction's weight, given its cosine above 0 to the mirror direction."""
    spread = 0.5 * (1.0 + c) * (alpha_squared - 1.0) + 1.0
    return c / (spread * spread)


@helper
def compute_ramp(value, start, end):
    """Return a value's fraction of the way from start to end, 0..1; a step where both are equal."""
    if value <= start:
        return 0.0
    if value >= end:
        return 1.0
    return (value - start) / (end - start)


@kernel
def add_ring(
    rows: (int64, int64), alpha_squared: float64, ring: float64[::1],
    source: float32[:, :, :, ::1], source_heights: float64[:, ::1], out_heights: float64[:, ::1],
    cosines: float64[::1], total: float64[:, ::1], out: float32[:, :, :, ::1],
):  # fmt: skip
    """
    Add a ring around each direction to the weighted sums of a filtered picture.

    Columns are numbered ``q k + p`` in a picture of q times as many columns as the narrower of the
    two, B: its phase p comes first in the arrays, so that neighbours in memory lie equally far
    from each other in both pictures.

    Parameters
    ----------
    rows : (int, int)
        The rows of ``out`` to work on.
    alpha_squared : float
        The square of the GGX alpha.
    ring : (4,) float64
        One minus the cosine where the ring begins to fade in, has its full weight, begins to
        fade out, and ends.
    source : (3, H, P, 2 B) float32
        The picture, the columns of each phase twice.
    source_heights : (3, H) float64
        Sine and cosine of each row's latitude, and the solid angle of the row.
    out_heights : (2, G) float64
        Sine and cosine of each row's latitude.
    cosines : (2 M,) float64
        Of the angles n / 2M of a turn, M being the number of columns of the wider picture.
    total : (G, Q) float64
        The weights so far, added to.
    out : (3, G, Q, B) float32
        The weighted sums so far, added to.
    """
    phases_in, phases_out, base = source.shape[2], out.shape[2], out.shape[3]
    steps = cosines.shape[0]
    per_source, per_out = steps // (phases_in * base), steps // (phases_out * base)
    for row in range(rows[0], rows[1]):
        y, s = out_heights[0, row], out_heights[1, row]
        for source_row in range(source.shape[1]):
            vertical = y * source_heights[0, source_row]
            horizontal = s * source_heights[1, source_row]
            if 1.0 - (vertical + horizontal) >= ring[3] or vertical + horizontal <= 0.0:
                continue
            for phase in range(phases_out):
                for p in range(phases_in):
                    offset = (2 * p + 1) * per_source // 2 - (2 * phase + 1) * per_out // 2
                    for k in range(base):
                        c = vertical + horizontal * cosines[(k * (steps // base) + offset) % steps]
                        versine = 1.0 - c
                        if c <= 0.0 or versine <= ring[0] or versine >= ring[3]:
                            continue
                        weight = compute_lobe_weight(c, alpha_squared)
                        weight *= source_heights[2, source_row]
                        weight *= compute_ramp(versine, ring[0], ring[1])
                        weight *= 1.0 - compute_ramp(versine, ring[2], ring[3])
                        total[row, phase] += weight
                        for channel in range(3):
                            add_weighted(
                                np.float32(weight),
                                source[channel, source_row, p, k : k + base],
                                out[channel, row, phase],
                            )


@kernel
def project_rows(
    source: float32[:, ::1], cosines: float64[::1], sines: float64[::1], sums: float64[:, ::1]
):  # fmt: skip
    """
    Project each row of a picture: write its sums over cosines and sines of longitude.

    Parameters
    ----------
    source : (H, W) float32
        One channel.
    cosines, sines : (W,) float64
        Of each column's longitude.
    sums : (5, H) float64
        Written: of the values, times cosine, times sine, and both of twice the longitude.
    """
    for row in range(source.shape[0]):
        plain, cosine, sine, double_cosine, double_sine = 0.0, 0.0, 0.0, 0.0, 0.0
        for column in range(source.shape[1]):
            value, c, s = float(source[row, column]), cosines[column], sines[column]
            plain += value
            cosine += value * c
            sine += value * s
            double_cosine += value * (c * c - s * s)
            double_sine += value * (c * s)
        sums[0, row], sums[1, row], sums[2, row] = plain, cosine, sine
        sums[3, row], sums[4, row] = double_cosine, double_sine
