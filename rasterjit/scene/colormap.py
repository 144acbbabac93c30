"""Colour maps: tables of colours that show numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.forks import cached_property
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import HoldsArrays
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.color import ColorLike, linear_color, linear_rows, opaque_codes
from rasterjit.scene.colormap_tables import TABLES
from rasterjit.scene.norm import interpolate
from rasterjit.scene.validation import MaskedError

REVERSED_SUFFIX = "_r"
"""Suffix of the names of reversed maps."""

COLORMAPS = tuple(sorted(name for name in TABLES if not name.endswith(REVERSED_SUFFIX)))
"""Names of the maps, without the reversed ones."""

ColormapLike: TypeAlias = (
    "str | ArrayLike | Colormap | Callable[..., Any] | Mapping[str, ColorLike]"
)
"""A name, rows of sRGB colours, a `Colormap`, one of Matplotlib's, or colours by name."""


class Colormap(HoldsArrays, Guarded):
    """
    A table of colours, from that of the lowest value to that of the highest.

    A value x of a range from ``low`` to ``high`` shows entry ``floor(N (x - low) / (high - low))``
    of N, held to 0..N-1: what lies outside the range shows the colour of its nearer end, and there
    is nothing between two entries. That is Matplotlib's rule, in float64, so that figures agree.
    Where ``low`` equals ``high`` all values show entry 0, as there.

    Parameters
    ----------
    colors : str, (N, 3) or (N, 4) array_like, Colormap, or Matplotlib's ``Colormap``
        ``"viridis"``, ``"plasma"``, ``"inferno"``, ``"magma"``, ``"cividis"``, ``"turbo"``,
        ``"coolwarm"`` or ``"gray"``, of 256 entries each, with ``"_r"`` at its end read from the
        other side; or the entries themselves in sRGB: ``uint8`` codes, or floats in 0..1, which
        are *not* linear light here: so are the maps that others publish. Floats become 8-bit codes
        as in Matplotlib, rounded down. Alpha is 1 where it is not given. Or a mapping of names to
        colours: categories, for scalars that are 0, 1, 2 ...; see ``categories``. Those of vertices
        are interpolated as any are: between a 0 and a 2 there is a 1, so give those of faces.
    under, over : colour, optional
        Of values below and above the range. Default: those of its ends, or Matplotlib's map's own.
    bad : colour, optional
        Of values that are NaN or infinite, where a mesh is not told another. Default: Matplotlib's
        map's own, if that can be seen; else a mesh takes a dark grey.
    opacity : float or sequence of float, optional
        Alphas, 0 to 1, at even steps from the lowest to the highest value, linear between them;
        they multiply the map's. Seen through where the material's ``alpha_mode`` is ``"blend"``.

    Attributes
    ----------
    name : str
        The name it was asked for by; empty for entries.
    categories : tuple of str
        Names of the entries, where a mapping was given: bars show them beside boxes. The range is
        then, if it is not given, such that entry n is that of the number n.

    Raises
    ------
    ValueError
        If there is no map of that name, with those that are nearly called so; or the array has
        another shape, is empty, or holds anything else than numbers in 0..1.

    Examples
    --------
    >>> import rasterjit as rj
    >>> rj.Colormap("viridis").codes[[0, -1]].tolist()
    [[68, 1, 84, 255], [253, 231, 36, 255]]
    >>> rj.Colormap({"bone": "ivory", "muscle": "firebrick"}).categories
    ('bone', 'muscle')
    """

    def __init__(
        self,
        colors: ColormapLike,
        *,
        under: ColorLike | None = None,
        over: ColorLike | None = None,
        bad: ColorLike | None = None,
        opacity: ArrayLike | None = None,
    ) -> None:
        self._name = colors.strip() if isinstance(colors, str) else getattr(colors, "name", "")
        codes = _read_entries(colors)
        if opacity is not None:
            codes = _multiply_alphas(codes, opacity)
        self._codes = check.read_only(codes)
        self._categories = _read_categories(colors)
        own = _read_special_colors(colors)
        for name, value in {"under": under, "over": over, "bad": bad}.items():
            own[name] = own[name] if value is None else linear_color(name, value)
        self._special = {
            name: None if value is None else check.read_only(value) for name, value in own.items()
        }

    @property
    def name(self) -> str:
        """The name it was asked for by; empty for entries."""
        return self._name

    @property
    def codes(self) -> NDArray[np.uint8]:
        """(N, 4) uint8, read-only: sRGB codes of the entries, and alpha."""
        return self._codes

    @cached_property
    def _linear(self) -> NDArray[np.float32]:
        return check.read_only(linear_rows("colors", self._codes))

    @property
    def colors(self) -> NDArray[np.float32]:
        """(N, 4) float32, read-only: the entries in linear light."""
        return self._linear

    @property
    def categories(self) -> tuple[str, ...]:
        """Names of the entries, where a mapping was given; else empty."""
        return self._categories

    @property
    def under(self) -> NDArray[np.float32]:
        """(4,) float32, read-only: linear RGBA of values below the range."""
        color = self._special["under"]
        return self.colors[0] if color is None else color

    @property
    def over(self) -> NDArray[np.float32]:
        """(4,) float32, read-only: linear RGBA of values above the range."""
        color = self._special["over"]
        return self.colors[-1] if color is None else color

    @property
    def bad(self) -> NDArray[np.float32] | None:
        """(4,) float32, read-only: linear RGBA of what is no number; None: it has none."""
        return self._special["bad"]

    @property
    def has_ends(self) -> bool:
        """Whether values outside the range have a colour of their own."""
        return self._special["under"] is not None or self._special["over"] is not None

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self._codes)

    def __repr__(self) -> str:
        return f"Colormap({self._name!r})" if self._name else f"Colormap of {len(self)} entries"

    def entries(self, values: ArrayLike, low: float, high: float) -> NDArray[np.int64]:
        """
        Return which entry each value shows, in 0..N-1; N, one past the last, for NaN.

        Parameters
        ----------
        values : (...) array_like
        low, high : float
            The range, low <= high.
        """
        low, high = check.finite_number("low", low), check.finite_number("high", high)
        count, width = len(self), range_divisor(low, high)
        with np.errstate(over="ignore", invalid="ignore"):
            positions = (check.number_array("values", values) - low) / width * count
        clipped = np.clip(np.nan_to_num(positions, nan=0.0, posinf=count, neginf=0.0), 0, count - 1)
        return np.where(np.isnan(positions), count, np.floor(clipped).astype(np.int64))


