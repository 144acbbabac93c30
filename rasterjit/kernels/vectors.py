"""
An instruction that no loop compiles to: spread a value over neighbouring places.

LLVM makes no vector of a loop of so few steps. With ``NUMBA_DISABLE_JIT=1`` it is plain Python.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

LANES = 8
"""Values written at once: a 256-bit register of 32-bit numbers."""


def _spread(typing_context: Any, row: Any, start: Any, value: Any) -> Any:
    """Write a value to ``LANES`` neighbouring places of a contiguous row, from ``start`` on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, number = arguments
        vector = ir.VectorType(number.type, LANES)
        undefined, lane = ir.Constant(vector, ir.Undefined), ir.IntType(32)
        first = builder.insert_element(undefined, number, lane(0))
        all_first = ir.Constant(ir.VectorType(lane, LANES), [0] * LANES)
        filled = builder.shuffle_vector(first, undefined, all_first)
        place = builder.gep(context.make_array(row)(context, builder, array).data, [index])
        size = number.type.get_abi_size(context.target_data)
        builder.store(filled, builder.bitcast(place, vector.as_pointer()), align=size)
        return context.get_dummy_value()

    return types.void(row, types.uintp, row.dtype), generate


def _spread_in_python(row: Any, start: Any, value: Any) -> None:
    """Write a value to ``LANES`` neighbouring places of a row; beyond its end is an error."""
    for lane in range(LANES):
        row[int(start) + lane] = value


spread = _spread_in_python if numba.config.DISABLE_JIT else intrinsic(_spread)
