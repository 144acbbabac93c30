"""The rows of the first mark: what is timed, against whom, and what it must reach."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.contestants import contestant
from benchmarks.memory import measure_memory
from benchmarks.pairing import Entry, Run, agreement, measure, paired_ratio
from benchmarks.scenes import SCENES
from benchmarks.startup import measure_startup

VISIBILITY_RATIO = 230 / 60
"""60 ms on a core that gives OpenGL's CPU rasterizer 230 ms."""
FILL_RATE = 2.0
"""Depth-tested samples, 1e9 a second."""
LINES_MS = 300.0
CACHED_SECONDS, FIRST_SECONDS = 2.0, 15.0

TRIANGLE_AGREEMENT = 0.999
"""Share of pixels covered alike that a picture of triangles must reach."""
LINE_AGREEMENT = 0.995
"""The same for OpenGL's lines: it leaves out each line's last pixel, by its diamond-exit rule."""

EXACTNESS_COST = 1.10
"""How many times as long as with float edges being exact may take."""
EXACT_AND_FLOAT = ("rasterjit", "float_edges")

EXACTNESS_ROUNDS = 5
"""Times as many rounds as for other rows: a few percent want more of them than a factor does."""

STARTUP_ROUNDS = 5


@dataclass
class Row:
    """One line of the table; what does not apply is ``None``."""

    what: str
    who: str
    threads: int | None = None
    milliseconds: float | None = None
    processor_milliseconds: float | None = None
    """Processor time of all threads, which other programs on the machine disturb less."""
    rate: str = ""
    ratio: float | None = None
    """How many times as long as RasterJIT takes, with the same number of threads."""
    target: str = ""
    met: bool | None = None
    check: str = ""
    """How the picture compares with the reference, or why there is none."""
    rounds: list[float] | None = None
    """Milliseconds of every round."""


@dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    rounds: int
    threads: tuple[int, ...]


def check_pictures(runs: Sequence[Run], reference: Run, needed: float) -> dict[int, str]:
    """
    Compare every picture with the reference; a time whose picture differs is thrown away.

    Returns what to print, by position.
    """
    notes = {}
    for number, run in enumerate(runs):
        if run.missing is not None:
            notes[number] = f"missing: {run.missing}"
            continue
        if run is reference or not reference.picture:
            notes[number] = "reference" if run is reference else "no reference here"
            continue
        shares = agreement(run.picture, reference.picture)
        notes[number] = ", ".join(f"{name} {share:.4%}" for name, share in sorted(shares.items()))
        if shares["covered"] < needed:
            run.missing = f"the picture differs: {notes[number]}"
            notes[number] = run.missing
    return notes


def rows_of(what: str, runs: Sequence[Run], notes: dict[int, str]) -> list[Row]:
    """Return a row for each run, with its ratio to RasterJIT's run with as many threads."""
    rows = []
    for number, run in enumerate(runs):
        row = Row(what, contestant(run.entry.contestant).NAME, run.entry.threads)
        row.check = notes[number]
        rows.append(row)
        if run.missing is not None:
            continue
        row.milliseconds = 1e3 * run.median
        row.processor_milliseconds = 1e3 * statistics.median(run.processor_seconds)
        row.rounds = [1e3 * seconds for seconds in run.seconds]
        for own in runs:
            is_twin = own.entry.threads == run.entry.threads and own.missing is None
            if own.entry.contestant == "rasterjit" and is_twin and own is not run:
                row.ratio = paired_ratio(run, own)
    return rows


def against_opengl(
    what: str, scene: str, peers: Sequence[str], threads: Sequence[int], rounds: int, needed: float
) -> tuple[list[Row], list[Run]]:
    """Time RasterJIT and the peers; OpenGL on one thread is the reference."""
    entries = [Entry(key, scene, n) for n in threads for key in ("rasterjit", *peers)]
    runs = measure(entries, rounds)
    reference = next(run for run in runs if run.entry.contestant == "opengl")
    notes = check_pictures(runs, reference, needed)
    return rows_of(what, runs, notes), runs


def find_row(rows: Sequence[Row], runs: Sequence[Run], key: str, threads: int) -> Row | None:
    """Return the row of a contestant, if it was timed."""
    for row, run in zip(rows, runs, strict=True):
        if run.entry.contestant == key and run.entry.threads == threads and run.missing is None:
            return row
    return None


def visibility(options: Options) -> list[Row]:
    """Time the visibility of a million triangles."""
    peers = ("opengl", "opengl_color")
    rows, runs = against_opengl(
        "1 M triangles, 1920x1080", "visibility_1m", peers, options.threads, options.rounds,
        TRIANGLE_AGREEMENT,
    )  # fmt: skip
    work = SCENES["visibility_1m"]().work
    for row in rows:
        if row.milliseconds:
            row.rate = f"{work / row.milliseconds / 1e3:.1f} M triangles/s"
    row = find_row(rows, runs, "opengl", 1)
    if row is not None and row.ratio is not None:
        row.target, row.met = f">= {VISIBILITY_RATIO:.2f}x", row.ratio >= VISIBILITY_RATIO
    return rows


