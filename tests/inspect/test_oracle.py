"""The exact reference, checked by other means than its own."""

from __future__ import annotations

import math
import random
import subprocess
import sys
from decimal import Decimal
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.visibility.visibility_pass import make_viewport

F = Fraction
R09 = [(2.3, 1.7), (9.1, 3.2), (4.4, 10.6)]
I01 = [(0, 0), (16, 0), (0, 16)]
M07 = [(1.25, 1.5), (6.75, 2.25), (3.5, 6.75)]
C05 = [(1.5, -1.5, 0, 1), (0, 1.5, -1.5, 1), (-1.5, 0, 1.5, 1)]  # depth -1..1
BOX = (-3, 11)


def strictly_inside(triangle, point):
    """Tell whether a point is inside, off every edge, by the sides it lies on."""
    sides = []
    for n in range(3):
        (ax, ay), (bx, by) = triangle[n], triangle[(n + 1) % 3]
        cross = (point[0] - ax) * (by - ay) - (point[1] - ay) * (bx - ax)
        assert cross != 0 or (ax, ay) == (bx, by), "the move was meant to leave every edge"
        sides.append(cross > 0)
    return all(sides) or not any(sides)


def random_fan(count, seed, grid=2):
    """Yield triangles with corners on multiples of 1 / grid, so samples often hit edges."""
    rng = random.Random(seed)
    for _ in range(count):
        yield [
            tuple(F(rng.randint(BOX[0] * grid, BOX[1] * grid), grid) for _ in "xy") for _ in "abc"
        ]


# --- the grid -------------------------------------------------------------------------------------


def test_snapping_rounds_half_to_even():
    steps = [F(1, 2), F(3, 2), F(5, 2), F(-1, 2), F(-3, 2), F(349, 100), F(351, 100)]
    assert [oracle.snap(step / 256) for step in steps] == [0, 2, 2, 0, -2, 3, 4]
    assert [oracle.snap(step, 0) for step in steps] == [0, 2, 2, 0, -2, 3, 4]


def test_snapping_takes_floats_at_their_exact_value():
    # 0.5 / 256 and its neighbours: the tie goes to even, one rounding beyond it goes up.
    tie = 0.5 / 256
    assert [oracle.snap(x) for x in (tie, math.nextafter(tie, 1), -0.0)] == [0, 1, 0]
    assert oracle.snap_triangle(R09) == ((589, 435), (2330, 819), (1126, 2714))


def test_numpy_scalars_count_as_their_value_and_do_not_overflow():
    big = np.int32(2**30)
    assert oracle.edge((np.int32(0), 0), (big, 0), (0, big)) == 2**60
    assert oracle.snap(np.float32(0.1)) == round(F(float(np.float32(0.1))) * 256)
    assert oracle.covered_pixels(np.array(R09), (16, 16)) == oracle.covered_pixels(R09, (16, 16))


# --- coverage -------------------------------------------------------------------------------------


def test_edge_function_is_positive_clockwise_on_the_screen():
    assert oracle.edge((0, 0), (4, 0), (0, 2)) == 8
    assert oracle.edge((0, 0), (0, 2), (4, 0)) == -8
    assert oracle.edge((0, 0), (4, 2), (2, 1)) == 0


def test_top_left_rule_is_a_sample_moved_right_a_little_and_down_less():
    right, down = F(1, 10**7), F(1, 10**15)
    on_an_edge = 0
    for triangle in random_fan(100, 1):
        for row in range(8):
            for column in range(8):
                x, y = column + F(1, 2), row + F(1, 2)
                moved = strictly_inside(triangle, (x + right, y + down))
                degenerate = oracle.edge(*triangle) == 0
                assert oracle.covers(triangle, (x, y)) == (moved and not degenerate)
                on_an_edge += 0 in oracle_edges(triangle, (x, y))
    assert on_an_edge > 125


