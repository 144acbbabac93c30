import itertools
import math
import re

import numpy as np
import pytest

from rasterjit.classics.pipeline import ClassicPipeline
from rasterjit.scene import transforms as tf


def full_pipeline() -> ClassicPipeline:
    return (
        ClassicPipeline()
        .scale((0.5, 2.0, -1.25))
        .rotate(10.0, 200.0, -35.0)
        .world_pos((0.3, -0.2, 1.5))
        .camera((2.0, 3.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        .perspective(50.0, 320, 200, 0.1, 100.0)
    )


def looking_down_minus_z(far: float = 10.0) -> ClassicPipeline:
    return ClassicPipeline().perspective(90.0, 64, 64, 1.0, far)


def test_setters_return_the_pipeline():
    pipeline = ClassicPipeline()
    assert pipeline.scale(2) is pipeline
    assert pipeline.rotate(1, 2, 3) is pipeline
    assert pipeline.world_pos((1, 2, 3)) is pipeline
    assert pipeline.camera((0, 0, 1), (0, 0, 0)) is pipeline
    assert pipeline.perspective(45, 8, 8, 1, 2) is pipeline
    assert pipeline.orthographic(2, 8, 8, 1, 2) is pipeline


def test_matrix_is_projection_camera_translate_rotate_scale():
    expected = tf.compose(
        tf.perspective(50.0, 320 / 200, 0.1, 100.0),
        tf.look_at((2, 3, 5), (0, 0, 0), (0, 1, 0)),
        tf.translate((0.3, -0.2, 1.5)),
        tf.rotate_z(-35.0),
        tf.rotate_y(200.0),
        tf.rotate_x(10.0),
        tf.scale((0.5, 2.0, -1.25)),
    )
    np.testing.assert_allclose(full_pipeline().matrix, expected, rtol=1e-13, atol=1e-14)


def test_order_of_the_setters_does_not_matter():
    reordered = (
        ClassicPipeline()
        .perspective(50.0, 320, 200, 0.1, 100.0)
        .camera((2.0, 3.0, 5.0), (0.0, 0.0, 0.0))
        .world_pos((0.3, -0.2, 1.5))
        .rotate(10.0, 200.0, -35.0)
        .scale((0.5, 2.0, -1.25))
    )
    assert np.array_equal(reordered.matrix, full_pipeline().matrix)


def test_scale_comes_before_rotation_and_rotation_before_translation():
    pipeline = ClassicPipeline().scale((2, 1, 1)).rotate(z_degrees=90).world_pos((10, 0, 0))
    assert tf.apply(pipeline.world_from_object, (1, 0, 0)).tolist() == [10, 2, 0]


def test_rotation_is_about_x_then_y_then_z():
    matrix = ClassicPipeline().rotate(90, 90, 0).world_from_object
    assert tf.apply(matrix, (0, 1, 0)).tolist() == [1, 0, 0]


def test_setting_a_step_again_replaces_it():
    twice = full_pipeline().scale(3).scale((0.5, 2.0, -1.25))
    assert np.array_equal(twice.matrix, full_pipeline().matrix)


def test_unset_pipeline_is_the_identity():
    assert np.array_equal(ClassicPipeline().matrix, np.eye(4))


def test_one_product_equals_step_by_step():
    pipeline = full_pipeline()
    points = np.random.default_rng(1).normal(size=(500, 3))
    steps = points
    for matrix in (
        tf.scale((0.5, 2.0, -1.25)),
        tf.rotate_x(10.0),
        tf.rotate_y(200.0),
        tf.rotate_z(-35.0),
        tf.translate((0.3, -0.2, 1.5)),
        pipeline.view_from_world,
        pipeline.clip_from_view,
        tf.viewport(320, 200),
    ):
        steps = tf.apply(matrix, steps)
    projected = pipeline.project(points)
    assert projected.on_screen.any()
    np.testing.assert_allclose(projected.pixels, steps[:, :2], rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(projected.depth, steps[:, 2], rtol=1e-12)


def test_point_of_the_reference_lands_on_its_pixel():
    pixels, depth, on_screen = looking_down_minus_z().project([(1, 2, -4)])
    assert pixels.tolist() == [[40, 16]]
    assert depth[0] == pytest.approx((11 * 4 - 20) / 9 / 4, abs=1e-15)
    assert on_screen.tolist() == [True]


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0, 0, -2), True),
        ((0, 0, 2), False),
        ((0, 0, 0), False),
        ((0, 0, -0.99), False),
        ((0, 0, -1.01), True),
        ((0, 0, -9.99), True),
        ((0, 0, -10.01), False),
        ((-2, 0, -2), True),
        ((2, 0, -2), False),
        ((-2.001, 0, -2), False),
        ((0, 2, -2), True),
        ((0, -2, -2), False),
        ((math.nan, 0, -2), False),
        ((0, 0, -math.inf), False),
    ],
)
def test_only_points_in_the_view_volume_are_on_screen(point, expected):
    assert looking_down_minus_z().project([point]).on_screen.tolist() == [expected]


