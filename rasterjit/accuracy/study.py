"""Draw a scene in every quality that matters to it; measure the time and the error of each."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from rasterjit.accuracy import errors as measures
from rasterjit.accuracy.knobs import (
    Attempt,
    check_knobs,
    combined_attempts,
    single_attempts,
    without_effect,
)
from rasterjit.accuracy.ranking import mark_dominated, pareto_front
from rasterjit.accuracy.report.files import prepare_folder, write_report
from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study
from rasterjit.accuracy.timing import (
    Allowance,
    Contestant,
    Progress,
    Stages,
    fits,
    standard_trial,
    take_turns,
    total,
)
from rasterjit.io.meshes import as_scene
from rasterjit.outputs.frame import Frame
from rasterjit.rendering.budget import machine
from rasterjit.rendering.renderer import Renderer, explain
from rasterjit.rendering.views import choose_camera, settle_together
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import image_size, positive_number, thread_count
from rasterjit.survey.posing import posed_scene

SIZE = (640, 480)
"""Pixels of the pictures, unless another size is asked for."""

BUDGET = 100.0
"""Seconds of a study, unless others are asked for."""

KEPT = 0.5
"""Share of them that is kept for levels, however long the reference took."""

PACKAGES = ("rasterjit", "numpy", "numba", "llvmlite", "flip-evaluator")

COLOR_ALONE = ("color",)
"""Outputs of the frames that are timed."""

COMPILE = "compile"
"""The stage that no time counts."""


def study(
    what: Any,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] = SIZE,
    knobs: Iterable[str] | None = None,
    budget: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    output: str | Path | None = None,
    name: str = "scene",
) -> Study:
    """
    Measure what each accuracy setting costs in time and buys in error, on a scene of one's own.

    The reference is drawn first, then every level of every setting that has an effect on the scene,
    changed from ``Quality.standard()`` alone, then combinations of them. Once all is compiled they
    are timed by turns, round after round. Errors are the same bits in every run on a machine;
    times are not.

    Ctrl-C ends a study early: what is done by then is returned, and written.

    Parameters
    ----------
    what, camera
        As `rasterjit.render` takes them.
    size : (int, int)
        Width and height, pixels.
    knobs : iterable of str, optional
        Names of the settings to try. Default: all.
    budget : float, optional
        Seconds, about, that it may take. Half of them are kept for what follows the reference and
        the standard, however long those take to compile. What there is no time for is left out and
        named; the next study of the scene finds its kernels compiled and gets further. Default 100.
    threads : int, optional
        Default: all processors.
    progress : callable, optional
        Called with what is being done, how much of it is done, and how much there is.
    output : str or Path, optional
        Folder for ``accuracy.json``, ``accuracy.csv`` and, where matplotlib is installed,
        ``index.html``; made if there is none.
    name : str
        What the study calls the scene.

    Returns
    -------
    Study

    Raises
    ------
    ValueError
        Naming the argument that is wrong, before anything is drawn.
    KeyboardInterrupt
        On Ctrl-C before there is anything to compare.
    """
    chosen, size = check_knobs(knobs), image_size("size", size)
    seconds = BUDGET if budget is None else positive_number("budget", budget)
    thread_count("threads", threads)
    folder = None if output is None else prepare_folder(output)
    scene = posed_scene(as_scene(what))
    camera = choose_camera(scene, camera, size)
    (camera,) = settle_together(scene, [camera], size, Quality.standard())
    idle = without_effect(explain(scene, camera, size=size), chosen)
    active = [knob for knob in chosen if knob not in idle]
    attempts, impossible = possible_attempts(
        [*single_attempts(active), *combined_attempts(active)], scene, camera, size
    )
    with Studio(scene, camera, size, threads) as studio:
        measured = _measure(studio, attempts, seconds, progress or _say_nothing)
    found = Study(
        scene=name,
        size=size,
        threads=threads or available_processors(),
        rounds=measured.rounds,
        machine=machine(),
        versions=versions(),
        without_effect=idle,
        impossible=impossible | measured.impossible,
        **_results(measured, [attempt.label for attempt in attempts]),
    )
    if folder is not None:
        write_report(found, folder)
    return found


class Measured(NamedTuple):
    """What was measured, before it is put in order."""

    reference: measures.Reference
    reference_seconds: float
    standard: Contestant
    contestants: list[Contestant]
    impossible: dict[str, str]
    """Why what was not drawn could not be, by label."""
    interrupted: bool = False

    @property
    def rounds(self) -> int:
        """How often those that are not slow were drawn."""
        frames = [len(one.frames) for one in self.contestants]
        return max(frames, default=len(self.standard.frames))


def _measure(
    studio: Studio, attempts: Sequence[Attempt], seconds: float, tell: Progress
) -> Measured:
    """Draw the reference and the standard; then, until interrupted, what there is time for."""
    allowance = Allowance(seconds)
    attempts = _by_cost(attempts)
    usual = Attempt(STANDARD, STANDARD, Quality.standard())
    tell("drawing the reference", 0, len(attempts) + 2)
    reference, reference_seconds = studio.reference()
    tell("drawing standard", 1, len(attempts) + 2)
    measured = Measured(reference, reference_seconds, studio.prepare(usual, reference), [], {})
    # What is drawn in any case may take long to compile.
    allowance.keep(KEPT * seconds)
    try:
        _prepare(studio, measured, attempts, allowance, tell)
        take_turns(studio, measured.standard, measured.contestants, allowance, tell)
    except KeyboardInterrupt:
        return measured._replace(interrupted=True)
    return measured


def _prepare(
    studio: Studio,
    measured: Measured,
    attempts: Sequence[Attempt],
    allowance: Allowance,
    tell: Progress,
) -> None:
    """Add a contestant for each of the attempts that there is time for."""
    contestants = measured.contestants
    for number, attempt in enumerate(attempts):
        tell(f"drawing {attempt.label}", number + 2, len(attempts) + 2)
        if not fits(attempt, measured.standard, contestants, allowance):
            continue
        try:
            contestants.append(studio.prepare(attempt, measured.reference))
        except (ValueError, MemoryError) as error:
            # Some limits show only as the picture is drawn: of layers at many samples, of memory.
            measured.impossible[attempt.label] = str(error) or "there is not enough memory"


def _results(measured: Measured, labels: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a `Study` that were measured, given all labels in order."""
    standard = standard_trial(measured.standard)
    contestants = sorted(
        measured.contestants, key=lambda contestant: labels.index(contestant.attempt.label)
    )
    trials = mark_dominated(
        [contestant.trial(measured.standard) for contestant in contestants], standard
    )
    done = {trial.label for trial in trials}
    return {
        "standard": standard,
        "trials": trials,
        "front": pareto_front([standard, *trials]),
        "left_out": tuple(
            label for label in labels if label not in done and label not in measured.impossible
        ),
        "reference_color": measured.reference.picture.color[:, :, :3].copy(),
        "reference_seconds": measured.reference_seconds,
        "interrupted": measured.interrupted,
    }


