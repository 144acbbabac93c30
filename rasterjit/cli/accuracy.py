"""The command ``rasterjit accuracy``: a study of a file or a made scene, and its report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.accuracy import results, sentences, study
from rasterjit.accuracy.calibration import calibrate
from rasterjit.accuracy.choice import choose, is_measured
from rasterjit.accuracy.many_scenes import FolderStudy, study_folder
from rasterjit.accuracy.report.files import (
    CSV_NAME,
    JSON_NAME,
    can_make_page,
    prepare_folder,
)
from rasterjit.accuracy.report.page import PAGE_NAME
from rasterjit.accuracy.sentences import (
    describe_alternatives,
    describe_certainty,
    describe_choice,
    format_options,
    summarize_folder,
)
from rasterjit.accuracy.study import SIZE
from rasterjit.accuracy.test_scenes import make
from rasterjit.cli.options import RenderOptions
from rasterjit.cli.program import load_scene
from rasterjit.cli.report import escape_controls, say
from rasterjit.io.meshes import mesh_files

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from rasterjit.accuracy.timing import Progress

STUDY_OPTIONS = ("knobs", "budget", "max_error", "lens", "threads")
"""Options of the command that are passed on to the study."""

MIN_WIDE_COLUMNS = 120
"""Least columns of a terminal that also shows PSNR and FLIP."""

FILE_COLUMNS = 140
"""Columns of the table where the output is not a terminal."""


def study_scene(what: str | Path, shown: RenderOptions, options: dict[str, Any]) -> results.Study:
    """
    Study a scene, print the results and write the report.

    Parameters
    ----------
    what : str or Path
        Name of a made scene, or a file.
    shown : RenderOptions
    options : dict
        Those of the command.
    """
    quiet, output = options["quiet"], options["output"]
    view, look, effects, _ = shown
    try:
        prepare_folder(output)
    except ValueError as error:
        raise click.BadOptionUsage("--output", f"--output: {error}") from None
    size, camera = view.find_size(options["size"] or SIZE), None
    if isinstance(what, Path):
        scene, name = load_scene(what, look, effects, quiet), what.name
    else:
        made, name = make(what), what
        scene, camera, size = made.scene, made.camera, view.find_size(options["size"] or made.size)
        look.apply(scene)
        effects.apply(scene)
    camera = view.camera(scene, size) or camera
    with _show_progress(quiet) as progress:
        found = study(
            scene, camera, size=size, progress=progress, output=output, name=name,
            **_gather_study_options(shown, options),
        )  # fmt: skip
    if not quiet:
        _print_study(found, Path(output))
    return found


def _gather_study_options(shown: RenderOptions, options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of the command that the study takes, with the lens of ``--camera``."""
    calibrated = shown.view.calibrated()
    lens = options["lens"] if calibrated is None else calibrated.lens
    return {name: options[name] for name in STUDY_OPTIONS} | {"lens": lens}


def study_files(folder: Path, shown: RenderOptions, options: dict[str, Any]) -> FolderStudy:
    """Study the scenes of a folder, print the quality for all of them, and write the reports."""
    quiet, output = options["quiet"], options["output"]
    size = shown.view.find_size(options["size"] or SIZE)
    if Path(output).resolve() == folder.resolve():
        raise click.BadOptionUsage("--output", "--output: must not be the folder of the scenes")
    files = {file.relative_to(folder.resolve()).as_posix(): file for file in mesh_files(folder)}
    if not files:
        raise click.UsageError(f"no mesh files in {str(folder)!r}")

    def loader(file: Path) -> Callable[[], Any]:
        def loaded() -> Any:
            scene = load_scene(file, shown.look.of_folder(), shown.effects, quiet)
            return scene, shown.view.camera(scene, size)

        return loaded

    with _show_progress(quiet) as progress:
        found = study_folder(
            {name: loader(file) for name, file in files.items()}, size=size, progress=progress,
            output=output, name=folder.resolve().name,
            **_gather_study_options(shown, options),
        )  # fmt: skip
    if quiet:
        return found
    for text in summarize_folder(found):
        say(text)
    say(f"  {format_options(found.take.trial, found.standard)}")
    for name, why in found.failures.items():
        say(f"not studied: {name}: {why}")
    for name in (JSON_NAME, PAGE_NAME):
        say(f"wrote {Path(output) / name}")
    return found


def calibrate_machine(threads: int | None, quiet: bool) -> None:
    """Measure time and error of qualities on this machine; print both, and where they are kept."""
    from rich.table import Column, Table

    with _show_progress(quiet) as progress:
        profile, path = calibrate(threads=threads, progress=progress)
    if quiet:
        return
    title = f"Time and error over those of a standard frame, {profile.threads} threads"
    numbers = (Column(name, justify="right") for name in ("× time", "× error"))
    table = Table("quality", *numbers, title=title, padding=(0, 1))
    for step in profile.steps:
        table.add_row(str(step.quality), f"{step.time:.2f}", f"{step.error:.3f}")
    _make_console().print(table)
    say(f"wrote {path}")


