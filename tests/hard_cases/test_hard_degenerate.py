"""Hard cases D01 to D16: faces that are degenerate, slivers, huge or not finite."""

from __future__ import annotations

import math

import naive
import numpy as np
import pytest
from screen_triangles import MAX, TILE, draw, draw_tile, owners, pixels, pixels_of

import rasterjit as rj
from rasterjit.inspect import oracle

SIZE = (64, 64)
NAN, INF = math.nan, math.inf
DENORMAL = 1e-310


def covered(positions, size=SIZE, **options):
    """Return where one triangle of clip positions is drawn, (H, W) bool."""
    return rj.rasterize(positions, [[0, 1, 2]], size, threads=1, **options).face_id == 0


# --- no area --------------------------------------------------------------------------------------


@pytest.mark.case("D01")
@pytest.mark.parametrize("points", [
    [(1, 1), (1, 1), (9, 9)], [(5, 5), (5, 5), (5, 5)], [(0, 0), (8, 8), (16, 16)],
])  # fmt: skip
def test_triangle_without_area_draws_nothing(points):
    seen = draw(points, [[0, 1, 2], [2, 0, 1], [2, 1, 0]], SIZE)
    assert (seen.face_id == -1).all()
    assert seen.totals.degenerate == 3
    assert not np.isnan(seen.depth).any()
    assert not seen.barycentric.any()


@pytest.mark.case("D02")
def test_sliver_between_the_centres_draws_nothing():
    points = [(0, 0), (100, 0.001), (100, 0.002)]
    assert oracle.snap_triangle(points) == ((0, 0), (25600, 0), (25600, 1))
    assert pixels(points, (128, 128)) == set()


@pytest.mark.case("D03")
def test_sliver_that_snaps_to_nothing_leaves_no_hole():
    points = [(0, 0.5), (100, 0.5005), (100, 0.4995), (0, 0), (100, 0), (100, 100), (0, 100)]
    a, b, c, upper_left, upper_right, lower_right, lower_left = range(7)
    assert pixels([points[a], points[b], points[c]], (128, 128)) == set()
    # In real arithmetic it covers a whole row of centres.
    assert all(oracle.covers([points[a], points[b], points[c]], (x + 0.5, 0.5)) for x in range(100))
    faces = [
        [a, b, c], [upper_left, upper_right, c], [upper_left, c, a], [a, b, lower_right],
        [a, lower_right, lower_left],
    ]  # fmt: skip
    seen = owners(points, faces, (128, 128))
    assert (seen[:100, :100] >= 0).all()
    assert (seen >= 0).sum() == 10_000


@pytest.mark.case("D04")
def test_sliver_one_step_high_owns_the_centres_on_its_top_edge():
    sliver = [(0, 0.5), (100, 0.5), (100, 0.50390625)]
    assert pixels(sliver, (128, 128)) == {(x, 0) for x in range(100)}


@pytest.mark.case("D05")
def test_sliver_one_step_wide_owns_the_centres_on_its_left_edge():
    right_of_them = [(0.5, 0), (0.50390625, 0), (0.5, 100)]
    left_of_them = [(0.5, 0), (0.49609375, 0), (0.5, 100)]
    assert pixels(right_of_them, (128, 128)) == {(0, y) for y in range(100)}
    assert pixels(left_of_them, (128, 128)) == set()


# --- huge -----------------------------------------------------------------------------------------


@pytest.mark.case("D06")
def test_area_beyond_32_bits_is_exact():
    width, height = MAX
    points = [(0, 0), (width, 0), (0, height), (width, height)]
    positions = naive.clip_from_screen(points, MAX)
    window = (8190, 8190, 8195, 8195)
    corner = 8192 - TILE  # the window lies around the corner of four tiles
    found = []
    for face in ([0, 1, 2], [1, 3, 2]):
        snapped = oracle.snap_triangle([points[n] for n in face])
        assert abs(oracle.edge(*snapped)) == 2**44  # nothing, in 32 bits
        tiles = [[draw_tile(positions, [face], 127 + i, 127 + j) for i in (0, 1)] for j in (0, 1)]
        drawn = {(x + corner, y + corner) for x, y in pixels_of(np.block(tiles))}
        exact = oracle.covered_pixels([points[n] for n in face], MAX, window=window)
        found.append({(x, y) for x, y in drawn if 8190 <= x < 8195 and 8190 <= y < 8195})
        assert found[-1] == exact
    assert found[0] == {
        (8190, 8190), (8190, 8191), (8190, 8192), (8191, 8190), (8191, 8191), (8192, 8190),
    }  # fmt: skip
    assert len(found[1]) == 19
    assert not found[0] & found[1]


