"""
``python -m benchmarks.dial``: whether frames keep to the time and the error that was asked for.

A camera goes around each of five scenes. With ``time_budget`` the frames' actual times are held
against the budget, those of a `Renderer` and lone ones of `render`: how many take at most a quarter
more. With ``max_error`` the actual error, as the reference tells it, is held against bounds that
are multiples of the standard's error; how long the frame and all that was drawn to choose its
quality took is told as a share of what the reference takes. A bound that is not kept is a fault; a
time that is not kept is only told.
"""

from __future__ import annotations

import statistics
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import click
import numpy as np
from rich.console import Console
from rich.table import Table

import rasterjit as rj
from rasterjit import accuracy, transforms
from rasterjit.rendering.budget import light_of, root_mean_square

TEAPOT = Path(__file__).parents[1] / "models" / "teapot.obj"

MADE = ("floor", "highlights", "shadows", "glass")
"""Scenes besides the teapot, of `rasterjit.accuracy`."""

ALLOWED = 1.25
"""Times the budget that a frame may take."""

STEP = 0.5
"""Degrees that the camera goes on from frame to frame."""

BOUNDS = (2.0, 1.0, 0.5, 0.25)
"""Bounds that errors are asked to keep to, over the standard's error."""

LIGHT = ("color", "linear")

Draw: TypeAlias = Callable[..., rj.Frame]
"""Draws a frame of a scene and a camera in a time."""


@dataclass(frozen=True)
class Orbit:
    """A scene that a camera goes around."""

    name: str
    scene: rj.Scene
    camera: rj.PerspectiveCamera

    def turned(self, degrees: float) -> rj.PerspectiveCamera:
        """Return the camera, gone around the vertical axis through its target."""
        way = np.subtract(self.camera.eye, self.camera.target)
        return replace(
            self.camera,
            eye=tuple(self.camera.target + transforms.apply(transforms.rotate_y(degrees), way)),
        )


@dataclass(frozen=True)
class Kept:
    """How the frames of one scene kept to a time budget."""

    seconds: tuple[float, ...]
    predicted: tuple[float, ...]
    qualities: tuple[rj.Quality, ...]

    def share(self, budget: float) -> float:
        """Return the share of the frames that took at most a quarter more than the budget."""
        return sum(time <= ALLOWED * budget for time in self.seconds) / len(self.seconds)


@dataclass(frozen=True)
class Bounded:
    """How one frame kept to a bound of its error."""

    bound: float
    error: float
    quality: rj.Quality
    time: float
    """Seconds with all that was drawn to choose the quality, over those of the reference."""

    @property
    def holds(self) -> bool:
        """Whether the actual error is within the bound."""
        return self.error <= self.bound


def orbits() -> Iterator[Orbit]:
    """Yield the five scenes."""
    scene = rj.load(TEAPOT)
    yield Orbit("teapot", scene, rj.fit_camera(scene))
    for name in MADE:
        made = accuracy.make(name)
        yield Orbit(name, made.scene, made.camera)


def keep_to_time(orbit: Orbit, draw: Draw, budget: float, frames: int) -> Kept:
    """Draw frames of a camera that moves, in a time."""
    choices = [
        draw(orbit.scene, orbit.turned(STEP * number), time_budget=budget).choice
        for number in range(frames)
    ]
    return Kept(
        tuple(choice.seconds for choice in choices),
        tuple(choice.predicted_seconds for choice in choices),
        tuple(choice.quality for choice in choices),
    )


def keep_to_error(orbit: Orbit, size: tuple[int, int]) -> Iterator[Bounded]:
    """Draw a frame for each of the bounds, and the reference beside it."""
    with rj.Renderer(size) as renderer:
        standard = light_of(renderer.render(orbit.scene, orbit.camera, outputs=LIGHT)).copy()
        renderer.quality = rj.Quality.reference()
        renderer.render(orbit.scene, orbit.camera, outputs=LIGHT)
        start = time.perf_counter()
        reference = light_of(renderer.render(orbit.scene, orbit.camera, outputs=LIGHT)).copy()
        whole = time.perf_counter() - start
    usual = root_mean_square(standard - reference)
    for factor in BOUNDS:
        bound = factor * usual
        # What the first frame compiles is not what it takes.
        for _ in range(2):
            start = time.perf_counter()
            frame = rj.render(orbit.scene, orbit.camera, size=size, outputs=LIGHT, max_error=bound)
            seconds = time.perf_counter() - start
        error = root_mean_square(light_of(frame) - reference)
        yield Bounded(bound, error, frame.choice.quality, seconds / whole)


def table_of_times(budget: float) -> Table:
    """Return the empty table of ``time_budget``."""
    table = Table(title=f"time_budget={budget:g}")
    for title in ("scene", f"within {ALLOWED:g} x budget", "median ms", "largest ms",
                  "prediction off by", "mostly"):  # fmt: skip
        table.add_column(title)
    return table


def row_of_times(name: str, kept: Kept, budget: float) -> tuple[str, ...]:
    """Return a row of it."""
    off = statistics.median(
        abs(predicted - actual) / actual
        for predicted, actual in zip(kept.predicted, kept.seconds, strict=True)
    )
    (quality, _), *_ = Counter(kept.qualities).most_common(1)
    return (
        name, f"{100.0 * kept.share(budget):.0f} %", f"{1e3 * statistics.median(kept.seconds):.1f}",
        f"{1e3 * max(kept.seconds):.1f}", f"{100.0 * off:.0f} %", str(quality),
    )  # fmt: skip


@click.command()
@click.option("--budget", type=click.FloatRange(0, min_open=True), default=0.02, show_default=True,
              help="Seconds of a frame.")  # fmt: skip
@click.option("--frames", type=click.IntRange(1), default=100, show_default=True,
              help="Frames of each scene that are drawn in a time.")  # fmt: skip
@click.option("--size", type=(int, int), default=(640, 480), show_default=True,
              help="Width and height, pixels.")  # fmt: skip
@click.pass_context
def main(context: click.Context, budget: float, frames: int, size: tuple[int, int]) -> None:
    """Hold frames against the time and the error that was asked for; status 1 if an error is not
    kept to."""
    warnings.simplefilter("ignore", rj.CalibrationWarning)
    times, errors = table_of_times(budget), Table(title="max_error")
    for title in ("scene", "bound", "actual error", "holds", "time / reference's", "quality"):
        errors.add_column(title)
    faults = 0
    for orbit in orbits():
        with rj.Renderer(size) as renderer:
            kept = keep_to_time(orbit, renderer.render, budget, frames)
        times.add_row(*row_of_times(orbit.name, kept, budget))
        alone = keep_to_time(orbit, partial(rj.render, size=size), budget, frames)
        times.add_row(*row_of_times(f"{orbit.name}, each alone", alone, budget))
        for found in keep_to_error(orbit, size):
            faults += not found.holds
            errors.add_row(
                orbit.name, f"{found.bound:.5f}", f"{found.error:.5f}",
                "yes" if found.holds else "NO", f"{found.time:.2f}", str(found.quality),
            )  # fmt: skip
    console = Console(width=None if Console().is_terminal else 140)
    console.print(times)
    console.print(errors)
    context.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
