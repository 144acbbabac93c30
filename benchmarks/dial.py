"""
``python -m benchmarks.dial``: whether frames keep to the time and the error that was asked for.

A camera goes around each of five scenes. With ``time_budget`` the frames' actual times are held
against the budget, those of a `Renderer` and lone ones of `render`: how many take at most a quarter
more. With ``max_error`` the 32 pictures of ``dial_scenes`` are asked for in round bounds, and in
bounds just above the errors of some qualities. The table tells what was chosen, its actual error,
its time over that of the fastest quality whose error is below the bound, and how long it took to
choose: processor time, which other programs hardly change. A bound that is not kept is a fault; a
time that is not kept is only told.
"""

from __future__ import annotations

import statistics
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import click
import numpy as np
from rich.console import Console
from rich.table import Table

import rasterjit as rj
from benchmarks.dial_scenes import PICTURES, Picture
from rasterjit import accuracy, transforms
from rasterjit.rendering.quality_selection import ERROR_LADDER, LADDER, light_of, root_mean_square

TEAPOT = Path(__file__).parents[1] / "models" / "teapot.obj"

MADE = ("floor", "highlights", "shadows", "glass")
"""Scenes besides the teapot, of `rasterjit.accuracy`."""

ALLOWED = 1.25
"""Times the budget that a frame may take."""

STEP = 0.5
"""Degrees that the camera goes on from frame to frame."""

BOUNDS = (0.05, 0.02, 0.005)
"""Bounds of each picture's error, besides those just above the errors of some qualities."""

ABOVE = 1.02
"""Bound just above a quality's error, over the error."""

TURNS = 3
"""Frames of each quality whose least processor time counts; of many pictures, one."""

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
class Measured:
    """What a quality costs and buys in a picture."""

    error: float
    seconds: float
    """Processor time."""


@dataclass(frozen=True)
class Bounded:
    """How one frame kept to a bound of its error."""

    bound: float
    error: float
    quality: rj.Quality
    time: float
    """Of its quality, over that of the fastest one whose error is below the bound."""
    choosing: float
    """Time of the call, over that of a standard frame."""

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


def qualities_of(plan: rj.RenderPlan) -> list[rj.Quality]:
    """Return the qualities that a picture can be drawn in."""
    blends = plan.facts.transparency.used
    ladder = (*ERROR_LADDER, LADDER[-1])
    return [quality for quality in ladder if not (blends and quality.samples == "area")]


def measure_qualities(picture: Picture, turns: int = TURNS) -> dict[rj.Quality, Measured]:
    """Return what each quality costs and buys in a picture, the reference last."""
    scene, camera = picture.scene_and_camera()
    lights, seconds = {}, {}
    with rj.Renderer(picture.size, threads=1) as renderer:
        for quality in qualities_of(rj.explain(scene, camera, size=picture.size)):
            renderer.quality = quality
            is_one = quality.samples not in (64, 256)
            # What the first frame compiles is not what it takes.
            lights[quality] = light_of(renderer.render(scene, camera, outputs=LIGHT)).copy()
            times = []
            for _ in range(turns if is_one else min(turns, 1)):
                start = time.process_time()
                renderer.render(scene, camera, outputs=LIGHT)
                times.append(time.process_time() - start)
            seconds[quality] = min(times, default=1.0)
    reference = lights[LADDER[-1]]
    return {
        quality: Measured(root_mean_square(light - reference), seconds[quality])
        for quality, light in lights.items()
    }


def bounds_of(measured: dict[rj.Quality, Measured]) -> list[float]:
    """Return bounds to ask for: round ones, and just above the errors of every third quality."""
    errors = [one.error for one in measured.values() if one.error > 0.0]
    return sorted({*BOUNDS, *(ABOVE * error for error in errors[::3])}, reverse=True)


def keep_to_error(
    picture: Picture, measured: dict[rj.Quality, Measured], bounds: Sequence[float]
) -> Iterator[Bounded]:
    """Draw a frame for each of the bounds."""
    scene, camera = picture.scene_and_camera()
    for bound in bounds:
        start = time.process_time()
        frame = rj.render(scene, camera, size=picture.size, max_error=bound, threads=1)
        choosing = time.process_time() - start
        best = min(one.seconds for one in measured.values() if one.error <= bound)
        quality = frame.choice.quality
        yield Bounded(
            bound, measured[quality].error, quality, measured[quality].seconds / best,
            choosing / measured[rj.Quality()].seconds,
        )  # fmt: skip


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
    ratios: list[float] = []
    for title in (
        "picture",
        "asked",
        "error",
        "holds",
        "time / best's",
        "call / standard",
        "quality",
    ):
        errors.add_column(title)
    faults = 0
    for orbit in orbits():
        with rj.Renderer(size) as renderer:
            kept = keep_to_time(orbit, renderer.render, budget, frames)
        times.add_row(*row_of_times(orbit.name, kept, budget))
        alone = keep_to_time(orbit, partial(rj.render, size=size), budget, frames)
        times.add_row(*row_of_times(f"{orbit.name}, each alone", alone, budget))
    for picture in PICTURES:
        measured = measure_qualities(picture)
        for found in keep_to_error(picture, measured, bounds_of(measured)):
            faults += not found.holds
            ratios.append(found.time)
            errors.add_row(
                str(picture), f"{found.bound:.5f}", f"{found.error:.5f}",
                "yes" if found.holds else "NO", f"{found.time:.2f}", f"{found.choosing:.0f}",
                str(found.quality),
            )  # fmt: skip
    errors.caption = (
        f"time / best's: median {statistics.median(ratios):.2f}, largest {max(ratios):.2f}"
    )
    console = Console(width=None if Console().is_terminal else 140)
    console.print(times)
    console.print(errors)
    context.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
