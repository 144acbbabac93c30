"""``python -m benchmarks``: measure, print the table, write it to ``results/``."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence

import click
from rich.console import Console

from benchmarks import plots, report
from benchmarks.against_peers import OWN, TITLES, Options
from benchmarks.compare import compare
from benchmarks.contestants import contestant
from benchmarks.costs import FRAMES_LAST, FRAMES_MOST
from benchmarks.curves import (
    EFFORT,
    QUICK_EFFORT,
    Curve,
    as_json,
    figures,
    measure_figure,
    row_of_curve,
)
from benchmarks.rows import FAILED, Row, folded, is_wrong
from benchmarks.suite import FULL, OTHERS, QUICK, marks

progress = Console(stderr=True)

quick_option = click.option("--quick", is_flag=True, help="Fewer rounds, points and peers.")


@click.group(invoke_without_command=True)
@click.option(
    "--only", multiple=True, type=click.Choice([*TITLES, *OTHERS]), metavar="SCENE",
    help=f"One scene, or {', '.join(OTHERS)}; may be repeated. Draws no curves.",
)  # fmt: skip
@quick_option
@click.option(
    "--threads", multiple=True, type=click.IntRange(1, 1024), default=(1, 2), show_default=True,
    help="Numbers of threads; may be repeated.",
)  # fmt: skip
@click.option("--no-curves", is_flag=True, help="Leave out the growth curves.")
@click.option(
    "--frames", type=click.IntRange(201), default=FRAMES_LAST, show_default=True,
    help=f"Frames after which memory must not have grown; {FRAMES_MOST} take minutes.",
)  # fmt: skip
@click.pass_context
def main(
    context: click.Context, only: tuple[str, ...], quick: bool, threads: tuple[int, ...],
    no_curves: bool, frames: int,
) -> None:  # fmt: skip
    """Measure RasterJIT beside other ways to draw the same pictures."""
    if context.invoked_subcommand is not None:
        return
    options = Options(QUICK if quick else FULL, tuple(sorted(set(threads))), quick)
    rows, parts = [], marks(frames)
    for name in only or parts:
        progress.print(f"measuring {name} ...")
        rows += measure_part(name, parts[name], options)
    drawn = [] if only or no_curves else draw_curves(options)
    finish(rows, drawn, options.effort.rounds)


def measure_part(name: str, part: Callable[[Options], list[Row]], options: Options) -> list[Row]:
    """Return the rows of a part, or one that says why it failed: the others still count."""
    try:
        return part(options)
    except (subprocess.SubprocessError, OSError, ValueError, RuntimeError) as error:
        return [Row(name, contestant(OWN).NAME, check=f"{FAILED}: {error}")]


@main.command("curves")
@quick_option
def curves_command(quick: bool) -> None:
    """Measure and plot how time grows with triangles, pixels and threads."""
    drawn = draw_curves(Options(QUICK if quick else FULL, quick=quick))
    rows = [row_of_curve(curve) for curve in drawn]
    report.print_table("Growth", report.COLUMNS, [report.cells(row) for row in rows])
    report.write_curves(rows, list(map(as_json, drawn)))
    end_if_wrong(rows)


main.add_command(compare)


def draw_curves(options: Options) -> list[Curve]:
    """Measure every figure and plot it, if matplotlib is installed."""
    drawn, reason = [], plots.missing()
    if reason is not None:
        progress.print(f"no plots: {reason}")
    for figure in figures(options, report.processors()):
        progress.print(f"measuring the curve {figure.name} ...")
        curves = measure_figure(figure, QUICK_EFFORT if options.quick else EFFORT)
        if reason is None:
            plots.plot(figure.name, figure.title, curves, report.RESULTS)
        drawn += curves
    return drawn


def finish(rows: Sequence[Row], drawn: Sequence[Curve], rounds: int) -> None:
    """Print and write everything; end with status 1 if a picture was wrong."""
    rows = [*rows, *map(row_of_curve, drawn)]
    report.print_table("Measured", report.COLUMNS, [report.cells(row) for row in folded(rows)])
    report.write(rows, rounds, list(map(as_json, drawn)))
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
