"""Segments with a width cover what they should, hide what they should, and nothing else."""

from __future__ import annotations

import itertools
import math

import naive
import naive_segments as twin
import numpy as np
import pytest
import screen

import rasterjit as rj

SIZE = (32, 32)


def positions(points, w=1.0):
    """Return what `screen.camera` sees at screen points, at the distances w."""
    clip = naive.clip_from_screen(points, SIZE, 0.0, w)
    return np.column_stack([clip[:, :2], -clip[:, 3]])


def draw(points, segments=None, w=1.0, outputs=("face_id",), quality=None, **options):
    lines = rj.Lines(positions(points, w), segments, **options)
    near = float(np.min(w))
    return rj.render(lines, screen.camera(near), size=SIZE, outputs=outputs, threads=1,
                     quality=quality)  # fmt: skip


def pixels(frame):
    """Return the pixels (row, column) that show a segment."""
    return set(map(tuple, np.argwhere(frame.face_id >= 0).tolist()))


def random_points(count, seed, low=2, high=30):
    drawn = np.random.default_rng(seed).integers(low * 256, high * 256, (count, 2))
    return [tuple(point) for point in (drawn / 256).tolist()]


def hold_to_distance(frame, points, width, flat=0.0625):
    """Hold coverage to the distance of pixel centres from a strip of points."""
    shown = pixels(frame)
    for row in range(SIZE[1]):
        for column in range(SIZE[0]):
            centre = column + 0.5, row + 0.5
            ways = itertools.pairwise(points)
            away = min(twin.distance(a, b, centre) for a, b in ways)
            if away < width / 2 - flat - 0.01:
                assert (row, column) in shown, (row, column)
            if away > width / 2 + 0.01:
                assert (row, column) not in shown, (row, column)


@pytest.mark.case("W01")
@pytest.mark.parametrize(("y", "row"), [(8.5, 8), (8.0, 7), (8.25, 8), (8.75, 8)])
def test_a_line_of_one_pixel_is_one_row(y, row):
    frame = draw([(4, y), (20, y)], width=1.0, caps="butt")
    assert pixels(frame) == {(row, column) for column in range(4, 20)}
    frame = draw([(y, 4), (y, 20)], width=1.0, caps="butt")
    assert pixels(frame) == {(column, row) for column in range(4, 20)}


@pytest.mark.case("W02")
@pytest.mark.parametrize("width", [1.0, 1.5])
def test_a_line_of_a_pixel_or_more_has_no_gap(width):
    for a, b in zip(random_points(60, 1), random_points(60, 2), strict=True):
        shown = pixels(draw([a, b], width=width, caps="butt"))
        axis = 0 if abs(b[1] - a[1]) >= abs(b[0] - a[0]) else 1
        first, last = sorted((a[1 - axis], b[1 - axis]))
        # Across the line all is there but near its ends.
        for step in range(math.ceil(first + 1.0), math.floor(last - 1.0)):
            assert any(pixel[axis] == step for pixel in shown), (a, b, step)


@pytest.mark.case("W03")
@pytest.mark.parametrize("width", [0.3, 1.0, 1.5, 4.0, 9.3])
def test_bodies_are_the_exact_ones(width):
    for a, b in zip(random_points(12, 1), random_points(12, 2), strict=True):
        shown = pixels(draw([a, b], width=width, caps="butt"))
        assert shown == twin.covered(twin.body(a, b, width), SIZE), (a, b)


@pytest.mark.case("W04")
def test_the_order_of_ends_changes_no_pixel():
    for a, b in zip(random_points(20, 1), random_points(20, 2), strict=True):
        for caps in ("butt", "round"):
            one, other = (draw(ends, width=3.0, caps=caps) for ends in ([a, b], [b, a]))
            assert pixels(one) == pixels(other)


@pytest.mark.case("W05")
def test_a_curve_of_blended_segments_covers_no_pixel_twice():
    around = np.linspace(0.0, 5.5, 60)
    points = np.round((16 + 12 * np.stack([np.cos(around), np.sin(around)], 1)) * 256) / 256
    glass = rj.Material("unlit", base_color=(0, 0, 0, 0.5), alpha_mode="blend")
    frame = draw(points, width=3.0, material=glass, outputs=("linear", "face_id"))
    light = frame.linear[frame.face_id >= 0, 0]
    assert len(light) > 150
    np.testing.assert_array_equal(light, np.float32(0.5))
    hold_to_distance(frame, points.tolist(), 3.0)


@pytest.mark.case("W06")
@pytest.mark.parametrize("width", [2.5, 6.0, 11.0])
def test_joints_are_round_at_any_bend(width):
    for seed in range(8):
        points = random_points(3, seed, 7, 25)
        hold_to_distance(draw(points, width=width), points, width)


