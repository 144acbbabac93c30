"""Small sound files of every format, with those that they name: what mutations start from."""

from __future__ import annotations

import bz2
import io
import json
import struct
import tarfile
import zipfile
from collections.abc import Callable

import numpy as np
from PIL import Image

Files = dict[str, bytes]
"""Contents by name; the first is the one that is opened."""

SIDE = 4
"""Vertices along a side of the grid that most samples hold."""


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices, (16, 3), of a bent square, and its triangles, (18, 3)."""
    rows, columns = np.indices((SIDE, SIDE)).reshape(2, -1)
    vertices = np.stack([columns, rows, (rows * columns % 3) * 0.25], axis=1).astype(np.float64)
    first = (SIDE * np.arange(SIDE - 1)[:, None] + np.arange(SIDE - 1)).reshape(-1, 1)
    faces = first + np.array([0, 1, SIDE + 1, 0, SIDE + 1, SIDE])
    return vertices, faces.reshape(-1, 3)


def coordinates() -> np.ndarray:
    """Return texture coordinates of the grid's vertices, (16, 2)."""
    return grid()[0][:, :2] / (SIDE - 1)


def rows_of(table: np.ndarray, lead: str = "") -> str:
    """Return numbers as lines of text."""
    return "".join(f"{lead}{' '.join(f'{x:g}' for x in row)}\n" for row in table)


def picture(kind: str = "PNG", size: tuple[int, int] = (6, 5)) -> bytes:
    """Return a picture's file."""
    pixels = np.arange(size[0] * size[1] * 3, dtype=np.uint32) * 37 % 256
    image = Image.fromarray(pixels.astype(np.uint8).reshape(size[1], size[0], 3))
    stream = io.BytesIO()
    image.save(stream, kind)
    return stream.getvalue()


def obj() -> Files:
    """Return an OBJ file of triangles and quadrangles with two materials and a picture."""
    vertices, faces = grid()
    text = "# a grid\nmtllib a.mtl\no grid\n" + rows_of(vertices, "v ")
    text += rows_of(coordinates(), "vt ") + "vn 0 0 1\nvn 0.6 0 0.8\ng first\nusemtl red\ns 1\n"
    for a, b, c in (faces[:10] + 1).tolist():
        text += f"f {a}/{a}/1 {b}/{b}/2 {c}/{c}/1\n"
    text += "g second\nusemtl skin\ns off\nf -1/-1/-1 -2/-2/-1 -6/-6/-2 -5/-5/-1\n"
    for a, b, c in (faces[10:] + 1).tolist():
        text += f"f {a}/{a}/2 {b}/{b}/1 \\\n {c}/{c}/1\n"
    library = "newmtl red\nKd 0.8 0.1 0.1\nKs 0.5 0.5 0.5\nNs 20\nd 0.5\nillum 2\n\n"
    library += "newmtl skin\nKa 0 0 0\nKd 1 1 1\nTr 0.25\nmap_Kd -s 1 1 1 skin.png\n"
    return {"a.obj": text.encode(), "a.mtl": library.encode(), "skin.png": picture()}


def obj_plain() -> Files:
    """Return an OBJ file of positions with colours, without materials."""
    vertices, faces = grid()
    colored = np.hstack([vertices, np.abs(np.sin(vertices))])
    text = rows_of(colored, "v ") + rows_of(faces + 1, "f ") + "f 1 2 6 7 5\n"
    return {"a.obj": text.encode()}


PLY_VERTEX = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
PLY_COLORS = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))