HUGE = 1e30


@pytest.mark.case("D07")
def test_huge_coordinates_cover_the_image():
    spread = [[-HUGE, -HUGE, 0.0, 1.0], [HUGE, -HUGE, 0.0, 1.0], [0.0, HUGE, 0.0, 1.0]]
    assert covered(spread).sum() == 4096


@pytest.mark.case("D08")
def test_huge_coordinates_with_huge_w_are_ordinary():
    scaled = [[-HUGE, -HUGE, 0.0, HUGE], [HUGE, -HUGE, 0.0, HUGE], [0.0, HUGE, 0.0, HUGE]]
    assert covered(scaled).sum() == 2048
    assert pixels_of(covered(scaled), True) == pixels([(0, 64), (64, 64), (32, 0)], SIZE)


# --- not finite -----------------------------------------------------------------------------------


def beside_an_invalid_face(component, value):
    """Draw a face, and one that shares an edge with it and has an invalid vertex; then it alone."""
    good = naive.clip_from_screen([(0, 0), (64, 0), (0, 64), (64, 64)], SIZE)
    broken = good.copy()
    broken[3, component] = value
    both = rj.rasterize(broken, [[1, 3, 2], [0, 1, 2], [3, 2, 1]], SIZE, threads=1)
    alone = rj.rasterize(good, [[0, 1, 2]], SIZE, threads=1)
    return both, alone


def assert_only_the_valid_face(both, alone):
    assert both.totals.invalid == 2
    assert (both.face_id == np.where(alone.face_id == 0, 1, -1)).all()
    assert both.depth.tobytes() == alone.depth.tobytes()
    assert not np.isnan(both.depth).any()
    assert not np.isnan(both.barycentric).any()


@pytest.mark.case("D09")
@pytest.mark.parametrize("component", range(4))
def test_nan_drops_its_face_and_no_other(component):
    assert_only_the_valid_face(*beside_an_invalid_face(component, NAN))


@pytest.mark.case("D10")
@pytest.mark.parametrize("component", range(4))
@pytest.mark.parametrize("value", [INF, -INF, 1.01e150, -1e300])
def test_infinite_or_too_large_drops_its_face_and_no_other(value, component):
    # Of the outcomes that one may choose, this one: nothing is drawn, on no side.
    assert_only_the_valid_face(*beside_an_invalid_face(component, value))


@pytest.mark.case("D10")
def test_coordinates_up_to_the_limit_make_no_nan():
    rng = np.random.default_rng(5)
    signs = rng.choice([-1.0, 1.0], (300, 4))
    positions = signs * np.minimum(10.0 ** rng.uniform(-150, 150, (300, 4)), 1e150)
    seen = rj.rasterize(positions, np.arange(300).reshape(-1, 3), SIZE, threads=1)
    assert seen.totals.invalid == 0
    assert seen.totals.clipped > 0
    assert not np.isnan(seen.depth).any()
    assert not np.isnan(seen.barycentric).any()
    assert (np.abs(seen.depth[seen.face_id >= 0]) <= 1.0).all()


# --- tiny -----------------------------------------------------------------------------------------


@pytest.mark.case("D11")
def test_denormal_triangle_draws_nothing():
    corners = [[DENORMAL, 0, 0, 1], [0, DENORMAL, 0, 1], [-DENORMAL, 0, DENORMAL, 1]]
    seen = rj.rasterize(corners, [[0, 1, 2]], SIZE, threads=1)
    assert (seen.face_id == -1).all()
    assert seen.totals.degenerate == 1


