"""Pictures with a lens show every point where OpenCV's formulas put it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import naive_lens
import numpy as np
import pytest

import rasterjit as rj

MODELS = Path(__file__).parents[2] / "models"
SIZE = (96, 64)
WIDE = (96, 48)
FARTHEST = 0.36
"""Pixels from the centre of a pixel to the sample that it is taken from, at most."""

BENT = (-0.25, 0.08, 2e-3, -3e-3, 0.01)
ALL = (-0.1, 0.05, 1e-3, 2e-3, 0.01, 0.02, 0.01, 3e-3, 2e-3, -1e-3, 3e-3, 1e-3, 0.05, -0.08)
FISHEYE = (-0.02, 0.003, 0.0, 0.0)
CAMERA = rj.PerspectiveCamera((0.3, 0.2, 0.4), (0.1, -0.2, -3.0), (0.1, 1.0, 0.0), fov_y=60.0)
CENTERS = np.stack(np.meshgrid(np.arange(96) + 0.5, np.arange(64) + 0.5), axis=-1)

LENSES = {
    "five": (rj.PinholeDistortion(*BENT), SIZE, 60.0),
    "all": (rj.PinholeDistortion(*ALL), SIZE, 60.0),
    "pincushion": (rj.PinholeDistortion(k1=0.4), SIZE, 60.0),
    "fisheye": (rj.FisheyeLens(*FISHEYE), SIZE, 60.0),
    "fisheye on a cube": (rj.FisheyeLens(*FISHEYE), SIZE, 76.0),
    "fisheye that sees behind": (rj.FisheyeLens(fov=300.0), SIZE, 130.0),
    "panorama": (rj.Equirectangular(), WIDE, 60.0),
}


def room(half=3.0, cuts=6):
    """Return a closed room around the origin, each wall cut into squares."""
    steps = np.linspace(-half, half, cuts + 1)
    a, b = (axis.ravel() for axis in np.meshgrid(steps, steps, indexing="ij"))
    number = np.arange((cuts + 1) ** 2).reshape(cuts + 1, cuts + 1)
    corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    i, j, k, m = (one.ravel() for one in corners)
    wall = np.concatenate((np.column_stack((i, j, k)), np.column_stack((i, k, m))))
    vertices, faces = [], []
    for axis in range(3):
        for side in (-half, half):
            points = np.empty((len(a), 3))
            points[:, axis], points[:, axis - 1], points[:, axis - 2] = side, a, b
            faces.append(wall + sum(map(len, vertices)))
            vertices.append(points)
    points = np.concatenate(vertices)
    return rj.Mesh(
        points, np.concatenate(faces), colors=(points / half + 1) / 2,
        material=rj.Material(shading="unlit", base_color="white"),
    )  # fmt: skip


def block(at=(0.0, 0.0, 0.0), half=0.4):
    """Return a box."""
    corners = np.array([[n & 1, n >> 1 & 1, n >> 2 & 1] for n in range(8)]) * 2.0 - 1.0
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    return rj.Mesh(corners * half + at, faces)


def furnished():
    scene = rj.Scene()
    scene.add(room())
    for at in (
        (0.5, -0.6, -2.0),
        (-0.9, 0.4, -2.2),
        (1.8, 0.2, 0.6),
        (-1.5, 0.4, 1.4),
        (0.2, 1.9, 0.3),
    ):
        scene.add(block(), rj.transforms.translate(at))
    return scene


def camera_points(points, camera):
    """Return world points in the axes of OpenCV: x right, y down, z ahead."""
    return rj.transforms.apply(camera.view_matrix(), points) * (1, -1, -1)


def pixels(points, camera, lens, size):
    """Return where world points are seen, (N, 2), by the slow twins."""
    width, height = size
    seen = camera_points(points, camera)
    if isinstance(lens, rj.Equirectangular):
        turns = np.array([naive_lens.panorama(one) for one in seen])
        return turns * (width / (2 * math.pi), height / math.pi) + (width / 2, height / 2)
    if isinstance(lens, rj.FisheyeLens):
        given = lens.k1, lens.k2, lens.k3, lens.k4
        places = np.array([naive_lens.distort_fisheye(one, given) for one in seen])
    else:
        given = [getattr(lens, name) for name in lens.__dataclass_fields__]
        places = np.array([naive_lens.distort(one[:2] / one[2], given) for one in seen])
    focal = height / 2 / math.tan(math.radians(camera.fov_y) / 2)
    return places * focal + (width / 2, height / 2)


def draw(what, camera, lens, size=SIZE, **options):
    options = {"outputs": ("face_id", "position"), "threads": 1, **options}
    return rj.render(what, camera, lens=lens, size=size, **options)


@pytest.fixture(params=LENSES)
def seen(request):
    """Return lens, size, camera and a frame of a furnished room."""
    lens, size, fov_y = LENSES[request.param]
    camera = replace(CAMERA, fov_y=fov_y, near=0.05)
    outputs = "color", "face_id", "object_id", "position", "normal", "depth", "distance"
    if request.param in ("fisheye that sees behind", "panorama"):
        outputs = tuple(name for name in outputs if name != "depth")
    return lens, size, camera, draw(furnished(), camera, lens, size, outputs=outputs)


def test_points_are_seen_where_the_formulas_put_them(seen):
    lens, size, camera, frame = seen
    is_seen = frame.face_id >= 0
    # A closed room: all is seen but what the lens does not see.
    ends = isinstance(lens, rj.FisheyeLens) and lens.fov < 360
    assert is_seen.all() or ends
    assert is_seen.sum() > 2000
    found = pixels(frame.position[is_seen], camera, lens, size)
    off = found - CENTERS[: size[1]][is_seen]
    if isinstance(lens, rj.Equirectangular):
        # At the poles columns are thinner than rows are high.
        latitude = (found[:, 1] / size[1] - 0.5) * math.pi
        off[:, 0] = (off[:, 0] + size[0] / 2) % size[0] - size[0] / 2
        off[:, 0] *= np.cos(latitude)
    distance = np.hypot(*off.T)
    assert distance.max() <= FARTHEST
    assert np.median(distance) <= 0.2
    assert np.abs(off.mean(axis=0)).max() < 0.03


def test_edges_are_where_the_formulas_put_them():
    corners = np.array([[-0.9, -0.4, -2.0], [0.8, -0.7, -2.0], [0.1, 0.8, -2.0]])
    camera, focal = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=60.0), 32 * math.sqrt(3)
    flat = corners[:, :2] / 2 * (1, -1)

    def is_inside(at):
        """Tell of places on the screen whether the triangle is seen there."""
        x, y = np.moveaxis(rj.PinholeDistortion(*BENT).undistort((at - (48, 32)) / focal), -1, 0)
        sides = [
            (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            for a, b in zip(flat, np.roll(flat, -1, axis=0), strict=True)
        ]
        return np.max(sides, axis=0) < 0

    frame = draw(rj.Mesh(corners, [[0, 1, 2]]), camera, rj.PinholeDistortion(*BENT))
    seen, expected = frame.face_id == 0, is_inside(CENTERS)
    assert 700 < expected.sum() < 1500
    assert (seen != expected).mean() < 0.01
    # Where they differ, the edge is no farther from the centre than what is said.
    turns = np.linspace(0, 2 * math.pi, 32, endpoint=False)
    around = np.column_stack((np.cos(turns), np.sin(turns))) * FARTHEST
    near = np.array([is_inside(CENTERS + step) for step in around])
    differs = seen != expected
    assert (near.any(axis=0) & ~near.all(axis=0))[differs].all()


def test_pose_is_found_again_in_a_picture_with_a_lens():
    cv2 = pytest.importorskip("cv2")
    size, dist = (320, 240), np.array([-0.28, 0.09, 1e-3, -5e-4, 0.0])
    K = np.array([[260.0, 0.0, 161.5], [0.0, 255.0, 117.0], [0.0, 0.0, 1.0]])
    R, t = cv2.Rodrigues(np.array([2.8, 0.4, -0.3]))[0], np.array([0.2, 1.6, 9.0])
    camera = rj.cameras.from_opencv(K, size, rotation=R, translation=t)
    teapot = rj.load(MODELS / "teapot.obj")
    outputs, lens = ("object_position", "object_id"), rj.PinholeDistortion(*dist)
    frame = rj.render(teapot, camera, size=size, outputs=outputs, lens=lens, threads=1)
    rows, columns = np.nonzero(frame.object_id == 0)
    points = frame.object_position[rows, columns].astype(np.float64)
    # OpenCV counts from the centre of the first pixel.
    places = np.column_stack((columns, rows)).astype(np.float64)
    pose = np.vstack((np.column_stack((R, t)), [0.0, 0.0, 0.0, 1.0]))
    off = np.hypot(*(naive_lens.project(points, pose, K, dist) - places).T)
    assert len(points) > 5000
    assert off.max() < FARTHEST
    _, turn, shift = cv2.solvePnP(points, places, K, dist)
    vertices = teapot.nodes[0].mesh.vertices[::50].astype(np.float64)
    found, _ = cv2.projectPoints(vertices, turn, shift, K, dist)
    true, _ = cv2.projectPoints(vertices, cv2.Rodrigues(R)[0], t, K, dist)
    assert np.abs(found - true).max() < 0.1
    assert np.abs(shift[:, 0] - t).max() < 5e-3


def test_depth_is_along_the_axis_and_distance_along_the_ray(seen):
    _, _, camera, frame = seen
    is_seen = frame.face_id >= 0
    points = camera_points(frame.position[is_seen], camera)
    lengths = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(frame.distance[is_seen], lengths, rtol=1e-5)
    if "depth" in frame.arrays():
        # Vertices are snapped to a 256th of a sample: far from the axis depth is told less exactly.
        np.testing.assert_allclose(frame.depth[is_seen], points[:, 2], rtol=1e-4)
    assert np.isinf(frame.distance[~is_seen]).all()


def test_outputs_of_a_pixel_are_of_one_point(seen):
    _, _, _, frame = seen
    wall = frame.object_id == 0
    axis, side = np.divmod(frame.face_id[wall] // 72, 2)
    points = frame.position[wall]
    np.testing.assert_allclose(
        np.take_along_axis(points, axis[:, np.newaxis], 1)[:, 0], side * 6.0 - 3.0, atol=1e-4
    )
    assert np.unique(frame.object_id).size >= 3


@pytest.mark.parametrize("name", ["five", "fisheye on a cube", "panorama"])
def test_camera_space_is_that_of_the_camera_and_attributes_are_shown(name):
    lens, size, fov_y = LENSES[name]
    camera, mesh = replace(CAMERA, fov_y=fov_y), room()
    mesh = rj.Mesh(mesh.vertices, mesh.faces, attributes={"place": mesh.vertices})
    names = "normal", "normal_camera", "position", "position_camera", "attribute:place"
    outputs = *names, "face_id", "barycentric"
    frame = draw(mesh, camera, lens, size, outputs=outputs)
    view, points = camera.view_matrix(), frame.position.reshape(-1, 3)
    assert np.abs(frame.attribute("place") - frame.position).max() < 1e-5
    expected = rj.transforms.apply(view, points).reshape(frame.position.shape)
    np.testing.assert_allclose(frame.position_camera, expected, atol=1e-5)
    np.testing.assert_allclose(frame.normal_camera, frame.normal @ view[:3, :3].T, atol=1e-6)
    picked = frame.pick(7, 5)
    assert picked.face == frame.face_id[5, 7]
    assert (picked.position == frame.position[5, 7]).all()


def test_no_lens_is_a_lens_that_does_not_distort():
    outputs = "color", "face_id", "depth", "normal"
    plain = draw(furnished(), CAMERA, None, outputs=outputs)
    lensed = draw(furnished(), CAMERA, rj.PinholeDistortion(), outputs=outputs)
    same = lensed.face_id == plain.face_id
    assert same.mean() > 0.995
    np.testing.assert_allclose(lensed.depth[same], plain.depth[same], rtol=1e-3)
    # Filtered over the pixel, and not a sample: the same inside of faces.
    differs = np.abs(lensed.color.astype(int) - plain.color).max(axis=-1)
    assert np.median(differs) <= 1


@pytest.mark.parametrize("name", ["five", "fisheye on a cube", "panorama"])
def test_colours_are_filtered_over_the_pixel(name):
    lens, size, fov_y = LENSES[name]
    camera, scale = replace(CAMERA, fov_y=fov_y), 6
    mesh = block((0.5, -0.3, -1.8), 0.7)
    mesh.material = rj.Material(shading="unlit", base_color="white")
    outputs = "linear", "color", "coverage"
    coarse = draw(mesh, camera, lens, size, outputs=outputs, background="transparent")
    large = tuple(scale * side for side in size)
    fine = draw(mesh, camera, lens, large, outputs="face_id").face_id >= 0
    share = fine.reshape(size[1], scale, size[0], scale).mean(axis=(1, 3))
    alpha = coarse.linear[..., 3]
    assert ((share > 0.1) & (share < 0.9)).sum() > 30
    assert np.abs(alpha - share).max() < 0.3
    assert np.abs(alpha - share)[(share > 0) & (share < 1)].mean() < 0.1
    assert abs(alpha.sum() / share.sum() - 1.0) < 4e-3
    # White where anything is, whatever is behind it.
    assert (coarse.linear[alpha > 0, :3] == 1.0).all()
    assert (coarse.color[..., 3] == np.floor(alpha * 255.0 + 0.5)).all()
    assert (coarse.coverage == alpha).all()


def test_panorama_of_an_environment_is_that_picture():
    v, u = np.mgrid[0.5:64, 0.5:128] / 64.0
    sky = np.stack(
        [
            0.5 + 0.4 * np.sin(2 * math.pi * u / 2) * np.sin(math.pi * v) ** 2,
            0.2 + 0.6 * v,
            0.5 + 0.4 * np.cos(4 * math.pi * u / 2) * np.sin(math.pi * v) ** 2,
        ],
        axis=-1,
    ).astype(np.float32)
    scene = rj.Scene()
    scene.add(block((3, -90, 7), 1e-6))
    scene.environment = rj.Environment(sky)
    camera = rj.PerspectiveCamera((0, 0, 0), (1, 0, 0))
    frame = draw(scene, camera, rj.Equirectangular(), (128, 64), outputs="linear")
    # Everywhere: at the seams of the cube, at both poles, from the last column to the first.
    assert np.abs(frame.linear[..., :3] - sky).max() < 0.01


def test_panorama_of_a_turned_camera_is_the_panorama_turned():
    scene, size = furnished(), (256, 128)
    scene.nodes[0].mesh.material = rj.Material(base_color="white")
    scene.lights = [
        rj.AmbientLight(intensity=0.3),
        rj.PointLight((0, 2.5, 0), intensity=6.0, shadow=rj.Shadow()),
    ]
    one, other = (
        draw(
            scene, rj.PerspectiveCamera((0, 0, 0), target), rj.Equirectangular(), size,
            outputs=("color", "object_id", "distance"),
        )
        for target in ((1, 0, 0), (1, 0, 1))
    )  # fmt: skip
    # The seams of the cube are elsewhere: an eighth of the picture to the side.
    turned = {name: np.roll(array, 32, axis=1) for name, array in other.arrays().items()}
    same = turned["object_id"] == one.object_id
    assert same.mean() > 0.99
    assert np.quantile(np.abs(turned["distance"] / one.distance - 1)[same], 0.99) < 0.02
    off = np.abs(turned["color"].astype(int) - one.color).max(axis=-1)
    assert off.mean() < 1.5
    assert np.quantile(off, 0.95) <= 8


def move(frame_outputs=("motion", "face_id", "position"), **view):
    """Return the view before: from another place, where the first box has moved, too."""
    before = furnished()
    before.nodes[1].world_from_model = rj.transforms.translate((0.35, -0.5, -1.9))
    return rj.PreviousView(scene=before, camera=view["camera"])


@pytest.mark.parametrize("name", ["all", "fisheye on a cube", "panorama"])
def test_motion_is_across_the_picture_of_the_lens(name):
    lens, size, fov_y = LENSES[name]
    camera = replace(CAMERA, fov_y=fov_y, near=0.05)
    then = replace(camera, eye=(0.25, 0.25, 0.45), target=(0.2, -0.2, -3.0))
    outputs = "motion", "object_id", "position"
    frame = draw(furnished(), camera, lens, size, outputs=outputs, previous=move(camera=then))
    now = pixels(frame.position.reshape(-1, 3), camera, lens, size)
    is_moved = (frame.object_id == 1)[..., np.newaxis]
    points = frame.position - np.where(is_moved, (0.15, -0.1, -0.1), 0.0)
    expected = now - pixels(points.reshape(-1, 3), then, lens, size)
    expected = expected.reshape(*frame.motion.shape)
    if name == "panorama":
        expected[..., 0] = (expected[..., 0] + size[0] / 2) % size[0] - size[0] / 2
    is_known = np.isfinite(frame.motion).all(axis=-1)
    assert is_known.mean() > 0.99
    off = np.abs(frame.motion - expected)[is_known]
    # Next to its poles a panorama moves by any number of columns.
    assert np.quantile(off, 0.995) < 2e-3
    assert np.median(np.abs(frame.motion[is_known])) > 0.3
    # What has not moved has moved by exactly nothing.
    still = draw(
        furnished(), camera, lens, size, outputs=outputs, previous=rj.PreviousView(camera=camera)
    )
    assert (still.motion == 0).all()


def test_background_where_the_lens_sees_nothing():
    lens, camera = rj.FisheyeLens(fov=120.0), replace(CAMERA, fov_y=110.0)
    outputs = "color", "linear", "depth", "face_id", "coverage"
    given = {"outputs": outputs, "size": (64, 64)}
    frame = draw(furnished(), camera, lens, **given)
    is_seen = frame.face_id >= 0
    assert 0.3 < is_seen.mean() < 0.7
    assert not is_seen[0, 0]
    assert is_seen[32, 32]
    assert (frame.color[~is_seen] == (0, 0, 0, 255)).all()
    assert np.isinf(frame.depth[~is_seen]).all()
    assert (frame.coverage[~is_seen] == 0).all()
    assert frame.stats.pixels_covered == is_seen.sum()
    clear = draw(furnished(), camera, lens, background="transparent", **given)
    assert (clear.linear[~is_seen] == 0).all()
    # The radius at which it ends: half its field, equidistant.
    rows, columns = np.nonzero(is_seen)
    radius = np.hypot(columns - 31.5, rows - 31.5).max()
    focal = 32 / math.tan(math.radians(55))
    assert radius == pytest.approx(focal * math.radians(60), abs=0.75)


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_photograph_behind_is_what_the_lens_has_seen(kind):
    rows, columns = np.mgrid[:64, :96]
    photo = np.stack((rows * 4, columns * 2, (rows + columns) % 2 * 255), axis=-1).astype(kind)
    if kind is np.float32:
        photo /= 255.0
    mesh = block((0, 0, -2.0), 0.6)
    mesh.material = rj.Material(shading="unlit", base_color="white")
    outputs, options = ("color", "linear", "coverage"), {"size": (96, 64)}
    for lens in (rj.PinholeDistortion(*BENT), rj.FisheyeLens(fov=50.0)):
        frame = draw(mesh, CAMERA, lens, outputs=outputs, background=photo, **options)
        clear = draw(mesh, CAMERA, lens, outputs=outputs, background="transparent", **options)
        is_behind, alpha = frame.coverage == 0, clear.linear[..., 3:]
        given = rj.scene.color.decoding_table()[photo] if kind is np.uint8 else photo
        assert is_behind.mean() > 0.5
        if kind is np.uint8:
            assert (frame.color[is_behind][:, :3] == photo[is_behind]).all()
        expected = alpha + (1 - alpha) * given
        np.testing.assert_allclose(frame.linear[..., :3], expected, atol=1e-6)
        assert (frame.color[..., 3] == 255).all()
    with pytest.raises(ValueError, match="a picture of the frame's size, 96 x 64"):
        draw(mesh, CAMERA, rj.FisheyeLens(), background=photo[:32])


def test_bits_do_not_depend_on_threads_or_on_earlier_frames():
    outputs = "color", "linear", "distance", "normal"
    for name in ("five", "panorama"):
        lens, size, _ = LENSES[name]
        alone = draw(furnished(), CAMERA, lens, size, outputs=outputs).arrays()
        with rj.Renderer(size, threads=3) as renderer:
            elsewhere = replace(CAMERA, eye=(0, 0, 0))
            other = renderer.render(furnished(), elsewhere, outputs=outputs, lens=lens).arrays()
            again = renderer.render(furnished(), CAMERA, outputs=outputs, lens=lens).arrays()
            bent = rj.PinholeDistortion(k1=0.1)
            renderer.render(furnished(), CAMERA, outputs=outputs, lens=bent)
            last = renderer.render(furnished(), CAMERA, outputs=outputs, lens=lens).arrays()
        assert not np.array_equal(other["distance"], alone["distance"])
        for key, values in alone.items():
            assert np.array_equal(values, again[key], equal_nan=True)
            assert np.array_equal(values, last[key], equal_nan=True)


@pytest.mark.parametrize("samples", [4, "area", 64])
def test_several_samples_a_pixel(samples):
    quality = replace(rj.Quality.standard(), samples=samples)
    outputs = "linear", "coverage", "face_id"
    lens = rj.FisheyeLens()
    fine = draw(block((0, 0, -2)), CAMERA, lens, outputs=outputs, quality=quality)
    usual = draw(block((0, 0, -2)), CAMERA, lens, outputs=outputs)
    assert (fine.face_id == usual.face_id).all()
    assert np.abs(fine.coverage - usual.coverage).max() < 0.4
    assert abs(fine.coverage.sum() / usual.coverage.sum() - 1) < 2e-3
    assert len(np.unique(fine.coverage)) > len(np.unique(usual.coverage))


def test_vignette_darkens_the_corners_of_the_whole_picture():
    scene = furnished()
    outputs = "color", "linear"
    plain = draw(scene, CAMERA, rj.Equirectangular(), WIDE, outputs=outputs)
    scene.vignette = rj.Vignette(0.75, 0.2)
    dark = draw(scene, CAMERA, rj.Equirectangular(), WIDE, outputs=outputs)
    assert (dark.linear == plain.linear).all()
    assert (dark.color[20:28, 44:52] == plain.color[20:28, 44:52]).all()
    decode = rj.scene.color.decoding_table()
    light = [decode[one.color[0, 0, :3]].max() for one in (dark, plain)]
    assert light[0] / light[1] == pytest.approx(0.25, abs=0.04)


def test_calibrated_camera_with_skew_and_its_principal_point_elsewhere():
    matrix = np.array([[80.0, 3.0, 40.0], [0.0, 90.0, 35.0], [0.0, 0.0, 1.0]])
    x = 2 * matrix[0] / 96
    y = 2 * matrix[1] / 64
    clip = np.zeros((4, 4))
    # From OpenCV's axes to view space, whose y is up and whose z points back.
    clip[0, :3] = (x - (0, 0, 1)) * (1, -1, -1)
    clip[1, :3] = ((0, 0, 1) - y) * (1, -1, -1)
    clip[2, 2:], clip[3, 2] = (-1.0, -0.1), -1.0
    # The view may be in either of the two matrices.
    for view, project in (
        (CAMERA.view_matrix(), clip),
        (np.eye(4), clip @ CAMERA.view_matrix()),
    ):
        camera = rj.MatrixCamera(view, project)
        frame = draw(furnished(), camera, rj.PinholeDistortion(*BENT))
        seen = camera_points(frame.position.reshape(-1, 3), CAMERA)
        places = [naive_lens.distort(one[:2] / one[2], BENT) for one in seen]
        found = np.column_stack((places, np.ones(len(places)))) @ matrix[:2].T
        assert np.abs(found - CENTERS.reshape(-1, 2)).max() < FARTHEST


def test_explain_tells_the_pictures():
    plan = rj.explain(furnished(), CAMERA, size=WIDE, lens=rj.Equirectangular())
    assert plan.size == WIDE
    assert "lens                     Equirectangular: 6 pinhole pictures" in str(plan)
    assert "at least 2 samples along a pixel" in str(plan)
    frame = draw(furnished(), CAMERA, rj.PinholeDistortion(*BENT))
    assert "1 pinhole picture (" in frame.plan.lens
    assert repr(frame) == "Frame(96 x 64: face_id, position)"
    assert not rj.explain(furnished(), CAMERA).lens


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 3), (7, 300)])
def test_smallest_and_thinnest_pictures(size):
    lenses = [rj.PinholeDistortion(*BENT), rj.FisheyeLens(fov=100.0)]
    if size == (2, 1):
        lenses.append(rj.Equirectangular())
    for lens in lenses:
        outputs = "color", "distance"
        frame = draw(room(), replace(CAMERA, fov_y=30.0), lens, size, outputs=outputs)
        assert frame.color.shape == (*size[::-1], 4)
        assert np.isfinite(frame.distance).all()


def with_field(**fields):
    scene = furnished()
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


PARALLEL = rj.OrthographicCamera((0, 0, 2), (0, 0, 0))
PANORAMA = {"lens": rj.Equirectangular(), "size": WIDE}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lens": "fisheye"}, "lens must be a PinholeDistortion, FisheyeLens or .* got str"),
        ({"lens": rj.Equirectangular()}, r"size must be twice as wide as high .* got \(96, 64\)"),
        ({"lens": rj.PinholeDistortion(k1=-0.6)}, "all of the picture up to its corners: .* folds"),
        ({"lens": rj.FisheyeLens(k1=-0.6)}, "up to its corners: it folds beyond an angle of 42"),
        ({"lens": rj.FisheyeLens(), "fov_y": 150.0, "outputs": "depth"}, "'depth', .* 'distance'"),
        (
            {"outputs": "depth", **PANORAMA},
            "'depth', .* from it alone, and lens sees more: ask for",
        ),
        ({"outputs": ("color", "motion_visible")}, "'motion_visible', which is not found where"),
        ({"diagnose": True}, "diagnose must be False where a lens is given, got True"),
        ({"max_error": 0.1}, "max_error must be None where a lens is given"),
        ({"time_budget": 0.1}, "time_budget must be None where a lens is given"),
        ({"scene": with_field(outline=rj.Outline())}, "scene.outline must be None where a lens"),
        ({"scene": with_field(wireframe=rj.Wireframe())}, "scene.wireframe must be None where"),
        (
            {"scene": with_field(ambient_occlusion=rj.AmbientOcclusion()), **PANORAMA},
            "scene.ambient_occlusion must be None where lens sees so much that it takes 6",
        ),
        (
            {"scene": with_field(eye_dome=rj.EyeDome()), **PANORAMA},
            "scene.eye_dome must be None where lens sees so much that it takes 6",
        ),
        (
            {"camera": PARALLEL},
            "camera must be a perspective where a lens is given, got OrthographicCamera",
        ),
        (
            {"outputs": "motion", "previous": rj.PreviousView(camera=PARALLEL)},
            "previous.camera: camera must be a perspective where a lens is given",
        ),
        ({"outputs": "motion"}, "previous must be a PreviousView where outputs has 'motion'"),
    ],
)
def test_what_is_not_drawn_is_refused(options, message):
    options = {"lens": rj.PinholeDistortion(*BENT), "outputs": "color", **options}
    camera = options.pop("camera", replace(CAMERA, fov_y=options.pop("fov_y", 60.0)))
    with pytest.raises(ValueError, match=message):
        draw(options.pop("scene", None) or furnished(), camera, **options)


def test_eye_dome_lighting_of_one_picture():
    plain, found = (
        draw(scene, CAMERA, rj.PinholeDistortion(*BENT), outputs="linear").linear
        for scene in (with_field(), with_field(eye_dome=rj.EyeDome(0.2)))
    )
    assert (found <= plain).all()
    assert (found < 0.5 * plain).any()


def test_ambient_occlusion_of_one_picture():
    scene = with_field(ambient_occlusion=rj.AmbientOcclusion())
    frame = draw(scene, CAMERA, rj.PinholeDistortion(*BENT), outputs="color")
    assert frame.color.shape == (64, 96, 4)
