"""Report the progress of compiling in one line, on a terminal or in a notebook."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from rasterjit.runtime import clocks, store

Tell = Callable[[str], None]
"""Takes how far compiling is, as a text; an empty one when it is done."""

PATIENCE = 2.0
"""Seconds of compiling before progress is reported."""

BAR = 10
"""Characters of the bar."""

FIRST_KNOWN = 2
"""Kernels or pictures after which the time that the rest will take is told."""


def write_line(text: str) -> None:
    """Write a text in place of the last one, in the cell that runs or by standard error."""
    if _runs_cell():
        _write_in_cell(text)
        return
    stream = sys.stderr
    if not is_terminal(stream) or _is_worker():
        return
    line = f"rasterjit: {text}" if text else ""
    # Blanks go over the last one: not every terminal clears a line when it is told to.
    over, _LAST[0] = " " * (_LAST[0] - len(line)), len(line)
    with suppress(OSError, ValueError):
        stream.write(f"\r{line}{over}" if line else f"\r{over}\r")
        stream.flush()


_LAST = [0]
"""Columns of the line that stands there."""


class _CellLine(NamedTuple):
    """The line in a notebook's cell: the number of its run, and what changes the line."""

    run: int
    handle: Any


_CELL: list[_CellLine] = []
"""The line that was written in a cell last, if any."""


def _write_in_cell(text: str) -> None:
    """Write a text in place of the last one in the cell that runs."""
    from IPython import get_ipython
    from IPython.display import display

    told = text or f"kernels are compiled ({kept()})"
    bundle = {"text/plain": f"rasterjit: {told}"}
    run = get_ipython().execution_count
    if _CELL and _CELL[-1].run == run:
        _CELL[-1].handle.update(bundle, raw=True)
    else:
        _CELL[:] = [_CellLine(run, display(bundle, raw=True, display_id=True))]


def in_notebook() -> bool:
    """Tell whether this process is the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return getattr(running, "kernel", None) is not None


def _runs_cell() -> bool:
    """Tell whether a cell of a notebook runs in this thread."""
    if not in_notebook():
        return False
    if threading.current_thread() is not threading.main_thread():
        return False
    import asyncio

    # Cells run in a task of the kernel's; what a viewer draws beside them, in none.
    try:
        return asyncio.current_task() is not None
    except RuntimeError:
        return True


def is_terminal(stream: TextIO | None) -> bool:
    """Tell whether a stream is one of a terminal; it may be missing, closed, or know none."""
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


@contextmanager
def told_besides(tell: Tell) -> Iterator[None]:
    """Let a function show the progress, besides what shows it by now, for any thread."""
    shown_by = _TELLERS[-1]

    def tell_both(text: str) -> None:
        shown_by(text)
        tell(text)

    with told_to(tell_both):
        yield


def bar(done: int, total: int, seconds: float) -> str:
    """Return a bar of how many are done, for how long, and how long the rest will take."""
    filled = BAR * done // max(total, 1)
    left = ""
    if FIRST_KNOWN <= done < total:
        left = f", {math.ceil(seconds / done * (total - done))} s left"
    return f"{'#' * filled}{'.' * (BAR - filled)} {done} of {total}, {seconds:.0f} s{left}"


PICTURES: list[Callable[[int, int], None]] = []
"""
The last one is told how many pictures a frame is made of are drawn, and how many there are.

Where nothing is in it, nobody is told.
"""


@contextmanager
def pictures_told_to(tell: Callable[[int, int], None]) -> Iterator[None]:
    """Let a function know of the pictures that a frame is the mean of."""
    PICTURES.append(tell)
    try:
        yield
    finally:
        PICTURES.remove(tell)


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
        self._seconds = clocks.COMPILER_CLOCK.read()
        self._since = time.monotonic()
        self._used = [len(names) for names in store.USED]
        self._told = ""

    def _count(self) -> tuple[int, int]:
        """Return how many kernels are there by now, and how many are needed."""
        loaded, compiled = (
            set(names[count:]) for names, count in zip(store.USED, self._used, strict=True)
        )
        done = compiled | {
            name
            for name, file in self._wanted.items()
            if name in loaded or (file is not None and file.exists())
        }
        return len(done), len(compiled | {*self._wanted})

    def __str__(self) -> str:
        done, total = self._count()
        seconds = time.monotonic() - self._since
        return f"compiling kernels {bar(done, total, seconds)} ({kept()})"

    def tell(self) -> None:
        """Say how many are done, since when, and how long the rest will take, if it takes long."""
        if self._told or clocks.COMPILER_CLOCK.read() - self._seconds >= PATIENCE:
            # One kernel may take ten seconds: the time shows that there is life.
            text = str(self)
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
