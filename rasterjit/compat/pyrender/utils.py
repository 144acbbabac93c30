"""
Colours and pictures as the adapter keeps them, under the name that pyrender gives the module.

References
----------
pyrender 0.1.45, module ``utils``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.validation import brief, short_repr

_CHANNELS = {"R": (0,), "RG": (0, 1), "GB": (1, 2), "RGB": (0, 1, 2), "RGBA": (0, 1, 2, 3)}
"""Which channels of a picture a texture reads."""


def format_color_vector(value: Any, length: int) -> NDArray[np.float32]:
    """
    Return a colour as floats.

    Parameters
    ----------
    value : int, float or array_like
        Whole numbers are shares of 255, 1 as well. One number is that of all channels; channels
        that are missing are 1, and those beyond ``length`` are left out.
    length : int
        Channels to return.

    Returns
    -------
    (length,) float32

    Raises
    ------
    ValueError
        If the value is no colour.
    """
    given = np.asarray(value)
    if given.dtype.kind not in "buif" or given.size == 0:
        raise ValueError(f"must be a colour, a number or {length} of them, got {brief(value)}")
    if given.dtype.kind in "iu" or isinstance(value, bool):
        given = (given / 255.0).astype(np.float32)
    if given.ndim == 0:
        given = np.repeat(given, length)
    given = given.squeeze() if given.size > 1 else given.reshape(1)
    if given.ndim != 1:
        raise ValueError(f"must be one colour, got an array of shape {np.shape(value)}")
    color = np.ones(length, np.float32)
    color[: len(given)] = given[:length]
    return color


def format_color_array(value: ArrayLike, shape: tuple[int, int]) -> NDArray[np.float32]:
    """
    Return colours as floats, one a row.

    Parameters
    ----------
    value : (N, C) or (C,) array_like
        Whole numbers are shares of 255. One colour is repeated; channels that are missing are 1.
    shape : (int, int)
        Rows, of a colour that is repeated, and channels to return.

    Returns
    -------
    (N, shape[1]) float32

    Raises
    ------
    ValueError
        If the value is no such array.
    """
    given = np.asarray(value)
    if given.ndim not in (1, 2) or given.dtype.kind not in "buif":
        raise ValueError(f"must be colours, (n, 3) or (n, 4), got {brief(given)}")
    if given.dtype.kind in "iu":
        given = (given / 255.0).astype(np.float32)
    if given.ndim == 1:
        given = np.broadcast_to(given, (shape[0], len(given)))
    colors = np.ones((len(given), shape[1]), np.float32)
    colors[:, : given.shape[1]] = given[:, : shape[1]]
    return colors


def format_texture_source(texture: Any, target_channels: str = "RGB") -> NDArray[np.uint8] | None:
    """
    Return a picture as bytes in the channels that are asked for.

    Parameters
    ----------
    texture : (H, W) or (H, W, C) array or PIL.Image, optional
        Floats in 0..1 or whole numbers in 0..255; a share of 255 is cut, not rounded.
    target_channels : {"R", "RG", "GB", "RGB", "RGBA"}
        Grey pictures are repeated in all of them; an alpha that is missing is 255.

    Returns
    -------
    (H, W, C) uint8, (H, W) of one channel, None of None

    Raises
    ------
    TypeError
        If it is no picture.
    ValueError
        If it lacks a channel, or the channels are none of these.
    """
    if texture is None:
        return None
    if hasattr(texture, "mode") and hasattr(texture, "convert"):
        has_palette = texture.mode == "P" and target_channels in ("RGB", "RGBA")
        texture = np.asarray(texture.convert(target_channels) if has_palette else texture)
    if not isinstance(texture, np.ndarray) or texture.dtype.kind not in "buif":
        raise TypeError(f"must be a picture, got {brief(texture)}")
    if target_channels not in _CHANNELS:
        listed = ", ".join(_CHANNELS)
        raise ValueError(f"must have channels of {listed}, got {short_repr(target_channels)}")
    if texture.ndim not in (2, 3) or texture.size == 0:
        raise ValueError(f"must be (H, W) or (H, W, C), got {brief(texture)}")
    if texture.dtype.kind == "f":
        texture = np.clip(np.nan_to_num(texture), 0.0, 1.0) * 255.0
    return _select_channels(texture.astype(np.uint8), target_channels)


def _select_channels(pixels: NDArray[np.uint8], wanted: str) -> NDArray[np.uint8]:
    """Return the channels of a picture, or raise ``ValueError`` if it lacks some."""
    if pixels.ndim == 2:
        pixels = pixels[..., None]
    count, channels = pixels.shape[2], _CHANNELS[wanted]
    if wanted == "R":
        return np.ascontiguousarray(pixels[..., 0])
    if count == 1:
        pixels = np.repeat(pixels, len(channels), axis=2)
        if wanted == "RGBA":
            pixels[..., 3] = 255
        return pixels
    if count == 2:
        if wanted in ("RGB", "RGBA"):
            raise ValueError(f"must have 1, 3 or 4 channels to be {wanted}, got 2")
        # Where two channels are, they are those that are asked for.
        return np.ascontiguousarray(pixels)
    if wanted == "RGBA" and count == 3:
        return np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
    return np.ascontiguousarray(pixels[..., list(channels)])
