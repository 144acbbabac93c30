"""Check arguments: errors name the argument, its value and what was expected."""

from __future__ import annotations

import math
import operator
import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.attribute_guard import similar_names
from rasterjit.scene.vectors import cross, dot

T = TypeVar("T")

MAX_SIZE = 16384
"""Largest side of an image that is drawn at once, pixels: edge functions are exact up to it."""

MAX_TILED_SIZE = 1 << 17
"""Largest side of an image that is drawn in tiles, pixels."""

MAX_GRID_UNITS = 1 << 27
"""Largest width of an image and its guard bands, units of the sub-pixel grid; see ``setup``."""

_MATRIX_SIZE = 16
"""Entries of a 4x4 matrix."""

_FLOAT64 = np.dtype(np.float64)
"""The dtype of most arrays of numbers: one object, which `is` compares faster than `==`."""

_ARRAY_ERRORS = (TypeError, ValueError, OverflowError, MemoryError)
"""Exceptions that NumPy raises for values that it cannot make an array of."""

ROWS_WORDING = "an array of numbers", "rows of unequal length"
"""What `unmasked_array` says was expected and given, where a value is likely a list of rows."""

MAX_SHOWN_LENGTH = 80
"""Most characters of a value that a message shows."""

MAX_THREADS = 1024
"""Most threads a render takes: more than processors in one machine, and few enough to start."""

MAX_ROTATION_ERROR = 1e-3
"""By how much the columns of a rotation may differ from unit length and right angles: float32
poses that were multiplied many times are within it, scaled or mirrored ones are not."""


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
    """Return a number as the caller wrote it, for a message: 10, not 10.0."""
    return value if type(value) is int else number


