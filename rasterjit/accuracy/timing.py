"""Time qualities against the standard: in rounds, by turns, within an allowance of seconds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy.choice import noise
from rasterjit.accuracy.results import CPU, STANDARD, WALL, Errors, Trial
from rasterjit.accuracy.settings_to_try import Attempt

if TYPE_CHECKING:
    from rasterjit.accuracy.study import Studio

MIN_ROUNDS, MAX_ROUNDS = 3, 21
"""Least and most rounds of timing."""

RESERVED_ROUNDS = 2
"""Rounds that time is reserved for."""

SLOW_RATIO = 8.0
"""Frames that take longer than so many of the standard's are drawn in fewer rounds: so often that
on average they take no longer, but not so seldom that nothing is known of their times."""

STANDARDS_PER_ROUND = 3
"""Frames of the standard in a round of many."""

WARMUP_FRAMES = 2
"""Frames of each quality that are drawn before the rounds."""

MAX_WALL_NOISE = 0.1
"""Largest relative uncertainty of a typical time at which elapsed times are reported."""

HOPELESS_RATIO = 1.3
"""Ratio to the time of a trial as accurate at which a quality gets no further rounds."""

Stages = dict[str, float]
"""Seconds by stage, without compiling."""

Progress = Callable[[str, float, float], None]
"""Callback for progress: text, amount done, and total, in seconds or scenes."""


class Allowance:
    """
    Budget of seconds that runs out.

    Parameters
    ----------
    seconds : float
    clock : callable
        Returns seconds from any start.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock, self._begin = clock, clock()
        self._end = self._begin + seconds

    @property
    def total(self) -> float:
        """All seconds, those that are spent and those that are left."""
        return self._end - self._begin

    def spent(self) -> float:
        """Return the seconds spent."""
        return self._clock() - self._begin

    def left(self) -> float:
        """Return the seconds left; below zero if overspent."""
        return self._end - self._clock()

    def take(self, seconds: float) -> None:
        """Subtract seconds."""
        self._end -= seconds

    def keep(self, seconds: float) -> None:
        """Add what is missing from so many, if fewer are left."""
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
    first : dict of float
        Seconds of its stages when it was first drawn: all that is known until a round is over.
    first_worked : float
        Seconds that processors worked for that frame.
    """

    attempt: Attempt
    errors: Errors
    color: NDArray[np.uint8]
    error_map: NDArray[np.float32]
    first: Stages
    first_worked: float = 0.0
    frames: list[Stages] = field(default_factory=list)
    usual: list[float] = field(default_factory=list)
    """Seconds of the standard in the round of each of ``frames``."""
    worked: list[float] = field(default_factory=list)
    """Seconds that processors worked for each of ``frames``."""

    @property
    def cost(self) -> float:
        """Seconds that a frame takes, about."""
        return total(self.first)

    @property
    def least(self) -> float:
        """Least seconds that processors worked for a frame; 0 where nobody knows."""
        return min([self.first_worked, *self.worked])

    def trial(self, standard: Contestant, clock: str = WALL) -> Trial:
        """Return the trial measured by a clock."""
        frames = self.frames or [self.first]
        if clock == WALL:
            seconds = tuple(total(frame) for frame in frames)
            usual = self.usual or [total(standard.first)]
        else:
            seconds = least_half([self.first_worked, *self.worked])
            other = statistics.median(least_half([standard.first_worked, *standard.worked]))
            usual = [other] * len(seconds)
        attempt = self.attempt
        return Trial(
            attempt.setting,
            attempt.level,
            attempt.quality,
            seconds,
            tuple(mine / other for mine, other in zip(seconds, usual, strict=True)),
            medians(frames),
            self.errors,
            self.color,
            self.error_map,
        )


def least_half(worked: Sequence[float]) -> tuple[float, ...]:
    """
    Return the least half of some processor times, sorted; at least three of them.

    What shares a core or a cache makes the work longer, never shorter.
    """
    return tuple(sorted(worked)[: max(MIN_ROUNDS, -(-len(worked) // 2))])


def best_clock(standard: Contestant, contestants: Sequence[Contestant]) -> str:
    """Return which clock tells times best: the processors' where the machine is disturbed."""
    if not contestants or any(one.least == 0.0 for one in (standard, *contestants)):
        return WALL
    unknown = {
        clock: statistics.median(
            noise(trial) / trial.ratio
            for trial in (one.trial(standard, clock) for one in contestants)
        )
        for clock in (WALL, CPU)
    }
    is_quiet = unknown[WALL] <= MAX_WALL_NOISE or unknown[WALL] < unknown[CPU]
    return WALL if is_quiet else CPU


