"""Tracks go through their keys, and the short and steady way between them."""

import dataclasses
import math
import sys

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.animation import tracks
from rasterjit.animation.tracks import CameraTrack, MorphTrack, TransformTrack
from rasterjit.scene import transforms

KINDS = ("linear", "smooth")
TIMES = (0.0, 0.5, 2.0, 3.0)


def cameras():
    """Four cameras that look at different points from different distances."""
    eyes = [(0, 0, 5), (4, 1, 0), (0, 6, -3), (-5, 2, 1)]
    targets = [(0, 0, 0), (0, 0.5, 0), (0.2, 0, 0.1), (0, 0, 1)]
    fovs = (30.0, 60.0, 60.0, 45.0)
    return [
        rj.PerspectiveCamera(eye, target, fov_y=fov, near=0.1 * fov)
        for eye, target, fov in zip(eyes, targets, fovs, strict=True)
    ]


def orientation(camera):
    return camera.view_matrix()[:3, :3]


@pytest.mark.parametrize("kind", KINDS)
def test_a_track_goes_through_its_keys(kind):
    track = CameraTrack(TIMES, cameras(), kind)
    assert [track(time) for time in TIMES] == cameras()
    matrices = [
        transforms.compose(transforms.translate((k, 0, 1)), transforms.rotate_y(50 * k))
        for k in range(4)
    ]
    moving = TransformTrack(TIMES, matrices, kind)
    assert np.array_equal([moving(time) for time in TIMES], matrices)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", [-1e-7, 1e-7])
