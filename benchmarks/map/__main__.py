"""``python -m benchmarks.map``: measure the map, draw it, name what is worst, judge the marks."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console

from benchmarks import instructions as sets
from benchmarks import report
from benchmarks.checkouts import RevisionError, git
from benchmarks.map import cells, marks, picture
from benchmarks.map.cells import FACES, FAMILIES, LOOKS, OWN, SIZES, SLIVERS, TITLES, Cell, Measured
from benchmarks.map.turns import measure, participants, seats
from benchmarks.rows import DIFFERS

SECONDS = 2.5
"""Of a cell, all contestants together; slow ones take three rounds, whatever that takes."""
RESULT = report.RESULTS / "map.json"
SAVE_SECONDS = 60.0
AGAIN, LONGER = 12, 2.0
"""Cells of each panel that are measured again, the lowest ones, and how much longer."""

MARK_COLUMNS = ("instructions", "mark", "needed", "found", "verdict", "worst cell")
WORST_COLUMNS = ("with", "cell", "ratio", "ms", "llvmpipe", "tinydisplay", "stages, ms")

progress = Console(stderr=True)
Value = TypeVar("Value")


def say(line: str) -> None:
    """Print a line on standard error as it is."""
    progress.print(line, markup=False, highlight=False)


def size_of(text: str) -> tuple[int, int]:
    """Return a size from ``512`` or ``1280x720``."""
    parts = [int(part) for part in text.lower().split("x")]
    return (parts[0], parts[-1])


@click.command()
@click.option(
    "--sizes", multiple=True, metavar="N|WxH",
    help="Such as 512 or 1280x720; this and the next five may be repeated.",
)  # fmt: skip
@click.option("--faces", multiple=True, type=click.IntRange(12), metavar="N")
@click.option("--looks", multiple=True, type=click.Choice(LOOKS))
@click.option("--families", multiple=True, type=click.Choice([*FAMILIES, SLIVERS.family]))
@click.option("--threads", multiple=True, type=click.IntRange(1, 1024), help="1 and all of them.")
@click.option("--instructions", multiple=True, type=click.Choice(sets.SETS), help="Both.")
@click.option(
    "--seconds", default=SECONDS, show_default=True,
    help="Of a cell, all contestants together; three rounds at least.",
)  # fmt: skip
@click.option("--draw", is_flag=True, help="Measure nothing: print and draw what is in --results.")
@click.option(
    "--results", default=RESULT, show_default=False, help="The file of results.",
    type=click.Path(dir_okay=False, path_type=Path),
)  # fmt: skip
@click.option(
    "--to", "folder", default=report.RESULTS, help="The folder for the pictures.",
    type=click.Path(file_okay=False, path_type=Path),
)  # fmt: skip
def main(
    sizes: tuple[str, ...], faces: tuple[int, ...], looks: tuple[str, ...],
    families: tuple[str, ...], threads: tuple[int, ...], instructions: tuple[str, ...],
    seconds: float, draw: bool, results: Path, folder: Path,
) -> None:  # fmt: skip
    """Measure RasterJIT beside llvmpipe and tinydisplay over sizes, faces, looks and threads."""
    if draw:
        if not results.exists():
            raise click.ClickException(f"{results} does not exist: measure first")
        content = json.loads(results.read_text())
    else:
        wanted = choose(sizes, faces, looks, families)
        counts = sorted(set(threads or (1, report.processors())))
        content = measure_all(wanted, counts, instructions or sets.SETS, seconds, results)
    show(content, folder)
    if wrong := pictures_that_differ(read(content)):
        for line in wrong:
            say(line)
        sys.exit(1)


def choose(
    sizes: Sequence[str], faces: Sequence[int], looks: Sequence[str], families: Sequence[str]
) -> list[Cell]:
    """Return the cells that options ask for; slivers too where no part is named, or they are."""
    is_whole = not (sizes or faces or looks or families)
    return cells.choose(
        [size_of(text) for text in sizes] or SIZES, faces or FACES, looks or LOOKS,
        [name for name in families or FAMILIES if name != SLIVERS.family],
        with_slivers=is_whole or SLIVERS.family in families,
    )  # fmt: skip


def measure_all(
    wanted: Sequence[Cell], threads: Sequence[int], names: Sequence[str], seconds: float, path: Path
) -> dict[str, Any]:
    """Measure cell after cell; return the content of the file, which is written as it grows."""
    left_out = {name: reason for name in names if (reason := sets.missing(name)) is not None}
    names = [name for name in names if name not in left_out] or [sets.NATIVE]
    for reason in left_out.values():
        say(reason)
    content: dict[str, Any] = {
        "machine": report.machine(),
        "commit": commit(),
        "instructions": {name: sets.name_of(name) for name in names},
        "left_out": left_out,
        "threads": list(threads),
        "seconds": seconds,
        "cells": [],
    }
    found: list[Measured] = []
    started = saved = time.monotonic()
    with participants(seats(threads, names), say) as all_:
        for number, cell in enumerate(wanted):
            found.append(measure(cell, all_, seconds))
            now = time.monotonic()
            left = (now - started) / (number + 1) * (len(wanted) - number - 1)
            say(f"{number + 1}/{len(wanted)} {cell}, {left / 60:.0f} min left")
            if now - saved > SAVE_SECONDS:
                saved = now
                save(content, found, now - started, path)
        for low in lowest(found, panels_of(content)):
            say(f"again: {low.cell}")
            low.add(measure(low.cell, all_, LONGER * seconds))
    save(content, found, time.monotonic() - started, path)
    return content


def lowest(measured: Sequence[Measured], panels: Sequence[tuple[str, int, str]]) -> list[Measured]:
    """
    Return the cells with the lowest ratios of each panel, each once.

    Of hundreds of cells a few look slow by chance: more rounds tell.
    """
    wanted = {
        each.cell
        for _, threads, name in panels
        for each in marks.worst(marks.verdicts(measured, threads, name), AGAIN)
    }
    return [each for each in measured if each.cell in wanted]


def save(content: dict[str, Any], found: Sequence[Measured], seconds: float, path: Path) -> None:
    """Write what was measured so far."""
    content["cells"] = list(map(written, found))
    content["took_seconds"] = seconds
    report.write_text(path, json.dumps(content) + "\n")


def commit() -> str:
    """Return which commit is checked out, and whether files differ from it."""
    try:
        return git("describe", "--always", "--dirty", "--abbrev=10")
    except (RevisionError, OSError) as error:
        return f"unknown: {error}"


def written(measured: Measured) -> dict[str, Any]:
    """Return a cell as it stands in the file."""
    cell = measured.cell._asdict()
    return {**cell, "size": list(cell["size"]), "runs": list(map(asdict, measured.runs))}


def read(content: dict[str, Any]) -> list[Measured]:
    """Return the cells of a file."""
    return [
        Measured(
            Cell(each["family"], each["faces"], each["look"], tuple(each["size"])),
            [cells.Run(**run) for run in each["runs"]],
        )
        for each in content["cells"]
    ]


def threads_text(count: int) -> str:
    """Return a number of threads as text."""
    return f"{count} thread{'s' if count > 1 else ''}"


def panels_of(content: dict[str, Any]) -> list[tuple[str, int, str]]:
    """Return title, threads and instructions of each panel."""
    return [
        (f"{title}, {threads_text(count)}", count, name)
        for name, title in content["instructions"].items()
        for count in content["threads"]
    ]


def show(content: dict[str, Any], folder: Path) -> None:
    """Print the marks and the worst cells, and draw the maps."""
    measured, rows = read(content), []
    for name, title in content["instructions"].items():
        found = marks.marks_of(measured, name)
        found += [marks.scaling(measured, count, name) for count in content["threads"] if count > 1]
        rows += [
            [title, mark.name, mark.needed, mark.found, mark.verdict, mark.where] for mark in found
        ]
    report.print_table("Marks, with one thread unless said", MARK_COLUMNS, rows)
    rows = [
        [title, *worst_row(each)]
        for title, count, name in panels_of(content)
        for each in marks.worst(marks.verdicts(measured, count, name))
    ]
    report.print_table(f"The {marks.WORST} worst cells", WORST_COLUMNS, rows)
    for reason in content["left_out"].values():
        say(reason)
    if (reason := picture.missing()) is not None:
        say(f"no pictures: {reason}")
        return
    machine = content["machine"]
    where = f"{machine['processor']}, {machine['processors']} processors"
    for look in TITLES:
        if any(each.cell.look == look and each.cell.family in FAMILIES for each in measured):
            path = picture.draw(
                measured, look, panels_of(content), where, folder / f"map_{look}.png"
            )
            say(os.fspath(path))


def worst_row(verdict: marks.Verdict) -> list[str]:
    """Return a cell with its ratios and what each stage takes, longest first."""
    stages = verdict.own.stages
    inside = sorted((name for name in stages if name not in marks.OUTSIDE), key=stages.get)
    parts = [f"{name} {stages[name]:.2f}" for name in reversed(inside) if stages[name] >= 0.005]
    planning = f" (plan {stages['plan']:.2f})" if "plan" in stages else ""
    return [
        str(verdict.cell), f"{verdict.ratio:.2f}", report.number(verdict.ms),
        *[report.number(verdict.ratios.get(key)) for key in cells.PEERS],
        ", ".join([*parts, f"the rest {verdict.overhead_ms:.2f}{planning}"]),
    ]  # fmt: skip


def pictures_that_differ(measured: Sequence[Measured]) -> list[str]:
    """Return a line for each run whose picture was not the reference's."""
    return [
        f"{each.cell}, {run.contestant}, {threads_text(run.threads)}, {run.instructions or 'any'}: "
        f"{run.missing}"
        for each in measured
        for run in each.runs
        if (run.missing or "").startswith((DIFFERS, *["failed"] * (run.contestant == OWN)))
    ]


if __name__ == "__main__":
    main()
