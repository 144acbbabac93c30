"""Edges are clipped like faces, hidden where they lie behind, and without gaps elsewhere."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.effects import wireframe
from rasterjit.effects.wireframe import stage as wireframe_stage
from rasterjit.inspect import oracle
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads as sharing
from rasterjit.survey import cache

SIZE = (64, 64)
NEAR_OVER_W = (1.0, 0.0, 0.0)


def project(positions, edges, size=SIZE, coefficients=NEAR_OVER_W):
    """Return the end pixels and depths of the edges that may be seen."""
    edges, viewport = np.array(edges, np.int32), make_viewport(size, 8)
    positions = np.ascontiguousarray(positions, np.float64)
    pixels, codes = np.full((len(positions), 2), -9, np.int32), codes_of(positions, viewport)
    wireframe_stage.find_pixels((0, len(positions)), positions, codes, viewport, pixels)
    ends, depths = np.full((len(edges), 4), -9, np.int32), np.full((len(edges), 2), np.nan)
    vertices = positions, codes, pixels
    count = wireframe_stage.project_edges(edges, vertices, coefficients, viewport, ends, depths)
    without = np.full_like(ends, -9)
    assert count == wireframe_stage.project_edges(
        edges, vertices, coefficients, viewport, without, np.empty((0, 2))
    )
    np.testing.assert_array_equal(without[:count], ends[:count])
    return ends[:count], depths[:count]


def codes_of(positions, viewport):
    """Return the outcodes of clip positions."""
    screen, _ = drawing.project_to_screen(positions, NEAR_OVER_W, viewport, sharing.Workers(1))
    return screen.codes[: len(positions)]


def seen_by(points, near=1.0, far=np.inf):
    matrix = rj.transforms.perspective(90.0, 1.0, near, far)
    return np.column_stack([points, np.ones(len(points))]) @ matrix.T


def test_edge_is_cut_at_the_near_plane():
    ends, depths = project(seen_by([(0, 0, -2), (0, 1, 2)]), [[0, 1], [1, 0]])
    # Cut at t = 1/4, view (0, 1/4, -1): NDC y = 1/4.
    assert ends.tolist() == [[32, 32, 32, 24], [32, 24, 32, 32]]
    np.testing.assert_allclose(depths, [[0.5, 1.0], [1.0, 0.5]], rtol=1e-12)


def test_edge_behind_or_beside_the_view_is_dropped():
    behind = [(0, 0, 2), (1, 1, 0.5)]
    too_near = [(0, 0, -0.5), (0.2, 0, -0.9)]
    beside = [(-9, 0, -2), (-8, 5, -3)]
    positions = np.concatenate([seen_by(pair) for pair in (behind, too_near, beside)])
    positions = np.concatenate([positions, [[np.nan, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 0]]])
    ends, _ = project(positions, [[0, 1], [2, 3], [4, 5], [6, 7], [8, 8]])
    assert len(ends) == 0


def test_cut_edges_equal_naive():
    rng = np.random.default_rng(1)
    viewport = make_viewport(SIZE, 8)
    planes = oracle.view_planes(viewport.guard_x, viewport.guard_y)
    kept = 0
    for _ in range(400):
        scale = rng.choice([1.0, 1000.0])
        pair = rng.normal(size=(2, 4)) * [scale, scale, 1, 1] + [0, 0, 0, 0.5]
        ends, depths = project(pair, [[0, 1]])
        part = naive.cut_segment(*pair, planes)
        if part is None:
            assert len(ends) == 0
            continue
        if len(ends) == 0:
            # Both ends beyond one side of the view: dropped early, though inside the guard band.
            sides = [[abs(p[0]) > p[3], abs(p[1]) > p[3], abs(p[2]) > p[3]] for p in pair]
            assert np.logical_and(*sides).any()
            continue
        kept += 1
        for n, end in enumerate(part):
            x, y = oracle.screen_position(end, SIZE)
            assert abs(ends[0, 2 * n] + 0.5 - float(x)) <= 0.5 + 1e-6
            assert abs(ends[0, 2 * n + 1] + 0.5 - float(y)) <= 0.5 + 1e-6
            np.testing.assert_allclose(depths[0, n], 1.0 / float(end[3]), rtol=1e-9)
    assert kept > 50


component = st.one_of(st.integers(-4, 4).map(float), st.floats(-1e6, 1e6))


@settings(max_examples=100)
@given(st.lists(component, min_size=8, max_size=8))
def test_ends_never_leave_the_guard_band(numbers):
    ends, depths = project(np.reshape(numbers, (2, 4)), [[0, 1]])
    assert (np.abs(ends - 32) <= 32 + 8192 + 1).all()
    assert not np.isnan(depths).any()


def test_every_edge_is_listed_once(cube):
    edges = cache.find_unique_edges(cube.faces)
    pairs = {tuple(sorted((int(f[k]), int(f[k - 1])))) for f in cube.faces for k in range(3)}
    assert [tuple(edge) for edge in edges.tolist()] == sorted(pairs)
    assert len(edges) == 18


def render_edges(mesh, camera, mode, size=SIZE, color="red"):
    """Return where the wireframe is drawn; the surface is white on white."""
    scene = rj.Scene()
    white = rj.Mesh(mesh.vertices, mesh.faces, material=rj.Material("unlit", "white"))
    scene.add(white)
    scene.wireframe = rj.Wireframe(color, mode)
    frame = rj.render(scene, camera, size=size, threads=1)
    return frame.color[..., 1] == 0


def edge_pixels(mesh, camera, edges, size=SIZE):
    """Return where some edges are drawn with nothing to hide them."""
    clip_from_world = camera.projection_matrix(size) @ camera.view_matrix()
    positions = np.column_stack([mesh.vertices, np.ones(len(mesh.vertices))]) @ clip_from_world.T
    positions, viewport = np.ascontiguousarray(positions), make_viewport(size, 8)
    geometry = Geometry(
        mesh.faces, np.zeros((0, 2), np.int32), codes_of(positions, viewport), np.zeros(0),
        positions, viewport,
    )  # fmt: skip
    color = np.zeros((size[1], size[0], 4), np.uint8)
    wireframe.draw_edges(
        np.array(edges, np.int32), geometry, camera.depth_coefficients(),
        np.full(4, 255, np.uint8), color, None, sharing.Workers(1),
    )  # fmt: skip
    return color[..., 0] == 255


def grow(mask):
    """Return the mask with all eight neighbours of its pixels."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    return np.any(
        [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)], axis=0
    )


