"""Cameras of other programs see a point where those programs' own formulas put it."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.io import cameras

SIZE = (64, 48)
W, H = SIZE
POINTS = np.array([[0.3, -0.2, 0.1], [-1.1, 0.7, 0.9], [0.9, 1.0, -1.2], [0.0, 0.0, 0.0]])


def turned(seed):
    """Return any rotation, (3, 3)."""
    axis, angle = np.random.default_rng(seed).normal(size=3), 20.0 + 47.0 * seed
    return rj.transforms.rotate(axis, angle)[:3, :3]


def pose_towards_origin(eye, up=(0.1, 1.0, 0.2)):
    """Return right, up and back as columns, and the eye: a camera that sees the origin."""
    back = np.asarray(eye) / np.linalg.norm(eye)
    right = np.cross(up, back)
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], axis=1), np.asarray(eye, float)


def pixels_of(camera, points=POINTS, size=SIZE):
    """Return where our camera puts points, (N, 2): first corner at (0, 0), y down."""
    matrix = camera.projection_matrix(size) @ camera.view_matrix()
    clip = np.c_[points, np.ones(len(points))] @ matrix.T
    ndc = clip[:, :2] / clip[:, 3:]
    return (ndc * (1, -1) + 1) / 2 * size


def assert_same_camera(one, other, size=SIZE):
    np.testing.assert_allclose(one.view_matrix(), other.view_matrix(), atol=1e-9)
    np.testing.assert_allclose(
        one.projection_matrix(size), other.projection_matrix(size), atol=1e-9
    )


def off_axis(far=math.inf, fy=51.0):
    """Return a calibrated camera of ours that sees the points."""
    turn, eye = pose_towards_origin((2.0, 1.5, 4.0))
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = turn.T, -turn.T @ eye
    return rj.MatrixCamera.from_intrinsics(
        51.0, fy, 37.5, 20.25, SIZE, view_from_world=view, near=0.25, far=far
    )


def drawn_pixel(camera, point, size=SIZE):
    """Draw a small ball at a point; return the middle of the pixels it covers, (x, y)."""
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = [[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    frame = rj.render(
        rj.Mesh(point + 0.15 * corners, faces), camera, size=size, outputs="face_id", threads=1
    )
    rows, columns = np.nonzero(frame.face_id >= 0)
    assert len(rows) > 1
    return columns.mean() + 0.5, rows.mean() + 0.5


# OpenCV


def opencv_parameters():
    k = np.array([[55.0, 1.5, 34.0], [0.0, 60.0, 21.0], [0.0, 0.0, 1.0]])
    turn, eye = pose_towards_origin((1.0, -2.0, 4.5))
    rotation = np.diag([1, -1, -1]) @ turn.T
    return k, rotation, -rotation @ eye


def test_opencv_puts_points_where_its_formula_does():
    k, rotation, translation = opencv_parameters()
    camera = cameras.from_opencv(k, SIZE, rotation=rotation, translation=translation)
    uvw = (k @ (rotation @ POINTS.T + translation[:, None])).T
    np.testing.assert_allclose(pixels_of(camera), uvw[:, :2] / uvw[:, 2:] + 0.5, atol=1e-9)
    x, y = drawn_pixel(camera, POINTS[1])
    assert (x, y) == pytest.approx(uvw[1, :2] / uvw[1, 2] + 0.5, abs=0.7)


def test_opencv_itself_puts_them_there():
    cv2 = pytest.importorskip("cv2")
    k, rotation, translation = opencv_parameters()
    k[0, 1] = 0.0
    turn, _ = cv2.Rodrigues(rotation)
    expected, _ = cv2.projectPoints(POINTS, turn, translation, k, None)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    for matrix in (pose, pose[:3]):
        camera = cameras.from_opencv(k, SIZE, camera_from_world=matrix)
        np.testing.assert_allclose(pixels_of(camera), expected[:, 0] + 0.5, atol=1e-9)


def test_opencv_and_back():
    k, rotation, translation = opencv_parameters()
    camera = cameras.from_opencv(
        k, SIZE, rotation=rotation, translation=translation[:, None], near=0.5, far=20.0
    )
    found = cameras.to_opencv(camera, SIZE)
    np.testing.assert_allclose(found.intrinsics, k, atol=1e-9)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, translation, atol=1e-12)
    again = cameras.from_opencv(
        found.intrinsics, SIZE, camera_from_world=found.camera_from_world, near=0.5, far=20.0
    )
    assert_same_camera(again, camera)


def test_a_camera_of_ours_goes_to_opencv_and_back():
    ours = rj.PerspectiveCamera((2, 3, 5), (0, 0.5, 0), fov_y=40.0, near=0.1)
    k, rotation, translation = cameras.to_opencv(ours, SIZE)
    back = cameras.from_opencv(k, SIZE, rotation=rotation, translation=translation, near=0.1)
    assert_same_camera(back, ours)
    assert k[0, 2] == pytest.approx(W / 2 - 0.5)
    assert k[1, 2] == pytest.approx(H / 2 - 0.5)


# OpenGL


def test_opengl_puts_points_where_its_window_transform_does():
    ours = off_axis(far=30.0)
    view, projection = cameras.to_opengl(ours, SIZE)
    eye = np.c_[POINTS, np.ones(4)] @ view.T
    clip = eye @ projection.T
    window = (clip[:, :2] / clip[:, 3:] + 1.0) * (W / 2, H / 2)
    expected = np.c_[window[:, 0], H - window[:, 1]]
    # The principal point by the formula of a pinhole, not by a matrix.
    x, y, z = (eye[:, k] for k in range(3))
    np.testing.assert_allclose(expected, np.c_[37.5 - 51 * x / z, 20.25 + 51 * y / z], atol=1e-9)
    camera = cameras.from_opengl(view, projection)
    np.testing.assert_allclose(pixels_of(camera), expected, atol=1e-9)
    assert drawn_pixel(camera, POINTS[0]) == pytest.approx(expected[0], abs=0.7)
    assert_same_camera(camera, ours)


def test_a_frustum_of_opengl_is_taken():
    left, right, bottom, top, near, far = -0.3, 0.5, -0.2, 0.25, 0.5, 40.0
    frustum = np.array(
        [
            [2 * near / (right - left), 0, (right + left) / (right - left), 0],
            [0, 2 * near / (top - bottom), (top + bottom) / (top - bottom), 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
    )
    camera = cameras.from_opengl(np.eye(4), frustum)
    corner = np.array([[right * 4, top * 4, -near * 4], [left, bottom, -near]])
    np.testing.assert_allclose(pixels_of(camera, corner), [[W, 0], [0, H]], atol=1e-9)
    found = cameras.to_opencv(camera, SIZE)
    assert found.intrinsics[0, 2] + 0.5 == pytest.approx(W * -left / (right - left))


# PyTorch3D


def pytorch3d_parameters():
    turn, eye = pose_towards_origin((-2.0, 1.0, 4.0))
    rotation = turn * (-1, 1, -1)
    return rotation, -eye @ rotation


@pytest.mark.parametrize("size", [(64, 48), (30, 50)])
def test_pytorch3d_puts_points_where_its_formulas_do(size):
    width, height = size
    rotation, shift = pytorch3d_parameters()
    focal, point = np.array([1.7, 1.9]), np.array([0.1, -0.25])
    camera = cameras.from_pytorch3d(rotation, shift, focal, size, principal_point=point)
    seen = POINTS @ rotation + shift
    assert (seen[:, 2] > 0).all()
    ndc = focal * seen[:, :2] / seen[:, 2:] + point
    short = min(size)
    expected = np.c_[width / 2 - short / 2 * ndc[:, 0], height / 2 - short / 2 * ndc[:, 1]]
    np.testing.assert_allclose(pixels_of(camera, size=size), expected, atol=1e-9)
    assert drawn_pixel(camera, POINTS[3], size) == pytest.approx(expected[3], abs=0.7)
    # The same in pixels: in_ndc=False.
    screen = cameras.from_pytorch3d(
        rotation[None], shift[None], focal * short / 2, size, space="screen",
        principal_point=np.array([width, height]) / 2 - point * short / 2,
    )  # fmt: skip
    assert_same_camera(screen, camera, size)
    for space in ("ndc", "screen"):
        found = cameras.to_pytorch3d(camera, size, space)
        again = cameras.from_pytorch3d(
            found.R, found.T, found.focal_length, size, space=space,
            principal_point=found.principal_point,
        )  # fmt: skip
        assert_same_camera(again, camera, size)
    np.testing.assert_allclose(cameras.to_pytorch3d(camera, size).principal_point, point)
    np.testing.assert_allclose(cameras.to_pytorch3d(camera, size).R, rotation, atol=1e-12)


def test_pytorch3d_camera_that_nobody_moved_looks_along_z_with_x_to_the_left():
    camera = cameras.from_pytorch3d(np.eye(3), np.zeros(3), 1.0, SIZE)
    (x, y), (ahead, _) = pixels_of(camera, np.array([[0.5, 0.5, 2.0], [0, 0, 2.0]]))
    assert x < ahead == W / 2
    assert y < H / 2


# Blender


def blender_pixels(world, size, lens, sensor, fits_width, shift):
    """Project by K of lens, sensor and shift, and by the object's inverse matrix."""
    width, height = size
    side = width if fits_width else height
    focal = lens * side / sensor
    seen = np.c_[POINTS, np.ones(4)] @ np.linalg.inv(world).T
    u = width / 2 - shift[0] * side + focal * seen[:, 0] / -seen[:, 2]
    v = height / 2 + shift[1] * side - focal * seen[:, 1] / -seen[:, 2]
    return np.c_[u, v]


