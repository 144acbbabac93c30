"""Backgrounds of frames: a colour, or a picture such as a photograph."""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.forks import cached_property
from rasterjit.scene.color import ColorLike, linear_color, linear_rows
from rasterjit.scene.texture import read_picture
from rasterjit.scene.validation import existing_file, unmasked_array

MAX_CACHED_FILES = 4
"""Most pictures of files that are cached, so that frames of an animation read them once."""


@dataclass(frozen=True, eq=False)
class BackgroundImage:
    """
    A picture behind all faces; each of its pixels is behind one pixel of the frame.

    Parameters
    ----------
    image : (H, W, 3) or (H, W, 4) array_like
        Rows from the top, red first: ``uint8`` is sRGB, everything else linear light in 0..1. Alpha
        is straight and linear.

    Attributes
    ----------
    image : (H, W, 4) uint8 or float32

    Raises
    ------
    ValueError
        If the shape is another, or a number lies outside 0..1 or is not finite.
    """

    image: NDArray[Any]

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        return f"BackgroundImage({width} x {height} {self.image.dtype})"

    def __post_init__(self) -> None:
        pixels = unmasked_array("background", self.image)
        if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or not pixels.size:
            raise ValueError(
                "background must be a colour, the name of a picture's file, or a picture of shape "
                f"(H, W, 3) or (H, W, 4), got shape {pixels.shape}"
            )
        if pixels.dtype == np.uint8:
            image = np.array(pixels, order="C")
            if pixels.shape[2] == 3:
                image = np.full((*pixels.shape[:2], 4), 255, np.uint8)
                image[..., :3] = pixels
        else:
            rows = linear_rows("background", pixels.reshape(-1, pixels.shape[2]))
            image = rows.reshape(*pixels.shape[:2], 4)
        image.flags.writeable = False
        object.__setattr__(self, "image", image)

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> BackgroundImage:
        """
        Read a picture, turned as its EXIF data say.

        Raises
        ------
        ValueError
            If the file is missing or holds no picture; the message names it.
        """
        file = existing_file("background", path)
        status = file.stat()
        return _read_file(str(file.absolute()), status.st_mtime_ns, status.st_size)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.image.shape[1], self.image.shape[0]

    @cached_property
    def is_opaque(self) -> bool:
        """Whether every pixel is opaque."""
        return bool(self.image[..., 3].min() == (255 if self.image.dtype == np.uint8 else 1.0))

    def alpha_at(self, x: int, y: int) -> float:
        """Return the alpha of a pixel, 0..1."""
        alpha = float(self.image[y, x, 3])
        return alpha / 255.0 if self.image.dtype == np.uint8 else alpha

    def resampled(self, size: tuple[int, int]) -> BackgroundImage:
        """Return the picture in another size, resampled to the nearest pixel."""
        width, height = size
        rows = (2 * np.arange(height) + 1) * self.size[1] // (2 * height)
        columns = (2 * np.arange(width) + 1) * self.size[0] // (2 * width)
        return BackgroundImage(self.image[rows[:, None], columns])

    def check_size(self, size: tuple[int, int]) -> None:
        """Raise ``ValueError`` if a frame has another size."""
        if self.size != tuple(size):
            width, height = self.size
            raise ValueError(
                f"background must be a picture of the frame's size, {size[0]} x {size[1]} pixels, "
                f"got {width} x {height}: render with size=({width}, {height}), or scale it"
            )


@functools.lru_cache(maxsize=MAX_CACHED_FILES)
def _read_file(path: str, modified: int, length: int) -> BackgroundImage:
    """Return the picture of a file; read again where it has changed."""
    image = read_picture("background", existing_file("background", path), apply_exif=True)
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    image = image.reshape(*image.shape[:2], -1)
    if image.shape[2] < 3:
        image = np.dstack([np.repeat(image[..., :1], 3, axis=2), image[..., 1:]])
    return BackgroundImage(image)


Background: TypeAlias = ColorLike | os.PathLike[str] | BackgroundImage | None
"""A background as users give it; None: an environment that is a background, else white."""

Backdrop: TypeAlias = NDArray[np.float32] | BackgroundImage
"""A converted background: a colour, (4,) linear, or a picture."""


def read_background(value: Any) -> Backdrop:
    """
    Convert a background to a linear colour or a picture.

    Parameters
    ----------
    value : color, path, (H, W, 3) or (H, W, 4) array_like, BackgroundImage or None
        A string with a dot or a slash is the name of a file; ``None`` is white.

    Raises
    ------
    ValueError
        If it is none of these, or the file holds no picture.
    """
    if value is None:
        return linear_color("background", "white")
    if isinstance(value, BackgroundImage):
        return value
    if isinstance(value, os.PathLike) or is_file_name(value):
        return BackgroundImage.from_file(value)
    if not isinstance(value, str) and _dimensions(value) > 1:
        return BackgroundImage(value)
    return linear_color("background", value)


def is_file_name(value: Any) -> bool:
    """Tell whether a background is a string that names a file: no colour has a dot or a slash."""
    return isinstance(value, str) and any(character in value for character in (".", "/", os.sep))


def _dimensions(value: ArrayLike) -> int:
    """Return the number of dimensions of an array; 0 for other values."""
    try:
        return unmasked_array("background", value).ndim
    except ValueError:
        return 0
