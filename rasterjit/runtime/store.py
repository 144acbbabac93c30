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
read half written. A process that compiles holds a lock; others wait for a minute.

Code is linked before it is stored. A store may come from elsewhere, and an entry that cannot be
linked may end the process: so a mark, which its process locks, lies beside an entry while it is
linked. An entry with a mark that no process holds is removed, and compiled again.

Without Numba, an entry of any version is used: the bits are the same. Without llvmlite, which links
entries, none is.

A shared library that came with the installation (``prebuilt_kernels``) is searched first. Entries
are made from the LLVM text that came, or else compiled from Python. What came is never written.

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
"""User number of root, who may write to any folder: root's own are trusted."""

FOLDER_VARIABLE = "RASTERJIT_CACHE_DIR"
"""Environment variable that names the folder of kernels."""

MAGIC = b"RasterJIT kernel 2\n"
CHECKSUM_BYTES = hashlib.sha256().digest_size

SUFFIX, PART, LOCK, MARK = ".kernel", ".part", ".lock", ".linking"
"""Ends of file names: an entry, one being written, the lock of a process that compiles one, and the
mark of a process that links one."""

LOCK_PATIENCE = 60.0
"""Seconds that another process may take to compile before this one does it, too."""

MAX_TEMPORARY_AGE = 3600.0
"""Seconds after which a temporary file is abandoned."""

RETRY_PAUSES = (0.01, 0.04, 0.2) if sys.platform == "win32" else ()
"""Seconds between attempts to read or replace a file: Windows refuses both while another process,
such as a virus scanner, has it open."""

MAX_ENTRY_BYTES = 1 << 26
"""Most bytes of an entry: a thousand times those of our kernels."""

READ_FLAGS = (
    os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)  # fmt: skip
"""Flags to open an entry: follows no link, and waits for no pipe."""

CREATE_FLAGS = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_BINARY", 0)

COMPILER_FILES = (
    "array_type", "code_generation", "compiler", "intrinsics", "intrinsics_ir", "numba_internals",
    "state_block",
)  # fmt: skip
"""Files of this folder that every kernel depends on."""

