"""Meshes whose sharp edges made normals would round off are told from those of smooth surfaces."""

from __future__ import annotations

import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.io.meshes import from_trimesh
from rasterjit.scene import normals
from rasterjit.scene.normals import is_creased, safe_scale

creation = trimesh.creation
CAMERA = rj.PerspectiveCamera((3.0, 4.0, 5.0), (0.0, 0.0, 0.0))
SAYS = "sharp edges are rounded off"


def mesh_of(shape, **options):
    return rj.Mesh(shape.vertices, shape.faces, **options)


def draw(mesh, outputs=("color",)):
    scene = rj.Scene()
    scene.add(mesh)
    return rj.render(scene, CAMERA, size=(24, 16), outputs=outputs, threads=1)


def creased(vertices, faces):
    vertices, faces = np.array(vertices, np.float64), np.array(faces, np.int32)
    return is_creased(vertices, faces, safe_scale(vertices.min(axis=0), vertices.max(axis=0)))


def noisy_ball(subdivisions, share):
    """Return a ball whose vertices are moved to and from its middle by a share of their length."""
    shape = creation.icosphere(subdivisions)
    chance = np.random.default_rng(3)
    factors = 1.0 + share * chance.standard_normal((len(shape.vertices), 1))
    return trimesh.Trimesh(shape.vertices * factors, shape.faces, process=False)


def field(heights):
    """Return a square of unit side as a height field."""
    n = len(heights)
    steps = np.linspace(0.0, 1.0, n)
    x, y = np.meshgrid(steps, steps)
    i = np.arange(n * n).reshape(n, n)
    corners = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    faces = [np.stack([corners[k] for k in some], axis=-1) for some in ((0, 1, 2), (0, 2, 3))]
    vertices = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(vertices, np.concatenate(faces).reshape(-1, 3), process=False)


