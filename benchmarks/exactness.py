"""
What promises cost: RasterJIT beside itself without one of them.

Exact coverage and an order that repeats, against float edge functions and vertices in any order;
float64 vertices, against float32; reversed depth, against standard depth. And what checking every
index would cost, which the tests do so that no picture has to.
"""

from __future__ import annotations

from dataclasses import replace

from benchmarks.against_peers import OWN, Options, planned
from benchmarks.pairing import measure
from benchmarks.pictures import USUAL
from benchmarks.rows import Row, check_picture, find_run, row_of
from benchmarks.scenes import find_scene
from benchmarks.targets import EXACTNESS

SCENES = {
    "visibility_1m": "exact coverage and order, 1 M triangles",
    "visibility_fill_back_to_front": "exact coverage and order, 20 quads back to front",
    "visibility_fill_front_to_back": "exact coverage and order, 20 quads front to back",
}

PROMISES = {
    "single_vertices": ("float64 vertices, 1 M triangles", "float64 vertices cost {:+.1f} %"),
    "standard_depth": ("reversed depth, 1 M triangles", "reversed depth costs {:+.1f} %"),
    "checked_bounds": ("checked bounds, 1 M triangles", "checking them would cost {:+.1f} %"),
}
"""Contestants that break another promise, with the title and the price of their row."""

PROMISED = "mesh_1m"
"""The scene that they draw."""

MORE_ROUNDS = 3
"""Times as many rounds as for other rows: a few percent want more of them than a factor does."""


def measure_exactness(options: Options) -> list[Row]:
    """Time RasterJIT with exact and with float edge functions."""
    effort = replace(
        options.effort,
        rounds=MORE_ROUNDS * options.effort.rounds,
        seconds=MORE_ROUNDS * options.effort.seconds,
    )
    rows = []
    for name, title in SCENES.items():
        scene = find_scene(name)
        runs = [
            planned(key, name, scene, threads)
            for threads in options.threads
            for key in ("rasterjit", "float_edges")
        ]
        measure(runs, effort)
        for run in runs:
            note = check_picture(run, runs[0], USUAL)
            row = row_of(title, run, note, find_run(runs, OWN, run.entry.threads))
            if row.ratio is not None:
                row.aim_above(row.ratio, EXACTNESS)
                row.rate = f"both cost {100 / row.ratio - 100:+.1f} %"
            rows.append(row)
    return rows + measure_promises(replace(options, effort=effort))


def measure_promises(options: Options) -> list[Row]:
    """Time RasterJIT and those that break one promise each."""
    scene = find_scene(PROMISED)
    runs = [
        planned(key, PROMISED, scene, threads)
        for threads in options.threads
        for key in (OWN, *PROMISES)
    ]
    measure(runs, options.effort)
    rows = []
    for run in runs:
        key = run.entry.contestant
        note = check_picture(run, runs[0], USUAL)
        title, price = PROMISES.get(key, (f"promises, {scene.work / 1e6:.0f} M triangles", ""))
        row = row_of(title, run, note, find_run(runs, OWN, run.entry.threads))
        if row.ratio is not None and key == "checked_bounds":
            row.rate = price.format(100 * row.ratio - 100)
        elif row.ratio is not None and key != OWN:
            row.rate = price.format(100 / row.ratio - 100)
        rows.append(row)
    return rows
