"""What a file asks for is refused before memory is taken for it."""

from __future__ import annotations

import bz2
import functools
import gzip
import io
import itertools
import json
import re
import struct
import subprocess
import sys
import tarfile
import zipfile
import zlib

import numpy as np
import pytest
from click.testing import CliRunner
from sample_models import Model, blank_png, quad

import rasterjit as rj
from rasterjit.cli import commands

BUDGET = 32 << 20

PROGRAM = """
import importlib, json, os, sys, warnings
import numpy as np, rasterjit as rj
import trimesh, PIL.Image
from rasterjit.io.meshes import load
warnings.simplefilter("ignore")
for name in ("lxml.etree", "OpenEXR", "svg.path", "ezdxf.recover", "ezdxf.path"):
    try:
        importlib.import_module(name)
    except ImportError:
        pass

def kilobytes(name):
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith(name))

def peak_of(path, most):
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")  # The peak is what there is now.
    before, code = kilobytes("VmRSS:"), kilobytes("RssFile:")
    try:
        if path.endswith((".hdr", ".exr")):
            kept = rj.Environment.from_file(path, max_bytes=most)
        else:
            kept = load(path, max_bytes=most, isolate=False)
        said = "loaded"
    except ValueError as error:
        said = str(error)
    # A child reads anew what code it runs: that is no memory of its own.
    code = kilobytes("RssFile:") - code
    return (kilobytes("VmHWM:") - before - code) * 1024, said

for line in sys.stdin:
    # A child is as if it had just imported all that.
    child = os.fork()
    if not child:
        print(json.dumps(peak_of(*json.loads(line))), flush=True)
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        print("null", flush=True)
"""


@pytest.fixture(scope="module")
def peak_of():
    """Return what tells by how much a process grew that loads a file, bytes, and what it said."""
    command = [sys.executable, "-c", PROGRAM]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as program:

        def ask(path, most):
            program.stdin.write(json.dumps([str(path), most]) + "\n")
            program.stdin.flush()
            return json.loads(program.stdout.readline())

        yield ask
        program.stdin.close()


def refusal_of(path, most=BUDGET, read=rj.load):
    """Return why a file is refused; the message has the file, the need, and the budget."""
    with pytest.raises(ValueError, match=re.escape(str(path))) as said:
        read(path, max_bytes=most)
    found = re.search(r": (.+) needs ([0-9,]+) bytes, but ([0-9,]+) are left", str(said.value))
    assert f"max_bytes = {most:,}" in str(said.value)
    needed, left = (int(found[k].replace(",", "")) for k in (2, 3))
    assert left < needed
    assert left <= most
    return found[1]


def no_bytes(folder):
    """Write a glTF file of accessors that take no bytes."""
    model = Model()
    model.add(quad(-1, -1, 1, 1), model.material())
    accessor = model.glb._document["accessors"][0]
    del accessor["bufferView"]
    accessor["count"] = 1 << 25
    return model.save(folder / "a.glb"), "accessor 0"


def many_changes(folder):
    """Write a glTF file of a sparse accessor, all of whose rows are of the same bytes."""
    count = 400_000
    return shared_bytes(folder, count, count, [{"count": count}]), "sparse accessor 0"


def changes_of_few_rows(folder):
    """Write a glTF file of a sparse accessor that says to change more rows than it has."""
    return shared_bytes(folder, 8_000_000, 3, [{"count": 7_999_900}]), None


def views_of_one_buffer(folder):
    """Write a glTF file of accessors of a few rows, each of a view of nearly all bytes."""
    return shared_bytes(folder, 24_000_000, 3, [None] * 6), None


