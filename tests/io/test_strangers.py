"""Mesh files reach no further than their folder."""

from __future__ import annotations

import base64
import json
import os
import re
import socket
import subprocess
import threading
import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.io.load_warnings import LoadWarning, MeshFileError

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
UV = np.array([[0, 0], [1, 0], [0, 1]], "<f4")
SECRET = (10, 200, 30)


def picture(path, color=SECRET):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (4, 4), color).save(path, "PNG")
    return path


def obj(folder, name, library="model.mtl"):
    """Write an OBJ file whose material names a picture."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
    file = folder / "model.obj"
    file.write_text(
        f"mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\n"
        "f 1/1 2/2 3/3\n"
    )
    return file


def gltf(folder, uri, buffer=None):
    """Write a glTF file with a picture, or with its buffer, elsewhere."""
    folder.mkdir(parents=True, exist_ok=True)
    content = TRIANGLE.tobytes() + UV.tobytes()
    data = "data:application/octet-stream;base64," + base64.b64encode(content).decode()
    header = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}
        ]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}], "images": [{"uri": uri}],
        "buffers": [{"uri": buffer or data, "byteLength": len(content)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
             "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
    }  # fmt: skip
    file = folder / "model.gltf"
    file.write_text(json.dumps(header))
    return file


def texture_of(scene):
    return scene.nodes[0].mesh.material.base_color_texture


def loaded(file, **options):
    """Return the texture of a file, and what was warned of."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene = rj.load(file, **options)
    return texture_of(scene), " ".join(str(one.message) for one in said)


WRITERS = {"obj": obj, "gltf": gltf}


@pytest.fixture(params=WRITERS)
def write(request):
    return WRITERS[request.param]


def test_a_picture_in_a_folder_below_is_read(tmp_path, write):
    picture(tmp_path / "model" / "textures" / "wood.png")
    texture, said = loaded(write(tmp_path / "model", "textures/wood.png"))
    assert texture is not None
    assert said == ""


OUTSIDE = {
    "above": "../secret.png",
    "above by a detour": "textures/../../secret.png",
    "windows": "..\\secret.png",
    "file": "file:{outside}/secret.png",
    "file with slashes": "file://{outside}/secret.png",
    "absolute": "{outside}/secret.png",
    "drive": "C:/secret.png",
}


@pytest.mark.parametrize("name", OUTSIDE.values(), ids=OUTSIDE)
def test_a_picture_outside_is_not_opened_and_named(tmp_path, write, name):
    picture(tmp_path / "secret.png")
    (tmp_path / "model" / "textures").mkdir(parents=True)
    name = name.format(outside=tmp_path.as_posix())
    texture, said = loaded(write(tmp_path / "model", name))
    assert texture is None
    assert "secret.png" in said
    assert "outside" in said or "is not a file beside" in said


@pytest.mark.parametrize("dots", ["%2e%2e/secret.png", "%2E%2E%2Fsecret.png", ".%2e/secret.png"])
def test_encoded_dots_lead_nowhere(tmp_path, dots):
    picture(tmp_path / "secret.png")
    texture, said = loaded(gltf(tmp_path / "model", dots))
    assert texture is None
    assert "secret.png" in said


def test_a_link_out_of_the_folder_is_not_followed(tmp_path, write):
    secret = picture(tmp_path / "secret.png")
    inside = picture(tmp_path / "model" / "textures" / "wood.png")
    os.symlink(secret, inside.parent / "out.png")
    os.symlink(inside, inside.parent / "in.png")
    texture, said = loaded(write(tmp_path / "model", "textures/out.png"))
    assert texture is None
    assert "outside" in said
    texture, said = loaded(write(tmp_path / "model", "textures/in.png"))
    assert texture is not None
    assert said == ""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "socket"])
def test_what_is_no_regular_file_is_not_opened(tmp_path, write, kind):
    folder = tmp_path / "model"
    folder.mkdir()
    place = folder / "wood.png"
    if kind == "pipe":
        os.mkfifo(place)
    elif kind == "folder":
        place.mkdir()
    elif kind == "socket":
        here = os.getcwd()
        os.chdir(folder)  # Names of sockets are short.
        with socket.socket(socket.AF_UNIX) as opened:
            opened.bind("wood.png")
        os.chdir(here)
    file = write(folder, "wood.png" if kind != "device" else "/dev/zero")
    found = []
    thread = threading.Thread(target=lambda: found.append(loaded(file)), daemon=True)
    thread.start()
    thread.join(20.0)
    assert found, "it waits for the file"
    texture, said = found[0]
    assert texture is None
    assert "regular file" in said or "is not a file beside" in said


