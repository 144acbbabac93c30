"""Check arguments: errors name the argument, its value and what was expected."""

from __future__ import annotations

import math
import operator
import os
import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.attribute_guard import similar_names
from rasterjit.scene.vectors import cross, dot

Kind = TypeVar("Kind")

MAX_SIZE = 16384
"""Largest image side, pixels: the edge functions are proved exact up to it."""

MAX_WHOLE_SIZE = 1 << 17
"""Largest side of an image that is drawn in tiles, pixels."""

MAX_UNITS = 1 << 27
"""Most units of the sub-pixel grid from one side of the guard bands to the other; see ``setup``."""

_MATRIX_SIZE = 16
"""Entries of a 4x4 matrix."""

_FLOAT64 = np.dtype(np.float64)
"""The dtype of most arrays of numbers, which compares fast as it is the same object."""

_ARRAY_ERRORS = (TypeError, ValueError, OverflowError, MemoryError)
"""Exceptions that NumPy raises for values that it cannot make an array of."""

ROWS_WORDING = "an array of numbers", "rows of unequal length"
"""Wording of errors for an argument of rows: what was expected, and what was given."""

MAX_SHOWN_LENGTH = 80
"""Most characters of a value that a message shows."""

MAX_THREADS = 1024
"""Most threads a render takes: more than processors in one machine, and few enough to start."""

MAX_ROTATION_ERROR = 1e-3
"""By how much columns of a rotation may miss unit length and right angles: float32 poses that
were multiplied many times are within it, and a scaled or mirrored one is not."""


def finite_number(name: str, value: Any) -> float:
    """Return ``value`` as a float, or raise ``ValueError`` naming the argument."""
    try:
        is_plain = type(value) in (int, float)
        if not is_plain and (isinstance(value, (str, bytes)) or _has_masked(value)):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a number, got {short_repr(value)}") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number!r}")
    return number


def _has_masked(value: Any) -> bool:
    """Tell whether an array has masked entries."""
    return _is_masked_array(value) and bool(value.mask.any())


def bounded_number(name: str, value: Any, low: float, high: float) -> float:
    """Return ``value`` as a float in [low, high], or raise ``ValueError``."""
    number = finite_number(name, value)
    if not low <= number <= high:
        raise ValueError(f"{name} must be in {low:g}..{high:g}, got {_as_written(value, number)!r}")
    return number


MIN_LINE_WIDTH, MAX_LINE_WIDTH = 0.1, 64.0
"""Least and largest width of a line that is drawn over a picture, pixels."""


def line_width(name: str, value: Any) -> float:
    """Return a width of lines over a picture, pixels, or raise ``ValueError``."""
    return bounded_number(name, value, MIN_LINE_WIDTH, MAX_LINE_WIDTH)


def positive_number(name: str, value: Any) -> float:
    """Return ``value`` as a finite float above zero, or raise ``ValueError``."""
    number = finite_number(name, value)
    if number <= 0.0:
        raise ValueError(f"{name} must be above 0, got {_as_written(value, number)!r}")
    return number


def _as_written(value: Any, number: float) -> int | float:
    """Return a number as the caller wrote it: 10, not 10.0."""
    return value if type(value) is int else number


def unmasked_array(
    name: str, value: Any, expected: str = "an array", got: str | None = None
) -> NDArray[Any]:
    """
    Return ``value`` as a NumPy array, of no subclass.

    Errors say what was ``expected``, and what was given instead: the value, or ``got``.

    Raises
    ------
    ValueError
        Of a masked array, if entries are masked: there is no number where one is needed. If it is
        no array, such as rows of several lengths, or says that it is longer than memory.
    """
    if _is_masked_array(value):
        masked = int(np.count_nonzero(value.mask))
        if masked:
            raise MaskedError(
                f"{name} must have no masked entries, got {masked} of {value.size}; its method "
                "filled() gives them a value"
            )
    try:
        return np.asarray(value)
    except _ARRAY_ERRORS:
        if isinstance(value, np.ndarray):
            raise
        text = brief(value) if got is None else got
        raise ValueError(f"{name} must be {expected}, got {text}") from None


