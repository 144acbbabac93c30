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

from rasterjit.accuracy import effects, results, timing
from rasterjit.accuracy.choice import INVISIBLE_ERROR, choose_among, mark_dominated, pareto_front
from rasterjit.accuracy.effects import MeasuredEffect
from rasterjit.accuracy.report.files import prepare_folder, write_report
from rasterjit.accuracy.results import CPU, STANDARD, Errors, Study, Trial
from rasterjit.accuracy.settings_to_try import (
    Attempt,
    check_knobs,
    find_idle_settings,
    is_combined,
    list_combined_attempts,
    list_preset_attempts,
    list_single_attempts,
)
from rasterjit.outputs.frame import Frame
from rasterjit.rendering.planning import choose_camera, share_clip_planes
from rasterjit.rendering.quality_selection import describe_machine, light_of, root_mean_square
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

MIN_LEVELS_SHARE = 0.5
"""Least share of the budget for levels, however long the reference took."""

MAX_REFERENCE_SHARE = 0.3
"""Largest share of the budget for the pictures of the reference, by an estimate of their time."""

MAX_EFFECTS_SHARE = 0.2
"""Largest share of the budget for the references of the scene's effects."""

MIN_REFERENCE_PICTURES = 16
"""Least number of reference pictures that a size must leave time for."""

REFERENCE_TIME_RATIO = 1.5
"""Estimated time of a reference picture over that of a standard frame."""

MIN_SIDE = 96
"""Least side of a picture that is made smaller to save time, pixels."""

MAX_SHRINK_RATIO = 0.7
"""Largest share of its time that a frame of a quarter of the pixels may take: where faces take the
time, a smaller picture saves none."""

FIRST_FLIP_SHARE = 0.05
"""Share of the budget that must be left for the first FLIP, whose time is not known."""

REPORT_CPU_SECONDS, MAX_REPORT_SHARE = 3.0, 0.2
"""Processor time of a report, seconds, and the largest share of the budget reserved for it."""

REFERENCE_SAMPLE_COUNTS = (4, 16, 64, 256)
"""Numbers of samples of the reference, drawn in this order while there is time."""

MIN_USELESS_TIME_RATIO = 0.9
"""Share of the standard's time above which a level that changes no error is not combined."""

PACKAGES = ("rasterjit", "numpy", "numba", "llvmlite", "flip-evaluator")

TIMED_OUTPUTS = ("color",)
"""Outputs of timed frames."""

COMPILE_STAGE = "compile"
"""Name of the stage that times leave out."""


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
    study_run = begin_study((what, camera), options, 1.0, lens, progress)
    with study_run.studio:
        study_run.run()
    found = study_run.result(name, options.max_error)
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
    settings, size = check_knobs(knobs), image_size("size", size)
    seconds = BUDGET if budget is None else positive_number("budget", budget)
    max_error = None if max_error is None else positive_number("max_error", max_error)
    thread_count("threads", threads)
    folder = None if output is None else prepare_folder(output)
    return StudyOptions(size, settings, seconds, max_error, threads, folder)


def begin_study(
    what: tuple[Any, Camera | None],
    options: StudyOptions,
    share: float,
    lens: Lens | None,
    progress: timing.Progress | None,
) -> StudyRun:
    """Return a run for a scene and its camera that takes a share of the budget."""
    scene, size = pose_input(what[0]), options.size
    camera = choose_camera(scene, what[1], size)
    (camera,) = share_clip_planes(scene, [camera], size, Quality.standard())
    plan = explain(scene, camera, size=size)
    studio = Studio(scene, camera, size, options.threads, lens)
    seconds, notify = share * options.seconds, progress or _ignore_progress
    return StudyRun(studio, seconds, notify, plan, options.knobs, options.folder is not None)


