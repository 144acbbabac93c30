"""
Draw the classic primitives straight into a colour and a depth array.

Coordinates are integer pixels: x right, y down, (0, 0) the top left one. Pixels outside are not
drawn. Everything is exact; ``rasterjit.pipeline.bresenham`` and ``primitives`` say how ties are
broken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.classics import line_bands, primitives
from rasterjit.pipeline import bresenham
from rasterjit.runtime.threads import Workers, split_range
from rasterjit.scene import validation as check
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.validation import MaskedError

OPAQUE = 255

EdgeRule: TypeAlias = Literal["top-left", "inclusive"]
FillMethod: TypeAlias = Literal["barycentric", "scanline"]

EDGE_RULES: dict[EdgeRule, int] = {
    "top-left": primitives.EXCLUSIVE_BIAS,
    "inclusive": primitives.INCLUSIVE_BIAS,
}

FILL_METHODS: dict[FillMethod, Callable[..., None]] = {
    "barycentric": primitives.fill_triangle,
    "scanline": primitives.fill_triangle_scanline,
}

NO_DEPTH = np.empty((0, 0), np.float32)
"""Stored depths for a triangle without a depth test."""

LINE_RANGE = (-(2**31), 2**31 - 1)
"""Smallest and largest coordinate of a line's end, pixels."""

MAX_DEPTH = float(np.finfo(np.float32).max)
"""Largest magnitude of a depth."""

SHAPE_RANGE = (-primitives.MAX_COORDINATE, primitives.MAX_COORDINATE)
"""Smallest and largest coordinate of all other shapes, pixels."""

MAX_UNBINNED_PIXELS = 2**19
"""Most pixels of lines drawn without bands: binning and waking threads would cost more."""

SEQUENCE_TYPES = (tuple, list, np.ndarray, Sequence)
"""Types of sequences of numbers or colours, the most common first."""

INTEGER_TYPES = frozenset({int, *(np.dtype(code).type for code in "bhilqBHILQ")})
"""Types of integers."""

MAX_BAND_BYTES = 2**20
"""Most bytes of a band of rows: a core's own cache."""

MAX_BANDS = 64
"""Most bands, and so most lists that hold one line."""

MIN_BAND_ROWS = 16
"""Fewest rows of a band; in thinner ones most lines would be drawn in pieces."""

LINES_PER_TASK = 2**15
"""Lines binned by one task."""

RECORDS_PER_BATCH = 2**22
"""Most entries of all lists at a time, 24 bytes each, which bounds memory."""


