"""Count the instructions of compiled kernels, and how many of them work on vectors."""

from __future__ import annotations

import gc
import importlib.util
import re
from collections.abc import Iterable

INSTRUCTION = re.compile(r"^\t(?!\.)[a-z]\w*", re.MULTILINE)
"""A line of assembly that is no directive, label or comment."""
WIDE = re.compile(r"^\t(?!\.)[a-z]\w*[^\n#]*?(?:[yz]mm\d|\bv\d+\.\d)", re.MULTILINE)
"""One that names a register of 256 or 512 bits on x86, or a vector on ARM."""


def count(text: str) -> dict[str, int]:
    """Return the ``instructions`` of some assembly, and the ``wide`` ones among them."""
    return {"instructions": len(INSTRUCTION.findall(text)), "wide": len(WIDE.findall(text))}


def of_store() -> Iterable[tuple[str, str]]:
    """Yield the name and the assembly of every kernel and stage in use, compiled once more."""
    from rasterjit.runtime import compiler, jit, store

    # Earlier versions call it otherwise.
    emit = getattr(compiler, "emit_assembly_text", None) or compiler.assembly
    forms = [(kernel, form.kind) for kernel in jit.KERNELS for form in kernel.forms]
    forms += [(stage, stage.kind) for stage in jit.STAGES if stage.is_in_use]
    for function, kind in forms:
        yield f"{function.__module__}.{function.__name__}", emit(function, kind, store.host())


def of_numba() -> Iterable[tuple[str, str]]:
    """Yield the same in versions that let Numba keep kernels: start those with an empty cache."""
    from numba.core.caching import FunctionCache
    from numba.core.dispatcher import Dispatcher

    for thing in gc.get_objects():
        is_kernel = isinstance(thing, Dispatcher) and isinstance(thing._cache, FunctionCache)
        if is_kernel and thing.py_func.__module__.startswith("rasterjit."):
            for text in thing.inspect_asm().values():
                yield f"{thing.py_func.__module__}.{thing.py_func.__qualname__}", text


def kernels() -> dict[str, dict[str, int]]:
    """Return the counts of every kernel that this process has in use, over all its forms."""
    has_store = importlib.util.find_spec("rasterjit.runtime") is not None
    texts = of_store() if has_store else of_numba()
    found: dict[str, dict[str, int]] = {}
    for name, text in texts:
        row = found.setdefault(name, {"instructions": 0, "wide": 0, "forms": 0})
        for key, number in count(text).items():
            row[key] += number
        row["forms"] += 1
    return dict(sorted(found.items()))