@pytest.mark.case("D11")
def test_denormal_triangles_do_the_work_of_zeros():
    # "The same speed class": they are dropped at the same place, and reach no list.
    faces = np.arange(600).reshape(-1, 3)
    zeros = np.zeros((faces.size, 4))
    zeros[:, 3] = 1.0
    denormals = zeros.copy()
    denormals[:, :3] = DENORMAL * np.random.default_rng(0).uniform(-1, 1, (faces.size, 3))
    assert (denormals[:, :3] != 0.0).any()
    seen = [rj.rasterize(positions, faces, (8, 8), threads=1) for positions in (zeros, denormals)]
    assert seen[0].totals == seen[1].totals
    assert seen[1].totals.degenerate == len(faces)


@pytest.mark.case("D12")
def test_denormal_w_is_a_true_divisor():
    # 1 / w is infinite here; x / w is 0.5.
    tiny = np.array([[0.5, 0, 0, 1], [-0.5, 0.5, 0, 1], [-0.5, -0.75, 0, 1]]) * DENORMAL
    assert tiny[0].tolist() == [0.5e-310, 0.0, 0.0, 1e-310]
    with np.errstate(over="ignore"):
        assert np.isinf(1.0 / tiny[0, 3])
    assert pixels_of(covered(tiny), True) == pixels([(48, 32), (16, 16), (16, 56)], SIZE)


# --- w = 0 ----------------------------------------------------------------------------------------


@pytest.mark.case("D13")
@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_vertex_at_infinity_is_a_direction(zero):
    # Two corners, and the direction to the right: a band without end. Never divided.
    band = np.array([[-0.5, -0.5, 0.0, 1.0], [-0.5, 0.5, 0.0, 1.0], [1.0, 0.0, 0.0, zero]])
    seen = rj.rasterize(band, [[0, 1, 2]], SIZE, threads=1)
    assert pixels_of(seen.face_id) == {(x, y) for x in range(16, 64) for y in range(16, 48)}
    assert not np.isnan(seen.depth).any()


@pytest.mark.case("D13")
@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_vertex_at_the_eye_draws_nothing(zero, count):
    corners = np.array([[-0.5, -0.5, 0.0, 1.0], [-0.5, 0.5, 0.0, 1.0], [0.5, 0.0, 0.0, 1.0]])
    assert covered(corners).any()
    corners[:count] = zero
    seen = rj.rasterize(corners, [[0, 1, 2]], SIZE, threads=1)
    assert (seen.face_id == -1).all()
    assert not np.isnan(seen.depth).any()


@pytest.mark.case("D13")
@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_face_wholly_at_infinity_draws_nothing(zero):
    corners = np.array([[1.0, 0.0, 0.0, zero], [-1.0, 1.0, 0.0, zero], [-1.0, -1.0, 0.0, zero]])
    assert not covered(corners).any()


# --- scale ----------------------------------------------------------------------------------------


@pytest.mark.case("D14")
def test_homogeneous_scaling_changes_no_bit():
    rng = np.random.default_rng(14)
    positions = rng.normal(size=(240, 4)) * [1.0, 1.0, 0.7, 0.5] + [0.0, 0.0, 0.0, 1.0]
    faces = np.arange(240).reshape(-1, 3)
    one = rj.rasterize(positions, faces, SIZE, threads=1)
    assert one.totals.clipped > 5
    assert (one.face_id >= 0).any()
    for k in range(-20, 21):
        scaled = rj.rasterize(positions * 2.0**k, faces, SIZE, threads=1)
        assert scaled.face_id.tobytes() == one.face_id.tobytes()
        assert scaled.depth.tobytes() == one.depth.tobytes()
        np.testing.assert_array_equal(scaled.barycentric, one.barycentric)


