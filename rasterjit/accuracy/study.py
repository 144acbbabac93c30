"""Draw a scene in all qualities that matter to it; measure the time and error of each."""

from __future__ import annotations

import importlib.metadata
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy import effects, timing
from rasterjit.accuracy import results as measures
from rasterjit.accuracy.choice import INVISIBLE, choose_among, mark_dominated, pareto_front
from rasterjit.accuracy.effects import Measured
from rasterjit.accuracy.report.files import prepare_folder, write_report
from rasterjit.accuracy.results import CPU, STANDARD, Errors, Study, Trial
from rasterjit.accuracy.settings_to_try import (
    Attempt,
    check_knobs,
    combined_attempts,
    is_on_axis,
    preset_attempts,
    single_attempts,
    without_effect,
)
from rasterjit.outputs.frame import Frame
from rasterjit.rendering.planning import choose_camera, settle_cameras
from rasterjit.rendering.quality_selection import light_of, machine, root_mean_square
from rasterjit.rendering.renderer import Renderer, explain
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.camera import Camera, MatrixCamera
from rasterjit.scene.lens import Lens
from rasterjit.scene.quality import Quality, differences
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import image_size, positive_number, thread_count
from rasterjit.survey.deformation import pose_input
from rasterjit.survey.plan import RenderPlan

SIZE = (640, 480)
"""Default size of the pictures, pixels."""

BUDGET = 75.0
"""Default budget of a study, seconds."""

LEVELS_SHARE = 0.5
"""Share of the budget that is kept for levels, however long the reference took."""

REFERENCE_SHARE = 0.3
"""Share of them that the pictures of the reference may take, as far as their time can be told."""

EFFECTS_SHARE = 0.2
"""Largest share of the budget for the references of the scene's effects."""

MIN_PICTURES = 16
"""Least number of reference pictures that a size must leave time for."""

REFERENCE_FACTOR = 1.5
"""Estimated time of a reference picture over that of a standard frame."""

MIN_SIDE = 96
"""Least side of a picture that is made smaller to save time, pixels."""

MAX_SHRINK_RATIO = 0.7
"""Share of its time that a frame of a quarter of the pixels may take at most: where faces take the
time, a smaller picture saves none."""

FLIP_SHARE = 0.05
"""Share of the seconds that must be left for the first FLIP, whose time nobody knows."""

PAGE_WORK, PAGE_SHARE = 3.0, 0.2
"""Seconds that a processor works for a report, and the share of a budget kept for it at most."""

SAMPLE_STEPS = (4, 16, 64, 256)
"""Numbers of samples of the reference, in turn, while there is time."""

USELESS = 0.9
"""Share of the standard's time from which on a level that changes no error is in no combination."""

PACKAGES = ("rasterjit", "numpy", "numba", "llvmlite", "flip-evaluator")

COLOR_ONLY = ("color",)
"""Outputs of timed frames."""

COMPILE = "compile"
"""The stage that times leave out."""


