"""Which parts of edges are visible: against fractions, convex bodies and boxes by hand."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.hidden_lines import cells
from rasterjit.hidden_lines.occlusion import exact_span, make_triangles, split_by_visibility
from rasterjit.inspect import oracle
from rasterjit.runtime.threads import Workers

EXTENT = 64
"""Width and height of the picture of random triangles, units of the grid."""


def naive_pieces(ends, depths, triangles):
    """Return (begin, end, hidden) of an edge: cut wherever anything may change, middles tried."""
    start, stop = (tuple(map(Fraction, end)) for end in (ends[:2], ends[2:]))
    faces = [
        (corners[:2], corners[2:4], corners[4:], list(map(Fraction, of_face)), Fraction(slack))
        for corners, of_face, slack in zip(
            triangles.corners.tolist(), triangles.depths.tolist(), triangles.slack.tolist(),
            strict=True,
        )
    ]  # fmt: skip
    near, far = map(Fraction, depths)

    def lead(face, end, depth):
        *corners, of_face, _ = face
        weights = oracle.affine_weights(corners, end)
        return sum(w * d for w, d in zip(weights, of_face, strict=True)) - depth

    cuts = {Fraction(0), Fraction(1)}
    for face in faces:
        a, b, c = face[:3]
        values = [(oracle.edge(*side, start), oracle.edge(*side, stop)) for side in
                  ((a, b), (b, c), (c, a))]  # fmt: skip
        for one, other in [*values, (lead(face, start, near), lead(face, stop, far))]:
            if one != other:
                cuts.add(Fraction(one) / (one - other))
    spans, pieces = list(pairwise(sorted(cut for cut in cuts if 0 <= cut <= 1))), []

    def lead_at(face, along):
        return lead(face, point_at(along), near + along * (far - near))

    def point_at(along):
        return [p + along * (q - p) for p, q in zip(start, stop, strict=True)]

    def covers(face, low, high):
        return min(oracle.affine_weights(face[:3], point_at((low + high) / 2))) >= 0

    hiding = [
        face
        for face in faces
        if any(
            covers(face, *span) and max(lead_at(face, along) for along in span) > face[4]
            for span in spans
        )
    ]
    for low, high in spans:
        hidden = any(
            covers(face, low, high) and lead_at(face, (low + high) / 2) > 0 for face in hiding
        )
        if pieces and pieces[-1][2] == hidden:
            pieces[-1][1] = high
        else:
            pieces.append([low, high, hidden])
    return pieces


def random_soup(random, count, levels):
    """Return triangles and edges on a grid so coarse that they touch, meet and coincide."""
    xy = random.integers(-8, EXTENT + 8, (count, 3, 2))
    triangles = make_triangles(
        xy.astype(np.int32), random.integers(0, levels, (count, 3)) / levels,
        random.integers(-1, 2, count) * (random.random(count) < 0.2),
    )  # fmt: skip
    ends = random.integers(0, EXTENT, (12, 4)).astype(np.int32)
    corners = triangles.corners.reshape(-1, 3, 2)
    if len(corners):
        # Some begin at corners, or run along sides.
        ends[0] = corners[0, :2].ravel()
        ends[1, :2], ends[2] = corners[0, 0], (2 * corners[0, 0] - corners[0, 1]).tolist() * 2
    return triangles, ends, random.integers(0, levels, (12, 2)) / levels


@pytest.mark.parametrize("seed", range(24))
def test_pieces_are_those_of_fractions(seed):
    random = np.random.default_rng(seed)
    triangles, ends, depths = random_soup(random, 3 + seed % 6, (4, 1000)[seed % 2])
    is_inside = ((ends >= 0) & (ends <= EXTENT)).all(axis=1)
    ends, depths = np.ascontiguousarray(ends[is_inside]), depths[is_inside]
    found = split_by_visibility(ends, depths, triangles, (EXTENT + 1, EXTENT + 1), Workers(1))
    for n in range(len(ends)):
        if (ends[n, :2] == ends[n, 2:]).all():
            continue
        mine = found.edges == n
        want = naive_pieces(ends[n].tolist(), depths[n].tolist(), triangles)
        assert found.is_hidden[mine].tolist() == [hidden for *_, hidden in want]
        parts = [(float(low), float(high)) for low, high, _ in want]
        np.testing.assert_allclose(found.parts[mine], parts, atol=1e-12)


def test_what_floats_cannot_tell_is_decided_in_fractions():
    # The triangle is nearer than the edge by its slack exactly, but for one bit.
    triangles = make_triangles(
        np.array([[(0, 0), (40, 0), (0, 40)]], np.int32), np.full((1, 3), 0.5), np.zeros(1, int)
    )
    ends, depth = np.array([(3, 3, 17, 11)] * 3, np.int32), 0.5 - triangles.slack[0]
    depths = np.array([[depth] * 2, [np.nextafter(depth, 0.0)] * 2, [np.nextafter(depth, 1.0)] * 2])
    found = split_by_visibility(ends, depths, triangles, (64, 64), Workers(1))
    assert found.is_hidden.tolist() == [False, True, False]
    spans = [
        exact_span(ends[n].tolist(), depths[n].tolist(), triangles.corners[0].tolist(),
                   [0.5] * 3, float(triangles.slack[0])) for n in range(3)
    ]  # fmt: skip
    assert spans == [None, (0, 1), None]


def is_front(mesh, eye):
    """Return which faces of a mesh look to a point, in fractions."""
    fronts = []
    for corners in mesh.vertices[mesh.faces].tolist():
        a, b, c, e = (list(map(Fraction, p)) for p in (*corners, eye))
        u, v, w = ([q[k] - a[k] for k in range(3)] for q in (b, c, e))
        normal = [u[k - 2] * v[k - 1] - u[k - 1] * v[k - 2] for k in range(3)]
        fronts.append(sum(n * x for n, x in zip(normal, w, strict=True)) > 0)
    return np.array(fronts)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_of_a_convex_body_edges_of_faces_that_look_here_are_visible_whole(seed, mirror):
    random = np.random.default_rng(seed)
    hull = trimesh.convex.convex_hull(random.normal(size=(24, 3)))
    eye = (4.0 + seed, 3.0, 5.0)
    fronts = is_front(hull, np.multiply(eye, (mirror, 1.0, 1.0)))
    scene = rj.Scene()
    scene.add(rj.Mesh(hull.vertices, hull.faces), rj.transforms.scale((mirror, 1.0, 1.0)))
    camera = rj.PerspectiveCamera(eye=eye, target=(0, 0, 0), fov_y=70.0)
    found = rj.line_drawing(scene, camera, (300, 200), edges=("silhouette", "crease", "wireframe"))
    adjacent = fronts[hull.face_adjacency]
    edges = hull.vertices[hull.face_adjacency_edges] * (mirror, 1.0, 1.0)
    want = camera.project(edges, (300, 200)).pixels
    assert len(found.segments) == len(edges)
    assert np.count_nonzero(found.kinds == "silhouette") == (adjacent.sum(axis=1) == 1).sum()
    for ends, seen in zip(want, adjacent.any(axis=1), strict=True):
        both = np.stack([ends, ends[::-1]])
        gaps = np.abs(found.segments[:, np.newaxis] - both).max(axis=(2, 3)).min(axis=1)
        assert gaps.min() < 2.0**-12
        assert found.visible[gaps.argmin()] == seen


def boxes(place=(0.0, 0.0, 0.0), **material):
    """Return a scene of a plate before another, both square to a parallel view."""
    scene, box = rj.Scene(), trimesh.creation.box((2.0, 2.0, 0.5))
    scene.add(rj.Mesh(box.vertices, box.faces), rj.transforms.translate((0, 0, -3)), "behind")
    front = rj.Mesh(box.vertices, box.faces, material=rj.Material(**material))
    scene.add(front, rj.transforms.translate(place), "in front")
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=4.0)
    return scene, camera


def test_a_box_hides_the_edges_of_another_from_where_it_begins():
    scene, camera = boxes((0.75, 0.5, 0.0))
    found = rj.line_drawing(scene, camera, (64, 64))
    # 16 pixels to the unit, (0, 0) in the middle: the box behind from 16 to 48, the other from
    # 28 to 60 and from 8 to 40.
    is_mine = (found.object_ids == 0) & found.visible
    mine = np.unique(np.sort(found.segments[is_mine], axis=1).reshape(-1, 4), axis=0)
    assert mine.tolist() == [
        [16.0, 16.0, 16.0, 48.0], [16.0, 16.0, 28.0, 16.0], [16.0, 48.0, 48.0, 48.0],
        [48.0, 40.0, 48.0, 48.0],
    ]  # fmt: skip
    other = found.segments[(found.object_ids == 1) & found.visible]
    assert {tuple(point) for point in other.reshape(-1, 2).tolist()} == {
        (28.0, 8.0), (28.0, 40.0), (60.0, 8.0), (60.0, 40.0)
    }  # fmt: skip


def test_faces_do_not_hide_what_lies_in_them():
    # A square in the plane of a larger one, with other triangles.
    large = np.array([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], float)
    small = np.array([(-1, -0.7, 0), (1.1, -1, 0), (0.9, 1, 0), (-1, 1.3, 0)], float)
    turn = rj.transforms.rotate((0.3, 1.0, 0.2), 33.0)
    scene = rj.Scene()
    scene.add(rj.Mesh(large, [(0, 1, 2), (0, 2, 3)]), turn)
    scene.add(rj.Mesh(small, [(0, 1, 3), (1, 2, 3)]), turn)
    found = rj.line_drawing(scene, size=(200, 150), edges=("boundary", "wireframe"))
    assert found.visible.all()
    assert len(found.segments) == 10


def test_faces_that_pierce_hide_edges_from_there():
    # A square across the view, and a triangle whose tip comes through it half way.
    square = rj.Mesh([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [(0, 1, 2), (0, 2, 3)])
    tip = rj.Mesh([(-1, 0, -1), (-1, 0.5, -1), (1, 0, 1)], [(0, 1, 2)])
    scene = rj.Scene()
    scene.add(square)
    scene.add(tip)
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=8.0)
    found = rj.line_drawing(scene, camera, (64, 64))
    seen = found.segments[found.visible & (found.object_ids == 1)]
    # 8 pixels to the unit: y = 0 is row 32, and z = 0 half way along both long sides.
    ends = sorted(map(tuple, np.round(seen, 3).reshape(-1, 2).tolist()))
    assert ends == [(32.0, 30.0), (32.0, 32.0), (40.0, 32.0), (40.0, 32.0)]


@pytest.mark.parametrize(
    ("material", "hides"),
    [
        ({"base_color": (1.0, 1.0, 1.0, 0.5), "alpha_mode": "blend"}, False),
        ({"base_color": (1.0, 1.0, 1.0, 1.0), "alpha_mode": "blend"}, True),
        ({"shading": "pbr", "transmission": 1.0}, False),
        ({"shading": "pbr"}, True),
    ],
)
def test_see_through_objects_hide_nothing_and_have_edges(material, hides):
    scene, camera = boxes(**material)
    found = rj.line_drawing(scene, camera, (64, 64))
    is_behind = found.object_ids == 0
    assert found.visible[is_behind].any() == (not hides)
    assert found.visible[~is_behind].any()


@pytest.mark.parametrize("double_sided", [True, False])
def test_culled_faces_hide_nothing_and_their_edges_are_hidden(double_sided):
    material = rj.Material(double_sided=double_sided)
    square = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
    scene = rj.Scene()
    scene.add(rj.Mesh(square, [(0, 2, 1), (0, 3, 2)], material=material))
    scene.add(rj.Mesh(np.array(square) * 0.5 - (0, 0, 1), [(0, 1, 2), (0, 2, 3)]))
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=8.0)
    found = rj.line_drawing(scene, camera, (64, 64))
    assert found.visible[found.object_ids == 0].all() == double_sided
    assert found.visible[found.object_ids == 1].all() == (not double_sided)


def test_edges_before_the_near_plane_are_cut_there():
    floor = rj.Mesh([(-1, 0, 9), (1, 0, 9), (1, 0, -9), (-1, 0, -9)], [(0, 1, 2), (0, 2, 3)])
    camera = rj.PerspectiveCamera(eye=(0, 1, 2), target=(0, 1, 0), fov_y=90.0, near=0.5)
    found = rj.line_drawing(floor, camera, (100, 100))
    assert found.visible.all()
    # Both long sides run from the horizon's corner to the lower end of the picture.
    sides = [line for line in found.segments.tolist() if line[0][1] != line[1][1]]
    assert len(sides) == 2
    for (x, y), (far_x, far_y) in (sorted(line, key=lambda end: -end[1]) for line in sides):
        assert y == 100.0
        assert abs(abs(x - 50.0) - 50.0) < 0.001
        assert abs(far_y - (50.0 + 50.0 / 11.0)) < 0.001
        assert abs(abs(far_x - 50.0) - 50.0 / 11.0) < 0.001


def test_bits_are_the_same_for_any_number_of_threads(monkeypatch):
    monkeypatch.setattr(cells, "THINGS_PER_TASK", 500)
    monkeypatch.setattr(cells, "PAIRS_PER_THING", 1)
    scene = rj.load("models/torus_knot.obj")
    one, other = (
        rj.line_drawing(scene, size=(200, 150), edges=("silhouette", "wireframe"), threads=count)
        for count in (1, 3)
    )
    for name in ("segments", "kinds", "object_ids", "visible"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def widened(pixels):
    """Return pixels and those around them, (H, W) bool."""
    shifts = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1)]
    return np.logical_or.reduce([np.roll(pixels, shift, (0, 1)) for shift in shifts])


def test_lines_are_where_a_technical_picture_has_ink():
    scene, size = rj.load("models/teapot.obj"), (640, 480)
    camera = rj.fit_camera(scene, aspect=4 / 3)
    style = rj.styles.technical(scene, camera)
    ink = rj.render(style.scene, camera, size=size).color[..., :3].max(axis=2) < 128
    drawing = rj.line_drawing(scene, camera, size)
    lines = drawing.segments[drawing.visible]
    shares = np.linspace(0.0, 1.0, 101)[:, np.newaxis, np.newaxis]
    points = (lines[:, 0] + shares * (lines[:, 1] - lines[:, 0])).reshape(-1, 2)
    lengths = np.tile(np.abs(lines[:, 1] - lines[:, 0]).max(axis=1), len(shares))
    columns, rows = np.floor(points).astype(int).T
    assert (lengths * widened(ink)[rows, columns]).sum() > 0.97 * lengths.sum()
    drawn = np.zeros_like(ink)
    drawn[rows, columns] = True
    assert np.count_nonzero(ink & widened(widened(drawn))) > 0.99 * np.count_nonzero(ink)
