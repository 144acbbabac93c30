"""
What a process that reads other people's files may do: limits that it sets itself, for good.

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

from rasterjit.io.resources import RefusedFileError, shown_name

resource: Any = None
with contextlib.suppress(ImportError):
    import resource

_SLACK = 256 << 20
"""Bytes of addresses that are mapped for other reasons, such as stacks of threads."""

_OPEN_FILES = 256

_CREATE, _ADD, _RESTRICT = 444, 445, 446
"""Numbers of Landlock's system calls, the same for all processors but Alpha."""

_READ_FILE, _READ_FOLDER = 1 << 2, 1 << 3
_FILE_RIGHTS = (13, 14, 15, 15, 16)
"""How many rights to files each version of Landlock knows; later ones as many as the last."""

_TCP, _SCOPES = 0b11, 0b11
"""Rights to bind and to connect; not to reach sockets without a file, or to send signals."""

_NO_NEW_PRIVILEGES, _DIE_WITH_PARENT = 38, 1
_NEW_USER, _NEW_NETWORK = 0x10000000, 0x40000000
_SIGKILL = 9

_LIBRARIES = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache",
              "/dev/null", "/dev/urandom", "/usr/share/zoneinfo")  # fmt: skip
"""Where a system has what packages load late."""

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

_REFUSED = ("socket.", "subprocess.", "os.exec", "os.fork", "os.posix_spawn", "os.spawn",
            "os.system", "os.kill", "os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link",
            "os.symlink", "os.chmod", "os.chown", "os.truncate", "shutil.",
            "webbrowser.")  # fmt: skip
"""How names begin of what Python tells its hooks before it does it, and is refused."""


def without_network() -> None:
    """Move into a network of its own, in which nothing is, if the system lets this process."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.unshare(_NEW_NETWORK) != 0:
            libc.unshare(_NEW_USER | _NEW_NETWORK)


def die_with_parent() -> None:
    """Let the system end this process when the one that made it ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, _SIGKILL, 0, 0, 0)


def seconds_used() -> int:
    """Return how long this process has used the processor, rounded up."""
    return int(time.process_time()) + 1


def hold_to_seconds(seconds: int) -> None:
    """Let this process use the processor for so long, all that it has used included."""
    if resource is not None:
        _limit(resource.RLIMIT_CPU, seconds)


