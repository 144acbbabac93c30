"""
Choose the quality of a frame: the best within a time budget, or the fastest within an error.

A profile of this machine (time and error of each quality) is measured once and kept in the cache
folder.

For a time budget, it remembers what frames of a scene took. Where it does not know enough for the
budget it first draws frames of ever better qualities until one takes too long; with a profile of
the machine (``rasterjit accuracy --calibrate``) one frame tells what the others would take. Each
frame corrects these times, and its quality is chosen afresh from them, so that the choice follows
budgets, a camera that moves and a machine that slows down and recovers.

For an error bound nothing is remembered. Frames of ever better qualities are drawn in full size and
compared with the first pictures of the reference, 4, 16, 64 or all 256: as many as it takes to tell
whether the error is below the bound. The first that is so is the frame; if none is, the reference.
What repeats from pixel to pixel, such as wires of a fence, may lie between the samples of all first
pictures. So two more are drawn whose samples lie elsewhere in each pixel: a frame that differs more
from both than from the first pictures is compared with more of them.
"""

from __future__ import annotations

import json
import math
import platform
import statistics
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from rasterjit import forks
from rasterjit.io.atomic_write import atomic_file
from rasterjit.outputs.frame import Frame, QualityChoice
from rasterjit.outputs.output_table import OutputName
from rasterjit.runtime.store import host_cpu_features, user_cache_folder
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.quality import SUPERSAMPLED, Quality, differences
from rasterjit.scene.warning import warn_caller
from rasterjit.survey.effect import is_backdrop, list_screen_effects

HEADROOM = 0.9
"""Largest share of a time budget that a frame's predicted time may take."""

ON_TIME_SHARE = 0.9
"""Share of the frames that should stay in the budget. If recent ones took longer than predicted,
the next is predicted to take so much longer."""

RECENT_FRAMES = 20
"""Number of recent frames from which the variation of times is estimated."""

MAX_BUDGETS_TO_GO_ON = 1.5
"""Calibrating stops at a quality that takes this many budgets: better ones take longer."""

MAX_BUDGETS_TO_REPEAT = 3.0
"""A quality is measured by its first frame alone, which also allocates memory, if that takes this
many budgets."""

FRAMES_PER_QUALITY = 3
"""Frames of each quality whose median calibrating takes; supersampled ones are drawn once."""

LOAD_FRAMES = 3
"""Frames whose median gives the machine's load."""

OLD_TIME_WEIGHT = 0.6
"""Weight of the old estimate of a quality's time when a frame updates it."""

MAX_TIME_RATIO = 2.0
"""Ratios of a frame's time to the predicted one are clamped to this, either way."""

FRAMES_BEFORE_RETRY = 32
"""Frames after which the next better quality is tried again, as it may have been measured while the
machine was busy; twice as many after each trial that takes too long."""

MAX_BUDGETS_TO_RETRY = 3.0
"""Times over the budget that a quality may be expected to take if it is tried again."""

MAX_TIMED_SCENES = 64
"""Most scenes, per set of circumstances, whose times are stored; the oldest go first."""

ERROR_RATIO_OF_MEAN = 0.4
"""Error of the mean of some pictures over its difference from that of the first quarter of them:
0.35 at edges, more in what is random."""

MIN_CORRELATION = 0.5
"""Least assumed correlation between the error of a quality and that of the mean: of 32 pictures of
many kinds nearly all had less than 0.4; those with more are found by `CORRELATION_FACTOR`."""

CORRELATION_FACTOR = 1.5
"""Assumed correlation over the one between the quality's difference from the mean and that of the
first quarter: edges along rows of pixels meet all samples alike."""

CHANCE_FACTOR = 1.5
"""Assumed chance correlation, times the root of the number of pixels that differ."""

MAX_FIRST_ERROR_RATIO = 1.75
"""Largest ratio, either way, of the error of a quality of one sample to its difference from the
mean of 4 pictures, the first: of 32 pictures none had more than 1.65."""

REFERENCE_PICTURES = int(Quality.reference().samples)
"""Pictures of the reference."""

COMPARED_OUTPUTS: tuple[OutputName, ...] = "color", "linear"
"""Outputs by which frames are compared: see `light_of`."""

MAX_CODE = 255.0
"""Largest 8-bit code."""

