"""
Read values of glTF's JSON: what is not of the kind that it must be is named by its key.

``null`` counts as what is not there where objects and lists are expected.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

_PLAIN = frozenset((int, float))
"""What numbers of JSON are in Python; a truth value is neither."""

LONGEST_SHOWN = 60
"""Characters of a value that a message shows."""


def shown(value: Any) -> str:
    """Return a value as it stands in the file, in short."""
    text = json.dumps(value, ensure_ascii=True, default=repr)
    return text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "..."


def needed(values: dict[str, Any], key: str) -> Any:
    """Return a value that has to be there, or raise ``ValueError``."""
    if key not in values:
        raise ValueError(f"{key} is missing")
    return values[key]


def object_of(values: dict[str, Any], key: str) -> dict[str, Any]:
    """Return an object of JSON, empty if there is none, or raise ``ValueError``."""
    value = values.get(key)
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ValueError(f"{key} must be an object, got {shown(value)}")
    return value


def extension_of(values: dict[str, Any], name: str) -> dict[str, Any]:
    """Return what an extension says of an entry, empty if nothing, or raise ``ValueError``."""
    return object_of(object_of(values, "extensions"), name) if "extensions" in values else {}


def list_of(values: dict[str, Any], key: str) -> list[Any]:
    """Return a list of JSON, empty if there is none, or raise ``ValueError``."""
    value = [] if values.get(key) is None else values[key]
    if not isinstance(value, list):
        raise ValueError(f"{key} must be a list, got {shown(value)}")
    return value


def whole_of(values: dict[str, Any], key: str, default: int | None = None) -> int:
    """Return a whole number at least 0, or raise ``ValueError``; without a default it is needed."""
    value = needed(values, key) if default is None else values.get(key, default)
    if not are_numbers((value,)) or value < 0 or value != math.floor(value):
        raise ValueError(f"{key} must be a whole number at least 0, got {shown(value)}")
    return int(value)


def number_of(
    values: dict[str, Any], key: str, default: float, most: float, least: float = 0.0
) -> float:
    """Return a number held within its range; what is not one raises ``ValueError``."""
    value = values.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        raise ValueError(f"{key} must be a number, got {shown(value)}")
    return float(min(max(value, least), most))


def finite_of(values: dict[str, Any], key: str, default: float | None = None) -> float:
    """Return a finite number, or raise ``ValueError``; without a default it has to be there."""
    value = needed(values, key) if default is None else values.get(key, default)
    if not are_numbers((value,)):
        raise ValueError(f"{key} must be a finite number, got {shown(value)}")
    return float(value)


def finite_numbers_of(
    values: dict[str, Any], key: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    """Return as many finite numbers as the default has, or raise ``ValueError``."""
    if key not in values:
        return default
    value = values[key]
    if not isinstance(value, (list, tuple)) or len(value) != len(default):
        raise ValueError(f"{key} must be {len(default)} numbers, got {shown(value)}")
    if not are_numbers(value):
        wrong = next(part for part in value if not are_numbers((part,)))
        raise ValueError(f"{key} must be {len(default)} finite numbers, got {shown(wrong)}")
    return tuple(map(float, value))


def are_numbers(values: Sequence[Any]) -> bool:
    """Tell whether all values are numbers that float64 holds."""
    try:
        return _PLAIN.issuperset(map(type, values)) and all(map(math.isfinite, values))
    except OverflowError:
        return False
