"""Say how far compiling is, where it takes long: one line, on a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from rasterjit.runtime import jit, store

Tell = Callable[[str], None]
"""Takes how far compiling is, as a text; an empty one when it is done."""

PATIENCE = 2.0
"""Seconds of compiling that are not spoken of."""


def write_line(text: str) -> None:
    """Write a text in place of the last one on standard error, if that is a terminal."""
    stream = sys.stderr
    if not _is_terminal(stream) or _is_worker():
        return
    line = f"rasterjit: {text}" if text else ""
    # Blanks go over the last one: not every terminal clears a line when it is told to.
    over, _LAST[0] = " " * (_LAST[0] - len(line)), len(line)
    with suppress(OSError, ValueError):
        stream.write(f"\r{line}{over}" if line else f"\r{over}\r")
        stream.flush()


_LAST = [0]
"""Columns of the line that stands there."""


def _is_terminal(stream: TextIO | None) -> bool:
    # Standard error may be missing, closed, or an object that knows no terminals.
    with suppress(AttributeError, ValueError):
        return stream.isatty()
    return False


def _is_worker() -> bool:
    """Tell whether this process was started by `multiprocessing`: its parent shows the progress."""
    module = sys.modules.get("multiprocessing.process")
    return module is not None and module.parent_process() is not None


_TELLERS: list[Tell] = [write_line]


@contextmanager
def told_to(tell: Tell) -> Iterator[None]:
    """Let a function show the progress, in place of `write_line`, for any thread."""
    _TELLERS.append(tell)
    try:
        yield
    finally:
        _TELLERS.remove(tell)


class Progress:
    """
    What was compiled since this was made.

    Parameters
    ----------
    wanted : mapping of str to Path or None
        The kernels that are missing, as far as they are known: module and name, and the file that
        will keep each. Another process may write it.
    """

    def __init__(self, wanted: Mapping[str, Path | None]) -> None:
        self._wanted = wanted
        self._seconds = jit.COMPILER_CLOCK.read()
        self._since = time.monotonic()
        self._used = [len(names) for names in store.USED]
        self._told = ""

    def __str__(self) -> str:
        loaded, compiled = (
            set(names[count:]) for names, count in zip(store.USED, self._used, strict=True)
        )
        done = compiled | {
            name
            for name, file in self._wanted.items()
            if name in loaded or (file is not None and file.exists())
        }
        return f"compiling kernels ({kept()}): {len(done)} of {len(compiled | {*self._wanted})}"

    def tell(self) -> None:
        """Say how many are done, and since when, if compiling takes long."""
        if self._told or jit.COMPILER_CLOCK.read() - self._seconds >= PATIENCE:
            # One kernel may take ten seconds: the time shows that there is life.
            text = f"{self}, {time.monotonic() - self._since:.0f} s"
            if text != self._told:
                self._told = text
                _TELLERS[-1](text)

    def end(self) -> None:
        """Say that compiling is done, if it was told before."""
        if self._told:
            _TELLERS[-1]("")


def kept() -> str:
    """Say whether compiled kernels are kept."""
    return "kept on disk" if store.folder() else "not kept: no folder can be written"
