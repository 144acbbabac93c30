"""Make ``import pyrender`` mean this package."""

from __future__ import annotations

import importlib
import pkgutil
import sys

_OURS = __package__
"""The name of this package."""


def install() -> None:
    """
    Make ``import pyrender``, and that of its modules, mean this package in this process.

    Call it before the first such import. Calling it again changes nothing.

    Raises
    ------
    RuntimeError
        If pyrender itself was imported before.
    """
    ours = importlib.import_module(_OURS)
    there = sys.modules.get("pyrender")
    if there is not None and there is not ours and not getattr(there, "is_stand_in", False):
        place = getattr(there, "__file__", None)
        raise RuntimeError(
            f"install must come before the first import of pyrender, got one imported from {place}"
        )
    sys.modules["pyrender"] = ours
    for found in pkgutil.walk_packages(ours.__path__, f"{_OURS}."):
        rest = found.name.removeprefix(_OURS)
        if rest != ".__main__":
            sys.modules[f"pyrender{rest}"] = importlib.import_module(found.name)
