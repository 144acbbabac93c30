"""
Find the prebuilt kernels that came with the installation, in ``rasterjit/machine_code``.

A platform wheel brings a shared library for each CPU level, with every form of every kernel and
stage. The system opens it as it opens any other, so processes share its memory, and nothing is
linked here. What opens cannot be checked any more, and a file that was cut off ends the process: so
its SHA-256 is compared before, by the file ``index``, which ``cli.wheels`` writes ::

    SHA-256 of what follows
    {"made_with": what compiled it, "sources": files and a hash over them,
     "libraries": [[file, SHA-256, triple, CPU, features], ...], the best level first,
     "texts": [[file, SHA-256, kind of CPU, CPU, LLVM's version], ...],
     "forms": {symbol: result, ...}}

The source distribution and the pure wheel bring LLVM's text instead, optimized for each level. The
store makes object code of it, in a sixth of the time that compiling from Python takes. A clone
brings nothing.

The sources are those that the code depends on. After an edit of any of them nothing here is used.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.runtime.targets import Target, find_host_levels, requested_cpu_name

ROOT = Path(__file__).resolve().parents[1]

FOLDER = ROOT / "machine_code"

INDEX_FILE = "index"

CPU_CHECK_FUNCTION = "rasterjit_runs"
"""Function of a library that tells whether this CPU can run it."""

REINSTALL = "pip install --force-reinstall --no-deps rasterjit"


class UnusableError(ValueError):
    """Raised for prebuilt code that cannot be used; the message names the file and the reason."""


class Index(NamedTuple):
    """The content of the file ``index``."""

    made_with: str
    """Python, Numba and llvmlite, with their versions."""
    sources: dict[str, Any]
    """``files``, below the package, and ``hash``, that of their contents."""
    libraries: list[list[str]]
    """File, SHA-256 and target of each; the best level first."""
    forms: dict[str, str]
    """The result of each form (``store.RETURNS``), by its symbol."""
    texts: list[list[str]]
    """File, SHA-256, kind of CPU, level and LLVM's major version of each (`find_host_levels`)."""


class Library(NamedTuple):
    """A shared library of machine code."""

    path: Path
    target: Target
    index: Index
    functions: Any
    """The ``ctypes.CDLL``."""

    def code(self, symbol: str) -> tuple[int, str] | None:
        """Return the address of a form and the kind of its result; None if it is missing."""
        returns = self.index.forms.get(symbol)
        if returns is None:
            return None
        address = ctypes.cast(self.functions[symbol], ctypes.c_void_p).value
        return address or 0, returns


def symbol_name(kernel: Any, number: int) -> str:
    """Return the symbol of a form of a kernel or stage, given its number."""
    return f"{kernel.__module__}.{kernel.__name__}.{number}".replace(".", "_")


def hash_sources(sources: Iterable[str]) -> str:
    """Return a hash of source files, given their paths in the package."""
    digest = hashlib.sha256()
    for name in sources:
        content = (ROOT / name).read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def encode_index(index: Index) -> bytes:
    """Return the bytes of the file ``index``, for any order of the forms the same."""
    text = json.dumps(index._asdict(), indent=1, sort_keys=True).encode()
    return hashlib.sha256(text).hexdigest().encode() + b"\n" + text


def read_index(path: Path) -> Index:
    """
    Read a file ``index``.

    Raises
    ------
    UnusableError
        It is damaged, or has other fields.
    OSError
        It cannot be read, or is missing.
    """
    checksum, _, text = path.read_bytes().partition(b"\n")
    if hashlib.sha256(text).hexdigest().encode() != checksum:
        raise UnusableError(f"{path} is damaged")
    try:
        index = Index(**json.loads(text))
        # Check the types of the fields.
        for name, _, *target in index.libraries:
            FOLDER.joinpath(name)
            Target(*target)
        for name, _, _, _, llvm in index.texts:
            FOLDER.joinpath(name)
            int(llvm)
        ROOT.joinpath(*index.sources["files"])
        str(index.sources["hash"])
        dict(index.forms)
    except (KeyError, TypeError, ValueError) as error:
        raise UnusableError(f"{path} has other fields than this version reads: {error}") from error
    return index


def open_library(path: Path, checksum: str) -> Any:
    """
    Check and open a shared library.

    Raises
    ------
    UnusableError
        It is damaged.
    OSError
        It cannot be opened, or is missing.
    """
    if hashlib.sha256(path.read_bytes()).hexdigest() != checksum:
        raise UnusableError(f"{path} is damaged")
    return ctypes.CDLL(str(path))


