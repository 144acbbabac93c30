"""
What the machine code of kernels shows: fused operations, math functions, registers of vectors.

An entry of the store has no assembly, so `look_at` compiles once more, in processes of its own,
which run this file.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from strict import STRICT

from rasterjit.runtime.threads import available_processors

ROOT = Path(__file__).parents[2]

FUSED = re.compile(
    # x86, with the order of its operands.
    r"\bv?fn?m(?:add|sub)(?:add|sub)?(?:132|213|231)?[ps][sdh]\b"
    # ARM: numbers, vectors of NEON, those of SVE, and the steps to a quotient or a root.
    r"|\bfn?m(?:add|sub|ad|sb|l[as](?:l[bt]?2?)?)\b|\bfcmla\b|\bb?fmmla\b|\bbf(?:dot|ml[as]l?[bt]?)\b"
    r"|\bfr(?:ecp|sqrt)s\b|\bftmad\b"
)
"""A product and a sum in one instruction, on x86 or ARM."""

ESTIMATED = re.compile(
    r"\bv?r(?:cp|sqrt)(?:14|28)?[ps][sdh]\b|\bv?exp2[ps][sd]\b"
    r"|\b[fu]r(?:ecp|sqrt)e\b|\bfrecpx\b|\bfexpa\b"
)
"""An estimate, whose bits are the maker's affair, on x86 or ARM."""

MATH = [
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "exp2",
    "expm1", "log", "log2", "log10", "log1p", "pow", "powi", "cbrt", "hypot", "fma", "sincos",
    "fmod",
]  # fmt: skip
CALLED_MATH = re.compile(
    r"(?:__svml_|_ZGV|amd_vr|npy_|numba_)?\b_*(?:" + "|".join(MATH) + r")[fl]?\d*(?:_\w+)?$"
)
"""A function of a math library, of its vector version, or of Numba's own."""

CALL = re.compile(r"^\s+(?:callq?|jmpq?|bl?)\s+\*?(?:\[?rip \+ )?([A-Za-z_.][\w.$]*)")
ADDRESS = re.compile(
    r"\bmovabsq?\s+\$([A-Za-z_.][\w.$]*)|\b([A-Za-z_.][\w.$]*)@GOT"
    r"|^\s+adrp\s+\w+, ([A-Za-z_.][\w.$]*)|:(?:got|got_lo12|lo12|abs_g3):([A-Za-z_.][\w.$]*)"
)
"""Where code of x86 or ARM names a function: it calls it, or loads its address first."""

WIDTHS = {
    "xmm": r"%xmm", "ymm": r"%ymm", "zmm": r"%zmm",
    "neon": r"\bv\d+\.(?:16b|8h|4s|2d)\b|\bq\d+\b", "sve": r"\bz\d+\.[bhsdq]\b|\bz\d+\b",
}  # fmt: skip
"""Vector registers: of x86, 128, 256 and 512 bits; of ARM, 128 bits and as many as there are."""


def names_called(assembly):
    """Return the functions that the assembly names as something to call."""
    found = set()
    for line in assembly.splitlines():
        found.update(CALL.findall(line))
        found.update(name for names in ADDRESS.findall(line) for name in names if name)
    return found


def cpu_dependent(assembly):
    """Return the fused operations, the estimates and the math functions in the assembly."""
    found = {*FUSED.findall(assembly), *ESTIMATED.findall(assembly)}
    return sorted(found) + sorted(
        name for name in names_called(assembly) if CALLED_MATH.match(name)
    )


class Form(NamedTuple):
    """What the machine code of a form of a kernel shows."""

    kernel: str
    types: str
    dependent: list[str]
    """What depends on the CPU, by `cpu_dependent`."""
    vectors: dict[str, int]
    """How often the assembly names vector registers of each kind."""
    needed: list[str]
    """What the object code calls."""


def vectors_used(assembly):
    """Return how often the assembly names vector registers of each kind."""
    return {kind: len(re.findall(pattern, assembly)) for kind, pattern in WIDTHS.items()}


def look_at(target=None, some=(), model="", libraries=()):
    """
    Compile kernels, and return what the code of all their forms shows, and the kernels' names.

    Parameters
    ----------
    target : Target or None
        What to compile for; None takes this machine.
    some : sequence of str
        Full names of kernels.
    model : str
        A file: kernels that drawing it needs are looked at, too. Without both, all are.
    libraries : sequence of Target
        Look at the code for shared libraries of these, of the target's CPU, instead.
    """
    # The compiler holds Python's lock: a process for each core.
    count = 1 if some or model else available_processors()
    asked = [json.dumps([target, some, model, libraries, part, count]) for part in range(count)]
    started = [
        subprocess.Popen(
            [sys.executable, *STRICT, __file__, one], stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests' / 'support'}"},
        )
        for one in asked
    ]  # fmt: skip
    said = [one.communicate()[0] for one in started]
    assert [one.returncode for one in started] == [0] * count
    parts = [json.loads(one) for one in said]
    names = [name for part, _ in parts for name in part]
    return names, [Form(*form) for _, part in parts for form in part]


def main(target, some, model, libraries, part, count):
    """Print what `look_at` returns, of every kernel whose number leaves a remainder."""
    from importlib import import_module

    from kernel_files import kernel_modules

    import rasterjit as rj
    from rasterjit.cli import shared_libraries
    from rasterjit.runtime import (
        code_generation,
        compiler,
        jit,
        pack_arguments,
        stage_runner,
        store,
    )

    target = store.Target(*target) if target else store.host()
    if model:
        rj.render(rj.load(model), size=(32, 24), threads=1)
    used = {*store.USED_KERNELS.loaded, *store.USED_KERNELS.compiled, *some}
    for name in kernel_modules():
        import_module(name)
    every = (stage_runner.run_list, pack_arguments.pack, *jit.KERNELS, *jit.STAGES)
    asked = [one for one in every if not used or store.qualified_name(one) in used][part::count]
    libraries = [store.Target(*one) for one in libraries]
    forms = []
    for one in asked:
        for kind in one.declared:
            _, module = compiler.lower_to_llvm(one, kind, one.__name__, target)
            made = [
                (
                    shared_libraries.machine_of(system),
                    shared_libraries.module_for(str(module), one.__name__, system),
                )
                for system in libraries
            ] or [(code_generation.target_machine(target), module)]
            for machine, code in made:
                needed = sorted(shared_libraries.needed_symbols(machine.emit_object(code)))
                assembly = machine.emit_assembly(code)
                assert one.__name__ in assembly
                dependent, vectors = cpu_dependent(assembly), vectors_used(assembly)
                forms.append(Form(one.__name__, str(kind), dependent, vectors, needed))
    print(json.dumps([[one.__name__ for one in asked], forms]))


if __name__ == "__main__":
    main(*json.loads(sys.argv[1]))
