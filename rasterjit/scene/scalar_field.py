"""Scalar fields: a number for each vertex or face of a mesh, shown by a colour map."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import HoldsArrays
from rasterjit.scene.color import ColorLike, linear_color
from rasterjit.scene.colormap import Colormap, ColormapLike, range_divisor, read_colormap
from rasterjit.scene.contours import Contours, ContoursLike, read_contours
from rasterjit.scene.norm import Norm, NormLike, RangeLike, make_norm

NAN_COLOR = "darkgray"
"""The colour of values that are NaN or infinite, if no other is given."""

_MAX_FLOAT32 = float(np.finfo(np.float32).max)


class ColorScale(NamedTuple):
    """Map of values to colours, as a colour bar shows it."""

    colormap: Colormap
    norm: Norm
    thresholds: NDArray[np.float64] | None
    """Where entries begin; None: evenly spaced. See `Field`."""
    nan_color: NDArray[np.float32] | None
    """(4,), linear RGBA; None: no value is NaN."""
    lines: tuple[tuple[float, tuple[float, ...]], ...] = ()
    """The values of contours within the range, each with its colour, linear RGBA."""
    exceeds: tuple[bool, bool] = (False, False)
    """Whether values lie below the range, and above."""

    def _list_entries(self) -> tuple[Any, ...]:
        """Return where entries begin, their colours and names, and those outside the range."""
        shown, starts = self.colormap, self.thresholds
        colors = shown.codes.tobytes(), shown.under.tobytes(), shown.over.tobytes()
        return *colors, shown.categories, None if starts is None else starts.tobytes()

    def equals(self, other: ColorScale) -> bool:
        """Tell whether finite values have the same colours in both."""
        return self.norm.range == other.norm.range and self._list_entries() == other._list_entries()


@dataclass(frozen=True, eq=False)
class Field(HoldsArrays):
    """
    The scalars of a mesh with their colour map; see `Mesh.field`.

    Values are interpolated over each face, perspective-correctly and in float64, *before* the
    colour is looked up.
    """

    values: NDArray[np.float64]
    """(V,) or (F,), read-only, as given: NaN and infinity too."""
    of_faces: bool
    """Whether they are those of the faces, each of one colour."""
    colormap: Colormap
    norm: Norm
    """How values are spread over the colour map."""
    thresholds: NDArray[np.float64] | None
    """(N+2,), read-only: the least value that has a colour, and the first of each entry and of
    those above the range. None: entries are evenly spaced over it, and it is held to them."""
    nan_color: NDArray[np.float32]
    """(4,), read-only, linear RGBA: the colour of faces with a corner that is NaN."""
    contours: Contours | None = None

    def __repr__(self) -> str:
        low, high = self.range
        owners = "faces" if self.of_faces else "vertices"
        return f"Field({len(self.values)} {owners}, {low:g} to {high:g}, {self.colormap!r})"

    @property
    def range(self) -> tuple[float, float]:
        """Values of the first and the last entry of the colour map."""
        return self.norm.range

    @property
    def has_nan(self) -> bool:
        """Whether any value is NaN or infinite, or has no colour, such as 0 where logarithms do."""
        least = -np.inf if self.thresholds is None else self.thresholds[0]
        return not bool((np.isfinite(self.values) & (self.values >= least)).all())

    @property
    def scale(self) -> ColorScale:
        """The map of values to colours."""
        low, high = self.range
        color = () if self.contours is None else self.contours.color
        lines = tuple((level, color) for level in self.levels.tolist() if low <= level <= high)
        nan_color = self.nan_color if self.has_nan else None
        finite = self.values[np.isfinite(self.values)]
        exceeds = bool((finite < low).any()), bool((finite > high).any())
        return ColorScale(self.colormap, self.norm, self.thresholds, nan_color, lines, exceeds)

    @property
    def table(self) -> NDArray[np.float32]:
        """(N+1, 4), linear RGBA: the entries of the map, and the colour of NaN behind them;
        (N+3, 4) with those of values outside the range, where entries have thresholds.
        """
        colors = self.colormap.colors
        if self.thresholds is not None:
            colors = np.vstack([self.colormap.under, colors, self.colormap.over])
        return np.vstack([colors, self.nan_color])

    @property
    def range_start_width(self) -> tuple[float, float]:
        """Start and width of the range; infinite width where it is 0."""
        return self.range[0], range_divisor(*self.range)

    def entries(self, values: ArrayLike) -> NDArray[np.int64]:
        """Return which row of ``table`` each value, (...), shows; its last for NaN."""
        if self.thresholds is None:
            return self.colormap.entries(values, *self.range)
        numbers = check.number_array("values", values)
        rows = np.searchsorted(self.thresholds, numbers, side="right") - 1
        return np.where((rows < 0) | np.isnan(numbers), len(self.thresholds), rows)

    @property
    def levels(self) -> NDArray[np.float64]:
        """The values of its contours, ascending; (0,) without."""
        if self.contours is None:
            return np.empty(0)
        if type(self.norm) is Norm or not isinstance(self.contours.levels, int):
            return self.contours.level_values(*self.range)
        shares = self.contours.level_values(0.0, 1.0).tolist()
        return np.unique([self.norm.value(share) for share in shares])

    @property
    def min_alpha(self) -> np.float32:
        """Least alpha of all its colours."""
        return np.float32(self.table[: None if self.has_nan else -1, 3].min())

    def colors(self) -> NDArray[np.float32]:
        """Return the colours of the values themselves, linear RGBA, (V, 4) or (F, 4)."""
        finite_values = np.where(np.isfinite(self.values), self.values, np.nan)
        return self.table[self.entries(finite_values)]

    def select_rows(self, rows: NDArray[Any]) -> Field:
        """Return the field of some vertices, given their indices, with the same colour map."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Field(**values | {"values": check.read_only(self.values[rows])})


