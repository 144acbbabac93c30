"""Hard cases of interpolation, I01 to I10."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
import screen
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads

SIZE = (16, 16)
I01 = [(0, 0), (16, 0), (0, 16)]
WS = (1.0, 4.0, 2.0)
FACE = [[0, 1, 2]]

# Pixel -> weights and w, for w = 1, 4, 2 at the vertices.
PERSPECTIVE = {
    (0, 0): ("40/41", "1/123", "2/123", "128/123"),
    (4, 4): ("56/83", "9/83", "18/83", "128/83"),
    (8, 2): ("40/67", "17/67", "10/67", "128/67"),
    (2, 8): ("40/79", "5/79", "34/79", "128/79"),
    (14, 0): ("8/39", "29/39", "2/39", "128/39"),
    (0, 14): ("8/67", "1/67", "58/67", "128/67"),
    (7, 7): ("8/53", "15/53", "30/53", "128/53"),
}
AFFINE = {
    (0, 0): ("15/16", "1/32", "1/32"),
    (4, 4): ("7/16", "9/32", "9/32"),
    (7, 7): ("1/16", "15/32", "15/32"),
}


def see(w, outputs, **attributes):
    """Render the triangle of I01 with vertices at the distances w."""
    shown = screen.mesh(I01, FACE, SIZE, w, **attributes)
    near = min(np.broadcast_to(w, 3).tolist())
    return rj.render(shown, screen.camera(near), size=SIZE, outputs=outputs, threads=1)


def half_up(linear):
    """Return 8-bit codes of values 0..1 as they are, rounded half up."""
    return np.floor(255.0 * linear.astype(float) + 0.5).tolist()


@pytest.mark.case("I01")
def test_perspective_weights_are_those_of_exact_arithmetic():
    seen = screen.draw(I01, FACE, SIZE, w=WS)
    frame = see(WS, ("barycentric", "depth"))
    for (column, row), (*weights, w) in PERSPECTIVE.items():
        exact = [Fraction(weight) for weight in weights]
        assert list(rj.oracle.perspective_weights(I01, WS, screen.centre(column, row))) == exact
        assert sum(b * Fraction(at) for b, at in zip(exact, WS, strict=True)) == Fraction(w)
        rounded = [np.float32(float(weight)) for weight in exact]
        assert seen.barycentric[row, column].tolist() == rounded
        assert frame.barycentric[row, column].tolist() == rounded
        # The depth output is w. It is 1 / w that is stored, so that it is rounded twice.
        stored = np.float32(float(1 / Fraction(w)))
        assert frame.depth[row, column] == np.float32(1.0 / np.float64(stored))


@pytest.mark.case("I02")
def test_affine_weights_are_those_of_exact_arithmetic():
    for w in (1.0, 2.0):
        seen = screen.draw(I01, FACE, SIZE, w=w)
        for (column, row), weights in AFFINE.items():
            exact = [Fraction(weight) for weight in weights]
            assert list(rj.oracle.affine_weights(I01, screen.centre(column, row))) == exact
            assert seen.barycentric[row, column].tolist() == [float(weight) for weight in exact]


@pytest.mark.case("I03")
@pytest.mark.parametrize(("w", "codes"), [(WS, [172, 28, 55]), (1.0, [112, 72, 72])])
def test_colour_is_perspective_correct(w, codes):
    frame = see(w, ("linear",), colors=np.eye(3))
    assert half_up(frame.linear[4, 4, :3]) == codes


@pytest.mark.case("I04")
@pytest.mark.parametrize(
    "w", [1.0, WS, (0.25, 8.0, 1024.0), (2.0**-20, 1.0, 1.0), (2.0**-60, 1.0, 2.0**60)]
)
def test_constant_attribute_stays_exactly_constant(w):
    third = np.float32(1 / 3)
    frame = see(
        w, ("uv", "linear", "face_id"), uv=np.full((3, 2), third), colors=np.full((3, 3), third)
    )
    hit = frame.face_id == 0
    assert hit.sum() == 120
    assert (frame.uv[hit] == third).all()
    assert (frame.linear[hit][:, :3] == third).all()


coordinate = st.integers(-20 * 256, 36 * 256).map(lambda n: n / 256)
point = st.tuples(coordinate, coordinate)


@pytest.mark.case("I05")
@settings(max_examples=60)
@given(point, point, point, st.tuples(*[st.integers(-20, 20)] * 3))
def test_weights_are_a_partition_of_one(a, b, c, exponents):
    seen = screen.draw([a, b, c], FACE, SIZE, w=2.0 ** np.array(exponents))
    drawn = seen.barycentric[seen.face_id == 0].astype(float)
    assert ((drawn >= 0.0) & (drawn <= 1.0)).all()
    assert (np.abs(drawn.sum(axis=1) - 1.0) <= 2 * np.spacing(np.float32(1.0))).all()
    assert (seen.barycentric[seen.face_id < 0] == 0.0).all()


@pytest.mark.case("I05")
def test_no_colour_is_extrapolated():
    # Slivers whose pixels lie on the edge from the second vertex to the third: the first has the
    # weight 0, and 1 less the other two weights may round below it.
    rng = np.random.default_rng(5)
    size, drawn = (64, 64), 0
    for _ in range(60):
        a = rng.integers(20, 44, 2) + 0.5
        b = a + 12 * rng.choice([-3, -2, -1, 1, 2, 3], 2)
        points = [(a + b) / 2 + rng.integers(-3, 4, 2) / 256, a, b]
        shown = screen.mesh(points, FACE, size, 2.0 ** rng.integers(-9, 10, 3), colors=np.eye(3))
        frame = rj.render(
            shown, screen.camera(2.0**-9), size=size, outputs=("linear", "face_id"), threads=1
        )
        linear = frame.linear[frame.face_id == 0]
        assert ((linear >= 0.0) & (linear <= 1.0)).all()
        drawn += len(linear)
    assert drawn > 200


SLIVERS = [
    (
        [(1900.25, 1000.25), (1900.7578125, 1000.25), (1900.5, 1000.75)],
        (0, 1, 0.5), (1900, 1000), (2048, 1024), "129/260",
    ),
    (
        [(16000.49609375, 9000), (16000.50390625, 9000), (16000.5, 9001)],
        (0, 1, 0), (16000, 9000), (16384, 16384), "1/4",
    ),
    (
        [(16000.49609375, 9000), (16000.50390625, 9000), (16000.5, 9001)],
        (0, 1, 0.5), (16000, 9000), (16384, 16384), "1/2",
    ),
    (
        [(4000.46875, 10), (4000.53125, 10), (4000.5, 1000)],
        (0, 1, 0), (4000, 500), (4096, 1024), "111/440",
    ),
]  # fmt: skip


@pytest.mark.case("I06")
@pytest.mark.parametrize(("points", "values", "pixel", "size", "want"), SLIVERS)
def test_slivers_far_from_the_origin_lose_nothing(points, values, pixel, size, want):
    column, row = pixel
    exact = rj.oracle.affine_weights(screen.corners(points), screen.centre(*pixel))
    assert rj.oracle.interpolate(exact, values) == Fraction(want)
    window = (column, row, column + 1, row + 1)
    assert rj.oracle.covered_pixels(points, size, window=window) == {pixel}
    # One pixel of a large image: the kernel fills its row alone.
    geometry = geometry_of(points, 1.0, size)
    face_id = np.zeros((row + 1, column + 1), np.int32)  # Other rows take no memory.
    face_id[row, :column] = -1
    filled = np.empty((*face_id.shape, 1), np.float32)
    attribute = np.array(values, np.float32)[:, None]
    whole = geometry
    barycentric.fill_attribute(face_id, (row, row + 1), whole, attribute, filled)
    assert filled[row, column, 0] == np.float32(float(Fraction(want)))


def geometry_of(points, w, size):
    """Return what the kernels know of one face of screen points."""
    positions = screen.naive.clip_from_screen(points, size, 0.0, w)
    viewport = make_viewport(size, 8)
    projected, _ = visibility_pass.project_to_screen(
        positions, (0.0, -1.0, 0.0), viewport, threads.Workers(1)
    )
    return Geometry(
        np.array(FACE, np.int32), projected.xy, projected.codes, projected.w, positions, viewport
    )


def strip(w_ratio, columns):
    """Return u across the image of a strip whose w grows from 1 to the ratio; u from 0 to 1."""
    points = [(0, 0), (columns, 0), (columns, 2), (0, 2)]
    w = np.array([1.0, w_ratio, w_ratio, 1.0])
    uv = np.array([(0, 0), (1, 0), (1, 0), (0, 0)])
    shown = screen.mesh(points, [[0, 1, 2], [0, 2, 3]], (columns, 2), w, uv=uv)
    frame = rj.render(
        shown, screen.camera(1.0), size=(columns, 2), outputs=("uv", "face_id"), threads=1
    )
    assert (frame.face_id >= 0).all()
    assert (frame.uv[0] == frame.uv[1]).all()
    return frame.uv[0, :, 0].astype(float)


def largest_error(w_ratio):
    """Return the largest difference of affine and perspective interpolation along an edge."""
    root = math.sqrt(w_ratio)
    return (root - 1.0) / (root + 1.0)


COLUMNS = 2048
"""Pixels across a strip: at a ratio of 100 the largest difference of all lies within 0.00003 of
that at a pixel's centre."""
BETWEEN_CENTRES = 3e-5


