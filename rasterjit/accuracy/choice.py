"""
Choose a quality from the trials of a study, and rate how sure the choice is.

Errors are exact, times are not: the choice is as sure as the times of those that were not chosen
are known.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial
from rasterjit.accuracy.settings_to_try import COMBINED_LEVELS

MEDIAN_NOTCH = 1.57
"""Uncertainty of a median, in interquartile ranges over the root of the number of samples."""

MIN_ROUNDS_APART = 3
"""Rounds from which on a time is told to be another one, unless it is so by far."""

ROUGH_UNCERTAINTY = 0.5
"""Relative uncertainty of a time that was measured in fewer rounds."""

QUARTILE_ROUNDS = 6
"""Rounds from which on quartiles say how far a median is known; of fewer, all samples do: both ends
of six samples hold the median in 97 of 100 cases, those of three in 75."""

MIN_NOISE = 0.01
"""Least uncertainty of a time, relative to the standard's, however alike the samples are."""

MAX_UNCERTAINTY = 0.25
"""Largest relative uncertainty of a time that is reported as a factor."""

SAME_ERROR = 1.005
"""Errors in a smaller ratio are not told apart: they print alike."""

INVISIBLE = 1e-3
"""Error, root mean square of linear light, below which none is seen: half an 8-bit step is more."""

MAX_ON_FRONT = 7
"""Most points of the Pareto front."""


def noise(trial: Trial) -> float:
    """
    Return the uncertainty of a trial's ratio, plus or minus.

    References
    ----------
    .. [1] R. McGill, J. W. Tukey, W. A. Larsen, "Variations of Box Plots", The American
       Statistician 32 (1), 1978: the notch.
    """
    if not is_timed(trial):
        return ROUGH_UNCERTAINTY * trial.ratio
    if len(trial.ratios) < QUARTILE_ROUNDS:
        return max(max(trial.ratios) - min(trial.ratios), MIN_NOISE)
    low, high = trial.spread
    return max(MEDIAN_NOTCH * (high - low) / math.sqrt(len(trial.ratios)), MIN_NOISE)


def is_timed(trial: Trial) -> bool:
    """Tell whether a trial was drawn often enough to say how much its time varies."""
    return len(trial.ratios) >= MIN_ROUNDS_APART


def is_measured(trial: Trial) -> bool:
    """Tell whether a time is known well enough to be called a factor."""
    return is_timed(trial) and noise(trial) <= MAX_UNCERTAINTY * trial.ratio


def is_slower(trial: Trial, other: Trial) -> bool:
    """Tell whether a trial took longer than another by more than the noise of both."""
    a, b = noise(trial), noise(other)
    return trial.ratio - other.ratio > math.sqrt(a * a + b * b)


def compared_errors(trial: Trial) -> tuple[float, ...]:
    """Return the errors by which trials are compared: of light, faces, depth, texture."""
    errors = trial.errors
    return (
        errors.rmse, float(errors.wrong_faces), errors.depth_units or 0.0, errors.uv_texels or 0.0,
    )  # fmt: skip


def dominates(trial: Trial, other: Trial) -> bool:
    """Tell whether a trial is neither slower nor less accurate than another, and not its equal."""
    pairs = list(zip(compared_errors(trial), compared_errors(other), strict=True))
    if is_slower(trial, other) or any(a > b for a, b in pairs):
        return False
    are_known = is_measured(trial) and is_measured(other)
    return is_slower(other, trial) or (are_known and any(a < b for a, b in pairs))


def mark_dominated(trials: Iterable[Trial], standard: Trial) -> tuple[Trial, ...]:
    """Return the trials, each with the fastest level of its setting that dominates it."""
    trials = list(trials)
    result = []
    for trial in trials:
        rivals: list[Trial] = []
        if trial.setting != COMBINATIONS:
            rivals = [standard, *(other for other in trials if other.setting == trial.setting)]
        better = [rival for rival in rivals if dominates(rival, trial)]
        name = min(better, key=lambda rival: rival.ratio).label if better else None
        result.append(replace(trial, dominated_by=name))
    return tuple(result)


def pareto_front(trials: Sequence[Trial]) -> tuple[str, ...]:
    """
    Return the labels of those worth choosing among, fastest first: at most seven.

    Each is more accurate than all faster ones, and the times of any two of them can be told apart.
    Of levels whose times cannot be told apart the most accurate stands for all; of those that are
    as accurate as well, the standard, else the one that changes least. What is not measured well
    enough is not among them, apart from the standard.
    """
    remaining = [trial for trial in trials if is_measured(trial) or trial.setting == STANDARD]
    front: list[Trial] = []
    while remaining:
        limit = SAME_ERROR * min(trial.errors.rmse for trial in remaining)
        peers = [
            trial
            for trial in remaining
            if trial.errors.rmse <= limit and all(is_slower(other, trial) for other in front)
        ]
        fastest = [trial for trial in peers if not any(is_slower(trial, other) for other in peers)]
        if fastest:
            front.append(min(fastest, key=_complexity))
        remaining = [trial for trial in remaining if trial.errors.rmse > limit]
    return tuple(trial.label for trial in thin_front(front[::-1]))


def _complexity(trial: Trial) -> tuple[bool, int, float]:
    """Return a sort key: the least belongs to the simplest quality."""
    return trial.setting != STANDARD, len(trial.level.split()), trial.ratio


