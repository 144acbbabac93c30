"""
Ctrl-C ends the command line with status 130 and one line on standard error, from its first line on.

The package imports this file before anything that takes time, so it imports nothing that does.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False
"""Stands for ``typing.TYPE_CHECKING``: that module takes time to import."""

if TYPE_CHECKING:
    from types import FrameType
    from typing import Any

INTERRUPTED = 130
"""Exit status after Ctrl-C; the others are click's: 1 failed, 2 wrong usage."""


def is_program() -> bool:
    """Tell whether this process was started as the command line."""
    try:
        started, script = sys.orig_argv[-len(sys.argv)], sys.argv[0]
    except (AttributeError, IndexError):
        return False
    if script == "-m":
        package = __name__.partition(".")[0]
        return started.removeprefix("-m") in (package, f"{package}.__main__")
    stem = os.path.splitext(os.path.basename(script))[0]
    return started == script and stem.removesuffix("-script") == __name__.partition(".")[0]


def end_now(*_: Any) -> None:
    """End the process with status `INTERRUPTED`: nothing has begun, or all is done."""
    try:
        os.write(2, b"error: interrupted\n")
    finally:
        os._exit(INTERRUPTED)


try:
    import _thread
    import atexit
    import signal
    import time
except KeyboardInterrupt:
    if not is_program():
        raise
    end_now()

IMPORT_SYSTEM = "<frozen importlib._bootstrap>"
"""File name of Python's import system in tracebacks."""

PAUSE = 0.01
"""Seconds after which an interrupt during an import is repeated."""

MAX_IMPORT_WAIT = 5.0
"""Most seconds that an interrupt waits for an import."""


class _FirstInterrupt:
    """When the first one came."""

    time: float | None = None


def refuse(complaint: str | None) -> None:
    """Refuse to be imported if there is a complaint; the command line exits with one line."""
    if complaint is not None and is_program():
        sys.exit(f"error: {complaint}")
    if complaint is not None:
        raise ImportError(complaint)


def interrupt(number: int, frame: FrameType | None) -> None:
    """
    Raise ``KeyboardInterrupt``; while a module is imported, a little later.

    Modules that are interrupted as they begin print tracebacks of their own, or raise other errors.
    """
    now = time.monotonic()
    if _FirstInterrupt.time is None:
        _FirstInterrupt.time = now
    while frame is not None and now - _FirstInterrupt.time < MAX_IMPORT_WAIT:
        if frame.f_code.co_filename == IMPORT_SYSTEM:
            _interrupt_later()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def raise_if_interrupted() -> None:
    """Raise ``KeyboardInterrupt`` if one came that others, as trimesh does, took for an error."""
    if _FirstInterrupt.time is not None:
        raise KeyboardInterrupt


def print_unraisable(unraisable: Any) -> None:
    """
    Print an unraisable exception as Python does, unless Ctrl-C caused it.

    An interrupt in a destructor comes again. After one, pipes that break tell nothing new.
    """
    if unraisable.exc_type is KeyboardInterrupt:
        _interrupt_later()
    elif _FirstInterrupt.time is None:
        sys.__unraisablehook__(unraisable)


def _interrupt_later() -> None:
    """Interrupt this thread, the main one, after a pause."""
    thread = _thread.get_ident()

    def come() -> None:
        time.sleep(PAUSE)
        if hasattr(signal, "pthread_kill"):
            # What waits, wakes.
            signal.pthread_kill(thread, signal.SIGINT)
        else:
            _thread.interrupt_main()

    _thread.start_new_thread(come, ())


def set_handler(handler: Any) -> None:
    """Handle Ctrl-C, unless whoever started the process has it ignored."""
    ours = (signal.default_int_handler, end_now, interrupt)
    # Not in the main thread: another's.
    try:
        if signal.getsignal(signal.SIGINT) in ours:
            signal.signal(signal.SIGINT, handler)
    except ValueError:
        pass


if is_program():
    set_handler(end_now)
    # What is registered first comes last: then Python takes itself apart, and would be killed.
    atexit.register(set_handler, signal.SIG_IGN)
