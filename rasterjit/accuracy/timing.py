"""Time qualities against the standard: in rounds, by turns, within an allowance of seconds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy.knobs import Attempt
from rasterjit.accuracy.results import STANDARD, Errors, Trial
from rasterjit.scene.quality import Quality

LEAST_ROUNDS, MOST_ROUNDS = 3, 21
"""Rounds that time is kept for, and after which more would hardly tell more."""

SLOW = 8.0
"""Frames that take longer than so many of the standard's are drawn in fewer rounds: so often that
on average they take no longer, but not so seldom that nothing is known of their times."""

STANDARDS = 3
"""Frames of the standard in a round of many."""

DRAWINGS = 3
"""Frames that are drawn of each quality before the rounds."""

Stages = dict[str, float]
"""Seconds by stage; compiling is none of them."""

Progress = Callable[[str, int, int], None]
"""Is told what is being done, how much of it is done, and how much there is."""


class Painter(Protocol):
    """Draws one scene."""

    def seconds(self, quality: Quality) -> Stages:
        """Draw a frame in a quality and return how long its stages took."""


class Allowance:
    """
    Seconds that run out.

    Parameters
    ----------
    seconds : float
    clock : callable
        Returns seconds from any start.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._end = clock() + seconds

    def left(self) -> float:
        """Return how many are left; below zero if none are."""
        return self._end - self._clock()

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
    """

    attempt: Attempt
    errors: Errors
    color: NDArray[np.uint8]
    error_map: NDArray[np.float32]
    first: Stages
    frames: list[Stages] = field(default_factory=list)
    usual: list[float] = field(default_factory=list)
    """Seconds of the standard in the round of each of ``frames``."""

    @property
    def cost(self) -> float:
        """Seconds that a frame takes, about."""
        return total(self.first)

    def trial(self, standard: Contestant) -> Trial:
        """Return what was measured."""
        frames = self.frames or [self.first]
        usual = self.usual or [total(standard.first)]
        seconds = tuple(total(frame) for frame in frames)
        return Trial(
            *self.attempt,
            seconds,
            tuple(mine / other for mine, other in zip(seconds, usual, strict=True)),
            medians(frames),
            self.errors,
            self.color,
            self.error_map,
        )


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


def standard_trial(standard: Contestant) -> Trial:
    """Return what was measured of the standard, which is timed in every round."""
    trial = standard.trial(standard)
    return replace(trial, setting=STANDARD, level=STANDARD, ratios=(1.0,) * len(trial.seconds))


def fits(
    attempt: Attempt,
    standard: Contestant,
    prepared: Sequence[Contestant],
    allowance: Allowance,
) -> bool:
    """
    Tell whether there is time to prepare one more quality, and for rounds of all of them after.

    Whether it has to be compiled nobody knows; after one that took too long none fits.
    """
    cost = attempt.passes * standard.cost
    round_seconds = 2.0 * (standard.cost + cost + sum(one.cost for one in prepared))
    wanted = DRAWINGS * cost + LEAST_ROUNDS * round_seconds
    return wanted <= allowance.left()


def rounds_between(contestant: Contestant, standard: Contestant) -> int:
    """Return in every how many rounds a contestant takes part; three times, if all are drawn."""
    wanted = round(contestant.cost / (SLOW * max(standard.cost, 1e-9)))
    return max(1, min(wanted, MOST_ROUNDS // LEAST_ROUNDS))


def take_turns(
    painter: Painter,
    standard: Contestant,
    contestants: Sequence[Contestant],
    allowance: Allowance,
    progress: Progress,
) -> None:
    """
    Draw all contestants once a round, until nothing is left of the allowance.

    The standard is drawn up to three times, and the median counts: all are held against it. What
    disturbs the machine so falls on all of them. They begin with another one every round.
    A frame is drawn twice and the second counts, for another quality was drawn before: what is kept
    from frame to frame is not as for the next of many. The first round is drawn in any case. One
    that is interrupted is forgotten.
    """
    longest = 0.0
    for number in range(MOST_ROUNDS):
        progress("timing", number, MOST_ROUNDS)
        before = allowance.left()
        if number > 0 and before < longest:
            break
        present = [one for one in contestants if number % rounds_between(one, standard) == 0]
        first = number % max(len(present), 1)
        drawn = [
            (one, _timed(painter, one.attempt))
            for one in with_standard(present[first:] + present[:first], standard)
        ]
        usual = statistics.median(total(frame) for one, frame in drawn if one is standard)
        for one, frame in drawn:
            one.frames.append(frame)
            one.usual.append(usual)
        longest = max(longest, before - allowance.left())
    progress("timing", MOST_ROUNDS, MOST_ROUNDS)


def with_standard(turn: Sequence[Contestant], standard: Contestant) -> list[Contestant]:
    """Return who is drawn in a round: the standard before each third of the others."""
    third = max(-(-len(turn) // STANDARDS), 1)
    order: list[Contestant] = []
    for start in range(0, max(len(turn), 1), third):
        order += [standard, *turn[start : start + third]]
    return order


def _timed(painter: Painter, attempt: Attempt) -> Stages:
    """Return the seconds of a frame that is not the first of its quality."""
    if attempt.passes == 1:
        painter.seconds(attempt.quality)
    return painter.seconds(attempt.quality)
