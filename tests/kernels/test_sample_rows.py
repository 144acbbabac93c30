"""Rows of samples as machine code tests them, against what the intrinsics do in Python."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import numpy as np
import pytest

from rasterjit.runtime.intrinsics import (
    blend_clipped_run,
    blend_run,
    copy_pair,
    draw_box,
    encode_lanes,
    fill_rows,
    find_min_in_rows,
    find_range_end,
    store_bounds,
)
from rasterjit.runtime.jit import CHECKED, helper

pytestmark = pytest.mark.needs_jit

DEPTHS = [np.float32, np.float64, np.int32]
STRIDE, ROWS = 24, 12


@helper
def compiled_draw_box(
    depths, numbers, first, stride, rows, columns, edges, plane, face, is_mixed
):  # fmt: skip
    draw_box(depths, numbers, first, stride, rows, columns, edges, plane, face, is_mixed)


@helper
def compiled_fill_rows(
    depths, numbers, spans, first, stride, rows, before, longest, plane, face, is_mixed
):  # fmt: skip
    fill_rows(
        depths, numbers, spans, first, stride, rows, before, longest, plane, face, is_mixed
    )  # fmt: skip


@helper
def compiled_least_in_rows(values, first, stride, rows, left, right):
    return find_min_in_rows(values, first, stride, rows, left, right)


@helper
def compiled_blend_run(red, green, blue, edges, steps, ratios, corners, base):
    blend_run(red, green, blue, edges, steps, ratios, corners, base)


@helper
def compiled_blend_clipped_run(
    red, green, blue, memory, odd, width, xs, ws, down, corners, base
):  # fmt: skip
    return blend_clipped_run(red, green, blue, memory, odd, width, xs, ws, down, corners, base)


@helper
def compiled_copy_pair(pairs, number, row, n):
    copy_pair(pairs, number, row, n)


@helper
def compiled_bounds(xy, a, b, c, least, most, n):
    store_bounds(xy, a, b, c, least, most, n)


@helper
def compiled_range_end(numbers, start, first, end):
    return find_range_end(numbers, start, first, end)


@helper
def compiled_encode_lanes(red, green, blue, table, first, others, color):
    encode_lanes(red, green, blue, table, first, others, color)


def both(compiled, intrinsic, tile, *arguments):
    """Return the tile, (depths, numbers), as machine code and as Python change it."""
    tiles = [tuple(array.copy() for array in tile) for _ in range(2)]
    compiled(*tiles[0], *arguments)
    intrinsic.function(*tiles[1], *arguments)
    return tiles


def tile_of(random, kind, tied=()):
    """Return depths of a kind, some of them empty or tied with some, and face numbers 0 to 7."""
    depths = random.uniform(0, 1000, STRIDE * ROWS)
    depths[random.random(depths.shape) < 0.3] = -1.0
    for depth in tied:
        depths[random.random(depths.shape) < 0.4] = depth
    return depths.astype(kind), random.integers(0, 8, STRIDE * ROWS).astype(np.int32)


def ties_won(tile, drawn):
    """Return how many samples changed the face alone."""
    is_tied = tile[0] == drawn[0]
    return np.count_nonzero(is_tied & (tile[1] > drawn[1]))


def assert_same(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.view(np.uint8), b.view(np.uint8))


@pytest.mark.parametrize("is_mixed", [False, True])
@pytest.mark.parametrize("kind", DEPTHS)
@pytest.mark.parametrize("edge", [np.int32, np.float32])
def test_boxes(kind, edge, is_mixed):
    random = np.random.default_rng(3)
    drawn, won = 0, 0
    for columns in [*range(9), 3, 5]:
        for rows in (0, 1, 2, 7):
            edges = tuple(map(edge, random.integers(-40, 60, 9)))
            plane = (*random.integers(-50, 50, 6).astype(float), 500.0, 2.0, 1.5, 420.0, 900.0)
            tile = tile_of(random, kind, (420.0, 900.0))
            one, other = both(
                compiled_draw_box, draw_box, tile, np.int64(26), np.int64(STRIDE), np.int64(rows),
                np.int32(columns), edges, plane, np.int32(3), is_mixed,
            )  # fmt: skip
            assert_same(one, other)
            drawn += np.count_nonzero(one[0] != tile[0])
            won += ties_won(tile, one)
    assert drawn > 20
    assert (won > 0) == is_mixed


@pytest.mark.parametrize("columns", [3, 5, 8])
def test_lanes_behind_the_box_may_overflow(columns):
    # At the column behind the box the edge passes 2**31 and comes back as if it were inside.
    step = 2**31 // columns
    edges = tuple(map(np.int32, (-1, 0, 0, -step + 1, 0, 0, 0, 0, 0)))
    tile = np.full(STRIDE * ROWS, -1, np.float32), np.full(STRIDE * ROWS, 7, np.int32)
    plane = (0.0,) * 6 + (5.0, 0.0, 0.0, 5.0, 5.0)
    one, other = both(
        compiled_draw_box, draw_box, tile, np.int64(0), np.int64(STRIDE), np.int64(2),
        np.int32(columns), edges, plane, np.int32(3), True,
    )  # fmt: skip
    assert_same(one, other)
    assert (one[1] == 7).all()


@pytest.mark.parametrize("is_mixed", [False, True])
@pytest.mark.parametrize("kind", DEPTHS)
@pytest.mark.parametrize("longest", [1, 2, 4, 5, 8, 9, 16])
def test_spans(kind, longest, is_mixed):
    random = np.random.default_rng(longest)
    rows, room, won = 9, 16, 0
    begins = random.integers(0, 8, room).astype(np.int32)
    # Some rows are empty, some end before they begin
    ends = (begins + random.integers(-3, longest + 1, room)).astype(np.int32)
    starts = random.uniform(300, 900, room)
    starts[::2] = 300.0
    for before in (0, 3, 8):
        tile = tile_of(random, kind, (800.0, 400.0, 400.0))
        one, other = both(
            compiled_fill_rows, fill_rows, tile, (begins, ends, starts),
            np.int64(24), np.int64(STRIDE), np.int64(rows), np.int32(before), np.int64(longest),
            (7.25, 400.0, 800.0), np.int32(3), is_mixed,
        )  # fmt: skip
        assert_same(one, other)
        won += ties_won(tile, one)
    assert (one[0] == tile[0]).any()
    assert (won > 0) == is_mixed


@pytest.mark.parametrize("kind", DEPTHS)
def test_least_in_rows(kind):
    random = np.random.default_rng(4)
    values = random.permutation(STRIDE * ROWS).astype(kind) - kind(60)
    for left in range(8):
        for right in range(left - 1, 8):
            for rows in (0, 1, 3, 8):
                asked = (*map(np.int64, (29, STRIDE, rows)), np.int32(left), np.int32(right))
                expected = [values[29 + STRIDE * k :][left : right + 1] for k in range(rows)]
                expected = np.concatenate([*expected, np.empty(0, kind)])
                greatest = np.iinfo(kind).max if kind == np.int32 else np.inf
                least = compiled_least_in_rows(values, *asked)
                assert least == (expected.min() if len(expected) else greatest)
                assert find_min_in_rows.function(values, *asked) == least


def test_vertices_in_pairs():
    random, ends = np.random.default_rng(6), np.iinfo(np.int32)
    # As screen vertices lie: x, y and a depth side by side.
    packed = random.standard_normal((20, 2))
    xy = packed.view(np.int32)[:, :2]
    xy[:] = random.integers(ends.min, ends.max, (20, 2), endpoint=True)
    xy[3:6] = (ends.min, ends.max), (ends.max, ends.min), (0, -1)
    for vertices in [(3, 4, 5), (4, 5, 3), (7, 7, 7), *random.integers(0, 20, (40, 3))]:
        n, rows = np.uintp(random.integers(4)), np.zeros((2, 3, 8), np.int32)
        three = tuple(map(np.uintp, vertices))
        for found, enclosed, copied in zip(
            rows, (compiled_bounds, store_bounds.function),
            (compiled_copy_pair, copy_pair.function), strict=True,
        ):  # fmt: skip
            enclosed(xy, *three, found[0], found[1], n)
            copied(xy, three[0], found[2], n)
        assert (rows[0] == rows[1]).all()
        corners, here = xy[list(vertices)], slice(2 * int(n), 2 * int(n) + 2)
        assert (rows[0, 0, here] == corners.min(axis=0)).all()
        assert (rows[0, 1, here] == corners.max(axis=0)).all()
        assert (rows[0, 2, here] == corners[0]).all()
        others = np.ones(8, bool)
        others[here] = False
        assert not rows[:, :, others].any()


@pytest.mark.parametrize("size", [1, 15, 16, 17, 64, 90])
def test_ends_of_ranges(size):
    random = np.random.default_rng(size)
    greatest = np.iinfo(np.int32).max
    for first, end in ((0, 5), (-1, 0), (7, 8), (-greatest - 1, 3), (5, greatest)):
        for share in (0.0, 0.02, 0.5):
            numbers = random.integers(first, end, size, dtype=np.int32)
            outside = random.random(size) < share
            others = np.array([v for v in (-1, first - 1, end) if -greatest <= v <= greatest])
            others = others[(others < first) | (others >= end)]
            numbers[outside] = random.choice(others, outside.sum())
            for start in sorted({0, min(3, size), size // 2, size - 1, size}):
                asked = np.int64(start), np.int32(first), np.int32(end)
                found = compiled_range_end(numbers, *asked)
                assert found == find_range_end.function(numbers, *asked)
                inside = (numbers[start:] >= first) & (numbers[start:] < end)
                assert found == start + (np.argmin(inside) if not inside.all() else size - start)


@pytest.mark.parametrize("count", [8, 16, 40])
def test_colours_of_runs(count):
    random = np.random.default_rng(count)
    for _ in range(50):
        starts, ends = (random.integers(0, 2**38, 3) for _ in range(2))
        steps = (ends - starts) // count
        corners = random.uniform(0, 1, (3, 3)) ** random.integers(1, 20)
        corners[random.random((3, 3)) < 0.3] = 0.0
        given = (
            tuple(map(np.float64, starts)), tuple(map(np.float64, steps)),
            tuple(map(np.float32, 2.0 ** random.uniform(-20, 20, 2))),
            tuple(tuple(map(np.float32, corner)) for corner in corners),
            tuple(map(np.float32, random.uniform(0, 1, 3))),
        )  # fmt: skip
        one, other = np.full((2, 3, count), np.nan, np.float32)
        compiled_blend_run(*one, *given)
        blend_run.function(*other, *given)
        assert_same(one, other)
        assert np.isfinite(one).all()


@pytest.mark.parametrize("count", [8, 16, 40])
def test_colours_of_clipped_runs(count):
    random = np.random.default_rng(count)
    unsure = 0
    for _ in range(100):
        corners = random.uniform(0, 1, (3, 3)) ** random.integers(1, 20)
        corners[random.random((3, 3)) < 0.3] = 0.0
        xs, ws, down = random.normal(size=(3, 3)) * 2.0 ** random.integers(-30, 30)
        given = (
            np.float64(2 * random.integers(0, 900) + 1), np.float64(random.integers(1000, 2000)),
            tuple(xs), tuple(ws), tuple(down),
            tuple(tuple(map(np.float32, corner)) for corner in corners),
            tuple(map(np.float32, random.uniform(0, 1, 3))),
        )  # fmt: skip
        one, other = np.full((2, 3, count), np.nan, np.float32)
        memories = np.full((2, 4, count), np.nan)
        found = compiled_blend_clipped_run(*one, tuple(memories[0]), *given)
        with np.errstate(invalid="ignore"):
            assert found == blend_clipped_run.function(*other, tuple(memories[1]), *given)
        unsure += found
        if not found:
            assert_same(one, other)
            assert_same(*memories)
    assert 20 < unsure < 80


@pytest.mark.parametrize(("down", "is_found"), [
    ((0.0, 0.0, 1.0), False), ((1.0, 0.0, 0.0), True), ((0.0, 1.0, 0.0), True),
    ((0.0, 0.0, np.nan), True), ((0.0, 0.0, np.inf), True), ((0.0, 0.0, -np.inf), True),
])  # fmt: skip
def test_sums_that_are_not_positive_are_found(down, is_found):
    # All sums are the last number minus the first.
    color = (np.float32(0.5),) * 3
    rows, memory = np.zeros((3, 16), np.float32), np.zeros((4, 16))
    given = (
        np.float64(1.0), np.float64(16.0), (0.0, 1.0, 0.0), (1.0, 1.0, 1.0), down, (color,) * 3,
        color,
    )  # fmt: skip
    assert compiled_blend_clipped_run(*rows, tuple(memory), *given) == is_found
    with np.errstate(all="ignore"):
        assert blend_clipped_run.function(*rows, tuple(memory), *given) == is_found


def test_codes():
    random = np.random.default_rng(5)
    table = random.integers(0, 2**24, 2**16, np.int32)
    for first in (0, 3, 12):
        light = random.integers(0, 2**32, (3, 20), np.uint32).view(np.float32)
        asked = (*light, table, np.int64(first), np.uint32(random.integers(0, 256) << 24))
        one, other = np.full((2, 20), 7, np.uint32)
        compiled_encode_lanes(*asked, one)
        encode_lanes.function(*asked, other)
        assert_same((one,), (other,))
        assert np.count_nonzero(one != 7) == 8


def test_checked_indices_find_boxes_beyond_the_tile():
    if not CHECKED:
        pytest.skip("indices are checked with NUMBA_BOUNDSCHECK=1 alone")
    tile = np.zeros(STRIDE, np.float32), np.zeros(STRIDE, np.int32)
    with pytest.raises(IndexError, match="ends beyond its memory"):
        compiled_draw_box(
            *tile, np.int64(0), np.int64(STRIDE), np.int64(2), np.int32(3),
            (np.int32(0),) * 9, (0.0,) * 11, np.int32(3), False,
        )  # fmt: skip
    with pytest.raises(IndexError, match="ends beyond its memory"):
        compiled_least_in_rows(tile[0], *map(np.int64, (0, STRIDE, 2)), np.int32(0), np.int32(7))
    with pytest.raises(IndexError, match="ends beyond its memory"):
        compiled_encode_lanes(
            *np.zeros((3, 20), np.float32), np.zeros(2**16, np.int32), np.int64(13),
            np.uint32(0), np.zeros(20, np.uint32),
        )  # fmt: skip


COUNT_MASKED_STORES = """
import re, sys
from rasterjit.pipeline.visibility.tile_rasterizer import draw_batch
from rasterjit.runtime import compiler, store

for kind in draw_batch.declared[: int(sys.argv[1])]:
    assembly = compiler.emit_assembly_text(draw_batch, kind, store.host())
    stores = re.findall("\\tv(?:p?maskmov[^\\n]*\\\\)|p?blendv[^\\n]*)$", assembly, re.MULTILINE)
    print(sum("maskmov" in line for line in stores), sum("blendv" in line for line in stores))
"""


@pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="masked stores of x86"
)
@pytest.mark.parametrize("forms", [1, pytest.param(3, marks=pytest.mark.takes_long)])
def test_rows_are_blended_where_masked_stores_are_slow(forms):
    asked = {"NUMBA_CPU_NAME": "znver3", "NUMBA_CPU_FEATURES": "", "NUMBA_BOUNDSCHECK": "0"}
    done = subprocess.run(
        [sys.executable, "-c", COUNT_MASKED_STORES, str(forms)],
        capture_output=True, text=True, check=True, env=os.environ | asked,
    )  # fmt: skip
    counts = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    assert len(counts) == forms
    assert all(masked == 0 < blended for masked, blended in counts), counts
