"""
Read the files that a mesh file refers to: textures, buffers, libraries of materials.

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
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedIOBase
from pathlib import Path
from typing import BinaryIO

from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.load_warnings import MissingFileError, reason_of
from rasterjit.scene.memory_limits import MemoryBudget

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
"""The scheme of a URL, such as ``http:``, or a drive letter."""

_PACKAGE = re.compile(r"(?:package|model):///?([^/]+)/(.+)", re.DOTALL)
"""A URL of a file in a ROS package or a Gazebo model."""

_DRIVE = re.compile(r"[A-Za-z]:/")
"""The beginning of an absolute path on Windows."""

_PACKAGE_VARIABLES = (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
"""Environment variables that list folders of ROS packages, and where these lie in them."""

_MANIFESTS = ("model.config", "package.xml")
"""Files that mark the folder of a model or a package."""

_OPEN_FLAGS = ("O_NONBLOCK", "O_NOFOLLOW", "O_BINARY", "O_CLOEXEC")
"""Flags with which files are opened, where the system has them."""

_MAX_MANIFEST_PARENTS = 4
"""Parent folders of a mesh file that are searched for a manifest."""

_TEXTURE_FOLDER = "materials/textures"
"""Folder of a Gazebo model for pictures that meshes name without a folder."""

_MANIFEST_SEARCH_BYTES = 1 << 16
"""Bytes of a manifest that are searched for its name."""

MAX_NAME_LENGTH = 80
"""Most characters of a name in a message: the last ones, which tell files apart."""


def quote_name(name: str) -> str:
    """Return a file's name in quotes, shortened, for a message."""
    return repr(name if len(name) <= MAX_NAME_LENGTH else f"...{name[-MAX_NAME_LENGTH:]}")


class RefusedFileError(ValueError):
    """A mesh file refers to a file that it may not open."""


