import math

import naive_lines as naive
import numpy as np

from rasterjit.effects.wireframe import stage as wireframe_stage
from rasterjit.inspect import oracle
from rasterjit.pipeline import bresenham
from rasterjit.runtime import jit

JIT = not jit.DISABLED
WHITE = (255, 255, 255, 255)
LOW, HIGH = -(2**31), 2**31 - 1


def draw(size, ends, colors=(WHITE, WHITE)):
    """Draw lines given as (x0, y0, x1, y1) and return the (H, W, 4) picture."""
    ends = np.array(ends, np.int64).reshape(-1, 4)
    colors = np.broadcast_to(np.array(colors, np.uint8), (len(ends), 2, 4))
    image = np.zeros((size[1], size[0], 4), np.uint8)
    target = image.view(np.uint32).reshape(size[1], size[0])
    bresenham.draw_lines(target, ends, np.ascontiguousarray(colors))
    return image


def pixels(image):
    """Return the set of (x, y) that were drawn."""
    return {(int(x), int(y)) for y, x in np.argwhere(image.any(axis=2))}


def visible_reference(size, ends, colors):
    """Return the picture of a line of any length: exact fractions near the target only."""
    (x0, y0, x1, y1), image = ends, np.zeros((size[1], size[0], 4), np.uint8)
    major, limit = (0, size[0]) if abs(x1 - x0) >= abs(y1 - y0) else (1, size[1])
    start, end = ends[major], ends[2 + major]
    sign = 1 if end >= start else -1
    steps = [sign * (c - start) for c in range(limit)]
    inside = [k for k in steps if 0 <= k <= abs(end - start)]
    naive.draw_line(image, (x0, y0), (x1, y1), *colors, steps=inside)
    return image


def random_colors(rng, count):
    return rng.integers(0, 256, (count, 2, 4)).astype(np.uint8)


