"""
Small hostile files, one or more for each way in which a file from a stranger can do harm.

``python tests/hostile/corpus.py FOLDER`` writes them, each into a folder of its own.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import os
import socket
import struct
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from PIL import Image

sys.path.append(str(Path(__file__).parents[2]))

from benchmarks.fuzz_files.samples import (
    Files,
    dae_text,
    gltf,
    grid,
    obj,
    off,
    opened,
    picture,
    ply_text,
    sky_hdr,
    stl_binary,
    three_mf,
    three_mf_text,
    xaml,
    zipped,
)

MAX = 32 << 20
"""Bytes that each file may take."""

SECRET = "secret.png"


class Hostile(NamedTuple):
    """
    A hostile file.

    Parameters
    ----------
    make : callable
        Given a folder, writes the file and what it names; returns its path.
    outcome : {"refused", "warned", "loaded"}
    said : str
        Pattern of what the error or the warning says.
    """

    make: Callable[[Path], Path]
    outcome: str
    said: str = ""


def placed(folder: Path, files: Files) -> Path:
    """Write files; return the path of the one that is opened."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder / opened(files)


def changed(files: Files, old: str, new: str) -> Callable[[Path], Path]:
    """Return what writes files whose first one is changed, once."""

    def make(folder: Path) -> Path:
        name = opened(files)
        assert old.encode() in files[name]
        return placed(folder, files | {name: files[name].replace(old.encode(), new.encode(), 1)})

    return make


def cut(files: Files, share: float) -> Callable[[Path], Path]:
    """Return what writes files of which the first one ends too early."""
    name = opened(files)
    return lambda folder: placed(
        folder, files | {name: files[name][: int(share * len(files[name]))]}
    )


def with_gltf(change: Callable[[dict], None]) -> Callable[[Path], Path]:
    """Return what writes a glTF file whose JSON is changed."""

    def make(folder: Path) -> Path:
        document = json.loads(gltf()["a.gltf"])
        change(document)
        return placed(folder, gltf() | {"a.gltf": json.dumps(document).encode()})

    return make


