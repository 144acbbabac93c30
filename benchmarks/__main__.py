"""``python -m benchmarks``: measure the first mark, print it, write it to ``results/``."""

from __future__ import annotations

import sys

import click
from rich.console import Console

from benchmarks.first_mark import MARKS, Options
from benchmarks.report import print_table, write

ROUNDS, QUICK_ROUNDS = 9, 3
TABLE_WIDTH = 190
"""Columns of the table where the output is not a terminal."""


@click.command()
@click.option(
    "--only", multiple=True, type=click.Choice(list(MARKS)), help="One mark; may be repeated."
)
@click.option("--quick", is_flag=True, help=f"{QUICK_ROUNDS} rounds instead of {ROUNDS}.")
@click.option(
    "--threads", multiple=True, type=click.IntRange(1, 1024), default=(1, 2), show_default=True,
    help="Numbers of threads; may be repeated.",
)  # fmt: skip
def main(only: tuple[str, ...], quick: bool, threads: tuple[int, ...]) -> None:
    """Measure RasterJIT beside other ways to draw the same pictures."""
    options = Options(QUICK_ROUNDS if quick else ROUNDS, threads)
    progress, rows = Console(stderr=True), []
    for name in only or MARKS:
        progress.print(f"measuring {name} ...")
        rows += MARKS[name](options)
    console = Console()
    if not console.is_terminal:
        console = Console(width=TABLE_WIDTH)
    print_table(rows, console)
    write(rows, options.rounds)
    if any("the picture differs" in row.check for row in rows):
        progress.print("a picture differs from the reference")
        sys.exit(1)


if __name__ == "__main__":
    main()