def test_every_pair_on_a_grid_is_the_exact_line_in_pixels_and_colors():
    side = 21 if JIT else 5
    grid = np.array([(x, y) for y in range(side) for x in range(side)], np.int64)
    colors = random_colors(np.random.default_rng(1), len(grid))
    batch = max(16384 // side, 1)
    drawn = 0
    for start in grid:
        for first in range(0, len(grid), batch):
            ends, ramp = grid[first : first + batch], colors[first : first + batch]
            starts = np.broadcast_to(start, ends.shape)
            shift = np.arange(len(ends))[:, None] * (0, side)
            image = draw((side, side * len(ends)), np.hstack((starts + shift, ends + shift)), ramp)
            expected = naive.lines_on_panels(starts, ends, ramp, side)
            assert np.array_equal(image.view(np.uint32), expected.view(np.uint32)), start
            drawn += len(ends)
    assert drawn == side**4


def test_the_reference_in_whole_numbers_is_the_oracle_s():
    rng = np.random.default_rng(9)
    for number in range(200):
        reach = 2 ** int(rng.integers(1, 32)) if number % 2 else 12
        start, end = np.clip(rng.integers(-reach, reach, (2, 2)), -reach, reach).tolist()
        colors = random_colors(rng, 1)[0].tolist()
        n = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
        # All steps of short lines, some of long ones; each in the middle of a picture.
        steps = range(n + 1) if n < 30 else np.sort(rng.integers(0, n + 1, 20)).tolist()
        pixels = oracle.line_pixels(start, end, steps=steps)
        listed = oracle.line_colors(start, end, *colors, steps=steps)
        for step, (x, y), color in zip(steps, pixels, listed, strict=True):
            image, expected = np.zeros((2, 3, 3, 4), np.uint8)
            expected[1, 1] = color
            moved = [(px - x + 1, py - y + 1) for px, py in (start, end)]
            naive.draw_line(image, *moved, *colors, steps=[step])
            np.testing.assert_array_equal(image, expected, err_msg=f"{start} {end} {step}")


def test_the_fast_reference_of_the_grid_is_the_slow_one():
    rng = np.random.default_rng(2)
    starts, ends = rng.integers(0, 9, (2, 60, 2))
    colors = random_colors(rng, 60)
    panels = naive.lines_on_panels(starts, ends, colors, 9).reshape(60, 9, 9, 4)
    for panel, start, end, (first, last) in zip(panels, starts, ends, colors.tolist(), strict=True):
        image = np.zeros((9, 9, 4), np.uint8)
        naive.draw_line(image, tuple(start.tolist()), tuple(end.tolist()), first, last)
        np.testing.assert_array_equal(panel, image)


def test_clipped_line_is_the_unclipped_line_inside():
    rng = np.random.default_rng(3)
    size = (23, 17)
    for _ in range(1500 if JIT else 150):
        ends = tuple(rng.integers(-40, 60, 4).tolist())
        first, last = random_colors(rng, 1)[0].tolist()
        image = np.zeros((17, 23, 4), np.uint8)
        naive.draw_line(image, ends[:2], ends[2:], first, last)
        np.testing.assert_array_equal(draw(size, ends, (first, last)), image, err_msg=str(ends))


def test_huge_lines_through_the_target_are_exact():
    rng = np.random.default_rng(4)
    size = (61, 47)
    hits = 0
    for _ in range(1500 if JIT else 60):
        reach = 2 ** int(rng.integers(7, 32))
        middle = rng.integers(0, 47, 2)
        span = rng.integers(-reach, reach, 2)
        far = np.clip(middle + span, LOW, HIGH), np.clip(middle - span, LOW, HIGH)
        ends = (*far[0].tolist(), *far[1].tolist())
        colors = random_colors(rng, 1)[0].tolist()
        image = draw(size, ends, colors)
        np.testing.assert_array_equal(
            image, visible_reference(size, ends, colors), err_msg=str(ends)
        )
        hits += bool(image.any())
    assert hits > 50


def test_widest_target_keeps_huge_lines_exact():
    size = (16384, 8) if JIT else (512, 8)
    ends = (LOW, 0, HIGH, 7)
    colors = ((0, 255, 3, 255), (255, 0, 251, 254))
    for line in (ends, (-3, -5, 16386, 12), (0, 7, size[0] - 1, 0), (LOW, LOW, HIGH, HIGH)):
        np.testing.assert_array_equal(
            draw(size, line, colors), visible_reference(size, line, colors), err_msg=str(line)
        )


def test_values_just_below_an_integer_at_the_end_of_the_longest_walk_are_not_rounded_up():
    # Of an n-step line that gains d, the running value at step k, with 2 k d + n = -1 modulo 2 n,
    # is 1 / (2 n) below an integer: the closest possible. Put that pixel last in the widest target
    rng = np.random.default_rng(8)
    width = 16384 if JIT else 512
    tried = 0
    while tried < 40:
        n = 2 * int(rng.integers(2**13, 2 ** int(rng.integers(15, 32)))) + 1
        d = int(rng.integers(3, 256))
        if math.gcd(n, d) > 1:
            continue
        k = -(n + 1) // 2 * pow(d, -1, n) % n
        start = width - 1 - k
        if k < width or start < LOW or start + n > HIGH:
            continue
        tried += 1
        for sign in (1, -1):
            step = np.arange(k - width + 1, k + 1)
            values = (2 * sign * d * step + n) // (2 * n)
            row = 2 - int(values[-1])
            ramp = (0, d) if sign > 0 else (255, 255 - d)
            ends = (start, row, start + n, row + sign * d)
            image = draw((width, 5), ends, ((ramp[0],) * 4, (ramp[1],) * 4))
            x = np.nonzero((values + row >= 0) & (values + row < 5))[0]
            expected = np.zeros((5, width, 4), np.uint8)
            expected[values[x] + row, x] = (ramp[0] + values[x])[:, None]
            np.testing.assert_array_equal(image, expected, err_msg=str(ends))
            assert image[2, -1, 0] == ramp[0] + values[-1]


def test_lines_of_one_color_have_the_pixels_of_those_of_two():
    rng = np.random.default_rng(5)
    ends = rng.integers(-20, 50, (60, 4))
    one = draw((31, 29), ends)
    two = draw((31, 29), ends, (WHITE, (255, 255, 255, 254)))
    assert pixels(one) == pixels(two)
    assert set(map(tuple, one.reshape(-1, 4).tolist())) == {(0, 0, 0, 0), WHITE}


def test_later_lines_draw_over_earlier_ones():
    colors = np.array([[[1] * 4] * 2, [[2] * 4] * 2], np.uint8)
    image = draw((5, 5), [[0, 2, 4, 2], [2, 0, 2, 4]], colors)
    assert image[2, 2].tolist() == [2] * 4
    assert image[2, 1].tolist() == [1] * 4


def test_no_lines_draw_nothing():
    assert not draw((4, 4), np.empty((0, 4))).any()


# Depth test

TESTED_COLOR = (9, 8, 7, 6)


def draw_tested(depth, ends, line_depths, slack=None):
    depth = np.asarray(depth, np.float32)
    height, width = depth.shape
    image = np.zeros((height, width, 4), np.uint8)
    wireframe_stage.draw_edges(
        image.view(np.uint32).reshape(height, width),
        depth,
        np.zeros((height, width), np.float32) if slack is None else slack,
        np.array([ends], np.int32),
        np.array(line_depths, np.float64).reshape(-1, 2),
        np.array(TESTED_COLOR, np.uint8),
    )
    return image


def test_line_before_everything_is_the_untested_line():
    ends = (-7, 3, 30, 12)
    image = draw_tested(np.zeros((16, 16)), ends, (0.5, 0.25))
    np.testing.assert_array_equal(image, draw((16, 16), ends, (TESTED_COLOR, TESTED_COLOR)))


def test_line_is_hidden_exactly_where_the_surface_is_nearer():
    rng = np.random.default_rng(6)
    for _ in range(200 if JIT else 20):
        depth = rng.uniform(0, 1, (16, 16)).astype(np.float32)
        slack = rng.uniform(0, 0.3, (16, 16)).astype(np.float32)
        ends = tuple(rng.integers(-20, 36, 4).tolist())
        d0, d1 = rng.uniform(0, 1, 2).tolist()
        n = max(abs(ends[2] - ends[0]), abs(ends[3] - ends[1]), 1)
        for given, allowed in ((None, np.zeros_like(slack)), (slack, slack)):
            expected = set()
            for k, (x, y) in enumerate(oracle.line_pixels(ends[:2], ends[2:])):
                line = d0 + (d1 - d0) / n * k
                if (
                    0 <= x < 16
                    and 0 <= y < 16
                    and line >= float(depth[y, x]) - float(allowed[y, x])
                ):
                    expected.add((x, y))
            assert pixels(draw_tested(depth, ends, (d0, d1), given)) == expected


def test_equal_depth_is_seen_and_nan_is_not():
    depth = np.full((4, 4), 0.5)
    assert len(pixels(draw_tested(depth, (0, 0, 3, 3), (0.5, 0.5)))) == 4
    assert not draw_tested(depth, (0, 0, 3, 3), (np.nan, np.nan)).any()


def test_a_line_without_depths_reads_neither_depth_nor_slack():
    rng = np.random.default_rng(7)
    for unread in (np.full((16, 16), np.nan, np.float32), np.full((16, 16), np.inf, np.float32)):
        for ends in rng.integers(-5, 20, (20, 4)).tolist():
            image = draw_tested(unread, ends, (), slack=unread)
            np.testing.assert_array_equal(image, draw((16, 16), ends, (TESTED_COLOR,) * 2))


def test_depth_is_only_read():
    depth = np.zeros((4, 4), np.float32)
    draw_tested(depth, (0, 0, 3, 3), (1.0, 1.0))
    assert not depth.any()
