"""``python -m benchmarks``: measure, print the table, write it to ``results/``."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence

import click
from rich.console import Console

from benchmarks import report
from benchmarks.against_peers import OWN, TITLES, Options
from benchmarks.compare import compare
from benchmarks.contestants import contestant
from benchmarks.costs import FRAMES_LAST, FRAMES_MAX
from benchmarks.rows import FAILED, Row, folded, is_wrong
from benchmarks.starting import startup
from benchmarks.suite import FULL, OTHERS, QUICK, marks

progress = Console(stderr=True)


@click.group(invoke_without_command=True)
@click.option(
    "--only", multiple=True, type=click.Choice([*TITLES, *OTHERS]), metavar="SCENE",
    help=f"One scene, or {', '.join(OTHERS)}; may be repeated.",
)  # fmt: skip
@click.option("--quick", is_flag=True, help="Fewer rounds, views and peers.")
@click.option(
    "--threads", multiple=True, type=click.IntRange(1, 1024), default=(1, 2), show_default=True,
    help="Numbers of threads; may be repeated.",
)  # fmt: skip
@click.option(
    "--frames", type=click.IntRange(201), default=FRAMES_LAST, show_default=True,
    help=f"Frames after which memory must not have grown; {FRAMES_MAX} take minutes.",
)  # fmt: skip
@click.pass_context
def main(
    context: click.Context, only: tuple[str, ...], quick: bool, threads: tuple[int, ...],
    frames: int,
) -> None:  # fmt: skip
    """Measure RasterJIT beside other ways to draw the same pictures."""
    if context.invoked_subcommand is not None:
        return
    options = Options(QUICK if quick else FULL, tuple(sorted(set(threads))), quick)
    rows, parts = [], marks(frames)
    for name in only or parts:
        progress.print(f"measuring {name} ...")
        rows += measure_part(name, parts[name], options)
    finish(rows, options.effort.rounds)


def measure_part(name: str, part: Callable[[Options], list[Row]], options: Options) -> list[Row]:
    """Return the rows of a part, or one that says why it failed: the others still count."""
    try:
        return part(options)
    except (subprocess.SubprocessError, OSError, ValueError, RuntimeError) as error:
        return [Row(name, contestant(OWN).NAME, check=f"{FAILED}: {error}")]


main.add_command(compare)
main.add_command(startup)


def finish(rows: Sequence[Row], rounds: int) -> None:
    """Print and write everything; end with status 1 if a picture was wrong."""
    report.print_table("Measured", report.COLUMNS, [report.cells(row) for row in folded(rows)])
    report.write(rows, rounds)
    end_if_wrong(rows)


def end_if_wrong(rows: Sequence[Row]) -> None:
    """Name the rows whose pictures are wrong; if there are any, end with status 1."""
    wrong = [row for row in rows if is_wrong(row)]
    for row in wrong:
        progress.print(f"{row.scene}, {row.contestant}: {row.check}", markup=False)
    if wrong:
        sys.exit(1)


if __name__ == "__main__":
    main()
