"""
From a kernel's Python to object code. Imported when something compiles, and Numba with it.

The problem: Numba's own way from a decorated function to a call takes seconds at first, checks
every argument at each call, and keeps code that is tied to its version. A frame calls dozens of
kernels, each within microseconds, in processes that may have no Numba at all.

The idea: all code is called alike, whatever its arguments are. A caller packs these into a *state
block*, a row of 64-bit words (``state_block.py``), and calls an address with three whole numbers.
An example: ``scale(row: float32[::1], factor: float32)`` has the words ::

    [address of row's numbers, their count, bits of factor]

and becomes ``int64 entry(int64 state, int64 first, int64 stop)``: load the three words, make an
array and a number of them, run the body, return 0. A stage gets a block of samples by ``first`` and
their count by ``stop``.

Numba turns Python into LLVM's language (``numba_internals``), helpers and all. What follows is done
with llvmlite's public interface: one entry point of a fixed C signature,
``int64 kernel(int64 state, int64 first, int64 stop)``, whose arguments lie in a state block
(``state_block``); one round of LLVM's optimizations for a chosen CPU; object code that needs
nothing but ``memset``, ``memcpy`` and ``memmove``, and on old CPUs a few roundings of the C
library.

There are two ways from Python to LLVM's language, and no kernel is made by both: drafts, which use
Numba's private interface, and stock Numba, where a release of it lacks something of that.
"""

from __future__ import annotations

import functools
import gc
import threading
import warnings
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba
from llvmlite import binding, ir
from numba import types
from numba.extending import intrinsic, typeof_impl

from rasterjit import forks
from rasterjit.runtime import array_type, intrinsics_ir
from rasterjit.runtime.array_type import PlainArray
from rasterjit.runtime.code_generation import (
    ALLOWED_CALLS,
    check_no_unknown,
    generate_code,
    target_machine,
)
from rasterjit.runtime.jit import CheckedKernel, Helper, Intrinsic, Kernel, RawKernel, Stage
from rasterjit.runtime.state_block import (
    ArrayType,
    NumberType,
    RecordType,
    Type,
    count_words,
)
from rasterjit.runtime.store import report_compiling
from rasterjit.runtime.targets import Target, compiling_for, host

NUMBA_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
"""Numba's options for every function."""

_COMPILING = forks.hold_over_forks(threading.RLock())

STOCK = None
"""In place of a target: stock Numba compiles the helpers, for this machine's CPU."""


class _HelperMode(threading.local):
    """Mode in which a thread compiles helpers: as drafts for a target, or `STOCK`."""

    target: Target | None = STOCK


_HELPER_MODE = _HelperMode()


@typeof_impl.register(Helper)
@typeof_impl.register(Kernel)
@typeof_impl.register(CheckedKernel)
def _type_of_helper(value: Any, context: Any) -> Any:
    # Called for each helper of each function: often enough to show that there is life.
    report_compiling()
    return types.Dispatcher(_dispatcher(value, _HELPER_MODE.target))


@functools.cache
def _dispatcher(value: Any, target: Target | None) -> Any:
    """Return Numba's dispatcher of a helper: a draft for a target, or a stock one."""
    function = replace_intrinsics(value.function)
    if target is STOCK:
        return numba.njit(**NUMBA_OPTIONS)(function)
    return _import_numba_internals().draft(
        function, getattr(value, "is_disjoint", False), NUMBA_OPTIONS
    )