@pytest.mark.parametrize(
    ("size", "fit", "sensor", "fits_width"),
    [
        ((64, 48), "AUTO", 36.0, True), ((48, 64), "AUTO", 36.0, False),
        ((48, 64), "HORIZONTAL", 36.0, True), ((64, 48), "VERTICAL", 20.0, False),
    ],
)  # fmt: skip
def test_blender_puts_points_where_lens_and_sensor_say(size, fit, sensor, fits_width):
    turn, eye = pose_towards_origin((3.0, -4.0, 2.0), up=(0, 0, 1))
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = turn, eye
    scaled = world.copy()
    scaled[:3, :3] *= (2.0, 3.0, 0.5)
    camera = cameras.from_blender(
        scaled, size, lens=42.0, sensor_width=36.0, sensor_height=20.0, sensor_fit=fit,
        shift_x=0.1, shift_y=-0.05,
    )  # fmt: skip
    expected = blender_pixels(world, size, 42.0, sensor, fits_width, (0.1, -0.05))
    np.testing.assert_allclose(pixels_of(camera, size=size), expected, atol=1e-9)
    assert drawn_pixel(camera, POINTS[3], size) == pytest.approx(expected[3], abs=0.7)
    found = cameras.to_blender(camera, size)
    again = cameras.from_blender(clip_end=found.clip_end, size=size, **taken(found))
    assert_same_camera(again, camera, size)
    np.testing.assert_allclose(found.matrix_world, world, atol=1e-12)


