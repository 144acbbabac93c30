"""
Define the array type of kernels: address, shape, and strides unless contiguous.

Numba's own arrays also carry a size, the size of an element, an owner, a parent, and strides in any
case. Every call passes all of that on, and every index takes it apart. Without it compiling takes a
quarter less. Imported when something compiles.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import (
    NativeValue,
    box,
    lower_builtin,
    lower_getattr,
    models,
    register_model,
    unbox,
)

WORD = ir.IntType(64)


class PlainArray(types.Array):
    """The type of an array that consists of an address, lengths and perhaps strides."""

    def __init__(self, dtype: Any, ndim: int, layout: str) -> None:
        super().__init__(dtype, ndim, layout, name=f"plain({dtype}, {ndim}d, {layout})")

    def copy(
        self, dtype: Any = None, ndim: Any = None, layout: Any = None, readonly: Any = None
    ) -> PlainArray:
        """Return a copy of this type with some properties replaced."""
        return PlainArray(dtype or self.dtype, ndim or self.ndim, layout or self.layout)


@register_model(PlainArray)
class _PlainArrayModel(models.StructModel):
    """The LLVM structure of a `PlainArray`."""

    def __init__(self, manager: Any, kind: PlainArray) -> None:
        lengths = types.UniTuple(types.intp, kind.ndim)
        members = [("data", types.CPointer(kind.dtype)), ("shape", lengths)]
        members += [("strides", lengths)] if kind.layout != "C" else []
        super().__init__(manager, kind, members)


def load_field(context: Any, builder: Any, kind: Any, array: Any, name: str) -> Any:
    """Return a field of an array, plain or Numba's own: ``data``, ``shape`` or ``strides``."""
    return context.data_model_manager[kind].get(builder, array, name)


def list_axis_values(context: Any, builder: Any, kind: Any, array: Any, name: str) -> list[Any]:
    """Return the lengths or the strides of an array, one for each axis."""
    values = load_field(context, builder, kind, array, name)
    return [builder.extract_value(values, axis) for axis in range(kind.ndim)]


def make_array(
    context: Any, builder: Any, kind: Any, data: Any, shape: list[Any], strides: list[Any]
) -> Any:
    """Return a value of a `PlainArray` type; strides are ignored if it is contiguous."""
    model = context.data_model_manager[kind]
    value = ir.Constant(model.get_value_type(), ir.Undefined)
    value = model.set(builder, value, data, "data")
    value = model.set(builder, value, pack_words(builder, shape), "shape")
    if kind.layout != "C":
        value = model.set(builder, value, pack_words(builder, strides), "strides")
    return value


def pack_words(builder: Any, values: list[Any]) -> Any:
    """Pack 64-bit words, such as lengths, into an LLVM array."""
    words = ir.Constant(ir.ArrayType(WORD, len(values)), ir.Undefined)
    for n, value in enumerate(values):
        words = builder.insert_value(words, value, n)
    return words


def _max_signed(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.icmp_signed(">", a, b), a, b)


def _resolve_negative(builder: Any, index: Any, length: Any) -> Any:
    """Return an index; add the length if it is negative."""
    is_negative = builder.icmp_signed("<", index, WORD(0))
    return builder.select(is_negative, builder.add(index, length), index)


def _resolve_index(context: Any, builder: Any, kind: Any, value: Any, length: Any) -> Any:
    if isinstance(value, int):
        return WORD(value) if value >= 0 else builder.add(length, WORD(value))
    wide = context.cast(builder, value, kind, types.intp)
    return _resolve_negative(builder, wide, length) if kind.signed else wide


def _resolve_slice(
    context: Any, builder: Any, kind: Any, value: Any, length: Any
) -> tuple[Any, Any]:
    """Return the first index and the length of a slice, clamped to its axis."""
    if kind.has_step:
        raise TypeError("kernels take slices without steps")
    bounds = []
    for name in ("start", "stop"):
        end = context.data_model_manager[kind].get(builder, value, name)
        end = _max_signed(builder, _resolve_negative(builder, end, length), WORD(0))
        is_beyond = builder.icmp_signed(">", end, length)
        bounds.append(builder.select(is_beyond, length, end))
    return bounds[0], _max_signed(builder, builder.sub(bounds[1], bounds[0]), WORD(0))