@pytest.mark.case("I07")
@pytest.mark.parametrize(
    ("w_ratio", "table"), [(1.1, 0.0238), (2, 0.1716), (4, 1 / 3), (10, 0.519), (100, 0.818)]
)
def test_affine_interpolation_errs_by_the_formula(w_ratio, table):
    assert abs(largest_error(w_ratio) - table) <= 5e-4
    perspective, affine = strip(w_ratio, COLUMNS), strip(1.0, COLUMNS)
    t = (np.arange(COLUMNS) + 0.5) / COLUMNS
    assert (affine == t).all()
    # Two roundings of a number below one: of the exact value, and of the one compared with.
    exact = t / (w_ratio * (1.0 - t) + t)
    assert np.abs(perspective - exact).max() <= np.spacing(np.float32(1.0))
    error = np.abs(affine - perspective).max()
    assert largest_error(w_ratio) - BETWEEN_CENTRES <= error
    assert error <= largest_error(w_ratio) + np.spacing(np.float32(1.0))


@pytest.mark.case("I07")
@pytest.mark.parametrize(
    ("steps", "within", "beyond"), [(0.5, 1.00787, 1.00789), (1, 1.01581, 1.01583)]
)
def test_affine_interpolation_stays_below_an_8_bit_step_up_to_a_ratio(steps, within, beyond):
    affine = strip(1.0, COLUMNS)
    assert 255.0 * np.abs(affine - strip(within, COLUMNS)).max() < steps
    assert 255.0 * np.abs(affine - strip(beyond, COLUMNS)).max() > steps


