"""
Link the machine code of kernels into a shared library, for this system or another, on any system.

Numba and LLVM make object code, as for the store; ``ziglang`` brings linkers of every system and a
C compiler for ``library.c``, which tells whether a CPU runs a library.
"""

from __future__ import annotations

import functools
import os
import re
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.runtime import code_generation, isolated_numba
from rasterjit.runtime.state_block import RecordType
from rasterjit.runtime.targets import PLATFORMS, Target, split_triple

OBJECT = ".o"

OWN_CODE = Path(__file__).with_name("library.c")

CALLED = frozenset(["memset", "memcpy", "memmove"])
"""
Functions of the C library that a library may call. Processes of Linux and macOS have them; for
Windows ``library.c`` brings ``memset``, and the linker refuses the others.
"""


class System(NamedTuple):
    """How libraries of an operating system are linked."""

    name: str
    """As zig calls it."""
    linker: tuple[str, ...]
    """A program of zig's and its arguments, but for the object files."""
    needed: frozenset[str] = frozenset()
    """What LLVM calls there besides."""


SYSTEMS = {
    "linux": System(
        "linux-gnu",
        (
            # The C library is not linked: the process has it.
            "ld.lld", "-shared", "--build-id=none", "--hash-style=gnu", "-z", "now", "-z", "relro",
            "-z", "noexecstack", "--strip-all", "-soname", "{name}", "-o", "{made}",
        ),
    ),
    "windows": System(
        "windows-gnu",
        # What else would be of Microsoft's C library is in `library.c`.
        ("lld-link", "/dll", "/noentry", "/nologo", "/machine:{machine}", "/Brepro", "/out:{made}"),
        frozenset(["_fltused"]),
    ),
    "macos": System(
        "macos.11.0",
        (
            "cc", "-target", "{target}", "-dynamiclib", "-nostdlib", "-lSystem",
            "-Wl,-install_name,@rpath/{name}", "-o", "{made}",
        ),
        frozenset(["bzero", "__bzero"]),
    ),
}  # fmt: skip
"""By our names (``targets.split_triple``)."""


@functools.cache
def machine_of(target: Target) -> Any:
    """Return LLVM's description of a machine, for code that may lie anywhere as a whole."""
    from llvmlite import binding

    code_generation.target_machine(target)  # It registers LLVM's targets.
    return binding.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=3, reloc="pic", codemodel="small"
    )


def optimized_text(value: Any, kind: RecordType, name: str, target: Target) -> tuple[str, str]:
    """
    Return what a form of a kernel returns, and its optimized module as LLVM's text.

    It is optimized for the target's CPU on Linux: for macOS, LLVM would call what others lack.
    """
    on_linux = (one for system in ("x86_64", "aarch64") for one in PLATFORMS[system].targets())
    same_cpu = (one for one in on_linux if one[1:] == target[1:])
    lower = isolated_numba.compiler().lower_to_llvm
    returns, module = lower(value, kind, name, next(same_cpu, target))
    return returns, str(module)


def object_code(text: str, name: str, target: Target) -> bytes:
    """Return the object code of a kernel for a target, given its optimized module."""
    code = machine_of(target).emit_object(module_for(text, name, target))
    unknown = needed_symbols(code) - allowed_in(target)
    if unknown:
        raise RuntimeError(f"{name} calls what a library must not: {sorted(unknown)}")
    return code


def module_for(text: str, name: str, target: Target) -> Any:
    """Return the optimized module of a kernel for a target, with tables to unwind the stack."""
    from llvmlite import binding

    module = binding.parse_assembly(re.sub(r"(?m)^(define .*) \{$", r"\1 uwtable {", text))
    module.triple, module.data_layout = target.triple, str(machine_of(target).target_data)
    module.name = name
    if split_triple(target.triple)[1] == "windows":
        module.get_function(name).storage_class = "dllexport"
    return module


def allowed_in(target: Target) -> frozenset[str]:
    """Return the names that a target's object code may need from elsewhere."""
    return CALLED | SYSTEMS[split_triple(target.triple)[1]].needed


COFF, MACHO = (b"\x64\x86", b"\x64\xaa"), b"\xcf\xfa\xed\xfe"
"""How object code of Windows, for x86-64 and for AArch64, and of macOS begins."""

MACHINES = {"x86_64": "x64", "aarch64": "arm64"}
"""Windows' names of our kinds of CPUs."""


def needed_symbols(code: bytes) -> set[str]:
    """Return the names that object code of any system needs from elsewhere."""
    if code.startswith(COFF):
        return set(_needed_of_coff(code))
    if code.startswith(MACHO):
        return set(_needed_of_macho(code))
    return code_generation.find_undefined_symbols(code)


def _needed_of_coff(code: bytes) -> Iterator[str]:
    at, count = struct.unpack_from("<II", code, 8)
    texts = at + 18 * count
    while at < texts:
        name, value, section, _, kind, more = struct.unpack_from("<8sIhHBB", code, at)
        zero, offset = struct.unpack("<II", name)
        # An external one, in no section.
        if (value, section, kind) == (0, 0, 2):
            yield name.rstrip(b"\0").decode() if zero else _text(code, texts + offset)
        at += 18 * (1 + more)


def _needed_of_macho(code: bytes) -> Iterator[str]:
    (commands,) = struct.unpack_from("<I", code, 16)
    at = 32
    for _ in range(commands):
        kind, size = struct.unpack_from("<II", code, at)
        if kind == 2:  # The table of symbols.
            symbols, count, texts, _ = struct.unpack_from("<4I", code, at + 8)
            for one in struct.iter_unpack("<IBBHQ", code[symbols : symbols + 16 * count]):
                # An external one, undefined. The system puts a line before names.
                if one[1] & 0x0F == 1:
                    yield _text(code, texts + one[0])[1:]
        at += size


def _text(code: bytes, first: int) -> str:
    return code[first : code.index(b"\0", first)].decode()


def link(target: Target, name: str, objects: Sequence[Path]) -> bytes:
    """
    Return the shared library of object files, all of whose functions it exports.

    Raises
    ------
    RuntimeError
        The linker refuses; its words.
    """
    (kind, system), level = split_triple(target.triple), target.cpu.rpartition("-v")[2]
    zig_target = f"{kind}-{SYSTEMS[system].name}"
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        here = Path(place)
        own, made, listed = here / f"library{OBJECT}", here / name, here / "objects"
        # Quoted for spaces, and without backslashes, which some linkers take for escapes.
        listed.write_text("\n".join(f'"{path.as_posix()}"' for path in (*objects, own)))
        _zig(
            place, "cc", "-target", zig_target, "-O2", "-g0", "-fPIC", "-fno-sanitize=all",
            "-fno-stack-protector", f"-DLEVEL={level}", "-c", str(OWN_CODE), "-o", str(own),
        )  # fmt: skip
        words = SYSTEMS[system].linker
        known = {"name": name, "made": made, "target": zig_target, "machine": MACHINES[kind]}
        _zig(place, *(word.format(**known) for word in words), f"@{listed}")
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
