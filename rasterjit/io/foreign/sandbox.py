"""
Limits that a process that reads untrusted files sets on itself, for good.

Linux holds it to them: Landlock [1]_ to files, limits of the system to memory and time. Everywhere
Python refuses to open what lies elsewhere, of which readers in C take no notice.

References
----------
.. [1] M. Salaün, "Landlock: unprivileged access control", Linux kernel documentation.
"""

from __future__ import annotations

import builtins
import contextlib
import ctypes
import io
import os
import stat
import struct
import sys
import sysconfig
import time
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

from rasterjit.io.resources import RefusedFileError, quote_name

resource: Any = None
with contextlib.suppress(ImportError):
    import resource

_EXTRA_MEMORY_BYTES = 256 << 20
"""Bytes of address space for other uses, such as stacks of threads."""

_MAX_OPEN_FILES = 256

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
"""Landlock's system calls: create a ruleset, add a rule, restrict; Alpha has others."""

_READ_FILE_RIGHT, _READ_FOLDER_RIGHT = 1 << 2, 1 << 3
_FILE_RIGHT_COUNTS = (13, 14, 15, 15, 16)
"""Number of file rights of each version of Landlock; later ones have as many as the last."""

_TCP_RIGHTS, _SCOPE_RIGHTS = 0b11, 0b11
"""Landlock rights over TCP: bind, connect; scopes: abstract sockets, signals."""

_NO_NEW_PRIVILEGES, _DIE_WITH_PARENT = 38, 1
_NEW_USER_NAMESPACE, _NEW_NETWORK_NAMESPACE = 0x10000000, 0x40000000
_SIGKILL = 9

_SYSTEM_PATHS = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache",
              "/dev/null", "/dev/urandom", "/usr/share/zoneinfo")  # fmt: skip
"""Paths of the system from which packages load late."""

_WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

_REFUSED_EVENTS = ("socket.", "subprocess.", "os.exec", "os.fork", "os.posix_spawn", "os.spawn",
            "os.system", "os.kill", "os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link",
            "os.symlink", "os.chmod", "os.chown", "os.truncate", "shutil.",
            "webbrowser.")  # fmt: skip
"""Prefixes of the audit events of Python that are refused."""


def isolate_network() -> None:
    """Move this process into an empty network namespace, if the system allows it."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.unshare(_NEW_NETWORK_NAMESPACE) != 0:
            libc.unshare(_NEW_USER_NAMESPACE | _NEW_NETWORK_NAMESPACE)


def die_with_parent() -> None:
    """Let the system kill this process when its parent ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, _SIGKILL, 0, 0, 0)


def measure_cpu_seconds() -> int:
    """Return the processor time of this process in seconds, rounded up."""
    return int(time.process_time()) + 1


def limit_cpu_time(seconds: int) -> None:
    """Limit the total processor time of this process."""
    if resource is not None:
        _lower_limit(resource.RLIMIT_CPU, seconds)


def limit_memory(memory: int) -> None:
    """
    Limit the memory of this process, and the size of files that it writes.

    Parameters
    ----------
    memory : int
        Bytes that may be taken beyond those that this process has; files get no larger either.
    """
    if resource is None:
        return
    with contextlib.suppress(OSError):
        with open("/proc/self/statm", "rb") as file:
            mapped = int(file.read().split()[0]) * resource.getpagesize()
        _lower_limit(resource.RLIMIT_AS, mapped + memory + _EXTRA_MEMORY_BYTES)
    _lower_limit(resource.RLIMIT_FSIZE, memory + _EXTRA_MEMORY_BYTES)
    _lower_limit(resource.RLIMIT_CORE, 0)
    _lower_limit(resource.RLIMIT_NOFILE, _MAX_OPEN_FILES)


def _lower_limit(which: int, value: int) -> None:
    """Lower a resource limit; one that is lower already stays."""
    _, most = resource.getrlimit(which)
    value = value if most == resource.RLIM_INFINITY else min(value, most)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(which, (value, most))


def list_library_paths() -> list[str]:
    """Return the folders and files that Python and its packages are read from."""
    return _list_library_paths(tuple(sys.path), len(sys.modules))


@lru_cache(maxsize=1)
def _list_library_paths(path: tuple[str, ...], _: int) -> list[str]:
    """Return `list_library_paths`, cached for a path and a number of modules."""
    schemes = sysconfig.get_paths()
    paths = {schemes[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    paths |= {one for one in path if os.path.basename(one) in ("site-packages", "dist-packages")}
    paths |= {one for one in path if one.startswith(schemes["stdlib"])}
    paths |= set(_SYSTEM_PATHS) | {os.path.join(sys.base_prefix, "lib")}
    for name, module in list(sys.modules.items()):
        if "." not in name:
            # A package may lie elsewhere, such as where it is worked on.
            paths |= set(map(os.fspath, getattr(module, "__path__", ())))
    return [one for one in dict.fromkeys(map(os.path.realpath, sorted(paths)))
            if os.path.exists(one) and one != os.sep]  # fmt: skip


def restrict_files(paths: Sequence[str]) -> bool:
    """
    Restrict this process, for good, to reading files below some paths.

    Returns
    -------
    bool
        Whether the kernel enforces it: Linux has Landlock from 5.13 on.
    """
    if sys.platform != "linux":
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    version = libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(1))
    if version < 1:
        return False
    rights = (1 << _FILE_RIGHT_COUNTS[min(version, len(_FILE_RIGHT_COUNTS)) - 1]) - 1
    masks = [
        rights,
        *([_TCP_RIGHTS] if version >= 4 else []),
        *([_SCOPE_RIGHTS] if version >= 6 else []),
    ]
    attributes = struct.pack(f"<{len(masks)}Q", *masks)
    rules = libc.syscall(
        _CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), ctypes.c_uint32(0)
    )
    if rules < 0:
        return False
    try:
        for path in paths:
            _add_allowed_path(libc, rules, path)
        if libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
            return False
        return bool(libc.syscall(_RESTRICT_SELF, rules, ctypes.c_uint32(0)) == 0)
    finally:
        os.close(rules)


