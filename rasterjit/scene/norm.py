"""Norms: how the values of a range are spread over the entries of a colour map."""

from __future__ import annotations

import copy
from bisect import bisect_right
from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Float64, HoldsArrays, Int64

NormName: TypeAlias = Literal["linear", "log", "symlog"]
NORMS: tuple[NormName, ...] = get_args(NormName)
"""Names of norms."""

NormLike: TypeAlias = NormName | tuple[str, float] | Callable[..., Any]
"""A name, ``("symlog", width)``, or one of Matplotlib's norms."""

RangeLike: TypeAlias = tuple[float, float] | str
"""Low and high, or the share of the values at each end that is left out: ``"2%"``."""

LINEAR_WIDTH = 2.0
"""Where ``"symlog"`` turns from linear to logarithmic, as in Matplotlib."""

LINEAR_SHARE = Decimal(10) / Decimal(9)
"""Length of the linear part of ``"symlog"`` from 0 on, in decades: Matplotlib's, of base 10."""

DIGITS = 40
"""Digits of logarithms and powers, so that thresholds are rounded once."""

MAX_VALUE = float(np.finfo(np.float32).max)
"""Greatest size of scalars."""

MONOTONY_SAMPLES = 1024
"""Number of values at which a norm must not fall."""

MAX_RANGE = 1e200
"""Largest width of a range: products with it are finite."""

_SIZE_BITS = np.int64(0x7FFFFFFFFFFFFFFF)


class Norm(HoldsArrays):
    """
    Spread the values of a range evenly over 0 to 1.

    Parameters
    ----------
    range : (float, float)
        The values of 0 and of 1.
    """

    name = "linear"
    """Kind, which says what ticks are at: ``NORMS`` or ``"other"``."""
    width = LINEAR_WIDTH
    """Where logarithms of both signs begin."""
    bounds: Sequence[float] = ()
    """Where entries change, if there are such bounds: bars space them evenly."""

    def __init__(self, range: tuple[float, float]) -> None:
        self.range = range

    def __repr__(self) -> str:
        return f"{self.name}, {self.range[0]:g} to {self.range[1]:g}"

    def fraction(self, value: float) -> float:
        """Return where a value of the range lies, 0 to 1; 0.5 in a range without a width."""
        low, high = self.range
        return (value - low) / (high - low) if high > low else 0.5

    def value(self, fraction: float) -> float:
        """Return the value at a fraction, 0 to 1, of the range."""
        low, high = self.range
        return low + (high - low) * fraction

    def ranks(self, values: Float64, count: int) -> Float64:
        """Return the entry of each value among ``count``: below 0 and from it on, outside."""
        low, high = self.range
        width = high - low if high > low else np.inf
        with np.errstate(over="ignore", invalid="ignore"):
            ranks = (values - low) / width * count
        return _close_end(ranks, count)

    def thresholds(self, count: int) -> Float64:
        """
        Return where each entry of a map begins, the range's outside included.

        Parameters
        ----------
        count : int
            N, the number of entries.

        Returns
        -------
        (N+2,) float64
            Ascending: the least value that has a colour at all, the first of entry 0, of entry 1
            ... and the first above the range. Infinite where there is none.
        """
        return np.append(-np.inf, _find_thresholds(lambda some: self.ranks(some, count), count))


