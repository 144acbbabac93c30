"""
Choose one quality, always, and say how sure the choice is.

Errors are exact, times are not: the choice is as sure as the times of those that were not chosen
are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rasterjit.accuracy.knobs import AXES
from rasterjit.accuracy.ranking import ALIKE, INVISIBLE, inaccuracies, is_slower, noise
from rasterjit.accuracy.results import STANDARD, Study, Trial

AS_GOOD = 1.05
"""Prices in a smaller ratio are as good: of those the simplest quality is taken."""

SURE, FAIRLY_SURE = 0.05, 0.25
"""Most that another quality may be better by, as a share, for the choice to be called so."""

FEW = 0.2
"""Share of the promising qualities that may be untried for a choice to be called sure; up to half
of them, it is fairly sure."""


class Choice(NamedTuple):
    """The quality to take."""

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
        """How sure the choice is, in words."""
        if self.at_most <= SURE and self.untried <= FEW:
            return "sure"
        return "fairly sure" if max(self.at_most, 0.5 * self.untried) <= FAIRLY_SURE else "a guess"


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
    found = choose_among(study.standard, study.trials, study.max_error, floor)
    left = sum(map(_is_promising, study.left_out))
    tried = sum(_is_promising(one.label) for one in study.trials)
    return found._replace(untried=left / max(left + tried, 1) if study.trials else 1.0)


def choose_among(
    standard: Trial,
    trials: Sequence[Trial],
    max_error: float | None = None,
    floor: float = INVISIBLE,
) -> Choice:
    """Return the quality to take of some; see `choose`."""
    usual = inaccuracies(standard)
    limit = usual[0] * ALIKE if max_error is None else max_error
    # The first is the error of light, which is asked for by itself.
    fit = [
        one
        for one in (standard, *trials)
        if all(a <= b for a, b in zip(inaccuracies(one)[1:], usual[1:], strict=True))
    ]
    holding = [one for one in fit if one.errors.rmse <= limit and _is_worthwhile(one, standard)]
    if not holding:
        best = min(fit, key=lambda one: (one.errors.rmse, one.ratio))
        return Choice(best, False, 0.0)
    price = _price if max_error is None else _time
    least = min(price(one, floor) for one in holding)
    good = [one for one in holding if price(one, floor) <= AS_GOOD * least]
    chosen = min(good, key=lambda one: (_changes(one), price(one, floor)))
    rivals = [_gain(chosen, one, price, floor) for one in holding if one is not chosen]
    return Choice(chosen, True, max(rivals, default=0.0))


def _is_promising(label: str) -> bool:
    """Tell whether a quality is a preset or a combination, or of a level that is combined."""
    setting, _, level = label.partition("=")
    return not level or " " in label or level in map(str, AXES.get(setting, ()))


def _is_worthwhile(trial: Trial, standard: Trial) -> bool:
    """Tell whether a quality has less error than the standard, or is known to be faster."""
    if trial is standard or trial.errors.rmse * ALIKE < standard.errors.rmse:
        return True
    return is_slower(standard, trial)


def _price(trial: Trial, floor: float) -> float:
    return trial.ratio * max(trial.errors.rmse, floor)


def _time(trial: Trial, floor: float) -> float:
    return trial.ratio


def _changes(trial: Trial) -> int:
    """Return how many settings a quality changes; a preset is one."""
    return 0 if trial.setting == STANDARD else len(trial.level.split())


def _gain(chosen: Trial, other: Trial, price, floor: float) -> float:
    """Return by which share another quality may be better, as far as times are known."""
    unknown = math.hypot(*(_unknown(one) for one in (chosen, other)))
    return max(0.0, 1.0 - price(other, floor) / price(chosen, floor) * math.exp(-unknown))


def _unknown(trial: Trial) -> float:
    """Return the share of a time that is not known; the standard is what times are over."""
    return 0.0 if trial.setting == STANDARD else noise(trial) / trial.ratio
