"""Objects of PyVista, Open3D and meshio are drawn as they are, and files that these read."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene.color import srgb_to_linear

RNG = np.random.default_rng(26)
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
CUBE = np.array([[x, y, z] for z in (0.0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])


def only(what):
    """Load something, without a warning, and return its one mesh; objects can be added, too."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (node,) = rj.load(what).nodes
        added = node.mesh if isinstance(what, Path) else rj.Scene().add(what).mesh
    assert np.array_equal(added.vertices, node.mesh.vertices)
    return node.mesh


# Open3D, of which only what is read is made here


def open3d(kind, **values):
    """Return an object as Open3D has it."""
    return type(kind, (), {"__module__": "open3d.cpu.pybind.geometry", **values})()


def test_a_point_cloud_of_open3d_is_points():
    colors = RNG.integers(0, 256, (4, 3)) / 255.0
    normals = np.eye(4, 3) + [0, 0, 0.5]
    points = only(open3d("PointCloud", points=CORNERS, colors=colors, normals=normals))
    assert isinstance(points, rj.Points)
    codes = np.round(colors * 255).astype(np.uint8)
    assert np.array_equal(points.colors[:, :3], srgb_to_linear(codes))
    assert points.normals is not None
    bare = only(open3d("PointCloud", points=CORNERS, colors=np.zeros((0, 3)), normals=[]))
    assert (bare.colors, bare.normals) == (None, None)
    with pytest.raises(rj.MeshFileError, match="open3d PointCloud holds a point cloud of no poi"):
        rj.load(open3d("PointCloud", points=np.zeros((0, 3)), colors=[], normals=[]))


def test_points_of_a_depth_camera_that_are_nan_are_counted_in_objects_too():
    xyz = CORNERS.copy()
    xyz[2] = np.nan
    with pytest.warns(rj.LoadWarning, match=r"open3d PointCloud: left out point without a pos.*1"):
        (node,) = rj.load(open3d("PointCloud", points=xyz, colors=[], normals=[])).nodes
    assert node.mesh.invalid_vertices == 1


def test_lines_of_open3d_have_their_colours():
    lines = only(open3d("LineSet", points=CORNERS, lines=[[0, 1], [3, 1]], colors=np.eye(2, 3)))
    assert lines.segments.tolist() == [[0, 1], [3, 1]]
    assert lines.face_colors.tolist() == [[1, 0, 0, 1], [0, 1, 0, 1]]
    with pytest.raises(rj.MeshFileError, match="holds no lines"):
        rj.load(open3d("LineSet", points=CORNERS, lines=np.zeros((0, 2), int), colors=[]))


def triangles(**values):
    """Return a mesh of Open3D's."""
    said = {
        "vertices": CORNERS, "triangles": np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        "vertex_normals": [], "vertex_colors": [], "has_textures": lambda self: False,
    }  # fmt: skip
    return open3d("TriangleMesh", **{**said, **values})


def test_a_mesh_of_open3d_keeps_its_faces_and_normals():
    tilted = np.tile([0.6, 0.0, 0.8], (4, 1))
    mesh = only(triangles(vertex_normals=tilted, vertex_colors=CORNERS))
    assert np.array_equal(mesh.vertices, CORNERS)
    assert mesh.normals == pytest.approx(tilted)
    assert mesh.vertex_colors[2].tolist() == [1, 1, 0, 1]
    assert only(triangles()).normals[:, 2].tolist() == [1.0] * 4
    with pytest.warns(rj.LoadWarning, match="textures of a TriangleMesh"):
        rj.load(triangles(has_textures=lambda self: True))
    with pytest.raises(rj.MeshFileError, match="holds a mesh of 4 vertices, no faces"):
        rj.load(triangles(triangles=np.zeros((0, 3), int)))


def test_averaged_normals_of_a_box_do_not_round_its_edges():
    quads = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    faces = np.array([row for a, b, c, d in quads for row in ([a, b, c], [a, c, d])])
    mesh = only(triangles(vertices=CUBE, triangles=faces, vertex_normals=CUBE - 0.5))
    assert np.abs(mesh.normals).max(axis=1).tolist() == [1.0] * len(mesh.vertices)


class Tensor:
    """Values as Open3D's tensors have them."""

    def __init__(self, values):
        self.values = np.asarray(values)

    def numpy(self):
        return self.values


