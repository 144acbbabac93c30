"""Points lead to pixels and back by the numbers of the pipeline, and by OpenCV's formulas."""

import dataclasses
import math

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms as tf

SIZE = W, H = (64, 48)
EYE, TARGET = (2.0, 1.5, 4.0), (0.1, 0.2, 0.0)
VIEW = rj.PerspectiveCamera(EYE, TARGET).view_matrix()
K = np.array([[90.0, 1.5, 30.0], [0.0, 85.0, 26.0], [0.0, 0.0, 1.0]])
POSE = tf.compose(tf.translate((0.1, -0.2, 5.0)), tf.rotate((1, 2, 3), 200.0))

CAMERAS = {
    "perspective": rj.PerspectiveCamera(EYE, TARGET, fov_y=40.0),
    "perspective, near and far": rj.PerspectiveCamera(EYE, TARGET, near=0.5, far=60.0),
    "parallel": rj.OrthographicCamera(EYE, TARGET, height=3.0, near=-1.0, far=20.0),
    "opencv": rj.cameras.from_opencv(K, SIZE, camera_from_world=POSE),
    "matrices": rj.MatrixCamera(VIEW, tf.perspective(50.0, 4 / 3, 0.3, 40.0)),
    "matrices, scaled": rj.MatrixCamera(
        tf.compose(tf.scale(2.0), VIEW), tf.perspective(50.0, 4 / 3, 0.3, 40.0)
    ),
    "matrices, parallel": rj.MatrixCamera(VIEW, tf.orthographic(-2, 1.5, -1.25, 1.5, 0.0, 10.0)),
    "matrices, oblique": rj.MatrixCamera(
        VIEW, tf.compose(tf.orthographic(-2, 2, -1.5, 1.5, 0.0, 10.0), tf.shear(xz=0.2, yz=-0.1))
    ),
    "matrices, mirrored": rj.MatrixCamera(
        VIEW, tf.compose(tf.scale((-1, 1, 1)), tf.perspective(50.0, 4 / 3, 0.3, 40.0))
    ),
    "matrices, the view in the projection": rj.MatrixCamera(
        np.eye(4), tf.compose(tf.perspective(50.0, 4 / 3, 0.3, 40.0), VIEW)
    ),
}


@pytest.fixture(params=CAMERAS)
def camera(request):
    return CAMERAS[request.param]


def centers(size=SIZE):
    """Return the centres of all pixels, (H, W, 2)."""
    rows, columns = np.indices(size[::-1])
    return np.stack([columns, rows], axis=-1) + 0.5


@pytest.fixture(scope="module")
def scene():
    """Return boxes around the point that the cameras look at, some of them cut by the image."""
    made = rj.Scene()
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for p, q, r, s in sides for a, b, c in ((p, q, r), (p, r, s))]
    box = rj.Mesh(corners, faces)
    for number, place in enumerate(((0, 0, 0), (1.5, 0.5, -1), (-1.2, -0.6, 0.7), (0.4, 1.2, 0))):
        turn = tf.rotate((1, 2, 3), 30.0 * number)
        made.add(box, tf.compose(tf.translate(place), turn, tf.scale(0.6)))
    return made


def frame_of(scene, camera):
    outputs = "depth", "position", "distance"
    return rj.render(scene, camera, size=SIZE, outputs=outputs, threads=1)


SNAPPED = 0.003
"""Vertices are snapped to 1/256 pixel: up to half of it off, each way; and float32."""


def test_positions_are_projected_to_the_centres_of_their_pixels(camera, scene):
    frame = frame_of(scene, camera)
    seen = np.isfinite(frame.depth)
    assert 300 < seen.sum() < seen.size
    pixels, depth = camera.project(frame.position, SIZE)
    assert np.abs(pixels - centers())[seen].max() < SNAPPED
    np.testing.assert_allclose(depth[seen], frame.depth[seen], rtol=3e-6, atol=1e-5)
    assert np.isnan(pixels[~seen]).all()


def test_depth_is_projected_back_to_positions(camera, scene):
    frame = frame_of(scene, camera)
    seen = np.isfinite(frame.depth)
    points = camera.unproject(centers(), frame.depth, SIZE)
    assert points.dtype == np.float64
    assert np.isnan(points[~seen]).all()
    pixels, depth = camera.project(points, SIZE)
    np.testing.assert_allclose(pixels[seen], centers()[seen], atol=1e-9)
    np.testing.assert_allclose(depth[seen], frame.depth[seen], rtol=1e-12, atol=1e-12)
    # As far off as the snapped vertices are, at a depth of 10 on 64 pixels.
    assert np.abs(points - frame.position)[seen].max() < 10.0 / 64.0 * 2.0 * SNAPPED


def test_rays_lead_through_what_the_pixels_show(camera, scene):
    frame = frame_of(scene, camera)
    seen = np.isfinite(frame.depth)
    origins, directions = camera.rays(SIZE)
    assert origins.shape == directions.shape == (H, W, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, rtol=1e-14)
    points = camera.unproject(centers(), np.where(seen, frame.depth, 1.0), SIZE)
    reach = ((points - origins) * directions).sum(axis=-1)
    assert (reach > 0.0).all()
    np.testing.assert_allclose(origins + reach[..., None] * directions, points, atol=1e-11)
    if camera is not CAMERAS["matrices, oblique"]:
        np.testing.assert_allclose(reach[seen], frame.distance[seen], rtol=3e-5)


