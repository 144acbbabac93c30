"""
Define the state block of a kernel: its arguments as 64-bit words, and the types for its layout.

A block is a row of 64-bit words. An array takes its address and the lengths of its axes, and the
strides, too, unless it is C-contiguous; a number takes one word; a record (a tuple, named or not)
takes what its fields take, one after the other.

Every call packs a block, so machine code does it (``pack_arguments``): it reads tuples, arrays and
numbers where CPython and NumPy keep them. `pack_in_python` does the same in Python, and says
which argument is wrong.
"""

from __future__ import annotations

import operator
import struct
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

WORD = 8
"""Bytes of a word."""

LINE = 64
"""Bytes of a cache line, to which arrays in a block of samples are aligned."""


class ArrayType(NamedTuple):
    """An array of numbers."""

    dtype: str
    """A NumPy name: ``float32``."""
    ndim: int
    is_contiguous: bool
    """Whether it must be C-contiguous; else any strides do."""
    shape: tuple[int, ...] | None = None
    """Fixed lengths, of an array in a block of samples; such an array is contiguous."""

    def __str__(self) -> str:
        if self.shape is not None:
            return f"{self.dtype}[{' x '.join(map(str, self.shape))}]"
        axes = [":"] * self.ndim
        if self.is_contiguous and axes:
            axes[-1] = "::1"
        return f"{self.dtype}[{', '.join(axes)}]"


class NumberType(NamedTuple):
    """A number; ``float32[:, ::1]`` and the like name the types of arrays of such numbers."""

    dtype: str
    """``int64``, ``float64``, ``float32`` or ``bool``; others only as elements of arrays."""

    def __str__(self) -> str:
        return self.dtype

    def __getitem__(self, axes: Any) -> ArrayType:  # type: ignore[override]
        """Return the type of an array: ``[:, :]`` of any strides, ``[:, ::1]`` C-contiguous."""
        axes = axes if isinstance(axes, tuple) else (axes,)
        if all(isinstance(axis, int) for axis in axes):
            return ArrayType(self.dtype, len(axes), True, axes)
        return ArrayType(self.dtype, len(axes), axes[-1] == slice(None, None, 1))


class RecordType(NamedTuple):
    """A tuple, perhaps a named one."""

    record: type
    fields: tuple[Any, ...]

    def __str__(self) -> str:
        name = "" if self.record is tuple else self.record.__name__
        return f"{name}({', '.join(map(str, self.fields))})"


float64, float32 = NumberType("float64"), NumberType("float32")
int64, int32, int8 = (NumberType(f"int{bits}") for bits in (64, 32, 8))
uint32, uint8 = NumberType("uint32"), NumberType("uint8")

stored = NumberType("float32|float64|int32")
"""Types of stored depths: a kernel has a form for each, the usual one first."""

real = NumberType("float64|float32")
"""Types in which vertices are projected: a kernel has a form for each."""

Type = ArrayType | NumberType | RecordType


def infer_type(value: Any) -> Type:
    """Return the type of an argument."""
    if isinstance(value, np.ndarray):
        return ArrayType(value.dtype.name, value.ndim, bool(value.flags.c_contiguous))
    if isinstance(value, tuple):
        return RecordType(type(value), tuple(map(infer_type, value)))
    if isinstance(value, (bool, np.bool_)):
        return NumberType("bool")
    if isinstance(value, np.float32):
        return NumberType("float32")
    if isinstance(value, (int, np.integer)):
        return NumberType("int64")
    if isinstance(value, (float, np.floating)):
        return NumberType("float64")
    raise TypeError(f"a kernel takes arrays, numbers and tuples of them, not {value!r}")


def type_from_annotation(annotation: Any) -> Type:
    """Return the type that an annotation of a parameter or a record's field stands for."""
    if isinstance(annotation, tuple) and not hasattr(annotation, "_fields"):
        return RecordType(tuple, tuple(map(type_from_annotation, annotation)))
    if isinstance(annotation, type) and hasattr(annotation, "_fields"):
        module_globals = vars(sys.modules[annotation.__module__])
        annotations = (annotation.__annotations__[key] for key in annotation._fields)
        # NamedTuple wraps what it finds as text.
        evaluated = (getattr(each, "__forward_arg__", each) for each in annotations)
        fields = (
            eval(each, module_globals) if isinstance(each, str) else each for each in evaluated
        )
        return RecordType(annotation, tuple(map(type_from_annotation, fields)))
    if isinstance(annotation, (ArrayType, NumberType)):
        return annotation
    raise TypeError(f"no type of a stage's argument: {annotation!r}")