def taken(found):
    """Return what `from_blender` takes of what `to_blender` gives."""
    return {name: value for name, value in found._asdict().items() if name != "clip_end"}


def test_blender_shift_to_the_right_moves_the_picture_to_the_left():
    plain, shifted = (cameras.from_blender(np.eye(4), SIZE, shift_x=s) for s in (0.0, 0.25))
    ahead = np.array([[0.0, 0.0, -5.0]])
    np.testing.assert_allclose(pixels_of(plain, ahead), [[W / 2, H / 2]])
    np.testing.assert_allclose(pixels_of(shifted, ahead), [[W / 4, H / 2]])


def test_blender_field_of_view_is_that_of_the_fitted_side():
    camera = cameras.from_blender(np.eye(4), SIZE, fov=90.0)
    np.testing.assert_allclose(pixels_of(camera, np.array([[1.0, 0.0, -1.0]])), [[W, H / 2]])
    same = cameras.from_blender(np.eye(4), SIZE, lens=18.0)
    assert_same_camera(same, camera)


@pytest.mark.parametrize("size", [(64, 48), (30, 50)])
def test_blender_parallel_view(size):
    turn, eye = pose_towards_origin((3.0, -4.0, 2.0), up=(0, 0, 1))
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = turn, eye
    camera = cameras.from_blender(
        world, size, type="ORTHO", ortho_scale=5.0, shift_x=0.1, shift_y=0.2, clip_end=20.0
    )
    side = max(size)
    seen = (POINTS - eye) @ turn
    pixel = 5.0 / side
    expected = np.c_[
        size[0] / 2 + (seen[:, 0] - 0.1 * 5.0) / pixel,
        size[1] / 2 - (seen[:, 1] - 0.2 * 5.0) / pixel,
    ]
    np.testing.assert_allclose(pixels_of(camera, size=size), expected, atol=1e-9)
    found = cameras.to_blender(camera, size)
    assert (found.clip_start, found.clip_end) == pytest.approx((0.1, 20.0))
    assert found.ortho_scale == pytest.approx(5.0 * size[0] / side)
    again = cameras.from_blender(size=size, clip_end=found.clip_end, **taken(found))
    assert_same_camera(again, camera, size)