def test_geometries_of_open3d_of_tensors_keep_values_of_their_own():
    def cpu(self):
        return self

    xyz, heat = Tensor(CORNERS.astype(np.float32)), Tensor(np.arange(4.0).reshape(4, 1))
    cloud = open3d("PointCloud", point={"positions": xyz, "heat": heat}, cpu=cpu)
    assert only(cloud).attributes["heat"].tolist() == [[0], [1], [2], [3]]
    faces = {"indices": Tensor([[0, 1, 2]])}
    mesh = open3d("TriangleMesh", vertex={"positions": xyz}, triangle=faces, cpu=cpu)
    assert only(mesh).faces.tolist() == [[0, 1, 2]]
    pairs = {"indices": Tensor([[0, 1]])}
    lines = open3d("LineSet", point={"positions": xyz}, line=pairs, cpu=cpu)
    assert only(lines).segments.tolist() == [[0, 1]]


def test_other_objects_of_open3d_are_refused_by_name():
    said = "open3d VoxelGrid must be a TriangleMesh, a PointCloud or a LineSet"
    with pytest.raises(rj.MeshFileError, match=said):
        rj.render(open3d("VoxelGrid"))
    with pytest.raises(
        ValueError, match="max_bytes must not be given for an object of open3d, got 7"
    ):
        rj.load(open3d("VoxelGrid"), max_bytes=7)


# meshio


def cells(*blocks, points=CUBE, **values):
    """Return a mesh of meshio's."""
    meshio = pytest.importorskip("meshio")
    return meshio.Mesh(points, list(blocks), **values)


def test_a_solid_is_shown_by_its_outer_faces_which_look_outwards():
    two = np.concatenate([CUBE, CUBE[4:] + [0, 0, 1]])
    blocks = ("hexahedron", [[0, 1, 2, 3, 4, 5, 6, 7], [4, 5, 6, 7, 8, 9, 10, 11]])
    mesh = only(cells(blocks, points=two, cell_data={"number": [[3.0, 8.0]]}))
    assert len(mesh.faces) == 20
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) - [0.5, 0.5, 1.0]
    assert (np.einsum("ij,ij->i", normals, outwards) > 0).all()
    assert mesh.field.of_faces
    assert sorted(mesh.field.values.tolist()) == [3.0] * 10 + [8.0] * 10
    below = corners[mesh.field.values == 3.0]
    assert below[..., 2].max() == 1.0


@pytest.mark.parametrize(
    ("kind", "numbers", "count"),
    [
        ("tetra", [[0, 1, 2, 4]], 4),
        ("wedge", [[0, 2, 1, 4, 6, 5]], 8),
        ("pyramid", [[0, 1, 2, 3, 4]], 6),
        ("hexahedron", [list(range(8))], 12),
    ],
)
def test_every_kind_of_solid_is_closed_and_looks_outwards(kind, numbers, count):
    mesh = only(cells((kind, numbers)))
    assert len(mesh.faces) == count
    assert mesh.is_closed()
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = CUBE[numbers[0]].mean(axis=0)
    assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1) - middle) > 0).all()


def test_points_are_shown_by_their_first_scalar_and_keep_all():
    heat, flow = np.arange(8.0), RNG.random((8, 3))
    data = {"flow": flow, "same": np.ones(8), "heat": heat, "more": heat**2}
    mesh = only(cells(("quad", [[0, 1, 2, 3], [4, 5, 6, 7]]), point_data=data))
    assert not mesh.field.of_faces
    assert sorted(set(mesh.field.values.tolist())) == list(range(8))
    assert sorted(mesh.vertex_attributes) == ["flow", "heat", "more", "same"]


def test_scalars_with_nan_are_shown_and_are_no_attributes():
    data = {"heat": np.array([np.nan, *range(7)])}
    mesh = only(cells(("quad", [[0, 1, 2, 3], [4, 5, 6, 7]]), point_data=data))
    assert mesh.field.has_nan
    assert not mesh.vertex_attributes


