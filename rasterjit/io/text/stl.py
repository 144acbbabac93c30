"""Read STL files, binary and text, as unconnected triangles; normals are computed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.resources import Resources
from rasterjit.io.text.mesh_builder import MeshData, Names
from rasterjit.io.text.number_parser import (
    MEMORY_PER_BINARY_BYTE,
    Damage,
    TextLines,
    make_row_table,
    parse_rows,
)

_HEADER_BYTES = 84
"""Bytes of a binary file before its triangles: a text of 80, and their number."""

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])

_TEXT_PROBE_BYTES = 1024
"""Leading bytes of a file that are searched for a zero, which no text has."""


def read_stl(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[MeshData]:
    """Return the meshes of an STL file, or raise `MeshFileError`."""
    data = resources.read_mesh_file(path)
    count = int.from_bytes(data[80:_HEADER_BYTES], "little")
    capacity, rest = divmod(len(data) - _HEADER_BYTES, _TRIANGLE.itemsize)
    is_binary = len(data) >= _HEADER_BYTES and (capacity, rest) == (count, 0)
    if is_binary or (len(data) >= _HEADER_BYTES and b"\0" in data[:_TEXT_PROBE_BYTES]):
        if capacity < count:
            damage.report_end(f"{count} triangles, as its head says", f"room for {capacity}")
        elif not is_binary:
            extra = len(data) - _HEADER_BYTES - count * _TRIANGLE.itemsize
            damage.report_end(f"nothing after {count} triangles", f"{extra} bytes")
        resources.budget.take("its triangles", MEMORY_PER_BINARY_BYTE * len(data))
        triangles = np.frombuffer(data, _TRIANGLE, min(count, capacity), _HEADER_BYTES)
        attribute_count = int(np.count_nonzero(triangles["attribute"]))
        left_out.note("colour or attribute of a triangle", attribute_count)
        vertices = triangles["vertices"].reshape(-1, 3)
        parts = [_make_mesh(path.name, vertices)] if len(vertices) else []
    else:
        parts = list(_read_solids(TextLines(data, resources.budget), path.name, damage, left_out))
    if not parts:
        raise MeshFileError(f"{path} holds no faces")
    return parts


def _make_mesh(name: str, vertices: NDArray) -> MeshData:
    """Return a mesh of unconnected triangles."""
    return MeshData(name, vertices.astype(np.float64), np.arange(len(vertices)).reshape(-1, 3))


def _read_solids(
    lines: TextLines, file_name: str, damage: Damage, left_out: LeftOut
) -> Iterator[MeshData]:
    """Yield a mesh for each solid of a text file that has triangles."""
    first, second, fourth = (lines.byte_at(offset) | 0x20 for offset in (0, 1, 3))
    solids = np.flatnonzero((first == ord("s")) & (second == ord("o")))
    facets = np.flatnonzero((first == ord("f")) & (second == ord("a")))
    corners = np.flatnonzero((first == ord("v")) & (second == ord("e")))
    ends = np.flatnonzero((first == ord("e")) & (second == ord("n")) & (fourth == ord("s")))
    if not len(corners):
        return
    is_known = np.isin(first, np.frombuffer(b"sfve", np.uint8)) | (
        (first == ord("o")) & (second == ord("u"))
    )
    lines.note_unknown(np.flatnonzero(~is_known & (lines.starts < lines.ends)), left_out)
    if not len(ends) or ends[-1] < corners[-1]:
        damage.report_end("'endsolid'", lines.quote(len(lines) - 1))
    values, counts = parse_rows(lines, corners, len("vertex"), 3, "a vertex", damage)
    vertices, valid = make_row_table(values, counts, 3)
    facet = np.searchsorted(facets, corners)
    sizes = np.bincount(facet, minlength=len(facets) + 1)
    is_whole = sizes == 3
    is_whole[facet[~valid]] = False
    is_whole[0] = False
    for number in np.flatnonzero((sizes != 3) & (np.arange(len(sizes)) > 0)).tolist():
        damage.report_line(
            lines, int(facets[number - 1]), f"a facet of 3 vertices, not {sizes[number]}"
        )
    if sizes[0]:
        damage.report_line(lines, int(corners[0]), "'facet' before it")
    is_kept = is_whole[facet]
    # A solid that begins within a triangle has the next one first.
    solid, names = np.repeat(np.searchsorted(solids, corners[is_kept][::3]), 3), Names()
    vertices = vertices[is_kept]
    bounds = np.concatenate(([0], np.flatnonzero(np.diff(solid)) + 1, [len(solid)]))
    for begin, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        if begin < end:
            number = int(solid[begin])
            name = lines.text(int(solids[number - 1]))[len("solid") :].strip() if number else ""
            yield _make_mesh(names.unique(name or file_name), vertices[begin:end])
