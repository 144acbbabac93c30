"""Everything that ``python -m benchmarks`` measures, by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from benchmarks.against_peers import TITLES, Options, measure_scene
from benchmarks.against_python import measure_python
from benchmarks.costs import FRAMES_LAST, measure_costs_of_memory, measure_startup
from benchmarks.exactness import measure_exactness
from benchmarks.pairing import Effort
from benchmarks.rows import Row

FULL, QUICK = Effort(9, 8.0), Effort(3, 2.0)
"""Rounds, and seconds for each contestant of a scene."""

OTHERS = ("python", "exactness", "startup", "memory")


def marks(frames: int = FRAMES_LAST) -> dict[str, Callable[[Options], list[Row]]]:
    """Return what measures each part of the table; ``frames`` are drawn for the memory rows."""
    found: dict[str, Callable[[Options], list[Row]]] = {
        name: partial(measure_scene, name) for name in TITLES
    }
    return {
        **found,
        "python": measure_python,
        "exactness": measure_exactness,
        "startup": measure_startup,
        "memory": partial(measure_costs_of_memory, frames=frames),
    }