EDGE_OF_A_CELL = 0.02
"""Distance from the edge of a checkerboard's cell, texels, from which on its parity is certain."""


@pytest.mark.case("I08")
@pytest.mark.parametrize("is_clipped", [False, True])
def test_checkerboard_on_the_ground_has_the_right_parity(is_clipped):
    size = (64, 64)
    # Row j sees the plane y = -1 at a distance of 64 / (2 j - 63). One quad just fills the lower
    # half of the image down to its bottom; one reaches behind the eye and beyond both sides.
    ends = ((1.0, -1.0), (128.0, -128.0)) if not is_clipped else ((200.0, 50.0), (200.0, -200.0))
    (near_x, near_z), (far_x, far_z) = ends
    vertices = [
        (-near_x, -1, near_z), (near_x, -1, near_z), (far_x, -1, far_z), (-far_x, -1, far_z)
    ]  # fmt: skip
    uv = [(x, z) for x, _, z in vertices]
    ground = rj.Mesh(vertices, [[0, 1, 2], [0, 2, 3]], uv=uv)
    frame = rj.render(
        ground, screen.camera(2.0**-10), size=size, outputs=("uv", "depth", "face_id"), threads=1
    )
    assert frame.stats.clipped == (2 if is_clipped else 0)
    assert (frame.face_id[:32] == -1).all()
    checked = 0
    for row in range(32, 64):
        distance = Fraction(64, 2 * row - 63)
        for column in range(64):
            if frame.face_id[row, column] < 0:
                continue
            u, v = (Fraction(2 * column + 1, 64) - 1) * distance, -distance
            if min(abs(u - round(u)), abs(v - round(v))) <= EDGE_OF_A_CELL:
                continue
            drawn = np.floor(frame.uv[row, column].astype(float)).astype(int)
            assert drawn.sum() % 2 == (math.floor(u) + math.floor(v)) % 2
            checked += 1
    assert checked > 1500


I09 = [(-0.4, -0.4), (0.4, -0.4), (0.0, 0.4)]
I09_WS = (10.0, 10.0, 20.0)
# Of the column in the middle, rows 3 to 7: the others lie outside the triangle.
I09_AFFINE = (19.5455, 17.2727, 15.0, 12.7273, 10.4545)
I09_PERSPECTIVE = (19.1304, 15.7143, 13.3333, 11.5789, 10.2326)
TABLE_DIGITS = 5e-5
"""Half of the last digit of the table."""


