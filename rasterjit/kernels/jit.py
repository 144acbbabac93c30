"""
Every decision about compilation, in one place.

Three decorators, no more:

``@kernel``
    An entry point: compiled on first call, cached on disk, releases the GIL.
``@stage``
    A helper: compiled into the kernels that call it, not cached alone.
``@disjoint_stage``
    A helper whose array arguments never overlap, so that its loops vectorize.

With ``NUMBA_DISABLE_JIT=1`` all return the plain Python function; a kernel is then as silent about
overflow and NaN as when it is compiled.

Numba's disk cache stamps a kernel with the hash of *its own* source file, so it would not see an
edit in a helper that lives in another file. The stamp is therefore replaced by one hash over all
files in this folder: a change anywhere in the kernels recompiles, an unchanged tree loads.

Kernels allocate nothing: whoever calls them gives them their scratch memory. So they are compiled
without Numba's memory runtime (``_nrt=False``), which would count references to every slice with
an atomic instruction each, in the middle of the loops.

No kernel uses ``fastmath``: coverage, clipping and depth rest on exact ties and on NaN comparing
false, and without it LLVM neither reorders nor contracts floating-point arithmetic.
"""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.registry import CPUDispatcher

OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
"""What every function in this folder is compiled with."""

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


class CompileClock:
    """Wall-clock seconds that this process spent compiling kernels or loading them from disk."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._active = 0
        self._since = 0.0
        self._seconds = 0.0

    @property
    def seconds(self) -> float:
        """Seconds so far; time that several threads waited for one compiler counts once."""
        return self._seconds

    def timed(self, compile_signature: Callable) -> Callable:
        """Return the function with its duration added to the clock."""

        def compile_and_count(*arguments: Any) -> Any:
            with self._lock:
                if self._active == 0:
                    self._since = time.perf_counter()
                self._active += 1
            try:
                return compile_signature(*arguments)
            finally:
                with self._lock:
                    self._active -= 1
                    if self._active == 0:
                        self._seconds += time.perf_counter() - self._since

        return compile_and_count


COMPILE_CLOCK = CompileClock()


def _loader(cache: Any) -> Callable:
    """
    Return a cache's function that loads, without what it does first: get ready to compile.

    That is importing all that Numba can compile, which takes longer than everything else in the
    first frame of a process. Whoever compiles does it then.
    """

    def load_overload(signature: Any, target_context: Any) -> Any:
        with cache._guard_against_spurious_io_errors():
            return cache._load_overload(signature, target_context)

    return load_overload


def kernel(function: Callable) -> Any:
    """Compile an entry point: cached on disk, GIL released, IEEE arithmetic."""
    if numba.config.DISABLE_JIT:
        silent = np.errstate(all="ignore")(function)
        KERNELS.append(silent)
        return silent
    try:
        compiled = numba.njit(cache=True, **OPTIONS)(function)
    except RuntimeError:
        # No folder can be written to: compile anew in every process.
        compiled = numba.njit(**OPTIONS)(function)
    if hasattr(compiled, "_cache") and hasattr(compiled._cache, "_cache_file"):
        # Widen the cache's stamp to all kernel sources.
        compiled._cache._cache_file._source_stamp = SOURCES_HASH
        compiled._cache.load_overload = _loader(compiled._cache)
    compiled.compile = COMPILE_CLOCK.timed(compiled.compile)
    KERNELS.append(compiled)
    return compiled


class _WithoutEnvironments:
    """A code generator that keeps no environment, the Python objects of machine code."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing."""


class _Draft(JITCodeLibrary):
    """
    The code of a helper without machine code, for the kernels that it is compiled into.

    Numba would turn every helper into machine code, with all helpers inside it, and do so again for
    each that calls it, up to the kernel, the only one that is ever called.
    """

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code."""
        return 0

    @property
    def codegen(self) -> Any:
        """Return who made it, but for environments: those are for machine code."""
        return _WithoutEnvironments(self._codegen)


class _FirstDraft(_Draft):
    """The same, as it was written down: it is optimized with what it is compiled into."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass


class _StageCompiler(CompilerBase):
    """The usual pipeline, up to a draft."""

    library: type[_Draft] = _FirstDraft

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_cpython_wrapper = True
        self.state.flags.no_cfunc_wrapper = True
        codegen = self.state.targetctx.codegen()
        self.state.library = self.library(codegen, self.state.func_id.func_qualname)
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


class _DisjointCompiler(_StageCompiler):
    """
    The same, told that array arguments do not overlap.

    What follows from that (vectors) is worked out here: inside its caller it is known no more.
    """

    library = _Draft

    def define_pipelines(self) -> list[Any]:
        self.state.flags.noalias = True
        return super().define_pipelines()


class _Stage(CPUDispatcher):
    """A helper that kernels call. For Python, which tests it, a kernel is made around it."""

    def __call__(self, *arguments: Any) -> Any:
        helper = self
        if not hasattr(self, "_around"):
            self._around = numba.njit(**OPTIONS)(lambda *given: helper(*given))
        return self._around(*arguments)


def _compile_into_kernels(function: Callable, compiler: type[CompilerBase]) -> Any:
    if numba.config.DISABLE_JIT:
        return function
    options = {"nopython": True, "forceinline": True, **OPTIONS}
    return _Stage(function, targetoptions=options, pipeline_class=compiler)


def stage(function: Callable) -> Any:
    """Compile a helper into the kernels that call it."""
    return _compile_into_kernels(function, _StageCompiler)


def disjoint_stage(function: Callable) -> Any:
    """
    Compile a helper whose array arguments never overlap.

    LLVM vectorizes a loop over many arrays only if it knows that no store changes a later load;
    checking at run time gives up beyond a handful of arrays. Only for helpers that are given
    distinct rows of scratch memory.
    """
    return _compile_into_kernels(function, _DisjointCompiler)


def cpu_features() -> tuple[str, list[str]]:
    """Return the name of this CPU and the features that LLVM compiles for, sorted."""
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    return binding.get_host_cpu_name(), sorted(name for name, has in features.items() if has)


def cache_folder() -> Path | None:
    """Return the folder of the compiled kernels; ``None`` if none are kept."""
    if numba.config.DISABLE_JIT or not KERNELS or KERNELS[0].stats.cache_path is None:
        return None
    return Path(KERNELS[0].stats.cache_path)