@pytest.mark.case("W06")
def test_a_line_that_goes_straight_back_is_round_there():
    points = [(8.0, 16.0), (20.0, 16.0), (10.0, 16.0)]
    hold_to_distance(draw(points, width=7.0), points, 7.0)


@pytest.mark.case("W07")
def test_ends_are_round_or_cut_off():
    points = [(10.0, 16.5), (20.0, 16.5)]
    hold_to_distance(draw(points, width=9.0), points, 9.0)
    shown = pixels(draw(points, width=9.0, caps="butt"))
    assert shown == {(row, column) for row in range(12, 21) for column in range(10, 20)}


@pytest.mark.case("W08")
def test_a_segment_through_the_eye_shows_what_lies_before_it():
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), near=0.25, far=100.0, fov_y=90.0)
    ends = np.array([[-1.0, -0.5, -4.0], [1.0, -0.5, 4.0]])
    # Where it crosses the near plane.
    cut = ends[0] + (3.75 / 8.0) * (ends[1] - ends[0])
    colors = np.array([[0.0, 0, 0], [1.0, 1, 1]])
    options = {"width": 2.0, "caps": "butt"}
    through = rj.Lines(ends, colors=colors, **options)
    short = rj.Lines([ends[0], cut], colors=[[0.0] * 3, [3.75 / 8.0] * 3], **options)
    one, other = (
        rj.render(lines, camera, size=SIZE, outputs=("linear", "face_id", "depth"), threads=1)
        for lines in (through, short)
    )
    assert len(pixels(one)) > 10
    assert pixels(one) == pixels(other)
    np.testing.assert_allclose(one.linear, other.linear, atol=2e-6)
    np.testing.assert_allclose(one.depth, other.depth, rtol=1e-6)
    assert one.stats.drawn == 1


@pytest.mark.case("W09")
def test_an_end_far_beside_the_picture_moves_no_pixel():
    for x in (64.0, 2.0**14, 2.0**21, 2.0**40):
        frame = draw([(8.0, 12.5), (x, 12.5)], width=3.0, caps="butt")
        assert pixels(frame) == {(row, c) for row in range(11, 14) for c in range(8, 32)}


@pytest.mark.case("W10")
def test_a_segment_with_an_invalid_point_is_left_out_alone():
    points = positions([(4, 8), (10, 8), (16, 8), (22, 8), (28, 8)])
    points[2] = np.nan
    lines = rj.Lines(points, width=3.0, caps="butt", on_invalid="drop")
    frame = rj.render(lines, screen.camera(1.0), size=SIZE, outputs=("face_id",), threads=1)
    assert set(np.unique(frame.face_id)) == {-1, 0, 3}
    assert frame.stats.invalid == 2


@pytest.mark.case("W11")
def test_a_segment_without_length_is_a_dot_if_its_ends_are_round():
    points = [(16.5, 16.5), (16.5, 16.5)]
    hold_to_distance(draw(points, width=7.0), points, 7.0)
    frame = draw(points, width=7.0, caps="butt")
    assert not pixels(frame)
    assert frame.stats.drawn == 0


@pytest.mark.case("W11")
def test_a_segment_without_length_has_a_pixel_wherever_it_is():
    for width in (1.0, 1.5, 1.9):
        for point in [*random_points(15, 8), (8.0, 8.0), (8.5, 8.0), (8.5, 8.5)]:
            shown = pixels(draw([point, point], width=width))
            holder = {(int(np.ceil(point[1])) - 1, int(np.ceil(point[0])) - 1)}
            away = abs(point[0] % 1 - 0.5) + abs(point[1] % 1 - 0.5)
            if away >= width / 2:
                assert shown == holder, (width, point)
            assert shown, (width, point)
            # Seen end-on, and one that comes back to where it was.
            assert pixels(draw([point, point], w=[1.0, 2.0], width=width)) == shown
            assert pixels(draw([point] * 3, width=width)) == shown
    assert not pixels(draw([(8.0, 8.0)] * 2, width=1.5, caps="butt"))


@pytest.mark.case("W12")
def test_a_face_hides_exactly_what_is_behind_it():
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.0, near=1.0, far=9.0)
    wall = rj.Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]], [[0, 1, 2], [0, 2, 3]])
    # It goes through the wall at 3/4 of its way: depth is linear along it.
    lines = rj.Lines([[-0.9, 0.02, 0.75], [0.9, 0.02, -0.25]], width=3.0, caps="butt")
    scene = rj.Scene()
    scene.add(wall)
    scene.add(lines)
    frame = rj.render(scene, camera, size=(64, 64), outputs=("object_id", "depth"), threads=1)
    columns = np.flatnonzero((frame.object_id == 1).any(axis=0))
    assert columns[0] == 3
    through = 32 + 32 * (-0.9 + 0.75 * 1.8)
    assert columns[-1] == math.floor(through - 0.5)
    rows, columns = np.nonzero(frame.object_id == 1)
    along = ((columns + 0.5) / 32 - 1 + 0.9) / 1.8
    np.testing.assert_allclose(frame.depth[rows, columns], 5 - (0.75 - along), atol=1e-4)


