"""OBJ, PLY, STL and OFF: the scenes that trimesh's readers give, and errors that name the line."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from PIL import Image

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.io.load_warnings import LeftOut, LoadWarning, MeshFileError
from rasterjit.io.primitives import Context
from rasterjit.io.resources import Resources
from rasterjit.io.text.mesh_builder import Names, number_rows, triangulate
from rasterjit.io.text.mtl import MtlLibrary
from rasterjit.io.text.number_parser import Damage
from rasterjit.io.text.obj import read_obj
from rasterjit.io.trimesh.resolver import make_resolver
from rasterjit.io.trimesh.scene import TrimeshAdapter

MODELS = Path(__file__).parents[2] / "models"

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"

MTL = (
    "newmtl red\nKd 1 0 0\nKs 0.5 0.5 0.5\nNs 20\nd 0.5\n\nnewmtl skin\nNs 0\nmap_Kd skin.png\n"
    "newmtl\tplain\nKd 0.2 0.4 0.6\nKa 1 1 1\nillum 2\nTr 0.25\n"
)

OBJS = {
    "quads": f"{SQUARE}v 2 0 0\nv 2 1 0\nf 1 2 3 4\nf 2 5 6 3\n",
    "mixed": f"{SQUARE}v 2 0 0\nv 2 1 0\nv 3 1 1\nf 1 2 3 4\nf 2 5 6\nf 1 2 5 7 6\n",
    "pentagons": f"{SQUARE}v -1 0.5 0\nf 1 2 3 4 5\nf 5 4 3 2 1\n",
    "negative": f"{SQUARE}vn 0 0 1\nvt 0 0\nvt 1 1\nf -4/-2/-1 -3/-1/-1 -2/-2/-1\n",
    "normals": f"{SQUARE}vn 1 0 0\nvn 0 0 2\nf 1//1 2//1 3//2\nf 1//2 3//2 4//1\n",
    "uv": f"{SQUARE}vt 0 0\nvt 1 0\nvt 1 1 0\nf 1/1 2/2 3/3\nf 1/3 3/2 4/1\n",
    "uv and normals": f"{SQUARE}vt 0 0\nvt 1 0\nvn 0 0 1\nvn 0 1 0\n"
    "f 1/1/1 2/2/2 3/2/1\nf 1/1/2 3/2/1 4/1/1\n",
    "colours": "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0.3 0.4 2\nf 1 2 3\n",
    "colours and uv": "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0.3 0.4 2\nvt 0 0\nvt 0 1\n"
    "f 1/1 2/2 3/1\n",
    "weights": "v 0 0 0 1\nv 1 0 0 1\nv 1 1 0 1\nf 1 2 3\n",
    "some colours": "v 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n",
    "continued": f"{SQUARE}f 1 2 \\\n 3 4\n",
    "windows": f"{SQUARE}f 1 2 3\nf 1 3 4".replace("\n", "\r\n"),
    "blanks": f"# a\n\n{SQUARE}\n\nf  1   2 3  \nf 1 3 4\t\n",
    "object first": f"o lamp\n{SQUARE}g x\nf 1 2 3\no other\nf 1 3 4\n",
    "object later": f"{SQUARE}s 1\no lamp\nf 1 2 3\n",
    "groups": f"{SQUARE}g a\nf 1 2 3\ng b\nf 1 3 4\ng a\nf 2 3 4\n",
    "materials": f"mtllib a.mtl\n{SQUARE}usemtl red\nf 1 2 3\nusemtl plain\nf 1 3 4\nusemtl red\n"
    "f 2 3 4\nusemtl none\nf 1 2 4\n",
    "no material first": f"mtllib a.mtl\n{SQUARE}f 1 2 3\nusemtl plain\nf 1 3 4\n",
    "picture": f"mtllib a.mtl\n{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nusemtl skin\nf 1/1 2/2 3/3\n",
    "picture without uv": f"mtllib a.mtl\n{SQUARE}usemtl skin\nf 1 2 3\n",
    "library without materials": f"mtllib none.mtl\n{SQUARE}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n",
    "same names": f"o part_3\n{SQUARE}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\nusemtl c\nf 1 2 4\n",
    "unused vertices": f"{SQUARE}v 9 9 9\nv nan 0 0\nf 2 3 4\n",
    "infinite normal": f"{SQUARE}vn inf 0 0\nf 1//1 2//1 3//1\n",
    "exponents": "v 1e-3 0 0\nv 1E+2 0 0\nv .5 -1. +2\nf 1 2 3\n",
}

TRIANGLE = (
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\n"
    "endloop\nendfacet\n"
)

STLS = {
    "one": f"solid a part \n{TRIANGLE}endsolid a part\n",
    "no name": f"solid\n{TRIANGLE}{TRIANGLE}endsolid",
    "several": f"solid x\n{TRIANGLE}endsolid x\nsolid X\n{TRIANGLE}endsolid\nsolid x\n{TRIANGLE}"
    f"endsolid\nsolid\n{TRIANGLE}endsolid\nsolid\nendsolid\nsolid\n{TRIANGLE}endsolid\n",
    "capitals": f"solid x\n{TRIANGLE}endsolid\n".upper().replace("\n", "\r\n"),
}

UNNAMED = {"geometry_1": "a.stl", "geometry_2": "a.stl_1"}

THREE = "OFF\n3 2 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n"

OFFS = {
    "comments": "# a\nOFF # b\n# c\n4 2 0\n0 0 0\n1 0 0 # d\n1 1 0\n\n0 1 0\n3 0 1 2\n3 0 2 3# e",
    "marked": "\ufeffOFF\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n",
    "one line": "OFF 4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3  0 1  2\n4 0 1 2 3",
    "colours": "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 255 0 0 255\n1 1 0 0 0 9 255\n3 0 1 2\n",
    "face colours": "OFF\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2 0.5 0.5 0.5\n",
    "normals": "NOFF\r\n3 1 0\r\n0 0 0 0 0 1\r\n1 0 0 0 0 1\r\n1 1 0 0 0 1\r\n3 0 1 2\r\n",
    "texture": "STOFF\n3 1 0\n0 0 0 0 1\n1 0 0 0 1\n1 1 0 1 1\n3 0 1 2\n",
    "polygons": "OFF\n4 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 2\n4 3 2 1 0\n",
}


def ply(vertex, rows, faces, order="ascii", face="property list uchar int vertex_indices\n"):
    """Write a PLY as text; each property of ``vertex`` is a type and a name."""
    head = f"ply\nformat {order} 1.0\ncomment made\nelement vertex {len(rows)}\n"
    head += "".join(f"property {one}\n" for one in vertex)
    head += f"element face {len(faces)}\n{face}end_header\n"
    return head + "".join(f"{row}\n" for row in [*rows, *faces])


XYZ = ["float x", "float y", "float z"]
CORNERS = ["0 0 0", "1 0 0", "1 1 0.1", "0 1 0"]
RGB = ["uchar red", "uchar green", "uchar blue"]


def each(values):
    return [f"{corner} {value}" for corner, value in zip(CORNERS, values, strict=True)]


PLYS = {
    "plain": ply(XYZ, CORNERS, ["3 0 1 2", "3 0 2 3"]),
    "double": ply([one.replace("float", "double") for one in XYZ], CORNERS, ["3 0 1 2"]),
    "quads": ply(XYZ, CORNERS, ["4 0 1 2 3", "4 3 2 1 0"]),
    "polygons": ply(XYZ, [*CORNERS, "-1 .5 0"], ["4 0 1 2 3", "3 0 1 2", "5 0 1 2 3 4"]),
    "double blanks": ply(XYZ, CORNERS, ["3  0 1   2 ", "3 0 2 3"]),
    "colours": ply(XYZ + RGB, each(["255 0 0", "0 9 0", "1 2 3", "4 5 6"]), ["3 0 1 2"]),
    "alpha": ply([*XYZ, *RGB, "uchar alpha"], each(["255 0 0 9"] * 4), ["3 0 1 2"]),
    "float colours": ply(
        XYZ + [f"float {name}" for name in ("red", "green", "blue")],
        each(["1 0 0", "0 0.3 0", "0.1 0.2 2", "nan 0 1"]), ["3 0 1 2"],
    ),
    "face colours": ply(
        XYZ, CORNERS, ["3 0 1 2 255 0 0", "3 0 2 3 9 8 7"],
        face="property list uchar int vertex_index\n" + "".join(f"property {c}\n" for c in RGB),
    ),
    "normals": ply([*XYZ, "float nx", "float ny", "float nz"], each(["0 0 1"] * 4), ["3 0 1 2"]),
    "zero normals": ply(
        [*XYZ, "float nx", "float ny", "float nz"], each(["0 0 0"] * 4), ["3 0 1 2"]
    ),
    "uv of vertices": ply([*XYZ, "float s", "float t"], each(["0 0", "1 0", "1 1", "0 1"]),
                          ["3 0 1 2", "3 0 2 3"]),
    "uv and colours": ply([*XYZ, "float u", "float v", *RGB], each(["0 0 9 8 7"] * 4),
                          ["3 0 1 2", "3 0 2 3"]),
    "uv of corners": ply(
        XYZ, CORNERS, ["3 0 1 2 6 0 0 1 0 1 1", "3 0 2 3 6 0 0 0.5 1 0 1"],
        face="property list uchar int vertex_indices\nproperty list uchar float texcoord\n",
    ),
    "picture": ply([*XYZ, "float texture_u", "float texture_v"], each(["0 0", "1 0", "1 1", "0 1"]),
                   ["3 0 1 2", "3 0 2 3"]).replace("comment made", "comment TextureFile skin.png"),
    "other elements": ply(XYZ, CORNERS, ["3 0 1 2"]).replace(
        "element face", "element edge 0\nproperty int vertex1\nproperty int vertex2\nelement face"
    ),
    "windows": ply(XYZ, CORNERS, ["3 0 1 2"]).replace("\n", "\r\n"),
}  # fmt: skip

SUFFIXES = {"obj": OBJS, "stl": STLS, "off": OFFS, "ply": PLYS}
FILES = [
    (suffix, name) for suffix, texts in SUFFIXES.items() for name in texts
    if not (suffix == "off" and "colours" in name)
]  # fmt: skip
"""All but those with what trimesh does not read: colours of OFF files."""


def write(folder, suffix, text):
    """Write a file and what it may name; a text keeps its line ends."""
    path = folder / f"a.{suffix}"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "a.mtl").write_text(MTL)
    pixels = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    Image.fromarray(pixels).save(folder / "skin.png")
    return path


def loaded(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LoadWarning)
        return rj.load(path, **options)


class WithLibrary(TrimeshAdapter):
    """Takes the pictures of materials from MTL files, as trimesh drops what these say."""

    library = None

    def _material(self, material, is_gltf):
        found = None if self.library is None else self.library.material(material.name)
        return super()._material(material, is_gltf) if found is None else found


def through_trimesh(path, on_invalid="raise"):
    """Read a file with trimesh's reader."""
    left_out, resources = LeftOut(), Resources(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = trimesh.load_scene(path, resolver=make_resolver(resources, left_out), process=False)
    adapter = WithLibrary(Context(str(path), on_invalid, 40.0, left_out), True)
    if path.suffix == ".obj" and "mtllib a.mtl" in path.read_text():
        used = [line.split()[1] for line in path.read_text().splitlines() if line[:6] == "usemtl"]
        adapter.library = MtlLibrary(["a.mtl"], used, resources, left_out)
    return adapter.scene(read)


def corner_values(mesh):
    """Return what the corners of faces have: vertices that share a place may swap theirs."""
    yield mesh.vertices[mesh.faces]
    for values in (mesh.normals, mesh.uv, mesh.vertex_colors):
        yield None if values is None else values[mesh.faces]
    yield mesh.face_colors


def assert_same_scenes(ours, theirs):
    # trimesh calls meshes of OBJ files by the whole path, and solids without a name by a number.
    expected = [UNNAMED.get(node.name, node.name) for node in theirs.nodes]
    expected = [os.path.basename(name) if os.path.isabs(name) else name for name in expected]
    assert [node.name for node in ours.nodes] == expected
    for one, other in zip(ours.nodes, theirs.nodes, strict=True):
        assert np.array_equal(one.mesh.vertices, other.mesh.vertices, equal_nan=True)
        pairs = zip(corner_values(one.mesh), corner_values(other.mesh), strict=True)
        for mine, expected in pairs:
            assert (mine is None) == (expected is None)
            if mine is not None:
                assert np.array_equal(mine, expected, equal_nan=True)
        assert_same_materials(one.mesh.material, other.mesh.material)


def assert_same_materials(one, other):
    for name in ("base_color", "specular", "shininess", "name", "alpha_mode", "shading"):
        assert getattr(one, name) == getattr(other, name), name
    mine, expected = one.base_color_texture, other.base_color_texture
    assert (mine is None) == (expected is None)
    if mine is not None:
        assert np.array_equal(mine.image, expected.image)


@pytest.mark.parametrize(("suffix", "name"), FILES)
def test_scenes_are_those_of_trimeshs_readers(tmp_path, suffix, name):
    path = write(tmp_path, suffix, SUFFIXES[suffix][name])
    on_invalid = "drop" if name == "unused vertices" else "raise"
    assert_same_scenes(loaded(path, on_invalid=on_invalid), through_trimesh(path, on_invalid))


MODEL_FILES = sorted(p.name for p in MODELS.iterdir() if p.suffix[1:] in SUFFIXES)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "binvox"])
def test_meshes_without_a_name_have_that_of_the_file_without_its_folders(
    tmp_path, suffix, monkeypatch
):
    if suffix == "binvox":
        content = b"#binvox 1\ndim 2 2 2\ndata\n\1\x08"
    else:
        texts = SUFFIXES[suffix]
        content = texts.get("no name", next(iter(texts.values())))
    path = write(tmp_path, suffix, content)
    monkeypatch.chdir(tmp_path)
    for given in (path, path.name, f"../{tmp_path.name}/{path.name}"):
        scene = loaded(given)
        assert scene.find(path.name) is scene.nodes[0]
    if suffix == "obj":
        path.write_text(f"o parts/nut\n{SQUARE}f 1 2 3\n")
        assert [node.name for node in rj.load(path).nodes] == ["parts/nut"]


