"""
Choose the quality of a frame: the best one that a time allows, or the fastest for an error.

What qualities cost and buy on this machine is measured once and kept in the cache folder.

For a time budget, it remembers what frames of a scene took. The first time that it sees a scene it
draws frames of ever better qualities until one takes too long; with a profile of the machine
(``rasterjit accuracy --calibrate``) one frame tells what the others would take. From then on each
frame corrects these times, so that the choice follows a camera that moves and a machine that slows
down.

For an error bound nothing is remembered: two small pictures are drawn accurately, then in ever
faster qualities until one exceeds the bound. If all do, the frame is the reference.
"""

from __future__ import annotations

import json
import math
import platform
import statistics
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from rasterjit import forks
from rasterjit.io.whole import replacing
from rasterjit.outputs.frame import Choice, Frame
from rasterjit.runtime.store import cache_folder, cpu_features
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.quality import SUPERSAMPLED, Quality, differences
from rasterjit.scene.warning import warn_caller
from rasterjit.survey.effect import shown_as_given

HEADROOM = 0.9
"""Share of a time budget that a frame may be expected to take: times vary."""

TOO_LONG = 1.5
"""Calibrating stops at a quality that takes this many budgets: better ones take longer."""

HOPELESS = 3.0
"""A quality is measured by its first frame alone, which also gets memory, if that takes this many
budgets."""

FRAMES = 3
"""Frames of each quality whose median calibrating takes; supersampled ones are drawn once."""

MEMORY = 0.5
"""Weight of the old estimate of the machine's load when a frame updates it."""

OWN_MEMORY = 0.8
"""Weight of the old estimate of a quality's own time when a frame updates it."""

MOST_SHARE = 2.0
"""Largest ratio, either way, of a frame's time to the expected one that counts."""

MOST_KNOWN = 64
"""Most scenes, each in its circumstances, whose times are remembered; the oldest go first."""

MARGIN = 1.75
"""
The error of the small pictures, times this, must be below the bound.

The picture itself has other pixels. Of 30 pictures of many kinds, none needed more than 1.4.
"""

PROBE_SHARES = (0.5, 0.4)
"""Sides of the two small pictures over those of the picture. Edges and patterns that happen to fit
the pixels of one do not fit those of the other."""

LEAST_PROBE = 48
"""Side of a small picture, pixels, unless the picture itself is smaller."""

PROBE_SAMPLES = 64
"""Pictures whose mean stands for the reference of a small picture, at a quarter of its time."""

CODES = 255.0
"""Largest 8-bit code."""

Draw: TypeAlias = Callable[[Quality], Frame]

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


class CalibrationWarning(UserWarning):
    """Without a profile of the machine, a scene was drawn several times to time the qualities."""


class Times:
    """
    What frames of one scene take in each quality.

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
        """Held by `draw_in_time` while it calibrates: other threads' frames would be timed too."""
        self.is_calibrated = False
        """Whether `calibrate` came to its end."""
        self._ratios = ratios
        self._seconds: dict[Quality, float] = {}
        self._load = 1.0

    def calibrate(self, budget: float, draw: Draw) -> Iterator[Quality]:
        """
        Measure the times of the qualities, from the fastest on, until one takes too long.

        With a profile of the machine, the fastest one predicts the others; only chosen ones are
        measured as well.

        Yields
        ------
        Quality
            The one that was measured. A caller that stops here and calls again continues with the
            next. A call after the end measures more only if frames have become faster.
        """
        for step, quality in enumerate(self.ladder):
            # The first two may be the other way round: there are scenes that fewer lit vertices, or
            # smaller shadow maps, make no faster.
            if step > 1 and self._least(quality) > TOO_LONG * budget:
                break
            if quality not in self._seconds:
                self._measure(quality, budget, draw)
                yield quality
            is_too_long = step > 0 and self._seconds[quality] * self._load > TOO_LONG * budget
            if self._ratios or is_too_long:
                break
        while (chosen := self.best(budget)) not in self._seconds:
            self._measure(chosen, budget, draw)
            yield chosen
        self.is_calibrated = True

    @property
    def is_known(self) -> bool:
        """Whether the time of any quality is known."""
        return bool(self._seconds)

    def _least(self, quality: Quality) -> float:
        """Return the least seconds of a quality: of all pictures if supersampled, else 0."""
        if quality.samples not in SUPERSAMPLED:
            return 0.0
        return int(quality.samples) * min(self._seconds.values()) * self._load

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
            if seconds <= HEADROOM * budget:
                return quality
        return min(known, key=known.__getitem__)

    def learn(self, quality: Quality, seconds: float) -> None:
        """
        Correct the known times by the time of a frame.

        Most of the difference counts as the machine's load, so a disturbed frame is soon forgotten.
        The rest corrects the time of its quality for longer.
        """
        if quality not in self._seconds:
            predicted = self.predict(quality)
            self._seconds[quality] = (seconds if predicted is None else predicted) / self._load
        share = seconds / (self._seconds[quality] * self._load)
        share = min(max(share, 1.0 / MOST_SHARE), MOST_SHARE)
        self._load *= MEMORY + (1.0 - MEMORY) * share
        self._seconds[quality] *= OWN_MEMORY + (1.0 - OWN_MEMORY) * share


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
        if not times.is_calibrated:
            for _ in times.calibrate(budget, draw):
                pass
    return draw_as_known(budget, times, draw)


