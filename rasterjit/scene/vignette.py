"""Vignette: darken the corners of a picture."""

from __future__ import annotations

from dataclasses import dataclass

from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.validation import bounded_number


@suggests_replace
@dataclass(frozen=True)
class Vignette:
    """
    Darken a picture towards its corners.

    It acts on the output ``"color"``, surfaces and background alike, below outlines and wireframe.
    The output ``"linear"`` stays the light of the scene. Light at distance r from the middle of
    the picture, where the corners have r = 1, is multiplied by ``1 - strength s(t)`` with
    ``t = (r - start) / (1 - start)`` in 0..1 and ``s(t) = t² (3 - 2 t)``.

    Parameters
    ----------
    strength : float
        Share of the light that the corners lose, 0..1.
    start : float
        Distance from the middle where darkening begins, 0..1.

    Raises
    ------
    ValueError
        If one of them is not in 0..1.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/teapot.obj")
    >>> scene.vignette = rj.Vignette(0.6)
    """

    strength: float = 0.5
    start: float = 0.3

    def __post_init__(self) -> None:
        for name in ("strength", "start"):
            store(self, **{name: bounded_number(name, getattr(self, name), 0.0, 1.0)})

    @property
    def is_neutral(self) -> bool:
        """Whether it changes nothing."""
        return self.strength == 0.0 or self.start == 1.0
