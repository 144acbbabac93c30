"""Turn the pictures of trimesh's materials into textures, sampled as the file says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rasterjit.io.left_out import LeftOut
from rasterjit.scene.texture import Texture

SAMPLED_AS_THEY_ARE = ("L", "LA", "RGB", "RGBA", "I;16")
"""Pillow's kinds of picture that lie in memory as `Texture` takes them; others become RGBA."""

_PLACEHOLDER = (100, 100, 100, 255)
"""The colour of the 2×2 pixels that trimesh puts where a material has no picture."""

_GLTF_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_GLTF_NEAREST, _GLTF_LINEAR = 9728, 9729
"""Numbers of OpenGL, which glTF samplers use."""


class TextureReader:
    """
    Read the pictures of a file, each once for every way it is sampled.

    Parameters
    ----------
    samplers : mapping of str or None to dict
        By the name of a material, what `Texture` is given besides the picture.
    left_out : LeftOut
        Notes pictures that cannot be read.
    """

    def __init__(self, samplers: Mapping[str | None, dict[str, Any]], left_out: LeftOut) -> None:
        self._samplers = samplers
        self._left_out = left_out
        self._known: dict[tuple, Texture | None] = {}

    def read(self, image: Any, material: str | None) -> Texture | None:
        """
        Return a Pillow image as the texture of a material; None if there is none to show.

        OBJ files and trimesh's placeholders say nothing about sampling: they repeat, trilinear.
        """
        if image is None or is_placeholder(image):
            return None
        options = self._samplers.get(material, {})
        key = (id(image), *options.items())
        if key not in self._known:
            try:
                pixels = image if image.mode in SAMPLED_AS_THEY_ARE else image.convert("RGBA")
                self._known[key] = Texture(np.asarray(pixels), **options)
            except (OSError, SyntaxError, ValueError, AttributeError):
                self._left_out.note("texture image that cannot be read")
                self._known[key] = None
        return self._known[key]


def is_placeholder(image: Any) -> bool:
    """Tell trimesh's stand-in for a missing image from a real one."""
    try:
        pixels = np.asarray(image)
    except (OSError, SyntaxError):
        return False
    return pixels.shape == (2, 2, 4) and bool((pixels == _PLACEHOLDER).all())


def gltf_samplers(header: dict[str, Any], left_out: LeftOut) -> dict[str | None, dict[str, Any]]:
    """
    Return how glTF materials sample their base colour, by name, which trimesh does not tell.

    A name that stands for materials that differ is left to the defaults. A magnification filter
    NEAREST is taken as ``"nearest"``, a minification filter without mip levels as ``"bilinear"``.
    """
    found: dict[str | None, dict[str, Any]] = {}
    unclear: set[str | None] = set()
    for material in header.get("materials", []):
        texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
        if texture is None:
            continue
        if texture.get("texCoord", 0) != 0:
            left_out.note("second set of texture coordinates")
        if "KHR_texture_transform" in texture.get("extensions", {}):
            left_out.note("transform of a texture")
        name = material.get("name")
        options = _sampler_options(header, texture)
        if found.setdefault(name, options) != options:
            unclear.add(name)
    return {name: options for name, options in found.items() if name not in unclear}


def _sampler_options(header: dict[str, Any], texture: dict[str, Any]) -> dict[str, Any]:
    """Return wrap and filter of one use of a texture."""
    number = header.get("textures", [])[texture["index"]].get("sampler")
    sampler = {} if number is None else header.get("samplers", [])[number]
    wrap = tuple(_GLTF_WRAPS.get(sampler.get(side), "repeat") for side in ("wrapS", "wrapT"))
    if sampler.get("magFilter") == _GLTF_NEAREST:
        return {"wrap": wrap, "filter": "nearest"}
    unmipped = sampler.get("minFilter") in (_GLTF_NEAREST, _GLTF_LINEAR)
    return {"wrap": wrap, "filter": "bilinear" if unmipped else "trilinear"}
