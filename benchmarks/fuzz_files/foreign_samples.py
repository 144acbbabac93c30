"""Small sound files of formats that packages of others read."""

from __future__ import annotations

import contextlib
import io
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz_files.samples import SIDE, Files, grid, rows_of

CUBE = np.array([[x, y, z] for z in (0.0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
"""Eight corners, as a hexahedron has them."""

PARTS = np.array([[0, 1, 3, 4], [1, 2, 3, 6], [1, 5, 4, 6], [3, 4, 6, 7], [1, 3, 4, 6]])
"""Tetrahedra that fill the cube."""

SURFACES = (
    "vtk", "vtu", "msh", "mesh", "meshb", "inp", "bdf", "nas", "fem", "avs", "tec", "dat", "vol",
    "mdpa", "post", "dato", "wkt", "xml", "med", "h5m", "hmf", "exo", "ex2", "e",
)  # fmt: skip
"""Formats of which meshio writes triangles."""

SOLIDS = ("f3grid", "su2", "ele", "node", "cgns")
"""Formats of which it writes tetrahedra alone."""

WRITTEN_AS: dict[str, dict[str, Any]] = {
    "msh text": {"file_format": "gmsh22", "binary": False},
    "msh ansys": {"file_format": "ansys", "binary": False},
    "vtk text": {"file_format": "vtk42", "binary": False},
    "vtu text": {"binary": False},
    "xdmf hdf": {"data_format": "HDF"},
}  # fmt: skip
"""Other ways in which a format is written, and what meshio calls them."""

PACKAGES = {
    **dict.fromkeys(("med", "h5m", "hmf", "cgns", "xdmf", "xmf", "xdmf hdf"), "h5py"),
    **dict.fromkeys(("exo", "ex2", "e"), "netCDF4"),
    **dict.fromkeys(("vtp", "vti", "vtr", "vts", "vtm", "vtk polydata"), "pyvista"),
    "urdf": "yourdfpy",
}
"""What some samples need beside meshio."""


def cells(name: str) -> Files:
    """Return a grid or a cube of tetrahedra as meshio writes it."""
    import meshio

    kind = name.partition(" ")[0]
    points, faces = grid()
    mesh = meshio.Mesh(points, [("triangle", faces)])
    if kind in SOLIDS:
        mesh = meshio.Mesh(CUBE, [("tetra", PARTS)])
    if name in ("vtk text", "vtu text"):
        mesh = _mixed()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        place = Path(folder, f"a.{kind}")
        with contextlib.redirect_stderr(io.StringIO()):
            mesh.write(place, **WRITTEN_AS.get(name, {}))
        beside = sorted(set(Path(folder).iterdir()) - {place})
        return {one.name: one.read_bytes() for one in (place, *beside)}


def _mixed() -> Any:
    """Return a mesh with a number for each point and cell, of cells of every kind that is shown."""
    import meshio

    points = np.concatenate([CUBE, CUBE[4:] + [0.0, 0.0, 1.0], [[0.5, 0.5, 3.0]]])
    blocks = [
        ("hexahedron", [[0, 1, 2, 3, 4, 5, 6, 7]]), ("wedge", [[4, 5, 6, 8, 9, 10]]),
        ("pyramid", [[8, 9, 10, 11, 12]]), ("tetra", [[4, 6, 7, 11]]),
        ("triangle", [[0, 5, 12], [1, 6, 12]]), ("quad", [[0, 2, 10, 8]]), ("line", [[0, 12]]),
    ]  # fmt: skip
    return meshio.Mesh(
        points, [(kind, np.array(rows)) for kind, rows in blocks],
        point_data={"height": points[:, 2]},
        cell_data={"number": [np.arange(len(rows)) * 1.5 for _, rows in blocks]},
    )  # fmt: skip


def ugrid() -> Files:
    """Return triangles, a quadrangle and a hexahedron as text."""
    faces = [[1, 2, 3], [1, 3, 4]]
    text = f"8 2 1 0 0 0 1\n{rows_of(CUBE)}{rows_of(np.array(faces))}1 3 7 5\n1\n1\n2\n"
    return {"a.ugrid": f"{text}1 2 3 4 5 6 7 8\n".encode()}


def xdmf(kind: str) -> Files:
    """Return the grid as XML."""
    vertices, faces = grid()
    items = [
        f'<DataItem Dimensions="{len(table)} 3" NumberType="{number}" Format="XML">'
        f"\n{rows_of(table)}</DataItem>"
        for table, number in ((vertices, "Float"), (faces, "Int"))
    ]
    return {
        f"a.{kind}": (
            '<Xdmf Version="3.0"><Domain><Grid Name="Grid">\n<Geometry GeometryType="XYZ">'
            f'{items[0]}</Geometry>\n<Topology TopologyType="Triangle" '
            f'NumberOfElements="{len(faces)}">{items[1]}</Topology>\n</Grid></Domain></Xdmf>\n'
        ).encode()
    }


def _vtk_rows(values: Any, kind: str, name: str = "", width: int = 1) -> str:
    """Return an array of a VTK file of XML."""
    numbers = " ".join(f"{x:g}" for x in np.asarray(values).reshape(-1))
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="ascii">'
        f"{numbers}</DataArray>\n"
    )


def _vtk_file(kind: str, inner: str) -> bytes:
    """Return a VTK file of XML."""
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" '
        f'byte_order="LittleEndian" header_type="UInt64">\n{inner}</VTKFile>\n'
    ).encode()


_HEIGHTS = '<PointData Scalars="height">{}</PointData>\n'


def vtp() -> Files:
    """Return a surface of VTK's."""
    vertices, faces = grid()
    offsets = 3 * np.arange(1, len(faces) + 1)
    inner = (
        f'<PolyData><Piece NumberOfPoints="{len(vertices)}" NumberOfVerts="0" NumberOfLines="1" '
        f'NumberOfStrips="0" NumberOfPolys="{len(faces)}">\n'
        + _HEIGHTS.format(_vtk_rows(vertices[:, 2], "Float64", "height"))
        + f"<Points>{_vtk_rows(vertices, 'Float64', 'Points', 3)}</Points>\n"
        + f"<Lines>{_vtk_rows([0, 5, 10], 'Int64', 'connectivity')}"
        + f"{_vtk_rows([3], 'Int64', 'offsets')}</Lines>\n"
        + f"<Polys>{_vtk_rows(faces, 'Int64', 'connectivity')}"
        + f"{_vtk_rows(offsets, 'Int64', 'offsets')}</Polys>\n</Piece></PolyData>\n"
    )
    return {"a.vtp": _vtk_file("PolyData", inner)}


_EXTENT = "0 3 0 3 0 0"
"""Of grids of 4 x 4 x 1 points."""


def vti() -> Files:
    """Return a grid of equal steps."""
    heights = _HEIGHTS.format(_vtk_rows(grid()[0][:, 2], "Float64", "height"))
    inner = (
        f'<ImageData WholeExtent="{_EXTENT}" Origin="0 0 0" Spacing="1 1 1">'
        f'<Piece Extent="{_EXTENT}">\n{heights}</Piece></ImageData>\n'
    )
    return {"a.vti": _vtk_file("ImageData", inner)}


def vtr() -> Files:
    """Return a grid of uneven steps."""
    heights = _HEIGHTS.format(_vtk_rows(grid()[0][:, 2], "Float64", "height"))
    steps = "".join(_vtk_rows(one, "Float64") for one in ([0, 1, 2, 4], [0, 1, 3, 4], [0]))
    inner = (
        f'<RectilinearGrid WholeExtent="{_EXTENT}"><Piece Extent="{_EXTENT}">\n{heights}'
        f"<Coordinates>{steps}</Coordinates></Piece></RectilinearGrid>\n"
    )
    return {"a.vtr": _vtk_file("RectilinearGrid", inner)}


def vts() -> Files:
    """Return a bent grid."""
    vertices = grid()[0]
    heights = _HEIGHTS.format(_vtk_rows(vertices[:, 2], "Float64", "height"))
    inner = (
        f'<StructuredGrid WholeExtent="{_EXTENT}"><Piece Extent="{_EXTENT}">\n{heights}'
        f"<Points>{_vtk_rows(vertices, 'Float64', 'Points', 3)}</Points></Piece>"
        "</StructuredGrid>\n"
    )
    return {"a.vts": _vtk_file("StructuredGrid", inner)}


def vtm() -> Files:
    """Return a file that names two others."""
    inner = (
        '<vtkMultiBlockDataSet><DataSet index="0" name="one" file="a.vtp"/>\n'
        '<DataSet index="1" name="two" file="a.vti"/></vtkMultiBlockDataSet>\n'
    )
    return {"a.vtm": _vtk_file("vtkMultiBlockDataSet", inner), **vtp(), **vti()}


def vtk_polydata() -> Files:
    """Return a surface as VTK wrote them first, with a strip, a line and a point."""
    vertices, faces = grid()
    text = f"# vtk DataFile Version 3.0\na grid\nASCII\nDATASET POLYDATA\nPOINTS {len(vertices)} "
    text += f"double\n{rows_of(vertices)}VERTICES 1 2\n1 3\nLINES 1 4\n3 0 5 10\n"
    text += f"POLYGONS {len(faces)} {4 * len(faces)}\n{rows_of(faces, '3 ')}"
    text += "TRIANGLE_STRIPS 1 5\n4 0 1 4 5\n"
    text += f"POINT_DATA {len(vertices)}\nSCALARS height double 1\nLOOKUP_TABLE default\n"
    return {"a.vtk": (text + rows_of(vertices[:, 2:])).encode()}


def cloud(kind: str, version: str = "1.2", form: int = 3) -> Files:
    """Return the vertices of the grid as points with colours."""
    import laspy

    stream, file = io.BytesIO(), laspy.create(point_format=form, file_version=version)
    file.x, file.y, file.z = grid()[0].T
    file.red = file.green = np.arange(SIDE * SIDE) * 4096
    file.write(stream, do_compress=kind == "laz")
    return {f"a.{kind}": stream.getvalue()}


def svg() -> Files:
    """Return a drawing of lines and curves."""
    return {
        "a.svg": b'<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L4 0 L4 3 Z"/>'
        b'<circle cx="2" cy="2" r="1"/><rect x="0" y="0" width="3" height="2"/></svg>'
    }


def dxf(has_curves: bool) -> Files:
    """Return a drawing of lines, a face, a point and a block in two places, or of curves too."""
    block = [0, "BLOCK", 8, 0, 2, "b", 70, 0, 10, 0.0, 20, 0.0, 0, "LINE", 8, 0, 10, 0.0, 20, 0.0,
             11, 2.0, 21, 0.0, 0, "ENDBLK", 8, 0]  # fmt: skip
    corners = [code for x, y in ((0, 0), (1, 0), (1, 1))
               for code in (0, "VERTEX", 8, 0, 10, float(x), 20, float(y))]  # fmt: skip
    drawn = [
        0, "LINE", 8, 0, 62, 1, 10, 0.0, 20, 0.0, 11, 1.0, 21, 1.0,
        0, "3DFACE", 8, 0, 10, 0.0, 20, 0.0, 30, 0.0, 11, 1.0, 21, 0.0, 31, 0.0,
        12, 1.0, 22, 1.0, 32, 0.0, 13, 0.0, 23, 1.0, 33, 1.0,
        0, "POINT", 8, 0, 10, 3.0, 20, 3.0,
        0, "INSERT", 8, 0, 2, "b", 10, 1.0, 20, 0.0, 0, "INSERT", 8, 0, 2, "b", 10, 2.0, 20, 0.0,
    ]  # fmt: skip
    if has_curves:
        drawn += [
            0, "ARC", 8, 0, 10, 0.0, 20, 0.0, 40, 2.0, 50, 0.0, 51, 90.0,
            0, "CIRCLE", 8, 0, 10, 5.0, 20, 0.0, 40, 1.0,
            0, "POLYLINE", 8, 0, 66, 1, 70, 1, *corners, 0, "SEQEND", 8, 0,
        ]  # fmt: skip
    codes = [0, "SECTION", 2, "BLOCKS", *block, 0, "ENDSEC",
             0, "SECTION", 2, "ENTITIES", *drawn, 0, "ENDSEC", 0, "EOF"]  # fmt: skip
    return {"a.dxf": "".join(f"{code}\n" for code in codes).encode()}


def urdf() -> Files:
    """Return a robot of a box and a mesh, whose joints a second one follows."""
    box = '<visual><geometry><box size="1 2 3"/></geometry><material name="m"/></visual>'
    mesh = '<visual><geometry><mesh filename="skin.obj" scale="1 2 1"/></geometry></visual>'
    links = f'<link name="a">{box}</link><link name="b">{mesh}</link><link name="c">{box}</link>'
    ends = '<parent link="a"/><child link="{}"/><limit lower="-1" upper="1"/>'
    return {
        "a.urdf": (
            f'<robot name="r"><material name="m"><color rgba="1 0.5 0 1"/></material>{links}'
            f'<joint name="j" type="revolute">{ends.format("b")}<axis xyz="0 0 1"/></joint>'
            f'<joint name="k" type="prismatic">{ends.format("c")}<mimic joint="j"/></joint></robot>'
        ).encode(),
        "skin.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    }


ALL = {
    **{name: lambda name=name: cells(name) for name in (*SURFACES, *SOLIDS)},
    **{name: lambda name=name: cells(name) for name in WRITTEN_AS if " " in name},
    "xdmf": lambda: xdmf("xdmf"), "xmf": lambda: xdmf("xmf"), "ugrid": ugrid,
    "vtp": vtp, "vti": vti, "vtr": vtr, "vts": vts, "vtm": vtm,
    "vtk polydata": vtk_polydata,
    "las": lambda: cloud("las"), "laz": lambda: cloud("laz"),
    "las new": lambda: cloud("las", "1.4", 7), "laz new": lambda: cloud("laz", "1.4", 7),
    "urdf": urdf, "svg": svg, "dxf": lambda: dxf(False), "dxf curves": lambda: dxf(True),
}  # fmt: skip

SAMPLES = {name: make for name, make in ALL.items() if find_spec(PACKAGES.get(name, "numpy"))}
"""What makes each sample that can be read with what is installed."""