def unmasked_array(
    name: str, value: Any, expected: str = "an array", got: str | None = None
) -> NDArray[Any]:
    """
    Return ``value`` as a NumPy array, not of a subclass.

    Errors say what was ``expected``, and what was given instead: ``got``, or the value.

    Raises
    ------
    MaskedError
        If entries are masked.
    ValueError
        If NumPy cannot make an array of it, such as of rows of unequal length.
    """
    if _is_masked_array(value):
        count = int(np.count_nonzero(value.mask))
        if count:
            raise MaskedError(
                f"{name} must have no masked entries, got {count} of {value.size}; its method "
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
    """Return a masked array of real numbers with NaN where it is masked; other values as given."""
    if not _is_masked_array(value) or value.dtype.kind not in "buif":
        return value
    return value.astype(np.float64).filled(np.nan)


def _is_masked_array(value: Any) -> bool:
    """Tell whether a value is a masked array, without importing `numpy.ma`."""
    # The module may be incomplete: another thread may be importing it.
    masked_array = getattr(sys.modules.get("numpy.ma"), "MaskedArray", None)
    return masked_array is not None and isinstance(value, masked_array)


class MaskedError(ValueError):
    """An array has masked entries where each must be a number."""


def number_array(name: str, value: ArrayLike, kinds: str = "buif") -> NDArray[np.float64]:
    """
    Return numbers as an aligned float64 array, NaN and infinity allowed, or raise ``ValueError``.

    ``kinds`` are the codes, `numpy.dtype.kind`, of the types that are allowed.
    """
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
    if array.shape != expected and not _fits_shape(array, expected):
        text = ", ".join("n" if length is None else str(length) for length in expected)
        raise ValueError(f"{name} must have shape ({text}), got {array.shape}")
    if not _is_finite(array):
        count = int((~np.isfinite(array)).sum())
        text = f": {array.tolist()}" if array.size <= 16 else ""
        raise ValueError(f"{name} must be finite, got {count} NaN or infinite entries{text}")
    return array


def _fits_shape(array: NDArray[Any], shape: tuple[int | None, ...]) -> bool:
    """Tell whether an array has a shape in which None stands for any length."""
    return array.ndim == len(shape) and all(
        expected is None or length == expected
        for length, expected in zip(array.shape, shape, strict=True)
    )


def _is_finite(array: NDArray[np.float64]) -> bool:
    """Tell whether all entries are finite; a matrix takes 1 microsecond here, and 3 in NumPy."""
    if array.size <= _MATRIX_SIZE:
        numbers = array.ravel().tolist()
        # A finite sum proves it; an infinite one may come of large numbers.
        return math.isfinite(sum(numbers)) or all(map(math.isfinite, numbers))
    return bool(np.isfinite(array).all())


def align(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array if its address is aligned, as kernels need it; else a copy."""
    return array if array.flags.aligned else array.copy()


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view that cannot be made writable: the array itself becomes read-only, too."""
    # Arrays that were pickled may be at any address.
    array = align(array)
    array.setflags(write=False)
    return array.view()


VectorLike: TypeAlias = Sequence[float] | NDArray[Any]
"""Three numbers, as fields accept them that store a tuple."""


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
    """Raise ``ValueError`` unless a (3, 3) matrix is a rotation."""
    (a, b, c) = (matrix[:, k].tolist() for k in range(3))
    lengths = [dot(a, a) - 1.0, dot(b, b) - 1.0, dot(c, c) - 1.0]
    angles = [dot(a, b), dot(b, c), dot(c, a)]
    if max(map(abs, lengths + angles)) > MAX_ROTATION_ERROR or dot(cross(a, b), c) <= 0.0:
        raise ValueError(
            f"{name} must hold a rotation, neither scaled nor mirrored, got {matrix.tolist()}"
        )


def boolean(name: str, value: Any) -> bool:
    """Return ``value`` as a bool, or raise ``ValueError``, also for 1 and 0."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} must be True or False, got {brief(value)}")
    return bool(value)


def string(name: str, value: Any) -> str:
    """Return ``value`` if it is a string, or raise ``ValueError``."""
    if not isinstance(value, str):
        raise ValueError(f"{name} must be a string, got {brief(value)}")
    return value


def instance_of(name: str, value: Any, expected: type[T]) -> T:
    """Return ``value`` if it is an instance of a class, or raise ``ValueError``."""
    if not isinstance(value, expected):
        article = "an" if expected.__name__[0] in "AEIO" else "a"
        raise ValueError(f"{name} must be {article} {expected.__name__}, got {brief(value)}")
    return value


def strings(name: str, value: Any) -> tuple[str, ...]:
    """Return strings as a tuple, or raise ``ValueError``, also for a single string."""
    return tuple(string(f"each of {name}", item) for item in sequence(name, value))


def sequence(name: str, value: Any) -> tuple[Any, ...]:
    """Return the items of a sequence or iterator; raise ``ValueError`` for others and strings."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        return tuple(value)
    except (TypeError, MemoryError):
        # Memory: its ``__len__`` may be too large.
        raise ValueError(f"{name} must be a sequence, got {brief(value)}") from None


def is_infinite(value: Any) -> bool:
    """Tell whether ``value``, of any type, is positive infinity."""
    return isinstance(value, (float, np.floating)) and value == math.inf


def one_of(name: str, value: Any, choices: Collection[Any]) -> Any:
    """Return ``value`` if it is one of ``choices``, or raise ``ValueError`` listing them."""
    if type(value) is str and value in choices:
        return value
    # Of other types, True and 8.0 equal numbers, and arrays cannot be compared.
    candidates = [choice for choice in choices if _has_type_of(value, choice)]
    if not candidates or value not in candidates:
        options = ", ".join(map(repr, choices)) or "the choices, of which there are none"
        raise ValueError(
            f"{name} must be one of {options}; got {short_repr(value)}{suggest(value, choices)}"
        )
    return value


def _has_type_of(value: Any, choice: Any) -> bool:
    """Tell whether a value has the type of a choice: int includes NumPy's integers, but no bool."""
    if isinstance(choice, int):
        return isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    return isinstance(value, type(choice))


def suggest(text: Any, choices: Iterable[Any]) -> str:
    """Return "; did you mean 'x'?" for text that is similar to a choice, else an empty string."""
    names = [name for name in choices if isinstance(name, str)]
    guesses = similar_names(text, names) if isinstance(text, str) else []
    return f"; did you mean {guesses[0]!r}?" if guesses else ""


def brief(value: Any) -> str:
    """Describe a value for a message: a plain one by its `repr`, others by their type."""
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
    """Return an index in 0..count-1, such as a pixel's column, or raise ``ValueError``."""
    return whole_number(name, value, 0, count - 1)


def whole_number(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number in low..high, or raise ``ValueError``, also for True and False."""
    try:
        number = None if isinstance(value, (bool, np.bool_)) else operator.index(value)
    except TypeError:
        number = None
    if number is None or not low <= number <= high:
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

    Each is in 1..131072 pixels, or less with more than 9 sub-pixel bits: edge functions are exact
    up to a number of units of the sub-pixel grid.
    """
    width, height = picture_size(name, value)
    largest = MAX_GRID_UNITS // (1 << subpixel_bits) - MAX_SIZE
    if max(width, height) > largest:
        raise ValueError(
            f"{name} must be two whole numbers in 1..{largest} with {subpixel_bits} sub-pixel "
            f"bits, got {value!r}; quality.subpixel_bits below {subpixel_bits} allows more"
        )
    return width, height


def picture_size(name: str, value: Any) -> tuple[int, int]:
    """Return ``(width, height)`` in pixels, each in 1..131072, or raise ``ValueError``."""
    return _size_within(name, value, MAX_TILED_SIZE)


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
        if isinstance(value, (set, frozenset, dict)) or _has_masked(width) or _has_masked(height):
            raise TypeError
        sides = (int(width), int(height))
        is_whole = sides[0] == width and sides[1] == height
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
    """
    Turn the ``ImportError`` of a missing package into one that says which extra installs it.

    ``need`` begins the message: what needs the package. ``error`` is the type that is raised.
    """
    try:
        yield
    except ImportError as missing:
        raise error(f'{need}: pip install "rasterjit[{extra}]" ({missing})') from missing


def existing_file(name: str, value: Any) -> Path:
    """Return the path of a file that exists and is not empty, or raise ``ValueError``."""
    return _existing_path(name, value, "a file", "a file name", _find_file_fault)


def existing_folder(name: str, value: Any) -> Path:
    """Return the path of a folder that exists, or raise ``ValueError``."""
    return _existing_path(name, value, "a folder", "the name of a folder", _find_folder_fault)


def _existing_path(
    name: str, value: Any, kind: str, kind_of_name: str, find_fault: Callable[[Path], str]
) -> Path:
    """Return a path without a fault, ``~`` expanded, or raise ``ValueError``."""
    if not isinstance(value, (str, os.PathLike)):
        raise ValueError(f"{name} must be {kind_of_name}, got {short_repr(value)}")
    try:
        path = Path(value).expanduser()
        fault = find_fault(path)
    except (OSError, RuntimeError, TypeError) as error:
        fault = f"cannot be: {error}"
    if fault:
        raise ValueError(f"{name} must be {kind}, but {os.fspath(value)!r} {fault}")
    return path


def _find_file_fault(path: Path) -> str:
    """Say why a path is not a file with content; an empty string if it is."""
    if path.is_dir():
        return "is a folder"
    if not path.exists():
        return "does not exist"
    if not path.is_file():
        return "is a pipe or a device"
    return "is empty" if path.stat().st_size == 0 else ""


def _find_folder_fault(path: Path) -> str:
    """Say why a path is not a folder; an empty string if it is."""
    if path.is_dir():
        return ""
    return "is not a folder" if path.exists() else "does not exist"
