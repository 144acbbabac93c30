"""The slow, obvious twin of the visibility kernel: one triangle, one sample at a time."""

from __future__ import annotations

import numpy as np

from rasterjit.inspect import oracle

BLOCK = 64
"""Depth along a row of a wide triangle starts anew every so many columns."""

SMALL = 8
"""Samples that lie in the width of the widest triangle whose depth does not step along rows."""


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
    covered = oracle.covered_pixels(points, size, subpixel_bits=bits)
    starts: dict[tuple[int, int], int] = {}
    for column, row in sorted(covered):
        starts.setdefault((row, column // BLOCK), column)
    for column, row in covered:
        start = starts[row, column // BLOCK] if width > SMALL else column
        place = start * unit + unit // 2, row * unit + unit // 2
        edge_bc = float(oracle.edge(b[:2], c[:2], place))
        edge_ca = float(oracle.edge(c[:2], a[:2], place))
        depth = c[2] + (edge_bc * weight_a + edge_ca * weight_b)
        depth = depth + float(column - start) * step
        found[row, column] = np.float32(min(max(depth, lowest), highest))
    return found