def oracle_edges(triangle, point):
    return [oracle.edge(triangle[n], triangle[(n + 1) % 3], point) for n in range(3)]


def test_covered_pixels_are_those_whose_sample_is_covered():
    samples = [(F(1, 2), F(1, 2)), (F(5, 16), F(15, 16)), (0, 0), (F(1, 3), F(2, 3))]
    for n, triangle in enumerate(random_fan(60, 2, grid=7)):
        bits, sample = (0, 4, 8, 12)[n % 4], samples[n // 4 % 4]
        snapped, scale = oracle.snap_triangle(triangle, bits), 2**bits
        want = {
            (i, j)
            for i in range(8)
            for j in range(6)
            if oracle.covers(snapped, ((i + sample[0]) * scale, (j + sample[1]) * scale))
        }
        assert oracle.covered_pixels(triangle, (8, 6), subpixel_bits=bits, sample=sample) == want


def test_pixels_of_a_triangle_by_hand():
    rows = {2: (2, 5), 3: (3, 8), 4: (3, 7), 5: (3, 7), 6: (3, 6), 7: (4, 5), 8: (4, 5), 9: (4, 4)}
    want = {(x, y) for y, (first, last) in rows.items() for x in range(first, last + 1)}
    assert len(want) == 29
    for turned in (R09, R09[1:] + R09[:1], R09[::-1]):
        assert oracle.covered_pixels(turned, (16, 16)) == want


def test_window_replaces_the_image():
    whole = oracle.covered_pixels(R09, (16, 16))
    part = oracle.covered_pixels(R09, (16, 16), window=(4, 3, 7, 6))
    assert part == {(x, y) for x, y in whole if 4 <= x < 7 and 3 <= y < 6}


def test_triangle_without_area_covers_nothing():
    line = [(0, 0), (8, 8), (4, 4)]
    assert not oracle.covers(line, (2, 2))
    assert oracle.covered_pixels(line, (8, 8)) == set()
    sliver = [(0.5, 0.5), (7.5, 0.5), (4, 0.501)]  # flat once it is snapped
    assert oracle.covered_pixels(sliver, (8, 8)) == set()


# --- interpolation --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("point", "weights"),
    [
        ((0.5, 0.5), (F(40, 41), F(1, 123), F(2, 123))),
        ((4.5, 4.5), (F(56, 83), F(9, 83), F(18, 83))),
        ((8.5, 2.5), (F(40, 67), F(17, 67), F(10, 67))),
        ((2.5, 8.5), (F(40, 79), F(5, 79), F(34, 79))),
        ((14.5, 0.5), (F(8, 39), F(29, 39), F(2, 39))),
        ((0.5, 14.5), (F(8, 67), F(1, 67), F(58, 67))),
        ((7.5, 7.5), (F(8, 53), F(15, 53), F(30, 53))),
    ],
)
def test_perspective_weights_by_hand(point, weights):
    ws = (1, 4, 2)
    assert oracle.perspective_weights(I01, ws, point) == weights
    # The same face in clip space, on a 16 x 16 image, gives the same weights.
    clip = [((x / 8 - 1) * w, (1 - y / 8) * w, 0, w) for (x, y), w in zip(I01, ws, strict=True)]
    assert oracle.clip_weights(clip, point, (16, 16)) == weights


def test_weights_sum_to_one_and_give_back_the_point():
    rng = random.Random(3)
    for triangle in random_fan(200, 4):
        if oracle.edge(*triangle) == 0:
            continue
        point = F(rng.randint(-9, 9), 7), F(rng.randint(-9, 9), 5)
        weights = oracle.affine_weights(triangle, point)
        assert sum(weights) == 1
        assert oracle.interpolate(weights, triangle) == point
        inside = [sum(F(corner[axis]) for corner in triangle) / 3 for axis in (0, 1)]
        assert sum(oracle.perspective_weights(triangle, (1, F(1, 3), 7), inside)) == 1