class Framebuffer(Guarded):
    """
    A picture to draw into, with a depth for each pixel.

    Parameters
    ----------
    width, height : int, pixels
        In 1..16384.
    threads : int or None, optional
        Most threads that ``draw_lines`` uses, in 1..1024; ``None`` takes the processors this
        process may run on. The picture is the same for any number.

    Attributes
    ----------
    color : (H, W, 4) uint8
        RGBA, row 0 on top; at first opaque black. Always this very array: read or write it at any
        time, nothing is copied.
    depth : (H, W) float32
        Smaller is nearer; at first ``inf``.

    Raises
    ------
    ValueError
        If a size is not a whole number in 1..16384, or the number of threads not as said.
    AttributeError
        If an attribute is assigned.

    Examples
    --------
    >>> framebuffer = Framebuffer(8, 4)
    >>> framebuffer.draw_line((0, 0), (7, 3), (255, 0, 0), (0, 0, 255))
    >>> framebuffer.color[0, 0].tolist(), framebuffer.color[3, 7].tolist()
    ([255, 0, 0, 255], [0, 0, 255, 255])
    """

    _ADVICE = "draw into it, or write into its arrays"

    def __init__(self, width: int, height: int, *, threads: int | None = None) -> None:
        self._width, self._height = check.image_size("width, height", (width, height))
        self._workers = Workers(check.thread_count("threads", threads))
        self._color = np.empty((self._height, self._width, 4), np.uint8)
        self._depth = np.empty((self._height, self._width), np.float32)
        self._pixels = self._color.view(np.uint32).reshape(self._height, self._width)
        self.clear()

    def __repr__(self) -> str:
        return f"Framebuffer({self._width}, {self._height})"

    @property
    def width(self) -> int:
        """Columns."""
        return self._width

    @property
    def height(self) -> int:
        """Rows."""
        return self._height

    @property
    def color(self) -> NDArray[np.uint8]:
        """(H, W, 4) uint8: RGBA, row 0 on top; the array itself, not a copy."""
        return self._color

    @property
    def depth(self) -> NDArray[np.float32]:
        """(H, W) float32: smaller is nearer; the array itself, not a copy."""
        return self._depth

    def clear(self, color: ArrayLike = (0, 0, 0), depth: float = math.inf) -> None:
        """
        Set every pixel to one colour and one depth.

        Parameters
        ----------
        color : 3 or 4 ints in 0..255
            RGB (then opaque) or RGBA, as everywhere in this class. Opaque black if left out.
        depth : float
            Infinite if left out: everything is nearer.

        Raises
        ------
        ValueError
            If the colour is not such a sequence, or the depth is neither ``inf`` nor in the
            range of float32.
        """
        pixel = _read_pixel("color", color)
        if not check.is_infinite(depth):
            depth = check.bounded_number("depth", depth, -MAX_DEPTH, MAX_DEPTH)
        self._pixels.fill(pixel)
        self._depth.fill(depth)

    def put_pixel(self, x: int, y: int, color: ArrayLike) -> None:
        """
        Set one pixel; outside the picture nothing happens.

        Raises
        ------
        ValueError
            If x or y is not a whole number, or the colour not 3 or 4 ints in 0..255.
        """
        column, row = _read_integer("x", x), _read_integer("y", y)
        pixel = _read_pixel("color", color)
        if 0 <= column < self._width and 0 <= row < self._height:
            self._pixels[row, column] = pixel

    def draw_line(
        self,
        start: Sequence[int],
        end: Sequence[int],
        color: ArrayLike,
        end_color: ArrayLike | None = None,
    ) -> None:
        """
        Draw a Bresenham line, both ends included.

        Parameters
        ----------
        start, end : (x, y) ints in [-2**31, 2**31 - 1], pixels
        color : 3 or 4 ints in 0..255
            Of the start, and of the whole line if ``end_color`` is left out.
        end_color : 3 or 4 ints in 0..255, optional
            Of the end; in between each channel is mixed per pixel and rounded half up.

        Raises
        ------
        ValueError
            If a point or a colour is not as said.
        """
        a = _read_point("start", start, *LINE_RANGE)
        b = _read_point("end", end, *LINE_RANGE)
        bresenham.draw_one_line(self._pixels, a, b, _read_two_pixels(color, end_color))

    def draw_lines(self, ends: ArrayLike, colors: ArrayLike) -> None:
        """
        Draw many lines in one call, in order.

        More than a thousand are shared among the threads by bands of rows: each band is drawn by
        one thread, in order, and cuts no pixel of a line anew.

        Parameters
        ----------
        ends : (N, 4) ints in [-2**31, 2**31 - 1], pixels
            x and y of the start, x and y of the end.
        colors : (N, 2, 3|4), (N, 3|4) or (3|4,) ints in 0..255
            One for each end, one for each line, or one for all.

        Raises
        ------
        ValueError
            If an array is not as said.
        """
        points = _read_integer_array("ends", ends, (None, 4), *LINE_RANGE)
        rgba = _read_colors("colors", colors)
        count = len(points)
        if rgba.shape not in ((count, 2, 4), (count, 4), (4,)):
            raise ValueError(
                f"colors must be one for each end, one for each line or one for all of {count} "
                f"lines, got an array of shape {np.shape(colors)}"
            )
        if rgba.ndim == 2:
            rgba = rgba[:, None]
        rgba = np.ascontiguousarray(np.broadcast_to(rgba, (count, 2, 4)))
        if _has_few_pixels(points, max(self.width, self.height)):
            bresenham.draw_lines(self._pixels, points, rgba)
        else:
            _draw_in_bands(self._pixels, points, rgba, self._workers)

    def draw_triangle(
        self, a: Sequence[int], b: Sequence[int], c: Sequence[int], color: ArrayLike
    ) -> None:
        """
        Draw the outline of a triangle: the lines a to b, b to c and c to a.

        Parameters
        ----------
        a, b, c : (x, y) ints in [-2**31, 2**31 - 1], pixels
        color : 3 or 4 ints in 0..255, or three such colours
            One for all, or one for each vertex, mixed along the lines.

        Raises
        ------
        ValueError
            If a point or a colour is not as said.
        """
        points = [_read_point(*named, *LINE_RANGE) for named in (("a", a), ("b", b), ("c", c))]
        pixels = _read_three_pixels("color", color)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            bresenham.draw_one_line(self._pixels, points[i], points[j], (pixels[i], pixels[j]))

    def fill_triangle(
        self,
        a: Sequence[int],
        b: Sequence[int],
        c: Sequence[int],
        color: ArrayLike,
        *,
        edges: EdgeRule = "top-left",
        method: FillMethod = "barycentric",
        depth: ArrayLike | None = None,
    ) -> None:
        """
        Fill a triangle in either winding; one without area draws nothing.

        Parameters
        ----------
        a, b, c : (x, y) ints in [-2**20, 2**20], pixels
        color : 3 or 4 ints in 0..255, or three such colours
            One for all, or one for each vertex: then mixed exactly and rounded half up.
        edges : {"top-left", "inclusive"}
            Whether triangles that share an edge share its pixels: with "top-left" each pixel
            belongs to one of them; with "inclusive" every pixel on an edge is drawn.
        method : {"barycentric", "scanline"}
            Test each pixel of the bounding box, or divide for the ends of each row and then only
            add. The result is the same.
        depth : 3 floats, optional
            One for each vertex: then only pixels nearer (smaller) than ``self.depth`` are drawn,
            and update it. Without it ``self.depth`` is neither read nor written.

        Raises
        ------
        ValueError
            If a point, a colour, a name or a depth is not as said.
        """
        low, high = SHAPE_RANGE
        (ax, ay), (bx, by) = _read_point("a", a, low, high), _read_point("b", b, low, high)
        cx, cy = _read_point("c", c, low, high)
        first, second, third = _read_three_pixels("color", color)
        bias = EDGE_RULES[check.one_of("edges", edges, EDGE_RULES)]
        fill = FILL_METHODS[check.one_of("method", method, FILL_METHODS)]
        depths, stored = (0.0, 0.0, 0.0), NO_DEPTH
        if depth is not None:
            depths, stored = check.triple("depth", depth), self._depth
            if max(map(abs, depths)) > MAX_DEPTH:
                raise ValueError(f"depth must fit float32, got {list(depths)}")
        da, db, dc = depths
        corners = (ax, ay, first, da), (bx, by, second, db), (cx, cy, third, dc)
        fill(self._pixels, stored, corners, bias)

    def draw_circle(self, center: Sequence[int], radius: int, color: ArrayLike) -> None:
        """
        Draw a circle by the midpoint algorithm, each pixel once.

        Parameters
        ----------
        center : (x, y) ints in [-2**20, 2**20], pixels
        radius : int in 0..2**20, pixels
            0 is one pixel.
        color : 3 or 4 ints in 0..255

        Raises
        ------
        ValueError
            If an argument is not as said.
        """
        x, y = _read_point("center", center, *SHAPE_RANGE)
        (size,) = _read_integers((radius,), (1,), 0, primitives.MAX_COORDINATE) or (
            int(_read_integer_array("radius", radius, (), 0, primitives.MAX_COORDINATE)),
        )
        primitives.draw_circle(self._pixels, x, y, size, _read_pixel("color", color))

    def draw_bezier(
        self,
        points: ArrayLike,
        color: ArrayLike,
        end_color: ArrayLike | None = None,
    ) -> None:
        """
        Draw a quadratic or cubic Bezier curve one pixel wide, both ends included.

        Every pixel's centre lies within half a pixel's diagonal (0.7072) of the curve, and every
        place of the curve within one pixel of a pixel's centre. The pixels form one path without
        gaps, in which none follows itself. Where the curve comes back to a pixel, the later colour
        stays.

        Parameters
        ----------
        points : (3, 2) or (4, 2) floats in [-2**20, 2**20], pixels
            Control points, x and y; whole numbers are pixel centres.
        color, end_color : 3 or 4 ints in 0..255
            At the start and at the end; in between they follow the curve's parameter. One colour
            throughout if ``end_color`` is left out.

        Raises
        ------
        ValueError
            If an argument is not as said.
        """
        control = np.ascontiguousarray(check.finite_array("points", points, (None, 2)))
        if len(control) not in (3, 4):
            raise ValueError(f"points must be 3 or 4 control points, got {len(control)}")
        furthest = max(map(abs, control.ravel().tolist()))
        if furthest > primitives.MAX_COORDINATE:
            raise ValueError(
                f"points must be at most {primitives.MAX_COORDINATE} in magnitude, got {furthest!r}"
            )
        primitives.draw_bezier(self._pixels, control, _read_two_pixels(color, end_color))

    def save(self, path: str | Path) -> None:
        """
        Write the colours to an image file.

        Raises
        ------
        ValueError
            If the folder does not exist, the extension is not that of a known image format, or a
            pixel is transparent and the format, as JPEG, cannot show that.
        """
        from rasterjit.io.images import save_image

        save_image(path, self._color)


