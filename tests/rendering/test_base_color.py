"""Colours and textures are drawn as given; a base colour that is given multiplies them."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import rasterjit as rj

SQUARE = np.array([[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]])
FACES = [[0, 1, 2], [0, 2, 3]]
CAMERA = rj.OrthographicCamera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))
CODES = np.array([128, 37, 250], np.uint8)
GREY = np.float32(0.8)


def square(material=None, colored=None, textured=False):
    """Return a square whose colours, and a texture's texels, are all the same."""
    rows = {None: 0, "vertex": 4, "face": 2}[colored]
    colors = np.tile(CODES, (rows, 1)) if rows else None
    material = rj.Material("unlit") if material is None else material
    if textured:
        material = replace(material, base_color_texture=rj.Texture(np.tile(CODES, (2, 2, 1))))
    return rj.Mesh(SQUARE, FACES, colors=colors, uv=SQUARE[:, :2], material=material)


def draw(mesh, **options):
    scene = rj.Scene()
    scene.add(mesh)
    return rj.render(scene, CAMERA, size=(5, 5), outputs=("color", "linear"), **options)


@pytest.mark.parametrize("colored", ["vertex", "face", None])
def test_colours_and_textures_are_drawn_as_given(colored):
    frame = draw(square(colored=colored, textured=colored is None))
    assert (frame.color[..., :3] == CODES).all()


@pytest.mark.parametrize("shading", ["unlit", "flat", "gouraud", "phong", "pbr"])
@pytest.mark.parametrize(
    ("colored", "textured"),
    [("vertex", False), ("face", False), (None, True), ("vertex", True), ("face", True)],
)
def test_a_base_colour_that_is_not_given_is_white_beside_colours(shading, colored, textured):
    bare, white = rj.Material(shading), rj.Material(shading, "white")
    found, want = (draw(square(one, colored, textured)).linear for one in (bare, white))
    np.testing.assert_array_equal(found, want)


@pytest.mark.parametrize("shading", ["unlit", "flat", "gouraud", "phong", "pbr"])
def test_it_is_a_light_grey_where_there_are_no_colours(shading):
    found = draw(square(rj.Material(shading))).linear
    want = draw(square(rj.Material(shading, (0.8, 0.8, 0.8)))).linear
    np.testing.assert_array_equal(found, want)


@pytest.mark.parametrize("colored", ["vertex", "face"])
def test_a_base_colour_that_is_given_multiplies(colored):
    plain = draw(square(rj.Material("unlit"), colored)).linear
    half = draw(square(rj.Material("unlit", (0.5, 0.25, 1.0)), colored)).linear
    np.testing.assert_array_equal(half[..., :3], plain[..., :3] * np.float32([0.5, 0.25, 1.0]))


def test_one_material_of_two_meshes_has_each_drawn_by_what_it_holds():
    material = rj.Material("unlit")
    scene = rj.Scene()
    for place, colored in ((-1.0, "vertex"), (1.0, None)):
        shift = rj.transforms.translate((place, 0.0, 0.0))
        scene.add(square(material, colored), shift @ np.diag([0.5, 1.0, 1.0, 1.0]))
    frame = rj.render(scene, CAMERA, size=(8, 4), outputs=("color", "linear", "material_id"))
    assert frame.color[2, 0, :3].tolist() == CODES.tolist()
    assert frame.linear[2, 7, :3].tolist() == [GREY] * 3
    assert set(frame.material_id.ravel().tolist()) == {0}


def test_it_stays_not_given_in_copies():
    material = rj.Material("unlit")
    for copied in (replace(material, name="m"), pickle.loads(pickle.dumps(material))):
        assert copied.base_color is None
        assert (draw(square(copied, "face")).color[..., :3] == CODES).all()
    mesh = square(material, "vertex").split_creases()
    assert (draw(mesh).color[..., :3] == CODES).all()


def test_explain_pixel_tells_the_colour_that_is_drawn():
    scene = rj.Scene()
    scene.add(square(rj.Material("unlit"), "vertex"))
    told = rj.explain_pixel(scene, CAMERA, (5, 5), x=2, y=2)
    drawn = rj.render(scene, CAMERA, size=(5, 5), outputs=("linear",)).linear[2, 2, :3]
    assert told.light.base_color.tolist() == drawn.tolist()


def test_alpha_of_colours_is_that_of_the_mesh():
    rgba = np.tile(np.array([*CODES, 51], np.uint8), (4, 1))
    mesh = rj.Mesh(SQUARE, FACES, colors=rgba, material=rj.Material("unlit", alpha_mode="blend"))
    frame = draw(mesh, background="transparent")
    assert frame.color[2, 2, 3] == 51


def test_a_mesh_of_a_file_keeps_the_colours_of_vertices_under_another_shading(tmp_path):
    path = tmp_path / "a.ply"
    rows = "".join(f"{x} {y} {z} 128 37 250\n" for x, y, z in SQUARE)
    kinds = "".join(f"property float {axis}\n" for axis in "xyz")
    kinds += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex 4\n{kinds}element face 2\n"
        f"property list uchar int vertex_indices\nend_header\n{rows}3 0 1 2\n3 0 2 3\n"
    )
    mesh = rj.load(path).nodes[0].mesh
    mesh.material = rj.Material("unlit")
    assert (draw(mesh).color[..., :3] == CODES).all()


def test_a_material_of_an_mtl_file_without_colour_takes_a_texture_as_it_is(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl plain\nNs 10\nnewmtl clear\nd 0.5\n")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl plain\nf 1 2 3\nusemtl clear\nf 1 3 2\n"
    )
    found = {n.mesh.material.name: n.mesh.material for n in rj.load(tmp_path / "a.obj").nodes}
    assert found["plain"].base_color is None
    assert found["clear"].base_color == (GREY, GREY, GREY, 0.5)
