"""Files of every format in which something is planted that no reader shows."""

from __future__ import annotations

import base64
import json
import struct
import zipfile

import numpy as np
import pytest

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
PLY_HEAD = (
    "ply\nformat ascii 1.0\n"
    "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\n"
)
PLACES = "0 0 0\n1 0 0\n0 1 0\n"


def text(name, content):
    def write(folder):
        (folder / name).write_text(content)
        return folder / name

    return write


def binary_stl(folder):
    corners = struct.pack("<12f", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0)
    path = folder / "a.stl"
    path.write_bytes(b" " * 80 + struct.pack("<I", 2) + (corners + struct.pack("<H", 7)) * 2)
    return path


def mtl(folder):
    (folder / "a.mtl").write_text("newmtl m\nmap_Bump a.png\nodd 1\n")
    return text("a.obj", f"mtllib a.mtl\nusemtl m\n{TRIANGLE}")(folder)


def pcd(folder):
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\n"
    return text("a.pcd", f"{head}VIEWPOINT 1 2 3 1 0 0 0\nPOINTS 1\nDATA ascii\n0 0 0\n")(folder)


def las(folder):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.vlrs.append(laspy.VLR("someone", 7, "odd", b"abc"))
    data = laspy.LasData(header)
    data.x = data.y = data.z = np.arange(3.0)
    data.write(folder / "a.las")
    return folder / "a.las"


def binvox(folder):
    head = b"#binvox 1\ndim 1 1 1\nodd 3\ntranslate 0 0 0\nscale 1\ndata\n"
    (folder / "a.binvox").write_bytes(head + b"\1\1")
    return folder / "a.binvox"


def gltf(folder, **more):
    """Write a triangle with an attribute, an entry and an extension that nobody knows."""
    data = base64.b64encode(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()).decode()
    part = {"attributes": {"POSITION": 0, **more.pop("attributes", {})}}
    part |= more.pop("primitive", {})
    header = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [part, part]}],
        "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{data}"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}], **more,
    }  # fmt: skip
    path = folder / "a.gltf"
    path.write_text(json.dumps(header))
    return path


def dxf(folder):
    ezdxf = pytest.importorskip("ezdxf")
    document = ezdxf.new()
    space = document.modelspace()
    space.add_line((0, 0), (1, 1))
    for _ in range(3):
        space.add_hatch()
    document.saveas(folder / "a.dxf")
    return folder / "a.dxf"


def svg(folder):
    pytest.importorskip("svg.path")
    begin = '<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L4 0 L4 3 Z"/>'
    return text("a.svg", f"{begin}<text>a</text><text>b</text></svg>")(folder)


def urdf(folder):
    """Write a robot of two links with a joint of six freedoms and an element nobody knows."""
    pytest.importorskip("yourdfpy")
    shape = '<visual><geometry><sphere radius="1"/></geometry></visual>'
    joint = '<joint name="j" type="floating"><parent link="a"/><child link="b"/></joint>'
    links = f'<link name="a">{shape}</link><link name="b"/>'
    return text("a.urdf", f'<robot name="r">{links}{joint}<odd/></robot>')(folder)


def threemf(folder):
    """Write a triangle with a slice stack, which is another way to say what it is."""
    core, slices = (
        f"http://schemas.microsoft.com/3dmanufacturing/{name}"
        for name in ("core/2015/02", "slice/2015/07")
    )
    corners = "".join(f'<vertex x="{a}" y="{b}" z="0"/>' for a, b in ((0, 0), (1, 0), (0, 1)))
    content = (
        f'<model unit="millimeter" xmlns="{core}" xmlns:s="{slices}"><resources>'
        f'<s:slicestack id="1"/><object id="9"><mesh><vertices>{corners}</vertices><triangles>'
        '<triangle v1="0" v2="1" v3="2"/></triangles></mesh></object></resources>'
        '<build><item objectid="9"/></build></model>'
    )
    with zipfile.ZipFile(folder / "a.3mf", "w") as package:
        package.writestr("3D/3dmodel.model", content)
    return folder / "a.3mf"


def collada(folder):
    """Write a triangle with an animation."""
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("collada")
    trimesh.Trimesh(np.eye(3), [(0, 1, 2)]).export(folder / "a.dae")
    content = (folder / "a.dae").read_text()
    moving = "<library_animations><animation/></library_animations><library_geometries>"
    (folder / "a.dae").write_text(content.replace("<library_geometries>", moving))
    return folder / "a.dae"


def cells(name, *further, **more):
    def write(folder):
        meshio = pytest.importorskip("meshio")
        points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
        mesh = meshio.Mesh(points, [("triangle", [[0, 1, 2]]), *further], **more)
        if name is None:
            return mesh
        mesh.write(folder / name)
        return folder / name

    return write


PLANTED = {
    "obj": (text("a.obj", f"{TRIANGLE}surf 0\nsurf 1\n"), {"surface": 2}),
    "obj, unknown": (
        text("a.obj", f"{TRIANGLE}odd 0\n"), {"lines of no known kind, first line 5: 'odd 0'": 1}
    ),
    "mtl": (mtl, {"map_Bump of material 'm'": 1, "odd of material 'm'": 1}),
    "ply": (
        text(
            "a.ply", f"{PLY_HEAD}element odd 2\nproperty int a\nend_header\n{PLACES}3 0 1 2\n7\n8\n"
        ),
        {"element 'odd'": 2},
    ),
    "ply of points": (
        text(
            "a.ply", PLY_HEAD.replace("face 1", "face 0")
            + f"element odd 2\nproperty int a\nend_header\n{PLACES}7\n8\n",
        ),
        {"element 'odd'": 2},
    ),
    "off": (
        text("a.off", "NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2 9\n"),
        {"normal of a vertex": 3, "colour of a face": 1},
    ),
    "stl": (binary_stl, {"colour or attribute of a triangle": 2}),
    "stl as text": (
        text(
            "a.stl", "solid a\nmaterial red\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n"
            "vertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
        ),
        {"lines of no known kind, first line 2: 'material red'": 1},
    ),
    "xyz": (text("a.xyz", "x y z a a\n0 0 0 1 2\n1 0 0 1 2\n"), {"second column 'a'": 1}),
    "pcd": (pcd, {"viewpoint": 1}),
    "las": (las, {"record of 'someone'": 1}),
    "binvox": (binvox, {"line 'odd' of its head": 1}),
    "gltf, extension": (
        lambda folder: gltf(folder, primitive={"extensions": {"ODD_thing": {}}}),
        {"extension ODD_thing": 2},
    ),
    "gltf, attribute": (
        lambda folder: gltf(folder, attributes={"COLOR_1": 0}), {"attribute 'COLOR_1'": 2}
    ),
    "gltf, entry": (lambda folder: gltf(folder, odd=[1]), {"entry 'odd'": 1}),
    "urdf": (urdf, {"motion of the floating joint 'j'": 1, "odd of a robot": 1}),
    "3mf": (threemf, {"slicestack of a model": 1}),
    "dae": (collada, {"animation": 1}),
    "dxf": (dxf, {"HATCH entity": 3}),
    "svg": (svg, {"text element": 2}),
    "object of meshio": (
        lambda folder: cells(None, field_data={"odd": np.array([1, 2])})(folder), {"field data": 1}
    ),
    "vtu": (
        cells("a.vtu", ("VTK_LAGRANGE_CURVE", [[0, 1, 2]])), {"VTK_LAGRANGE_CURVE cell": 1}
    ),
}  # fmt: skip
