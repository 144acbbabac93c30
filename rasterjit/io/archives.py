"""Count what packed files hold before they are unpacked: as they say, and as it is."""

from __future__ import annotations

import bz2
import gzip
import os
import struct
import tarfile
import zipfile
import zlib
from io import BufferedIOBase
from pathlib import Path
from typing import BinaryIO

from rasterjit.scene.memory import MemoryBudget

_GZIP, _BZIP2, _TAR = b"\x1f\x8b", b"BZh", b"ustar"
_TAR_AT = 257
"""Where the header of a file in a plain TAR archive says that it is one."""

_LISTED, MEMBER_BYTES = b"PK\1\2", 640
"""How an entry of a ZIP archive's list begins, and the memory that it takes."""

_PIECE = 1 << 20
"""Bytes that are unpacked at once to count them."""


def take_members(path: Path, extension: str, factor: int, budget: MemoryBudget) -> None:
    """
    Count the members of a packed file.

    Parameters
    ----------
    path : Path
    extension : str
        Lower case, without a dot. Any file that is a ZIP archive is counted as one.
    factor : int
        How much memory reading a byte takes.
    budget : MemoryBudget

    Raises
    ------
    FileSizeError
        If they hold more than is left.
    ValueError
        If a member of a ZIP archive, or a TAR archive, is packed in an unusual way.
    """
    try:
        if zipfile.is_zipfile(path):
            _take_zip(path, factor, budget)
        elif extension in ("tar.gz", "tar.bz2"):
            _take_tar(path, factor, budget)
        elif extension == "bz2":
            with bz2.open(path) as opened:
                _take_content(opened, factor, budget)
    except (zipfile.BadZipFile, tarfile.TarError, struct.error, zlib.error, OSError, EOFError):
        # What is damaged is refused, with its reason, by who reads it.
        return


def _take_zip(path: Path, factor: int, budget: MemoryBudget) -> None:
    """Count what is declared, then what is there besides: unpacking may make all of it at once."""
    with path.open("rb") as file:
        listed = sum(piece.count(_LISTED) for piece in iter(lambda: file.read(_PIECE), b""))
    budget.take("its list of members", listed * MEMBER_BYTES)
    with zipfile.ZipFile(path) as archive, path.open("rb") as file:
        members = [one for one in archive.infolist() if not one.is_dir()]
        for one in members:
            budget.take(f"its member {one.filename[-80:]!r}", one.file_size * factor)
        for one in members:
            if one.compress_type == zipfile.ZIP_DEFLATED:
                _take_rest(file, one, factor, budget)
            elif one.compress_type != zipfile.ZIP_STORED:
                raise ValueError(
                    f"its member {one.filename[-80:]!r} must be stored or deflated, got method "
                    f"{one.compress_type}"
                )


def _take_rest(file: BinaryIO, member: zipfile.ZipInfo, factor: int, budget: MemoryBudget) -> None:
    """Count what a deflated member holds beyond what it declares."""
    file.seek(member.header_offset)
    name, extra = struct.unpack("<26xHH", file.read(30))
    file.seek(name + extra, os.SEEK_CUR)
    left, size, stream = member.compress_size, 0, zlib.decompressobj(-zlib.MAX_WBITS)
    while left > 0 and not stream.eof:
        packed = stream.unconsumed_tail or file.read(min(left, _PIECE))
        if not packed:
            return
        before = size
        size += len(stream.decompress(packed, _PIECE))
        left -= len(packed) - len(stream.unconsumed_tail)
        if size > member.file_size:
            what = f"its member {member.filename[-80:]!r}, which is larger than it says,"
            budget.take(what, (size - max(before, member.file_size)) * factor)


def _take_tar(path: Path, factor: int, budget: MemoryBudget) -> None:
    """
    Count what is packed, headers too, and sparse members, which are as large as they say.

    The headers of a member may be longer than it, and are read whole.
    """
    with path.open("rb") as file:
        head = file.read(_TAR_AT + len(_TAR))
    if head.startswith((_GZIP, _BZIP2)):
        unpack = gzip.open if head.startswith(_GZIP) else bz2.open
        with unpack(path) as opened:
            _take_content(opened, factor, budget)
    elif head[_TAR_AT:] == _TAR:
        budget.take("what it holds", path.stat().st_size * factor)
    else:
        raise ValueError("it must be packed by gzip or bzip2")
    with tarfile.open(path, "r:*") as archive:
        for one in archive:
            if one.issparse():
                budget.take(f"its member {one.name[-80:]!r}", one.size * factor)


def _take_content(opened: BufferedIOBase, factor: int, budget: MemoryBudget) -> None:
    """Count by unpacking."""
    while piece := opened.read(_PIECE):
        budget.take("what it holds", len(piece) * factor)
