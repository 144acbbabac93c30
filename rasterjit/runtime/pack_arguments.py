"""
Pack the arguments of a call into a state block and make the call, in about a microsecond.

Machine code reads tuples, arrays and numbers from the addresses that a plan (``argument_plan``)
gives, and checks their types. `state_block.pack_in_python` packs whatever differs from the plan. It
packs all calls if a first try (`reads_this_python`) shows that this Python lays out objects in
another way.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from rasterjit.runtime import argument_plan as layout
from rasterjit.runtime.intrinsics import call_at, load_int32, load_int64, store_int64
from rasterjit.runtime.jit import helper, raw_kernel, set_packer
from rasterjit.runtime.state_block import WORD, RecordType, float32, float64, int64, pack_in_python


@helper
def copy_words(source, count, target):
    """Copy ``count`` words from one address to another; return the address behind the copy."""
    for k in range(count):
        store_int64(target + WORD * k, load_int64(source + WORD * k))
    return target + WORD * count


@helper
def has_expected_layout(array, header, instruction):
    """Tell whether an array, given behind its header, has the expected type, axes and flags."""
    word = load_int64(load_int64(array + layout.DESCR) + header + layout.TYPE_CODE)
    flags = load_int64(instruction + layout.EXPECTED_FLAGS)
    return (
        (word & np.int64(np.uint64(layout.TYPE_CODE_MASK)))
        == load_int64(instruction + layout.EXPECTED)
        and np.int64(load_int32(array + layout.NDIM)) == load_int64(instruction + layout.DETAIL)
        and (np.int64(load_int32(array + layout.FLAGS)) & flags) == flags
    )


@raw_kernel
def pack(arguments, plan, state):
    """
    Write a state block; if the plan names a kernel's code, call it with the block, without the GIL.

    Parameters
    ----------
    arguments : int
        Address of a tuple.
    plan : int
        Address of the plan (`make_plan`): the type object of arrays, the function that reads an
        int, the number of items in the tuple, the layout of objects, the code to call or 0, the
        functions that release and acquire the GIL, then instructions.
    state : int
        Address of the block, written. After a call its first word is the kernel's result.

    Returns
    -------
    int
        0, or the number, from 1 on, of the first instruction whose argument differs from the plan.
    """
    array_type, read_int = load_int64(plan + layout.ARRAY_TYPE), load_int64(plan + layout.READ_INT)
    header, items = load_int64(plan + layout.HEADER_BYTES), load_int64(plan + layout.ITEMS_OFFSET)
    instruction, out, position = plan + layout.FIRST_INSTRUCTION, state, np.int64(1)
    if load_int64(arguments + header) != load_int64(plan + layout.ARGUMENT_COUNT):
        return position
    # Pack
    op = load_int64(instruction + layout.OP)
    while op != layout.END:
        # Follow the path to the value, through tuples in tuples
        value = arguments
        for k in range(load_int64(instruction + layout.PATH_LENGTH)):
            value = load_int64(
                value + items + WORD * load_int64(instruction + layout.PATH + WORD * k)
            )
        body = value + header
        kind, expected = load_int64(body - WORD), load_int64(instruction + layout.EXPECTED)
        detail = load_int64(instruction + layout.DETAIL)
        if op == layout.ARRAY:
            if kind != array_type or not has_expected_layout(body, header, instruction):
                return position
            store_int64(out, load_int64(body + layout.DATA))
            out = copy_words(load_int64(body + layout.SHAPE), detail, out + WORD)
            if load_int64(instruction + layout.HAS_STRIDES):
                out = copy_words(load_int64(body + layout.STRIDES), detail, out)
        elif op == layout.RECORD:
            if kind != expected or load_int64(body) != detail:
                return position
        else:
            if kind != expected and kind != detail:
                return position
            if op == layout.INT:
                word = call_at(read_int, value, 0, 0)
            elif op == layout.FLOAT64:
                word = load_int64(body)
            else:
                word = np.int64(load_int32(body))
            store_int64(out, word)
            out += WORD
        instruction, position = instruction + layout.INSTRUCTION_BYTES, position + 1
        op = load_int64(instruction + layout.OP)
    # Call
    code = load_int64(plan + layout.CODE)
    if code != 0:
        thread = call_at(load_int64(plan + layout.RELEASE_GIL), 0, 0, 0)
        store_int64(state, call_at(code, state, 0, 0))
        call_at(load_int64(plan + layout.ACQUIRE_GIL), thread, 0, 0)
    return np.int64(0)


def reads_this_python(pack_at: Callable[[int, int, int], int]) -> bool:
    """Tell whether `pack` reads objects of this Python and this NumPy correctly."""
    array = np.zeros((5, 7, 3), np.float32)[::2, 1:3]
    value = (array, (3, 2.5, np.float32(1.5)), np.int64(-9), 1 << 40)
    record = RecordType(tuple, (int64, float64, float32))
    kind = RecordType(tuple, (float32[:, :, :], record, int64, int64))
    plan = layout.make_plan(kind)
    block = (ctypes.c_int64 * 16)()
    if pack_at(id(value), ctypes.addressof(plan), ctypes.addressof(block)) != 0:
        return False
    words: list[int] = []
    pack_in_python(kind, value, words)
    return list(block)[: len(words)] == words


set_packer(pack, reads_this_python)
