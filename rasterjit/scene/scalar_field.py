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

_MAX_RANGE = 1e200
"""Largest width of a range: products with it are finite."""

NAN_COLOR = "darkgray"
"""The colour of values that are NaN or infinite, if no other is given."""

_MAX_FLOAT32 = float(np.finfo(np.float32).max)


class ColorScale(NamedTuple):
    """Map of values to colours, as a colour bar shows it."""

    colormap: Colormap
    range: tuple[float, float]
    nan_color: NDArray[np.float32] | None
    """(4,), linear RGBA; None: no value is NaN."""
    lines: tuple[tuple[float, tuple[float, ...]], ...] = ()
    """The values of contours within the range, each with its colour, linear RGBA."""

    def equals(self, other: ColorScale) -> bool:
        """Tell whether finite values have the same colours in both."""
        is_same = self.range == other.range
        return is_same and np.array_equal(self.colormap.codes, other.colormap.codes)


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
    range: tuple[float, float]
    """Values of the first and the last entry of the colour map."""
    nan_color: NDArray[np.float32]
    """(4,), read-only, linear RGBA: the colour of faces with a corner that is NaN."""
    contours: Contours | None = None

    def __repr__(self) -> str:
        low, high = self.range
        owners = "faces" if self.of_faces else "vertices"
        return f"Field({len(self.values)} {owners}, {low:g} to {high:g}, {self.colormap!r})"

    @property
    def has_nan(self) -> bool:
        """Whether any value is NaN or infinite."""
        return not bool(np.isfinite(self.values).all())

    @property
    def scale(self) -> ColorScale:
        """The map of values to colours."""
        low, high = self.range
        color = () if self.contours is None else self.contours.color
        lines = tuple((level, color) for level in self.levels.tolist() if low <= level <= high)
        nan_color = self.nan_color if self.has_nan else None
        return ColorScale(self.colormap, self.range, nan_color, lines)

    @property
    def table(self) -> NDArray[np.float32]:
        """(N+1, 4), linear RGBA: the entries of the map, and the colour of NaN behind them."""
        return np.vstack([self.colormap.colors, self.nan_color])

    @property
    def range_start_width(self) -> tuple[float, float]:
        """Start and width of the range; infinite width where it is 0."""
        return self.range[0], range_divisor(*self.range)

    @property
    def levels(self) -> NDArray[np.float64]:
        """The values of its contours, ascending; (0,) without."""
        return np.empty(0) if self.contours is None else self.contours.level_values(*self.range)

    @property
    def min_alpha(self) -> np.float32:
        """Least alpha of all its colours."""
        lowest = self.colormap.colors[:, 3].min()
        return np.float32(min(lowest, self.nan_color[3]) if self.has_nan else lowest)

    def colors(self) -> NDArray[np.float32]:
        """Return the colours of the values themselves, linear RGBA, (V, 4) or (F, 4)."""
        finite_values = np.where(np.isfinite(self.values), self.values, np.nan)
        return self.table[self.colormap.entries(finite_values, *self.range)]

    def select_rows(self, rows: NDArray[Any]) -> Field:
        """Return the field of some vertices, given their indices, with the same colour map."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Field(**values | {"values": check.read_only(self.values[rows])})


def make_field(
    scalars: ArrayLike,
    counts: tuple[int, int],
    colormap: ColormapLike,
    range: tuple[float, float] | None,
    nan_color: ColorLike,
    contours: ContoursLike | None,
) -> Field:
    """
    Check the arguments of a mesh and return its scalar field.

    Parameters
    ----------
    scalars : (V,) or (F,) array_like
    counts : (int, int)
        V and F; V is -1 where scalars cannot be those of vertices.
    colormap, range, nan_color, contours
        As `Mesh` takes them.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    values = _check_scalars(scalars, counts)
    if contours is not None and len(values) != counts[0]:
        raise ValueError("contours must be None where scalars are those of faces, without slopes")
    return Field(
        values=check.read_only(values),
        of_faces=len(values) != counts[0],
        colormap=read_colormap(colormap),
        range=_find_range(values) if range is None else _check_range(range),
        nan_color=check.read_only(linear_color("nan_color", nan_color)),
        contours=None if contours is None else read_contours(contours),
    )


def refuse_field(**given: Any) -> None:
    """Raise ``ValueError`` if arguments about scalars are given without scalars."""
    defaults = {"colormap": "viridis", "nan_color": NAN_COLOR}
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


def _find_range(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the least and the greatest finite value; 0 and 1 where there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)


def _check_range(value: Any) -> tuple[float, float]:
    """Check a range and return it, or raise ``ValueError``."""
    try:
        limits = check.number_array("range", value)
    except ValueError:
        limits = np.empty(0)
    if limits.shape != (2,) or not np.isfinite(limits).all():
        raise ValueError(
            f"range must be two finite numbers, low and high, got {check.short_repr(value)}"
        )
    low, high = limits.tolist()
    if low > high:
        raise ValueError(
            f"range must go from low to high, got {(low, high)!r}; a colormap with '_r' at the end "
            "of its name shows low values as others show high ones"
        )
    if high - low > _MAX_RANGE:
        raise ValueError(f"range must be at most {_MAX_RANGE:g} wide, got {(low, high)!r}")
    return low, high