def _add_allowed_path(libc: Any, rules: int, path: str) -> None:
    """Add a path to a ruleset; one that does not exist is left out."""
    try:
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        is_folder = stat.S_ISDIR(os.fstat(opened).st_mode)
        rights = _READ_FILE_RIGHT | (_READ_FOLDER_RIGHT if is_folder else 0)
        rule = struct.pack("<Qi", rights, opened)
        libc.syscall(_ADD_RULE, rules, ctypes.c_int(1), rule, ctypes.c_uint32(0))
    finally:
        os.close(opened)


class Guard:
    """
    An audit hook of Python that refuses, and names, what a reader may not do.

    Attributes
    ----------
    is_armed : bool
        Whether it refuses anything.
    """

    def __init__(self) -> None:
        self.is_armed = False
        self._root = ""
        self._paths: tuple[str, ...] = ()
        sys.addaudithook(self._check)

    def restrict(self, root: str, paths: Iterable[str]) -> None:
        """Refuse files outside a root and other paths, links followed."""
        self._root, self._paths = root, tuple(paths)

    def _check(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Raise `RefusedFileError` about an audit event that is not allowed."""
        if not self.is_armed:
            return
        if event == "open":
            self._check_open(*arguments)
        elif event.startswith(_REFUSED_EVENTS):
            raise RefusedFileError(f"reading a file must not do this: {event}")

    def _check_open(self, file: Any, mode: Any, flags: Any) -> None:
        """Check a file before it is opened."""
        if not isinstance(file, (str, bytes, os.PathLike)):
            return
        name = os.fsdecode(file)
        if isinstance(flags, int) and flags & _WRITE_FLAGS:
            raise RefusedFileError(f"reading a file writes none: {quote_name(name)}")
        path = os.path.realpath(name)
        if not _is_below(path, self._root) and not any(_is_below(path, one) for one in self._paths):
            raise RefusedFileError(
                f"the file {quote_name(name)} lies outside {self._root!r}; resource_root names "
                "another folder"
            )
        with contextlib.suppress(OSError):
            kind = os.stat(path).st_mode
            if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind) and not path.startswith("/dev/"):
                raise RefusedFileError(f"{quote_name(name)} is no regular file")


def _is_below(path: str, folder: str) -> bool:
    """Tell whether a path is a folder or in it, both without links."""
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)


_MAX_EMPTY_READS = 1000
"""Most reads in a row at the end of a file: correct readers need a few."""

_END_MESSAGE = "it ends where more is expected"

_OPEN = io.open


class _CountingFile(io.FileIO):
    """A file that counts its empty reads."""

    _empty_reads = 0

    def readinto(self, buffer: Any, /) -> int | None:
        """Read into memory; raise ``EOFError`` after too many empty reads."""
        count = super().readinto(buffer)
        if count:
            self._empty_reads = 0
        elif len(memoryview(buffer)):
            self._empty_reads += 1
            if self._empty_reads > _MAX_EMPTY_READS:
                raise EOFError(_END_MESSAGE)
        return count


def _open(
    file: Any, mode: str = "r", buffering: int = -1, encoding: str | None = None,
    errors: str | None = None, newline: str | None = None, closefd: bool = True, opener: Any = None,
) -> Any:  # fmt: skip
    """Open a file as Python does; buffered readers count empty reads."""
    if not isinstance(mode, str) or mode not in ("r", "rt", "tr", "rb", "br") or buffering >= 0:
        return _OPEN(file, mode, buffering, encoding, errors, newline, closefd, opener)
    is_text = "b" not in mode
    if not is_text and (encoding, errors, newline) != (None, None, None):
        # It says what is wrong with that.
        return _OPEN(file, mode, buffering, encoding, errors, newline, closefd, opener)
    buffered = io.BufferedReader(_CountingFile(file, "r", closefd, opener))
    if not is_text:
        return buffered
    try:
        return io.TextIOWrapper(buffered, encoding, errors, newline)
    except BaseException:
        buffered.close()
        raise


def limit_empty_reads() -> None:
    """Replace ``open``, so that endless reads at the end of a file raise ``EOFError``."""
    builtins.open = io.open = _open  # type: ignore[assignment]
