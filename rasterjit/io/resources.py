"""
Files that a mesh file names: textures, buffers, libraries of materials.

A mesh file may come from anywhere, so what it names is opened only if it is a regular file inside
the folder of the mesh file, or another folder that the caller allows. A model of Gazebo and a
package of ROS are such a folder for the meshes in it [1]_ [2]_.

References
----------
.. [1] Open Robotics, "Model structure and requirements": ``model.config``, ``model://``.
.. [2] M. Quigley et al., "ROS: an open-source Robot Operating System", 2009; ``package.xml`` and
   ``package://`` are of its REP 127 and URDF.
"""

from __future__ import annotations

import bz2
import gzip
import os
import re
import stat
import struct
import tarfile
import zipfile
import zlib
from io import BufferedIOBase
from pathlib import Path
from typing import BinaryIO

from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.load_warnings import MissingFileError, reason_of
from rasterjit.scene.memory_limits import MemoryBudget

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
"""The beginning of ``http:``, ``file:`` and the like, and of a path with a drive letter."""

_PACKAGE = re.compile(r"(?:package|model)://([^/]+)/(.+)", re.DOTALL)
"""A file of a package of ROS, or of a model of Gazebo, by the name of either."""

_MARKS = ("model.config", "package.xml")
"""Files that mark the folder of a model or a package."""

_FLAGS = ("O_NONBLOCK", "O_NOFOLLOW", "O_BINARY", "O_CLOEXEC")
"""How files are opened, where the system has it."""

_HIGHEST = 4
"""How many folders above that of a mesh file such a folder is looked for."""

_TEXTURES = "materials/textures"
"""Where a model of Gazebo keeps pictures that meshes name without a folder."""

_MAX_OF_MARK = 1 << 16
"""Bytes among which such a file has its name."""

LONGEST_NAME = 80
"""Characters of a name that a message shows: the last ones, which tell files apart."""


def shown_name(name: str) -> str:
    """Return a file's name as messages show it."""
    return repr(name if len(name) <= LONGEST_NAME else f"...{name[-LONGEST_NAME:]}")


class RefusedFileError(ValueError):
    """A mesh file names what it may not open."""


