import math
import re
from decimal import Decimal, getcontext
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from rasterjit.scene import transforms as tf

BLOCK = 16384


def decimal_pi() -> Decimal:
    """Machin's formula, independent of the constant under test."""

    def arctan_inverse(n: int) -> Decimal:
        return sum(
            (Decimal((-1) ** k) / ((2 * k + 1) * Decimal(n) ** (2 * k + 1)) for k in range(60)),
            Decimal(0),
        )

    return 4 * (4 * arctan_inverse(5) - arctan_inverse(239))


def decimal_sine_cosine(degrees: float) -> tuple[float, float]:
    getcontext().prec = 60
    x = Decimal(degrees) * decimal_pi() / 180
    sine = cosine = Decimal(0)
    term = Decimal(1)
    for k in range(0, 120, 2):
        sign = (-1) ** (k // 2)
        cosine += sign * term
        term = term * x / (k + 1)
        sine += sign * term
        term = term * x / (k + 2)
    return float(sine), float(cosine)


def homogeneous_by_hand(matrix, points):
    rows = np.asarray(matrix, dtype=np.float64).tolist()
    return [
        [((m0 * x + m1 * y) + m2 * z) + m3 for m0, m1, m2, m3 in rows]
        for x, y, z in np.asarray(points, dtype=np.float64).tolist()
    ]


def camera_like_matrix():
    return tf.compose(
        tf.perspective(50.0, 1.5, 0.1, 100.0),
        tf.look_at((3.0, 2.0, 5.0), (0.0, 0.1, 0.0), (0.0, 1.0, 0.0)),
        tf.shear(xy=0.3, zx=-0.7),
    )


# --- Angles


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        (0, (0, 1)),
        (90, (1, 0)),
        (180, (0, -1)),
        (270, (-1, 0)),
        (-90, (-1, 0)),
        (360e6 + 90, (1, 0)),
        (30, (0.5, math.sqrt(3) / 2)),
        (60, (math.sqrt(3) / 2, 0.5)),
        (120, (math.sqrt(3) / 2, -0.5)),
        (45, (math.sqrt(0.5), math.sqrt(0.5))),
        (135, (math.sqrt(0.5), -math.sqrt(0.5))),
    ],
)
def test_special_angles_are_exact(degrees, expected):
    assert tf.sine_cosine(degrees) == expected


@pytest.mark.parametrize("degrees", [-360, -180, -90, -0.0, 90, 180, 270, 360])
def test_zeros_of_sine_and_cosine_are_positive(degrees):
    assert 0.0 in tf.sine_cosine(degrees)
    assert all(math.copysign(1, v) == 1 for v in tf.sine_cosine(degrees) if v == 0)


def test_sine_and_cosine_are_correctly_rounded():
    angles = np.random.default_rng(1).uniform(-180.0, 180.0, 200).tolist()
    for degrees in [*angles, 1e-12, 89.99999999, 179.9999999]:
        assert tf.sine_cosine(degrees) == decimal_sine_cosine(degrees)


def test_tiny_angles_keep_their_relative_precision():
    sine, cosine = tf.sine_cosine(1e-200)
    assert sine == pytest.approx(math.pi / 180 * 1e-200, rel=1e-15)
    assert cosine == 1.0


@pytest.mark.parametrize("rotation", [tf.rotate_x, tf.rotate_y, tf.rotate_z])
@pytest.mark.parametrize("quarters", [-3, -2, -1, 0, 1, 2, 3, 4, 1000001])
def test_quarter_turns_are_exact(rotation, quarters):
    matrix = rotation(90.0 * quarters)
    assert set(np.abs(matrix).ravel().tolist()) == {0.0, 1.0}
    assert not np.signbit(matrix[matrix == 0.0]).any()
    assert np.array_equal(tf.compose(*[rotation(90.0)] * (quarters % 4)), matrix)