def expand_forms(kind: RecordType) -> list[RecordType]:
    """Return the forms of a declaration, one for each choice of element types."""
    choices = {leaf.dtype for leaf in iterate_leaves(kind) if "|" in leaf.dtype}
    forms = [kind]
    for choice in sorted(choices):
        forms = [_choose_dtype(form, choice, each) for each in choice.split("|") for form in forms]
    return forms


def _choose_dtype(kind: Any, choice: str, dtype: str) -> Any:
    """Replace a choice of element types, such as ``float32|float64``, by one of them."""
    if isinstance(kind, RecordType):
        return kind._replace(
            fields=tuple(_choose_dtype(field, choice, dtype) for field in kind.fields)
        )
    if kind.dtype == choice:
        return kind._replace(dtype=dtype)
    return kind


def iterate_leaves(kind: Type) -> Iterator[Type]:
    """Yield the arrays and numbers in a type, in the order of a state block."""
    if isinstance(kind, RecordType):
        for field in kind.fields:
            yield from iterate_leaves(field)
    else:
        yield kind


def count_words(leaf: Type) -> int:
    """Return the words of an array or number; an array of fixed shape lies in the block."""
    if isinstance(leaf, ArrayType):
        if leaf.shape is not None:
            return -(-int(np.prod(leaf.shape)) * np.dtype(leaf.dtype).itemsize // LINE) * (
                LINE // WORD
            )
        return 1 + leaf.ndim * (1 if leaf.is_contiguous else 2)
    return 1


def count_block_words(kind: Type) -> int:
    """Return the words of a block of a type."""
    return sum(map(count_words, iterate_leaves(kind)))


def pack_in_python(kind: Type, value: Any, words: list[int], name: str = "arguments") -> None:
    """
    Append the words of an argument.

    Raises
    ------
    TypeError
        Names the argument, if it is of another type.
    """
    if isinstance(kind, RecordType):
        if not isinstance(value, tuple) or len(value) != len(kind.fields):
            raise TypeError(f"{name} must be {kind}, got {value!r}")
        names = getattr(value, "_fields", range(len(value)))
        for key, field, each in zip(names, kind.fields, value, strict=True):
            pack_in_python(field, each, words, f"{name}.{key}")
    elif isinstance(kind, ArrayType):
        words += _pack_array(kind, value, name)
    else:
        words.append(_pack_number(kind, value, name))


def _pack_array(kind: ArrayType, value: Any, name: str) -> list[int]:
    fits = isinstance(value, np.ndarray) and value.dtype.name == kind.dtype
    fits = fits and value.dtype.isnative and value.flags.aligned and value.ndim == kind.ndim
    if not fits or (kind.is_contiguous and not value.flags.c_contiguous):
        raise TypeError(f"{name} must be an array {kind}, got {_describe_value(value)}")
    strides = () if kind.is_contiguous else value.strides
    return [value.ctypes.data, *value.shape, *strides]


def _describe_value(value: Any) -> str:
    return str(infer_type(value)) if isinstance(value, np.ndarray) else repr(value)


def _pack_number(kind: NumberType, value: Any, name: str) -> int:
    try:
        if kind.dtype in ("int64", "bool"):
            return operator.index(bool(value) if kind.dtype == "bool" else value)
        code = "<d" if kind.dtype == "float64" else "<f"
        return int.from_bytes(struct.pack(code, value).ljust(WORD, b"\0"), "little", signed=True)
    except (TypeError, struct.error):
        raise TypeError(f"{name} must be a number, {kind}, got {value!r}") from None


def view_block_arrays(kind: RecordType, words: Any) -> Any:
    """Return a record of views of the arrays in a block of samples, (n,) int64."""
    arrays, at = [], 0
    for leaf in kind.fields:
        count = int(np.prod(leaf.shape))
        end = at + count_words(leaf)
        arrays.append(words[at:end].view(leaf.dtype)[:count].reshape(leaf.shape))
        at = end
    return kind.record(*arrays)