def test_weights_in_clip_space_meet_the_ray_behind_the_eye_too():
    face = [(-0.5, 0, 0, 1), (0.5, 0, 0.25, 1), (0, -1, -1, -1)]
    weights = oracle.clip_weights(face, (40.5, 33.5), (64, 64))
    x, y, _, w = oracle.interpolate(weights, face)
    assert sum(weights) == 1
    assert (x / w, y / w) == (F(81, 64) - 1, 1 - F(67, 64))


def test_depth_is_linear_on_the_screen():
    assert oracle.depth_at(I01, (0, 1, F(1, 2)), (4, 8)) == F(1, 2)
    assert oracle.depth_at(I01, (0.25, 0.25, 0.25), (100, -3)) == F(1, 4)


# --- visibility -----------------------------------------------------------------------------------


def test_smaller_depth_wins_then_the_lower_face():
    near, far = (F(1, 4),) * 3, (F(3, 4),) * 3
    shown = oracle.visible_faces([I01, I01, I01], [far, near, near], (16, 16))
    assert set(shown) == oracle.covered_pixels(I01, (16, 16))
    assert set(shown.values()) == {(1, F(1, 4))}


def test_planes_that_cross_show_the_nearer_on_each_side():
    square = [[(0, 0), (8, 0), (0, 8)], [(8, 8), (0, 8), (8, 0)]]
    rising = [(0, 1, 0), (1, 0, 1)]  # depth x / 8
    shown = oracle.visible_faces(square + square, rising + [(F(1, 2),) * 3] * 2, (8, 8))
    for (column, _), (face, depth) in shown.items():
        assert depth == min(F(2 * column + 1, 16), F(1, 2))
        assert (face < 2) == (column < 4)
    assert len(shown) == 64


def test_screen_position_by_hand():
    assert oracle.screen_position((1, 2, 3, 4), (64, 64)) == (40, 16)
    assert oracle.screen_position((0.0, 0.0, 0.0, 0.5), (5, 3)) == (F(5, 2), F(3, 2))


def test_faces_between_near_and_far_are_their_snapped_triangles():
    rng = random.Random(5)
    clip, size = [], (16, 12)
    for _ in range(18):
        w = F(rng.randint(1, 9), 3)
        clip.append(
            [F(rng.randint(-150, 150), 100) * w for _ in "xy"] + [rng.random() * float(w), w]
        )
    faces = [(3 * n, 3 * n + 1, 3 * n + 2) for n in range(6)]
    screen = [[oracle.screen_position(clip[n], size) for n in face] for face in faces]
    depths = [[F(clip[n][2]) / clip[n][3] for n in face] for face in faces]
    for bits in (0, 8):
        want = oracle.visible_faces(screen, depths, size, subpixel_bits=bits)
        assert oracle.render_faces(clip, faces, size, subpixel_bits=bits) == want


def test_face_with_a_vertex_behind_the_eye_is_cut_first():
    # A trapezoid is left, not the triangle that dividing by a negative w gives.
    face = [(-0.5, 0, 0, 1), (0.5, 0, 0, 1), (0, -1, 0, -1)]
    shown = oracle.render_faces(face, [(0, 1, 2)], (64, 64))
    columns = {row: [i for i, j in shown if j == row] for row in (31, 32, 63)}
    assert len(shown) == 1536
    assert columns[31] == []
    assert (min(columns[32]), max(columns[32])) == (16, 47)
    assert (min(columns[63]), max(columns[63])) == (0, 63)
    assert {depth for _, depth in shown.values()} == {0}


def test_face_cut_by_near_has_its_depths_on_the_screen_plane():
    face = [(-1, -1, -1.5, 1), (1, -1, 0.5, 1), (0, 1, 0.5, 1)]
    shown = oracle.render_faces(face, [(0, 1, 2)], (32, 32))
    assert 0 < len(shown) < len(oracle.covered_pixels([(0, 32), (32, 32), (16, 0)], (32, 32)))
    assert all(-1 <= depth <= F(1, 2) for _, depth in shown.values())