@pytest.mark.parametrize(
    ("rotation", "source", "expected"),
    [
        (tf.rotate_x, (0, 1, 0), (0, 0, 1)),
        (tf.rotate_y, (0, 0, 1), (1, 0, 0)),
        (tf.rotate_z, (1, 0, 0), (0, 1, 0)),
    ],
)
def test_positive_angles_are_right_handed(rotation, source, expected):
    assert np.array_equal(tf.apply(rotation(90.0), source), expected)


# --- Model matrices


def test_rotation_about_a_diagonal_permutes_the_axes():
    matrix = tf.rotate((1, 1, 1), 120.0)
    permutation = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
    np.testing.assert_allclose(matrix, permutation, atol=4e-16)


def test_rotation_keeps_lengths_and_its_axis():
    rng = np.random.default_rng(2)
    for _ in range(50):
        axis, degrees = rng.normal(size=3), rng.uniform(-720, 720)
        matrix = tf.rotate(axis, degrees)
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(4), atol=2e-15)
        np.testing.assert_allclose(tf.apply(matrix, axis), axis, rtol=1e-14)
        assert np.trace(matrix[:3, :3]) == pytest.approx(
            1 + 2 * math.cos(math.radians(degrees)), abs=1e-12
        )


@pytest.mark.parametrize("length", [1e-300, 1e-160, 1.0, 1e160, 1e300])
def test_length_of_the_axis_does_not_matter(length):
    assert np.allclose(tf.rotate((length, length, 0), 33), tf.rotate((1, 1, 0), 33), atol=1e-15)


def test_translate_moves_and_scale_mirrors():
    assert tf.apply(tf.translate((1, 2, 3)), (10, 20, 30)).tolist() == [11, 22, 33]
    assert tf.apply(tf.scale(2), (1, 2, 3)).tolist() == [2, 4, 6]
    assert tf.apply(tf.scale((-1, 2, 0.5)), (1, 2, 4)).tolist() == [-1, 4, 2]


@pytest.mark.parametrize("name", ["xy", "xz", "yx", "yz", "zx", "zy"])
def test_shear_adds_the_second_coordinate_to_the_first(name):
    point = np.array([2.0, 3.0, 5.0])
    to, by = "xyz".index(name[0]), "xyz".index(name[1])
    expected = point.copy()
    expected[to] += 7.0 * point[by]
    assert np.array_equal(tf.apply(tf.shear(**{name: 7.0}), point), expected)


def test_shears_together_read_the_unsheared_point():
    matrix = tf.shear(xy=1, xz=2, yx=3, yz=4, zx=5, zy=6)
    assert matrix[:3, :3].tolist() == [[1, 1, 2], [3, 1, 4], [5, 6, 1]]


def test_compose_of_nothing_is_the_identity():
    assert np.array_equal(tf.compose(), np.eye(4))
    assert np.array_equal(tf.identity(), np.eye(4))


def test_compose_applies_the_leftmost_last():
    matrix = tf.compose(tf.translate((1, 0, 0)), tf.rotate_z(90), tf.scale((2, 1, 1)))
    assert tf.apply(matrix, (1, 0, 0)).tolist() == [1, 2, 0]


def test_compose_sums_each_entry_left_to_right():
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(size=(3, 4, 4)) * 10.0 ** rng.integers(-9, 9, (3, 4, 4))

    def product(left, right):
        entries = [
            [
                ((r[0] * right[0][k] + r[1] * right[1][k]) + r[2] * right[2][k])
                + r[3] * right[3][k]
                for k in range(4)
            ]
            for r in left
        ]
        return entries

    expected = product(product(a.tolist(), b.tolist()), c.tolist())
    assert tf.compose(a, b, c).tolist() == expected


# --- Camera