FILES_WITHOUT_KERNEL_CODE = {
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
"""Kinds of results of a kernel, as headers name them."""


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
    """Whether it was prebuilt or stored; else this process compiled it."""
    library: Any
    """Keeps the code in memory."""


class UsedKernels(NamedTuple):
    """The kernels of forms that this process uses, by module and name, in order."""

    loaded: list[str]
    compiled: list[str]


USED_KERNELS = UsedKernels([], [])

BEFORE_COMPILING: list[Callable[[], None]] = []
"""Called before and during compilation of a kernel, also by another process that is waited for."""


# Messages.


PRINTED_SUBJECTS: set[str] = set()
"""Subjects of printed messages: ``damage``, ``kept``, ``level``, ``shipped``."""

_PRINTING = forks.lock()


def print_once(subject: str, message: str) -> None:
    """Print a line on standard error, once per subject in this process."""
    with _PRINTING:
        if subject in PRINTED_SUBJECTS:
            return
        PRINTED_SUBJECTS.add(subject)
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            print(f"rasterjit: {message}", file=sys.stderr, flush=True)


# The folder.


@functools.cache
def kernel_folder() -> Path | None:
    """
    Return the folder of compiled kernels, created if missing; None if it cannot be used.

    By default ``rasterjit/kernels`` in the user's cache folder, else ``RASTERJIT_CACHE_DIR``.
    """
    chosen = os.environ.get(FOLDER_VARIABLE)
    try:
        path = Path(chosen) if chosen else user_cache_folder() / "kernels"
        # Missing parents get no permissions for others either, whatever the umask.
        for each in (*reversed(path.parents), path):
            if not each.is_dir():
                each.mkdir(mode=0o700, exist_ok=True)
        # Resolve links, so that the folder that is checked is the one that is used.
        path = path.resolve()
        problem = _find_distrust(path)
    except OSError as error:
        _report_not_stored(f"{error.filename or chosen}: {error.strerror}")
        return None
    except RuntimeError as error:  # The home folder is unknown.
        _report_not_stored(f"{error} {FOLDER_VARIABLE} can name a folder")
        return None
    if problem is not None:
        warnings.warn(f"{path} is not used to keep kernels: {problem}", RuntimeWarning, 2)
        return None
    return path


def _report_not_stored(reason: str) -> None:
    print_once("kept", f"compiled kernels are not kept on disk: {reason}")


def user_cache_folder() -> Path:
    """Return RasterJIT's folder in the user's cache folder."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        named = os.environ.get("XDG_CACHE_HOME", "")
        # The standard ignores relative paths.
        base = named if os.path.isabs(named) else Path.home() / ".cache"
    return Path(base) / "rasterjit"


def _find_distrust(path: Path) -> str | None:
    """Return why other users may change or exchange a folder; None if they may not."""
    if os.name != "posix":
        return None
    if _can_others_write(path.lstat()):
        return "others may write to it"
    for parent in path.parents:
        status = parent.lstat()
        # In a sticky folder, such as /tmp, only the owner of a file or folder can move it.
        if _can_others_write(status, is_sticky_enough=True):
            return f"others may write to {parent}, and exchange it"
    return None


def _can_others_write(status: os.stat_result, is_sticky_enough: bool = False) -> bool:
    """Tell whether a file or folder is another user's, or others may write to it."""
    if status.st_uid not in (os.geteuid(), ROOT_USER):
        return True
    is_open = bool(status.st_mode & 0o022)
    return is_open and not (is_sticky_enough and status.st_mode & stat.S_ISVTX)


# Names of entries.

OUR_IMPORT = re.compile(
    r"^(?:from (rasterjit[\w.]*) import (\([^)]*\)|[^\n#]*)|import (rasterjit[\w.]+))", re.M
)
"""Matches an import of our own modules."""


@functools.cache
def _read_source(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """Return the hash of a source file, and our files that it imports."""
    content = path.read_bytes()
    imported: list[Path] = []
    for module, names, plain in OUR_IMPORT.findall(content.decode()):
        base = ROOT.joinpath(*(module or plain).split(".")[1:])
        found = [base.with_suffix(".py")]
        if base.is_dir():
            found = [base / "__init__.py"]
            found += [base / f"{name}.py" for name in re.findall(r"(\w+)(?:\s+as\s+\w+)?", names)]
        imported += [one for one in found if one.is_file()]
    return hashlib.sha256(content).digest(), tuple(imported)


@functools.cache
def list_sources(path: Path) -> tuple[Path, ...]:
    """Return a file and all our files that it imports, directly or not, sorted."""
    pending, seen = [path], {path}
    while pending:
        for one in _read_source(pending.pop())[1]:
            is_ours = one.parent != ROOT / "runtime" or one.stem not in FILES_WITHOUT_KERNEL_CODE
            if one not in seen and is_ours:
                seen.add(one)
                pending.append(one)
    return tuple(sorted(seen))


def list_all_sources(module: str) -> tuple[Path, ...]:
    """Return the files that the code of a module's kernels depends on, the compiler's first."""
    here = ROOT / "runtime"
    return (*(here / f"{name}.py" for name in COMPILER_FILES), *list_sources(_module_file(module)))


@functools.cache
def hash_sources(module: str) -> str:
    """Return a hash of all sources that the code of a module's kernels depends on."""
    digest = hashlib.sha256()
    for path in list_all_sources(module):
        folder = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name
        digest.update(folder.encode() + b"\0" + _read_source(path)[0])
    return digest.hexdigest()[:32]


def _module_file(module: str) -> Path:
    """Return the file of a module, without importing one of ours."""
    ours = ROOT.joinpath(*module.split(".")[1:])
    if module.startswith("rasterjit."):
        return ours / "__init__.py" if ours.is_dir() else ours.with_suffix(".py")
    return Path(sys.modules[module].__file__ or "").resolve()


@functools.cache
def compiler_versions() -> str | None:
    """Return the versions of Numba and llvmlite, without importing Numba; None without them."""
    spec = _find_spec("numba")
    if not has_linker() or spec is None or not spec.origin:
        return None
    import llvmlite

    folder = Path(spec.origin).parent
    found = (
        re.fullmatch(r"numba-([^-]+)\.(?:dist|egg)-info", name)
        for name in _list_names(folder.parent)
    )
    version = next((match[1] for match in found if match), None)
    if version is None:
        with contextlib.suppress(OSError):
            text = (folder / "_version.py").read_text()
            version = next(iter(re.findall(r"\"version\": \"([^\"]+)\"", text)), None)
    return f"{version or 'unknown'} {llvmlite.__version__}"


def _find_spec(package: str) -> ModuleSpec | None:
    """Return the import spec of a package, without importing it; None if not installed."""
    try:
        return importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return None


@functools.cache
def has_linker() -> bool:
    """Tell whether llvmlite is installed, which links code that is not prebuilt."""
    return _find_spec("llvmlite") is not None


def _list_names(folder: Path) -> list[str]:
    """Return the names in a folder; none if it cannot be listed."""
    try:
        return os.listdir(folder)
    except OSError:
        return []


def describe_type(kind: Type) -> str:
    """Return a type as text; records with their modules and the names of their fields."""
    if not isinstance(kind, RecordType):
        return str(kind)
    names = getattr(kind.record, "_fields", None)
    fields = ", ".join(map(describe_type, kind.fields))
    if names is None:
        return f"({fields})"
    return f"{kind.record.__module__}.{kind.record.__qualname__}[{', '.join(names)}]({fields})"


def symbol_name(kernel: Any, kind: RecordType, target: Target) -> str:
    """Return the symbol of a form of a kernel, with which its file's name begins."""
    facts = (hash_sources(kernel.__module__), qualified_name(kernel), describe_type(kind), *target)
    digest = hashlib.sha256("\n".join(facts).encode()).hexdigest()
    return f"{kernel.__name__}_{digest[:24]}"


def qualified_name(kernel: Any) -> str:
    """Return the module and the name of a kernel."""
    return f"{kernel.__module__}.{kernel.__name__}"


def entry_path(folder: Path, name: str) -> Path:
    """Return the path of an entry; without Numba, of an entry of any versions."""
    made_with = compiler_versions()
    if made_with is None:
        stem = f"{name}."
        found = sorted(
            one for one in _list_names(folder) if one.startswith(stem) and one.endswith(SUFFIX)
        )
        return folder / (found[-1] if found else f"{name}{SUFFIX}")
    mark = hashlib.sha256(made_with.encode()).hexdigest()[:8]
    return folder / f"{name}.{mark}{SUFFIX}"


# Files.


def read_entry(path: Path) -> tuple[Header, bytes] | None:
    """
    Return the header and the object code of an entry; None if missing or damaged.

    The first damaged entry is reported on standard error.
    """
    try:
        content = _retry_refused(lambda: _read_content(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        _report_damaged(path, error.strerror or str(error))
        return None
    found = parse_entry(path.name, content)
    if found is None:
        _report_damaged(path, "is damaged")
    return found


def _read_content(path: Path) -> bytes:
    """
    Return the bytes of an entry.

    Raises
    ------
    OSError
        If it is no regular file, too large, or if other users may change it.
    """
    _check_entry(path.lstat())
    number = os.open(path, READ_FLAGS)
    with os.fdopen(number, "rb") as file:
        # The file may have been exchanged before it was opened.
        _check_entry(os.fstat(number))
        return file.read(MAX_ENTRY_BYTES)


def _check_entry(status: os.stat_result) -> None:
    """Raise ``OSError`` if a file cannot be an entry; the text follows a file's name."""
    if stat.S_ISDIR(status.st_mode):
        raise OSError("is a folder")
    if not stat.S_ISREG(status.st_mode):
        raise OSError("is no regular file")
    if status.st_size > MAX_ENTRY_BYTES:
        raise OSError(f"has {status.st_size} bytes, more than any entry")
    if os.name == "posix":
        if _can_others_write(status):
            raise OSError("is another user's, or others may write to it")
        if status.st_nlink > 1:
            raise OSError("has another name (a hard link)")


def _retry_refused(action: Callable[[], Any]) -> Any:
    """Return the result of an action on a file; retry it while access is refused."""
    for pause in RETRY_PAUSES:
        try:
            return action()
        except PermissionError:
            time.sleep(pause)
    return action()


def _report_damaged(path: Path, reason: str) -> None:
    print_once(
        "damage", f"compiling again what cannot be used in {path.parent}: {path.name} {reason}"
    )


def parse_entry(name: str, content: bytes) -> tuple[Header, bytes] | None:
    """Return the header and the object code in a file's content; None if damaged or renamed."""
    checksum, rest = (
        content[len(MAGIC) : len(MAGIC) + CHECKSUM_BYTES],
        content[len(MAGIC) + CHECKSUM_BYTES :],
    )
    if not content.startswith(MAGIC) or _checksum(name, rest) != checksum:
        return None
    line, _, code = rest.partition(b"\n")
    try:
        header = Header(*line.decode().split("\t"))
    except (UnicodeDecodeError, TypeError):
        # The checksum is right, so another version wrote it.
        return None
    return (header, code) if header.returns in RETURNS else None


def _checksum(name: str, rest: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + rest).digest()


def write_entry(path: Path, header: Header, code: bytes) -> None:
    """Write an entry whole, or not at all; report a full or read-only disk."""
    rest = "\t".join(header).encode() + b"\n" + code
    content = MAGIC + _checksum(path.name, rest) + rest
    try:
        if path.is_dir() and not path.is_symlink():
            _remove(path)
        temporary = path.with_name(f".{os.urandom(16).hex()}{PART}")
        # `tempfile` would retry for hours in a read-only folder on Windows.
        number = os.open(temporary, CREATE_FLAGS, 0o600)
        try:
            with os.fdopen(number, "wb") as file:
                file.write(content)
            _retry_refused(lambda: os.replace(temporary, path))
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
    except OSError as error:
        _report_not_stored(f"{path.parent}: {error.strerror or error}")


def _remove(path: Path) -> None:
    """Remove a file, or a folder with its contents."""
    if path.is_dir() and not path.is_symlink():
        import shutil

        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def lock_entry(path: Path) -> Iterator[None]:
    """
    Hold the lock of an entry, after waiting for another process that compiles it.

    The lock ends with the process that holds it. Where files cannot be locked, both compile.
    """
    claim = path.with_suffix(LOCK)
    held = _lock_entry(claim)
    try:
        yield
    finally:
        if held is not None:
            with held, contextlib.suppress(OSError):
                held.remove(claim)


def _lock_entry(path: Path) -> Lock | None:
    """Create a file and lock it; None after `LOCK_PATIENCE`, or where files cannot be locked."""
    end = time.monotonic() + LOCK_PATIENCE
    while time.monotonic() < end:
        try:
            path.touch()
        except OSError:
            return None
        try:
            held = lock(path)
        except FileNotFoundError:
            # The process that held the lock has removed the file.
            continue
        except OSError:
            return None
        if held is not None:
            return held
        _notify()
        time.sleep(0.02)
    return None


@functools.cache
def _sweep(folder: Path) -> None:
    """Remove abandoned temporary files, once in a process."""
    for one in list_temporary_files(folder):
        with contextlib.suppress(OSError):
            if time.time() - one.stat().st_mtime > MAX_TEMPORARY_AGE:
                one.unlink()


def list_temporary_files(folder: Path) -> list[Path]:
    """Return the files that exist only while a process compiles, sorted."""
    return sorted(folder / name for name in _list_names(folder) if name.endswith((PART, LOCK)))


# Loading.


def load(kernel: Any, kind: RecordType) -> Code:
    """
    Return the machine code of a form of a kernel: prebuilt, stored, or compiled and then stored.

    Raises
    ------
    NoCompilerError
        It is neither prebuilt nor stored, and Numba or llvmlite is not installed.
    """
    prebuilt = _load_prebuilt(kernel, kind)
    if prebuilt is not None:
        USED_KERNELS.loaded.append(qualified_name(kernel))
        return prebuilt
    if not has_linker():
        raise _make_no_compiler_error(kernel)
    name, folder = symbol_name(kernel, kind, host()), kernel_folder()
    if folder is None:
        header, code = _compile(kernel, kind, name)
        return _link(kernel, name, header.returns, code, False)
    path = entry_path(folder, name)
    loaded = _load_stored(kernel, kind, name, path)
    if loaded is not None:
        return loaded
    with lock_entry(path):
        loaded = _load_stored(kernel, kind, name, path)
        if loaded is not None:
            return loaded
        header, code = _compile(kernel, kind, name)
        # Link before storing: code that cannot be linked may end the process.
        linked = _link(kernel, name, header.returns, code, False)
        _sweep(folder)
        write_entry(path, header, code)
    return linked


def _load_prebuilt(kernel: Any, kind: RecordType) -> Code | None:
    """
    Return the prebuilt machine code of a form, if there is any and it can be used.

    The first problem with it is reported on standard error.
    """
    symbol = _prebuilt_symbol(kernel, kind)
    if symbol is None:
        return None
    library, problem = prebuilt_kernels.find_library()
    if library is not None:
        if problem is not None:
            print_once("level", f"loading code for {library.target.cpu}: {problem}")
        code = library.code(symbol)
        if code is not None:
            return Code(*code, True, library)
        problem = f"{library.path} has no {symbol}; {prebuilt_kernels.REINSTALL}"
    if problem is not None:
        _report_unusable(problem)
    return None


def _prebuilt_symbol(kernel: Any, kind: RecordType) -> str | None:
    """Return the name of a form in prebuilt code; None of others' kernels and undeclared forms."""
    if not kernel.__module__.startswith("rasterjit.") or kind not in kernel.declared:
        return None
    return prebuilt_kernels.symbol_name(kernel, kernel.declared.index(kind))


UNUSABLE_REASONS: list[str] = []
"""Problems with prebuilt code that this process has met."""


def _report_unusable(problem: str) -> None:
    if problem not in UNUSABLE_REASONS:
        UNUSABLE_REASONS.append(problem)
    # Without a compiler an error says so.
    if compiler_versions() is not None:
        print_once("shipped", f"compiling instead of loading: {problem}")


def _load_stored(kernel: Any, kind: RecordType, name: str, path: Path) -> Code | None:
    """Return the machine code of an entry; None if missing, damaged or of another form."""
    found = read_entry(path)
    if found is None:
        return None
    expected = _make_host_header(kernel, kind, found[0].returns)
    if compiler_versions() is None:
        expected = expected._replace(versions=found[0].versions)
    if found[0] != expected:
        _report_damaged(path, "was made for another kernel, machine or version")
        return None
    try:
        with _mark_linking(path) as has_ended_process:
            # Link it again only if no other code can be made.
            if has_ended_process and (
                compiler_versions() is not None or _find_text(kernel, kind) is not None
            ):
                with contextlib.suppress(OSError):
                    _retry_refused(lambda: path.unlink(missing_ok=True))
                _report_damaged(path, "was being linked when a process ended")
                return None
            return _link(kernel, name, found[0].returns, found[1], True)
    except RuntimeError:
        _report_damaged(path, "is no machine code")
    return None


@contextlib.contextmanager
def _mark_linking(path: Path) -> Iterator[bool]:
    """
    Mark an entry while it is linked; yield whether an earlier process ended while linking it.

    Nothing is marked where another process links the entry, too, or where no file can be locked.
    """
    mark, held = path.with_suffix(MARK), None
    with contextlib.suppress(OSError):
        held = lock(mark, creates=True)
    if held is None:
        yield False
        return
    with held:
        has_ended_process = False
        with contextlib.suppress(OSError):
            has_ended_process = held.is_exclusive and held.read() != b"" and held.is_at(mark)
            held.write(b"linking")
        try:
            yield has_ended_process
        finally:
            with contextlib.suppress(OSError):
                held.write(b"")
                held.remove(mark)


def is_stored(kernel: Any, kind: RecordType) -> bool:
    """Tell whether a form of a kernel is prebuilt or stored."""
    if _load_prebuilt(kernel, kind) is not None:
        return True
    folder = kernel_folder() if has_linker() else None
    return (
        folder is not None
        and read_entry(entry_path(folder, symbol_name(kernel, kind, host()))) is not None
    )


def _notify() -> None:
    _LAST_NOTIFIED[0] = time.monotonic()
    for tell in tuple(BEFORE_COMPILING):
        tell()


_LAST_NOTIFIED = [0.0]

NOTIFY_SECONDS = 0.5
"""Seconds between notifications while a kernel is being compiled."""


def report_compiling() -> None:
    """Notify, every `NOTIFY_SECONDS`, that a kernel is still being compiled; never raise."""
    if time.monotonic() - _LAST_NOTIFIED[0] >= NOTIFY_SECONDS:
        # An error here must not look like the compiler's.
        with contextlib.suppress(Exception):
            _notify()


class NoCompilerError(ImportError):
    """A kernel must be compiled, and Numba or llvmlite is not installed."""


def _make_no_compiler_error(kernel: Any) -> NoCompilerError:
    reason = f"; {UNUSABLE_REASONS[0]}" if UNUSABLE_REASONS else ""
    return NoCompilerError(
        f"{qualified_name(kernel)} must be compiled, which needs Numba: pip install numba{reason}"
    )


def _compile(kernel: Any, kind: RecordType, name: str) -> tuple[Header, bytes]:
    """Return the header and the object code of a form, from prebuilt LLVM text if there is any."""
    target = host()
    if compiler_versions() is None and _find_text(kernel, kind) is None:
        raise _make_no_compiler_error(kernel)
    _notify()
    with COMPILER_CLOCK.running():
        found = _generate_from_text(kernel, kind, name, target)
        if found is None and compiler_versions() is None:
            raise _make_no_compiler_error(kernel)
        returns, code = found or isolated_numba.compiler().compile_form(kernel, kind, name, target)
    return _make_host_header(kernel, kind, returns), code


def _generate_from_text(
    kernel: Any, kind: RecordType, name: str, target: Target
) -> tuple[str, bytes] | None:
    """Return what a form returns and its object code; None without text that can be used."""
    lowered = _find_text(kernel, kind)
    if lowered is None:
        return None
    from rasterjit.runtime.code_generation import generate_from_text

    try:
        return lowered.returns, generate_from_text(lowered.text, lowered.symbol, name, target)
    except RuntimeError as error:
        # LLVM shows the line below its message.
        reason = " ".join(str(error).split())[:200]
        _report_unusable(f"LLVM's text of {lowered.symbol}: {reason}")
        return None


class _LoweredForm(NamedTuple):
    """A form of a kernel as LLVM's text."""

    returns: str
    text: str
    symbol: str
    """Its name in the text."""


def _find_text(kernel: Any, kind: RecordType) -> _LoweredForm | None:
    """
    Return the prebuilt LLVM text of a form, if there is any and it can be used.

    The first problem with it is reported on standard error.
    """
    symbol = _prebuilt_symbol(kernel, kind)
    if symbol is None:
        return None
    lowered, problem = prebuilt_kernels.find_texts()
    if problem is not None and lowered is not None:
        print_once("shipped", f"compiling LLVM's text for {lowered.cpu}: {problem}")
    elif problem is not None:
        _report_unusable(problem)
    if lowered is None or symbol not in lowered.texts:
        return None
    return _LoweredForm(lowered.index.forms[symbol], lowered.texts[symbol], symbol)


def _make_host_header(kernel: Any, kind: RecordType, returns: str) -> Header:
    """Return the header of an entry for this machine."""
    return make_header(kernel, kind, returns, host())


def make_header(kernel: Any, kind: RecordType, returns: str, target: Target) -> Header:
    """Return the header of an entry for a target."""
    triple, cpu, _ = target
    return Header(
        returns, qualified_name(kernel), describe_type(kind), hash_sources(kernel.__module__),
        compiler_versions() or "", triple, cpu,
    )  # fmt: skip


_LINKER_LOCK = forks.hold_over_forks(threading.Lock())


@functools.cache
def _get_linker() -> Any:
    """Return LLVM's linker for this process."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.create_lljit_compiler()


_LIBRARY_NUMBERS = itertools.count()


def _link(kernel: Any, name: str, returns: str, code: bytes, is_loaded: bool) -> Code:
    """Link object code into memory."""
    from llvmlite import binding

    with _LINKER_LOCK:
        builder = binding.JITLibraryBuilder().add_object_img(code).export_symbol(name)
        library = builder.add_current_process().link(
            _get_linker(), f"{name}.{next(_LIBRARY_NUMBERS)}"
        )
        address = library[name]
    (USED_KERNELS.loaded if is_loaded else USED_KERNELS.compiled).append(qualified_name(kernel))
    return Code(address, returns, is_loaded, library)


# Maintenance.


class StoreContents(NamedTuple):
    """Counts of the files in a store, and those with problems."""

    entries: int
    """Valid entries; the next counts are of these."""
    other_versions: int
    """Made with other versions of Numba or llvmlite."""
    other_cpus: int
    other_sources: int
    """Made from other sources: of another installation, or before an edit."""
    size: int
    """Bytes of all entries."""
    damaged: list[Path]
    """Paths named like entries that are none."""
    unreadable: list[Path]
    temporary: list[Path]
    """Files of processes that compile, or were killed meanwhile."""


def inspect_folder(folder: Path) -> StoreContents:
    """Read all entries of a store."""
    good: list[Header] = []
    damaged, unreadable, size = [], [], 0
    for name in sorted(_list_names(folder)):
        path = folder / name
        if not name.endswith(SUFFIX):
            continue
        try:
            found = parse_entry(name, _read_content(path))
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
    (triple, cpu, _), versions = host(), compiler_versions()
    return StoreContents(
        len(good),
        # Without a compiler, entries made of LLVM's text are in use.
        0 if versions is None else sum(one.versions != versions for one in good),
        sum((one.triple, one.cpu) != (triple, cpu) for one in good),
        sum(one.sources != _try_hash_sources(one.kernel) for one in good),
        size, damaged, unreadable, list_temporary_files(folder),
    )  # fmt: skip


def _try_hash_sources(kernel: str) -> str | None:
    """Return the current hash of a kernel's sources; None if there are none."""
    try:
        return hash_sources(kernel.rpartition(".")[0])
    except (AttributeError, KeyError, OSError):
        return None


def remove_damaged(found: StoreContents) -> list[Path]:
    """
    Remove damaged entries and files of killed processes; return those that could not be removed.

    Locks that are held, and files that may still be written, stay.
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
    """Tell whether a process may still use a temporary file."""
    with contextlib.suppress(OSError):
        if path.suffix == PART:
            return time.time() - path.stat().st_mtime < LOCK_PATIENCE
        held = lock(path)
        if held is None:
            return True
        held.close()
    return False


def host_cpu_features() -> tuple[str, list[str]]:
    """Return the name of this CPU and the features that LLVM compiles for, sorted."""
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    return binding.get_host_cpu_name(), sorted(name for name, has in features.items() if has)
