"""
The protocol between server and page: pictures, views as code, and messages of the page.

A message of a page is a line of JSON from whoever reached the socket. Only what is listed here goes
further, made anew from the fields that are listed; numbers lie within bounds, and nothing else gets
through: moves of the pointer, the wheel, keys, the size, and what is to be seen how.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.viewer import effect_switches
from rasterjit.viewer.viewer import KIND_NAMES

JPEG_QUALITY = 90
"""Of JPEG: of neighbouring pixels no colour is mixed."""


def encode_jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture, (H, W, 4) uint8, C-contiguous, as a JPEG file of its colours."""
    import simplejpeg

    return simplejpeg.encode_jpeg(picture, JPEG_QUALITY, "RGBA", "444", True)


SIGNIFICANT_DIGITS = 9
"""Of numbers: no pixel of a picture tells more."""


class ShortView(NamedTuple):
    """Where a camera stands and looks; coordinates end at the same digit."""

    eye: list[float]
    target: list[float]
    up: list[float]
    fov_y: float

    @classmethod
    def of(cls, camera: PerspectiveCamera) -> ShortView:
        """Return the view of a camera."""
        eye, target = _round_vectors(camera.eye, camera.target)
        (up,) = _round_vectors(camera.up)
        return cls(eye, target, up, float(f"{camera.fov_y:.{SIGNIFICANT_DIGITS}g}"))


def format_camera_code(camera: PerspectiveCamera) -> str:
    """Return the call that makes a camera which sees the same; planes are left to rendering."""
    view = ShortView.of(camera)
    eye, target, up = map(_format_vector, view[:3])
    fov_y = f"{view.fov_y:.{SIGNIFICANT_DIGITS}g}"
    return f"rj.PerspectiveCamera(eye=({eye}), target=({target}), up=({up}), fov_y={fov_y})"


def _format_vector(place: Iterable[float]) -> str:
    return ", ".join(f"{part:.{SIGNIFICANT_DIGITS}g}" for part in place)


def _round_vectors(*places: Sequence[float]) -> list[list[float]]:
    """Return places with as many decimals as the largest coordinate needs."""
    largest = max(max(map(abs, place)) for place in places)
    _, exponent = f"{largest:e}".split("e")
    decimals = SIGNIFICANT_DIGITS - 1 - int(exponent)
    # What rounds to -0 becomes 0.
    return [[round(float(part), decimals) + 0.0 for part in place] for place in places]


MAX_MESSAGE_BYTES = 16384
"""Most bytes of a message; most have some 100, a list of hidden objects more."""

MAX_COORDINATE = 1e6
"""Largest coordinate, and turn of a wheel, pixels."""

MAX_KEY_LENGTH = 32
"""Most characters of a key's name."""

Check = Callable[[Any], bool]
"""Function that tells whether a value is allowed."""

Fields = dict[str, Check]
"""Checks of a message's fields, by name."""

MODIFIERS = ("Alt", "Control", "Meta", "Shift")

MAX_BUTTONS = 8

MAX_TIME = 1e12
"""Largest time, seconds."""

MAX_PIXELS = 3840 * 2160
"""Most pixels of a picture: a page on a larger screen stretches it."""

MAX_SIDE = 7680

MAX_NUMBER = 2**31 - 1
"""Largest number of an object."""

MIN_RATIO, MAX_RATIO = 0.1, 16.0
"""Range of device pixel ratios."""

SHOWN = "shown"
"""Type of the message that a picture was displayed."""

MAX_LISTED = 1000
"""Most objects that a page lists, and may hide."""

MAX_SWITCHED = 64
"""Most effects that a page switches."""

MAX_VIEW_COORDINATE = 1e15
"""Largest coordinate of a view, scene units."""

MIN_FOV, MAX_FOV = 1e-3, 179.0
"""Range of the vertical field of view, degrees."""


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
    if not isinstance(text, str) or len(text) > MAX_MESSAGE_BYTES:
        return None
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or not isinstance(kind := content.get("type"), str):
        return None
    if kind == "resize":
        return _fit_size(content)
    if kind == SHOWN:
        fields: Fields = {"number": integer_in(1, sent)}
    elif kind in FIELDS:
        fields = FIELDS[kind]
    else:
        return None
    if not all(name in content and allowed(content[name]) for name, allowed in fields.items()):
        return None
    return {"type": kind, **{name: content[name] for name in fields}}


