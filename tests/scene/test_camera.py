import dataclasses
import itertools
import math
import sys

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.scene import transforms as tf
from rasterjit.scene.camera import MatrixCamera, OrthographicCamera, PerspectiveCamera
from rasterjit.scene.camera_fitting import fit_camera, orbit_direction

SIZE = (640, 480)


@dataclasses.dataclass
class Sphere:
    center: tuple[float, float, float]
    radius: float

    def bounding_sphere(self):
        return np.array(self.center), self.radius


def perspective_camera(**changes):
    return PerspectiveCamera(
        **{"eye": (2, 3, 5), "target": (0, 0.5, 0), "near": 0.5, "far": 50.0, **changes}
    )


def orthographic_camera(**changes):
    return OrthographicCamera(
        **{"eye": (2, 3, 5), "target": (0, 0.5, 0), "near": -1.0, "far": 50.0, **changes}
    )


def as_matrices(camera, size=SIZE):
    return MatrixCamera(camera.view_matrix(), camera.projection_matrix(size))


def clip_points(camera, points, size=SIZE):
    matrix = tf.compose(camera.projection_matrix(size), camera.view_matrix())
    return tf.transform_points(matrix, points)


def stored_depth(camera, points, size=SIZE):
    c0, c1, c2 = camera.depth_coefficients()
    clip = clip_points(camera, points, size)
    return (c0 + c1 * clip[:, 2] + c2 * clip[:, 3]) / clip[:, 3]


def screen_points(camera, points, size):
    clip = clip_points(camera, points, size)
    return tf.apply(tf.viewport(*size), clip[:, :3] / clip[:, 3:])[:, :2]


def points_before(camera, count=200):
    """World points at view depths 1..40."""
    rng = np.random.default_rng(3)
    view = np.column_stack([rng.normal(size=(count, 2)), -rng.uniform(1, 40, count)])
    return tf.apply(np.linalg.inv(camera.view_matrix()), view), -view[:, 2]


def sphere_points(sphere, count=4000):
    directions = np.random.default_rng(4).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return np.array(sphere.center) + sphere.radius * directions


# --- The common interface

CAMERAS = [
    perspective_camera(),
    perspective_camera(far=math.inf, fov_y=100.0),
    orthographic_camera(),
    as_matrices(perspective_camera()),
    as_matrices(perspective_camera(far=math.inf)),
    as_matrices(orthographic_camera()),
    MatrixCamera.from_intrinsics(
        500, 510, 300, 250, SIZE, view_from_world=perspective_camera().view_matrix()
    ),
]


@pytest.mark.parametrize("camera", CAMERAS)
def test_stored_depth_turns_back_into_view_depth(camera):
    points, depths = points_before(camera)
    stored = stored_depth(camera, points)
    converted = camera.view_depth(stored)
    assert converted.dtype == np.float64
    np.testing.assert_allclose(converted, depths, rtol=1e-12)


@pytest.mark.parametrize("camera", CAMERAS)
def test_nearer_is_stored_bigger(camera):
    points, depths = points_before(camera)
    stored = stored_depth(camera, points)
    assert (np.diff(stored[np.argsort(depths)]) < 0).all()


@pytest.mark.parametrize("camera", CAMERAS)
def test_eye_is_the_origin_of_view_space(camera):
    np.testing.assert_allclose(camera.eye_position(), (2, 3, 5), rtol=1e-14)


@pytest.mark.parametrize("camera", CAMERAS[:6])
def test_stored_depth_is_one_on_the_near_plane_or_zero_of_a_parallel_view(camera):
    is_perspective = camera.depth_coefficients()[0] > 0.0
    near = 0.5 if is_perspective else -1.0
    point = tf.apply(np.linalg.inv(camera.view_matrix()), (0, 0, -near))
    c0, c1, c2 = camera.depth_coefficients()
    x, y, z, w = clip_points(camera, [point])[0]
    assert (x, y) == pytest.approx((0, 0), abs=1e-12)
    assert (c0 + c1 * z + c2 * w) / w == pytest.approx(float(is_perspective), abs=1e-12)