def _locate(
    context: Any, builder: Any, kind: Any, array: Any, kinds: Any, indices: Any
) -> tuple[Any, list[Any], list[Any]]:
    """Return the address, the lengths and the strides of the part that indices select."""
    lengths = list_axis_values(context, builder, kind, array, "shape")
    is_contiguous = kind.layout == "C"
    strides = [] if is_contiguous else list_axis_values(context, builder, kind, array, "strides")
    offset, lengths_left, strides_left = None, [], []
    for axis, length in enumerate(lengths):
        first, count = None, length  # The whole of an axis without an index.
        if axis < len(indices):
            if isinstance(kinds[axis], types.SliceType):
                first, count = _resolve_slice(context, builder, kinds[axis], indices[axis], length)
            else:
                first = _resolve_index(context, builder, kinds[axis], indices[axis], length)
                count = None
        if count is not None:
            lengths_left.append(count)
            strides_left += [] if is_contiguous else [strides[axis]]
        if is_contiguous and offset is not None:
            offset = builder.mul(offset, length)
        if first is not None:
            step = first if is_contiguous else builder.mul(first, strides[axis])
            offset = step if offset is None else builder.add(offset, step)
    data = load_field(context, builder, kind, array, "data")
    if offset is None:
        return data, lengths_left, strides_left
    if is_contiguous:
        return builder.gep(data, [offset]), lengths_left, strides_left
    as_bytes = builder.bitcast(data, ir.IntType(8).as_pointer())
    return builder.bitcast(builder.gep(as_bytes, [offset]), data.type), lengths_left, strides_left


def _load_indexed(
    context: Any, builder: Any, signature: Any, array: Any, kinds: Any, indices: Any
) -> Any:
    kind, result = signature.args[0], signature.return_type
    data, shape, strides = _locate(context, builder, kind, array, kinds, indices)
    if not shape:
        return context.unpack_value(builder, kind.dtype, data)
    if kind.layout == "C" and result.layout != "C":
        raise TypeError("kernels take no columns of contiguous arrays")
    return make_array(context, builder, result, data, shape, strides)


def _store_indexed(
    context: Any, builder: Any, signature: Any, arguments: Any, kinds: Any, indices: Any
):
    kind, _, value_kind = signature.args
    data, shape, _ = _locate(context, builder, kind, arguments[0], kinds, indices)
    if shape:
        raise TypeError("kernels write one element at a time")
    value = context.cast(builder, arguments[2], value_kind, kind.dtype)
    context.pack_value(builder, kind.dtype, value, data)
    return context.get_dummy_value()


def _split_index(builder: Any, kind: Any, index: Any) -> tuple[Any, Any]:
    """Return the types and the values of the indices in an index expression."""
    if isinstance(kind, types.BaseTuple):
        return kind.types, [builder.extract_value(index, k) for k in range(len(kind))]
    return (kind,), (index,)


@lower_builtin(operator.getitem, PlainArray, types.Integer)
@lower_builtin(operator.getitem, PlainArray, types.SliceType)
@lower_builtin(operator.getitem, PlainArray, types.BaseTuple)
def _getitem(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kinds, indices = _split_index(builder, signature.args[1], arguments[1])
    return _load_indexed(context, builder, signature, arguments[0], kinds, indices)


@lower_builtin(operator.setitem, PlainArray, types.Any, types.Any)
def _setitem(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kinds, indices = _split_index(builder, signature.args[1], arguments[1])
    return _store_indexed(context, builder, signature, arguments, kinds, indices)


def _constant_indices(index: Any) -> tuple[int, ...]:
    """Return the indices of a constant expression; leave others to the functions above."""
    indices = index if isinstance(index, tuple) else (index,)
    if not all(isinstance(each, int) for each in indices):
        raise NotImplementedError
    return indices


@lower_builtin("static_getitem", PlainArray, types.Any)
def _getitem_at_constants(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    indices = _constant_indices(arguments[1])
    kinds = [types.intp] * len(indices)
    return _load_indexed(context, builder, signature, arguments[0], kinds, indices)


@lower_builtin("static_setitem", PlainArray, types.Any, types.Any)
def _setitem_at_constants(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    indices = _constant_indices(arguments[1])
    return _store_indexed(
        context, builder, signature, arguments, [types.intp] * len(indices), indices
    )


@lower_builtin(len, PlainArray)
def _len(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return list_axis_values(context, builder, signature.args[0], arguments[0], "shape")[0]


@lower_getattr(PlainArray, "shape")
def _shape(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return load_field(context, builder, kind, array, "shape")


# Stock Numba also compiles a wrapper of every helper for Python, which is never called.


@unbox(PlainArray)
def _unbox(kind: Any, value: Any, context: Any) -> NativeValue:
    undefined = ir.Constant(context.context.get_value_type(kind), ir.Undefined)
    return NativeValue(undefined, is_error=ir.Constant(ir.IntType(1), 1))


@box(PlainArray)
def _box(kind: Any, array: Any, context: Any) -> Any:
    return context.pyapi.get_null_object()
