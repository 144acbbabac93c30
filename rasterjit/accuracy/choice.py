"""
Choose a quality from the trials of a study, and rate how sure the choice is.

Errors are exact, times are not: how sure it is depends on the times of the other qualities.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial
from rasterjit.accuracy.settings_to_try import COMBINED_LEVELS

MEDIAN_NOTCH = 1.57
"""Uncertainty of a median, times the root of the number of samples, in interquartile ranges."""

MIN_TIMED_ROUNDS = 3
"""Least number of rounds for an uncertainty from their times."""

ROUGH_UNCERTAINTY = 0.5
"""Relative uncertainty of a time that was measured in fewer rounds."""

MIN_QUARTILE_ROUNDS = 6
"""Least number of rounds for an uncertainty from quartiles; with fewer, the range of all samples:
that of six holds the median in 97 of 100 cases, that of three in 75."""

MIN_NOISE = 0.01
"""Least uncertainty of a time, relative to the standard's, even of equal samples."""

MAX_UNCERTAINTY = 0.25
"""Largest relative uncertainty of a time that is reported as a factor."""

SAME_ERROR = 1.005
"""Largest ratio of two errors that count as equal: they are printed alike."""

INVISIBLE_ERROR = 1e-3
"""Largest invisible error, root mean square of linear light: below half an 8-bit step."""

MAX_FRONT_POINTS = 7
"""Most points of the Pareto front."""


def find_uncertainty(trial: Trial) -> float:
    """
    Return the uncertainty of a trial's ratio, plus or minus.

    References
    ----------
    .. [1] R. McGill, J. W. Tukey, W. A. Larsen, "Variations of Box Plots", The American
       Statistician 32 (1), 1978: the notch.
    """
    if not is_timed(trial):
        return ROUGH_UNCERTAINTY * trial.ratio
    if len(trial.ratios) < MIN_QUARTILE_ROUNDS:
        return max(max(trial.ratios) - min(trial.ratios), MIN_NOISE)
    low, high = trial.spread
    return max(MEDIAN_NOTCH * (high - low) / math.sqrt(len(trial.ratios)), MIN_NOISE)


def is_timed(trial: Trial) -> bool:
    """Tell whether a trial was drawn often enough to measure how its time varies."""
    return len(trial.ratios) >= MIN_TIMED_ROUNDS


def is_measured(trial: Trial) -> bool:
    """Tell whether a time is precise enough to be reported as a factor."""
    return is_timed(trial) and find_uncertainty(trial) <= MAX_UNCERTAINTY * trial.ratio


def is_slower(trial: Trial, other: Trial) -> bool:
    """Tell whether a trial took longer than another by more than the noise of both."""
    a, b = find_uncertainty(trial), find_uncertainty(other)
    return trial.ratio - other.ratio > math.sqrt(a * a + b * b)


def list_compared_errors(trial: Trial) -> tuple[float, ...]:
    """Return the errors by which trials are compared: of light, faces, depth, texture."""
    errors = trial.errors
    return (
        errors.rmse, float(errors.wrong_faces), errors.depth_units or 0.0, errors.uv_texels or 0.0,
    )  # fmt: skip


def dominates(trial: Trial, other: Trial) -> bool:
    """Tell whether a trial is neither slower nor less accurate than another, and better in one."""
    pairs = list(zip(list_compared_errors(trial), list_compared_errors(other), strict=True))
    if is_slower(trial, other) or any(a > b for a, b in pairs):
        return False
    are_known = is_measured(trial) and is_measured(other)
    return is_slower(other, trial) or (are_known and any(a < b for a, b in pairs))


def mark_dominated(trials: Iterable[Trial], standard: Trial) -> tuple[Trial, ...]:
    """Return the trials, each with the fastest level of its setting that dominates it."""
    trials = list(trials)
    marked = []
    for trial in trials:
        rivals: list[Trial] = []
        if trial.setting != COMBINATIONS:
            rivals = [standard, *(other for other in trials if other.setting == trial.setting)]
        better = [rival for rival in rivals if dominates(rival, trial)]
        name = min(better, key=lambda rival: rival.ratio).label if better else None
        marked.append(replace(trial, dominated_by=name))
    return tuple(marked)


def pareto_front(trials: Sequence[Trial]) -> tuple[str, ...]:
    """
    Return the labels of the trials on the Pareto front, fastest first: at most seven.

    Each is more accurate than all faster ones, and any two of their times differ measurably. Of
    trials with the same time the most accurate is taken; if they are as accurate as well, the
    standard, else the one that changes least. Besides the standard, only measured trials count.
    """
    remaining = [trial for trial in trials if is_measured(trial) or trial.setting == STANDARD]
    front: list[Trial] = []
    while remaining:
        max_error = SAME_ERROR * min(trial.errors.rmse for trial in remaining)
        peers = [
            trial
            for trial in remaining
            if trial.errors.rmse <= max_error and all(is_slower(other, trial) for other in front)
        ]
        fastest = [trial for trial in peers if not any(is_slower(trial, other) for other in peers)]
        if fastest:
            front.append(min(fastest, key=_complexity))
        remaining = [trial for trial in remaining if trial.errors.rmse > max_error]
    return tuple(trial.label for trial in thin_front(front[::-1]))


def _complexity(trial: Trial) -> tuple[bool, int, float]:
    """Return a sort key that puts the simplest quality first."""
    return trial.setting != STANDARD, len(trial.level.split()), trial.ratio


