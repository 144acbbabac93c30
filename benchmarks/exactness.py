"""What being exact costs: the same stages with float edge functions and lists in any order."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.against_peers import OWN, Options, planned
from benchmarks.pairing import measure
from benchmarks.pictures import USUAL
from benchmarks.rows import Row, check_picture, find_run, row_of
from benchmarks.scenes import find_scene
from benchmarks.targets import EXACTNESS

SCENES = {
    "visibility_1m": "exact coverage, 1 M triangles",
    "visibility_fill_back_to_front": "exact coverage, 20 quads back to front",
    "visibility_fill_front_to_back": "exact coverage, 20 quads front to back",
}

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
                row.rate = f"being exact costs {100 / row.ratio - 100:+.1f} %"
            rows.append(row)
    return rows