Draw: TypeAlias = Callable[[Quality], Frame]
Sweep: TypeAlias = Callable[[], Iterable[Frame]]

Item = TypeVar("Item")

PROFILE_FORMAT = 1
"""Format number of the profile's file; a file of another format is ignored."""

PROFILE_KEYS = ("cpu", "architecture", "processors")
"""Keys of `machine` that must be those of the profile; else the profile is ignored."""

LADDER = (
    Quality.draft(),
    Quality.standard(),
    Quality(samples=2),
    Quality(samples=4),
    Quality.high(),
    replace(Quality.high(), samples=16),
    replace(Quality.reference(), samples=16, shadow_taps=9),
    replace(Quality.reference(), samples=64),
    Quality.reference(),
)
"""The qualities to choose from on a machine without a profile, from the fastest on."""

ERROR_LADDER = (*LADDER[:-2], replace(Quality.high(), samples="area"), LADDER[-2])
"""Qualities to choose from for an error, before the reference: the same on all machines, so that
they choose alike."""

PICTURES_COMPARED = dict(zip(
    ERROR_LADDER,
    ((4, 16), (4, 256), (16, 64), (16, 64), (16, 64), (16, 256), (16, 256), (16, 256), (64, 256)),
    strict=True,
))  # fmt: skip
"""How many pictures of the reference each quality is compared with first, and at most: with all
where the next one may be several times slower."""


class CalibrationWarning(UserWarning):
    """Without a profile of the machine, a scene was drawn several times to time the qualities."""


