"""
Who writes to the folder of a data set: one run at a time.

A lock file names the run that has the folder. It is removed at the end, whatever happens; one that
a killed run of this machine left behind is taken over.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

LOCK = ".lock"
"""Name of the lock file, in the folder."""

HALF_WRITTEN = 1.0
"""Seconds after which a lock file without content is nobody's."""

_STILL_ACTIVE, _QUERY = 259, 0x1000
"""Of Windows: the exit code of a process that goes on, and the right to ask for it."""

_held: set[str] = set()
"""What the lock files of this process hold."""


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """
    Have a folder for oneself.

    Parameters
    ----------
    folder : Path
        An existing folder.

    Raises
    ------
    ValueError
        If another run has it.
    OSError
        If the lock file cannot be written.
    """
    file = folder / LOCK
    mine = json.dumps({"host": socket.gethostname(), "pid": os.getpid(), "run": uuid.uuid4().hex})
    try:
        while not _created(file, mine):
            _take_over(file)
        yield
    finally:
        _held.discard(mine)
        if _content(file) == mine:
            file.unlink(missing_ok=True)


def _created(file: Path, mine: str) -> bool:
    """Make the lock file, unless there is one."""
    try:
        handle = os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
    except FileExistsError:
        return False
    _held.add(mine)
    with open(handle, "w", encoding="utf-8") as lock:
        lock.write(mine)
    return True


def _take_over(file: Path) -> None:
    """Remove a lock file that is nobody's, or raise ``ValueError``."""
    content = _content(file)
    if content == "":
        # Whoever made it has not written to it yet, or was killed before.
        time.sleep(HALF_WRITTEN)
        content = _content(file)
    if content is None:
        return
    if _is_held(content):
        owner = _owner(content)
        raise ValueError(
            f"output is being written by another run, process {owner.get('pid')} on "
            f"{owner.get('host')}: wait until it ends; if there is none, remove {str(file)!r}"
        )
    aside = file.with_name(f"{LOCK}-{uuid.uuid4().hex}")
    try:
        os.replace(file, aside)
    except FileNotFoundError:
        return
    if _content(aside) == content:
        aside.unlink(missing_ok=True)
    else:
        # Another run was faster and has the folder now.
        os.replace(aside, file)


def _is_held(content: str) -> bool:
    """Tell whether the run that a lock file names may be going on."""
    owner = _owner(content)
    pid = owner.get("pid")
    if not isinstance(pid, int) or pid <= 0:
        return False
    if owner.get("host") != socket.gethostname():
        return True
    if pid == os.getpid():
        # A number that was another process's before.
        return content in _held
    return _is_alive(pid)


def _owner(content: str) -> dict[str, Any]:
    """Return what a lock file says, nothing if it cannot be read."""
    try:
        owner = json.loads(content)
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}


def _content(file: Path) -> str | None:
    """Return what is in a file, ``None`` if there is none."""
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return None


def _is_alive(pid: int) -> bool:
    """Tell whether a process of this machine goes on."""
    if sys.platform == "win32":
        import ctypes

        # There os.kill ends a process, whatever the signal.
        kernel = ctypes.windll.kernel32
        handle = kernel.OpenProcess(_QUERY, False, pid)
        if not handle:
            return False
        code = ctypes.c_ulong()
        kernel.GetExitCodeProcess(handle, ctypes.byref(code))
        kernel.CloseHandle(handle)
        return code.value == _STILL_ACTIVE
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        # It is somebody else's.
        return True
    return True
