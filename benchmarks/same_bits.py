"""
``python -m benchmarks.same_bits --against COMMIT``: whether random scenes keep every bit.

Each of the random scenes that the tests draw, too, is drawn by both versions in all ways that there
are: alone, by a kept `Renderer` and in a batch, on one thread and on two, and once more after one
change. The table tells which outputs differ between the versions, and between the ways of one
version. Below it stands how much of the source the scenes reach: the different lists of stages, and
the share of the kernels and stages that ran.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from benchmarks.checkouts import RevisionError, checkouts
from benchmarks.pairing import ROOT, package_environment

SHOWN = 12
"""Scenes that are named for each way and output that differs."""

ALIKE = (
    ("lone, 1 thread", "lone, 2 threads"),
    ("lone, 1 thread", "kept"),
    ("lone, 1 thread", "bound"),
    ("lone, 1 thread", "batch, 1 thread"),
    ("batch, 1 thread", "batch, 2 threads"),
    ("changed", "kept, changed"),
    ("changed", "bound, changed"),
)
"""Ways to draw that have the same bits."""


def start(folder: Path, seed: int, count: int, lines: Path) -> subprocess.Popen[str]:
    """Start a process that draws the scenes with the package of a folder."""
    command = [sys.executable, "-m", "benchmarks.same_bits_worker", str(folder), str(seed)]
    with lines.open("w") as file:
        return subprocess.Popen(
            [*command, str(count)], cwd=ROOT, env=package_environment({}, folder), stdout=file,
            text=True,
        )  # fmt: skip


def rows_of(lines: Path) -> list[dict[str, Any]]:
    """Return what a process printed."""
    return [json.loads(line) for line in lines.read_text().splitlines()]


def differing(one: dict[str, str], other: dict[str, str]) -> list[str]:
    """Return the outputs whose hashes differ."""
    return sorted(name for name in {*one, *other} if one.get(name) != other.get(name))


def between_ways(rows: list[dict[str, Any]]) -> dict[str, list[int]]:
    """Return the scenes whose outputs differ between two ways of one version, by way and output."""
    found: dict[str, list[int]] = {}
    for number, row in enumerate(rows):
        for one, other in ALIKE:
            for name in differing(row["hashes"][one], row["hashes"][other]):
                found.setdefault(f"{other}: {name}, for {one}", []).append(number)
    return found


def between_versions(old: list[dict[str, Any]], new: list[dict[str, Any]]) -> dict[str, list[int]]:
    """Return the scenes whose outputs differ between two versions, by way and output."""
    found: dict[str, list[int]] = {}
    for number, (before, after) in enumerate(zip(old, new, strict=True)):
        for way, hashes in before["hashes"].items():
            for name in differing(hashes, after["hashes"][way]):
                found.setdefault(f"{way}: {name}", []).append(number)
    return found


def reach(rows: list[dict[str, Any]], ran: dict[str, list[str]]) -> str:
    """Say how much of the source the scenes reach."""
    lists = {tuple(row["stages"]) for row in rows}
    errors = Counter(
        hashes["error"] for row in rows for hashes in row["hashes"].values() if "error" in hashes
    )
    told = (
        f"{len(lists)} lists of stages, the longest of {max(map(len, lists))}; "
        f"{len(ran['ran'])} of {len(ran['known'])} kernels and stages ran"
    )
    return told + "".join(f"; {count} frames ended with {name}" for name, count in errors.items())


def table_of(title: str, found: dict[str, list[int]], seed: int) -> Table:
    """Return a table of what differs."""
    table = Table(title=title)
    for column in ("what", "scenes", f"of seed {seed}"):
        table.add_column(column)
    for what, numbers in sorted(found.items()):
        shown = ", ".join(map(str, numbers[:SHOWN])) + (" ..." if len(numbers) > SHOWN else "")
        table.add_row(what, str(len(numbers)), shown)
    if not found:
        table.add_row("nothing", "0", "")
    return table


@click.command()
@click.option("--against", default="HEAD", show_default=True, help="Commit to compare with.")
@click.option("--scenes", type=click.IntRange(1), default=600, show_default=True)
@click.option("--seed", type=click.IntRange(0), help="Of the scenes. Default: another each time.")
@click.pass_context
def main(context: click.Context, against: str, scenes: int, seed: int | None) -> None:
    """Draw random scenes with the files as they are and with a commit; status 1 if bits differ."""
    console = Console()
    seed = int.from_bytes(os.urandom(4), "big") if seed is None else seed
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        lines = [Path(place) / name for name in ("old", "new")]
        try:
            with checkouts([against, "."], Path(place)) as trees:
                jobs = [
                    start(folder, seed, scenes, file)
                    for (_, folder), file in zip(trees, lines, strict=True)
                ]
                if any([job.wait() for job in jobs]):
                    raise click.ClickException("a version ended before all scenes were drawn")
        except RevisionError as error:
            raise click.ClickException(str(error)) from error
        (*old, _), (*new, ran) = map(rows_of, lines)
    versions, ways = between_versions(old, new), between_ways(new)
    console.print(table_of(f"{against} and the files as they are", versions, seed))
    console.print(table_of("ways to draw, with the files as they are", ways, seed))
    others = sum(a["stages"] != b["stages"] for a, b in zip(old, new, strict=True))
    console.print(f"{others} scenes have other lists of stages in the two versions")
    took = time.perf_counter() - began
    console.print(f"{scenes} scenes in {took:.0f} s: {reach(new, ran)}", soft_wrap=True)
    context.exit(1 if versions or ways else 0)


if __name__ == "__main__":
    main()