def study(
    what: Any,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] = SIZE,
    knobs: Iterable[str] | None = None,
    budget: float | None = None,
    max_error: float | None = None,
    lens: Lens | None = None,
    threads: int | None = None,
    progress: timing.Progress | None = None,
    output: str | Path | None = None,
    name: str = "scene",
) -> Study:
    """
    Measure what each accuracy setting costs in time and buys in error, on a scene of one's own.

    The reference is drawn first, then the presets and every level of every setting that has an
    effect on the scene, changed from ``Quality.standard()`` alone: first those whose price is
    highest, and combinations of them, the most promising first; then what each effect of the scene
    costs, and how far it is from a reference of its own; then all other levels. Last they are timed
    by turns, round after round. For the same number of samples of the reference, errors are the
    same bits in every run on a machine; times are not.

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
        Seconds that it may take. Nearly a third is for the reference: where its 256 samples take
        longer, it has 64, 16 or 4, and where not even 16 could be drawn, the picture is made
        smaller; the study says so. Half is kept for what follows the reference and the standard,
        however long those take to compile. What there is no time for is left out and named; the
        next study of the scene finds its kernels compiled and gets further. Default 75.
    max_error : float, optional
        The error that is wanted, root mean square of linear light: the fastest quality that holds
        it is recommended. Default: the one that buys most error for its time.
    lens : Lens, optional
        As `rasterjit.render` takes it.
    threads : int, optional
        Default: all processors.
    progress : callable, optional
        Called with what is being done, the seconds that are spent, and those there are in all.
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
    options = check_options(size, knobs, budget, max_error, threads, output)
    course = begin_study((what, camera), options, 1.0, lens, progress)
    with course.studio:
        course.run()
    found = course.result(name, options.max_error)
    if options.folder is not None:
        write_report(found, options.folder)
    return found


class StudyOptions(NamedTuple):
    """Checked arguments of a study."""

    size: tuple[int, int]
    knobs: tuple[str, ...]
    seconds: float
    max_error: float | None
    threads: int | None
    folder: Path | None


def check_options(
    size: tuple[int, int],
    knobs: Iterable[str] | None,
    budget: float | None,
    max_error: float | None,
    threads: int | None,
    output: str | Path | None,
) -> StudyOptions:
    """Check the arguments of a study, or raise ``ValueError``."""
    chosen, size = check_knobs(knobs), image_size("size", size)
    seconds = BUDGET if budget is None else positive_number("budget", budget)
    bound = None if max_error is None else positive_number("max_error", max_error)
    thread_count("threads", threads)
    folder = None if output is None else prepare_folder(output)
    return StudyOptions(size, chosen, seconds, bound, threads, folder)


def begin_study(
    what: tuple[Any, Camera | None],
    options: StudyOptions,
    share: float,
    lens: Lens | None,
    progress: timing.Progress | None,
) -> StudyRun:
    """Return the study of a scene and its camera, which is to run, in a share of the seconds."""
    scene, size = pose_input(what[0]), options.size
    camera = choose_camera(scene, what[1], size)
    (camera,) = settle_cameras(scene, [camera], size, Quality.standard())
    plan = explain(scene, camera, size=size)
    studio = Studio(scene, camera, size, options.threads, lens)
    seconds, told = share * options.seconds, progress or _ignore_progress
    return StudyRun(studio, seconds, told, plan, options.knobs, options.folder is not None)


class StudyRun:
    """
    The way of one study: what is drawn first, and what is cut when time runs out.

    Parameters
    ----------
    studio : Studio
    seconds : float
        That it may take.
    progress : callable
    plan : RenderPlan
        Of the standard.
    knobs : sequence of str
        Settings to try.
    writes : bool
        Whether time is kept for a report.
    """

    def __init__(
        self,
        studio: Studio,
        seconds: float,
        progress: timing.Progress,
        plan: RenderPlan,
        knobs: Sequence[str],
        writes: bool = False,
    ) -> None:
        self.studio, self.seconds, self._progress, self.plan = studio, seconds, progress, plan
        self._writes = writes
        self.allowance = timing.Allowance(seconds)
        self.idle = without_effect(plan, knobs)
        self.knobs = [knob for knob in knobs if knob not in self.idle]
        self.asked_size = studio.size
        self.order: list[str] = []
        """Labels of what was meant to be tried, in the order of results."""
        self.contestants: list[timing.Contestant] = []
        self.effects: list[Measured] = []
        self.impossible: dict[str, str] = {}
        self.interrupted = False
        self.reference: measures.ReferenceFrame
        self.standard: timing.Contestant

    def tell(self, text: str) -> None:
        """Report progress."""
        self._progress(text, self.allowance.spent(), self.allowance.total)

    def run(self) -> None:
        """Draw the reference and the standard; then, until interrupted, what there is time for."""
        usual = Attempt(STANDARD, STANDARD, Quality.standard())
        worked = time.process_time()
        self.tell("drawing standard")
        self.studio.shrink(usual, REFERENCE_SHARE * self.seconds)
        self.tell("drawing the reference")
        self.reference = self.studio.reference(REFERENCE_SHARE * self.seconds)
        self.standard = self.studio.prepare(usual, self.reference)
        # What is drawn in any case may take long to compile.
        self.allowance.keep(LEVELS_SHARE * self.seconds)
        if self._writes:
            worked = max(time.process_time() - worked, 1e-3)
            slower = max(1.0, self.allowance.spent() / worked)
            self.allowance.take(min(PAGE_WORK * slower, PAGE_SHARE * self.seconds))
        singles, presets = single_attempts(self.knobs), preset_attempts(self.knobs)
        self.order = [one.label for one in (*singles, *presets)]
        lone = [one for one in singles if one.passes == 1]
        many = [one for one in singles if one.passes > 1]
        try:
            self._prepare([*presets, *_interleave(one for one in lone if is_on_axis(one))])
            combinations = combined_attempts(self.knobs, self._useless())
            self.order += [one.label for one in combinations]
            self._prepare(sorted(combinations, key=self._promise))
            self._weigh_effects()
            self._prepare(_interleave(one for one in lone if not is_on_axis(one)))
            self._prepare([one for one in many if one.passes <= self.reference.samples])
            present = [*self.contestants, *(one for each in self.effects for one in each.levels)]
            timing.run_rounds(self.studio, self.standard, present, self.allowance, self.tell)
        except KeyboardInterrupt:
            self.interrupted = True

    def _prepare(self, attempts: Sequence[Attempt]) -> None:
        """Add a contestant for each of the attempts that there is time for."""
        for attempt in attempts:
            self.tell(self._so_far(f"drawing {attempt.label}"))
            reason = self.studio.refusal(attempt)
            if reason is None and not self._fits(attempt):
                continue
            try:
                if reason is None:
                    self.contestants.append(self.studio.prepare(attempt, self.reference))
            except (ValueError, MemoryError) as error:
                # Some limits show only as the picture is drawn: of layers at many samples, of
                # memory.
                reason = str(error) or "there is not enough memory"
            if reason is not None:
                self.impossible[attempt.label] = reason

    def _fits(self, attempt: Attempt) -> bool:
        """Tell whether there is time for one more."""
        prepared = [*self.contestants, *(one for each in self.effects for one in each.levels)]
        return timing.has_time(attempt, self.standard, prepared, self.allowance)

    def _weigh_effects(self) -> None:
        """Draw the scene without each effect, and the reference of each, if there is time."""
        costs = effects.effect_trials(self.studio.scene, self.plan, self.studio.lens)
        for number, cost in enumerate(costs):
            self.tell(self._so_far(f"drawing {cost.effect}"))
            share = EFFECTS_SHARE * self.seconds / (len(costs) - number)
            if not all(self._fits(attempt) for attempt in cost.attempts):
                continue
            self.effects.append(effects.measure(self.studio, cost, self.standard, share))

    def _useless(self) -> set[str]:
        """Return labels of levels that change no error, and save no time to speak of."""
        usual = self.standard
        return {
            one.attempt.label
            for one in self.contestants
            if one.errors == usual.errors and _seconds_of(one) > USELESS * _seconds_of(usual)
        }

    def _promise(self, attempt: Attempt) -> float:
        """Return time and error of a combination over the standard's, if factors multiply."""
        known = {one.attempt.label: one for one in self.contestants}
        usual, product = _time_error_product(self.standard), 1.0
        for name, level in differences(attempt.quality, self.standard.attempt.quality).items():
            single = known.get(f"{name}={level}")
            product *= 1.0 if single is None else _time_error_product(single) / usual
        return product

    def _so_far(self, text: str) -> str:
        """Add the best quality so far to what is being done."""
        if not self.contestants:
            return text
        trials = [one.trial(self.standard, CPU) for one in self.contestants]
        best = choose_among(timing.standard_trial(self.standard, CPU), trials).trial
        return f"{text}; best so far: {best.label}"

    def _with_flip(self, trials: Sequence[Trial], front: Sequence[str]) -> list[Trial]:
        """Add FLIP to the standard and to what is worth choosing, as far as there is time."""
        found, longest = list(trials), FLIP_SHARE * self.seconds
        for number, trial in enumerate(trials):
            before = self.allowance.left()
            if trial.label not in (STANDARD, *front) or before < longest:
                continue
            errors = measures.with_flip(trial.errors, trial.color, self.reference)
            found[number] = replace(trial, errors=errors)
            longest = max(longest, before - self.allowance.left())
        return found

    def result(self, name: str, max_error: float | None) -> Study:
        """Return the results of the study."""
        clock = timing.best_clock(self.standard, self.contestants)
        standard = timing.standard_trial(self.standard, clock)
        contestants = sorted(self.contestants, key=lambda one: self.order.index(one.attempt.label))
        trials = mark_dominated([one.trial(self.standard, clock) for one in contestants], standard)
        front = pareto_front([standard, *trials])
        standard, *trials = self._with_flip([standard, *trials], front)
        done = {trial.label for trial in trials} | set(self.impossible)
        size, asked = self.studio.size, self.asked_size
        frames = [len(one.frames) for one in self.contestants]
        return Study(
            scene=name,
            size=size,
            threads=self.studio.threads,
            rounds=max(frames, default=len(self.standard.frames)),
            machine=machine(),
            versions=versions(),
            standard=standard,
            trials=tuple(trials),
            front=front,
            without_effect=self.idle,
            left_out=tuple(label for label in self.order if label not in done),
            reference_color=self.reference.picture.color[:, :, :3].copy(),
            reference_seconds=self.reference.seconds,
            impossible=self.impossible,
            interrupted=self.interrupted,
            clock=clock,
            reference_samples=self.reference.samples,
            reference_error=self.reference.error,
            asked_size=None if size == asked else asked,
            max_error=max_error,
            effects=tuple(one.cost(self.standard, clock) for one in self.effects),
        )


