"""
Read PLY files [1]_: text and binary of both byte orders, lists of any length.

References
----------
.. [1] G. Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import Cloud, LineSet
from rasterjit.io.resources import RefusedFileError, Resources, quote_name
from rasterjit.io.text import mesh_builder
from rasterjit.io.text.mesh_builder import Geometry, MeshData, Names
from rasterjit.io.text.mtl import MtlMaterial, convert_mtl_material
from rasterjit.io.text.number_parser import (
    MEMORY_PER_BINARY_BYTE,
    Damage,
    TextLines,
    find_line_ending,
    parse_rows,
)
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.texture import Texture

_DTYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float16": "f2",
    "float32": "f4", "float64": "f8",
}  # fmt: skip

_BYTE_ORDERS: dict[str, Literal["=", "<", ">"]] = {
    "ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">",
}  # fmt: skip

_POSITION, _NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
_COLORS = (("red", "green", "blue", "alpha"), ("red", "green", "blue"))

_UV = (
    ("texture_u", "texture_v"), ("u", "v"), ("s", "t"), ("texture_s", "texture_t"),
    ("tex_u", "tex_v"), ("texcoord_u", "texcoord_v"), ("texcoord_s", "texcoord_t"), ("tu", "tv"),
)  # fmt: skip
"""Names of texture coordinates of vertices."""

_CORNER_UV = ("texcoord", "texcoords", "texture_coordinates", "tex_coord", "uv", "uvs")
"""Names of lists of texture coordinates for the corners of a face."""

_TEXTURE_NUMBERS = ("texnumber", "texture_number", "tex_number")
"""Names of the number of a face's or vertex's texture file."""

_INDEX_LISTS = ("vertex_index", "vertex_indices")

_EDGE_ENDS = ("vertex1", "vertex2")
"""Names of the ends of an edge."""

_STRIPS = "tristrips"

_KNOWN_NAMES = (
    _POSITION, _NORMAL, *_COLORS, *_UV, _EDGE_ENDS,
    *((name,) for name in (*_CORNER_UV, *_TEXTURE_NUMBERS, *_INDEX_LISTS)),
)  # fmt: skip
"""Names of properties that are read in any case."""

_RESTART_INDEX = -1
"""Index that restarts a strip: -1, or the largest of an unsigned type."""

_TEXTURE_COMMENT = re.compile(
    r"(?:comment|obj_info)\s+(?:texture_?file[:=]?\s*(\S.*)"
    r"|texture[:=]?\s+(\S.*\.(?:png|jpe?g|tga|bmp|tiff?|webp|gif)))",
    re.IGNORECASE,
)
"""A comment of the header that names a texture file."""


@dataclass
class _Property:
    """A property of an element: a value or a list of values."""

    name: str
    dtype: np.dtype
    count_dtype: np.dtype | None = None


@dataclass
class _Element:
    """
    An element: rows of one kind, such as vertices.

    After it is read, ``columns`` has the values of each property, and of a list all of them, with
    their numbers in ``counts``; ``valid`` tells the rows that are not damaged.
    """

    name: str
    length: int
    properties: list[_Property] = field(default_factory=list)
    columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    counts: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    valid: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    lines: NDArray[np.int64] | None = None

    def attributes(self, left_out: LeftOut, excluded: set[str]) -> dict[str, NDArray[Any]]:
        """
        Return further properties as attributes: (N,), or of lists (N, D).

        ``excluded`` are names of what is; lists of several lengths are left out.
        """
        arrays = {}
        for name, values in self.columns.items():
            if name in excluded:
                continue
            if name not in self.counts:
                arrays[name] = values
            else:
                counts = self.counts[name]
                lengths = np.unique(counts[self.valid])
                if len(lengths) == 1 and lengths[0] > 0:
                    # Damaged rows may have others: they have zeros.
                    rows = np.flatnonzero(self.valid)
                    begins = (np.cumsum(counts) - counts)[rows, np.newaxis]
                    arrays[name] = np.zeros((len(counts), int(lengths[0])), values.dtype)
                    arrays[name][rows] = values[begins + np.arange(lengths[0])]
                elif len(lengths) > 1:
                    what = f"{self.name} lists {name!r} of several lengths"
                    left_out.note(what, len(counts))
        return arrays

    def present(self, *groups: tuple[str, ...]) -> set[str]:
        """Return the first group of names that is complete, or none."""
        return set(next((names for names in groups if self.stack(names) is not None), ()))

    def stack(self, names: tuple[str, ...]) -> NDArray[Any] | None:
        """Return single values as columns; None if one is missing."""
        if any(name not in self.columns or name in self.counts for name in names):
            return None
        return np.column_stack([self.columns[name] for name in names])


def read_ply(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Geometry]:
    """Return the mesh of a PLY file, else its edges, else its points, or raise `MeshFileError`."""
    data = resources.read_mesh_file(path)
    try:
        order, elements, pictures, at = _read_header(data)
    except ValueError as error:
        raise MeshFileError(f"{path} could not be read as .ply: {error}") from None
    lines = None
    if order == "=":
        lines = TextLines(data, resources.budget, at)
        _read_text(lines, elements, damage)
    else:
        resources.budget.take("its rows", MEMORY_PER_BINARY_BYTE * len(data))
        _read_binary(data, at, elements, damage)
    by_name = {element.name: element for element in elements}
    for name, element in by_name.items():
        left_out.expect(f"element {name!r}", element.length)
    vertex = by_name.get("vertex")
    positions = vertex.stack(_POSITION) if vertex is not None else None
    if vertex is None or positions is None or not len(positions):
        raise MeshFileError(f"{path} holds no faces and no points")
    left_out.mark_read("element 'vertex'", vertex.length)
    face, edge = _merge_strips(by_name, left_out), by_name.get("edge")
    ends = None if edge is None else edge.stack(_EDGE_ENDS)
    polygons = None
    if face is not None:
        polygons = _select_faces(face, vertex.valid, lines, damage, left_out, resources.budget)
    if face is None or polygons is None or not len(polygons.counts):
        if edge is not None and ends is not None and len(ends):
            left_out.mark_read("element 'edge'", edge.length)
            return [_make_edge_lines(path, vertex, edge, ends, damage, left_out)]
        left_out.expect("texture file", len(pictures))
        return [_make_cloud(path, vertex, left_out)]
    return _make_meshes(path.name, vertex, face, polygons, pictures, resources, left_out)


def _make_cloud(path: Path, vertex: _Element, left_out: LeftOut) -> Cloud:
    """Return the vertices of a file without faces as a cloud, without damaged ones."""
    valid = vertex.valid
    positions, normals = vertex.stack(_POSITION), vertex.stack(_NORMAL)
    if positions is None or not valid.any():
        raise MeshFileError(f"{path} holds a point cloud of no points")
    colors = _stack_colors(vertex)
    used = vertex.present(_POSITION) | vertex.present(_NORMAL) | vertex.present(*_COLORS)
    return Cloud(
        path.name, positions[valid].astype(np.float64),
        None if colors is None else mesh_builder.srgb_to_rgba(colors[valid]),
        None if normals is None else normals[valid],
        {name: values[valid] for name, values in vertex.attributes(left_out, used).items()},
    )  # fmt: skip


def _make_edge_lines(
    path: Path, vertex: _Element, edge: _Element, ends: NDArray[Any], damage: Damage,
    left_out: LeftOut,
) -> LineSet:  # fmt: skip
    """Return the edges of a file without faces as a line set."""
    valid, positions = vertex.valid, vertex.stack(_POSITION)
    sound = edge.valid & ((ends >= 0) & (ends < len(valid)) & (ends == np.floor(ends))).all(axis=1)
    sound[sound] = valid[ends[sound].astype(np.int64)].all(axis=1)
    for row in np.flatnonzero(edge.valid & ~sound).tolist():
        expected = f"numbers of vertices below {len(valid)} in an edge"
        damage.report_end(expected, f"{ends[row].tolist()} in edge {row}")
    if positions is None or not sound.any():
        raise MeshFileError(f"{path} holds edges, none of which joins two of its vertices")
    of_vertices, of_edges = _stack_colors(vertex), _stack_colors(edge)
    colors = of_vertices if of_edges is None else of_edges[sound]
    attributes = edge.attributes(left_out, edge.present(*_COLORS) | set(_EDGE_ENDS))
    used = vertex.present(_POSITION) | (vertex.present(*_COLORS) if of_edges is None else set())
    return LineSet(
        path.name, np.where(valid[:, np.newaxis], positions, 0.0).astype(np.float64),
        ends[sound].astype(np.int64),
        None if colors is None else mesh_builder.srgb_to_rgba(colors),
        of_edges is not None, vertex.attributes(left_out, used),
        {name: values[sound] for name, values in attributes.items()},
    )  # fmt: skip


def _read_header(data: bytes) -> tuple[str, list[_Element], list[str], int]:
    """
    Read the header of a file, or raise ``ValueError``.

    Returns
    -------
    order : {"=", "<", ">"}
        Byte order; ``"="`` for text.
    elements : list of _Element
    pictures : list of str
        Names of the textures' files.
    at : int
        Where the rows begin.
    """
    # Line by line, up to end_header.
    order, at, number, ending = None, 0, 0, find_line_ending(data)
    elements: list[_Element] = []
    pictures: dict[str, None] = {}
    while True:
        end = data.find(ending, at)
        if number and end < 0:
            raise ValueError("its head has no end_header")
        text = data[at : end if end >= 0 else len(data)].decode("utf-8", "replace").strip()
        at, number = end + 1, number + 1
        words = text.split()
        if number == 1:
            if text.lower() != "ply":
                raise ValueError("it does not begin with ply")
            if end < 0:
                raise ValueError("its head has no end_header")
        elif not words:
            continue
        elif words[0] == "end_header":
            break
        elif words[0] == "format":
            order = _BYTE_ORDERS.get(words[1].lower()) if len(words) > 1 else None
            if order is None:
                raise ValueError(f"line {number}: format must be one of {', '.join(_BYTE_ORDERS)}")
        elif words[0] in ("element", "property"):
            try:
                _add_declaration(words, elements)
            except (ValueError, LookupError):
                raise ValueError(
                    f"line {number}: expected an element or a property, got {text[:40]!r}"
                ) from None
        elif match := _TEXTURE_COMMENT.fullmatch(text):
            pictures[(match[1] or match[2]).strip().strip("\"'")] = None
        elif words[0] not in ("comment", "obj_info"):
            raise ValueError(
                f"line {number}: expected format, comment, obj_info, element, property or "
                f"end_header, got {text[:40]!r}"
            )
    # Names as they are meant, numbers in the file's byte order.
    if order is None:
        raise ValueError("its head has no format")
    for element in elements:
        names = mesh_builder.normalize_names([one.name for one in element.properties], _KNOWN_NAMES)
        for one, name in zip(element.properties, names, strict=True):
            one.name = name
            one.dtype = one.dtype.newbyteorder(order)
            if one.count_dtype is not None:
                one.count_dtype = one.count_dtype.newbyteorder(order)
    return order, elements, list(pictures), at


def _add_declaration(words: list[str], elements: list[_Element]) -> None:
    """Add the element or property of a header line, or raise ``ValueError``."""
    if words[0] == "element":
        _, name, length = words
        if int(length) < 0 or any(element.name == name for element in elements):
            raise ValueError(name)
        elements.append(_Element(name, int(length)))
        return
    if words[1] == "list":
        _, _, count, dtype, name = words
        declared = _Property(name, np.dtype(_DTYPES[dtype]), np.dtype(_DTYPES[count]))
    else:
        _, dtype, name = words
        declared = _Property(name, np.dtype(_DTYPES[dtype]))
    if any(one.name == name for one in elements[-1].properties):
        raise ValueError(name)
    elements[-1].properties.append(declared)


def _read_text(lines: TextLines, elements: list[_Element], damage: Damage) -> None:
    """Parse the rows of a text file, a line each."""
    filled = np.flatnonzero(lines.starts < lines.ends)
    at = 0
    for element in elements:
        if not element.properties:
            continue
        rows = filled[at : at + element.length]
        at += len(rows)
        if len(rows) < element.length:
            damage.report_end(
                f"{element.length} lines of {element.name}, as its head says", str(len(rows))
            )
        what = f"{element.name} ({', '.join(one.name for one in element.properties)})"
        least = len(element.properties)
        values, counts_found = parse_rows(lines, rows, 0, least, what, damage)
        element.lines, element.valid = rows, counts_found > 0
        begin = np.cumsum(counts_found) - counts_found
        end = begin + counts_found
        for one in element.properties:
            _mark_invalid(element, begin < end, lines, what, damage)
            firsts = np.where(element.valid, begin, 0)
            column = values[firsts] if len(values) else np.zeros(len(rows))
            begin = begin + element.valid
            if one.count_dtype is None:
                element.columns[one.name] = _cast(column, one.dtype)
                continue
            # A list: the number of its values stands before them.
            fits = (column == np.floor(column)) & (column >= 0) & (column <= end - begin)
            _mark_invalid(element, fits, lines, what, damage)
            counts = np.where(element.valid, column, 0.0).astype(np.int64)
            value_rows = np.arange(int(counts.sum()))
            value_rows += np.repeat(begin - (np.cumsum(counts) - counts), counts)
            element.columns[one.name] = _cast(values[value_rows], one.dtype)
            element.counts[one.name] = counts
            begin = begin + counts
        _mark_invalid(element, begin == end, lines, what, damage)
    if at < len(filled):
        damage.report_line(lines, int(filled[at]), "no line behind those that its head says")


def _mark_invalid(
    element: _Element, fits: NDArray[np.bool_], lines: TextLines, what: str, damage: Damage
) -> None:
    """Report rows that do not fit, and mark them invalid."""
    bad = element.valid & ~fits
    numbers = np.zeros(len(bad), np.int64) if element.lines is None else element.lines
    for row in np.flatnonzero(bad).tolist():
        damage.report_line(lines, int(numbers[row]), f"as many numbers as {what} has")
    element.valid &= ~bad


def _cast(values: NDArray[np.float64], dtype: np.dtype) -> NDArray[Any]:
    """Convert numbers of a text to the declared type."""
    with np.errstate(invalid="ignore", over="ignore"):
        return values.astype(dtype)


def _read_binary(data: bytes, at: int, elements: list[_Element], damage: Damage) -> None:
    """Read the rows of a binary file."""
    for element in elements:
        if not element.properties:
            continue
        row_bytes = sum((one.count_dtype or one.dtype).itemsize for one in element.properties)
        max_rows = max(0, (len(data) - at) // row_bytes)
        if all(one.count_dtype is None for one in element.properties):
            length = min(element.length, max_rows)
            rows = np.frombuffer(data, _make_row_type(element, {}), length, at) if length else None
            _store_rows(element, rows, {})
            at += length * row_bytes
        else:
            length, at = _read_lists(data, at, element)
        element.valid = np.ones(length, bool)
        if length < element.length:
            damage.report_end(
                f"{element.length} rows of {element.name}, as its head says", str(length)
            )
            at = len(data)
    rest = data[at:]
    if rest.strip():
        damage.report_end("nothing after the rows that its head says", f"{len(rest)} bytes")


def _make_row_type(element: _Element, counts: dict[str, int]) -> np.dtype:
    """Return the type of a row whose lists have given lengths."""
    fields: list[tuple[Any, ...]] = []
    for number, one in enumerate(element.properties):
        if one.count_dtype is not None:
            fields.append((f"n{number}", one.count_dtype))
            fields.append((f"v{number}", one.dtype, (counts[one.name],)))
        else:
            fields.append((f"v{number}", one.dtype))
    return np.dtype(fields)


def _store_rows(element: _Element, rows: NDArray[Any] | None, counts: dict[str, int]) -> None:
    """Store rows of one type as columns."""
    for number, one in enumerate(element.properties):
        values = np.zeros(0, one.dtype) if rows is None else rows[f"v{number}"].reshape(-1)
        element.columns[one.name] = values.astype(one.dtype.newbyteorder("="))
        if one.count_dtype is not None:
            length = 0 if rows is None else len(rows)
            element.counts[one.name] = np.full(length, counts.get(one.name, 0))


def _read_lists(data: bytes, at: int, element: _Element) -> tuple[int, int]:
    """Read rows with lists; return the number of complete rows, and their end."""
    first = _read_layout(data, at, element)
    if first is None:
        _store_rows(element, None, {})
        return 0, at
    counts = {one.name: first[1][n] for n, one in enumerate(element.properties)}
    dtype = _make_row_type(element, counts)
    if element.length * dtype.itemsize <= len(data) - at:
        rows = np.frombuffer(data, dtype, element.length, at)
        if all(
            (rows[f"n{n}"] == counts[one.name]).all()
            for n, one in enumerate(element.properties)
            if one.count_dtype is not None
        ):
            _store_rows(element, rows, counts)
            return element.length, at + element.length * dtype.itemsize
    pieces = [bytearray() for _ in element.properties]
    numbers = [array("q") for _ in element.properties]
    length = 0
    while length < element.length:
        row = _read_layout(data, at, element)
        if row is None:
            break
        begins, row_counts, at = row
        for n, one in enumerate(element.properties):
            pieces[n] += data[begins[n] : begins[n] + row_counts[n] * one.dtype.itemsize]
            numbers[n].append(row_counts[n])
        length += 1
    for n, one in enumerate(element.properties):
        column = np.frombuffer(pieces[n], one.dtype)
        element.columns[one.name] = column.astype(one.dtype.newbyteorder("="))
        if one.count_dtype is not None:
            element.counts[one.name] = np.array(numbers[n], np.int64)
    return length, at


def _read_layout(
    data: bytes, at: int, element: _Element
) -> tuple[list[int], list[int], int] | None:
    """Return offsets and counts of a row's values, and its end; None if it is cut short."""
    begins, counts = [], []
    for one in element.properties:
        count = 1
        if one.count_dtype is not None:
            size = one.count_dtype.itemsize
            if at + size > len(data):
                return None
            if one.count_dtype.kind == "f":
                number = float(np.frombuffer(data, one.count_dtype, 1, at)[0])
                count = int(number) if number >= 0 and number.is_integer() else -1
            else:
                order: Literal["big", "little"] = (
                    "big" if one.count_dtype.str[0] == ">" else "little"
                )
                is_signed = one.count_dtype.kind == "i"
                count = int.from_bytes(data[at : at + size], order, signed=is_signed)
            if count < 0:
                return None
            at += size
        begins.append(at)
        counts.append(count)
        at += count * one.dtype.itemsize
        if at > len(data):
            return None
    return begins, counts, at


