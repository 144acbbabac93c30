"""Weights equal exact arithmetic, of clipped faces too; positions and normals are the surface's."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads

SIZE = (16, 16)
I01 = [(0, 0), (16, 0), (0, 16)]


def see(points, w=1.0, size=SIZE, faces=((0, 1, 2),), z=0.0):
    positions = naive.clip_from_screen(points, size, z, w)
    return rj.rasterize(positions, faces, size, threads=1)


def fill(points, values, size=SIZE, w=1.0, faces=((0, 1, 2),)):
    """Interpolate a vertex attribute over faces of screen points; (H, W, K)."""
    positions = naive.clip_from_screen(points, size, 0.0, w)
    faces = np.array(faces, np.int32)
    viewport, workers = make_viewport(size, 8), threads.Workers(1)
    screen, _ = visibility_pass.project_to_screen(positions, (0.0, -1.0, 0.0), viewport, workers)
    face_id = rj.rasterize(positions, faces, size, threads=1).face_id
    geometry = Geometry(faces, screen.xy, screen.codes, screen.w, positions, viewport)
    values = np.asarray(values, np.float32).reshape(len(points), -1)
    attribute = np.full((size[1], size[0], values.shape[1]), 7.0, np.float32)
    barycentric.fill_attribute(face_id, (0, size[1]), geometry, values, attribute)
    return attribute


def test_weights_equal_naive_on_random_faces():
    rng = np.random.default_rng(1)
    for _ in range(30):
        points = np.round(rng.uniform(-30, 94, (3, 2)) * 256) / 256
        w = 2.0 ** rng.integers(-3, 6, 3)
        seen = see(points, w, (64, 64))
        corners = oracle.snap_triangle(points.tolist())
        for row, column in np.argwhere(seen.face_id == 0)[::31]:
            exact = oracle.perspective_weights(
                corners, w.tolist(), naive.centre(int(column), int(row))
            )
            for have, want in zip(seen.barycentric[row, column], exact, strict=True):
                assert abs(Fraction(float(have)) - want) <= Fraction(float(np.spacing(have)))


def test_weights_of_clipped_faces_equal_naive():
    rng = np.random.default_rng(2)
    size, checked = (32, 32), 0
    for _ in range(40):
        positions = rng.normal(size=(3, 4)) * [2, 2, 0.8, 1] + [0, 0, 0, 0.7]
        seen = rj.rasterize(positions, [[0, 1, 2]], size, threads=1)
        if not seen.totals.clipped:
            continue
        for row, column in np.argwhere(seen.face_id == 0)[::17]:
            # The face's point on the ray of the pixel: sum b (x - X w) = sum b (y - Y w) = 0.
            x, y = Fraction(2 * int(column) + 1, 32) - 1, 1 - Fraction(2 * int(row) + 1, 32)
            exact = [[Fraction(c) for c in corner] for corner in positions.tolist()]
            u = [p[0] - x * p[3] for p in exact]
            v = [p[1] - y * p[3] for p in exact]
            b = [u[k - 2] * v[k - 1] - u[k - 1] * v[k - 2] for k in range(3)]
            want = [float(share / sum(b)) for share in b]
            # The sample may lie a sub-pixel outside the exact face.
            np.testing.assert_allclose(seen.barycentric[row, column], want, atol=2e-2)
            if min(want) > 0:
                np.testing.assert_allclose(seen.barycentric[row, column], want, atol=1e-6)
                checked += 1
    assert checked > 50


def test_attribute_at_the_cut_is_that_of_the_cut():
    # An edge from w = 1, u = 0 to w = 3, u = 1, the far plane half-way: u = 1/2 there.
    positions = np.array([[-1, -1, -1, 1], [1, -1, -1, 1], [0, 3, 5, 3.0], [0, 3, 5, 3.0]])
    cut = positions[0] + 0.5 * (positions[2] - positions[0])
    assert cut[2] == cut[3]
    seen = rj.rasterize(positions, [[0, 1, 2]], (64, 64), threads=1)
    assert seen.totals.clipped == 1
    rows = np.nonzero((seen.face_id >= 0).any(axis=1))[0]
    # Screen y of the cut: (1 - y / w) 32.
    assert rows.min() == round((1 - cut[1] / cut[3]) * 32)
    third = seen.barycentric[rows.min(), 32, 2]
    row_y = 1 - (rows.min() + 0.5) / 32
    # Along the middle: y = -1 + 4 u, w = 1 + 2 u, so u = (Y + 1) / (4 - 2 Y).
    assert abs(third - (row_y + 1) / (4 - 2 * row_y)) < 1e-6
    assert third < 0.5


def test_attribute_is_nan_where_nothing_is():
    drawn = fill(I01, np.zeros((3, 2)))
    assert np.isnan(drawn[15, 15]).all()
    assert not np.isnan(drawn[0, 0]).any()


def test_rotating_a_face_rotates_its_weights_bit_for_bit():
    rng = np.random.default_rng(4)
    for clipped in (False, True):
        for _ in range(10):
            positions = rng.normal(size=(3, 4)) * [1, 1, 0.5, 0.2] + [0, 0, 0, 1.5]
            if clipped:
                positions[1, 3] = -0.3
            first = rj.rasterize(positions, [[0, 1, 2]], SIZE, threads=1)
            second = rj.rasterize(positions, [[1, 2, 0]], SIZE, threads=1)
            rotated = np.ascontiguousarray(first.barycentric[:, :, [1, 2, 0]])
            assert second.barycentric.tobytes() == rotated.tobytes()


def test_positions_and_normals_lie_on_the_surface(sphere, camera):
    frame = rj.render(
        sphere, camera, size=(48, 40), outputs=("position", "normal", "depth", "face_id")
    )
    hit = frame.face_id >= 0
    assert hit.sum() > 100
    corners = sphere.vertices[sphere.faces[frame.face_id[hit]]]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    offset = np.einsum("ij,ij->i", flat, frame.position[hit] - corners[:, 0])
    assert np.abs(offset).max() < 1e-6
    view = np.column_stack([frame.position[hit], np.ones(hit.sum())]) @ camera.view_matrix().T
    np.testing.assert_allclose(-view[:, 2], frame.depth[hit], rtol=1e-3)
    # The ball is smooth: its normal is nearly its position, of length one.
    np.testing.assert_allclose(np.linalg.norm(frame.normal[hit], axis=1), 1.0, atol=1e-6)
    assert np.einsum("ij,ij->i", frame.normal[hit], frame.position[hit]).min() > 0.8
    assert np.isnan(frame.position[~hit]).all()
    assert (frame.normal[~hit] == 0.0).all()


def test_normal_is_on_the_side_that_is_seen(cube):
    inside = rj.PerspectiveCamera(eye=(0, 0, 0), target=(0, 0, -1), fov_y=90.0)
    outside = rj.PerspectiveCamera(eye=(0, 0, 5), target=(0, 0, 0), fov_y=20.0)
    # Creases of 0 degrees: the normals of vertices are those of their face.
    flat = rj.Mesh(cube.vertices, cube.faces).split_creases(0.0)
    for camera in (inside, outside):
        for name in ("normal", "geometric_normal"):
            frame = rj.render(flat, camera, size=(8, 8), outputs=name)
            assert frame.arrays()[name][4, 4].tolist() == [0, 0, 1]


def test_normals_of_a_mirrored_object_are_those_of_the_mirrored_mesh(sphere, camera):
    mirror = rj.transforms.scale((-1.0, 1.0, 1.0))
    scene, twin = rj.Scene(), rj.Scene()
    scene.add(sphere, mirror)
    twin.add(rj.Mesh(sphere.vertices * [-1.0, 1.0, 1.0], sphere.faces[:, ::-1]))
    frames = [rj.render(what, camera, size=(32, 32), outputs="normal") for what in (scene, twin)]
    np.testing.assert_allclose(frames[0].normal, frames[1].normal, atol=1e-6)
    assert np.abs(frames[0].normal).max() > 0.5
