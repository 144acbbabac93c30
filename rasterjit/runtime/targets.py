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
    """A machine that code is compiled for."""

    triple: str
    cpu: str
    features: str


class Level(NamedTuple):
    """A set of CPU features that code may use."""

    cpu: str
    """LLVM's name of the CPU; also the name of the library."""
    features: str = ""
    """Further features and preferences, for LLVM."""
    needs: frozenset[str] = frozenset()
    """Features that a CPU must have, by LLVM's names."""


class Platform(NamedTuple):
    """An operating system on a kind of CPU, for which there is a wheel."""

    triple: str
    """LLVM's name; only the first part and the system count."""
    tag: str
    """Of the wheel."""
    levels: tuple[Level, ...]
    """The best first."""
    suffix: str
    """Of a shared library."""

    def targets(self) -> list[Target]:
        """Return a target for each level."""
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
    "win_arm64": Platform("aarch64-pc-windows-msvc", "win_arm64", AARCH64, ".dll"),
    "macos_arm64": Platform("arm64-apple-macosx11.0", "macosx_11_0_arm64", AARCH64, ".dylib"),
    # Hardly any Mac has AVX-512, and none shows it before it is used.
    "macos_x86_64": Platform("x86_64-apple-macosx11.0", "macosx_11_0_x86_64", X86_64[1:], ".dylib"),
}
"""By the name that ``RASTERJIT_PLATFORMS`` has for it."""

SYSTEM_NAMES = {"linux": "linux", "windows": "windows", "darwin": "macos", "macosx": "macos"}
"""Our names of systems, by the words in triples."""

CPU_VARIABLES = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
"""Environment variables that request another CPU than this machine's."""


def _hold_llvm_over_forks() -> None:
    """Let forks wait for other threads' calls of LLVM."""
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
    Return this machine's target, or what ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` request.

    Detected features may end with a preference of ours. A level's name without features stands for
    the target of wheels.
    """
    from llvmlite import binding

    _hold_llvm_over_forks()
    triple = process_triple()
    requested, features = (os.environ.get(name) for name in CPU_VARIABLES)
    level = _find_level(triple, requested)
    if level is not None and not features:
        return Target(triple, level.cpu, level.features)
    cpu = requested or binding.get_host_cpu_name()
    if features is None:
        features = "" if cpu == "generic" else binding.get_host_cpu_features().flatten()
        if cpu.startswith("znver"):
            # AMD's CPUs gather more slowly than they load one by one: a seventh of shading.
            features += ",+prefer-no-gather"
    return Target(triple, cpu, features)


def find_platform(triple: str) -> Platform | None:
    """Return the platform of a triple; None if no wheel is made for it."""
    parts = split_triple(triple)
    return next((each for each in PLATFORMS.values() if split_triple(each.triple) == parts), None)


def split_triple(triple: str) -> tuple[str, str]:
    """Return our names of the CPU and the system of a triple."""
    kind, *rest = re.sub(r"[\d.]+$", "", triple).split("-")
    system = next((SYSTEM_NAMES[part] for part in rest if part in SYSTEM_NAMES), "")
    return ("aarch64" if kind == "arm64" else kind), system


def needs_far_addresses(triple: str) -> bool:
    """
    Tell whether code needs 64-bit addresses: on Linux, and on x86-64 Windows.

    ARM's Windows cannot relocate them in object files; macOS has its own rules.
    """
    kind, system = split_triple(triple)
    return (kind in LEVELS and system == "linux") or (kind, system) == ("x86_64", "windows")


def process_triple() -> str:
    """Return the triple of this process, without macOS's version: an update changes no code."""
    from llvmlite import binding

    return re.sub(r"(darwin|macosx)[\d.]+", r"\1", binding.get_process_triple())


def _find_level(triple: str, cpu: str | None) -> Level | None:
    platform = find_platform(triple)
    levels = () if platform is None else platform.levels
    return next((level for level in levels if level.cpu == cpu), None)


def requested_cpu_name() -> str | None:
    """
    Return the CPU that the environment requests; an empty name for this machine's.

    None if it also requests features: no wheel has code for these.
    """
    cpu, features = (os.environ.get(name) for name in CPU_VARIABLES)
    if features or (features is not None and not cpu):
        return None
    return cpu or ""


def find_host_levels() -> tuple[str, list[Level]]:
    """Return the kind of this CPU and its levels, best first, or the one that is requested."""
    from llvmlite import binding

    kind, requested = split_triple(process_triple())[0], requested_cpu_name()
    features = {name for name, has in binding.get_host_cpu_features().items() if has}
    return kind, [
        level for level in LEVELS.get(kind, ())
        if level.cpu == requested or (requested == "" and level.needs <= features)
    ]  # fmt: skip


class _ThreadTarget(threading.local):
    """The target of this thread's compilation."""

    target: Target | None = None


_THREAD_TARGET = _ThreadTarget()


@contextmanager
def compiling_for(target: Target) -> Iterator[None]:
    """Let `current_target` return a target, in this thread, within a ``with`` block."""
    before, _THREAD_TARGET.target = _THREAD_TARGET.target, target
    try:
        yield
    finally:
        _THREAD_TARGET.target = before


def current_target() -> Target:
    """Return the target that this thread compiles for."""
    return _THREAD_TARGET.target or host()
