"""What ``explain`` says that a camera sees."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene import transforms as tf
from rasterjit.survey.view_summary import spread_points

SIZE = (320, 240)
GOOD = rj.PerspectiveCamera((4, 5, 9), (0, 1.5, 0), fov_y=40.0)
K, R, T = rj.cameras.to_opencv(GOOD, SIZE)


@pytest.fixture(scope="module")
def teapot():
    return rj.load(Path(__file__).parents[2] / "models" / "teapot.obj")


def said(scene, camera, size=SIZE, **options):
    """Return the rows about the camera, by name, out of the text that is printed."""
    text = str(rj.explain(scene, camera, size=size, **options))
    return dict(re.findall(r"^(camera|up|in view) +(.*)$", text, re.MULTILINE))


def test_a_camera_that_sees_the_scene(teapot):
    rows = said(teapot, GOOD)
    assert rows["camera"] == (
        "perspective, at (4, 5, 9), looks along (-0.3827, -0.3349, -0.8611), 40 degrees from top "
        "to bottom"
    )
    assert rows["up"] == "+y of the world"
    seen = rj.render(teapot, GOOD, size=SIZE, outputs="face_id", threads=1).face_id >= 0
    found = re.fullmatch(
        r"100 % of the surface, over (\d+) x (\d+) of 320 x 240 pixels", rows["in view"]
    )
    for axis, told in enumerate(found.groups()):
        assert int(told) == pytest.approx(np.ptp(np.nonzero(seen.any(axis=axis))) + 1, abs=8)


def test_the_same_camera_is_described_alike_as_matrices(teapot):
    view, clip = GOOD.view_matrix(), GOOD.projection_matrix(SIZE)
    for camera in (rj.MatrixCamera(view, clip), rj.MatrixCamera(np.eye(4), tf.compose(clip, view))):
        assert said(teapot, camera) == said(teapot, GOOD)


def test_a_parallel_camera(teapot):
    camera = rj.OrthographicCamera((0, 0, 20), (0, 0, 0), height=12.0)
    rows = said(teapot, camera)
    assert (
        rows["camera"]
        == "parallel, at (0, 0, 20), looks along (0, 0, -1), 12 units from top to bottom"
    )
    assert rows["up"] == "+y of the world"


@pytest.mark.parametrize(
    ("mistake", "camera", "row", "told"),
    [
        ("OpenGL's pose as OpenCV's",
         rj.cameras.from_opencv(K, SIZE, camera_from_world=GOOD.view_matrix()),
         "in view", "none of 4096 points on the surface; 100 % behind the camera"),
        ("OpenGL's pose as OpenCV's",
         rj.cameras.from_opencv(K, SIZE, camera_from_world=GOOD.view_matrix()),
         "up", "-y of the world"),
        ("radians", dataclasses.replace(GOOD, fov_y=np.radians(40.0)),
         "in view", "under 1 % of the surface, over .*; over 99 % beside the picture"),
        ("radians", dataclasses.replace(GOOD, fov_y=np.radians(40.0)),
         "camera", r".*, 0\.698 degrees from top to bottom"),
        ("a transposed rotation", rj.cameras.from_opencv(K, SIZE, rotation=R.T, translation=T),
         "up", r"\+y of the world, 8\.2 degrees to the right"),
        ("the eye as t", rj.cameras.from_opencv(K, SIZE, rotation=R, translation=GOOD.eye),
         "in view", r"2\d % of the surface, over .*; 7\d % beside the picture"),
        ("upside down", dataclasses.replace(GOOD, up=(0, -1, 0)), "up", "-y of the world"),
        ("z is up", dataclasses.replace(GOOD, up=(0, 0, 1)), "up", r"\+z of the world"),
        ("tilted", dataclasses.replace(GOOD, up=tf.rotate((4, 3.5, 9), 12)[:3, 1]),
         "up", r"\+y of the world, 12 degrees to the right"),
        ("mirrored",
         rj.MatrixCamera(GOOD.view_matrix(), np.diag([-1, 1, 1, 1]) @ GOOD.projection_matrix(SIZE)),
         "up", r"\+y of the world; mirrored"),
        ("near too far", dataclasses.replace(GOOD, near=100.0),
         "in view", "none of 4096 points on the surface; 100 % before the near plane"),
        ("far too near", dataclasses.replace(GOOD, far=1.0),
         "in view", "none of 4096 points on the surface; 100 % beyond the far plane"),
        ("far away", rj.PerspectiveCamera((0, 0, 9000), (0, 0, 0)),
         "in view", r"100 % of the surface, over 1 x 1 of 320 x 240 pixels"),
    ],
)  # fmt: skip
def test_mistakes_show(teapot, mistake, camera, row, told):
    assert re.fullmatch(told, said(teapot, camera)[row]), said(teapot, camera)[row]


def test_straight_down_the_axis_that_is_up_is_another_one(teapot):
    assert said(teapot, rj.fit_camera(teapot, (0, 1, 0)))["up"] == "-z of the world"


def test_a_share_is_one_of_the_area_however_finely_it_is_divided():
    # Of two squares side by side, one in 2 faces and one in 20000, the camera sees one and a half.
    side = 100
    rows, columns = np.indices((side + 1, side + 1)) / side
    grid = np.stack([columns.ravel(), rows.ravel(), 0.0 * rows.ravel()], axis=1)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    halves = [np.stack([first, first + 1, first + side + 2], axis=1),
              np.stack([first, first + side + 2, first + side + 1], axis=1)]  # fmt: skip
    scene = rj.Scene()
    scene.add(rj.Mesh(grid, np.concatenate(halves)))
    scene.add(rj.Mesh([(1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0)], [(0, 1, 2), (0, 2, 3)]))
    camera = rj.OrthographicCamera((0.75, 0.5, 5), (0.75, 0.5, 0), height=1.5)
    assert said(scene, camera, (40, 40))["in view"] == (
        "75 % of the surface, over 40 x 27 of 40 x 40 pixels; 25 % beside the picture"
    )
    points = spread_points(scene.nodes, np.zeros(3))
    assert (points[:, 0] < 1.0).mean() == pytest.approx(0.5, abs=1e-3)
    # Evenly: each of 64 parts has its share.
    parts = np.histogram2d(points[:, 0], points[:, 1], bins=8, range=[(0, 2), (0, 1)])[0]
    assert np.ptp(parts) < 0.3 * parts.mean()


def test_lines_and_flattened_space_have_words_too():
    line = rj.Mesh([(0, 0, 0), (0, 1, 0), (0, 2, 0)], [(0, 1, 2)])
    assert said(line, GOOD)["in view"].startswith("100 % of the surface")
    flat = rj.MatrixCamera(np.eye(4), np.diag([1.0, 0.0, -1.0, 1.0]))
    assert said(line, flat)["camera"] == "flattens space"


def test_frames_do_not_pay_for_it(teapot):
    frame = rj.render(teapot, GOOD, size=SIZE, threads=1)
    assert frame.plan.view is None
    assert "in view" not in str(frame.plan)


@pytest.mark.parametrize(
    ("lens", "tall"),
    [
        (rj.PinholeDistortion(), "40"),
        (rj.PinholeDistortion(k1=-0.28, k2=0.07), r"41\.\d"),
        (rj.FisheyeLens(), r"41\.7"),
        (rj.FisheyeLens(fov=30.0), None),
    ],
)
def test_a_camera_with_a_lens(teapot, lens, tall):
    rows = said(teapot, GOOD, lens=lens)
    whole = (
        r"perspective, at \(4, 5, 9\), looks along \(-0.3827, -0.3349, -0.8611\), through a lens"
    )
    assert re.fullmatch(f"{whole}, {tall} degrees from top to bottom" if tall else whole,
                        rows["camera"])  # fmt: skip
    assert rows["up"] == "+y of the world"
    seen = rj.render(teapot, GOOD, size=SIZE, outputs="face_id", lens=lens, threads=1).face_id >= 0
    found = re.fullmatch(
        r"(\d+) % of the surface, over (\d+) x (\d+) of 320 x 240 pixels(; .* beside the picture)?",
        rows["in view"],
    )
    for axis, told in enumerate(found.groups()[1:3]):
        assert int(told) == pytest.approx(np.ptp(np.nonzero(seen.any(axis=axis))) + 1, abs=8)


def test_a_panorama_sees_all_but_what_is_cut_off(teapot):
    lens = rj.Equirectangular()
    camera = rj.PerspectiveCamera((0, 1.5, 0), (1, 1.5, 0))
    rows = said(teapot, camera, (256, 128), lens=lens)
    assert rows["camera"].endswith("through a lens, 180 degrees from top to bottom")
    assert rows["in view"].startswith("100 % of the surface")
    cut = dataclasses.replace(camera, near=50.0, far=100.0)
    assert said(teapot, cut, (256, 128), lens=lens)["in view"] == (
        "none of 4096 points on the surface; 100 % before the near plane"
    )
    cut = dataclasses.replace(camera, near=0.01, far=0.02)
    assert said(teapot, cut, (256, 128), lens=lens)["in view"] == (
        "none of 4096 points on the surface; 100 % beyond the far plane"
    )


def test_a_lens_does_not_see_what_is_behind(teapot):
    away = rj.PerspectiveCamera((4, 5, 9), (8, 8.5, 18))
    rows = said(teapot, away, lens=rj.PinholeDistortion(k1=0.1))
    assert rows["in view"] == "none of 4096 points on the surface; 100 % behind the camera"
