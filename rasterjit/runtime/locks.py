"""
Tell by a lock whether who writes something is still there: it ends with the process that holds it.

Numbers of processes tell nothing: containers that share a folder have the same ones.

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

BOOT = Path("/proc/sys/kernel/random/boot_id")
"""Where Linux names the run of the system, the same in all containers."""

APPLE_BOOT = "kern.bootsessionuuid"
"""What macOS calls it. Its host's name changes with the network."""

FAR = 1 << 30
"""The byte that is locked where locks are for bytes: none that anyone reads."""


_OPENING = forks.hold_over_forks(threading.Lock())

_OPEN: weakref.WeakSet[Lock] = weakref.WeakSet()


class Lock:
    """
    A file or folder that is open, and locked until it is closed or the process ends.

    It stays with the process that locked it: a forked child closes its copy.

    Attributes
    ----------
    is_sure : bool
        False where nothing can be locked: another may have it, too.
    """

    def __init__(self, descriptor: int, is_sure: bool) -> None:
        self._descriptor: int | None = descriptor
        self.is_sure = is_sure
        _OPEN.add(self)

    def __enter__(self) -> Lock:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of it."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)

    def read(self) -> bytes:
        """Return what a file holds: where locks are mandatory, only who has it can read it."""
        if self._descriptor is None:
            return b""
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        return os.read(self._descriptor, os.fstat(self._descriptor).st_size)

    def write(self, content: bytes) -> None:
        """
        Let a file hold something else, a few bytes.

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
        Let go of a file at a path and remove it: before, for afterwards it may be another's.

        Raises
        ------
        OSError
            If it cannot be removed.
        """
        try:
            path.unlink(missing_ok=True)
        except PermissionError:
            # Windows removes no file that is open; once closed, another run may have it.
            self.close()
            with suppress(PermissionError):
                path.unlink(missing_ok=True)
        self.close()

    def is_of(self, path: Path) -> bool:
        """Tell whether what is locked is what lies at a path now."""
        if self._descriptor is None:
            return False
        with suppress(OSError):
            there = os.stat(path, follow_symlinks=False)
            return os.path.samestat(os.fstat(self._descriptor), there)
        return False


def lock(path: Path, is_made: bool = False) -> Lock | None:
    """
    Lock a file or folder that is there, or a file that is made if missing; None if another has it.

    Raises
    ------
    OSError
        If it cannot be opened, a link for one.
    """
    is_folder = os.name == "posix" and path.is_dir()
    # Over a network, only what is open for writing can be locked.
    flags = os.O_RDONLY if is_folder else os.O_RDWR
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"):
        flags |= getattr(os, name, 0)
    if is_made:
        flags |= os.O_CREAT
    with _OPENING:
        descriptor = os.open(path, flags, 0o600)
        try:
            is_sure = _lock(descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        if is_sure is None:
            os.close(descriptor)
            return None
        return Lock(descriptor, is_sure)


def _close_all() -> None:
    """Leave locks to the process that this one was forked from."""
    for held in list(_OPEN):
        held.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_all)


def _lock(descriptor: int) -> bool | None:
    """Lock what is open; return whether that is sure, or None if another has it."""
    try:
        import fcntl
    except ImportError:
        import msvcrt

        os.lseek(descriptor, FAR, os.SEEK_SET)
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
def machine() -> tuple[str, str]:
    """
    Return two names of this machine, 8 hexadecimal digits each: of the host, and of the system.

    Processes that share either are asked by locks. Where both differ, a lock may not be seen.
    """
    host = platform.node()
    system = (read_sysctl(APPLE_BOOT) or b"").rstrip(b"\0").decode() or host
    with suppress(OSError):
        system = BOOT.read_text().strip()
    return _digits(host), _digits(system)


def _digits(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()[:8]
