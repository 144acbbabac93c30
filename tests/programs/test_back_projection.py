"""Back-projection: what one camera measures is where another one sees it."""

from pathlib import Path

import numpy as np

import rasterjit as rj

TEAPOT = Path(__file__).parents[2] / "models" / "teapot.obj"
SIZE = 320, 240
K = np.array([[290.0, 0.0, 152.0], [0.0, 300.0, 118.5], [0.0, 0.0, 1.0]])


def test_depth_of_one_view_lands_on_the_pixels_of_another():
    scene = rj.load(TEAPOT)
    one = rj.fit_camera(scene, rj.orbit_direction(30.0, 20.0))
    pose = rj.cameras.to_opencv(rj.fit_camera(scene, rj.orbit_direction(50.0, 35.0)), SIZE)
    other = rj.cameras.from_opencv(K, SIZE, camera_from_world=pose.camera_from_world)

    # Each pixel of the depth map is a point, which the other camera sees by OpenCV's formula.
    frame = rj.render(scene, one, size=SIZE, outputs=("depth", "position"))
    rows, columns = np.isfinite(frame.depth).nonzero()
    pixels = np.column_stack([columns, rows]) + 0.5
    points = one.unproject(pixels, frame.depth[rows, columns], SIZE)
    found, depth = other.project(points, SIZE)
    x, y, z = K @ (pose.rotation @ points.T + pose.translation[:, None])
    assert np.abs(found - 0.5 - np.column_stack([x, y]) / z[:, None]).max() < 1e-9
    np.testing.assert_allclose(depth, z, rtol=1e-12)

    # It is where the surface is, which the other camera draws there unless something hides it.
    there = other.project(frame.position[rows, columns], SIZE).pixels
    assert np.abs(found - there).max() < 0.01
    i, j = np.floor(found).astype(int).T
    drawn = rj.render(scene, other, size=SIZE, outputs="depth").depth[j, i]
    assert (drawn < depth + 0.2).mean() > 0.97  # all but outlines
    assert (np.abs(drawn - depth) < 0.02).mean() > 0.7