def naming(name: str) -> Callable[[Path], Path]:
    """Return what writes an OBJ file whose picture has a name, beside a secret above."""

    def make(folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        (folder.parent / SECRET).write_bytes(picture())
        library = obj()["a.mtl"].replace(b"skin.png", name.format(above=folder.parent).encode())
        return placed(folder, obj() | {"a.mtl": library})

    return make


def special(kind: str) -> Callable[[Path], Path]:
    """Return what writes an OBJ file whose picture is no regular file."""

    def make(folder: Path) -> Path:
        path = placed(folder, obj())
        place = folder / "skin.png"
        place.unlink()
        if kind == "pipe":
            os.mkfifo(place)
        elif kind == "device":
            place.symlink_to("/dev/zero")
        elif kind == "link":
            (folder.parent / SECRET).write_bytes(picture())
            place.symlink_to(folder.parent / SECRET)
        else:
            here = os.getcwd()
            os.chdir(folder)  # Names of sockets are short.
            with socket.socket(socket.AF_UNIX) as one:
                one.bind("skin.png")
            os.chdir(here)
        return path

    return make


def of_picture(content: Callable[[], bytes]) -> Callable[[Path], Path]:
    """Return what writes an OBJ file with a picture of some content."""
    return lambda folder: placed(folder, obj() | {"skin.png": content()})


def large_png() -> bytes:
    """Return a picture of one colour, which packs into next to nothing."""
    stream = io.BytesIO()
    Image.new("L", (4000, 4000)).save(stream, "PNG")
    return stream.getvalue()


POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(id) (w) file\n%%EOF\n"


def many_targets(document: dict) -> None:
    """Ask for many morph targets that say nothing."""
    document["meshes"][0]["primitives"][0]["targets"] = [{}] * 200_000


def many_accessors(document: dict) -> None:
    """Let a hundred meshes use one accessor that takes no bytes."""
    document["accessors"][0] = {"componentType": 5126, "count": 1 << 24, "type": "VEC3"}
    document["meshes"] = [document["meshes"][0]] * 100
    document["nodes"] = [{"mesh": number} for number in range(100)]
    document["scenes"] = [{"nodes": list(range(100))}]


def draco(is_required: bool) -> Callable[[dict], None]:
    """Return what compresses a primitive whose accessors are there as well."""

    def change(document: dict) -> None:
        name = "KHR_draco_mesh_compression"
        document["extensionsUsed"].append(name)
        if is_required:
            document["extensionsRequired"] = ["EXT_that_nobody_knows"]
        primitive = document["meshes"][0]["primitives"][0]
        primitive["extensions"] = {name: {"bufferView": 0, "attributes": {}}}

    return change


def huge_stream(document: dict) -> None:
    """Let a Draco stream of a few bytes say that it has four billion faces."""
    name = "KHR_draco_mesh_compression"
    stream = b"DRACO\2\2\1\0\0\0" + b"\xff\xff\xff\xff\x0f" * 2
    uri = "data:;base64," + base64.b64encode(stream).decode()
    buffer, view = len(document["buffers"]), len(document["bufferViews"])
    document["buffers"].append({"byteLength": len(stream), "uri": uri})
    document["bufferViews"].append({"buffer": buffer, "byteLength": len(stream)})
    primitive = document["meshes"][0]["primitives"][0]
    for number in [*primitive["attributes"].values(), primitive["indices"]]:
        document["accessors"][number].pop("bufferView")
    primitive["extensions"] = {
        name: {"bufferView": view, "attributes": dict.fromkeys(primitive["attributes"], 0)}
    }


def lying_zip(folder: Path) -> Path:
    """Write a 3MF file whose model says that it is small."""
    size = 40 << 20
    content = zipped({"3D/3dmodel.model": b" " * size})
    return placed(folder, {"a.3mf": content.replace(struct.pack("<I", size), struct.pack("<I", 9))})


def nested_tar(folder: Path) -> Path:
    """Write an archive of which a header is larger than what it holds."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as archive:
        entry = tarfile.TarInfo("a.stl")
        entry.pax_headers = {"comment": "x" * (8 << 20)}
        archive.addfile(entry)
    return placed(folder, {"a.tar.gz": gzip.compress(stream.getvalue())})


def slow_library(folder: Path) -> Path:
    """Write a material library of forty thousand blanks, and an OBJ file of many groups."""
    blanks = " " * 40_000
    lines = ["mtllib a.mtl", "v 0 0 0", "v 1 0 0", "v 0 1 0"]
    for number in range(2000):
        lines += [f"g part {number}", f"usemtl m{number}", "f 1 2 3"]
    library = f"newmtl{blanks}m0\nKd{blanks}1 0 0\n"
    return placed(folder, {"a.obj": "\n".join(lines).encode(), "a.mtl": library.encode()})


def unknown_materials(folder: Path) -> Path:
    """Write an OBJ file that uses many materials, and a library of as many others."""
    lines = ["mtllib a.mtl", "v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 3"]
    lines += [f"usemtl a{number}" for number in range(6000)]
    library = "".join(f"newmtl b{number}\nd 1\n" for number in range(6000))
    return placed(folder, {"a.obj": "\n".join(lines).encode(), "a.mtl": library.encode()})


def mixed_3mf(group: str) -> Callable[[Path], Path]:
    """Return what writes a 3MF file of a group that mixes a colour with itself again and again."""
    color = '<basematerials id="5"><base name="a" displaycolor="#FF0000"/></basematerials>'
    said = ("0 " if "mat" in group else "5 ") * 10_000
    mixed = f"{color}<{group.format(said)}>{'<a/>' * 10_000}</{group.partition(' ')[0]}>"
    text = three_mf_text().replace("<resources>", f"<resources>{mixed}", 1)
    text = text.replace('id="1"', 'id="1" pid="9" pindex="0"', 1)
    return lambda folder: placed(folder, three_mf(text))


def short_faces(folder: Path) -> Path:
    """Write an OBJ file whose faces take few bytes there and many in memory."""
    return placed(folder, {"a.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * (1 << 17)})


def bomb(kind: str) -> Callable[[Path], Path]:
    """Return what writes a XML file that refers to an entity of entities, or to a file."""
    outside = '<!ENTITY a SYSTEM "file:///etc/passwd">'
    inside = '<!ENTITY a "aaaaaaaaaa">' + "".join(
        f'<!ENTITY {one} "{f"&{before};" * 10}">'
        for before, one in zip("abcdefgh", "bcdefghi", strict=True)
    )
    kinds = {"outside": (outside, "a"), "inside": (inside, "i")}

    def make(folder: Path) -> Path:
        declared, name = kinds[kind]
        text = dae_text(None).replace("?>", f"?><!DOCTYPE COLLADA [{declared}]>", 1)
        return placed(folder, {"a.dae": text.replace("1 0 0</tr", f"&{name}; 0 0</tr").encode()})

    return make


def sky(head: str) -> Callable[[Path], Path]:
    """Return what writes a Radiance picture of another size than it has."""
    return changed(sky_hdr(12), "-Y 4 +X 12", head)


def instances(kind: str) -> str:
    """Return a COLLADA file's text with something besides its mesh."""
    return dae_text(None).replace("</node></vis", f'<instance_{kind} url="#x"/></node></vis')


def svg(shapes: str) -> Callable[[Path], Path]:
    """Return what writes a drawing."""
    text = f'<svg xmlns="http://www.w3.org/2000/svg">{shapes}</svg>'
    return lambda folder: placed(folder, {"a.svg": text.encode()})


FAR = " ".join("1e308" for _ in range(3))
FACES = len(grid()[1]) + 1

HOSTILE: dict[str, Hostile] = {
    # What a file names.
    "above": Hostile(naming(f"../{SECRET}"), "warned", "lies outside"),
    "above, from windows": Hostile(naming(f"..\\{SECRET}"), "warned", "lies outside"),
    "absolute": Hostile(naming(f"{{above}}/{SECRET}"), "warned", "is not a file beside"),
    "address": Hostile(naming("http://127.0.0.1/skin.png"), "warned", "is not a file beside"),
    "file address": Hostile(naming(f"file://{{above}}/{SECRET}"), "warned", "not a file beside"),
    "encoded dots": Hostile(
        with_gltf(lambda it: it["images"][0].update(uri=f"%2e%2e/{SECRET}")), "warned", "outside"
    ),
    "library above": Hostile(changed(obj(), "mtllib ", "mtllib ../"), "warned", "outside"),
    "DAE picture above": Hostile(
        lambda folder: placed(folder, {"a.dae": dae_text(f"../{SECRET}").encode()}),
        "warned", "lies outside",
    ),
    "pipe": Hostile(special("pipe"), "warned", "is no regular file"),
    "device": Hostile(special("device"), "warned", "lies outside"),
    "socket": Hostile(special("socket"), "warned", "is no regular file"),
    "link": Hostile(special("link"), "warned", "lies outside"),
    "entity of a file": Hostile(bomb("outside"), "refused"),
    # What pictures are.
    "PostScript": Hostile(of_picture(lambda: POSTSCRIPT), "warned", "no known picture"),
    "empty picture": Hostile(of_picture(bytes), "warned", "it is empty"),
    "cut picture": Hostile(of_picture(lambda: picture()[:60]), "warned", "cannot be read"),
    # What takes memory or time.
    "picture of many texels": Hostile(of_picture(large_png), "refused", "needs .* bytes"),
    "morph targets without bytes": Hostile(
        with_gltf(many_targets), "refused", "the morph targets of mesh .* needs .* bytes"
    ),
    "accessors without bytes": Hostile(with_gltf(many_accessors), "refused", "needs .* bytes"),
    "lying ZIP": Hostile(lying_zip, "refused", "larger than it says"),
    "TAR header": Hostile(nested_tar, "refused", "what it holds needs"),
    "short faces": Hostile(short_faces, "refused", "needs .* bytes"),
    "large head": Hostile(changed(ply_text(), "vertex 16", "vertex 99999999999"), "refused",
                          "expected 99999999999 lines of vertex"),
    "entities of entities": Hostile(bomb("inside"), "refused"),
    "slow library": Hostile(slow_library, "warned", "no MTL file"),
    "unknown materials": Hostile(unknown_materials, "warned", "no MTL file"),
    "blanks in a head": Hostile(
        changed(ply_text(), "element", f"comment texture{' ' * 200_000}x\nelement"), "loaded"
    ),
    "zeros": Hostile(
        lambda folder: placed(folder, {"a.obj": bytes(3_000_000)}), "refused", "no faces"
    ),
    "mixtures of mixtures": Hostile(
        mixed_3mf('compositematerials id="9" matid="5" matindices="{}"'), "refused",
        "mixtures of materials needs .* bytes",
    ),
    "properties of properties": Hostile(
        mixed_3mf('multiproperties id="9" pids="{}"'), "refused", "multi-properties needs .* bytes"
    ),
    "deep JSON": Hostile(
        lambda folder: placed(folder, {"a.gltf": b"[" * 100_000}), "refused", "could not be read"
    ),
    "large arc": Hostile(svg('<path d="M-1e6 0 A1e6 1e6 0 0 1 1e6 0"/>'), "loaded"),
    "arc of no size": Hostile(svg('<circle cx="0" cy="0" r="0"/>'), "refused",
                              "Arc of a drawing .* a circle's points must not lie on a line"),
    "arc of no number": Hostile(svg('<line x1="0" y1="0" x2="1" y2="1"/>'
                                    '<circle cx="0" cy="0" r="nan"/>'), "refused",
                                "Arc 1 of the drawing 'a.svg': its points must be finite"),
    "arc too far away": Hostile(svg('<circle cx="0" cy="0" r="1e308"/>'), "refused",
                                "Arc of a drawing .* too far apart"),
    "large sky": Hostile(sky("-Y 3000 +X 3000"), "refused", "the picture needs"),
    "negative sky": Hostile(sky("-Y -4 +X 12"), "refused"),
    "short sky": Hostile(cut(sky_hdr(12), 0.7), "refused"),
    # What is damaged.
    "cut OBJ": Hostile(cut(obj(), 0.93), "refused", r"line \d+: expected"),
    "cut PLY": Hostile(cut(ply_text(), 0.9), "refused", "line|end"),
    "cut OFF": Hostile(cut(off(), 0.9), "refused", "line|end"),
    "cut STL": Hostile(cut(stl_binary(), 0.9), "refused", "its end: expected 18 triangles"),
    "fewer faces": Hostile(changed(off(), f"16 {FACES}", f"16 {FACES + 1}"), "refused",
                           f"expected {FACES + 1} faces"),
    "more faces": Hostile(changed(off(), f"16 {FACES}", f"16 {FACES - 1}"), "refused",
                          f"nothing after {FACES - 1} faces"),
    "more rows": Hostile(changed(ply_text(), f"face {FACES}", f"face {FACES - 1}"), "refused",
                         "no line behind"),
    "word in a vertex": Hostile(changed(obj(), "v 1 0 0", "v 1 0 O"), "refused", "line 5: expect"),
    "face misspelt": Hostile(changed(obj(), "\nf 1/1", "\nff 1/1"), "warned", "no known kind"),
    "word in a 3MF": Hostile(
        lambda folder: placed(folder, three_mf(three_mf_text().replace('v1="8"', 'v1="x"', 1))),
        "refused", "could not be read",
    ),
    "far away": Hostile(changed(obj(), "v 1 0 0", f"v {FAR}"), "loaded"),
    "no number": Hostile(changed(obj(), "v 1 0 0", "v nan 0 0"), "refused", "finite"),
    "signalling NaN": Hostile(
        lambda folder: placed(folder, gltf() | {
            "a.bin": gltf()["a.bin"][:192] + struct.pack("<I", 0x7FA00000) + gltf()["a.bin"][196:]
        }), "warned", "NORMAL .* NaN or infinity"),
    "no number in a DAE": Hostile(
        lambda folder: placed(folder, {"a.dae": dae_text(None).replace(">0 0 0 ", ">inf 0 0 ", 1)
                                       .encode()}), "warned", "no finite numbers"),
    "unknown extension": Hostile(with_gltf(draco(True)), "refused", "EXT_that_nobody_knows"),
    "optional Draco": Hostile(with_gltf(draco(False)), "loaded"),
    "huge Draco": Hostile(with_gltf(huge_stream), "warned", "KHR_draco_mesh_compression"),
    # What is not shown.
    "DAE picture that is missing": Hostile(
        lambda folder: placed(folder, {"a.dae": dae_text("none.png").encode()}), "warned", "none"
    ),
    "gradient brush": Hostile(
        changed(xaml(), '<SolidColorBrush Color="#804020" Opacity="1"/>', "<LinearGradientBrush/>"),
        "warned", "LinearGradientBrush",
    ),
    "skinned DAE": Hostile(
        lambda folder: placed(folder, {"a.dae": instances("light").encode()}), "warned", "light"
    ),
}  # fmt: skip
"""By name."""


def write_corpus(folder: Path) -> list[Path]:
    """Write all files, each into a folder of its own; return the paths of those to open."""
    return [
        one.make(folder / name.replace(" ", "_").replace(",", "") / "model")
        for name, one in HOSTILE.items()
    ]


if __name__ == "__main__":
    for path in write_corpus(Path(sys.argv[1])):
        print(path)
