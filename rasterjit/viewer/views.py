"""A view in numbers that are short, and as code: to be used again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rasterjit.scene.camera import PerspectiveCamera

DIGITS = 9
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
        eye, target = _rounded(camera.eye, camera.target)
        (up,) = _rounded(camera.up)
        return cls(eye, target, up, float(f"{camera.fov_y:.{DIGITS}g}"))


def camera_code(camera: PerspectiveCamera) -> str:
    """Return the call that makes a camera which sees the same; planes are left to rendering."""
    view = ShortView.of(camera)
    eye, target, up = map(_text, view[:3])
    fov_y = f"{view.fov_y:.{DIGITS}g}"
    return f"rj.PerspectiveCamera(eye=({eye}), target=({target}), up=({up}), fov_y={fov_y})"


def _text(place: Iterable[float]) -> str:
    return ", ".join(f"{part:.{DIGITS}g}" for part in place)


def _rounded(*places: Sequence[float]) -> list[list[float]]:
    """Return places with as many decimals as the largest coordinate needs."""
    largest = max(max(map(abs, place)) for place in places)
    _, exponent = f"{largest:e}".split("e")
    decimals = DIGITS - 1 - int(exponent)
    # What rounds to -0 becomes 0.
    return [[round(float(part), decimals) + 0.0 for part in place] for place in places]