# trimesh


def trimesh_scene(size=SIZE):
    import trimesh

    turn, eye = pose_towards_origin((2.0, 1.0, 3.5))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, eye
    camera = trimesh.scene.Camera(resolution=size, fov=(55.0, 40.0), z_near=0.2, z_far=50.0)
    return trimesh.Scene(camera=camera, camera_transform=pose)


def test_trimesh_rays_pass_through_the_middle_of_their_pixels():
    scene = trimesh_scene((6, 4))
    camera = cameras.from_trimesh(scene.camera, scene.camera_transform)
    origins, directions, pixels = scene.camera_rays()
    seen = pixels_of(camera, origins + 2.5 * directions, (6, 4))
    # trimesh counts rows from the bottom.
    rows = 3 - pixels[:, 1]
    np.testing.assert_allclose(seen, np.c_[pixels[:, 0], rows] + 0.5, atol=1e-9)


def test_trimesh_puts_points_where_its_matrix_does():
    scene = trimesh_scene()
    camera = cameras.from_trimesh(scene.camera, scene.camera_transform)
    seen = np.c_[POINTS, np.ones(4)] @ np.linalg.inv(scene.camera_transform).T
    uvw = np.c_[seen[:, 0], -seen[:, 1], -seen[:, 2]] @ scene.camera.K.T
    np.testing.assert_allclose(pixels_of(camera), uvw[:, :2] / uvw[:, 2:], atol=1e-9)
    assert drawn_pixel(camera, POINTS[1]) == pytest.approx(uvw[1, :2] / uvw[1, 2], abs=0.7)


def test_trimesh_and_back():
    scene = trimesh_scene()
    camera = cameras.from_trimesh(scene.camera, scene.camera_transform)
    made, transform = cameras.to_trimesh(camera, SIZE)
    np.testing.assert_allclose(made.K, scene.camera.K)
    np.testing.assert_allclose(made.fov, scene.camera.fov)
    np.testing.assert_allclose(transform, scene.camera_transform, atol=1e-12)
    assert (made.z_near, made.z_far) == pytest.approx((0.2, 50.0))
    assert_same_camera(cameras.from_trimesh(made, transform), camera)


