"""
Write the table of ``docs/guides/files.md`` that says what is read of each format, and what is not.

``python tests/io/formats_table.py``: what is named is found by reading planted files; what is read
and what is passed over is said here.
"""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path

from planted_files import PLANTED

import rasterjit as rj

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "files.md"

BEGIN, END = "<!-- formats: python tests/io/formats_table.py -->", "<!-- /formats -->"

FORMATS: dict[str, tuple[str, str, str]] = {
    "OBJ": ("obj", "faces, lines, points, colours, normals, uv", "smoothing and merging groups"),
    "MTL": (
        "mtl",
        "Kd, Ks, Ns, d, Tr, map_Kd, map_d; -s, -o, -clamp",
        "Ka, Ni, illum, sharpness",
    ),
    "PLY": (
        "ply",
        "faces, strips, edges, points, colours, normals, uv, pictures; other numbers as attributes",
        "comments",
    ),
    "OFF": ("off", "faces, colours", "numbers of edges"),
    "STL": ("stl", "triangles, names of solids", "normals, which are made anew; the head"),
    "XYZ, PTS, CSV ...": (
        "xyz",
        "positions, colours, normals; other columns as attributes",
        "comments",
    ),
    "PCD": ("pcd", "positions, colours, normals; other fields as attributes", "rows of an image"),
    "LAS, LAZ": (
        "las",
        "positions, colours; other dimensions as attributes",
        "coordinate systems",
    ),
    "glTF, GLB": (
        "gltf",
        "[the standard and extensions](gltf.md)",
        "`extras`; extensions without a picture",
    ),
    "3MF": (
        "3mf",
        "meshes, components, colours, textures, composites, multi-properties, lattices of beams",
        "thumbnails, metadata",
    ),
    "COLLADA": (
        "dae",
        "meshes, materials, pictures, the scene, its upward axis",
        "`extra`",
    ),
    "URDF": (
        "urdf",
        "links, joints, shapes, meshes, colours, pictures",
        "collision shapes, masses, drives, sensors",
    ),
    "binvox": ("binvox", "voxels as their sides", ""),
    "DXF": (
        "dxf",
        "curves, faces, meshes, points, blocks, colours",
        "widths and patterns of lines",
    ),
    "SVG": ("svg", "paths and shapes but ellipses", "colours and widths; other name spaces"),
    "VTK, VTU, MSH ...": (
        "vtu",
        "cells of up to 4 corners a side, polygons; values as attributes",
        "middles of edges, which are straight",
    ),
}
"""By the name on the page: planted files, what is read, and what is passed over without a word."""


def named(form: str) -> list[str]:
    """Return what reading the planted files of a format names."""
    found: dict[str, None] = {}
    for name, (write, _) in PLANTED.items():
        if name.partition(",")[0].split()[0] != form:
            continue
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", rj.LoadWarning)
            rj.load(write(Path(folder)))
        for one in said:
            found |= dict.fromkeys(getattr(one.message, "left_out", {}))
    return list(found)


def table() -> str:
    """Return the table as Markdown."""
    rows = ["| format | read | named, for example | passed over |", "|---|---|---|---|"]
    for name, (form, read, passed) in FORMATS.items():
        told = ", ".join(f"`{one}`" for one in named(form))
        rows.append(f"| {name} | {read} | {told} | {passed} |")
    return "\n".join(rows)


def with_table(page: str, content: str) -> str:
    """Return the page with the table between its marks."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{content}\n\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), table()), encoding="utf-8")
