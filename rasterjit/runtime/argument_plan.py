"""
Build the plan by which `pack_arguments.pack` reads a call's arguments from Python's memory.

CPython and NumPy keep tuples, arrays and numbers at fixed places (``PyTupleObject``,
``PyArrayObject`` and ``PyArray_Descr``, whose fields NumPy's C interface fixes). A plan is a row of
numbers: for each argument an instruction that says what to expect, and the path to it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

from rasterjit.runtime.state_block import WORD, ArrayType, RecordType, Type

DATA, NDIM, SHAPE, STRIDES, DESCR, FLAGS = 0, 8, 16, 24, 40, 48
"""Byte offsets of an array's fields, behind the object header."""

TYPE_CODE = 8
"""Byte offset in a description: four characters, the third its byte order, then its type number."""

OBJECT_LAYOUT = object.__basicsize__, tuple.__basicsize__
"""
Bytes of an object's header, whose last word is the object's type, and before the items of a tuple.

Releases of Python differ in them, so a plan names them and the machine code fits all.
"""

(
    ARRAY_TYPE,
    READ_INT,
    ARGUMENT_COUNT,
    HEADER_BYTES,
    ITEMS_OFFSET,
    CODE,
    RELEASE_GIL,
    ACQUIRE_GIL,
    FIRST_INSTRUCTION,
) = (WORD * n for n in range(9))
"""Byte offsets in a plan: the values that `pack` reads once, and the first instruction."""

C_CONTIGUOUS, ALIGNED = 0x1, 0x100
"""Flags of an array."""

END, RECORD, ARRAY, INT, FLOAT64, FLOAT32 = range(6)
"""Operation codes: what an instruction packs."""

NUMBERS = {
    "int64": (INT, int, np.int64),
    "bool": (INT, bool, bool),
    "float64": (FLOAT64, float, np.float64),
    "float32": (FLOAT32, np.float32, np.float32),
}
"""For each type of number, the operation code and the two Python types it accepts."""

MAX_NESTING = 8
"""Most tuples inside each other."""

OP, EXPECTED, DETAIL, EXPECTED_FLAGS, HAS_STRIDES, PATH_LENGTH, PATH = (WORD * n for n in range(7))
"""
Bytes into an instruction. ``EXPECTED`` is the type object of a record or a number, or the byte
order and type number of an array. ``DETAIL`` is the number of an array's axes, the length of a
record, or a second type object that a number may have.
"""

INSTRUCTION_BYTES = PATH + WORD * MAX_NESTING
"""Bytes of an instruction."""

TYPE_CODE_MASK = 0xFFFFFFFF00FF0000
"""Mask of byte order and type number in the word at `TYPE_CODE`."""


def _list_instructions(kind: Type, path: tuple[int, ...]) -> Iterator[list[int]]:
    def make_instruction(
        op: int, expected: int, axes: int = 0, flags: int = 0, has_strides: int = 0
    ) -> Any:
        depth = len(path)
        if depth > MAX_NESTING:
            raise ValueError(f"tuples nest too deep in the arguments of a kernel: {path}")
        return [op, expected, axes, flags, has_strides, depth, *path, *[0] * (MAX_NESTING - depth)]

    if isinstance(kind, RecordType):
        if path:
            yield make_instruction(RECORD, id(kind.record), len(kind.fields))
        for k, field in enumerate(kind.fields):
            yield from _list_instructions(field, (*path, k))
    elif isinstance(kind, ArrayType):
        dtype = np.dtype(kind.dtype)
        byte_order = ord(dtype.byteorder) << 16
        type_number = dtype.num << 32
        flags = ALIGNED | (C_CONTIGUOUS if kind.is_contiguous else 0)
        yield make_instruction(
            ARRAY, byte_order | type_number, kind.ndim, flags, int(not kind.is_contiguous)
        )
    else:
        op, python_type, numpy_type = NUMBERS[kind.dtype]
        yield make_instruction(op, id(python_type), id(numpy_type))


def make_plan(kind: RecordType, code: int = 0) -> Any:
    """Return the plan, a ctypes array, of packing arguments and, if given, calling some code."""
    python_api = ctypes.pythonapi
    functions = (
        python_api.PyLong_AsLongLong,
        python_api.PyEval_SaveThread,
        python_api.PyEval_RestoreThread,
    )
    read_int, *lock_functions = [ctypes.cast(each, ctypes.c_void_p).value for each in functions]
    words = [id(np.ndarray), read_int, len(kind.fields), *OBJECT_LAYOUT, code, *lock_functions]
    for each in _list_instructions(kind, ()):
        words += each
    words += [END] * (INSTRUCTION_BYTES // WORD)
    return (ctypes.c_int64 * len(words))(*words)