@pytest.mark.parametrize("fov", [(55.0, 40.0), (60.0, 45.0), (40.0, 80.0)])
def test_a_trimesh_scene_is_seen_as_its_camera_is(fov):
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh_scene()
    scene.camera.fov = fov
    scene.camera.z_far = 1000.0
    scene.add_geometry(trimesh.creation.box())
    own = rj.load(scene).camera
    assert_same_camera(own, cameras.from_trimesh(scene.camera, scene.camera_transform))
    assert own.far == math.inf
    # In other sizes it keeps what it sees from bottom to top, and the shape of pixels.
    wide = own.projection_matrix((2 * W, H))
    assert wide[0, 0] == pytest.approx(own.projection_matrix(SIZE)[0, 0] / 2.0)
    assert wide[1, 1] == own.projection_matrix(SIZE)[1, 1]


# The size that a camera is made for


def made_for_a_size():
    """Return cameras that are made for images of W x H pixels, by the name of who makes them."""
    scene = trimesh_scene()
    return {
        "intrinsics": off_axis(),
        "opencv": cameras.from_opencv(opencv_parameters()[0], SIZE),
        "pytorch3d": cameras.from_pytorch3d(np.eye(3), np.zeros(3), 1.0, SIZE),
        "blender": cameras.from_blender(np.eye(4), SIZE),
        "blender, parallel": cameras.from_blender(np.eye(4), SIZE, type="ORTHO", clip_end=9.0),
        "trimesh": cameras.from_trimesh(scene.camera, scene.camera_transform),
    }


@pytest.mark.parametrize("name", made_for_a_size())
def test_a_camera_made_for_one_size_is_not_stretched_to_another(name):
    camera = made_for_a_size()[name]
    cube = rj.load(Path(__file__).parents[2] / "models" / "cube.ply")
    with pytest.raises(ValueError, match=rf"^size .* {W} x {H}.* got {W} x {H + 9}; .*replace"):
        rj.render(cube, camera, size=(W, H + 9))
    for told in ((W, H + 9), None):
        stretched = dataclasses.replace(camera, size=told)
        assert np.array_equal(stretched.projection_matrix((W, H + 9)), camera.clip_from_view)


def test_an_error_bound_is_met_with_a_camera_made_for_a_size():
    # Small pictures, of another aspect than this wide one, tell which quality is enough.
    size = 200, 60
    cube = rj.load(Path(__file__).parents[2] / "models" / "cube.ply")
    matrix = rj.fit_camera(cube).view_matrix()
    camera = rj.MatrixCamera.from_intrinsics(70, 70, 100, 30, size, view_from_world=matrix)
    assert rj.render(cube, camera, size=size, max_error=0.5, threads=1).color.shape == (60, 200, 4)


def test_the_camera_of_an_earlier_view_is_named():
    cube = rj.load(Path(__file__).parents[2] / "models" / "cube.ply")
    view = rj.PreviousView(camera=off_axis())
    with pytest.raises(ValueError, match=rf"^previous\.camera: size .* {W} x {H}"):
        rj.render(cube, size=(W, W), outputs="motion", previous=view)


def test_a_size_of_the_same_aspect_up_to_rounded_sides_is_taken():
    camera = cameras.from_opencv(np.eye(3), (641, 481))
    taken = [(641, 481), (320, 240), (321, 241), (320, 241), (1282, 962), (64, 48), (6410, 4810)]
    for size in taken:
        assert np.array_equal(camera.projection_matrix(size), camera.clip_from_view)
    for size in ((640, 640), (481, 641), (321, 239), (1282, 959), (6410, 4800)):
        with pytest.raises(ValueError, match="641 x 481"):
            camera.projection_matrix(size)


