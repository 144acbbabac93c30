import math

import naive_lines as naive
import numpy as np
import pytest
from test_lines import HIGH, LOW, draw, random_colors, visible_reference

from rasterjit.classics.framebuffer import _bin_lines, _draw_band
from rasterjit.classics.line_bands import CHUNK_PIXELS
from rasterjit.pipeline.bresenham import MAX_SHARED_STEPS
from rasterjit.runtime import jit

JIT = not jit.DISABLED


def binned(size, ends, colors, rows):
    """Return the starts and the records of lines in bands of so many rows."""
    width, height = size
    band_of_row = (np.arange(height) // rows).astype(np.int32)
    packed = np.ascontiguousarray(colors, np.uint8).view(np.int32).reshape(-1, 2)
    return _bin_lines(
        np.array(ends, np.int64).reshape(-1, 4), packed, band_of_row, width, -(-height // rows)
    )


def draw_in_bands(size, ends, colors, rows):
    """Draw lines into bands of so many rows, the last band first."""
    width, height = size
    ends = np.array(ends, np.int64).reshape(-1, 4)
    starts, records = binned(
        size, ends, np.broadcast_to(np.array(colors, np.uint8), (len(ends), 2, 4)), rows
    )
    image = np.zeros((height, width, 4), np.uint8)
    target = image.view(np.uint32).reshape(height, width)
    for band in reversed(range(len(starts) - 1)):
        own = records[starts[band] : starts[band + 1]]
        _draw_band(target[band * rows : (band + 1) * rows], band * rows, [own])
    return image


@pytest.mark.parametrize("rows", [1, 5, 8, 40])
def test_lists_are_those_of_the_slow_twin_in_order(rows):
    rng = np.random.default_rng(1)
    ends = rng.integers(-20, 60, (300, 4))
    ends[::10] = np.clip(ends[::10] * 2**27, LOW, HIGH)
    colors = random_colors(rng, 300)
    starts, records = binned((31, 37), ends, colors, rows)
    expected = naive.lines_of_bands(ends.tolist(), (31, 37), rows)
    assert np.diff(starts).tolist() == [len(numbers) for numbers in expected]
    order = np.concatenate(expected).astype(int)
    np.testing.assert_array_equal(records[:, :4], ends[order])
    assert records[:, 4:].tobytes() == colors[order].tobytes()


def test_every_pair_on_a_grid_is_the_exact_line_in_bands_of_any_height():
    side = 17 if JIT else 4
    grid = np.array([(x, y) for y in range(side) for x in range(side)], np.int64)
    ramp = random_colors(np.random.default_rng(2), len(grid))
    shift = np.arange(len(grid))[:, None] * (0, side)
    for number, start in enumerate(grid):
        starts = np.broadcast_to(start, grid.shape)
        ends = np.hstack((starts + shift, grid + shift))
        image = draw_in_bands((side, side * len(grid)), ends, ramp, 1 + number % (2 * side))
        expected = naive.lines_on_panels(starts, grid, ramp, side)
        np.testing.assert_array_equal(image, expected, err_msg=str(start))


def test_line_cut_by_edges_and_bands_is_the_whole_line():
    rng = np.random.default_rng(3)
    size = (23, 17)
    for _ in range(1000 if JIT else 60):
        ends = tuple(rng.integers(-40, 60, 4).tolist())
        first, last = random_colors(rng, 1)[0].tolist()
        image = np.zeros((17, 23, 4), np.uint8)
        naive.draw_line(image, ends[:2], ends[2:], first, last)
        got = draw_in_bands(size, ends, (first, last), int(rng.integers(1, 20)))
        np.testing.assert_array_equal(got, image, err_msg=str(ends))


def test_huge_lines_through_bands_are_exact():
    rng = np.random.default_rng(4)
    size = (61, 47)
    hits = 0
    for _ in range(1000 if JIT else 30):
        reach = 2 ** int(rng.integers(7, 32))
        middle, span = rng.integers(0, 47, 2), rng.integers(-reach, reach, 2)
        far = np.clip(middle + span, LOW, HIGH), np.clip(middle - span, LOW, HIGH)
        ends = (*far[0].tolist(), *far[1].tolist())
        colors = random_colors(rng, 1)[0].tolist()
        image = draw_in_bands(size, ends, colors, int(rng.integers(1, 50)))
        np.testing.assert_array_equal(
            image, visible_reference(size, ends, colors), err_msg=str(ends)
        )
        hits += bool(image.any())
    assert hits > 20


@pytest.mark.parametrize(
    "steps", [CHUNK_PIXELS - 2, CHUNK_PIXELS - 1, CHUNK_PIXELS, 3 * CHUNK_PIXELS, MAX_SHARED_STEPS]
)
@pytest.mark.parametrize("upright", [False, True])
def test_lines_of_whole_chunks_and_one_more_pixel_are_exact(steps, upright):
    width = min(steps + 1, 16384 if JIT else 512)
    colors = ((0, 255, 3, 255), (255, 0, 251, 254))
    for rise in (0, 1, -5, 6):
        line = (0, 7, steps, 7 + rise) if not upright else (7, 0, 7 + rise, steps)
        size = (width, 15) if not upright else (15, width)
        np.testing.assert_array_equal(
            draw_in_bands(size, line, colors, 4 if not upright else 100),
            visible_reference(size, line, colors),
            err_msg=str(line),
        )


def test_channels_just_below_an_integer_are_not_rounded_up():
    # As in test_lines, for short lines: step k of a ramp by d is 1 / (2 n) below an integer
    rng = np.random.default_rng(5)
    tried = 0
    while tried < (15 if JIT else 4):
        n = 2 * int(rng.integers(2**12 if JIT else 2**7, 2**13 if JIT else 2**8)) - 1
        d = int(rng.integers(3, 256))
        if math.gcd(n, d) > 1:
            continue
        tried += 1
        k = -(n + 1) // 2 * pow(d, -1, n) % n
        for sign in (1, -1):
            values = (2 * sign * d * np.arange(n + 1) + n) // (2 * n)
            assert (2 * d * k + n) % (2 * n) == 2 * n - 1
            ramp = (0, d) if sign > 0 else (255, 255 - d)
            # The minor coordinate rises as the colour does
            line = (0, 0, n, d) if sign > 0 else (0, d, n, 0)
            image = draw_in_bands((n + 1, 256), line, [[c] * 4 for c in ramp], 37)
            expected = np.zeros((256, n + 1, 4), np.uint8)
            rows = values + line[1]
            expected[rows, np.arange(n + 1)] = (ramp[0] + values)[:, None]
            assert np.array_equal(image.view(np.uint32), expected.view(np.uint32)), line


def test_order_holds_between_short_and_long_lines():
    rng = np.random.default_rng(6)
    near, far = rng.integers(-10, 40, (2, 60, 4))
    far[:, :2] -= far[:, 2:] * 2**12
    ends = np.where(rng.random((60, 1)) < 0.5, near, far)
    steps = np.abs(ends[:, :2] - ends[:, 2:]).max(axis=1)
    assert 10 < (steps > MAX_SHARED_STEPS).sum() < 50
    colors = random_colors(rng, 60)
    for rows in (1, 7, 33):
        np.testing.assert_array_equal(
            draw_in_bands((37, 33), ends, colors, rows), draw((37, 33), ends, colors)
        )


def test_points_are_drawn_once_and_no_lines_draw_nothing():
    image = draw_in_bands((5, 5), [(2, 3, 2, 3)], ((1, 2, 3, 4), (9, 9, 9, 9)), 2)
    assert image[3, 2].tolist() == [1, 2, 3, 4]
    assert image.any(axis=2).sum() == 1
    assert not draw_in_bands((5, 5), np.empty((0, 4)), np.empty((0, 2, 4)), 2).any()
