"""The slow, obvious twin of mixing in 8-bit sRGB codes: fractions, one colour after the other."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from rasterjit.inspect import oracle
from rasterjit.scene.color import linear_to_srgb

CLEAR = (0, 0, 0, 0)


def coded(color):
    """Return the codes of a linear colour with alpha, each rounded half up."""
    encoded = linear_to_srgb(np.asarray(color[:3], np.float32)).tolist()
    alpha = min(max(Fraction(float(np.float32(color[3]))), Fraction(0)), Fraction(1))
    return tuple(oracle.round_half_up(Fraction(255 * value)) for value in (*encoded, alpha))


def over(front, behind):
    """Return codes with straight alpha over others, by Porter and Duff, each rounded half up."""
    alpha, under = Fraction(front[3], 255), Fraction(behind[3], 255)
    total = alpha + (1 - alpha) * under
    if total == 0:
        return behind
    mixed = [
        (alpha * own + (1 - alpha) * under * other) / total
        for own, other in zip(front[:3], behind[:3], strict=True)
    ]
    return tuple(oracle.round_half_up(value) for value in (*mixed, 255 * total))


def laid(codes, background):
    """Return codes, the nearest first, laid over a background from the farthest on."""
    seen = background
    for code in reversed(codes):
        seen = over(code, seen)
    return seen


def mean(codes):
    """Return the mean of codes: of what each shows, and of alpha; each rounded half up."""
    total = sum(code[3] for code in codes)
    if total == 0:
        return CLEAR
    mixed = [Fraction(sum(code[3] * code[k] for code in codes), total) for k in range(3)]
    return tuple(oracle.round_half_up(value) for value in (*mixed, Fraction(total, len(codes))))
