"""``python -m benchmarks compare A B``: whether B is slower than A, measured in one run."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from benchmarks import instructions as sets
from benchmarks import report
from benchmarks.checkouts import RevisionError, checkouts
from benchmarks.judging import LIMIT, Comparison, judge_code, judge_times
from benchmarks.pairing import (
    PREPARE_SECONDS,
    ROOT,
    Effort,
    Worker,
    WorkerError,
    cache_environment,
    package_environment,
)
from benchmarks.public_api import CASES

EFFORT = Effort(15, 10.0)
"""Rounds, and seconds for either version of a scene."""
COMPILE_ROUNDS = 2
COMPILE_SECONDS = 300.0

COLUMNS = ("what", "A", "B", "B / A", "quartiles", "verdict", "note")

progress = Console(stderr=True)


class Tree:
    """
    One version: its name, its folder, and a cache for its kernels.

    Its processes are held to a set of `benchmarks.instructions`.
    """

    def __init__(
        self, name: str, folder: Path, cache: Path, instructions: str = sets.NATIVE
    ) -> None:
        self.name, self.folder, self._cache = name, folder, cache
        self._instructions = sets.environment(instructions)

    def environment(self, cache: str = "kernels") -> dict[str, str]:
        """Return the environment of a worker, with one of the version's caches."""
        place = self._cache / cache
        place.mkdir(parents=True, exist_ok=True)
        return package_environment({**cache_environment(place), **self._instructions})

    def worker(self, task: str, *arguments: str) -> Worker:
        """Start a worker for a task of `benchmarks.compare_worker`."""
        self._cache.mkdir(parents=True, exist_ok=True)
        return Worker(
            ("-m", "benchmarks.compare_worker", task, str(self.folder), *arguments),
            self.environment(), self._cache / "errors.log",
        )  # fmt: skip

    def code(self, cache: str) -> dict[str, Any]:
        """Compile everything into a cache; return the seconds and the kernels' instructions."""
        result = subprocess.run(
            [sys.executable, "-m", "benchmarks.compare_worker", "code", str(self.folder)],
            capture_output=True, text=True, cwd=ROOT, env=self.environment(cache),
            timeout=COMPILE_SECONDS,
        )  # fmt: skip
        if result.returncode != 0:
            raise WorkerError((result.stderr.strip().splitlines() or ["no message"])[-1])
        return json.loads(result.stdout)


def time_scene(
    trees: Sequence[Tree], scene: str, threads: int, limit: float, effort: Effort = EFFORT
) -> Comparison:
    """Time both versions on a scene, in turns; the one that begins changes from round to round."""
    what = f"{scene}, {threads} thread{'s' if threads > 1 else ''}, ms"
    try:
        with contextlib.ExitStack() as stack:
            workers, ready = [], []
            for tree in trees:
                workers.append(tree.worker("draw", scene, str(threads)))
                stack.callback(workers[-1].close)
                ready.append(workers[-1].answer(PREPARE_SECONDS))
            slowest = max(each["seconds"] for each in ready)
            wall: tuple[list[float], list[float]] = ([], [])
            processor: tuple[list[float], list[float]] = ([], [])
            for turn in range(effort.rounds_of(slowest)):
                for number in (0, 1) if turn % 2 == 0 else (1, 0):
                    answer = workers[number].ask("draw")
                    wall[number].append(1e3 * answer["total"])
                    processor[number].append(1e3 * answer["processor"])
    except WorkerError as error:
        return Comparison(what, note=f"not drawn: {error}")
    row, by_processor = (judge_times(what, *times, limit) for times in (wall, processor))
    if threads == 1:
        row.is_worse = is_confirmed(row, by_processor, limit)
    same = "same" if ready[0]["picture"] == ready[1]["picture"] else "other"
    row.note = f"CPU time {by_processor.ratio:.3f}, {same} bits"
    return row


def is_confirmed(row: Comparison, by_processor: Comparison, limit: float) -> bool:
    """
    Return whether a slowdown by the wall clock, on one thread, is no other program's doing.

    It costs processor time, or three quarters of the rounds exceed the limit itself.
    """
    return row.is_worse and (by_processor.is_worse or (row.low or 0.0) > limit)


