"""Tell by its first bytes what a file is that is not what its name says."""

from __future__ import annotations

import re
import struct
from pathlib import Path

_KINDS: tuple[tuple[bytes, int, str, tuple[str, ...]], ...] = (
    (b"\x89PNG\r\n", 0, "a PNG picture", ()),
    (b"\xff\xd8\xff", 0, "a JPEG picture", ()),
    (b"GIF8", 0, "a GIF picture", ()),
    (b"WEBP", 8, "a WebP picture", ()),
    (b"II*\0", 0, "a TIFF picture", ()),
    (b"MM\0*", 0, "a TIFF picture", ()),
    (b"v/1\x01", 0, "an OpenEXR picture", ()),
    (b"%PDF-", 0, "a PDF document", ()),
    (b"\x1f\x8b", 0, "packed by gzip", ("gz",)),
    (b"BZh", 0, "packed by bzip2", ("bz2",)),
    (b"7z\xbc\xaf\x27\x1c", 0, "a 7z archive", ()),
    (b"PK\x03\x04", 0, "a ZIP archive", ("zip", "3mf", "3dxml", "zae")),
    (b"glTF", 0, "a GLB file", ("glb", "vrm")),
    (b"ply\n", 0, "a PLY file", ("ply",)),
    (b"ply\r", 0, "a PLY file", ("ply",)),
    (b"OFF\n", 0, "an OFF file", ("off",)),
    (b"OFF\r", 0, "an OFF file", ("off",)),
    (b"#binvox", 0, "a binvox file", ("binvox",)),
    (b"[MeshSerializer", 2, "a mesh of OGRE", ()),
    (b"<mesh>", 0, "a mesh of OGRE as XML", ()),
    (b"<!DOCTYPE html", 0, "a page of HTML", ()),
    (b"<html", 0, "a page of HTML", ()),
    (b"version https://git-lfs", 0, "a pointer of Git LFS: the file itself was not fetched", ()),
)
"""First bytes, where they begin, what begins so, and the extensions that mean it."""

_HEAD = 4096
"""Bytes at the beginning of a file that are looked at."""

_COUNTS = struct.Struct("<4i")
_UCD = re.compile(rb"(?:#[^\n]*\n)*[ \t]*\d+(?:[ \t]+\d+){4}[ \t]*\r?\n")
"""The first line of AVS UCD: how many points, cells, and numbers of each; comments before it."""


def other_kind(file: Path, extension: str) -> str | None:
    """Return what a file is that its extension does not say, such as ``"a PNG picture"``."""
    try:
        with file.open("rb") as opened:
            head = opened.read(_HEAD)
        size = file.stat().st_size
    except OSError:
        return None
    for begin, start, kind, extensions in _KINDS:
        if head[start:].startswith(begin):
            known = extension.rpartition(".")[2]
            return None if known in extensions else kind
    if extension == "msh" and _is_of_mujoco(head, size):
        return "a mesh of MuJoCo"
    if extension == "inp" and _UCD.match(head):
        return "a file of AVS UCD, which is read where it ends in .avs"
    return None


def extension_of(file: Path) -> str:
    """Return a file's extension as trimesh names it: lower case, no dot."""
    name = file.name.lower()
    double = [ending for ending in ("tar.gz", "tar.bz2") if name.endswith("." + ending)]
    return double[0] if double else file.suffix.lower().removeprefix(".")


def _is_of_mujoco(head: bytes, size: int) -> bool:
    """Tell a file that is as long as its four counts say: vertices, normals, uv and faces."""
    if len(head) < _COUNTS.size:
        return False
    vertices, normals, coordinates, faces = counts = _COUNTS.unpack_from(head)
    needed = _COUNTS.size + 12 * (vertices + normals + faces) + 8 * coordinates
    return min(counts) >= 0 and vertices > 0 and size == needed
