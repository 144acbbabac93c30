"""
Read prebuilt kernels that came with the installation: a file for each CPU level (``targets``).

The platform wheels bring them in ``rasterjit/machine_code``; a clone and the pure wheel have none.
A file holds every form of every kernel and stage, by the names that ``store`` has for them: a hash
of sources, types and target, so that it fits whatever versions of Python and Numba are here, and
no sources but its own. It is read whole, and never written: ``cli.wheels`` makes it.

::

    RasterJIT machine code 1
    SHA-256 of the file's name, a zero and the table; length of the table, 8 bytes, little-endian
    the table: triple, CPU, features, what compiled it; then for each form, sorted by name: name,
    result, first byte, number of bytes, SHA-256
    object codes, one behind the other
"""

from __future__ import annotations

import functools
import hashlib
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from rasterjit.runtime.targets import Target, shipped_target

FOLDER = Path(__file__).resolve().parents[1] / "machine_code"

SUFFIX = ".kernels"

MAGIC = b"RasterJIT machine code 1\n"
SUM = hashlib.sha256().digest_size
LENGTH = struct.Struct("<Q")
TABLE = len(MAGIC) + SUM + LENGTH.size
"""Where the table begins."""

LINKING = ("create_lljit_compiler", "JITLibraryBuilder")
"""What llvmlite must have to bring object code into memory."""

REINSTALL = "pip install --force-reinstall --no-deps rasterjit"


class UnfitError(ValueError):
    """Shipped code that cannot be used; the message names the file and says why."""


class CodeLocation(NamedTuple):
    """Where the machine code of a form lies in a file."""

    returns: str
    """``none``, ``int`` or ``bool``."""
    first: int
    size: int
    checksum: str
    """SHA-256, hexadecimal."""


class Pack(NamedTuple):
    """A file of machine code."""

    path: Path
    target: Target
    made_with: str
    """Python, Numba and llvmlite, with their versions."""
    forms: dict[str, CodeLocation]
    """By name."""
    content: bytes

    def code(self, name: str) -> tuple[str, bytes]:
        """
        Return what a form returns, and its object code.

        Raises
        ------
        UnfitError
            The form is not in the file, or damaged.
        """
        place = self.forms.get(name)
        if place is None:
            raise UnfitError(f"{self.path} has no {name}: it was made from other sources")
        code = self.content[place.first : place.first + place.size]
        if hashlib.sha256(code).hexdigest() != place.checksum:
            raise UnfitError(f"{self.path} is damaged: {name}")
        return place.returns, code

    def damaged(self) -> list[str]:
        """Return the names of the forms that are damaged, sorted."""
        found = []
        for name in sorted(self.forms):
            try:
                self.code(name)
            except UnfitError:
                found.append(name)
        return found


def content_of(
    name: str, target: Target, made_with: str, forms: Mapping[str, tuple[str, bytes]]
) -> bytes:
    """
    Return the bytes of a file: the same for the same forms, whatever their order.

    Parameters
    ----------
    name : str
        Of the file.
    target : Target
    made_with : str
    forms : mapping
        What each form returns, and its object code, by name.
    """
    lines, codes, first = ["\t".join((*target, made_with))], [], 0
    for form, (returns, code) in sorted(forms.items()):
        checksum = hashlib.sha256(code).hexdigest()
        lines.append(f"{form}\t{returns}\t{first}\t{len(code)}\t{checksum}")
        codes.append(code)
        first += len(code)
    table = "\n".join(lines).encode()
    checksum = _checksum(name, table)
    return b"".join((MAGIC, checksum, LENGTH.pack(len(table)), table, *codes))


def _checksum(name: str, table: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + table).digest()


def file_name(target: Target) -> str:
    """Return the name of the file of a target's machine code."""
    return f"{target.cpu}{SUFFIX}"


def read(path: Path) -> Pack:
    """
    Return a file of machine code.

    Raises
    ------
    UnfitError
        It is damaged, or another's.
    OSError
        It cannot be read, or is missing.
    """
    content = path.read_bytes()
    if not content.startswith(MAGIC) or len(content) < TABLE:
        raise UnfitError(f"{path} is damaged: it is no file of machine code")
    (length,) = LENGTH.unpack(content[TABLE - LENGTH.size : TABLE])
    table, start = content[TABLE : TABLE + length], TABLE + length
    if _checksum(path.name, table) != content[len(MAGIC) : len(MAGIC) + SUM]:
        raise UnfitError(f"{path} is damaged: its table")
    (triple, cpu, features, made_with), *lines = (
        line.split("\t") for line in table.decode().split("\n")
    )
    forms = {
        name: CodeLocation(returns, start + int(first), int(size), checksum)
        for name, returns, first, size, checksum in lines
    }
    return Pack(path, Target(triple, cpu, features), made_with, forms, content)


class Found(NamedTuple):
    """What came with the installation."""

    pack: Pack | None
    problem: str | None
    """Why there is none, where there should be one."""


@functools.cache
def found() -> Found:
    """Return the machine code for this CPU that came with the installation, as far as of use."""
    if not FOLDER.is_dir():
        return Found(None, None)
    target = shipped_target()
    if target is None:
        return Found(None, None)
    path = FOLDER / file_name(target)
    problem = _cannot_link()
    if problem is not None:
        return Found(None, f"{path} is of no use: {problem}")
    try:
        pack = read(path)
    except UnfitError as error:
        return Found(None, str(error))
    except OSError as error:
        return Found(None, f"{path}: {error.strerror or error}")
    if pack.target != target:
        return Found(None, f"{path} was made for another machine: {' '.join(pack.target)}")
    return Found(pack, None)


def _cannot_link() -> str | None:
    """Say why object code cannot be brought into memory; None if it can."""
    import llvmlite
    from llvmlite import binding

    lacking = [name for name in LINKING if not hasattr(binding, name)]
    if not lacking:
        return None
    return f"llvmlite {llvmlite.__version__} has no {', '.join(lacking)}"