def _ply_head(order: str, vertices: int, faces: int) -> str:
    return (
        f"ply\nformat {order} 1.0\ncomment made up\nelement vertex {vertices}\n{PLY_VERTEX}"
        f"{PLY_COLORS}element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )


def ply_text() -> Files:
    """Return a text PLY file with normals and colours, and a quadrangle."""
    vertices, faces = grid()
    text = _ply_head("ascii", len(vertices), len(faces) + 1)
    for x, y, z in vertices.tolist():
        text += f"{x:g} {y:g} {z:g} 0 0.6 0.8 {int(x) * 60} {int(y) * 60} 9\n"
    return {"a.ply": (text + rows_of(faces, "3 ") + "4 0 1 5 4\n").encode()}


def ply_binary(order: str) -> Files:
    """Return a binary PLY file, ``"little"`` or ``"big"`` end first, with a quadrangle."""
    vertices, faces = grid()
    mark = "<" if order == "little" else ">"
    content = _ply_head(f"binary_{order}_endian", len(vertices), len(faces) + 1).encode()
    for x, y, z in vertices.tolist():
        content += struct.pack(f"{mark}6f3B", x, y, z, 0.0, 0.6, 0.8, int(x) * 60, int(y) * 60, 9)
    for face in [*faces.tolist(), [0, 1, 5, 4]]:
        content += struct.pack(f"{mark}B{len(face)}i", len(face), *face)
    return {"a.ply": content}


def stl_text() -> Files:
    """Return a text STL file of two solids."""
    vertices, faces = grid()
    text = ""
    for name, part in (("one", faces[:9]), ("two", faces[9:])):
        text += f"solid {name}\n"
        for corners in vertices[part]:
            loop = rows_of(corners, "vertex ")
            text += f"facet normal 0 0 1\nouter loop\n{loop}endloop\nendfacet\n"
        text += f"endsolid {name}\n"
    return {"a.stl": text.encode()}


def stl_binary() -> Files:
    """Return a binary STL file."""
    vertices, faces = grid()
    content = b"made up".ljust(80) + struct.pack("<I", len(faces))
    for corners in vertices[faces]:
        content += struct.pack("<12fH", 0.0, 0.0, 1.0, *corners.reshape(-1).tolist(), 0)
    return {"a.stl": content}


def off() -> Files:
    """Return an OFF file with comments and a quadrangle."""
    vertices, faces = grid()
    text = f"OFF # a grid\n{len(vertices)} {len(faces) + 1} 0\n\n{rows_of(vertices)}"
    return {"a.off": f"{text}{rows_of(faces, '3 ')}4 0 1 5 4 0.5 0.5 0.5\n".encode()}


def _gltf_parts() -> tuple[dict, bytes]:
    """Return the header and the buffer of a glTF scene."""
    vertices, faces = grid()
    normals = np.tile(np.float32([0.0, 0.6, 0.8]), (len(vertices), 1))
    blocks = [
        (vertices.astype("<f4"), 5126, "VEC3"), (normals, 5126, "VEC3"),
        (coordinates().astype("<f4"), 5126, "VEC2"), (faces.astype("<u2"), 5123, "SCALAR"),
    ]  # fmt: skip
    views, accessors, buffer = [], [], b""
    for array, kind, shape in blocks:
        content = array.tobytes()
        count = array.size if shape == "SCALAR" else len(array)
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(content)})
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": kind, "count": count, "type": shape}
        )
        buffer += content.ljust(-(-len(content) // 4) * 4, b"\0")
    accessors[0] |= {"min": vertices.min(0).tolist(), "max": vertices.max(0).tolist()}
    png = picture()
    views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(png)})
    buffer += png.ljust(-(-len(png) // 4) * 4, b"\0")
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}
    light = {"type": "spot", "color": [1, 0.9, 0.8], "intensity": 40, "range": 20,
             "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}}  # fmt: skip
    header = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 2, 3]}],
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform"],
        "extensions": {"KHR_lights_punctual": {"lights": [light]}},
        "nodes": [
            {"mesh": 0, "name": "grid", "children": [1], "translation": [0, 0, 1]},
            {"mesh": 1, "rotation": [0, 0, 0.6, 0.8], "scale": [1, 2, 1]},
            {"camera": 0, "translation": [1, 1, 9]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 0, 5]},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
        "meshes": [
            {"name": "first", "primitives": [
                {"attributes": attributes, "indices": 3, "material": 0}
            ]},
            {"primitives": [{"attributes": {"POSITION": 0}, "indices": 3, "mode": 4},
                            {"attributes": {"POSITION": 0}, "mode": 5, "material": 1}]},
        ],
        "materials": [
            {"name": "skin", "alphaMode": "MASK", "alphaCutoff": 0.1, "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0, "extensions": {
                    "KHR_texture_transform": {"scale": [2, 2], "offset": [0.1, 0]}}},
                "metallicFactor": 0.2, "roughnessFactor": 0.6}},
            {"doubleSided": True, "emissiveFactor": [0.1, 0.2, 0.3]},
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071, "magFilter": 9729, "minFilter": 9987}],
        "images": [{"bufferView": 4, "mimeType": "image/png"}],
        "buffers": [{"byteLength": len(buffer)}],
        "bufferViews": views, "accessors": accessors,
    }  # fmt: skip
    return header, buffer