def test_look_at_puts_eye_at_origin_and_target_on_minus_z():
    view = tf.look_at((2, 3, 5), (-1, 0, 4), (0, 1, 0))
    np.testing.assert_allclose(tf.apply(view, (2, 3, 5)), 0, atol=1e-15)
    np.testing.assert_allclose(
        tf.apply(view, (-1, 0, 4)), (0, 0, -math.sqrt(19)), rtol=1e-15, atol=1e-15
    )
    up = tf.apply(view, (2, 4, 5))
    assert up[0] == pytest.approx(0, abs=1e-15)
    assert up[1] > 0


def test_look_at_down_minus_z_is_a_translation():
    assert np.array_equal(tf.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0)), tf.translate((0, 0, -4)))


def test_focal_length_is_exact_at_90_and_accurate_everywhere():
    assert tf.perspective(90, 2, 1, 10)[1, 1] == 1.0
    assert tf.perspective(90, 2, 1, 10)[0, 0] == 0.5
    for fov in (1e-9, 1.0, 30.0, 45.0, 89.0, 91.0, 120.0, 179.0, 179.999999):
        sine, cosine = decimal_sine_cosine(fov / 2)
        assert tf.focal_length(fov) == pytest.approx(cosine / sine, rel=5e-16)


@pytest.mark.parametrize("far", [0.25000001, 10.0, 1e9, math.inf])
def test_near_and_far_plane_map_to_minus_and_plus_one(far):
    matrix = tf.perspective(60, 1, 0.25, far)
    tolerance = 1e-15 * (1 + (0.25 / (far - 0.25) if far < math.inf else 0))
    assert tf.apply(matrix, (0, 0, -0.25))[2] == pytest.approx(-1, abs=8 * tolerance)
    if far < math.inf:
        assert tf.apply(matrix, (0, 0, -far))[2] == pytest.approx(1, abs=8 * tolerance)
    else:
        assert tf.apply(matrix, (0, 0, -1e300))[2] == 1.0


def test_infinite_far_has_finite_entries_and_orders_by_w():
    matrix = tf.perspective(45, 1, 0.1, math.inf)
    assert np.isfinite(matrix).all()
    clip = tf.transform_points(matrix, [(0, 0, -1e3), (0, 0, -1e3 - 1)])
    assert 0.1 / clip[0, 3] > 0.1 / clip[1, 3]


def test_depth_row_matches_rational_arithmetic():
    for near, far in ((1, 10), (0.1, 1e5), (0.1, 1e9), (5, 6)):
        n, f = Fraction(near), Fraction(far)
        scale, offset = tf.perspective_depth(near, far)
        assert scale == pytest.approx(float(-(f + n) / (f - n)), rel=4e-16)
        assert offset == pytest.approx(float(-2 * f * n / (f - n)), rel=4e-16)


def test_perspective_focal_projects_onto_the_view_plane():
    matrix = tf.perspective_focal(2.0)
    assert matrix.tolist() == [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, -0.5, 0]]
    assert tf.apply(matrix, (3, 5, -4)).tolist() == [1.5, 2.5, -2]


def test_orthographic_maps_its_box_to_the_cube():
    matrix = tf.orthographic(-2, 6, 1, 5, 3, 11)
    assert tf.apply(matrix, (-2, 1, -3)).tolist() == [-1, -1, -1]
    assert tf.apply(matrix, (6, 5, -11)).tolist() == [1, 1, 1]
    assert tf.apply(matrix, (2, 3, -7)).tolist() == [0, 0, 0]


def test_viewport_edges_reach_the_corners_of_the_image():
    matrix = tf.viewport(640, 480)
    assert np.array_equal(matrix, tf.viewport(640, 480, "edges"))
    assert tf.apply(matrix, (-1, 1, 0.25)).tolist() == [0, 0, 0.25]
    assert tf.apply(matrix, (1, -1, -0.5)).tolist() == [640, 480, -0.5]
    assert matrix[0, 0] == 320


