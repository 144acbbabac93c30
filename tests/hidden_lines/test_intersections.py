"""Lines along which faces pierce each other: against fractions, and solids by hand."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.hidden_lines import cells
from rasterjit.hidden_lines.edges import SurfaceFaces
from rasterjit.hidden_lines.piercings import find_intersections
from rasterjit.runtime.threads import Workers


def subtract(a, b):
    return [p - q for p, q in zip(a, b, strict=True)]


def dot(a, b):
    return sum(p * q for p, q in zip(a, b, strict=True))


def cross(a, b):
    return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]


def cut(triangle, plane):
    """Return both ends of a triangle's cut by another's plane, which counts as in front."""
    normal = cross(subtract(plane[1], plane[0]), subtract(plane[2], plane[0]))
    sides = [dot(normal, subtract(corner, plane[0])) for corner in triangle]
    ends = []
    for k in range(3):
        if (sides[k] >= 0) != (sides[k - 1] >= 0):
            along = Fraction(sides[k], sides[k] - sides[k - 1])
            edge = subtract(triangle[k - 1], triangle[k])
            ends.append([p + along * q for p, q in zip(triangle[k], edge, strict=True)])
    return ends


def naive_piercing(one, other):
    """Return both ends of the line along which triangles pierce each other, in fractions."""
    first, second = cut(one, other), cut(other, one)
    if not first or not second:
        return None
    # Both lie on one line, along which points have an order.
    start, stop = max(min(first), min(second)), min(max(first), max(second))
    return (start, stop) if start < stop else None


def surface(corners):
    """Return triangles, (F, 3, 3), without common vertices as faces."""
    corners = np.asarray(corners, float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    count = len(corners)
    numbers, ones = np.arange(3 * count), np.ones(count, np.int64)
    return SurfaceFaces(
        numbers.reshape(-1, 3), ones, ones, normals, ones > 0, corners.reshape(-1, 3), numbers,
        np.zeros(3 * count, np.int64), np.abs(corners).max(axis=(1, 2)),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(8))
def test_lines_are_those_of_fractions(seed, monkeypatch):
    monkeypatch.setattr(cells, "THINGS_PER_TASK", 5)
    monkeypatch.setattr(cells, "PAIRS_PER_THING", 1)
    random = np.random.default_rng(seed)
    # On a grid so coarse that corners lie in planes, and edges meet.
    corners = random.integers(0, (4, 60)[seed % 2], (24, 3, 3))
    edges = corners[:, 1:] - corners[:, :1]
    corners = corners[np.cross(edges[:, 0], edges[:, 1]).any(axis=1)]
    found, points = find_intersections(surface(corners), Workers(2))
    lines = {tuple(map(tuple, sorted(line.tolist()))) for line in points[found.vertices]}
    whole = [[[int(x) for x in corner] for corner in face] for face in corners.tolist()]
    want = [naive_piercing(one, other) for one, other in combinations(whole, 2)]
    want = [np.array(line, float) for line in want if line is not None]
    assert len(found.vertices) == len(want) > 10
    lines = np.array(sorted(lines)).reshape(-1, 6)
    for line in want:
        assert np.abs(lines - line.ravel()).max(axis=1).min() < 1e-12


def drawn(*placed, **options):
    """Return the intersections of meshes in places, in a view along z, 16 pixels to the unit."""
    scene = rj.Scene()
    for mesh, place in placed:
        scene.add(rj.Mesh(mesh.vertices, mesh.faces), rj.transforms.translate(place))
    camera = rj.OrthographicCamera(eye=(0, 0, 9), target=(0, 0, 0), height=4.0)
    return rj.line_drawing(scene, camera, (64, 64), edges=("intersection",), **options)


@pytest.mark.parametrize("height", [0.0, 0.3])
def test_a_ball_in_a_plate_shows_a_circle_once(height):
    # Through its middle, edges of the ball lie in the plate's face.
    ball, plate = trimesh.creation.icosphere(3), trimesh.creation.box((3.5, 3.5, 2.0))
    found = drawn((ball, (0, 0, 0)), (plate, (0, 0, height - 1.0)))
    lengths = np.sqrt((np.diff(found.segments, axis=1) ** 2).sum(axis=2)).sum()
    assert lengths == pytest.approx(16 * 2 * np.pi * np.sqrt(1 - height**2), rel=0.01)
    if height:
        assert found.visible.all()
        (circle,) = found.paths("intersection")
        assert (circle[0] == circle[-1]).all()
        assert np.ptp(np.sqrt(((circle - 32.0) ** 2).sum(axis=1))) < 0.2


def test_solids_that_touch_have_no_such_line():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    for place in ((0, 0, 1), (1, 0, 0), (1, 1, 0), (0.5, 0.25, 1), (0, 0, 1 - 1e-8)):
        assert len(drawn((box, (0, 0, 0)), (box, place)).segments) == 0
    assert len(drawn((box, (0, 0, 0)), (box, (0.5, 0.25, 0.9))).segments) > 0


@pytest.mark.parametrize("turned", [0.0, 10.0])
def test_surfaces_that_coincide_have_no_such_line(turned):
    turn = trimesh.transformations.rotation_matrix(np.radians(turned), (1, 2, 3))
    for mesh in (trimesh.creation.icosphere(2), trimesh.creation.cylinder(0.7, 2.0, sections=24)):
        mesh.apply_transform(turn)
        assert len(drawn((mesh, (0, 0, 0)), (mesh, (0, 0, 0))).segments) == 0


def test_sheets_that_cross_along_edges_of_both_have_a_line():
    # Two halves each, which meet in the middle; the second is shorter.
    corners = np.array([[-1, -1, 0], [0, -1, 0], [1, -1, 0], [-1, 1, 0], [0, 1, 0], [1, 1, 0]])
    faces = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]
    flat = trimesh.Trimesh(corners, faces, process=False)
    steep = trimesh.Trimesh(0.5 * corners[:, [2, 1, 0]] + 0.25 * corners[:, [0, 2, 2]], faces)
    found = drawn((flat, (0, 0, 0)), (steep, (0, 0, 0)))
    assert found.segments[:, :, 0].tolist() == [[32.0, 32.0]]
    assert np.ptp(found.segments[:, :, 1]) == 16.0


def test_a_wide_ground_leaves_the_lines_of_small_solids():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    wide = 1e7 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    ground = trimesh.Trimesh(wide, [[0, 1, 2], [0, 2, 3]], process=False)
    alone = drawn((box, (0, 0, 0)), (box, (0.5, 0.25, 0.125)))
    found = drawn((box, (0, 0, 0)), (box, (0.5, 0.25, 0.125)), (ground, (0, 0, -2)))
    assert len(alone.segments) > 0
    assert np.array_equal(found.segments, alone.segments)


def test_they_are_drawn_unless_other_edges_are_asked_for():
    scene, box = rj.Scene(), trimesh.creation.box((1.0, 1.0, 1.0))
    scene.add(rj.Mesh(box.vertices, box.faces))
    scene.add(rj.Mesh(box.vertices, box.faces), rj.transforms.translate((0.5, 0.3, 0.2)))
    found = rj.line_drawing(scene)
    assert found.visible[found.kinds == "intersection"].any()
    assert "intersection" not in rj.line_drawing(scene, edges=("silhouette", "crease")).kinds
