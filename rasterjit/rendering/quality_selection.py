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
from rasterjit.runtime.store import cache_folder, cpu_features
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.quality import SUPERSAMPLED, Quality, differences
from rasterjit.scene.warning import warn_caller
from rasterjit.survey.effect import is_backdrop, list_screen_effects

HEADROOM = 0.9
"""Largest share of a time budget that a frame's predicted time may take."""

KEPT_SHARE = 0.9
"""Share of the frames that are to stay in the budget. Where the latest ones took longer than was
expected of them, so much longer is expected of the next."""

LATEST = 20
"""Number of recent frames from which the variation of times is estimated."""

TOO_LONG = 1.5
"""Calibrating stops at a quality that takes this many budgets: better ones take longer."""

HOPELESS = 3.0
"""A quality is measured by its first frame alone, which also gets memory, if that takes this many
budgets."""

FRAMES = 3
"""Frames of each quality whose median calibrating takes; supersampled ones are drawn once."""

FOR_LOAD = 3
"""How many frames tell the machine's load: the median, so that one that is disturbed does not
count."""

OWN_MEMORY = 0.6
"""Weight of the old estimate of a quality's own time when a frame updates it."""

MAX_SHARE = 2.0
"""Largest ratio, either way, of a frame's time to the expected one that counts for its quality."""

PATIENCE = 32
"""Frames after which the next better quality is tried again, as it may have been measured while the
machine was busy; twice as many after each trial that takes too long."""

WORTH_TRYING = 3.0
"""Times over the budget that a quality may be expected to take if it is tried again."""

MAX_KNOWN = 64
"""Most scenes, each in its circumstances, whose times are remembered; the oldest go first."""

FALL = 0.4
"""Error of the mean of some pictures over its difference from that of the first quarter of them:
0.35 at edges, more in what is random."""

TOGETHER = 0.5
"""Correlation that is allowed for between the error of a quality and that of the mean: of 32
pictures of many kinds nearly all had less than 0.4, and those with more are told by `ALIKE`."""

ALIKE = 1.5
"""The same over the correlation between the quality's difference from the mean and that of the
first quarter: edges along rows of pixels meet all samples alike."""

BY_CHANCE = 1.5
"""The same times the root of the number of pixels that differ."""

ROUGHLY = 1.75
"""Largest ratio, either way, of the error of a quality of one sample to its difference from the
mean of 4 pictures, the first: of 32 pictures none had more than 1.65."""

FEW_FACES = 0.25
"""Faces for each pixel up to which the areas that they show are found in the time of 64 pictures
or less."""

ALL_PICTURES = int(Quality.reference().samples)
"""Pictures of the reference."""

LIGHT: tuple[OutputName, ...] = "color", "linear"
"""Outputs by which frames are compared: see `light_of`."""

CODES = 255.0
"""Largest 8-bit code."""

Draw: TypeAlias = Callable[[Quality], Frame]
Sweep: TypeAlias = Callable[[], Iterable[Frame]]

Item = TypeVar("Item")

FORMAT = 1
"""Format number of the profile's file; a file of another format is ignored."""

DECIDING = ("cpu", "architecture", "processors")
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
"""Those to choose from for an error, before the reference. It is the same for all machines, so that
they choose alike."""

COMPARED = dict(zip(
    ERROR_LADDER,
    ((4, 16), (4, 256), (16, 64), (16, 64), (16, 64), (16, 256), (16, 256), (16, 256), (64, 256)),
    strict=True,
))  # fmt: skip
"""With how many pictures of the reference each is compared first, and at last if it takes so many
to tell: with all where the next one may be several times slower."""


class CalibrationWarning(UserWarning):
    """Without a profile of the machine, a scene was drawn several times to time the qualities."""


