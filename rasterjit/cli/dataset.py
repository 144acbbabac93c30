"""The command that makes data sets: its options, and what it prints while it works."""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.cli import option_types
from rasterjit.cli.options import (
    Effects,
    SceneOptions,
    add_options,
    option,
    quality_options,
    refuse_unused,
)
from rasterjit.cli.program import spell_options
from rasterjit.cli.report import say, show_compile_progress, warn

if TYPE_CHECKING:
    from rasterjit.dataset.dataset_builder import Outcome
    from rasterjit.dataset.recipe import Recipe

MAX_PRINTED_FAILURES = 20
"""Most failures that are printed; the report file has all."""


@option_types.text_type("size")
def square_type(text: str) -> tuple[int, int]:
    """Return width and height, or one number for both: ``512`` or ``640x480``."""
    side = text.strip()
    return option_types.size_type.read(f"{side}x{side}" if re.fullmatch(r"[0-9]+", side) else text)


@option_types.text_type("names")
def outputs_to_write_type(text: str) -> tuple[str, ...]:
    """Return the outputs to write of each view, ``color,depth``."""
    from rasterjit.dataset.recipe import Recipe

    return Recipe(outputs=option_types.split_names(text)).outputs


@option_types.text_type("N|ADDRESS")
def workers_type(text: str) -> int | str:
    """Return a number of processes, or the address of a scheduler, ``tcp://host:8786``."""
    if "://" in text:
        return text
    if not re.fullmatch(r"[0-9]{1,3}", text) or not 1 <= int(text) <= 256:
        raise ValueError(
            f"{text!r} is neither a number in 1..256 nor an address such as tcp://host:8786"
        )
    return int(text)


@dataclasses.dataclass(frozen=True)
class DatasetOptions:
    """
    Options of the command, by the names of a `Recipe`'s fields.

    Parameters
    ----------
    output : Path
        Folder to write: a new one, or one to continue.
    views : int
        Pictures of each mesh.
    outputs : tuple of str
        What to write, separated by commas: color, depth, normal, mask (PNG), coco (JSON, of color),
        and any other output of a frame but motion (.npz).
    size : (int, int)
        Size of the pictures, pixels.
    layout : {"sphere", "random", "ring"}
        Where cameras stand: evenly all around, at random all around, or on a circle.
    seed : int
        Seed of --cameras random.
    elevation : float
        Elevation of --cameras ring, degrees.
    fov_y : float
        Vertical field of view, degrees.
    up : (float, float, float)
        Which way is up in the meshes.
    background : str
        A CSS colour name, #rrggbb or #rrggbbaa.
    """

    output: Path = option(
        click.Path(path_type=Path), "-o", "--output", required=True, metavar="OUT"
    )
    views: int = option(click.IntRange(1, 10_000), default=24)
    outputs: str = option(outputs_to_write_type, default="color,depth,normal,mask", metavar="NAMES")
    size: str = option(square_type, default="512", metavar="N|WxH")
    layout: str = option(click.Choice(["sphere", "random", "ring"]), "--cameras", default="sphere")
    seed: int = option(click.IntRange(0), default=0)
    elevation: float = option(option_types.FiniteType(-90.0, 90.0), default=20.0, metavar="DEG")
    fov_y: float = option(
        option_types.FiniteType(0.0, 180.0, min_open=True, max_open=True),
        "--fov",
        default=45.0,
        metavar="DEG",
    )
    up: str = option(option_types.up_type, default="y")
    background: str = option(option_types.color_type, default="transparent")


def dataset_options(command: Callable) -> Callable:
    """Add the argument and the options of the command."""
    workers = click.option(
        "--workers", type=workers_type, default="1", show_default=True,
        help="Processes that share the work, or a Dask scheduler's address (needs "
        "rasterjit[distributed]). Any number writes the same files.",
    )  # fmt: skip
    reading = add_options(
        SceneOptions, ("on_invalid", "on_damage", "max_bytes", "isolate"),
        on_invalid="Leave out a mesh with NaN or infinite vertices, or draw the rest.",
    )  # fmt: skip
    folder = click.argument("folder", type=click.Path(path_type=Path))
    return folder(add_options(DatasetOptions)(reading(quality_options(workers(command)))))


def make_dataset(
    folder: Path, output: Path, workers: int | str, quiet: bool, **options: Any
) -> None:
    """Make the data set, show progress, and print a summary."""
    from rasterjit.dataset.dataset_builder import make
    from rasterjit.dataset.recipe import Recipe

    if options["layout"] != "random":
        refuse_unused(["seed"], "it is for --cameras random")
    if options["layout"] != "ring":
        refuse_unused(["elevation"], "it is for --cameras ring")
    chosen = {name: options.pop(name) for name in ("preset", "changes", "samples")}
    quality = Effects(**chosen).quality()
    recipe = Recipe(**options, quality=quality)
    start = time.perf_counter()
    with show_compile_progress(quiet), _show_progress(recipe, quiet) as report:
        summary = make(folder, output, recipe, workers=workers, report=report)
    for name, lines in list(summary.warnings.items())[:MAX_PRINTED_FAILURES]:
        for line in lines:
            warn(f"{name}: {spell_options(line.removeprefix(f'{name}: '))}", quiet)
    for name, reason in list(summary.failures.items())[:MAX_PRINTED_FAILURES]:
        warn(f"left out {name}: {spell_options(reason)}", quiet)
    if not quiet:
        seconds = time.perf_counter() - start
        views = summary.made * recipe.views
        say(
            f"wrote {output}: {summary.made} meshes, {views} views in {seconds:.1f} s; "
            f"{summary.present} were there, {len(summary.failures)} failed"
        )
    if summary.failures:
        count = len(summary.failures) + summary.made + summary.present
        raise click.ClickException(
            f"{len(summary.failures)} of {count} mesh files could not be drawn: see failures.json"
        )


@contextmanager
def _show_progress(recipe: Recipe, quiet: bool) -> Iterator[Callable[[Outcome, int, int], None]]:
    """Show meshes done, views per second and time left, if standard error is a terminal."""
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