class _Polygons(NamedTuple):
    """
    The valid faces of a file.

    Parameters
    ----------
    corners : (N,) int64
        Numbers of vertices, one polygon after the other.
    counts, rows : (G,) int64
        Corners of each polygon, and its row of the element.
    all_counts : (F,) int64
        Corners of all rows.
    """

    corners: NDArray[np.int64]
    counts: NDArray[np.int64]
    rows: NDArray[np.int64]
    all_counts: NDArray[np.int64]

    def select(self, selected: NDArray[np.bool_]) -> _Polygons:
        """Return the polygons of a mask."""
        corners = self.corners[np.repeat(selected, self.counts)]
        return _Polygons(corners, self.counts[selected], self.rows[selected], self.all_counts)


def _merge_strips(by_name: dict[str, _Element], left_out: LeftOut) -> _Element | None:
    """Return the faces of a file followed by the triangles of its strips; None without any."""
    face, strips = by_name.get("face"), by_name.get(_STRIPS)
    name = None if face is None else _find_corners(face)
    of_strips = None if strips is None else _find_corners(strips)
    if face is not None and name is not None:
        left_out.mark_read("element 'face'", face.length)
    if strips is None or of_strips is None:
        return face
    left_out.mark_read(f"element {_STRIPS!r}", strips.length)
    cut = _triangulate_strips(strips, of_strips, name or _INDEX_LISTS[0])
    if face is None or name is None or not face.length:
        return cut
    both = _Element("face", face.length + cut.length)
    both.valid = np.concatenate([face.valid, cut.valid])
    both.counts[name] = np.concatenate([face.counts[name], cut.counts[name]])
    if face.lines is not None and cut.lines is not None:
        both.lines = np.concatenate([face.lines, cut.lines])
    shared = [one for one in face.columns if one == name or one in cut.columns]
    for one in shared:
        both.columns[one] = np.concatenate([face.columns[one], cut.columns[one]])
    for element in (face, cut):
        for one in element.columns.keys() - set(shared):
            left_out.note(f"property {one!r} of faces beside strips", element.length)
    return both