class Times:
    """
    Predicted times of one scene's frames, by quality.

    Parameters
    ----------
    ladder : sequence of Quality
        The qualities to choose from, from the fastest on.
    ratios : dict of float
        Their times over that of the standard, as far as they are known of the machine.
    """

    def __init__(self, ladder: Sequence[Quality], ratios: dict[Quality, float]) -> None:
        self.ladder = tuple(ladder)
        self.lock = forks.lock()
        """Held by `draw_in_time` while it measures: other threads' frames would be timed too."""
        self._ratios = ratios
        self._seconds: dict[Quality, float] = {}
        """Of each quality, at a load of 1: that of the frames which were measured first."""
        self._loads: deque[float] = deque([1.0] * FOR_LOAD, FOR_LOAD)
        self._late: deque[float] = deque([1.0] * LATEST, LATEST)
        """Ratios of actual to predicted time of the latest frames."""
        self._waited, self._patience = 0, PATIENCE
        self._best: Quality | None = None
        self._last: Quality | None = None

    @property
    def _load(self) -> float:
        """How busy the machine is, or the scene: the latest frames' times over those known."""
        return statistics.median(self._loads)

    @property
    def _margin(self) -> float:
        """Safety factor on predicted times."""
        return max(1.0 / HEADROOM, sorted(self._late)[math.ceil(KEPT_SHARE * LATEST) - 1])

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
            # The first two may be the other way round: there are scenes that fewer lit vertices, or
            # smaller shadow maps, make no faster.
            if step > 1 and self._least(quality) > TOO_LONG * budget:
                break
            if quality not in self._seconds:
                self._find_load(draw)
                self._measure(quality, budget, draw)
                yield quality
            is_too_long = step > 0 and self._seconds[quality] * self._load > TOO_LONG * budget
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

    def _least(self, quality: Quality) -> float:
        """Return the least seconds of a quality: of all pictures if supersampled, else 0."""
        if quality.samples not in SUPERSAMPLED:
            return 0.0
        return int(quality.samples) * min(self._seconds.values()) * self._load

    def _find_load(self, draw: Draw) -> None:
        """Measure the machine's load by the fastest quality, unless no frame was chosen yet."""
        if self._best is not None:
            fastest = min(self._seconds, key=self._seconds.__getitem__)
            for _ in range(FOR_LOAD):
                self._loads.append(self._seconds_alone(fastest, draw) / self._seconds[fastest])

    def _measure(self, quality: Quality, budget: float, draw: Draw) -> None:
        """Measure the time of a quality."""
        # The first frame gets memory. While anything compiles, in whatever thread, stages count for
        # less than they take.
        first = self._seconds_alone(quality, draw)
        if quality.samples in SUPERSAMPLED or first > HOPELESS * budget:
            self._seconds[quality] = first / self._load
            return
        times = [self._seconds_alone(quality, draw) for _ in range(FRAMES)]
        self._seconds[quality] = statistics.median(times) / self._load

    def _seconds_alone(self, quality: Quality, draw: Draw) -> float:
        """Return the seconds of a frame during which nothing compiled, if one of a few is such."""
        for _ in range(FRAMES):
            frame = draw(quality)
            if frame.stats.seconds["compile"] == 0.0:
                break
        return seconds_of(frame)

    def predict(self, quality: Quality) -> float | None:
        """Return what a frame will take, seconds; ``None`` if that is not known."""
        if quality in self._seconds:
            return self._seconds[quality] * self._load
        if quality not in self._ratios:
            return None
        # By the best quality that is known: it is the nearest.
        known = [one for one in self.ladder if one in self._seconds and one in self._ratios]
        if not known:
            return None
        share = self._ratios[quality] / self._ratios[known[-1]]
        return self._seconds[known[-1]] * share * self._load

    def best(self, budget: float) -> Quality:
        """Return the most accurate quality that stays in a budget; the fastest if none does."""
        predicted = {quality: self.predict(quality) for quality in reversed(self.ladder)}
        known = {quality: seconds for quality, seconds in predicted.items() if seconds is not None}
        for quality, seconds in known.items():
            if self._margin * seconds <= budget:
                return quality
        return min(known, key=known.__getitem__)

    def choose(self, budget: float, draw: Draw) -> tuple[Quality, float | None]:
        """
        Return the best quality that stays in a budget, and the seconds it is expected to take.

        Now and then it is the next better one, whose time is forgotten, once the load is measured.
        """
        best = self.best(budget)
        if best != self._best:
            self._best, self._patience = best, PATIENCE
        self._waited += 1
        if self._waited > self._patience:
            self._waited, self._patience = 0, 2 * self._patience
            above = self.ladder[self.ladder.index(best) + 1 :]
            other = next((one for one in above if one in self._seconds), best)
            seconds = self._seconds[other] * self._load
            if other != best and seconds <= WORTH_TRYING * budget:
                self._find_load(draw)
                del self._seconds[other]
                return other, seconds
        return best, self.predict(best)

    def learn(self, quality: Quality, seconds: float) -> None:
        """
        Correct the known times by the time of a frame.

        Of a quality that the frame before had too, what differs is load; of another one it corrects
        that quality's own time.
        """
        own = self._seconds.get(quality)
        if own is None:
            own = (self.predict(quality) or seconds) / self._load
        late = seconds / (own * self._load)
        self._late.append(late)
        if quality != self._last:
            rest = min(max(late, 1.0 / MAX_SHARE), MAX_SHARE)
            own *= OWN_MEMORY + (1.0 - OWN_MEMORY) * rest
        self._seconds[quality], self._last = own, quality
        self._loads.append(seconds / own)


