"""
Link the machine code of kernels into a shared library, for this system or another, on any system.

Numba and LLVM make object code, as for the store; ``ziglang`` brings linkers of every system and a
C compiler for ``library.c``, which tells whether a CPU runs a library.
"""

from __future__ import annotations

import functools
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rasterjit.runtime import isolated_numba
from rasterjit.runtime.state_block import RecordType
from rasterjit.runtime.targets import Target

OBJECT = ".o"

OWN_CODE = Path(__file__).with_name("library.c")

CALLED = {"memset", "memcpy", "memmove"}
"""Functions of the C library that a library may call: every process has them."""

LINUX = (
    "ld.lld", "-shared", "--build-id=none", "--hash-style=gnu", "-z", "now", "-z", "relro", "-z",
    "noexecstack", "--strip-all",
)  # fmt: skip
"""A linker and its options. The C library is not linked: the process has it."""


@functools.cache
def machine_of(target: Target) -> Any:
    """Return LLVM's description of a machine, for code that may lie anywhere as a whole."""
    from llvmlite import binding

    return binding.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=3, reloc="pic", codemodel="small"
    )


def compile_form(
    value: Any, kind: RecordType, name: str, targets: Sequence[Target]
) -> tuple[str, list[bytes]]:
    """
    Return what a form of a kernel returns, and its object code for targets of one CPU.

    It is optimized once, for the first of them.
    """
    compiler = isolated_numba.compiler()
    returns, module = compiler.lower(value, kind, name, targets[0])
    codes = []
    for target in targets:
        codes.append(machine_of(target).emit_object(module_for(module, target)))
        unknown = compiler.needed_symbols(codes[-1]) - CALLED
        if unknown:
            raise RuntimeError(f"{name} calls what a library must not: {sorted(unknown)}")
    return returns, codes


def module_for(module: Any, target: Target) -> Any:
    """Return a copy of an optimized module for a target, with tables to unwind the stack."""
    from llvmlite import binding

    text = re.sub(r"(?m)^(define .*) \{$", r"\1 uwtable {", str(module))
    copy = binding.parse_assembly(text)
    copy.triple, copy.data_layout = target.triple, str(machine_of(target).target_data)
    return copy


def link(target: Target, name: str, objects: Sequence[Path]) -> bytes:
    """
    Return the shared library of object files, all of whose functions it exports.

    Raises
    ------
    RuntimeError
        The linker refuses; its words.
    """
    kind, level = target.triple.partition("-")[0], target.cpu.rpartition("-v")[2]
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        here = Path(place)
        own, made, listed = here / f"library{OBJECT}", here / name, here / "objects"
        listed.write_text("\n".join(map(str, (*objects, own))))
        _zig(
            place, "cc", "-target", f"{kind}-linux-gnu", "-O2", "-g0", "-fPIC", "-fno-sanitize=all",
            "-fno-stack-protector", f"-DLEVEL={level}", "-c", str(OWN_CODE), "-o", str(own),
        )  # fmt: skip
        _zig(place, *LINUX, "-soname", name, "-o", str(made), f"@{listed}")
        return made.read_bytes()


def _zig(place: str, *words: str) -> None:
    """Run a program of zig's, whose cache lies in a folder."""
    caches = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), place)
    done = subprocess.run(
        [sys.executable, "-m", "ziglang", *words], capture_output=True, text=True, check=False,
        env={**os.environ, **caches},
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"zig {' '.join(words)}: {done.stderr}")