class LogNorm(Norm):
    """Spread the logarithms of a range, which is above zero."""

    name = "log"

    def fraction(self, value: float) -> float:
        """Return where a value of the range lies, 0 to 1; 0.5 in a range without a width."""
        with localcontext(prec=DIGITS):
            low, high, place = (self._spread(Decimal(one)) for one in (*self.range, value))
            return float((place - low) / (high - low)) if high > low else 0.5

    def value(self, fraction: float) -> float:
        """Return the value at a fraction, 0 to 1, of the range."""
        return self._values([Decimal(fraction)])[0]

    def thresholds(self, count: int) -> Float64:
        """Return where each entry begins: see `Norm.thresholds`."""
        low, high = self.range
        if low == high:
            starts = [self._least(), *[np.inf] * count]
        else:
            inner = [Decimal(n) / count for n in range(1, count)]
            starts = [low, *self._values(inner), float(np.nextafter(high, np.inf))]
        return np.array([self._least(), *starts])

    def _values(self, fractions: list[Decimal]) -> list[float]:
        """Return the values at fractions, each rounded once."""
        with localcontext(prec=DIGITS):
            low, high = (self._spread(Decimal(end)) for end in self.range)
            return [float(self._unspread(low + share * (high - low))) for share in fractions]

    def _least(self) -> float:
        """Return the least value that has a colour."""
        return 5e-324

    def _spread(self, value: Decimal) -> Decimal:
        """Return the logarithm."""
        return value.log10()

    def _unspread(self, place: Decimal) -> Decimal:
        """Return the value of a logarithm."""
        return Decimal(10) ** place


class SymLogNorm(LogNorm):
    """Spread the logarithms of sizes, linear from zero up to ``width``."""

    name = "symlog"

    def __init__(self, range: tuple[float, float], width: float) -> None:
        super().__init__(range)
        self.width = width

    def _least(self) -> float:
        return -np.inf

    def _spread(self, value: Decimal) -> Decimal:
        share = value / Decimal(self.width)
        if abs(share) <= 1:
            return share * LINEAR_SHARE
        return (LINEAR_SHARE + abs(share).log10()).copy_sign(share)

    def _unspread(self, place: Decimal) -> Decimal:
        width, size = Decimal(self.width), abs(place)
        if size <= LINEAR_SHARE:
            return place / LINEAR_SHARE * width
        return width * (Decimal(10) ** (size - LINEAR_SHARE)).copy_sign(place)


OWN_NORMS = {"Normalize": Norm, "LogNorm": LogNorm}
"""Norms of Matplotlib that are norms of RasterJIT's."""


class ForeignNorm(Norm):
    """
    Spread values as one of Matplotlib's norms does, or whatever is called as those are.

    Parameters
    ----------
    norm : callable
        A copy of one's own, with its limits set.
    """

    def __init__(self, norm: Any) -> None:
        super().__init__((float(norm.vmin), float(norm.vmax)))
        self.original = norm
        self.name = _kind_of(norm)
        self.width = float(getattr(norm, "linthresh", LINEAR_WIDTH))
        self.bounds = [float(one) for one in getattr(norm, "boundaries", ())]

    def fraction(self, value: float) -> float:
        """Return where a value lies, 0 to 1; boundaries are evenly spaced, as on bars."""
        if self.bounds:
            return interpolate(value, self.bounds, self._bound_places())
        if self.range[0] == self.range[1]:
            return 0.5
        return float(self._call(np.array([value]))[0])

    def value(self, fraction: float) -> float:
        """Return the value at a fraction, 0 to 1, of the range."""
        if self.bounds:
            return interpolate(fraction, self._bound_places(), self.bounds)
        (value,) = _bisect(self._call, np.array([fraction]), *self.range)
        return float(value)

    def ranks(self, values: Float64, count: int) -> Float64:
        """Return the entry of each value as Matplotlib's colour maps find it: see `Norm.ranks`."""
        placed = self._call(values)
        return placed if self.bounds else _close_end(placed * count, count)

    def thresholds(self, count: int) -> Float64:
        """Return where each entry begins: see `Norm.thresholds`."""
        everywhere = np.linspace(*self.range, MONOTONY_SAMPLES)
        if (np.diff(self.ranks(everywhere, count)) < 0.0).any():
            raise ValueError(f"norm must not fall from low to high values, got {self.original!r}")
        starts = _find_thresholds(lambda some: self.ranks(some, count), count)
        (least,) = _bisect(self._call, np.array([-np.inf]), -MAX_VALUE, MAX_VALUE)
        return np.append(-np.inf if least == -MAX_VALUE else least, starts)

    def _bound_places(self) -> list[float]:
        """Return the places of bounds on bars: evenly spaced from 0 to 1."""
        return [n / (len(self.bounds) - 1) for n in range(len(self.bounds))]

    def _call(self, values: Float64) -> Float64:
        """Return what the norm says of values; NaN where they have no colour."""
        with np.errstate(all="ignore"):
            placed = self.original(values)
        numbers = np.asarray(np.ma.getdata(placed), np.float64)
        if np.shape(numbers) != values.shape:
            raise ValueError(f"norm must give one number per value, got {check.brief(placed)}")
        return np.where(np.ma.getmaskarray(placed), np.nan, numbers)