def shared_bytes(folder, size, count, sparse):
    """Write a glTF file of VEC3 accessors, sparse or not, of the same bytes."""
    (folder / "a.bin").write_bytes(bytes(size))
    accessors, views = [], []
    for number, one in enumerate(sparse):
        view = {"bufferView": number}
        views.append({"buffer": 0, "byteOffset": number, "byteLength": size - number})
        accessor = {"componentType": 5126, "count": count, "type": "VEC3"}
        if one is None:
            accessor |= view
        else:
            views[-1]["byteStride"] = 1
            one |= {"indices": {**view, "componentType": 5121}, "values": view}
            one["count"] = min(one["count"], size - 12)
            accessor["sparse"] = one
        accessors.append(accessor)
    names = ["POSITION", *(f"_A{number}" for number in range(1, len(sparse)))]
    used = {name: number for number, name in enumerate(names)}
    document = {
        "asset": {"version": "2.0"}, "accessors": accessors, "bufferViews": views,
        "buffers": [{"uri": "a.bin", "byteLength": size}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": used}]}],
    }  # fmt: skip
    (folder / "a.gltf").write_text(json.dumps(document))
    return folder / "a.gltf"


def long_name_spaces(folder):
    """Write a 3MF file of many names in name spaces of long addresses."""
    address = "urn:" + "x" * 600_000
    names = "".join(f'<t{number} m:a{number}=""/>' for number in range(300))
    text = f'<model xmlns="{address}"><metadatagroup xmlns:m="{address}">{names}</metadatagroup>'
    with zipfile.ZipFile(folder / "a.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", f"{text}</model>")
    return folder / "a.3mf", None


def many_accessors(folder):
    """Write a glTF file of a hundred meshes of one large accessor."""
    model, row = Model(), quad(-1, -1, 1, 1)
    large = {name: np.repeat(values, 2000, axis=0) for name, values in row.items()}
    model.add(large, model.material())
    document = model.glb._document
    for _ in range(99):
        document["meshes"].append(document["meshes"][0])
        model.nodes.append(model.glb.add("nodes", {"mesh": len(document["meshes"]) - 1}))
    return model.save(folder / "a.glb"), r"accessor \d+"


def many_pictures(folder):
    """Write a glTF file of pictures, each of which would do."""
    model = Model()
    for number in range(4):
        use = {"index": model.glb.add_texture(blank_png(500, 500), f"p{number}")}
        material = model.material(f"m{number}", baseColorTexture=use)
        model.add(quad(number, 0, number + 1, 1), material)
    return model.save(folder / "a.glb"), r"image \d, 'p\d'"


def obj_picture(folder):
    """Write an OBJ file with a large picture."""
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd wall.png\n")
    (folder / "wall.png").write_bytes(blank_png(9000, 9000))
    text = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"
    (folder / "a.obj").write_text(text)
    return folder / "a.obj", r"picture 'wall\.png'"


def packed_texts(folder):
    """Write an OBJ file whose picture has packed texts beside its texels."""
    picture = blank_png(4, 4)
    text = b"zTXt" + b"a\0\0" + zlib.compress(bytes(1 << 20))
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    path, what = obj_picture(folder)
    # Behind the mark and the head.
    (folder / "wall.png").write_bytes(picture[:33] + 300 * chunk + picture[33:])
    return path, what


def tiff(folder, tags, content):
    """Write an OBJ file whose picture is a TIFF file of a texel, with more tags, or long ones."""
    usual = [(256, 3, 1, 1), (257, 3, 1, 1), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1)]
    tags = sorted([*usual, *tags, (278, 3, 1, 1)])
    rows = b"".join(struct.pack("<HHII", *one) for one in tags)
    head = struct.pack("<4sIH", b"II*\0", 8, len(tags)) + rows + bytes(4)
    path, _ = obj_picture(folder)
    (folder / "wall.png").unlink()
    (folder / "wall.tif").write_bytes(head.ljust(TAGS_END, b"\0") + content)
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd wall.tif\n")
    return path, r"picture 'wall\.tif'"


TAGS_END = 1 << 13


def many_strips(folder):
    """Write a picture of one texel in strips without number."""
    strips, count = bytes(8_000_000), 2_000_000
    return tiff(folder, [(273, 4, count, TAGS_END), (279, 4, count, TAGS_END)], strips)


def tags_of_one_place(folder):
    """Write a picture whose tags are long, and all the same bytes."""
    tags = [(40000 + n, 7, 1_000_000, TAGS_END) for n in range(300)]
    return tiff(folder, [(273, 4, 1, TAGS_END), (279, 4, 1, 1), *tags], bytes(1_000_000))


def many_members(folder):
    """Write a 3MF file of empty members without number."""
    with zipfile.ZipFile(folder / "a.3mf", "w") as archive:
        for number in range(150_000):
            archive.writestr(zipfile.ZipInfo(f"{number}"), b"")
    return folder / "a.3mf", "its list of members"


def ply_picture(folder):
    """Write a PLY file with a large picture."""
    (folder / "wall.png").write_bytes(blank_png(9000, 9000))
    head = "ply\nformat ascii 1.0\ncomment TextureFile wall.png\nelement vertex 3\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "a.ply").write_text(f"{head}0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n")
    return folder / "a.ply", r"picture 'wall\.png'"