class LibrarySearch(NamedTuple):
    """The library for this CPU, or the reason why there is none."""

    library: Library | None
    problem: str | None
    """Why there is no library, or a better one was passed over; with the remedy."""


@functools.cache
def _try_read_index() -> tuple[Index | None, str | None]:
    """Return the index, if it was made from these sources; else the problem with it, if any."""
    if not FOLDER.is_dir():
        return None, None
    path = FOLDER / INDEX_FILE
    try:
        index = read_index(path)
        if hash_sources(index.sources["files"]) != index.sources["hash"]:
            raise UnusableError(f"{path}: it was made from other sources")
    except (UnusableError, OSError) as error:
        return None, _describe_problem(error, path)
    return index, None


@functools.cache
def find_library() -> LibrarySearch:
    """
    Find the best prebuilt library for this CPU.

    Libraries that are damaged, missing or refused by the system are passed over.
    """
    (index, problem), requested_cpu = _try_read_index(), requested_cpu_name()
    if index is None:
        return LibrarySearch(None, problem)
    for name, checksum, *target in index.libraries:
        path = FOLDER / name
        if requested_cpu not in ("", target[1]):
            continue
        try:
            functions = open_library(path, checksum)
        except (UnusableError, OSError) as error:
            problem = problem or _describe_problem(error, path)
            continue
        if requested_cpu or functions[CPU_CHECK_FUNCTION]():
            return LibrarySearch(Library(path, Target(*target), index, functions), problem)
    return LibrarySearch(None, problem)


class LoweredKernels(NamedTuple):
    """LLVM's text of kernels."""

    path: Path
    cpu: str
    """The level that it was optimized for."""
    index: Index
    texts: dict[str, str]
    """By symbol."""


class TextSearch(NamedTuple):
    """LLVM's text for this CPU, or the reason why there is none."""

    lowered: LoweredKernels | None
    problem: str | None
    """Why there is no text, or that of a better level was passed over; with the remedy."""


@functools.cache
def find_texts() -> TextSearch:
    """
    Find the prebuilt LLVM text of the best level that this CPU has.

    Text that is damaged or missing is passed over. Text of a newer LLVM is not used.
    """
    index = _try_read_index()[0]
    if index is None or not index.texts:
        return TextSearch(None, None)
    from llvmlite import binding

    kind, levels = find_host_levels()
    problem = None
    for level in levels:
        for name, checksum, text_kind, cpu, llvm in index.texts:
            if (text_kind, cpu) != (kind, level.cpu):
                continue
            path = FOLDER / name
            if int(llvm) > binding.llvm_version_info[0]:
                here = binding.llvm_version_info[0]
                return TextSearch(None, f"{path} was made by LLVM {llvm}, and here is LLVM {here}")
            try:
                return TextSearch(
                    LoweredKernels(path, cpu, index, read_texts(path, checksum)), problem
                )
            except (UnusableError, OSError) as error:
                problem = problem or _describe_problem(error, path)
            except ImportError as error:
                return TextSearch(None, f"{path}: {error}")
    return TextSearch(None, problem)


def pack_texts(texts: dict[str, str]) -> bytes:
    """Pack texts, by their symbols, into the content of a file."""
    import lzma

    return lzma.compress(json.dumps(texts, sort_keys=True).encode(), preset=9)


def read_texts(path: Path, checksum: str) -> dict[str, str]:
    """
    Check and read the texts in a file, by their symbols.

    Raises
    ------
    UnusableError
        It is damaged.
    OSError
        It cannot be read, or is missing.
    ImportError
        This Python lacks ``lzma``.
    """
    import lzma

    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != checksum:
        raise UnusableError(f"{path} is damaged")
    return json.loads(lzma.decompress(content))


def _describe_problem(error: UnusableError | OSError, path: Path) -> str:
    """Describe what is wrong with a file, and the remedy, if that is to install it again."""
    text = str(error)
    if isinstance(error, OSError):
        # Errors of the dynamic linker name the file in their text.
        text, place = error.strerror or text, str(error.filename or path)
        text = text if place in text else f"{place}: {text}"
    # The system would refuse the same file again.
    helps = isinstance(error, UnusableError | FileNotFoundError)
    return f"{text}; {REINSTALL}" if helps else text
