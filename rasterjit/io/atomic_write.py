"""
Write files and folders whole, or not at all: under a temporary name, then moved in one step.

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

from rasterjit.runtime.locks import lock, machine

MARK = ".rasterjit-part-"
"""What the names of temporary files begin with; then come the names of the machine."""

ASIDE = "-was"
"""How the name of a folder ends in which something lies that is about to be replaced."""

NAME = re.compile(rf"{re.escape(MARK)}([0-9a-f]{{8}})-([0-9a-f]{{8}})-[0-9a-f]{{32}}(.*)", re.S)
"""Host, system and end of the name of a temporary file."""

UNHELD = ("0" * 8, "0" * 8)
"""In place of the names of the machine: a file that nobody holds, though it is being written."""

TRIES = 10
"""How often a temporary file is made anew, before one is written that nobody holds."""

LEFT_AFTER = 24 * 3600.0
"""Seconds after which nobody writes a temporary file any more, where locks do not tell."""

IS_LOCKED = sys.platform != "win32"
"""Whether a temporary file is locked: Windows moves no file that is open."""


def write_text(place: Path, text: str) -> None:
    """Write text in UTF-8, whole or not at all; what is no letter of a name as JSON escapes it."""
    with replacing(place) as temporary:
        temporary.write_text(text, "utf-8", "backslashreplace", newline="\n")


@contextmanager
def replacing(place: Path) -> Iterator[Path]:
    """
    Give a temporary file in the same folder; move it to ``place`` on success, else remove it.

    The first time in a folder, what killed processes left there is removed.

    Raises
    ------
    OSError
        Naming ``place``.
    """
    remove_leftovers(place.parent)
    with ExitStack() as stack, _naming(place):
        temporary = _begun(place, stack, _make_file)
        yield temporary
        os.replace(temporary, place)


@contextmanager
def replacing_folder(place: Path) -> Iterator[Path]:
    """
    Give a temporary folder beside a place; move it there on success, else remove it.

    What is there, a folder or a link to one, goes only when the new one is there.
    """
    remove_leftovers(place.parent)
    with ExitStack() as stack:
        with _naming(place):
            temporary = _begun(place, stack, os.mkdir)
        yield temporary
        with _naming(place):
            if os.path.lexists(place):
                aside = temporary.with_name(temporary.name.removesuffix(place.suffix) + ASIDE)
                os.mkdir(aside)
                stack.callback(_put_back, aside)
                os.rename(place, aside / place.name)
            os.replace(temporary, place)


@contextmanager
def _naming(place: Path) -> Iterator[None]:
    """Let errors of the system name what was asked for, not a temporary file, nor none."""
    try:
        yield
    except OSError as error:
        if not os.path.basename(str(error.filename or MARK)).startswith(MARK):
            raise
        if error.errno is None:
            if isinstance(error, ConnectionError):
                # A cluster that draws what is written is lost: no fault of the file.
                raise
            # NumPy and encoders say in words how much was written.
            said = f"could not be written whole: {error}"
            raise OSError(errno.EIO, said, str(place)) from error
        error.filename = str(place)
        del error.filename2
        raise


def _temporary(place: Path, end: str, names: tuple[str, str] | None = None) -> Path:
    """Return a new name beside a place, with the names of this machine if none are given."""
    host, system = names or machine()
    return place.with_name(f"{MARK}{host}-{system}-{uuid.uuid4().hex}{end}")


def _make_file(path: Path) -> None:
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))


def _begun(place: Path, stack: ExitStack, make: Callable[[Path], None]) -> Path:
    """Make a temporary file or folder and hold it, until the stack is left: then it is removed."""
    for _ in range(TRIES):
        with ExitStack() as attempt:
            temporary = _temporary(place, place.suffix)
            attempt.callback(_remove, temporary)
            make(temporary)
            # One that is not held yet may be taken for nobody's, and removed.
            if not _hold(temporary, attempt):
                continue
            if not _lets_others_write(temporary):
                break
            stack.enter_context(attempt.pop_all())
            return temporary
    temporary = _temporary(place, place.suffix, UNHELD)
    stack.callback(_remove, temporary)
    make(temporary)
    return temporary


def _lets_others_write(path: Path) -> bool:
    """Tell whether an empty file can be written while it is held: not so on SMB shares."""
    if IS_LOCKED and not path.is_dir():
        try:
            with open(path, "r+b", buffering=0) as other:
                other.write(b"\0")
                other.truncate(0)
        except PermissionError:
            return False
        except OSError:
            pass  # A full disk is told by who writes the content.
    return True


def _hold(path: Path, stack: ExitStack) -> bool:
    """Hold a file or folder until the stack is left; return False if another has it, or had."""
    if not IS_LOCKED:
        return True
    try:
        found = lock(path)
    except FileNotFoundError:
        return False
    return found is not None and stack.enter_context(found).is_of(path)


@functools.cache
def remove_leftovers(folder: Path) -> None:
    """Remove, once in a process, what processes that are no more left in a folder."""
    with suppress(OSError):
        for name in os.listdir(folder):
            if match := NAME.fullmatch(name):
                with suppress(OSError, ValueError):
                    _remove_if_left(folder / name, *match.groups())


def _remove_if_left(path: Path, host: str, system: str, end: str) -> None:
    """Remove a temporary file or folder that nobody holds; move back what was moved aside."""
    if end == ASIDE:
        _put_back_if_left(path)
    elif not IS_LOCKED or (host, system) == UNHELD:
        if _is_old(path):
            _remove(path)
    elif found := lock(path):
        with found:
            is_near = host == machine()[0] or system == machine()[1]
            if (is_near and found.is_sure) or _is_old(path):
                _remove(path)


def _is_old(path: Path) -> bool:
    """Tell whether nothing was written to a file, or anywhere in a folder, for long."""
    since = time.time() - LEFT_AFTER
    inside = (os.path.join(at, name) for at, *both in os.walk(path) for name in both[0] + both[1])
    return all(os.lstat(one).st_mtime < since for one in (os.fspath(path), *inside))


def _put_back_if_left(aside: Path) -> None:
    """Move back what was moved aside, unless who did so may still be there."""
    begin = aside.name.removesuffix(ASIDE)
    for name in os.listdir(aside.parent):
        if name.startswith(begin) and name != aside.name and (match := NAME.fullmatch(name)):
            # Who still writes what shall replace it goes on with both.
            _remove_if_left(aside.parent / name, *match.groups())
            if os.path.lexists(aside.parent / name):
                return
    _put_back(aside)


def _put_back(aside: Path) -> None:
    """Move what was moved aside to where it was; remove it if something else is there."""
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
