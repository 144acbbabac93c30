"""Vertices go to the screen in float32 or float64: against NumPy's own products."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.geometry.setup import INVALID
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads
from rasterjit.scene import transforms
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.survey import cache, object_transforms

SINGLE = rj.Quality(precision="float32")
SIZE = (96, 64)
UNIT = 2.0**-24
"""Largest relative error of one float32 operation."""


def camera(**options):
    return PerspectiveCamera((3.0, 2.5, 5.0), (0.2, 0.1, 0.0), near=0.5, far=40.0, **options)


def cloud(rng, count=5000):
    """Return a mesh of loose triangles around the origin."""
    points = rng.normal(size=(count, 1, 3)) + rng.normal(size=(count, 3, 3)) * 0.05
    return rj.Mesh(points.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def scene_of(*meshes, **fields):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh, transforms.rotate_y(20.0 * len(scene.nodes)))
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


def on_screen(scene, precision, size=SIZE):
    """Return the screen vertices, the matrices and the positions that they were found from."""
    known = cache.update_cache(scene.nodes, None, rj.Quality())
    views = object_transforms.transform_to_view(known.transforms, camera(), size)
    arrays, positions = known.shapes.arrays, known.shapes.positions(precision)
    vertices = visibility_pass.ModelVertices(
        positions, arrays.vertex_starts, views.relative_from_model, views.clip_from_relative
    )
    workers = threads.Workers(1)
    screen, _ = visibility_pass.transform_and_project(
        vertices, camera().depth_coefficients(), make_viewport(size, 8), workers
    )
    return screen, vertices, visibility_pass.transform_to_clip(*vertices[:4], workers)


def numpy_clip(vertices):
    """Return clip positions by NumPy's own float32 products, and what they may be off by."""
    clip = np.empty((len(vertices.positions), 4), np.float32)
    bound = np.empty((len(vertices.positions), 4))
    to_clip = vertices.clip_from_relative.astype(np.float32)
    for owner, (first, last) in enumerate(
        zip(vertices.vertex_starts[:-1], vertices.vertex_starts[1:], strict=True)
    ):
        matrix = vertices.relative_from_model[owner].astype(np.float32)
        points = np.ones((last - first, 4), np.float32)
        points[:, :3] = vertices.positions[first:last].astype(np.float32)
        relative = np.matmul(points, matrix.T)
        clip[first:last] = np.matmul(relative, to_clip.T)
        # Two products of four terms: eight roundings of each, in whatever order, and their sums.
        size = np.abs(points).astype(float) @ np.abs(matrix.T).astype(float)
        bound[first:last] = 16 * UNIT * (size @ np.abs(to_clip.T).astype(float))
    return clip, bound


def test_float32_transforms_are_numpys_float32_products_but_for_rounding():
    rng = np.random.default_rng(3)
    _, vertices, clip = on_screen(scene_of(cloud(rng), cloud(rng)), "float32")
    want, bound = numpy_clip(vertices)
    assert vertices.positions.dtype == np.float32
    assert (np.abs(clip - want) <= bound).all()
    # What is held as float64 are float32 numbers.
    assert (clip == clip.astype(np.float32)).all()
    exact = on_screen(scene_of(cloud(np.random.default_rng(3))), "float64")[2]
    off = np.abs(clip[: len(exact)] - exact)
    assert (off <= bound[: len(exact)]).all()
    assert (off > 0.0).mean() > 0.9


def test_a_vertex_lands_where_its_float32_clip_position_does():
    """Divided, mapped and rounded once: within a unit of the grid of the exact place."""
    rng = np.random.default_rng(4)
    screen, vertices, clip = on_screen(scene_of(cloud(rng)), "float32")
    count = len(vertices.positions)
    assert not (screen.codes[:count] & INVALID).any()
    seen = screen.codes[:count] == 0
    assert seen.mean() > 0.5
    ndc = clip[seen, :2] / clip[seen, 3:]
    places = (ndc * [1.0, -1.0] + 1.0) * np.array(SIZE) * 128.0
    assert np.abs(screen.xy[:count][seen] - places).max() <= 0.5 + 0.02
    assert (screen.w[:count][seen] == clip[seen, 3]).all()
    depth = camera().near / clip[seen, 3]
    assert screen.depth[:count][seen] == pytest.approx(depth, rel=2 * UNIT)


def test_pictures_in_float32_differ_at_edges_alone():
    scene = scene_of(cloud(np.random.default_rng(5), 400))
    frames = [
        rj.render(scene, camera(), size=SIZE, outputs=("face_id", "depth"), quality=one, threads=1)
        for one in (rj.Quality(), SINGLE)
    ]
    same = frames[0].face_id == frames[1].face_id
    assert same.mean() > 0.99
    seen = same & (frames[0].face_id >= 0)
    assert frames[1].depth[seen] == pytest.approx(frames[0].depth[seen], rel=1e-4)
    assert (frames[0].depth != frames[1].depth)[seen].any()