def test_cells_of_every_kind_become_faces_lines_and_points():
    mixed = cells(("triangle6", [[0, 1, 2, 3, 4, 5]]), ("line3", [[0, 1, 2]]), ("vertex", [[7]]))
    scene = rj.load(mixed)
    assert [node.mesh.primitive for node in scene.nodes] == ["triangles", "lines", "points"]
    assert scene.nodes[2].mesh.vertices.tolist() == CUBE[[7]].tolist()
    assert scene.nodes[1].mesh.segments.tolist() == [[0, 2], [2, 1]]
    assert only(cells(("vertex", [[7], [2]]))).vertices.tolist() == CUBE[[7, 2]].tolist()
    assert len(only(cells())) == 8
    with pytest.warns(rj.LoadWarning, match=r"left out VTK_LAGRANGE_CURVE cell \(1\)"):
        rj.load(cells(("VTK_LAGRANGE_CURVE", [[0, 1, 2]]), ("vertex", [[7]])))
    for wrong in (9, -1):
        with pytest.raises(rj.MeshFileError, match=f"cells of points from 0 to 7, got {wrong}"):
            rj.load(cells(("triangle", [[0, 1, wrong]])))


@pytest.mark.parametrize(
    ("kind", "count"), [("triangle", 4), ("tetra", 3), ("line3", 2), ("quad8", 4), ("vertex", 2)]
)
def test_cells_have_the_points_of_their_kind(kind, count):
    with pytest.raises(rj.MeshFileError, match=rf"\d points in each {kind} cell, got {count}"):
        rj.load(cells((kind, [list(range(count))])))


def test_vertex_cells_at_corners_of_others_are_not_drawn_again():
    scene = rj.load(cells(("triangle", [[0, 1, 2]]), ("vertex", [[1], [5]])))
    assert [node.mesh.primitive for node in scene.nodes] == ["triangles", "points"]
    assert len(scene.nodes[1].mesh.vertices) == 1


@pytest.mark.parametrize("kind", ["tetra", "hexahedron"])
def test_faces_that_are_sides_of_solids_are_drawn_once(kind):
    solid = [[0, 1, 3, 4]] if kind == "tetra" else [list(range(8))]
    sides = [[3, 0, 1], [4, 1, 0]] if kind == "tetra" else [[0, 1, 2, 3], [7, 6, 5, 4]]
    inside = [[0, 2, 5]]
    face = "triangle" if kind == "tetra" else "quad"
    alone = only(cells((kind, solid)))
    mixed = only(cells((face, sides), (kind, solid), ("triangle", inside)))
    assert len(mixed.faces) == len(alone.faces) + 1
    assert mixed.is_closed() == (len(mixed.faces) == len(alone.faces))


def test_values_of_sides_of_solids_and_sets_of_cells_are_named():
    mesh = cells(
        ("quad", [[0, 1, 2, 3]]), ("hexahedron", [list(range(8))]),
        cell_data={"ref": [[4.0], [5.0]]}, point_sets={"left": [0, 3]},
        cell_sets={"all": [[0], [0]]},
    )  # fmt: skip
    with pytest.warns(rj.LoadWarning) as said:
        rj.load(mesh)
    assert said[0].message.left_out == {
        "point sets": 1, "cell sets": 1, "values of a face that is a side of a solid": 1,
    }  # fmt: skip


STRIP = """<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">
<UnstructuredGrid><Piece NumberOfPoints="6" NumberOfCells="1"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="ascii">
0 0 0 0 1 0 1 0 0 1 1 0 2 0 0 2 1 0</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3 4 5</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">6</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">6</DataArray></Cells></Piece>
</UnstructuredGrid></VTKFile>
"""


def test_cells_that_meshio_drops_are_named(tmp_path, monkeypatch):
    (tmp_path / "a.vtu").write_text(STRIP)
    monkeypatch.setattr("rasterjit.io.foreign.readers.find_spec", lambda name: None)
    with pytest.warns(rj.LoadWarning, match=r"cells that meshio cannot handle \(type 6\)"):
        rj.load(tmp_path / "a.vtu", isolate=False)


def test_strips_of_a_vtu_file_are_triangles(tmp_path):
    pytest.importorskip("pyvista")
    (tmp_path / "a.vtu").write_text(STRIP)
    corners = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0], [2, 1, 0]])
    found = only(tmp_path / "a.vtu")
    expected = [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]
    at = [[corners.tolist().index(place.tolist()) for place in face]
          for face in found.vertices[found.faces]]  # fmt: skip
    assert sorted(map(rolled, at)) == sorted(map(rolled, expected))


def rolled(face):
    """Return the corners of a face, the least first, which turns as before."""
    first = face.index(min(face))
    return face[first:] + face[:first]


