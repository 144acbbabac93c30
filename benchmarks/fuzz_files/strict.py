"""
Read files once more, slowly and word by word, to tell how many triangles or points they hold.

Nothing here is shared with the readers of the package. What is not sound by the letter of a format
has no answer: there a reader may refuse, warn or mend.
"""

from __future__ import annotations

import io
import json
import math
import re
import struct
import zipfile
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from benchmarks.fuzz_files.samples import Files, opened

Corners = list[tuple[float, float, float]]
"""The three corners of each triangle, one triangle after the other."""

Reader = Callable[[bytes, Files], "int | Corners"]
"""What is given the file that is opened, and all files, and returns what it holds."""

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_WHOLE = re.compile(r"[-+]?[0-9]+", re.ASCII)


_OBJ_STATEMENTS = tuple(
    "v vt vn vp f l p o g s mg usemtl mtllib usemap maplib cstype deg bmat step curv curv2 surf "  # noqa: SIM905
    "parm trim hole scrv sp end con bevel c_interp d_interp lod shadow_obj trace_obj ctech stech "
    "call csh".split()
)

_UNKNOWN = -1
"""Of a file with lines that are no statements, which must not be passed over in silence."""


class NotSoundError(Exception):
    """A file is not what its format says, so nothing can be said of it."""


def triangles_of(name: str, files: Files) -> int | Corners | None:
    """
    Return the number of triangles of a file, or their corners, or None where nothing can be said.

    Parameters
    ----------
    name : str
        Of the sample.
    files : dict
    """
    return _answer(READERS.get(name), files)


def points_of(name: str, files: Files) -> int | None:
    """Return the number of points of a file without faces, or None where nothing can be said."""
    return _answer(READERS_OF_POINTS.get(name), files)


def _answer(reader: Reader | None, files: Files) -> Any:
    """Return what a reader says of the file that is opened, or None."""
    if reader is None:
        return None
    try:
        return reader(files[opened(files)], files)
    except (NotSoundError, ValueError, LookupError, TypeError, AttributeError, struct.error,
            OverflowError, ElementTree.ParseError, zipfile.BadZipFile, EOFError):  # fmt: skip
        return None


def _number(word: str) -> float:
    if _NUMBER.fullmatch(word) is None or not math.isfinite(float(word)):
        raise NotSoundError(word)
    return float(word)


def _whole(word: str) -> int:
    if _WHOLE.fullmatch(word) is None:
        raise NotSoundError(word)
    return int(word)


def _text(content: bytes) -> str:
    text = content.decode("ascii")
    if _CONTROL.search(text) is not None:
        # Some take it for a blank, others for part of a word.
        raise NotSoundError("a control character")
    return text


def _fan(polygon: list[Any]) -> Iterator[Any]:
    """Yield the corners of a polygon's triangles."""
    if len(polygon) < 3:
        raise NotSoundError(polygon)
    for k in range(1, len(polygon) - 1):
        yield from (polygon[0], polygon[k], polygon[k + 1])


def _picked(points: list[Any], number: int) -> Any:
    if not 0 <= number < len(points):
        raise NotSoundError(number)
    return points[number]


def _obj(content: bytes, _files: Files) -> Corners | int:
    """Read an OBJ file; what its corners say of normals and coordinates must be there as well."""
    text = _text(content).replace("\\\r\n", " ").replace("\\\n", " ")
    known = {"v": [], "vt": [], "vn": []}
    corners: list[int] = []
    for line in re.split(r"\r?\n", text):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] in known:
            known[words[0]].append([_number(word) for word in words[1:]])
            if len(words) < (2 if words[0] == "vt" else 4):
                raise NotSoundError(line)
        elif words[0] == "f":
            polygon = []
            for word in words[1:]:
                parts = word.split("/")
                if len(parts) > 3:
                    raise NotSoundError(word)
                places = [
                    _place(_whole(part), len(known[kind])) if part or kind == "v" else 0
                    for kind, part in zip(known, parts, strict=False)
                ]
                polygon.append(places[0])
            corners += _fan(polygon)
        elif words[0] not in _OBJ_STATEMENTS:
            # Perhaps it was a face.
            return _UNKNOWN
    points = known["v"]
    return [tuple(_picked(points, place)[:3]) for place in corners]