def text_faces(folder):
    """Write an OBJ file of faces of few bytes."""
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "f 1 2 3\n" * (1 << 20))
    return folder / "a.obj", r"its \d+ lines|the corners of its faces|the mesh '.*'"


def text_rows(folder):
    """Write an OBJ file of vertices that one face uses."""
    (folder / "a.obj").write_text("v 0 0 0\n" * (1 << 20) + "f 1 2 3\n")
    return folder / "a.obj", r"its \d+ lines|\d+ rows of v"


def long_polygon(folder):
    """Write an OBJ file of one face."""
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + " 1 2 3" * (1 << 20))
    return folder / "a.obj", r"its \d+ lines|the corners of its faces"


def blank_lines(folder):
    """Write a PLY file that goes on in blank lines."""
    head = "ply\nformat ascii 1.0\n" + "".join(f"property float {name}\n" for name in "xyz")
    head = head.replace("1.0\n", "1.0\nelement vertex 3\n", 1)
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "a.ply").write_text(f"{head}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n" + "\n" * (8 << 20))
    return folder / "a.ply", r"its \d+ lines"


def binary_faces(folder):
    """Write a binary PLY file of faces of four bytes, of which every second one is wider."""
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
    head += "".join(f"property char {name}\n" for name in "xyz")
    head += f"element face {1 << 20}\nproperty list uchar char vertex_indices\nend_header\n"
    rows = bytes([3, 0, 1, 2, 4, 0, 1, 2, 0]) * (1 << 19)
    (folder / "a.ply").write_bytes(head.encode() + bytes([0, 0, 0, 1, 0, 0, 0, 1, 0]) + rows)
    return folder / "a.ply", "the corners of its faces"


def many_solids(folder):
    """Write an STL file of meshes of one triangle."""
    loop = "facet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    (folder / "a.stl").write_text(f"solid\n{loop}endsolid\n" * 8_000)
    return folder / "a.stl", r"the mesh 'a\.stl_\d+'"


