"""The obvious twin of the visibility kernel: one triangle, in NumPy integers and float64."""

from __future__ import annotations

import numpy as np

from rasterjit.inspect import oracle

BLOCK = 64
"""Depth along a row of a wide triangle starts anew every so many columns."""

SMALL = 8
"""Samples that lie in the width of the widest triangle whose depth does not step along rows."""

MAX = 2**29
"""Coordinates below it, on the sub-pixel grid, have edge functions that 64 bits hold."""


def samples_of(size, unit, place=(0.5, 0.5)):
    """Return x (1, W) and y (H, 1), int64, of the samples of an image on a grid of units."""
    first = [int(unit * part) for part in place]
    assert first == [unit * part for part in place], "a place is on the grid"
    return (
        np.arange(size[0], dtype=np.int64)[np.newaxis] * unit + first[0],
        np.arange(size[1], dtype=np.int64)[:, np.newaxis] * unit + first[1],
    )


def edge(a, b, x, y):
    """Return the edge function of grid points a, b at samples, int64: ``oracle.edge`` for many."""
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])


def covers(corners, x, y):
    """
    Tell by the top-left rule which samples a triangle owns: ``oracle.covers`` for many.

    Parameters
    ----------
    corners : three (int, int)
        On the sub-pixel grid.
    x, y : (1, W), (H, 1) int64
        The samples, on the same grid.

    Returns
    -------
    (H, W) bool
    """
    assert max(abs(c) for corner in corners for c in corner) < MAX
    assert max(int(x.max()), int(y.max())) < MAX
    a, b, c = corners
    area = oracle.edge(a, b, c)
    if area < 0:
        b, c = c, b
    owned = np.full(np.broadcast_shapes(x.shape, y.shape), area != 0)
    for start, end in ((a, b), (b, c), (c, a)):
        is_left, is_top = end[1] < start[1], end[1] == start[1] and end[0] > start[0]
        value = edge(start, end, x, y)
        owned &= value >= 0 if is_left or is_top else value > 0
    return owned


def stored_depths(points, depths, size, bits=8):
    """
    Return the depth that one triangle stores at each pixel, -inf where it does not cover it.

    Parameters
    ----------
    points : (3, 2) float64
        Screen, pixels.
    depths : (3,) float64
        Stored depth: greater is nearer.
    size : (int, int)
        Width and height.
    bits : int
        Sub-pixel bits.

    Returns
    -------
    (height, width) float32
    """
    unit, spacing = 2 ** max(bits, 1), 2 if bits == 0 else 1
    a, b, c = (
        (oracle.snap(x, bits) * spacing, oracle.snap(y, bits) * spacing, float(depth))
        for (x, y), depth in zip(np.asarray(points, float).tolist(), depths, strict=True)
    )
    if oracle.edge(a[:2], b[:2], c[:2]) < 0:
        b, c = c, b
    while (a[1], a[0]) != min((y, x) for x, y, _ in (a, b, c)):
        a, b, c = b, c, a
    found = np.full((size[1], size[0]), -np.inf, np.float32)
    area = oracle.edge(a[:2], b[:2], c[:2])
    if area == 0:
        return found
    weight_a, weight_b = (a[2] - c[2]) / float(area), (b[2] - c[2]) / float(area)
    step = float((b[1] - c[1]) * unit) * weight_a + float((c[1] - a[1]) * unit) * weight_b
    lowest, highest = min(a[2], b[2], c[2]), max(a[2], b[2], c[2])
    left, right = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
    width = (right - unit // 2) // unit - -((unit // 2 - left) // unit) + 1
    x, y = samples_of(size, unit)
    covered = covers((a[:2], b[:2], c[:2]), x, y)
    # Along a row the depth steps from the first covered sample of each block of columns.
    start = np.broadcast_to(np.arange(size[0]), covered.shape).copy()
    if width > SMALL:
        for first in range(0, size[0], BLOCK):
            start[:, first : first + BLOCK] = first + np.argmax(
                covered[:, first : first + BLOCK], axis=1, keepdims=True
            )
    at_start = start * unit + unit // 2
    edge_bc = edge(b, c, at_start, y).astype(float)
    edge_ca = edge(c, a, at_start, y).astype(float)
    depth = c[2] + (edge_bc * weight_a + edge_ca * weight_b)
    depth = depth + (np.arange(size[0]) - start).astype(float) * step
    found[covered] = np.clip(depth, lowest, highest)[covered]
    return found