def thin_front(front: Sequence[Trial], max_points: int = MAX_FRONT_POINTS) -> list[Trial]:
    """Thin a front to ``max_points``, removing those nearest to their neighbours' line."""
    points = list(front)
    while len(points) > max_points:
        inner = [n for n in range(1, len(points) - 1) if points[n].setting != STANDARD]
        del points[min(inner, key=lambda n: _corner_area(*points[n - 1 : n + 2]))]
    return points


def _corner_area(before: Trial, middle: Trial, after: Trial) -> float:
    """Return twice the area of a triangle of neighbours on logarithmic axes."""
    (x0, y0), (x1, y1), (x2, y2) = (
        (math.log(trial.ratio), math.log(max(trial.errors.rmse, 1e-9)))
        for trial in (before, middle, after)
    )
    return abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))


SAME_PRICE = 1.05
"""Largest ratio of two prices that count as equal: the simplest quality is taken."""

MAX_SURE_GAIN, MAX_FAIR_GAIN = 0.05, 0.25
"""Largest possible gain of another quality, a share, for a sure and a fairly sure choice."""

MAX_UNTRIED_SHARE = 0.2
"""Largest untried share of promising qualities for a sure choice; half for a fairly sure one."""


class Choice(NamedTuple):
    """The chosen quality, and how sure the choice is."""

    trial: Trial
    holds: bool
    """Whether its error is at most the requested one, if there is one."""
    at_most: float
    """Largest possible gain of another quality that was tried, a share: of time times error, or of
    time if an error was requested."""
    untried: float = 0.0
    """Share of the promising qualities that there was no time for: of presets, and of levels that
    are combined, alone and together."""

    @property
    def sureness(self) -> str:
        """Certainty of the choice, in words."""
        if self.at_most <= MAX_SURE_GAIN and self.untried <= MAX_UNTRIED_SHARE:
            return "sure"
        return (
            "fairly sure" if max(self.at_most, 0.5 * self.untried) <= MAX_FAIR_GAIN else "a guess"
        )


def choose(study: Study) -> Choice:
    """
    Return the quality to take.

    Only qualities no worse than the standard in faces, depth and texture coordinates count. With
    ``max_error``, the fastest that holds it, or the most accurate if none does. Without, the one
    with the least product of time and error among those no less accurate than the standard.
    Invisible errors, and those below the reference's own error, count as equal.
    """
    error_floor = max(INVISIBLE_ERROR, study.reference_error)
    choice = choose_among(study.standard, study.trials, study.max_error, error_floor)
    untried = sum(map(_is_promising, study.left_out))
    tried = sum(_is_promising(trial.label) for trial in study.trials)
    return choice._replace(untried=untried / max(untried + tried, 1) if study.trials else 1.0)


def choose_among(
    standard: Trial,
    trials: Sequence[Trial],
    max_error: float | None = None,
    error_floor: float = INVISIBLE_ERROR,
) -> Choice:
    """Return the quality to take among some trials; see `choose`."""

    def price(trial: Trial) -> float:
        """Return time times error, or the time alone if an error was requested."""
        return trial.ratio * (max(trial.errors.rmse, error_floor) if max_error is None else 1.0)

    # The error of light, the first, is compared with the requested one.
    max_rmse, *max_errors = list_compared_errors(standard)
    max_rmse = max_rmse * SAME_ERROR if max_error is None else max_error
    usable = [
        trial
        for trial in (standard, *trials)
        if all(a <= b for a, b in zip(list_compared_errors(trial)[1:], max_errors, strict=True))
    ]
    accurate = [t for t in usable if t.errors.rmse <= max_rmse and _is_worthwhile(t, standard)]
    if not accurate:
        best = min(usable, key=lambda trial: (trial.errors.rmse, trial.ratio))
        return Choice(best, False, 0.0)
    max_price = SAME_PRICE * min(map(price, accurate))
    near_best = [trial for trial in accurate if price(trial) <= max_price]
    simplest = min(near_best, key=lambda trial: (_count_changes(trial), price(trial)))
    # How much better may each of the others be, given the uncertainty of times?
    gains = [
        1.0 - price(trial) / price(simplest) * math.exp(-_pair_uncertainty(simplest, trial))
        for trial in accurate
        if trial is not simplest
    ]
    return Choice(simplest, True, max([0.0, *gains]))


def _is_promising(label: str) -> bool:
    """Tell whether a quality is a preset or a combination, or of a level that is combined."""
    setting, _, level = label.partition("=")
    return not level or " " in label or level in map(str, COMBINED_LEVELS.get(setting, ()))


def _is_worthwhile(trial: Trial, standard: Trial) -> bool:
    """Tell whether a quality has less error than the standard, or is known to be faster."""
    if trial is standard or trial.errors.rmse * SAME_ERROR < standard.errors.rmse:
        return True
    return is_slower(standard, trial)


def _count_changes(trial: Trial) -> int:
    """Return how many settings a quality changes; 1 for a preset."""
    return 0 if trial.setting == STANDARD else len(trial.level.split())


def _pair_uncertainty(trial: Trial, other: Trial) -> float:
    """Return the relative uncertainty of the ratio of two times; the standard's is exact."""
    return math.hypot(
        *(find_uncertainty(t) / t.ratio for t in (trial, other) if t.setting != STANDARD)
    )
