"""Every accuracy setting in one place."""

from __future__ import annotations

from dataclasses import dataclass

from rasterjit.validation import one_of

SAMPLES = (1, 2, 4, 8, 16, "area")
"""How edges are smoothed: so many samples of each pixel, or the areas that faces cover of it."""


@dataclass(frozen=True)
class Quality:
    """
    How accurately to render; ``dataclasses.replace`` changes single settings.

    Parameters
    ----------
    subpixel_bits : {0, 4, 8, 12}
        Vertices are rounded to ``2**-subpixel_bits`` pixel. 8 is what Direct3D requires and what
        Mesa's rasterizer uses; 0 rounds to whole pixels, as in the classic exercise.
    samples : {1, 2, 4, 8, 16, "area"}
        What smooths edges: the nearest faces at so many places of each pixel, those that Direct3D
        and Vulkan fix, or ``"area"``, the exact limit of ever more of them: the areas that faces
        show of it. Each face is shaded once in a pixel, at its centre, or on the face where the
        centre lies beside it. Colour is mixed in linear light, before tone mapping; all other
        outputs come from the pixel centre. ``"area"`` is not for scenes that show blended
        materials (``alpha_mode`` "blend" with an alpha below 1): rendering them raises
        ``ValueError``, naming an object that has one. Edges of the holes of an alpha mask are
        smoothed as all others with 2 to 16 samples, each of which has its own alpha; with
        ``"area"`` a face has one alpha in a pixel, at its centre, so they stay hard.

    Raises
    ------
    ValueError
        If a setting is not one of its levels.
    """

    subpixel_bits: int = 8
    samples: int | str = 1

    def __post_init__(self) -> None:
        bits = one_of("subpixel_bits", self.subpixel_bits, (0, 4, 8, 12))
        object.__setattr__(self, "subpixel_bits", int(bits))
        samples = one_of("samples", self.samples, SAMPLES)
        object.__setattr__(self, "samples", samples if samples == "area" else int(samples))
        if samples != 1 and bits == 0:
            raise ValueError(
                f"samples must be 1 where subpixel_bits is 0, got {samples!r}: vertices on whole "
                "pixels leave nothing to smooth"
            )

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
