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
    """The type of an array that is an address and lengths."""

    def __init__(self, dtype: Any, ndim: int, layout: str) -> None:
        super().__init__(dtype, ndim, layout, name=f"plain({dtype}, {ndim}d, {layout})")

    def copy(
        self, dtype: Any = None, ndim: Any = None, layout: Any = None, readonly: Any = None
    ) -> PlainArray:
        """Return the type of a part of such an array."""
        return PlainArray(dtype or self.dtype, ndim or self.ndim, layout or self.layout)


@register_model(PlainArray)
class _Model(models.StructModel):
    """What a value of it consists of."""

    def __init__(self, manager: Any, kind: PlainArray) -> None:
        lengths = types.UniTuple(types.intp, kind.ndim)
        members = [("data", types.CPointer(kind.dtype)), ("shape", lengths)]
        members += [("strides", lengths)] if kind.layout != "C" else []
        super().__init__(manager, kind, members)


def field(context: Any, builder: Any, kind: Any, array: Any, name: str) -> Any:
    """Return a field of an array, of Numba's own, too: ``data``, ``shape`` or ``strides``."""
    return context.data_model_manager[kind].get(builder, array, name)


def words(context: Any, builder: Any, kind: Any, array: Any, name: str) -> list[Any]:
    """Return the lengths or the strides of an array, one for each axis."""
    whole = field(context, builder, kind, array, name)
    return [builder.extract_value(whole, axis) for axis in range(kind.ndim)]


def make(
    context: Any, builder: Any, kind: Any, data: Any, shape: list[Any], strides: list[Any]
) -> Any:
    """Return an array of a plain type; strides count only where it is not contiguous."""
    model = context.data_model_manager[kind]
    value = ir.Constant(model.get_value_type(), ir.Undefined)
    value = model.set(builder, value, data, "data")
    value = model.set(builder, value, packed(builder, shape), "shape")
    if kind.layout != "C":
        value = model.set(builder, value, packed(builder, strides), "strides")
    return value


def packed(builder: Any, values: list[Any]) -> Any:
    """Return 64-bit words as one value, an LLVM array: the lengths or strides of an array."""
    whole = ir.Constant(ir.ArrayType(WORD, len(values)), ir.Undefined)
    for n, value in enumerate(values):
        whole = builder.insert_value(whole, value, n)
    return whole


def _larger(builder: Any, one: Any, other: Any) -> Any:
    return builder.select(builder.icmp_signed(">", one, other), one, other)


def _from_end(builder: Any, index: Any, length: Any) -> Any:
    """Return an index, counted from the end if it is negative."""
    is_negative = builder.icmp_signed("<", index, WORD(0))
    return builder.select(is_negative, builder.add(index, length), index)


def _index(context: Any, builder: Any, kind: Any, value: Any, length: Any) -> Any:
    if isinstance(value, int):
        return WORD(value) if value >= 0 else builder.add(length, WORD(value))
    wide = context.cast(builder, value, kind, types.intp)
    return _from_end(builder, wide, length) if kind.signed else wide


def _ends(context: Any, builder: Any, kind: Any, given: Any, length: Any) -> tuple[Any, Any]:
    """Return where a slice begins, and how many elements it has."""
    if kind.has_step:
        raise TypeError("kernels take slices without steps")
    ends = []
    for name in ("start", "stop"):
        end = context.data_model_manager[kind].get(builder, given, name)
        end = _larger(builder, _from_end(builder, end, length), WORD(0))
        is_beyond = builder.icmp_signed(">", end, length)
        ends.append(builder.select(is_beyond, length, end))
    return ends[0], _larger(builder, builder.sub(ends[1], ends[0]), WORD(0))