def test_viewport_centers_reach_the_centres_of_the_outer_pixels():
    matrix = tf.viewport(640, 480, "centers")
    assert tf.apply(matrix, (-1, 1, 0.25)).tolist() == [0.5, 0.5, 0.25]
    assert tf.apply(matrix, (1, -1, 0.25)).tolist() == [639.5, 479.5, 0.25]
    assert matrix[0, 0] == 639 / 2


# --- Normals


def test_normal_matrix_is_the_inverse_transpose():
    rng = np.random.default_rng(6)
    for exponent in (-200, -100, 0, 100):
        matrix = np.eye(4)
        matrix[:3, :3] = rng.normal(size=(3, 3))
        expected = np.linalg.inv(matrix[:3, :3]).T * 10.0**-exponent
        matrix[:3, :3] *= 10.0**exponent
        np.testing.assert_allclose(tf.normal_matrix(matrix), expected, rtol=1e-12)
    assert tf.normal_matrix(tf.scale((2, 4, -8))).tolist() == np.diag([0.5, 0.25, -0.125]).tolist()


@pytest.mark.parametrize("thickness", [0.0, 5e-324, -1e-310, 1e-300])
def test_normal_matrix_of_a_thin_matrix_is_finite_and_keeps_the_side(thickness):
    matrix = tf.normal_matrix(np.diag([1.0, 1.0, thickness, 1.0]))
    assert np.isfinite(matrix).all()
    assert matrix[2, 2] * math.copysign(1.0, thickness) > 0


def fraction_inverse(matrix):
    """Return the exact inverse, by minors, rounded."""
    rows = [[Fraction(entry) for entry in row] for row in matrix.tolist()]

    def minor(square, i, j):
        return [row[:j] + row[j + 1 :] for n, row in enumerate(square) if n != i]

    def determinant(square):
        if len(square) == 1:
            return square[0][0]
        first = enumerate(square[0])
        return sum((-1) ** j * entry * determinant(minor(square, 0, j)) for j, entry in first)

    whole = determinant(rows)
    places = range(len(rows))
    return np.array(
        [
            [float((-1) ** (i + j) * determinant(minor(rows, j, i)) / whole) for j in places]
            for i in places
        ]
    )


def test_inverse_undoes_a_matrix_whose_rows_differ_in_size():
    rng = np.random.default_rng(7)
    for _ in range(200):
        matrix = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-9, 9, (4, 1))
        exact = fraction_inverse(matrix)
        error = np.abs(tf.inverse(matrix) - exact).max(axis=0) / np.abs(exact).max(axis=0)
        assert error.max() < 1e-15 * np.linalg.cond(matrix / np.abs(matrix).max(axis=1)[:, None])


def test_inverse_is_exact_where_it_can_be():
    matrix = tf.compose(tf.translate((1, -2, 3)), tf.rotate_y(90), tf.scale((2, 0.5, -4)))
    assert (tf.compose(tf.inverse(matrix), matrix) == np.eye(4)).all()
    assert not np.signbit(tf.inverse(np.eye(4))).any()


def test_normal_matrix_ignores_translation():
    assert np.array_equal(tf.normal_matrix(tf.translate((1, 2, 3))), np.eye(3))


# --- Points


@pytest.mark.parametrize("count", [0, 1, BLOCK - 1, BLOCK, 2 * BLOCK + 7])
def test_transform_points_equals_the_scalar_formula_bit_for_bit(count):
    points = np.random.default_rng(7).normal(size=(count, 3))
    result = tf.transform_points(camera_like_matrix(), points)
    assert result.shape == (count, 4)
    assert result.tolist() == homogeneous_by_hand(camera_like_matrix(), points)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32, np.uint8])
def test_points_of_any_dtype_and_stride_give_the_bits_of_float64(dtype):
    values = np.random.default_rng(8).uniform(0, 200, size=(60, 6)).astype(dtype)
    for points in (values[::-2, ::2], np.asfortranarray(values[:, :3])):
        result = tf.transform_points(camera_like_matrix(), points)
        assert result.tolist() == homogeneous_by_hand(camera_like_matrix(), points)