class Studio:
    """
    Draws one scene at one size in any quality.

    Parameters
    ----------
    scene, camera, size, threads
        As `rasterjit.render` takes them.
    """

    def __init__(
        self, scene: Scene, camera: Camera, size: tuple[int, int], threads: int | None
    ) -> None:
        self._scene, self._camera, self._size = scene, camera, size
        self._buffers = measures.buffers_of(scene)
        self._outputs = (*measures.PICTURE_OUTPUTS, *self._buffers)
        # One for all: what is prepared of the scene, and the memory, they have in common.
        self._renderer = Renderer(size, threads=threads)

    def __enter__(self) -> Studio:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._renderer.close()

    def draw(self, quality: Quality, outputs: Sequence[str]) -> Frame:
        """Draw a frame."""
        self._renderer.quality = quality
        return self._renderer.render(self._scene, self._camera, outputs=outputs)

    def seconds(self, quality: Quality) -> Stages:
        """Draw the colour alone, as most frames are, and return the seconds of each stage."""
        return _without_compiling(self.draw(quality, COLOR_ALONE))

    def reference(self) -> tuple[measures.Reference, float]:
        """Return what errors are measured against, and the seconds that its picture took."""
        quality = reference_quality()
        picture = self.draw(quality, measures.PICTURE_OUTPUTS)
        # The samples are for colour: buffers come from the pixel centre.
        buffers = self.draw(replace(quality, samples=1), self._buffers)
        seconds = total(_without_compiling(picture))
        return measures.reference_of(self._scene, picture, buffers), seconds

    def prepare(self, attempt: Attempt, reference: measures.Reference) -> Contestant:
        """Compile what a quality needs, measure its errors and see how long it takes, about."""
        frame = self.draw(attempt.quality, self._outputs)
        errors, error_map = measures.compare(frame, reference)
        color = frame.color[:, :, :3].copy()
        if attempt.passes == 1:
            self.seconds(attempt.quality)
        return Contestant(attempt, errors, color, error_map, self.seconds(attempt.quality))


def _by_cost(attempts: Sequence[Attempt]) -> list[Attempt]:
    """
    Return a level of each setting first, then another of each, then combinations.

    Last comes what draws many pictures: if any, those lack time.
    """
    turns: dict[str, int] = {}
    order = {}
    for attempt in attempts:
        turn = turns[attempt.setting] = turns.get(attempt.setting, 0) + 1
        order[attempt.label] = attempt.passes, attempt.setting == COMBINATIONS, turn
    return sorted(attempts, key=lambda attempt: order[attempt.label])


def possible_attempts(
    attempts: Sequence[Attempt], scene: Scene, camera: Camera, size: tuple[int, int]
) -> tuple[list[Attempt], dict[str, str]]:
    """Return the attempts that can be rendered, and why the others can not."""
    possible, impossible = [], {}
    for attempt in attempts:
        try:
            explain(scene, camera, attempt.quality, size=size)
        except ValueError as error:
            impossible[attempt.label] = str(error)
        else:
            possible.append(attempt)
    return possible, impossible


def reference_quality() -> Quality:
    """Return the quality that errors are measured against."""
    return Quality.reference()


def _without_compiling(frame: Frame) -> Stages:
    """Return the seconds of each stage but compiling."""
    seconds = frame.stats.seconds.items()
    return {stage: duration for stage, duration in seconds if stage != COMPILE}


def _say_nothing(text: str, done: int, count: int) -> None:
    """Take no notice of progress."""


def versions() -> dict[str, str]:
    """Return the versions of the packages that matter, as far as they are installed."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            # It runs from a folder of sources, or is an extra that is not there.
            continue
    return found