def make_norm(norm: NormLike | None, range: Any, values: Float64) -> Norm:
    """
    Return the norm that an argument names, its range fitted to values where none is given.

    Parameters
    ----------
    norm : str, (str, float) or callable, optional
    range : (float, float), str or None
        The range; or ``"2%"``: that much of the values lies below it, and above.
    values : (N,) float64
        Those that are finite are read.

    Raises
    ------
    ValueError
        Naming ``norm`` or ``range`` if it is none, or does not fit the other.
    """
    finite = values[np.isfinite(values)]
    if callable(norm) and hasattr(norm, "vmin"):
        return _copy_foreign(norm, range, finite)
    name, width = norm if isinstance(norm, tuple) and len(norm) == 2 else (norm, LINEAR_WIDTH)
    if norm is None:
        name = "linear"
    elif not isinstance(name, str) or (name != "symlog" and norm is not name):
        raise ValueError(
            f"norm must be one of {', '.join(map(repr, NORMS))}, ('symlog', width) or a norm of "
            f"Matplotlib, got {check.short_repr(norm)}"
        )
    check.one_of("norm", name, NORMS)
    if name == "symlog":
        return SymLogNorm(find_range(range, finite), check.positive_number("norm[1]", width))
    if name == "linear":
        return Norm(find_range(range, finite))
    low, high = find_range(range, finite[finite > 0.0], (1.0, 1.0))
    if low <= 0.0:
        raise ValueError(f"range must be above 0 where norm is 'log', got {(low, high)!r}")
    return LogNorm((low, high))


def find_range(
    range: Any, values: Float64, empty: tuple[float, float] = (0.0, 1.0)
) -> tuple[float, float]:
    """Return the range that an argument of a mesh means; ``empty`` for that of no values."""
    if isinstance(range, str):
        share = parse_percent(range)
        low, high = np.percentile(values, [share, 100.0 - share]) if values.size else empty
        return float(low), float(high)
    if range is not None:
        return check_range(range)
    return (float(values.min()), float(values.max())) if values.size else empty


def check_range(value: Any) -> tuple[float, float]:
    """Check a range and return it, or raise ``ValueError``."""
    try:
        limits = check.number_array("range", value)
    except ValueError:
        limits = np.empty(0)
    if limits.shape != (2,) or not np.isfinite(limits).all():
        raise ValueError(
            "range must be two finite numbers, low and high, or a share of the values at each "
            f"end, such as '2%'; got {check.short_repr(value)}"
        )
    low, high = limits.tolist()
    if low > high:
        raise ValueError(
            f"range must go from low to high, got {(low, high)!r}; a colormap with '_r' at the end "
            "of its name shows low values as others show high ones"
        )
    if high - low > MAX_RANGE:
        raise ValueError(f"range must be at most {MAX_RANGE:g} wide, got {(low, high)!r}")
    return low, high


def parse_percent(text: str) -> float:
    """Return the share of values to leave out at each end, percent, or raise ``ValueError``."""
    try:
        share = float(text.strip().removesuffix("%"))
    except ValueError:
        share = -1.0
    if not (text.strip().endswith("%") and 0.0 <= share < 50.0):
        raise ValueError(
            "range must be two numbers, or a share of the values at each end, 0% to below 50%, "
            f"such as '2%'; got {text!r}"
        )
    return share


