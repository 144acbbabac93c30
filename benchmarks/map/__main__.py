"""``python -m benchmarks.map``: measure the map, draw it, name what is worst, judge the marks."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from benchmarks import instructions as sets
from benchmarks import report
from benchmarks.checkouts import RevisionError, git
from benchmarks.map import cells, marks, picture
from benchmarks.map.cells import FACES, FAMILIES, LOOKS, OWN, SIZES, SLIVERS, TITLES, Cell, Measured
from benchmarks.map.schedule import Schedule
from benchmarks.map.turns import measure_safely, participants, seats
from benchmarks.pairing import package_environment
from benchmarks.rows import DIFFERS, FAILED

SECONDS, MINUTES = 2.5, 20.0
"""Of the rounds of a cell, all contestants together, and of the whole at most."""
RESULT = report.RESULTS / "map.json"
SAVE_SECONDS = 20.0
AGAIN, LONGER = 12, 2.0
"""Cells of each panel that are measured again, the lowest ones, and how much longer."""
MAX_SIDE, MAX_FACES = 8192, 10_000_000
SAME = ("commit", "instructions", "threads")
"""What a file of results must have in common with a run that goes on with it; and the processor."""

MARK_COLUMNS = ("instructions", "mark", "needed", "found", "verdict", "worst cell")
WORST_COLUMNS = ("with", "cell", "ratio", "ms", "llvmpipe", "tinydisplay", "stages, ms")

progress = Console(stderr=True)


def say(line: str) -> None:
    """Print a line on standard error as it is."""
    progress.print(line, markup=False, highlight=False)


class Size(click.ParamType):
    """A size in pixels: ``512`` or ``1280x720``."""

    name = "size"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return width and height."""
        found = re.fullmatch(r"(\d{1,9})(?:x(\d{1,9}))?", str(value).strip().lower())
        if found is None:
            self.fail(f"{value!r} is no size: expected one such as 512 or 1280x720", param, ctx)
        size = int(found[1]), int(found[2] or found[1])
        if min(size) < 1 or max(size) > MAX_SIDE:
            self.fail(f"{value!r} is out of range: 1 to {MAX_SIDE} pixels a side", param, ctx)
        return size


class Duration(click.FloatRange):
    """A positive number."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number."""
        found: float = super().convert(value, param, ctx)
        if math.isnan(found):
            self.fail(f"{value!r} is no number", param, ctx)
        return found


DURATION = Duration(min=0.0, min_open=True, max=1e6)
MEASURING = ("sizes", "faces", "looks", "families", "threads", "instructions", "seconds", "minutes")
"""Options that mean nothing where nothing is measured."""