def range_divisor(low: float, high: float) -> float:
    """Return the width of a range, or infinity if it is 0: all values then show entry 0."""
    return high - low if high > low else np.inf


def read_colormap(value: ColormapLike) -> Colormap:
    """Return a `Colormap`, converting other input."""
    return value if isinstance(value, Colormap) else Colormap(value)


def _read_entries(colors: Any) -> NDArray[np.uint8]:
    """Return the entries of a map in any notation, (N, 4) sRGB codes."""
    if isinstance(colors, Colormap):
        return colors.codes
    if isinstance(colors, str):
        return _read_named_entries(colors.strip())
    if isinstance(colors, Mapping):
        if not colors:
            raise ValueError("colormap must have a name or more for categories, got none")
        rows = [linear_color(f"colormap[{name!r}]", color) for name, color in colors.items()]
        alphas = np.floor(255.0 * np.array(rows)[:, 3:] + 0.5)
        return np.hstack([[opaque_codes(row[:3])[:3] for row in rows], alphas]).astype(np.uint8)
    if callable(colors) and isinstance(getattr(colors, "N", None), int):
        return np.array(colors(np.arange(colors.N), bytes=True), np.uint8)
    try:
        array = check.unmasked_array("colormap", colors)
    except MaskedError:
        raise
    except ValueError:
        array = np.empty(0, object)
    if array.dtype.kind not in "uif":
        raise ValueError(
            f"colormap must be a name, one of {', '.join(COLORMAPS)}, or (N, 3) or (N, 4) numbers; "
            f"got {check.brief(colors)}"
        )
    if array.ndim != 2 or array.shape[1] not in (3, 4) or not len(array):
        raise ValueError(f"colormap must have shape (N, 3) or (N, 4), N >= 1, got {array.shape}")
    codes = np.full((len(array), 4), 255, np.uint8)
    if array.dtype == np.uint8:
        codes[:, : array.shape[1]] = array
        return codes
    if not (array.min() >= 0 and array.max() <= 1):
        example = array[~((array >= 0) & (array <= 1))][0].item()
        raise ValueError(
            f"colormap must hold floats in 0..1, or uint8 codes, got {example!r} in an array of "
            f"{array.dtype}"
        )
    codes[:, : array.shape[1]] = (array * 255).astype(np.uint8)
    return codes


