"""The conventions of the design, held: handedness, rows, centres, winding, depth, ties, order."""

from __future__ import annotations

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads

SIZE = (64, 64)
LOOKING_DOWN_Z = {"eye": (0, 0, 0), "target": (0, 0, -1)}


def view(fov_y=90.0, near=0.1, far=np.inf, **place):
    return rj.PerspectiveCamera(**{**LOOKING_DOWN_Z, **place}, fov_y=fov_y, near=near, far=far)


def triangle(a, b, c, **options):
    return rj.Mesh([a, b, c], [[0, 1, 2]], **options)


def small_at(x, y, z, reach=0.3):
    """Return a small triangle around a point, counter-clockwise from +z."""
    return triangle((x - reach, y - reach, z), (x + reach, y - reach, z), (x, y + reach, z))


def where(mesh, camera=None, size=SIZE, **options):
    """Return the mean column and row of a mesh's pixels."""
    face_id = rj.render(
        mesh, camera or view(), size=size, outputs="face_id", threads=1, **options
    ).face_id
    rows, columns = np.nonzero(face_id >= 0)
    assert len(rows), "nothing is seen"
    return columns.mean(), rows.mean()


def test_camera_looks_down_its_negative_z():
    where(small_at(0, 0, -5))
    with pytest.raises(AssertionError, match="nothing is seen"):
        where(small_at(0, 0, 5))


def test_x_is_right_and_y_is_up_on_row_zero_at_the_top():
    assert where(small_at(3, 0, -5))[0] > 40
    assert where(small_at(-3, 0, -5))[0] < 24
    assert where(small_at(0, 3, -5))[1] < 24
    assert where(small_at(0, -3, -5))[1] > 40


def test_world_is_right_handed():
    # Looking along +x with y up, +z is on the right.
    assert where(small_at(0, 0, 0), view(eye=(0, 0, 5), target=(0, 0, 0)))[0] == pytest.approx(31.5)
    side = triangle((5, -0.3, 2), (5, -0.3, 2.6), (5, 0.3, 2.3))
    assert where(side, view(target=(1, 0, 0)))[0] > 40
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    assert (np.cross(x, y) == [0, 0, 1]).all()


def test_point_lands_on_its_pixel():
    # View (1, 2, -4), 90 degrees, 64 x 64: NDC (1/4, 1/2), screen (40, 16).
    matrix = view().projection_matrix(SIZE)
    clip = matrix @ [1, 2, -4, 1]
    np.testing.assert_allclose(clip[:2] / clip[3], [0.25, 0.5], rtol=1e-15)
    screen, _ = visibility_pass.project_to_screen(
        clip[np.newaxis], (0.0, -1.0, 0.0), make_viewport(SIZE, 8), threads.Workers(1)
    )
    assert screen.xy[0].tolist() == [40 * 256, 16 * 256]


def test_centre_of_a_pixel_lies_at_one_half():
    # A triangle around (10.5, 20.5), smaller than a pixel, draws pixel column 10, row 20.
    for dx, dy, drawn in ((0, 0, True), (0.5, 0, False), (0, -0.5, False)):
        x, y = 10.5 + dx, 20.5 + dy
        points = [(x - 0.25, y - 0.25), (x + 0.25, y - 0.25), (x, y + 0.25)]
        seen = rj.rasterize(naive.clip_from_screen(points, SIZE), [[0, 1, 2]], SIZE, threads=1)
        assert np.argwhere(seen.face_id == 0).tolist() == ([[20, 10]] if drawn else [])


def test_near_is_minus_one_in_ndc():
    camera = view(near=0.5, far=8.0)
    matrix = camera.projection_matrix(SIZE)
    for distance, ndc in ((0.5, -1.0), (8.0, 1.0)):
        clip = matrix @ [0, 0, -distance, 1]
        assert clip[2] / clip[3] == pytest.approx(ndc, abs=1e-12)
        assert clip[3] == distance


def test_counter_clockwise_is_the_front():
    front = small_at(0, 0, -5, 2.0)
    back = rj.Mesh(front.vertices, front.faces[:, ::-1])
    for mesh, cull in ((front, "back"), (back, "front")):
        where(mesh, cull="none")
        where(mesh, cull=cull)
        with pytest.raises(AssertionError, match="nothing is seen"):
            where(mesh, cull="front" if cull == "back" else "back")


def test_mirrored_object_keeps_its_front():
    mesh = small_at(1, 0, -5, 2.0)
    scene = rj.Scene()
    scene.add(mesh, rj.transforms.scale((-1, 1, 1)))
    # It turns the other way on the screen, yet its front stays the front.
    kept, gone, plain = (
        rj.render(what, view(), size=SIZE, outputs="face_id", cull=cull, threads=1).face_id >= 0
        for what, cull in ((scene, "back"), (scene, "front"), (mesh, "back"))
    )
    assert kept.sum() > 100
    assert not gone.any()
    # Up to the fill rule, the mirror image of the image.
    assert (kept != plain[:, ::-1]).sum() <= 2 * SIZE[1]


