"""
Write files and folders atomically: under a temporary name, then renamed in one step.

Who writes holds a lock on the temporary file. Those that nobody holds were left by processes that
were killed, and are removed by the next that writes to the same folder. Where locks cannot be had,
or forbid to write, files are left when they are old.
"""

from __future__ import annotations

import errno
import functools
import os
import re
import shutil
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from rasterjit.runtime.locks import lock, machine_names

PREFIX = ".rasterjit-part-"
"""Beginning of the names of temporary files; the names of the machine follow."""

BACKUP_SUFFIX = "-was"
"""End of the name of a folder that holds what is about to be replaced."""

TEMPORARY_NAME = re.compile(
    rf"{re.escape(PREFIX)}([0-9a-f]{{8}})-([0-9a-f]{{8}})-[0-9a-f]{{32}}(.*)", re.S
)
"""Host, system and end of the name of a temporary file."""

UNLOCKED_NAMES = ("0" * 8, "0" * 8)
"""Stands for the names of the machine in the name of a file that is written without a lock."""

MAX_ATTEMPTS = 10
"""Attempts to create a locked temporary file, before one is written without a lock."""

STALE_SECONDS = 24 * 3600.0
"""Age in seconds from which a temporary file counts as left by a killed process, without locks."""

USES_LOCKS = sys.platform != "win32"
"""Whether a temporary file is locked: Windows moves no file that is open."""


def write_text(path: Path, text: str) -> None:
    """Write text in UTF-8 atomically; lone surrogates become backslash escapes."""
    with atomic_file(path) as temporary:
        temporary.write_text(text, "utf-8", "backslashreplace", newline="\n")


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """
    Yield a temporary file in the same folder; rename it to ``path`` on success, else remove it.

    The first time in a folder, what killed processes left there is removed.

    Raises
    ------
    OSError
        Naming ``path``.
    """
    remove_stale_files(path.parent)
    with ExitStack() as stack, _name_target_in_errors(path):
        temporary = _create_temporary(path, stack, _make_file)
        yield temporary
        os.replace(temporary, path)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """
    Yield a temporary folder beside ``path``; rename it to that on success, else remove it.

    What is there, a folder or a link to one, goes only when the new one is there.
    """
    remove_stale_files(path.parent)
    with ExitStack() as stack:
        with _name_target_in_errors(path):
            temporary = _create_temporary(path, stack, os.mkdir)
        yield temporary
        with _name_target_in_errors(path):
            if os.path.lexists(path):
                aside = temporary.with_name(
                    temporary.name.removesuffix(path.suffix) + BACKUP_SUFFIX
                )
                os.mkdir(aside)
                stack.callback(_restore, aside)
                os.rename(path, aside / path.name)
            os.replace(temporary, path)


@contextmanager
def _name_target_in_errors(path: Path) -> Iterator[None]:
    """Let errors of the system name the path that is written, not its temporary file."""
    try:
        yield
    except OSError as error:
        if not os.path.basename(str(error.filename or PREFIX)).startswith(PREFIX):
            raise
        if error.errno is None:
            if isinstance(error, ConnectionError):
                # A cluster that draws what is written is lost: no fault of the file.
                raise
            # NumPy and encoders say in words how much was written.
            message = f"could not be written whole: {error}"
            raise OSError(errno.EIO, message, str(path)) from error
        error.filename = str(path)
        del error.filename2
        raise


def _make_temporary_path(path: Path, end: str, names: tuple[str, str] | None = None) -> Path:
    """Return a new temporary name beside a path, with the names of this machine by default."""
    host, system = names or machine_names()
    return path.with_name(f"{PREFIX}{host}-{system}-{uuid.uuid4().hex}{end}")


def _make_file(path: Path) -> None:
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))


def _create_temporary(path: Path, stack: ExitStack, make: Callable[[Path], None]) -> Path:
    """Create and lock a temporary file or folder; the stack removes it when it is left."""
    for _ in range(MAX_ATTEMPTS):
        with ExitStack() as attempt:
            temporary = _make_temporary_path(path, path.suffix)
            attempt.callback(_remove, temporary)
            make(temporary)
            # One that is not held yet may be taken for nobody's, and removed.
            if not _lock_file(temporary, attempt):
                continue
            if not _is_writable_while_locked(temporary):
                break
            stack.enter_context(attempt.pop_all())
            return temporary
    temporary = _make_temporary_path(path, path.suffix, UNLOCKED_NAMES)
    stack.callback(_remove, temporary)
    make(temporary)
    return temporary


def _is_writable_while_locked(path: Path) -> bool:
    """Tell whether an empty file can be written while it is locked: not so on SMB shares."""
    if USES_LOCKS and not path.is_dir():
        try:
            with open(path, "r+b", buffering=0) as other:
                other.write(b"\0")
                other.truncate(0)
        except PermissionError:
            return False
        except OSError:
            pass  # A full disk is told by who writes the content.
    return True


def _lock_file(path: Path, stack: ExitStack) -> bool:
    """Lock a file or folder until the stack is left; return False if another process did so."""
    if not USES_LOCKS:
        return True
    try:
        held = lock(path)
    except FileNotFoundError:
        return False
    return held is not None and stack.enter_context(held).is_at(path)


@functools.cache
def remove_stale_files(folder: Path) -> None:
    """Remove, once in a process, the temporary files that killed processes left in a folder."""
    with suppress(OSError):
        for name in os.listdir(folder):
            if match := TEMPORARY_NAME.fullmatch(name):
                with suppress(OSError, ValueError):
                    _remove_if_stale(folder / name, *match.groups())


def _remove_if_stale(path: Path, host: str, system: str, end: str) -> None:
    """Remove a temporary file or folder that no process locks; restore a backup."""
    if end == BACKUP_SUFFIX:
        _restore_if_stale(path)
    elif not USES_LOCKS or (host, system) == UNLOCKED_NAMES:
        if _is_old(path):
            _remove(path)
    elif held := lock(path):
        with held:
            is_near = host == machine_names()[0] or system == machine_names()[1]
            if (is_near and held.is_exclusive) or _is_old(path):
                _remove(path)


def _is_old(path: Path) -> bool:
    """Tell whether nothing was written to a file, or anywhere in a folder, for long."""
    since = time.time() - STALE_SECONDS
    inside = (os.path.join(at, name) for at, *both in os.walk(path) for name in both[0] + both[1])
    return all(os.lstat(one).st_mtime < since for one in (os.fspath(path), *inside))


def _restore_if_stale(aside: Path) -> None:
    """Restore a backup, unless the process that made it may still run."""
    begin = aside.name.removesuffix(BACKUP_SUFFIX)
    for name in os.listdir(aside.parent):
        if (
            name.startswith(begin)
            and name != aside.name
            and (match := TEMPORARY_NAME.fullmatch(name))
        ):
            # Who still writes what shall replace it goes on with both.
            _remove_if_stale(aside.parent / name, *match.groups())
            if os.path.lexists(aside.parent / name):
                return
    _restore(aside)


def _restore(aside: Path) -> None:
    """Move a backup to where it was; remove it if something else is there."""
    if aside.is_symlink():
        return
    with suppress(FileNotFoundError):
        for name in os.listdir(aside):
            if not os.path.lexists(aside.parent / name):
                os.rename(aside / name, aside.parent / name)
    _remove(aside)


def _remove(path: Path) -> None:
    """Remove a file or link, or a folder with all that is in it, if it is there."""
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
    else:
        shutil.rmtree(path, ignore_errors=True)
