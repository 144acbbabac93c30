"""
Find the prebuilt kernels that came with the installation, in ``rasterjit/machine_code``.

A platform wheel brings a shared library for each CPU level, with every form of every kernel and
stage. The system opens it as it opens any other, so processes share its memory, and nothing is
linked here. What opens cannot be checked any more, and a file that was cut off ends the process: so
its SHA-256 is compared before, by the file ``index``, which ``cli.wheels`` writes ::

    SHA-256 of what follows
    {"made_with": what compiled it, "sources": files and a hash over them,
     "libraries": [[file, SHA-256, triple, CPU, features], ...], the best level first,
     "texts": [[file, SHA-256, kind of CPU, CPU], ...],
     "forms": {symbol: result, ...}}

The source distribution and the pure wheel bring LLVM's text instead, optimized for each level. The
store makes object code of it, in a sixth of the time that compiling from Python takes. A clone
brings nothing.

The sources are those that the kernels follow from. After an edit of any of them nothing here is
used.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.runtime.targets import Target, asked_cpu, level_here

ROOT = Path(__file__).resolve().parents[1]

FOLDER = ROOT / "machine_code"

INDEX = "index"

RUNS = "rasterjit_runs"
"""Function of a library that tells whether this CPU runs the rest of it."""

REINSTALL = "pip install --force-reinstall --no-deps rasterjit"


class UnfitError(ValueError):
    """Shipped code that cannot be used; the message names the file and says why."""


class Index(NamedTuple):
    """What came with the installation."""

    made_with: str
    """Python, Numba and llvmlite, with their versions."""
    sources: dict[str, Any]
    """``files``, below the package, and ``hash``, that of their contents."""
    libraries: list[list[str]]
    """Of each its file, its SHA-256 and its target; the best level first."""
    forms: dict[str, str]
    """What each form returns (``store.RETURNS``), by its symbol."""
    texts: list[list[str]]
    """Of each its file, its SHA-256, the kind of CPU and the level, as `level_here` calls them."""


class Library(NamedTuple):
    """A shared library of machine code."""

    path: Path
    target: Target
    index: Index
    functions: Any
    """As ``ctypes`` opened it."""

    def code(self, symbol: str) -> tuple[int, str] | None:
        """Return the address of a form, and what it returns; None if it is not in the library."""
        returns = self.index.forms.get(symbol)
        if returns is None:
            return None
        address = ctypes.cast(self.functions[symbol], ctypes.c_void_p).value
        return address or 0, returns


def symbol_of(kernel: Any, number: int) -> str:
    """Return the name of a form of a kernel or stage in a library, by its number."""
    return f"{kernel.__module__}.{kernel.__name__}.{number}".replace(".", "_")


def hash_of(sources: Iterable[str]) -> str:
    """Return a hash of source files, named by where they lie in the package."""
    digest = hashlib.sha256()
    for name in sources:
        content = (ROOT / name).read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def content_of(index: Index) -> bytes:
    """Return the bytes of the file ``index``: the same whatever the order of the forms."""
    text = json.dumps(index._asdict(), indent=1, sort_keys=True).encode()
    return hashlib.sha256(text).hexdigest().encode() + b"\n" + text


def read_index(path: Path) -> Index:
    """
    Return what a file ``index`` says.

    Raises
    ------
    UnfitError
        It is damaged, or has other fields.
    OSError
        It cannot be read, or is missing.
    """
    checksum, _, text = path.read_bytes().partition(b"\n")
    if hashlib.sha256(text).hexdigest().encode() != checksum:
        raise UnfitError(f"{path} is damaged")
    try:
        index = Index(**json.loads(text))
        # These raise here where a field is not what is used later.
        for name, _, *target in index.libraries:
            FOLDER.joinpath(name)
            Target(*target)
        for name, _, _, _ in index.texts:
            FOLDER.joinpath(name)
        ROOT.joinpath(*index.sources["files"])
        str(index.sources["hash"])
        dict(index.forms)
    except (KeyError, TypeError, ValueError) as error:
        raise UnfitError(f"{path} has other fields than this version reads: {error}") from error
    return index


def open_library(path: Path, checksum: str) -> Any:
    """
    Return a shared library, opened.

    Raises
    ------
    UnfitError
        It is damaged.
    OSError
        It cannot be opened, or is missing.
    """
    if hashlib.sha256(path.read_bytes()).hexdigest() != checksum:
        raise UnfitError(f"{path} is damaged")
    return ctypes.CDLL(str(path))


class Found(NamedTuple):
    """What came with the installation for this CPU."""

    library: Library | None
    problem: str | None
    """Why there is none, or what is wrong with one that was tried before it; and the remedy."""


@functools.cache
def _index() -> tuple[Index | None, str | None]:
    """Return what came with the installation, made from these sources; or what is wrong with it."""
    if not FOLDER.is_dir():
        return None, None
    path = FOLDER / INDEX
    try:
        index = read_index(path)
        if hash_of(index.sources["files"]) != index.sources["hash"]:
            raise UnfitError(f"{path}: it was made from other sources")
    except (UnfitError, OSError) as error:
        return None, _problem(error, path)
    return index, None


@functools.cache
def found() -> Found:
    """
    Return the shared library for this CPU that came with the installation, as far as of use.

    A library that is damaged, missing or refused by the system is passed over.
    """
    (index, problem), asked = _index(), asked_cpu()
    if index is None:
        return Found(None, problem)
    for name, checksum, *target in index.libraries:
        path = FOLDER / name
        if asked not in ("", target[1]):
            continue
        try:
            functions = open_library(path, checksum)
        except (UnfitError, OSError) as error:
            problem = problem or _problem(error, path)
            continue
        if asked or functions[RUNS]():
            return Found(Library(path, Target(*target), index, functions), problem)
    return Found(None, problem)


class LoweredKernels(NamedTuple):
    """LLVM's text of kernels."""

    path: Path
    cpu: str
    """The level that it was optimized for."""
    made: Index
    texts: dict[str, str]
    """By symbol."""


