"""Find the ticks of colour bars: round numbers or powers of ten, and their texts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from decimal import ROUND_DOWN, Decimal
from itertools import pairwise
from typing import NamedTuple

from rasterjit.scene.scalar_field import ColorScale

TICK_STEPS = ("0.1", "0.2", "0.5", "1", "2", "5", "10", "20")
"""Distances of ticks, times a power of ten; the first with few enough ticks is taken."""

MAX_DIGITS = 6
"""Numbers with more digits before or behind the point have a power of ten or an offset."""

MIN_EXPONENT = -4
"""Power of ten of the largest tick below which ticks are written with a power of ten."""

NAMES_PER_INTERVAL = 2.4
"""How many names of categories have room in an interval between numbers: 1.25 font sizes each."""

MINOR_FACTORS = range(2, 10)
"""Minor ticks, times a power of ten."""

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
"""Digits of exponents."""


class Ticks(NamedTuple):
    """The ticks of a bar, each with its text."""

    values: list[float]
    texts: list[str]
    note: str = ""
    """The factor and the offset of the texts: see `format_ticks`."""
    minors: tuple[float, ...] = ()
    """Values of the short ticks, which have no text."""


def make_ticks(scale: ColorScale, max_intervals: int) -> Ticks:
    """
    Return the ticks of a scale: names, bounds, powers of ten or round numbers, as its norm asks.

    Parameters
    ----------
    scale : ColorScale
    max_intervals : int
        How many intervals between ticks there is room for, 1 or more.
    """
    norm, (low, high) = scale.norm, scale.norm.range
    if scale.colormap.categories:
        step = max(math.ceil((high - low) / (NAMES_PER_INTERVAL * max_intervals)), 1)
        shown_names = [*enumerate(scale.colormap.categories)][::step]
        inside = [(float(n), name) for n, name in shown_names if low <= n <= high]
        if inside:
            return Ticks([n for n, _ in inside], [name for _, name in inside])
    if norm.bounds:
        shown = [*norm.bounds][:: math.ceil((len(norm.bounds) - 1) / max_intervals)]
        return Ticks(shown, [f"{bound:.{MAX_DIGITS}g}" for bound in shown])
    powers: list[float] = []
    if norm.name == "log" and low < high:
        powers, minors = find_log_ticks(low, high, max_intervals)
    elif norm.name == "symlog" and low < high:
        powers, minors = find_symlog_ticks(low, high, norm.width, max_intervals)
    if len(powers) > 1:
        return Ticks(powers, [_format_power(power) for power in powers], "", tuple(minors))
    values = find_ticks(low, high, max_intervals)
    return Ticks(values, *format_ticks(values))


def find_log_ticks(low: float, high: float, max_ticks: int) -> tuple[list[float], list[float]]:
    """
    Return powers of ten in a range above zero, and the minor ticks between them.

    At most ``max_ticks``, every s-th power, from a multiple of s on if that can be: Matplotlib's
    ``LogLocator``. Minor ticks only where no power is left out. None where one alone would fit.
    """
    first, last = _ceil_exponent(low), exponent_of(high)
    count = last - first + 1
    stride = max(count, 0) // (max_ticks + 1) + 1
    wanted = min(-(-count // stride), max_ticks)
    if wanted < 2:
        return [], []
    stride = (count - 1) // (wanted - 1)
    if stride * wanted < count:
        stride = count // wanted
    least = max(count - stride * wanted, 0)
    offset = -first % stride
    if not least <= offset < min(count - stride * (wanted - 1), stride):
        offset = least
    minors = _find_minors(range(first - 1, last + 1), "", low, high) if stride == 1 else []
    return _powers(range(first + offset, last + 1, stride), "", low, high), minors


def find_symlog_ticks(
    low: float, high: float, width: float, max_ticks: int
) -> tuple[list[float], list[float]]:
    """
    Return zero and powers of ten of both signs from ``width`` on, and the minor ticks between.

    About ``max_ticks``, as Matplotlib's ``SymmetricalLogLocator`` spreads them. None in a range
    that is linear all over.
    """
    below = above = range(0)
    if low < -width:
        below = range(exponent_of(-min(-width, high)), _ceil_exponent(1.0 - low))
    if high > width:
        above = range(exponent_of(max(width, low)), _ceil_exponent(high + 1.0))
    has_zero = (low < -width < high) or (low < width < high)
    stride = max((len(below) + len(above) + has_zero) // max_ticks, 1)
    if not below and not above:
        return [], []
    zero = [0.0] if has_zero and low <= 0.0 <= high else []
    powers = _powers(below[::stride], "-", low, high)[::-1] + zero
    powers += _powers(above[::stride], "", low, high)
    minors = []
    if stride == 1:
        minors = _find_minors(below, "-", low, high) + _find_minors(above, "", low, high)
    return powers, minors


def _powers(exponents: Iterable[int], sign: str, low: float, high: float) -> list[float]:
    """Return the powers of ten, of one sign, that lie in a range."""
    powers = (float(f"{sign}1e{exponent}") for exponent in exponents)
    return [power for power in powers if low <= power <= high]


def _find_minors(exponents: Iterable[int], sign: str, low: float, high: float) -> list[float]:
    """Return the multiples of powers of ten, of one sign, that lie in a range."""
    values = (float(f"{sign}{factor}e{n}") for n in exponents for factor in MINOR_FACTORS)
    return [value for value in values if low <= value <= high]


def _ceil_exponent(value: float) -> int:
    """Return the least power of ten that is not below a positive number."""
    number = Decimal(repr(value))
    return number.adjusted() + (number.normalize().as_tuple().digits != (1,))


def _format_power(power: float) -> str:
    """Format zero or a power of ten: ``0``, ``-10²``."""
    if power == 0.0:
        return "0"
    exponent = str(exponent_of(power)).translate(SUPERSCRIPTS)
    return f"{'-' if power < 0.0 else ''}10{exponent}"


def find_ticks(low: float, high: float, max_intervals: int) -> list[float]:
    """
    Return the ticks of a range: round numbers, at least one, ``max_intervals + 1`` at most.

    ``low`` alone where the range has no width, or is too narrow for round numbers.
    """
    min_step = (high - low) / max_intervals
    if not min_step > 0.0:
        return [low]
    # From text, so that each is rounded once.
    steps = [float(f"{factor}e{exponent_of(min_step)}") for factor in TICK_STEPS]
    if not (steps[0] > 0.0 and math.isfinite(max(abs(low), abs(high)) / steps[0])):
        return [low]
    # Differences are off by their last bits.
    min_step = float(f"{min_step:.6g}")
    sparse = next((n for n, step in enumerate(steps) if step >= min_step), len(steps) - 1)
    step = steps[sparse]
    # A range with one round number, or none, has room for closer ones.
    for finer in steps[sparse::-1]:
        count = math.floor(high / finer) - math.ceil(low / finer) + 1
        if count > max_intervals + 1:
            break
        step = finer
        if count > 1:
            break
    ticks = [n * step for n in range(math.ceil(low / step), math.floor(high / step) + 1)]
    # So that 3 * 0.1 is 0.3.
    digits = -exponent_of(step)
    rounded = [round(tick, digits) + 0.0 for tick in ticks]
    inside = [tick for tick in rounded if low <= tick <= high]
    return list(dict.fromkeys(inside)) or [low]


def exponent_of(value: float) -> int:
    """Return the power of ten of a number's first decimal digit; 0 for 0."""
    return Decimal(repr(value)).adjusted() if value else 0