def test_nan_and_infinity_propagate_through_zeros_without_a_warning():
    result = tf.transform_points(np.eye(4), [(np.nan, 0, 0), (0, np.inf, 0), (1e308, 0, 0)])
    assert np.isnan(result[0]).all()
    assert np.isnan(result[1, [0, 2, 3]]).all()
    assert result[1, 1] == np.inf
    assert result[2].tolist() == [1e308, 0, 0, 1]


def test_apply_divides_by_w_and_keeps_the_shape():
    matrix = tf.perspective_focal(1.0)
    assert tf.apply(matrix, [(2, 4, -2)]).tolist() == [[1, 2, -1]]
    assert tf.apply(matrix, (2, 4, -2)).tolist() == [1, 2, -1]
    assert tf.apply(matrix, np.empty((0, 3))).shape == (0, 3)


def test_apply_gives_infinity_at_w_zero_without_a_warning():
    assert tf.apply(tf.perspective_focal(1.0), (1, -1, 0)).tolist()[:2] == [np.inf, -np.inf]


# --- Degenerate input

NAN, INF = math.nan, math.inf
AXIS, UP = (0, 0, 1), (0, 1, 0)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: tf.translate((1, 2)), "offset"),
        (lambda: tf.translate((1, NAN, 2)), "offset"),
        (lambda: tf.scale(0), "factor"),
        (lambda: tf.scale((1, 0, 1)), "factor"),
        (lambda: tf.scale(NAN), "factor"),
        (lambda: tf.scale("big"), "factor"),
        (lambda: tf.scale((1, INF, 1)), "factor"),
        (lambda: tf.scale((1, 2)), "factor"),
        (lambda: tf.rotate((0, 0, 0), 10), "axis"),
        (lambda: tf.rotate((NAN, 0, 0), 10), "axis"),
        (lambda: tf.rotate(AXIS, INF), "degrees"),
        (lambda: tf.rotate_x(NAN), "degrees"),
        (lambda: tf.shear(zy=INF), "zy"),
        (lambda: tf.compose(np.eye(4), np.eye(3)), r"matrices\[1\]"),
        (lambda: tf.compose(np.full((4, 4), NAN)), r"matrices\[0\]"),
        (lambda: tf.look_at((0, 0, 0), AXIS, (1e-12, 0, 1)), "up"),
        (lambda: tf.perspective_focal(0), "d"),
        (lambda: tf.orthographic(1, 1, 0, 1, 0, 1), "right"),
        (lambda: tf.orthographic(0, 1, 2, 2, 0, 1), "top"),
        (lambda: tf.orthographic(0, 1, 0, 1, 1, 1), "far"),
        (lambda: tf.orthographic(0, 1, 0, 1, 0, INF), "far"),
        (lambda: tf.viewport(10, 10, "corners"), "convention"),
        (lambda: tf.normal_matrix(np.eye(3)), "matrix"),
        (lambda: tf.inverse(np.eye(3)), "matrix"),
        (lambda: tf.inverse(np.full((4, 4), 1.0)), "matrix"),
        (lambda: tf.inverse(np.zeros((4, 4))), "matrix"),
        (lambda: tf.inverse(np.diag([1e-310, 1, 1, 1])), "matrix"),
        (lambda: tf.apply(np.full((4, 4), INF), [(0, 0, 0)]), "matrix"),
        (lambda: tf.apply(np.eye(4), [(0, 0)]), "points"),
        (lambda: tf.transform_points(np.eye(3), np.zeros((2, 3))), "matrix"),
        (lambda: tf.transform_points(np.eye(4), np.zeros((2, 4))), "points"),
        (lambda: tf.focal_length(200), "fov_y"),
        (lambda: tf.sine_cosine(NAN), "degrees"),
    ],
)
def test_degenerate_input_is_named(call, name):
    with pytest.raises(ValueError, match=rf"^{name} must "):
        call()


