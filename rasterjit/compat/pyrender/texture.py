"""Textures: pictures and how they are read."""

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
"""OpenGL's codes of a plain texture and of bytes."""


class Texture:
    """
    A picture and how it is read.

    Parameters
    ----------
    name : str, optional
    sampler : Sampler, optional
    source : (H, W) or (H, W, C) array or PIL.Image, optional
        Floats in 0..1 or bytes. Without one, nothing can be drawn with it.
    source_channels : {"R", "RG", "GB", "RGB", "RGBA"}
        Which channels of the source are kept; must be given if a source is.
    width, height : int, optional
        Kept and without effect: the source has a size.
    tex_type, data_format : int
        OpenGL's codes; kept and without effect.

    Raises
    ------
    TypeError
        If the source is no picture.
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
        lambda value: Sampler() if value is None else value, "Sampler: how it is read; never None."
    )
    source_channels = Field(keep_any, "str or None: the channels of the next source that is set.")
    width = Field(keep_any, "int or None: as it was given.")
    height = Field(keep_any, "int or None: as it was given.")
    tex_type = Field(keep_any, "int: OpenGL's code of the kind, as it was given.")
    data_format = Field(keep_any, "int: OpenGL's code of the numbers, as it was given.")

    @property
    def source(self) -> NDArray[np.uint8] | None:
        """(H, W, C) or (H, W) uint8, or None: the picture."""
        return self._source

    @source.setter
    def source(self, value: Any) -> None:
        self._source = None
        if value is not None:
            try:
                # No channels are an error, not the usual ones.
                self._source = format_texture_source(value, self.source_channels)  # type: ignore[arg-type]
            except (TypeError, ValueError) as error:
                raise type(error)(f"source {error}") from None
        self._drawn: dict[bool, SceneTexture] = {}

    def is_transparent(self, cutoff: float = 1.0) -> bool:
        """Return False: as in pyrender 0.1.45, what a picture's alpha is does not count here."""
        return False

    @property
    def is_opaque(self) -> bool:
        """Whether its alpha is 1 everywhere."""
        return self.convert().is_opaque

    def show_alpha(self) -> Texture:
        """Return a texture that is read like it and shows its alpha in all channels."""
        pixels, grey = np.asarray(self.source), copy.copy(self)
        has_alpha = pixels.ndim == 3 and pixels.shape[2] == 4
        alphas = pixels[..., 3] if has_alpha else np.full(pixels.shape[:2], 255, np.uint8)
        grey.source_channels = "RGBA"
        grey.source = np.repeat(alphas[..., np.newaxis], 4, axis=2)
        return grey

    def delete(self) -> None:
        """Let go of what was made to draw it."""
        self._drawn = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return what is copied and pickled: no copy shares what was drawn."""
        return {**self.__dict__, "_drawn": {}}

    def convert(self, *, are_facets: bool = False) -> SceneTexture:
        """
        Return the texture as RasterJIT has it, its codes as they are; made once.

        Parameters
        ----------
        are_facets : bool
            Whether the first two channels are roughness and metallic: they go where glTF has them.

        Raises
        ------
        ValueError
            If it has no source, or its sampler an unknown code.
        """
        if are_facets not in self._drawn:
            pixels = self.source
            if pixels is None:
                raise ValueError("source must be a picture where a texture is drawn, got None")
            if are_facets or (pixels.ndim == 3 and pixels.shape[2] == 2):
                # OpenGL has 0 where a channel is missing.
                channels = np.atleast_3d(pixels)
                none = np.zeros_like(channels[..., :1])
                rough, metal = channels[..., :1], channels[..., 1:2] if pixels.ndim == 3 else none
                pixels = np.dstack([none, rough, metal] if are_facets else [rough, metal, none])
            self._drawn[are_facets] = SceneTexture(
                pixels, color_space="linear", **self.sampler.convert()
            )
        return self._drawn[are_facets]