def compare_code(trees: Sequence[Tree], limit: float, rounds: int) -> list[Comparison]:
    """Compile both versions in turns; compare the times, if any, and the instructions."""
    found: list[list[dict[str, Any]]] = [[], []]
    for turn in range(max(rounds, 1)):
        for number, tree in enumerate(trees):
            found[number].append(tree.code("kernels" if turn == 0 else f"kernels-{turn}"))
    rows = judge_code(found[0][0]["kernels"], found[1][0]["kernels"])
    if rounds:
        seconds = [[each["seconds"] for each in side] for side in found]
        rows.insert(0, judge_times("compiling everything, s", *seconds, limit))
    return rows


def cells(row: Comparison) -> list[str]:
    """Return a row as text."""
    spread = "" if row.low is None or row.high is None else f"{row.low:.3f} .. {row.high:.3f}"
    verdict = "" if row.ratio is None else "ok"
    return [
        row.what,
        "" if row.before is None else f"{row.before:.4g}",
        "" if row.after is None else f"{row.after:.4g}",
        "" if row.ratio is None else f"{row.ratio:.3f}",
        spread,
        "WORSE" if row.is_worse else verdict,
        row.note,
    ]


def compare_trees(
    trees: Sequence[Tree], scenes: Sequence[str], threads: Sequence[int], limit: float, timed: bool
) -> list[Comparison]:
    """Return every row of a comparison."""
    progress.print("compiling ...")
    code = compare_code(trees, limit, COMPILE_ROUNDS if timed else 0)
    rows = []
    for scene in scenes if timed else ():
        progress.print(f"measuring {scene} ...")
        rows += [time_scene(trees, CASES[scene], count, limit) for count in threads]
    return rows + code


@click.command()
@click.argument("before", metavar="A")
@click.argument("after", metavar="B")
@click.option("--limit", default=LIMIT, show_default=True, help="Largest ratio of B to A allowed.")
@click.option("--only", multiple=True, type=click.Choice(list(CASES)), metavar="SCENE")
@click.option(
    "--threads", multiple=True, type=click.IntRange(1, 1024), default=(1,), show_default=True
)
@click.option(
    "--instructions", type=click.Choice(sets.SETS), default=sets.NATIVE, show_default=True,
    help="What both may use: all that this CPU has, or AVX2 alone.",
)  # fmt: skip
@click.option(
    "--instructions-only", is_flag=True,
    help="Compare the compiled code, not the times: the same on every run.",
)  # fmt: skip
def compare(
    before: str, after: str, limit: float, only: tuple[str, ...], threads: tuple[int, ...],
    instructions: str, instructions_only: bool,
) -> None:  # fmt: skip
    """
    Compare the speed of commit A and commit B; "." is the working tree.

    Ends with status 1 if B is slower than A in any scene, or a kernel lost its vectors.
    """
    if (reason := sets.missing(instructions)) is not None:
        raise click.ClickException(reason)
    with tempfile.TemporaryDirectory() as folder:
        try:
            with checkouts((before, after), Path(folder)) as versions:
                trees = [
                    Tree(name, place, Path(folder) / f"cache-{number}", instructions)
                    for number, (name, place) in enumerate(versions)
                ]
                rows = compare_trees(
                    trees, only or tuple(CASES), threads, limit, not instructions_only
                )
        except RevisionError as error:
            raise click.ClickException(str(error)) from None
    names = {
        "A": f"{before} ({trees[0].name})",
        "B": f"{after} ({trees[1].name})",
        "instructions": sets.name_of(instructions),
    }
    finish(rows, names, limit)


def finish(rows: Sequence[Comparison], names: dict[str, str], limit: float) -> None:
    """Print and write the rows; end with status 1 if any is worse."""
    title = (
        f"A: {names['A']}, B: {names['B']}, {names['instructions']}; worse: more than {limit:g} "
        "times as long; of kernels, their instructions"
    )
    report.print_table(title, COLUMNS, [cells(row) for row in rows])
    content = {
        "machine": report.machine(),
        **names,
        "limit": limit,
        "rows": list(map(asdict, rows)),
    }
    report.write_text(report.RESULTS / "compare.json", json.dumps(content, indent=2) + "\n")
    worse = [row.what for row in rows if row.is_worse]
    if worse:
        progress.print(f"worse: {', '.join(worse)}", markup=False)
        sys.exit(1)