class FrameTimes:
    """
    Predicts the times of one scene's frames, by quality.

    Parameters
    ----------
    ladder : sequence of Quality
        The qualities to choose from, from the fastest on.
    ratios : dict of float
        Their times over that of the standard, from the machine's profile.
    """

    def __init__(self, ladder: Sequence[Quality], ratios: dict[Quality, float]) -> None:
        self.ladder = tuple(ladder)
        self.lock = forks.lock()
        """Held while measuring: frames of other threads would disturb the times."""
        self._ratios = ratios
        self._seconds: dict[Quality, float] = {}
        """Time of each quality at a load of 1, the load of the first measured frames."""
        self._loads: deque[float] = deque([1.0] * LOAD_FRAMES, LOAD_FRAMES)
        self._time_ratios: deque[float] = deque([1.0] * RECENT_FRAMES, RECENT_FRAMES)
        """Ratios of actual to predicted time of the latest frames."""
        self._frames_since_retry, self._frames_before_retry = 0, FRAMES_BEFORE_RETRY
        self._best_quality: Quality | None = None
        self._last_quality: Quality | None = None

    @property
    def _load(self) -> float:
        """The load of machine and scene: the latest frames' times over the stored ones."""
        return statistics.median(self._loads)

    @property
    def _margin(self) -> float:
        """Safety factor on predicted times."""
        return max(
            1.0 / HEADROOM, sorted(self._time_ratios)[math.ceil(ON_TIME_SHARE * RECENT_FRAMES) - 1]
        )

    def calibrate(self, budget: float, draw: Draw) -> Iterator[Quality]:
        """
        Measure the times of the qualities, from the fastest on, until one takes too long.

        With a profile of the machine, the fastest one predicts the others; only chosen ones are
        measured as well.

        Yields
        ------
        Quality
            The one that was measured. A caller that stops here and calls again continues with the
            next. A call after the end measures more only if the budget has become larger, or frames
            faster.
        """
        for step, quality in enumerate(self.ladder):
            # Where fewer lit vertices, or smaller shadow maps, make no frame faster, the first two
            # may be in the wrong order.
            if step > 1 and self._min_seconds(quality) > MAX_BUDGETS_TO_GO_ON * budget:
                break
            if quality not in self._seconds:
                self._find_load(draw)
                self._measure(quality, budget, draw)
                yield quality
            is_too_long = (
                step > 0 and self._seconds[quality] * self._load > MAX_BUDGETS_TO_GO_ON * budget
            )
            if self._ratios or is_too_long:
                break
        while (chosen := self.best(budget)) not in self._seconds:
            self._find_load(draw)
            self._measure(chosen, budget, draw)
            yield chosen

    @property
    def is_known(self) -> bool:
        """Whether the time of any quality is known."""
        return bool(self._seconds)

    def _min_seconds(self, quality: Quality) -> float:
        """Return a lower bound of a quality's seconds: of all pictures if supersampled, else 0."""
        if quality.samples not in SUPERSAMPLED:
            return 0.0
        return int(quality.samples) * min(self._seconds.values()) * self._load

    def _find_load(self, draw: Draw) -> None:
        """Measure the load by the fastest quality, once a frame has been chosen."""
        if self._best_quality is not None:
            fastest = min(self._seconds, key=self._seconds.__getitem__)
            for _ in range(LOAD_FRAMES):
                self._loads.append(
                    self._time_without_compiling(fastest, draw) / self._seconds[fastest]
                )

    def _measure(self, quality: Quality, budget: float, draw: Draw) -> None:
        """Measure the time of a quality."""
        # The first frame allocates memory. While any thread compiles, stages are timed too short.
        first = self._time_without_compiling(quality, draw)
        if quality.samples in SUPERSAMPLED or first > MAX_BUDGETS_TO_REPEAT * budget:
            self._seconds[quality] = first / self._load
            return
        times = [self._time_without_compiling(quality, draw) for _ in range(FRAMES_PER_QUALITY)]
        self._seconds[quality] = statistics.median(times) / self._load

    def _time_without_compiling(self, quality: Quality, draw: Draw) -> float:
        """Return the seconds of a frame, of a few the first during which nothing compiled."""
        for _ in range(FRAMES_PER_QUALITY):
            frame = draw(quality)
            if frame.stats.seconds["compile"] == 0.0:
                break
        return seconds_of(frame)

    def predict(self, quality: Quality) -> float | None:
        """Return the predicted seconds of a frame; ``None`` if unknown."""
        if quality in self._seconds:
            return self._seconds[quality] * self._load
        if quality not in self._ratios:
            return None
        # Scale the time of the best measured quality, the nearest one.
        measured = [each for each in self.ladder if each in self._seconds and each in self._ratios]
        if not measured:
            return None
        time_ratio = self._ratios[quality] / self._ratios[measured[-1]]
        return self._seconds[measured[-1]] * time_ratio * self._load

    def best(self, budget: float) -> Quality:
        """Return the most accurate quality that stays in a budget; the fastest if none does."""
        predicted = {quality: self.predict(quality) for quality in reversed(self.ladder)}
        measured = {
            quality: seconds for quality, seconds in predicted.items() if seconds is not None
        }
        for quality, seconds in measured.items():
            if self._margin * seconds <= budget:
                return quality
        return min(measured, key=measured.__getitem__)

    def choose(self, budget: float, draw: Draw) -> tuple[Quality, float | None]:
        """
        Return the best quality that stays in a budget, and its predicted seconds.

        After `FRAMES_BEFORE_RETRY` frames, try the next better one again, and forget its time.
        """
        best = self.best(budget)
        if best != self._best_quality:
            self._best_quality, self._frames_before_retry = best, FRAMES_BEFORE_RETRY
        self._frames_since_retry += 1
        if self._frames_since_retry > self._frames_before_retry:
            self._frames_since_retry, self._frames_before_retry = 0, 2 * self._frames_before_retry
            better = self.ladder[self.ladder.index(best) + 1 :]
            retried = next((each for each in better if each in self._seconds), best)
            seconds = self._seconds[retried] * self._load
            if retried != best and seconds <= MAX_BUDGETS_TO_RETRY * budget:
                self._find_load(draw)
                del self._seconds[retried]
                return retried, seconds
        return best, self.predict(best)

    def learn(self, quality: Quality, seconds: float) -> None:
        """
        Update the stored times by the time of a frame.

        If the last frame had the same quality, only the load is updated; else also the quality's
        time.
        """
        known_seconds = self._seconds.get(quality)
        if known_seconds is None:
            known_seconds = (self.predict(quality) or seconds) / self._load
        ratio = seconds / (known_seconds * self._load)
        self._time_ratios.append(ratio)
        if quality != self._last_quality:
            limited_ratio = min(max(ratio, 1.0 / MAX_TIME_RATIO), MAX_TIME_RATIO)
            known_seconds *= OLD_TIME_WEIGHT + (1.0 - OLD_TIME_WEIGHT) * limited_ratio
        self._seconds[quality], self._last_quality = known_seconds, quality
        self._loads.append(seconds / known_seconds)


