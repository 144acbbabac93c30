"""
What a forked child can use, whatever other threads of its parent were doing.

A child has one thread: a lock that another thread held at the fork stays locked there for ever.
So locks that are waited for come from here and are free again in a child. Some guard what a fork
must not cut in two, such as the state of LLVM or a module that is being imported: a fork waits for
these (`hold_over_forks`). ``functools.cached_property`` has such a lock in Python 3.10 and 3.11;
`cached_property` has none.
"""

from __future__ import annotations

import _imp
import functools
import os
import threading
import time
import weakref
from importlib import _bootstrap
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

MAX_WAIT = 60.0
"""Most seconds that a fork waits, such as for a compiler in another thread."""

PAUSE = 0.001
"""Seconds between two attempts to take all locks."""

_LOCKS: weakref.WeakSet[Any] = weakref.WeakSet()
_HELD_OVER_FORKS: list[Any] = []
_ACQUIRED: list[Any] = []
_IMPORTS = SimpleNamespace(release=_imp.release_lock)


def lock() -> threading.Lock:
    """Return a lock that is free in a forked child."""
    result = threading.Lock()
    _LOCKS.add(result)
    return result


def reentrant_lock() -> Any:
    """Return a reentrant lock that is free in a forked child."""
    result = threading.RLock()
    _LOCKS.add(result)
    return result


def hold_over_forks(guard: Any) -> Any:
    """Let forks wait for a lock, and free it in their children; return it."""
    _LOCKS.add(guard)
    _HELD_OVER_FORKS.append(guard)
    return guard


if TYPE_CHECKING:
    cached_property = functools.cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801
        """A cached property without a lock: two threads may both compute it."""

        def __get__(self, instance, owner=None):
            """Work it out, and keep it as an attribute; what came first is kept."""
            if instance is None:
                return self
            return instance.__dict__.setdefault(self.attrname, self.func(instance))


def _is_importing() -> bool:
    """Tell whether another thread is in the middle of finding or importing a module."""
    # Python has no public name for these locks, each held by who imports the module.
    locks = [reference() for reference in list(_bootstrap._module_locks.values())]
    return any(getattr(each, "owner", None) not in (None, threading.get_ident()) for each in locks)


def _before_fork() -> None:
    """Acquire all locks that forks wait for, or none, to avoid a deadlock."""
    deadline = time.monotonic() + MAX_WAIT
    while time.monotonic() < deadline:
        for guard in _HELD_OVER_FORKS:
            if not guard.acquire(blocking=False):
                break
            _ACQUIRED.append(guard)
        else:
            # From here to the fork, no other thread begins an import.
            _imp.acquire_lock()
            _ACQUIRED.append(_IMPORTS)
            if not _is_importing():
                return
        _release()
        time.sleep(PAUSE)


def _release() -> None:
    """Release the locks in the parent."""
    while _ACQUIRED:
        _ACQUIRED.pop().release()


def _reset_locks() -> None:
    """Free all locks in a child."""
    if _IMPORTS in _ACQUIRED:
        _IMPORTS.release()
    _ACQUIRED.clear()
    for each in list(_LOCKS):
        each._at_fork_reinit()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_release, after_in_child=_reset_locks)