def test_depth_coefficients_are_those_of_the_contract():
    assert perspective_camera(near=0.25).depth_coefficients() == (0.25, 0.0, 0.0)
    assert orthographic_camera().depth_coefficients() == (0.0, -0.5, -0.5)
    assert as_matrices(orthographic_camera()).depth_coefficients() == (0.0, -0.5, -0.5)
    for far in (50.0, math.inf):
        copied = as_matrices(perspective_camera(far=far)).depth_coefficients()
        assert copied == pytest.approx((0.5, 0.0, 0.0), rel=1e-14)


def test_perspective_stores_zero_at_infinity_and_gives_infinity_back():
    assert perspective_camera().view_depth([0.0, 0.5]).tolist() == [math.inf, 1.0]
    assert as_matrices(perspective_camera()).view_depth(np.zeros((2, 3))).shape == (2, 3)


def test_orthographic_depth_is_exact_at_both_planes():
    camera = orthographic_camera(near=0.1, far=0.7)
    assert camera.view_depth([0.0, -1.0]).tolist() == [0.1, 0.7]


def test_stored_float32_depth_is_converted_in_float64():
    stored = np.array([0.1], dtype=np.float32)
    camera = perspective_camera(near=0.1)
    assert camera.view_depth(stored)[0] == 0.1 / float(stored[0])


def test_projection_follows_the_aspect_of_the_image():
    for camera in (perspective_camera(), orthographic_camera()):
        wide, square = camera.projection_matrix((200, 100)), camera.projection_matrix((100, 100))
        assert wide[0, 0] == square[0, 0] / 2
        assert wide[1, 1] == square[1, 1]


def test_perspective_matrices_are_those_of_transforms():
    camera = perspective_camera(fov_y=30)
    assert np.array_equal(camera.projection_matrix(SIZE), tf.perspective(30, 4 / 3, 0.5, 50))
    assert np.array_equal(camera.view_matrix(), tf.look_at((2, 3, 5), (0, 0.5, 0), (0, 1, 0)))


def test_orthographic_height_fills_the_image():
    camera = OrthographicCamera((0, 0, 5), (0, 0, 0), height=6.0)
    assert screen_points(camera, [(0, 3, 0), (4, -3, 0)], SIZE).tolist() == [[320, 0], [640, 480]]


def test_cameras_are_frozen_and_compare_by_value():
    camera = perspective_camera(eye=np.array([2.0, 3.0, 5.0]))
    assert camera == perspective_camera()
    assert hash(camera) == hash(perspective_camera())
    assert camera != perspective_camera(fov_y=46)
    with pytest.raises(dataclasses.FrozenInstanceError):
        camera.fov_y = 10
    matrices = as_matrices(camera)
    with pytest.raises(ValueError, match="read-only"):
        matrices.view_from_world[0, 0] = 7


def test_matrix_camera_keeps_its_own_copies():
    view = tf.translate((0, 0, -3))
    camera = MatrixCamera(view, tf.perspective(45, 1, 1, 10))
    view[:] = 0
    camera.view_matrix()[:] = 0
    camera.projection_matrix(SIZE)[:] = 0
    assert np.array_equal(camera.view_matrix(), tf.translate((0, 0, -3)))
    assert np.array_equal(camera.projection_matrix((3, 9)), tf.perspective(45, 1, 1, 10))


def test_view_folded_into_the_projection_gives_the_same_eye_and_depth():
    camera = perspective_camera()
    whole = tf.compose(camera.projection_matrix(SIZE), camera.view_matrix())
    folded = MatrixCamera(tf.identity(), whole)
    points, depths = points_before(camera)
    np.testing.assert_allclose(folded.eye_position(), (2, 3, 5), rtol=1e-12)
    np.testing.assert_allclose(folded.view_depth(stored_depth(folded, points)), depths, rtol=1e-12)


