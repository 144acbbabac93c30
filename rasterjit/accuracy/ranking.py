"""Which levels are worth their time: what is dominated within a setting, and the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from rasterjit.accuracy.results import COMBINATIONS, Trial
from rasterjit.rendering.budget import front_of

NOTCH = 1.57
"""Interquartile ranges, over the root of their number, that a median of samples is known to."""

TOLD_APART = 3
"""Rounds from which on a time is told to be another one, unless it is so by far."""

ROUGH = 0.5
"""Share of a time that it is known to where it was taken in fewer rounds."""

LEAST_NOISE = 0.01
"""Share of the standard's time that is never told apart, however alike the samples are."""


def noise(trial: Trial) -> float:
    """
    Return what the ratio of a trial is known to, plus or minus.

    References
    ----------
    .. [1] R. McGill, J. W. Tukey, W. A. Larsen, "Variations of Box Plots", The American
       Statistician 32 (1), 1978: the notch.
    """
    if not is_timed(trial):
        return ROUGH * trial.ratio
    low, high = trial.spread
    return max(NOTCH * (high - low) / math.sqrt(len(trial.ratios)), LEAST_NOISE)


def is_timed(trial: Trial) -> bool:
    """Tell whether a trial was drawn often enough to say how much its time varies."""
    return len(trial.ratios) >= TOLD_APART


def is_slower(trial: Trial, other: Trial) -> bool:
    """Tell whether a trial took longer than another by more than the noise of both."""
    a, b = noise(trial), noise(other)
    return trial.ratio - other.ratio > math.sqrt(a * a + b * b)


def inaccuracies(trial: Trial) -> tuple[float, ...]:
    """Return the errors that a level must be no worse in: of light, faces, depth, texture."""
    errors = trial.errors
    return (
        errors.rmse, float(errors.wrong_faces), errors.depth_units or 0.0, errors.uv_texels or 0.0,
    )  # fmt: skip


def dominates(trial: Trial, other: Trial) -> bool:
    """Tell whether a trial is neither slower nor less accurate than another, and not its equal."""
    pairs = list(zip(inaccuracies(trial), inaccuracies(other), strict=True))
    if is_slower(trial, other) or any(a > b for a, b in pairs):
        return False
    are_timed = is_timed(trial) and is_timed(other)
    return is_slower(other, trial) or (are_timed and any(a < b for a, b in pairs))


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
    """Return the labels of those that no other is faster and more accurate than, fastest first."""
    front = front_of(trials, lambda trial: (trial.ratio, trial.errors.rmse))
    return tuple(trial.label for trial in front)
