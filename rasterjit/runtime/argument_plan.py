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
"""Where, behind its header, an array keeps address, axes, lengths, strides, description, flags."""

KIND = 8
"""Where a description keeps four characters, the third its byte order, then its type number."""

LAYOUT = object.__basicsize__, tuple.__basicsize__
"""
Bytes of an object's header, whose last word is the object's type, and before the items of a tuple.

Releases of Python differ in them, so a plan names them and the machine code fits all.
"""

ARRAY_TYPE, READ_INT, LENGTH, HEADER, ITEMS, CODE, UNLOCK, LOCK, FIRST = (
    WORD * n for n in range(9)
)
"""Bytes into a plan: what `pack` reads once, and the first instruction."""

C_CONTIGUOUS, ALIGNED = 0x1, 0x100
"""Flags of an array."""

END, RECORD, ARRAY, INT, FLOAT64, FLOAT32 = range(6)
"""Operations of a plan: what an instruction packs."""

NUMBERS = {
    "int64": (INT, int, np.int64),
    "bool": (INT, bool, bool),
    "float64": (FLOAT64, float, np.float64),
    "float32": (FLOAT32, np.float32, np.float32),
}
"""For each type of number: the instruction that packs it, and the Python types it accepts."""

LONGEST_PATH = 8
"""Most tuples inside tuples."""

OP, EXPECTED, DETAIL, WANTED_FLAGS, STRIDED, DEPTH, PATH = (WORD * n for n in range(7))
"""
Bytes into an instruction. ``EXPECTED`` is the type object of a record or a number, or the byte
order and type number of an array. ``DETAIL`` is the number of an array's axes, the length of a
record, or a second type object that a number may have.
"""

INSTRUCTION = PATH + WORD * LONGEST_PATH
"""Bytes of an instruction."""

ORDER_AND_NUMBER = 0xFFFFFFFF00FF0000
"""Mask of the word at ``KIND``: byte order and type number."""


def _instructions(kind: Type, path: tuple[int, ...]) -> Iterator[list[int]]:
    def instruction(op: int, expected: int, axes: int = 0, flags: int = 0, strided: int = 0) -> Any:
        depth = len(path)
        if depth > LONGEST_PATH:
            raise ValueError(f"tuples nest too deep in the arguments of a kernel: {path}")
        return [op, expected, axes, flags, strided, depth, *path, *[0] * (LONGEST_PATH - depth)]

    if isinstance(kind, RecordType):
        if path:
            yield instruction(RECORD, id(kind.record), len(kind.fields))
        for k, field in enumerate(kind.fields):
            yield from _instructions(field, (*path, k))
    elif isinstance(kind, ArrayType):
        dtype = np.dtype(kind.dtype)
        order = ord(dtype.byteorder) << 16
        number = dtype.num << 32
        flags = ALIGNED | (C_CONTIGUOUS if kind.is_contiguous else 0)
        yield instruction(ARRAY, order | number, kind.ndim, flags, int(not kind.is_contiguous))
    else:
        op, one, other = NUMBERS[kind.dtype]
        yield instruction(op, id(one), id(other))


def plan_of(kind: RecordType, code: int = 0) -> Any:
    """Return the plan of a kernel's arguments, a ctypes array, and of a call of some code."""
    python = ctypes.pythonapi
    functions = python.PyLong_AsLongLong, python.PyEval_SaveThread, python.PyEval_RestoreThread
    read_int, *locks = [ctypes.cast(one, ctypes.c_void_p).value for one in functions]
    words = [id(np.ndarray), read_int, len(kind.fields), *LAYOUT, code, *locks]
    for one in _instructions(kind, ()):
        words += one
    words += [END] * (INSTRUCTION // WORD)
    return (ctypes.c_int64 * len(words))(*words)