def draw_as_known(budget: float, times: Times, draw: Draw) -> Frame:
    """
    Draw a frame in the most accurate quality whose predicted time fits a budget.

    Takes and returns what `draw_in_time` does, but measures nothing first: some time must be known.
    """
    quality = times.best(budget)
    predicted = times.predict(quality)
    frame = draw(quality)
    seconds = seconds_of(frame)
    # Ignore a frame during which anything compiled, in this thread or another.
    if frame.stats.seconds["compile"] == 0.0:
        times.learn(quality, seconds)
    frame.choice = Choice(quality, predicted, seconds)
    return frame


def draw_within_error(bound: float, draw: Draw, small_draws: Sequence[Draw]) -> Frame:
    """
    Draw a frame in the fastest quality that is near enough to the reference.

    Parameters
    ----------
    bound : float
        Largest root mean square difference from the reference, in linear light, above 0.
    draw : callable
        Draws a frame of a quality.
    small_draws : sequence of callable
        Draw it in small pictures; the largest of their errors counts.

    Returns
    -------
    Frame
        Its ``choice`` tells which one it is.
    """

    def lights(quality: Quality) -> list[NDArray[np.float32]]:
        return [light_of(draw_small(quality)) for draw_small in small_draws]

    best = Quality.reference()
    nearly = replace(best, samples=PROBE_SAMPLES)
    true = lights(nearly)
    quality, error = best, 0.0
    # Go from the most accurate one down: one that beats a more accurate one does so by luck.
    # Leave out `nearly`: to measure its error takes 256 small pictures, as long as the reference.
    for candidate in reversed(known_ladder()):
        if candidate not in (best, nearly):
            found = max(error, _largest_error(lights(candidate), true))
            if MARGIN * found > bound:
                break
            quality, error = candidate, found
    frame = draw(quality)
    frame.choice = Choice(quality, None, seconds_of(frame), error)
    return frame


def _largest_error(
    lights: Sequence[NDArray[np.float32]], others: Sequence[NDArray[np.float32]]
) -> float:
    """Return the largest root mean square difference of pairs of pictures."""
    return max(root_mean_square(light - other) for light, other in zip(lights, others, strict=True))


def known_ladder() -> tuple[Quality, ...]:
    """Return the qualities to choose from, from the fastest on."""
    profile = load_profile()
    return LADDER if profile is None else profile.ladder


def probe_sizes(size: tuple[int, int]) -> list[tuple[int, int]]:
    """Return the sizes of the small pictures that errors are measured on."""
    width, height = size
    return [(_probe_side(width, share), _probe_side(height, share)) for share in PROBE_SHARES]


def _probe_side(side: int, share: float) -> int:
    """Return a side of a small picture, pixels."""
    return min(side, max(LEAST_PROBE, round(share * side)))


def light_of(frame: Frame) -> NDArray[np.float32]:
    """
    Return the light that a frame shows, (H, W, 3) float32, linear red, green and blue.

    Before a transparent background, the light is multiplied by alpha, which is a fourth channel.
    Lines around and along faces are drawn over the 8-bit colour alone: with them the light is that
    colour, decoded. Other overlays treat a pixel alike in any quality, as tone curves do, and are
    left out.
    """
    plan = frame.plan
    if any(overlay.effect.joins_faces for overlay in plan.at("overlay")):
        light = srgb_to_linear(frame.color[:, :, :3])
        alpha = frame.color[:, :, 3:].astype(np.float32) / np.float32(CODES)
    else:
        light, alpha = frame.linear[:, :, :3], frame.linear[:, :, 3:]
    shows_more = any(not shown_as_given(one.effect) for one in plan.at("background"))
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
        while len(_TIMES) > MOST_KNOWN:
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
"""What is known of scenes, by their address and the circumstances."""


class Step(NamedTuple):
    """A quality to choose from."""

    quality: Quality
    time: float
    """Of a frame, over that of a standard one."""
    error: float
    """Root mean square in linear light, over that of a standard frame."""


@dataclass(frozen=True)
class Profile:
    """
    What qualities cost and buy on a machine.

    Attributes
    ----------
    steps : tuple of Step
        From the fastest on, each more accurate than those before.
    threads : int
        That frames were drawn with.
    """

    steps: tuple[Step, ...]
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


def front_of_steps(steps: Iterable[Step]) -> tuple[Step, ...]:
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
        with replacing(path) as temporary:
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


def _step(entry: Any) -> Step:
    """Return a step read from the file; raise ``ValueError`` for impossible times and errors."""
    time, error = float(entry["time"]), float(entry["error"])
    if not (0.0 < time < math.inf and 0.0 <= error < math.inf):
        raise ValueError(f"a step must take time and have an error, got {entry!r}")
    return Step(Quality(**entry["settings"]), time, error)