def draw_within_time(budget: float, times: FrameTimes, draw: Draw) -> Frame:
    """
    Draw a frame in the most accurate quality that a time allows.

    Parameters
    ----------
    budget : float
        Seconds, above 0. If even the fastest quality takes longer, that is drawn.
    times : Times
        Of the scene; updated.
    draw : callable
        Draws a frame of a quality.

    Returns
    -------
    Frame
        Its ``choice`` tells which one it is.
    """
    with times.lock:
        for _ in times.calibrate(budget, draw):
            pass
    return draw_by_known_times(budget, times, draw)


def draw_by_known_times(budget: float, times: FrameTimes, draw: Draw) -> Frame:
    """
    Draw a frame in the most accurate quality whose predicted time fits a budget.

    Like `draw_within_time`, but measures nothing first: some time must be known.
    """
    quality, predicted = times.choose(budget, draw)
    frame = draw(quality)
    seconds = seconds_of(frame)
    # Ignore a frame during which anything compiled, in this thread or another.
    if frame.stats.seconds["compile"] == 0.0:
        times.learn(quality, seconds)
    frame.choice = QualityChoice(quality, predicted, seconds)
    return frame


class Reference:
    """
    The reference picture, accumulated progressively: the mean of as many pictures as needed so far.

    Parameters
    ----------
    frames : iterator of Frame
        The mean of the first 4, 16, 64 and all 256 pictures, as `Renderer.refine` yields them.
    sweep : callable
        Draws two pictures whose samples sweep over the pixels, each independent of the other.
    """

    def __init__(self, frames: Iterator[Frame], sweep: Sweep) -> None:
        self._frames, self._sweep = frames, sweep
        self._swept: tuple[NDArray[np.float32], ...] = ()
        self._seconds: dict[str, float] = {}
        self._change: NDArray[np.float32] | None = None
        self._light: NDArray[np.float32]
        self.pictures = 0

    def draw(self, pictures: int) -> None:
        """Draw the missing pictures of the first ``pictures``."""
        while self.pictures < pictures:
            frame = next(self._frames)
            light = light_of(frame)
            if self.pictures:
                self._change = light - self._light
            for stage, seconds in frame.stats.seconds.items():
                self._seconds[stage] = self._seconds.get(stage, 0.0) + seconds
            frame.stats.seconds.update(self._seconds)
            self.frame, self._light, self.pictures = frame, light, frame.plan.pictures

    def bound_error(self, frame: Frame) -> tuple[float, float]:
        """Return a lower and an upper bound of a frame's error."""
        differences = light_of(frame) - self._light
        difference = root_mean_square(differences)
        if self.pictures == REFERENCE_PICTURES:
            return difference, difference
        lowest, highest = self._bounds(differences, difference)
        square, chance = self._estimate_square_error(frame)
        if square - chance > highest**2:
            return lowest, math.inf
        # If no pixel differs, all samples may lie at the same positions.
        return lowest, highest if difference > 0.0 else max(
            highest, math.sqrt(max(square + 3.0 * chance, 0.0))
        )

    def _estimate_square_error(self, frame: Frame) -> tuple[float, float]:
        """
        Estimate the mean square error of a frame; return it and its standard deviation.

        Samples of the two swept pictures are independent, and so the mean of the product of the
        differences from both is that square.
        """
        if not self._swept:
            self._swept = tuple(light_of(picture) for picture in self._sweep())
        light = light_of(frame)
        first, second = (np.subtract(swept, light, dtype=np.float64) for swept in self._swept)
        squares = (first * second).mean(axis=2)
        return float(squares.mean()), float(squares.std()) / math.sqrt(squares.size)

    def _bounds(self, differences: NDArray[np.float32], difference: float) -> tuple[float, float]:
        """
        Return a lower and an upper bound of an error, by the difference from the mean so far.

        Its square is that of the difference from the mean, less that of the mean's own error, but
        for the correlation of the two errors: by chance, less where more pixels differ, or since
        samples lie at the same positions. The bounds allow for that.
        """
        if self._change is None:
            return difference / MAX_FIRST_ERROR_RATIO, difference * MAX_FIRST_ERROR_RATIO
        mean_error = ERROR_RATIO_OF_MEAN * root_mean_square(self._change)
        if difference == 0.0 or mean_error == 0.0:
            return difference, difference + mean_error
        squares = np.square(differences, dtype=np.float64).sum(axis=2)
        chance_share = CHANCE_FACTOR * math.sqrt(np.sum(squares**2)) / float(np.sum(squares))
        products = np.multiply(differences, self._change, dtype=np.float64)
        correlation = (
            ERROR_RATIO_OF_MEAN * abs(float(np.mean(products))) / (difference * mean_error)
        )
        spread = (
            2.0
            * difference
            * mean_error
            * (max(MIN_CORRELATION, CORRELATION_FACTOR * correlation) + chance_share)
        )
        return math.sqrt(max(difference**2 - mean_error**2 - spread, 0.0)), math.sqrt(
            difference**2 + spread
        )