@pytest.mark.parametrize("name", MODEL_FILES)
def test_models_are_those_of_trimeshs_readers(name):
    assert_same_scenes(loaded(MODELS / name), through_trimesh(MODELS / name))


@pytest.mark.parametrize("kind", ["plain", "vertex colours", "face colours", "normals", "uv"])
@pytest.mark.parametrize("form", ["obj", "off", "stl", "stl_ascii", "ply", "ply ascii"])
def test_exports_of_trimesh_come_back(tmp_path, form, kind):
    source = trimesh.creation.icosphere(1)
    rng = np.random.default_rng(3)
    if kind == "vertex colours":
        source.visual.vertex_colors = rng.integers(0, 256, (len(source.vertices), 4), np.uint8)
    elif kind == "face colours":
        source.visual.face_colors = rng.integers(0, 256, (len(source.faces), 4), np.uint8)
    elif kind == "normals":
        assert len(source.vertex_normals)
    elif kind == "uv":
        uv = rng.random((len(source.vertices), 2))
        source.visual = trimesh.visual.TextureVisuals(uv=uv)
    options = {"encoding": "ascii"} if form == "ply ascii" else {}
    content = source.export(file_type=form.split()[0], **options)
    path = write(tmp_path, form.split("_")[0].split()[0], content)
    assert_same_scenes(loaded(path), through_trimesh(path))


