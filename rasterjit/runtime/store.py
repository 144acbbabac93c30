"""
The kernel cache on disk: a file for each compiled form of a kernel, and its loader.

The problem: a frame needs dozens of kernels, and each takes half a second to compile. Code that is
kept must never be used where it does not belong: for other sources, another CPU, another type.

The idea: a file is named by a hash over all that decides its content: the sources of the kernel, of
the files of ours that it imports and of the compiler, the types of its arguments, and the target
CPU; then by the versions of Numba and llvmlite. Nothing has to be compared, nothing is ever out of
date: whoever edits a kernel looks for another name. An example: ``encode_rows`` of
``pipeline/srgb_encoding.py`` lies in ``encode_rows_<24 digits>.<8 digits of versions>.kernel``;
after any edit of that file the digits are others, and it is compiled again.

A file begins with a checksum over its name and its content. Damaged and missing entries are
compiled again. Files are written under another name and moved into place, so that none is ever
seen half written, whoever else writes. Who compiles holds a lock; others wait for a minute.

Code is linked before it is stored. A store may come from elsewhere, and an entry that cannot be
linked may end the process: so a mark, which its process locks, lies beside an entry while it is
linked. An entry with a mark that nobody holds is removed, and compiled again.

Where Numba is missing, an entry of any version will do: the bits are the same. Without llvmlite,
which links entries, none will.

A shared library that came with the installation (``prebuilt_kernels``) is looked at first. Entries
are made of the LLVM text that came, or else compiled from Python. What came is never written.

A checksum finds damage, not malice: a folder that others may write to, or exchange, is not used,
and of its files none that is another user's, that others may write to, or that has further names.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import itertools
import os
import re
import stat
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit import forks
from rasterjit.runtime import isolated_numba, prebuilt_kernels
from rasterjit.runtime.clocks import COMPILER_CLOCK
from rasterjit.runtime.locks import Lock, lock
from rasterjit.runtime.state_block import RecordType, Type
from rasterjit.runtime.targets import Target as Target
from rasterjit.runtime.targets import host as host

ROOT_USER = 0
"""May write to any folder, so its own are as good as the user's."""

FOLDER_VARIABLE = "RASTERJIT_CACHE_DIR"
"""Environment variable that names another folder."""

MAGIC = b"RasterJIT kernel 2\n"
SUM = hashlib.sha256().digest_size

SUFFIX, PART, LOCK, MARK = ".kernel", ".part", ".lock", ".linking"
"""How files end: an entry, one that is being written, the claim of who compiles one, and the mark
of who links one."""

PATIENCE = 60.0
"""Seconds that another process may take to compile before this one does it, too."""

STALE = 3600.0
"""Seconds after which nobody writes a temporary file any more."""

PAUSES = (0.01, 0.04, 0.2) if sys.platform == "win32" else ()
"""Seconds between tries to read or replace a file: Windows refuses both while another process, such
as a search for viruses, has it open."""

MAX_ENTRY = 1 << 26
"""Bytes of an entry at most: a thousand times those of our kernels."""

OPEN_FILE = (
    os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)  # fmt: skip
"""No link is followed, and no pipe waited for."""

NEW_FILE = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_BINARY", 0)

COMPILER_FILES = (
    "array_type", "code_generation", "compiler", "intrinsics", "intrinsics_ir", "numba_internals",
    "state_block",
)  # fmt: skip
"""Files of this folder that every kernel depends on."""

NOT_COMPILED = {
    "isolated_numba",
    "jit",
    "locks",
    "prebuilt_kernels",
    "store",
    "sysctl",
    "targets",
    "versions",
}
"""Files of this folder that do not affect compiled code."""

ROOT = Path(__file__).resolve().parents[1]


RETURNS = ("none", "int", "bool")
"""What a kernel may return, as a header says it."""


class Header(NamedTuple):
    """The header of an entry, a line of text."""

    returns: str
    """One of ``RETURNS``."""
    kernel: str
    """Module and name."""
    types: str
    sources: str
    """Hash of the sources, hexadecimal."""
    versions: str
    triple: str
    cpu: str


