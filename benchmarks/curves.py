"""How time grows with triangles, pixels and threads, and by which power."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from benchmarks.against_peers import OWN, THREADED, Options, check_pictures, planned
from benchmarks.contestants import contestant
from benchmarks.pairing import Effort, Run, measure
from benchmarks.rows import FAILED, MISSING, Row
from benchmarks.scenes import find_scene
from benchmarks.targets import OPENGL, TINYDISPLAY

EFFORT, QUICK_EFFORT = Effort(5, 3.0), Effort(3, 1.0)
LONGEST_SECONDS = 5.0
"""A contestant that took longer for a picture draws no larger one."""

TRIANGLES = tuple(round(10 ** (power / 2)) for power in range(6, 15))
SIDES = tuple(1 << power for power in range(7, 14))
QUICK_TRIANGLES, QUICK_SIDES = TRIANGLES[::2], SIDES[::2]

NAMES = (OWN, OPENGL, TINYDISPLAY, "numpy")
THREADS_NAMES = (OWN, OPENGL)


@dataclass
class Curve:
    """The times of one contestant along one axis."""

    name: str
    """Of the figure: ``triangles``, ``fill``, ``mesh`` or ``threads_...``."""
    axis: str
    contestant: str
    x: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    """Medians, reading back included."""
    note: str = ""
    """Why points are missing, if any are."""
    is_ended: bool = False
    """Whether larger points are left out."""

    @property
    def exponent(self) -> float | None:
        """Return p of time ~ x**p, over the upper half of the points."""
        return exponent(self.x, self.ms)

    @property
    def fitted(self) -> list[float]:
        """Return the points that the exponent is fitted to."""
        return self.x[-upper_half(len(self.x)) :]


@dataclass(frozen=True)
class Figure:
    """One plot: what grows, and who draws."""

    name: str
    title: str
    axis: str
    points: tuple[int, ...]
    scene: Callable[[int], str]
    """The name of the scene at a point."""
    names: tuple[str, ...]
    x: Callable[[int], float] = float
    threads: Callable[[int], int] = lambda point: 1


def upper_half(count: int) -> int:
    """Return how many of so many points are fitted: the upper half, two at least."""
    return max(count - count // 2, 2)


def exponent(x: Sequence[float], y: Sequence[float]) -> float | None:
    """Return the slope of log y over log x, by least squares over the upper half of the points."""
    if len(x) < 2:
        return None
    used = upper_half(len(x))
    return float(np.polyfit(np.log(x[-used:]), np.log(y[-used:]), 1)[0])


def figures(options: Options, processors: int) -> list[Figure]:
    """Return what is plotted."""
    triangles = QUICK_TRIANGLES if options.quick else TRIANGLES
    sides = QUICK_SIDES if options.quick else SIDES
    counts = tuple(n for n in range(1, processors + 1) if n & (n - 1) == 0 or n == processors)
    found = [
        Figure(
            "triangles", "mesh at 1920x1080", "triangles", triangles, "triangles:{}".format, NAMES
        )
    ]
    for name, title in (("fill", "4 full-screen quads"), ("mesh", "70 k faces")):
        found.append(
            Figure(
                name, title, "pixels", sides, (name + ":{}").format, NAMES,
                lambda side: float(side * side),
            )
        )  # fmt: skip
    for scene in ("fill_back_to_front", "mesh_1m") if processors > 1 else ():
        found.append(
            Figure(
                f"threads_{scene}", scene, "threads", counts, lambda n, scene=scene: scene,
                THREADS_NAMES, threads=lambda n: n,
            )
        )  # fmt: skip
    return found


def measure_figure(figure: Figure, effort: Effort) -> list[Curve]:
    """Time each contestant at each point; one that got slow or failed draws no larger ones."""
    curves = {key: Curve(figure.name, figure.axis, contestant(key).NAME) for key in figure.names}
    for point in figure.points:
        name, threads = figure.scene(point), figure.threads(point)
        scene = find_scene(name)
        runs = [
            planned(key, name, scene, threads if key in THREADED else 1)
            for key, curve in curves.items()
            if not curve.is_ended
        ]
        measure(runs, effort)
        check_pictures(runs, scene)
        for run in runs:
            add_point(curves[run.entry.contestant], figure.x(point), run)
    return list(curves.values())


def add_point(curve: Curve, x: float, run: Run) -> None:
    """Add what was measured to a curve, or the reason why there is nothing."""
    if run.missing is not None:
        curve.note = f"none at {x:.3g}: {run.missing}"
        curve.is_ended = run.missing.startswith((MISSING, FAILED))
        return
    curve.x.append(x)
    curve.ms.append(1e3 * statistics.median(run.seconds))
    if run.median > LONGEST_SECONDS:
        curve.note = f"at {x:.3g} more than {LONGEST_SECONDS:g} s for a picture"
        curve.is_ended = True


def row_of_curve(curve: Curve) -> Row:
    """Return the row of a curve; RasterJIT must have all points."""
    row = Row(f"growth with {curve.axis}: {curve.name}", curve.contestant, check=curve.note)
    slope = curve.exponent
    if slope is not None:
        row.rate = f"time ~ {curve.axis}^{slope:.2f}"
        points = f"{curve.fitted[0]:.3g} to {curve.fitted[-1]:.3g} {curve.axis}"
        row.check = "; ".join(filter(None, [f"fitted over {points}", curve.note]))
    if curve.note and not curve.is_ended and curve.contestant == contestant(OWN).NAME:
        row.check = f"{FAILED}: {row.check}"
    return row


def as_json(curve: Curve) -> dict[str, Any]:
    """Return a curve with its exponent."""
    fitted = curve.fitted if len(curve.x) > 1 else []
    return {**asdict(curve), "exponent": curve.exponent, "fitted": fitted}
