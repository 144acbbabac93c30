"""Textures: pictures that colour a surface, decoded to linear light once, with their mip chain."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.color import srgb_to_linear
from rasterjit.validation import existing_file, one_of, read_only

WRAPS = ("repeat", "clamp", "mirror")
"""What lies outside 0..1: the picture again; its border texels; the picture, turned every time."""

FILTERS = ("nearest", "bilinear", "trilinear")
"""One texel; four texels, mixed by distance; the same from the two levels around the footprint."""

MOST_LIGHT = 1e6
"""Largest value of a texel, linear: its product with the brightest light fits float32."""

MAX_SIDE = 65536
"""Most texels in a row or column: positions along it keep their fraction."""

_NEWTON_STEPS = 12
"""From ``base**2``, at most 3.3 times too large, 8 reach the last bit of float32; 12 leave room."""

_CONVERTED_MODES = ("1", "P", "PA", "La", "RGBa", "CMYK", "YCbCr", "LAB", "HSV")
"""Pillow's kinds of picture that are neither grey nor RGB as they lie in memory."""


@dataclass(frozen=True, eq=False)
class Texture:
    """
    A picture to be laid over a mesh by its texture coordinates.

    Coordinate u runs right, v **up**: (0, 0) is the lower left corner of the picture, (1, 1) the
    upper right one, as in OBJ files (glTF counts v from the top; loading turns it over). Texel
    (column i, row j) of a picture with w columns and h rows has its centre at
    u = (i + 0.5) / w, v = 1 - (j + 0.5) / h.

    Filtering happens in linear light. ``"trilinear"`` chooses its level from the longer side of
    the pixel's footprint in texels, so a surface seen at a grazing angle is blurred rather than
    aliased.

    Parameters
    ----------
    image : (H, W) or (H, W, 1..4) array_like
        Grey, grey and alpha, RGB or RGBA, row 0 on top. ``uint8`` and ``uint16`` are sRGB; floats
        are linear light in 0..1e6. Alpha is linear in every form. Stored as (H, W, 4) float32,
        linear, read-only.
    wrap : {"repeat", "clamp", "mirror"} or a pair of them
        What coordinates outside 0..1 show; a pair gives u and v each their own. Stored as a pair.
    filter : {"trilinear", "bilinear", "nearest"}
        How texels become the colour of a pixel.

    Raises
    ------
    ValueError
        If the image has another shape or type, is empty or larger than 65536 on a side, holds a
        NaN, infinite or negative number or one above 1e6, or if ``wrap`` or ``filter`` is unknown.

    Notes
    -----
    The alpha of a texture is kept but not drawn: surfaces are opaque.
    """

    image: ArrayLike = field(repr=False)
    wrap: str | tuple[str, str] = field(default="repeat", kw_only=True)
    filter: str = field(default="trilinear", kw_only=True)

    def __post_init__(self) -> None:
        wrap = (self.wrap, self.wrap) if isinstance(self.wrap, str) else self.wrap
        if not isinstance(wrap, (tuple, list)) or len(wrap) != 2:
            raise ValueError(f"wrap must be a name or a pair of names, got {self.wrap!r}")
        wrap = (one_of("wrap", wrap[0], WRAPS), one_of("wrap", wrap[1], WRAPS))
        one_of("filter", self.filter, FILTERS)
        object.__setattr__(self, "wrap", wrap)
        object.__setattr__(self, "image", _linear_image(self.image))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Fill a copy, or what was pickled; its texels are read-only too."""
        for name, value in state.items():
            self.__dict__[name] = read_only(value) if isinstance(value, np.ndarray) else value

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        *,
        wrap: str | tuple[str, str] = "repeat",
        filter: str = "trilinear",
    ) -> Texture:
        """
        Read a texture from a PNG, JPEG or any other picture that imageio reads.

        Parameters
        ----------
        path : str or path-like
            Of several pictures in a file, the first is taken.
        wrap, filter
            As `Texture` takes them.

        Raises
        ------
        ValueError
            If the file is missing or holds no picture; the message names it.
        """
        import imageio.v3 as iio

        file = existing_file("path", path)
        try:
            mode = iio.immeta(file, index=0, plugin="pillow").get("mode")
            options = {"mode": "RGBA"} if mode in _CONVERTED_MODES else {}
            pixels = iio.imread(file, index=0, plugin="pillow", **options)
        except (OSError, SyntaxError, ValueError) as error:
            raise ValueError(
                f"path must be a picture, but {str(file)!r} is not: {error}"
            ) from error
        if mode == "I":
            # Pillow's name for 16-bit grey in 32-bit integers.
            pixels = np.clip(pixels, 0, 65535).astype(np.uint16)
        return cls(pixels, wrap=wrap, filter=filter)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, texels."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def is_opaque(self) -> bool:
        """Whether every texel has an alpha of 1 or more."""
        return bool((self.image[:, :, 3] >= 1.0).all())

    @property
    def levels(self) -> tuple[NDArray[np.float32], ...]:
        """
        The mip chain, each level (h, w, 4) float32, linear, read-only; the first is the image.

        Each level halves the sides of the one before, rounded down but not below 1, until a single
        texel is left. Its texels are means, by area, of the texels below them, in float64: the
        mean of the image is kept on every level, and a constant stays itself.
        """
        levels, start = [], 0
        for width, height in level_sizes(*self.size):
            stop = start + width * height
            levels.append(self._chain[start:stop].reshape(height, width, 4))
            start = stop
        return tuple(levels)

    def texels(self) -> NDArray[np.float32]:
        """Return what its filter reads, (N, 4): row by row, and level by level if trilinear."""
        return self._chain if self.filter == "trilinear" else self.image.reshape(-1, 4)

    @cached_property
    def _chain(self) -> NDArray[np.float32]:
        """The texels of all levels, (N, 4) float32, read-only; made when first asked for."""
        means, rows = self.image, [self.image.reshape(-1, 4)]
        for _ in level_sizes(*self.size)[1:]:
            means = _halved(_halved(means, 0), 1)
            rows.append(means.astype(np.float32).reshape(-1, 4))
        chain = read_only(np.concatenate(rows))
        # Keep the picture once: in the chain.
        object.__setattr__(self, "image", chain[: len(rows[0])].reshape(self.image.shape))
        return chain


def level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    """Return (width, height) of each mip level: halved, rounded down, until both are 1."""
    count = max(width, height).bit_length()
    return [(max(1, width >> k), max(1, height >> k)) for k in range(count)]


def _halved(image: NDArray[Any], axis: int) -> NDArray[Any]:
    """Return half as many texels along an axis, float64: the means of the area of each."""
    rows = np.moveaxis(image, axis, 0)
    size = len(rows)
    if size == 1:
        return image
    if size % 2 == 0:
        means = np.add(rows[0::2], rows[1::2], dtype=np.float64) / 2.0
    else:
        # Each covers 2 + 1/half texels: a part of the first, all of the second, a part of the last.
        half = size // 2
        number = np.arange(half, dtype=np.float64).reshape(-1, 1, 1)
        whole = np.float64(half) * rows[1::2].astype(np.float64)
        means = ((half - number) * rows[0:-1:2] + whole + (number + 1.0) * rows[2::2]) / size
    return np.moveaxis(means, 0, axis)


def _linear_image(value: Any) -> NDArray[np.float32]:
    """Return an image as (H, W, 4) float32, linear, read-only, or raise ``ValueError``."""
    try:
        image = np.asarray(value)
    except ValueError:
        raise ValueError("image must be an array of numbers, got rows of unequal length") from None
    if image.dtype not in (np.uint8, np.uint16) and image.dtype.kind != "f":
        raise ValueError(
            f"image must be uint8 or uint16 (sRGB) or float (linear light), got {image.dtype}"
        )
    shape = image.shape
    if len(shape) == 2:
        image = image[:, :, np.newaxis]
    if image.ndim != 3 or image.shape[2] not in (1, 2, 3, 4):
        raise ValueError(f"image must have shape (H, W) or (H, W, 1..4), got {shape}")
    height, width, channels = image.shape
    if not (1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE):
        raise ValueError(f"image must be 1..{MAX_SIDE} texels wide and high, got {width}×{height}")
    colors = channels - 1 if channels in (2, 4) else channels
    linear = np.ones((height, width, 4), np.float32)
    if image.dtype.kind == "f":
        _check_light(image[:, :, :colors], "linear light", MOST_LIGHT)
        _check_light(image[:, :, colors:], "alpha", 1.0)
        linear[:, :, :3] = image[:, :, :colors]
        linear[:, :, 3:] = image[:, :, colors:] if colors < channels else 1.0
    else:
        decoded = srgb_to_linear if image.dtype == np.uint8 else _srgb_16_to_linear
        linear[:, :, :3] = decoded(image[:, :, :colors])
        if colors < channels:
            most = np.float32(np.iinfo(image.dtype).max)
            np.divide(image[:, :, colors:], most, out=linear[:, :, 3:])
    return read_only(linear)


def _check_light(values: NDArray[Any], what: str, most: float) -> None:
    """Raise ``ValueError`` unless all values lie in 0..most; NaN lies nowhere."""
    if values.size == 0:
        return
    lowest, highest = float(values.min()), float(values.max())
    if not (lowest >= 0.0 and highest <= most):
        raise ValueError(
            f"image must hold {what} in 0..{most:g}, got numbers from {lowest} to {highest}; 8-bit "
            "codes need the dtype uint8"
        )


def _srgb_16_to_linear(codes: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Decode 16-bit sRGB codes to linear light through a table; 257 c is the 8-bit code c."""
    return _decoding_table_16()[codes]


@cache
def _decoding_table_16() -> NDArray[np.float32]:
    """
    Return the linear value of each of the 65536 codes.

    The curve's power of 12/5 is the fifth root r of ``base**12``. Newton's steps fall to it from
    ``base**2`` by sums, products and quotients alone, which have the same bits on every machine.
    """
    encoded = np.arange(65536, dtype=np.float64) / 65535.0
    base = (encoded + 0.055) / 1.055
    squared = base * base
    power = squared * squared * squared * (squared * squared * squared)
    root = squared
    for _ in range(_NEWTON_STEPS):
        fourth = (root * root) * (root * root)
        root = (4.0 * root + power / fourth) / 5.0
    table = np.where(encoded <= 0.04045, encoded / 12.92, root)
    table[-1] = 1.0
    return table.astype(np.float32)