class Code(NamedTuple):
    """Machine code in memory."""

    address: int
    returns: str
    is_loaded: bool
    """It came with the installation or from the store; this process did not compile it."""
    library: Any
    """Keeps it there."""


class Used(NamedTuple):
    """The forms that this process took into use, by module and name of the kernel, in order."""

    loaded: list[str]
    compiled: list[str]


USED = Used([], [])

BEFORE_COMPILING: list[Callable[[], None]] = []
"""Called before and while this process compiles a kernel, or waits for another that does."""


# What it says.


SAID: set[str] = set()
"""What this process has told: ``damage``, ``kept``, ``level``, ``shipped``."""

_SAYING = forks.lock()


def say_once(subject: str, message: str) -> None:
    """Print a line on standard error, the first of this process on its subject."""
    with _SAYING:
        if subject in SAID:
            return
        SAID.add(subject)
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            print(f"rasterjit: {message}", file=sys.stderr, flush=True)


# Where it lies.


@functools.cache
def folder() -> Path | None:
    """
    Return the folder of the compiled kernels; None if none are kept.

    It is ``RASTERJIT_CACHE_DIR``, or ``rasterjit/kernels`` in the user's cache folder.
    """
    chosen = os.environ.get(FOLDER_VARIABLE)
    try:
        path = Path(chosen) if chosen else cache_folder() / "kernels"
        # What is made on the way is nobody else's either, whatever the umask.
        for one in (*reversed(path.parents), path):
            if not one.is_dir():
                one.mkdir(mode=0o700, exist_ok=True)
        # Links on the way are left behind: what is used is what was checked.
        path = path.resolve()
        problem = _distrust(path)
    except OSError as error:
        _say_not_kept(f"{error.filename or chosen}: {error.strerror}")
        return None
    except RuntimeError as error:  # Nobody knows where this user's home is.
        _say_not_kept(f"{error} {FOLDER_VARIABLE} can name a folder")
        return None
    if problem is not None:
        warnings.warn(f"{path} is not used to keep kernels: {problem}", RuntimeWarning, 2)
        return None
    return path


def _say_not_kept(reason: str) -> None:
    say_once("kept", f"compiled kernels are not kept on disk: {reason}")


def cache_folder() -> Path:
    """Return RasterJIT's folder in the user's cache folder."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        named = os.environ.get("XDG_CACHE_HOME", "")
        # By its standard, one that is not absolute is none.
        base = named if os.path.isabs(named) else Path.home() / ".cache"
    return Path(base) / "rasterjit"


def _distrust(path: Path) -> str | None:
    """Return why others may change what is in a folder, or exchange it; None if they may not."""
    if os.name != "posix":
        return None
    if _is_others(path.lstat()):
        return "others may write to it"
    for parent in path.parents:
        status = parent.lstat()
        # In a sticky folder, such as /tmp, nobody but its owner moves what is another's.
        if _is_others(status, is_sticky_enough=True):
            return f"others may write to {parent}, and exchange it"
    return None


def _is_others(status: os.stat_result, is_sticky_enough: bool = False) -> bool:
    """Tell whether a file or folder is another user's, or one that others may write to."""
    if status.st_uid not in (os.geteuid(), ROOT_USER):
        return True
    is_open = bool(status.st_mode & 0o022)
    return is_open and not (is_sticky_enough and status.st_mode & stat.S_ISVTX)


# What an entry is called.

IMPORT = re.compile(
    r"^(?:from (rasterjit[\w.]*) import (\([^)]*\)|[^\n#]*)|import (rasterjit[\w.]+))", re.M
)
"""An import of our own modules, at the beginning of a line."""


