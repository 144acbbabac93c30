"""The command ``rasterjit accuracy``: a study of a file or a made scene, and its report."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rasterjit.accuracy import Study, Trial, can_make_page, make, sentences, study
from rasterjit.accuracy.files import CSV_NAME, JSON_NAME, prepare_folder
from rasterjit.accuracy.results import COMBINATIONS
from rasterjit.accuracy.study import SIZE
from rasterjit.cli_effects import Effects
from rasterjit.cli_files import load_scene
from rasterjit.cli_options import Look, View

if TYPE_CHECKING:
    from rich.console import Console

    from rasterjit.accuracy.timing import Progress

PAGE_NAME = "index.html"


def study_scene(
    what: str | Path, view: View, look: Look, effects: Effects, options: dict[str, Any]
) -> Study:
    """
    Study a scene, print what was found and write the report.

    Parameters
    ----------
    what : str or Path
        Name of a made scene, or a file.
    view, look, effects : View, Look, Effects
    options : dict
        Those of the command: knobs, budget, output, size, threads and quiet.
    """
    quiet, output = options["quiet"], options["output"]
    try:
        prepare_folder(output)
    except ValueError as error:
        raise click.BadOptionUsage("--output", f"--output: {error}") from None
    size, camera = options["size"] or SIZE, None
    if isinstance(what, Path):
        scene, name = load_scene(what, look, effects, quiet), what.name
    else:
        made, name = make(what), what
        scene, camera, size = made.scene, made.camera, options["size"] or made.size
        look.apply(scene)
        effects.apply(scene)
    camera = view.camera(scene, size) or camera
    with _progress(quiet) as progress:
        found = study(
            scene, camera, size=size, knobs=options["knobs"], budget=options["budget"],
            threads=options["threads"], progress=progress, output=output, name=name,
        )  # fmt: skip
    if not quiet:
        _print(found, Path(output))
    return found


@contextmanager
def _progress(quiet: bool) -> Iterator[Progress | None]:
    """Give what shows progress on standard error, if somebody is looking."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting")

        def show(text: str, done: int, count: int) -> None:
            bar.update(task, description=text, completed=done, total=count)

        yield show


def _print(found: Study, folder: Path) -> None:
    """Print the table, the sentences, what is missing from them, and the files."""
    from rich.console import Console

    console = Console(highlight=False, markup=False, emoji=False)
    _print_table(found, console)
    for sentence in sentences(found).values():
        console.print(f"- {sentence}")
    console.print()
    console.print(f"Pareto front: {'; '.join(found.front)}")
    for label, reason in found.impossible.items():
        console.print(f"not possible: {label}: {reason}")
    if found.left_out:
        why = "interrupted" if found.interrupted else "no time left"
        console.print(f"left out ({why}): {'; '.join(found.left_out)}")
    names = [JSON_NAME, CSV_NAME, *([PAGE_NAME] if can_make_page() else [])]
    for name in names:
        click.echo(f"wrote {folder / name}")
    if not can_make_page():
        click.echo(f'no {PAGE_NAME}: its plots need matplotlib; pip install "rasterjit[accuracy]"')


def _print_table(found: Study, console: Console) -> None:
    """Print time and error of each trial."""
    from rich.table import Table

    width, height = found.size
    table = Table(
        title=f"{found.scene}, {width} x {height}, {found.threads} threads, {found.rounds} rounds; "
        "* on the Pareto front",
        padding=(0, 1),
    )
    table.add_column("setting", no_wrap=True)
    table.add_column("level")
    has_flip = found.standard.errors.flip is not None
    names = ["ms", "× standard", "rmse", "PSNR", *(["FLIP"] if has_flip else []), "wrong px"]
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("dominated by")
    last = None
    for trial in (found.standard, *found.trials):
        if trial.setting != last:
            table.add_section()
        table.add_row(*_cells(trial, found, trial.setting != last))
        last = trial.setting
    console.print(table)


def _cells(trial: Trial, found: Study, is_first: bool) -> list[str]:
    """Return a row of the table."""
    errors, (low, high) = trial.errors, trial.spread
    mark = " *" if trial.label in found.front else ""
    cells = [
        trial.setting if is_first else "",
        trial.level + mark,
        f"{1e3 * trial.median:.2f}",
        f"{trial.ratio:.2f} ±{(high - low) / 2.0:.2f}",
        f"{errors.rmse:.2e}",
        f"{errors.psnr:.1f}",
    ]
    if found.standard.errors.flip is not None:
        cells.append("-" if errors.flip is None else f"{errors.flip:.4f}")
    cells.append(f"{errors.wrong_faces:,}")
    cells.append(short(trial.dominated_by, trial.setting))
    return cells


def short(label: str | None, setting: str) -> str:
    """Return a label without the setting that its row names already."""
    if label is None or setting == COMBINATIONS:
        return label or ""
    return label.removeprefix(f"{setting}=")