def test_textbook_projection_without_a_near_plane_still_has_depth():
    camera = MatrixCamera(tf.translate((0, 0, -3)), tf.perspective_focal(2.0))
    assert camera.depth_coefficients()[0] > 0
    stored = stored_depth(camera, [(0, 0, -1)])
    assert camera.view_depth(stored).tolist() == [4.0]


# --- Calibrated intrinsics


def test_intrinsics_reproject_to_a_billionth_of_a_pixel():
    rng = np.random.default_rng(5)
    for _ in range(20):
        fx, fy = rng.uniform(300, 3000, 2)
        cx, cy = rng.uniform(-200, 2000, 2)
        size = tuple(rng.integers(100, 4000, 2).tolist())
        pose = tf.look_at(*rng.normal(size=(2, 3)), (0, 1, 0))
        camera = MatrixCamera.from_intrinsics(fx, fy, cx, cy, size, view_from_world=pose)
        view = np.column_stack([rng.normal(size=(100, 2)), -rng.uniform(0.5, 50, 100)])
        world = tf.apply(np.linalg.inv(pose), view)
        expected = np.column_stack(
            [cx - fx * view[:, 0] / view[:, 2], cy + fy * view[:, 1] / view[:, 2]]
        )
        assert np.abs(screen_points(camera, world, size) - expected).max() < 1e-9


def test_principal_axis_lands_on_the_principal_point():
    camera = MatrixCamera.from_intrinsics(800, 800, 0.5, 0.5, SIZE)
    np.testing.assert_allclose(screen_points(camera, [(0, 0, -7)], SIZE), [(0.5, 0.5)], atol=1e-12)
    right_and_up = screen_points(camera, [(7, 7, -7)], SIZE)
    np.testing.assert_allclose(right_and_up, [(800.5, -799.5)], atol=1e-10)


def test_opencv_conversion_of_the_docstring():
    fx, fy, cx, cy = 700.0, 710.0, 320.25, 239.5
    camera_from_world = tf.compose(tf.translate((0.1, -0.2, 3)), tf.rotate((1, 2, 3), 20))
    camera = MatrixCamera.from_intrinsics(
        fx,
        fy,
        cx + 0.5,
        cy + 0.5,
        SIZE,
        view_from_world=tf.compose(tf.scale((1, -1, -1)), camera_from_world),
    )
    world = np.random.default_rng(6).normal(size=(50, 3)) * 0.3
    x, y, z = tf.apply(camera_from_world, world).T
    opencv = np.column_stack([fx * x / z + cx, fy * y / z + cy])
    assert np.abs(screen_points(camera, world, SIZE) - (opencv + 0.5)).max() < 1e-9


def test_symmetric_intrinsics_equal_the_perspective_camera():
    focal = tf.focal_length(45) * 240
    calibrated = MatrixCamera.from_intrinsics(focal, focal, 320, 240, SIZE, near=0.5, far=50)
    np.testing.assert_allclose(
        calibrated.projection_matrix(SIZE), tf.perspective(45, 4 / 3, 0.5, 50), rtol=1e-15
    )


# --- Fitting

SPHERES = [
    Sphere((0, 0, 0), 1.0),
    Sphere((10, -20, 30), 3.5),
    Sphere((1e6, 0, 0), 1e-3),
    Sphere((0, 0, 0), 1e12),
    Sphere((0, 0, 0), 1e-12),
]


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("aspect", [1.0, 0.25, 3.0])
def test_fitted_sphere_is_wholly_in_the_image(aspect, projection):
    own = {"aspect": aspect, "projection": projection, "margin": 1.01}
    for sphere, fov_y in itertools.product(SPHERES, (1.0, 45.0, 120.0, 179.0)):
        camera = fit_camera(sphere, (1, 2, 3), fov_y, **own)
        clip = clip_points(camera, sphere_points(sphere), (round(400 * aspect), 400))
        assert (np.abs(clip[:, :3]) <= clip[:, 3:]).all(), (sphere, fov_y)
        assert camera.near > 0, (sphere, fov_y)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("aspect", [1.0, 0.25, 3.0])