class Resources:
    """
    Reads the files that a mesh file may refer to.

    Parameters
    ----------
    path : Path
        The mesh file; names are relative to its folder.
    root : Path or None
        The folder that all of them must lie in; ``None`` -> that of the model or package that the
        mesh file is in, or else that of the mesh file.
    budget : MemoryBudget, optional
        Counts the memory of what is read.
    decoder : Decoder, optional
        Decodes compressed data of the files; default: in this process.

    Attributes
    ----------
    folder, root : Path
        Folder of the mesh file, and the folder that all files must lie in, without symbolic links.
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
        self._model = _find_model_folder(Path(os.path.realpath(self.folder)))
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
        with self.open(name) as file:
            size = os.fstat(file.fileno()).st_size
            self.budget.take(f"the file {quote_name(name)}", size)
            # It may have grown since.
            return file.read(size)

    @contextmanager
    def open(self, name: str) -> Iterator[BinaryIO]:
        """Open a file to read parts of it, or raise as `read` does."""
        label = quote_name(name)
        path = self._resolve(name, label)
        model = self._model
        if model is not None and path.is_relative_to(model) and not os.path.exists(path):
            # Beside meshes of Gazebo's models lie no pictures; those of others are not its own.
            textures = model / _TEXTURE_FOLDER / Path(name.replace("\\", "/")).name
            path = self._resolve_inside(textures, label) if os.path.isfile(textures) else path
        try:
            with _open_regular(path, label) as file:
                yield file
        except FileNotFoundError:
            raise MissingFileError(f"the file {label} beside it is missing") from None
        except OSError as error:
            raise ValueError(f"the file {label}: {reason_of(error)}") from None

    def read_mesh_file(self, path: Path) -> bytes:
        """Return the content of the mesh file."""
        self.budget.take("the file", path.stat().st_size)
        return path.read_bytes()

    def _resolve(self, name: str, label: str) -> Path:
        """Return the real path of a file name, or raise `RefusedFileError`."""
        slashed = name.replace("\\", "/")
        folder = self.folder
        if match := _PACKAGE.fullmatch(slashed):
            folder, slashed = self._find_package_folder(match[1], label), match[2].lstrip("/")
        if _SCHEME.match(slashed) or slashed.startswith("/"):
            raise RefusedFileError(f"{label} is not a file beside this one")
        if "\0" in slashed:
            raise RefusedFileError(f"{label} is no name of a file")
        return self._resolve_inside(Path(os.path.realpath(folder)) / slashed, label)

    def _find_package_folder(self, name: str, label: str) -> Path:
        """Return the folder of a package or model, or raise `RefusedFileError`."""
        if self._model is not None and name in (self._model.name, _read_manifest_name(self._model)):
            return self._model
        if name == self.root.name:
            return self.root
        if name not in ("", ".", "..") and (self.root / name).is_dir():
            return self.root / name
        raise RefusedFileError(
            f"{label} is of a package or model that this file is not in; resource_root names the "
            "folder that has it"
        )

    def _resolve_inside(self, unresolved: Path, label: str, root: Path | None = None) -> Path:
        """Return the real path of a path inside a root, or raise `RefusedFileError`."""
        root = self.root if root is None else root
        # First as it is written: a link out of the folder must not be followed on the way back.
        written = Path(os.path.normpath(unresolved))
        path = Path(os.path.realpath(written))
        for one in (written, path):
            if not one.is_relative_to(root):
                raise RefusedFileError(
                    f"the file {label} lies outside {str(root)!r}; resource_root names "
                    "another folder"
                )
        return path


class RobotResources(Resources):
    """
    Finds the files that a robot's description names, also in other packages.

    What is allowed is each package that is found, and the folder above that of the file: meshes
    often lie in one beside it. A ``root`` allows only what lies in it.

    Parameters
    ----------
    path, root, budget, decoder
        As of `Resources`.

    Attributes
    ----------
    renamed : dict of str to None
        Packages, in quotes, that were not found, and in whose place the folder of the file, or the
        one above it, had what is named.
    """

    def __init__(
        self,
        path: Path,
        root: Path | None = None,
        budget: MemoryBudget | None = None,
        decoder: Decoder | None = None,
    ) -> None:
        super().__init__(path, root, budget, decoder)
        self.renamed: dict[str, None] = {}
        self._is_limited = root is not None
        folder = Path(os.path.realpath(self.folder))
        self._folders = (folder, *folder.parents[:_MAX_MANIFEST_PARENTS])
        if root is None and self._model is None:
            self.root = folder.parent

    def find(self, name: str) -> tuple[Path, Path]:
        """
        Return the path of a file, and the folder that all that it names must lie in.

        Parameters
        ----------
        name : str
            ``package://NAME/path`` or ``model://NAME/path``: of the package that the file is in, of
            one in or beside a folder above, of one in ``ROS_PACKAGE_PATH`` or
            ``AMENT_PREFIX_PATH``, or, where no folder of that name is a package, the folder of the
            file or the one above it. A path relative to these two. An absolute path, also with
            ``file://``, in what is allowed.

        Raises
        ------
        MissingFileError
            If there is none.
        RefusedFileError
            If it lies outside what is allowed.
        """
        label, slashed = quote_name(name), name.replace("\\", "/").removeprefix("file://")
        if "\0" in slashed:
            raise RefusedFileError(f"{label} is no name of a file")
        folders = self._folders[:2]
        beside = [(one, self.root) for one in folders if one.is_relative_to(self.root)]
        missing, package, roots = "it is missing", "", list[Path]()
        if match := _PACKAGE.fullmatch(slashed):
            package, slashed = quote_name(match[1]), match[2].lstrip("/")
            roots = self._list_package_folders(match[1])
            if not roots:
                missing = (
                    f"there is no package {package} above or beside the file, in "
                    "ROS_PACKAGE_PATH or in AMENT_PREFIX_PATH"
                )
            # Folders of packages are often renamed.
            if any(map(_has_manifest, roots)):
                missing, beside = f"it is missing in the package {package}", []
            beside = [*((root, root) for root in roots), *beside]
        elif _SCHEME.match(slashed) and not _DRIVE.match(slashed):
            raise RefusedFileError(f"{label} is not a file on this machine")
        refused: RefusedFileError | None = None
        for folder, root in beside:
            try:
                path = self._resolve_inside(folder / slashed, label, root)
            except RefusedFileError as error:
                refused = refused or error
                continue
            if path.is_file():
                if package and folder not in roots:
                    self.renamed[package] = None
                return path, self.root if self._is_limited else root
        if refused is not None:
            raise refused
        raise MissingFileError(missing)

    def _resolve(self, name: str, label: str) -> Path:
        """Return the real path of a file name, or raise ``ValueError``."""
        return self.find(name)[0]

    def _list_package_folders(self, name: str) -> list[Path]:
        """Return the folders that may be a package."""
        if name in ("", ".", ".."):
            return []
        candidates = [one for one in self._folders if one.name == name]
        if self._model is not None and name == _read_manifest_name(self._model):
            candidates.append(self._model)
        if self._is_limited:
            candidates += [self.root] if self.root.name == name else []
            candidates.append(self.root / name)
        candidates += [one / name for one in self._folders]
        for variable, inner in _PACKAGE_VARIABLES:
            for entry in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                folder = Path(entry, inner)
                candidates += [folder] if folder.name == name else []
                candidates.append(folder / name)
        real = dict.fromkeys(Path(os.path.realpath(one)) for one in candidates if one.is_dir())
        return [one for one in real if not self._is_limited or one.is_relative_to(self.root)]


def _find_model_folder(folder: Path) -> Path | None:
    """Return the nearest folder, this one or a parent, with a manifest; None without one."""
    for one in (folder, *folder.parents[:_MAX_MANIFEST_PARENTS]):
        if one.parent != one and _has_manifest(one):
            return one
    return None


def _has_manifest(folder: Path) -> bool:
    """Tell whether a folder is a model or a package."""
    return any(_is_regular(folder / manifest) for manifest in _MANIFESTS)


def _is_regular(path: Path) -> bool:
    """Tell whether there is a regular file, not a link to one."""
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:
        return False


def _read_manifest_name(folder: Path) -> str | None:
    """Return the name of a model or package by its manifest."""
    for manifest in _MANIFESTS:
        try:
            with _open_regular(folder / manifest, manifest) as file:
                match = re.search(rb"<name>([^<]*)</name>", file.read(_MANIFEST_SEARCH_BYTES))
        except (OSError, RefusedFileError):
            continue
        if match:
            return match[1].decode("utf-8", "replace").strip()
    return None


def _open_regular(path: Path, label: str) -> BinaryIO:
    """Open a regular file, no link to one; never wait for a pipe, never touch a device."""
    if not stat.S_ISREG(os.lstat(path).st_mode):
        raise RefusedFileError(f"{label} is no regular file")
    # It may have become another since; opening a pipe would wait for who writes to it.
    flags = os.O_RDONLY | sum(getattr(os, name, 0) for name in _OPEN_FLAGS)
    file = open(os.open(path, flags), "rb")  # noqa: SIM115
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        return file
    file.close()
    raise RefusedFileError(f"{label} is no regular file")


_GZIP, _BZIP2, _TAR = b"\x1f\x8b", b"BZh", b"ustar"
_TAR_OFFSET = 257
"""Offset of the signature in a plain TAR archive."""

_ZIP_ENTRY_SIGNATURE, MEMORY_PER_ZIP_ENTRY = b"PK\1\2", 640
"""Signature of an entry of a ZIP archive's central directory, and its memory."""

