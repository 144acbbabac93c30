"""A camera as code, to be used again."""

from __future__ import annotations

from collections.abc import Sequence

from rasterjit.scene.camera import PerspectiveCamera

DIGITS = 9
"""Of each number: no pixel of a picture tells more."""


def camera_code(camera: PerspectiveCamera) -> str:
    """Return the call that makes a camera which sees the same; planes are left to rendering."""
    places = ", ".join(
        f"{name}=({_text(getattr(camera, name))})" for name in ("eye", "target", "up")
    )
    return f"rj.PerspectiveCamera({places}, fov_y={camera.fov_y:.{DIGITS}g})"


def _text(place: Sequence[float]) -> str:
    return ", ".join(f"{part:.{DIGITS}g}" for part in rounded(place))


def rounded(place: Sequence[float]) -> list[float]:
    """Return a place whose coordinates have as many digits as the largest one needs."""
    largest = max(map(abs, place))
    if largest == 0.0:
        return [0.0, 0.0, 0.0]
    decimals = DIGITS - 1 - int(f"{largest:e}".partition("e")[2])
    # What rounds to -0 becomes 0.
    return [round(part, decimals) + 0.0 for part in place]
