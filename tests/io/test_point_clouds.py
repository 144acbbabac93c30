"""Point clouds load as points: what each format says of them, and what is refused."""

from __future__ import annotations

import struct
import warnings

import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.io.point_clouds.pcd import unpack_lzf
from rasterjit.io.primitives import choose_point_size
from rasterjit.scene.color import srgb_to_linear

RNG = np.random.default_rng(24)
COUNT = 60
XYZ = RNG.random((COUNT, 3)).astype(np.float32)
CODES = RNG.integers(0, 256, (COUNT, 3), np.uint8)
NORMALS = RNG.normal(size=(COUNT, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
HEAT = RNG.random(COUNT).astype(np.float32)
LINEAR = srgb_to_linear(CODES)


def only(path, **options):
    """Load a file, without a warning, and return its points."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (node,) = rj.load(path, **options).nodes
    assert isinstance(node.mesh, rj.Points)
    return node.mesh


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


# PLY


PLY_HEAD = """ply
format {form} 1.0
element vertex {count}
property float x
property float y
property float z
property float nx
property float ny
property float nz
property uchar red
property uchar green
property uchar blue
property float heat
end_header
"""


def ply_rows(order):
    """Return the rows of a binary file."""
    kind = np.dtype([("p", f"{order}f4", 3), ("n", f"{order}f4", 3), ("c", "u1", 3),
                     ("h", f"{order}f4")])  # fmt: skip
    rows = np.zeros(COUNT, kind)
    rows["p"], rows["n"], rows["c"], rows["h"] = XYZ, NORMALS, CODES, HEAT
    return rows.tobytes()


def ply(form):
    """Return a file of points."""
    head = PLY_HEAD.format(form=form, count=COUNT).encode()
    if form != "ascii":
        return head + ply_rows("<" if "little" in form else ">")
    lines = (
        " ".join([*map(repr, map(float, (*p, *n))), *map(str, c), repr(float(h))])
        for p, n, c, h in zip(XYZ, NORMALS.astype(np.float32), CODES, HEAT, strict=True)
    )
    return head + "\n".join(lines).encode() + b"\n"


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_points_of_a_ply_file_keep_all_their_properties(tmp_path, form):
    points = only(write(tmp_path / "a.ply", ply(form)))
    assert np.array_equal(points.vertices, XYZ)
    assert np.array_equal(points.colors[:, :3], LINEAR)
    assert points.normals == pytest.approx(NORMALS, abs=1e-6)
    assert np.array_equal(points.attributes["heat"][:, 0], HEAT)


def test_a_ply_file_of_an_independent_library_is_read(tmp_path):
    plyfile = pytest.importorskip("plyfile")
    rows = np.zeros(COUNT, [("x", "f8"), ("y", "f8"), ("z", "f8"), ("heat", "f4")])
    for axis, name in enumerate("xyz"):
        rows[name] = XYZ[:, axis]
    rows["heat"] = HEAT
    vertex = plyfile.PlyElement.describe(rows, "vertex")
    plyfile.PlyData([vertex], byte_order=">").write(str(tmp_path / "a.ply"))
    points = only(tmp_path / "a.ply")
    assert np.array_equal(points.vertices, XYZ)
    assert np.array_equal(points.attributes["heat"][:, 0], HEAT)


def test_edges_of_a_ply_file_without_faces_are_lines(tmp_path):
    head = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement edge 2\nproperty int vertex1\nproperty int vertex2\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
        "0 0 0\n1 0 0\n1 1 0\n"
    )
    scene = rj.load(write(tmp_path / "a.ply", head + "0 1 255 0 0\n2 1 0 0 255\n"))
    lines = scene.nodes[0].mesh
    assert lines.segments.tolist() == [[0, 1], [2, 1]]
    assert lines.face_colors.tolist() == [[1, 0, 0, 1], [0, 0, 1, 1]]
    with pytest.raises(rj.MeshFileError, match="expected numbers of vertices below 3 in an edge"):
        rj.load(write(tmp_path / "b.ply", head + "0 1 255 0 0\n2 9 0 0 255\n"))


# Rows of numbers


def rows(*columns, separator=" ", head=""):
    """Return lines of numbers."""
    table = np.column_stack(columns).astype(np.float64)
    return head + "".join(separator.join(f"{v:.9g}" for v in row) + "\n" for row in table)


@pytest.mark.parametrize(
    ("name", "text", "has"),
    [
        ("a.xyz", rows(XYZ), ()),
        ("a.asc", rows(XYZ, HEAT), ("heat",)),
        ("a.txt", rows(XYZ, CODES), ("colors",)),
        ("a.xyz", rows(XYZ, NORMALS), ("normals",)),
        ("a.xyzn", rows(XYZ, NORMALS), ("normals",)),
        ("a.xyzrgb", rows(XYZ, CODES / 255.0), ("colors",)),
        ("a.csv", rows(XYZ, CODES, separator=",", head="X,Y,Z,Red,Green,Blue\n"), ("colors",)),
        ("a.csv", rows(XYZ, HEAT, separator=";", head='"x";"y";"z";"intensity"\n'), ("heat",)),
        ("a.csv", rows(XYZ, HEAT, separator=";").replace(".", ","), ("heat",)),
        ("a.csv", rows(HEAT, XYZ, separator=", ", head="intensity, x, y, z\n"), ("heat",)),
        ("a.pts", rows(XYZ, HEAT, CODES, head=f"{COUNT}\n"), ("heat", "colors")),
        ("a.pts", rows(XYZ, CODES, head=f"{COUNT}\r\n").replace("\n", "\r\n"), ("colors",)),
        ("a.txt", rows(XYZ, CODES, HEAT, head="# a\n// b\n\n"), ("heat", "colors")),
        ("a.txt", rows(XYZ, CODES, NORMALS, separator="\t"), ("colors", "normals")),
        ("a.txt", rows(XYZ, NORMALS, CODES), ("colors", "normals")),
    ],
)
def test_rows_of_numbers_are_what_their_number_and_values_say(tmp_path, name, text, has):
    points = only(write(tmp_path / name, text))
    assert points.vertices == pytest.approx(XYZ, abs=1e-7)
    assert (points.colors is not None and points.field is None) == ("colors" in has)
    if "colors" in has:
        assert np.array_equal(points.colors[:, :3], LINEAR)
    assert (points.normals is not None) == ("normals" in has)
    if "normals" in has:
        assert points.normals == pytest.approx(NORMALS, abs=1e-6)
    assert list(points.attributes) == (["intensity"] if "heat" in has else [])
    if "heat" in has:
        assert points.attributes["intensity"][:, 0] == pytest.approx(HEAT, abs=1e-7)
        assert (points.field is not None) == (has == ("heat",))


def test_columns_of_no_known_meaning_are_attributes(tmp_path):
    points = only(write(tmp_path / "a.csv", "x,y,z,label,Depth\n0,0,0,3,7\n1,0,0,4,8\n"))
    assert points.attributes["label"].tolist() == [[3], [4]]
    huge = write(tmp_path / "a.pts", "0 0 0 1 60 1e308 0\n1 0 0 1 60 60 0\n")
    with pytest.raises(rj.LoadWarning, match="left out attribute 'column 6'"):
        only(huge)
    assert points.attributes["depth"].tolist() == [[7], [8]]
    points = only(write(tmp_path / "b.txt", "0 0 0 300 9\n1 0 0 -4 8\n"))
    assert points.attributes["column 4"].tolist() == [[300], [-4]]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.xyz", "", "must be a file, but .* is empty"),
        ("a.xyz", "# nothing\n", "holds a point cloud of no points"),
        ("a.xyz", "1 2\n3 4\n", r"rows of 3 numbers or more, x y z \.\.\., got '1 2' at line 1"),
        ("a.xyz", "0 0 0\n1 1\n", r"damaged at line 2: expected 3 numbers of a point, got '1 1'"),
        ("a.xyz", "0 0 0\n1 1 x\n", "damaged at line 2: expected 3 numbers"),
        ("a.xyz", "0 0 0\n1 1 1 1\n", "damaged at line 2: expected 3 numbers"),
        ("a.pts", "3\n0 0 0 1\n1 1 1 1\n", "expected 3 points, as its first line says, got 2"),
        ("a.xyz", "3\nwater\nO 0 0 0\n", "rows of points below the number of them"),
        ("a.csv", "a,b,c\n1,2,3\n", "names with x, y and z among them, got 'a b c'"),
        ("a.asc", "ncols 4\nnrows 5\n1 2 3 4\n", "holds a grid of heights, no points"),
        ("a.xyz", "nan nan nan\n", "of 1 points, none of which has a finite position"),
        ("a.xyz", "0 0 0\ninf 0 0\n", "1 of 2 at infinity; on_invalid='drop' leaves them out"),
    ],
)
def test_rows_that_are_no_points_are_refused(tmp_path, name, text, said):
    with pytest.raises(rj.MeshFileError, match=said):
        rj.load(write(tmp_path / name, text))


def test_damaged_rows_may_be_left_out(tmp_path):
    path = write(tmp_path / "a.xyz", "0 0 0\n1 1\n2 2 2\n")
    with pytest.warns(rj.LoadWarning, match="what is damaged, first line 2"):
        (node,) = rj.load(path, on_damage="warn").nodes
    assert node.mesh.vertices.tolist() == [[0, 0, 0], [2, 2, 2]]


# PCD


PCD_HEAD = """# .PCD v0.7
VERSION 0.7
FIELDS x y z rgb normal_x normal_y normal_z _ heat
SIZE 4 4 4 4 4 4 4 1 4
TYPE F F F F F F F U F
COUNT 1 1 1 1 1 1 1 4 1
WIDTH {width}
HEIGHT {height}
VIEWPOINT 0 0 0 1 0 0 0
POINTS {count}
DATA {form}
"""
PACKED = (CODES.astype(np.uint32) << np.array([16, 8, 0], np.uint32)).sum(1, dtype=np.uint32)


def lzf(data):
    """Pack bytes: runs of zeros as references to the byte before them, all others as they are."""
    packed, at = bytearray(), 0
    while at < len(data):
        run = 0
        while run < 200 and at and data[at - 1 : at] == data[at + run : at + run + 1]:
            run += 1
        if run >= 9:
            packed += bytes([7 << 5, run - 9, 0])
            at += run
        elif run >= 3:
            packed += bytes([(run - 2) << 5, 0])
            at += run
        else:
            packed += bytes([0, data[at]])
            at += 1
    return bytes(packed)


def pcd(form, count=COUNT, xyz=XYZ):
    """Return a file of points, 4 rows high."""
    head = PCD_HEAD.format(width=count // 4, height=4, count=count, form=form).encode()
    columns = [*xyz.T.astype("<f4"), PACKED.astype("<u4").view("<f4"),
               *NORMALS.T.astype("<f4")]  # fmt: skip
    if form == "ascii":
        padding = np.zeros((COUNT, 4))
        table = np.column_stack([*columns[:3], PACKED.view("f4"), *columns[4:], padding, HEAT])
        lines = (" ".join(f"{float(v):.9g}" for v in row) for row in table)
        return head + "\n".join(lines).encode() + b"\n"
    kind = np.dtype([*((f"f{n}", "<f4") for n in range(7)), ("pad", "u1", 4), ("h", "<f4")])
    table = np.zeros(COUNT, kind)
    for number, column in enumerate(columns):
        table[f"f{number}"] = column
    table["h"] = HEAT
    if form == "binary":
        return head + table.tobytes()
    data = b"".join(np.ascontiguousarray(table[name]).tobytes() for name in kind.names)
    packed = lzf(data)
    return head + struct.pack("<II", len(packed), len(data)) + packed


@pytest.mark.parametrize("form", ["ascii", "binary", "binary_compressed"])
def test_points_of_a_pcd_file_keep_all_their_fields(tmp_path, form):
    points = only(write(tmp_path / "a.pcd", pcd(form)))
    assert np.array_equal(points.vertices.astype(np.float32), XYZ)
    assert np.array_equal(points.colors[:, :3], LINEAR)
    assert points.normals == pytest.approx(NORMALS, abs=1e-6)
    assert list(points.attributes) == ["heat"]
    assert points.attributes["heat"][:, 0] == pytest.approx(HEAT, rel=1e-6)


def test_points_that_a_depth_camera_did_not_measure_are_counted_and_keep_their_numbers(tmp_path):
    xyz = XYZ.copy()
    xyz[[2, 9, 40]] = np.nan
    path = write(tmp_path / "a.pcd", pcd("binary", xyz=xyz))
    with pytest.warns(rj.LoadWarning, match=r"left out point without a position \(NaN\) \(3\)"):
        (node,) = rj.load(path).nodes
    assert len(node.mesh) == COUNT
    assert node.mesh.invalid_vertices == 3
    assert np.array_equal(node.mesh.vertices[3], xyz[3])
    xyz[5] = np.inf
    write(path, pcd("binary", xyz=xyz))
    with pytest.warns(rj.LoadWarning, match=r"point at infinity \(1\)"):
        rj.load(path, on_invalid="drop")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data.replace(b"DATA binary", b"DATA packed"), "DATA must be ascii, binary"),
        (
            lambda data: data.replace(b"POINTS 60", b"POINTS 61"),
            "POINTS must be WIDTH times HEIGHT",
        ),
        (lambda data: data.replace(b"SIZE 4 4", b"SIZE 4 3"), "field 'y' must be of a known type"),
        (lambda data: data.replace(b"SIZE 4 4", b"SIZE 4"), "must be as many, got 9, 8, 9 and 9"),
        (lambda data: data.replace(b"FIELDS x", b"FIELDS w"), "must have the fields x, y and z"),
        (lambda data: data.replace(b"VERSION", b"EDITION"), "line 2: expected one of VERSION"),
        (lambda data: data[:100], "its head has no DATA"),
        (lambda data: data[:-50], "expected 60 points, as its head says, got room for"),
    ],
)
def test_damaged_pcd_files_say_what_is_wrong(tmp_path, change, said):
    with pytest.raises(rj.MeshFileError, match=said):
        rj.load(write(tmp_path / "a.pcd", change(pcd("binary"))))


def test_lzf_refers_back_and_repeats():
    assert unpack_lzf(bytes([2, *b"abc", (2 << 5), 2, 0, ord("!")]), 8) == b"abcabca!"
    assert unpack_lzf(bytes([0, 7, 7 << 5, 10, 0]), 20) == bytes([7] * 20)
    for packed, size in ((b"\x20\x05", 3), (b"\x05ab", 6), (b"\x00a", 2), (b"\xe0", 9)):
        with pytest.raises(ValueError, match="it "):
            unpack_lzf(packed, size)


# LAS


def las(path, change=None, version="1.2"):
    """Write a file with laspy."""
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    header = laspy.LasHeader(point_format=3, version=version)
    header.offsets, header.scales = [500_000.0, 5_400_000.0, 100.0], [0.001] * 3
    header.add_extra_dim(laspy.ExtraBytesParams("heat", np.float32))
    data = laspy.LasData(header)
    data.x, data.y, data.z = (XYZ.astype(np.float64) + header.offsets).T
    data.red, data.green, data.blue = CODES.T.astype(np.uint16) * 257
    data.classification = np.arange(COUNT) % 5
    data["heat"] = HEAT
    if change is not None:
        change(data)
    data.write(str(path))
    return path


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_points_of_a_las_file_keep_places_to_the_millimetre_and_what_differs(tmp_path, name):
    points = only(las(tmp_path / name))
    wanted = np.round(XYZ.astype(np.float64), 3) + [500_000.0, 5_400_000.0, 100.0]
    assert np.abs(points.vertices - wanted).max() < 1.5e-3
    assert len(np.unique(points.vertices[:, 1])) > COUNT // 2
    assert np.array_equal(points.colors[:, :3], LINEAR)
    assert sorted(points.attributes) == ["classification", "heat"]


def test_heights_of_a_las_file_are_up(tmp_path):
    assert rj.load(las(tmp_path / "a.las")).up == (0.0, 0.0, 1.0)
    assert rj.load(write(tmp_path / "a.pcd", pcd("binary"))).up is None


def test_points_of_a_las_file_without_colours_are_shown_by_their_intensity(tmp_path):
    def change(data):
        data.red[:], data.green[:], data.blue[:] = 0, 0, 0
        data.intensity = np.arange(COUNT)

    points = only(las(tmp_path / "a.las", change))
    assert points.field is not None
    assert points.field.values.tolist() == list(range(COUNT))


def test_a_las_file_without_its_package_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "laspy", None)
    said = r"a\.laz: reading \.laz needs a package .* pip install 'rasterjit\[clouds\]'"
    with pytest.raises(rj.MeshFileError, match=said):
        rj.load(write(tmp_path / "a.laz", b"LASF"))


def test_las_files_that_are_cut_short_are_refused(tmp_path):
    whole = las(tmp_path / "a.las").read_bytes()
    with pytest.raises(rj.MeshFileError, match="expected 60 points, as its head says"):
        rj.load(write(tmp_path / "b.las", whole[:-100]))
    packed = las(tmp_path / "a.laz").read_bytes()
    with pytest.raises(rj.MeshFileError, match=r"c\.laz could not be read as \.laz"):
        rj.load(write(tmp_path / "c.laz", packed[:-300]))


def said_of(content, place, count, form="<I"):
    """Return a file whose head says at a place that there are so many of something."""
    changed = bytearray(content)
    struct.pack_into(form, changed, place, count)
    return bytes(changed)


@pytest.mark.parametrize(
    ("name", "version", "place", "what"),
    [
        ("a.las", "1.2", 100, "records"), ("a.laz", "1.2", 100, "records"),
        ("a.las", "1.4", 243, "records behind its points"), ("a.laz", "1.4", 100, "records"),
        ("a.laz", "1.2", None, "chunks of points"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("count", [1000, 2**32 - 1])
def test_counts_that_the_bytes_of_a_las_file_cannot_hold_are_refused_unread(
    tmp_path, monkeypatch, name, version, place, what, count
):
    laspy = pytest.importorskip("laspy")
    content = las(tmp_path / name, version=version).read_bytes()
    if place is None:
        table = struct.unpack_from("<q", content, struct.unpack_from("<I", content, 96)[0])[0]
        place, count = table + 4, max(count, len(content))
    monkeypatch.setattr(laspy, "open", None)
    said = f"{name} is damaged: its head says {count} {what}, but it has room for "
    with pytest.raises(rj.MeshFileError, match=said):
        rj.load(write(tmp_path / name, said_of(content, place, count)), isolate=False)


def test_a_laz_file_that_was_written_without_going_back_is_read(tmp_path):
    content = las(tmp_path / "a.laz").read_bytes()
    points = struct.unpack_from("<I", content, 96)[0]
    table = content[points : points + 8]
    content = said_of(content, points, -1, "<q") + table
    assert len(only(write(tmp_path / "b.laz", content)).vertices) == COUNT
    at = struct.unpack("<q", table)[0] + 4
    with pytest.raises(rj.MeshFileError, match="its head says 4294967295 chunks of points"):
        rj.load(write(tmp_path / "c.laz", said_of(content, at, 2**32 - 1)))


# All


def outcome(path):
    """Return the scene of a file, or what the error says about it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return rj.load(path)
        except rj.MeshFileError as error:
            return str(error)


def test_no_cut_of_a_file_ends_in_anything_but_an_error_that_names_it(tmp_path):
    files = {"ply": ply("binary_little_endian"), "pcd": pcd("binary_compressed"),
             "xyz": rows(XYZ).encode(), "pts": rows(XYZ, CODES, head="60\n").encode()}  # fmt: skip
    for extension, whole in files.items():
        for length in RNG.integers(0, len(whole) - 1, 25).tolist():
            path = write(tmp_path / f"a.{extension}", whole[:length])
            found = outcome(path)
            if isinstance(found, rj.Scene):
                # Rows of numbers may end behind any digit.
                assert extension == "xyz"
                assert len(found.nodes[0].mesh) <= COUNT
            else:
                assert str(path) in found


def test_bytes_of_a_pcd_file_may_be_anything(tmp_path):
    whole = bytearray(pcd("binary_compressed"))
    for _ in range(60):
        data = bytearray(whole)
        for at in RNG.integers(0, len(data), 8).tolist():
            data[at] = int(RNG.integers(0, 256))
        found = outcome(write(tmp_path / "a.pcd", bytes(data)))
        assert isinstance(found, rj.Scene) or "a.pcd" in found


def test_a_cloud_takes_no_more_memory_than_it_may(tmp_path):
    head = PCD_HEAD.format(width=10**12 // 4, height=4, count=10**12, form="binary")
    with pytest.raises(ValueError, match="max_bytes"):
        rj.load(write(tmp_path / "a.pcd", head))
    with pytest.raises(ValueError, match="max_bytes"):
        rj.load(write(tmp_path / "a.xyz", rows(XYZ)), max_bytes=2000)


def test_a_cloud_of_places_alone_is_grey_on_white_paper(tmp_path):
    points = only(write(tmp_path / "a.xyz", rows(XYZ)))
    assert points.material == rj.Points(XYZ).material
    frame = rj.render(points, size=(64, 48), outputs=("linear", "face_id"), background="white")
    assert frame.linear[frame.face_id >= 0].max(axis=0) == pytest.approx([0.2, 0.2, 0.2, 1.0])


def test_large_clouds_have_small_points():
    sizes = [
        choose_point_size(count)
        for count in (1, 10, 100, 1000, 100_000, 160_001, 444_000, 500_000, 10**8)
    ]
    assert sizes == [12, 12, 6, 3, 3, 2, 2, 1, 1]


def test_a_point_cloud_of_trimesh_keeps_its_colours():
    cloud = trimesh.PointCloud(XYZ, colors=CODES)
    (node,) = rj.load(cloud).nodes
    assert np.array_equal(node.mesh.vertices, XYZ)
    assert np.array_equal(node.mesh.colors[:, :3], LINEAR)
    scene = rj.Scene()
    assert scene.add(cloud).mesh.primitive == "points"


def test_points_of_an_obj_file_are_those_named_or_all_if_it_has_nothing_else(tmp_path):
    vertices = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\n"
    points = only(write(tmp_path / "a.obj", vertices))
    assert points.colors.tolist() == [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]]
    points = only(write(tmp_path / "b.obj", f"{vertices}p 3 1\np -2\n"))
    assert points.vertices.tolist() == [[0, 1, 0], [0, 0, 0], [1, 0, 0]]
    with pytest.raises(rj.MeshFileError, match="line 4: expected vertices among 3 v, got 'p 4'"):
        rj.load(write(tmp_path / "c.obj", f"{vertices}p 4\n"))