def test_engine_draws_what_the_oracle_says():
    rng = np.random.default_rng(6)
    clip = np.round(rng.uniform(-1.5, 1.5, (60, 4)) * 2**12) / 2**12
    clip[:, 2] *= 0.5
    clip[:, 3] = 1.0
    faces = np.arange(60).reshape(-1, 3)
    seen = rj.rasterize(clip, faces, (32, 16), threads=1)
    want = np.full((16, 32), -1)
    for (column, row), (face, _) in rj.oracle.render_faces(clip, faces, (32, 16)).items():
        want[row, column] = face
    np.testing.assert_array_equal(seen.face_id, want)


# --- clipping -------------------------------------------------------------------------------------


def test_all_six_planes_leave_nine_corners():
    polygon = oracle.clip_polygon(C05)
    in_0_to_1 = [(x, y, (z + 1) / 2) for x, y, z, w in polygon if w == 1]
    want = [
        (1, F(-1, 2), F(1, 4)), (F(1, 2), F(1, 2), 0), (0, 1, 0), (F(-1, 2), 1, F(1, 4)),
        (-1, F(1, 2), F(3, 4)), (-1, 0, 1), (F(-1, 2), F(-1, 2), 1), (F(1, 2), -1, F(3, 4)),
        (1, -1, F(1, 2)),
    ]  # fmt: skip
    first = in_0_to_1.index(want[0])
    assert in_0_to_1[first:] + in_0_to_1[:first] == want
    assert len(oracle.render_faces(C05, [(0, 1, 2)], (64, 48))) == 2016


def test_point_at_infinity_is_cut_off():
    polygon = oracle.clip_polygon([(0, 0, 0, 1), (1, 0, 0, 0), (0, 1, 0, 1)])
    corners = {(x / w, y / w) for x, y, _, w in polygon}
    assert corners == {(0, 0), (1, 0), (1, 1), (0, 1)}


def test_every_corner_left_is_inside_and_in_front_and_on_the_face():
    rng = random.Random(7)
    left = 0
    for _ in range(300):
        face = [[rng.randint(-3, 3) for _ in "xyzw"] for _ in "abc"]
        for x, y, z, w in oracle.clip_polygon(face):
            left += 1
            assert w > 0
            assert max(abs(x), abs(y), abs(z)) <= w
            # On the plane through the three corners and in their span: weights are not negative.
            rows = [(*corner[:2], corner[3]) for corner in face]
            if determinant(*rows):
                weights = [
                    determinant(*[(x, y, w) if m == n else rows[m] for m in range(3)])
                    for n in range(3)
                ]
                total = determinant(*rows)
                assert all(weight / total >= 0 for weight in weights)
                assert (
                    sum(
                        F(k, 1) / total * corner[2] for k, corner in zip(weights, face, strict=True)
                    )
                    == z
                )
    assert left > 300