def _has_few_pixels(ends: NDArray[np.int64], most_steps: int) -> bool:
    """Return whether lines have so few pixels that bands would cost more than they save."""
    if len(ends) * most_steps <= MAX_UNBINNED_PIXELS:
        return True
    # Measuring millions of lines would take a quarter of the time to draw them
    if len(ends) > MAX_UNBINNED_PIXELS:
        return False
    steps = np.abs(ends[:, 2:] - ends[:, :2]).max(axis=1)
    return int(np.minimum(steps, most_steps).sum()) <= MAX_UNBINNED_PIXELS


def _draw_in_bands(
    pixels: NDArray[np.uint32],
    ends: NDArray[np.int64],
    colors: NDArray[np.uint8],
    workers: Workers,
) -> None:
    """Draw (N, 4) end points and (N, 2, 4) colours, band by band, on all threads."""
    height, width = pixels.shape
    rows = _choose_band_rows(height, width, workers.threads)
    tops = range(0, height, rows)
    band_of_row = np.arange(height, dtype=np.int32) // np.int32(rows)
    packed_colors = colors.view(np.int32).reshape(-1, 2)
    lines_per_batch = RECORDS_PER_BATCH // len(tops)
    for batch in range(0, len(ends), lines_per_batch):
        batch_end = min(batch + lines_per_batch, len(ends))
        parts = [slice(*part) for part in split_range(batch_end, LINES_PER_TASK, batch)]
        bins = workers.run(
            _bin_lines,
            [(ends[part], packed_colors[part], band_of_row, width, len(tops)) for part in parts],
        )
        workers.run(
            _draw_band,
            [
                (
                    pixels[top : top + rows],
                    top,
                    [records[starts[k] : starts[k + 1]] for starts, records in bins],
                )
                for k, top in enumerate(tops)
            ],
        )