@click.command()
@click.option(
    "--sizes", multiple=True, type=Size(), metavar="N|WxH",
    help="Of pictures, such as 512 or 1280x720. This and the next five may be repeated; the whole "
    "map is measured where none is given.",
)  # fmt: skip
@click.option(
    "--faces", multiple=True, type=click.IntRange(12, MAX_FACES), metavar="N",
    help="Of meshes, about.",
)  # fmt: skip
@click.option(
    "--looks", multiple=True, type=click.Choice([*TITLES]), help="How meshes are coloured."
)
@click.option(
    "--families", multiple=True, type=click.Choice([*FAMILIES, SLIVERS.family]),
    help="Of meshes; slivers is a single cell, whatever sizes, faces and looks are.",
)  # fmt: skip
@click.option(
    "--threads", multiple=True, type=click.IntRange(1, 1024), metavar="N",
    help="Of RasterJIT and llvmpipe.  [default: 1 and all processors]",
)  # fmt: skip
@click.option(
    "--instructions", multiple=True, type=click.Choice(sets.SETS),
    help="What the CPU has, or AVX2 alone.  [default: both]",
)  # fmt: skip
@click.option(
    "--seconds", default=SECONDS, show_default=True, type=DURATION,
    help="Of the rounds of a cell, all contestants together; three rounds at least.",
)  # fmt: skip
@click.option(
    "--minutes", default=MINUTES, show_default=True, type=DURATION,
    help="After which all is to be measured: cells get their share, with fewer rounds if need be.",
)  # fmt: skip
@click.option(
    "--resume", is_flag=True, help="Measure only what --results lacks, by the same commit."
)
@click.option("--draw", is_flag=True, help="Measure nothing: print and draw what is in --results.")
@click.option(
    "--results", default=RESULT, show_default=False,
    help="The file of results, written as it grows.  [default: benchmarks/results/map.json]",
    type=click.Path(dir_okay=False, path_type=Path),
)  # fmt: skip
@click.option(
    "--to", "folder", default=report.RESULTS, show_default=False,
    help="The folder for the pictures.  [default: benchmarks/results]",
    type=click.Path(file_okay=False, path_type=Path),
)  # fmt: skip
@click.pass_context
def main(
    context: click.Context, sizes: tuple[tuple[int, int], ...], faces: tuple[int, ...],
    looks: tuple[str, ...], families: tuple[str, ...], threads: tuple[int, ...],
    instructions: tuple[str, ...], seconds: float, minutes: float, resume: bool, draw: bool,
    results: Path, folder: Path,
) -> None:  # fmt: skip
    """
    Measure RasterJIT beside llvmpipe and tinydisplay over sizes, faces, looks and threads.

    Prints which marks hold and the worst cells, and draws a heat map for each look. Ends with
    status 1 if a picture was wrong or RasterJIT failed.
    """
    if draw:
        refuse_with_draw(context, resume)
        content = content_of(results)
    else:
        wanted = choose(sizes, faces, looks, families)
        counts = sorted(set(threads or (1, report.processors())))
        names = [name for name in sets.SETS if name in (instructions or sets.SETS)]
        content = measure_all(wanted, counts, names, seconds, 60.0 * minutes, results, resume)
    show(content, folder)
    if wrong := pictures_that_differ(read(content)):
        for line in wrong:
            say(line)
        sys.exit(1)


def refuse_with_draw(context: click.Context, resume: bool) -> None:
    """Raise ``click.UsageError`` if an option is given that means nothing beside ``--draw``."""
    given = click.core.ParameterSource.COMMANDLINE
    idle = [name for name in MEASURING if context.get_parameter_source(name) == given]
    if idle or resume:
        names = " and ".join(f"--{name}" for name in [*idle, *["resume"] * resume])
        raise click.UsageError(f"--draw measures nothing: it goes without {names}")


def content_of(path: Path) -> dict[str, Any]:
    """Return what a file of results holds; raise ``click.ClickException`` if it holds none."""
    try:
        content: dict[str, Any] = json.loads(path.read_text())
        read(content)
        [content[key] for key in ("machine", "left_out", *SAME)]
    except FileNotFoundError as error:
        raise click.ClickException(f"{path} does not exist: measure first") from error
    except (OSError, ValueError, TypeError, LookupError) as error:
        raise click.ClickException(
            f"{path} is no file of results: {type(error).__name__}: {error}"
        ) from error
    return content


def choose(
    sizes: Sequence[tuple[int, int]],
    faces: Sequence[int],
    looks: Sequence[str],
    families: Sequence[str],
) -> list[Cell]:
    """Return the cells that options ask for; slivers too where no part is named, or they are."""
    is_whole = not (sizes or faces or looks or families)
    found = cells.choose(
        sizes or SIZES, faces or FACES, looks or LOOKS,
        [name for name in families or FAMILIES if name != SLIVERS.family],
        with_slivers=is_whole or SLIVERS.family in families,
    )  # fmt: skip
    return list(dict.fromkeys(found))


def measure_all(
    wanted: Sequence[Cell],
    threads: Sequence[int],
    names: Sequence[str],
    seconds: float,
    limit: float,
    path: Path,
    resume: bool = False,
) -> dict[str, Any]:
    """
    Measure cell after cell; return the content of the file, which is written as it grows.

    All is to be done within ``limit`` seconds; cells that nothing is left for are named in the
    content's ``not_reached``. To ``resume`` is to keep the cells that the file has.
    """
    started = time.monotonic()
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
        "minutes": limit / 60.0,
        "not_reached": [],
        "cells": [],
    }
    found = resumed(path, content) if resume and path.exists() else []
    done = {each.cell for each in found}
    wanted = [cell for cell in wanted if cell not in done]
    warm_up(names)
    saved = started
    schedule = Schedule(wanted, limit - (time.monotonic() - started))
    try:
        with participants(seats(threads, names), say) as all_:
            for number, cell in enumerate(wanted):
                if schedule.is_over:
                    content["not_reached"] = list(map(str, wanted[number:]))
                    break
                found.append(measure_safely(cell, all_, seconds, schedule.next_end(cell)))
                say(f"{number + 1}/{len(wanted)} {cell}, {schedule.passed / 60:.1f} min")
                if time.monotonic() - saved > SAVE_SECONDS:
                    saved = time.monotonic()
                    save(content, found, saved - started, path)
            for low in lowest(found, panels_of(content)):
                # A cell takes as long as its rounds, and about as long to prepare and to check.
                if schedule.has(2.0 * LONGER * seconds):
                    say(f"again: {low.cell}")
                    low.add(measure_safely(low.cell, all_, LONGER * seconds, schedule.end))
    finally:
        save(content, found, time.monotonic() - started, path)
    return content


