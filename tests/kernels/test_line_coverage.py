"""Lines by the area of each pixel that they cover: against cut polygons, and by their laws."""

from __future__ import annotations

import itertools

import naive_codes
import naive_lines
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.effects import wireframe
from rasterjit.effects.wireframe import coverage
from rasterjit.inspect import oracle
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.srgb_encoding import make_encoding_table
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads as sharing
from rasterjit.scene.color import decoding_table
from rasterjit.survey import cache

SIZE = (40, 36)
"""More rows than one band has."""

UNIT = 256
"""Steps of the grid in a pixel."""

END_ERROR = 1.0 / 40.0
"""Largest error of the area of a pixel that an end and a long side of a line cut, pixels."""


def cover(lines, size=SIZE, bits=8, depths=None, depth=None, slack=None, rows=None):
    """Return how much of each pixel lines cover, (N, 4) in steps of the grid."""
    ends = np.array(lines, np.int32).reshape(-1, 4)
    first, last = rows or (0, size[1])
    found = np.full((last - first, size[0]), 7.0, np.float32)
    depths = np.empty((0, 2)) if depths is None else depths
    depth = np.full((1, size[0]), -np.inf, np.float32) if depth is None else depth
    slack = np.zeros(depth.shape, np.float32) if slack is None else slack
    coverage.cover_lines(
        np.arange(len(ends), dtype=np.int32), ends, depths, (first, last),
        make_viewport(size, bits), depth, slack, found,
    )  # fmt: skip
    return found


def naive_cover(line, size=SIZE, unit=UNIT):
    """Return the same of one line, and where it is only nearly so."""
    start, end = (line[0] / unit, line[1] / unit), (line[2] / unit, line[3] / unit)
    found, near = np.zeros(size[::-1]), np.zeros(size[::-1], bool)
    for column, row in itertools.product(range(size[0]), range(size[1])):
        found[row, column] = naive_lines.line_share(start, end, column, row)
        near[row, column] = naive_lines.is_cut_by_end_and_side(start, end, column, row)
    return found, near


def agree(line, size=SIZE):
    have = cover([line], size)
    want, is_near = naive_cover(line, size)
    np.testing.assert_allclose(have[~is_near], want[~is_near], rtol=0, atol=2e-6)
    assert (np.abs(have - want)[is_near] < END_ERROR).all()
    return have, want


# All eight octants, and what lies between them.
DIRECTIONS = [
    (3000, 1100), (1100, 3000), (-1100, 3000), (-3000, 1100), (-3000, -1100), (-1100, -3000),
    (1100, -3000), (3000, -1100), (3000, 0), (0, -3000), (2100, 2100), (2100, -2100), (3000, 1),
    (-1, 3000), (700, 650), (90, 40), (3, 0), (0, 3), (2, 2),
]  # fmt: skip


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("corner", [(0, 0), (128, 128), (37, 201)])
def test_a_pixel_is_covered_by_the_area_that_the_line_has_in_it(direction, corner):
    middle = np.array([20 * UNIT + corner[0], 18 * UNIT + corner[1]])
    start = middle - np.array(direction) // 2
    have, want = agree((*start, *(start + direction)))
    length = np.hypot(*direction) / UNIT
    # Where an end and a side cut a pixel, nothing is lost on the whole.
    assert have.sum() == pytest.approx(length + 1.0, abs=4 * END_ERROR)
    assert want.sum() == pytest.approx(length + 1.0, abs=1e-9)


coordinate = st.integers(-3 * UNIT, 13 * UNIT)


@settings(max_examples=60, deadline=None)
@given(st.tuples(coordinate, coordinate, coordinate, coordinate))
def test_any_line_covers_its_area_also_at_borders(line):
    agree(line, (10, 9))


def test_the_error_at_ends_is_bounded_and_the_bound_is_tight():
    most = 0.0
    for angle in range(0, 46, 3):
        for place in range(16):
            turn = np.radians(angle)
            ends = np.round(np.array([0, 0, np.cos(turn), np.sin(turn)]) * 5 * UNIT)
            line = (ends + [512 + 16 * place, 512 + 48 * (place % 5)] * 2).astype(int)
            have, (want, _) = cover([line], (10, 9)), naive_cover(line, (10, 9))
            most = max(most, np.abs(have - want).max())
    assert 0.5 * END_ERROR < most < END_ERROR