class Studio:
    """
    Draws one scene at one size in any quality.

    Parameters
    ----------
    scene, camera, size, threads, lens
        As `rasterjit.render` takes them.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int],
        threads: int | None,
        lens: Lens | None = None,
    ) -> None:
        self.scene, self.camera, self.lens = scene, camera, lens
        self.threads = threads or available_processors()
        self._buffers = measures.compared_buffers(scene)
        if lens is not None:
            # Depth along the axis does not exist beside it.
            self._buffers = tuple(name for name in self._buffers if name != "depth")
        self._outputs = (*measures.PICTURE_OUTPUTS, *self._buffers)
        # One for all: what is prepared of the scene, and the memory, they have in common.
        self._renderer = Renderer(size, threads=threads)

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Release threads and memory; a later frame acquires them again."""
        self._renderer.close()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._renderer.size

    def draw(self, quality: Quality, outputs: Sequence[str], scene: Scene | None = None) -> Frame:
        """Draw a frame of the scene, or of another one in its place."""
        self._renderer.quality = quality
        shown = self.scene if scene is None else scene
        return self._renderer.render(shown, self.camera, outputs=outputs, lens=self.lens)

    def light(self, quality: Quality, scene: Scene | None = None) -> NDArray[np.float64]:
        """Draw a frame and return its linear light, (H, W, 3)."""
        frame = self.draw(quality, measures.PICTURE_OUTPUTS, scene)
        return light_of(frame)[:, :, :3].astype(np.float64)

    def seconds(self, attempt: Attempt) -> timing.Stages:
        """Draw the colour alone, as most frames are, and return the seconds of each stage."""
        return _without_compiling(self.draw(attempt.quality, COLOR_ONLY, attempt.scene))

    def refusal(self, attempt: Attempt) -> str | None:
        """Return why an attempt cannot be rendered, if so."""
        try:
            explain(attempt.scene or self.scene, self.camera, attempt.quality, size=self.size)
        except ValueError as error:
            return str(error)
        return None

    def shrink(self, usual: Attempt, seconds: float) -> None:
        """
        Halve the size as long as there is no time for sixteen pictures, and as it saves any.

        The first frame compiles, the second tells the time.
        """
        self.seconds(usual)
        took = timing.total(self.seconds(usual))
        while REFERENCE_FACTOR * MIN_PICTURES * took > seconds and min(self.size) >= 2 * MIN_SIDE:
            before = self.size
            self._resize((before[0] // 2, before[1] // 2))
            self.seconds(usual)
            smaller = timing.total(self.seconds(usual))
            if smaller > MAX_SHRINK_RATIO * took:
                self._resize(before)
                return
            took = smaller

    def _resize(self, size: tuple[int, int]) -> None:
        """Draw pictures of another size from now on."""
        self._renderer.close()
        self._renderer = Renderer(size, threads=self.threads)
        if isinstance(self.camera, MatrixCamera):
            self.camera = replace(self.camera, size=None)

    def reference(self, seconds: float) -> measures.ReferenceFrame:
        """Return what errors are measured against: as many samples as so many seconds allow."""
        pictures = self._reference_pictures()
        samples, frame = next(pictures)
        took = spent = timing.total(_without_compiling(frame))
        # Of four samples and one, both err by chance, one twice as much.
        usual = light_of(self.draw(Quality.standard(), measures.PICTURE_OUTPUTS))
        error = root_mean_square(light_of(frame) - usual) / math.sqrt(5.0)
        # The next step draws four times as many pictures as the last one.
        while samples < SAMPLE_STEPS[-1] and took + 4.0 * spent <= seconds:
            before = light_of(frame)
            samples, frame = next(pictures)
            spent = timing.total(_without_compiling(frame))
            took += spent
            # The first quarter of some samples errs twice as much as all of them, by chance.
            error = root_mean_square(light_of(frame) - before) / math.sqrt(3.0)
        # The samples are for colour: buffers come from the pixel centre.
        buffers = self.draw(replace(Quality.reference(), samples=1), self._buffers)
        found = measures.reference_of(self.scene, frame, buffers)
        error = 0.0 if samples == SAMPLE_STEPS[-1] else error
        return found._replace(samples=samples, seconds=took, error=error)

    def _reference_pictures(self) -> Iterator[tuple[int, Frame]]:
        """Yield pictures of 4, 16, 64 and 256 samples, each with their number."""
        outputs = measures.PICTURE_OUTPUTS
        if self.lens is None:
            steps = self._renderer.refine(self.scene, self.camera, outputs=outputs, first=())
            yield from zip(SAMPLE_STEPS, steps, strict=True)
            return
        for samples in SAMPLE_STEPS:
            yield samples, self.draw(replace(Quality.reference(), samples=samples), outputs)

    def prepare(self, attempt: Attempt, reference: measures.ReferenceFrame) -> timing.Contestant:
        """Compile what a quality needs, measure its errors and see how long it takes, about."""
        frame = self.draw(attempt.quality, self._outputs)
        errors, error_map = measures.compare(frame, reference)
        color = frame.color[:, :, :3].copy()
        return self.contestant(attempt, errors, color, error_map)

    def contestant(
        self,
        attempt: Attempt,
        errors: Errors,
        color: NDArray[np.uint8],
        error_map: NDArray[np.float32],
    ) -> timing.Contestant:
        """Return what is timed later, and how long it takes, about."""
        before = time.process_time()
        first = self.seconds(attempt)
        worked = time.process_time() - before
        return timing.Contestant(attempt, errors, color, error_map, first, worked)


def _time_error_product(one: timing.Contestant) -> float:
    """Return the product of time and error, as far as either is seen."""
    return _seconds_of(one) * max(one.errors.rmse, INVISIBLE)


def _seconds_of(one: timing.Contestant) -> float:
    """Return the seconds that processors worked for a frame, or that it took."""
    return one.least or one.cost


def _interleave(attempts: Iterable[Attempt]) -> list[Attempt]:
    """Return a level of each setting first, then another of each."""
    turns: dict[str, int] = {}
    order = {}
    for attempt in attempts:
        turn = turns[attempt.setting] = turns.get(attempt.setting, 0) + 1
        order[attempt] = turn
    return sorted(order, key=order.__getitem__)


def _without_compiling(frame: Frame) -> timing.Stages:
    """Return the seconds of each stage but compiling."""
    seconds = frame.stats.seconds.items()
    return {stage: duration for stage, duration in seconds if stage != COMPILE}


def _ignore_progress(text: str, done: float, count: float) -> None:
    """Ignore progress."""


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