def many_materials(folder):
    """Write an OBJ file with a large library."""
    (folder / "a.mtl").write_text("".join(f"newmtl {n}\n" for n in range(200_000)))
    (folder / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return folder / "a.obj", "an MTL file"


def many_curves(folder):
    """Write a drawing of curves that take few bytes there."""
    text = "M0 0" + "C1 1 2 1 3 0" * 10_000
    (folder / "a.svg").write_text(SVG.format(f'<path d="{text}"/>'))
    return folder / "a.svg", r"the curves of the drawing 'a\.svg'"


SVG = '<svg xmlns="http://www.w3.org/2000/svg">{}</svg>'


def dxf(entities, blocks=""):
    """Return the text of a DXF file."""
    head = "0 SECTION 2 HEADER 9 $ACADVER 1 AC1015 0 ENDSEC"
    both = f"0 SECTION 2 BLOCKS {blocks} 0 ENDSEC 0 SECTION 2 ENTITIES {entities} 0 ENDSEC"
    return "\n".join(f"{head} {both} 0 EOF".split())


def many_bulges(folder):
    """Write a line whose segments are circles but for a little."""
    points = "".join(f" 10 {n} 20 {n % 7} 42 50" for n in range(12_000))
    line = f" 0 LWPOLYLINE 5 9 100 AcDbEntity 8 0 100 AcDbPolyline 90 12000 70 0 {points}"
    (folder / "a.dxf").write_text(dxf(line))
    return folder / "a.dxf", "the points of a curve"


def many_places(folder):
    """Write a block that stands in 900 million places."""
    point = "0 POINT 8 0 10 0 20 0"
    inserted = "0 INSERT 8 0 2 B 10 0 20 0 70 30000 71 30000 44 1 45 1"
    (folder / "a.dxf").write_text(dxf(inserted, f"0 BLOCK 8 0 2 B 70 0 10 0 20 0 {point} 0 ENDBLK"))
    return folder / "a.dxf", "all that its blocks hold, wherever they stand,"


def blocks_in_blocks(folder):
    """Write blocks of ten of the next, of which the last is empty."""
    blocks = [
        f"0 BLOCK 8 0 2 B{n} 70 0 10 0 20 0 {f'0 INSERT 8 0 2 B{n + 1} 10 0 20 0 ' * 10} 0 ENDBLK"
        for n in range(12)
    ]
    (folder / "a.dxf").write_text(dxf("0 INSERT 8 0 2 B0 10 0 20 0", " ".join(blocks)))
    return folder / "a.dxf", "all that its blocks hold, wherever they stand,"


def large_file(folder):
    """Write a glTF file whose buffer is a large file with holes."""
    path, _ = many_pictures(folder)
    text = path.read_bytes()
    length = struct.unpack_from("<I", text, 12)[0]
    header = text[20 : 20 + length].replace(b'"buffers":[{', b'"buffers":[{"uri":"a.bin",')
    (folder / "a.gltf").write_bytes(header)
    with (folder / "a.bin").open("wb") as file:
        file.truncate(1 << 33)
    return folder / "a.gltf", r"the file 'a\.bin'"


def zip_member(folder):
    """Write a 3MF file whose model unpacks to much."""
    with zipfile.ZipFile(folder / "a.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b" " * (100 << 20))
    return folder / "a.3mf", "its member '3D/3dmodel.model'"


def lying_member(folder):
    """Write a 3MF file whose model says that it is small."""
    path, _ = zip_member(folder)
    content = path.read_bytes().replace(struct.pack("<I", 100 << 20), struct.pack("<I", 1000))
    path.write_bytes(content)
    return path, "its member '3D/3dmodel.model', which is larger than it says,"


def tar_member(folder):
    """Write an archive whose member unpacks to much."""
    with tarfile.open(folder / "a.tar.gz", "w:gz") as archive:
        entry = tarfile.TarInfo("a.stl")
        entry.size = 50 << 20
        archive.addfile(entry, io.BytesIO(bytes(entry.size)))
    return folder / "a.tar.gz", "what it holds"


def tar_headers(folder):
    """Write an archive of an empty member with a long header, and of many empty ones."""
    with tarfile.open(folder / "a.tar.gz", "w:gz", format=tarfile.PAX_FORMAT) as archive:
        entry = tarfile.TarInfo("a.stl")
        entry.pax_headers = {"comment": "x" * (20 << 20)}
        archive.addfile(entry)
        for number in range(20_000):
            archive.addfile(tarfile.TarInfo(f"{number}.stl"))
    return folder / "a.tar.gz", "what it holds"


def sparse_tar_member(folder):
    """Write an archive of a sparse member, which holds nothing."""
    entry = tarfile.TarInfo("a.stl")
    entry.type, entry.size = tarfile.GNUTYPE_SPARSE, 0
    block = bytearray(entry.tobuf(tarfile.GNU_FORMAT))
    # Where data lies in the member, and how large it is, are octal numbers.
    block[386:410] = b"%011o\0%011o\0" % (50 << 20, 0)
    block[483:495] = b"%011o\0" % (50 << 20)
    block[148:156] = b" " * 8
    block[148:155] = b"%06o\0" % sum(block)
    (folder / "a.tar.gz").write_bytes(gzip.compress(bytes(block) + bytes(1024)))
    return folder / "a.tar.gz", "its member 'a.stl'"


def bz2_content(folder):
    """Write a packed file that unpacks to much."""
    (folder / "a.bz2").write_bytes(bz2.compress(bytes(50 << 20)))
    return folder / "a.bz2", "what it holds"


def grid(folder):
    """Write a grid of a thousand million voxels."""
    runs = bytes([0, 255]) * 4
    path = folder / "a.binvox"
    path.write_bytes(b"#binvox 1\ndim 1020 1000 1000\ndata\n" + runs * 1_000_000)
    return path, "a grid of 1020000000 voxels"


WRITERS = {
    one.__name__: one
    for one in (
        no_bytes, many_accessors, many_pictures, obj_picture, ply_picture, many_materials,
        many_changes, large_file, zip_member, lying_member, tar_member, tar_headers,
        sparse_tar_member, bz2_content, grid, text_faces, text_rows, long_polygon, blank_lines,
        binary_faces, many_solids, many_curves, many_bulges, many_places, blocks_in_blocks,
    )
}  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return what writes each file once, in a folder of its own, and says what needs the room."""
    return functools.cache(lambda write: write(tmp_path_factory.mktemp("files")))


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_what_takes_too_much_is_refused_by_name(written, write):
    path, what = written(write)
    assert re.fullmatch(what, refusal_of(path))


def hdr(folder, width, height):
    """Write the header of a Radiance picture, and no row."""
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    (folder / "a.hdr").write_bytes(head.encode())
    return folder / "a.hdr"


def exr(folder, width, height):
    """Write an OpenEXR picture, which packs into next to nothing."""
    OpenEXR = pytest.importorskip("OpenEXR")
    pixels = {name: np.zeros((height, width), np.float32) for name in "RGB"}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, pixels) as file:
        file.write(str(folder / "a.exr"))
    return folder / "a.exr"


def sky_png(folder, width, height):
    """Write a picture of 8 bits."""
    (folder / "a.png").write_bytes(blank_png(width, height))
    return folder / "a.png"


@pytest.mark.parametrize("write", [hdr, exr, sky_png])
def test_a_sky_is_refused_by_its_header(tmp_path, write):
    path = write(tmp_path, 1200, 800)
    assert refusal_of(path, BUDGET, rj.Environment.from_file) == "the picture"
    if write is not hdr:
        assert rj.Environment.from_file(path, max_bytes=2 * BUDGET).sky is not None


@pytest.mark.parametrize("max_bytes", [0, -1, 1.5, "8G", None, True])
def test_max_bytes_is_checked(tmp_path, max_bytes):
    path = sky_png(tmp_path, 4, 2)
    for read in (rj.load, rj.Environment.from_file):
        with pytest.raises(ValueError, match=r"^max_bytes must be a whole number above 0, got"):
            read(path, max_bytes=max_bytes)


def test_the_command_line_takes_a_budget(tmp_path):
    path, _ = many_pictures(tmp_path)
    command = ["render", str(path), "-o", str(tmp_path / "a.png"), "--max-bytes", "1000"]
    run = CliRunner().invoke(commands.program, command)
    assert run.exit_code == 1
    assert "are left of --max-bytes 1,000" in run.output
    assert not (tmp_path / "a.png").exists()


def test_what_fits_is_loaded_without_a_word(tmp_path):
    path, _ = many_pictures(tmp_path)
    assert len(rj.load(path, max_bytes=2 * BUDGET).nodes) == 4


def arcs(paths):
    """Return the text of a drawing of half circles: from, to and radius."""
    shapes = "".join(f'<path d="M{x} {y} A{r} {r} 0 0 1 {x + 2 * r} {y}"/>' for x, y, r in paths)
    return SVG.format(shapes)


@pytest.mark.skipif(sys.platform != "linux", reason="it asks Linux for the peak")
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.svg", arcs([(0, 0, 1e6)])),
        ("a.svg", arcs([(0, 0, 1e12), (0, 0, 1e-3)])),
        ("a.svg", arcs([(n * 700.0, n % 9 * 4e4, 1e3 * (n % 97 + 1)) for n in range(200)])),
        ("a.dxf", dxf("0 ARC 8 0 10 0 20 0 40 1e9 50 0 51 180")),
        ("a.dxf", dxf("0 ARC 8 0 10 0 20 0 40 1e9 50 0 51 1e-9")),
        ("a.dxf", dxf("0 CIRCLE 8 0 10 1e12 20 0 40 1e6 0 CIRCLE 8 0 10 0 20 0 40 1e-3")),
    ],
    ids=["one", "large and small", "site plan", "DXF", "flat", "circles"],
)
def test_curves_are_cut_by_the_extent_of_the_drawing(tmp_path, peak_of, name, text):
    (tmp_path / name).write_text(text)
    peak, said = peak_of(tmp_path / name, BUDGET)
    assert said == "loaded"
    assert peak < 4 << 20


@pytest.mark.skipif(sys.platform != "linux", reason="it asks Linux for the peak")
@pytest.mark.parametrize(
    ("times", "write"),
    [
        *itertools.product(
            (1, 8),
            (
                many_accessors, many_pictures, obj_picture, lying_member, grid, tar_headers,
                text_faces, text_rows, long_polygon, blank_lines, many_changes,
                changes_of_few_rows, views_of_one_buffer, long_name_spaces, packed_texts,
                many_strips, tags_of_one_place,
            ),
        ),
        # With more to spend these take seconds each, and nowhere near as much memory.
        *((1, one) for one in (
            binary_faces, many_solids, many_curves, many_bulges, many_members,
        )),
    ],
)  # fmt: skip
def test_the_peak_is_at_most_twice_the_budget(written, peak_of, write, times):
    path, _ = written(write)
    peak, said = peak_of(path, times * BUDGET)
    assert peak < 2 * times * BUDGET, said