def test_line_through_pixel_centres_covers_them_wholly_and_nothing_beside():
    middle = UNIT // 2
    row = cover([(5 * UNIT + middle, 7 * UNIT + middle, 9 * UNIT + middle, 7 * UNIT + middle)])
    want = np.zeros_like(row)
    want[7, 5:10] = 1.0
    np.testing.assert_array_equal(row, want)
    column = cover([(5 * UNIT + middle, 3 * UNIT + middle, 5 * UNIT + middle, 8 * UNIT + middle)])
    want = np.zeros_like(column)
    want[3:9, 5] = 1.0
    np.testing.assert_array_equal(column, want)


def test_line_between_two_rows_covers_half_of_each():
    have = cover([(5 * UNIT, 7 * UNIT, 15 * UNIT, 7 * UNIT)])
    want = np.zeros_like(have)
    want[6:8, 5:15] = 0.5
    # The ends lie half a pixel beyond.
    want[6:8, [4, 15]] = 0.25
    np.testing.assert_array_equal(have, want)


@pytest.mark.parametrize("place", [(0, 0), (128, 128), (64, 200)])
def test_line_of_no_length_is_a_dot_of_one_pixel(place):
    x, y = 9 * UNIT + place[0], 8 * UNIT + place[1]
    have, _ = agree((x, y, x, y))
    assert have.sum() == pytest.approx(1.0, abs=1e-6)


def test_lines_that_go_on_in_each_other_leave_no_gap():
    rng = np.random.default_rng(91)
    for _ in range(40):
        start, step = rng.integers(6 * UNIT, 12 * UNIT, 2), rng.integers(-400, 400, 2)
        whole = cover([(*start, *(start + 8 * step))])
        parts = [(*(start + n * step), *(start + (n + 1) * step)) for n in range(8)]
        joined = cover(parts)
        tolerance = 2 * END_ERROR
        # A diagonal loses corners where its parts meet: less than a quarter of a pixel.
        assert (joined > whole - 0.25 - tolerance).all()
        if 0 in step:
            assert (joined > whole - 1e-6).all()
        assert (joined < whole + tolerance).all()


def test_direction_of_a_line_changes_no_bit():
    rng = np.random.default_rng(92)
    for line in rng.integers(-2 * UNIT, 42 * UNIT, (60, 4)).tolist():
        one, other = cover([line]), cover([[*line[2:], *line[:2]]])
        assert one.tobytes() == other.tobytes()


def test_mirrored_and_turned_lines_have_the_mirrored_and_turned_bits():
    rng, size = np.random.default_rng(93), (33, 33)
    side = 33 * UNIT
    for line in rng.integers(-2 * UNIT, 35 * UNIT, (60, 4)).tolist():
        x0, y0, x1, y1 = line
        have = cover([line], size)
        for other, turned in (
            ((side - x0, y0, side - x1, y1), have[:, ::-1]),
            ((x0, side - y0, x1, side - y1), have[::-1]),
            ((y0, x0, y1, x1), have.T),
            ((side - x0, side - y0, side - x1, side - y1), have[::-1, ::-1]),
            ((y0, side - x0, y1, side - x1), have.T[::-1]),
        ):
            np.testing.assert_array_equal(cover([other], size), turned)


def test_order_of_lines_and_lines_that_are_there_twice_change_no_bit():
    rng = np.random.default_rng(94)
    lines = rng.integers(-2 * UNIT, 42 * UNIT, (30, 4))
    first = cover(lines)
    for _ in range(4):
        again = np.concatenate([lines, lines[rng.integers(0, 30, 9)]])
        assert cover(rng.permutation(again)).tobytes() == first.tobytes()
    np.testing.assert_array_equal(first, np.max([cover([line]) for line in lines], axis=0))


