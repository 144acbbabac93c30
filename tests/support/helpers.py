"""Call helpers of kernels from Python, compiled as kernels are: one module, optimized once."""

from __future__ import annotations

import numba

from rasterjit.runtime import compiler, numba_internals, targets
from rasterjit.runtime.jit import Helper


def around(helper: Helper):
    """
    Return a function that calls a helper.

    Stock Numba makes machine code of every function that a helper calls, and again for each that
    calls those: twice the time, and most of it is spent before a test begins.
    """
    whole = {"pipeline_class": numba_internals.WHOLE, **compiler.OPTIONS}
    inner = numba.njit(**whole)(compiler.with_instructions(helper.function))

    @numba.njit(**compiler.OPTIONS)
    def call(*given):
        return inner(*given)

    def run(*given):
        before, compiler._WAY.target = compiler._WAY.target, targets.host()
        try:
            return call(*given)
        finally:
            compiler._WAY.target = before

    return run


def call(helper: Helper, *arguments):
    """Run a helper: in place of `Helper.__call__`."""
    if helper._around is None:
        helper._around = around(helper)
    return helper._around(*arguments)
