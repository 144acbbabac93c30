"""Decide which objects are transparent, and which layers and samples a pixel has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.node import Node
from rasterjit.scene.quality import Quality
from rasterjit.survey.object_counts import describe_count


class PixelLayers(NamedTuple):
    """Samples and transparent layers of a pixel, and how they are blended."""

    is_blended: NDArray[np.uint8]
    """(O,): 1 for each transparent object."""
    has_blended: bool
    samples: int | str
    """Samples of each pixel, or ``"area"``."""
    most: int | None = None
    """Largest number of transparent layers of a sample, nearest first; ``None`` -> all."""
    blends_srgb8: bool = False
    """Whether colours are blended as 8-bit sRGB codes, not in linear light."""
    in_order: bool = False
    """Whether a face is visible through another only if it was drawn before, as in OpenGL."""
    at_centers: bool = False
    """Whether faces are shaded at the pixel's centre even if it lies off them, as in OpenGL."""


class Transparency(NamedTuple):
    """The transparent objects."""

    is_blended: NDArray[np.uint8]
    """(O,): 1 for each transparent object that may be in view."""
    used: bool
    reason: str

    def equals(self, other: Transparency) -> bool:
        """Tell whether the transparent objects are the same."""
        is_same = np.array_equal(self.is_blended, other.is_blended)
        return is_same and (self.used, self.reason) == (other.used, other.reason)


NO_TRANSPARENCY = Transparency(np.empty(0, np.uint8), False, "")


def find_transparency(
    nodes: Sequence[Node],
    shades: bool,
    is_any_blended: bool,
    is_see_through: NDArray[np.bool_],
    in_view: NDArray[np.bool_],
) -> Transparency:
    """
    Decide which objects are blended.

    Parameters
    ----------
    nodes : sequence of Node
    shades : bool
        Whether the colour of faces is an output.
    is_any_blended : bool
        Whether any material is blended.
    is_see_through, in_view : (O,) bool
        Which objects are transparent, and which may be in view.
    """
    is_blended = np.zeros(len(nodes), np.uint8)
    if not is_any_blended:
        return Transparency(is_blended, False, "no material is blended")
    if not shades:
        return Transparency(is_blended, False, "nothing is shaded")
    object_count = np.count_nonzero(is_see_through)
    if object_count == 0:
        return Transparency(is_blended, False, "every blended surface has alpha 1")
    visible = is_see_through & in_view
    if not visible.any():
        name = nodes[int(is_see_through.argmax())].name
        others = f" and {object_count - 1} others lie" if object_count > 1 else " lies"
        return Transparency(is_blended, False, f"object {name!r}{others} outside the view")
    reason = describe_count(int(np.count_nonzero(visible)), int(object_count), "blended object")
    return Transparency(visible.astype(np.uint8), True, reason)


def choose_pixel_layers(
    transparency: Transparency,
    antialiases: bool,
    samples: int | str,
    nodes: Sequence[Node],
    quality: Quality,
) -> PixelLayers | None:
    """
    Return the samples and layers of pixels; ``None`` for one opaque sample.

    Reads from the quality only the number of layers, and the blending space.

    Raises
    ------
    ValueError
        If samples is ``"area"`` and an object is blended; names the object.
    """
    if not transparency.used and not antialiases:
        return None
    if transparency.used and samples == "area":
        number = int(transparency.is_blended.argmax())
        name, place = nodes[number].name, f"object {number}"
        raise ValueError(
            "quality.samples must be 1, 2, 4, 8 or 16 where a material is blended, got 'area' and "
            f"{place if name == place else f'{name!r} ({place})'} with alpha_mode 'blend'"
        )
    # Of several pictures, each has one sample.
    pixel_samples = samples if antialiases else 1
    max_layers = None if quality.transparency_layers == "all" else int(quality.transparency_layers)
    blends_srgb8 = quality.blending == "srgb8"
    return PixelLayers(
        transparency.is_blended, transparency.used, pixel_samples, max_layers, blends_srgb8
    )


def describe_blending(quality: Quality) -> str:
    """Describe the space in which colours are blended, if it is not linear light."""
    return ", mixed in 8-bit sRGB codes" if quality.blending == "srgb8" else ""
