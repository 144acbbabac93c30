"""RasterJIT beside its peers: every scene, every contestant, one thread and several."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.contestants import MODULES, contestant
from benchmarks.pairing import (
    ROOT,
    Effort,
    Entry,
    Run,
    measure,
    package_environment,
    paired_ratio,
)
from benchmarks.pictures import EXACT, needed
from benchmarks.report import processors
from benchmarks.rows import LEFT_OUT, MISSING, UNABLE, Row, check_picture, find_run, rate, row_of
from benchmarks.scenes import Scene, find_scene
from benchmarks.targets import OPENGL, PEERS, SCALED, SCALING, TINYDISPLAY

TITLES = {
    "fill_back_to_front": "20 smooth quads, 1920x1080, back to front",
    "fill_front_to_back": "20 smooth quads, 1920x1080, front to back",
    "mesh_70k": "70 k faces, 1280x720",
    "mesh_70k_phong": "70 k faces, Phong per pixel",
    "mesh_1m": "1 M faces, 1920x1080",
    "scalars_1m": "1 M faces, a colour map",
    "mesh_5m": "5 M faces, 1920x1080",
    "visibility_1m": "1 M faces, face numbers only",
    "slivers": "200 k slivers",
    "short_lines": "1 M lines of 50 pixels",
    "long_lines": "20 k lines of 800 pixels",
    "small_images": "images of 128x128, 5 k faces",
    "wireframe": "wireframe of 70 k faces",
    "instances_10k": "10 k instances of 100 faces",
    "culled": "1 M faces, 96 % culled",
}
"""The scenes of the table, and what it calls them."""

QUICK_SCENES = {"small_images": "small_images_quick"}
"""Smaller scenes of the same kind, for a quick run."""

OWN = "rasterjit"

THREADED = (OWN, OPENGL, "opengl_color", "lavapipe")
"""Contestants that are asked for several numbers of threads; the others draw with one."""

MAIN = (OWN, OPENGL, TINYDISPLAY)
"""Those that targets are about: they take part in more rounds, and in quick runs."""
OTHERS_PATIENCE = 0.25

ELSEWHERE = (
    "float_edges", "single_vertices", "standard_depth", "checked_bounds", "numpy", "pure_python",
    "full_screen", "rasterjit_batch",
)  # fmt: skip
"""Contestants with rows of their own."""


@dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    effort: Effort
    threads: tuple[int, ...] = (1, 2)
    quick: bool = False


ASK = """
import json, sys
from benchmarks.contestants import contestant
print(json.dumps([contestant(sys.argv[1]).available()]))
"""
ASK_SECONDS = 60.0


@functools.cache
def unavailable(key: str) -> str | None:
    """
    Return why a contestant cannot draw here at all, or ``None``.

    Asks in a process of its own: what a driver starts, or breaks, must not stay in this one.
    """
    try:
        result = subprocess.run(
            [sys.executable, "-c", ASK, key],
            capture_output=True, text=True, check=True, cwd=ROOT,
            env=package_environment({}), timeout=ASK_SECONDS,
        )  # fmt: skip
    except subprocess.SubprocessError as error:
        return f"{MISSING}: {error}"
    (reason,) = json.loads(result.stdout.splitlines()[-1])
    return None if reason is None else f"{MISSING}: {reason}"


def planned(key: str, name: str, scene: Scene, threads: int = 1) -> Run:
    """Return the run of an entry, with the reason if the contestant cannot draw the scene."""
    run = Run(Entry(key, name, threads), unavailable(key))
    if run.missing is None:
        reason = contestant(key).draws(scene)
        run.missing = None if reason is None else f"{UNABLE}: {reason}"
    return run


def entrants(name: str, scene: Scene, options: Options) -> list[Run]:
    """Return the runs of all contestants on a scene: with one thread, then with more."""
    runs = []
    for count in options.threads:
        for key in MODULES:
            if key in ELSEWHERE or (count > 1 and key not in THREADED):
                continue
            run = planned(key, name, scene, count)
            if key not in MAIN:
                run.patience = OTHERS_PATIENCE
                run.missing = LEFT_OUT if options.quick and not run.missing else run.missing
            runs.append(run)
    return runs


def check_pictures(runs: Sequence[Run], scene: Scene) -> list[str]:
    """
    Compare RasterJIT's picture with OpenGL's and all others with RasterJIT's, or else OpenGL's.

    With any number of threads RasterJIT's must be the same bits. Returns what to print about each.
    """
    threads = min((run.entry.threads for run in runs), default=1)
    own, opengl = find_run(runs, OWN, threads), find_run(runs, OPENGL, threads)
    own_note = ""
    if own is not None:
        has_judge = opengl is not None and opengl.missing is None
        judge = opengl if has_judge else own
        own_note = check_picture(own, judge, needed(scene, contestant(OPENGL)))
    reference = own if own is not None and own.missing is None else opengl
    notes = []
    for run in runs:
        key = run.entry.contestant
        least = EXACT if key == OWN else needed(scene, contestant(key))
        notes.append(own_note if run is own else check_picture(run, reference, least))
    return notes


def scaling_row(title: str, runs: Sequence[Run], key: str, threads: int) -> Row | None:
    """Return how many times faster several threads of a contestant are than one."""
    found = {run.entry.threads: run for run in runs if run.entry.contestant == key}
    one, more = found.get(1), found.get(threads)
    if one is None or more is None or one.missing or more.missing:
        return None
    note = "" if processors() >= threads else f"only {processors()} processor here"
    row = row_of(f"{title}: 1 to {threads} threads", more, note)
    row.gain = paired_ratio(one, more)
    row.rate = f"{row.gain:.2f}x as fast as one thread"
    return row


def measure_scene(title_key: str, options: Options) -> list[Row]:
    """Time all contestants on a scene, and how they gain by threads."""
    name = QUICK_SCENES.get(title_key, title_key) if options.quick else title_key
    scene, title = find_scene(name), TITLES[title_key]
    runs = measure(entrants(name, scene, options), options.effort)
    notes = check_pictures(runs, scene)
    rows = []
    for run, note in zip(runs, notes, strict=True):
        row = row_of(title, run, note, find_run(runs, OWN, run.entry.threads))
        if row.ms is not None:
            row.rate = rate(scene.work, scene.unit, row.ms)
        target = PEERS.get((title_key, run.entry.contestant))
        if target is not None:
            row.aim_above(row.ratio, target)
        rows.append(row)
    return rows + scaling_rows(title_key, runs, options.threads)


def scaling_rows(title_key: str, runs: Sequence[Run], threads: Sequence[int]) -> list[Row]:
    """Return the gain by threads of RasterJIT and OpenGL; the target is for two threads."""
    rows = []
    for count in threads:
        for key in (OWN, OPENGL) if count > 1 else ():
            row = scaling_row(TITLES[title_key], runs, key, count)
            if row is None:
                continue
            if title_key in SCALED and key == OWN and count == 2:
                row.aim_above(row.gain, SCALING)
            rows.append(row)
    return rows
