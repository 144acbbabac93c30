"""A sample has the same bits whether it is gathered in a long run or among other faces."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit import stages
from rasterjit.kernels import patches, shading, vectors

SIZE = (200, 12)
WIDTHS = [1, 2, 3, 1, 40, 1, 1, 16, 5, 17, 1, 64, 2, 31, 7, 8, 1]
"""Columns of neighbouring strips: 201, about one pixel each."""


def strips(model, texture=None, **options):
    """Return a wall of strips, two faces each, whose vertices differ in depth."""
    rng = np.random.default_rng(5)
    x = np.concatenate([[0.0], np.cumsum(WIDTHS)]) / sum(WIDTHS) * 2 - 1
    flat = np.column_stack([np.repeat(x, 2), np.tile([1.0, -1.0], len(x))])
    vertices = np.column_stack([flat * [5.6, 0.3], rng.uniform(-0.5, 0.5, len(flat))])
    first = 2 * np.arange(len(WIDTHS))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [2, 1, 3]])
    return rj.Mesh(
        vertices, rng.permutation(faces), uv=rng.uniform(-1, 2, (len(flat), 2)),
        material=rj.Material(model, "white", specular=0.4, base_color_texture=texture), **options,
    )  # fmt: skip


def shaded(scene, camera, monkeypatch):
    """Render; return what ``shade_rows`` was given."""
    calls = []

    def note(*given):
        calls.append(given)
        kernel(*given)

    kernel = shading.shade_rows
    monkeypatch.setattr(stages.shading, "shade_rows", note)
    rj.render(scene, camera, size=SIZE, outputs=("linear", "color"), threads=1)
    monkeypatch.setattr(stages.shading, "shade_rows", kernel)
    return calls


def scene_of(mesh):
    scene = rj.Scene()
    scene.add(mesh)
    scene.lights = [
        rj.AmbientLight("white", 0.15),
        rj.DirectionalLight((-1, -2, -1.5), intensity=0.6),
        rj.PointLight((2.0, 1.0, 3.0), color=(0.4, 0.5, 1.0), intensity=4.0),
    ]
    return scene


def assert_neighbours_do_not_matter(calls):
    """Shade once more, with some columns left out: what is left keeps its bits."""
    for call in calls:
        face_id, linear, color = call[0], call[8], call[9]
        columns = np.arange(face_id.shape[1])
        for period, kept in ((2, 1), (3, 2), (7, 5), (50, 33)):
            for shift in (0, 1):
                shown = (columns + shift) % period < kept
                some = np.where(shown, face_id, np.int32(-1))
                again = np.empty_like(linear), np.empty_like(color)
                shading.shade_rows(some, *call[1:8], *again, call[10])
                assert again[0][:, shown].tobytes() == linear[:, shown].tobytes()
                assert again[1][:, shown].tobytes() == color[:, shown].tobytes()


@pytest.mark.parametrize("model", ["unlit", "flat", "gouraud", "phong"])
@pytest.mark.parametrize("near", [0.1, 3.9])
def test_neighbours_change_no_bit_of_a_sample(model, near, monkeypatch):
    rng = np.random.default_rng(6)
    mesh = strips(model, colors=rng.uniform(0, 1, (2 * len(WIDTHS) + 2, 3)))
    camera = rj.PerspectiveCamera(eye=(0.4, 0.1, 4.0), target=(0, 0, 0), fov_y=10.0, near=near)
    calls = shaded(scene_of(mesh), camera, monkeypatch)
    face_id = np.concatenate([call[0] for call in calls])
    assert (face_id >= 0).any()
    changes = (np.diff(face_id) != 0).sum(axis=1)
    assert near > 1 or changes.max() >= 10
    assert_neighbours_do_not_matter(calls)


@pytest.mark.parametrize("model", ["gouraud", "phong"])
def test_neighbours_change_no_bit_of_a_textured_sample(model, monkeypatch):
    texture = rj.Texture(np.random.default_rng(7).uniform(0, 1, (16, 16, 3)))
    camera = rj.PerspectiveCamera(eye=(0.4, 0.1, 4.0), target=(0, 0, 0), fov_y=10.0, near=3.9)
    calls = shaded(scene_of(strips(model, texture)), camera, monkeypatch)
    assert any((call[0] >= 0).any() for call in calls)
    assert_neighbours_do_not_matter(calls)


def test_neighbours_change_no_bit_of_a_face_colour(monkeypatch):
    colors = np.random.default_rng(8).uniform(0, 1, (2 * len(WIDTHS), 3))
    camera = rj.PerspectiveCamera(eye=(0.4, 0.1, 4.0), target=(0, 0, 0), fov_y=10.0)
    calls = shaded(scene_of(strips("phong", colors=colors)), camera, monkeypatch)
    assert_neighbours_do_not_matter(calls)


def rows_of(scratch):
    """Return those parts of ``shading.scratch_memory`` that have a column for every sample."""
    samples, weights, places, lookup, _, _, gathered = scratch
    own = (samples, weights, *gathered)
    return list(own) if places is None else [*own, places, *lookup]


@pytest.mark.parametrize("has_textures", [False, True])
def test_rows_have_room_for_what_is_written_behind_the_last_sample(has_textures):
    parts = rows_of(shading.scratch_memory(has_textures=has_textures))
    assert len(parts) == 5 + 4 * has_textures
    for part in parts:
        # A stretch in whole vectors may begin with the last sample, and so may a patch.
        assert part.shape[-1] >= shading.BLOCK_COLUMNS + patches.VECTOR - 1
        assert part.shape[-1] >= shading.BLOCK_COLUMNS - 1 + vectors.LANES


@pytest.mark.parametrize("split", [shading.BLOCK_COLUMNS - 1, 120, 113, 1])
def test_nothing_is_written_beyond_the_rows(split, monkeypatch):
    texture = rj.Texture(np.random.default_rng(9).uniform(0, 1, (4, 4, 3)))
    scene = scene_of(strips("phong", texture))
    scene.add(strips("phong", texture))
    camera = rj.PerspectiveCamera(eye=(0.4, 0.1, 4.0), target=(0, 0, 0), fov_y=10.0)
    call = shaded(scene, camera, monkeypatch)[0]
    # No two neighbours show one face, and from ``split`` on they show the other object.
    face_id = np.arange(shading.BLOCK_COLUMNS, dtype=np.int32)[np.newaxis] % 5
    face_id[0, split:] += 2 * len(WIDTHS)
    scratch = shading.scratch_memory(has_textures=True)
    spare, mark = 64, 77
    roomy = [np.full((*p.shape[:-1], p.shape[-1] + spare), mark, p.dtype) for p in rows_of(scratch)]
    samples, weights, whole, doubles, singles, places, *lookup = roomy
    given = samples, weights, places, tuple(lookup), *scratch[4:6], (whole, doubles, singles)
    linear = np.empty((1, face_id.shape[1], 4), np.float32)
    color = np.empty(face_id.shape, np.uint32)
    shading.shade_rows(face_id, *call[1:8], linear, color, given)
    assert np.isfinite(linear).all()
    for part in roomy:
        assert (part[..., -spare:] == mark).all()
    count = shading.BLOCK_COLUMNS - split
    end = split + -(-count // patches.VECTOR) * patches.VECTOR
    assert (weights[:, end - 1] != mark).all()
    assert (weights[:, end:] == mark).all()