def test_a_track_is_continuous_at_its_keys(kind, step):
    track = CameraTrack(TIMES, cameras(), kind)
    for time, key in zip(TIMES, cameras(), strict=True):
        near = track(time + step)
        assert np.allclose(near.eye, key.eye, atol=1e-5)
        assert np.allclose(near.target, key.target, atol=1e-5)
        assert np.allclose(orientation(near), orientation(key), atol=1e-5)
        assert math.isclose(near.fov_y, key.fov_y, abs_tol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_track_stands_still_before_and_after_its_keys(kind):
    track = CameraTrack(TIMES, cameras(), kind)
    assert track(-7.0) == cameras()[0]
    assert track(99.0) == cameras()[-1]


def test_a_camera_between_two_keys_goes_around_what_both_look_at():
    """Opposite keys: a straight line would lead through what is looked at."""
    first = rj.PerspectiveCamera((3, 0, 0), (0, 0, 0), near=0.1)
    second = rj.PerspectiveCamera((-3, 0, 0.001), (0, 0, 0), near=0.1)
    track = CameraTrack((0, 1), (first, second))
    for time in np.linspace(0, 1, 11):
        camera = track(time)
        assert camera.target == (0, 0, 0)
        assert math.isclose(math.dist(camera.eye, (0, 0, 0)), 3.0, rel_tol=1e-6)
        assert math.isclose(camera.eye[1], 0.0, abs_tol=1e-9)


def test_a_linear_turn_has_one_speed():
    moving = TransformTrack((0, 3), [transforms.rotate_z(10), transforms.rotate_z(100)])
    for time in np.linspace(0, 3, 7):
        assert np.allclose(moving(time), transforms.rotate_z(10 + 30 * time), atol=1e-12)


def test_a_turn_goes_the_short_way():
    moving = TransformTrack((0, 1), [transforms.rotate_x(350), transforms.rotate_x(20)])
    assert np.allclose(moving(0.5), transforms.rotate_x(5), atol=1e-12)


def test_nothing_shrinks_while_it_turns():
    keys = [transforms.identity(), transforms.compose(transforms.rotate_y(170), np.eye(4))]
    halfway = TransformTrack((0, 1), keys)(0.5)[:3, :3]
    assert np.allclose(halfway @ halfway.T, np.eye(3), atol=1e-12)


def test_a_stretch_goes_from_one_size_to_the_other():
    keys = [transforms.scale((1, 1, 1)), transforms.scale((3, 1, 0.5))]
    assert np.allclose(TransformTrack((0, 2), keys)(1.0), transforms.scale((2, 1, 0.75)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_mirrored_object_stays_mirrored(kind):
    mirrored = transforms.scale((-1, 1, 1))
    keys = [transforms.compose(transforms.rotate_z(60 * k), mirrored) for k in range(3)]
    track = TransformTrack((0, 1, 2), keys, kind)
    for time in np.linspace(0, 2, 9):
        assert np.linalg.det(track(time)[:3, :3]) == pytest.approx(-1.0)


def test_a_smooth_track_has_no_jolt():
    """The velocity of a linear one jumps at a key, that of a smooth one does not."""
    places = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    keys = [transforms.translate(place) for place in places]
    jumps = {}
    for kind in KINDS:
        track = TransformTrack((0, 1, 2), keys, kind)
        before, at, after = (track(time)[:3, 3] for time in (1 - 1e-4, 1.0, 1 + 1e-4))
        jumps[kind] = np.abs((after - at) - (at - before)).max() / 1e-4
    assert jumps["linear"] == pytest.approx(1.0)
    assert jumps["smooth"] < 0.01


def test_numbers_of_a_camera_stay_between_their_keys():
    track = CameraTrack(TIMES, cameras(), "smooth")
    for time in np.linspace(0, 3, 50):
        assert 30.0 <= track(time).fov_y <= 60.0 + 1e-9
        assert track(time).far == math.inf


def test_parallel_cameras_have_tracks_too():
    keys = [rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=h, near=-1, far=9) for h in (2, 6)]
    assert CameraTrack((0, 1), keys)(0.25).height == pytest.approx(3.0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_morph_goes_from_shape_to_shape(cube, kind):
    flat = cube.vertices * (1, 0.2, 1)
    track = MorphTrack((0, 2), cube, [cube.vertices, flat], kind)
    assert np.array_equal(track(0).vertices, cube.vertices)
    assert np.array_equal(track(2).vertices, flat)
    assert np.allclose(track(0.5).vertices, 0.75 * cube.vertices + 0.25 * flat)
    assert np.array_equal(track(1).faces, cube.faces)


def test_a_morph_keeps_colours_uv_and_material(cube):
    material = rj.Material(shading="flat", base_color="white")
    colors = np.random.default_rng(1).random((len(cube.faces), 3))
    mesh = rj.Mesh(
        cube.vertices, cube.faces, colors=colors, uv=cube.vertices[:, :2], material=material
    )
    shape = MorphTrack((0, 1), mesh, [mesh.vertices, 2 * mesh.vertices])(0.5)
    assert np.array_equal(shape.face_colors, mesh.face_colors)
    assert np.array_equal(shape.uv, mesh.uv)
    assert shape.material is material


@pytest.mark.parametrize("of_faces", [False, True])
def test_scalars_go_from_key_to_key_by_one_scale(cube, of_faces):
    count = len(cube.faces if of_faces else cube.vertices)
    values = np.array([np.zeros(count), np.arange(count), np.full(count, 3.0 * count)])
    mesh = cube.with_scalars(values[1], "inferno", range=(-1, 2.5 * count), norm="symlog")
    track = MorphTrack((0, 1, 3), mesh, scalars=values)
    for time, wanted in ((0, values[0]), (1, values[1]), (2, (values[1] + values[2]) / 2)):
        field = track(time).field
        assert np.allclose(field.values, wanted, rtol=1e-12)
        assert (field.range, field.norm, field.colormap) == (
            mesh.field.range, mesh.field.norm, mesh.field.colormap,
        )  # fmt: skip
        assert np.array_equal(track(time).vertices, cube.vertices)
        if of_faces:
            assert np.array_equal(track(time).face_colors, field.colors())
    both = MorphTrack((0, 1, 3), cube, [cube.vertices, cube.vertices, 2 * cube.vertices],
                      scalars=values)(2)  # fmt: skip
    assert np.allclose(both.vertices, 1.5 * cube.vertices)
    assert both.field.range == (0.0, 3.0 * count)
    assert both.field.colormap.name == "viridis"


def test_a_morph_of_points_is_points():
    points = rj.Points(np.eye(3), size=0.2, unit="world", shape="sphere")
    shape = MorphTrack((0, 1), points, [np.eye(3), 3 * np.eye(3)], scalars=[[0, 1, 2], [2, 3, 4]])
    half = shape(0.5)
    assert isinstance(half, rj.Points)
    assert (half.shape, half.sizes.tolist()) == ("sphere", [0.2])
    assert np.allclose(half.vertices, 2 * np.eye(3))
    assert np.allclose(half.field.values, [1, 2, 3])


def test_one_key_is_enough(cube):
    camera = cameras()[0]
    assert CameraTrack((1.0,), (camera,))(5) == camera
    assert np.array_equal(TransformTrack([2.0], [np.eye(4)], "smooth")(0), np.eye(4))
    assert np.array_equal(MorphTrack([0], cube, [cube.vertices])(3).vertices, cube.vertices)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CameraTrack((0, 1), cameras()), "2 times and 4 keys"),
        (lambda: CameraTrack((), ()), "times must be one or more"),
        (lambda: CameraTrack((0, 0), cameras()[:2]), "growing"),
        (lambda: CameraTrack((1, 0), cameras()[:2]), "growing"),
        (lambda: CameraTrack((0, math.nan), cameras()[:2]), "times must be finite"),
        (lambda: CameraTrack((0, 1), cameras()[:2], "cubic"), "interpolation must be one of"),
        (lambda: CameraTrack((0,), ("camera",)), "cameras must be"),
        (lambda: CameraTrack((0,), (rj.MatrixCamera(np.eye(4), np.eye(4)),)), "cameras must be"),
        (
            lambda: CameraTrack(
                (0, 1), (cameras()[0], rj.OrthographicCamera((0, 0, 1), (0, 0, 0)))
            ),
            "of one kind",
        ),
        (
            lambda: CameraTrack((0, 1), (cameras()[0], dataclasses.replace(cameras()[0], far=9.0))),
            "finite far",
        ),
        (lambda: CameraTrack((0,), cameras()[:1])(math.nan), "time must be finite"),
        (lambda: TransformTrack((0,), [np.eye(3)]), r"transforms must have shape"),
        (lambda: TransformTrack((0,), [np.full((4, 4), math.nan)]), "transforms must be finite"),
        (lambda: TransformTrack((0,), [np.ones((4, 4))]), "last rows"),
        (lambda: MorphTrack((0,), "mesh", [[[0, 0, 0]]]), "mesh must be a Mesh"),
        (lambda: MorphTrack((0,), rj.Mesh(np.eye(3), [[0, 1, 2]])), "vertices must be given"),
        (
            lambda: MorphTrack((0,), rj.Mesh(np.eye(3), [[0, 1, 2]]), scalars=[[1, 2]]),
            "scalars must have",
        ),
        (
            lambda: MorphTrack((), rj.Mesh(np.eye(3), [[0, 1, 2]]), scalars=np.zeros((0, 3))),
            r"scalars must have rows of numbers, got shape \(0, 3\)",
        ),
        (
            lambda: MorphTrack(
                (0, 1), rj.Mesh(np.eye(3), [[0, 1, 2]]), [np.eye(3)] * 2, scalars=[[1, 2, 3]]
            ),
            "scalars must be as many rows as vertices, 2, got 1",
        ),
    ],
)
def test_what_is_no_track_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_morph_of_another_topology_is_refused(cube):
    with pytest.raises(ValueError, match=r"vertices must have shape \(n, 8, 3\)"):
        MorphTrack((0, 1), cube, [cube.vertices[:7]] * 2)


def test_without_scipy_the_extra_is_named(monkeypatch):
    for name in ("interpolate", "linalg", "spatial.transform"):
        monkeypatch.setitem(sys.modules, f"scipy.{name}", None)
    with pytest.raises(ImportError, match=r'pip install "rasterjit\[animation\]"'):
        CameraTrack(TIMES, cameras())
    assert tracks.CameraTrack is CameraTrack


@pytest.mark.parametrize("cameras", [5, None, rj.PerspectiveCamera((0, 0, 1), (0, 0, 0))])
def test_cameras_that_are_no_sequence_are_refused(cameras):
    with pytest.raises(ValueError, match="cameras must be a sequence of cameras, got "):
        CameraTrack([0], cameras)