def _triangulate_strips(strips: _Element, of_strips: str, name: str) -> _Element:
    """Return the triangles of strips as faces, with the single values of their strips."""
    corners, counts = strips.columns[of_strips], strips.counts[of_strips]
    restarts = {
        _RESTART_INDEX,
        *([np.iinfo(corners.dtype).max] if corners.dtype.kind == "u" else []),
    }
    ends = np.isin(corners, list(restarts))
    of_corners = np.repeat(np.arange(len(counts)), counts)[~ends]
    # A strip goes on to its end, or to where it begins anew.
    run = (np.cumsum(ends) + np.repeat(np.arange(len(counts)), counts))[~ends]
    begins = np.flatnonzero(np.diff(run, prepend=-1))
    lengths = np.diff(begins, append=len(run))
    corner_rows, of_runs = mesh_builder.triangulate_strips(lengths)
    rows = of_corners[begins[of_runs]] if len(begins) else np.zeros(0, np.int64)
    triangles_element = _Element("face", len(rows), valid=strips.valid[rows])
    triangles_element.columns[name] = corners[~ends][corner_rows].reshape(-1)
    triangles_element.counts[name] = np.full(len(rows), 3)
    for one, values in strips.columns.items():
        if one not in strips.counts:
            triangles_element.columns[one] = values[rows]
    triangles_element.lines = None if strips.lines is None else strips.lines[rows]
    return triangles_element


