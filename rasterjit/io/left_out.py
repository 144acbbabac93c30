"""Say what of a file or scene is not shown: all of it, or once and in one line, a part."""

from __future__ import annotations

import warnings
from collections import Counter


class MeshFileError(ValueError):
    """A file is missing, unreadable, of no known format, or holds nothing to draw."""


class LoadWarning(UserWarning):
    """Part of a file or scene was left out; the rest is there."""


class LeftOut:
    """Count what is left out by kind, to warn about everything at once."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def note(self, what: str, count: int = 1) -> None:
        """Add ``count`` things of a kind, such as ``"further camera"``."""
        self._counts[what] += count

    def __str__(self) -> str:
        return ", ".join(f"{what} ({count})" for what, count in self._counts.items())

    def warn(self, source: str) -> None:
        """Warn, if anything was left out, naming ``source`` and every kind."""
        if self._counts:
            message = f"{source}: left out {self}; the rest is there"
            warnings.warn(message, LoadWarning, stacklevel=3)
