"""Lines of any width with round ends: against samples, and by their laws."""

from __future__ import annotations

import naive_lines
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.wireframe import strokes
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.scene.color import decoding_table

SIZE = (48, 40)
UNIT = 256

LARGEST_ERROR = 0.07
"""Largest error of a pixel that is not at an end."""


def cover(lines, width, rows=None, depths=None, depth=None, slack=None, part=strokes.VISIBLE):
    """Return how much of each pixel lines cover, (N, 4) in pixels."""
    ends = np.rint(np.array(lines) * UNIT).astype(np.int32).reshape(-1, 4)
    first, last = rows or (0, SIZE[1])
    found = np.full((last - first, SIZE[0]), 7.0, np.float32)
    depths = np.empty((0, 2)) if depths is None else np.array(depths, float)
    depth = np.full((1, SIZE[0]), -np.inf, np.float32) if depth is None else depth
    slack = np.zeros(depth.shape, np.float32) if slack is None else slack
    strokes.stroke_lines(
        np.arange(len(ends), dtype=np.int32), ends, depths, (first, last),
        make_viewport(SIZE, 8), depth, slack, width / 2, part,
        strokes.make_scratch(len(found), SIZE[0]), found,
    )  # fmt: skip
    return found


def chain(random, count):
    """Return the pieces of a line that bends a little from one to the next, pixels."""
    angles = random.uniform(0, 2 * np.pi) + np.cumsum(random.uniform(-0.3, 0.3, count))
    steps = 5.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.cumsum(np.concatenate([[(0.0, 0.0)], steps]), axis=0)
    points += np.array(SIZE) / 2 - points.mean(axis=0)
    return np.rint(np.concatenate([points[:-1], points[1:]], axis=1) * UNIT) / UNIT


@pytest.mark.parametrize("width", [0.4, 1.0, 2.5, 9.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_chains_have_the_coverage_that_samples_find(seed, width):
    lines = chain(np.random.default_rng(seed), 5)
    want = naive_lines.stroke_shares(lines, width / 2, SIZE)
    found = cover(lines, width)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    away = np.ones(want.shape, bool)
    for x, y in (lines[0, :2], lines[-1, 2:]):
        away &= np.hypot(columns - x, rows - y) > 1.0 + width / 2
    assert np.abs(found - want)[away].max() < LARGEST_ERROR
    # An end of a thin line may reach half a pixel farther.
    assert abs(found.sum() - want.sum()) < 0.01 * want.sum() + width


def test_pieces_of_a_line_look_like_the_line():
    points = np.linspace((5.0, 6.0), (37.0, 22.0), 17)
    whole = cover([(*points[0], *points[-1])], 1.5)
    pieces = cover(np.concatenate([points[:-1], points[1:]], axis=1), 1.5)
    assert np.abs(whole - pieces).max() < 1e-5


def test_parts_of_the_rows_have_the_bits_of_the_whole():
    lines = chain(np.random.default_rng(4), 6)
    whole = cover(lines, 3.0)
    parts = [cover(lines, 3.0, rows) for rows in ((0, 7), (7, 23), (23, SIZE[1]))]
    assert np.concatenate(parts).tobytes() == whole.tobytes()


def test_what_lies_behind_is_hidden():
    line, depth = [(4.0, 20.3, 44.0, 20.3)], np.full(SIZE[::-1], -np.inf, np.float32)
    depth[:, 10:20] = 0.5
    depth[:, 30:40] = 0.1
    free = cover(line, 2.0)
    # Nearer than the line at the left, farther at the right; the line goes away to the right.
    found = cover(line, 2.0, depths=[(0.4, 0.2)], depth=depth)
    assert (found[:, 10:20] == 0.0).all()
    is_clear = np.ones(SIZE[0], bool)
    is_clear[10:20] = False
    assert (found[:, is_clear] == free[:, is_clear]).all()
    hidden = cover(line, 2.0, depths=[(0.4, 0.2)], depth=depth, part=strokes.HIDDEN)
    assert (found + hidden == free).all()
    slack = np.full(depth.shape, 0.2, np.float32)
    assert (cover(line, 2.0, depths=[(0.4, 0.2)], depth=depth, slack=slack) == free).all()


def test_a_wide_wireframe_is_smooth_in_any_quality(cube, camera):
    scene = rj.Scene()
    scene.add(rj.Mesh(cube.vertices, cube.faces, material=rj.Material("unlit", "white")))
    scene.wireframe = rj.Wireframe("red", "only", width=2.5)
    frame = rj.render(scene, camera, size=SIZE, background="white")
    assert "mode only, 2.5 wide, by coverage" in str(frame.plan)
    found = 1.0 - decoding_table()[frame.color[..., 1]]
    matrix = camera.projection_matrix(SIZE) @ camera.view_matrix()
    clip = np.column_stack([cube.vertices, np.ones(8)]) @ matrix.T
    pixels = (clip[:, :2] / clip[:, 3:] * (1, -1) + 1) * 0.5 * SIZE
    edges = {tuple(sorted((f[k], f[k - 1]))) for f in cube.faces.tolist() for k in range(3)}
    first, second = np.array(sorted(edges)).T
    want = naive_lines.stroke_shares(
        np.concatenate([pixels[first], pixels[second]], axis=1), 1.25, SIZE
    )
    # Where lines cross, a pixel is covered by the nearest alone.
    assert np.abs(found - want).mean() < 0.01
    assert found.sum() == pytest.approx(want.sum(), rel=0.02)


@pytest.mark.parametrize("width", [0.0, 65, np.nan, "thin"])
def test_widths_out_of_range_are_named(width):
    with pytest.raises(ValueError, match="width must be"):
        rj.Wireframe(width=width)
