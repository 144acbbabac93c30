"""Cameras that fit a scene: everything is in the picture, in its middle, and as large as it can."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.scene import point_bounds
from rasterjit.scene import transforms as tf

MARGIN = 1.06
ALL = settings(max_examples=150, deadline=None)
PROJECTIONS = ("perspective", "orthographic")

both = pytest.mark.parametrize("projection", PROJECTIONS)
projections = st.sampled_from(PROJECTIONS)
directions = st.sampled_from([(0, 0, 1), (1, 0, 0), (0, 1, 0), (1, 2, 3), (-4, 1, 0.5), (0, -3, 1)])
seeds = st.integers(0, 2**32 - 1)
aspects = st.floats(0.2, 5.0)
fields = st.floats(2.0, 150.0)


def cloud(seed, count=12, stretch=(1.0, 1.0, 1.0)):
    """Return vertices at random, (count, 3), longer in some directions."""
    numbers = np.random.default_rng(seed)
    return numbers.normal(size=(count, 3)) * stretch + numbers.normal(size=3)


def scene_of(vertices):
    """Return a scene of a mesh that uses all of the vertices."""
    count = len(vertices)
    faces = np.column_stack([np.arange(count), np.roll(np.arange(count), 1), np.zeros(count, int)])
    scene = rj.Scene()
    scene.add(rj.Mesh(vertices, faces))
    return scene


def clip_of(camera, points, aspect):
    """Return clip coordinates, (N, 4), in a picture of any aspect, pixels aside."""
    size = 10_000, 10_000
    matrix = camera.projection_matrix(size)
    # Those of the aspect without rounding it to whole pixels.
    matrix[0] /= aspect
    if aspect < camera.min_aspect:
        matrix[:2] *= aspect / camera.min_aspect
    if camera.min_aspect > 1.0:
        matrix[:2] *= camera.min_aspect
    points = np.atleast_2d(points)
    return np.column_stack([points, np.ones(len(points))]) @ (matrix @ camera.view_matrix()).T


def ndc_of(camera, points, aspect):
    clip = clip_of(camera, points, aspect)
    return clip[:, :3] / clip[:, 3:]


def check_fit(camera, points, aspect, margin=MARGIN, tolerance=1e-9):
    """Fail unless points fill the picture from one border to the other, less the margin."""
    clip = clip_of(camera, points, aspect)
    assert (clip[:, 3] > 0.0).all()
    ndc = clip[:, :3] / clip[:, 3:]
    assert (np.abs(ndc[:, 2]) <= 1.0).all(), "cut by the near or far plane"
    low, high = ndc[:, :2].min(axis=0), ndc[:, :2].max(axis=0)
    assert np.abs(low + high).max() <= tolerance, "not in the middle"
    if clip[:, 3].min() < 1.01 * point_bounds.MIN_CLEARANCE * radius_of(points):
        assert high.max() <= 1.0 / margin + tolerance
        return
    assert high.max() == pytest.approx(1.0 / margin, abs=tolerance)


def radius_of(points):
    """Return the radius of points around the middle of their box."""
    offsets = points - (points.min(axis=0) + points.max(axis=0)) / 2.0
    return math.sqrt((offsets * offsets).sum(axis=1).max())


@ALL
@given(seeds, directions, aspects, fields, projections, st.floats(1.0, 3.0), st.integers(0, 2))
def test_everything_is_in_the_picture_and_touches_its_tighter_sides(
    seed, direction, aspect, fov_y, projection, margin, longest
):
    stretch = np.ones(3)
    stretch[longest] = 4.0
    points = cloud(seed, stretch=stretch)
    camera = rj.fit_camera(
        scene_of(points), direction, fov_y, aspect=aspect, projection=projection, margin=margin
    )
    check_fit(camera, points, aspect, margin)
    if projection == "perspective":
        assert camera.fov_y == fov_y
    toward = tf.unit_vector("direction", direction)
    np.testing.assert_allclose(camera.view_matrix()[2, :3], toward, atol=1e-12)


@both
@pytest.mark.parametrize("aspect", [1.0, 0.5, 3.0])
@pytest.mark.parametrize("shape", [(5, 1, 1), (1, 5, 1), (1, 1, 5)])
def test_everything_is_in_pictures_of_other_shapes_too(projection, aspect, shape):
    points = cloud(3, 40, shape)
    camera = rj.fit_camera(scene_of(points), aspect=aspect, projection=projection)
    ends = np.column_stack([points, np.ones(len(points))])
    own = camera.projection_matrix((round(1000 * aspect), 1000))
    for size in ((400, 400), (300, 400), (100, 1600), (900, 400), (1600, 100)):
        clip = ends @ (camera.projection_matrix(size) @ camera.view_matrix()).T
        assert (np.abs(clip[:, :3]) <= clip[:, 3:]).all(), size
        # No narrower than need be: where nothing is cut, the field of view is what it says.
        if size[0] / size[1] >= aspect:
            assert camera.projection_matrix(size)[1, 1] == pytest.approx(own[1, 1]), size


@both
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6, 2.0**900, 2.0**-900])
def test_size_of_a_scene_scales_its_camera(size, projection):
    points = cloud(5, 30)
    camera, scaled = (
        rj.fit_camera(scene_of(points * one), (1, 2, 3), aspect=1.5, projection=projection)
        for one in (1.0, size)
    )
    for name in ("eye", "target", "near", "far"):
        np.testing.assert_allclose(
            np.divide(getattr(scaled, name), size), getattr(camera, name), rtol=1e-9
        )
    assert scaled.min_aspect == pytest.approx(camera.min_aspect)


@both
@pytest.mark.parametrize("offset", [(1e6, 0.0, 0.0), (-1e6, 1e6, 2e6)])
def test_place_of_a_scene_moves_its_camera(offset, projection):
    points = cloud(6, 30)
    camera, moved = (
        rj.fit_camera(scene_of(points + one), (1, 2, 3), aspect=0.7, projection=projection)
        for one in (np.zeros(3), np.array(offset))
    )
    for name in ("eye", "target"):
        np.testing.assert_allclose(
            np.subtract(getattr(moved, name), offset), getattr(camera, name), atol=1e-8
        )
    check_fit(moved, points + np.array(offset), 0.7, tolerance=1e-8)


@both
def test_a_camera_that_fits_is_nearer_than_one_that_is_steady(projection):
    points = cloud(7, 30, (6, 1, 1))
    scene = scene_of(points)
    shares = []
    for steady in (False, True):
        camera = rj.fit_camera(scene, aspect=2.0, projection=projection, steady=steady)
        shares.append(np.abs(ndc_of(camera, points, 2.0)[:, :2]).max())
    assert shares[1] < 0.9 * shares[0]


@both
@pytest.mark.parametrize("aspect", [0.5, 2.0])
def test_steady_cameras_are_all_equally_far_away(projection, aspect):
    scene = scene_of(cloud(8, 30, (1, 4, 1)))
    center, radius = scene.bounding_sphere()
    cameras = [
        rj.fit_camera(
            scene, rj.orbit_direction(angle, 20.0), aspect=aspect, projection=projection,
            steady=True,
        )
        for angle in range(0, 360, 40)
    ]  # fmt: skip
    distances = [math.dist(camera.eye, center) for camera in cameras]
    np.testing.assert_allclose(distances, distances[0], rtol=1e-12)
    assert {camera.target for camera in cameras} == {tuple(center.tolist())}
    assert {(camera.near, camera.far) for camera in cameras} == {(cameras[0].near, cameras[0].far)}
    assert cameras[0].near < distances[0] - radius < distances[0] + radius < cameras[0].far


def test_zoom_leaves_the_camera_where_it_is():
    points = cloud(9, 30)
    plain, zoomed = (rj.fit_camera(scene_of(points), zoom=zoom) for zoom in (1.0, 2.5))
    assert (plain.eye, plain.target) == (zoomed.eye, zoomed.target)
    np.testing.assert_allclose(
        ndc_of(zoomed, points, 1.0)[:, :2], 2.5 * ndc_of(plain, points, 1.0)[:, :2], rtol=1e-9
    )


@both
@pytest.mark.parametrize("unit", ["world", "pixel"])
def test_points_are_fitted_with_their_sizes_in_scene_units(projection, unit):
    places = cloud(10, 20)
    sizes = np.linspace(0.1, 2.0, 20) if unit == "world" else np.full(20, 3.0)
    scene = rj.Scene()
    shape = "sphere" if unit == "world" else "disc"
    scene.add(rj.Points(places, size=sizes, unit=unit, shape=shape))
    camera = rj.fit_camera(scene, aspect=1.3, projection=projection)
    if unit == "pixel":
        check_fit(camera, places, 1.3)
        return
    ball = cloud(0, 20_000)
    ball /= np.sqrt((ball * ball).sum(axis=1))[:, np.newaxis]
    shown = (places[:, np.newaxis] + 0.5 * sizes[:, np.newaxis, np.newaxis] * ball).reshape(-1, 3)
    check_fit(camera, shown, 1.3, tolerance=2e-3)


@both
def test_lines_are_fitted_with_their_widths_in_scene_units(projection):
    ends = np.array([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    scene = rj.Scene()
    scene.add(rj.Lines(ends, width=0.5, unit="world"))
    camera = rj.fit_camera(scene, (0, 0, 1), projection=projection)
    edge = np.abs(ndc_of(camera, [(1.25, 0.0, 0.0), (-1.25, 0.0, 0.0)], 1.0)[:, 0])
    assert edge == pytest.approx(1.0 / MARGIN, abs=0.02)


@both
def test_what_is_drawn_is_fitted_wherever_it_is_and_however_often(projection):
    points = cloud(11, 30)
    mesh = scene_of(points).nodes[0].mesh
    scene = rj.Scene()
    above = scene.add(mesh, tf.translate((3.0, 0.0, 0.0)))
    scene.add(mesh, tf.compose(tf.rotate((1, 2, 3), 50.0), tf.scale(2.0)), parent=above)
    shown = [tf.apply(node.world_from_model, points) for node in scene.nodes]
    camera = rj.fit_camera(scene, (1, -1, 2), aspect=1.5, projection=projection)
    check_fit(camera, np.concatenate(shown), 1.5)


@both
def test_vertices_that_nothing_shows_do_not_count(projection):
    points = cloud(12, 30)
    stray = np.vstack([points, [(50.0, 60.0, 70.0), (math.nan, 0.0, 1.0)]])
    faces = scene_of(points).nodes[0].mesh.faces
    with_stray = rj.Mesh(stray, faces, on_invalid="drop")
    assert rj.fit_camera(with_stray, projection=projection) == rj.fit_camera(
        scene_of(points), projection=projection
    )


@both
@pytest.mark.parametrize("aspect", [0.5, 2.0])
@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 1, 0), (1, 0, 0), (1, 1, 1)])
def test_flat_things_fill_the_picture_from_any_side(projection, aspect, direction):
    square = np.array([(-1.0, -2.0, 0.0), (1.0, -2.0, 0.0), (1.0, 2.0, 0.0), (-1.0, 2.0, 0.0)])
    camera = rj.fit_camera(scene_of(square), direction, aspect=aspect, projection=projection)
    check_fit(camera, square, aspect)


@both
def test_a_straight_line_seen_from_its_end_is_before_the_camera(projection):
    ends = np.array([(0.0, 0.0, -2.0), (0.0, 0.0, 2.0), (0.0, 0.0, 0.0)])
    camera = rj.fit_camera(scene_of(ends), (0, 0, 1), projection=projection)
    ndc = ndc_of(camera, ends, 1.0)
    assert np.abs(ndc[:, :2]).max() < 1e-9
    assert np.abs(ndc[:, 2]).max() <= 1.0
    if projection == "perspective":
        assert camera.eye[2] - 2.0 == pytest.approx(2.0 / 64.0)


@both
def test_a_single_vertex_is_framed_as_a_sphere_of_radius_one(projection):
    here = (4.0, -5.0, 6.0)
    camera = rj.fit_camera(scene_of(np.array([here] * 3)), projection=projection)
    assert camera == rj.fit_camera(Sphere(here, 1.0), projection=projection)


class Sphere:
    """Something that knows no more than the sphere around it."""

    def __init__(self, center, radius):
        self.sphere = center, radius

    def bounding_sphere(self):
        return self.sphere


def test_the_fit_is_the_best_one_there_is():
    """A search finds no eye, in this direction, that is nearer and sees everything."""
    points = cloud(13, 40)
    aspect, fov_y = 1.4, 60.0
    camera = rj.fit_camera(scene_of(points), (1, 2, 3), fov_y, aspect=aspect)
    axes = camera.view_matrix()[:3, :3]
    x, y, z = axes @ points.T
    eye = axes @ np.array(camera.eye)
    focal = MARGIN * tf.focal_length(fov_y)
    numbers = np.random.default_rng(1)
    for _ in range(2000):
        dx, dy = numbers.normal(scale=0.05, size=2)
        depth = eye[2] * (1.0 - 1e-4) - z
        is_in = (np.abs(x - eye[0] - dx) * focal / aspect <= depth).all()
        assert not (is_in and (np.abs(y - eye[1] - dy) * focal <= depth).all())


def test_many_points_are_transformed_again_with_the_same_bits(monkeypatch):
    scene = scene_of(cloud(14, 5000))
    expected = rj.fit_camera(scene, aspect=1.7)
    monkeypatch.setattr(point_bounds, "_MAX_CACHED_POINTS", 100)
    assert rj.fit_camera(scene, aspect=1.7) == expected


def test_cameras_of_scenes_without_a_camera_fit_what_is_seen():
    points = cloud(15, 30, (3, 1, 1))
    frame = rj.render(scene_of(points), size=(90, 60), outputs=("face_id",), threads=1)
    check_fit(frame.plan.camera, points, 1.5)
    rows, columns = np.nonzero(frame.face_id >= 0)
    middle = [0.5 * (one.min() + one.max() + 1) for one in (columns, rows)]
    np.testing.assert_allclose(middle, (45.0, 30.0), atol=1.0)
    assert columns.min() == pytest.approx(45 * (1 - 1 / MARGIN), abs=1.5)