@pytest.mark.case("W13")
@pytest.mark.parametrize("ws", [(1.0, 1.0), (1.0, 8.0), (64.0, 0.5)])
def test_values_along_a_line_are_those_of_its_points(ws):
    for a, b in zip(random_points(6, 1), random_points(6, 2), strict=True):
        frame = draw([a, b], w=ws, width=5.0, attributes={"t": [[0.0], [1.0]]},
                     outputs=("face_id", "attribute:t", "barycentric"))  # fmt: skip
        assert not frame.barycentric.any()
        for row, column in pixels(frame):
            wanted = twin.share(a, b, ws, screen.centre(column, row))
            have = frame.arrays()["attribute:t"][row, column, 0]
            assert abs(have - float(wanted)) < 2e-6, (row, column)


@pytest.mark.case("W14")
def test_dashes_are_as_long_as_they_say():
    points = [(2.0, 8.5), (30.0, 8.5)]
    shown = pixels(draw(points, width=1.0, dashes=[3, 2]))
    assert shown == {(8, c) for c in range(2, 30) if (c - 2) % 5 < 3}
    # They go on around a corner, and begin anew with the next strip.
    points = [(2.0, 8.5), (9.5, 8.5), (9.5, 28.0), (20.0, 4.5), (30.0, 4.5)]
    frame = draw(points, [(0, 1), (1, 2), (3, 4)], width=1.0, dashes=[4, 4], caps="butt")
    shown = pixels(frame)
    assert {c for r, c in shown if r == 8} >= {2, 3, 4, 5}
    assert (8, 6) not in shown
    down = {r for r, c in shown if c == 9 and r > 9}
    assert down == {r for r in range(10, 28) if (r - 8.5 + 0.5 + 7.5) % 8 < 4}
    assert {c for r, c in shown if r == 4} == {20, 21, 22, 23, 28, 29}


@pytest.mark.case("W15")
def test_shares_of_a_line_are_its_areas():
    black = rj.Material("unlit", base_color=(0, 0, 0))
    frame = draw([(4.0, 8.25), (20.0, 8.25)], width=1.5, caps="butt", material=black,
                 outputs=("linear", "coverage"), quality=rj.Quality(samples="area"))  # fmt: skip
    # From 7.5 to 9.
    wanted = np.zeros(32)
    wanted[7], wanted[8] = 0.5, 1.0
    np.testing.assert_allclose(frame.coverage[:, 10], wanted, atol=1e-6)
    np.testing.assert_allclose(frame.linear[:, 10, 0], 1.0 - wanted, atol=1e-6)


@pytest.mark.case("W16")
def test_a_width_in_scene_units_shrinks_with_distance():
    # At w = 4 a scene unit is 4 pixels: half of 32 over 4.
    for w, wide in ((1.0, 8), (2.0, 4), (4.0, 2)):
        frame = draw([(16.0, 2.0), (16.0, 30.0)], w=w, width=0.5, unit="world", caps="butt")
        assert (frame.face_id[16] >= 0).sum() == wide
    # The node's transform scales it.
    scene = rj.Scene()
    points = positions([(16.0, 2.0), (16.0, 30.0)], 4.0)
    scene.add(rj.Lines(points / 2, width=0.5, unit="world", caps="butt"), rj.transforms.scale(2.0))
    frame = rj.render(scene, screen.camera(4.0), size=SIZE, outputs=("face_id",), threads=1)
    assert (frame.face_id[16] >= 0).sum() == 4


@pytest.mark.case("W17")
def test_segments_of_other_widths_are_capped_where_they_meet():
    points = [(6.0, 16.0), (16.0, 16.0), (26.0, 16.0)]
    frame = draw(points, width=[9.0, 3.0], caps="butt")
    shown = pixels(frame)
    for row in range(SIZE[1]):
        for column in range(SIZE[0]):
            x, y = column + 0.5, row + 0.5
            away = min(
                math.hypot(max(6 - x, 0, x - 16), y - 16) - 4.5 if x > 6 else 9.0,
                math.hypot(max(16 - x, 0, x - 26), y - 16) - 1.5 if x < 26 else 9.0,
            )
            if away < -0.08:
                assert (row, column) in shown
            if away > 0.02:
                assert (row, column) not in shown
