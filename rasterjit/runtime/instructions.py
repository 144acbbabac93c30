"""What the intrinsics are in LLVM's language. Imported when something compiles."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from rasterjit.runtime.intrinsics import CHANNELS, LANES
from rasterjit.runtime.jit import CHECKED
from rasterjit.runtime.plain_arrays import WORD, PlainArray, field, make, packed, words


@intrinsic
def spread(typing_context: Any, row: Any, start: Any, value: Any) -> Any:
    """Write a value to ``LANES`` neighbouring places of a contiguous row, from ``start`` on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, number = arguments
        vector = ir.VectorType(number.type, LANES)
        undefined, lane = ir.Constant(vector, ir.Undefined), ir.IntType(32)
        first = builder.insert_element(undefined, number, lane(0))
        all_first = ir.Constant(ir.VectorType(lane, LANES), [0] * LANES)
        filled = builder.shuffle_vector(first, undefined, all_first)
        place = builder.gep(field(context, builder, row, array, "data"), [index])
        size = number.type.get_abi_size(context.target_data)
        builder.store(filled, builder.bitcast(place, vector.as_pointer()), align=size)
        return context.get_dummy_value()

    return types.void(row, types.uintp, row.dtype), generate


@intrinsic
def part(typing_context: Any, rows: Any, number: Any, start: Any, stop: Any) -> Any:
    """Return the places ``start:stop`` of a row of a contiguous array, without a copy."""
    if rows.layout != "C" or rows.ndim != 2:
        raise TypeError(f"a row is part of a contiguous array of two axes, not of {rows}")
    row = rows.copy(ndim=1)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, first, end = arguments
        count, length = words(context, builder, rows, array, "shape")
        if CHECKED:
            order = ((index, count, "<"), (first, end, "<="), (end, length, "<="))
            for low, high, comparison in order:
                # Unsigned, so that what is below zero is beyond the end.
                is_outside = builder.not_(builder.icmp_unsigned(comparison, low, high))
                with builder.if_then(is_outside, likely=False):
                    message = "a part of a row ends beyond the row"
                    context.call_conv.return_user_exc(builder, IndexError, (message,))
        start = builder.add(builder.mul(index, length), first)
        return _row(context, builder, row, rows, array, start, builder.sub(end, first))

    return row(rows, types.intp, types.intp, types.intp), generate


def _row(
    context: Any, builder: Any, kind: Any, whole: Any, array: Any, start: Any, count: Any
) -> Any:
    """Return a row of so many elements of a contiguous array."""
    data = field(context, builder, whole, array, "data")
    data = data if start is None else builder.gep(data, [start])
    if isinstance(kind, PlainArray):
        return make(context, builder, kind, data, [count], [])
    # A helper that Python calls takes Numba's own arrays.
    one, given = context.make_array(kind)(context, builder), context.make_array(whole)
    many = given(context, builder, array)
    one.meminfo, one.parent, one.itemsize = many.meminfo, many.parent, many.itemsize
    one.nitems, one.data = count, data
    one.shape = packed(builder, [count])
    one.strides = packed(builder, [many.itemsize])
    return one._getvalue()


def _pixel_at(context: Any, builder: Any, kind: Any, array: Any, number: Any) -> Any:
    """Return a pointer to the four channels of a pixel in contiguous memory."""
    data = field(context, builder, kind, array, "data")
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


@intrinsic
def copy_texel(typing_context: Any, texels: Any, number: Any, colors: Any, n: Any) -> Any:
    """Copy texel ``number`` to place ``n`` of some colours; all float32, contiguous."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = _load(context, builder, texels, arguments[0], arguments[1])
        return _store(context, builder, colors, arguments[2], arguments[3], value)

    return types.void(texels, types.int64, colors, types.int64), generate


@intrinsic
def mix_texels(
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


@intrinsic
def mix_colors(typing_context: Any, colors: Any, others: Any, share: Any, n: Any) -> Any:
    """Mix a share of other colours into some colours, at place ``n``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        first, second, part, place = arguments
        one = _load(context, builder, colors, first, place)
        other = _load(context, builder, others, second, place)
        mixed = _mix(builder, one, other, part)
        return _store(context, builder, colors, first, place, mixed)

    return types.void(colors, others, types.float32, types.int64), generate


def _pointer(builder: Any, address: Any, bits: int) -> Any:
    return builder.inttoptr(address, ir.IntType(bits).as_pointer())


@intrinsic
def load_int64(typing_context: Any, address: Any) -> Any:
    """Return the word at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(builder, arguments[0], 64))

    return types.int64(types.int64), generate


@intrinsic
def load_int32(typing_context: Any, address: Any) -> Any:
    """Return the 32-bit word at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(builder, arguments[0], 32))

    return types.int32(types.int64), generate


@intrinsic
def store_int64(typing_context: Any, address: Any, value: Any) -> Any:
    """Write the word at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[1], _pointer(builder, arguments[0], 64))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


@intrinsic
def call_at(typing_context: Any, address: Any, state: Any, first: Any, stop: Any) -> Any:
    """Call ``int64 f(int64, int64, int64)`` at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        function = ir.FunctionType(word, [word] * 3).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], function), arguments[1:])

    return types.int64(types.int64, types.int64, types.int64, types.int64), generate


@intrinsic
def flat(typing_context: Any, array: Any) -> Any:
    """Return a contiguous array as one row, without a copy."""
    if array.layout != "C":
        raise TypeError(f"a row is made of a contiguous array, not of {array}")
    row = array.copy(ndim=1)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        count = WORD(1)
        for length in words(context, builder, array, arguments[0], "shape"):
            count = builder.mul(count, length)
        return _row(context, builder, row, array, arguments[0], None, count)

    return row(array), generate
