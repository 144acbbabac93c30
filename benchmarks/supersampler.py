"""
``python -m benchmarks.supersampler``: how far each level is from many points of each pixel.

Draws the scenes of ``rasterjit.accuracy`` in all that a study of them tries, and in the reference,
which studies take for the truth. Here it is held against another program: `true_pictures`, in NumPy
and float64, which looks at 16 x 16 points of each pixel. No level should be nearer to it than the
reference. One that is ends this with status 1.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable

import click
import numpy as np
from rich.console import Console
from rich.table import Table

import rasterjit as rj
from benchmarks.true_pictures import SIDE, true_light
from rasterjit.accuracy.results import PICTURE_OUTPUTS, STANDARD
from rasterjit.accuracy.settings_to_try import (
    Attempt,
    find_idle_settings,
    list_combined_attempts,
    list_preset_attempts,
    list_single_attempts,
)
from rasterjit.accuracy.study import Studio
from rasterjit.accuracy.test_scenes import SCENES, MadeScene, make
from rasterjit.rendering.quality_selection import light_of, root_mean_square
from rasterjit.scene.quality import LEVELS, PRESETS

SIZE = (96, 72)
"""Pixels of the pictures."""

REFERENCE = "reference"

OTHERS = "the best combination"
"""What of the combinations of settings is told."""


def attempts_of(made: MadeScene, size: tuple[int, int]) -> list[Attempt]:
    """Return the reference, the standard, and all that a study of the scene would try."""
    plan = rj.explain(made.scene, made.camera, size=size)
    idle = find_idle_settings(plan, tuple(LEVELS))
    active = [name for name in LEVELS if name not in idle]
    tried = [
        attempt
        for list_attempts in (list_single_attempts, list_preset_attempts, list_combined_attempts)
        for attempt in list_attempts(active)
    ]
    presets = [Attempt(name, name, PRESETS[name]()) for name in (REFERENCE, STANDARD)]
    with Studio(made.scene, made.camera, size, None) as studio:
        return [attempt for attempt in presets + tried if studio.refusal_reason(attempt) is None]


def errors_of(made: MadeScene, size: tuple[int, int], side: int = SIDE) -> dict[str, float]:
    """
    Return how far levels are from the truth.

    Parameters
    ----------
    made : MadeScene
    size : (int, int)
        Width and height, pixels.
    side : int
        The truth looks at ``side * side`` points of each pixel.

    Returns
    -------
    dict
        Root mean square difference of linear light, by `Attempt.label`; the first is the reference.
    """
    true, found = true_light(made.scene, made.camera, size, side), {}
    with rj.Renderer(size) as renderer:
        for attempt in attempts_of(made, size):
            renderer.quality = attempt.quality
            frame = renderer.render(made.scene, made.camera, outputs=PICTURE_OUTPUTS)
            name = attempt.level if attempt.setting in PRESETS else attempt.label
            found[name] = root_mean_square(light_of(frame).astype(np.float64) - true)
    return found


def nearer_than_reference(errors: dict[str, float]) -> list[str]:
    """Return the levels that are nearer to the truth than the reference."""
    return [name for name, error in errors.items() if error < errors[REFERENCE]]


def table_of(errors: dict[str, dict[str, float]], side: int) -> Table:
    """Return a row for each level and a column for each scene; combinations are one row."""
    table = Table(title=f"RMSE of linear light against {side} x {side} points of each pixel")
    table.add_column("level", no_wrap=True)
    for scene in errors:
        table.add_column(scene, justify="right", no_wrap=True)
    alone = [f"{name}={level}" for name, levels in LEVELS.items() for level in levels]
    names = [*PRESETS, *alone]
    for name in (REFERENCE, *(name for name in names if name != REFERENCE)):
        values = [found.get(name) for found in errors.values()]
        if any(value is not None for value in values):
            table.add_row(name, *map(_in_figures, values))
    combined = [
        min((error for name, error in found.items() if name not in names), default=None)
        for found in errors.values()
    ]
    table.add_row(OTHERS, *map(_in_figures, combined))
    return table


def _in_figures(value: float | None) -> str:
    """Return an error with three figures; a dash where a level changes nothing."""
    return "-" if value is None else f"{value:.2e}"


@click.command(help=(__doc__ or "").split(":", 1)[1])
@click.option("--only", multiple=True, type=click.Choice(list(SCENES)), help="A scene.")
@click.option("--size", nargs=2, type=int, default=SIZE, show_default=True, help="Pixels.")
@click.option("--side", default=SIDE, show_default=True, help="Points a side of each pixel.")
def main(only: Iterable[str], size: tuple[int, int], side: int) -> None:
    """Print the table; see the help."""
    errors = {name: errors_of(make(name), size, side) for name in only or SCENES}
    console = Console(width=None if sys.stdout.isatty() else 200)
    console.print(table_of(errors, side))
    nearer = {name: nearer_than_reference(found) for name, found in errors.items()}
    for scene, names in nearer.items():
        if names:
            console.print(f"{scene}: nearer than the reference are {', '.join(names)}")
    sys.exit(int(any(nearer.values())))


if __name__ == "__main__":
    main()