def format_ticks(ticks: Sequence[float]) -> tuple[list[str], str]:
    """
    Format ticks with as many digits as tell them apart; return a note of factor and offset.

    The note, as in Matplotlib, is the factor of the texts and then the offset: ``"1e-7"``,
    ``"+1e9"``, ``"1e-6+1"``; empty if the texts are the ticks themselves.
    """
    if len(ticks) == 1:
        return [f"{ticks[0]:.{MAX_DIGITS}g}"], ""
    # From text, so that each has the digits that it is written with.
    decimals = [Decimal(repr(tick)) for tick in ticks]
    # Off by last bits: 3e-9 - 2e-9 is below 1e-9.
    step_exponent = exponent_of(float(f"{min(b - a for a, b in pairwise(ticks)):.6g}"))
    offset = _shared_offset(decimals, step_exponent)
    shifted = [tick - offset for tick in decimals]
    largest_exponent = max(tick.adjusted() for tick in shifted if tick)
    has_factor = not MIN_EXPONENT <= largest_exponent < MAX_DIGITS or step_exponent < -MAX_DIGITS
    exponent = largest_exponent if has_factor else 0
    last_digit = Decimal(1).scaleb(min(0, step_exponent - exponent))
    texts = [f"{tick.scaleb(-exponent).quantize(last_digit):f}" for tick in shifted]
    note = f"1e{exponent}" if exponent else ""
    if offset:
        note += f"{offset.normalize():+}".replace("E+", "e").replace("E", "e")
    # Zero has no sign.
    return [text if float(text) else text.removeprefix("-") for text in texts], note


def _shared_offset(ticks: Sequence[Decimal], step_exponent: int) -> Decimal:
    """Return the offset that ticks share, if it has many more digits than their differences."""
    low, high = ticks[0], ticks[-1]
    if low * high <= 0 or max(abs(low), abs(high)).adjusted() - step_exponent < MAX_DIGITS:
        return Decimal(0)
    # Ticks less the offset have a digit more than their differences.
    exponent = (high - low).adjusted() + 1
    smallest = low if low > 0 else high
    return smallest.scaleb(-exponent).to_integral_value(ROUND_DOWN).scaleb(exponent)
