"""Write what a helper returns to memory: numbers, in tuples and records; imports the compiler."""

from __future__ import annotations

import json

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WORD = ir.IntType(64)


def shape_of(kind):
    """Return the description of a type: a letter, None, or module, name and parts of a record."""
    if kind == types.none:
        return None
    if isinstance(kind, types.BaseTuple):
        own = getattr(kind, "instance_class", None)
        names = (None, None) if own is None else (own.__module__, own.__qualname__)
        return [*names, [shape_of(one) for one in kind.types]]
    for letter, family in (("b", types.Boolean), ("f", types.Float), ("i", types.Integer)):
        if isinstance(kind, family):
            return "u" if letter == "i" and not kind.signed else letter
    raise TypeError(f"helpers return numbers, tuples and records of them here, not {kind}")


def leaves_of(context, builder, kind, value):
    """Yield the numbers of a value, each as a word."""
    if isinstance(kind, types.BaseTuple):
        parts = cgutils.unpack_tuple(builder, value, len(kind.types))
        for one, part in zip(kind.types, parts, strict=True):
            yield from leaves_of(context, builder, one, part)
    elif isinstance(kind, types.Float):
        yield builder.bitcast(context.cast(builder, value, kind, types.float64), WORD)
    elif kind != types.none:
        yield context.cast(builder, value, kind, types.int64)


@intrinsic
def keep(typing_context, place, value):
    """Write the address of a result's description to a place, then its numbers, a word each."""

    def generate(context, builder, signature, arguments):
        text = json.dumps(shape_of(types.unliteral(value)))
        description = context.insert_const_string(builder.module, text)
        words = [builder.ptrtoint(description, WORD)]
        words += leaves_of(context, builder, types.unliteral(value), arguments[1])
        start = builder.inttoptr(arguments[0], WORD.as_pointer())
        for number, word in enumerate(words):
            builder.store(word, builder.gep(start, [ir.Constant(WORD, number)]))
        return context.get_dummy_value()

    return types.none(types.int64, value), generate
