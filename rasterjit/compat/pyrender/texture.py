"""Textures: images, and the samplers that read them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.pyrender.fields import Field, keep_any, to_text_or_none
from rasterjit.compat.pyrender.sampler import Sampler
from rasterjit.compat.pyrender.utils import format_texture_source
from rasterjit.scene.texture import Texture as SceneTexture

_TEXTURE_2D, _UNSIGNED_BYTE = 3553, 5121
"""OpenGL's codes of a two-dimensional texture and of bytes."""


class Texture:
    """
    An image, and the sampler that reads it.

    Parameters
    ----------
    name : str, optional
    sampler : Sampler, optional
    source : (H, W) or (H, W, C) array or PIL.Image, optional
        Floats in 0..1 or bytes. A material whose texture has none cannot be drawn.
    source_channels : {"R", "RG", "GB", "RGB", "RGBA"}
        Which channels of the source are kept; must be given if a source is.
    width, height : int, optional
        Kept and without effect: the size is the source's.
    tex_type, data_format : int
        OpenGL's codes; kept and without effect.

    Raises
    ------
    TypeError
        If the source is no image.
    ValueError
        If the source lacks a channel, or the channels are none of these.
    """

    def __init__(
        self,
        name: str | None = None,
        sampler: Sampler | None = None,
        source: Any = None,
        source_channels: str | None = None,
        width: int | None = None,
        height: int | None = None,
        tex_type: int = _TEXTURE_2D,
        data_format: int = _UNSIGNED_BYTE,
    ) -> None:
        self.source_channels = source_channels
        self.name = name
        self.sampler = sampler
        self.source = source
        self.width, self.height = width, height
        self.tex_type, self.data_format = tex_type, data_format

    name = Field(to_text_or_none, "str or None: the texture's name.")
    sampler = Field(
        lambda value: Sampler() if value is None else value, "Sampler: reads the image; never None."
    )
    source_channels = Field(keep_any, "str or None: the channels of the next source that is set.")
    width = Field(keep_any, "int or None: as it was given.")
    height = Field(keep_any, "int or None: as it was given.")
    tex_type = Field(keep_any, "int: OpenGL's code of the kind, as it was given.")
    data_format = Field(keep_any, "int: OpenGL's code of the numbers, as it was given.")

    @property
    def source(self) -> NDArray[np.uint8] | None:
        """(H, W, C) or (H, W) uint8, or None: the image."""
        return self._source

    @source.setter
    def source(self, value: Any) -> None:
        self._source = None
        if value is not None:
            try:
                # Channels of None raise an error here, as in pyrender.
                self._source = format_texture_source(value, self.source_channels)  # type: ignore[arg-type]
            except (TypeError, ValueError) as error:
                raise type(error)(f"source {error}") from None
        self._converted: dict[bool, SceneTexture] = {}

    def is_transparent(self, cutoff: float = 1.0) -> bool:
        """Return False whatever the image's alpha, as pyrender 0.1.45 does."""
        return False

    @property
    def is_opaque(self) -> bool:
        """Whether its alpha is 1 everywhere."""
        return self.convert().is_opaque

    def show_alpha(self) -> Texture:
        """Return a texture with the same sampler and this one's alpha in all channels."""
        pixels, texture = np.asarray(self.source), copy.copy(self)
        has_alpha = pixels.ndim == 3 and pixels.shape[2] == 4
        alphas = pixels[..., 3] if has_alpha else np.full(pixels.shape[:2], 255, np.uint8)
        texture.source_channels = "RGBA"
        texture.source = np.repeat(alphas[..., np.newaxis], 4, axis=2)
        return texture

    def delete(self) -> None:
        """Free the textures that `convert` made."""
        self._converted = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return what copies and pickles hold: all but what `convert` made."""
        return {**self.__dict__, "_converted": {}}

    def convert(self, *, is_metallic_roughness: bool = False) -> SceneTexture:
        """
        Convert the texture to RasterJIT's, its numbers not decoded from sRGB; the result is cached.

        Parameters
        ----------
        is_metallic_roughness : bool
            Whether the first two channels are roughness and metallic: they move to green and blue,
            where glTF has them.

        Raises
        ------
        ValueError
            If it has no source, or its sampler an unknown code.
        """
        if is_metallic_roughness not in self._converted:
            pixels = self.source
            if pixels is None:
                raise ValueError("source must be an image where a texture is drawn, got None")
            if is_metallic_roughness or (pixels.ndim == 3 and pixels.shape[2] == 2):
                # OpenGL has 0 where a channel is missing.
                channels = np.atleast_3d(pixels)
                first, zeros = channels[..., :1], np.zeros_like(channels[..., :1])
                second = channels[..., 1:2] if pixels.ndim == 3 else zeros
                pixels = np.dstack(
                    [zeros, first, second] if is_metallic_roughness else [first, second, zeros]
                )
            self._converted[is_metallic_roughness] = SceneTexture(
                pixels, color_space="linear", **self.sampler.convert()
            )
        return self._converted[is_metallic_roughness]