@pytest.mark.case("D14")
def test_scaling_each_vertex_by_itself_changes_no_bit():
    rng = np.random.default_rng(41)
    positions = np.append(rng.uniform(-1.2, 1.2, (240, 2)), rng.uniform(-1, 1, (240, 1)), axis=1)
    positions = np.append(positions, np.ones((240, 1)), axis=1)
    faces = np.arange(240).reshape(-1, 3)
    powers = 2.0 ** rng.integers(-20, 21, (240, 1))
    one = rj.rasterize(positions, faces, SIZE, threads=1)
    scaled = rj.rasterize(positions * powers, faces, SIZE, threads=1)
    assert one.totals.clipped == 0  # a plane cuts scaled ends elsewhere, by rounding
    assert scaled.face_id.tobytes() == one.face_id.tobytes()
    assert scaled.depth.tobytes() == one.depth.tobytes()


# --- the border -----------------------------------------------------------------------------------

SQUARE = np.array([(0, 0), (64, 0), (64, 64), (0, 64)], float)
HALVES = [[0, 1, 2], [0, 2, 3]]


@pytest.mark.case("D15")
@pytest.mark.parametrize("gap", [0.25, 0.0])
@pytest.mark.parametrize("side", [(-1, 0), (1, 0), (0, -1), (0, 1)])
def test_box_beside_the_image_draws_nothing(side, gap):
    seen = draw(SQUARE + np.array(side) * (64 + gap), HALVES, SIZE)
    assert (seen.face_id == -1).all()
    assert seen.totals.drawn == 0  # so no tile, row or column of it was ever looked for


@pytest.mark.case("D15")
@pytest.mark.parametrize(("side", "owned"), [
    ((-1, 0), set()), ((1, 0), {(63, y) for y in range(64)}),
    ((0, -1), set()), ((0, 1), {(x, 63) for x in range(64)}),
])  # fmt: skip
def test_border_through_centres_is_in_at_left_and_top_alone(side, owned):
    # The square reaches half a pixel into the image, to the centres beside its border.
    points = SQUARE + np.array(side) * 63.5
    seen = owners(points, HALVES, SIZE)
    assert pixels_of(seen >= 0, True) == owned


@pytest.mark.case("D15")
def test_box_from_the_first_to_the_last_centre_leaves_out_right_and_bottom():
    seen = owners(np.clip(SQUARE, 0.5, 63.5), HALVES, SIZE)
    assert pixels_of(seen >= 0, True) == {(x, y) for x in range(63) for y in range(63)}


# --- nothing, or nothing sensible -----------------------------------------------------------------

CORNERS = np.array([[-1.0, -1.0, 0.0, 1.0], [1.0, -1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]])
NO_FACES = np.zeros((0, 3), int)


@pytest.mark.case("D16")
@pytest.mark.parametrize(("call", "message"), [
    (lambda: rj.rasterize(CORNERS, NO_FACES, SIZE), "no faces"),
    (lambda: rj.rasterize(np.zeros((0, 4)), NO_FACES, SIZE), "no faces"),
    (lambda: rj.Mesh(CORNERS[:, :3], NO_FACES), "no faces"),
    (lambda: rj.Mesh(np.zeros((0, 3)), NO_FACES), "no vertices"),
])  # fmt: skip
def test_empty_mesh_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.case("D16")
@pytest.mark.parametrize("size", [(0, 0), (0, 5), (5, 0), (-1, 5)])
def test_size_without_pixels_is_refused(size):
    mesh = rj.Mesh(CORNERS[:, :3], [[0, 1, 2]])
    for call in (
        lambda: rj.rasterize(CORNERS, [[0, 1, 2]], size),
        lambda: rj.render(mesh, size=size),
        lambda: rj.Framebuffer(*size),
    ):
        with pytest.raises(ValueError, match=r"size|width, height"):
            call()


@pytest.mark.case("D16")
@pytest.mark.parametrize("index", [3, -1, 2**31, 2**32, -(2**63)])
def test_index_out_of_range_is_refused(index):
    faces = [[0, 1, 2], [0, 1, index]]
    for call in (
        lambda: rj.rasterize(CORNERS, faces, SIZE),
        lambda: rj.Mesh(CORNERS[:, :3], faces),
    ):
        with pytest.raises(ValueError, match="faces must"):
            call()
