"""Generate object code from LLVM's language: llvmlite does that, and Numba is not needed."""

from __future__ import annotations

import functools
import struct
from collections.abc import Iterable
from typing import Any

from llvmlite import binding

from rasterjit.runtime.targets import Target, needs_far_addresses

ALLOWED_CALLS = {
    "memset", "memcpy", "memmove", "floor", "floorf", "ceil", "ceilf", "rint", "rintf", "trunc",
    "truncf", "nearbyint", "nearbyintf", "fma", "fmaf", "sqrt", "sqrtf",
}  # fmt: skip
"""Functions that object code may call: exact, with the same bits in every C library."""


@functools.cache
def target_machine(target: Target) -> Any:
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


def generate_code(module: Any, name: str, target: Target) -> bytes:
    """Generate the object code of a kernel, given its optimized module."""
    code = target_machine(target).emit_object(module)
    check_no_unknown(find_undefined_symbols(code) - ALLOWED_CALLS, name)
    return code


def generate_from_text(text: str, symbol: str, name: str, target: Target) -> bytes:
    """Generate the object code of a kernel by another name, given its optimized module as text."""
    module = binding.parse_assembly(text)
    module.triple, module.data_layout = target.triple, str(target_machine(target).target_data)
    module.name = module.get_function(symbol).name = name
    return generate_code(module, name, target)


def check_no_unknown(unknown: Iterable[str], name: str) -> None:
    """Raise ``RuntimeError`` for functions that a kernel must not call."""
    if unknown:
        raise RuntimeError(f"kernel {name} needs what no store can keep: {sorted(unknown)}")


ELF_HEADER, SYMBOL_TABLE, SYMBOL_BYTES, UNDEFINED_SECTION = b"\x7fELF\x02\x01", 2, 24, 0
"""The first bytes of 64-bit object code of Linux, the type of the section of symbols, the bytes of
a symbol, and the section number of an undefined one."""


def find_undefined_symbols(code: bytes) -> set[str]:
    """
    Return the undefined symbols of object code.

    LLVM's language does not tell them all: LLVM calls functions of its own choice. Only object
    code of Linux is read; of others, none are known.
    """
    if not code.startswith(ELF_HEADER):
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
        for at in range(offset + SYMBOL_BYTES, offset + length, SYMBOL_BYTES):
            name, _, _, section = struct.unpack_from("<IBBH", code, at)
            if section == UNDEFINED_SECTION:
                begin = texts + name
                found.add(code[begin : code.index(b"\0", begin)].decode())
    return found
