"""Time qualities against the standard: in rounds, by turns, within a budget of seconds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy.choice import find_uncertainty
from rasterjit.accuracy.results import CPU, STANDARD, WALL, Errors, Trial
from rasterjit.accuracy.settings_to_try import Attempt

if TYPE_CHECKING:
    from rasterjit.accuracy.study import Studio

MIN_ROUNDS, MAX_ROUNDS = 3, 21
"""Least and most rounds of timing."""

RESERVED_ROUNDS = 2
"""Rounds that must fit into the budget before one more quality is prepared."""

MIN_SLOW_RATIO = 8.0
"""Ratio to the standard's time above which frames are drawn in fewer rounds: as if they took that
long on average, but in at least three rounds."""

STANDARDS_PER_ROUND = 3
"""Frames of the standard in a round, if it has that many contestants."""

WARMUP_FRAMES = 2
"""Frames of each quality that are drawn before the rounds."""

MAX_WALL_UNCERTAINTY = 0.1
"""Largest relative uncertainty of a typical time at which elapsed times are reported."""

HOPELESS_RATIO = 1.3
"""Ratio to the time of a trial as accurate at which a quality gets no further rounds."""

Stages = dict[str, float]
"""Seconds by stage, without compiling."""

Progress = Callable[[str, float, float], None]
"""Callback for progress: text, amount done, and total, in seconds or scenes."""


class TimeBudget:
    """
    Budget of seconds that runs out as time passes.

    Parameters
    ----------
    seconds : float
    clock : callable
        Returns seconds since a fixed time.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock, self._begin = clock, clock()
        self._end = self._begin + seconds

    @property
    def total(self) -> float:
        """Seconds spent and left together."""
        return self._end - self._begin

    def spent(self) -> float:
        """Return the seconds spent."""
        return self._clock() - self._begin

    def left(self) -> float:
        """Return the seconds left; below zero if overspent."""
        return self._end - self._clock()

    def reserve(self, seconds: float) -> None:
        """Take seconds away, for work after the budget has run out."""
        self._end -= seconds

    def ensure(self, seconds: float) -> None:
        """Extend the budget until so many seconds are left, if there are fewer."""
        self._end += max(0.0, seconds - self.left())