class StudyRun:
    """
    The run of one study: draws the most important qualities first, within a budget.

    Parameters
    ----------
    studio : Studio
    seconds : float
        Budget.
    progress : callable
    plan : RenderPlan
        Of the standard.
    knobs : sequence of str
        Settings to try.
    writes_report : bool
        Whether time is reserved for a report.
    """

    def __init__(
        self,
        studio: Studio,
        seconds: float,
        progress: timing.Progress,
        plan: RenderPlan,
        knobs: Sequence[str],
        writes_report: bool = False,
    ) -> None:
        self.studio, self.seconds, self._progress, self.plan = studio, seconds, progress, plan
        self._writes_report = writes_report
        self.budget = timing.TimeBudget(seconds)
        self.idle = find_idle_settings(plan, knobs)
        self.knobs = [knob for knob in knobs if knob not in self.idle]
        self.asked_size = studio.size
        self.order: list[str] = []
        """Labels of the planned attempts, in the order of results."""
        self.contestants: list[timing.Contestant] = []
        self.effects: list[MeasuredEffect] = []
        self.impossible: dict[str, str] = {}
        self.interrupted = False
        self.reference: results.ReferenceFrame
        self.standard: timing.Contestant

    def _notify(self, text: str) -> None:
        """Report progress."""
        self._progress(text, self.budget.spent(), self.budget.total)

    def run(self) -> None:
        """Draw the reference and the standard; then other qualities, in the time there is."""
        standard = Attempt(STANDARD, STANDARD, Quality.standard())
        cpu_start = time.process_time()
        self._notify("drawing standard")
        self.studio.shrink(standard, MAX_REFERENCE_SHARE * self.seconds)
        self._notify("drawing the reference")
        self.reference = self.studio.draw_reference(MAX_REFERENCE_SHARE * self.seconds)
        self.standard = self.studio.prepare(standard, self.reference)
        # Reference and standard may have taken long to compile.
        self.budget.ensure(MIN_LEVELS_SHARE * self.seconds)
        if self._writes_report:
            cpu_seconds = max(time.process_time() - cpu_start, 1e-3)
            report_seconds = REPORT_CPU_SECONDS * max(1.0, self.budget.spent() / cpu_seconds)
            self.budget.reserve(min(report_seconds, MAX_REPORT_SHARE * self.seconds))
        singles, presets = list_single_attempts(self.knobs), list_preset_attempts(self.knobs)
        self.order = [attempt.label for attempt in (*singles, *presets)]
        single_pass = [attempt for attempt in singles if attempt.passes == 1]
        combined = [attempt for attempt in single_pass if is_combined(attempt)]
        uncombined = [attempt for attempt in single_pass if not is_combined(attempt)]
        multi_pass = [a for a in singles if 1 < a.passes <= self.reference.samples]
        try:
            self._prepare([*presets, *_interleave_settings(combined)])
            combinations = list_combined_attempts(self.knobs, self._find_useless_levels())
            self.order += [attempt.label for attempt in combinations]
            self._prepare(sorted(combinations, key=self._predict_price))
            self._measure_effects()
            self._prepare(_interleave_settings(uncombined))
            self._prepare(multi_pass)
            present = self._list_prepared()
            timing.run_rounds(self.studio, self.standard, present, self.budget, self._notify)
        except KeyboardInterrupt:
            self.interrupted = True

    def _prepare(self, attempts: Sequence[Attempt]) -> None:
        """Add a contestant for each of the attempts that there is time for."""
        for attempt in attempts:
            self._notify(self._append_best(f"drawing {attempt.label}"))
            reason = self.studio.refusal_reason(attempt)
            if reason is None and not self._has_time(attempt):
                continue
            try:
                if reason is None:
                    self.contestants.append(self.studio.prepare(attempt, self.reference))
            except (ValueError, MemoryError) as error:
                # Some limits are met only in drawing: of layers at many samples, of memory.
                reason = str(error) or "there is not enough memory"
            if reason is not None:
                self.impossible[attempt.label] = reason

    def _list_prepared(self) -> list[timing.Contestant]:
        """Return the contestants, those of effects included."""
        return [*self.contestants, *(one for effect in self.effects for one in effect.levels)]

    def _has_time(self, attempt: Attempt) -> bool:
        """Tell whether there is time for one more attempt."""
        return timing.has_time(attempt, self.standard, self._list_prepared(), self.budget)

    def _measure_effects(self) -> None:
        """Draw the scene without each effect, and the reference of each, if there is time."""
        trials = effects.list_effect_trials(self.studio.scene, self.plan, self.studio.lens)
        for number, trial in enumerate(trials):
            self._notify(self._append_best(f"drawing {trial.effect}"))
            seconds = MAX_EFFECTS_SHARE * self.seconds / (len(trials) - number)
            if all(self._has_time(attempt) for attempt in trial.attempts):
                measured = effects.measure_effect(self.studio, trial, self.standard, seconds)
                self.effects.append(measured)

    def _find_useless_levels(self) -> set[str]:
        """Return labels of levels that change no error and save hardly any time."""
        min_seconds = MIN_USELESS_TIME_RATIO * _frame_seconds(self.standard)
        return {
            one.attempt.label
            for one in self.contestants
            if one.errors == self.standard.errors and _frame_seconds(one) > min_seconds
        }

    def _predict_price(self, attempt: Attempt) -> float:
        """Return time times error of a combination over the standard's, if factors multiply."""
        by_label = {one.attempt.label: one for one in self.contestants}
        standard_price, price = _time_error_product(self.standard), 1.0
        for name, level in differences(attempt.quality, self.standard.attempt.quality).items():
            single = by_label.get(f"{name}={level}")
            price *= 1.0 if single is None else _time_error_product(single) / standard_price
        return price

    def _append_best(self, text: str) -> str:
        """Append the best quality so far to a text of progress."""
        if not self.contestants:
            return text
        trials = [one.trial(self.standard, CPU) for one in self.contestants]
        best = choose_among(timing.make_standard_trial(self.standard, CPU), trials).trial
        return f"{text}; best so far: {best.label}"

    def _add_flip(self, trials: Sequence[Trial], front: Sequence[str]) -> list[Trial]:
        """Add FLIP to the standard and the front, as far as there is time."""
        trials_with_flip, longest = list(trials), FIRST_FLIP_SHARE * self.seconds
        for number, trial in enumerate(trials):
            before = self.budget.left()
            if trial.label not in (STANDARD, *front) or before < longest:
                continue
            errors = results.add_flip(trial.errors, trial.color, self.reference)
            trials_with_flip[number] = replace(trial, errors=errors)
            longest = max(longest, before - self.budget.left())
        return trials_with_flip

    def result(self, name: str, max_error: float | None) -> Study:
        """Return the results of the study."""
        clock = timing.choose_clock(self.standard, self.contestants)
        standard = timing.make_standard_trial(self.standard, clock)
        contestants = sorted(self.contestants, key=lambda one: self.order.index(one.attempt.label))
        trials = mark_dominated([one.trial(self.standard, clock) for one in contestants], standard)
        front = pareto_front([standard, *trials])
        standard, *trials = self._add_flip([standard, *trials], front)
        done = {trial.label for trial in trials} | set(self.impossible)
        size, asked = self.studio.size, self.asked_size
        frames = [len(one.frame_stages) for one in self.contestants]
        return Study(
            scene=name,
            size=size,
            threads=self.studio.threads,
            rounds=max(frames, default=len(self.standard.frame_stages)),
            machine=describe_machine(),
            versions=list_versions(),
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
        self._buffers = results.list_compared_buffers(scene)
        if lens is not None:
            # Depth along the axis does not exist beside it.
            self._buffers = tuple(name for name in self._buffers if name != "depth")
        self._outputs = (*results.PICTURE_OUTPUTS, *self._buffers)
        # One renderer, so that all qualities share the prepared scene and the memory.
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

    def draw_light(self, quality: Quality, scene: Scene | None = None) -> NDArray[np.float64]:
        """Draw a frame and return its linear light, (H, W, 3)."""
        frame = self.draw(quality, results.PICTURE_OUTPUTS, scene)
        return light_of(frame)[:, :, :3].astype(np.float64)

    def time_stages(self, attempt: Attempt) -> timing.Stages:
        """Draw only the colour, and return the seconds of each stage."""
        return _without_compiling(self.draw(attempt.quality, TIMED_OUTPUTS, attempt.scene))

    def refusal_reason(self, attempt: Attempt) -> str | None:
        """Return why an attempt cannot be rendered; None if it can."""
        try:
            explain(attempt.scene or self.scene, self.camera, attempt.quality, size=self.size)
        except ValueError as error:
            return str(error)
        return None

    def shrink(self, standard: Attempt, seconds: float) -> None:
        """
        Halve the size while sixteen reference pictures take longer, as long as that saves time.

        The first frame compiles, the second is timed.
        """
        self.time_stages(standard)
        frame_seconds = timing.sum_stages(self.time_stages(standard))
        max_seconds = seconds / (REFERENCE_TIME_RATIO * MIN_REFERENCE_PICTURES)
        while frame_seconds > max_seconds and min(self.size) >= 2 * MIN_SIDE:
            size = self.size
            self._resize((size[0] // 2, size[1] // 2))
            self.time_stages(standard)
            smaller_seconds = timing.sum_stages(self.time_stages(standard))
            if smaller_seconds > MAX_SHRINK_RATIO * frame_seconds:
                self._resize(size)
                return
            frame_seconds = smaller_seconds

    def _resize(self, size: tuple[int, int]) -> None:
        """Set the size of pictures."""
        self._renderer.close()
        self._renderer = Renderer(size, threads=self.threads)
        if isinstance(self.camera, MatrixCamera):
            self.camera = replace(self.camera, size=None)

    def draw_reference(self, seconds: float) -> results.ReferenceFrame:
        """Return the frame that errors are measured against, of as many samples as time allows."""
        pictures = self._reference_pictures()
        max_samples = REFERENCE_SAMPLE_COUNTS[-1]
        samples, frame = next(pictures)
        total_seconds = step_seconds = timing.sum_stages(_without_compiling(frame))
        # Estimate the error: one sample has twice the standard error of four.
        standard_light = light_of(self.draw(Quality.standard(), results.PICTURE_OUTPUTS))
        error = root_mean_square(light_of(frame) - standard_light) / math.sqrt(5.0)
        # Each step draws four times as many pictures as the last one.
        while samples < max_samples and total_seconds + 4.0 * step_seconds <= seconds:
            quarter_light = light_of(frame)
            samples, frame = next(pictures)
            step_seconds = timing.sum_stages(_without_compiling(frame))
            total_seconds += step_seconds
            # A quarter of the samples has twice the standard error of all.
            error = root_mean_square(light_of(frame) - quarter_light) / math.sqrt(3.0)
        # Only colour is sampled: buffers are those of the pixel centre.
        buffers = self.draw(replace(Quality.reference(), samples=1), self._buffers)
        reference = results.make_reference(self.scene, frame, buffers)
        error = 0.0 if samples == max_samples else error
        return reference._replace(samples=samples, seconds=total_seconds, error=error)

    def _reference_pictures(self) -> Iterator[tuple[int, Frame]]:
        """Yield the number of samples and the picture of each step: 4, 16, 64 and 256 samples."""
        outputs = results.PICTURE_OUTPUTS
        if self.lens is None:
            steps = self._renderer.refine(self.scene, self.camera, outputs=outputs, first=())
            yield from zip(REFERENCE_SAMPLE_COUNTS, steps, strict=True)
            return
        for samples in REFERENCE_SAMPLE_COUNTS:
            yield samples, self.draw(replace(Quality.reference(), samples=samples), outputs)

    def prepare(self, attempt: Attempt, reference: results.ReferenceFrame) -> timing.Contestant:
        """Compile what a quality needs, measure its errors, and time a first frame."""
        frame = self.draw(attempt.quality, self._outputs)
        errors, error_map = results.measure_errors(frame, reference)
        color = frame.color[:, :, :3].copy()
        return self.make_contestant(attempt, errors, color, error_map)

    def make_contestant(
        self,
        attempt: Attempt,
        errors: Errors,
        color: NDArray[np.uint8],
        error_map: NDArray[np.float32],
    ) -> timing.Contestant:
        """Return a contestant with the times of a first frame."""
        cpu_start = time.process_time()
        first_stages = self.time_stages(attempt)
        cpu_seconds = time.process_time() - cpu_start
        return timing.Contestant(attempt, errors, color, error_map, first_stages, cpu_seconds)


def _time_error_product(one: timing.Contestant) -> float:
    """Return time times error; invisible errors count as equal."""
    return _frame_seconds(one) * max(one.errors.rmse, INVISIBLE_ERROR)


def _frame_seconds(one: timing.Contestant) -> float:
    """Return the processor time of a frame, or its elapsed time where that is not known."""
    return one.min_cpu_seconds or one.estimated_seconds


def _interleave_settings(attempts: Iterable[Attempt]) -> list[Attempt]:
    """Return the first level of each setting, then the second of each, and so on."""
    counts: dict[str, int] = {}
    order = {}
    for attempt in attempts:
        count = counts[attempt.setting] = counts.get(attempt.setting, 0) + 1
        order[attempt] = count
    return sorted(order, key=order.__getitem__)


def _without_compiling(frame: Frame) -> timing.Stages:
    """Return the seconds of each stage but compiling."""
    seconds = frame.stats.seconds.items()
    return {stage: duration for stage, duration in seconds if stage != COMPILE_STAGE}


def _ignore_progress(text: str, done: float, count: float) -> None:
    """Ignore progress."""


def list_versions() -> dict[str, str]:
    """Return the versions of the installed packages that results depend on."""
    version_by_package = {}
    for package in PACKAGES:
        try:
            version_by_package[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            # Run from a folder of sources, or an extra that is not installed.
            continue
    return version_by_package