_CHUNK_BYTES = 1 << 20
"""Bytes that are read or unpacked at once to count them."""


def take_members(path: Path, extension: str, factor: int, budget: MemoryBudget) -> None:
    """
    Count the memory of the members of an archive.

    Parameters
    ----------
    path : Path
    extension : str
        Lower case, without a dot. Any file that is a ZIP archive is counted as one.
    factor : int
        Memory that reading a byte takes.
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
    """Count the declared sizes of members, then what they hold beyond these."""
    with path.open("rb") as file:
        listed = sum(
            chunk.count(_ZIP_ENTRY_SIGNATURE)
            for chunk in iter(lambda: file.read(_CHUNK_BYTES), b"")
        )
    budget.take("its list of members", listed * MEMORY_PER_ZIP_ENTRY)
    with zipfile.ZipFile(path) as archive, path.open("rb") as file:
        members = [one for one in archive.infolist() if not one.is_dir()]
        for one in members:
            budget.take(f"its member {one.filename[-80:]!r}", one.file_size * factor)
        for one in members:
            if one.compress_type == zipfile.ZIP_DEFLATED:
                _take_extra(file, one, factor, budget)
            elif one.compress_type != zipfile.ZIP_STORED:
                raise ValueError(
                    f"its member {one.filename[-80:]!r} must be stored or deflated, got method "
                    f"{one.compress_type}"
                )


def _take_extra(file: BinaryIO, member: zipfile.ZipInfo, factor: int, budget: MemoryBudget) -> None:
    """Count the bytes of a deflated member beyond its declared size."""
    file.seek(member.header_offset)
    name, extra = struct.unpack("<26xHH", file.read(30))
    file.seek(name + extra, os.SEEK_CUR)
    left, size, stream = member.compress_size, 0, zlib.decompressobj(-zlib.MAX_WBITS)
    while left > 0 and not stream.eof:
        packed = stream.unconsumed_tail or file.read(min(left, _CHUNK_BYTES))
        if not packed:
            return
        before = size
        size += len(stream.decompress(packed, _CHUNK_BYTES))
        left -= len(packed) - len(stream.unconsumed_tail)
        if size > member.file_size:
            what = f"its member {member.filename[-80:]!r}, which is larger than it says,"
            budget.take(what, (size - max(before, member.file_size)) * factor)


def _take_tar(path: Path, factor: int, budget: MemoryBudget) -> None:
    """
    Count the content of a TAR archive with its headers, and the full size of sparse members.

    The headers of a member may be longer than it, and are read whole.
    """
    with path.open("rb") as file:
        head = file.read(_TAR_OFFSET + len(_TAR))
    if head.startswith((_GZIP, _BZIP2)):
        unpack = gzip.open if head.startswith(_GZIP) else bz2.open
        with unpack(path) as opened:
            _take_content(opened, factor, budget)
    elif head[_TAR_OFFSET:] == _TAR:
        budget.take("what it holds", path.stat().st_size * factor)
    else:
        raise ValueError("it must be packed by gzip or bzip2")
    with tarfile.open(path, "r:*") as archive:
        for one in archive:
            if one.issparse():
                budget.take(f"its member {one.name[-80:]!r}", one.size * factor)


def _take_content(opened: BufferedIOBase, factor: int, budget: MemoryBudget) -> None:
    """Count the bytes of an unpacked stream."""
    while chunk := opened.read(_CHUNK_BYTES):
        budget.take("what it holds", len(chunk) * factor)


_SIGNATURES: tuple[tuple[bytes, int, str, tuple[str, ...]], ...] = (
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
"""Signature, its offset, a description, and the extensions of such files."""

_SIGNATURE_SEARCH_BYTES = 4096
"""Bytes of a file that are searched for a signature."""

_MUJOCO_COUNTS = struct.Struct("<4i")
_UCD = re.compile(rb"(?:#[^\n]*\n)*[ \t]*\d+(?:[ \t]+\d+){4}[ \t]*\r?\n")
"""The first line of AVS UCD: how many points, cells, and numbers of each; comments before it."""


def detect_kind(file: Path, extension: str) -> str | None:
    """Describe a file whose content contradicts its extension, such as ``"a PNG picture"``."""
    try:
        with file.open("rb") as opened:
            head = opened.read(_SIGNATURE_SEARCH_BYTES)
        size = file.stat().st_size
    except OSError:
        return None
    for begin, start, description, extensions in _SIGNATURES:
        if head[start:].startswith(begin):
            last_extension = extension.rpartition(".")[2]
            return None if last_extension in extensions else description
    if extension == "msh" and _is_mujoco_mesh(head, size):
        return "a mesh of MuJoCo"
    if extension == "inp" and _UCD.match(head):
        return "a file of AVS UCD, which is read where it ends in .avs"
    return None


def extension_of(file: Path) -> str:
    """Return a file's extension in lower case, without a dot; of archives both, ``tar.gz``."""
    name = file.name.lower()
    double = [ending for ending in ("tar.gz", "tar.bz2") if name.endswith("." + ending)]
    return double[0] if double else file.suffix.lower().removeprefix(".")


def _is_mujoco_mesh(head: bytes, size: int) -> bool:
    """Tell a MuJoCo mesh by its length: its header counts vertices, normals, uv and faces."""
    if len(head) < _MUJOCO_COUNTS.size:
        return False
    vertices, normals, coordinates, faces = counts = _MUJOCO_COUNTS.unpack_from(head)
    expected_size = _MUJOCO_COUNTS.size + 12 * (vertices + normals + faces) + 8 * coordinates
    return min(counts) >= 0 and vertices > 0 and size == expected_size