def draw_within_error(bound: float, draw: Draw, refined: Iterator[Frame], sweep: Sweep) -> Frame:
    """
    Draw a frame in the fastest quality whose error is below a bound.

    Parameters
    ----------
    bound : float
        Largest root mean square difference from the reference, in linear light, above 0.
    draw : callable
        Draws a frame of a quality, with its light.
    refined : iterator of Frame
        The reference of ever more pictures, as `Renderer.refine` yields it; only as many as it
        takes are drawn.
    sweep : callable
        See `Reference`.

    Returns
    -------
    Frame
        Its ``choice`` tells which one it is.
    """
    reference, shows_areas = Reference(refined, sweep), False
    undecided: list[Frame] = []
    for quality in ERROR_LADDER:
        if quality.samples == "area" and not shows_areas:
            continue
        latest = draw(quality)
        undecided.append(latest)
        # Areas of many faces for each pixel take at most 2.5 times as long as 64 pictures.
        shows_areas = not latest.plan.facts.transparency.used
        pictures, last = PICTURES_COMPARED[quality]
        # Before a quality that is many times slower, none may be left undecided.
        while pictures <= last and undecided:
            if undecided[-1] is not latest and last < REFERENCE_PICTURES:
                break
            reference.draw(pictures)
            tried, undecided = undecided, []
            for frame in tried:
                lowest, highest = reference.bound_error(frame)
                if highest <= bound:
                    frame.choice = QualityChoice(
                        frame.plan.quality, None, seconds_of(frame), highest
                    )
                    return frame
                if lowest <= bound:
                    undecided.append(frame)
            pictures = 4 * reference.pictures
    reference.draw(REFERENCE_PICTURES)
    reference.frame.choice = QualityChoice(
        Quality.reference(), None, seconds_of(reference.frame), 0.0
    )
    return reference.frame


def get_ladder() -> tuple[Quality, ...]:
    """Return the qualities to choose from, from the fastest on."""
    profile = load_profile()
    return LADDER if profile is None else profile.ladder


def light_of(frame: Frame) -> NDArray[np.float32]:
    """
    Return the light that a frame shows, (H, W, 3) float32, linear red, green and blue.

    Before a transparent background, the light is multiplied by alpha, which is a fourth channel.
    Lines around and along faces are drawn over the 8-bit colour alone: with them the light is that
    colour, decoded. Other overlays treat a pixel alike in any quality, as tone curves do, and are
    left out.
    """
    plan = frame.plan
    if any(effect.joins_faces for effect, _ in list_screen_effects(plan.effects_at("overlay"))):
        light = srgb_to_linear(frame.color[:, :, :3])
        alpha = frame.color[:, :, 3:].astype(np.float32) / np.float32(MAX_CODE)
    else:
        light, alpha = frame.linear[:, :, :3], frame.linear[:, :, 3:]
    shows_more = any(not is_backdrop(planned.effect) for planned in plan.effects_at("background"))
    if shows_more or plan.background[3] >= 1.0:
        return light
    return np.concatenate([light * alpha, alpha], axis=2)


def root_mean_square(differences: NDArray[Any]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(differences, dtype=np.float64))))


def seconds_of(frame: Frame) -> float:
    """Return the seconds of a frame, without compiling."""
    return sum(time for stage, time in frame.stats.seconds.items() if stage != "compile")


