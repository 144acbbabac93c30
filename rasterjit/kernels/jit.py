"""
Every decision about compilation, in one place.

Three decorators, no more (``vectors`` has an instruction that they do not reach):

``@kernel``
    An entry point: compiled on first call, cached on disk, releases the GIL.
``@stage``
    A helper: compiled into the kernels that call it, not cached alone.
``@disjoint_stage``
    A helper whose array arguments never overlap, so that its loops vectorize.

With ``NUMBA_DISABLE_JIT=1`` all return the plain Python function; a kernel is then as silent about
overflow and NaN as when it is compiled.

Numba's disk cache stamps a kernel with the hash of *its own* source file, so it would not see an
edit in a helper that lives in another file, nor whether indices are to be checked
(``NUMBA_BOUNDSCHECK``). The stamp is therefore replaced by one hash over that and all files in this
folder: a change anywhere in the kernels recompiles, an unchanged tree loads.

Kernels allocate nothing: whoever calls them gives them their scratch memory. So they are compiled
without Numba's memory runtime (``_nrt=False``), which would count references to every slice with
an atomic instruction each, in the middle of the loops.

No kernel uses ``fastmath``: coverage, clipping and depth rest on exact ties and on NaN comparing
false, and without it LLVM neither reorders nor contracts floating-point arithmetic.
"""

from __future__ import annotations

import copy
import functools
import gc
import hashlib
import pickle
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite.binding import Linkage
from numba.core import typed_passes, types, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager, _pass_registry
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.sigutils import normalize_signature
from numba.core.typing import Context

OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
"""What every function in this folder is compiled with."""

PASSES = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.DeadBranchPrune,
    untyped_passes.GenericRewrites,
    untyped_passes.ReconstructSSA,
    untyped_passes.DeadBranchPrune,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.IRLegalization,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)
"""What is done with every function in this folder, in order, from byte code to LLVM's language."""

KERNELS: list[Any] = []
"""Every function decorated with ``@kernel``, in order of definition."""


