"""Threads of the package: other libraries start and end theirs at any time."""

from __future__ import annotations

import threading


def own_threads(name="rasterjit"):
    """Return the threads that run now and whose names begin so."""
    return {one for one in threading.enumerate() if one.name.startswith(name)}