def determinant(a, b, c):
    return F(
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def test_face_outside_or_only_touching_leaves_nothing():
    assert oracle.clip_polygon([(2, 0, 0, 1), (3, 0, 0, 1), (2, 1, 0, 1)]) == []
    assert oracle.clip_polygon([(1, 0, 0, 1), (2, 0, 0, 1), (2, 1, 0, 1)]) == []
    assert oracle.clip_polygon([(1, 0, 0, 1), (1, 1, 0, 1), (2, 1, 0, 1)]) == []


def test_face_through_the_eye_leaves_nothing():
    assert oracle.clip_polygon([(0, 0, 0, 0), (1, 0, 0, 1), (0, 1, 0, 1)]) == []
    assert oracle.clip_polygon([(0, 0, 0, 0)] * 3) == []


def test_near_alone_cuts_in_depth_only():
    polygon = oracle.clip_near([(0, 0, 0, 1), (4, 0, 0, 1), (0, 0, -2, 1)])
    assert polygon == [(0, 0, 0, 1), (4, 0, 0, 1), (2, 0, -1, 1), (0, 0, -1, 1)]
    with pytest.raises(ValueError, match="polygon reaches infinity"):
        oracle.clip_near([(0, 0, 0, 1), (1, 0, 0, 0), (0, 1, 0, 1)])
    assert oracle.clip_near([(0, 0, 3, -1), (1, 0, 3, -1), (0, 1, 3, -1)]) == []


def test_guard_band_is_the_engine_s():
    for size in ((64, 32), (1, 16384)):
        viewport = make_viewport(size, 8)
        assert oracle.guard_band(size) == oracle.view_planes(viewport.guard_x, viewport.guard_y)


# --- area -----------------------------------------------------------------------------------------


def test_areas_by_hand():
    assert oracle.pixel_area([(0, 0), (1, 0), (0, 1)], 0, 0) == F(1, 2)
    ramp = [(0, 0.25), (4, 1.25), (4, 4), (0, 4)]
    assert [oracle.pixel_area(ramp, i, 0) for i in range(4)] == [F(5, 8), F(3, 8), F(1, 8), 0]
    assert [oracle.pixel_area(ramp, i, 1) for i in range(4)] == [1, 1, 1, F(7, 8)]
    assert oracle.polygon_area(ramp) == 13
    table = {
        (1, 1): F(1395, 4928), (2, 1): F(29, 88), (3, 3): 1, (6, 2): F(35, 88),
        (3, 6): F(939, 2912), (5, 4): F(1225, 7488), (2, 3): F(197, 224),
    }  # fmt: skip
    assert {pixel: oracle.pixel_area(M07, *pixel) for pixel in table} == table


def test_areas_of_the_pixels_sum_to_the_polygon_s():
    bent = [(0, 0), (6, 1), (3, 2.5), (5.75, 7)]  # not convex
    for polygon in [M07, bent, bent[::-1], *random_fan(12, 8, grid=3)]:
        pixels = [(i, j) for i in range(*BOX) for j in range(*BOX)]
        areas = [oracle.pixel_area(polygon, *pixel) for pixel in pixels]
        assert sum(areas) == oracle.polygon_area(polygon)
        assert all(0 <= area <= 1 for area in areas)
    assert oracle.polygon_area(M07) == F(435, 32)
    assert oracle.polygon_area([(0, 0), (1, 1)]) == oracle.pixel_area([], 0, 0) == 0


# --- lines ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", range(8))
def test_line_in_every_octant(turn):
    first = [(0, 0), (1, 0), (2, 1), (3, 1), (4, 2), (5, 2), (6, 3), (7, 3)]

    def turned(point):
        x, y = point if turn & 1 else point[::-1]
        return (x if turn & 2 else -x), (y if turn & 4 else -y)

    assert oracle.line_pixels(turned((0, 0)), turned((7, 3))) == [turned(p) for p in first]


def test_tie_goes_to_the_larger_coordinate_in_both_directions():
    assert oracle.line_pixels((0, 0), (2, 1)) == [(0, 0), (1, 1), (2, 1)]
    assert oracle.line_pixels((2, 1), (0, 0)) == [(2, 1), (1, 1), (0, 0)]
    assert oracle.line_pixels((0, 0), (-1, 2)) == [(0, 0), (0, 1), (-1, 2)]


def test_line_is_within_half_a_pixel_and_moves_one_pixel_a_step():
    for dx in range(-9, 10):
        for dy in range(-9, 10):
            pixels, steps = oracle.line_pixels((3, -2), (3 + dx, dy - 2)), max(abs(dx), abs(dy))
            assert (len(pixels), pixels[0], pixels[-1]) == (steps + 1, (3, -2), (3 + dx, dy - 2))
            for x, y in pixels:
                assert 2 * abs((x - 3) * dy - (y + 2) * dx) <= steps
            for (x, y), (u, v) in pairwise(pixels):
                assert max(abs(u - x), abs(v - y)) == 1


def test_colours_along_a_line_are_rounded_half_up():
    ramp = oracle.line_colors((0, 0), (10, 3), (0, 255), (255, 0))
    assert [first for first, _ in ramp] == [0, 26, 51, 77, 102, 128, 153, 179, 204, 230, 255]
    assert [last for _, last in ramp] == [255, 230, 204, 179, 153, 128, 102, 77, 51, 26, 0]
    assert oracle.line_colors((4, 4), (4, 4), (1, 2, 3), (7, 8, 9)) == [(1, 2, 3)]


def test_steps_of_a_huge_line_are_listed_alone():
    ends = (-(2**31), -(2**30)), (2**31 - 1, 2**30)
    steps = range(2**31, 2**31 + 5)
    assert oracle.line_pixels(*ends, steps=steps) == [(0, 0), (1, 1), (2, 1), (3, 2), (4, 2)]
    assert oracle.line_colors(*ends, (0,), (2**32 - 1,), steps=steps) == [(k,) for k in steps]


# --- transparency ---------------------------------------------------------------------------------


def test_layers_are_laid_over_each_other():
    red, blue = (1, 0, 0), (0, 0, 1)
    assert oracle.composite([(red, F(1, 2)), (blue, F(1, 2))]) == (F(1, 2), 0, F(1, 4))
    assert oracle.composite([(red, 0.25)], (1, 1, 1)) == (1, F(3, 4), F(3, 4))
    assert oracle.composite([(red, 1), (blue, 1)], (9, 9, 9)) == (1, 0, 0)
    assert oracle.composite([(red, 0)], (F(1, 3),) * 3) == oracle.composite([], (F(1, 3),) * 3)


# --- borders --------------------------------------------------------------------------------------

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: oracle.snap(NAN), "value must be finite, got nan"),
        (lambda: oracle.snap("1"), "value must be a number, got '1'"),
        (lambda: oracle.snap(1, -1), "subpixel_bits must be at least 0, got -1"),
        (lambda: oracle.snap(1, 2**70), "subpixel_bits must be at most 1074, got 11805916"),
        (lambda: oracle.snap_triangle(R09[:2]), "points must have 3 entries, got 2"),
        (lambda: oracle.edge((0, 0), (1, INF), (0, 0)), r"b\[1\] must be finite, got inf"),
        (lambda: oracle.covers(I01, (np.float32(NAN), 0)), r"point\[0\] must be finite, got .*nan"),
        (lambda: oracle.covered_pixels(R09, (0, 4)), r"size\[0\] must be at least 1, got 0"),
        (lambda: oracle.covered_pixels(R09, (4.5, 4)), r"size\[0\] must be a whole number"),
        (lambda: oracle.affine_weights([(0, 0)] * 3, (0, 0)), "triangle must have an area"),
        (lambda: oracle.perspective_weights(I01, (1, 0, 1), (1, 1)), "ws must be above zero"),
        (lambda: oracle.interpolate((1, 2), (1, 2, 3)), "values must have 2 entries, got 3"),
        (lambda: oracle.visible_faces([I01], [], (4, 4)), "depths must have 1 entries, got 0"),
        (lambda: oracle.screen_position((0, 0, 0, 0), (4, 4)), "must have w above zero"),
        (lambda: oracle.clip_polygon([(0, 0, NAN, 1)]), r"polygon\[0\]\[2\] must be finite, got"),
        (lambda: oracle.render_faces(C05, [(0, 1, 3)], (4, 4)), r"faces\[0\] must be three"),
        (lambda: oracle.render_faces(C05, [(0, 1, -1)], (4, 4)), r"faces\[0\] must be at least 0"),
        (lambda: oracle.line_pixels((0, 0), (1.5, 0)), r"end\[0\] must be a whole number, got 1.5"),
        (lambda: oracle.line_pixels((0, 0), (2, 0), steps=[3]), "steps must be from 0 to 2, got 3"),
        (lambda: oracle.line_colors((0, 0), (1, 1), (1,), (1, 2)), "end_color must have 1 entr"),
        (lambda: oracle.composite([((0, 0, 0), 2)]), r"layers\[0\] alpha must be from 0 to 1"),
        (lambda: oracle.clip_weights([(0, 0, 0, 0)] * 3, (0, 0), (4, 4)), "point must not be on"),
    ],
)  # fmt: skip
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_results_are_whole_numbers_and_fractions():
    def leaves(value):
        if isinstance(value, dict):
            yield from leaves([*value.keys(), *value.values()])
        elif isinstance(value, (list, tuple, set)):
            for member in value:
                yield from leaves(member)
        else:
            yield value

    floats = np.array(R09)
    clip = np.array([(*point, 0.5, 20.0) for point in R09])
    results = [
        oracle.snap(np.float64(1.5)), oracle.edge(*floats), oracle.covered_pixels(floats, (16, 16)),
        oracle.affine_weights(floats, np.array([4.5, 4.5])), oracle.round_half_up(np.float32(0.5)),
        oracle.perspective_weights(floats, np.ones(3), (4.5, 4.5)),
        oracle.clip_weights(clip[:3], (12, 4), (16, 16)),
        oracle.interpolate((0.5, 0.5), floats[:2]),
        oracle.depth_at(floats, np.arange(3), (1.0, 1.0)), oracle.clip_polygon(clip),
        oracle.visible_faces([floats], np.ones((1, 3)), (16, 16)), oracle.guard_band((3, 5)),
        oracle.render_faces(clip, [(0, 1, 2)], (16, 16)), oracle.screen_position(clip[0], (16, 16)),
        oracle.polygon_area(floats), oracle.pixel_area(floats, 4, 4), oracle.VIEW_VOLUME,
        oracle.line_pixels(np.array([0, 0]), np.array([3, 1])),
        oracle.line_colors((0, 0), (3, 1), np.uint8([1, 2]), np.uint8([200, 1])),
        oracle.composite([(np.ones(3), 0.5)]),
    ]  # fmt: skip
    assert {type(leaf) for leaf in leaves(results)} == {int, Fraction}