def draw_in_time(budget: float, times: Times, draw: Draw) -> Frame:
    """
    Draw a frame in the most accurate quality that a time allows.

    Parameters
    ----------
    budget : float
        Seconds, above 0. If even the fastest quality takes longer, that is drawn.
    times : Times
        What is known of the scene; changed.
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
    return draw_as_known(budget, times, draw)


def draw_as_known(budget: float, times: Times, draw: Draw) -> Frame:
    """
    Draw a frame in the most accurate quality whose predicted time fits a budget.

    Takes and returns what `draw_in_time` does, but measures nothing first: some time must be known.
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
        """Draw the pictures that are missing of so many."""
        while self.pictures < pictures:
            frame = next(self._frames)
            light = light_of(frame)
            if self.pictures:
                self._change = light - self._light
            for stage, seconds in frame.stats.seconds.items():
                self._seconds[stage] = self._seconds.get(stage, 0.0) + seconds
            frame.stats.seconds.update(self._seconds)
            self.frame, self._light, self.pictures = frame, light, frame.plan.pictures

    def error_of(self, frame: Frame) -> tuple[float, float]:
        """Return the least and the most that the error of a frame is."""
        differences = light_of(frame) - self._light
        found = root_mean_square(differences)
        if self.pictures == ALL_PICTURES:
            return found, found
        least, most = self._bounds(differences, found)
        square, chance = self._square_between(frame)
        if square - chance > most**2:
            return least, math.inf
        # Samples that all agree may all lie at the same places.
        return least, most if found > 0.0 else max(most, math.sqrt(max(square + 3.0 * chance, 0.0)))

    def _square_between(self, frame: Frame) -> tuple[float, float]:
        """
        Return the mean square error of a frame, and how far that may be off by chance.

        Samples of the two swept pictures are independent, and so the mean of the product of the
        differences from both is that square.
        """
        if not self._swept:
            self._swept = tuple(light_of(one) for one in self._sweep())
        light = light_of(frame)
        one, other = (np.subtract(swept, light, dtype=np.float64) for swept in self._swept)
        squares = (one * other).mean(axis=2)
        return float(squares.mean()), float(squares.std()) / math.sqrt(squares.size)

    def _bounds(self, differences: NDArray[np.float32], found: float) -> tuple[float, float]:
        """
        Return the least and the most of an error, by the difference from the mean so far.

        Its square is that of the difference from the mean so far, less that of the mean's own
        error, but for how the two errors may go together: by chance, less where more pixels
        differ, or since samples lie at the same places. The least and the most allow for that.
        """
        if self._change is None:
            return found / ROUGHLY, found * ROUGHLY
        own = FALL * root_mean_square(self._change)
        if found == 0.0 or own == 0.0:
            return found, found + own
        squares = np.square(differences, dtype=np.float64).sum(axis=2)
        chance = BY_CHANCE * math.sqrt(np.sum(squares**2)) / float(np.sum(squares))
        products = np.multiply(differences, self._change, dtype=np.float64)
        alike = FALL * abs(float(np.mean(products))) / (found * own)
        spread = 2.0 * found * own * (max(TOGETHER, ALIKE * alike) + chance)
        return math.sqrt(max(found**2 - own**2 - spread, 0.0)), math.sqrt(found**2 + spread)


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
    true, shows_areas = Reference(refined, sweep), False
    undecided: list[Frame] = []
    for quality in ERROR_LADDER:
        if quality.samples == "area" and not shows_areas:
            continue
        latest = draw(quality)
        undecided.append(latest)
        shows_areas = not latest.plan.facts.transparency.used and (
            latest.stats.drawn <= FEW_FACES * math.prod(latest.plan.size)
        )
        pictures, last = COMPARED[quality]
        # Before a quality that is many times slower, none may be left undecided.
        while pictures <= last and undecided:
            if undecided[-1] is not latest and last < ALL_PICTURES:
                break
            true.draw(pictures)
            tried, undecided = undecided, []
            for frame in tried:
                least, most = true.error_of(frame)
                if most <= bound:
                    frame.choice = QualityChoice(frame.plan.quality, None, seconds_of(frame), most)
                    return frame
                if least <= bound:
                    undecided.append(frame)
            pictures = 4 * true.pictures
    true.draw(ALL_PICTURES)
    true.frame.choice = QualityChoice(Quality.reference(), None, seconds_of(true.frame), 0.0)
    return true.frame