@pytest.mark.parametrize("extension", ["vtk", "vtu"])
def test_files_that_only_pyvista_reads_say_so(tmp_path, monkeypatch, extension):
    (tmp_path / f"a.{extension}").write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET ODD\n")
    monkeypatch.setattr("rasterjit.io.foreign.readers.find_spec", lambda name: None)
    with pytest.raises(rj.MeshFileError, match="PyVista may read it: pip install pyvista"):
        rj.load(tmp_path / f"a.{extension}", isolate=False)


@pytest.mark.parametrize("extension", ["vtu", "vtk", "msh", "inp", "su2", "mesh"])
def test_files_that_meshio_writes_are_read(tmp_path, extension):
    mesh = cells(("hexahedron", [list(range(8))]))
    path = tmp_path / f"a.{extension}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mesh.write(path)
        found = only(path)
    assert len(found.faces) == 12
    assert found.bounds()[1].tolist() == [1, 1, 1]


def test_values_of_a_vtu_file_are_kept(tmp_path):
    mesh = cells(("quad", [[0, 1, 2, 3]]), point_data={"heat": np.arange(8.0)},
                 cell_data={"part": [[4.0]]})  # fmt: skip
    mesh.write(tmp_path / "a.vtu")
    found = only(tmp_path / "a.vtu")
    assert sorted(found.field.values.tolist()) == list(range(8))
    assert found.face_attributes["part"].tolist() == [[4], [4]]


def test_files_that_are_none_say_so(tmp_path, capfd):
    pytest.importorskip("meshio")
    (tmp_path / "a.vtu").write_text("<VTKFile")
    with pytest.raises(rj.MeshFileError, match=r"a\.vtu could not be read as \.vtu: "):
        rj.load(tmp_path / "a.vtu")
    assert capfd.readouterr() == ("", "")


def test_what_no_package_reads_names_the_way_out(tmp_path, monkeypatch):
    from rasterjit.io.foreign import readers

    monkeypatch.setattr(readers, "find_spec", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "meshio", None)
    for name, said in (("a.vtu", r"pip install 'rasterjit\[vtk\]'"), ("a.vtp", "install pyvista")):
        (tmp_path / name).write_text("<VTKFile>")
        with pytest.raises(rj.MeshFileError, match=said):
            rj.load(tmp_path / name, isolate=False)


# PyVista


def test_a_surface_of_pyvista_is_shown_by_its_active_scalars():
    pv = pytest.importorskip("pyvista")
    ball = pv.Sphere()
    ball["height"] = ball.points[:, 2]
    mesh = only(ball)
    assert len(mesh.faces) == ball.n_cells
    assert np.array_equal(mesh.vertices, ball.points)
    assert np.array_equal(mesh.field.values, ball["height"])
    ball.cell_data["number"] = np.arange(ball.n_cells)
    ball.set_active_scalars("number")
    mesh = only(ball)
    assert mesh.field.values.tolist() == list(range(ball.n_cells))
    assert list(mesh.vertex_attributes) == ["height"]
    assert list(mesh.face_attributes) == ["number"]


@pytest.mark.parametrize("of_points", [True, False])
def test_active_scalars_of_pyvista_keep_their_name(of_points):
    pv = pytest.importorskip("pyvista")
    ball = pv.Sphere(theta_resolution=5, phi_resolution=5)
    data = ball.point_data if of_points else ball.cell_data
    data["perm"] = np.arange(ball.n_points if of_points else ball.n_cells, dtype=float)
    ball.set_active_scalars("perm")
    mesh = only(ball)
    assert mesh.scalar_attributes == ("perm",)
    assert mesh.with_scalars("perm").field.values.tolist() == mesh.field.values.tolist()


def test_polygons_and_strips_of_pyvista_keep_the_values_of_their_cells():
    pv = pytest.importorskip("pyvista")
    surface = pv.PolyData(CORNERS, faces=[4, 0, 1, 2, 3, 3, 0, 1, 2])
    surface.cell_data["part"] = [5.0, 7.0]
    assert only(surface).field.values.tolist() == [5, 5, 7]
    strip = pv.PolyData(CORNERS, strips=[4, 0, 1, 3, 2])
    mesh = only(strip)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert normals[:, 2].tolist() == [1, 1]