@contextmanager
def _show_progress(quiet: bool) -> Iterator[Progress | None]:
    """Yield a function that shows progress on standard error, if that is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting")

        def show(text: str, done: float, count: float) -> None:
            bar.update(task, description=escape_controls(text), completed=done, total=count)

        yield show


def _make_console() -> Console:
    """Return the console for tables; `FILE_COLUMNS` wide if the output is not a terminal."""
    from rich.console import Console

    console = Console(highlight=False, markup=False, emoji=False)
    if not console.is_terminal:
        console.width = FILE_COLUMNS
    return console


def _print_study(found: results.Study, folder: Path) -> None:
    """Print the answer, the table, the sentences, what is missing from them, and the files."""
    console = _make_console()
    console.print(describe_choice(found))
    options = format_options(choose(found).trial, found.standard)
    if options:
        console.print(f"  {options}")
    console.print(describe_certainty(found))
    console.print(describe_alternatives(found))
    console.print()
    _print_table(found, console)
    for sentence in sentences(found).values():
        console.print(f"- {sentence}")
    console.print()
    if found.effects:
        _print_effects(found, console)
    console.print(f"worth choosing: {'; '.join(found.front)}")
    for label, reason in found.impossible.items():
        console.print(f"not possible: {label}: {reason}")
    if found.left_out:
        why = "interrupted" if found.interrupted else "no time left"
        console.print(f"left out ({why}): {'; '.join(found.left_out)}")
    names = [JSON_NAME, CSV_NAME, *([PAGE_NAME] if can_make_page() else [])]
    for name in names:
        say(f"wrote {folder / name}")
    if not can_make_page():
        say(f'no {PAGE_NAME}: it needs matplotlib and jinja2; pip install "rasterjit[accuracy]"')


def _print_table(found: results.Study, console: Console) -> None:
    """Print time and error of each trial."""
    is_wide = console.width >= MIN_WIDE_COLUMNS
    names = ["ms", "× standard", "rmse", *(["PSNR", "FLIP"] if is_wide else []), "wrong px"]
    table = _make_table("setting", names, "dominated by")
    last = None
    for trial in (found.standard, *found.trials):
        cells = _format_cells(trial, found)
        shown = {name: cells[name] for name in ("level", *names, "dominated by")}
        if trial.setting != last:
            table.add_section()
        table.add_row(trial.setting if trial.setting != last else "", *shown.values())
        last = trial.setting
    width, height = found.size
    console.print(
        f"{escape_controls(found.scene)}, {width} x {height} pixels, {found.threads} threads; "
        f"{'processor ' if found.clock == results.CPU else ''}times are medians of up to "
        f"{max(found.rounds, 1)} rounds ± half of what lies between the quartiles, ? where that is "
        "not measured well enough; * worth choosing: more accurate than all that is faster"
    )
    console.print(table)


def _print_effects(found: results.Study, console: Console) -> None:
    """Print the time of each effect, and its error from the reference."""
    table = _make_table("effect", ["× standard", "rmse"], "reference")
    for cost in found.effects:
        error = "-" if cost.rmse is None else f"{cost.rmse:.2e}"
        table.add_section()
        table.add_row(cost.effect, results.FROM_SCENE, "1.00", error, cost.reference)
        for level in cost.levels:
            factor = f"{level.ratio:.2f}" if is_measured(level) else "?"
            table.add_row("", level.level, factor, f"{level.errors.rmse:.2e}")
    console.print(
        "Each effect alone, in the standard quality; errors against its own reference, or against "
        "the picture with it where there is none"
    )
    console.print(table)


def _make_table(first: str, numbers: Sequence[str], last: str) -> Table:
    """Return a table of levels without rows, of columns by their names."""
    from rich import box
    from rich.table import Column, Table

    columns = (Column(name, justify="right", no_wrap=True) for name in numbers)
    return Table(
        first, Column("level", min_width=10), *columns, last,
        box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False,
    )  # fmt: skip


def _format_cells(trial: results.Trial, found: results.Study) -> dict[str, str]:
    """Return the cells that a row of the table may show."""
    errors, (low, high) = trial.errors, trial.spread
    is_known = is_measured(trial) or trial.setting == results.STANDARD
    factor = f"{trial.ratio:.2f} ±{(high - low) / 2.0:.2f}" if is_known else "?"
    return {
        "level": trial.level + (" *" if trial.label in found.front else ""),
        "ms": f"{1e3 * trial.median:.2f}",
        "× standard": factor,
        "rmse": f"{errors.rmse:.2e}",
        "PSNR": f"{errors.psnr:.1f}",
        "FLIP": "-" if errors.flip is None else f"{errors.flip:.4f}",
        "wrong px": f"{errors.wrong_faces:,}",
        "dominated by": shorten_label(trial.dominated_by, trial.setting),
    }


def shorten_label(label: str | None, setting: str) -> str:
    """Return a label without the setting that its row already names."""
    if label is None or setting == results.COMBINATIONS:
        return label or ""
    return label.removeprefix(f"{setting}=")