def _read_categories(colors: Any) -> tuple[str, ...]:
    """Return the names of a map's entries; empty if it has none."""
    if isinstance(colors, Mapping):
        return tuple(str(name) for name in colors)
    return colors.categories if isinstance(colors, Colormap) else ()


def _read_special_colors(colors: Any) -> dict[str, NDArray[np.float32] | None]:
    """Return the colours of a map below and above its range and of NaN, (4,) linear, or None."""
    if isinstance(colors, Colormap):
        return dict(colors._special)
    if not hasattr(colors, "get_bad"):
        return dict.fromkeys(("under", "over", "bad"))
    table = colors(np.arange(colors.N), bytes=True)
    under, over, bad = (
        linear_rows("colormap", np.array(row, np.uint8)[np.newaxis])[0]
        for row in (*colors(np.array([-1, colors.N]), bytes=True),
                    *colors(np.ma.masked_all(1), bytes=True))
    )  # fmt: skip
    first, last = linear_rows("colormap", np.array(table, np.uint8)[[0, -1]])
    return {
        "under": None if np.array_equal(under, first) else under,
        "over": None if np.array_equal(over, last) else over,
        "bad": bad if bad[3] > 0.0 else None,
    }


def _multiply_alphas(codes: NDArray[np.uint8], opacity: ArrayLike) -> NDArray[np.uint8]:
    """Return codes, (N, 4), with alphas multiplied by one or several at even steps."""
    alphas = np.atleast_1d(check.number_array("opacity", opacity))
    if alphas.ndim != 1 or not alphas.size or not ((alphas >= 0.0) & (alphas <= 1.0)).all():
        raise ValueError(
            f"opacity must be one number or more in 0..1, got {check.short_repr(opacity)}"
        )
    knots = np.linspace(0.0, 1.0, len(alphas)).tolist()
    places = np.linspace(0.0, 1.0, len(codes)).tolist()
    shares = np.array([interpolate(place, knots, alphas.tolist()) for place in places])
    result = codes.copy()
    result[:, 3] = np.floor(codes[:, 3] * shares + 0.5)
    return result


def _read_named_entries(name: str) -> NDArray[np.uint8]:
    """Return the entries of a named map, (N, 4) sRGB codes."""
    forward_name = name.removesuffix(REVERSED_SUFFIX)
    if forward_name not in TABLES:
        raise ValueError(
            f"colormap must be one of {', '.join(COLORMAPS)}, or one of them with "
            f"{REVERSED_SUFFIX!r} at its end; got {name!r}{_similar_names(name)}"
        )
    table = TABLES.get(name)
    rgb = np.frombuffer(bytes.fromhex(table or TABLES[forward_name]), np.uint8).reshape(-1, 3)
    codes = np.full((len(rgb), 4), 255, np.uint8)
    codes[:, :3] = rgb if table else rgb[::-1]
    return codes


def _similar_names(name: str) -> str:
    """Return "; did you mean 'x'?" with similar names, or an empty string."""
    import difflib

    names = [*COLORMAPS, *(known + REVERSED_SUFFIX for known in COLORMAPS)]
    found = difflib.get_close_matches(name.lower(), names, n=3)
    return f": did you mean {' or '.join(map(repr, found))}?" if found else ""