def test_an_address_is_not_asked(tmp_path, write, monkeypatch):
    def refuse(*arguments):
        raise AssertionError("the network is asked")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    for name in ("http://localhost/wood.png", "https://localhost/wood.png", "ftp:wood.png"):
        texture, said = loaded(write(tmp_path / "model", name))
        assert texture is None
        assert "wood.png" in said


def test_the_end_of_a_long_name_is_shown(tmp_path, write):
    texture, said = loaded(write(tmp_path / "model", f"../{'deep/' * 60}secret.png"))
    assert texture is None
    assert "secret.png" in said
    assert len(said) < 600


def test_a_root_that_is_named_widens_what_may_be_read(tmp_path, write):
    picture(tmp_path / "shared" / "wood.png")
    picture(tmp_path.parent / f"{tmp_path.name}-secret.png")
    file = write(tmp_path / "model", "../shared/wood.png")
    assert loaded(file)[0] is None
    texture, said = loaded(file, resource_root=tmp_path)
    assert texture is not None
    assert said == ""
    beyond = write(tmp_path / "model", f"../../{tmp_path.name}-secret.png")
    assert loaded(beyond, resource_root=tmp_path)[0] is None


def test_the_command_line_takes_a_root(tmp_path):
    picture(tmp_path / "shared" / "wood.png")
    file = obj(tmp_path / "model", "../shared/wood.png")
    command = ["render", str(file), "-o", str(tmp_path / "a.png"), "--size", "9x9"]
    said = CliRunner().invoke(commands.program, command).output
    assert "wood.png" in said
    given = CliRunner().invoke(commands.program, [*command, "--resource-root", str(tmp_path)])
    assert given.exit_code == 0
    assert "wood.png" not in given.output
    wrong = CliRunner().invoke(commands.program, [*command, "--resource-root", str(file)])
    assert wrong.exit_code == 1
    assert "--resource-root must be a folder" in wrong.output


