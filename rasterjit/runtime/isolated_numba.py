"""
Import the compiler, and Numba with it, isolated from configuration in the current folder.

Numba reads ``.numba_config.yaml`` in the current folder when it is imported, and again whenever it
compiles: a file that came with a model could switch the compiler off. Environment variables are the
user's own and keep their say. Where the program imported Numba before, it is as the program has it.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import threading
import warnings
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, ModuleType
from typing import Any

from rasterjit import forks
from rasterjit.runtime.versions import explain_too_new

COMPILER = "rasterjit.runtime.compiler"

SETTINGS_MODULE = "numba.core.config"

SETTINGS_FILE = ".numba_config.yaml"

NO_FILE = ""
"""A name that no file has."""

_IMPORTING = forks.hold_over_forks(threading.RLock())


class _Loader(SourceFileLoader):
    """Loads Numba's settings with another name for the file."""

    def get_code(self, fullname: str) -> CodeType | None:
        """Return the module's code, the name of the file replaced."""
        code = super().get_code(fullname)
        if code is None:
            return None
        known = tuple(NO_FILE if one == SETTINGS_FILE else one for one in code.co_consts)
        return code.replace(co_consts=known)


class _Finder:
    """Finds the module of Numba's settings, and no other."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None, target: Any = None) -> ModuleSpec | None:
        """Return how to load the module; None leaves it to Python."""
        if name != SETTINGS_MODULE:
            return None
        found = PathFinder.find_spec(name, path)
        if found is None or not isinstance(found.loader, SourceFileLoader):
            return found
        loader = _Loader(name, found.loader.path)
        return importlib.util.spec_from_file_location(name, found.loader.path, loader=loader)


def compiler() -> ModuleType:
    """Return the compiler, imported with Numba on first need."""
    with _IMPORTING:
        if COMPILER not in sys.modules and (complaint := explain_too_new()):
            warnings.warn(complaint, RuntimeWarning, 2)
        if SETTINGS_MODULE in sys.modules:
            return importlib.import_module(COMPILER)
        finder = _Finder()
        sys.meta_path.insert(0, finder)
        try:
            return importlib.import_module(COMPILER)
        finally:
            sys.meta_path.remove(finder)