def _copy_foreign(norm: Any, range: Any, values: Float64) -> Norm:
    """Return a norm of Matplotlib's with limits of its own; the one given stays as it is."""
    limits = norm.vmin, getattr(norm, "vmax", None)
    if range is not None and any(limit is not None for limit in limits):
        raise ValueError(
            f"range must be None where norm has its own, {limits[0]!r} to {limits[1]!r}; "
            f"got {check.short_repr(range)}"
        )
    wanted = None if range is None else find_range(range, values)
    try:
        own = copy.deepcopy(norm)
        if wanted is not None:
            own.vmin, own.vmax = wanted
        elif any(limit is None for limit in limits):
            own.autoscale_None(values)
        check_range((own.vmin, own.vmax))
        # Some norms change their limits when they are called.
        own(np.array([own.vmin, own.vmax]))
        foreign = ForeignNorm(own)
        foreign._call(np.array(foreign.range))
    except (AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"norm does not fit its range: {error}; got {norm!r}") from error
    if wanted not in (None, foreign.range):
        raise ValueError(
            f"range must be one that norm leaves as it is, not {foreign.range!r} in its place; "
            f"got {check.short_repr(range)}"
        )
    is_own = type(norm).__module__ == "matplotlib.colors" and not norm.clip
    own_type = OWN_NORMS.get(type(norm).__name__) if is_own else None
    return foreign if own_type is None else own_type(foreign.range)


def interpolate(value: float, knots: Sequence[float], values: Sequence[float]) -> float:
    """Return a value between ascending knots, linearly; that of the nearer end beyond them."""
    n = bisect_right(knots, value)
    if n in (0, len(knots)):
        return values[0] if n == 0 else values[-1]
    share = (value - knots[n - 1]) / (knots[n] - knots[n - 1])
    return values[n - 1] + share * (values[n] - values[n - 1])


def _kind_of(norm: Any) -> str:
    """Return the kind of a norm of Matplotlib's, whose ticks it has."""
    kinds = {"LogNorm": "log", "SymLogNorm": "symlog"}
    found = (kinds[one.__name__] for one in type(norm).__mro__ if one.__name__ in kinds)
    return next(found, "other")


def _close_end(ranks: Float64, count: int) -> Float64:
    """Return whole ranks, those of the end of the range in its last entry."""
    return np.floor(np.where(ranks == count, count - 1, ranks))


def _find_thresholds(ranks: Callable[[Float64], Float64], count: int) -> Float64:
    """Return the least value of each rank, 0 to ``count``; infinite where there is none."""
    found = _bisect(ranks, np.arange(count + 1.0), -MAX_VALUE, MAX_VALUE)
    return np.where(found == -MAX_VALUE, -np.inf, found)


def _bisect(
    function: Callable[[Float64], Float64], targets: Float64, low: float, high: float
) -> Float64:
    """Return the least float64 of low..high at which a function reaches each target, or inf."""
    least, most = (np.full(len(targets), _order(np.float64(end))) for end in (low, high))
    is_reached = function(np.full(len(targets), high)) >= targets
    while (least < most).any():
        middle = (least & most) + ((least ^ most) >> 1)
        is_above = function(_value(middle)) >= targets
        least, most = (
            np.where(is_above, least, np.minimum(middle + 1, most)),
            np.where(is_above, middle, most),
        )
    return np.where(is_reached, _value(least), np.inf)


def _order(value: np.float64) -> np.int64:
    """Return a whole number that is ordered as floats are."""
    bits = value.view(np.int64)
    return bits ^ ((bits >> 63) & _SIZE_BITS)


def _value(orders: Int64) -> Float64:
    """Return the floats of whole numbers: the inverse of `_order`."""
    return (orders ^ ((orders >> 63) & _SIZE_BITS)).view(np.float64)