# What trimesh's readers cannot


def as_binary(text, order):
    """Return a text PLY of float and int properties as a binary one."""
    head, body = text.split("end_header\n")
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    content = b""
    for line in body.splitlines():
        words = line.split()
        if "." in line or words[0] not in ("3", "4", "5"):
            content += np.array(words, f"{order}f4").tobytes()
        else:
            content += bytes([int(words[0])]) + np.array(words[1:], f"{order}i4").tobytes()
    return f"{head.replace('ascii', name)}end_header\n".encode() + content


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("name", ["plain", "quads", "polygons"])
def test_binary_ply_is_read_in_both_byte_orders(tmp_path, order, name):
    text = loaded(write(tmp_path, "ply", PLYS[name]))
    assert_same_scenes(loaded(write(tmp_path, "ply", as_binary(PLYS[name], order))), text)


@pytest.mark.parametrize("order", ["ascii", "<", ">"])
def test_lists_of_one_length_are_attributes_of_several_columns(tmp_path, order):
    faces = ["3 0 1 2 2 1 2", "3 0 2 3 2 3 4"]
    text = ply(
        [*XYZ, "list uchar float flow", "float heat", "list uchar int some"],
        each(["2 1 2 5 1 6", "2 3 4 6 1 7", "2 5 6 7 1 4", "2 7 8 8 2 1 2"]), faces,
        face="property list uchar int vertex_indices\nproperty list uchar float pair\n",
    )  # fmt: skip
    if order != "ascii":
        head, body = text.split("end_header\n")
        lists = [("f4", 3, "u1", 1, "f4", 2, "f4", 1, "u1", 1, "i4", 1)] * 4
        lists[3] = (*lists[3][:-1], 2)
        content = b""
        lists += [("u1", 1, "i4", 3, "u1", 1, "f4", 2)] * 2
        for line, kinds in zip(body.splitlines(), lists, strict=True):
            words = line.split()
            for kind, count in zip(kinds[::2], kinds[1::2], strict=True):
                content += np.array(words[:count], order + kind).tobytes()
                words = words[count:]
        name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
        text = f"{head.replace('ascii', name)}end_header\n".encode() + content
    path = write(tmp_path, "ply", text)
    with pytest.warns(rj.LoadWarning, match=r"left out vertex lists 'some' of several lengths"):
        mesh = rj.load(path).nodes[0].mesh
    assert sorted(mesh.vertex_attributes) == ["flow", "heat"]
    assert mesh.vertex_attributes["flow"].tolist() == [[1, 2], [3, 4], [5, 6], [7, 8]]
    assert mesh.vertex_attributes["heat"].tolist() == [[5], [6], [7], [8]]
    assert mesh.face_attributes["pair"].tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_attributes_that_trimesh_writes_are_read(tmp_path, encoding):
    box = trimesh.creation.box()
    box.vertex_attributes["flow"] = np.arange(24, dtype=np.float32).reshape(8, 3)
    path = tmp_path / "flow.ply"
    box.export(path, encoding=encoding, vertex_normal=False)
    mesh = rj.load(path).nodes[0].mesh
    flow = mesh.vertex_attributes["flow"]
    assert flow.shape[1] == 3
    for corner, values in zip(mesh.vertices, flow, strict=True):
        own = (np.abs(box.vertices - corner) < 1e-6).all(axis=1)
        assert values.tolist() in box.vertex_attributes["flow"][own].tolist()