def replace_intrinsics(function: Callable) -> Any:
    """Return a function that finds the machine's intrinsics where it finds Python's."""
    found = {
        name: getattr(intrinsics_ir, value.__name__)
        for name in function.__code__.co_names
        if isinstance(value := function.__globals__.get(name), Intrinsic)
    }
    if not found:
        return function
    globals_with_intrinsics = {**function.__globals__, **found}
    copied = FunctionType(
        function.__code__,
        globals_with_intrinsics,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copied.__qualname__ = function.__qualname__
    return copied


@functools.cache
def _import_numba_internals() -> Any:
    """Import the module that makes drafts only when one is made."""
    from rasterjit.runtime import numba_internals

    forks.hold_over_forks(numba_internals.compiler_lock.global_compiler_lock._lock)
    return numba_internals


def numba_type(kind: Type) -> Any:
    """Return a type as Numba names it."""
    if isinstance(kind, ArrayType):
        layout = "C" if kind.is_contiguous else "A"
        return PlainArray(numba.from_dtype(_dtype(kind)), kind.ndim, layout)
    if isinstance(kind, NumberType):
        return {"bool": types.boolean}.get(kind.dtype) or getattr(types, kind.dtype)
    fields = [numba_type(field) for field in kind.fields]
    if kind.record is tuple:
        return types.Tuple(tuple(fields))
    if fields and all(field == fields[0] for field in fields):
        return types.NamedUniTuple(fields[0], len(fields), kind.record)
    return types.NamedTuple(fields, kind.record)


def _dtype(kind: ArrayType) -> Any:
    import numpy as np

    return np.dtype(kind.dtype)


def _load_argument(
    context: Any, builder: Any, kind: Type, numba_kind: Any, base: Any, word: int
) -> Any:
    """Return a value of a state block, from a word on, and the word behind it."""
    if isinstance(kind, RecordType):
        values = []
        for field, one in zip(kind.fields, numba_kind.types, strict=True):
            value, word = _load_argument(context, builder, field, one, base, word)
            values.append(value)
        return context.make_tuple(builder, numba_kind, values), word

    def at(number: int) -> Any:
        return builder.gep(base, [ir.Constant(ir.IntType(64), word + number)])

    end = word + count_words(kind)
    if isinstance(kind, NumberType):
        pointed = context.get_data_type(numba_kind).as_pointer()
        value = builder.load(builder.bitcast(at(0), pointed))
        return context.data_model_manager[numba_kind].from_data(builder, value), end
    if kind.shape is None:
        address = builder.load(at(0))
        shape = [builder.load(at(1 + k)) for k in range(kind.ndim)]
    else:
        address = builder.ptrtoint(at(0), ir.IntType(64))
        shape = [context.get_constant(types.intp, length) for length in kind.shape]
    strides = []
    if not kind.is_contiguous:
        strides = [builder.load(at(1 + kind.ndim + k)) for k in range(kind.ndim)]
    pointer = context.get_data_type(numba_kind.dtype).as_pointer()
    data = builder.inttoptr(address, pointer)
    return array_type.make_array(context, builder, numba_kind, data, shape, strides), end


def _make_entry(value: Any, kind: RecordType, target: Target | None) -> tuple[Callable, list[Any]]:
    """
    Return a function that calls a kernel, and a list to which compiling it adds the result's type.

    The function takes three whole numbers. A kernel reads the first, the address of its state
    block; a stage also reads the address of a block of samples and their count. A raw kernel takes
    the numbers themselves.
    """
    if isinstance(value, RawKernel):
        return replace_intrinsics(value.function), [types.int64]
    # What the function takes.
    dispatcher, is_stage = _dispatcher(value, target), isinstance(value, Stage)
    argument_types = [numba_type(field) for field in kind.fields]
    if is_stage:
        argument_types[:1] = [argument_types[0], types.int64]
    returned: list[Any] = []

    # Load its arguments from the words of the state block, and call it.
    @intrinsic
    def run(typing_context: Any, state: Any, block: Any, count: Any) -> Any:
        resolved = types.Dispatcher(dispatcher).get_call_type(typing_context, argument_types, {})
        returned.append(resolved.return_type)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            def base(address: Any) -> Any:
                return builder.inttoptr(address, ir.IntType(64).as_pointer())

            def load_all(fields: Any, numba_types: Any, address: Any) -> list[Any]:
                values, word = [], 0
                for field, one in zip(fields, numba_types, strict=True):
                    loaded, word = _load_argument(context, builder, field, one, base(address), word)
                    values.append(loaded)
                return values

            if is_stage:
                values = load_all(kind.fields[:1], argument_types[:1], arguments[1])
                values.append(arguments[2])
                values += load_all(kind.fields[1:], argument_types[2:], arguments[0])
            else:
                values = load_all(kind.fields, argument_types, arguments[0])
            call = context.get_function(types.Dispatcher(dispatcher), resolved)
            context.add_linking_libs(getattr(call, "libs", ()))
            result = call(builder, values)
            if resolved.return_type == types.none:
                return ir.Constant(ir.IntType(64), 0)
            return context.cast(builder, result, resolved.return_type, types.int64)

        return types.int64(types.int64, types.int64, types.int64), generate

    def entry(state: Any, first: Any, stop: Any) -> Any:
        return run(state, first, stop)

    return entry, returned


def optimize(module: Any, machine: Any) -> None:
    """Run LLVM's optimizations over a module."""
    module.data_layout = str(machine.target_data)
    tuning = binding.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = tuning.slp_vectorization = True
    builder = binding.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(module, builder)


_USES_STOCK: list[bool] = []
"""Not empty: use stock Numba, since drafts have failed where it did not."""


def lower_to_llvm(value: Any, kind: RecordType, name: str, target: Target) -> tuple[str, Any]:
    """Return what a form of a kernel returns, and its optimized module for a target."""
    collects = gc.isenabled()
    gc.disable()  # It would only look, and free little.
    try:
        with _COMPILING:
            with compiling_for(target):
                returned, module, symbol = _lower_any_way(value, kind, target)
            module = _add_c_entry(module, symbol, name, target)
            report_compiling()
            optimize(module, target_machine(target))
            _check_calls(module, name)
            _rename_symbols(module, name)
            return _describe_result(returned, name), module
    finally:
        if collects:
            gc.enable()


def _lower_any_way(value: Any, kind: RecordType, target: Target) -> tuple[Any, Any, str]:
    """Return the type of a kernel's result, a module with it and its helpers, and its symbol."""
    if _USES_STOCK:
        return _lower_stock(value, kind)
    try:
        return _lower_drafts(value, kind, target)
    except Exception as error:
        if target != host():
            raise  # Stock Numba compiles for this machine alone.
        try:
            found = _lower_stock(value, kind)
        except Exception:
            raise error from None  # Both ways fail: the kernel is at fault.
        _USES_STOCK.append(True)
        warnings.warn(
            f"Numba {numba.__version__} is not as RasterJIT knows it, so compiling takes longer: "
            f"{type(error).__name__}: {error}",
            RuntimeWarning,
            2,
        )
        return found


def _lower_drafts(value: Any, kind: RecordType, target: Target) -> tuple[Any, Any, str]:
    internals = _import_numba_internals()
    _HELPER_MODE.target = target
    try:
        entry, returned = _make_entry(value, kind, target)
        module, symbol = internals.whole(entry, (types.int64,) * 3, NUMBA_OPTIONS)
    finally:
        _HELPER_MODE.target = STOCK
    return returned[0], module, symbol


def _lower_stock(value: Any, kind: RecordType) -> tuple[Any, Any, str]:
    entry, returned = _make_entry(value, kind, STOCK)
    words = (types.int64,) * 3
    compiled = numba.njit(types.int64(*words), **NUMBA_OPTIONS)(entry)
    module = binding.parse_assembly(compiled.inspect_llvm(words))
    # Around it are what Python and C would call, of fewer arguments; its helpers are not external.
    (symbol,) = (
        one.name
        for one in module.functions
        if one.linkage == binding.Linkage.external
        and not one.is_declaration
        and len(list(one.arguments)) == 2 + len(words)
    )
    return returned[0], module, symbol


def _add_c_entry(module: Any, symbol: str, name: str, target: Target) -> Any:
    """Add an entry point of C's calling convention, and hide everything else."""
    text = f"""
    declare i32 @"{symbol}"(ptr, ptr, i64, i64, i64)
    define i64 @"{name}"(i64 %state, i64 %first, i64 %stop) {{
        %result = alloca i64
        %error = alloca ptr
        %status = call i32 @"{symbol}"(ptr %result, ptr %error, i64 %state, i64 %first, i64 %stop)
        %value = load i64, ptr %result
        ret i64 %value
    }}"""
    module.link_in(binding.parse_assembly(text))
    module.triple, module.name = target.triple, name
    for one in (*module.functions, *module.global_variables):
        if not one.is_declaration and one.name != name:
            one.linkage = "internal"
    return module


def _check_calls(module: Any, name: str) -> None:
    called = {one.name for one in module.functions if one.is_declaration}
    unknown = {one for one in called if not one.startswith("llvm.")} - ALLOWED_CALLS
    unknown |= {one.name for one in module.global_variables if one.is_declaration}
    check_no_unknown(unknown, name)


def _rename_symbols(module: Any, name: str) -> None:
    """Name what is inside by numbers: Numba's names count what a process has compiled."""
    inside = [one for one in (*module.functions, *module.global_variables)
              if not one.is_declaration and one.name != name]  # fmt: skip
    for number, one in enumerate(inside):
        one.name = f"{name}.{number}"


def _describe_result(result: Any, name: str) -> str:
    if result == types.none:
        return "none"
    if result == types.boolean:
        return "bool"
    if isinstance(result, types.Integer):
        return "int"
    raise TypeError(
        f"kernel {name} returns {result}: results other than whole numbers go to arrays"
    )


def compile_form(value: Any, kind: RecordType, name: str, target: Target) -> tuple[str, bytes]:
    """Return what a form of a kernel returns, and its object code for a target."""
    returns, module = lower_to_llvm(value, kind, name, target)
    report_compiling()
    return returns, generate_code(module, name, target)


def emit_assembly_text(value: Any, kind: RecordType, target: Target) -> str:
    """Return the assembly of a form of a kernel, for people and tests."""
    _, module = lower_to_llvm(value, kind, value.__name__, target)
    return target_machine(target).emit_assembly(module)


def compile_checked(function: Callable) -> Any:
    """Return a kernel with checked indices, as Numba makes and calls it."""
    return numba.njit(**NUMBA_OPTIONS)(replace_intrinsics(function))


def compile_caller(value: Any) -> Any:
    """Return a function that calls a helper or an intrinsic, for Python."""

    def call(*given: Any) -> Any:
        return value(*given)

    return numba.njit(**NUMBA_OPTIONS)(call)