def contenders(standard: Contestant, contestants: Sequence[Contestant]) -> list[Contestant]:
    """Return those that may be worth choosing, however their times err; no scene but the own."""
    own = [one for one in contestants if one.attempt.scene is None]
    return [
        one
        for one in own
        if not any(
            other.errors.rmse <= one.errors.rmse and HOPELESS_RATIO * other.least < one.least
            for other in (standard, *own)
        )
    ]


def total(stages: Stages) -> float:
    """Return the seconds of all stages together."""
    seconds = 0.0
    for duration in stages.values():
        seconds += duration
    return seconds


def medians(frames: Sequence[Stages]) -> Stages:
    """Return the median seconds of each stage, in order."""
    return {
        stage: statistics.median(frame.get(stage, 0.0) for frame in frames) for stage in frames[-1]
    }


def standard_trial(standard: Contestant, clock: str = WALL) -> Trial:
    """Return what was measured of the standard, which is timed in every round."""
    trial = standard.trial(standard, clock)
    return replace(trial, setting=STANDARD, level=STANDARD, ratios=(1.0,) * len(trial.seconds))


def has_time(
    attempt: Attempt, standard: Contestant, prepared: Sequence[Contestant], allowance: Allowance
) -> bool:
    """
    Tell whether there is time to prepare one more quality, and for rounds of all of them after.

    Whether it has to be compiled nobody knows; after one that took too long none fits.
    """
    cost = attempt.passes * standard.cost
    round_seconds = 2.0 * (standard.cost + cost + sum(one.cost for one in prepared))
    wanted = WARMUP_FRAMES * cost + RESERVED_ROUNDS * round_seconds
    return wanted <= allowance.left()


def round_interval(contestant: Contestant, standard: Contestant) -> int:
    """Return in every how many rounds a contestant takes part; three times, if all are drawn."""
    wanted = round(contestant.cost / (SLOW_RATIO * max(standard.cost, 1e-9)))
    return max(1, min(wanted, MAX_ROUNDS // MIN_ROUNDS))


def run_rounds(
    painter: Studio,
    standard: Contestant,
    contestants: Sequence[Contestant],
    allowance: Allowance,
    progress: Callable[[str], None],
    processor: Callable[[], float] = time.process_time,
) -> None:
    """
    Draw all contestants once a round, until nothing is left of the allowance.

    Three rounds are for all, if there is time; after that, those that take longer than something as
    accurate, or that draw another scene, have no more.

    The standard is drawn up to three times, and the median counts: all are held against it. What
    disturbs the machine so falls on all of them. They begin with another one every round.
    A frame is drawn twice and the second counts, for another quality was drawn before: what is kept
    from frame to frame is not as for the next of many. The first round is drawn in any case. One
    that is interrupted is forgotten.
    """
    longest, count = 0.0, len(contestants)
    for number in range(MAX_ROUNDS):
        progress("timing")
        before = allowance.left()
        is_late = before < (MIN_ROUNDS - number) * longest
        if len(contestants) == count and (number == MIN_ROUNDS or is_late):
            longest /= standard.cost + sum(one.cost for one in contestants)
            contestants = contenders(standard, contestants)
            longest *= standard.cost + sum(one.cost for one in contestants)
        if number > 0 and before < longest:
            break
        present = [one for one in contestants if number % round_interval(one, standard) == 0]
        first = number % max(len(present), 1)
        drawn = [
            (one, *_time_frame(painter, one.attempt, processor))
            for one in insert_standards(present[first:] + present[:first], standard)
        ]
        usual = statistics.median(total(frame) for one, frame, _ in drawn if one is standard)
        for one, frame, worked in drawn:
            one.frames.append(frame)
            one.worked.append(worked)
            one.usual.append(usual)
        longest = max(longest, before - allowance.left())


def insert_standards(turn: Sequence[Contestant], standard: Contestant) -> list[Contestant]:
    """Return the order of a round: the standard before each third of the others."""
    third = max(-(-len(turn) // STANDARDS_PER_ROUND), 1)
    order: list[Contestant] = []
    for start in range(0, max(len(turn), 1), third):
        order += [standard, *turn[start : start + third]]
    return order


def _time_frame(
    painter: Studio, attempt: Attempt, processor: Callable[[], float]
) -> tuple[Stages, float]:
    """Return the seconds of a frame that is not the first of its quality, and those worked."""
    if attempt.passes == 1:
        painter.seconds(attempt)
    before = processor()
    return painter.seconds(attempt), processor() - before
