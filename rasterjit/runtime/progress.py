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

ShowText = Callable[[str], None]
"""Shows how far compiling is; the text is empty when it is done."""

MIN_SECONDS = 2.0
"""Seconds of compiling before progress is reported."""

BAR_WIDTH = 10
"""Characters."""

MIN_DONE_FOR_ESTIMATE = 2
"""Kernels or pictures after which the remaining time is estimated."""


def write_line(text: str) -> None:
    """Write a text in place of the last one, in the running cell or on standard error."""
    if _runs_cell():
        _write_in_cell(text)
        return
    stream = sys.stderr
    if not is_terminal(stream) or _is_worker():
        return
    line = f"rasterjit: {text}" if text else ""
    # Blanks overwrite the last one: not every terminal has a command that clears a line.
    blanks, _LAST_LENGTH[0] = " " * (_LAST_LENGTH[0] - len(line)), len(line)
    with suppress(OSError, ValueError):
        stream.write(f"\r{line}{blanks}" if line else f"\r{blanks}\r")
        stream.flush()


_LAST_LENGTH = [0]
"""Characters of the line on the terminal."""


class _CellLine(NamedTuple):
    """The line in a notebook's cell."""

    execution_count: int
    handle: Any
    """Of IPython's display: updates the line."""


_LAST_CELL_LINE: list[_CellLine] = []
"""The line that was last written in a cell, if any."""


def _write_in_cell(text: str) -> None:
    """Write a text in place of the last one in the cell that runs."""
    from IPython import get_ipython
    from IPython.display import display

    line = text or f"kernels are compiled ({describe_storage()})"
    bundle = {"text/plain": f"rasterjit: {line}"}
    count = get_ipython().execution_count
    if _LAST_CELL_LINE and _LAST_CELL_LINE[-1].execution_count == count:
        _LAST_CELL_LINE[-1].handle.update(bundle, raw=True)
    else:
        _LAST_CELL_LINE[:] = [_CellLine(count, display(bundle, raw=True, display_id=True))]


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

    # Cells run in a task of the kernel's event loop; a viewer draws outside of any task.
    try:
        return asyncio.current_task() is not None
    except RuntimeError:
        return True


def is_terminal(stream: TextIO | None) -> bool:
    """Tell whether a stream, which may be missing or closed, writes to a terminal."""
    with suppress(AttributeError, ValueError):
        return stream.isatty()
    return False


def _is_worker() -> bool:
    """Tell whether this process was started by `multiprocessing`: its parent shows the progress."""
    module = sys.modules.get("multiprocessing.process")
    return module is not None and module.parent_process() is not None


_TEXT_SHOWERS: list[ShowText] = [write_line]


@contextmanager
def show_progress_by(show: ShowText) -> Iterator[None]:
    """Let a function show the progress, in place of `write_line`, for any thread."""
    _TEXT_SHOWERS.append(show)
    try:
        yield
    finally:
        _TEXT_SHOWERS.remove(show)


@contextmanager
def also_show_progress_by(show: ShowText) -> Iterator[None]:
    """Let a function show the progress, too, for any thread."""
    show_before = _TEXT_SHOWERS[-1]

    def show_both(text: str) -> None:
        show_before(text)
        show(text)

    with show_progress_by(show_both):
        yield


def format_bar(done: int, total: int, seconds: float) -> str:
    """Return a bar, the counts, the seconds so far, and an estimate of those left."""
    filled = BAR_WIDTH * done // max(total, 1)
    left = ""
    if MIN_DONE_FOR_ESTIMATE <= done < total:
        left = f", {math.ceil(seconds / done * (total - done))} s left"
    return f"{'#' * filled}{'.' * (BAR_WIDTH - filled)} {done} of {total}, {seconds:.0f} s{left}"


PICTURE_COUNTERS: list[Callable[[int, int], None]] = []
"""The last one is called after each picture that a frame is the mean of: ``(drawn, total)``."""


@contextmanager
def count_pictures_by(count: Callable[[int, int], None]) -> Iterator[None]:
    """Call a function after each picture that a frame is the mean of."""
    PICTURE_COUNTERS.append(count)
    try:
        yield
    finally:
        PICTURE_COUNTERS.remove(count)


class Progress:
    """
    Counts the kernels compiled since it was created, and reports them.

    Parameters
    ----------
    missing : mapping of str to Path or None
        The kernels to compile, as far as they are known: module and name, and the file that will
        store each. Another process may write it.
    """

    def __init__(self, missing: Mapping[str, Path | None]) -> None:
        self._missing = missing
        self._seconds_before = clocks.COMPILER_CLOCK.read()
        self._since = time.monotonic()
        self._used_before = [len(names) for names in store.USED_KERNELS]
        self._last_text = ""

    def _count(self) -> tuple[int, int]:
        """Return how many kernels are compiled by now, and how many are needed."""
        loaded, compiled = (
            set(names[count:])
            for names, count in zip(store.USED_KERNELS, self._used_before, strict=True)
        )
        done = compiled | {
            name
            for name, file in self._missing.items()
            if name in loaded or (file is not None and file.exists())
        }
        return len(done), len(compiled | {*self._missing})

    def __str__(self) -> str:
        done, total = self._count()
        seconds = time.monotonic() - self._since
        return f"compiling kernels {format_bar(done, total, seconds)} ({describe_storage()})"

    def report(self) -> None:
        """Show how many are compiled and how long the rest will take, after `MIN_SECONDS`."""
        if self._last_text or clocks.COMPILER_CLOCK.read() - self._seconds_before >= MIN_SECONDS:
            # One kernel may take ten seconds: meanwhile the seconds count on.
            text = str(self)
            if text != self._last_text:
                self._last_text = text
                _TEXT_SHOWERS[-1](text)

    def end(self) -> None:
        """Show that compiling is done, if anything was shown."""
        if self._last_text:
            _TEXT_SHOWERS[-1]("")


def describe_storage() -> str:
    """Return words on whether compiled kernels are stored."""
    return "kept on disk" if store.kernel_folder() else "not kept: no folder can be written"