def fill_masked(value: Any) -> Any:
    """Fill a masked array of real numbers with NaN where it is masked; return others as given."""
    if not _is_masked_array(value) or value.dtype.kind not in "buif":
        return value
    return value.astype(np.float64).filled(np.nan)


def _is_masked_array(value: Any) -> bool:
    """Tell whether a value is a masked array, without importing `numpy.ma`."""
    # Another thread may be importing it.
    kind = getattr(sys.modules.get("numpy.ma"), "MaskedArray", None)
    return kind is not None and isinstance(value, kind)


class MaskedError(ValueError):
    """An array has masked entries."""


def number_array(name: str, value: ArrayLike, kinds: str = "buif") -> NDArray[np.float64]:
    """Return numbers, NaN and infinity allowed, as an aligned float64 array, or raise."""
    try:
        given = value if type(value) is np.ndarray else unmasked_array(name, value)
        if given.dtype is _FLOAT64:
            return align(given)
        if given.size and given.dtype.kind not in kinds:
            raise TypeError
        return align(given.astype(np.float64))
    except MaskedError:
        raise
    except _ARRAY_ERRORS:
        raise ValueError(f"{name} must be an array of numbers, got {short_repr(value)}") from None


def finite_array(name: str, value: ArrayLike, shape: Sequence[int | None]) -> NDArray[np.float64]:
    """
    Return ``value`` as a float64 array of the given shape with only finite entries.

    Parameters
    ----------
    name : str
        What the message calls the argument.
    value : array_like
    shape : sequence of int or None
        Expected shape; ``None`` stands for any length.

    Raises
    ------
    ValueError
        If the shape differs, an entry is not a number, or an entry is NaN or infinite.
    """
    array = number_array(name, value)
    expected = tuple(shape)
    if array.shape != expected and (
        array.ndim != len(expected)
        or any(n is not None and size != n for size, n in zip(array.shape, expected, strict=True))
    ):
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in expected) + ")"
        raise ValueError(f"{name} must have shape {wanted}, got {array.shape}")
    if not _is_finite(array):
        count = int((~np.isfinite(array)).sum())
        text = f": {array.tolist()}" if array.size <= 16 else ""
        raise ValueError(f"{name} must be finite, got {count} NaN or infinite entries{text}")
    return array


def _is_finite(array: NDArray[np.float64]) -> bool:
    """Tell whether all entries are finite; a matrix takes 1 microsecond here, and 3 in NumPy."""
    if array.size <= _MATRIX_SIZE:
        numbers = array.ravel().tolist()
        # The sum of what is not finite is not; that of large numbers may overflow.
        return math.isfinite(sum(numbers)) or all(map(math.isfinite, numbers))
    return bool(np.isfinite(array).all())


