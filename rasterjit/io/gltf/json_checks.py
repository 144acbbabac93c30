"""
Read values of glTF's JSON; errors name the key of a value of the wrong kind.

``null`` counts as what is not there where objects and lists are expected.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

_NUMBER_TYPES = frozenset((int, float))
"""Python types of numbers of JSON; ``bool`` is none."""

MAX_VALUE_LENGTH = 60
"""Most characters of a value in a message."""


def quote(value: Any) -> str:
    """Quote a value in a message: as JSON, shortened."""
    text = json.dumps(value, ensure_ascii=True, default=repr)
    return text if len(text) <= MAX_VALUE_LENGTH else text[:MAX_VALUE_LENGTH] + "..."


def require(values: dict[str, Any], key: str) -> Any:
    """Return the value of a required key, or raise ``ValueError``."""
    if key not in values:
        raise ValueError(f"{key} is missing")
    return values[key]


def get_object(values: dict[str, Any], key: str) -> dict[str, Any]:
    """Return the object of a key, empty if it is missing, or raise ``ValueError``."""
    value = values.get(key)
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ValueError(f"{key} must be an object, got {quote(value)}")
    return value


def get_extension(values: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the object of one extension of an entry, empty if missing, or raise ``ValueError``."""
    return get_object(get_object(values, "extensions"), name) if "extensions" in values else {}


def get_list(values: dict[str, Any], key: str) -> list[Any]:
    """Return the list of a key, empty if it is missing, or raise ``ValueError``."""
    value = [] if values.get(key) is None else values[key]
    if not isinstance(value, list):
        raise ValueError(f"{key} must be a list, got {quote(value)}")
    return value


def get_integer(values: dict[str, Any], key: str, default: int | None = None) -> int:
    """Return a non-negative integer, or raise ``ValueError``; it is required without a default."""
    value = require(values, key) if default is None else values.get(key, default)
    if not are_numbers((value,)) or value < 0 or value != math.floor(value):
        raise ValueError(f"{key} must be a whole number at least 0, got {quote(value)}")
    return int(value)


def get_clamped(
    values: dict[str, Any], key: str, default: float, maximum: float, minimum: float = 0.0
) -> float:
    """Return a number clamped to its range, or raise ``ValueError`` if it is no number."""
    value = values.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        raise ValueError(f"{key} must be a number, got {quote(value)}")
    return float(min(max(value, minimum), maximum))


def get_number(values: dict[str, Any], key: str, default: float | None = None) -> float:
    """Return a finite number, or raise ``ValueError``; it is required without a default."""
    value = require(values, key) if default is None else values.get(key, default)
    if not are_numbers((value,)):
        raise ValueError(f"{key} must be a finite number, got {quote(value)}")
    return float(value)


def get_numbers(values: dict[str, Any], key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return a tuple of finite numbers as long as the default, or raise ``ValueError``."""
    if key not in values:
        return default
    value = values[key]
    if not isinstance(value, (list, tuple)) or len(value) != len(default):
        raise ValueError(f"{key} must be {len(default)} numbers, got {quote(value)}")
    if not are_numbers(value):
        wrong = next(part for part in value if not are_numbers((part,)))
        raise ValueError(f"{key} must be {len(default)} finite numbers, got {quote(wrong)}")
    return tuple(map(float, value))


def get_clamped_numbers(
    values: dict[str, Any], key: str, default: tuple[float, ...], maximum: float
) -> tuple[float, ...]:
    """Return a tuple of numbers as long as the default, clamped to 0..maximum."""
    value = values.get(key, default)
    if not isinstance(value, (list, tuple)) or len(value) != len(default):
        raise ValueError(f"{key} must be {len(default)} numbers, got {quote(value)}")
    return tuple(get_clamped({key: part}, key, 0.0, maximum) for part in value)


def are_numbers(values: Sequence[Any]) -> bool:
    """Tell whether all values are numbers that are finite as float64."""
    try:
        return _NUMBER_TYPES.issuperset(map(type, values)) and all(map(math.isfinite, values))
    except OverflowError:
        return False
