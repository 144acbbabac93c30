"""Generate object code from LLVM's language: llvmlite does that, and Numba is not needed."""

from __future__ import annotations

import functools
import struct
from collections.abc import Iterable
from typing import Any

from llvmlite import binding

from rasterjit.runtime.targets import Target, needs_far_addresses

ALLOWED = {
    "memset", "memcpy", "memmove", "floor", "floorf", "ceil", "ceilf", "rint", "rintf", "trunc",
    "truncf", "nearbyint", "nearbyintf", "fma", "fmaf", "sqrt", "sqrtf",
}  # fmt: skip
"""Functions that object code may call: exact, with the same bits in every C library."""


@functools.cache
def machine_of(target: Target) -> Any:
    """
    Return LLVM's description of a machine to compile for.

    LLVM's linker gives code and constants memory of their own, more than 2 GB apart where the
    program has a large array between them: addresses of 32 bits would end the process.
    """
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    is_far = needs_far_addresses(target.triple)
    addresses = {
        "reloc": "static" if is_far else "pic",
        "codemodel": "large" if is_far else "default",
    }
    return binding.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=3, **addresses
    )


def object_code(module: Any, name: str, target: Target) -> bytes:
    """Return the object code of a kernel, given its optimized module."""
    code = machine_of(target).emit_object(module)
    refuse(needed_symbols(code) - ALLOWED, name)
    return code


def object_code_of_text(text: str, symbol: str, name: str, target: Target) -> bytes:
    """Return the object code of a kernel by another name, given its optimized module as text."""
    module = binding.parse_assembly(text)
    module.triple, module.data_layout = target.triple, str(machine_of(target).target_data)
    module.name = module.get_function(symbol).name = name
    return object_code(module, name, target)


def refuse(unknown: Iterable[str], name: str) -> None:
    """Raise ``RuntimeError`` for functions that a kernel must not call."""
    if unknown:
        raise RuntimeError(f"kernel {name} needs what no store can keep: {sorted(unknown)}")


ELF, SYMBOL_TABLE, SYMBOL, NOWHERE = b"\x7fELF\x02\x01", 2, 24, 0
"""How 64-bit object code of Linux begins, the kind of the section that lists its symbols, bytes of
each of these, and the number of the section of one that is elsewhere."""


def needed_symbols(code: bytes) -> set[str]:
    """
    Return the names that object code needs from elsewhere.

    LLVM's language does not tell them all: LLVM calls functions of its own choice. Only object
    code of Linux is read; of others, none are known.
    """
    if not code.startswith(ELF):
        return set()
    (start,) = struct.unpack_from("<Q", code, 0x28)
    size, count = struct.unpack_from("<HH", code, 0x3A)
    # Name, kind, flags, address, offset, length, link and further facts of each.
    sections = [struct.unpack_from("<IIQQQQII", code, start + size * k) for k in range(count)]
    found = set()
    for _, kind, _, _, offset, length, link, _ in sections:
        if kind != SYMBOL_TABLE:
            continue
        texts = sections[link][4]
        for at in range(offset + SYMBOL, offset + length, SYMBOL):
            name, _, _, section = struct.unpack_from("<IBBH", code, at)
            if section == NOWHERE:
                begin = texts + name
                found.add(code[begin : code.index(b"\0", begin)].decode())
    return found