def align(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array at an aligned address, as kernels need it: itself or a copy."""
    return array if array.flags.aligned else array.copy()


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """
    Return a view of an array that nothing can write to, nor be made to.

    What was pickled may lie at any address: see `align`.
    """
    array = align(array)
    array.setflags(write=False)
    return array.view()


VectorLike: TypeAlias = Sequence[float] | NDArray[Any]
"""Three numbers, as a field takes them that stores a tuple."""


def vector(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return ``value`` as a finite float64 vector of three, or raise ``ValueError``."""
    return finite_array(name, value, (3,))


def triple(name: str, value: ArrayLike) -> tuple[float, float, float]:
    """Return ``value`` as three finite floats, or raise ``ValueError``."""
    if type(value) is tuple and len(value) == 3:
        x, y, z = value
        if type(x) is type(y) is type(z) is float and math.isfinite(x + y + z):
            return value
    x, y, z = vector(name, value).tolist()
    return x, y, z


def check_rotation(name: str, matrix: NDArray[np.float64]) -> None:
    """Raise ``ValueError`` if a (3, 3) matrix is no rotation."""
    (a, b, c) = (matrix[:, k].tolist() for k in range(3))
    lengths = [dot(a, a) - 1.0, dot(b, b) - 1.0, dot(c, c) - 1.0]
    angles = [dot(a, b), dot(b, c), dot(c, a)]
    if max(map(abs, lengths + angles)) > MAX_ROTATION_ERROR or dot(cross(a, b), c) <= 0.0:
        raise ValueError(
            f"{name} must hold a rotation, neither scaled nor mirrored, got {matrix.tolist()}"
        )


def boolean(name: str, value: Any) -> bool:
    """Return ``value`` as a bool, or raise ``ValueError``: 1 and 0 are none."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} must be True or False, got {brief(value)}")
    return bool(value)


def string(name: str, value: Any) -> str:
    """Return ``value`` if it is a string, or raise ``ValueError``."""
    if not isinstance(value, str):
        raise ValueError(f"{name} must be a text, got {brief(value)}")
    return value


def instance_of(name: str, value: Any, kind: type[Kind]) -> Kind:
    """Return ``value`` if it is of a class, or raise ``ValueError``."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise ValueError(f"{name} must be {article} {kind.__name__}, got {brief(value)}")
    return value


def strings(name: str, value: Any) -> tuple[str, ...]:
    """Return strings as a tuple, or raise ``ValueError``, also for one string alone."""
    return tuple(string(f"each of {name}", one) for one in sequence(name, value))


def sequence(name: str, value: Any) -> tuple[Any, ...]:
    """Return the items of a sequence or iterator, but no string, or raise ``ValueError``."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        return tuple(value)
    except (TypeError, MemoryError):
        # One may say that it is longer than memory.
        raise ValueError(f"{name} must be a sequence, got {brief(value)}") from None


def is_infinite(value: Any) -> bool:
    """Tell whether ``value``, of any type, is positive infinity."""
    return isinstance(value, (float, np.floating)) and value == math.inf


def one_of(name: str, value: Any, choices: Collection[Any]) -> Any:
    """Return ``value`` if it is one of ``choices``, or raise ``ValueError`` listing them."""
    if type(value) is str and value in choices:
        return value
    # A value of another type may equal a choice (True, 8.0), or not compare at all (an array).
    candidates = [
        choice
        for choice in choices
        if isinstance(value, type(choice) if not isinstance(choice, int) else (int, np.integer))
    ]
    if isinstance(value, bool) or not candidates or value not in candidates:
        options = ", ".join(map(repr, choices)) or "those that there are, which are none"
        raise ValueError(
            f"{name} must be one of {options}; got {short_repr(value)}{suggest(value, choices)}"
        )
    return value


def suggest(text: Any, choices: Iterable[Any]) -> str:
    """Return "; did you mean 'x'?" for text that is similar to a choice, else an empty string."""
    names = [name for name in choices if isinstance(name, str)]
    guesses = similar_names(text, names) if isinstance(text, str) else []
    return f"; did you mean {guesses[0]!r}?" if guesses else ""


def brief(value: Any) -> str:
    """Describe a value for a message: itself if it is short and plain, else its type."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} with shape {value.shape}"
    if value is not None and not isinstance(value, (str, bytes, int, float, os.PathLike)):
        return type(value).__name__
    return short_repr(value)


def short_repr(value: Any) -> str:
    """Return the ``repr`` of a value, cut to the length that a message shows."""
    try:
        text = repr(value)
    except RecursionError:
        return type(value).__name__
    return text if len(text) <= MAX_SHOWN_LENGTH else text[:MAX_SHOWN_LENGTH] + "..."


def index_below(name: str, value: Any, count: int) -> int:
    """Return a whole number in 0..count-1, such as a pixel's column, or raise ``ValueError``."""
    return whole_number(name, value, 0, count - 1)


def whole_number(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number in low..high, or raise ``ValueError``; True and False are none."""
    try:
        number = low - 1 if isinstance(value, (bool, np.bool_)) else operator.index(value)
    except TypeError:
        number = low - 1
    if not low <= number <= high:
        raise ValueError(f"{name} must be a whole number in {low}..{high}, got {brief(value)}")
    return number


def thread_count(name: str, value: Any) -> int | None:
    """Return ``value`` if it is None or a whole number in 1..1024, or raise ``ValueError``."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise ValueError(f"{name} must be a whole number or None, got {short_repr(value)}")
    if not 1 <= value <= MAX_THREADS:
        raise ValueError(f"{name} must be in 1..{MAX_THREADS}, got {value!r}")
    return int(value)


def tiled_size(name: str, value: Any, subpixel_bits: int) -> tuple[int, int]:
    """
    Return ``(width, height)`` of a picture that is drawn in tiles, or raise ``ValueError``.

    Each is in 1..131072, or less on a grid of more than 9 sub-pixel bits: what is exact of a
    picture of 16384 pixels on the finest grid is exact of a larger one on a coarser grid.
    """
    width, height = picture_size(name, value)
    largest = MAX_UNITS // (1 << subpixel_bits) - MAX_SIZE
    if max(width, height) > largest:
        raise ValueError(
            f"{name} must be two whole numbers in 1..{largest} with {subpixel_bits} sub-pixel "
            f"bits, got {value!r}; quality.subpixel_bits below {subpixel_bits} allows more"
        )
    return width, height


def picture_size(name: str, value: Any) -> tuple[int, int]:
    """Return ``(width, height)`` of any picture, each in 1..131072, or raise ``ValueError``."""
    return _size_within(name, value, MAX_WHOLE_SIZE)


def image_size(name: str, value: Any) -> tuple[int, int]:
    """Return ``(width, height)`` in pixels, each in 1..16384, or raise ``ValueError``."""
    return _size_within(name, value, MAX_SIZE)


def _size_within(name: str, value: Any, largest: int) -> tuple[int, int]:
    """Return two whole numbers of pixels, each in 1..largest, or raise ``ValueError``."""
    if type(value) is tuple and len(value) == 2 and type(value[0]) is type(value[1]) is int:
        width, height = value
        if 1 <= width <= largest and 1 <= height <= largest:
            return value
    try:
        width, height = value
        if _has_masked(width) or _has_masked(height):
            raise TypeError
        sides = (int(width), int(height))
        is_whole = sides[0] == width and sides[1] == height
        if isinstance(value, (set, frozenset, dict)):
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        text = short_repr(value)
        raise ValueError(f"{name} must be (width, height) in pixels, got {text}") from None
    if not is_whole or not all(1 <= side <= largest for side in sides):
        raise ValueError(
            f"{name} must be two whole numbers in 1..{largest}, got {short_repr(value)}"
        )
    return sides


@contextmanager
def needs_extra(extra: str, need: str, error: type[Exception] = ImportError) -> Iterator[None]:
    """Name in the error of a missing package the extra of this one that brings it."""
    try:
        yield
    except ImportError as missing:
        raise error(f'{need}: pip install "rasterjit[{extra}]" ({missing})') from missing


def existing_file(name: str, value: Any) -> Path:
    """Return the path of a file that exists and is not empty, or raise ``ValueError``."""
    if not isinstance(value, (str, os.PathLike)):
        raise ValueError(f"{name} must be a file name, got {short_repr(value)}")
    path_name = os.fspath(value)
    try:
        file = Path(value).expanduser()
        if file.is_dir():
            raise ValueError(f"{name} must be a file, but {path_name!r} is a folder")
        if not file.exists():
            raise ValueError(f"{name} must be a file, but {path_name!r} does not exist")
        if not file.is_file():
            raise ValueError(f"{name} must be a file, but {path_name!r} is a pipe or a device")
        if file.stat().st_size == 0:
            raise ValueError(f"{name} must be a file with content, but {path_name!r} is empty")
    except (OSError, RuntimeError, TypeError) as error:
        raise ValueError(f"{name} must be a file, but {path_name!r} cannot be: {error}") from None
    return file


def existing_folder(name: str, value: Any) -> Path:
    """Return the path of a folder that exists, or raise ``ValueError``."""
    if not isinstance(value, (str, os.PathLike)):
        raise ValueError(f"{name} must be the name of a folder, got {short_repr(value)}")
    path_name = os.fspath(value)
    try:
        folder = Path(value).expanduser()
        if not folder.is_dir():
            raise ValueError(f"{name} must be a folder, but {path_name!r} is none")
    except (OSError, RuntimeError, TypeError) as error:
        raise ValueError(f"{name} must be a folder, but {path_name!r} cannot be: {error}") from None
    return folder
