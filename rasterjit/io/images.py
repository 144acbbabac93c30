"""
Write pictures and arrays to files, whole or not at all.

A file is written beside its place under a temporary name and then moved there in one step, so a
picture that was there before is either kept or replaced, never left half-written.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.validation import positive_number

IMAGE_FORMATS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".gif")
"""Extensions that ``save_image`` writes."""

OPAQUE_FORMATS = (".jpg", ".jpeg", ".bmp")
"""Those of them without an alpha channel."""

ENCODER_OPTIONS: dict[str, dict[str, Any]] = {
    ".jpg": {"quality": 95},
    ".jpeg": {"quality": 95},
    ".webp": {"lossless": True},
}
"""What differs from the encoders' defaults, which lose visible detail."""

DEPTH_FORMATS = (".exr", ".npz", ".npy", ".png")
"""Extensions that ``save_depth`` writes."""

LARGEST_UINT16 = 65535


def save_image(path: str | Path, image: NDArray[np.uint8]) -> None:
    """
    Write a picture; the format follows the extension.

    Parameters
    ----------
    path : str or Path
        Ends in one of ``IMAGE_FORMATS``. An existing file is replaced.
    image : (H, W, 4), (H, W, 3) or (H, W) uint8
        RGBA, RGB or grey, sRGB, rows from the top. JPEG and BMP drop the alpha channel.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is not a known one, or ``image`` is not such an
        array. Nothing is written.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    place = checked_path(path, IMAGE_FORMATS)
    pixels = np.asarray(image)
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3) or pixels.size == 0:
        raise ValueError(
            f"image must be (H, W, 4), (H, W, 3) or (H, W) uint8, not empty; got {pixels.shape} "
            f"{pixels.dtype}"
        )
    if channels not in (1, 3, 4) or (pixels.ndim == 3 and channels == 1):
        raise ValueError(f"image must have 3 or 4 channels or no channel axis, got {pixels.shape}")
    suffix = place.suffix.lower()
    if channels == 4 and suffix in OPAQUE_FORMATS:
        pixels = pixels[:, :, :3]
    with replacing(place) as temporary:
        _write_pixels(temporary, pixels, ENCODER_OPTIONS.get(suffix, {}))


def save_arrays(path: str | Path, **arrays: NDArray[Any]) -> None:
    """
    Write named arrays to a compressed ``.npz``.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is not ``.npz``, or no array is given.
    """
    place = checked_path(path, (".npz",))
    if not arrays:
        raise ValueError("arrays must hold at least one array, got none")
    with replacing(place) as temporary:
        np.savez_compressed(temporary, **arrays)


def save_depth(path: str | Path, depth: NDArray[np.float32], *, scale: float = 1000.0) -> None:
    """
    Write a depth map, ``inf`` where nothing is; the format follows the extension.

    Parameters
    ----------
    path : str or Path
        ``.exr`` (channel Z, float32), ``.npz`` (array ``depth``), ``.npy``, or ``.png`` (16 bits).
    depth : (H, W) float32, scene units
    scale : float
        PNG only: a pixel holds ``depth * scale`` rounded half up, 0 where nothing is. The default
        makes millimetres of metres.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is not a known one, ``depth`` is not such an
        array, ``scale`` is not above 0, a PNG would need values outside 0..65535, or an EXR is
        asked for and OpenEXR is not installed.
    """
    place = checked_path(path, DEPTH_FORMATS)
    values = np.asarray(depth)
    if values.ndim != 2 or values.size == 0 or values.dtype != np.float32:
        raise ValueError(
            f"depth must be (H, W) float32, not empty; got {values.shape} {values.dtype}"
        )
    suffix = place.suffix.lower()
    if suffix == ".npz":
        save_arrays(place, depth=values)
    elif suffix == ".npy":
        with replacing(place) as temporary:
            np.save(temporary, values)
    elif suffix == ".png":
        pixels = _depth_as_uint16(values, positive_number("scale", scale))
        with replacing(place) as temporary:
            _write_pixels(temporary, pixels, {})
    else:
        from rasterjit.io import exr

        exr.write(place, {"Z": values})


def _depth_as_uint16(depth: NDArray[np.float32], scale: float) -> NDArray[np.uint16]:
    """Return ``depth * scale`` rounded half up, 0 where the depth is not finite."""
    seen = np.isfinite(depth)
    scaled = np.floor(np.where(seen, depth, 0.0).astype(np.float64) * scale + 0.5)
    if scaled.min() < 0 or scaled.max() > LARGEST_UINT16:
        raise ValueError(
            f"depth * scale must lie in 0..{LARGEST_UINT16} for a 16-bit PNG, got "
            f"{scaled.min():.0f}..{scaled.max():.0f} with scale={scale!r}; "
            "choose another scale, .exr or .npz"
        )
    return scaled.astype(np.uint16)


def _write_pixels(path: Path, pixels: NDArray[Any], options: dict[str, Any]) -> None:
    """Encode pixels with Pillow, through imageio save for PNG."""
    if path.suffix.lower() == ".png":
        # Half the time: imageio lets Pillow look for every format that it knows.
        from PIL import Image

        Image.fromarray(pixels).save(path, "PNG", **options)
        return
    import imageio.v3 as iio

    iio.imwrite(path, pixels, plugin="pillow", **options)


def checked_path(path: str | Path, formats: Iterable[str]) -> Path:
    """Return the path if its extension and its folder are good, or raise ``ValueError``."""
    if not isinstance(path, (str, os.PathLike)):
        raise ValueError(f"path must be a file name, got {path!r}")
    place = Path(path)
    shown = str(place)
    if not shown.isprintable():
        raise ValueError(f"path must hold printable characters alone, got {shown!r}")
    if place.suffix.lower() not in formats:
        raise ValueError(f"path {str(place)!r} must end in one of {', '.join(formats)}")
    try:
        if not place.parent.is_dir():
            raise ValueError(f"path {shown!r}: the folder {str(place.parent)!r} does not exist")
        if place.is_dir():
            raise ValueError(f"path {shown!r} is a folder")
    except OSError as error:
        raise ValueError(f"path {shown!r} cannot be a file: {error.strerror}") from None
    return place


@contextmanager
def replacing(place: Path) -> Iterator[Path]:
    """Give a temporary path in the same folder; move it to ``place`` on success, else remove it."""
    temporary = place.with_name(f".{uuid.uuid4().hex}{place.suffix}")
    try:
        yield temporary
        os.replace(temporary, place)
    except OSError as error:
        # Name the file that was asked for, not the temporary one, nor none.
        named = error.filename in (None, str(temporary)) and error.filename2 is None
        if named and error.errno is not None:
            error.filename = str(place)
        raise
    finally:
        temporary.unlink(missing_ok=True)