def _select_faces(
    face: _Element,
    valid: NDArray[np.bool_],
    lines: TextLines | None,
    damage: Damage,
    left_out: LeftOut,
    budget: MemoryBudget,
) -> _Polygons | None:
    """Return the valid faces; None if there are no lists of corners."""
    name = _find_corners(face)
    if name is None:
        return None
    counts = face.counts[name]
    begins = np.cumsum(counts) - counts

    def report(row: int) -> None:
        expected = f"numbers of vertices below {len(valid)} in a face"
        if lines is not None and face.lines is not None:
            damage.report_line(lines, int(face.lines[row]), expected)
        else:
            begin = int(begins[row])
            corner_numbers = face.columns[name][begin : begin + int(counts[row])][:8].tolist()
            damage.report_end(expected, f"{corner_numbers} in face {row}")

    budget.take(
        "the corners of its faces", len(face.columns[name]) * mesh_builder.POLYGON_CORNER_MEMORY
    )
    corners, sizes, rows = mesh_builder.select_polygons(
        face.columns[name], counts, valid, report, left_out
    )
    return _Polygons(corners, sizes, rows, counts)


def _find_corners(face: _Element) -> str | None:
    """Return the name of the lists of corners, or None."""
    name = next((one for one in _INDEX_LISTS if one in face.counts), None)
    return next(iter(face.counts)) if name is None and len(face.counts) == 1 else name