def test_rows_of_a_band_are_those_of_the_picture():
    rng = np.random.default_rng(95)
    lines = rng.integers(-2 * UNIT, 42 * UNIT, (20, 4))
    whole = cover(lines)
    for rows in ((0, 1), (5, 20), (32, 36)):
        np.testing.assert_array_equal(cover(lines, rows=rows), whole[rows[0] : rows[1]])


@pytest.mark.parametrize("bits", [0, 4, 12])
def test_any_grid_gives_the_same_areas(bits):
    unit = 1 << max(bits, 1)
    for ends in ((3, 4, 17, 9), (3, 4, 3, 20), (5, 30, 30, 5)):
        have = cover([np.array(ends) * unit], bits=bits)
        np.testing.assert_array_equal(have, cover([np.array(ends) * UNIT]))


def test_huge_lines_cover_what_their_part_in_the_picture_does():
    far = 1 << 13
    for x, y in ((far, far // 3), (-far, far // 7), (far // 5, far)):
        line = (20 * UNIT - x * UNIT, 18 * UNIT - y * UNIT, 20 * UNIT + x * UNIT,
                18 * UNIT + y * UNIT)  # fmt: skip
        near = np.array([20 - x / 100, 18 - y / 100, 20 + x / 100, 18 + y / 100])
        want = np.array(
            [
                [naive_lines.line_share(near[:2], near[2:], column, row) for column in range(40)]
                for row in range(36)
            ]
        )
        np.testing.assert_allclose(cover([line]), want, rtol=0, atol=1e-5)


def test_nothing_but_nearer_surfaces_hides_a_line():
    line = [(2 * UNIT, 10 * UNIT, 38 * UNIT, 20 * UNIT)]
    alone = cover(line)
    depth, slack = np.full(SIZE[::-1], 0.5, np.float32), np.zeros(SIZE[::-1], np.float32)
    # Depth falls from 0.8 to 0.2 from left to right: half of the line is seen.
    ramp = np.array([[0.8, 0.2]])
    seen = cover(line, depths=ramp, depth=depth, slack=slack)
    np.testing.assert_array_equal(seen[:, :18], alone[:, :18])
    assert not seen[:, 22:].any()
    backward = cover([(*line[0][2:], *line[0][:2])], depths=ramp[:, ::-1].copy(), depth=depth,
                     slack=slack)  # fmt: skip
    assert backward.tobytes() == seen.tobytes()
    nothing = np.full_like(depth, -np.inf)
    np.testing.assert_array_equal(cover(line, depths=ramp, depth=nothing, slack=slack), alone)
    slack += np.float32(1.0)
    np.testing.assert_array_equal(cover(line, depths=ramp, depth=depth, slack=slack), alone)
    assert not cover(line, depths=np.array([[np.nan, 1.0]]), depth=depth, slack=slack).any()


def test_a_line_seen_end_on_shows_its_nearer_end():
    dot = [(9 * UNIT, 9 * UNIT, 9 * UNIT, 9 * UNIT)]
    depth, slack = np.full(SIZE[::-1], 0.5, np.float32), np.zeros(SIZE[::-1], np.float32)
    for ramp in ([[0.1, 0.6]], [[0.6, 0.1]]):
        assert cover(dot, depths=np.array(ramp), depth=depth, slack=slack).any()


def lay(shares, rgba, pixels, light):
    color = np.array(pixels, np.uint8).reshape(1, -1, 4)
    coverage.blend_lines(
        np.array([shares], np.float32), np.array(rgba, np.uint8).view(np.uint32), light,
        make_encoding_table(), color.view(np.uint32)[:, :, 0],
    )  # fmt: skip
    return [tuple(code) for code in color[0].tolist()]


def test_colour_is_laid_over_in_linear_light():
    light = decoding_table().astype(np.float64)
    rgba, pixel = (200, 30, 0, 255), (10, 90, 255, 255)
    for share in (0.0, 0.001, 0.25, 0.5, 0.75, 1.0):
        want = [light[a] * share + light[b] * (1 - share) for a, b in zip(rgba, pixel, strict=True)]
        (have,) = lay([share], rgba, [pixel], decoding_table().copy())
        assert have[:3] == naive_codes.coded([*want[:3], 1.0])[:3]
        assert have[3] == 255
    assert lay([0.0, 1.0], rgba, [pixel, pixel], decoding_table().copy()) == [pixel, rgba]


def test_colour_is_laid_over_in_codes_where_codes_are_mixed():
    rgba, pixels = (200, 30, 0, 255), [(10, 90, 255, 255), (7, 8, 9, 0), (50, 60, 70, 130)]
    for share in (0.0, 0.001, 0.3, 0.5, 1.0):
        front = (*rgba[:3], oracle.round_half_up(255.0 * float(np.float32(share))))
        want = [naive_codes.over(front, pixel) for pixel in pixels]
        assert lay([share] * 3, rgba, pixels, np.empty(0, np.float32)) == want


def test_a_transparent_background_takes_the_colour_of_the_line_and_its_share_as_alpha():
    have = lay([0.4, 1.0], (200, 30, 0, 255), [(0, 0, 0, 0)] * 2, decoding_table().copy())
    assert have == [(200, 30, 0, 102), (200, 30, 0, 255)]


# --- in a picture ---------------------------------------------------------------------------------

COVERAGE = rj.Quality(lines="coverage")


def wired(mesh, mode, color="red"):
    """Return a scene of a white mesh and its edges."""
    scene = rj.Scene()
    scene.add(rj.Mesh(mesh.vertices, mesh.faces, material=rj.Material("unlit", "white")))
    scene.wireframe = rj.Wireframe(color, mode)
    return scene


def shares_of(frame):
    """Return how much of each pixel red lines cover on white: green is what is left."""
    return 1.0 - decoding_table()[frame.color[..., 1]]


def draw(mesh, camera, mode="overlay", size=(64, 64), quality=COVERAGE, **options):
    options = {"threads": 1, **options}
    return rj.render(wired(mesh, mode), camera, size=size, quality=quality, **options)


def ball_camera(azimuth=33.0):
    turn = np.radians(azimuth)
    return rj.PerspectiveCamera(
        eye=(4 * np.sin(turn), 1.5, 4 * np.cos(turn)), target=(0, 0, 0), near=0.5, far=50.0
    )


@pytest.mark.parametrize("mode", ["only", "overlay"])
def test_picture_shows_lines_between_the_snapped_vertices(cube, camera, mode):
    size = (64, 64)
    frame = draw(cube, camera, "only", size)
    clip = np.column_stack([cube.vertices, np.ones(8)]) @ (
        camera.projection_matrix(size) @ camera.view_matrix()
    ).T  # fmt: skip
    screen = (clip[:, :2] / clip[:, 3:] * (1, -1) + 1) * 32
    snapped = np.rint(screen * UNIT).astype(int)
    edges = cache.find_unique_edges(cube.faces)
    want = cover(np.concatenate([snapped[edges[:, 0]], snapped[edges[:, 1]]], axis=1), size)
    np.testing.assert_allclose(shares_of(frame), want, rtol=0, atol=0.006)
    if mode == "overlay":
        # Hidden edges alone are missing.
        seen = shares_of(draw(cube, camera, mode, size))
        assert (seen <= want + 0.006).all()
        assert seen.sum() < 0.9 * want.sum()


@pytest.mark.parametrize("azimuth", [20.0, 77.0, 200.0])
def test_edges_of_faces_that_are_seen_are_whole(cube, azimuth):
    camera, size = ball_camera(azimuth), (233, 171)
    corners = cube.vertices[cube.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    toward = camera.eye_position() - corners[:, 0]
    facing = np.einsum("ij,ij->i", normals, toward) / 4 / np.linalg.norm(toward, axis=1)
    seen = rj.Mesh(cube.vertices, cube.faces[facing > 0.12])
    overlay = shares_of(draw(cube, camera, "overlay", size))
    alone = shares_of(draw(seen, camera, "only", size))
    assert alone.sum() > 200
    assert (overlay > alone - 0.02).all()


def test_edge_inside_a_closed_box_is_hidden(cube):
    camera = ball_camera()
    scene = wired(cube, "overlay")
    scene.add(rj.Mesh(0.4 * cube.vertices, cube.faces, material=rj.Material("unlit", "white")))
    both = rj.render(scene, camera, size=(64, 64), quality=COVERAGE, threads=1)
    alone = draw(cube, camera)
    assert both.color.tobytes() == alone.color.tobytes()


@pytest.mark.parametrize("mode", ["only", "overlay"])
def test_threads_and_tasks_change_no_bit(sphere, camera, monkeypatch, mode):
    size = (64, 70)
    want = draw(sphere, camera, mode, size).color.tobytes()
    monkeypatch.setattr(wireframe, "EDGES_PER_TASK", 7)
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", 1)
    for threads in (1, 3):
        assert draw(sphere, camera, mode, size, threads=threads).color.tobytes() == want


def test_lines_beside_the_picture_reach_into_it():
    camera = rj.MatrixCamera(np.eye(4), np.eye(4))
    size, step = (16, 16), 2.0 / 16.0
    # Two sides lie a quarter of a pixel outside: a quarter of the first pixels is covered.
    low, high = -1.0 - 0.25 * step, 1.0 + 0.25 * step
    square = rj.Mesh(
        [[low, low, 0], [high, low, 0], [high, high, 0], [low, high, 0]], [[0, 1, 2], [0, 2, 3]]
    )
    frame = draw(square, camera, "only", size)
    share = shares_of(frame)
    assert share[0, 8] == share[-1, 8] == pytest.approx(0.25, abs=0.006)
    assert share[8, 0] == share[8, -1] == pytest.approx(0.25, abs=0.006)


def test_camera_inside_sees_lines_cut_at_the_near_plane(cube):
    camera = rj.PerspectiveCamera(eye=(0.9, 0.2, 0.9), target=(-1, 0, -1), near=0.5)
    share = shares_of(draw(cube, camera, "only"))
    assert 0.0 < share.mean() < 0.5


def test_lines_in_codes_are_those_in_light_mixed_otherwise(cube, camera):
    light = draw(cube, camera, "only")
    codes = draw(cube, camera, "only", quality=rj.Quality(lines="coverage", blending="srgb8"))
    share, own = shares_of(light), codes.color[..., 1].astype(int)
    np.testing.assert_allclose(own, 255.0 * (1.0 - share), rtol=0, atol=2.5)
    assert (codes.color[..., 0] == 255).all()


def test_plan_and_kernels_name_what_is_drawn(cube, camera, monkeypatch):
    def reason(quality):
        plan = rj.explain(wired(cube, "overlay"), camera, quality)
        return next(effect.reason for effect in plan.effects if effect.name == "wireframe")

    assert reason(rj.Quality()) == "mode overlay"
    assert reason(COVERAGE) == "mode overlay, by coverage"
    both = rj.Quality(lines="coverage", blending="srgb8")
    assert reason(both) == "mode overlay, by coverage, mixed in 8-bit sRGB codes"

    def refuse(*_):
        raise AssertionError("nobody asked for it")

    for name in ("project_lines", "list_lines", "cover_lines", "blend_lines"):
        monkeypatch.setattr(coverage, name, refuse)
    draw(cube, camera, quality=rj.Quality())
    plain = rj.Scene()
    plain.add(cube)
    rj.render(plain, camera, size=(16, 16), quality=COVERAGE)
    with pytest.raises(AssertionError, match="nobody asked"):
        draw(cube, camera)


def test_no_edges_draw_nothing():
    viewport = make_viewport((16, 70), 8)
    nothing = np.zeros((0, 4))
    geometry = Geometry(
        np.zeros((0, 3), np.int32), np.zeros((0, 2), np.int32), np.zeros(0, np.uint8), np.zeros(0),
        nothing, viewport,
    )  # fmt: skip
    color = np.full((70, 16, 4), 9, np.uint8)
    wireframe.cover_edges(
        np.zeros((0, 2), np.int32), geometry, (1.0, 0.0, 0.0), np.full(4, 255, np.uint8), color,
        None, 1.0, decoding_table().copy(), sharing.Workers(1),
    )  # fmt: skip
    assert (color == 9).all()
