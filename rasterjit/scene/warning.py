"""Issue warnings at the line of the user's program that called this package."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType

_PACKAGE = __name__.partition(".")[0]

REPEATED = "warnings of each frame"
"""Kind of warnings that are repeated for each frame."""

REPAIRED_NORMALS = "normals of length 0 of a mesh"
"""Kind of warnings about repaired normals, issued once for each mesh."""

_SILENCED_KINDS: ContextVar[frozenset[str | type[Warning]]] = ContextVar(
    "_SILENCED_KINDS", default=frozenset()
)
_GATHERED: ContextVar[list[Warning] | None] = ContextVar("_GATHERED", default=None)


@contextmanager
def silence_warnings(kind: str | type[Warning]) -> Iterator[None]:
    """Suppress warnings of a kind or category in a block of a thread that reports the same."""
    token = _SILENCED_KINDS.set(_SILENCED_KINDS.get() | {kind})
    try:
        yield
    finally:
        _SILENCED_KINDS.reset(token)


@contextmanager
def gather_warnings() -> Iterator[list[Warning]]:
    """
    Collect what `warn_caller` is given in a block of a thread, and issue none of it.

    `warnings.catch_warnings` changes what all threads of a program see.
    """
    gathered: list[Warning] = []
    token = _GATHERED.set(gathered)
    try:
        yield gathered
    finally:
        _GATHERED.reset(token)


def warn_caller(
    message: str | Warning, category: type[Warning] = UserWarning, kind: str = ""
) -> None:
    """
    Issue a warning that points at the line that called this package, at any depth.

    Parameters
    ----------
    message : str or Warning
        Without a full stop at its end. A `Warning` is issued as it is.
    category : type of Warning
    kind : str
        Kind for `silence_warnings`. Default: never suppressed.
    """
    if not _SILENCED_KINDS.get().isdisjoint((kind, category)):
        return
    gathered = _GATHERED.get()
    if gathered is not None:
        gathered.append(message if isinstance(message, Warning) else category(message))
        return
    level, outermost = 1, 1
    frame: FrameType | None = sys._getframe()
    # Frames of other packages, such as functools, may lie between those of this package.
    while frame is not None:
        if frame.f_globals.get("__name__", "").split(".")[0] == _PACKAGE:
            outermost = level
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=outermost + 1)