WITH_CREASES = {
    "box": creation.box,
    "long box": lambda: creation.box((1.0, 20.0, 0.01)),
    "box of 768 faces": lambda: creation.box().subdivide().subdivide().subdivide(),
    "cylinder": lambda: creation.cylinder(1.0, 2.0),
    "cylinder of 8 sides": lambda: creation.cylinder(1.0, 2.0, sections=8),
    "cone": lambda: creation.cone(1.0, 2.0),
    "ring": lambda: creation.annulus(1.0, 2.0, 1.0),
    "axes": creation.axis,
    "tetrahedron": lambda: trimesh.Trimesh(
        [[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]],
        [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
    ),
    "5000 boxes": lambda: trimesh.util.concatenate(
        [creation.box().apply_translation((2 * (n % 70), 2 * (n // 70), 0)) for n in range(5000)]
    ),
    "30 boxes of 768 faces": lambda: trimesh.util.concatenate(
        [creation.box().subdivide().subdivide().subdivide() for _ in range(30)]
    ),
}

CHANCE = np.random.default_rng(5)

WITHOUT = {
    "capsule": creation.capsule,
    "ball": creation.uv_sphere,
    "ball of 96 faces": lambda: creation.uv_sphere(count=[6, 6]),
    "ball of 20 faces": lambda: creation.icosphere(subdivisions=0),
    "ball of 80 faces": lambda: creation.icosphere(subdivisions=1),
    "ball of 81920 faces": lambda: creation.icosphere(subdivisions=6),
    "torus": lambda: creation.torus(2.0, 0.5),
    "torus of 96 faces": lambda: creation.torus(2.0, 0.5, major_sections=8, minor_sections=6),
    **{f"noise of {n}": partial(noisy_ball, 4, n) for n in (0.003, 0.02, 0.1)},
    "much noise": partial(noisy_ball, 6, 0.1),
    **{
        f"ground of {n}": partial(field, n * CHANCE.standard_normal((50, 50)))
        for n in (0.01, 0.05, 0.2)
    },
    "hull": partial(trimesh.convex.convex_hull, CHANCE.standard_normal((300, 3))),
    "hull of a ball": lambda: trimesh.convex.convex_hull(noisy_ball(2, 0.0).vertices),
    "chance": partial(
        trimesh.Trimesh, CHANCE.random((60, 3)), CHANCE.integers(0, 60, (300, 3)), process=False
    ),
    "one fold": lambda: trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 3, 1]], process=False
    ),
    "one face": lambda: trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False
    ),
}


@pytest.mark.parametrize("name", WITH_CREASES)
def test_what_has_flat_sides_is_creased(name):
    shape = WITH_CREASES[name]()
    assert creased(shape.vertices, shape.faces)


@pytest.mark.parametrize("name", WITHOUT)
def test_smooth_and_noisy_surfaces_are_not(name):
    shape = WITHOUT[name]()
    assert not creased(shape.vertices, shape.faces)


@pytest.mark.parametrize("name", ["ball of 81920 faces", "much noise", "capsule"])
def test_a_few_faces_tell_that_a_surface_is_smooth(name, monkeypatch):
    # It is asked for each new mesh, and so for each frame where a shape morphs.
    shape, looked_at = WITHOUT[name](), []
    measure = normals.compute_area_vectors

    def count(vertices, faces, scale):
        looked_at.append(len(faces))
        return measure(vertices, faces, scale)

    monkeypatch.setattr(normals, "compute_area_vectors", count)
    assert not creased(shape.vertices, shape.faces)
    assert 100 < sum(looked_at) < 1024 < len(shape.faces)


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_size_place_and_order_decide_nothing(scale):
    box, torus = creation.box(), WITHOUT["torus"]()
    chance = np.random.default_rng(1)
    faces = np.array([np.roll(face, n) for n, face in enumerate(chance.permutation(box.faces))])
    assert creased(box.vertices * scale, faces)
    assert creased(box.vertices * scale, faces[:, ::-1])
    assert not creased(torus.vertices * scale, torus.faces)


def test_faces_without_an_area_and_vertices_that_are_not_finite_have_no_say():
    box = creation.box()
    vertices = np.concatenate([box.vertices, [[np.nan, 0.0, 0.0]]])
    faces = np.concatenate([box.faces, [[0, 0, 1], [8, 0, 1], [2, 2, 2]]])
    mesh = rj.Mesh(vertices, faces, on_invalid="drop")
    with pytest.warns(UserWarning, match=SAYS):
        mesh.vertex_normals()


@pytest.mark.parametrize("shading", ["phong", "gouraud", "pbr"])
def test_drawing_a_box_smooth_warns_once_at_the_line_that_draws(shading):
    mesh = mesh_of(creation.box(), material=rj.Material(shading))
    with pytest.warns(UserWarning, match=SAYS) as said:
        draw(mesh)
    (warning,) = said
    assert Path(warning.filename) == Path(__file__)
    for advice in ("split_creases()", "'flat'", "give it normals"):
        assert advice in str(warning.message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw(mesh)
        draw(mesh, ("normal",))


def test_a_warning_that_is_an_error_is_raised_once():
    mesh = mesh_of(creation.box())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserWarning, match=SAYS):
            draw(mesh)
        assert draw(mesh).color.any()


@pytest.mark.parametrize(
    "make",
    [
        lambda box: mesh_of(box, material=rj.Material("flat")),
        lambda box: mesh_of(box, material=rj.Material("unlit")),
        lambda box: mesh_of(box).split_creases(),
        lambda box: mesh_of(box, normals=box.vertex_normals),
        lambda box: rj.Mesh(box.triangles.reshape(-1, 3), np.arange(36).reshape(12, 3)),
        lambda box: from_trimesh(box).nodes[0].mesh,
        lambda _: mesh_of(creation.icosphere()),
    ],
)
def test_what_the_warning_advises_and_smooth_meshes_are_drawn_without_a_word(make):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw(make(creation.box()))