def _make_meshes(
    name: str,
    vertex: _Element,
    face: _Element,
    polygons: _Polygons,
    pictures: list[str],
    resources: Resources,
    left_out: LeftOut,
) -> list[Geometry]:
    """Return a mesh for each texture file that faces use, or one."""
    has_uv = bool(_find_corner_uv(face, polygons) or vertex.present(*_UV))
    if not has_uv:
        left_out.expect("texture file without texture coordinates", len(pictures))
        return [_make_mesh(name, vertex, face, polygons, None, left_out)]
    if len(pictures) < 2:
        texture = _read_texture(pictures[0], resources, left_out) if pictures else None
        return [_make_mesh(name, vertex, face, polygons, texture, left_out)]
    numbers = _find_textures(vertex, face, polygons)
    if numbers is None:
        left_out.note("further texture file, which no face names", len(pictures) - 1)
        texture = _read_texture(pictures[0], resources, left_out)
        return [_make_mesh(name, vertex, face, polygons, texture, left_out)]
    parts: list[Geometry] = []
    names = Names()
    for number in np.unique(numbers).tolist():
        texture = None
        if 0 <= number < len(pictures):
            texture = _read_texture(pictures[int(number)], resources, left_out)
        selected = polygons.select(numbers == number)
        parts.append(_make_mesh(names.unique(name), vertex, face, selected, texture, left_out))
    return parts