def glb_of(header: bytes, buffer: bytes) -> bytes:
    """Return a binary glTF file."""
    header = header.ljust(-(-len(header) // 4) * 4)
    chunks = struct.pack("<I4s", len(header), b"JSON") + header
    chunks += struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def glb() -> Files:
    """Return a binary glTF file with textures, two nodes, a camera and a light."""
    header, buffer = _gltf_parts()
    return {"a.glb": glb_of(json.dumps(header).encode(), buffer)}


def gltf() -> Files:
    """Return a glTF file with its buffer and picture beside it."""
    header, buffer = _gltf_parts()
    header["buffers"][0]["uri"] = "a.bin"
    header["images"] = [{"uri": "skin.png"}]
    return {"a.gltf": json.dumps(header).encode(), "a.bin": buffer, "skin.png": picture()}


def xaml() -> Files:
    """Return a XAML file."""
    vertices, faces = grid()
    numbers = [" ".join(f"{x:g}" for x in table.reshape(-1)) for table in (vertices, faces)]
    normals = " ".join(["0 0 1"] * len(vertices))
    return {"a.xaml": (
        '<Viewport3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation">\n'
        "<ModelVisual3D><ModelVisual3D.Content><GeometryModel3D>\n<GeometryModel3D.Material>"
        '<DiffuseMaterial><DiffuseMaterial.Brush><SolidColorBrush Color="#804020" Opacity="1"/>'
        "</DiffuseMaterial.Brush></DiffuseMaterial></GeometryModel3D.Material>\n"
        f'<GeometryModel3D.Geometry><MeshGeometry3D Positions="{numbers[0]}"\n'
        f'Normals="{normals}"\nTriangleIndices="{numbers[1]}"/></GeometryModel3D.Geometry>\n'
        "</GeometryModel3D></ModelVisual3D.Content></ModelVisual3D>\n</Viewport3D>\n"
    ).encode()}  # fmt: skip


def zipped(files: Files) -> bytes:
    """Return files in a ZIP archive."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, (2020, 1, 1, 0, 0, 0))
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def three_mf_text() -> str:
    """Return the model of a 3MF file: one object in two places."""
    vertices, faces = grid()
    return (
        '<?xml version="1.0"?>\n<model unit="millimeter" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        '<object id="1" type="model"><mesh><vertices>\n'
        + "".join(f'<vertex x="{x:g}" y="{y:g}" z="{z:g}"/>\n' for x, y, z in vertices)
        + "</vertices><triangles>\n"
        + "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n' for a, b, c in faces)
        + '</triangles></mesh></object></resources><build><item objectid="1"/>'
        '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"/></build></model>'
    )


def three_mf(model: str | None = None) -> Files:
    """Return a 3MF file of a model."""
    model = three_mf_text() if model is None else model
    types = (
        '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        '<Default Extension="model" '
        'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
    )
    parts = {"[Content_Types].xml": types.encode(), "3D/3dmodel.model": model.encode()}
    return {"a.3mf": zipped(parts)}


def dae_text(picture_name: str | None) -> str:
    """Return a COLLADA document, with a material of a picture or of a colour."""
    vertices, faces = grid()
    places, pairs = (
        " ".join(f"{x:g}" for x in table.reshape(-1)) for table in (vertices, coordinates())
    )
    corners = " ".join(f"{v} {v}" for v in faces.reshape(-1))
    count, images, new, diffuse = len(vertices), "", "", "<color>0.8 0.2 0.1 1</color>"
    if picture_name is not None:
        images = (
            f'<library_images><image id="i"><init_from>{picture_name}</init_from></image>'
            "</library_images>"
        )
        new = (
            '<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>'
            '<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>'
        )
        diffuse = '<texture texture="t" texcoord="UV"/>'
    return (
        '<?xml version="1.0"?>\n<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" '
        'version="1.4.1"><asset><unit name="meter" meter="1"/><up_axis>Y_UP</up_axis></asset>\n'
        f'{images}<library_effects><effect id="e"><profile_COMMON>{new}<technique sid="c"><phong>'
        f"<diffuse>{diffuse}</diffuse></phong></technique></profile_COMMON></effect>"
        '</library_effects><library_materials><material id="m"><instance_effect url="#e"/>'
        '</material></library_materials>\n<library_geometries><geometry id="g"><mesh>'
        f'<source id="p"><float_array id="pa" count="{3 * count}">{places}</float_array>'
        f'<technique_common><accessor source="#pa" count="{count}" stride="3">'
        '<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>'
        "</accessor></technique_common></source>\n"
        f'<source id="u"><float_array id="ua" count="{2 * count}">{pairs}</float_array>'
        f'<technique_common><accessor source="#ua" count="{count}" stride="2">'
        '<param name="S" type="float"/><param name="T" type="float"/>'
        '</accessor></technique_common></source>\n<vertices id="v">'
        '<input semantic="POSITION" source="#p"/></vertices>'
        f'<triangles count="{len(faces)}" material="mm"><input semantic="VERTEX" source="#v" '
        'offset="0"/><input semantic="TEXCOORD" source="#u" offset="1" set="0"/>'
        f"<p>{corners}</p></triangles></mesh></geometry></library_geometries>\n"
        '<library_visual_scenes><visual_scene id="s0"><node id="n"><translate>1 0 0</translate>'
        '<instance_geometry url="#g"><bind_material><technique_common>'
        '<instance_material symbol="mm" target="#m"/></technique_common></bind_material>'
        "</instance_geometry></node></visual_scene></library_visual_scenes>\n"
        '<scene><instance_visual_scene url="#s0"/></scene></COLLADA>\n'
    )


def dae() -> Files:
    """Return a COLLADA file with a picture."""
    return {"a.dae": dae_text("skin.png").encode(), "skin.png": picture()}


def zae() -> Files:
    """Return a packed COLLADA file."""
    return {"a.zae": zipped({"a.dae": dae_text(None).encode()})}


def three_dxml() -> Files:
    """Return a 3DXML file of one part."""
    vertices, faces = grid()
    manifest = '<Manifest xmlns="m"><Root>a.3dxml</Root></Manifest>'
    corners = " ".join(str(v) for v in faces.reshape(-1))
    points = ", ".join(" ".join(f"{x:g}" for x in row) for row in vertices)
    normals = ", ".join(["0 0 1"] * len(vertices))
    scene = (
        '<Model_3dxml xmlns="m"><ProductStructure root="1"><Reference3D id="1" name="root"/>'
        '<Reference3D id="2" name="part"/><Instance3D id="3" name="i"><IsAggregatedBy>1'
        "</IsAggregatedBy><IsInstanceOf>2</IsInstanceOf><RelativeMatrix>1 0 0 0 1 0 0 0 1 0 0 0"
        '</RelativeMatrix></Instance3D><ReferenceRep id="4" name="r" format="TESSELLATED" '
        'associatedFile="urn:3DXML:part.3DRep"/><InstanceRep id="5" name="ir"><IsAggregatedBy>2'
        "</IsAggregatedBy><IsInstanceOf>4</IsInstanceOf></InstanceRep></ProductStructure>"
        "</Model_3dxml>"
    )
    part = (
        f'<XMLRepresentation xmlns="m"><Root><Rep><Faces><Face triangles="{corners}"/></Faces>'
        f"<VertexBuffer><Positions>{points}</Positions><Normals>{normals}</Normals></VertexBuffer>"
        "</Rep></Root></XMLRepresentation>"
    )
    members = {"Manifest.xml": manifest, "a.3dxml": scene, "part.3DRep": part}
    return {"a.3dxml": zipped({name: text.encode() for name, text in members.items()})}


def binvox() -> Files:
    """Return a grid of voxels."""
    pairs = bytes([0, 21, 1, 2, 0, 3, 1, 1, 0, 37])
    return {"a.binvox": b"#binvox 1\ndim 4 4 4\ntranslate 0 0 0\nscale 2\ndata\n" + pairs}


def xyz() -> Files:
    """Return a cloud of points."""
    return {"a.xyz": rows_of(grid()[0]).encode()}


def zip_of_obj() -> Files:
    """Return an OBJ file with all that it names in a ZIP archive."""
    return {"a.zip": zipped(obj())}


def tar_of_stl(kind: str) -> Files:
    """Return an STL file in a TAR archive, packed by ``"gz"`` or ``"bz2"``."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode=f"w:{kind}") as archive:
        for name, content in stl_binary().items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    return {f"a.tar.{kind}": stream.getvalue()}


def bz2_of_ply() -> Files:
    """Return a packed PLY file."""
    return {"a.ply.bz2": bz2.compress(ply_text()["a.ply"])}


def skin(kind: str) -> Files:
    """Return an OBJ file whose picture is of a kind; its name says PNG, as some files' do."""
    files = obj()
    return {"skin.png": picture(kind)} | files | {"skin.png": picture(kind)}


def sky_hdr(width: int) -> Files:
    """Return a Radiance picture; packed by channels if it is wide enough."""
    height, head = 4, f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X {width}\n"
    rows = np.arange(height * width * 4, dtype=np.uint32).reshape(height, width, 4) * 7 % 96 + 64
    rows[:, :, 3] = 126 + rows[:, :, 3] % 5
    content = b""
    for row in rows.astype(np.uint8):
        if width < 8:
            content += row.tobytes()
            continue
        content += bytes([2, 2, 0, width])
        for channel in row.T:
            content += bytes([128 + 3]) + channel[:1].tobytes()
            content += bytes([width - 3]) + channel[3:].tobytes()
    return {"a.hdr": head.encode() + content}


def sky_exr() -> Files:
    """Return an OpenEXR picture of linear light."""
    import tempfile
    from pathlib import Path

    import OpenEXR

    pixels = {name: np.linspace(0.0, 2.0, 32, dtype=np.float32).reshape(4, 8) for name in "RGB"}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with tempfile.TemporaryDirectory() as folder, OpenEXR.File(header, pixels) as file:
        place = Path(folder) / "a.exr"
        file.write(str(place))
        return {"a.exr": place.read_bytes()}


def sky_picture() -> Files:
    """Return a picture of 8 bits as an environment."""
    return {"sky.png": picture("PNG", (8, 4))}


def pcd(data: str) -> Files:
    """Return points as ``"ascii"`` or ``"binary"``."""
    points = grid()[0].astype("<f4")
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 16\nHEIGHT 1\n"
    content = rows_of(points).encode() if data == "ascii" else points.tobytes()
    return {"a.pcd": f"{head}POINTS 16\nDATA {data}\n".encode() + content}


def pcd_compressed() -> Files:
    """Return points whose bytes are packed in runs of their own."""
    columns = np.ascontiguousarray(grid()[0].astype("<f4").T).tobytes()
    runs = [columns[at : at + 32] for at in range(0, len(columns), 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    head = pcd("binary")["a.pcd"].partition(b"DATA")[0] + b"DATA binary_compressed\n"
    return {"a.pcd": head + struct.pack("<II", len(packed), len(columns)) + packed}


def rows(kind: str) -> Files:
    """Return points as rows of numbers: positions, with normals, colours or a head of names."""
    points = grid()[0]
    normals, colors = np.tile([0.0, 0.6, 0.8], (len(points), 1)), np.round(points * 60) % 256
    if kind == "xyzn":
        points = np.hstack([points, normals])
    elif kind == "xyzrgb":
        points = np.hstack([points, colors])
    elif kind == "pts":
        points = np.hstack([points, colors[:, :1], colors])
    text = rows_of(points)
    if kind == "pts":
        text = f"{len(points)}\n{text}"
    elif kind == "csv":
        text = "x,y,z\n" + text.replace(" ", ",")
    return {f"a.{kind}": text.encode()}


def renamed(files: Files, kind: str) -> Files:
    """Return a file under another extension."""
    (content,) = files.values()
    return {f"a.{kind}": content}


SAMPLES: dict[str, Callable[[], Files]] = {
    "obj": obj, "obj plain": obj_plain, "ply text": ply_text,
    "ply little": lambda: ply_binary("little"), "ply big": lambda: ply_binary("big"),
    "stl text": stl_text, "stl binary": stl_binary, "off": off, "glb": glb, "gltf": gltf,
    "vrm": lambda: renamed(glb(), "vrm"), "stl_ascii": lambda: renamed(stl_text(), "stl_ascii"),
    "dae": dae, "zae": zae, "3mf": three_mf, "3dxml": three_dxml, "xaml": xaml, "binvox": binvox,
    **{kind: lambda kind=kind: rows(kind)
       for kind in ("xyz", "xyzn", "xyzrgb", "pts", "asc", "txt", "csv")},
    "pcd text": lambda: pcd("ascii"), "pcd binary": lambda: pcd("binary"),
    "pcd compressed": pcd_compressed, "zip": zip_of_obj, "tar.gz": lambda: tar_of_stl("gz"),
    "tar.bz2": lambda: tar_of_stl("bz2"), "bz2": bz2_of_ply,
    **{f"picture {kind}": lambda kind=kind: skin(kind)
       for kind in ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "TGA", "GIF")},
    "sky hdr": lambda: sky_hdr(12), "sky hdr flat": lambda: sky_hdr(5), "sky exr": sky_exr,
    "sky png": sky_picture,
}  # fmt: skip
"""What makes each sample; those that begin with ``sky`` are environments."""


def opened(files: Files) -> str:
    """Return the name of the file that is opened."""
    return next(name for name in files if not name.startswith("skin."))