@dataclass
class Contestant:
    """
    A quality that is timed.

    Attributes
    ----------
    attempt : Attempt
    errors : Errors
    color : (H, W, 3) uint8, sRGB
    error_map : (H, W) float32
    first_stages : dict of float
        Seconds of the stages of its first frame: all that is known until a round is over.
    first_cpu_seconds : float
        Processor time of its first frame.
    """

    attempt: Attempt
    errors: Errors
    color: NDArray[np.uint8]
    error_map: NDArray[np.float32]
    first_stages: Stages
    first_cpu_seconds: float = 0.0
    frame_stages: list[Stages] = field(default_factory=list)
    standard_seconds: list[float] = field(default_factory=list)
    """Seconds of the standard in the round of each of ``frame_stages``."""
    cpu_seconds: list[float] = field(default_factory=list)
    """Processor time of each of ``frame_stages``."""

    @property
    def estimated_seconds(self) -> float:
        """Estimated seconds of a frame."""
        return sum_stages(self.first_stages)

    @property
    def min_cpu_seconds(self) -> float:
        """Least processor time of a frame; 0 where it is not known."""
        return min([self.first_cpu_seconds, *self.cpu_seconds])

    def least_cpu_seconds(self) -> tuple[float, ...]:
        """
        Return the least half of the processor times, sorted; at least three of them.

        Other processes on a core or in its cache make the work longer, never shorter.
        """
        seconds = sorted([self.first_cpu_seconds, *self.cpu_seconds])
        return tuple(seconds[: max(MIN_ROUNDS, -(-len(seconds) // 2))])

    def trial(self, standard: Contestant, clock: str = WALL) -> Trial:
        """Return the trial measured by a clock."""
        frame_stages = self.frame_stages or [self.first_stages]
        if clock == WALL:
            seconds = tuple(sum_stages(stages) for stages in frame_stages)
            standard_seconds = self.standard_seconds or [sum_stages(standard.first_stages)]
        else:
            seconds = self.least_cpu_seconds()
            standard_seconds = [statistics.median(standard.least_cpu_seconds())] * len(seconds)
        attempt = self.attempt
        return Trial(
            attempt.setting,
            attempt.level,
            attempt.quality,
            seconds,
            tuple(own / base for own, base in zip(seconds, standard_seconds, strict=True)),
            median_stages(frame_stages),
            self.errors,
            self.color,
            self.error_map,
        )


def choose_clock(standard: Contestant, contestants: Sequence[Contestant]) -> str:
    """Return the clock with the least uncertain times: the processors' on a busy machine."""
    if not contestants or any(one.min_cpu_seconds == 0.0 for one in (standard, *contestants)):
        return WALL
    wall, cpu = (
        statistics.median(
            find_uncertainty(trial) / trial.ratio
            for trial in (contestant.trial(standard, clock) for contestant in contestants)
        )
        for clock in (WALL, CPU)
    )
    return WALL if wall <= MAX_WALL_UNCERTAINTY or wall < cpu else CPU


def find_contenders(standard: Contestant, contestants: Sequence[Contestant]) -> list[Contestant]:
    """Return the contestants of the studied scene that none as accurate beats by far."""
    same_scene = [contestant for contestant in contestants if contestant.attempt.scene is None]
    return [
        contestant
        for contestant in same_scene
        if not any(
            rival.errors.rmse <= contestant.errors.rmse
            and HOPELESS_RATIO * rival.min_cpu_seconds < contestant.min_cpu_seconds
            for rival in (standard, *same_scene)
        )
    ]


def sum_stages(stages: Stages) -> float:
    """Return the seconds of all stages together."""
    return sum(stages.values(), 0.0)


def median_stages(frame_stages: Sequence[Stages]) -> Stages:
    """Return the median seconds of each stage of the last frame, in order."""
    return {
        stage: statistics.median(stages.get(stage, 0.0) for stages in frame_stages)
        for stage in frame_stages[-1]
    }


def make_standard_trial(standard: Contestant, clock: str = WALL) -> Trial:
    """Return the trial of the standard, whose ratios are 1."""
    trial = standard.trial(standard, clock)
    return replace(trial, setting=STANDARD, level=STANDARD, ratios=(1.0,) * len(trial.seconds))


def has_time(
    attempt: Attempt, standard: Contestant, prepared: Sequence[Contestant], budget: TimeBudget
) -> bool:
    """
    Tell whether there is time to prepare one more quality, and then for rounds of all.

    The time to compile it is not known, and not counted.
    """
    frame_seconds = attempt.passes * standard.estimated_seconds
    prepared_seconds = sum(one.estimated_seconds for one in prepared)
    round_seconds = 2.0 * (standard.estimated_seconds + frame_seconds + prepared_seconds)
    return WARMUP_FRAMES * frame_seconds + RESERVED_ROUNDS * round_seconds <= budget.left()


def round_interval(contestant: Contestant, standard: Contestant) -> int:
    """Return how many rounds lie between two frames of a contestant: 1 for every round."""
    max_seconds = MIN_SLOW_RATIO * max(standard.estimated_seconds, 1e-9)
    interval = round(contestant.estimated_seconds / max_seconds)
    return max(1, min(interval, MAX_ROUNDS // MIN_ROUNDS))


def run_rounds(
    studio: Studio,
    standard: Contestant,
    contestants: Sequence[Contestant],
    budget: TimeBudget,
    progress: Callable[[str], None],
    cpu_clock: Callable[[], float] = time.process_time,
) -> None:
    """
    Draw all contestants once a round, until the budget is spent.

    All have three rounds, if there is time; then those that take longer than others as accurate, or
    that draw another scene, have no more.

    The standard is drawn up to three times a round, and times are relative to the median, so that
    disturbances fall on all alike. Each round begins with another contestant. A frame is drawn
    twice and the second counts, as caches hold the data of another quality before. The first round
    is drawn in any case. An interrupted round is forgotten.
    """
    longest, count = 0.0, len(contestants)
    for number in range(MAX_ROUNDS):
        progress("timing")
        # After three rounds, or when time gets short, drop contestants.
        before = budget.left()
        is_late = before < (MIN_ROUNDS - number) * longest
        if len(contestants) == count and (number == MIN_ROUNDS or is_late):
            longest /= standard.estimated_seconds + sum(c.estimated_seconds for c in contestants)
            contestants = find_contenders(standard, contestants)
            longest *= standard.estimated_seconds + sum(c.estimated_seconds for c in contestants)
        if number > 0 and before < longest:
            break
        # Time a frame of each that takes part in this round.
        present = [c for c in contestants if number % round_interval(c, standard) == 0]
        first = number % max(len(present), 1)
        timed = [
            (contestant, *_time_frame(studio, contestant.attempt, cpu_clock))
            for contestant in order_round(present[first:] + present[:first], standard)
        ]
        standard_seconds = statistics.median(
            sum_stages(stages) for contestant, stages, _ in timed if contestant is standard
        )
        for contestant, stages, cpu_seconds in timed:
            contestant.frame_stages.append(stages)
            contestant.cpu_seconds.append(cpu_seconds)
            contestant.standard_seconds.append(standard_seconds)
        longest = max(longest, before - budget.left())


def order_round(contestants: Sequence[Contestant], standard: Contestant) -> list[Contestant]:
    """Return the order of a round: the standard before each third of the contestants."""
    third = max(-(-len(contestants) // STANDARDS_PER_ROUND), 1)
    order: list[Contestant] = []
    for start in range(0, max(len(contestants), 1), third):
        order += [standard, *contestants[start : start + third]]
    return order


def _time_frame(
    studio: Studio, attempt: Attempt, cpu_clock: Callable[[], float]
) -> tuple[Stages, float]:
    """Return the seconds of each stage of a second frame, and its processor time."""
    if attempt.passes == 1:
        studio.time_stages(attempt)
    before = cpu_clock()
    return studio.time_stages(attempt), cpu_clock() - before
