"""Turn the pictures of trimesh's materials into textures."""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.io.left_out import LeftOut
from rasterjit.io.pictures import image_pixels
from rasterjit.scene.texture import Texture

_PLACEHOLDER = (100, 100, 100, 255)
"""The colour of the 2×2 pixels that trimesh puts where a material has no picture."""


class TextureReader:
    """
    Read the pictures of trimesh's materials, each once for every use.

    They say nothing about sampling: they repeat, trilinear.

    Parameters
    ----------
    left_out : LeftOut
        Notes pictures that cannot be read.
    """

    def __init__(self, left_out: LeftOut) -> None:
        self._left_out = left_out
        self._known: dict[tuple[int, str], Texture | None] = {}

    def read(self, image: Any, label: str, color_space: str = "srgb") -> Texture | None:
        """Return a Pillow image as a texture; None if there is none to show."""
        if image is None or is_placeholder(image):
            return None
        key = id(image), color_space
        if key not in self._known:
            try:
                self._known[key] = Texture(image_pixels(image), color_space=color_space)
            except (OSError, SyntaxError, ValueError, AttributeError) as error:
                reason = " ".join(str(error).split())[:200]
                self._left_out.note(f"{label} that cannot be read: {reason}")
                self._known[key] = None
        return self._known[key]


def is_placeholder(image: Any) -> bool:
    """Tell trimesh's stand-in for a missing image from a real one."""
    try:
        pixels = np.asarray(image)
    except (OSError, SyntaxError):
        return False
    return pixels.shape == (2, 2, 4) and bool((pixels == _PLACEHOLDER).all())
