"""Fog: hides surfaces with their distance from the eye."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from rasterjit.scene.attribute_guard import Converted, store, suggests_replace
from rasterjit.scene.color import RGB, ColorLike, rgb
from rasterjit.scene.validation import bounded_number, finite_number, one_of

FogMode: TypeAlias = Literal["linear", "exp", "exp2"]
FOG_MODES: tuple[FogMode, ...] = get_args(FogMode)
"""Transmittance at a distance d: (end - d) / (end - start); e^-(density d); e^-(density d)²."""

MAX_DENSITY = 1e9
"""Largest density and falloff, per scene unit."""

MAX_LENGTH = 1e18
"""Largest distance and height, scene units: their squares are finite in float32."""


MIN_RAMP = 1e-18
"""Least distance from start to end, scene units: its inverse is finite in float32."""


@suggests_replace
@dataclass(frozen=True)
class Fog:
    """
    Fog between the eye and all surfaces; the background is not covered: give it the fog's colour.

    A surface at the distance d shows a share f of its own colour and 1 - f of the fog's, in linear
    light. The distance is measured from the eye straight to the surface, in scene units; for a
    parallel projection, which has no eye point, from the camera's plane along the line of sight.

    - ``"linear"``: f = (end - d) / (end - start), clamped to 0..1.
    - ``"exp"``: f = exp(-density d).
    - ``"exp2"``: f = exp(-(density d)²).

    With a ``height``, mode ``"exp"`` has fog that thins out upwards: at world height y it has the
    density ``density * exp(-falloff (y - height))``, and f is the exponential of minus the exact
    integral of that along the ray.

    Parameters
    ----------
    color : str or array_like
        Any colour, as `types.ColorLike` has it; stored as linear RGB, alpha dropped.
    mode : {"exp2", "exp", "linear"}
    start, end : float, scene units
        Mode linear alone: distances at which the fog begins, and where it hides everything.
    density : float, per scene unit
        Modes exp and exp2; at least 0.
    height : float, scene units, optional
        World y at which the fog has its density; mode exp alone.
    falloff : float, per scene unit
        With a height: how fast the fog thins out upwards, above 0.

    Raises
    ------
    ValueError
        Naming the field: the mode is unknown, a distance is negative or not finite, ``end`` is not
        above ``start`` by 1e-18 at least, the density is negative, or a field is missing that the
        mode needs or given that it has no use for.
    """

    color: Converted[ColorLike, RGB] = Converted("#b4bec8")
    mode: FogMode = "exp2"
    start: float | None = None
    end: float | None = None
    density: float | None = None
    height: float | None = None
    falloff: float | None = None

    def __post_init__(self) -> None:
        one_of("mode", self.mode, FOG_MODES)
        store(self, color=rgb("color", self.color))
        if self.mode == "linear":
            self._refuse("density", "height", "falloff")
            self._check_range()
        else:
            self._refuse("start", "end")
            self._check_density()

    def _refuse(self, *names: str) -> None:
        """Raise ``ValueError`` for a field that the mode does not read."""
        for name in names:
            value = getattr(self, name)
            if value is not None:
                raise ValueError(
                    f"{name} must be None for fog of mode {self.mode!r}, got {value!r}"
                )

    def _check_range(self) -> None:
        """Store start and end as floats."""
        start = bounded_number("start", 0.0 if self.start is None else self.start, 0.0, MAX_LENGTH)
        if self.end is None:
            raise ValueError("end must be given for mode 'linear', got None")
        end = bounded_number("end", self.end, 0.0, MAX_LENGTH)
        if not end > start:
            raise ValueError(f"end must be above start, {start!r}; got {end!r}")
        if end - start < MIN_RAMP:
            raise ValueError(
                f"end must be at least {MIN_RAMP:g} above start, {start!r}; got {end!r}"
            )
        store(self, start=start, end=end)

    def _check_density(self) -> None:
        """Store density, height and falloff as floats."""
        if self.density is None:
            raise ValueError(f"density must be given for mode {self.mode!r}, got None")
        store(self, density=bounded_number("density", self.density, 0.0, MAX_DENSITY))
        if self.height is None:
            if self.falloff is not None:
                raise ValueError(
                    f"falloff must be None for fog without height, got {self.falloff!r}"
                )
            return
        if self.mode != "exp":
            raise ValueError(f"height must be None for mode 'exp2', got {self.height!r}")
        height = finite_number("height", self.height)
        store(self, height=bounded_number("height", height, -MAX_LENGTH, MAX_LENGTH))
        if self.falloff is None:
            raise ValueError("falloff must be given for fog with a height, got None")
        falloff = bounded_number("falloff", self.falloff, 0.0, MAX_DENSITY)
        if falloff == 0.0:
            raise ValueError("falloff must be above 0; fog of even density has no height")
        store(self, falloff=falloff)