def get_frame_times(what: Any, circumstances: Any) -> FrameTimes:
    """
    Return the times of a scene, stored as long as the scene exists.

    Parameters
    ----------
    what : object
        What is drawn.
    circumstances : hashable
        Everything else that times depend on.

    Warns
    -----
    CalibrationWarning
        If nothing is known of the scene, nor of the machine.
    """
    key = id(what), circumstances
    with _LOCK:
        if key in _TIMES:
            return _TIMES[key]
        profile = load_profile()
        ladder, ratios = (LADDER, {}) if profile is None else (profile.ladder, profile.times())
        _TIMES[key] = times = FrameTimes(ladder, ratios)
        # Another scene may later have the same address.
        weakref.finalize(what, _TIMES.pop, key, None)
        while len(_TIMES) > MAX_TIMED_SCENES:
            del _TIMES[next(iter(_TIMES))]
    if profile is None:
        warn_caller(
            "time_budget: there is no profile of this machine, so frames of this scene are timed "
            "first; `rasterjit accuracy --calibrate` makes one",
            CalibrationWarning,
        )
    return times


_LOCK = forks.lock()
_TIMES: dict[Any, FrameTimes] = {}
"""Times by the address of the scene and the circumstances."""


class QualityStep(NamedTuple):
    """A quality to choose from."""

    quality: Quality
    time: float
    """Time of a frame over that of a standard one."""
    error: float
    """Root mean square in linear light, over that of a standard frame."""


@dataclass(frozen=True)
class Profile:
    """
    Time and error of the qualities on a machine.

    Attributes
    ----------
    steps : tuple of QualityStep
        From the fastest on, each more accurate than those before.
    threads : int
        That frames were drawn with.
    """

    steps: tuple[QualityStep, ...]
    threads: int

    @property
    def ladder(self) -> tuple[Quality, ...]:
        """The qualities to choose from, from the fastest on."""
        return tuple(step.quality for step in self.steps)

    def times(self) -> dict[Quality, float]:
        """Return the time of each quality, over that of a standard frame."""
        return {step.quality: step.time for step in self.steps}


def pareto_front(items: Iterable[Item], cost: Callable[[Item], tuple[float, float]]) -> list[Item]:
    """Return the Pareto front by time and error, the fastest first."""
    front: list[Item] = []
    for item in sorted(items, key=cost):
        if not front or cost(item)[1] < cost(front[-1])[1]:
            front.append(item)
    return front


def pareto_front_of_steps(steps: Iterable[QualityStep]) -> tuple[QualityStep, ...]:
    """Return the Pareto front of steps, the fastest first."""
    return tuple(pareto_front(steps, lambda step: (step.time, step.error)))


def describe_machine() -> dict[str, str]:
    """Return the properties of the machine that times depend on."""
    return {
        "cpu": host_cpu_features()[0],
        "architecture": platform.machine(),
        "processors": str(available_processors()),
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
    }


def profile_path() -> Path:
    """Return the path of this machine's profile."""
    return user_cache_folder() / "profile.json"


def save_profile(profile: Profile) -> Path:
    """
    Write the profile of this machine to its file, whole or not at all.

    Raises
    ------
    ValueError
        Naming the folder, if it cannot be written to.
    """
    content = {
        "format": PROFILE_FORMAT,
        "machine": describe_machine(),
        "threads": profile.threads,
        "steps": [
            {
                "settings": differences(step.quality, Quality.standard()),
                "time": step.time,
                "error": step.error,
            }
            for step in profile.steps
        ],
    }
    path = profile_path()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as temporary:
            temporary.write_text(json.dumps(content, indent=1))
    except OSError as error:
        raise ValueError(
            f"the cache folder must be one to write to, but {str(path.parent)!r} is not: {error}"
        ) from None
    return path


def load_profile() -> Profile | None:
    """Return the profile of this machine; ``None`` if there is none, or none that can be read."""
    try:
        content = json.loads(profile_path().read_text())
        this_machine = describe_machine()
        is_of_this_machine = all(
            content["machine"][name] == this_machine[name] for name in PROFILE_KEYS
        )
        steps = pareto_front_of_steps([_step(entry) for entry in content["steps"]])
        if content["format"] != PROFILE_FORMAT or not is_of_this_machine or not steps:
            return None
        return Profile(steps, int(content["threads"]))
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def _step(entry: Any) -> QualityStep:
    """Return a step read from the file; raise ``ValueError`` for impossible times and errors."""
    time, error = float(entry["time"]), float(entry["error"])
    if not (0.0 < time < math.inf and 0.0 <= error < math.inf):
        raise ValueError(f"a step must take time and have an error, got {entry!r}")
    return QualityStep(Quality(**entry["settings"]), time, error)
