"""
Files that end before their reader has found what it looks for.

Some readers ask for one more line for ever. Where that is certain, an error comes at once; other
endless loops are left to the limit of time.
"""

from __future__ import annotations

import builtins
import io
from typing import Any

_MAX_EMPTY_READS = 1000
"""In a row, at the end of one file: readers that know what they do need a few."""

_ENDS = "it ends where more is expected"

_OPEN = io.open


class _File(io.FileIO):
    """A file that counts how often it was read in vain."""

    _empty_reads = 0

    def readinto(self, buffer: Any, /) -> int | None:
        """Read into memory, or raise ``EOFError`` if there was nothing too often."""
        count = super().readinto(buffer)
        if count:
            self._empty_reads = 0
        elif len(memoryview(buffer)):
            self._empty_reads += 1
            if self._empty_reads > _MAX_EMPTY_READS:
                raise EOFError(_ENDS)
        return count


def _open(
    file: Any, mode: str = "r", buffering: int = -1, encoding: str | None = None,
    errors: str | None = None, newline: str | None = None, closefd: bool = True, opener: Any = None,
) -> Any:  # fmt: skip
    """Open a file as Python does; one that is only read, and in pieces, counts what is in vain."""
    if not isinstance(mode, str) or mode not in ("r", "rt", "tr", "rb", "br") or buffering >= 0:
        return _OPEN(file, mode, buffering, encoding, errors, newline, closefd, opener)
    is_text = "b" not in mode
    if not is_text and (encoding, errors, newline) != (None, None, None):
        # It says what is wrong with that.
        return _OPEN(file, mode, buffering, encoding, errors, newline, closefd, opener)
    buffered = io.BufferedReader(_File(file, "r", closefd, opener))
    if not is_text:
        return buffered
    try:
        return io.TextIOWrapper(buffered, encoding, errors, newline)
    except BaseException:
        buffered.close()
        raise


def refuse_endless_reads() -> None:
    """Let every file that this process opens by Python from now on raise ``EOFError`` in time."""
    builtins.open = io.open = _open  # type: ignore[assignment]