def fill(options: Options) -> list[Row]:
    """Time twenty full-screen quads in both orders."""
    found = []
    for order in ("back_to_front", "front_to_back"):
        scene = f"fill_{order}"
        rows, runs = against_opengl(
            f"20 full-screen quads, {order.replace('_', ' ')}", scene, ("opengl", "opengl_color"),
            options.threads, options.rounds, TRIANGLE_AGREEMENT,
        )  # fmt: skip
        work = SCENES[scene]().work
        for row in rows:
            if row.milliseconds:
                row.rate = f"{work / row.milliseconds / 1e6:.2f} G samples/s"
        row = find_row(rows, runs, "rasterjit", 1)
        if row is not None and row.milliseconds:
            row.target = f">= {FILL_RATE:g} G samples/s"
            row.met = work / row.milliseconds / 1e6 >= FILL_RATE
        found += rows
    return found


def exactness(options: Options) -> list[Row]:
    """Time the same stages with float edge functions and triangles in any order."""
    found = []
    for what, scene in (
        ("exact coverage, 1 M triangles", "visibility_1m"),
        ("exact coverage, 20 quads back to front", "fill_back_to_front"),
        ("exact coverage, 20 quads front to back", "fill_front_to_back"),
    ):
        entries = [Entry(key, scene, n) for n in options.threads for key in EXACT_AND_FLOAT]
        runs = measure(entries, EXACTNESS_ROUNDS * options.rounds, awake=True)
        notes = check_pictures(runs, runs[0], TRIANGLE_AGREEMENT)
        rows = rows_of(what, runs, notes)
        for row in rows:
            if row.ratio is not None:
                row.target = f">= {1 / EXACTNESS_COST:.2f}x"
                row.met = row.ratio >= 1 / EXACTNESS_COST
                row.rate = f"being exact costs {100 / row.ratio - 100:+.1f} %"
        found += rows
    return found


def lines(options: Options) -> list[Row]:
    """Time a million fifty-pixel lines; RasterJIT draws them in order on one thread."""
    threads = (1,)
    rows, runs = against_opengl(
        "1 M fifty-pixel lines", "short_lines", ("opengl",), threads, options.rounds,
        LINE_AGREEMENT,
    )  # fmt: skip
    for row in rows:
        if row.milliseconds:
            row.rate = f"{SCENES['short_lines']().work / row.milliseconds / 1e3:.2f} M lines/s"
    row = find_row(rows, runs, "rasterjit", 1)
    if row is not None and row.milliseconds is not None:
        row.target, row.met = f"<= {LINES_MS:g} ms", row.milliseconds <= LINES_MS
    return rows


def python(options: Options) -> list[Row]:
    """Time plain Python and NumPy on a part of a scene, and compare the cost of one unit."""
    found = []
    for what, whole, sample in (
        ("1 triangle of the million", "visibility_1m", "visibility_sample"),
        ("1 depth-tested sample of a fill", "visibility_fill_back_to_front", "fill_sample"),
        ("1 fifty-pixel line", "short_lines", "short_lines_sample"),
    ):
        names = ("rasterjit", "numpy", "pure_python")
        runs = measure(
            [Entry("rasterjit", whole), *(Entry(name, sample) for name in names)], options.rounds
        )
        notes = check_pictures(runs[1:], runs[3], 1.0)
        work = [SCENES[run.entry.scene]().work for run in runs]
        unit = SCENES[whole]().unit
        for number, run in enumerate(runs):
            if number == 1:
                continue
            row = Row(what, contestant(run.entry.contestant).NAME, 1)
            row.check = notes[max(number - 1, 0)]
            found.append(row)
            if run.missing is not None:
                continue
            each = [seconds / work[number] for seconds in run.draw_seconds]
            own = [seconds / work[0] for seconds in runs[0].draw_seconds]
            row.rounds = [1e3 * seconds for seconds in run.draw_seconds]
            row.rate = f"{1e9 * statistics.median(each):.4g} ns a {unit}"
            if number:
                row.ratio = statistics.median(a / b for a, b in zip(each, own, strict=True))
    return found


def memory(options: Options) -> list[Row]:
    """Measure the peak memory of a render of the million triangles."""
    found = measure_memory("visibility_1m")
    mega = 1e6
    row = Row("peak memory of a render of 1 M triangles, mesh included", "RasterJIT")
    row.rate = f"{found['peak_over_before'] / mega:.0f} MB"
    row.target = f"<= {found['bound'] / mega:.0f} MB"
    row.met = found["peak_over_before"] <= found["bound"]
    row.check = (
        f"mesh {found['mesh'] / mega:.0f} MB; {found['peak_over_mesh'] / mega:.0f} MB above it"
    )
    return [row]


def startup(options: Options) -> list[Row]:
    """Time the command line in fresh processes."""
    first, cached = measure_startup(min(options.rounds, STARTUP_ROUNDS))
    what = "rasterjit render teapot.obj, 640x480"
    rows = []
    for name, times, limit in (
        ("kernels cached", cached, CACHED_SECONDS),
        ("first ever", [first], FIRST_SECONDS),
    ):
        row = Row(f"{what}, {name}", contestant("rasterjit").NAME)
        row.rounds = [1e3 * seconds for seconds, _ in times]
        row.milliseconds = statistics.median(row.rounds)
        row.processor_milliseconds = 1e3 * statistics.median(seconds for _, seconds in times)
        row.target, row.met = f"<= {limit:g} s", row.milliseconds <= 1e3 * limit
        rows.append(row)
    return rows


MARKS: dict[str, Callable[[Options], list[Row]]] = {
    "visibility": visibility,
    "fill": fill,
    "exactness": exactness,
    "lines": lines,
    "python": python,
    "memory": memory,
    "startup": startup,
}