def known_ladder() -> tuple[Quality, ...]:
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
        alpha = frame.color[:, :, 3:].astype(np.float32) / np.float32(CODES)
    else:
        light, alpha = frame.linear[:, :, :3], frame.linear[:, :, 3:]
    shows_more = any(not is_backdrop(one.effect) for one in plan.effects_at("background"))
    if shows_more or plan.background[3] >= 1.0:
        return light
    return np.concatenate([light * alpha, alpha], axis=2)


def root_mean_square(differences: NDArray[Any]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(differences, dtype=np.float64))))


def seconds_of(frame: Frame) -> float:
    """Return the seconds that a frame took, without compiling."""
    return sum(time for stage, time in frame.stats.seconds.items() if stage != "compile")


def times_of(what: Any, circumstances: Any) -> Times:
    """
    Return what is known of the times of a scene, as long as the scene is there.

    Parameters
    ----------
    what : object
        What is drawn.
    circumstances : hashable
        What else times depend on.

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
        _TIMES[key] = times = Times(ladder, ratios)
        # Another scene may come to lie at the same address.
        weakref.finalize(what, _TIMES.pop, key, None)
        while len(_TIMES) > MAX_KNOWN:
            del _TIMES[next(iter(_TIMES))]
    if profile is None:
        warn_caller(
            "time_budget: there is no profile of this machine, so frames of this scene are timed "
            "first; `rasterjit accuracy --calibrate` makes one",
            CalibrationWarning,
        )
    return times


_LOCK = forks.lock()
_TIMES: dict[Any, Times] = {}
"""Times of scenes, by their address and the circumstances."""


class QualityStep(NamedTuple):
    """A quality to choose from."""

    quality: Quality
    time: float
    """Of a frame, over that of a standard one."""
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


def front_of(items: Iterable[Item], cost: Callable[[Item], tuple[float, float]]) -> list[Item]:
    """Return the items that no other is both faster and more accurate than, the fastest first."""
    front: list[Item] = []
    for item in sorted(items, key=cost):
        if not front or cost(item)[1] < cost(front[-1])[1]:
            front.append(item)
    return front


def front_of_steps(steps: Iterable[QualityStep]) -> tuple[QualityStep, ...]:
    """Return the steps that no other is both faster and more accurate than, the fastest first."""
    return tuple(front_of(steps, lambda step: (step.time, step.error)))


def machine() -> dict[str, str]:
    """Return the properties of the machine that times depend on."""
    return {
        "cpu": cpu_features()[0],
        "architecture": platform.machine(),
        "processors": str(available_processors()),
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
    }


def profile_file() -> Path:
    """Return where the profile of this machine is kept."""
    return cache_folder() / "profile.json"


def save_profile(profile: Profile) -> Path:
    """
    Write the profile of this machine to its file, whole or not at all.

    Raises
    ------
    ValueError
        Naming the folder, if it cannot be written to.
    """
    content = {
        "format": FORMAT,
        "machine": machine(),
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
    path = profile_file()
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
        content = json.loads(profile_file().read_text())
        here = machine()
        is_of_here = all(content["machine"][name] == here[name] for name in DECIDING)
        steps = front_of_steps([_step(entry) for entry in content["steps"]])
        if content["format"] != FORMAT or not is_of_here or not steps:
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