def thin_front(front: Sequence[Trial], most: int = MAX_ON_FRONT) -> list[Trial]:
    """Thin a front to a number of points, removing those nearest to their neighbours' line."""
    points = list(front)
    while len(points) > most:
        inner = [n for n in range(1, len(points) - 1) if points[n].setting != STANDARD]
        del points[min(inner, key=lambda n: _corner_area(*points[n - 1 : n + 2]))]
    return points


def _corner_area(before: Trial, one: Trial, after: Trial) -> float:
    """Return twice the area of a triangle of neighbours on logarithmic axes."""
    (x0, y0), (x1, y1), (x2, y2) = (
        (math.log(trial.ratio), math.log(max(trial.errors.rmse, 1e-9)))
        for trial in (before, one, after)
    )
    return abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))


SAME_PRICE = 1.05
"""Prices in a smaller ratio are as good: of those the simplest quality is taken."""

SURE_GAIN, FAIR_GAIN = 0.05, 0.25
"""Most that another quality may be better by, as a share, for the choice to be called so."""

MAX_UNTRIED = 0.2
"""Share of the promising qualities that may be untried for a choice to be called sure; up to half
of them, it is fairly sure."""


class Choice(NamedTuple):
    """The chosen quality, and how sure the choice is."""

    trial: Trial
    holds: bool
    """Whether its error is at most the one that was asked for, if one was."""
    at_most: float
    """Most that anything else that was tried can be better by, a share: of time times error, or of
    time where an error was asked for."""
    untried: float = 0.0
    """Share of the most promising qualities that there was no time for: of presets, and of levels
    that are combined, alone and together."""

    @property
    def sureness(self) -> str:
        """Certainty of the choice, in words."""
        if self.at_most <= SURE_GAIN and self.untried <= MAX_UNTRIED:
            return "sure"
        return "fairly sure" if max(self.at_most, 0.5 * self.untried) <= FAIR_GAIN else "a guess"


def choose(study: Study) -> Choice:
    """
    Return the quality to take.

    Of those that are no worse than the standard in faces, depth and texture coordinates it is the
    fastest whose error is at most ``max_error``, or the most accurate if none holds it. Where no
    error was asked for, it is the one with the least product of time and error among those no less
    accurate than the standard: it buys most error for its time. Errors that are not seen, or
    smaller than the reference's own, are not told apart.
    """
    floor = max(INVISIBLE, study.reference_error)
    choice = choose_among(study.standard, study.trials, study.max_error, floor)
    untried = sum(map(_is_promising, study.left_out))
    tried = sum(_is_promising(trial.label) for trial in study.trials)
    return choice._replace(untried=untried / max(untried + tried, 1) if study.trials else 1.0)


def choose_among(
    standard: Trial,
    trials: Sequence[Trial],
    max_error: float | None = None,
    floor: float = INVISIBLE,
) -> Choice:
    """Return the quality to take of some; see `choose`."""
    limits = compared_errors(standard)
    max_rmse = limits[0] * SAME_ERROR if max_error is None else max_error
    # The first is the error of light, which is asked for by itself.
    usable = [
        one
        for one in (standard, *trials)
        if all(a <= b for a, b in zip(compared_errors(one)[1:], limits[1:], strict=True))
    ]
    within = [
        one for one in usable if one.errors.rmse <= max_rmse and _is_worthwhile(one, standard)
    ]
    if not within:
        best = min(usable, key=lambda one: (one.errors.rmse, one.ratio))
        return Choice(best, False, 0.0)
    price = _price if max_error is None else _time
    lowest = min(price(one, floor) for one in within)
    near_best = [one for one in within if price(one, floor) <= SAME_PRICE * lowest]
    simplest = min(near_best, key=lambda one: (_change_count(one), price(one, floor)))
    gains = [_gain(simplest, one, price, floor) for one in within if one is not simplest]
    return Choice(simplest, True, max(gains, default=0.0))


def _is_promising(label: str) -> bool:
    """Tell whether a quality is a preset or a combination, or of a level that is combined."""
    setting, _, level = label.partition("=")
    return not level or " " in label or level in map(str, COMBINED_LEVELS.get(setting, ()))


def _is_worthwhile(trial: Trial, standard: Trial) -> bool:
    """Tell whether a quality has less error than the standard, or is known to be faster."""
    if trial is standard or trial.errors.rmse * SAME_ERROR < standard.errors.rmse:
        return True
    return is_slower(standard, trial)


def _price(trial: Trial, floor: float) -> float:
    return trial.ratio * max(trial.errors.rmse, floor)


def _time(trial: Trial, floor: float) -> float:
    return trial.ratio


def _change_count(trial: Trial) -> int:
    """Return how many settings a quality changes; a preset is one."""
    return 0 if trial.setting == STANDARD else len(trial.level.split())


def _gain(chosen: Trial, other: Trial, price, floor: float) -> float:
    """Return the share by which another quality may be better, given the uncertainty of times."""
    uncertainty = math.hypot(*(_uncertainty(trial) for trial in (chosen, other)))
    return max(0.0, 1.0 - price(other, floor) / price(chosen, floor) * math.exp(-uncertainty))


def _uncertainty(trial: Trial) -> float:
    """Return the relative uncertainty of a time; 0 for the standard."""
    return 0.0 if trial.setting == STANDARD else noise(trial) / trial.ratio