def test_float32_loses_what_lies_far_from_the_origin_of_its_mesh():
    """A cube around (2**24, 0, 0) in model space, moved back: its float32 vertices are too few."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.75
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    far = np.array([2.0**24, 0.0, 0.0])
    shown = []
    for shift, quality in ((0.0, rj.Quality()), (far, rj.Quality()), (far, SINGLE)):
        scene = rj.Scene()
        scene.add(rj.Mesh(corners + shift, faces), transforms.translate(np.zeros(3) - shift))
        shown.append(
            rj.render(
                scene, camera(), size=SIZE, outputs=("face_id",), quality=quality, threads=1
            ).face_id
        )
    assert (shown[0] == shown[1]).all()
    assert ((shown[0] >= 0) != (shown[2] >= 0)).mean() > 0.01


def test_float32_near_the_origin_of_a_mesh_is_good_wherever_the_mesh_stands():
    """The way to the eye is found in float64: only what is left is float32."""
    mesh, shown = cloud(np.random.default_rng(6), 300), []
    for place in ((0.0, 0.0, 0.0), (1e7, -1e7, 1e7)):
        eye = np.array([3.0, 2.5, 5.0]) + place
        view = PerspectiveCamera(eye, np.array(place), near=0.5, far=40.0)
        scene = rj.Scene()
        scene.add(mesh, transforms.translate(place))
        shown.append(
            rj.render(
                scene, view, size=SIZE, outputs=("face_id",), quality=SINGLE, threads=1
            ).face_id
        )
    assert (shown[0] == shown[1]).mean() > 0.995


@pytest.mark.parametrize("wild", [1e30, 1e60, 1e200, -1e300, np.nan])
def test_what_float32_can_not_hold_is_left_out(wild):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0], [-1, 1, 0], [1, 1, 0], [0, wild, 0]])
    mesh = rj.Mesh(corners, [[0, 1, 2], [3, 4, 5]], on_invalid="drop")
    frame = rj.render(
        mesh, camera(), size=SIZE, outputs=("face_id", "depth"), quality=SINGLE, diagnose=True,
        threads=1,
    )  # fmt: skip
    assert frame.stats.invalid == 1
    assert set(np.unique(frame.face_id)) == {-1, 0}
    assert frame.diagnostics.invalid_vertices >= 1


def test_faces_that_cross_the_near_plane_are_cut_as_in_float64():
    ground = rj.Mesh([[-40, 0, -40], [40, 0, -40], [40, 0, 40], [-40, 0, 40]],
                     [[0, 2, 1], [0, 3, 2]])  # fmt: skip
    frames = [
        rj.render(
            scene_of(ground, wireframe=rj.Wireframe("black")), camera(), size=SIZE,
            outputs=("face_id", "position", "color"), quality=one, threads=1,
        )
        for one in (rj.Quality(), SINGLE)
    ]  # fmt: skip
    assert frames[1].stats.clipped == 2
    same = frames[0].face_id == frames[1].face_id
    assert same.mean() > 0.995
    seen = same & (frames[0].face_id >= 0)
    error = np.abs(frames[0].position - frames[1].position)[seen].max(axis=-1)
    assert np.quantile(error, 0.99) < 1e-3
    assert (frames[0].color != frames[1].color).any(axis=-1).mean() < 0.02


def test_float32_positions_are_made_once_and_take_half_the_memory():
    scene = scene_of(cloud(np.random.default_rng(7), 50))
    with rj.Renderer(SIZE, quality=SINGLE, threads=1) as renderer:
        known = []
        for _ in range(2):
            renderer.render(scene, camera(), outputs=("face_id",))
            known.append(renderer._scene_cache.shapes.positions("float32"))
    assert known[0] is known[1]
    whole = renderer._scene_cache.shapes.positions("float64")
    assert known[0].dtype == np.float32
    assert 2 * known[0].nbytes == whole.nbytes
    with rj.Renderer(SIZE, threads=1) as renderer:
        renderer.render(scene, camera(), outputs=("face_id",))
        assert "_single_positions" not in vars(renderer._scene_cache.shapes)


def test_rasterize_computes_in_the_precision_it_is_given():
    rng = np.random.default_rng(8)
    positions = rng.normal(size=(600, 4)) * [1, 1, 0.3, 0] + [0, 0, 0, 1.0 / 3.0]
    faces = np.arange(600).reshape(-1, 3)
    seen = [
        rj.rasterize(positions, faces, SIZE, quality=one, threads=1)
        for one in (rj.Quality(), SINGLE)
    ]
    assert (seen[0].face_id == seen[1].face_id).mean() > 0.98
    assert (seen[0].depth != seen[1].depth).any()
    both = (seen[0].face_id == seen[1].face_id) & (seen[0].face_id >= 0)
    assert seen[1].depth[both] == pytest.approx(seen[0].depth[both], abs=2e-3)


def test_the_plan_names_float32():
    scene = scene_of(cloud(np.random.default_rng(9), 2))
    assert "precision                float32" in str(rj.explain(scene, camera(), SINGLE))
    assert "precision" not in str(rj.explain(scene, camera()))