def make_field(
    scalars: ArrayLike,
    counts: tuple[int, int],
    colormap: ColormapLike,
    range: RangeLike | None,
    norm: NormLike | None,
    nan_color: ColorLike | None,
    contours: ContoursLike | None,
) -> Field:
    """
    Check the arguments of a mesh and return its scalar field.

    Parameters
    ----------
    scalars : (V,) or (F,) array_like
    counts : (int, int)
        V and F; V is -1 where scalars cannot be those of vertices.
    colormap, range, norm, nan_color, contours
        As `Mesh` takes them.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    values = _check_scalars(scalars, counts)
    if contours is not None and len(values) != counts[0]:
        raise ValueError("contours must be None where scalars are those of faces, without slopes")
    table = read_colormap(colormap)
    if table.categories:
        if norm is not None and not (isinstance(norm, str) and norm == "linear"):
            raise ValueError(
                "norm must be None where colormap has categories, which are numbers from 0; got "
                f"{check.short_repr(norm)}"
            )
        range = (-0.5, len(table) - 0.5) if range is None else range
    spread = make_norm(norm, range, values)
    is_even = type(spread) is Norm and not table.has_ends
    color = table.bad if nan_color is None else linear_color("nan_color", nan_color)
    return Field(
        values=check.read_only(values),
        of_faces=len(values) != counts[0],
        colormap=table,
        norm=spread,
        thresholds=None if is_even else check.read_only(spread.thresholds(len(table))),
        nan_color=check.read_only(linear_color("nan_color", NAN_COLOR) if color is None else color),
        contours=None if contours is None else read_contours(contours),
    )


def refuse_field(**given: Any) -> None:
    """Raise ``ValueError`` if arguments about scalars are given without scalars."""
    defaults = {"colormap": "viridis"}
    for name, value in given.items():
        default = defaults.get(name)
        is_unset = value is None if default is None else isinstance(value, str) and value == default
        if not is_unset:
            raise ValueError(
                f"{name} must be {default!r} where no scalars are given, "
                f"got {check.short_repr(value)}"
            )


def _check_scalars(scalars: ArrayLike, counts: tuple[int, int]) -> NDArray[np.float64]:
    """Return a copy of scalars, (V,) or (F,) float64, or raise ``ValueError``."""
    array = check.unmasked_array("scalars", check.fill_masked(scalars), "an array of numbers")
    if array.dtype.kind not in "buif":
        raise ValueError(f"scalars must hold numbers, got an array of dtype {array.dtype}")
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or len(array) not in counts:
        expected = f"one number per vertex ({counts[0]}) or per face ({counts[1]})"
        if counts[0] < 0:
            expected = f"shape ({counts[1]},)"
        raise ValueError(f"scalars must have {expected}, got shape {array.shape}")
    values = np.array(array, np.float64)
    finite = np.abs(values[np.isfinite(values)])
    if finite.size and finite.max() > _MAX_FLOAT32:
        raise ValueError(f"scalars must fit float32, got {float(finite.max())!r} in size")
    return values
