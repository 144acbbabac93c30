"""What outlines wind around is filled, each point once, whatever crosses, touches or repeats."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.survey import cap_outlines, cross_sections


def filled(points, tails, heads):
    """Return the triangles that fill outlines, (T, 3, 2), and how often each counts."""
    cutter = cross_sections._Cutter.__new__(cross_sections._Cutter)
    cutter.planes = (rj.SectionPlane((0, 0, 0), (0, 0, 1)),)
    cutter.world = np.column_stack([points, np.zeros(len(points))])
    cutter.distances, cutter.position_ids = np.zeros((len(points), 1)), np.arange(len(points))
    cutter.steps = []
    found = cap_outlines.OutlineFiller(cutter, 0).fill(tails, heads, np.ones(len(tails), np.int64))
    return cutter.world[found[:, :3], :2], found[:, 3]


def winding(corners, others, points):
    """Return how often edges (E, 2) to (E, 2) go around points, (N,): by a ray to the right."""
    turns = np.zeros(len(points), int)
    x, y = points.T
    for (ax, ay), (bx, by) in zip(corners, others, strict=True):
        side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        turns += (ay <= y) & (by > y) & (side > 0.0)
        turns -= (by <= y) & (ay > y) & (side < 0.0)
    return turns


@pytest.mark.parametrize("on_grid", [False, True])
@pytest.mark.parametrize("seed", range(40))
def test_each_point_inside_lies_in_one_triangle(seed, on_grid):
    rng = np.random.default_rng(1000 * on_grid + seed)
    side = int(rng.integers(2, 12))
    points, tails, heads = [], [], []
    for _ in range(rng.integers(1, 5)):
        count, first = int(rng.integers(3, 14)), len(points)
        # On a grid outlines touch, repeat edges, pass through vertices and cross in one point.
        own = rng.integers(0, side + 1, (count, 2)) if on_grid else side * rng.random((count, 2))
        points += own.tolist()
        tails += range(first, first + count)
        heads += [*range(first + 1, first + count), first]
    points = np.array(points, float)
    triangles, counts = filled(points, np.array(tails), np.array(heads))
    corners, others = points[tails], points[heads]
    asked = side * rng.random((400, 2))
    away = np.ones(len(asked), bool)
    for a, b in zip(corners, others, strict=True):
        way = b - a
        along = np.clip((asked - a) @ way / max(way @ way, 1e-300), 0.0, 1.0)
        away &= np.hypot(*(asked - a - along[:, np.newaxis] * way).T) > 1e-5 * side
    asked = asked[away]
    wanted = winding(corners, others, asked)
    within, turned = np.zeros(len(asked), int), np.zeros(len(asked), int)
    for (a, b, c), count in zip(triangles, counts, strict=True):
        sides = np.array(
            [
                (q[0] - p[0]) * (asked[:, 1] - p[1]) - (q[1] - p[1]) * (asked[:, 0] - p[0])
                for p, q in ((a, b), (b, c), (c, a))
            ]
        )
        is_left, is_right = (sides > 0.0).all(axis=0), (sides < 0.0).all(axis=0)
        within += is_left | is_right
        turned += count * (is_left.astype(int) - is_right)
    np.testing.assert_array_equal(within, wanted != 0)
    np.testing.assert_array_equal(turned, wanted)


def test_outlines_that_do_not_close_are_not_filled():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    cutter = cross_sections._Cutter.__new__(cross_sections._Cutter)
    cutter.planes = (rj.SectionPlane((0, 0, 0), (0, 0, 1)),)
    cutter.world = np.column_stack([points, np.zeros(4)])
    cutter.distances, cutter.position_ids, cutter.steps = np.zeros((4, 1)), np.arange(4), []
    outlines = cap_outlines.OutlineFiller(cutter, 0)
    ends = np.array([0, 1, 2]), np.array([1, 2, 3])
    assert outlines.fill(*ends, np.ones(3, np.int64)) is None