def _find_textures(vertex: _Element, face: _Element, polygons: _Polygons) -> NDArray[Any] | None:
    """Return the texture number of each polygon, by it or its first corner, or None."""
    for element in (face, vertex):
        name = next((one for one in _TEXTURE_NUMBERS if one in element.columns), None)
        if name is not None and name not in element.counts:
            firsts = polygons.corners[np.cumsum(polygons.counts) - polygons.counts]
            return element.columns[name][polygons.rows if element is face else firsts]
    return None


def _make_mesh(
    name: str,
    vertex: _Element,
    face: _Element,
    polygons: _Polygons,
    texture: Texture | None,
    left_out: LeftOut,
) -> MeshData:
    """Return a mesh, with vertices split where faces differ in texture coordinates."""
    # What tells the corners of a vertex apart: texture coordinates.
    corners, counts, rows, _ = polygons
    positions = vertex.stack(_POSITION)
    assert positions is not None
    of_corners = _find_corner_uv(face, polygons)
    numbers, uv_names = corners[:, np.newaxis], set()
    uv = None
    if of_corners is not None:
        uv = _take_corner_uv(face, of_corners, polygons)
        numbers = np.column_stack([corners, distinct_rows(*uv.T)[0]])
    elif uv_names := vertex.present(*_UV):
        table = vertex.stack(next(one for one in _UV if set(one) == uv_names))
        uv = None if table is None else table[corners]
    # A vertex for each that differs.
    which, vertex_corners = corners, None
    if uv is not None or not vertex.valid.all():
        picked, which = mesh_builder.number_rows(numbers)
        vertex_corners, uv = corners[picked], None if uv is None else uv[picked]
    # Triangles of the polygons.
    cut, of_polygons = mesh_builder.triangulate(counts, by_size=True)
    # Colours, of vertices or of faces.
    of_vertices = vertex.present(*_COLORS)
    colors, face_colors = _stack_colors(vertex), set()
    if colors is None:
        of_faces, face_colors = _stack_colors(face), face.present(*_COLORS)
        colors = None if of_faces is None else of_faces[rows[of_polygons]]
    # Other attributes of the vertices.
    used = vertex.present(_POSITION) | vertex.present(_NORMAL) | of_vertices | uv_names
    normals = vertex.stack(_NORMAL)
    attributes = vertex.attributes(left_out, used | set(_TEXTURE_NUMBERS))
    if vertex_corners is not None:
        attributes = {name: values[vertex_corners] for name, values in attributes.items()}
        positions = positions[vertex_corners]
        normals = None if normals is None else normals[vertex_corners]
        colors = colors if colors is None or not of_vertices else colors[vertex_corners]
    # A texture, or colours: not both.
    material = None
    if uv is not None:
        material = convert_mtl_material(MtlMaterial("material_0"), texture, False, left_out)
    if colors is not None and material is not None:
        left_out.note(mesh_builder.COLORS_NOTE)
        colors = None
    elif colors is not None:
        colors = mesh_builder.srgb_to_rgba(colors)
    # Other attributes of the faces.
    used = {str(_find_corners(face)), str(of_corners), *_TEXTURE_NUMBERS, *face_colors}
    face_attributes = {
        name: values[rows[of_polygons]] for name, values in face.attributes(left_out, used).items()
    }
    return MeshData(
        name, positions.astype(np.float64), which[cut], normals, uv, colors, material, attributes,
        face_attributes,
    )  # fmt: skip


