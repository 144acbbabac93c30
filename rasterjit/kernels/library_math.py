"""
Powers by the math library of the machine, for who asks for them: ``Quality(math="library")``.

In float64, so that rounding to float32 is all that is lost. A math library rounds as it likes: the
last bit may differ from one machine to the next. Nothing else of the kernels calls one.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import stage

LARGEST_EXPONENT = 126.0
"""Exponents of 2 are held within it, as those of the engine's own: no power is infinite."""


@stage
def library_exp2(x):
    """Return 2**x of a float32 in [-126, 126]; below, 2**-126; float32."""
    held = max(min(np.float64(x), LARGEST_EXPONENT), -LARGEST_EXPONENT)
    return np.float32(np.exp2(held))


@stage
def library_power(x, exponent):
    """Return x**exponent for x in [0, 1] and exponent > 0, float32."""
    return np.float32(np.power(np.float64(x), np.float64(exponent)))