ORBIT = [(20, 15), (33, 40), (75, -25), (121, 62), (200, 5), (300, -70), (45, 35.264), (5, 3)]


def orbit(azimuth, elevation, distance=5.0):
    a, e = np.radians([azimuth, elevation])
    eye = distance * np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
    return rj.PerspectiveCamera(eye=tuple(eye), target=(0, 0, 0), near=0.5, far=50.0), eye


@pytest.mark.parametrize("size", [(64, 64), (233, 171)])
@pytest.mark.parametrize("angles", ORBIT)
def test_visible_edges_have_no_gaps_and_hidden_ones_are_hidden(cube, angles, size):
    camera, eye = orbit(*angles)
    corners = cube.vertices[cube.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    toward = eye - corners[:, 0]
    facing = np.einsum("ij,ij->i", normals, toward) / 4 / np.linalg.norm(toward, axis=1)

    def edges_of(faces):
        return {tuple(sorted((int(f[k]), int(f[k - 1])))) for f in faces for k in range(3)}

    visible = edges_of(cube.faces[facing > 0])
    overlay = render_edges(cube, camera, "overlay", size)
    hidden = {tuple(edge) for edge in cache.find_unique_edges(cube.faces).tolist()} - visible
    # A side seen nearly edge-on is thinner than a pixel: its far edge is hidden by the next side.
    for edge in sorted(edges_of(cube.faces[facing > 0.12])):
        run = edge_pixels(cube, camera, [edge], size)
        assert run.any()
        assert not (run & ~overlay).any(), f"edge {edge} has gaps"
    drawn = edge_pixels(cube, camera, sorted(visible), size)
    # What hidden edges show lies beside the corner where they meet the outline.
    extra = overlay & ~drawn
    assert extra.sum() <= 6 * len(hidden)
    assert not (extra & ~grow(grow(drawn))).any()


def test_only_draws_all_edges_and_no_face(cube):
    camera, _ = orbit(20, 15)
    all_edges = cache.find_unique_edges(cube.faces)
    only = render_edges(cube, camera, "only")
    assert only.tolist() == edge_pixels(cube, camera, all_edges).tolist()
    overlay = render_edges(cube, camera, "overlay")
    assert not (overlay & ~only).any()
    assert overlay.sum() < 0.8 * only.sum()


def test_faces_that_nobody_looks_at_are_not_found(cube, camera, monkeypatch):
    scene = rj.Scene()
    scene.add(cube)
    scene.wireframe = rj.Wireframe("red", "only")
    drawn = []
    draw = drawing.draw_tiles
    monkeypatch.setattr(drawing, "draw_tiles", lambda *a: drawn.append(1) or draw(*a))
    alone = rj.render(scene, camera, size=SIZE, threads=1)
    assert not drawn
    assert alone.stats.drawn == 12
    assert alone.stats.pixels_covered == 0
    both = rj.render(scene, camera, size=SIZE, outputs=("color", "face_id"), threads=1)
    assert drawn
    assert both.stats.pixels_covered == (both.face_id >= 0).sum() > 0
    assert both.color.tobytes() == alone.color.tobytes()


@pytest.mark.parametrize("mode", ["only", "overlay"])
def test_edges_are_the_same_for_any_number_of_threads(sphere, camera, monkeypatch, mode):
    monkeypatch.setattr(wireframe, "EDGES_PER_TASK", 7)
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", 1)
    scene = rj.Scene()
    scene.add(sphere)
    scene.wireframe = rj.Wireframe("red", mode)
    one, three = (
        rj.render(scene, camera, size=SIZE, threads=threads).color.tobytes() for threads in (1, 3)
    )
    monkeypatch.undo()
    assert one == three == rj.render(scene, camera, size=SIZE, threads=1).color.tobytes()


def test_edge_inside_a_closed_box_is_hidden(cube):
    camera, _ = orbit(33, 40)
    small = rj.Mesh(0.4 * cube.vertices, cube.faces)
    alone = render_edges(cube, camera, "overlay")
    scene = rj.Scene()
    for mesh in (cube, small):
        scene.add(rj.Mesh(mesh.vertices, mesh.faces, material=rj.Material("unlit", "white")))
    scene.wireframe = rj.Wireframe("red", "overlay")
    both = rj.render(scene, camera, size=SIZE, threads=1).color[..., 1] == 0
    assert both.tolist() == alone.tolist()


def test_wireframe_has_its_colour(cube, camera):
    scene = rj.Scene()
    scene.add(cube)
    scene.wireframe = rj.Wireframe(np.array([10, 20, 30], np.uint8), "only")
    frame = rj.render(scene, camera, size=SIZE, background="white", threads=1)
    assert {tuple(c) for c in frame.color.reshape(-1, 4).tolist()} == {
        (255, 255, 255, 255), (10, 20, 30, 255),
    }  # fmt: skip


def test_camera_inside_sees_edges_cut_at_the_near_plane(cube):
    camera = rj.PerspectiveCamera(eye=(0.9, 0.2, 0.9), target=(-1, 0, -1), near=0.5)
    mask = render_edges(cube, camera, "only")
    assert mask.any()
    assert not mask.all()
