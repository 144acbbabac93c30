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
from rasterjit.io.text.number_parser import Damage, TextLines, columns, number_rows
from rasterjit.scene.material import Material

_HEADER = re.compile(r"(?:ST)?C?N?OFF(?![A-Z])(.*)", re.IGNORECASE)
"""Some files have the numbers of vertices and faces right behind it."""

_BESIDE = {"N": "normal", "ST": "texture coordinates"}
"""What vertices have besides positions and colours, by the letters before ``OFF``."""

_MAX = 12
"""Numbers of a vertex that are looked at: position, normal, colour, texture coordinates."""

_A_FACE = "a face: how many vertices it has, and their numbers, below"


def read_off(
    path: Path, resources: Resources, damage: Damage, left_out: LeftOut
) -> list[mesh_builder.Part]:
    """Return the mesh of an OFF file, or raise `MeshFileError`."""
    data = resources.read_itself(path)
    if b"#" in data:
        data = re.sub(rb"#[^\r\n]*", lambda found: b" " * len(found[0]), data)
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
            f"{path} could not be read as .off: {lines.where(int(filled[at]))} must give the "
            f"numbers of vertices and faces, got {' '.join(words)[:40]!r}"
        ) from None
    rows = filled[at + 1 : at + 1 + vertex_count]
    if len(rows) < vertex_count:
        damage.end(f"{vertex_count} vertices, as its head says", str(len(rows)))
    values, found = number_rows(lines, rows, 0, 3, "a vertex", damage)
    letters = header[0][: header[0].upper().index("OFF")].upper()
    table, there = columns(values, found, _MAX)
    vertices, width = table[:, :3], table.shape[1]
    begin = 6 if "N" in letters else 3
    end = width - 2 if "ST" in letters else width
    vertex_colors = _colors(table[:, begin:end]) if "C" in letters and there.any() else None
    kinds = [name for letter, name in _BESIDE.items() if letter in letters]
    if width > 3 and (kinds or vertex_colors is None):
        left_out.note(f"{' and '.join(kinds) or 'further numbers'} of a vertex", int(there.sum()))
    rows = filled[at + 1 + vertex_count : at + 1 + vertex_count + face_count]
    if len(rows) < face_count:
        damage.end(f"{face_count} faces, as its head says", str(len(rows)))
    behind = filled[at + 1 + vertex_count + face_count :]
    if len(behind):
        damage.line(lines, int(behind[0]), f"nothing after {face_count} faces")
    values, found = number_rows(lines, rows, 0, 1, "a face", damage)
    rows, found = rows[found > 0], found[found > 0]
    begins = np.cumsum(found) - found
    said = values[begins]
    good = (said == np.floor(said)) & (said >= 0) & (said < found)
    for line in rows[~good].tolist():
        damage.line(lines, line, f"{_A_FACE} {len(there)}")
    rows, begins, counts = rows[good], begins[good] + 1, said[good].astype(np.int64)
    behind, ends = found[good] - counts - 1, begins + counts
    shift = begins - (np.cumsum(counts) - counts)
    corners = values[np.arange(int(counts.sum())) + np.repeat(shift, counts)]
    resources.budget.take(
        "the corners of its faces", len(corners) * mesh_builder.POLYGON_CORNER_BYTES
    )
    corners, counts, kept = mesh_builder.sound_polygons(
        corners, counts, there,
        lambda face: damage.line(lines, int(rows[face]), f"{_A_FACE} {len(there)}"), left_out,
    )  # fmt: skip
    if not len(counts):
        raise MeshFileError(f"{path} holds a mesh of {len(vertices)} vertices, no faces")
    faces, polygons = mesh_builder.triangles(counts, by_size=True)
    face_colors, is_colored = None, behind > 0
    width = behind.max(initial=0)
    if vertex_colors is None and (behind[is_colored] == width).all() and width:
        found_colors = _colors(values[ends[is_colored, np.newaxis] + np.arange(width)])
        if found_colors is not None:
            # The others look as they would without any colours.
            face_colors = np.full((len(behind), 4), Material().base_color_over(False), np.float32)
            face_colors[is_colored] = found_colors
    if face_colors is None:
        left_out.note("colour of a face", int(np.count_nonzero(is_colored)))
    else:
        face_colors = face_colors[kept][polygons]
    if not there.all():
        vertices = np.where(there[:, np.newaxis], vertices, 0.0)
    colors = vertex_colors if face_colors is None else face_colors
    return [mesh_builder.Part(path.name, vertices, corners[faces], colors=colors)]


def _colors(codes: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Return colours, linear RGBA, which are sRGB, bytes or shares of 1; None if they are none."""
    if codes.shape[1] not in (3, 4) or not np.isfinite(codes).all():
        return None
    is_bytes = bool((codes == np.floor(codes)).all() and codes.max() > 1.0)
    return mesh_builder.linear_rgba(
        mesh_builder.srgb_bytes(codes / 255.0 if is_bytes else codes), False
    )
