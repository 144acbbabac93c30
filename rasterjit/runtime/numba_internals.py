"""
Collect all uses of Numba's private interface, each with its reason.

Stock Numba makes machine code of every helper, and again for each function that calls it. Here one
stays a *draft* in LLVM's language, linked into kernels and optimized there. Without these: slower.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from typing import Any

import numba
from llvmlite.binding import Linkage
from numba import types
from numba.core import compiler_lock as compiler_lock  # A fork waits for its lock.
from numba.core import typed_passes as typed  # The steps of `PASSES`.
from numba.core import untyped_passes as untyped  # Those before types are known.
from numba.core.codegen import JITCodeLibrary  # Holds a compiled function; a draft is one.
from numba.core.compiler import CompilerBase  # Says which steps compile a function.
from numba.core.compiler_machinery import PassManager  # Runs them; ours checks less.
from numba.core.registry import cpu_target  # Has the contexts of typing and of lowering.
from numba.core.typing import Context  # Finds what an operation gives; ours remembers.

PASSES = (
    untyped.TranslateByteCode, untyped.FixupArgs, untyped.IRProcessing,
    untyped.RewriteSemanticConstants, untyped.DeadBranchPrune, untyped.GenericRewrites,
    untyped.ReconstructSSA, untyped.DeadBranchPrune, typed.NopythonTypeInference,
    typed.PreLowerStripPhis, typed.NativeLowering, typed.NoPythonBackend,
)  # fmt: skip
"""Numba's steps, less those for closures, exceptions, generators, whole arrays and deletion."""


class _Draft(JITCodeLibrary):
    """A function in LLVM's language, as it was written down; no machine code."""

    def __init__(self, codegen: Any, name: str, is_linked: bool) -> None:
        super().__init__(codegen, name)
        self.is_linked = is_linked

    def add_llvm_module(self, ll_module: Any) -> None:
        """Keep what was lowered."""
        ll_module.data_layout = self._codegen._data_layout  # Kept there alone.
        self._final_module = ll_module  # There is one piece; what links it looks here.

    def finalize(self) -> None:
        """Let callers link it, its helpers linked first where it is called from Python."""
        if self.is_linked:
            self._link_helpers()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"  # Every kernel may have a copy.
        self._shared_module = self._final_module  # What is linked into callers.
        self._finalized = True  # Asked for before linking.

    def get_pointer_to_function(self, name: str) -> int:
        """Return no address: there is no machine code."""
        return 0

    @property
    def codegen(self) -> Any:
        """Return what lowering asks to keep an environment, which does not."""
        return _WithoutEnvironments(self._codegen)

    def _link_helpers(self) -> None:
        seen = set(pending := list(self._linking_libraries))  # In the order of the calls.
        while pending:
            library = pending.pop()
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
            if isinstance(library, _Draft) and not library.is_linked:
                pending += [one for one in library._linking_libraries if one not in seen]
                seen.update(pending)


class _WithoutEnvironments:
    """A code generator that keeps no environment, the Python objects of machine code."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return (lambda *_: None) if name == "set_env" else getattr(self._codegen, name)


class _TypingContext(Context):
    """Numba's context of typing, which finds only once what an operation gives for some types."""

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a call, remembered unless it names arguments or a helper."""
        if kws or isinstance(func, (types.Dispatcher, str)):  # Finding a helper compiles it.
            return super().resolve_function_type(func, args, kws)
        key = func, tuple(args)
        if self.known.get(key) is None:
            self.known[key] = super().resolve_function_type(func, args, kws)
        return self.known[key]


TYPING = copy.copy(cpu_target.typing_context)
TYPING.__class__, TYPING.known = _TypingContext, {}
LOWERING = cpu_target.target_context  # Asks LLVM for the size of one type again and again.
LOWERING.get_abi_sizeof = functools.cache(LOWERING.get_abi_sizeof)


class _Passes(PassManager):
    """`PASSES`, without Numba's checks of itself after each, which take as long as the steps."""

    def run(self, state: Any) -> None:
        """Run the steps on the state of a compilation, in order."""
        for step, _ in self.passes:
            (instance := step()).analysis = self._analysis  # Which steps have run.
            instance.run_pass(state)


def _compiler(is_linked: bool, is_disjoint: bool) -> Any:
    class Compiler(CompilerBase):
        def define_pipelines(self) -> list[Any]:
            flags, name = self.state.flags, self.state.func_id.func_qualname
            flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True  # No Python object comes in.
            flags.noalias = is_disjoint  # No option of `njit` says so.
            self.state.library = _Draft(self.state.targetctx.codegen(), name, is_linked)
            self.state.typingctx = TYPING
            passes = _Passes("kernel")
            for step in PASSES:
                passes.add_pass(step, step.name())
            passes.finalize()
            return [passes]

    return Compiler


DRAFT, DISJOINT, WHOLE = _compiler(False, False), _compiler(False, True), _compiler(True, False)


def draft(function: Callable, is_disjoint: bool, options: dict) -> Any:
    """Return what calls a function from kernels."""
    pipeline = DISJOINT if is_disjoint else DRAFT
    made = numba.njit(pipeline_class=pipeline, forceinline=True, **options)(function)
    find = made.get_call_template  # A constant counts as any number of its type: one form fewer.
    made.get_call_template = lambda args, kws: find(tuple(map(types.unliteral, args)), kws)
    return made


def whole(function: Callable, argument_types: tuple, options: dict) -> tuple[Any, str]:
    """Return a module with a function and its helpers, and the function's symbol."""
    (dispatcher := numba.njit(pipeline_class=WHOLE, **options)(function)).compile(argument_types)
    result = dispatcher.overloads[argument_types]  # Has the module, which has no machine code.
    result.library._ensure_finalized()
    return result.library._final_module, result.fndesc.mangled_name
