"""Say that a spelling has been replaced, where a program still uses it."""

from __future__ import annotations

import sys
import warnings

_PACKAGE = __name__.partition(".")[0]


def warn_deprecated(old: str, new: str) -> None:
    """
    Warn that a spelling goes on working for now, and what to write instead.

    The warning is a `FutureWarning`, which Python shows to users of programs, too, once for each
    line. It points at the line that called this package, however deep inside it this is called.
    How long deprecated spellings work stands in CHANGELOG.

    Parameters
    ----------
    old, new : str
        What was written, and what means the same from now on: ``"--depth-scale"``.
    """
    level, frame = 1, sys._getframe()
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] == _PACKAGE:
        level, frame = level + 1, frame.f_back
    message = f"{old} is deprecated and will be an error; write {new}"
    warnings.warn(message, FutureWarning, stacklevel=level)
