"""Smooth outlines lie on the edges themselves, as wide as asked, by their area of each pixel."""

from __future__ import annotations

import math

import naive_lines
import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.effects.outline import tracing
from rasterjit.scene.color import decoding_table
from rasterjit.scene.edge_twins import NO_TWIN, find_twins
from rasterjit.scene.quality import Quality

SMOOTH = Quality(lines="coverage")
SIZE = (72, 56)
WHITE = rj.Material("unlit", "white")

CODE_ERROR = 0.006
"""Largest error of a share that is read from an 8-bit code."""

LARGEST_ERROR = 0.07
"""Largest error of a pixel beside a straight edge or a finely curved one, but for its corners."""


def scene_of(*meshes, **settings):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(rj.Mesh(mesh.vertices, mesh.faces, material=WHITE))
    scene.outline = rj.Outline(**{"color": "red", **settings})
    return scene


def shares(scene, camera, size=SIZE, quality=SMOOTH, **options):
    """Return how much of each pixel red lines cover on white: green is what is left."""
    options = {"threads": 1, "background": "white", **options}
    frame = rj.render(scene, camera, size=size, quality=quality, **options)
    return 1.0 - decoding_table()[frame.color[..., 1]]


def project(points, camera, size=SIZE):
    """Return points of the world in pixels, (N, 2)."""
    matrix = camera.projection_matrix(size) @ camera.view_matrix()
    clip = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return (clip[:, :2] / clip[:, 3:] * (1, -1) + 1) * 0.5 * size


def flat_camera(size=SIZE):
    """Return a camera whose units are pixels, from the picture's middle, y up."""
    width, height = size
    return rj.MatrixCamera(np.eye(4), np.diag([2.0 / width, 2.0 / height, 0.5, 1.0]))


def polygon(count, radius, turn, center=(0.0, 0.0)):
    """Return a regular polygon, and its sides in pixels, (N, 4)."""
    angles = math.radians(turn) + 2.0 * np.pi * np.arange(count) / count
    corners = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1) + center
    mesh = rj.Mesh(
        np.column_stack([corners, np.zeros(count)]), [(0, n, n + 1) for n in range(1, count - 1)]
    )
    pixels = corners * (1, -1) + np.array(SIZE) / 2
    return mesh, np.concatenate([pixels, np.roll(pixels, -1, axis=0)], axis=1)


def far_from(points, distance, size=SIZE):
    """Return which pixels are farther than a distance from all points, (H, W)."""
    rows, columns = np.mgrid[: size[1], : size[0]] + 0.5
    far = np.ones(size[::-1], bool)
    for x, y in points:
        far &= np.hypot(columns - x, rows - y) > distance
    return far


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("width", [0.5, 1.0, 1.5, 4.0])
def test_a_straight_edge_is_as_wide_as_asked(width, samples):
    for angle in (0.0, 3.0, 17.0, 45.0, 71.0):
        slope = math.tan(math.radians(min(angle, 90.0 - angle)))
        far = 200.0
        mesh = rj.Mesh(
            [(-far, 0.3 - slope * far, 0), (far, 0.3 + slope * far, 0), (0, far * far, 0)],
            [(0, 1, 2)],
        )
        found = shares(
            scene_of(mesh, width=width), flat_camera(),
            quality=Quality(lines="coverage", samples=samples),
        )  # fmt: skip
        columns = found[:, 20:52].sum(axis=0)
        length = math.sqrt(1.0 + slope * slope)
        assert columns.sum() == pytest.approx(32 * width * length, rel=0.01)
        assert np.abs(columns - width * length).max() < 0.01 + CODE_ERROR * (width + 3.0)


@pytest.mark.parametrize("width", [1.0, 2.5, 7.0])
@pytest.mark.parametrize(("count", "turn"), [(3, 10.0), (4, 31.0), (5, 3.0)])
def test_polygons_have_the_coverage_that_samples_find(count, turn, width):
    mesh, sides = polygon(count, 20.3, turn, (0.37, -0.21))
    found = shares(scene_of(mesh, width=width), flat_camera())
    want = naive_lines.stroke_shares(sides, width / 2, SIZE)
    # In a sharp corner, the inner sides of the lines meet far from it.
    away = far_from(sides[:, :2], 1.5 + width)
    assert np.abs(found - want)[away].max() < LARGEST_ERROR
    assert np.abs(found - want).sum() < 0.03 * want.sum() + 2.0
    assert found.sum() == pytest.approx(want.sum(), rel=0.02)


