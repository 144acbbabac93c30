"""How textures are read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rasterjit.compat.pyrender.constants import GLTF
from rasterjit.compat.pyrender.fields import Field, keep_any, to_text_or_none
from rasterjit.scene.validation import one_of

_WRAPS = {GLTF.REPEAT: "repeat", GLTF.CLAMP_TO_EDGE: "clamp", GLTF.MIRRORED_REPEAT: "mirror"}


@dataclass(eq=False, repr=False)
class Sampler:
    """
    How a texture is read; takes glTF's codes.

    Parameters
    ----------
    name : str, optional
    magFilter, minFilter : int, optional
        ``GLTF.NEAREST`` for both shows texels; all else is filtered trilinearly.
    wrapS, wrapT : int
        ``GLTF.REPEAT``, ``GLTF.CLAMP_TO_EDGE`` or ``GLTF.MIRRORED_REPEAT``; other codes are
        refused when the texture is drawn.
    """

    name: Field[str | None] = Field(to_text_or_none, "str or None: the sampler's name.", None)
    magFilter: Field[int | None] = Field(keep_any, "int or None: how texels are enlarged.", None)
    minFilter: Field[int | None] = Field(
        keep_any, "int or None: how texels are made smaller.", None
    )
    wrapS: Field[int] = Field(
        keep_any, "int: what lies beyond the left and right edge.", GLTF.REPEAT
    )
    wrapT: Field[int] = Field(
        keep_any, "int: what lies beyond the lower and upper edge.", GLTF.REPEAT
    )

    def convert(self) -> dict[str, Any]:
        """Return what RasterJIT's textures take, or raise ``ValueError`` of an unknown code."""
        is_nearest = self.magFilter == GLTF.NEAREST and self.minFilter in (None, GLTF.NEAREST)
        codes = [int(code) for code in _WRAPS]
        wraps = one_of("wrapS", self.wrapS, codes), one_of("wrapT", self.wrapT, codes)
        return {
            "wrap": tuple(_WRAPS[GLTF(wrap)] for wrap in wraps),
            "filter": "nearest" if is_nearest else "trilinear",
        }
