"""RasterJIT beside plain Python and NumPy, on parts of scenes that those can draw in time."""

from __future__ import annotations

import statistics

from benchmarks.against_peers import Options, planned
from benchmarks.pairing import Run, measure, paired_ratios
from benchmarks.pictures import EXACT
from benchmarks.rows import Row, check_picture, row_of
from benchmarks.scenes import find_scene
from benchmarks.targets import PYTHON_LINES, PYTHON_TRIANGLES, Target

PAIRS = (
    ("1 depth-tested sample of a fill", "visibility_fill_back_to_front", "fill_sample"),
    ("1 pixel with 400 triangles", "filled", "filled_sample"),
    ("1 of a million triangles", "visibility_1m", "visibility_sample"),
    ("1 fifty-pixel line", "short_lines", "short_lines_sample"),
)
"""The scene that RasterJIT draws whole, and the part of it that the others draw."""

TARGETS: dict[str, Target] = {
    "visibility_fill_back_to_front": PYTHON_TRIANGLES,
    "filled": PYTHON_TRIANGLES,
    "visibility_1m": PYTHON_TRIANGLES,
    "short_lines": PYTHON_LINES,
}

PYTHON = "pure_python"
NAMES = ("rasterjit", "numpy", PYTHON, "full_screen")
"""Who draws the sample; plain Python's picture is the reference and all must equal it."""


def measure_pair(title: str, whole: str, sample: str, options: Options) -> list[Row]:
    """Return what one unit of work costs each; RasterJIT's is that of the whole scene."""
    scenes = {name: find_scene(name) for name in (whole, sample)}
    runs = [planned("rasterjit", whole, scenes[whole])]
    runs += [planned(key, sample, scenes[sample]) for key in NAMES]
    measure(runs, options.effort)
    reference = next((run for run in runs[1:] if run.entry.contestant == PYTHON), None)
    notes = [check_picture(run, reference, EXACT) for run in runs[1:]]
    if runs[0].missing is None:
        runs[0].missing = runs[1].missing
    rows = []
    for run, note in zip(runs, (notes[0], *notes), strict=True):
        if run is runs[1]:
            continue
        row = row_of(title, run, note)
        rows.append(row)
        if run.missing is not None or runs[0].missing is not None:
            continue
        describe(row, run, runs[0], scenes[run.entry.scene].work, scenes[whole].work)
        row.rate += f" a {scenes[whole].unit}"
        if run.entry.contestant not in ("rasterjit", "numpy"):
            row.aim_above(row.ratio, TARGETS[whole])
    return rows


def describe(row: Row, run: Run, own: Run, work: int, own_work: int) -> None:
    """Note the cost of a unit, reading back not included, and its ratio to RasterJIT's."""
    each = [seconds / work for seconds in run.draw_seconds]
    own_each = [seconds / own_work for seconds in own.draw_seconds]
    row.rate = f"{1e9 * statistics.median(each):.4g} ns"
    if run is not own:
        row.ratio = statistics.median(paired_ratios(each, own_each))


def measure_python(options: Options) -> list[Row]:
    """Time plain Python and NumPy on every pair of scenes."""
    rows = []
    for title, whole, sample in PAIRS:
        rows += measure_pair(title, whole, sample, options)
    return rows