def test_pixels_are_those_of_opencv_moved_by_half_a_pixel():
    camera = CAMERAS["opencv"]
    points = np.random.default_rng(2).normal(size=(50, 3))
    pixels, depth = camera.project(points, SIZE)
    x, y, z = K @ tf.apply(POSE, points).T
    np.testing.assert_allclose(pixels, np.column_stack([x / z, y / z]) + 0.5, atol=1e-11)
    np.testing.assert_allclose(depth, z, rtol=1e-13)
    opencv = pytest.importorskip("cv2")
    turn, _ = opencv.Rodrigues(POSE[:3, :3])
    found, _ = opencv.projectPoints(points, turn, POSE[:3, 3], K, None)
    # It takes no skew.
    plain = rj.cameras.from_opencv(
        K * [[1, 0, 1], [1, 1, 1], [1, 1, 1]], SIZE, camera_from_world=POSE
    )
    np.testing.assert_allclose(plain.project(points, SIZE).pixels, found[:, 0] + 0.5, atol=1e-10)


def test_half_the_size_has_half_the_pixels():
    camera, points = CAMERAS["opencv"], np.random.default_rng(2).normal(size=(50, 3))
    whole, half = (camera.project(points, (W // n, H // n)).pixels for n in (1, 2))
    np.testing.assert_allclose(half, whole / 2.0, rtol=1e-13)
    with pytest.raises(ValueError, match=r"^size .*64 x 48"):
        camera.project(points, (W, W))


def test_what_is_not_in_front_of_the_eye_is_at_no_pixel(camera):
    eye, forward = camera.eye_position(), camera.unproject((W / 2, H / 2), 2.0, SIZE)
    behind = 2.0 * eye - forward
    pixels, depth = camera.project([forward, behind, (math.nan, 0, 0), (math.inf, 0, 0)], SIZE)
    assert depth[:2] == pytest.approx([2.0, -2.0]) or camera is CAMERAS["matrices, oblique"]
    assert np.isfinite(pixels[0]).all()
    is_parallel = not camera.projection_matrix(SIZE)[3, :3].any()
    assert np.isfinite(pixels[1]).all() == is_parallel
    assert not np.isfinite(pixels[2:]).any()
    back = camera.unproject([(1, 2)] * 4, [math.inf, math.nan, -math.inf, -1.0], SIZE)
    assert np.isnan(back[:3]).all()
    assert np.isfinite(back[3]).all() == is_parallel


def test_the_eye_itself_is_at_no_pixel():
    camera = CAMERAS["perspective"]
    pixels, depth = camera.project(EYE, SIZE)
    assert np.isnan(pixels).all()
    assert depth == 0.0


@pytest.mark.parametrize("shape", [(), (0,), (1,), (5,), (2, 3), (2, 3, 4)])
def test_arrays_keep_their_shape(camera, shape):
    points = np.random.default_rng(3).normal(size=(*shape, 3)) * 0.5
    pixels, depth = camera.project(points, SIZE)
    assert (pixels.shape, depth.shape) == ((*shape, 2), shape)
    np.testing.assert_allclose(camera.unproject(pixels, depth, SIZE), points, atol=1e-11)
    assert camera.unproject(pixels, 2, SIZE).shape == (*shape, 3)


@pytest.mark.parametrize("kind", ["perspective", "parallel"])
def test_far_from_the_origin_no_digits_are_lost(kind):
    here, offset = CAMERAS[kind], np.array([3e8, -2e8, 1e8])
    there = dataclasses.replace(here, eye=here.eye + offset, target=here.target + offset)
    points = np.round(np.random.default_rng(4).normal(size=(20, 3)) * 4096.0) / 4096.0
    near, far = here.project(points, SIZE), there.project(points + offset, SIZE)
    np.testing.assert_allclose(far.pixels, near.pixels, atol=1e-5)
    back = there.unproject(far.pixels, far.depth, SIZE) - offset
    np.testing.assert_allclose(back, points, atol=2e-7)


FLAT = rj.MatrixCamera(np.eye(4), np.diag([1.0, 0.0, -1.0, 1.0]))


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda camera: camera.project([(1, 2)], SIZE), r"points must have shape \(\.\.\., 3\)"),
        (lambda camera: camera.project(3.0, SIZE), "points"),
        (lambda camera: camera.project("abc", SIZE), "points"),
        (lambda camera: camera.project([(1, 2, 3), (1, 2)], SIZE), "points"),
        (lambda camera: camera.project([(1, 2, 3j)], SIZE), "points"),
        (lambda camera: camera.project((1, 2, 3), (0, 4)), "size"),
        (lambda camera: camera.unproject([(1, 2, 3)], 1.0, SIZE), "pixels must have"),
        (lambda camera: camera.unproject([(1, 2)], [1.0, 2.0], SIZE), "depth must have the shape"),
        (lambda camera: camera.unproject((1, 2), [1.0, 2.0], SIZE), "depth must have the shape"),
        (lambda camera: camera.unproject([(1, 2)], "far", SIZE), "depth"),
        (lambda camera: camera.unproject([(1, 2)], np.ma.array([1.0], mask=True), SIZE), "depth"),
        (lambda camera: camera.unproject([(1, 2)], 1.0, "big"), "size"),
        (lambda camera: camera.rays((4, -1)), "size"),
        (lambda camera: FLAT.rays(SIZE), "camera must not flatten"),
        (lambda camera: FLAT.unproject((1, 2), 1.0, SIZE), "camera must not flatten"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(call, named):
    with pytest.raises(ValueError, match=f"^{named}"):
        call(CAMERAS["perspective"])