def _obj_points(content: bytes, files: Files) -> int:
    """Count the vertices of an OBJ file that has nothing but them."""
    if _obj(content, files) != []:
        raise NotSoundError("faces")
    text = _text(content).replace("\\\r\n", " ").replace("\\\n", " ")
    first = [line.split("#", 1)[0].split()[:1] for line in re.split(r"\r?\n", text)]
    if ["l"] in first or ["p"] in first:
        raise NotSoundError("lines or points")
    return first.count(["v"])


def _rows(columns: int, head: str = "", separator: str | None = None) -> Reader:
    """Return what counts the rows of a file of points, each of so many numbers."""

    def count(content: bytes, _files: Files) -> int:
        """Count the rows; of a head that is their number, they must be as many."""
        lines = [line.strip() for line in _text(content).split("\n") if line.strip()]
        if head == "count":
            if _whole(lines[0]) != len(lines) - 1:
                raise NotSoundError(lines[0])
        elif head and lines[0] != head:
            raise NotSoundError(lines[0])
        rows = [line.split(separator) for line in (lines[1:] if head else lines)]
        for row in rows:
            if len(row) != columns:
                raise NotSoundError(row)
            for word in row:
                _number(word)
        return len(rows)

    return count


def _pcd(content: bytes, files: Files) -> int:
    """Count the points of a PCD file of three numbers each, of any of the three kinds."""
    head, _, rest = content.partition(b"DATA ")
    kind, _, body = rest.partition(b"\n")
    fields = {line.split()[0]: line.split()[1:] for line in _text(head).split("\n") if line}
    expected = {"FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1"}
    if any(fields[name] != words.split() for name, words in expected.items()):
        raise NotSoundError(fields)
    (width,), (height,), (points,) = (fields[name] for name in ("WIDTH", "HEIGHT", "POINTS"))
    count = _whole(points)
    held = {b"ascii": lambda: _rows(3)(body, files), b"binary": lambda: len(body) / 12,
            b"binary_compressed": lambda: count}[kind]()  # fmt: skip
    if not held == count == _whole(width) * _whole(height):
        raise NotSoundError(count)
    return count


def _place(number: int, before: int) -> int:
    """Return which row a number means, from 0."""
    if number == 0:
        raise NotSoundError(number)
    return number - 1 if number > 0 else before + number


_PLY_KINDS = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f",
    "double": "d", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "float32": "f", "float64": "d",
}  # fmt: skip