def _part(
    context: Any, builder: Any, kind: Any, array: Any, kinds: Any, indices: Any
) -> tuple[Any, list[Any], list[Any]]:
    """Return the address, the lengths and the strides of what some indices choose."""
    lengths = words(context, builder, kind, array, "shape")
    is_contiguous = kind.layout == "C"
    strides = [] if is_contiguous else words(context, builder, kind, array, "strides")
    place, left, left_strides = None, [], []
    for axis, length in enumerate(lengths):
        first, count = None, length  # All of an axis without an index.
        if axis < len(indices):
            if isinstance(kinds[axis], types.SliceType):
                first, count = _ends(context, builder, kinds[axis], indices[axis], length)
            else:
                first = _index(context, builder, kinds[axis], indices[axis], length)
                count = None
        if count is not None:
            left.append(count)
            left_strides += [] if is_contiguous else [strides[axis]]
        if is_contiguous and place is not None:
            place = builder.mul(place, length)
        if first is not None:
            step = first if is_contiguous else builder.mul(first, strides[axis])
            place = step if place is None else builder.add(place, step)
    data = field(context, builder, kind, array, "data")
    if place is None:
        return data, left, left_strides
    if is_contiguous:
        return builder.gep(data, [place]), left, left_strides
    bytes_of = builder.bitcast(data, ir.IntType(8).as_pointer())
    return builder.bitcast(builder.gep(bytes_of, [place]), data.type), left, left_strides


def _get(context: Any, builder: Any, signature: Any, array: Any, kinds: Any, indices: Any) -> Any:
    kind, result = signature.args[0], signature.return_type
    data, shape, strides = _part(context, builder, kind, array, kinds, indices)
    if not shape:
        return context.unpack_value(builder, kind.dtype, data)
    if kind.layout == "C" and result.layout != "C":
        raise TypeError("kernels take no columns of contiguous arrays")
    return make(context, builder, result, data, shape, strides)


def _set(context: Any, builder: Any, signature: Any, arguments: Any, kinds: Any, indices: Any):
    kind, _, value_kind = signature.args
    data, shape, _ = _part(context, builder, kind, arguments[0], kinds, indices)
    if shape:
        raise TypeError("kernels write one element at a time")
    value = context.cast(builder, arguments[2], value_kind, kind.dtype)
    context.pack_value(builder, kind.dtype, value, data)
    return context.get_dummy_value()


def _taken_apart(builder: Any, kind: Any, index: Any) -> tuple[Any, Any]:
    """Return the types and the values of one index or of several."""
    if isinstance(kind, types.BaseTuple):
        return kind.types, [builder.extract_value(index, k) for k in range(len(kind))]
    return (kind,), (index,)


@lower_builtin(operator.getitem, PlainArray, types.Integer)
@lower_builtin(operator.getitem, PlainArray, types.SliceType)
@lower_builtin(operator.getitem, PlainArray, types.BaseTuple)
def _getitem(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kinds, indices = _taken_apart(builder, signature.args[1], arguments[1])
    return _get(context, builder, signature, arguments[0], kinds, indices)


@lower_builtin(operator.setitem, PlainArray, types.Any, types.Any)
def _setitem(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kinds, indices = _taken_apart(builder, signature.args[1], arguments[1])
    return _set(context, builder, signature, arguments, kinds, indices)


def _constants(index: Any) -> tuple[int, ...]:
    """Return an index that is written down as numbers; leave others to the functions above."""
    indices = index if isinstance(index, tuple) else (index,)
    if not all(isinstance(one, int) for one in indices):
        raise NotImplementedError
    return indices


@lower_builtin("static_getitem", PlainArray, types.Any)
def _getitem_at_constants(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    indices = _constants(arguments[1])
    kinds = [types.intp] * len(indices)
    return _get(context, builder, signature, arguments[0], kinds, indices)


@lower_builtin("static_setitem", PlainArray, types.Any, types.Any)
def _setitem_at_constants(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    indices = _constants(arguments[1])
    return _set(context, builder, signature, arguments, [types.intp] * len(indices), indices)


@lower_builtin(len, PlainArray)
def _len(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return words(context, builder, signature.args[0], arguments[0], "shape")[0]


@lower_getattr(PlainArray, "shape")
def _shape(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return field(context, builder, kind, array, "shape")


# Stock Numba makes of every helper what Python could call as well. Nothing calls that.


@unbox(PlainArray)
def _from_python(kind: Any, given: Any, context: Any) -> NativeValue:
    undefined = ir.Constant(context.context.get_value_type(kind), ir.Undefined)
    return NativeValue(undefined, is_error=ir.Constant(ir.IntType(1), 1))


@box(PlainArray)
def _to_python(kind: Any, array: Any, context: Any) -> Any:
    return context.pyapi.get_null_object()