def _sources_hash() -> str:
    """Return one hash over the source of every kernel file, and whether indices are checked."""
    digest = hashlib.sha256(str(bool(numba.config.BOUNDSCHECK)).encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


SOURCES_HASH = _sources_hash()


class CompileClock:
    """Wall-clock seconds that this process spent on something, in any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._active = 0
        self._since = 0.0
        self._seconds = 0.0

    @property
    def seconds(self) -> float:
        """Seconds so far; time that several threads waited for one compiler counts once."""
        return self._seconds

    def read(self) -> float:
        """Return the seconds so far, with those of what is under way."""
        with self._lock:
            going_on = time.perf_counter() - self._since if self._active else 0.0
            return self._seconds + going_on

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let the clock run."""
        with self._lock:
            if self._active == 0:
                self._since = time.perf_counter()
            self._active += 1
        try:
            yield
        finally:
            with self._lock:
                self._active -= 1
                if self._active == 0:
                    self._seconds += time.perf_counter() - self._since

    def timed(self, compile_signature: Callable) -> Callable:
        """Return the function with its duration added to the clock."""

        def compile_and_count(*arguments: Any) -> Any:
            with self.running():
                return compile_signature(*arguments)

        return compile_and_count


COMPILE_CLOCK = CompileClock()
"""Runs while kernels are compiled or loaded from disk."""

COMPILER_CLOCK = CompileClock()
"""Runs while kernels are compiled, and not while they are loaded."""


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
        compiled = numba.njit(cache=True, pipeline_class=_KernelCompiler, **OPTIONS)(function)
    except RuntimeError:
        # No folder can be written to: compile anew in every process.
        compiled = numba.njit(pipeline_class=_KernelCompiler, **OPTIONS)(function)
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


class _Library(JITCodeLibrary):
    """The code of a kernel: all helpers are put in at once, and then it is optimized once."""

    def finalize(self) -> None:
        """Put in the helpers of the helpers as well, optimize and make machine code."""
        libraries = dict.fromkeys(self._linking_libraries)
        pending = list(libraries)
        while pending:
            library = pending.pop()
            if isinstance(library, _FirstDraft):
                new = [one for one in library._linking_libraries if one not in libraries]
                libraries.update(dict.fromkeys(new))
                pending += new
        self._linking_libraries = list(libraries)
        super().finalize()

    def _optimize_functions(self, ll_module: Any) -> None:
        # Without Numba's round before the helpers are there.
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        # Without Numba's cheaper round before: it makes room to remove reference counts.
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


class _Draft(_Library):
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
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """Return who made it, but for environments: those are for machine code."""
        return _WithoutEnvironments(self._codegen)


class _FirstDraft(_Draft):
    """The same, as it was written down: without its own helpers, and not optimized."""

    def add_llvm_module(self, ll_module: Any) -> None:
        """Take the code of the helper; there is one piece."""
        self._final_module = ll_module

    def finalize(self) -> None:
        """Let every kernel have a copy."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"
        self._shared_module = self._final_module
        self._finalize_final_module()


class _TypingContext(Context):
    """Numba's context of typing, which finds only once what an operation gives for some types."""

    known: dict[tuple, Any]

    @classmethod
    def of(cls, context: Context) -> _TypingContext:
        """Return a context that shares all declarations with another."""
        remembering = copy.copy(context)
        remembering.__class__, remembering.known = cls, {}
        return remembering

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """
        Return the signature.

        That of a helper is found anew, since finding compiles it. So are those that Numba asks for
        by a word: they take what is no type and can not be looked up, such as a slice.
        """
        if kws or isinstance(func, (types.Dispatcher, str)):
            return super().resolve_function_type(func, args, kws)
        key = func, tuple(args)
        if self.known.get(key) is None:
            self.known[key] = super().resolve_function_type(func, args, kws)
        return self.known[key]


@functools.cache
def _typing_context() -> _TypingContext:
    return _TypingContext.of(cpu_target.typing_context)


class _Passes(PassManager):
    """
    What turns Python into LLVM's language: the steps of Numba's pipeline that kernels need.

    Left out are those for closures, inlining of Python into Python, exceptions, generators, context
    managers, ``literal_unroll``, ``isinstance`` and expressions over whole arrays: no kernel has
    any, so they look at every function and leave it as it is. So do Numba's checks of itself after
    each step, which take as long as the steps.
    """

    def __init__(self) -> None:
        super().__init__("kernel")
        for step in PASSES:
            self.add_pass(step, step.name())
        self.finalize()

    def run(self, state: Any) -> None:
        """Take one function through all passes."""
        for step, _ in self.passes:
            instance = _pass_registry.get(step).pass_inst
            instance.analysis = self._analysis
            instance.run_pass(state)


class _KernelCompiler(CompilerBase):
    """The passes that kernels need, up to machine code that Python calls."""

    library: type[_Library] = _Library

    def compile_extra(self, func: Callable) -> Any:
        """
        Compile a function.

        Without garbage collection, in all threads: it would only look, and free little.
        """
        collects = gc.isenabled()
        gc.disable()
        try:
            with COMPILER_CLOCK.running():
                return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()

    def define_pipelines(self) -> list[Any]:
        self.state.typingctx = _typing_context()
        self.state.flags.no_cfunc_wrapper = True
        codegen = self.state.targetctx.codegen()
        self.state.library = self.library(codegen, self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return [_Passes()]


class _StageCompiler(_KernelCompiler):
    """The same, up to a draft."""

    library = _FirstDraft

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_cpython_wrapper = True
        return super().define_pipelines()


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

    def compile(self, sig: Any) -> Any:
        """Compile for one signature, as part of a kernel: its caller has the lock and the clock."""
        argument_types, return_type = normalize_signature(sig)
        if tuple(argument_types) not in self.overloads:
            with self._compiling_counter:
                self.add_overload(self._compiler.compile(argument_types, return_type))
        return self.overloads[tuple(argument_types)].entry_point

    def __call__(self, *arguments: Any) -> Any:
        helper = self
        if not hasattr(self, "_around"):
            around = numba.njit(pipeline_class=_KernelCompiler, **OPTIONS)
            self._around = around(lambda *given: helper(*given))
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


def is_cached(compiled: Any) -> bool:
    """Tell whether the disk has any form of a kernel, compiled from the sources as they are."""
    if cache_folder() is None:
        return False
    try:
        return bool(compiled._cache._cache_file._load_index())
    except (OSError, EOFError, pickle.UnpicklingError):
        # Cut short, or being replaced.
        return False


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
