"""Choose limits and ticks of logarithmic axes, and write numbers shortly."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

MANTISSAS = ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7))
"""Ticks of each decade, from the sparsest choice on."""

STEPS = (1.0, 2.0, 2.5, 5.0)
"""Distances of evenly spaced ticks, times a power of ten."""

LEAST_APART = 0.135
"""Least distance of two ticks, as a share of the axis: their labels must not touch."""

LEAST_LOGARITHMIC = 3.0
"""Ratio of the ends of an axis from which multiples of powers of ten are its ticks."""

END = 0.03
"""Share of the axis at its ends where no tick is: its label would stand out."""


def number(value: float) -> str:
    """Return a number with three digits, or all before the point: ``0.0213``, ``1,234``."""
    if 999.5 <= abs(value) < 999_999.5:
        return f"{value:,.0f}"
    text = f"{value:.3g}"
    mantissa, letter, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if letter else text


def duration(seconds: float) -> str:
    """Return a time with its unit: ``12.3 ms``, ``3.04 s``."""
    if seconds < 0.9995:
        return f"{number(1000.0 * seconds)} ms"
    return f"{seconds:.3g} s" if seconds < 999.5 else f"{seconds:,.0f} s"


def log_limits(values: Sequence[float], least: float, margin: float) -> tuple[float, float]:
    """
    Return the ends of a logarithmic axis.

    Parameters
    ----------
    values : sequence of float
        What must lie on it; all above 0, at least one.
    least : float
        Least ratio of the ends, before the margin.
    margin : float
        Share of its length that is added at each end.
    """
    low, high = math.log(min(values)), math.log(max(values))
    missing = max(math.log(least) - (high - low), 0.0)
    low, high = low - 0.5 * missing, high + 0.5 * missing
    more = margin * (high - low)
    return math.exp(low - more), math.exp(high + more)


def log_ticks(low: float, high: float) -> list[float]:
    """Return one to eight round numbers within a logarithmic axis, well apart."""
    length = math.log(high / low)
    low, high = low * math.exp(END * length), high * math.exp(-END * length)
    if high / low < LEAST_LOGARITHMIC:
        return _evenly_spaced(low, high, LEAST_APART * length)
    choices = [_of_decades(low, high, mantissas) for mantissas in MANTISSAS]
    fitting = [ticks for ticks in choices if _are_apart(ticks, LEAST_APART * length)]
    if fitting:
        return fitting[-1]
    # Too many decades for a tick at each.
    return choices[0][:: math.ceil(LEAST_APART * length / math.log(10.0))]


def _of_decades(low: float, high: float, mantissas: Sequence[float]) -> list[float]:
    """Return the given multiples of powers of ten that lie within low..high."""
    decades = range(math.floor(math.log10(low)), math.floor(math.log10(high)) + 1)
    ticks = [float(f"{mantissa}e{decade}") for decade in decades for mantissa in mantissas]
    return [tick for tick in ticks if low <= tick <= high]


def _evenly_spaced(low: float, high: float, least: float) -> list[float]:
    """Return multiples of the smallest round step that are apart on a logarithmic axis."""
    decade = math.floor(math.log10(high - low)) - 1
    choices = [
        [k * size * 10.0**power for k in _multiples(low, high, size * 10.0**power)]
        for power in (decade, decade + 1)
        for size in STEPS
    ]
    fitting = [ticks for ticks in choices if _are_apart(ticks, least)]
    return [float(f"{tick:.12g}") for tick in fitting[0]]


def _multiples(low: float, high: float, step: float) -> range:
    """Return the whole numbers of steps that lie within low..high."""
    return range(math.ceil(low / step), math.floor(high / step) + 1)


def _are_apart(ticks: Sequence[float], least: float) -> bool:
    """Tell whether neighbours are in no smaller ratio than ``exp(least)``."""
    return all(math.log(b / a) >= least for a, b in itertools.pairwise(ticks))
