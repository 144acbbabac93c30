"""Say that a spelling has been replaced, where a program still uses it."""

from __future__ import annotations

from rasterjit.scene.warning import warn_caller


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
    warn_caller(f"{old} is deprecated and will be an error; write {new}", FutureWarning)
