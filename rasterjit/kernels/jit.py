"""
Every decision about compilation, in one place.

Two decorators, no more:

``@kernel``
    An entry point: compiled on first call, cached on disk, releases the GIL.
``@stage``
    A helper: compiled into the kernels that call it, not cached alone.

With ``NUMBA_DISABLE_JIT=1`` both return the plain Python function.

Numba's disk cache stamps a kernel with the hash of *its own* source file, so it would not see an
edit in a helper that lives in another file. The stamp is therefore replaced by one hash over all
files in this folder: a change anywhere in the kernels recompiles, an unchanged tree loads.

No kernel uses ``fastmath``: coverage, clipping and depth rest on exact ties and on NaN comparing
false, and without it LLVM neither reorders nor contracts floating-point arithmetic.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

KERNELS: list[Any] = []
"""Every function decorated with ``@kernel``, in order of definition."""


def _sources_hash() -> str:
    """Return one hash over the source of every kernel file."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


SOURCES_HASH = _sources_hash()


def kernel(function: Callable) -> Any:
    """Compile an entry point: cached on disk, GIL released, IEEE arithmetic."""
    compiled = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    if not numba.config.DISABLE_JIT:
        # The one use of Numba's private API: widen the cache's stamp to all kernel sources.
        compiled._cache._cache_file._source_stamp = SOURCES_HASH
    KERNELS.append(compiled)
    return compiled


def stage(function: Callable) -> Any:
    """Compile a helper into the kernels that call it."""
    return numba.njit(nogil=True, error_model="numpy")(function)