def test_fitted_sphere_touches_the_narrow_side(projection, aspect):
    sphere = Sphere((1, 2, 3), 2.0)
    camera = fit_camera(sphere, (1, 2, 3), aspect=aspect, projection=projection, margin=1.0)
    clip = clip_points(camera, sphere_points(sphere, 200_000), (round(400 * aspect), 400))
    ndc = np.abs(clip[:, :2] / clip[:, 3:])
    assert ndc[:, 0 if aspect < 1 else 1].max() == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("aspect", [1.0, 0.5, 3.0])
@pytest.mark.parametrize("size", [(300, 400), (100, 1600), (1, 16384), (900, 400)])
def test_fitted_sphere_is_wholly_in_an_image_of_any_size(projection, aspect, size):
    sphere = Sphere((1, 2, 3), 2.0)
    camera = fit_camera(sphere, (1, 2, 3), aspect=aspect, projection=projection, margin=1.01)
    clip = clip_points(camera, sphere_points(sphere), size)
    assert (np.abs(clip[:, :3]) <= clip[:, 3:]).all()


@pytest.mark.parametrize("make", [perspective_camera, orthographic_camera])
def test_pictures_below_the_least_aspect_show_as_much_from_side_to_side(make):
    camera, plain = make(min_aspect=0.75), make()
    points, _ = points_before(camera)
    across = [screen_points(camera, points, size)[:, 0] for size in ((300, 400), (300, 1600))]
    np.testing.assert_allclose(*across, rtol=1e-12)
    for size in ((300, 400), (301, 400), (400, 300)):
        assert np.array_equal(camera.projection_matrix(size), plain.projection_matrix(size))
    # Pixels stay square.
    matrix = camera.projection_matrix((300, 1600))
    assert matrix[0, 0] * 300 == pytest.approx(matrix[1, 1] * 1600, rel=1e-15)


def test_fitted_depth_range_is_tight():
    camera = fit_camera(Sphere((0, 0, 0), 1.0), (0, 0, 1), margin=1.0)
    distance = camera.eye[2]
    assert 0.97 * (distance - 1) < camera.near < distance - 1
    assert distance + 1 < camera.far < 1.03 * (distance + 1)


def test_fitted_camera_looks_at_the_centre_from_the_direction():
    camera = fit_camera(Sphere((1, 2, 3), 1.0), (0, 0, 5))
    assert camera.target == (1, 2, 3)
    assert camera.eye[:2] == (1, 2)
    assert camera.eye[2] > 4


@pytest.mark.parametrize("center", [(0, 0, 0), (5, 6, 7), (1e20, -1e20, 0)])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_single_point_is_fitted_to_the_middle(center, projection):
    camera = fit_camera(Sphere(center, 0.0), projection=projection)
    assert camera.target == center
    clip = clip_points(camera, [center])[0]
    assert np.abs(clip[:2]).max() <= 1e-3 * clip[3]
    assert abs(clip[2]) < clip[3]


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_sphere_below_the_resolution_of_its_centre_is_still_fitted(projection):
    camera = fit_camera(Sphere((1e6, 2e6, 3e6), 1e-300), projection=projection)
    clip = clip_points(camera, [(1e6, 2e6, 3e6)])[0]
    assert np.abs(clip[:3]).max() < clip[3]


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("zoom", [0.5, 2.0, 10.0])
def test_zoom_scales_the_picture(projection, zoom):
    sphere = Sphere((1, 2, 3), 2.0)
    plain = fit_camera(sphere, projection=projection)
    zoomed = fit_camera(sphere, projection=projection, zoom=zoom)
    assert plain.eye == zoomed.eye
    ratio = zoomed.projection_matrix(SIZE)[:2] / np.where(
        plain.projection_matrix(SIZE)[:2], plain.projection_matrix(SIZE)[:2], np.inf
    )
    np.testing.assert_allclose(ratio.diagonal(), zoom, rtol=1e-10)


