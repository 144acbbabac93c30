"""Exact areas: against rational arithmetic, and as the limit of ever more samples."""

from __future__ import annotations

from itertools import pairwise

import naive_layers
import numpy as np
import pytest
from naive_layers import CAMERA, mesh_of, scene_of
from test_layered import colors_of, meshes_of, reason, soup

import rasterjit as rj
from rasterjit.pipeline.fragments import area_coverage

SIZE = (32, 16)


def draw(meshes, samples="area", size=SIZE, background=(0.0, 0.0, 0.0, 0.0), **options):
    options = {"threads": 1, "outputs": ("linear",), **options}
    quality = rj.Quality(samples=samples, subpixel_bits=8)
    return rj.render(
        scene_of(meshes), CAMERA, size=size, background=background, quality=quality, **options
    )


def crowd(rng, large, small):
    """Return triangles that intersect each other, and small ones between them."""
    triangles = soup(rng, large, SIZE, 0.9)
    for _ in range(small):
        points = rng.uniform(0, 1, 2) * SIZE + rng.uniform(-1.5, 1.5, (3, 2))
        depths = np.round(rng.uniform(-0.9, 0.9, 3) * 2**20) / 2**20
        triangles.append(((np.round(points * 256) / 256).tolist(), depths))
    return triangles


def test_every_share_is_the_exact_area():
    # Of three triangles at a time each alone has a channel: shares are read off.
    rng = np.random.default_rng(81)
    checked = intersecting = 0
    for _ in range(2):
        triangles = crowd(rng, 4, 50)
        count = len(triangles)
        shares = np.zeros((count, SIZE[1], SIZE[0]))
        plain = [mesh_of(points, depths, SIZE) for points, depths in triangles]
        for first in range(0, count, 3):
            materials = [rj.Material("unlit", "black")] * count
            of_channels = [
                rj.Material("unlit", color) for color in np.eye(3)[: count - first].tolist()
            ]
            materials[first : first + 3] = of_channels
            meshes = [
                rj.Mesh(mesh.vertices, mesh.faces, material=material)
                for mesh, material in zip(plain, materials, strict=True)
            ]
            frame = draw(meshes)
            seen = frame.linear[..., :3] * frame.linear[..., 3:]
            shares[first : first + 3] = seen.transpose(2, 0, 1)[: len(of_channels)]
        # With the background they are the whole pixel.
        np.testing.assert_allclose(shares.sum(axis=0), frame.linear[..., 3], atol=1e-6)
        mixed = np.argwhere((shares > 0).sum(axis=0) > 1)
        for row, column in rng.permutation(mixed)[:40].tolist():
            exact = naive_layers.exact_shares(triangles, column, row)
            want = np.array([float(exact.get(face, 0)) for face in range(count)])
            np.testing.assert_allclose(shares[:, row, column], want, atol=3e-7)
            checked += 1
            intersecting += len(exact) > 2
    assert checked == 80
    assert intersecting > 10


def test_triangles_of_equal_depth_at_a_corner_are_not_counted_twice():
    # The line of equal depths goes through the corner: a hidden part begins with an edge of none.
    one = [(228, 202), (239, 89), (131, 171)], (-30, 39, -41)
    other = [(228, 202), (116, 90), (239, 278)], (-30, -9, -16)
    behind = [(0, 0), (1024, 0), (0, 1024)], (60, 60, 60)
    triangles = [
        ((8 + np.array(points) / 256).tolist(), np.array(depths) / 64)
        for points, depths in (one, other, behind)
    ]
    meshes = [
        mesh_of(*triangle, SIZE, base_color=color)
        for triangle, color in zip(triangles, np.eye(3).tolist(), strict=True)
    ]
    exact = naive_layers.exact_shares(triangles, 8, 8)
    want = [float(exact[face]) for face in range(3)]
    np.testing.assert_allclose(draw(meshes).linear[8, 8, :3], want, atol=3e-7)


def test_sixteen_samples_converge_to_it():
    rng = np.random.default_rng(82)
    triangles = crowd(rng, 6, 10)
    colors = colors_of(rng, len(triangles))
    meshes = meshes_of(triangles, colors, np.zeros(len(triangles), bool), SIZE)
    exact = draw(meshes, background="white").linear
    errors = [
        np.abs(draw(meshes, samples, background="white").linear - exact).mean()
        for samples in (1, 2, 4, 8, 16)
    ]
    assert all(b < 0.8 * a for a, b in pairwise(errors))
    assert errors[-1] < 0.2 * errors[0]


def test_shared_edges_leave_neither_gap_nor_overlap(sphere, camera):
    # White faces before black: nothing of it shines through between them, nothing is there twice.
    ball = rj.Mesh(sphere.vertices * 1.5, sphere.faces, material=rj.Material("unlit", "white"))
    options = dict(size=(60, 50), background="black", outputs=("linear",), threads=1)
    seen = rj.render(ball, camera, quality=rj.Quality(samples="area"), **options).linear[..., 0]
    inside = rj.render(ball, camera, quality=rj.Quality(samples=16), **options).linear[..., 0] == 1
    assert inside.sum() > 500
    assert np.abs(seen[inside] - 1.0).max() < 0.07
    # Away from the outline it is 1 but for the rounding of the sum.
    deep = inside.copy()
    for axis in (0, 1):
        for step in (1, -1):
            deep &= np.roll(inside, step, axis)
    assert np.abs(seen[deep] - 1.0).max() < 1e-6