def _bin_lines(
    ends: NDArray[np.int64],
    colors: NDArray[np.int32],
    band_of_row: NDArray[np.int32],
    width: int,
    bands: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the start of each band in a list of lines, (bands + 1,), and the list."""
    counts = np.zeros(bands, np.int64)
    line_bands.count_lines(ends, band_of_row, width, counts)
    starts = np.concatenate(([0], np.cumsum(counts)))
    records = np.empty((starts[-1], line_bands.RECORD_WORDS), np.int32)
    line_bands.list_lines(ends, colors, band_of_row, width, starts[:-1].copy(), records)
    return starts, records


def _choose_band_rows(height: int, width: int, threads: int) -> int:
    """Return the number of rows of a band: a full cache, but at least two bands per thread."""
    rows = MAX_BAND_BYTES // (4 * width)
    if threads > 1:
        rows = min(rows, -(-height // (2 * threads)))
    return max(rows, -(-height // MAX_BANDS), MIN_BAND_ROWS)


def _draw_band(
    band_pixels: NDArray[np.uint32], top: int, lists: Sequence[NDArray[np.int32]]
) -> None:
    """Draw lists of binned lines into the rows of one band, which begins at row ``top``."""
    scratch = line_bands.make_scratch()
    for records in lists:
        line = 0
        while line < len(records):
            line = line_bands.draw_short_lines(band_pixels, top, records, line, scratch)
            if line < len(records):
                line = line_bands.draw_long_lines(band_pixels, top, records, line)


def _read_integers(value: Any, counts: Sequence[int], low: int, high: int) -> Sequence[int] | None:
    """
    Return integers in low..high of a tuple, list or array of an allowed length, else ``None``.

    ``None`` is no verdict: slower checks then accept or refuse the value.
    """
    numbers = value.tolist() if type(value) is np.ndarray else value
    if type(numbers) not in (tuple, list) or len(numbers) not in counts:
        return None
    for number in numbers:
        if type(number) is not int:
            break
        if not low <= number <= high:
            return None
    else:
        return numbers
    whole = [
        int(number)
        for number in numbers
        if type(number) in INTEGER_TYPES or (isinstance(number, float) and number.is_integer())
    ]
    return _read_integers(whole, (len(numbers),), low, high)


def _read_point(name: str, value: Any, low: int, high: int) -> tuple[int, int]:
    """Return x and y as ints in low..high, or raise ``ValueError``."""
    # A branch for the usual value takes half the time
    if type(value) is tuple and len(value) == 2:
        x, y = value
        if type(x) is type(y) is int and low <= x <= high and low <= y <= high:
            return value
    numbers = _read_integers(value, (2,), low, high)
    x, y = numbers or _read_integer_array(name, value, (2,), low, high).tolist()
    return x, y


def _read_integer_array(
    name: str, value: ArrayLike, shape: tuple[int | None, ...], low: int, high: int
) -> NDArray[np.int64]:
    """Return whole numbers in low..high as a contiguous int64 array, or raise ``ValueError``."""
    if _is_integer_array(value, shape, low, high):
        return np.require(value, np.int64, ["C", "ALIGNED", "WRITEABLE", "ENSUREARRAY"])
    numbers = check.finite_array(name, value, shape)
    wrong = (numbers != np.floor(numbers)) | (numbers < low) | (numbers > high)
    if wrong.any():
        raise ValueError(
            f"{name} must be whole numbers in {low}..{high}, got {numbers[wrong].flat[0]!r}"
        )
    return np.ascontiguousarray(numbers.astype(np.int64)).reshape(numbers.shape)


def _is_integer_array(value: ArrayLike, shape: tuple[int | None, ...], low: int, high: int) -> bool:
    """Return whether a value is an array of an integer dtype, a shape and a range."""
    return (
        isinstance(value, np.ndarray)
        and value.dtype.kind in "iu"
        and value.ndim == len(shape)
        and all(want in (None, have) for have, want in zip(value.shape, shape, strict=True))
        and (value.size == 0 or (value.min() >= low and value.max() <= high))
    )


def _read_integer(name: str, value: Any) -> int:
    """Return a whole number of any size as an int, or raise ``ValueError``."""
    try:
        whole = int(value)
        exact = whole == value
    except (TypeError, ValueError, OverflowError):
        exact = False
    if not exact:
        raise ValueError(f"{name} must be a whole number, got {value!r}")
    return whole


def _read_colors(name: str, value: ArrayLike) -> NDArray[np.uint8]:
    """Return colours of 3 or 4 channels as RGBA, in any number of axes before the last."""
    try:
        channels = check.unmasked_array(name, value)
        if channels.dtype == np.uint8 and channels.ndim and channels.shape[-1] == 4:
            return np.array(channels, order="C")
        if channels.dtype.kind not in "uif":
            raise TypeError
        if channels.dtype != np.uint8:
            channels = channels.astype(np.float64)
    except MaskedError:
        raise
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be 3 or 4 whole numbers in 0..255, got {value!r}") from None
    whole = (channels >= 0) & (channels <= 255) & (channels == np.floor(channels))
    if channels.ndim == 0 or channels.shape[-1] not in (3, 4) or not whole.all():
        raise ValueError(f"{name} must be 3 or 4 whole numbers in 0..255, got {value!r}")
    rgba = np.full((*channels.shape[:-1], 4), OPAQUE, np.uint8)
    rgba[..., : channels.shape[-1]] = channels.astype(np.uint8)
    return rgba


def _read_pixel(name: str, value: ArrayLike) -> int:
    """Return one colour as a pixel, red in its lowest byte, or raise ``ValueError``."""
    # A branch for the usual value takes half the time
    if type(value) is tuple and len(value) == 3:
        red, green, blue = value
        is_whole = type(red) is type(green) is type(blue) is int
        if is_whole and 0 <= red <= OPAQUE and 0 <= green <= OPAQUE and 0 <= blue <= OPAQUE:
            return red | green << 8 | blue << 16 | OPAQUE << 24
    channels = _read_integers(value, (3, 4), 0, OPAQUE)
    if channels is None:
        rgba = _read_colors(name, value)
        if rgba.ndim != 1:
            raise ValueError(f"{name} must be one colour, got an array of shape {np.shape(value)}")
        channels = rgba.tolist()
    red, green, blue, alpha = channels if len(channels) == 4 else (*channels, OPAQUE)
    return red | green << 8 | blue << 16 | alpha << 24


def _read_three_pixels(name: str, value: Any) -> tuple[int, int, int]:
    """Return one colour for each of three vertices, or one for all, as pixels, or raise."""
    if (
        isinstance(value, SEQUENCE_TYPES)
        and getattr(value, "ndim", 1) > 0
        and len(value) == 3
        and all([isinstance(item, SEQUENCE_TYPES) for item in value])
    ):
        first, second, third = value
        return _read_pixel(name, first), _read_pixel(name, second), _read_pixel(name, third)
    pixel = _read_pixel(name, value)
    return pixel, pixel, pixel


def _read_two_pixels(color: ArrayLike, end_color: ArrayLike | None) -> tuple[int, int]:
    """Return the colours of both ends as pixels, by default the same."""
    start = _read_pixel("color", color)
    return start, start if end_color is None else _read_pixel("end_color", end_color)