@pytest.mark.parametrize("eye", [(3.0, 2.0, 4.0), (-1.0, 3.0, 2.5), (0.4, -2.0, 4.5)])
def test_edges_and_creases_of_a_cube_are_those_of_its_projection(cube, eye):
    camera = rj.PerspectiveCamera(eye=eye, target=(0, 0, 0), fov_y=40.0, near=0.5)
    found = shares(scene_of(cube, width=1.5), camera)
    corners = cube.vertices[cube.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    seen = cube.faces[np.einsum("ij,ij->i", normals, np.array(eye) - corners[:, 0]) > 0.0]
    edges = {tuple(sorted((f[k], f[(k + 1) % 3]))) for f in seen.tolist() for k in range(3)}
    ends = cube.vertices[np.array(sorted(edges))]
    sides = np.abs(ends[:, 0] - ends[:, 1])
    ends = ends[(sides > 0).sum(axis=1) == 1]
    start, end = project(ends[:, 0], camera), project(ends[:, 1], camera)
    want = naive_lines.stroke_shares(np.concatenate([start, end], axis=1), 0.75, SIZE)
    # Where two edges meet at a small angle, they are nearer than a pixel for some way.
    away = far_from(np.concatenate([start, end]), 5.0)
    assert np.abs(found - want)[away].max() < LARGEST_ERROR
    assert found.sum() == pytest.approx(want.sum(), rel=0.03)


def fine_ball(rows=90, columns=180):
    """Return a ball of radius 1 whose faces are smaller than pixels where it turns away."""
    polar, around = np.mgrid[0 : rows + 1, 0:columns]
    polar, around = polar * np.pi / rows, around * 2.0 * np.pi / columns
    vertices = np.stack(
        [np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=2
    ).reshape(-1, 3)
    a, b = np.mgrid[0:rows, 0:columns]
    p, q = a * columns + b, a * columns + (b + 1) % columns
    faces = np.stack([p, q, q + columns, p, q + columns, p + columns], axis=2).reshape(-1, 3)
    return rj.Mesh(vertices, faces)


def test_a_round_shape_has_an_even_line_around():
    radius, width = 20.0, 1.0
    camera = rj.OrthographicCamera(
        eye=(0.1, 0.2, 5.0), target=(0.1, 0.2, 0.0), height=56.0 / radius, near=0.1, far=10.0
    )
    found = shares(scene_of(fine_ball(), width=width), camera)
    center = np.array(SIZE) / 2 + radius * np.array([-0.1, 0.2])
    angles = np.linspace(0.0, 2.0 * np.pi, 181)
    ring = center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    want = naive_lines.stroke_shares(
        np.concatenate([ring[:-1], ring[1:]], axis=1), width / 2, SIZE, steps=8
    )
    assert np.abs(found - want).max() < 0.13
    assert np.abs(found - want)[want > 0].mean() < 0.03
    assert found.sum() == pytest.approx(want.sum(), rel=0.02)


def test_objects_that_touch_are_parted_where_they_do(cube):
    other = rj.Mesh(cube.vertices + (2.0, 0.0, 0.0), cube.faces)
    camera = rj.OrthographicCamera(
        eye=(0.93, 0, 9), target=(0.93, 0, 0), height=3.0, near=1.0, far=20.0
    )
    found = shares(scene_of(cube, other, width=1.0), camera)
    column = project(np.array([[1.0, 0.0, 0.0]]), camera)[0, 0]
    middle = found[20:36]
    at = math.floor(column)
    assert middle[:, at - 2 : at + 3].sum(axis=1) == pytest.approx(np.ones(16), abs=0.03)
    mean = (middle * (np.arange(SIZE[0]) + 0.5))[:, at - 2 : at + 3].sum(axis=1)
    assert mean == pytest.approx(np.full(16, column), abs=1.0)


def test_a_small_turn_changes_little():
    camera, before = flat_camera(), None
    for turn in np.arange(20.0, 23.0, 0.1):
        mesh, _ = polygon(4, 22.0, turn)
        found = shares(scene_of(mesh, width=2.0), camera)
        if before is not None:
            # A corner moves by 0.04 pixels.
            assert np.abs(found - before).max() < 0.14
        before = found


def test_lines_go_on_to_the_border_of_the_picture():
    far = 300.0
    ends = np.array([(-far, 0.3 - far), (far, 0.3 + 0.4 * far)])
    mesh = rj.Mesh([(*ends[0], 0), (*ends[1], 0), (-far, far, 0)], [(0, 1, 2)])
    found = shares(scene_of(mesh, width=9.0), flat_camera())
    middle = ends * (1, -1) + np.array(SIZE) / 2
    want = naive_lines.stroke_shares([middle.ravel()], 4.5, SIZE)
    assert np.abs(found - want).max() < LARGEST_ERROR


@pytest.mark.needs_jit
@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_no_bit(threads, sphere, cube):
    camera = rj.PerspectiveCamera(eye=(2, 2.5, 4), target=(0, 0, 0), fov_y=40.0, near=0.05)
    scene = scene_of(sphere, cube, width=5.0)
    once = rj.render(scene, camera, size=(300, 250), quality=SMOOTH, threads=1).color
    again = rj.render(scene, camera, size=(300, 250), quality=SMOOTH, threads=threads).color
    assert once.tobytes() == again.tobytes()


def test_faces_across_the_near_plane_end_where_they_are_seen_to():
    """A floor that begins behind the eye: its far end is a straight line."""
    floor = rj.Mesh([(-90, 0, 9), (90, 0, 9), (90, 0, -30), (-90, 0, -31)], [(0, 1, 2), (0, 2, 3)])
    camera = rj.PerspectiveCamera(eye=(0, 2, 0), target=(0, 0, -20), fov_y=40.0, near=0.5)
    found = shares(scene_of(floor, width=1.0), camera)
    ends = project(np.array([[90.0, 0.0, -30.0], [-90.0, 0.0, -31.0]]), camera)
    want = naive_lines.stroke_shares([ends.ravel()], 0.5, SIZE)
    assert np.abs(found - want).max() < LARGEST_ERROR


def test_only_smooth_outlines_are_traced(cube, monkeypatch):
    def refuse(*_):
        raise AssertionError("nobody asked for it")

    for name in ("find_crossings", "cover_crossings"):
        monkeypatch.setattr(tracing, name, refuse)
    camera = rj.PerspectiveCamera(eye=(2, 2.5, 4), target=(0, 0, 0))
    scene = scene_of(cube)
    rj.render(scene, camera, size=(16, 16))
    rj.render(scene, camera, size=(16, 16), quality=SMOOTH, outputs=("depth",))
    scene.outline = None
    rj.render(scene, camera, size=(16, 16), quality=SMOOTH)
    assert cube._edge_twins is None


def test_widths_of_hard_lines_are_rounded(cube):
    camera = rj.PerspectiveCamera(eye=(2, 2.5, 4), target=(0, 0, 0))
    pictures = [
        rj.render(scene_of(cube, width=width), camera, size=(40, 30)).color
        for width in (2, 2.4, 1.5, 2.5)
    ]
    assert (pictures[0] == pictures[1]).all()
    assert (pictures[0] == pictures[2]).all()
    assert (pictures[0] != pictures[3]).any()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2)])
