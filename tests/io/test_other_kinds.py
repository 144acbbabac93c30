"""A file that cannot be read is named, with what was expected, or what it is instead."""

from __future__ import annotations

import struct
import zipfile

import pytest

import rasterjit as rj

TRIANGLE = struct.pack("<9f3i", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
UCD = b"# a comment\n3 1 0 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n1 1 tri 1 2 3\n"
XAML = (
    b'<Viewport3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation"><GeometryModel3D>'
    b'<MeshGeometry3D Positions="0,0,0 1,0,0 0,1,0"/></GeometryModel3D></Viewport3D>'
)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.msh", struct.pack("<4i", 3, 0, 0, 1) + TRIANGLE, "is a mesh of MuJoCo; its name says"),
        ("a.mesh", b"\0\x10[MeshSerializer_v1.100]\n" + bytes(40), "is a mesh of OGRE; its name"),
        ("a.mesh", b'<mesh><sharedgeometry vertexcount="3"/></mesh>', "is a mesh of OGRE as XML"),
        ("a.inp", UCD, r"is a file of AVS UCD, which is read where it ends in \.avs"),
        ("a.xaml", XAML, "Normals is missing; expected XML with MeshGeometry3D elements"),
        ("a.3dxml", b"<a/>", "File is not a zip file; expected a ZIP archive whose Manifest"),
        ("a.svg", b'<svg><circle cx="0" r="1"/></svg>', "cy is missing; expected XML with an svg"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, name, content, said):
    pytest.importorskip("meshio")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(rj.MeshFileError, match=said) as error:
        rj.load(tmp_path / name)
    assert str(tmp_path / name) in str(error.value)


def test_what_trimesh_stumbles_over_is_said_to_be_damaged(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.3dxml", "w") as archive:
        archive.writestr("Manifest.xml", "<a/>")
    with pytest.raises(rj.MeshFileError, match=r"damaged or something else; expected a ZIP archiv"):
        rj.load(tmp_path / "a.3dxml")


@pytest.mark.parametrize("size", [39, 41])
def test_a_file_is_of_mujoco_only_if_it_is_as_long_as_it_says(tmp_path, size):
    pytest.importorskip("meshio")
    (tmp_path / "a.msh").write_bytes((struct.pack("<4i", 3, 0, 0, 1) + TRIANGLE)[:size])
    with pytest.raises(rj.MeshFileError) as error:
        rj.load(tmp_path / "a.msh")
    assert "MuJoCo" not in str(error.value)


def test_a_scene_that_reaches_too_far_is_said_to():
    mesh = rj.Mesh([[1e308, 0, 0], [-1e308, 1, 0], [0, 1e308, 0]], [[0, 1, 2]])
    with pytest.raises(ValueError, match=r"scene, .* finite distances.* what lies within .* of \["):
        rj.fit_camera(mesh)