def test_points_not_in_front_have_no_coordinates():
    pixels, depth, on_screen = looking_down_minus_z().project([(1, 1, 3), (1, 1, 0), (1, 1, -2)])
    assert np.isnan(pixels).tolist() == [[True, True], [True, True], [False, False]]
    assert np.isnan(depth).tolist() == [True, True, False]
    assert on_screen.tolist() == [False, False, True]


def test_points_outside_the_image_keep_their_coordinates():
    pixels, _, on_screen = looking_down_minus_z().project([(4, 0, -2)])
    assert pixels.tolist() == [[96, 32]]
    assert on_screen.tolist() == [False]


def test_infinite_far_shows_points_at_any_distance():
    points = [(0, 0, -1e9), (0, 0, -1e300)]
    assert looking_down_minus_z(math.inf).project(points).on_screen.all()


def test_orthographic_keeps_sizes_at_any_depth():
    pipeline = ClassicPipeline().orthographic(4.0, 80, 40, 0.0, 10.0)
    pixels, depth, on_screen = pipeline.project([(1, 1, -1), (1, 1, -9), (0, 0, -10.5)])
    assert pixels.tolist() == [[50, 10], [50, 10], [40, 20]]
    np.testing.assert_allclose(depth, [-0.8, 0.8, 1.1], atol=1e-15)
    assert on_screen.tolist() == [True, True, False]


def test_no_points_give_empty_arrays():
    pixels, depth, on_screen = full_pipeline().project(np.empty((0, 3)))
    assert (pixels.shape, depth.shape, on_screen.shape) == ((0, 2), (0,), (0,))


def test_projecting_without_a_projection_is_an_error():
    with pytest.raises(ValueError, match="perspective or orthographic must be set"):
        ClassicPipeline().project([(0, 0, 0)])


def test_returned_matrices_are_copies():
    pipeline = full_pipeline()
    before = pipeline.matrix
    pipeline.view_from_world[:] = 0
    pipeline.clip_from_view[:] = 0
    pipeline.matrix[:] = 0
    assert np.array_equal(pipeline.matrix, before)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda p: p.scale(0), "factor"),
        (lambda p: p.rotate(y_degrees=math.nan), "y_degrees"),
        (lambda p: p.world_pos((1, 2)), "position"),
        (lambda p: p.camera((1, 2, 3), (1, 2, 3)), "target"),
        (lambda p: p.camera((0, math.inf, 0), (1, 2, 3)), "position"),
        (lambda p: p.camera((0, 0, 0), (0, 1, 0)), "up"),
        (lambda p: p.perspective(180, 8, 8, 1, 2), "fov_y"),
        (lambda p: p.perspective(45, 0, 8, 1, 2), "width, height"),
        (lambda p: p.perspective(45, 8, 8, 0, 2), "near"),
        (lambda p: p.perspective(45, 8, 8, 2, 2), "far"),
        (lambda p: p.orthographic(0, 8, 8, 1, 2), "view_height"),
        (lambda p: p.orthographic(1, 8, 8, 1, math.inf), "far"),
        (lambda p: p.project([(1, 2)]), "points"),
    ],
)
def test_degenerate_input_is_named_and_changes_nothing(call, name):
    pipeline = full_pipeline()
    with pytest.raises(ValueError, match=rf"^{name} must "):
        call(pipeline)
    assert np.array_equal(pipeline.matrix, full_pipeline().matrix)


