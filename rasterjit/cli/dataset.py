"""The command that makes data sets: its options, and what it prints while it works."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.cli.options import (
    ColorType,
    Effects,
    FiniteType,
    NamesType,
    SizeType,
    UpType,
    add_options,
    isolate_option,
    max_bytes_option,
    on_damage_option,
    quality_options,
    refuse_idle,
)
from rasterjit.cli.program import in_options
from rasterjit.cli.report import progress_notice, warn

if TYPE_CHECKING:
    from rasterjit.dataset.making import Outcome
    from rasterjit.dataset.recipe import Recipe

MOST_NAMED = 20
"""Failures that are printed; all are in the file."""


class SquareType(SizeType):
    """Width and height, or one number for both: ``512`` or ``640x480``."""

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> tuple[int, int]:
        """Return (width, height), or raise click's usage error."""
        if isinstance(value, str) and re.fullmatch(r"[0-9]+", value.strip()):
            value = f"{value.strip()}x{value.strip()}"
        return super().convert(value, parameter, context)


class KeptType(NamesType):
    """Names of what is kept of each view, ``color,depth``."""

    def check(self, names: list[str]) -> tuple[str, ...]:
        """Return the names, or raise ``ValueError``."""
        from rasterjit.dataset.recipe import Recipe

        return Recipe(outputs=names).outputs


class WorkersType(click.ParamType):
    """A number of processes, or the address of a scheduler, ``tcp://host:8786``."""

    name = "N|ADDRESS"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> int | str:
        """Return the number or the address, or raise click's usage error."""
        if isinstance(value, int) or "://" in value:
            return value
        if not re.fullmatch(r"[0-9]{1,3}", value) or not 1 <= int(value) <= 256:
            self.fail(
                f"{value!r} is neither a number in 1..256 nor an address such as tcp://host:8786",
                parameter,
                context,
            )
        return int(value)


def dataset_options(command: Callable) -> Callable:
    """Add the argument and the options of the command."""
    return add_options(
        [
            # What is read and written.
            click.argument("folder", type=click.Path(path_type=Path)),
            click.option("-o", "--output", type=click.Path(path_type=Path), required=True,
                         metavar="OUT", help="Folder to write: a new one, or one to continue."),
            click.option("--views", type=click.IntRange(1, 10_000), default=24, show_default=True,
                         help="Pictures of each mesh."),
            click.option("--outputs", type=KeptType(), default="color,depth,normal,mask",
                         show_default=True, metavar="NAMES",
                         help="What to write, separated by commas: color, depth, normal, mask "
                              "(PNG), coco (JSON, of color), and any other output of a frame but "
                              "motion (.npz)."),
            click.option("--size", type=SquareType(), default="512", show_default=True,
                         metavar="N|WxH", help="Size of the pictures, pixels."),
            # Where the cameras stand.
            click.option("--cameras", "layout", default="sphere", show_default=True,
                         type=click.Choice(["sphere", "random", "ring"]),
                         help="Where cameras stand: evenly all around, at random all around, or "
                              "on a circle."),
            click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
                         help="Seed of --cameras random."),
            click.option("--elevation", metavar="DEG", type=FiniteType(-90.0, 90.0), default=20.0,
                         show_default=True, help="Elevation of --cameras ring, degrees."),
            click.option("--fov", "fov_y", metavar="DEG", default=45.0, show_default=True,
                         type=FiniteType(0.0, 180.0, min_open=True, max_open=True),
                         help="Vertical field of view, degrees."),
            click.option("--up", type=UpType(), default="y", show_default=True,
                         help="Which way is up in the meshes."),
            # How meshes are drawn.
            click.option("--background", type=ColorType(), default="transparent",
                         show_default=True, help="A CSS colour name, #rrggbb or #rrggbbaa."),
            click.option("--on-invalid", type=click.Choice(["raise", "drop"]), default="raise",
                         show_default=True,
                         help="Leave out a mesh with NaN or infinite vertices, or draw the rest."),
            on_damage_option,
            max_bytes_option,
            isolate_option,
            quality_options,
            # Who draws them.
            click.option("--workers", type=WorkersType(), default="1", show_default=True,
                         help="Processes that share the work, or a Dask scheduler's address (needs "
                              "rasterjit[distributed]). Any number writes the same files."),
        ],
        command,
    )  # fmt: skip


def make_dataset(
    folder: Path, output: Path, workers: int | str, quiet: bool, **options: Any
) -> None:
    """Make the data set, show how far it has come, and say what came of it."""
    from rasterjit.dataset.making import make
    from rasterjit.dataset.recipe import Recipe

    if options["layout"] != "random":
        refuse_idle(["seed"], "it is for --cameras random")
    if options["layout"] != "ring":
        refuse_idle(["elevation"], "it is for --cameras ring")
    chosen = {name: options.pop(name) for name in ("preset", "changes", "samples")}
    quality = Effects(False, None, False, None, None, None, **chosen).quality()
    recipe = Recipe(**options, quality=quality)
    start = time.perf_counter()
    with progress_notice(quiet), _progress(recipe, quiet) as report:
        summary = make(folder, output, recipe, workers=workers, report=report)
    for name, lines in list(summary.warnings.items())[:MOST_NAMED]:
        for line in lines:
            warn(f"{name}: {in_options(line.removeprefix(f'{name}: '))}", quiet)
    for name, reason in list(summary.failures.items())[:MOST_NAMED]:
        warn(f"left out {name}: {in_options(reason)}", quiet)
    if not quiet:
        seconds = time.perf_counter() - start
        views = summary.made * recipe.views
        click.echo(
            f"wrote {output}: {summary.made} meshes, {views} views in {seconds:.1f} s; "
            f"{summary.present} were there, {len(summary.failures)} failed"
        )
    if summary.failures:
        count = len(summary.failures) + summary.made + summary.present
        raise click.ClickException(
            f"{len(summary.failures)} of {count} mesh files could not be drawn: see failures.json"
        )


@contextmanager
def _progress(recipe: Recipe, quiet: bool) -> Iterator[Callable[[Outcome, int, int], None]]:
    """Show meshes done, views a second and the time left, if somebody is looking."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    shown = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=quiet or not console.is_terminal,
    )
    with shown:
        task = shown.add_task("Rendering", total=None, rate="")

        def report(outcome: Outcome, done: int, total: int) -> None:
            """Count one mesh more."""
            speed = shown.tasks[0].finished_speed or shown.tasks[0].speed
            rate = f"{speed * recipe.views:.1f} views/s" if speed else ""
            shown.update(task, completed=done, total=total, rate=rate)

        yield report