def test_source_uses_nothing_that_rounds_differently_between_cpus():
    source = re.sub(r'"""[\s\S]*?"""', "", Path(tf.__file__).read_text(encoding="utf-8"))
    banned = r" @ |np\.(dot|matmul|einsum|linalg|sin|cos|tan|inner)\b|math\.(sin|cos|tan|a?tan2?)\b"
    assert re.findall(banned, source) == []


@pytest.mark.parametrize(
    ("y", "x", "degrees"),
    [
        (0, 0, 0), (0, 1, 0), (1, 1, 45), (1, 0, 90), (1, -1, 135), (0, -1, 180), (-1, -1, -135),
        (-1, 0, -90), (-3, 3, -45), (5e-324, 5e-324, 45), (1e308, 0.0, 90), (0.0, 1e-320, 0),
    ],
)  # fmt: skip
def test_arc_tangent_is_exact_at_eighths_of_a_turn(y, x, degrees):
    assert tf.arc_tangent(y, x) == degrees


@pytest.mark.parametrize("degrees", [1e-300, 1e-9, 0.5, 5.625, 11.25, 30.0, 44.9, 45.1, 123.4])
def test_arc_tangent_undoes_sine_and_cosine(degrees):
    sine, cosine = tf.sine_cosine(degrees)
    # Each of the two is half an ulp off, which is at most an ulp of the angle, and it one more.
    assert abs(tf.arc_tangent(sine, cosine) - degrees) <= 2.0 * math.ulp(degrees)


@pytest.mark.parametrize(("y", "x"), [(1, 3), (2, 7), (355, 113), (1, 10**6), (999, 1000)])
def test_arc_tangent_is_correctly_rounded(y, x):
    # Euler's series, which converges for every ratio and shares nothing with the code.
    getcontext().prec = 60
    ratio = Decimal(min(x, y)) / Decimal(max(x, y))
    square = ratio * ratio / (1 + ratio * ratio)
    term = total = square / ratio
    for n in range(1, 400):
        term = term * square * 2 * n / (2 * n + 1)
        total += term
    exact = total * 180 / decimal_pi()
    assert tf.arc_tangent(y, x) == float(exact if y < x else 90 - exact)


def test_product_that_overflows_is_refused():
    with pytest.raises(ValueError, match="matrices must have a finite product"):
        tf.compose(tf.scale(1e200), tf.scale(1e200))


def test_normal_matrices_are_the_bits_of_each_normal_matrix():
    rng = np.random.default_rng(11)
    linear = rng.normal(size=(600, 4, 4))
    linear[:, 3] = 0.0, 0.0, 0.0, 1.0
    linear[100:200] = np.round(linear[100:200])  # Singular ones, and zeros of both signs.
    linear[200:300, :3] *= 10.0 ** rng.integers(-160, 160, (100, 1, 1))
    linear[300:400, :3] *= 10.0 ** rng.integers(-300, 300, (100, 3, 4))
    linear[400:500, rng.integers(3)] *= -0.0
    linear[500, :3, :3] = 0.0
    single = np.stack([tf.normal_matrix(matrix) for matrix in linear])
    assert tf.normal_matrices(linear).tobytes() == single.tobytes()


def test_normal_matrices_of_nothing_are_nothing():
    assert tf.normal_matrices(np.empty((0, 4, 4))).shape == (0, 3, 3)


def test_instances_are_the_bits_of_each_transform():
    rng = np.random.default_rng(4)
    matrices = rng.normal(size=(7, 4, 4)) * 10.0 ** rng.integers(-200, 200, (7, 1, 1))
    points = rng.normal(size=(30, 3)) * 10.0 ** rng.integers(-200, 200, (30, 1))
    points[3] = np.inf, np.nan, -0.0
    together = tf.transform_instances(matrices, points)
    for number, matrix in enumerate(matrices):
        alone = tf.transform_points(matrix, points)[:, :3]
        assert together[number].tobytes() == alone.tobytes()
