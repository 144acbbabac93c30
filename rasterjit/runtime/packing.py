"""
Pack the arguments of a call into a state block, in machine code: about a microsecond.

Reads tuples, arrays and numbers where CPython and NumPy keep them (``PyTupleObject``,
``PyArrayObject`` and ``PyArray_Descr``, whose fields NumPy's C interface fixes). A plan says where
to look and what to expect; anything unexpected is left to `state.pack_slowly`. So is every call, if
a first try (`is_readable`) shows that this Python keeps things elsewhere.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rasterjit.runtime.intrinsics import call_at, load_int32, load_int64, store_int64
from rasterjit.runtime.jit import helper, raw_kernel
from rasterjit.runtime.state import WORD, ArrayType, NumberType, RecordType, Type

DATA, NDIM, SHAPE, STRIDES, DESCR, FLAGS = 0, 8, 16, 24, 40, 48
"""Where, behind its header, an array keeps address, axes, lengths, strides, description, flags."""

KIND = 8
"""Where a description keeps four characters, the third its byte order, then its type number."""

LAYOUT = object.__basicsize__, tuple.__basicsize__
"""
Bytes of an object's header, whose last word is the object's type, and before the items of a tuple.

Releases of Python differ in them, so a plan names them and the machine code fits all.
"""

ARRAY_TYPE, READ_INT, LENGTH, HEADER, ITEMS, FIRST = (WORD * n for n in range(6))
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

OP, EXPECTED, AXES, WANTED_FLAGS, STRIDED, DEPTH, PATH = (WORD * n for n in range(7))
"""
Bytes into an instruction. ``EXPECTED`` is the type object of a record or a number, or the byte
order and type number of an array. ``AXES`` is the number of an array's axes, the length of a
record, or a second type object that a number may have.
"""

INSTRUCTION = PATH + WORD * LONGEST_PATH
"""Bytes of an instruction."""

ORDER_AND_NUMBER = 0xFFFFFFFF00FF0000
"""Mask of the word at ``KIND``: byte order and type number."""


@helper
def copy_words(source, count, target):
    """Copy some words; return where they end."""
    for k in range(count):
        store_int64(target + WORD * k, load_int64(source + WORD * k))
    return target + WORD * count


@helper
def is_array(thing, header, at):
    """Tell whether an array, behind its header, is of the expected type, axes and layout."""
    word = load_int64(load_int64(thing + DESCR) + header + KIND)
    flags = load_int64(at + WANTED_FLAGS)
    return (
        (word & np.int64(np.uint64(ORDER_AND_NUMBER))) == load_int64(at + EXPECTED)
        and np.int64(load_int32(thing + NDIM)) == load_int64(at + AXES)
        and (np.int64(load_int32(thing + FLAGS)) & flags) == flags
    )


@raw_kernel
def pack(arguments, plan, state):
    """
    Write a state block.

    Parameters
    ----------
    arguments : int
        Address of a tuple.
    plan : int
        Address of the type object of arrays, the function that reads an int, the items that the
        tuple must have, the layout of objects, then instructions (`plan_of`).
    state : int
        Address of the block, written.

    Returns
    -------
    int
        0, or the number, from 1 on, of the first instruction that found something unexpected.
    """
    array_type, read_int = load_int64(plan + ARRAY_TYPE), load_int64(plan + READ_INT)
    header, items = load_int64(plan + HEADER), load_int64(plan + ITEMS)
    at, out, number = plan + FIRST, state, np.int64(1)
    if load_int64(arguments + header) != load_int64(plan + LENGTH):
        return number
    op = load_int64(at + OP)
    while op != END:
        thing = arguments
        for k in range(load_int64(at + DEPTH)):
            thing = load_int64(thing + items + WORD * load_int64(at + PATH + WORD * k))
        body = thing + header
        kind, expected = load_int64(body - WORD), load_int64(at + EXPECTED)
        if op == ARRAY:
            if kind != array_type or not is_array(body, header, at):
                return number
            axes = load_int64(at + AXES)
            store_int64(out, load_int64(body + DATA))
            out = copy_words(load_int64(body + SHAPE), axes, out + WORD)
            if load_int64(at + STRIDED):
                out = copy_words(load_int64(body + STRIDES), axes, out)
        elif op == INT:
            if kind != expected and kind != load_int64(at + AXES):
                return number
            store_int64(out, call_at(read_int, thing, 0, 0))
            out += WORD
        elif op == RECORD:
            if kind != expected or load_int64(body) != load_int64(at + AXES):
                return number
        else:
            if kind != expected and kind != load_int64(at + AXES):
                return number
            if op == FLOAT64:
                store_int64(out, load_int64(body))
            else:
                store_int64(out, np.int64(load_int32(body)))
            out += WORD
        at, number = at + INSTRUCTION, number + 1
        op = load_int64(at + OP)
    return np.int64(0)


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


def plan_of(kind: RecordType) -> Any:
    """Return the plan of a kernel's arguments, a ctypes array."""
    read_int = ctypes.cast(ctypes.pythonapi.PyLong_AsLongLong, ctypes.c_void_p).value
    words = [id(np.ndarray), read_int, len(kind.fields), *LAYOUT]
    for one in _instructions(kind, ()):
        words += one
    words += [END] * (INSTRUCTION // WORD)
    return (ctypes.c_int64 * len(words))(*words)


def is_readable(pack_at: Callable[[int, int, int], int]) -> bool:
    """Tell whether this Python and this NumPy keep things where `pack` looks."""
    array = np.zeros((5, 7, 3), np.float32)[::2, 1:3]
    value = (array, (3, 2.5, np.float32(1.5)), np.int64(-9), 1 << 40)
    number = NumberType
    inner = RecordType(tuple, (number("int64"), number("float64"), number("float32")))
    parts = ArrayType("float32", 3, False), inner, number("int64"), number("int64")
    kind = RecordType(tuple, parts)
    plan = plan_of(kind)
    block = (ctypes.c_int64 * 16)()
    if pack_at(id(value), ctypes.addressof(plan), ctypes.addressof(block)) != 0:
        return False
    from rasterjit.runtime.state import pack_slowly

    words: list[int] = []
    pack_slowly(kind, value, words)
    return list(block)[: len(words)] == words