def test_lists_of_damaged_rows_are_zeros(tmp_path):
    text = ply([*XYZ, "list uchar float flow"], each(["2 1 2", "2 3 4", "2 5 6", "2 7"]),
               ["3 0 1 2"])  # fmt: skip
    path = write(tmp_path, "ply", text)
    with pytest.warns(rj.LoadWarning, match="damaged"):
        mesh = rj.load(path, on_damage="warn").nodes[0].mesh
    assert mesh.vertex_attributes["flow"].tolist() == [[1, 2], [3, 4], [5, 6]]


def test_elements_that_are_not_known_are_skipped(tmp_path):
    extra = "element tag 2\nproperty list ushort short n\nproperty uchar a\n"
    text = PLYS["plain"].replace("element face", f"{extra}element face")
    lines = text.splitlines()
    at = lines.index("3 0 1 2")
    lines[at:at] = ["2 7 8 1", "0 4"]
    path = write(tmp_path, "ply", "\n".join(lines))
    assert_same_scenes(loaded(path), loaded(write(tmp_path, "ply", PLYS["plain"])))


def test_colours_of_polygons_stay_with_them(tmp_path):
    face = "property list uchar int vertex_indices\n" + "".join(f"property {c}\n" for c in RGB)
    text = ply(XYZ, CORNERS, ["4 0 1 2 3 255 0 0", "3 0 1 2 0 0 255"], face=face)
    (node,) = rj.load(write(tmp_path, "ply", text)).nodes
    assert node.mesh.face_colors[:, [0, 2]].tolist() == [[0, 1], [1, 0], [1, 0]]


