"""Warn at the line of a program that called this package."""

from __future__ import annotations

import sys
import warnings

_PACKAGE = __name__.partition(".")[0]


def warn_caller(message: str | Warning, category: type[Warning] = UserWarning) -> None:
    """
    Issue a warning that points at the line that called this package, however deep inside it is.

    Parameters
    ----------
    message : str or Warning
        Ends without a full stop. A warning that is made already is issued as it is.
    category : type of Warning
    """
    level, outermost, frame = 1, 1, sys._getframe()
    # Between frames of this package lie others, such as functools'.
    while frame is not None:
        if frame.f_globals.get("__name__", "").split(".")[0] == _PACKAGE:
            outermost = level
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=outermost + 1)