def _fit_size(content: dict[str, Any]) -> dict[str, Any] | None:
    """Return a new size; one with too many pixels becomes a smaller one of the same shape."""
    width, height, ratio = (content.get(name) for name in ("pwidth", "pheight", "ratio"))
    if not all(map(integer_in(1, MAX_COORDINATE), (width, height))):
        return None
    if not number_in(MIN_RATIO, MAX_RATIO)(ratio):
        return None
    share = min(1.0, math.sqrt(MAX_PIXELS / (width * height)), MAX_SIDE / max(width, height))
    width, height = (max(1, math.floor(side * share)) for side in (width, height))
    # Places in the page stay what they are.
    size = {"pwidth": width, "pheight": height, "ratio": ratio * share}
    return {"type": "resize", **size}


def number_in(low: float, high: float) -> Check:
    """Return a check of numbers in a range; ``bool`` is no number."""
    return lambda value: (
        isinstance(value, (int, float)) and not isinstance(value, bool) and low <= value <= high
    )


def integer_in(low: float, high: float) -> Check:
    """Return a check of integers in a range."""
    in_range = number_in(low, high)
    return lambda value: isinstance(value, int) and in_range(value)


def word_in(known: Collection[str]) -> Check:
    """Return a check of known words."""
    return lambda value: isinstance(value, str) and value in known


def list_of(allowed: Check, most: int, least: int = 0) -> Check:
    """Return a check of lists by their length and elements."""
    return lambda value: (
        isinstance(value, list) and least <= len(value) <= most and all(map(allowed, value))
    )


def _are_modes(value: Any) -> bool:
    """Tell whether something is a mode, or None, for each of some effects."""
    return isinstance(value, dict) and all(
        key in effect_switches.MODAL_EFFECTS
        and (mode is None or word_in(effect_switches.MODAL_EFFECTS[key].modes)(mode))
        for key, mode in value.items()
    )


_PIXEL, _OBJECT = number_in(-MAX_COORDINATE, MAX_COORDINATE), integer_in(0, MAX_NUMBER)
_BUTTON, _MODIFIERS = integer_in(0, MAX_BUTTONS), list_of(word_in(MODIFIERS), len(MODIFIERS))
_POINT = list_of(number_in(-MAX_VIEW_COORDINATE, MAX_VIEW_COORDINATE), 3, 3)
_POINTER = {
    "x": _PIXEL, "y": _PIXEL, "button": _BUTTON, "buttons": list_of(_BUTTON, MAX_BUTTONS),
    "modifiers": _MODIFIERS,
}  # fmt: skip
_WHEEL = {"x": _PIXEL, "y": _PIXEL, "dx": _PIXEL, "dy": _PIXEL, "modifiers": _MODIFIERS}
_KEY = {
    "key": lambda value: isinstance(value, str) and 1 <= len(value) <= MAX_KEY_LENGTH,
    "modifiers": _MODIFIERS,
}

FIELDS: dict[str, Fields] = {
    "pointer_down": _POINTER, "pointer_move": _POINTER, "pointer_up": _POINTER, "wheel": _WHEEL,
    "key_down": _KEY, "key_up": _KEY,
    "pick": {"x": _PIXEL, "y": _PIXEL},
    "view": {
        "eye": _POINT, "target": _POINT, "up": _POINT, "fov_y": number_in(MIN_FOV, MAX_FOV),
    },
    "look": {
        "kind": word_in(KIND_NAMES), "modes": _are_modes,
        "switched": list_of(word_in(effect_switches.EFFECT_KEYS.values()), MAX_SWITCHED),
    },
    "visibility": {
        "hidden": list_of(_OBJECT, MAX_LISTED), "only": lambda one: one is None or _OBJECT(one),
    },
}  # fmt: skip
"""Checks of the fields of each type of message."""
