"""
Two instructions that no loop compiles to: spread a value, and ask for memory ahead of its use.

LLVM makes no vector of a loop of so few steps. With ``NUMBA_DISABLE_JIT=1`` both are plain Python.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

LANES = 8
"""Values written at once: a 256-bit register of 32-bit numbers."""


def _element(context: Any, builder: Any, row: Any, array: Any, index: Any) -> Any:
    """Return a pointer to an element of a row."""
    return builder.gep(context.make_array(row)(context, builder, array).data, [index])


def _spread(typing_context: Any, row: Any, start: Any, value: Any) -> Any:
    """Write a value to ``LANES`` neighbouring places of a contiguous row, from ``start`` on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, number = arguments
        vector = ir.VectorType(number.type, LANES)
        undefined, lane = ir.Constant(vector, ir.Undefined), ir.IntType(32)
        first = builder.insert_element(undefined, number, lane(0))
        all_first = ir.Constant(ir.VectorType(lane, LANES), [0] * LANES)
        filled = builder.shuffle_vector(first, undefined, all_first)
        place = _element(context, builder, row, array, index)
        size = number.type.get_abi_size(context.target_data)
        builder.store(filled, builder.bitcast(place, vector.as_pointer()), align=size)
        return context.get_dummy_value()

    return types.void(row, types.uintp, row.dtype), generate


def _prefetch(typing_context: Any, row: Any, index: Any) -> Any:
    """Ask for the cache line of an element, which is read soon."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        place = builder.bitcast(_element(context, builder, row, *arguments), byte)
        function = builder.module.declare_intrinsic(
            "llvm.prefetch", [byte], ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        )
        # To be read, kept as near as can be, data.
        builder.call(function, [place, number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(row, types.uintp), generate


def _spread_in_python(row: Any, start: Any, value: Any) -> None:
    """Write a value to ``LANES`` neighbouring places of a row, from ``start`` on."""
    row[start : int(start) + LANES] = value


def _prefetch_in_python(row: Any, index: Any) -> None:
    """Do nothing."""


spread = _spread_in_python if numba.config.DISABLE_JIT else intrinsic(_spread)
prefetch = _prefetch_in_python if numba.config.DISABLE_JIT else intrinsic(_prefetch)
