"""
Lock files and folders, until the process that holds the lock ends.

Process numbers would not do: containers that share a folder have the same ones.

``filelock`` is no part of the core install, empties the file that it locks, and locks no folders.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import os
import platform
import threading
import weakref
from contextlib import suppress
from pathlib import Path

from rasterjit import forks
from rasterjit.runtime.sysctl import read_sysctl

BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")
"""On Linux, names the boot of the system, the same in all containers."""

APPLE_BOOT_ID = "kern.bootsessionuuid"
"""On macOS, names the boot; the host's name changes with the network."""

LOCKED_BYTE = 1 << 30
"""Offset of the byte that is locked on Windows, behind any content."""


_OPENING = forks.hold_over_forks(threading.Lock())

_OPEN_LOCKS: weakref.WeakSet[Lock] = weakref.WeakSet()


class Lock:
    """
    A file or folder that is open, and locked until it is closed or the process ends.

    A forked child closes its copy.

    Attributes
    ----------
    is_exclusive : bool
        False where files cannot be locked: another process may hold the lock, too.
    """

    def __init__(self, descriptor: int, is_exclusive: bool) -> None:
        self._descriptor: int | None = descriptor
        self.is_exclusive = is_exclusive
        _OPEN_LOCKS.add(self)

    def __enter__(self) -> Lock:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the lock."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)

    def read(self) -> bytes:
        """Return the content of the file: on Windows, only the holder of a lock can read it."""
        if self._descriptor is None:
            return b""
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        return os.read(self._descriptor, os.fstat(self._descriptor).st_size)

    def write(self, content: bytes) -> None:
        """
        Replace the content of the file, a few bytes.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        if self._descriptor is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.ftruncate(self._descriptor, os.write(self._descriptor, content))

    def remove(self, path: Path) -> None:
        """
        Remove the file at a path, then release the lock: in the other order another may hold it.

        Raises
        ------
        OSError
            If it cannot be removed.
        """
        try:
            path.unlink(missing_ok=True)
        except PermissionError:
            # Windows removes no open file; once closed, another process may hold it.
            self.close()
            with suppress(PermissionError):
                path.unlink(missing_ok=True)
        self.close()

    def is_at(self, path: Path) -> bool:
        """Tell whether the locked file or folder is the one now at a path."""
        if self._descriptor is None:
            return False
        with suppress(OSError):
            there = os.stat(path, follow_symlinks=False)
            return os.path.samestat(os.fstat(self._descriptor), there)
        return False


def lock(path: Path, creates: bool = False) -> Lock | None:
    """
    Lock a file or folder, or create a missing file; None if another process holds the lock.

    Raises
    ------
    OSError
        If it cannot be opened, for instance a link.
    """
    is_folder = os.name == "posix" and path.is_dir()
    # Network file systems lock only files that are open for writing.
    flags = os.O_RDONLY if is_folder else os.O_RDWR
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"):
        flags |= getattr(os, name, 0)
    if creates:
        flags |= os.O_CREAT
    with _OPENING:
        descriptor = os.open(path, flags, 0o600)
        try:
            is_exclusive = _lock(descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        if is_exclusive is None:
            os.close(descriptor)
            return None
        return Lock(descriptor, is_exclusive)


def _close_all() -> None:
    """Leave the locks to the parent process, after a fork."""
    for held in list(_OPEN_LOCKS):
        held.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_all)


def _lock(descriptor: int) -> bool | None:
    """Lock an open file; return whether locks work here, or None if another process holds it."""
    try:
        import fcntl
    except ImportError:
        import msvcrt

        os.lseek(descriptor, LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError as error:
            return None if error.errno in (errno.EACCES, errno.EDEADLK) else False
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return None
    except OSError:
        return False
    return True


@functools.cache
def machine_names() -> tuple[str, str]:
    """
    Return hashes of the names of this host and of the booted system, 8 hexadecimal digits each.

    Processes that share either see each other's locks. Where both differ, they may not.
    """
    host_name = platform.node()
    system = (read_sysctl(APPLE_BOOT_ID) or b"").rstrip(b"\0").decode() or host_name
    with suppress(OSError):
        system = BOOT_ID_FILE.read_text().strip()
    return _hash_name(host_name), _hash_name(system)


def _hash_name(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()[:8]