def z_down_the_middle(scale):
    """
    Return affine and perspective-correct z of the table's pixels.

    In an image of ``11 * scale`` pixels a side, ``scale`` odd, the centres of the table's pixels
    are centres too.
    """
    size = (11 * scale, 11 * scale)
    # Depth z / w is linear on the screen: with w = 1 it is the affine z. They fit -1..1 in 1/32.
    flat = [(x, y, z / 32.0, 1.0) for (x, y), z in zip(I09, I09_WS, strict=True)]
    affine = 32.0 * rj.rasterize(flat, FACE, size, threads=1).depth.astype(float)
    vertices = [(x * w, y * w, -w) for (x, y), w in zip(I09, I09_WS, strict=True)]
    frame = rj.render(
        rj.Mesh(vertices, FACE), screen.camera(1.0), size=size, outputs=("depth",), threads=1
    )
    middle = 5 * scale + scale // 2
    rows = [row * scale + scale // 2 for row in range(3, 8)]
    return affine[rows, middle], frame.depth[rows, middle].astype(float)


@pytest.mark.case("I09")
def test_table_of_pytorch3d_where_its_vertices_are_on_the_grid():
    # Vertices are at multiples of half a pixel here: 16.5, 27.5 and 38.5.
    affine, perspective = z_down_the_middle(5)
    assert np.abs(affine - I09_AFFINE).max() <= TABLE_DIGITS
    assert np.abs(perspective - I09_PERSPECTIVE).max() <= TABLE_DIGITS


@pytest.mark.case("I09")
def test_table_of_pytorch3d_with_snapped_vertices():
    points = [(3.3, 7.7), (7.7, 7.7), (5.5, 3.3)]
    corners = screen.corners(points)
    affine, perspective = z_down_the_middle(1)
    for n, row in enumerate(range(3, 8)):
        point = screen.centre(5, row)
        flat = rj.oracle.depth_at(corners, I09_WS, point)
        deep = rj.oracle.interpolate(rj.oracle.perspective_weights(corners, I09_WS, point), I09_WS)
        # 1 / w and w are float32, one rounding each; z is one.
        assert abs(affine[n] - flat) <= np.spacing(np.float32(flat)) / 2
        assert abs(perspective[n] - deep) <= np.spacing(np.float32(deep))
        # Snapping moved the plane by at most half a grid unit along its slope, 10 in 4.4 pixels
        # (at the far end the perspective one is twice as steep).
        moved = 10 / 4.4 / 512
        assert abs(affine[n] - I09_AFFINE[n]) <= moved + TABLE_DIGITS
        assert abs(perspective[n] - I09_PERSPECTIVE[n]) <= 2 * moved + TABLE_DIGITS


@pytest.mark.case("I10")
@pytest.mark.parametrize("tiny", [1e-6, 2.0**-20, 1e-30, 1e-140])
def test_tiny_w_overflows_nothing(tiny):
    ws = (tiny, 1.0, 1.0)
    seen = screen.draw(I01, FACE, SIZE, w=ws)
    geometry = geometry_of(I01, ws, SIZE)
    for column, row in screen.covered(seen)[::7]:
        exact = rj.oracle.perspective_weights(I01, ws, screen.centre(column, row))
        weights = barycentric.compute_sample_weights(0, 1, 2, column, row, geometry)
        for have, kernel, want in zip(seen.barycentric[row, column], weights, exact, strict=True):
            assert abs(Fraction(kernel) - want) <= Fraction(10) ** -12 * want
            # As float32 it is a rounding of that, 0 where it is too small for one.
            assert screen.is_rounded(have, want, Fraction(10) ** -12 * want)
    assert (seen.face_id == 0).sum() == 120


@pytest.mark.case("I10")
@pytest.mark.parametrize("turn", [0, 1, 2])
@pytest.mark.parametrize("ws", [(2.0**-660, 2.0**460, 2.0**459), (2.0**-1070, 2.0**30, 2.0**30)])
def test_on_the_edge_opposite_a_tiny_w_the_others_share_the_weight(ws, turn):
    # The vertex with the smallest w has no part in these samples; its w over theirs is 0 in floats.
    points = [(8.0, 12.0), (2.5, 4.5), (14.5, 4.5)]
    seen = screen.draw(points, np.roll(FACE, turn, axis=1), SIZE, w=ws)
    for column in range(3, 14):
        exact = rj.oracle.perspective_weights(points, ws, screen.centre(column, 4))
        have = np.roll(seen.barycentric[4, column], -turn)
        assert have[0] == exact[0] == 0
        for share, want in zip(have[1:], exact[1:], strict=True):
            assert 0 < want < 1
            assert screen.is_rounded(share, want, 8 * screen.UNIT * want)
