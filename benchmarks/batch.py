"""
Measure thousands of small pictures: ``render_batch`` beside the peers, in one run.

``python -m benchmarks.batch [--views N] [--sizes 64 128] [--instructions native avx2] [--rounds N]
[--output FILE]``, or ``python -m benchmarks.batch --streams [--views N] [--sizes 64 128 256]``

Five thousand faces with colours of vertices, seen from N sides; every picture is read back.
RasterJIT and llvmpipe draw on two threads, and on one; tinydisplay has one. The batch on two
threads draws all views; the others, whose views take as long however many there are, every fifth.
All take turns, round by round; a row has the median time of a view, and the median of the rounds'
ratios to RasterJIT's batch on two threads. The last pictures are compared before a time counts.
Four minutes for both sizes and both sets of instructions, on a machine with nothing else to do.

With ``--streams``: how many frames a second `render_many` draws, and a data set writes (colour
alone, and with depth), of the same faces, small views several in one go and each view alone, in
turns; ratios of frames a second and of processor time are the medians of the rounds'. Six minutes.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

from benchmarks import instructions as sets
from benchmarks.against_peers import OTHERS_PATIENCE, planned
from benchmarks.contestants import contestant
from benchmarks.contestants.rasterjit_ import make_scene
from benchmarks.many import seconds_of
from benchmarks.pairing import Effort, Run, measure, paired_ratios
from benchmarks.pictures import needed
from benchmarks.report import machine
from benchmarks.rows import check_picture, verdict
from benchmarks.scenes import find_scene
from benchmarks.targets import OPENGL, TINYDISPLAY, Target
from rasterjit import fit_camera, orbit_direction, render_many
from rasterjit.dataset.recipe import Recipe, render_views
from rasterjit.rendering import batch as batching
from rasterjit.runtime.threads import available_processors

OWN = "rasterjit_batch"

ENTRANTS = ((OWN, 2), (OWN, 1), ("rasterjit", 1), (OPENGL, 2), (OPENGL, 1), (TINYDISPLAY, 1))
"""Who draws, with how many threads; the first is who the others are compared with."""

MARKS = {(TINYDISPLAY, 1): Target(2.0, 3.0), (OPENGL, 2): Target(4.0)}
"""How many times as long others are to take: least, and goal."""

SECONDS = 24.0
"""Of an entry in all its rounds; a quarter of those that no mark is about."""


def measure_size(side: int, views: int, rounds: int, instructions: str) -> list[dict[str, object]]:
    """Time all of them on pictures of so many pixels a side; return a row each."""
    runs = []
    for key, threads in ENTRANTS:
        name = f"{'' if not runs else 'part_of_'}batch_{side}:{views}"
        run = planned(key, name, find_scene(name), threads)
        run.entry = replace(run.entry, instructions=instructions)
        if key != OWN and (key, threads) not in MARKS:
            run.patience = OTHERS_PATIENCE
        runs.append(run)
    measure(runs, Effort(rounds, SECONDS))
    return [row_of(run, runs[0]) for run in runs]


def row_of(run: Run, own: Run) -> dict[str, object]:
    """Return what was measured of a run, compared with ``own``; its picture is checked."""
    key, threads = run.entry.contestant, run.entry.threads
    row: dict[str, object] = {"name": contestant(key).NAME, "threads": threads}
    scene, whole = find_scene(run.entry.scene), find_scene(own.entry.scene)
    note = "" if run is own else check_picture(run, own, needed(scene, contestant(key)))
    row["check"] = note
    if run.missing is not None or own.missing is not None:
        row["missing"] = run.missing or own.missing
        return row
    row["ms"] = 1e3 * run.median / len(scene.views)
    each = len(whole.views) / len(scene.views)
    row["ratio"] = ratio = each * statistics.median(paired_ratios(run.seconds, own.seconds))
    mark = MARKS.get((key, threads))
    if mark is not None:
        met = verdict(ratio >= mark.least, mark.goal, ratio >= (mark.goal or 0.0))
        row |= {"mark": mark.least, "goal": mark.goal, "met": met}
    return row


def line_of(row: dict[str, object]) -> str:
    """Return a row as a line of text."""
    head = f"  {row['name']:<24}{row['threads']} thread{'s' if row['threads'] != 1 else ' '}"
    if "missing" in row:
        return f"{head}  {row['missing']}"
    text = f"{head}{row['ms']:9.3f} ms a view{row['ratio']:8.2f} x"
    if "mark" in row:
        goal = f", goal {row['goal']:g}" if row["goal"] else ""
        text += f"  mark {row['mark']:g}{goal}: {row['met']}"
    return f"{text}  {row['check']}".rstrip()


@contextmanager
def each_alone() -> Iterator[None]:
    """Let views of `render_many` and of data sets be drawn one by one."""
    most, batching.MAX_WORK = batching.MAX_WORK, 0
    try:
        yield
    finally:
        batching.MAX_WORK = most


def streams(side: int, views: int) -> dict[str, Callable[[], object]]:
    """Return what draws all views of a scene, by name."""
    scene = make_scene(find_scene(f"batch_64:{views}"))
    cameras = [fit_camera(scene, orbit_direction(360.0 * n / views, 20.0)) for n in range(views)]
    size = side, side

    def draw(threads: int) -> None:
        for _ in render_many(scene, cameras, size=size, threads=threads):
            pass

    def write(threads: int, *outputs: str) -> None:
        recipe = Recipe(views=views, size=size, outputs=outputs)
        with tempfile.TemporaryDirectory() as folder:
            render_views(scene, folder, recipe, threads=threads)

    found: dict[str, Callable[[], object]] = {}
    for threads in sorted({1, available_processors()}):
        ways = {
            "render_many": partial(draw, threads),
            "data set of color": partial(write, threads, "color"),
            "data set of color, depth": partial(write, threads, "color", "depth"),
        }
        found |= {
            f"{name}, {threads} thread{'s'[threads == 1 :]}": one for name, one in ways.items()
        }
    return found


def measure_streams(side: int, views: int, rounds: int) -> list[dict[str, object]]:
    """Time views drawn in one go and alone in turns; return a row for each way to draw them."""
    rows = []
    for name, draw in streams(side, views).items():
        walls: dict[bool, list[float]] = {True: [], False: []}
        worked: dict[bool, list[float]] = {True: [], False: []}
        for number in range(rounds + 1):
            for alone in (True, False) if number % 2 else (False, True):
                with each_alone() if alone else nullcontext():
                    since = time.process_time()
                    walls[alone].append(seconds_of(draw))
                    worked[alone].append(time.process_time() - since)
        # The first compiles and warms up.
        for seconds in (*walls.values(), *worked.values()):
            del seconds[0]
        rows.append({
            "name": name,
            "alone": views / statistics.median(walls[True]),
            "frames a second": views / statistics.median(walls[False]),
            "ratio": statistics.median(paired_ratios(walls[True], walls[False])),
            "ratio of processor time": statistics.median(
                paired_ratios(worked[True], worked[False])
            ),
        })  # fmt: skip
    return rows


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("--views", type=int)
    parser.add_argument("--sizes", type=int, nargs="+", choices=(64, 128, 256))
    parser.add_argument("--streams", action="store_true", help="render_many and data sets")
    parser.add_argument("--instructions", nargs="+", default=sets.SETS, choices=sets.SETS)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--output", type=Path, help="a JSON file")
    arguments = parser.parse_args()
    if not arguments.streams and 256 in (arguments.sizes or ()):
        parser.error("--sizes 256 needs --streams")
    sizes = arguments.sizes or ((64, 128, 256) if arguments.streams else (64, 128))
    views = arguments.views or (200 if arguments.streams else 10_000)
    found: dict[str, dict[int, list[dict[str, object]]]] = {}
    if arguments.streams:
        rows = found.setdefault("streams", {})
        for side in sizes:
            print(
                f"{views} views of {side} x {side}: frames a second, several in one go", flush=True
            )
            rows[side] = measure_streams(side, views, arguments.rounds)
            for row in rows[side]:
                print(
                    f"  {row['name']:<34}{row['frames a second']:8.0f}, each alone "
                    f"{row['alone']:6.0f}: {row['ratio']:.2f} x, processor time "
                    f"{row['ratio of processor time']:.2f} x"
                )
        arguments.instructions = ()
    for instructions in arguments.instructions:
        if (reason := sets.missing(instructions)) is not None:
            print(reason)
            continue
        rows = found.setdefault(sets.name_of(instructions), {})
        for side in sizes:
            title = f"{views} views of {side} x {side}, {sets.name_of(instructions)}"
            print(title, flush=True)
            rows[side] = measure_size(side, views, arguments.rounds, instructions)
            print(*map(line_of, rows[side]), sep="\n", flush=True)
    if arguments.output is not None:
        content = {"machine": machine(), "views": views, "found": found}
        arguments.output.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