@pytest.mark.parametrize(
    ("direction", "up", "expected"),
    [
        ((0, 1, 0), (0, 1, 0), (0, 0, -1)),
        ((0, -2, 0), (0, 1, 0), (0, 0, 1)),
        ((0, 0, 3), (0, 0, 1), (0, 1, 0)),
        ((1, 0, 0), (0, 1, 0), (0, 1, 0)),
    ],
)
def test_direction_parallel_to_up_takes_another_up(direction, up, expected):
    assert fit_camera(Sphere((0, 0, 0), 1.0), direction, up=up).up == expected


@pytest.mark.parametrize(
    ("azimuth", "elevation", "expected"),
    [
        (0, 0, (0, 0, 1)),
        (90, 0, (1, 0, 0)),
        (180, 0, (0, 0, -1)),
        (-90, 0, (-1, 0, 0)),
        (0, 90, (0, 1, 0)),
        (123, -90, (0, -1, 0)),
    ],
)
def test_orbit_starts_at_plus_z_and_turns_towards_plus_x(azimuth, elevation, expected):
    assert orbit_direction(azimuth, elevation) == expected


def test_whatever_is_drawn_can_be_framed_without_scipy(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy", None)
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    box = trimesh.creation.box((1, 2, 3))
    scene = rj.load(box)
    wanted = fit_camera(scene)
    for what in (box, trimesh.Scene(box), scene.nodes[0].mesh):
        assert fit_camera(what) == wanted
        assert rj.animation.turntable(what)(0.3) == rj.animation.turntable(scene)(0.3)
    with pytest.raises(ValueError, match=r"scene must be a Scene, a Mesh, .* got str; .*load"):
        fit_camera("models/teapot.obj")
    with pytest.raises(ValueError, match="holds no faces, lines or points"):
        fit_camera(trimesh.Scene())


@pytest.mark.parametrize(
    ("azimuth", "elevation", "up", "expected"),
    [
        (0.0, 0.0, (0, 0, 1), (0, -1, 0)),
        (90.0, 0.0, (0, 0, 2), (1, 0, 0)),
        (123.0, 90.0, (0, 0, 1), (0, 0, 1)),
        (0.0, 0.0, (0, 1, 0), (0, 0, 1)),
        (0.0, 90.0, (0, -1, 0), (0, -1, 0)),
    ],
)
def test_an_orbit_turns_with_up(azimuth, elevation, up, expected):
    np.testing.assert_allclose(rj.orbit_direction(azimuth, elevation, up=up), expected, atol=1e-15)


def test_an_orbit_around_y_is_the_default_and_up_is_checked():
    assert rj.orbit_direction(31.0, 23.0, up=(0, 1, 0)) == rj.orbit_direction(31.0, 23.0)
    with pytest.raises(ValueError, match="up"):
        rj.orbit_direction(31.0, 23.0, up=(0, 0, 0))


def test_orbit_directions_have_length_one():
    direction = orbit_direction(30, 45)
    expected = (0.5 * math.sqrt(0.5), math.sqrt(0.5), math.sqrt(0.375))
    assert direction == pytest.approx(expected, rel=1e-15)


# --- Degenerate input

BALL = Sphere((0, 0, 0), 1.0)
NAN, INF = math.nan, math.inf
LENS = tf.perspective(45, 1, 1, 10)
BOX = tf.orthographic(-1, 1, -1, 1, 0, 1)
FLAT_BOX = np.diag([1.0, 1.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: orthographic_camera(height=0), "height"),
        (lambda: orthographic_camera(min_aspect=-1), "min_aspect"),
        (lambda: perspective_camera(min_aspect=INF), "min_aspect"),
        (lambda: orthographic_camera(near=INF), "near"),
        (lambda: orthographic_camera(far=INF), "far"),
        (lambda: orthographic_camera(far=-1), "far"),
        (lambda: orthographic_camera().projection_matrix((5, 199999)), "size"),
        (lambda: MatrixCamera(np.eye(3), LENS), "view_from_world"),
        (lambda: MatrixCamera(LENS, LENS), "view_from_world"),
        (lambda: MatrixCamera(np.diag([1.0, 1.0, 0.0, 1.0]), LENS), "view_from_world"),
        (lambda: MatrixCamera(np.eye(4), np.full((4, 4), NAN)), "clip_from_view"),
        (lambda: MatrixCamera(np.eye(4), np.diag([0.0, 1, 1, 1]) @ LENS), "clip_from_view"),
        (lambda: MatrixCamera(np.eye(4), -BOX), "clip_from_view"),
        (lambda: MatrixCamera(np.eye(4), FLAT_BOX), "clip_from_view"),
        (lambda: MatrixCamera(np.eye(4), LENS).projection_matrix((1.5, 2)), "size"),
        (lambda: MatrixCamera.from_intrinsics(0, 1, 1, 1, SIZE), "fx"),
        (lambda: MatrixCamera.from_intrinsics(1, -1, 1, 1, SIZE), "fy"),
        (lambda: MatrixCamera.from_intrinsics(1, 1, NAN, 1, SIZE), "cx"),
        (lambda: MatrixCamera.from_intrinsics(1, 1, 1, INF, SIZE), "cy"),
        (lambda: fit_camera(BALL, (0, 0, 0)), "direction"),
        (lambda: fit_camera(BALL, up=(0, 0, 0)), "up"),
        (lambda: fit_camera(BALL, fov_y=180), "fov_y"),
        (lambda: fit_camera(BALL, margin=0.5), "margin"),
        (lambda: fit_camera(BALL, zoom=0), "zoom"),
        (lambda: fit_camera(BALL, aspect=-1), "aspect"),
        (lambda: fit_camera(BALL, projection="fisheye"), "projection"),
        (lambda: fit_camera(Sphere((0, 0, 0), -1.0)), "scene's radius"),
        (lambda: fit_camera(Sphere((0, 0, 0), NAN)), "scene's radius"),
        (lambda: fit_camera(Sphere((0, INF, 0), 1.0)), "scene's center"),
        (lambda: orbit_direction(NAN, 0), "azimuth"),
        (lambda: orbit_direction(0, INF), "elevation"),
    ],
)
def test_degenerate_input_is_named(call, name):
    with pytest.raises(ValueError, match=rf"^{name} must "):
        call()