def _ply(content: bytes, _files: Files) -> Corners:
    """Read a PLY file of any of the three kinds."""
    head, mark, body = content.partition(b"end_header\n")
    lines = _text(head).splitlines()
    if not mark or lines[0] != "ply":
        raise NotSoundError("head")
    order, elements = None, []
    for line in lines[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3:
            order = words[1]
        elif words[0] == "element" and len(words) == 3:
            elements.append((words[1], _whole(words[2]), []))
        elif words[0] == "property":
            kinds = [_PLY_KINDS[word] for word in words[1:-1] if word != "list"]
            if len(kinds) != (2 if words[1] == "list" else 1):
                raise NotSoundError(line)
            elements[-1][2].append((words[-1], kinds))
        else:
            raise NotSoundError(line)
    rows = _ply_words(body) if order == "ascii" else _ply_bytes(body, order)
    next(rows)
    points, corners = [], []
    for name, count, properties in elements:
        if count > 1000:
            raise NotSoundError(count)
        for _ in range(count):
            row = {}
            for one, kinds in properties:
                if len(kinds) == 1:
                    row[one] = rows.send(kinds[0])
                else:
                    row[one] = [rows.send(kinds[1]) for _ in range(int(rows.send(kinds[0])))]
            rows.send("")
            if name == "vertex":
                points.append((row["x"], row["y"], row["z"]))
            elif name == "face":
                corners += _fan(row.get("vertex_indices") or row["vertex_index"])
    rows.send("end")
    if not all(float(corner).is_integer() for corner in corners):
        raise NotSoundError("corner")
    return [_picked(points, int(corner)) for corner in corners]


def _ply_words(body: bytes) -> Iterator[Any]:
    """Yield a number for each kind that is sent; an empty kind ends the line."""
    lines = [line.split() for line in _text(body).split("\n") if line.strip()]
    kind = yield
    at = 0
    while kind != "end":
        words = iter(lines[at])
        while kind:
            word = next(words, "")
            kind = yield (_number(word) if kind in "fd" else _whole(word))
        if next(words, None) is not None:
            raise NotSoundError("more words")
        at += 1
        kind = yield
    if at != len(lines):
        raise NotSoundError("more lines")
    yield


def _ply_bytes(body: bytes, order: str | None) -> Iterator[Any]:
    """Yield a number for each kind that is sent, from bytes."""
    mark = {"binary_little_endian": "<", "binary_big_endian": ">"}[order]
    kind = yield
    at = 0
    while kind != "end":
        if not kind:
            kind = yield
            continue
        (value,) = struct.unpack_from(mark + kind, body, at)
        at += struct.calcsize(mark + kind)
        kind = yield value
    if at != len(body):
        raise NotSoundError("more bytes")
    yield


def _stl_text(content: bytes, _files: Files) -> Corners:
    """Read a text STL file by its grammar."""
    corners: Corners = []
    expected = ["solid"]
    for line in _text(content).split("\n"):
        words = line.split()
        if not words:
            continue
        if words[0] not in expected:
            raise NotSoundError(line)
        if words[0] == "solid":
            expected = ["facet", "endsolid"]
        elif words[0] == "facet":
            expected, loop = ["outer"], []
        elif words[0] == "outer":
            expected = ["vertex"]
        elif words[0] == "vertex":
            loop.append(tuple(_number(word) for word in words[1:]))
            expected = ["vertex"] if len(loop) < 3 else ["endloop"]
        elif words[0] == "endloop":
            corners += loop
            expected = ["endfacet"]
        elif words[0] == "endfacet":
            expected = ["facet", "endsolid"]
        else:
            expected = ["solid"]
    if expected != ["solid"] or any(len(corner) != 3 for corner in corners):
        raise NotSoundError("end")
    return corners


def _stl_binary(content: bytes, _files: Files) -> Corners:
    """Read a binary STL file."""
    (count,) = struct.unpack_from("<I", content, 80)
    if len(content) != 84 + 50 * count:
        raise NotSoundError("length")
    corners: Corners = []
    for k in range(count):
        numbers = struct.unpack_from("<9f", content, 96 + 50 * k)
        corners += [numbers[0:3], numbers[3:6], numbers[6:9]]
    return corners


def _off(content: bytes, _files: Files) -> Corners:
    """Read an OFF file."""
    lines = [line.split("#", 1)[0].split() for line in _text(content).split("\n")]
    lines = [words for words in lines if words]
    if lines[0] != ["OFF"]:
        raise NotSoundError("head")
    vertex_count, face_count, _ = (_whole(word) for word in lines[1])
    if len(lines) != 2 + vertex_count + face_count or min(vertex_count, face_count) < 0:
        raise NotSoundError("lines")
    points = [[_number(word) for word in words] for words in lines[2 : 2 + vertex_count]]
    if any(len(point) < 3 for point in points):
        raise NotSoundError("point")
    corners: Corners = []
    for words in lines[2 + vertex_count :]:
        count = _whole(words[0])
        if len(words) <= count:
            raise NotSoundError("face")
        polygon = [_whole(word) for word in words[1 : 1 + count]]
        corners += [tuple(_picked(points, corner)[:3]) for corner in _fan(polygon)]
    return corners


def _gltf(content: bytes, _files: Files) -> int:
    """Count the triangles at all nodes of a glTF file's scene."""
    if content[:4] == b"glTF":
        (length,) = struct.unpack_from("<I", content, 12)
        content = content[20 : 20 + length]
    document = json.loads(content)
    scenes, nodes = document.get("scenes", []), document.get("nodes", [])
    if not scenes:
        raise NotSoundError("scenes")
    waiting, seen, total = list(scenes[document.get("scene", 0)]["nodes"]), set(), 0
    while waiting:
        number = waiting.pop()
        if number in seen:
            raise NotSoundError("a node of two")
        seen.add(number)
        node = _picked(nodes, number)
        waiting += node.get("children", [])
        if "mesh" in node:
            for one in _picked(document["meshes"], node["mesh"])["primitives"]:
                used = one["indices"] if "indices" in one else one["attributes"]["POSITION"]
                count = _picked(document["accessors"], used)["count"]
                mode = one.get("mode", 4)
                total += count // 3 if mode == 4 else max(count - 2, 0) if mode in (5, 6) else 0
    return total


def _elements(root: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    return [one for one in root.iter() if one.tag.rpartition("}")[2] == name]


def _three_mf(content: bytes, _files: Files) -> int:
    """Count the triangles at all items of a 3MF file of plain objects."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        models = [name for name in archive.namelist() if name.endswith(".model")]
        (model,) = models
        root = ElementTree.fromstring(archive.read(model))
    counts: dict[str, int] = {}
    for one in _elements(root, "object"):
        if one.get("id") in counts:
            raise NotSoundError("an object twice")
        held = [face for group in _elements(one, "triangles") for face in group]
        if len(_elements(one, "triangle")) != len(held):
            raise NotSoundError("a triangle elsewhere")
        counts[one.get("id")] = len(held)
    return sum(counts[item.get("objectid")] for item in _elements(root, "item"))


def _dae(content: bytes, _files: Files) -> int:
    """Count the triangles at all instances in a COLLADA file's scene."""
    root = ElementTree.fromstring(content)
    counts = {}
    for one in _elements(root, "geometry"):
        total = 0
        for part in _elements(one, "triangles"):
            (numbers,) = _elements(part, "p")
            step = 1 + max(_whole(given.get("offset")) for given in _elements(part, "input"))
            words = [_whole(word) for word in (numbers.text or "").split()]
            if len(words) % (3 * step) or len(words) // (3 * step) != _whole(part.get("count")):
                raise NotSoundError("p")
            total += len(words) // (3 * step)
        counts[f"#{one.get('id')}"] = total
    (shown,) = _elements(root, "instance_visual_scene")
    (scene,) = (
        one for one in _elements(root, "visual_scene") if f"#{one.get('id')}" == shown.get("url")
    )
    return sum(counts[one.get("url")] for one in _elements(scene, "instance_geometry"))


def _zae(content: bytes, files: Files) -> int:
    """Count the triangles of the one document in a ZAE file."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (name,) = archive.namelist()
        return _dae(archive.read(name), files)


def _xaml(content: bytes, _files: Files) -> int:
    """Count the triangles of a XAML file."""
    total = 0
    for one in _elements(ElementTree.fromstring(content), "MeshGeometry3D"):
        words = one.get("TriangleIndices").replace(",", " ").split()
        points = len(one.get("Positions").replace(",", " ").split()) // 3
        if not all(0 <= _whole(word) < points for word in words):
            raise NotSoundError("corner")
        total += len(words) // 3
    return total


def _binvox(content: bytes, _files: Files) -> int:
    """Count two triangles for each open side of a full voxel."""
    head, _, pairs = content.partition(b"data\n")
    (sides,) = (line.split()[1:] for line in _text(head).split("\n") if line.startswith("dim"))
    shape = [_whole(word) for word in sides]
    if len(pairs) % 2 or math.prod(shape) > 1 << 20:
        raise NotSoundError("pairs")
    values = [value for value, count in zip(pairs[::2], pairs[1::2], strict=True)
              for _ in range(count)]  # fmt: skip
    full = np.pad(np.array(values).reshape(shape) != 0, 1)
    return 2 * sum(
        int((full & ~np.roll(full, step, axis)).sum()) for axis in range(3) for step in (-1, 1)
    )


READERS: dict[str, Reader] = {
    "obj": _obj, "obj plain": _obj, "ply text": _ply, "ply little": _ply, "ply big": _ply,
    "stl text": _stl_text, "stl_ascii": _stl_text, "stl binary": _stl_binary, "off": _off,
    **dict.fromkeys(("glb", "gltf", "vrm", "glb moving"), _gltf),
    **{f"{codec} {kind}": _gltf for codec in ("draco", "meshopt", "ktx2")
       for kind in ("glb", "gltf")},
    "3mf": _three_mf, "dae": _dae, "zae": _zae, "xaml": _xaml, "binvox": _binvox,
    **{f"picture {kind}": _obj for kind in ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "TGA", "GIF")},
}  # fmt: skip
"""What tells the triangles of each sample."""

READERS_OF_POINTS: dict[str, Reader] = {
    "obj": _obj_points, "obj plain": _obj_points,
    **dict.fromkeys(("pcd text", "pcd binary", "pcd compressed"), _pcd),
    **dict.fromkeys(("xyz", "asc", "txt"), _rows(3)),
    **dict.fromkeys(("xyzn", "xyzrgb"), _rows(6)),
    "pts": _rows(7, "count"), "csv": _rows(3, "x,y,z", ","),
}  # fmt: skip
"""What tells the points of samples that are points, or are where their faces are gone."""