def test_half_the_size_has_the_intrinsics_that_opencv_has_for_it():
    k, rotation, translation = opencv_parameters()
    camera = cameras.from_opencv(k, SIZE, rotation=rotation, translation=translation)
    half = cameras.to_opencv(camera, (W // 2, H // 2)).intrinsics
    want = np.diag([0.5, 0.5, 1.0]) @ k
    # Of cv2.resize: centres of pixels are whole numbers on both sides.
    want[:2, 2] -= 0.25
    np.testing.assert_allclose(half, want, rtol=1e-13)


# Poses that mirror


LEFT = np.diag([-1.0, 1.0, 1.0, 1.0])
MINUS = np.diag([-1.0, -1.0, -1.0, 1.0])
LENS = rj.transforms.perspective(45.0, 1.0, 0.1, 10.0)
TURNED = rj.transforms.compose(
    rj.transforms.translate((1, 2, 3)), rj.transforms.rotate((1, 2, 3), 40)
)

TAKERS = {
    "matrices": (lambda pose: rj.MatrixCamera(pose, LENS), "view_from_world"),
    "intrinsics": (
        lambda pose: rj.MatrixCamera.from_intrinsics(50, 50, 32, 24, SIZE, view_from_world=pose),
        "view_from_world",
    ),
    "opencv": (
        lambda pose: cameras.from_opencv(np.eye(3), SIZE, camera_from_world=pose),
        "camera_from_world",
    ),
    "opencv, R": (
        lambda pose: cameras.from_opencv(np.eye(3), SIZE, rotation=pose[:3, :3]), "rotation",
    ),
    "opengl": (lambda pose: cameras.from_opengl(pose, LENS), "view"),
    "pytorch3d": (lambda pose: cameras.from_pytorch3d(pose[:3, :3].T, np.zeros(3), 1.0, SIZE), "R"),
    "blender": (lambda pose: cameras.from_blender(pose, SIZE), "matrix_world"),
    "trimesh": (lambda pose: cameras.from_trimesh(trimesh_scene().camera, pose), "transform"),
    "pose": (cameras.view_from_pose, "pose"),
    "replace": (
        lambda pose: dataclasses.replace(off_axis(), view_from_world=pose), "view_from_world",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mirror", [LEFT, MINUS], ids=["x", "xyz"])
@pytest.mark.parametrize("name", TAKERS)
def test_no_constructor_takes_a_pose_that_mirrors(name, mirror):
    take, named = TAKERS[name]
    take(TURNED)
    for pose in (mirror @ TURNED, TURNED @ mirror):
        with pytest.raises(ValueError, match=rf"^{named} must .*mirror"):
            take(pose)


def test_no_field_of_a_camera_with_a_target_can_mirror():
    for up in ((0, 1, 0), (0, -1, 0)):
        for make in (rj.PerspectiveCamera, rj.OrthographicCamera):
            assert np.linalg.det(make((1, 2, 3), (0, 0, 0), up).view_matrix()[:3, :3]) > 0.9


# What is refused


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: cameras.from_opencv(np.ones((3, 3)), SIZE), "intrinsics"),
        (lambda: cameras.from_opencv(np.eye(3) * [[0], [1], [1]], SIZE), "focal"),
        (lambda: cameras.from_opencv(np.eye(3), (0, 1)), "size"),
        (lambda: cameras.from_opencv(np.eye(3), SIZE, rotation=2 * np.eye(3)), "rotation"),
        (lambda: cameras.from_opencv(np.eye(3), SIZE, rotation=-np.eye(3)), "rotation"),
        (lambda: cameras.from_opencv(np.eye(3), SIZE, translation=[1, 2]), "translation"),
        (lambda: cameras.from_opencv(np.eye(3), SIZE, camera_from_world=np.ones((4, 4))), "camera"),
        (lambda: cameras.from_opencv(np.eye(3), SIZE, camera_from_world=np.eye(4),
                                     translation=[0, 0, 0]), "camera_from_world"),
        (lambda: cameras.from_opencv(np.eye(3), SIZE, near=0.0), "near"),
        (lambda: cameras.from_opengl(np.eye(4).T + np.eye(4, k=-3), np.eye(4)), "view"),
        (lambda: cameras.from_opengl(np.eye(4), np.zeros((4, 4))), "projection"),
        (lambda: cameras.from_pytorch3d(np.eye(3), [0, 0, 0], 1.0, SIZE, space="x"), "space"),
        (lambda: cameras.from_pytorch3d(np.zeros((3, 3)), [0, 0, 0], 1.0, SIZE), "R"),
        (lambda: cameras.from_pytorch3d(np.eye(3), [0, 0], 1.0, SIZE), "T"),
        (lambda: cameras.from_pytorch3d(np.eye(3), [0, 0, 0], "a", SIZE), "focal_length"),
        (lambda: cameras.from_pytorch3d(np.eye(3), [0, 0, 0], -1.0, SIZE), "focal"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, type="PANO"), "type"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, sensor_fit="x"), "sensor_fit"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, lens=50, fov=30.0), "lens"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, type="ORTHO"), "clip_end"),
        (lambda: cameras.from_blender(np.zeros((4, 4)), SIZE), "matrix_world"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, shift_x=math.nan), "shift_x"),
        (lambda: cameras.from_trimesh(None, np.eye(4)), "camera"),
        (lambda: cameras.to_opencv(rj.OrthographicCamera((0, 0, 1), (0, 0, 0)), SIZE), "camera"),
        (lambda: cameras.to_opencv("x", SIZE), "camera"),
        (lambda: cameras.to_opengl(None, SIZE), "camera"),
        (lambda: cameras.to_trimesh(off_axis(), SIZE), "middle"),
        (lambda: cameras.to_blender(off_axis(fy=40.0), SIZE), "square"),
        (lambda: cameras.to_pytorch3d(cameras.from_opencv(*opencv_parameters()[:1], SIZE), SIZE),
         "skew"),
        (lambda: cameras.to_opencv(rj.MatrixCamera(
            np.diag([2.0, 2.0, 2.0, 1.0]), rj.transforms.perspective(40, 1, 1, 9)), SIZE),
         "scaled"),
    ],
)  # fmt: skip
def test_bad_input_is_named(call, named):
    with pytest.raises(ValueError, match=named):
        call()


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: cameras.from_opencv(np.diag([-2.0, 1.0, 1.0]), SIZE),
         r"^intrinsics must have focal lengths above 0, got \[\[-2.0"),
        (lambda: cameras.from_opencv(np.eye(3), SIZE, near=2.0, far=1.0),
         "^far must be above near"),
        (lambda: cameras.from_pytorch3d(np.eye(3), [0, 0, 0], -1.5, SIZE),
         r"^focal_length must be above 0, got \[-1.5\]"),
        (lambda: cameras.from_pytorch3d(np.eye(3), [0, 0, 0], [2.0, 0.0], SIZE, space="screen"),
         r"^focal_length must be above 0, got \[2.0, 0.0\]"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, clip_start=0.0),
         "^clip_start must be above 0, got 0.0"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, clip_start=4.0, clip_end=2.0),
         "^clip_end must be above clip_start = 4.0, got 2.0"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, clip_end=math.nan),
         "^clip_end must be finite"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, type="ORTHO", clip_end=0.1),
         "^clip_end must be above clip_start = 0.1, got 0.1"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, type="ORTHO", clip_start="a", clip_end=1.0),
         "^clip_start must be a number, got 'a'"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, sensor_width=0.0),
         "^sensor_width must be above 0, got 0.0"),
        (lambda: cameras.from_blender(np.eye(4), SIZE, sensor_fit="VERTICAL", sensor_height=-1.0),
         "^sensor_height must be above 0, got -1.0"),
    ],
)  # fmt: skip
def test_the_message_names_what_the_caller_gave(call, told):
    with pytest.raises(ValueError, match=told):
        call()


def test_the_message_about_a_camera_of_trimesh_names_its_part():
    from trimesh.scene import Camera

    camera = Camera(resolution=(8, 6), focal=(5.0, 5.0), z_near=3.0, z_far=2.0)
    with pytest.raises(ValueError, match=r"^camera\.z_far must be above camera\.z_near"):
        cameras.from_trimesh(camera, np.eye(4))
