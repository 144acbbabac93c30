"""Elements of PLY files besides plain faces: strips, pictures, coordinates, other line ends."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning
from rasterjit.io.text.mesh_builder import triangulate_strips

XYZ = "property float x\nproperty float y\nproperty float z\n"
CORNERS = "property list uchar int vertex_indices\n"
SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def ply(folder, elements, *, comments="", ending="\n"):
    """Write a text file of elements: name, properties, rows."""
    head = "".join(
        f"element {name} {len(rows.splitlines())}\n{properties}"
        for name, properties, rows in elements
    )
    text = f"ply\nformat ascii 1.0\n{comments}{head}end_header\n"
    path = folder / "a.ply"
    path.write_bytes((text + "".join(one[2] for one in elements)).replace("\n", ending).encode())
    return path


def strip(folder, rows, *, kind="int", more=(), vertices=6):
    points = "".join(f"{n // 2} {n % 2} 0\n" for n in range(vertices))
    listed = ("tristrips", f"property list int {kind} vertex_indices\n", rows)
    return ply(folder, [("vertex", XYZ, points), listed, *more])


def only_mesh(path):
    (node,) = rj.load(path).nodes
    return node.mesh


def plain_triangles(corners):
    """Return the triangles of a strip, one after the other."""
    found, run = [], []
    for corner in corners:
        run = [] if corner == -1 else [*run, corner]
        if len(run) >= 3:
            a, b, c = run[-3:]
            found.append([a, b, c] if len(run) % 2 else [a, c, b])
    return found


@pytest.mark.parametrize(
    "rows",
    [
        "4 0 1 2 3\n", "6 0 1 2 3 4 5\n", "9 0 1 2 3 -1 2 3 4 5\n", "8 0 1 2 -1 1 3 2 4\n",
        "4 0 1 2 3\n5 4 3 2 1 0\n", "3 -1 -1 0\n5 -1 0 1 2 -1\n", "2 0 1\n3 3 4 5\n",
    ],
)  # fmt: skip
def test_strips_are_triangles_that_all_turn_the_same_way(tmp_path, rows):
    mesh = only_mesh(strip(tmp_path, rows))
    expected = [
        triangle
        for row in rows.splitlines()
        for triangle in plain_triangles(list(map(int, row.split()[1:])))
    ]
    points = np.array([[n // 2, n % 2, 0] for n in range(6)], float)
    assert mesh.vertices[mesh.faces].tolist() == points[np.array(expected)].tolist()


def test_a_restart_of_a_type_without_a_sign_is_its_largest_number(tmp_path):
    mesh = only_mesh(strip(tmp_path, "7 0 1 2 255 3 4 5\n", kind="uchar"))
    assert len(mesh.faces) == 2


def test_strips_stand_behind_faces_and_share_their_properties(tmp_path):
    colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    points = "".join(f"{n // 2} {n % 2} 0\n" for n in range(6))
    path = ply(
        tmp_path,
        [
            ("vertex", XYZ, points), ("face", CORNERS + colors, "3 0 1 2 255 0 0\n"),
            ("tristrips", CORNERS + colors, "4 2 3 4 5 0 0 255\n"),
        ],
    )  # fmt: skip
    mesh = only_mesh(path)
    assert mesh.face_colors[:, [0, 2]].tolist() == [[1, 0], [0, 1], [0, 1]]


@pytest.mark.parametrize("number", [6, 99, -2])
def test_a_strip_among_vertices_that_are_not_there_is_damaged(tmp_path, number):
    path = strip(tmp_path, f"4 0 1 2 {number}\n")
    with pytest.raises(rj.MeshFileError, match=r"damaged at line 16: .* below 6 in a face"):
        rj.load(path)


def test_strips_of_random_lengths_are_cut_as_one_by_one():
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 7, 40)
    corners, strips = triangulate_strips(counts)
    begins = np.cumsum(counts) - counts
    expected = [
        (triangle, number)
        for number, (begin, count) in enumerate(zip(begins.tolist(), counts.tolist(), strict=True))
        for triangle in plain_triangles(range(begin, begin + count))
    ]
    assert list(zip(corners.tolist(), strips.tolist(), strict=True)) == expected


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_lines_may_end_in_three_ways(tmp_path, ending):
    path = ply(tmp_path, [("vertex", XYZ, SQUARE), ("face", CORNERS, "4 0 1 2 3\n")], ending=ending)
    assert len(only_mesh(path).faces) == 2


@pytest.mark.parametrize("first", [b"\n", b"\r"])
def test_bytes_behind_a_head_whose_lines_end_in_cr_are_not_part_of_it(tmp_path, first):
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 1\n{XYZ}end_header\n"
    point = first + np.array([2.0, 3.0, 4.0], "<f4").tobytes()[1:]
    (tmp_path / "a.ply").write_bytes(head.replace("\n", "\r").encode() + point)
    assert (
        only_mesh(tmp_path / "a.ply").vertices[0].tolist() == np.frombuffer(point, "<f4").tolist()
    )


def picture(folder, name, color):
    Image.new("RGB", (2, 2), color).save(folder / name)


PAIRS = [("texture_u", "texture_v"), ("u", "v"), ("s", "t"), ("texture_s", "texture_t"),
         ("tex_u", "tex_v"), ("texcoord_u", "texcoord_v"), ("tu", "tv")]  # fmt: skip


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize(
    "comment",
    ["comment TextureFile a b.png", "comment texture: a b.png", "obj_info texturefile=a b.png"],
)
def test_a_picture_is_laid_by_coordinates_of_vertices(tmp_path, pair, comment):
    picture(tmp_path, "a b.png", "red")
    named = XYZ + "".join(f"property float {name}\n" for name in pair)
    rows = "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n"
    path = ply(
        tmp_path,
        [("vertex", named, rows), ("face", CORNERS, "4 0 1 2 3\n")],
        comments=comment + "\n",
    )
    mesh = only_mesh(path)
    assert mesh.material.base_color_texture.image[0, 0].tolist() == [1.0, 0.0, 0.0, 1.0]
    assert np.array_equal(mesh.uv, mesh.vertices[:, :2])


@pytest.mark.parametrize("name", ["texcoord", "texcoords", "texture_coordinates", "uv"])
def test_each_face_shows_the_picture_of_its_number(tmp_path, name):
    for file, color in (("a.png", "red"), ("b.png", "blue")):
        picture(tmp_path, file, color)
    properties = f"{CORNERS}property list uchar float {name}\nproperty int texnumber\n"
    rows = "3 0 1 2 6 0 0 1 0 1 1 1\n3 0 2 3 6 0 0 1 1 0 1 0\n"
    path = ply(
        tmp_path, [("vertex", XYZ, SQUARE), ("face", properties, rows)],
        comments="comment TextureFile a.png\ncomment TextureFile b.png\n",
    )  # fmt: skip
    first, second = (node.mesh for node in rj.load(path).nodes)
    shown = {
        tuple(one.material.base_color_texture.image[0, 0, [0, 2]].tolist()): one.vertices
        for one in (first, second)
    }
    assert [1.0, 0.0, 0.0] in shown[0.0, 1.0].tolist()
    assert [1.0, 0.0, 0.0] not in shown[1.0, 0.0].tolist()


def test_pictures_that_no_face_shows_are_named(tmp_path):
    square = [("vertex", XYZ, SQUARE), ("face", CORNERS, "4 0 1 2 3\n")]
    comments = "comment TextureFile a.png\ncomment TextureFile b.png\n"
    with pytest.warns(LoadWarning, match=r"texture file without texture coordinates \(2\)"):
        rj.load(ply(tmp_path, square, comments=comments))


def test_what_vertices_and_faces_have_besides_becomes_attributes(tmp_path):
    named = XYZ + "property float u\nproperty float red\n"
    rows = "0 0 0 1 2\n1 0 0 1 2\n1 1 0 1 2\n0 1 0 1 2\n"
    face = CORNERS + "property float nx\nproperty int quality\n"
    mesh = only_mesh(ply(tmp_path, [("vertex", named, rows), ("face", face, "4 0 1 2 3 5 6\n")]))
    assert set(mesh.vertex_attributes) == {"u", "red"}
    assert set(mesh.face_attributes) == {"nx", "quality"}


@pytest.mark.parametrize("case", [str.lower, str.upper, str.title])
@pytest.mark.parametrize("form", ["pcd", "ply"])
def test_names_of_values_mean_the_same_in_any_case(tmp_path, case, form):
    normals = ("nx", "ny", "nz") if form == "ply" else ("normal_x", "normal_y", "normal_z")
    names = [*map(case, ("x", "y", "z", *normals)), "T", "t"]
    rows = "".join(f"{n} {n + 1} {n + 2} 0 0 1 {n + 7} {n + 8}\n" for n in range(3))
    if form == "ply":
        path = ply(tmp_path, [("vertex", "".join(f"property float {n}\n" for n in names), rows)])
    else:
        each = {"SIZE": "4", "TYPE": "F", "COUNT": "1"}
        head = "".join(f"{key} {' '.join([one] * len(names))}\n" for key, one in each.items())
        path = tmp_path / "a.pcd"
        path.write_text(
            f"VERSION .7\nFIELDS {' '.join(names)}\n{head}WIDTH 3\nHEIGHT 1\nPOINTS 3\n"
            f"DATA ascii\n{rows}"
        )
    mesh = only_mesh(path)
    assert mesh.vertices.tolist() == [[0, 1, 2], [1, 2, 3], [2, 3, 4]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3
    # Each is alone, and means nothing.
    assert {name: mesh.attributes[name].ravel().tolist() for name in ("T", "t")} == {
        "T": [7, 8, 9], "t": [8, 9, 10],
    }  # fmt: skip


def test_pictures_and_corners_are_found_by_names_in_capitals(tmp_path):
    Image.new("RGB", (2, 2), "red").save(tmp_path / "skin.png")
    found = []
    for case in (str.lower, str.upper):
        properties = XYZ + f"property float {case('u')}\nproperty float {case('v')}\n"
        places = "".join(f"{row} {row[0]} {row[2]}\n" for row in SQUARE.splitlines())
        corners = f"property list uchar int {case('vertex_indices')}\n"
        elements = [("vertex", properties, places), ("face", corners, "4 0 1 2 3\n")]
        mesh = only_mesh(ply(tmp_path, elements, comments="comment TextureFile skin.png\n"))
        assert mesh.material.base_color_texture is not None
        found.append(mesh.uv.tolist())
    assert found[0] == found[1]