def _find_corner_uv(face: _Element, polygons: _Polygons) -> str | None:
    """Return the name of the lists of corners' texture coordinates, or None."""
    for name in _CORNER_UV:
        uv_counts = face.counts.get(name)
        if uv_counts is not None and np.array_equal(uv_counts, 2 * polygons.all_counts):
            return name
    return None


def _take_corner_uv(face: _Element, name: str, polygons: _Polygons) -> NDArray[Any]:
    """Return the texture coordinates of the corners of the polygons, (N, 2)."""
    is_kept = np.zeros(len(polygons.all_counts), bool)
    is_kept[polygons.rows] = True
    pairs = face.columns[name].reshape(-1, 2)
    return pairs[np.repeat(is_kept, polygons.all_counts)]


def _stack_colors(element: _Element) -> NDArray[Any] | None:
    """Return the colours of an element's rows, unconverted, or None."""
    rgba = element.stack(_COLORS[0])
    return element.stack(_COLORS[1]) if rgba is None else rgba


def _read_texture(name: str, resources: Resources, left_out: LeftOut) -> Texture | None:
    """Return a texture file; None, with a note, if it cannot be read."""
    try:
        content = resources.read(name)
        what = f"picture {quote_name(name)}"
        return Texture(resources.decoder.decode("picture", content, what, ()))
    except RefusedFileError as error:
        left_out.note(f"a file that it names: {reason_of(error)}")
    except Exception as error:
        # Pillow raises what it likes about a damaged picture.
        left_out.note(f"picture {quote_name(name)} that cannot be read: {reason_of(error)}")
    return None
