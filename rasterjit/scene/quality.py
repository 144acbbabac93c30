"""Every accuracy setting in one place."""

from __future__ import annotations

from dataclasses import dataclass

from rasterjit.validation import one_of


@dataclass(frozen=True)
class Quality:
    """
    How accurately to render; ``dataclasses.replace`` changes single settings.

    Parameters
    ----------
    subpixel_bits : {0, 4, 8, 12}
        Vertices are rounded to ``2**-subpixel_bits`` pixel. 8 is what Direct3D requires and what
        Mesa's rasterizer uses; 0 rounds to whole pixels, as in the classic exercise.

    Raises
    ------
    ValueError
        If a setting is not one of its levels.
    """

    subpixel_bits: int = 8

    def __post_init__(self) -> None:
        bits = one_of("subpixel_bits", self.subpixel_bits, (0, 4, 8, 12))
        object.__setattr__(self, "subpixel_bits", int(bits))

    @classmethod
    def standard(cls) -> Quality:
        """Return the default settings."""
        return cls()


def check_quality(value: Quality | None) -> Quality:
    """Return ``value``, or the standard for ``None``; raise ``ValueError`` for anything else."""
    if value is None:
        return Quality.standard()
    if not isinstance(value, Quality):
        raise ValueError(f"quality must be a rasterjit.Quality, got {type(value).__name__}")
    return value
