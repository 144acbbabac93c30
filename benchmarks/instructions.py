"""
The sets of instructions that benchmarks run under: what the CPU has, and AVX2 alone.

Each is environment variables of a process, which must start with them.

RasterJIT compiles for what ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` name. A name alone does
not do: this CPU's features are then added. Here they are what this CPU has, less AVX-512 and what
came after it, and the preference that `rasterjit.runtime.store` has for AMD.

Mesa's llvmpipe takes vectors of 256 bits on its own on a CPU with AVX-512 as well, but fills them
with AVX-512's instructions (masks, registers from 16 on: seen in its machine code).
``GALLIUM_OVERRIDE_CPU_CAPS=avx`` takes AVX-512, and nothing else, away from it.
``LP_NATIVE_VECTOR_WIDTH`` is the width alone; 512 makes Mesa 22.3 crash, and a shader that was kept
on disk for one width serves all.

What is compiled ahead (tinydisplay, NumPy, the C library) chooses for itself, in both sets alike.
"""

from __future__ import annotations

import functools
import platform

NATIVE, AVX2 = "native", "avx2"
SETS = (NATIVE, AVX2)

LATER = ("avx512", "avx10", "evex512", "amx")
"""How features begin that a CPU with AVX2 alone lacks."""
NO_GATHER = "+prefer-no-gather"


@functools.cache
def features() -> dict[str, bool]:
    """Return what LLVM says this CPU has."""
    from llvmlite import binding

    return dict(binding.get_host_cpu_features())


def name_of(instructions: str) -> str:
    """Return what to call a set of instructions in print, on this machine."""
    if instructions == AVX2 or not has_avx512():
        return "AVX2" if features().get("avx2") else platform.machine()
    return "AVX-512"


def has_avx512() -> bool:
    """Return whether this CPU has AVX-512."""
    return bool(features().get("avx512f"))


def missing(instructions: str) -> str | None:
    """Return why a set is left out on this machine, or ``None``."""
    if instructions == NATIVE or has_avx512():
        return None
    return f"this CPU has no AVX-512: {name_of(NATIVE)} is all that it is measured with"


def environment(instructions: str) -> dict[str, str]:
    """Return the environment variables of a process that is held to a set of instructions."""
    if instructions == NATIVE:
        return {}
    from llvmlite import binding

    is_amd = binding.get_host_cpu_name().startswith("znver")
    parts = [
        f"{'+' if has and not name.startswith(LATER) else '-'}{name}"
        for name, has in sorted(features().items())
    ]
    return {
        "NUMBA_CPU_NAME": "znver3" if is_amd else "haswell",
        "NUMBA_CPU_FEATURES": ",".join(parts + [NO_GATHER] * is_amd),
        "GALLIUM_OVERRIDE_CPU_CAPS": "avx",
        "LP_NATIVE_VECTOR_WIDTH": "256",
    }