@functools.cache
def _source(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """Return the hash of a source file, and the files of ours that it imports."""
    content = path.read_bytes()
    imported: list[Path] = []
    for module, names, plain in IMPORT.findall(content.decode()):
        base = ROOT.joinpath(*(module or plain).split(".")[1:])
        found = [base.with_suffix(".py")]
        if base.is_dir():
            found = [base / "__init__.py"]
            found += [base / f"{name}.py" for name in re.findall(r"(\w+)(?:\s+as\s+\w+)?", names)]
        imported += [one for one in found if one.is_file()]
    return hashlib.sha256(content).digest(), tuple(imported)


@functools.cache
def sources_of(path: Path) -> tuple[Path, ...]:
    """Return a file and all files of ours that it imports, directly or not, sorted."""
    pending, seen = [path], {path}
    while pending:
        for one in _source(pending.pop())[1]:
            is_ours = one.parent != ROOT / "runtime" or one.stem not in NOT_COMPILED
            if one not in seen and is_ours:
                seen.add(one)
                pending.append(one)
    return tuple(sorted(seen))


def all_sources(module: str) -> tuple[Path, ...]:
    """Return the files that the kernels of a module follow from, the compiler's first."""
    here = ROOT / "runtime"
    return (*(here / f"{name}.py" for name in COMPILER_FILES), *sources_of(_file_of(module)))


@functools.cache
def sources_hash(module: str) -> str:
    """Return a hash of all sources that the kernels of a module follow from."""
    digest = hashlib.sha256()
    for path in all_sources(module):
        place = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name
        digest.update(place.encode() + b"\0" + _source(path)[0])
    return digest.hexdigest()[:32]


def _file_of(module: str) -> Path:
    """Return the file of a module; one of ours need not be imported."""
    ours = ROOT.joinpath(*module.split(".")[1:])
    if module.startswith("rasterjit."):
        return ours / "__init__.py" if ours.is_dir() else ours.with_suffix(".py")
    return Path(sys.modules[module].__file__ or "").resolve()


@functools.cache
def versions() -> str | None:
    """Return the versions of Numba and llvmlite; None without them. Numba is not imported."""
    spec = _spec("numba")
    if not has_linker() or spec is None or not spec.origin:
        return None
    import llvmlite

    place = Path(spec.origin).parent
    found = (
        re.fullmatch(r"numba-([^-]+)\.(?:dist|egg)-info", name) for name in _names(place.parent)
    )
    version = next((match[1] for match in found if match), None)
    if version is None:
        with contextlib.suppress(OSError):
            text = (place / "_version.py").read_text()
            version = next(iter(re.findall(r"\"version\": \"([^\"]+)\"", text)), None)
    return f"{version or 'unknown'} {llvmlite.__version__}"


def _spec(package: str) -> ModuleSpec | None:
    """Return where a package is; None if it is not installed. It is not imported."""
    try:
        return importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return None


@functools.cache
def has_linker() -> bool:
    """Tell whether llvmlite is installed, which links what is not shipped."""
    return _spec("llvmlite") is not None


def _names(place: Path) -> list[str]:
    """Return the names in a folder; none if it cannot be listed."""
    try:
        return os.listdir(place)
    except OSError:
        return []


def describe(kind: Type) -> str:
    """Return the text of a type: of a record, with its module and the names of its fields."""
    if not isinstance(kind, RecordType):
        return str(kind)
    names = getattr(kind.record, "_fields", None)
    fields = ", ".join(map(describe, kind.fields))
    if names is None:
        return f"({fields})"
    return f"{kind.record.__module__}.{kind.record.__qualname__}[{', '.join(names)}]({fields})"


def name_of(kernel: Any, kind: RecordType, target: Target) -> str:
    """Return the name of the symbol of a form of a kernel, with which its file's name begins."""
    facts = (sources_hash(kernel.__module__), full_name(kernel), describe(kind), *target)
    digest = hashlib.sha256("\n".join(facts).encode()).hexdigest()
    return f"{kernel.__name__}_{digest[:24]}"


def full_name(kernel: Any) -> str:
    """Return the module and the name of a kernel."""
    return f"{kernel.__module__}.{kernel.__name__}"


def path_of(place: Path, name: str) -> Path:
    """Return the path of an entry. Without Numba, it is any that is there."""
    made_with = versions()
    if made_with is None:
        stem = f"{name}."
        found = sorted(
            one for one in _names(place) if one.startswith(stem) and one.endswith(SUFFIX)
        )
        return place / (found[-1] if found else f"{name}{SUFFIX}")
    mark = hashlib.sha256(made_with.encode()).hexdigest()[:8]
    return place / f"{name}.{mark}{SUFFIX}"


# Files.


def read(path: Path) -> tuple[Header, bytes] | None:
    """
    Return what an entry says of itself, and its object code; None if missing or damaged.

    The first that is damaged is told on standard error.
    """
    try:
        content = _patiently(lambda: _content(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        _say_damaged(path, error.strerror or str(error))
        return None
    found = parse(path.name, content)
    if found is None:
        _say_damaged(path, "is damaged")
    return found


def _content(path: Path) -> bytes:
    """
    Return the bytes of an entry.

    Raises
    ------
    OSError
        If it is no regular file, which might have no end, is too large for an entry, or if others
        may change it.
    """
    _check_entry(path.lstat())
    number = os.open(path, OPEN_FILE)
    with os.fdopen(number, "rb") as file:
        # What was opened need not be what stood there before.
        _check_entry(os.fstat(number))
        return file.read(MAX_ENTRY)


def _check_entry(status: os.stat_result) -> None:
    """Raise ``OSError``, with words that follow a file's name, unless it may be an entry."""
    if stat.S_ISDIR(status.st_mode):
        raise OSError("is a folder")
    if not stat.S_ISREG(status.st_mode):
        raise OSError("is no regular file")
    if status.st_size > MAX_ENTRY:
        raise OSError(f"has {status.st_size} bytes, more than any entry")
    if os.name == "posix":
        if _is_others(status):
            raise OSError("is another user's, or others may write to it")
        if status.st_nlink > 1:
            raise OSError("has another name (a hard link)")


def _patiently(action: Callable[[], Any]) -> Any:
    """Return what an action on a file gives; try again where that is refused for a moment alone."""
    for pause in PAUSES:
        try:
            return action()
        except PermissionError:
            time.sleep(pause)
    return action()


def _say_damaged(path: Path, reason: str) -> None:
    say_once(
        "damage", f"compiling again what cannot be used in {path.parent}: {path.name} {reason}"
    )


def parse(name: str, content: bytes) -> tuple[Header, bytes] | None:
    """Return what a file of some name holds; None if it is damaged or another's."""
    checksum, rest = content[len(MAGIC) : len(MAGIC) + SUM], content[len(MAGIC) + SUM :]
    if not content.startswith(MAGIC) or _checksum(name, rest) != checksum:
        return None
    line, _, code = rest.partition(b"\n")
    try:
        header = Header(*line.decode().split("\t"))
    except (UnicodeDecodeError, TypeError):
        # Whoever wrote that knew how to make a checksum.
        return None
    return (header, code) if header.returns in RETURNS else None


def _checksum(name: str, rest: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + rest).digest()


def write(path: Path, header: Header, code: bytes) -> None:
    """Write a file whole, or not at all: a full or read-only disk keeps nothing, which is told."""
    rest = "\t".join(header).encode() + b"\n" + code
    content = MAGIC + _checksum(path.name, rest) + rest
    try:
        if path.is_dir() and not path.is_symlink():
            _remove(path)
        temporary = path.with_name(f".{os.urandom(16).hex()}{PART}")
        # The module `tempfile` tries for hours where Windows lets nobody write to the folder.
        number = os.open(temporary, NEW_FILE, 0o600)
        try:
            with os.fdopen(number, "wb") as file:
                file.write(content)
            _patiently(lambda: os.replace(temporary, path))
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
    except OSError as error:
        _say_not_kept(f"{path.parent}: {error.strerror or error}")


def _remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it."""
    if path.is_dir() and not path.is_symlink():
        import shutil

        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[None]:
    """
    Compile alone: wait while another process compiles the same entry.

    A claim is a lock that ends with the process that holds it, however that ends. Where there are
    no locks, both compile.
    """
    claim = path.with_suffix(LOCK)
    held = _claim(claim)
    try:
        yield
    finally:
        if held is not None:
            with held, contextlib.suppress(OSError):
                held.remove(claim)


def _claim(path: Path) -> Lock | None:
    """Make a file and lock it; None after a while in which another has it, or without locks."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            path.touch()
        except OSError:
            return None
        try:
            held = lock(path)
        except FileNotFoundError:
            # Who had it has removed it meanwhile.
            continue
        except OSError:
            return None
        if held is not None:
            return held
        _tell()
        time.sleep(0.02)
    return None


@functools.cache
def _sweep(place: Path) -> None:
    """Remove, once in a process, what killed processes left long ago."""
    for one in temporary_files(place):
        with contextlib.suppress(OSError):
            if time.time() - one.stat().st_mtime > STALE:
                one.unlink()


def temporary_files(place: Path) -> list[Path]:
    """Return the files that are there only while a process compiles, sorted."""
    return sorted(place / name for name in _names(place) if name.endswith((PART, LOCK)))


# Into memory.


def load(kernel: Any, kind: RecordType) -> Code:
    """
    Return the machine code of a form of a kernel: shipped, from the store, or compiled and stored.

    Raises
    ------
    NoCompilerError
        It is in neither, and Numba or llvmlite is not installed.
    """
    ready = _shipped(kernel, kind)
    if ready is not None:
        USED.loaded.append(full_name(kernel))
        return ready
    if not has_linker():
        raise _no_compiler(kernel)
    name, place = name_of(kernel, kind, host()), folder()
    if place is None:
        header, code = _compile(kernel, kind, name)
        return _linked(kernel, name, header.returns, code, False)
    path = path_of(place, name)
    loaded = _loaded(kernel, kind, name, path)
    if loaded is not None:
        return loaded
    with claimed(path):
        loaded = _loaded(kernel, kind, name, path)
        if loaded is not None:
            return loaded
        header, code = _compile(kernel, kind, name)
        # Code that cannot be linked may end the process: later ones must not find it.
        linked = _linked(kernel, name, header.returns, code, False)
        _sweep(place)
        write(path, header, code)
    return linked


def _shipped(kernel: Any, kind: RecordType) -> Code | None:
    """
    Return the machine code of a form that came with the installation.

    None if nothing came, or if it is of no use. The first time, what is wrong with what came is
    told on standard error.
    """
    if not kernel.__module__.startswith("rasterjit.") or kind not in kernel.declared:
        return None
    library, problem = prebuilt_kernels.found()
    if library is not None:
        if problem is not None:
            say_once("level", f"loading code for {library.target.cpu}: {problem}")
        symbol = prebuilt_kernels.symbol_of(kernel, kernel.declared.index(kind))
        code = library.code(symbol)
        if code is not None:
            return Code(*code, True, library)
        problem = f"{library.path} has no {symbol}; {prebuilt_kernels.REINSTALL}"
    if problem is not None:
        _say_unfit(problem)
    return None


UNFIT: list[str] = []
"""Why shipped code is of no use, as far as this process has met with it."""


def _say_unfit(problem: str) -> None:
    UNFIT.append(problem)
    # Without a compiler an error says so.
    if versions() is not None:
        say_once("shipped", f"compiling instead of loading: {problem}")


def _loaded(kernel: Any, kind: RecordType, name: str, path: Path) -> Code | None:
    """Return the machine code of an entry; None if it is missing, another's or no object code."""
    found = read(path)
    if found is None:
        return None
    expected = _header(kernel, kind, found[0].returns)
    if versions() is None:
        expected = expected._replace(versions=found[0].versions)
    if found[0] != expected:
        _say_damaged(path, "was made for another kernel, machine or version")
        return None
    try:
        with _marked(path) as has_ended_process:
            # Without a compiler there is nothing better.
            if has_ended_process and versions() is not None:
                with contextlib.suppress(OSError):
                    _patiently(lambda: path.unlink(missing_ok=True))
                _say_damaged(path, "was being linked when a process ended")
                return None
            return _linked(kernel, name, found[0].returns, found[1], True)
    except RuntimeError:
        _say_damaged(path, "is no machine code")
    return None


@contextlib.contextmanager
def _marked(path: Path) -> Iterator[bool]:
    """
    Mark an entry while it is linked; tell whether a process that marked it ended meanwhile.

    Nothing is marked where another process links the entry, too, or where no file can be locked.
    """
    mark, held = path.with_suffix(MARK), None
    with contextlib.suppress(OSError):
        held = lock(mark, is_made=True)
    if held is None:
        yield False
        return
    with held:
        has_ended_process = False
        with contextlib.suppress(OSError):
            has_ended_process = held.is_sure and held.read() != b"" and held.is_of(mark)
            held.write(b"linking")
        try:
            yield has_ended_process
        finally:
            with contextlib.suppress(OSError):
                held.write(b"")
                held.remove(mark)


def is_kept(kernel: Any, kind: RecordType) -> bool:
    """Tell whether a form of a kernel came with the installation, or is in the store."""
    if _shipped(kernel, kind) is not None:
        return True
    place = folder() if has_linker() else None
    return place is not None and read(path_of(place, name_of(kernel, kind, host()))) is not None


def _tell() -> None:
    _LAST_TOLD[0] = time.monotonic()
    for tell in tuple(BEFORE_COMPILING):
        tell()


_LAST_TOLD = [0.0]

PAUSE = 0.5
"""Seconds between two times that the compiler, on its way through a kernel, says it goes on."""


def tell_it_goes_on() -> None:
    """Tell, if that is some time ago, that a kernel is still being compiled; never raise."""
    if time.monotonic() - _LAST_TOLD[0] >= PAUSE:
        # The compiler would take an error for its own.
        with contextlib.suppress(Exception):
            _tell()


class NoCompilerError(ImportError):
    """A kernel must be compiled, and Numba or llvmlite is not installed."""


def _no_compiler(kernel: Any) -> NoCompilerError:
    reason = f"; {UNFIT[0]}" if UNFIT else ""
    return NoCompilerError(
        f"{full_name(kernel)} must be compiled, which needs Numba: pip install numba{reason}"
    )


def _compile(kernel: Any, kind: RecordType, name: str) -> tuple[Header, bytes]:
    """Return the header and the object code of a form, from LLVM's text if that came."""
    target, lowered = host(), _shipped_text(kernel, kind)
    if lowered is None and versions() is None:
        raise _no_compiler(kernel)
    _tell()
    with COMPILER_CLOCK.running():
        if lowered is not None:
            from rasterjit.runtime.code_generation import object_code_of_text

            returns, code = lowered.returns, object_code_of_text(*lowered[1:], name, target)
        else:
            returns, code = isolated_numba.compiler().compile_form(kernel, kind, name, target)
    return _header(kernel, kind, returns), code


class _Lowered(NamedTuple):
    """A form of a kernel as LLVM's text."""

    returns: str
    text: str
    symbol: str
    """Its name there."""


def _shipped_text(kernel: Any, kind: RecordType) -> _Lowered | None:
    """Return the text of a form that came with the installation; None if none is of use."""
    if not kernel.__module__.startswith("rasterjit.") or kind not in kernel.declared:
        return None
    try:
        found = prebuilt_kernels.found_texts()
    except prebuilt_kernels.UnfitError as error:
        _say_unfit(str(error))
        return None
    symbol = prebuilt_kernels.symbol_of(kernel, kernel.declared.index(kind))
    if found is None or symbol not in found.texts:
        return None
    return _Lowered(found.made.forms[symbol], found.texts[symbol], symbol)


def _header(kernel: Any, kind: RecordType, returns: str) -> Header:
    """Return what an entry for this machine says of itself."""
    return header_of(kernel, kind, returns, host())


def header_of(kernel: Any, kind: RecordType, returns: str, target: Target) -> Header:
    """Return what an entry for a target says of itself."""
    triple, cpu, _ = target
    return Header(
        returns, full_name(kernel), describe(kind), sources_hash(kernel.__module__),
        versions() or "", triple, cpu,
    )  # fmt: skip


_LINKING = forks.hold_over_forks(threading.Lock())


@functools.cache
def _linker() -> Any:
    """Return LLVM's linker for this process."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.create_lljit_compiler()


_NUMBERS = itertools.count()


def _linked(kernel: Any, name: str, returns: str, code: bytes, is_loaded: bool) -> Code:
    """Bring object code into memory."""
    from llvmlite import binding

    with _LINKING:
        builder = binding.JITLibraryBuilder().add_object_img(code).export_symbol(name)
        library = builder.add_current_process().link(_linker(), f"{name}.{next(_NUMBERS)}")
        address = library[name]
    (USED.loaded if is_loaded else USED.compiled).append(full_name(kernel))
    return Code(address, returns, is_loaded, library)


# Looking after it.


class StoreContents(NamedTuple):
    """What a store holds, by numbers of files."""

    entries: int
    """In good order; of them, the next four."""
    other_versions: int
    """Made with other versions of Numba or llvmlite."""
    other_cpus: int
    other_sources: int
    """Made from sources that are not these: of another installation, or before an edit."""
    size: int
    """Bytes of all entries."""
    damaged: list[Path]
    """Paths named like entries that are not valid ones."""
    unreadable: list[Path]
    temporary: list[Path]
    """What is there while a process compiles, or was killed."""


def contents(place: Path) -> StoreContents:
    """Read all of a store."""
    good: list[Header] = []
    damaged, unreadable, size = [], [], 0
    for name in sorted(_names(place)):
        path = place / name
        if not name.endswith(SUFFIX):
            continue
        try:
            found = parse(name, _content(path))
        except PermissionError:
            unreadable.append(path)
        except OSError:
            damaged.append(path)
        else:
            if found is None:
                damaged.append(path)
            else:
                good.append(found[0])
                size += path.stat().st_size
    triple, cpu, _ = host()
    return StoreContents(
        len(good),
        sum(one.versions != versions() for one in good),
        sum((one.triple, one.cpu) != (triple, cpu) for one in good),
        sum(one.sources != _current_sources(one.kernel) for one in good),
        size, damaged, unreadable, temporary_files(place),
    )  # fmt: skip


def _current_sources(kernel: str) -> str | None:
    """Return the hash of the sources of a kernel as they are now; None if there are none."""
    try:
        return sources_hash(kernel.rpartition(".")[0])
    except (AttributeError, KeyError, OSError):
        return None


def mend(found: StoreContents) -> list[Path]:
    """
    Remove what is damaged and what killed processes left; return what could not be removed.

    A claim that a process holds, and a file that may still be written, stay.
    """
    left = []
    for path in (*found.damaged, *found.temporary):
        if path in found.temporary and _is_in_use(path):
            continue
        try:
            _remove(path)
        except OSError:
            left.append(path)
    return left


def _is_in_use(path: Path) -> bool:
    """Tell whether a process may be compiling what a temporary file is for."""
    with contextlib.suppress(OSError):
        if path.suffix == PART:
            return time.time() - path.stat().st_mtime < PATIENCE
        held = lock(path)
        if held is None:
            return True
        held.close()
    return False


def cpu_features() -> tuple[str, list[str]]:
    """Return the name of this CPU and the features that LLVM compiles for, sorted."""
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    return binding.get_host_cpu_name(), sorted(name for name, has in features.items() if has)
