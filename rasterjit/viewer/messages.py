"""
What a page may say: moves of the pointer, the wheel, keys, its size, and what is to be seen how.

A message is a line of JSON from whoever reached the socket. Only what is listed here goes further,
made anew from the fields that are listed; numbers lie within bounds, and nothing else gets through.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from rasterjit.viewer import switches
from rasterjit.viewer.viewer import NAMES

LONGEST_MESSAGE = 16384
"""Bytes of one message; most of the page's own have some 100, a list of hidden objects more."""

FARTHEST = 1e6
"""Largest coordinate and turn of a wheel, pixels."""

LONGEST_KEY = 32
"""Characters of a key's name."""

Fields = dict[str, Callable[[Any], bool]]
"""Names, and what each must be."""

MODIFIERS = ("Alt", "Control", "Meta", "Shift")

MOST_BUTTONS = 8

LATEST = 1e12
"""Of all times, seconds."""

MOST_PIXELS = 3840 * 2160
"""Of a picture that a page asks for: a page on a larger screen stretches it."""

LONGEST_SIDE = 7680

LARGEST_NUMBER = 2**31 - 1
"""Of an object."""

LEAST_RATIO, LARGEST_RATIO = 0.1, 16.0
"""Pixels of a screen for one of a page."""

SHOWN = "shown"
"""That the page has shown a picture."""

MOST_LISTED = 1000
"""Objects that a page lists, and may hide."""

MOST_SWITCHED = 64
"""Effects that a page switches."""

FARTHEST_EYE = 1e15
"""Largest coordinate of a view, scene units."""

LEAST_FOV, LARGEST_FOV = 1e-3, 179.0
"""Vertical field of view, degrees."""


def read_message(text: Any, sent: int) -> dict[str, Any] | None:
    """
    Return a message of a page as it may go further; None for any other.

    Parameters
    ----------
    text : str
        What came; anything else is none.
    sent : int
        Number of the last picture that was sent to this page: it has shown no later one.
    """
    if not isinstance(text, str) or len(text) > LONGEST_MESSAGE:
        return None
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(said, dict) or not isinstance(kind := said.get("type"), str):
        return None
    if kind == "resize":
        return _size(said)
    if kind == SHOWN:
        fields: Fields = {"number": lambda number: _is_whole(number, 1, sent)}
    elif kind in FIELDS:
        fields = FIELDS[kind]
    else:
        return None
    if not all(name in said and allowed(said[name]) for name, allowed in fields.items()):
        return None
    return {"type": kind, **{name: said[name] for name in fields}}


def _size(said: dict[str, Any]) -> dict[str, Any] | None:
    """Return a new size; one with too many pixels becomes a smaller one of the same shape."""
    width, height, ratio = (said.get(name) for name in ("pwidth", "pheight", "ratio"))
    if not (_is_whole(width, 1, FARTHEST) and _is_whole(height, 1, FARTHEST)):
        return None
    if not _is_number(ratio, LEAST_RATIO, LARGEST_RATIO):
        return None
    share = min(1.0, math.sqrt(MOST_PIXELS / (width * height)), LONGEST_SIDE / max(width, height))
    width, height = (max(1, math.floor(side * share)) for side in (width, height))
    # Places in the page stay what they are.
    size = {"pwidth": width, "pheight": height, "ratio": ratio * share}
    return {"type": "resize", **size}


def _is_number(value: Any, low: float, high: float) -> bool:
    """Tell whether something is a number in a range; no number is none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and low <= value <= high


def _is_whole(value: Any, low: float, high: float) -> bool:
    """Tell whether something is a whole number in a range."""
    return isinstance(value, int) and _is_number(value, low, high)


def _is_place(value: Any) -> bool:
    return _is_number(value, -FARTHEST, FARTHEST)


def _is_button(value: Any) -> bool:
    return _is_whole(value, 0, MOST_BUTTONS)


def _are_buttons(value: Any) -> bool:
    return isinstance(value, list) and len(value) <= MOST_BUTTONS and all(map(_is_button, value))


def _are_modifiers(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) <= len(MODIFIERS)
        and all(isinstance(one, str) and one in MODIFIERS for one in value)
    )


def _is_key(value: Any) -> bool:
    return isinstance(value, str) and 1 <= len(value) <= LONGEST_KEY


def _is_point(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(_is_number(one, -FARTHEST_EYE, FARTHEST_EYE) for one in value)
    )


def _is_switched(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) <= MOST_SWITCHED
        and all(isinstance(one, str) and one in switches.KEYS.values() for one in value)
    )


def _are_modes(value: Any) -> bool:
    return isinstance(value, dict) and all(
        key in switches.MODED and (mode is None or _is_mode(key, mode))
        for key, mode in value.items()
    )


def _is_mode(key: str, mode: Any) -> bool:
    return isinstance(mode, str) and mode in switches.MODED[key].modes


def _is_object(value: Any) -> bool:
    return _is_whole(value, 0, LARGEST_NUMBER)


def _are_objects(value: Any) -> bool:
    return isinstance(value, list) and len(value) <= MOST_LISTED and all(map(_is_object, value))


_POINTER = {
    "x": _is_place, "y": _is_place, "button": _is_button, "buttons": _are_buttons,
    "modifiers": _are_modifiers,
}  # fmt: skip
_WHEEL = {
    "x": _is_place, "y": _is_place, "dx": _is_place, "dy": _is_place, "modifiers": _are_modifiers
}  # fmt: skip
_KEY = {"key": _is_key, "modifiers": _are_modifiers}

FIELDS: dict[str, Fields] = {
    "pointer_down": _POINTER, "pointer_move": _POINTER, "pointer_up": _POINTER, "wheel": _WHEEL,
    "key_down": _KEY, "key_up": _KEY,
    "pick": {"x": _is_place, "y": _is_place},
    "view": {
        "eye": _is_point, "target": _is_point, "up": _is_point,
        "fov_y": lambda angle: _is_number(angle, LEAST_FOV, LARGEST_FOV),
    },
    "look": {
        "kind": lambda kind: isinstance(kind, str) and kind in NAMES,
        "switched": _is_switched, "modes": _are_modes,
    },
    "visibility": {"hidden": _are_objects, "only": lambda one: one is None or _is_object(one)},
}  # fmt: skip
"""What viewers know, and which fields of what kind each has."""
