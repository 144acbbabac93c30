"""Turn what trimesh logs about a file into notes of a line."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rasterjit.io.skipped import LeftOut, reason_of


@contextmanager
def trimesh_told(left_out: LeftOut) -> Iterator[None]:
    """Note the warnings that trimesh logs in this thread, which would print tracebacks."""
    thread, log = threading.get_ident(), logging.getLogger("trimesh")

    def take(record: logging.LogRecord) -> bool:
        """Keep a record from handlers if it is a warning of ours."""
        if record.levelno < logging.WARNING or record.thread != thread:
            return True
        error = record.exc_info[1] if record.exc_info else None
        reason = f": {reason_of(error)}" if isinstance(error, Exception) else ""
        left_out.note(
            f"part of which trimesh says: {' '.join(record.getMessage().split())[:80]}{reason}"
        )
        return False

    log.addFilter(take)
    try:
        yield
    finally:
        log.removeFilter(take)