def textured(file, **options):
    """Tell whether the first mesh of a file has its picture; warnings are errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return rj.load(file, **options).nodes[0].mesh.material.base_color_texture is not None


@pytest.mark.parametrize("mark", ["package.xml", "model.config"])
@pytest.mark.parametrize(
    "name",
    [
        "package://arm/materials/textures/wood.png", "model://arm/materials/textures/wood.png",
        "package://its_name/materials/textures/wood.png", "../materials/textures/wood.png",
        "..\\materials\\textures\\wood.png", "wood.png",
    ],
)  # fmt: skip
def test_pictures_of_a_robots_package_are_found(tmp_path, mark, name):
    model = tmp_path / "arm"
    picture(model / "materials" / "textures" / "wood.png")
    file = obj(model / "meshes" / "visual", name.replace("..", "../.."))
    (model / mark).write_text("<package>\n<name> its_name </name></package>")
    assert textured(file)


@pytest.mark.parametrize(
    "name",
    [
        "package://other/wood.png", "model://other/wood.png", "package://arm/../other/wood.png",
        "../../other/wood.png", "package://../other/wood.png", "package://arm/link.png",
    ],
)  # fmt: skip
def test_nothing_outside_a_robots_package_is_opened(tmp_path, name):
    picture(tmp_path / "other" / "wood.png")
    file = obj(tmp_path / "arm" / "meshes", name)
    (tmp_path / "arm" / "package.xml").write_text("<package/>")
    (tmp_path / "arm" / "link.png").symlink_to(tmp_path / "other" / "wood.png")
    with pytest.warns(LoadWarning, match="outside|package"):
        scene = rj.load(file)
    assert scene.nodes[0].mesh.material.base_color_texture is None


def test_a_picture_that_another_package_lacks_is_not_taken_from_the_own_one(tmp_path):
    picture(tmp_path / "arm" / "materials" / "textures" / "wood.png")
    (tmp_path / "other").mkdir()
    file = obj(tmp_path / "arm" / "meshes", "package://other/wood.png")
    (tmp_path / "arm" / "package.xml").write_text("<package/>")
    with pytest.warns(LoadWarning, match="missing"):
        assert (
            rj.load(file, resource_root=tmp_path).nodes[0].mesh.material.base_color_texture is None
        )


def make_pipe(place):
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes among files")
    os.mkfifo(place)


@pytest.mark.parametrize("plant", [make_pipe, lambda place: place.symlink_to("../secret.xml")])
def test_what_marks_a_package_is_a_file(tmp_path, plant):
    (tmp_path / "secret.xml").write_text("<name>other</name>")
    file = obj(tmp_path / "arm", "package://other/wood.png")
    (tmp_path / "arm" / "package.xml").write_text("<package/>")
    plant(tmp_path / "arm" / "model.config")
    with pytest.warns(LoadWarning, match="package"):
        rj.load(file)


def test_lines_without_end_take_no_time(tmp_path):
    file = obj(tmp_path / "arm", "package://x/wood.png", library="package://x/" + "y" * 300_000)
    (tmp_path / "arm" / "package.xml").write_text("<name>" + " " * 60_000)
    (tmp_path / "arm" / "model.mtl").write_text(f"newmtl{' ' * 300_000}m\nKd {'1' * 300_000}x\n")
    with pytest.warns(LoadWarning, match="package"):
        rj.load(file)


def test_another_package_is_found_in_the_root_that_is_given(tmp_path):
    picture(tmp_path / "other" / "wood.png")
    file = obj(tmp_path / "arm" / "meshes", "package://other/wood.png")
    assert textured(file, resource_root=tmp_path)


def test_a_package_far_above_is_none_of_the_files(tmp_path):
    (tmp_path / "package.xml").write_text("<package/>")
    picture(tmp_path / "wood.png")
    file = obj(tmp_path / "a" / "b" / "c" / "d" / "e", "../../../../../wood.png")
    with pytest.warns(LoadWarning, match="outside"):
        rj.load(file)


@pytest.mark.parametrize("root", ["nowhere", 3])
def test_a_root_that_is_no_folder_is_an_error(tmp_path, write, root):
    file = write(tmp_path / "model", "wood.png")
    root = tmp_path / root if isinstance(root, str) else root
    with pytest.raises(ValueError, match=r"^resource_root must be"):
        rj.load(file, resource_root=root)


def test_a_material_library_outside_is_named(tmp_path):
    (tmp_path / "secret.mtl").write_text("newmtl m\nKd 1 0 0\n")
    with pytest.warns(LoadWarning, match=r"MTL file.*secret\.mtl.*outside"):
        scene = rj.load(obj(tmp_path / "model", "wood.png", "../secret.mtl"))
    red, green, _, _ = scene.nodes[0].mesh.material.base_color_over(False)
    assert red == green, "the file outside was read"


def test_a_buffer_outside_is_an_error_that_names_both(tmp_path):
    (tmp_path / "secret.bin").write_bytes(TRIANGLE.tobytes() + UV.tobytes())
    file = gltf(tmp_path / "model", "wood.png", "../secret.bin")
    with pytest.raises(MeshFileError, match=r"model\.gltf.*secret\.bin.*outside"):
        rj.load(file)


def test_a_ply_names_its_picture_like_others(tmp_path):
    picture(tmp_path / "secret.png")
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "model.ply").write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile ../secret.png\nelement vertex 3\n"
        "property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    )
    texture, said = loaded(folder / "model.ply")
    assert texture is None
    assert "secret.png" in said


POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n%%EOF\n"


def test_a_picture_that_is_a_program_is_not_started(tmp_path, write, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("a program is started")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    file = write(tmp_path / "model", "wood.png")
    (tmp_path / "model" / "wood.png").write_bytes(POSTSCRIPT)
    texture, said = loaded(file)
    assert texture is None
    assert "wood.png" in said
    with pytest.raises(ValueError, match=r"wood\.png.*none of PNG, JPEG"):
        rj.Texture.from_file(tmp_path / "model" / "wood.png")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF", "BMP", "TGA", "GIF"])
def test_pictures_are_told_by_their_content(tmp_path, write, kind):
    file = write(tmp_path / "model", "wood.png")
    Image.new("RGB", (4, 4), SECRET).save(tmp_path / "model" / "wood.png", kind)
    texture, said = loaded(file)
    assert said == ""
    assert texture.image.shape[:2] == (4, 4)
    assert rj.Texture.from_file(tmp_path / "model" / "wood.png").image.shape == (4, 4, 4)


@pytest.mark.parametrize("kind", ["PPM", "ICO", "PCX", "DDS", "SGI", "PDF"])
def test_pictures_of_other_formats_are_refused(tmp_path, kind):
    Image.new("RGB", (16, 16), SECRET).save(tmp_path / "wood.png", kind)
    with pytest.raises(ValueError, match=r"wood\.png.*none of PNG, JPEG"):
        rj.Texture.from_file(tmp_path / "wood.png")


def dae(folder, name, more=""):
    """Write a COLLADA file of a triangle whose colour is a picture."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.dae").write_text(f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified></asset>
<library_images><image id="i"><init_from>{name}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="common"><lambert><diffuse><texture texture="t" texcoord="UV"/></diffuse></lambert>
</technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array><technique_common>
<accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y"
type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="u"><float_array id="ua" count="6">0 0 1 0 0 1</float_array><technique_common>
<accessor source="#ua" count="3" stride="2"><param name="S" type="float"/><param name="T"
type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1" material="x"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="1" set="0"/><p>0 0 1 1 2 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g"><bind_material>
<technique_common><instance_material symbol="x" target="#m"/></technique_common></bind_material>
</instance_geometry>{more}</node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>""")
    return folder / "model.dae"


DAE_PICTURES = {
    "whole": (lambda place: picture(place), None),
    "missing": (lambda place: None, r"wood\.png' beside it is missing"),
    "no picture": (lambda place: place.write_bytes(b"wood"), r"wood\.png' .* no known picture"),
    "a program": (lambda place: place.write_bytes(POSTSCRIPT), r"wood\.png' .* no known picture"),
    "cut short": (
        lambda place: place.write_bytes(picture(place).read_bytes()[:45]),
        r"base_color_texture of .* that cannot be read: ",
    ),
}


@pytest.mark.parametrize("kind", DAE_PICTURES)
def test_a_picture_of_a_dae_is_read_or_named(tmp_path, kind):
    pytest.importorskip("collada")
    prepare, reason = DAE_PICTURES[kind]
    prepare(tmp_path / "wood.png")
    texture, said = loaded(dae(tmp_path, "wood.png"))
    assert (texture is not None) == (reason is None)
    assert said == "" if reason is None else re.search(reason, said)


def test_a_library_of_a_dae_in_another_file_is_named(tmp_path):
    pytest.importorskip("collada")
    picture(tmp_path / "wood.png")
    more = '<instance_geometry url="other.dae#h"/>'
    _, said = loaded(dae(tmp_path, "wood.png", more))
    assert "instance_geometry of a library in another file, 'other.dae#h' (1)" in said


@pytest.mark.parametrize(
    ("sound", "broken"),
    [("<source>s</source>", "<source>none</source>"), ('target="#m"', 'target="#none"')],
)
def test_faces_of_a_dae_whose_material_refers_to_nothing_are_drawn_without_it(
    tmp_path, sound, broken
):
    pytest.importorskip("collada")
    picture(tmp_path / "wood.png")
    path = dae(tmp_path, "wood.png")
    path.write_text(path.read_text().replace(sound, broken))
    texture, said = loaded(path)
    assert texture is None
    assert "materials of geometry 'g', which are broken (1)" in said


def test_animations_of_a_dae_are_named(tmp_path):
    pytest.importorskip("collada")
    picture(tmp_path / "wood.png")
    path = dae(tmp_path, "wood.png", '<instance_controller url="#c"/>')
    moves = '<animation id="a"><animation id="inner"/></animation><animation id="b"/>'
    library = f"<library_animations>{moves}</library_animations><scene>"
    path.write_text(path.read_text().replace("<scene>", library))
    _, said = loaded(path)
    assert "animation (2)" in said
    assert "skinned or morphed geometry (1)" in said


def test_brushes_of_xaml_that_are_not_one_colour_are_named(tmp_path):
    pytest.importorskip("lxml")
    model = """<GeometryModel3D><GeometryModel3D.Geometry><MeshGeometry3D
Positions="0,0,0 1,0,0 0,1,0" Normals="0,0,1 0,0,1 0,0,1" TriangleIndices="0 1 2"/>
</GeometryModel3D.Geometry><GeometryModel3D.Material><MaterialGroup><DiffuseMaterial>
<DiffuseMaterial.Brush>{}</DiffuseMaterial.Brush></DiffuseMaterial></MaterialGroup>
</GeometryModel3D.Material></GeometryModel3D>"""
    brushes = [
        '<SolidColorBrush Color="#ff0000" Opacity="1"/>',
        '<LinearGradientBrush><GradientStop Color="#fff"/></LinearGradientBrush>',
        "<RadialGradientBrush/>",
        '<ImageBrush ImageSource="wood.png"/>',
        "<LinearGradientBrush/>",
    ]
    space = "http://schemas.microsoft.com/winfx/2006/xaml/presentation"
    (tmp_path / "a.xaml").write_text(
        f'<Viewport3D xmlns="{space}">{"".join(map(model.format, brushes))}</Viewport3D>'
    )
    with pytest.warns(LoadWarning) as said:
        rj.load(tmp_path / "a.xaml")
    assert [
        "left out LinearGradientBrush of a DiffuseMaterial (2), RadialGradientBrush of a "
        "DiffuseMaterial (1), ImageBrush 'wood.png' of a DiffuseMaterial (1)" in str(one.message)
        for one in said
    ] == [True]
