"""
Measure thousands of small pictures: ``render_batch`` beside the peers, in one run.

``python -m benchmarks.batch [--views N] [--sizes 64 128] [--rounds N] [--output FILE]``

Five thousand faces with colours of vertices, seen from N sides; every picture is read back.
RasterJIT and llvmpipe draw on two threads, and on one; tinydisplay has one. All take turns, round
by round; a row has the median time of a view, and the median of the rounds' ratios to RasterJIT's
batch on two threads. The last pictures are compared before a time counts.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from benchmarks.against_peers import planned
from benchmarks.contestants import contestant
from benchmarks.pairing import Effort, Run, measure, paired_ratio
from benchmarks.pictures import needed
from benchmarks.report import machine
from benchmarks.rows import check_picture
from benchmarks.scenes import find_scene
from benchmarks.targets import OPENGL, TINYDISPLAY

OWN = "rasterjit_batch"

ENTRANTS = ((OWN, 2), (OWN, 1), ("rasterjit", 1), (OPENGL, 2), (OPENGL, 1), (TINYDISPLAY, 1))
"""Who draws, with how many threads; the first is who the others are compared with."""

AIMS = {(TINYDISPLAY, 1): 2.0, (OPENGL, 2): 4.0}
"""How many times as long others are to take."""

SECONDS = 60.0
"""Of an entry in all its rounds."""


def measure_size(side: int, views: int, rounds: int) -> list[dict[str, object]]:
    """Time all of them on pictures of so many pixels a side; return a row each."""
    name = f"batch_{side}:{views}"
    scene = find_scene(name)
    runs = [planned(key, name, scene, threads) for key, threads in ENTRANTS]
    measure(runs, Effort(rounds, SECONDS))
    own = runs[0]
    return [row_of(run, own, needed(scene, contestant(run.entry.contestant))) for run in runs]


def row_of(run: Run, own: Run, least: tuple[float, ...]) -> dict[str, object]:
    """Return what was measured of a run, compared with ``own``; its picture is checked."""
    key, threads = run.entry.contestant, run.entry.threads
    row: dict[str, object] = {"name": contestant(key).NAME, "threads": threads}
    note = "" if run is own else check_picture(run, own, least)
    row["check"] = note
    if run.missing is None and own.missing is None:
        views = int(run.entry.scene.partition(":")[2])
        row["ms"] = 1e3 * run.median / views
        row["ratio"], row["aim"] = paired_ratio(run, own), AIMS.get((key, threads))
    else:
        row["missing"] = run.missing or own.missing
    return row


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("--views", type=int, default=10_000)
    parser.add_argument("--sizes", type=int, nargs="+", default=(64, 128), choices=(64, 128))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--output", type=Path, help="a JSON file")
    arguments = parser.parse_args()
    found = {}
    for side in arguments.sizes:
        print(f"{arguments.views} views of {side} x {side}")
        found[side] = measure_size(side, arguments.views, arguments.rounds)
        for row in found[side]:
            head = f"  {row['name']:<24}{row['threads']} threads"
            if "missing" in row:
                print(f"{head}  {row['missing']}")
                continue
            aim = f" (aim {row['aim']:g} x)" if row["aim"] else ""
            print(f"{head}{row['ms']:9.3f} ms a view{row['ratio']:7.2f} x{aim}  {row['check']}")
    if arguments.output is not None:
        content = {"machine": machine(), "views": arguments.views, "found": found}
        arguments.output.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