def test_negative_numbers_count_back_from_their_line(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 6 1 0\nf -3 -2 -1\n"
    (node,) = rj.load(write(tmp_path, "obj", text)).nodes
    assert node.mesh.vertices[node.mesh.faces][:, 0, 0].tolist() == [0, 5]


def test_a_binary_stl_that_begins_with_solid_is_binary(tmp_path):
    content = bytearray(trimesh.creation.box().export(file_type="stl"))
    content[:6] = b"solid "
    path = write(tmp_path, "stl", bytes(content))
    assert_same_scenes(loaded(path), through_trimesh(path))


def test_materials_of_every_library_are_found(tmp_path):
    (tmp_path / "b.mtl").write_text("newmtl blue\nKd 0 0 1\nKs nonsense\n")
    text = f"mtllib a.mtl\nmtllib b.mtl\n{SQUARE}usemtl blue\nf 1 2 3\n"
    with pytest.warns(LoadWarning, match="left out Ks 'nonsense' of material 'blue'"):
        (node,) = rj.load(write(tmp_path, "obj", text)).nodes
    assert node.mesh.material.base_color == (0.0, 0.0, 1.0, 1.0)


def test_a_missing_picture_of_a_ply_is_named(tmp_path):
    text = PLYS["picture"].replace("skin.png", "none.png")
    with pytest.warns(LoadWarning, match=r"none\.png.*missing"):
        rj.load(write(tmp_path, "ply", text))


# Damage

DAMAGED = {
    "obj: a word in a vertex": ("obj", f"{SQUARE}v 1 x 0\nf 1 2 3\n", r"line 5: expected 3"),
    "obj: a vertex of two": ("obj", f"v 1 0\n{SQUARE}f 2 3 4\n", r"line 1: expected 3 numbers"),
    "obj: two numbers in a word": ("obj", f"v 1-2 3\n{SQUARE}f 2 3 4\n", r"line 1: expected 3"),
    "obj: a face of two": ("obj", f"{SQUARE}f 1 2 3\nf 1 2\n", r"line 6: expected a face of 3"),
    "obj: a face of words": ("obj", f"{SQUARE}f 1 2 3\n\nf a b c\n", r"line 7: .*'f a b c'"),
    "obj: a face beyond": ("obj", f"{SQUARE}f 1 2 3\nf 1 2 5\n", r"line 6: .*among 4 v.*'f 1 2 5'"),
    "obj: a normal beyond": ("obj", f"{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 2//2 3//1\n",
                             r"line 7: .*1 vn"),
    "obj: counts from zero": ("obj", f"{SQUARE}f 1 2 3\nf 0 1 2\n", r"line 6: "),
    "obj: before the first": ("obj", f"{SQUARE}f 1 2 3\nf -5 -4 -3\n", r"line 6: "),
    "obj: a face too far": ("obj", f"{SQUARE}f 1 2 3\nf 1 2 {'9' * 30} # far\n", r"line 6: "),
    "stl: a solid in a triangle": (
        "stl", "solid a\n" + TRIANGLE.replace("vertex 1", "solid b\nvertex 1") + "vertex 1 2 3\n"
        + TRIANGLE + "endsolid\n", r"line 2: expected a facet of 3 vertices, not 4"),
    "obj: continued": ("obj", f"{SQUARE}f 1 2 \\\n 3\nf 1 2 x\n", r"line 7: "),
    "ply: a vertex less": ("ply", ply(XYZ, CORNERS, ["3 0 1 2"]).replace("vertex 4", "vertex 7"),
                           r"its end: expected 7 lines of vertex, as its head says, got 5"),
    "ply: a face less": ("ply", ply(XYZ, CORNERS, ["3 0 1 2"]).replace("face 1", "face 5"),
                         r"its end: expected 5 lines of face, as its head says, got 1"),
    "ply: a word": ("ply", ply(XYZ, ["0 a 0", *CORNERS], ["3 1 2 3"]),
                    r"line 11: expected 3 numbers of vertex \(x, y, z\), got '0 a 0'"),
    "ply: a cut line": ("ply", ply(XYZ, CORNERS, ["3 0 1 2", "3 0 1"]), r"line 16: .*'3 0 1'"),
    "ply: a face beyond": ("ply", ply(XYZ, CORNERS, ["3 0 1 2", "3 0 1 4"]),
                           r"line 16: expected numbers of vertices below 4"),
    "ply: a number more": ("ply", ply(XYZ, CORNERS, ["3 0 1 2", "3 0 1 2 3"]), r"line 16: "),
    "ply: a line more": ("ply", PLYS["plain"].replace("face 2", "face 1"),
                         r"line 16: expected no line behind .*'3 0 2 3'"),
    "ply: rows more": ("ply", as_binary(PLYS["plain"], ">").replace(b"face 2", b"face 1"),
                       r"its end: expected nothing after the rows .* got 13 bytes"),
    "off: a line more": ("off", OFFS["one line"].replace("4 2 0", "4 1 0"),
                         r"line 7: expected nothing after 1 faces, got '4 0 1 2 3'"),
    "ply: binary": ("ply", as_binary(PLYS["plain"], "<")[:-3],
                    r"its end: expected 2 rows of face, as its head says, got 1"),
    "off: a face less": ("off", OFFS["one line"].replace("4 2 0", "4 5 0"),
                         r"its end: expected 5 faces, as its head says, got 2"),
    "off: a word": ("off", f"{THREE}3 0 x 2\n", r"line 7: .*'3 0 x"),
    "off: cut": ("off", f"{THREE}3 0 1\n", r"line 7: .*'3 0 1'"),
    "off: a face beyond": ("off", f"{THREE}3 0 1 3\n", r"line 7: "),
    "stl: no end": ("stl", f"solid a\n{TRIANGLE}{TRIANGLE}"[:-60], r"its end: expected 'endsolid'"),
    "stl: a word": ("stl", f"solid a\n{TRIANGLE}{TRIANGLE.replace('1 0 0', '1 q 0')}endsolid\n",
                    r"line 12: expected 3 numbers of a vertex"),
    "stl: binary": ("stl", trimesh.creation.box().export(file_type="stl")[:-7],
                    r"its end: expected 12 triangles, as its head says, got room for 11"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGED)
def test_damage_is_an_error_that_names_the_line_or_a_warning(tmp_path, name):
    suffix, content, said = DAMAGED[name]
    path = write(tmp_path, suffix, content)
    with pytest.raises(MeshFileError, match=rf"a\.{suffix} is damaged at .*(?:{said})"):
        rj.load(path)
    if name == "ply: a vertex less":
        return
    with pytest.warns(LoadWarning, match=said):
        scene = rj.load(path, on_damage="warn")
    assert sum(len(node.mesh.faces) for node in scene.nodes) >= 1
    assert all(np.isfinite(node.mesh.vertices).all() for node in scene.nodes)


@pytest.mark.parametrize(
    ("suffix", "text", "said"),
    [
        ("obj", f"{SQUARE}f 1 2 3\nff 1 3 4\nf1 3 4\nusemtk red\n",
         r"lines of no known kind, first line 6: 'ff 1 3 4' \(3\)"),
        ("obj", f"{SQUARE}f 1 2 3\ncstype bezier\nsurf 0 1 0 1 1\nend\n", r"surface \(1\)"),
        ("off", "OFF\n3 2 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n2 0 1\n",
         r"polygon of fewer than 3 corners \(1\)"),
        ("ply", ply(XYZ, CORNERS, ["3 0 1 2", "2 0 1", "0"]), r"fewer than 3 corners \(2\)"),
    ],
)  # fmt: skip
def test_what_is_no_face_is_named(tmp_path, suffix, text, said):
    with pytest.warns(LoadWarning, match=said):
        scene = rj.load(write(tmp_path, suffix, text))
    assert [len(node.mesh.faces) for node in scene.nodes] == [1]


def test_statements_without_a_shape_are_passed_over(tmp_path):
    text = f"# a\no a\ng b\ns off\nmg 1\nlod 2\nvp 0 1\nshadow_obj x.obj\n{SQUARE}f 1 2 3\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rj.load(write(tmp_path, "obj", text))


def test_a_line_of_a_head_that_is_none_is_refused(tmp_path):
    text = PLYS["plain"].replace("property float y", "propertz float y")
    with pytest.raises(MeshFileError, match=r"line 6: expected format, .* got 'propertz float y'"):
        rj.load(write(tmp_path, "ply", text))


def bent(corners):
    """Return an OBJ of a square bent along a line, with the corners of its faces."""
    return f"{SQUARE}v 2 0 1\nv 2 1 1\nvn 0 0.6 0.8\nvn 0 1 0\n{corners}"


def normals_of(mesh):
    """Return the normals at the corners of each face."""
    return mesh.normals[mesh.faces]


@pytest.mark.parametrize("uv", [False, True])
def test_faces_without_normals_take_none_from_others(tmp_path, uv):
    given = "f 1//1 2//1 3//2\nf 1//2 3//1 4//1\n"
    text = bent(f"{given}f 2//1 5 6//1\nf 2 6 3\n")
    if uv:
        text = (
            text.replace("f ", "vt 0 1\nf ", 1)
            .replace("//", "/1/")
            .replace("f 2 6 3", "f 2/1 6/1 3/1")
        )
        text = text.replace(" 5 ", " 5/1 ")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (node,) = rj.load(write(tmp_path, "obj", text), crease_angle=30.0).nodes
    mesh = node.mesh
    expected = np.float32([[0, 0.6, 0.8], [0, 1, 0]])
    assert np.allclose(normals_of(mesh)[:2], expected[[[0, 0, 1], [1, 0, 0]]])
    half = np.float32(0.5**0.5)
    assert np.allclose(normals_of(mesh)[2:], [-half, 0, half])
    plain = loaded(write(tmp_path, "obj", text.replace("vn", "#")), crease_angle=30.0).nodes[0].mesh
    assert np.array_equal(mesh.vertices[mesh.faces], plain.vertices[plain.faces])
    assert (mesh.uv is not None) == uv


def test_a_normal_that_is_not_finite_is_made_from_its_faces(tmp_path):
    text = bent("vn nan 0 0\nf 1//1 2//1 3//1\nf 2//2 5//2 6//3\n")
    with pytest.warns(LoadWarning, match="normals with NaN or infinity"):
        (node,) = rj.load(write(tmp_path, "obj", text)).nodes
    assert np.allclose(normals_of(node.mesh)[0], [0, 0.6, 0.8])
    half = 0.5**0.5
    assert np.allclose(normals_of(node.mesh)[1], [[0, 1, 0], [0, 1, 0], [-half, 0, half]])


def test_on_damage_is_one_of_two(tmp_path):
    with pytest.raises(ValueError, match="on_damage must be one of 'error', 'warn'; got 'skip'"):
        rj.load(write(tmp_path, "obj", OBJS["quads"]), on_damage="skip")


def test_the_command_line_loads_what_there_is(tmp_path):
    path = write(tmp_path, "obj", f"{SQUARE}f 1 2 3\nf 1 2\n")
    command = ["render", str(path), "-o", str(tmp_path / "a.png"), "--size", "9x9"]
    refused = CliRunner().invoke(commands.program, command)
    assert refused.exit_code == 1
    assert "line 6" in refused.output
    warned = CliRunner().invoke(commands.program, [*command, "--on-damage", "warn"])
    assert warned.exit_code == 0
    assert "line 6" in warned.output


@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        ("ply", "ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\n"
                "element face 999999999999\nproperty list uchar int vertex_indices\nend_header\n"),
        ("ply", "ply\nformat binary_little_endian 1.0\nelement face 999999999999\n"
                "property list uint double vertex_indices\nend_header\n\xff\xff\xff\xff"),
        ("off", "OFF\n999999999999 999999999999 0\n0 0 0\n"),
        ("stl", b"\0" * 80 + b"\xff" * 4),
        ("obj", "v 1 2 3\nf 1 1 99999999999999999999999\nf 9223372036854775807 1 1\n"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("on_damage", ["error", "warn"])
def test_a_head_that_promises_too_much_costs_nothing(tmp_path, suffix, text, on_damage):
    with pytest.raises(MeshFileError):
        rj.load(write(tmp_path, suffix, text), on_damage=on_damage)


# Time and memory grow with the file


def test_many_groups_and_many_blanks_are_read_soon(tmp_path):
    lines = ["mtllib a.mtl", "v 0 0 0", "v 1 0 0", "v 0 1 0"]
    for number in range(20_000):
        lines += [f"g part {number}", f"usemtl m{number}", "f 1 2 3"]
    path = write(tmp_path, "obj", "\n".join(lines))
    (tmp_path / "a.mtl").write_text(f"newmtl{' ' * 40_000}m0\nKd{' ' * 40_000}1 0 0\n")
    before = time.thread_time()
    left_out = LeftOut()
    parts = read_obj(path, Resources(path), Damage(path, "error", left_out), left_out)
    assert len({part.name for part in parts}) == 20_000
    blanks = write(tmp_path, "obj", f"{SQUARE}usemtl{' ' * 40_000}x\nf 1 2 3\n" + " " * 40_000)
    assert len(loaded(blanks).nodes) == 1
    assert time.thread_time() - before < 20.0


def test_trimesh_is_not_imported_for_these_files(tmp_path):
    names = [str(write(tmp_path / suffix, suffix, text)) for suffix, text in (
        ("obj", OBJS["picture"]), ("ply", PLYS["picture"]), ("stl", STLS["one"]),
        ("off", OFFS["comments"]),
    ) if (tmp_path / suffix).mkdir() is None]  # fmt: skip
    code = (
        "import sys, rasterjit as rj\n"
        f"for name in {names!r}: rj.load(name)\n"
        "print(sorted(m for m in ('trimesh', 'networkx', 'scipy') if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env=os.environ
    )
    assert done.stdout.strip() == "[]"


# Helpers


def test_names_that_are_given_again_get_the_next_free_number():
    names = Names()
    given = [names.unique(name) for name in ("a", "a_1", "a", "a", "a_1", "", "", "b_7", "b_7")]
    assert given == ["a", "a_1", "a_2", "a_3", "a_4", "geometry_1", "geometry_2", "b_7", "b_8"]
    again = [f"c_{number}" for number in range(20_000)]
    before = time.thread_time()
    assert len({names.unique(name) for name in again + again}) == 40_000
    assert time.thread_time() - before < 10.0


def test_rows_are_joined_by_their_numbers():
    rng = np.random.default_rng(5)
    for most in (4, 1 << 40):
        table = rng.integers(0, 4, (50, 3)) * (most // 4)
        rows, which = number_rows(table)
        assert np.array_equal(table[rows][which], table)
        assert len(rows) == len(np.unique(table, axis=0))
        assert np.array_equal(table[rows], np.unique(table, axis=0))


@pytest.mark.parametrize("by_size", [False, True])
def test_polygons_are_cut_into_fans(by_size):
    corners, polygons = triangulate(np.array([5, 3, 4]), by_size)
    assert np.bincount(polygons).tolist() == [3, 1, 2]
    assert corners[polygons == 0].tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert corners[polygons == 2].tolist() == [[8, 9, 10], [10, 11, 8]]
    assert (polygons.tolist() == [1, 2, 2, 0, 0, 0]) == by_size


@pytest.mark.parametrize(
    "head", ["OFF3 1 0\n", "off\n3 1 0\n", "OFF 3 1 0\n", "\ufeffOFF\n3 1 0\n"]
)
def test_numbers_may_follow_the_head_of_an_off_file_at_once(tmp_path, head):
    (tmp_path / "a.off").write_text(f"{head}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "utf-8")
    assert loaded(tmp_path / "a.off").nodes[0].mesh.faces.tolist() == [[0, 1, 2]]


def test_a_byte_order_mark_hides_no_statement(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n", "utf-8-sig")
    text = f"{SQUARE}mtllib a.mtl\nusemtl red\nf 1 2 3 4\n"
    (tmp_path / "a.obj").write_text(text, "utf-8-sig")
    mesh = rj.load(tmp_path / "a.obj").nodes[0].mesh
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.material.base_color == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("diffuse", ["nan 0 0", "1e308 -1e308 0"])
def test_numbers_of_a_material_that_are_not_finite_are_not_taken(tmp_path, diffuse):
    statements = f"Kd {diffuse}\nKs 1 1 1\nNs nan\nd nan\n"
    (tmp_path / "a.mtl").write_text(f"newmtl m\n{statements}")
    (tmp_path / "a.obj").write_text(f"{SQUARE}mtllib a.mtl\nusemtl m\nf 1 2 3 4\n")
    with pytest.warns(LoadWarning, match="Ns 'nan' of .*, d 'nan' of material 'm'"):
        material = rj.load(tmp_path / "a.obj").nodes[0].mesh.material
    assert np.isfinite([*material.base_color_over(False), material.shininess]).all()
    assert material.base_color_over(False)[3] == 1.0


def test_what_lies_behind_the_triangles_of_an_stl_file_is_counted(tmp_path):
    path = tmp_path / "a.stl"
    trimesh.creation.box().export(path)
    path.write_bytes(path.read_bytes() + b"...")
    with pytest.raises(ValueError, match=r"expected nothing after 12 triangles, got 3 bytes"):
        rj.load(path)
    assert len(loaded(path, on_damage="warn").nodes[0].mesh.faces) == 12


@pytest.mark.parametrize(
    ("head", "rows", "colors"),
    [
        (
            "COFF",
            ["255 0 0 255", "0 255 0 255", "0 0 255 0"],
            [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 0]],
        ),
        ("COFF", ["1 0 0", "0 1.0 0", "0 0 1"], [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]]),
    ],
)
def test_colours_of_vertices_of_an_off_file_are_read(tmp_path, head, rows, colors):
    places = ["0 0 0", "1 0 0", "0 1 0"]
    lines = [f"{place} {row}" for place, row in zip(places, rows, strict=True)]
    (tmp_path / "a.off").write_text("\n".join([head, "3 1 0", *lines, "3 0 1 2", ""]))
    mesh = loaded(tmp_path / "a.off").nodes[0].mesh
    order = [mesh.vertices.tolist().index([float(w) for w in place.split()]) for place in places]
    assert mesh.vertex_colors[order].tolist() == colors


@pytest.mark.parametrize("beside", ["255 0 0", "1.0 0 0", "1.0 0.0 0.0 1.0"])
def test_colours_of_faces_of_an_off_file_are_read(tmp_path, beside):
    rows = [
        "OFF",
        "4 2 0",
        "0 0 0",
        "1 0 0",
        "1 1 0",
        "0 1 0",
        f"3 0 1 2 {beside}",
        f"3 0 2 3 {beside}",
    ]
    (tmp_path / "a.off").write_text("\n".join(rows) + "\n")
    assert loaded(tmp_path / "a.off").nodes[0].mesh.face_colors.tolist() == [[1, 0, 0, 1]] * 2


def test_normals_and_numbers_of_colours_of_an_off_file_are_named(tmp_path):
    rows = ["NOFF", "3 2 0", "0 0 0 0 0 1", "1 0 0 0 0 1", "0 1 0 0 0 1", "3 0 1 2 7", "3 0 2 1"]
    (tmp_path / "a.off").write_text("\n".join(rows) + "\n")
    with pytest.warns(LoadWarning) as said:
        rj.load(tmp_path / "a.off")
    assert said[0].message.left_out == {"normal of a vertex": 3, "colour of a face": 1}