def test_matrices_that_lead_out_of_range_are_refused():
    view = np.diag([1.0, 1.0, 1e-200, 1.0])
    view[:3, 3] = 1e200
    with pytest.raises(ValueError, match="view_from_world and clip_from_view"):
        MatrixCamera(view, tf.perspective(60.0, 1.0, 0.1, 10.0))


@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e150])
def test_singular_view_is_refused_at_any_scale(scale):
    flat = np.eye(4)
    flat[:3, :3] = scale * np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]])
    with pytest.raises(ValueError, match="view_from_world must not be singular"):
        MatrixCamera(flat, tf.perspective(60.0, 1.0, 0.1, 10.0))


@pytest.mark.parametrize("kind", [PerspectiveCamera, OrthographicCamera])
def test_the_view_belongs_to_its_camera_alone(kind):
    camera = kind((1.0, 2.0, 3.0), (0.0, 0.5, 0.0))
    camera.view_matrix()[:] = 0.0
    expected = tf.look_at((1.0, 2.0, 3.0), (0.0, 0.5, 0.0), (0.0, 1.0, 0.0))
    assert camera.view_matrix().tobytes() == expected.tobytes()
    moved = dataclasses.replace(camera, eye=(3.0, 2.0, 1.0))
    expected = tf.look_at((3.0, 2.0, 1.0), (0.0, 0.5, 0.0), (0.0, 1.0, 0.0))
    assert moved.view_matrix().tobytes() == expected.tobytes()
