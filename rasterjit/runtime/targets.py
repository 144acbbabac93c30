"""
Define compile targets: this machine, or the CPU levels that wheels contain code for.

`PLATFORMS` is the table of those. A level is a set of features that many CPUs share; a CPU runs the
code of the best level whose features it has. The bits of a picture are the same on all of them.
"""

from __future__ import annotations

import functools
import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple


class Target(NamedTuple):
    """What machine code is for."""

    triple: str
    cpu: str
    features: str


class Level(NamedTuple):
    """CPUs of some age and younger."""

    cpu: str
    """As LLVM calls it; the file of its code is named by it."""
    features: str = ""
    """What LLVM is told besides."""
    needs: frozenset[str] = frozenset()
    """Features that a CPU must have, as LLVM calls them."""


class Platform(NamedTuple):
    """An operating system on a kind of CPU, for which there is a wheel."""

    triple: str
    """As LLVM calls it; the first part and the system count."""
    tag: str
    """Of the wheel."""
    levels: tuple[Level, ...]
    """The best first."""
    suffix: str
    """Of a shared library."""

    def targets(self) -> list[Target]:
        """Return what its code is compiled for, a target for each level."""
        return [Target(self.triple, level.cpu, level.features) for level in self.levels]


V2 = frozenset(["cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"])
V3 = V2 | frozenset(["avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"])
V4 = V3 | frozenset(["avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"])
"""Features of x86-64's levels, by its psABI."""

X86_64 = (
    # AMD's CPUs gather slowly, as do Intel's with the microcode of 2023.
    Level("x86-64-v4", "+avx512vl,+prefer-no-gather", V4),
    Level("x86-64-v3", needs=V3),
    Level("x86-64-v2", needs=V2),
)
AARCH64 = (Level("generic"),)
"""ARMv8.0, with the vectors of 128 bits that all have."""

LEVELS = {"x86_64": X86_64, "aarch64": AARCH64}
"""By the kind of CPU, the best first."""

PLATFORMS = {
    "x86_64": Platform(
        "x86_64-unknown-linux-gnu", "manylinux2014_x86_64.manylinux_2_17_x86_64", X86_64, ".so"
    ),
    "aarch64": Platform(
        "aarch64-unknown-linux-gnu", "manylinux2014_aarch64.manylinux_2_17_aarch64", AARCH64, ".so"
    ),
    "win_amd64": Platform("x86_64-pc-windows-msvc", "win_amd64", X86_64, ".dll"),
    "macos_arm64": Platform("arm64-apple-macosx11.0", "macosx_11_0_arm64", AARCH64, ".dylib"),
    # Hardly any Mac has AVX-512, and none shows it before it is used.
    "macos_x86_64": Platform("x86_64-apple-macosx11.0", "macosx_11_0_x86_64", X86_64[1:], ".dylib"),
}
"""By the name that ``RASTERJIT_PLATFORMS`` has for it."""

SYSTEMS = {"linux": "linux", "windows": "windows", "darwin": "macos", "macosx": "macos"}
"""By what triples call them."""

CHOICES = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
"""Environment variables that ask for another CPU than this machine's."""


def _hold_llvm_over_forks() -> None:
    """Let forks wait for calls of LLVM in other threads."""
    from llvmlite.binding import ffi

    # Not before: builds of wheels read `PLATFORMS` where the package is not installed.
    from rasterjit import forks

    # llvmlite has no public name for its lock.
    held = getattr(getattr(ffi.lib, "_lock", None), "_lock", None)
    if held is not None:
        forks.hold_over_forks(held)


@functools.cache
def host() -> Target:
    """
    Return this machine, or what ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` ask for.

    Features that are not asked for may end with a preference of ours. A level without features is
    what wheels are made for.
    """
    from llvmlite import binding

    _hold_llvm_over_forks()
    triple = process_triple()
    chosen, features = (os.environ.get(name) for name in CHOICES)
    level = _level_named(triple, chosen)
    if level is not None and not features:
        return Target(triple, level.cpu, level.features)
    cpu = chosen or binding.get_host_cpu_name()
    if features is None:
        features = "" if cpu == "generic" else binding.get_host_cpu_features().flatten()
        if cpu.startswith("znver"):
            # AMD's CPUs gather more slowly than they load one by one: a seventh of shading.
            features += ",+prefer-no-gather"
    return Target(triple, cpu, features)


def platform_of(triple: str) -> Platform | None:
    """Return the platform of a triple; None if no wheel is made for it."""
    wanted = parts_of(triple)
    return next((one for one in PLATFORMS.values() if parts_of(one.triple) == wanted), None)


def parts_of(triple: str) -> tuple[str, str]:
    """Return the kind of CPU and the system of a triple, by names of ours."""
    kind, *rest = re.sub(r"[\d.]+$", "", triple).split("-")
    system = next((SYSTEMS[part] for part in rest if part in SYSTEMS), "")
    return ("aarch64" if kind == "arm64" else kind), system


def needs_far_addresses(triple: str) -> bool:
    """
    Tell whether code is linked by addresses of 64 bits: on Linux and on Windows of x86-64.

    ARM's Windows cannot relocate them in object files; macOS has its own rules.
    """
    return platform_of(triple) is not None and parts_of(triple)[1] != "macos"


def process_triple() -> str:
    """Return the triple of this process, without macOS's version: an update changes no code."""
    from llvmlite import binding

    return re.sub(r"(darwin|macosx)[\d.]+", r"\1", binding.get_process_triple())


def _level_named(triple: str, cpu: str | None) -> Level | None:
    platform = platform_of(triple)
    levels = () if platform is None else platform.levels
    return next((level for level in levels if level.cpu == cpu), None)


def asked_cpu() -> str | None:
    """
    Return the CPU that the environment asks code for; an empty name for this machine's.

    None if it asks for features besides: no wheel has code for these.
    """
    cpu, features = (os.environ.get(name) for name in CHOICES)
    if features or (features is not None and not cpu):
        return None
    return cpu or ""


def level_here() -> tuple[str, Level] | None:
    """Return the kind of this CPU and its best level, or the one that the environment asks for."""
    from llvmlite import binding

    kind, asked = parts_of(process_triple())[0], asked_cpu()
    has = {name for name, is_here in binding.get_host_cpu_features().items() if is_here}
    for level in LEVELS.get(kind, ()):
        if level.cpu == asked or (asked == "" and level.needs <= has):
            return kind, level
    return None


class _Compiling(threading.local):
    """What this thread compiles for."""

    target: Target | None = None


_COMPILING = _Compiling()


@contextmanager
def compiling_for(target: Target) -> Iterator[None]:
    """Let `current` be another target than this machine."""
    before, _COMPILING.target = _COMPILING.target, target
    try:
        yield
    finally:
        _COMPILING.target = before


def current() -> Target:
    """Return what this thread compiles for."""
    return _COMPILING.target or host()