def test_stages_lead_from_the_vertex_to_its_pixel():
    pipeline, vertex = full_pipeline(), (0.3, -0.7, 0.2)
    stages = pipeline.explain(vertex)
    names = ["vertex", "scale", "rotate", "translate", "camera", "projection", "divide by w"]
    assert [stage.name for stage in stages] == [*names, "viewport"]
    for before, stage in itertools.pairwise(stages):
        by_hand = before.position / before.position[3]
        if stage.matrix is not None:
            by_hand = stage.matrix @ before.position
        assert stage.position == pytest.approx(by_hand, rel=1e-12)
    matrices = [stage.matrix for stage in stages[1:6]]
    assert np.allclose(tf.compose(*matrices[::-1]), pipeline.matrix, rtol=1e-13)
    found = pipeline.project([vertex])
    assert stages[-1].position[:2].tolist() == found.pixels[0].tolist()
    assert stages[-1].position[2] == pytest.approx(found.depth[0], rel=1e-12)


def test_stages_are_a_line_each_as_text_and_as_formulas():
    stages = full_pipeline().explain((0.3, -0.7, 0.2))
    lines = str(stages).splitlines()
    assert [line.split("  ")[0] for line in lines] == [stage.name for stage in stages]
    for line, stage in zip(lines, stages, strict=True):
        numbers = [float(one) for one in re.search(r"\((.*)\)", line)[1].split(",")]
        assert numbers == pytest.approx(stage.position, rel=1e-3, abs=1e-9)
        if stage.matrix is not None:
            rows = re.search(r"\[(.*)\]", line)[1].split("; ")
            entries = [[float(one) for one in row.split()] for row in rows]
            assert np.allclose(entries, stage.matrix, rtol=1e-3, atol=1e-9)
    formulas = stages.latex()
    assert formulas.startswith("\\begin{aligned}\n")
    assert stages._repr_latex_() == f"$\\displaystyle {formulas}$"
    for line in formulas.splitlines()[1:-1]:
        parts = re.findall(r"begin{bmatrix} (.*?) .end{bmatrix}", line)
        *left, result = (
            np.array([[float(one) for one in row.split("&")] for row in part.split(r"\\")])
            for part in parts
        )
        divisor = re.search(r"frac\{1\}\{(.*?)\}", line)
        product = left[0] @ left[1] if divisor is None else left[0] / float(divisor[1])
        assert product == pytest.approx(result, rel=5e-3, abs=0.05)


def test_rounding_is_written_as_zero():
    pipeline = looking_down_minus_z().camera((2, 3, 5), (0, 0, 0))
    assert np.abs(pipeline.view_from_world[1, 3]) < 1e-12
    assert "e-" not in str(pipeline.explain((0, 0, -2)))


def test_what_is_small_but_exact_is_written():
    stages = looking_down_minus_z().scale(1e-14).world_pos((0, 0, -2)).explain((1, 1, 1))
    line = str(stages).splitlines()[1]
    assert "[1e-14 0 0 0; 0 1e-14 0 0; 0 0 1e-14 0; 0 0 0 1]" in line
    assert "(1e-14, 1e-14, 1e-14, 1)" in line
    far = looking_down_minus_z().explain((1e300, 0, -2))
    assert str(far).count("(1e+300, 0, -2, 1)") == 5


def test_what_has_no_pixel_is_not_explained():
    with pytest.raises(ValueError, match="must be set before explain"):
        ClassicPipeline().explain((0, 0, 0))
    with pytest.raises(ValueError, match="vertex must be in front of the camera"):
        looking_down_minus_z().explain((0, 0, 1))
    with pytest.raises(ValueError, match="vertex"):
        looking_down_minus_z().explain((0, math.nan, 1))