def test_small_pictures(size, cube):
    camera = rj.PerspectiveCamera(eye=(2, 2.5, 4), target=(0, 0, 0))
    assert shares(scene_of(cube, width=9.0), camera, size).shape == size[::-1]


def test_plan_names_what_is_drawn(cube):
    plan = rj.explain(scene_of(cube, width=1.5), None, SMOOTH, size=(16, 16))
    (effect,) = [effect for effect in plan.effects if effect.name == "outline"]
    assert effect.reason == "silhouette, object, crease, 1.5 wide, by coverage"


def test_twins_are_the_other_faces_of_edges(sphere):
    loose = sphere.vertices[sphere.faces].reshape(-1, 3)
    faces = np.arange(len(loose), dtype=np.int32).reshape(-1, 3)
    for vertices, rows in ((sphere.vertices, sphere.faces), (loose, faces), (loose, faces[3:])):
        twins = find_twins(vertices, rows)
        at = {
            (tuple(vertices[face[k]]), tuple(vertices[face[(k + 1) % 3]])): 3 * n + k
            for n, face in enumerate(rows.tolist())
            for k in range(3)
        }
        want = [at.get((end, start), NO_TWIN) for start, end in at]
        assert twins.ravel().tolist() == want


def test_sides_of_three_faces_at_an_edge_follow_in_a_ring():
    vertices = np.array([(0, 0, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (-1, 0, 0)], float)
    twins = find_twins(vertices, np.array([(0, 1, 2), (1, 0, 3), (0, 1, 4)], np.int32))
    assert twins[:, 0].tolist() == [3, 6, 0]
    assert (twins[:, 1:] == NO_TWIN).all()


def test_rims_of_bores_in_fine_meshes_are_whole():
    """Pixels at the rim show faces of the top and of the bore that have no corner in common."""
    part = trimesh.creation.annulus(0.4, 1.0, 0.8, sections=64).subdivide().subdivide()
    camera = rj.PerspectiveCamera((0.3, -3.0, 2.0), (0.0, 0.0, 0.0), up=(0, 0, 1), fov_y=40.0)
    edges = ("silhouette", "crease")
    inked = shares(scene_of(part, edges=edges), camera, (160, 120)) > 0.2
    around = np.linspace(0.0, 2.0 * np.pi, 400)
    rim = np.stack([0.4 * np.cos(around), 0.4 * np.sin(around), np.full(400, 0.4)], axis=1)
    for x, y in project(rim, camera, (160, 120)).astype(int):
        assert inked[y - 1 : y + 2, x - 1 : x + 2].any(), (x, y)
