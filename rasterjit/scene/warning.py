"""Warn at the line of a program that called this package."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_PACKAGE = __name__.partition(".")[0]


_IS_SILENT: ContextVar[bool] = ContextVar("_IS_SILENT", default=False)


@contextmanager
def told_elsewhere() -> Iterator[None]:
    """Keep `warn_caller` silent in a block whose caller says the same in other words."""
    token = _IS_SILENT.set(True)
    try:
        yield
    finally:
        _IS_SILENT.reset(token)


def warn_caller(message: str | Warning, category: type[Warning] = UserWarning) -> None:
    """
    Issue a warning that points at the line that called this package, however deep inside it is.

    Parameters
    ----------
    message : str or Warning
        Ends without a full stop. A warning that is made already is issued as it is.
    category : type of Warning
    """
    if _IS_SILENT.get():
        return
    level, outermost, frame = 1, 1, sys._getframe()
    # Between frames of this package lie others, such as functools'.
    while frame is not None:
        if frame.f_globals.get("__name__", "").split(".")[0] == _PACKAGE:
            outermost = level
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=outermost + 1)
