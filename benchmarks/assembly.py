"""Count the instructions of compiled kernels, and how many of them work on vectors."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterable
from typing import Any

INSTRUCTION = re.compile(r"^\t(?!\.)[a-z]\w*", re.MULTILINE)
"""A line of assembly that is no directive, label or comment."""
WIDE = re.compile(r"^\t(?!\.)[a-z]\w*[^\n#]*?(?:[yz]mm\d|\bv\d+\.\d)", re.MULTILINE)
"""One that names a register of 256 or 512 bits on x86, or a vector on ARM."""


def count(text: str) -> dict[str, int]:
    """Return the ``instructions`` of some assembly, and the ``wide`` ones among them."""
    return {"instructions": len(INSTRUCTION.findall(text)), "wide": len(WIDE.findall(text))}


def dispatchers() -> Iterable[Any]:
    """Return every function of ``rasterjit`` that Numba compiles and keeps on disk: kernels."""
    from numba.core.caching import FunctionCache
    from numba.core.dispatcher import Dispatcher

    for thing in gc.get_objects():
        is_kernel = isinstance(thing, Dispatcher) and isinstance(thing._cache, FunctionCache)
        if is_kernel and thing.py_func.__module__.startswith("rasterjit."):
            yield thing


def kernels() -> dict[str, dict[str, int]]:
    """
    Return the counts of every kernel that was compiled by this process, over all its forms.

    Kernels that were loaded from disk have no assembly; start with an empty cache.
    """
    found = {}
    for dispatcher in dispatchers():
        texts = list(dispatcher.inspect_asm().values())
        if texts:
            name = f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"
            forms = [count(text) for text in texts]
            found[name] = {key: sum(form[key] for form in forms) for key in forms[0]}
            found[name]["forms"] = len(forms)
    return dict(sorted(found.items()))