def test_lines_and_points_of_pyvista_are_drawn_as_such():
    pv = pytest.importorskip("pyvista")
    lines = only(pv.PolyData(CORNERS, lines=[3, 0, 1, 2, 2, 3, 0]))
    assert lines.segments.tolist() == [[0, 1], [1, 2], [3, 0]]
    cloud = pv.PolyData(CORNERS)
    cloud["rgb"] = np.eye(4, 3, dtype=np.uint8) * 255
    cloud.set_active_scalars("rgb")
    points = only(cloud)
    assert points.colors[1].tolist() == [0, 1, 0, 1]
    assert isinstance(only(pv.PointSet(CORNERS)), rj.Points)


def test_streamlines_and_isosurfaces_of_pyvista_are_drawn_with_their_scalars():
    pv = pytest.importorskip("pyvista")
    field = pv.Wavelet().compute_derivative(gradient="slope")
    lines = field.streamlines("slope", n_points=9, source_radius=8.0, max_length=40)
    lines.set_active_scalars("RTData")
    scene = rj.Scene()
    scene.add(lines)
    scene.add(field.contour([130.0, 200.0], scalars="RTData"))
    shown = [node.mesh for node in scene.nodes]
    assert [mesh.primitive for mesh in shown] == ["lines", "triangles"]
    assert len(shown[0].vertices) == lines.n_points
    assert np.array_equal(shown[0].field.values, lines["RTData"])
    assert shown[1].field.range == pytest.approx((130.0, 200.0))
    frame = rj.render(scene, size=(80, 60), outputs="object_id", threads=1)
    assert {0, 1} <= set(np.unique(frame.object_id))


def test_grids_of_pyvista_are_shown_by_their_surface_and_blocks_by_name():
    pv = pytest.importorskip("pyvista")
    grid = pv.ImageData(dimensions=(3, 3, 3))
    grid["heat"] = np.arange(27.0)
    mesh = only(grid)
    assert len(mesh.faces) == 48
    assert mesh.field.values.max() == 26
    blocks = pv.MultiBlock({"ball": pv.Sphere(), "none": None, "dots": pv.PolyData(CORNERS)})
    assert [node.name for node in rj.load(blocks).nodes] == ["ball", "dots"]
    with pytest.raises(rj.MeshFileError, match="pyvista PolyData holds no faces, lines or points"):
        rj.load(pv.PolyData())


@pytest.mark.parametrize("name", ["a.vtp", "a.vtk", "a.vtm"])
def test_files_of_vtk_that_meshio_does_not_read_go_through_pyvista(tmp_path, name):
    pv = pytest.importorskip("pyvista")
    ball = pv.Sphere()
    (pv.MultiBlock([ball]) if name == "a.vtm" else ball).save(tmp_path / name)
    assert len(only(tmp_path / name).faces) == ball.n_cells


GRID = """# vtk DataFile Version 3.0
a grid
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 5 double
0 0 0 1 0 0 1 1 0 0 1 0 0 0 1
CELLS 2 {size}
{cells}
CELL_TYPES 2
{types}
"""


@pytest.mark.parametrize(
    ("cells", "types", "said"),
    [
        ("3 0 1 2 2 0 4", "5 14", "5 points in each Pyramid cell, got 2"),
        ("4 0 1 2 3 3 0 1 4", "5 7", "3 points in each Triangle cell, got 4"),
        ("3 0 1 2 3 0 1 7", "5 7", "points from 0 to 4, got 7"),
        ("3 0 1 2 3 0 1 -1", "7 5", "points from 0 to 4, got -1"),
    ],
)
def test_cells_that_vtk_would_read_beyond_are_refused(tmp_path, cells, types, said):
    pytest.importorskip("pyvista")
    (tmp_path / "a.vtk").write_text(GRID.format(size=len(cells.split()), cells=cells, types=types))
    with pytest.raises(rj.MeshFileError, match=f"(?i){said}"):
        rj.load(tmp_path / "a.vtk")


def test_what_vtk_says_of_a_file_that_it_reads_in_part_is_told(tmp_path):
    pytest.importorskip("pyvista")
    text = GRID.format(size=9, cells="3 0 1 2 4 0 1 2 3", types="5 7")
    (tmp_path / "a.vtk").write_text(text + "ODD 1\nPOINT_DATA 5\nSCALARS heat float\n")
    with pytest.warns(rj.LoadWarning, match=r"left out what VTK says: .*odd.* \(1\)"):
        scene = rj.load(tmp_path / "a.vtk")
    assert len(scene.nodes[0].mesh.faces) == 3
