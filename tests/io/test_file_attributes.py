"""Attributes of PLY and glTF files, and of trimesh's meshes, go with their vertices and faces."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import trimesh
from sample_models import Model, quad
from test_text_formats import CORNERS, XYZ, as_binary, ply, write

import rasterjit as rj
from rasterjit.io.load_warnings import LeftOut, LoadWarning
from rasterjit.io.primitives import Context
from rasterjit.io.text.mesh_builder import MeshData, build_scene
from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget

HEAT = [*XYZ, "float heat"]
HOT = [f"{corner} {heat}" for corner, heat in zip(CORNERS, (0.5, 1.5, 2.5, 3.5), strict=True)]
FACE = "property list uchar int vertex_indices\n"


def loaded(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (node,) = rj.load(path, **options).nodes
    return node.mesh


def at_corners(mesh, name="heat"):
    """Return an attribute at each corner of each face, with where that is."""
    return mesh.vertices[mesh.faces], mesh.vertex_attributes[name][mesh.faces][..., 0]


def by_place(mesh):
    """Return the heat of each corner as its place tells it."""
    x, y, _ = np.moveaxis(mesh.vertices[mesh.faces], 2, 0)
    return np.where(y == 0, np.where(x == 0, 0.5, 1.5), np.where(x == 1, 2.5, 3.5))


@pytest.mark.parametrize("order", ["text", "<", ">"])
def test_properties_of_a_ply_become_attributes(tmp_path, order):
    text = ply(HEAT, HOT, ["4 0 1 2 3"])
    content = text if order == "text" else as_binary(text, order)
    mesh = loaded(write(tmp_path, "ply", content))
    assert list(mesh.vertex_attributes) == ["heat"]
    assert mesh.vertex_attributes["heat"].shape == (len(mesh.vertices), 1)
    np.testing.assert_array_equal(at_corners(mesh)[1], by_place(mesh))
    frame = rj.render(mesh, size=(24, 18), outputs=("attribute:heat", "face_id"))
    assert 0.5 <= np.nanmin(frame.attribute("heat")) < 1.0
    assert 3.0 < np.nanmax(frame.attribute("heat")) <= 3.5


def test_properties_of_faces_stay_with_their_triangles(tmp_path):
    face = f"{FACE}property int label\nproperty list uchar float more\n"
    text = ply(XYZ, CORNERS, ["4 0 1 2 3 7 1 0.5", "3 0 1 2 -2 0"], face=face)
    with pytest.warns(rj.LoadWarning, match="'more' of several lengths"):
        mesh = rj.load(write(tmp_path, "ply", text)).nodes[0].mesh
    assert list(mesh.face_attributes) == ["label"]
    # Triangles come before the halves of quadrangles.
    assert mesh.face_attributes["label"].tolist() == [[-2.0], [7.0], [7.0]]
    assert not mesh.vertex_attributes


def test_as_many_vertices_as_faces_change_nothing_of_a_ply(tmp_path):
    face = f"{FACE}property int label\n"
    faces = ["3 0 1 2 1", "3 0 2 3 2", "3 0 1 3 3", "3 1 2 3 4"]
    mesh = loaded(write(tmp_path, "ply", ply(XYZ, CORNERS, faces, face=face)), crease_angle=180.0)
    assert len(mesh.vertices) == len(mesh.faces) == 4
    assert mesh.face_attributes["label"][:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert not mesh.vertex_attributes


def test_attributes_follow_vertices_that_are_split_for_uv_or_normals(tmp_path):
    face = f"{FACE}property list uchar float texcoord\n"
    faces = ["3 0 1 2 6 0 0 1 0 1 1", "3 0 2 3 6 0.5 0 1 1 0 1"]
    mesh = loaded(write(tmp_path, "ply", ply(HEAT, HOT, faces, face=face)))
    assert len(mesh.vertices) > 4
    np.testing.assert_array_equal(at_corners(mesh)[1], by_place(mesh))
    normals = [
        f"{row} {n}" for row, n in zip(HOT, ("0 0 1", "0 0 1", "0 0 1", "0 0 0"), strict=True)
    ]
    some = [*HEAT, "float nx", "float ny", "float nz"]
    text = ply(some, normals, ["3 0 1 2 1", "3 0 2 3 2"], face=f"{FACE}property int label\n")
    with pytest.warns(LoadWarning, match="normals of length 0"):
        (node,) = rj.load(write(tmp_path, "ply", text)).nodes
    mesh = node.mesh
    np.testing.assert_array_equal(at_corners(mesh)[1], by_place(mesh))
    assert mesh.face_attributes["label"].tolist() == [[1.0], [2.0]]


@pytest.mark.parametrize("wrong", ["nan", "inf", "1e300"])
def test_what_no_float32_holds_is_named_and_left_out(tmp_path, wrong):
    rows = [f"{row} {value}" for row, value in zip(HOT, (1, wrong, 2, 3), strict=True)]
    path = write(tmp_path, "ply", ply([*HEAT, "double far"], rows, ["4 0 1 2 3"]))
    with pytest.warns(LoadWarning, match="attribute 'far' with NaN, infinity or what no float32"):
        (node,) = rj.load(path).nodes
    assert list(node.mesh.vertex_attributes) == ["heat"]


def test_attributes_count_in_the_memory_that_a_file_may_take():
    places, faces = np.eye(4)[:, :3], np.array([[0, 1, 2], [0, 2, 3]])
    own = {"attributes": {"a": np.zeros((4, 500))}, "face_attributes": {"b": np.zeros((2, 1000))}}
    for name in own:
        part = MeshData("part", places, faces, **{name: own[name]})
        rest = "a.ply", "raise", 30.0, LeftOut()
        with pytest.raises(FileSizeError, match="part"):
            build_scene([part], Context(*rest, MemoryBudget("a.ply", 20_000)))
        (node,) = build_scene([part], Context(*rest, MemoryBudget("a.ply", 40_000))).nodes
        assert len(node.mesh.vertex_attributes) + len(node.mesh.face_attributes) == 1


# glTF


def model(**attributes):
    found = Model()
    found.add(quad(-1, -1, 1, 1) | attributes, found.material())
    return found


def test_attributes_of_a_gltf_begin_with_an_underscore(tmp_path):
    heat = np.array([[0.5, 1.0], [1.5, 2.0], [2.5, 3.0], [3.5, 4.0]], np.float32)
    path = model(_HEAT=heat, _n=np.arange(4, dtype=np.float32)[:, np.newaxis])
    mesh = loaded(path.save(tmp_path / "a.glb"))
    assert list(mesh.vertex_attributes) == ["HEAT", "n"]
    np.testing.assert_array_equal(mesh.vertex_attributes["HEAT"], heat)
    np.testing.assert_array_equal(mesh.vertex_attributes["n"][:, 0], [0, 1, 2, 3])
    frame = rj.render(mesh, size=(12, 9), outputs="attribute:HEAT")
    assert frame.attribute("HEAT").shape == (9, 12, 2)


def test_attributes_of_a_gltf_without_normals_are_those_of_its_corners(tmp_path):
    found, heat = Model(), np.array([[0.5], [1.5], [2.5], [3.5]], np.float32)
    arrays = {"POSITION": np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1, 0]]), "_heat": heat}
    found.add(arrays, found.material())
    mesh = loaded(found.save(tmp_path / "a.glb"), crease_angle=0.0)
    assert len(mesh.vertices) == 6
    np.testing.assert_array_equal(at_corners(mesh)[1], by_place(mesh))


def test_attributes_of_a_gltf_that_do_not_fit_are_left_out(tmp_path):
    for values, said in (
        (np.zeros((3, 1), np.float32), "attribute 'HEAT', which is not a number for each vertex"),
        (np.full((4, 1), np.nan, np.float32), "attribute 'HEAT' with NaN"),
    ):
        path = model(_HEAT=values).save(tmp_path / "a.glb")
        with pytest.warns(LoadWarning, match=said):
            (node,) = rj.load(path).nodes
        assert not node.mesh.vertex_attributes
    broken = model(_HEAT=np.zeros((4, 1), np.float32))
    accessor = broken.glb._document["meshes"][0]["primitives"][0]["attributes"]
    accessor["_HEAT"] = 99
    with pytest.warns(LoadWarning, match="_HEAT of mesh 'mesh 0', which cannot be read"):
        (node,) = rj.load(broken.save(tmp_path / "b.glb")).nodes
    assert len(node.mesh.faces) == 2


# trimesh


def test_attributes_of_trimesh_go_along(cube):
    heat, label = np.arange(8.0), np.arange(12)
    source = trimesh.Trimesh(
        cube.vertices, cube.faces, process=False, vertex_attributes={"heat": heat},
        face_attributes={"label": label, "turn": np.tile(np.eye(3), (12, 1, 1))},
    )  # fmt: skip
    source.vertex_attributes["tag"] = np.array(list("abcdefgh"))
    names = "attribute:heat", "attribute:label", "attribute:turn", "face_id"
    with pytest.warns(LoadWarning, match="attribute 'tag', which is not a number"):
        frame = rj.render(source, size=(24, 18), outputs=names)
    seen = frame.face_id >= 0
    assert seen.any()
    np.testing.assert_array_equal(frame.attribute("label")[seen][:, 0], frame.face_id[seen])
    assert (frame.attribute("turn")[seen] == np.eye(3).ravel()).all()
    assert np.nanmin(frame.attribute("heat")) >= 0.0
    assert np.nanmax(frame.attribute("heat")) <= 7.0
