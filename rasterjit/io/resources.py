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

import os
import re
import stat
from pathlib import Path
from typing import BinaryIO

from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.skipped import MissingFileError, reason_of
from rasterjit.scene.memory import MemoryBudget

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

_MOST_OF_MARK = 1 << 16
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
                found = re.search(rb"<name>([^<]*)</name>", file.read(_MOST_OF_MARK))
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