def hold_to_memory(memory: int) -> None:
    """
    Limit memory and what is written.

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
        _limit(resource.RLIMIT_AS, mapped + memory + _SLACK)
    _limit(resource.RLIMIT_FSIZE, memory + _SLACK)
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_NOFILE, _OPEN_FILES)


def _limit(which: int, value: int) -> None:
    """Lower what may be had of something; what is lower already stays."""
    _, most = resource.getrlimit(which)
    value = value if most == resource.RLIM_INFINITY else min(value, most)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(which, (value, most))


def library_places() -> list[str]:
    """Return the folders and files that Python and its packages are read from."""
    return _library_places(tuple(sys.path), len(sys.modules))


@lru_cache(maxsize=1)
def _library_places(path: tuple[str, ...], _: int) -> list[str]:
    """Return the same, found anew only for another path or where modules came or went."""
    schemes = sysconfig.get_paths()
    found = {schemes[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    found |= {one for one in path if os.path.basename(one) in ("site-packages", "dist-packages")}
    found |= {one for one in path if one.startswith(schemes["stdlib"])}
    found |= set(_LIBRARIES) | {os.path.join(sys.base_prefix, "lib")}
    for name, module in list(sys.modules.items()):
        if "." not in name:
            # A package may lie elsewhere, such as where it is worked on.
            found |= set(map(os.fspath, getattr(module, "__path__", ())))
    return [one for one in dict.fromkeys(map(os.path.realpath, sorted(found)))
            if os.path.exists(one) and one != os.sep]  # fmt: skip


def keep_to_files(places: Sequence[str]) -> bool:
    """
    Let this process read below some places, and nothing else of the file system, for good.

    Returns
    -------
    bool
        Whether the kernel does so; it knows no Landlock before Linux 5.13.
    """
    if sys.platform != "linux":
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    version = libc.syscall(_CREATE, None, ctypes.c_size_t(0), ctypes.c_uint32(1))
    if version < 1:
        return False
    rights = (1 << _FILE_RIGHTS[min(version, len(_FILE_RIGHTS)) - 1]) - 1
    parts = [rights, *([_TCP] if version >= 4 else []), *([_SCOPES] if version >= 6 else [])]
    said = struct.pack(f"<{len(parts)}Q", *parts)
    rules = libc.syscall(_CREATE, said, ctypes.c_size_t(len(said)), ctypes.c_uint32(0))
    if rules < 0:
        return False
    try:
        for place in places:
            _allow(libc, rules, place)
        if libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
            return False
        return bool(libc.syscall(_RESTRICT, rules, ctypes.c_uint32(0)) == 0)
    finally:
        os.close(rules)


def _allow(libc: Any, rules: int, place: str) -> None:
    """Add a place to rules; one that is not there any more is left out."""
    try:
        opened = os.open(place, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        is_folder = stat.S_ISDIR(os.fstat(opened).st_mode)
        rights = _READ_FILE | (_READ_FOLDER if is_folder else 0)
        said = struct.pack("<Qi", rights, opened)
        libc.syscall(_ADD, rules, ctypes.c_int(1), said, ctypes.c_uint32(0))
    finally:
        os.close(opened)


class Guard:
    """
    Refuses, by a hook of Python's, what a reader may not do; it names what that is.

    Attributes
    ----------
    is_armed : bool
        Whether it refuses anything.
    """

    def __init__(self) -> None:
        self.is_armed = False
        self._root = ""
        self._places: tuple[str, ...] = ()
        sys.addaudithook(self._check)

    def keep_to(self, root: str, places: Iterable[str]) -> None:
        """Refuse files that lie neither below a root nor below other places, links followed."""
        self._root, self._places = root, tuple(places)

    def _check(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Raise `RefusedFileError` about what is about to be done and must not be."""
        if not self.is_armed:
            return
        if event == "open":
            self._check_open(*arguments)
        elif event.startswith(_REFUSED):
            raise RefusedFileError(f"reading a file must not do this: {event}")

    def _check_open(self, path: Any, mode: Any, flags: Any) -> None:
        """Check a file before it is opened."""
        if not isinstance(path, (str, bytes, os.PathLike)):
            return
        name = os.fsdecode(path)
        if isinstance(flags, int) and flags & _WRITING:
            raise RefusedFileError(f"reading a file writes none: {shown_name(name)}")
        place = os.path.realpath(name)
        if not _is_below(place, self._root) and not any(
            _is_below(place, one) for one in self._places
        ):
            raise RefusedFileError(
                f"the file {shown_name(name)} lies outside {self._root!r}; resource_root names "
                "another folder"
            )
        with contextlib.suppress(OSError):
            kind = os.stat(place).st_mode
            if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind) and not place.startswith("/dev/"):
                raise RefusedFileError(f"{shown_name(name)} is no regular file")


def _is_below(place: str, folder: str) -> bool:
    """Tell whether a place is a folder or in it, both without links."""
    return place == folder or place.startswith(folder.rstrip(os.sep) + os.sep)


_MAX_EMPTY_READS = 1000
"""In a row, at the end of one file: readers that know what they do need a few."""

_ENDS = "it ends where more is expected"

_OPEN = io.open


class _File(io.FileIO):
    """A file that counts how often it was read in vain."""

    _empty_reads = 0

    def readinto(self, buffer: Any, /) -> int | None:
        """Read into memory, or raise ``EOFError`` if there was nothing too often."""
        count = super().readinto(buffer)
        if count:
            self._empty_reads = 0
        elif len(memoryview(buffer)):
            self._empty_reads += 1
            if self._empty_reads > _MAX_EMPTY_READS:
                raise EOFError(_ENDS)
        return count


def _open(
    file: Any, mode: str = "r", buffering: int = -1, encoding: str | None = None,
    errors: str | None = None, newline: str | None = None, closefd: bool = True, opener: Any = None,
) -> Any:  # fmt: skip
    """Open a file as Python does; one that is only read, and in pieces, counts what is in vain."""
    if not isinstance(mode, str) or mode not in ("r", "rt", "tr", "rb", "br") or buffering >= 0:
        return _OPEN(file, mode, buffering, encoding, errors, newline, closefd, opener)
    is_text = "b" not in mode
    if not is_text and (encoding, errors, newline) != (None, None, None):
        # It says what is wrong with that.
        return _OPEN(file, mode, buffering, encoding, errors, newline, closefd, opener)
    buffered = io.BufferedReader(_File(file, "r", closefd, opener))
    if not is_text:
        return buffered
    try:
        return io.TextIOWrapper(buffered, encoding, errors, newline)
    except BaseException:
        buffered.close()
        raise


def refuse_endless_reads() -> None:
    """Let every file that this process opens by Python from now on raise ``EOFError`` in time."""
    builtins.open = io.open = _open  # type: ignore[assignment]