@functools.cache
def found_texts() -> LoweredKernels | None:
    """
    Return LLVM's text for this CPU that came with the installation; None if none came.

    Raises
    ------
    UnfitError
        It is damaged, missing or cannot be read.
    """
    index, here = _index()[0], level_here()
    if index is None or here is None:
        return None
    for name, checksum, kind, cpu in index.texts:
        if (kind, cpu) == (here[0], here[1].cpu):
            path = FOLDER / name
            try:
                return LoweredKernels(path, cpu, index, read_texts(path, checksum))
            except (ImportError, OSError) as error:
                raise UnfitError(f"{path}: {error}; {REINSTALL}") from error
    return None


def pack_texts(texts: dict[str, str]) -> bytes:
    """Return the content of a file of texts, given by their symbols."""
    import lzma

    return lzma.compress(json.dumps(texts, sort_keys=True).encode(), preset=9)


def read_texts(path: Path, checksum: str) -> dict[str, str]:
    """
    Return the texts in a file, by their symbols.

    Raises
    ------
    UnfitError
        It is damaged.
    OSError
        It cannot be read, or is missing.
    ImportError
        This Python lacks ``lzma``.
    """
    import lzma

    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != checksum:
        raise UnfitError(f"{path} is damaged; {REINSTALL}")
    return json.loads(lzma.decompress(content))


def _problem(error: UnfitError | OSError, path: Path) -> str:
    """Return what is wrong with a file, and the remedy, if it is to install it again."""
    text = str(error)
    if isinstance(error, OSError):
        # Who opens libraries names the file in the text.
        text, place = error.strerror or text, str(error.filename or path)
        text = text if place in text else f"{place}: {text}"
    # What the system refuses to open it would refuse again.
    helps = isinstance(error, UnfitError | FileNotFoundError)
    return f"{text}; {REINSTALL}" if helps else text