def resumed(path: Path, content: dict[str, Any]) -> list[Measured]:
    """
    Return the cells of a file that a run goes on with, but for those in which a process failed.

    Raises ``click.ClickException`` if the file is of another commit, machine, or set of threads and
    instructions.
    """
    before = content_of(path)
    kept = {name: before[name] for name in SAME}
    wanted = {name: content[name] for name in SAME}
    kept["processor"], wanted["processor"] = (
        one["machine"].get("processor") for one in (before, content)
    )
    for name, value in wanted.items():
        if kept[name] != value:
            raise click.ClickException(
                f"--resume: {path} was measured with {name} {kept[name]!r}, this run would be with "
                f"{value!r}; give the same, or leave out --resume"
            )
    return [
        each
        for each in read(before)
        if not any((run.missing or "").startswith(FAILED) for run in each.runs)
    ]


def warm_up(names: Sequence[str]) -> None:
    """Compile all kernels that the store lacks, for each set of instructions, before any clock."""
    for name in names:
        done = subprocess.run(
            [sys.executable, "-m", "rasterjit", "warmup", "--quiet"],
            env=package_environment(sets.environment(name)), capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        if done.returncode != 0:
            say(f"rasterjit warmup failed, {sets.name_of(name)}: {done.stderr.strip()[-200:]}")


def lowest(measured: Sequence[Measured], panels: Sequence[tuple[str, int, str]]) -> list[Measured]:
    """
    Return the cells with the lowest ratios of each panel, each once, those of lowest rank first.

    Of hundreds of cells a few look slow by chance: more rounds tell.
    """
    ranks: dict[Cell, int] = {}
    for _, threads, name in panels:
        for rank, each in enumerate(marks.worst(marks.verdicts(measured, threads, name), AGAIN)):
            ranks[each.cell] = min(rank, ranks.get(each.cell, rank))
    found = [each for each in measured if each.cell in ranks]
    return sorted(found, key=lambda each: ranks[each.cell])


def save(content: dict[str, Any], found: Sequence[Measured], seconds: float, path: Path) -> None:
    """Write what was measured so far, and how many seconds it took."""
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
            Cell(each["family"], each["faces"], each["look"], (each["size"][0], each["size"][1])),
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
    if missed := content.get("not_reached"):
        say(
            f"{len(missed)} cells were not reached in {content['minutes']:g} minutes, from "
            f"{missed[0]} on: --resume goes on with them"
        )
    if (reason := picture.missing()) is not None:
        say(f"no pictures: {reason}")
        return
    machine = content["machine"]
    where = f"{machine['processor']}, {machine['processors']} processors, {content['commit']}"
    for look in TITLES:
        if any(each.cell.look == look and each.cell.family in FAMILIES for each in measured):
            path = picture.draw(
                measured, look, panels_of(content), where, folder / f"map_{look}.png"
            )
            say(os.fspath(path))
    first = panels_of(content)[: len(content["threads"])]
    titles = [(threads_text(count), count, name) for _, count, name in first]
    has = content["instructions"][titles[0][2]]
    what = f"{machine['processor']}, {machine['processors']} cores, {has}"
    say(os.fspath(picture.draw_summary(measured, titles, what, folder / "map.png")))


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
        if (run.missing or "").startswith((DIFFERS, *[FAILED] * (run.contestant == OWN)))
    ]


if __name__ == "__main__":
    main()
