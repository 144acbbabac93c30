"""
Read OFF files [1]_: positions, faces and colours. Normals and texture coordinates are left out.

References
----------
.. [1] Geomview, "OFF files", http://www.geomview.org/docs/html/OFF.html.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.resources import Resources
from rasterjit.io.text import mesh_builder
from rasterjit.io.text.number_parser import Damage, TextLines, make_row_table, parse_rows
from rasterjit.scene.material import Material

_HEADER = re.compile(r"(?:ST)?C?N?OFF(?![A-Z])(.*)", re.IGNORECASE)
"""First line of a file; the numbers of vertices and faces may follow in it."""

_UNREAD_DATA = {"N": "normal", "ST": "texture coordinates"}
"""Vertex data that is not read, by the letters before ``OFF``."""

_MAX_NUMBERS = 12
"""Most numbers of a vertex: position, normal, colour, texture coordinates."""

_FACE_FORMAT = "a face: how many vertices it has, and their numbers, below"


def read_off(
    path: Path, resources: Resources, damage: Damage, left_out: LeftOut
) -> list[mesh_builder.MeshData]:
    """Return the mesh of an OFF file, or raise `MeshFileError`."""
    data = resources.read_mesh_file(path)
    if b"#" in data:
        data = re.sub(rb"#[^\r\n]*", lambda counts_found: b" " * len(counts_found[0]), data)
    lines = TextLines(data, resources.budget)
    filled = np.flatnonzero(lines.starts < lines.ends)
    header = _HEADER.fullmatch(lines.text(int(filled[0]))) if len(filled) else None
    if header is None:
        raise MeshFileError(f"{path} could not be read as .off: it does not begin with OFF")
    if header[1].strip().upper().startswith("BINARY"):
        raise MeshFileError(f"{path} could not be read as .off: it is binary")
    at = 0 if header[1].strip() else min(1, len(filled) - 1)
    words = (lines.text(int(filled[at])) if at else header[1]).split()
    try:
        vertex_count, face_count = (int(word) for word in words[:2])
        if min(vertex_count, face_count) < 0:
            raise ValueError
    except ValueError:
        raise MeshFileError(
            f"{path} could not be read as .off: {lines.line_label(int(filled[at]))} must give the "
            f"numbers of vertices and faces, got {' '.join(words)[:40]!r}"
        ) from None
    rows = filled[at + 1 : at + 1 + vertex_count]
    if len(rows) < vertex_count:
        damage.report_end(f"{vertex_count} vertices, as its head says", str(len(rows)))
    values, counts_found = parse_rows(lines, rows, 0, 3, "a vertex", damage)
    letters = header[0][: header[0].upper().index("OFF")].upper()
    table, valid = make_row_table(values, counts_found, _MAX_NUMBERS)
    vertices, width = table[:, :3], table.shape[1]
    begin = 6 if "N" in letters else 3
    end = width - 2 if "ST" in letters else width
    vertex_colors = _convert_colors(table[:, begin:end]) if "C" in letters and valid.any() else None
    kinds = [name for letter, name in _UNREAD_DATA.items() if letter in letters]
    if width > 3 and (kinds or vertex_colors is None):
        left_out.note(f"{' and '.join(kinds) or 'further numbers'} of a vertex", int(valid.sum()))
    rows = filled[at + 1 + vertex_count : at + 1 + vertex_count + face_count]
    if len(rows) < face_count:
        damage.report_end(f"{face_count} faces, as its head says", str(len(rows)))
    extra = filled[at + 1 + vertex_count + face_count :]
    if len(extra):
        damage.report_line(lines, int(extra[0]), f"nothing after {face_count} faces")
    values, counts_found = parse_rows(lines, rows, 0, 1, "a face", damage)
    rows, counts_found = rows[counts_found > 0], counts_found[counts_found > 0]
    begins = np.cumsum(counts_found) - counts_found
    sizes = values[begins]
    is_whole = (sizes == np.floor(sizes)) & (sizes >= 0) & (sizes < counts_found)
    for line in rows[~is_whole].tolist():
        damage.report_line(lines, line, f"{_FACE_FORMAT} {len(valid)}")
    rows, begins, counts = rows[is_whole], begins[is_whole] + 1, sizes[is_whole].astype(np.int64)
    extra, ends = counts_found[is_whole] - counts - 1, begins + counts
    shift = begins - (np.cumsum(counts) - counts)
    corners = values[np.arange(int(counts.sum())) + np.repeat(shift, counts)]
    resources.budget.take(
        "the corners of its faces", len(corners) * mesh_builder.POLYGON_CORNER_MEMORY
    )

    def report_face(row: int) -> None:
        damage.report_line(lines, int(rows[row]), f"{_FACE_FORMAT} {len(valid)}")

    corners, counts, face_numbers = mesh_builder.select_polygons(
        corners, counts, valid, report_face, left_out
    )
    if not len(counts):
        raise MeshFileError(f"{path} holds a mesh of {len(vertices)} vertices, no faces")
    faces, polygons = mesh_builder.triangulate(counts, by_size=True)
    face_colors, is_colored = None, extra > 0
    width = extra.max(initial=0)
    if vertex_colors is None and (extra[is_colored] == width).all() and width:
        found_colors = _convert_colors(values[ends[is_colored, np.newaxis] + np.arange(width)])
        if found_colors is not None:
            # The others look as they would without any colours.
            face_colors = np.full((len(extra), 4), Material().base_color_over(False), np.float32)
            face_colors[is_colored] = found_colors
    if face_colors is None:
        left_out.note("colour of a face", int(np.count_nonzero(is_colored)))
    else:
        face_colors = face_colors[face_numbers][polygons]
    if not valid.all():
        vertices = np.where(valid[:, np.newaxis], vertices, 0.0)
    colors = vertex_colors if face_colors is None else face_colors
    return [mesh_builder.MeshData(path.name, vertices, corners[faces], colors=colors)]


def _convert_colors(codes: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Return sRGB colours, bytes or 0..1, as linear RGBA; None if they are none."""
    if codes.shape[1] not in (3, 4) or not np.isfinite(codes).all():
        return None
    is_bytes = bool((codes == np.floor(codes)).all() and codes.max() > 1.0)
    return mesh_builder.srgb_to_rgba(codes / 255.0 if is_bytes else codes)
