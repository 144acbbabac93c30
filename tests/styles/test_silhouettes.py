"""Silhouettes cover the texels where a picture shows a face, whatever the mesh."""

from collections import Counter

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.scene.camera import MatrixCamera
from rasterjit.styles import shadow_catcher, silhouettes

KEY = (-0.5, 0.7, 0.5)


def soup(seed, faces=200, **material):
    """Faces between any of some points: borders, folds, edges of many faces, points that repeat."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(60, 3)) * rng.uniform(0.1, 3.0, 3)
    chosen = rng.integers(0, len(points), (faces, 3))
    made = rj.Material(double_sided=bool(seed % 2), **material)
    return rj.Mesh(points, chosen, material=made, on_invalid="drop")


def ball():
    made = trimesh.creation.icosphere(2)
    return rj.Mesh(made.vertices, made.faces)


def grid():
    """Squares whose corners lie on centres of texels, and so do many of their edges."""
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0))
    points = np.stack([x.ravel(), np.abs(x - y).ravel() % 3.0, y.ravel()], axis=1)
    first = (np.arange(8)[:, None] * 9 + np.arange(8)).reshape(-1, 1)
    return rj.Mesh(points, np.concatenate([first + [0, 1, 9], first + [1, 10, 9]]))


def cameras(scene):
    placed = shadow_catcher.find_ground(scene, KEY)
    slopes = [
        *shadow_catcher.list_sky_slopes(6),
        *shadow_catcher.list_key_slopes(placed.slope, 4),
        (0.0, 0.0),
    ]
    return shadow_catcher._place_maps(placed, slopes)


def drawn(scene, view, clips):
    """The slow twin: how many pictures show a face."""
    with rj.Renderer((shadow_catcher.MAP_SIDE, shadow_catcher.MAP_SIDE), threads=1) as renderer:
        return sum(
            (renderer.render(scene, MatrixCamera(view, clip), outputs=("face_id",)).face_id >= 0)
            for clip in clips
        ).astype(np.int32)


def scenes():
    for seed in range(4):
        yield f"soup {seed}", [soup(seed)]
    yield "grid", [grid()]
    yield "two", [soup(1, 20), soup(2, 20)]
    yield "section", [ball()]
    yield "cut out", [soup(3, 50, alpha_mode="mask", base_color=(1.0, 1.0, 1.0, 0.6))]
    stray = np.vstack([soup(5).vertices, [(np.nan, 0.0, 0.0), (np.inf, 1.0, 1e300)]])
    yield "stray", [rj.Mesh(stray, soup(5).faces, on_invalid="drop")]


@pytest.mark.parametrize(("name", "meshes"), [*scenes()])
def test_texels_are_counted_that_pictures_show(name, meshes):
    scene = rj.Scene()
    if name == "section":
        scene.section = rj.SectionPlane((0.0, 0.1, 0.0), (0.3, 1.0, 0.2))
    for n, mesh in enumerate(meshes):
        # The second is mirrored.
        scene.add(mesh, np.diag([(-1.0) ** n, 1.0, 1.0, 1.0]))
    one = cameras(scene)
    for threads in (1, 2):
        (found,) = shadow_catcher._count_blocked(scene, [one], threads)
        assert np.array_equal(found, drawn(scene, *one))
    assert found.any()


def test_a_face_beyond_the_guard_band_is_drawn():
    scene = rj.Scene()
    scene.add(rj.Mesh([[-1e6, 0.5, -1e6], [0.0, 0.5, 2e6], [1e6, 0.5, -1e6]], [[0, 1, 2]]))
    small = rj.Scene()
    small.add(rj.Mesh([[0, 0, 0], [1, 1, 0], [0, 0, 1]], [[0, 1, 2]]))
    view, clips = cameras(small)
    (found,) = shadow_catcher._count_blocked(scene, [(view, clips)], 1)
    assert np.array_equal(found, drawn(scene, view, clips))
    assert found.any()


@pytest.mark.parametrize("faces", [0, 1, 40, 3000])
def test_edges_are_those_of_all_faces(faces):
    """Each face gives its edges back, of as many as a vertex has."""
    rng = np.random.default_rng(faces)
    chosen = rng.integers(0, 50, (faces, 3)).astype(np.int32)
    edges = np.empty((3 * faces, silhouettes.EDGE_COLUMNS), np.int32)
    newest, older = np.empty(50, np.int32), np.empty(3 * faces, np.int32)
    count = silhouettes.pair_edges(chosen, newest, older, edges)
    found = Counter()
    for first, last, left, right in edges[:count].tolist():
        found[left, first, last] += 1
        if right != faces:
            found[(right, last, first) if right >= 0 else (~right, first, last)] += 1
    wanted = Counter(
        (n, face[k], face[(k + 1) % 3])
        for n, face in enumerate(chosen.tolist())
        for k in range(3)
        if face[k] != face[(k + 1) % 3]
    )
    assert found == wanted


def test_faces_of_a_closed_surface_share_all_edges():
    faces = trimesh.creation.icosphere(3).faces.astype(np.int32)
    edges = np.empty((faces.size, silhouettes.EDGE_COLUMNS), np.int32)
    newest, older = np.empty(faces.max() + 1, np.int32), np.empty(faces.size, np.int32)
    assert silhouettes.pair_edges(faces, newest, older, edges) == faces.size // 2