def test_file_stands_alone():
    code = (
        "import runpy, sys; runpy.run_path(sys.argv[1]); "
        "print([m for m in ('numpy', 'numba', 'rasterjit') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", code, str(Path(oracle.__file__))],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == "[]"


def test_rendering_does_not_load_it():
    code = (
        "import sys, rasterjit; print('rasterjit.oracle' in sys.modules, rasterjit.oracle.snap(1))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(rj.__file__).parents[1], capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["False", "256"]


def test_every_public_function_is_listed_and_described():
    public = {
        name
        for name, thing in vars(oracle).items()
        if callable(thing)
        and getattr(thing, "__module__", "") == oracle.__name__
        and name[0] != "_"
    }
    assert set(oracle.__all__) == public | {"VIEW_VOLUME"}
    for name in public - {"WrongPixel"}:
        for heading in ("Parameters", "Returns", "Raises"):
            assert f"{heading}\n    ---" in getattr(oracle, name).__doc__, f"{name}: {heading}"


@pytest.mark.parametrize(
    ("value", "exact"),
    [
        (np.float32(0.1), Fraction(13421773, 2**27)),
        (np.longdouble(1) / 3, Fraction(*(np.longdouble(1) / 3).as_integer_ratio())),
        (Decimal("0.1"), Fraction(1, 10)),
        (np.int8(-3), -3),
        (Fraction(2, 7), Fraction(2, 7)),
    ],
    ids=str,
)
def test_numbers_of_any_kind_are_taken_at_their_exact_value(value, exact):
    assert oracle.plane_distance((value, 0, 0, 0), (1, 0, 0, 0)) == exact
    assert oracle.interpolate((1,), (value,)) == exact


def test_it_is_listed_and_loaded_when_it_is_named():
    assert "oracle" in dir(rj)
    assert rj.oracle is oracle


# --- what is wrong with a line or a fill ----------------------------------------------------------


def spoil(pixels, rng, elsewhere):
    """Return pixels with faults, and which those are."""
    pixels, faults = list(pixels), {}
    for pixel in rng.sample(pixels, min(2, len(pixels))):
        pixels.remove(pixel)
        faults[pixel] = "missing"
    for pixel in rng.sample(pixels, min(1, len(pixels))):
        pixels.append(pixel)
        faults[pixel] = "twice"
    for pixel in elsewhere:
        if pixel not in faults and pixel not in pixels:
            pixels.append(pixel)
            faults[pixel] = "extra"
    rng.shuffle(pixels)
    return pixels, faults


def test_faults_of_lines_are_found_with_their_reasons():
    rng = random.Random(5)
    for _ in range(200):
        start, end = ((rng.randint(-9, 9), rng.randint(-9, 9)) for _ in "se")
        others = [(rng.randint(-11, 11), rng.randint(-11, 11)) for _ in "abc"]
        right = oracle.line_pixels(start, end)
        assert oracle.explain_line(right, start, end) == []
        pixels, faults = spoil(right, rng, others)
        found = oracle.explain_line(pixels, start, end)
        assert {one.pixel: one.fault for one in found} == faults
        for one in found:
            along = int(abs(end[0] - start[0]) < abs(end[1] - start[1]))
            ends = sorted((start[along], end[along]))
            if ends[0] <= one.pixel[along] <= ends[1]:
                there = next(pixel for pixel in right if pixel[along] == one.pixel[along])
                assert int(one.reason.split()[-1]) == there[1 - along]
                assert (there == one.pixel) == (one.fault != "extra")
            else:
                assert one.reason.startswith("the line goes from")


def test_faults_of_fills_are_found_with_their_reasons():
    rng, reasons = random.Random(6), []
    for triangle in random_fan(150, seed=7):
        others = [(rng.randint(-1, 10), rng.randint(-1, 10)) for _ in range(5)]
        right = oracle.covered_pixels(triangle, (10, 10))
        assert oracle.explain_fill(right, triangle, (10, 10)) == []
        pixels, faults = spoil(sorted(right), rng, others)
        found = oracle.explain_fill(pixels, triangle, (10, 10))
        assert {one.pixel: one.fault for one in found} == faults
        for one in found:
            reasons.append(one.reason.split(",")[-1])
            centre = F(2 * one.pixel[0] + 1, 2), F(2 * one.pixel[1] + 1, 2)
            values = [oracle.edge(triangle[n], triangle[(n + 1) % 3], centre) for n in range(3)]
            turn = 1 if oracle.edge(*triangle) > 0 else -1
            if one.fault != "extra":
                assert one.reason.count(", a left edge") + one.reason.count(", a top edge") == (
                    values.count(0)
                )
            elif "outside" in one.reason:
                assert one.reason.count("the edge from") == sum(turn * v < 0 for v in values)
            else:
                assert any(words in one.reason for words in ("neither", "no area", "picture has"))
    assert {" a left edge", " a top edge", " neither a top nor a left edge"} <= {*reasons}


def test_a_wrong_pixel_is_a_line_of_text():
    (found,) = oracle.explain_line([(0, 0), (1, 1), (1, 1)], (0, 0), (1, 1))
    assert str(found).startswith("(1, 1) is there twice: in column 1 the line is at row 1")
    (_, found) = oracle.explain_fill([(9, 9), (8, 8)], [(0, 0), (1, 1), (2, 2)], (9, 9))
    assert str(found) == "(9, 9) is too many: the picture has 9 × 9 pixels"
    with pytest.raises(ValueError, match=r"pixels\[0\]"):
        oracle.explain_line([(0.5, 0)], (0, 0), (1, 1))