def ground(y=-1.0, reach=1e8):
    return rj.Mesh(
        [[-reach, y, reach], [reach, y, reach], [reach, y, -reach], [-reach, y, -reach]],
        [[0, 1, 2], [0, 2, 3]],
    )


def test_depth_is_in_scene_units_along_the_axis():
    # Ground one unit below the eye: row j sees it at exactly 64 / (2 j - 63).
    frame = rj.render(ground(), view(), size=SIZE, outputs="depth", threads=1)
    assert np.isinf(frame.depth[:32]).all()
    for row in range(32, 64):
        np.testing.assert_allclose(frame.depth[row], 64 / (2 * row - 63), rtol=2e-6)
    # Along the axis, not along the ray: the same in the middle and in the corner.
    assert np.ptp(frame.depth[63]) <= 1e-6


def test_depth_of_a_parallel_projection_is_the_distance():
    camera = rj.OrthographicCamera((0, 0, 7), (0, 0, 0), height=4.0, near=1.0, far=21.0)
    frame = rj.render(
        small_at(0, 0, 2, 1.0), camera, size=SIZE, outputs=("depth", "face_id"), threads=1
    )
    hit = frame.face_id >= 0
    np.testing.assert_allclose(frame.depth[hit], 5.0, rtol=1e-6)
    assert np.isposinf(frame.depth[~hit]).all()


def test_nothing_is_infinitely_far():
    frame = rj.render(
        small_at(0, 0, -5), view(), size=SIZE, outputs=("depth", "face_id", "object_id"), threads=1
    )
    assert np.isposinf(frame.depth[0, 0])
    assert frame.face_id[0, 0] == frame.object_id[0, 0] == -1


def test_nearer_wins_and_ties_go_to_the_lower_object_and_face():
    scene = rj.Scene()
    scene.add(small_at(0, 0, -5, 2.0), name="first")
    twice = rj.Mesh(small_at(0, 0, -5, 2.0).vertices, [[0, 1, 2], [1, 2, 0]])
    scene.add(twice, name="same place")
    scene.add(small_at(0, 0, -4, 0.5), name="nearer")
    frame = rj.render(scene, view(), size=SIZE, outputs=("face_id", "object_id"), threads=2)
    assert set(np.unique(frame.object_id)) == {-1, 0, 2}
    assert set(np.unique(frame.face_id)) == {-1, 0, 3}
    assert frame.object_id[32, 32] == 2


def test_objects_and_faces_are_numbered_in_order(cube):
    scene = rj.Scene()
    for x in (2.0, -2.0, 0.0):
        scene.add(cube, rj.transforms.translate((x * 1.5, 0, -8)))
    frame = rj.render(scene, view(), size=SIZE, outputs=("face_id", "object_id"), threads=1)
    assert frame.object_id[32, 44] == 0
    assert frame.object_id[32, 20] == 1
    assert frame.object_id[32, 32] == 2
    hit = frame.face_id >= 0
    assert (frame.face_id[hit] // 12 == frame.object_id[hit]).all()


def test_colour_is_summed_in_linear_light_and_stored_as_srgb():
    white = rj.Material("phong", "white", specular=0.0)
    mesh = small_at(0, 0, -5, 4.0)
    scene = rj.Scene()
    scene.add(rj.Mesh(mesh.vertices, mesh.faces, material=white))
    scene.lights = [rj.AmbientLight(intensity=0.25), rj.AmbientLight(intensity=0.25)]
    frame = rj.render(scene, view(), size=SIZE, outputs=("color", "linear"), threads=1)
    assert frame.linear[32, 32].tolist() == [0.5, 0.5, 0.5, 1.0]
    assert frame.color[32, 32].tolist() == [188, 188, 188, 255]


def test_matrices_multiply_column_vectors():
    clip_from_model = rj.transforms.compose(
        rj.transforms.translate((1, 0, 0)), rj.transforms.scale(2.0)
    )
    assert (clip_from_model @ [1, 1, 1, 1]).tolist() == [3, 2, 2, 1]
    assert clip_from_model.dtype == np.float64
    turned = rj.transforms.rotate_z(90.0) @ [1, 0, 0, 1]
    np.testing.assert_allclose(turned, [0, 1, 0, 1], atol=1e-15)


def test_image_survives_a_large_translation_of_the_world(cube):
    far = np.array([2.0**20, -(2.0**20), 2.0**20])
    frames = []
    for offset in (np.zeros(3), far):
        scene = rj.Scene()
        scene.add(cube, rj.transforms.translate(offset))
        camera = rj.PerspectiveCamera(np.array([2.5, 3.0, 4.0]) + offset, offset, near=0.5)
        frames.append(
            rj.render(scene, camera, size=SIZE, outputs=("color", "depth", "face_id"), threads=1)
        )
    for one, other in zip(*(frame.arrays().values() for frame in frames), strict=True):
        assert one.tobytes() == other.tobytes()
