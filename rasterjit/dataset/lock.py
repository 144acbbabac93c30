"""
Who writes to the folder of a data set: one run at a time.

A run holds a lock on a file that names it, and removes the file at the end, whatever happens. One
that nobody holds was left by a run that was killed, and is taken over.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rasterjit.runtime.locks import Lock, lock, machine

LOCK = ".lock"
"""Name of the lock file, in the folder."""

TRIES = 10
"""How often the lock file is made or asked for, while others remove it."""


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
    try:
        with _taken(file) as held:
            try:
                held.write(_myself().encode())
                yield
            finally:
                if held.is_of(file):
                    held.remove(file)
    except KeyboardInterrupt:
        # It may have come after the file was made, and before that was known.
        _remove_empty(file)
        raise


def _taken(file: Path) -> Lock:
    """Make the lock file, or take one over that is nobody's, or raise ``ValueError``."""
    for _ in range(TRIES):
        is_mine = _created(file)
        try:
            held = lock(file)
        except FileNotFoundError:
            continue
        if held is None:
            break
        # Whoever had it may have removed it meanwhile.
        if not held.is_of(file):
            held.close()
        elif is_mine or (held.is_sure and _is_near(_parsed(held.read()))):
            return held
        else:
            held.close()
            break
    raise _refusal(file)


def _remove_empty(file: Path) -> None:
    """Remove a lock file that nobody has locked or written to."""
    with suppress(OSError):
        held = lock(file)
        if held is not None:
            if held.is_of(file) and not held.read():
                held.remove(file)
            held.close()


def _created(file: Path) -> bool:
    """Make the lock file, unless there is one."""
    try:
        os.close(os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    except FileExistsError:
        return False
    return True


def _refusal(file: Path) -> ValueError:
    """Return the error that says who has the folder."""
    owner = {}
    # Where locks are mandatory, nobody else can read it.
    with suppress(OSError):
        owner = _parsed(file.read_bytes())
    who = f", process {owner['pid']} on {owner['host']}" if {"pid", "host"} <= owner.keys() else ""
    return ValueError(
        f"output is being written by another run{who}: wait until it ends; "
        f"if there is none, remove {str(file)!r}"
    )


def _myself() -> str:
    """Return what a lock file of this process says."""
    return json.dumps({"host": platform.node(), "pid": os.getpid(), "machine": machine()})


def _is_near(owner: dict[str, Any]) -> bool:
    """Tell whether a run that goes on would be seen to hold its lock."""
    names = owner.get("machine")
    return not isinstance(names, list) or any(
        mine == other for mine, other in zip(machine(), names, strict=False)
    )


def _parsed(content: bytes) -> dict[str, Any]:
    """Return what a lock file says; nothing if that is damaged."""
    try:
        owner = json.loads(content.decode("utf-8", "replace"))
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}