def test_of_equal_depths_the_lower_face_is_seen():
    points = [(3, 3), (20, 4), (5, 14)]
    others = [(4, 3), (22, 6), (5, 13)]
    for one, other in ((points, others), (others, points)):
        meshes = [
            mesh_of(one, [0.25] * 3, SIZE, base_color=(1, 0, 0)),
            mesh_of(other, [0.25] * 3, SIZE, base_color=(0, 1, 0)),
        ]
        red = draw(meshes[:1]).linear[..., 3]
        both = draw(meshes).linear
        np.testing.assert_allclose(both[..., 0] * both[..., 3], red, atol=1e-6)


def test_pixels_of_one_face_and_of_none_keep_their_bits(cube, camera):
    options = dict(size=(60, 50), background=(0.3, 0.1, 0.7, 0.4), outputs=("linear", "color"))
    one = rj.render(cube, camera, threads=1, **options)
    many = rj.render(cube, camera, quality=rj.Quality(samples=16), **options)
    exact = rj.render(cube, camera, quality=rj.Quality(samples="area"), **options)
    fine = rj.render(cube, camera, size=(960, 800), outputs=("face_id",)).face_id
    blocks = fine.reshape(50, 16, 60, 16).transpose(0, 2, 1, 3).reshape(50, 60, -1)
    plain = (blocks == blocks[:, :, :1]).all(axis=2)
    for axis in (0, 1):
        for step in (1, -1):
            plain &= (np.roll(blocks, step, axis) == blocks).all(axis=2)
    assert plain.sum() > 1000
    assert exact.linear[plain].tobytes() == one.linear[plain].tobytes()
    assert exact.color[plain].tobytes() == one.color[plain].tobytes()
    assert np.abs(exact.linear - many.linear).mean() < 0.01


def test_threads_and_clipped_faces(camera):
    # A floor that begins behind the eye: its pieces are one face.
    eye = rj.PerspectiveCamera(eye=(0, 1, 0), target=(0, 0.8, -1), near=0.1, far=100.0)
    floor = [[-50, 0, 50], [50, 0, 50], [50, 0, -50], [-50, 0, -50]]
    mesh = rj.Mesh(floor, [[0, 1, 2], [0, 2, 3]], material=rj.Material("unlit", "white"))
    options = dict(size=(70, 66), background="black", outputs=("linear",))
    quality = rj.Quality(samples="area")
    one = rj.render(mesh, eye, quality=quality, threads=1, **options)
    two = rj.render(mesh, eye, quality=quality, threads=3, **options)
    assert one.linear.tobytes() == two.linear.tobytes()
    assert one.stats.clipped > 0
    centres = rj.render(mesh, eye, threads=1, **options).linear[..., 0]
    assert np.abs(one.linear[..., 0] - centres).mean() < 0.02
    assert (one.linear[..., 0] > 0.999999).sum() > 1000


def test_a_pixel_of_hundreds_of_faces():
    rng = np.random.default_rng(83)
    meshes = []
    for n in range(150):
        points = np.round((8 + rng.uniform(0, 1, (3, 2))) * 256) / 256
        meshes.append(mesh_of(points, [-0.5 + n / 300] * 3, SIZE, base_color=(1, 1, 1)))
    seen = draw(meshes).linear[8, 8, 3]
    many = draw(meshes, 16).linear[8, 8, 3]
    assert abs(seen - many) < 0.1


def test_too_many_pieces_are_an_error_that_says_where(monkeypatch):
    # Compiled code has its limits built in: the Python side is told by a number.
    def give_up(*arguments):
        arguments[-3][:] = -1, 7, 5

    monkeypatch.setattr(area_coverage, "find_areas", give_up)
    mesh = mesh_of([(3, 3), (20, 4), (5, 14)], [0.25] * 3, SIZE)
    with pytest.raises(ValueError, match=r"samples must be .* got 'area': .* column 7, row 5"):
        draw([mesh])


def test_blended_materials_are_refused():
    mesh = mesh_of([(3, 3), (20, 4), (5, 14)], [0.25] * 3, SIZE, base_color=(1, 0, 0, 0.5),
                   alpha_mode="blend")  # fmt: skip
    with pytest.raises(ValueError, match=r"samples must be .* 'area' and object 0 with alpha_mode"):
        draw([mesh])


def test_plan_says_that_areas_are_found(cube, camera):
    plan = rj.explain(cube, camera, rj.Quality(samples="area"))
    assert reason(plan, "anti-aliasing") == (
        True, "exact areas, shaded once per face and pixel",
    )  # fmt: skip