class Resources:
    """
    The files that a mesh file may name.

    Parameters
    ----------
    path : Path
        The mesh file; names are relative to its folder.
    root : Path or None
        The folder that all of them must lie in; ``None`` -> that of the model or package that the
        mesh file is in, or else that of the mesh file.
    budget : MemoryBudget, optional
        Counts what is read, here and by who makes something of it.
    decoder : Decoder, optional
        Decodes what the files hold packed; default: in this process.

    Attributes
    ----------
    folder, root : Path
        That of the mesh file, and that which all files must lie in, all symbolic links followed.
    """

    def __init__(
        self,
        path: Path,
        root: Path | None = None,
        budget: MemoryBudget | None = None,
        decoder: Decoder | None = None,
    ) -> None:
        self.budget = MemoryBudget(str(path)) if budget is None else budget
        self.decoder = Decoder(self.budget) if decoder is None else decoder
        self.folder = path.parent
        self._model = _model_folder(Path(os.path.realpath(self.folder)))
        allowed = (self._model or self.folder) if root is None else root
        self.root = Path(os.path.realpath(allowed))

    def read(self, name: str) -> bytes:
        """
        Return the content of a file.

        Parameters
        ----------
        name : str
            Its path, relative to the mesh file; slashes of either kind separate folders. Also
            ``package://NAME/path`` and ``model://NAME/path``, of the package or model that the mesh
            file is in, or of one in the folder that the caller allows.

        Raises
        ------
        MissingFileError
            If there is none.
        RefusedFileError
            If it is an address or an absolute path, lies outside the folder, also by a symbolic
            link, or is no regular file.
        ValueError
            If it cannot be read.
        """
        shown = shown_name(name)
        place = self._place(name, shown)
        if self._model is not None and not os.path.exists(place):
            # Beside meshes of Gazebo's models lie no pictures.
            textures = self._model / _TEXTURES / Path(name.replace("\\", "/")).name
            place = self._inside(textures, shown) if os.path.isfile(textures) else place
        try:
            return _regular_content(place, shown, self.budget)
        except FileNotFoundError:
            raise MissingFileError(f"the file {shown} beside it is missing") from None
        except OSError as error:
            raise ValueError(f"the file {shown}: {reason_of(error)}") from None

    def read_itself(self, path: Path) -> bytes:
        """Return the content of the mesh file."""
        self.budget.take("the file", path.stat().st_size)
        return path.read_bytes()

    def _place(self, name: str, shown: str) -> Path:
        """Return where a file lies, all symbolic links followed."""
        plain = name.replace("\\", "/")
        folder = self.folder
        if found := _PACKAGE.fullmatch(plain):
            folder, plain = self._package(found[1], shown), found[2].lstrip("/")
        if _SCHEME.match(plain) or plain.startswith("/"):
            raise RefusedFileError(f"{shown} is not a file beside this one")
        if "\0" in plain:
            raise RefusedFileError(f"{shown} is no name of a file")
        return self._inside(Path(os.path.realpath(folder)) / plain, shown)

    def _package(self, name: str, shown: str) -> Path:
        """Return the folder of a package or model, or raise `RefusedFileError`."""
        if self._model is not None and name in (self._model.name, _name_in(self._model)):
            return self._model
        if name == self.root.name:
            return self.root
        if name not in ("", ".", "..") and (self.root / name).is_dir():
            return self.root / name
        raise RefusedFileError(
            f"{shown} is of a package or model that this file is not in; resource_root names the "
            "folder that has it"
        )

    def _inside(self, named: Path, shown: str) -> Path:
        """Return where a file lies, all links followed, if it is inside what the caller allows."""
        # First as it is written: a link out of the folder must not be followed on the way back.
        written = Path(os.path.normpath(named))
        place = Path(os.path.realpath(written))
        for one in (written, place):
            if not one.is_relative_to(self.root):
                raise RefusedFileError(
                    f"the file {shown} lies outside {str(self.root)!r}; resource_root names "
                    "another folder"
                )
        return place


def _model_folder(folder: Path) -> Path | None:
    """Return the nearest folder, this one or above, of a model or package; None without one."""
    for one in (folder, *folder.parents[:_HIGHEST]):
        if one.parent != one and any(_is_regular(one / mark) for mark in _MARKS):
            return one
    return None


def _is_regular(place: Path) -> bool:
    """Tell whether there is a regular file, not a link to one."""
    try:
        return stat.S_ISREG(os.lstat(place).st_mode)
    except OSError:
        return False


def _name_in(folder: Path) -> str | None:
    """Return the name that the file of a model or package gives it."""
    for mark in _MARKS:
        try:
            with _open_regular(folder / mark, mark) as file:
                found = re.search(rb"<name>([^<]*)</name>", file.read(_MAX_OF_MARK))
        except (OSError, RefusedFileError):
            continue
        if found:
            return found[1].decode("utf-8", "replace").strip()
    return None


def _open_regular(place: Path, shown: str) -> BinaryIO:
    """Open a regular file, no link to one; never wait for a pipe, never touch a device."""
    if not stat.S_ISREG(os.lstat(place).st_mode):
        raise RefusedFileError(f"{shown} is no regular file")
    # It may have become another since; opening a pipe would wait for who writes to it.
    flags = os.O_RDONLY | sum(getattr(os, name, 0) for name in _FLAGS)
    file = open(os.open(place, flags), "rb")  # noqa: SIM115
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        return file
    file.close()
    raise RefusedFileError(f"{shown} is no regular file")


def _regular_content(place: Path, shown: str, budget: MemoryBudget) -> bytes:
    """Return the content of a regular file."""
    with _open_regular(place, shown) as file:
        size = os.fstat(file.fileno()).st_size
        budget.take(f"the file {shown}", size)
        # It may have grown since.
        return file.read(size)


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
