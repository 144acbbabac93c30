"""A mesh over a photograph lies where OpenCV's camera and lens put it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import rasterjit as rj

SIZE = 320, 240
VIEWS = [0, 1, 3, 4, 6]


@pytest.fixture
def taken(program):
    """Return the program, small photographs, and what it finds out from them."""
    module = program("photo_overlay")
    photos = []
    for k in VIEWS:
        photos.append(f"photo_{k}.png")
        picture = module.take_photograph(module.VIEWS[k], SIZE, fine=2)
        cv2.imwrite(photos[-1], picture[..., ::-1].astype(np.uint8))
    return module, photos, module.calibrate(photos)


def projected(found, number, points):
    pose = found.poses[number]
    turn = cv2.Rodrigues(pose[:3, :3])[0]
    points = np.asarray(points, float)
    return cv2.projectPoints(points, turn, pose[:3, 3], found.K, found.distortion)[0][:, 0]


def test_the_camera_that_took_the_photographs_is_found(taken):
    module, _, found = taken
    assert found.error < 0.15  # pixels
    half = module.K * [[0.5], [0.5], [1.0]] - [[0, 0, 0.25], [0, 0, 0.25], [0, 0, 0]]
    assert np.abs(found.K - half).max() < 2.5
    assert np.abs(found.distortion[:2] - module.BENT[:2]).max() < 0.06


def test_what_is_drawn_lies_where_opencv_projects_it(taken):
    _, _, found = taken
    marks = np.array([(0, 0, 0), (7, 0, 0), (7, 4, 0), (0, 4, 0), (3, 2, -1.5), (6, 1, -1)], float)
    scene = rj.Scene()
    side = 0.06 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
             (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip
    cube = rj.Mesh(side, faces, material=rj.Material("unlit", "white"))
    for mark in marks:
        scene.add(cube, rj.transforms.translate(mark))
    camera = rj.cameras.from_opencv(found.K, SIZE, camera_from_world=found.poses[0])
    frame = rj.render(
        scene, camera, size=SIZE, background="black", quality=rj.Quality(samples=16),
        lens=rj.PinholeDistortion(*found.distortion), outputs="linear",
    )  # fmt: skip
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    for x, y in projected(found, 0, marks):
        weights = frame.linear[..., 0] * (np.hypot(columns - x, rows - y) < 5.0)
        centre = np.array([(columns * weights).sum(), (rows * weights).sum()]) / weights.sum()
        assert np.abs(centre - (x, y)).max() < 0.1, (x, y, centre)


def test_the_lines_follow_the_edges_of_the_photographed_squares(taken):
    module, photos, found = taken
    frame = module.overlay(photos[0], "models/cube.ply", found)
    photo = cv2.imread(photos[0])[..., ::-1]
    changed = (frame.color[..., :3] != photo).any(axis=2)
    # Each inner corner of the board that OpenCV saw is under a line, or behind the cube.
    corners = np.rint(projected(found, 0, module.board_points(8, 5))).astype(int)
    assert changed[corners[:, 1], corners[:, 0]].all()
    # Far from the board the photograph is untouched.
    assert not changed[:20].any()
    assert 0.02 < changed.mean() < 0.5


def test_what_shows_no_board_is_refused(program):
    module = program("photo_overlay")
    cv2.imwrite("grey.png", np.full((120, 160, 3), 128, np.uint8))
    with pytest.raises(SystemExit, match=r"grey\.png shows no board"):
        module.calibrate(["grey.png"])
    with pytest.raises(SystemExit, match="nowhere"):
        module.calibrate(["nowhere.png"])
