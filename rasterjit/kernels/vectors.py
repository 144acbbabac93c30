"""
Instructions that no loop compiles to: LLVM makes no vector of a loop of so few steps.

A value is spread over neighbouring places; texels, four channels each, are copied and mixed. With
``NUMBA_DISABLE_JIT=1`` all are plain Python.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

LANES = 8
"""Values written at once: a 256-bit register of 32-bit numbers."""

CHANNELS = 4
"""Channels of a texel: a 128-bit register of 32-bit numbers."""


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


def _pixel_at(context: Any, builder: Any, kind: Any, array: Any, number: Any) -> Any:
    """Return a pointer to the four channels of a pixel in contiguous memory."""
    data = context.make_array(kind)(context, builder, array).data
    place = builder.gep(data, [builder.mul(number, number.type(CHANNELS))])
    return builder.bitcast(place, ir.VectorType(ir.FloatType(), CHANNELS).as_pointer())


def _load(context: Any, builder: Any, kind: Any, array: Any, number: Any) -> Any:
    return builder.load(_pixel_at(context, builder, kind, array, number), align=4)


def _store(context: Any, builder: Any, kind: Any, array: Any, number: Any, value: Any) -> Any:
    builder.store(value, _pixel_at(context, builder, kind, array, number), align=4)
    return context.get_dummy_value()


def _mix(builder: Any, one: Any, other: Any, share: Any) -> Any:
    """Return ``one + share * (other - one)`` in each channel."""
    undefined, lane = ir.Constant(one.type, ir.Undefined), ir.IntType(32)
    first = builder.insert_element(undefined, share, lane(0))
    all_first = ir.Constant(ir.VectorType(lane, CHANNELS), [0] * CHANNELS)
    shares = builder.shuffle_vector(first, undefined, all_first)
    return builder.fadd(one, builder.fmul(shares, builder.fsub(other, one)))


def _copy_texel(typing_context: Any, texels: Any, number: Any, colors: Any, n: Any) -> Any:
    """Copy texel ``number`` to place ``n`` of some colours; all float32, contiguous."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = _load(context, builder, texels, arguments[0], arguments[1])
        return _store(context, builder, colors, arguments[2], arguments[3], value)

    return types.void(texels, types.int64, colors, types.int64), generate


def _mix_texels(
    typing_context: Any, texels: Any, numbers: Any, right: Any, up: Any, colors: Any, n: Any
) -> Any:
    """Mix four texels, lower left first, by shares right and up; write it to place ``n``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, four, along, upward, target, place = arguments
        values = [
            _load(context, builder, texels, array, builder.extract_value(four, k)) for k in range(4)
        ]
        lower = _mix(builder, values[0], values[1], along)
        upper = _mix(builder, values[2], values[3], along)
        mixed = _mix(builder, lower, upper, upward)
        return _store(context, builder, colors, target, place, mixed)

    four = types.UniTuple(types.int64, 4)
    return types.void(texels, four, types.float32, types.float32, colors, types.int64), generate


def _mix_colors(typing_context: Any, colors: Any, others: Any, share: Any, n: Any) -> Any:
    """Mix a share of other colours into some colours, at place ``n``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        first, second, part, place = arguments
        one = _load(context, builder, colors, first, place)
        other = _load(context, builder, others, second, place)
        mixed = _mix(builder, one, other, part)
        return _store(context, builder, colors, first, place, mixed)

    return types.void(colors, others, types.float32, types.int64), generate


def _copy_texel_in_python(texels: Any, number: Any, colors: Any, n: Any) -> None:
    """Copy a texel, channel by channel."""
    for k in range(CHANNELS):
        colors[CHANNELS * n + k] = texels[number, k]


def _mix_texels_in_python(
    texels: Any, numbers: Any, right: Any, up: Any, colors: Any, n: Any
) -> None:
    """Mix four texels, channel by channel."""
    for k in range(CHANNELS):
        a, b, c, d = (texels[number, k] for number in numbers)
        lower, upper = a + right * (b - a), c + right * (d - c)
        colors[CHANNELS * n + k] = lower + up * (upper - lower)


def _mix_colors_in_python(colors: Any, others: Any, share: Any, n: Any) -> None:
    """Mix two colours, channel by channel."""
    for at in range(CHANNELS * n, CHANNELS * (n + 1)):
        colors[at] += share * (others[at] - colors[at])


if numba.config.DISABLE_JIT:
    copy_texel, mix_texels, mix_colors = (
        _copy_texel_in_python, _mix_texels_in_python, _mix_colors_in_python,
    )  # fmt: skip
else:
    copy_texel = intrinsic(_copy_texel)
    mix_texels = intrinsic(_mix_texels)
    mix_colors = intrinsic(_mix_colors)
