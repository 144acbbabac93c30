"""The numbers of all hard cases, by stage; every one of them must be held by a test."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

STAGES = {
    "R": ("coverage and the fill rule", 19),
    "D": ("degenerate, sliver, huge and non-finite faces", 16),
    "C": ("clipping and cameras", 24),
    "L": ("lines", 25),
    "O": ("points", 16),
    "Z": ("depth and visibility", 16),
    "I": ("interpolation", 10),
    "T": ("textures", 11),
    "K": ("colour, gamma and blending", 14),
    "N": ("normals and lighting", 9),
    "S": ("shadows", 6),
    "M": ("samples and analytic coverage", 10),
    "P": ("platform traps", 8),
    "W": ("segments with a width", 17),
    "G": ("effects that are not called for", 12),
}
"""What each letter stands for, and how many cases it has."""

IDS = [f"{letter}{n:02}" for letter, (_, count) in STAGES.items() for n in range(1, count + 1)]


def cases(names: Iterable[str]) -> list:
    """Return names of a table's rows as parameters that hold the cases their names begin with."""
    marks = {name: [pytest.mark.case(n) for n in name.split()[:1] if n in IDS] for name in names}
    return [pytest.param(name, id=name, marks=marks[name]) for name in marks]
