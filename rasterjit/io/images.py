"""
Decode the pictures of mesh files; write pictures, depth maps and arrays atomically.

OpenEXR files have named channels, so that other programs know them: R, G, B, A and Z [1]_, and
X, Y, Z and U, V [2]_. ``outputs.save`` chooses the names, `write_exr` writes the channels.

PNG files are encoded by `encode_png`. Pillow, and with it imageio, writes 16 bits a channel in grey
alone; and it tries five filters on each row, which takes four times as long for files that are a
little smaller.

References
----------
.. [1] Academy Software Foundation, "Technical Introduction to OpenEXR": R, G, B, A and Z are the
   names of colour, opacity and depth, a layer's channels are ``layer.channel``, and colour is
   multiplied by alpha.
.. [2] Blender Manual, "Passes": multilayer files name vectors X, Y, Z and texture coordinates U, V.
"""

from __future__ import annotations

import errno
import io
import os
import struct
import sys
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.atomic_write import atomic_file
from rasterjit.scene.color import decoding_table, srgb_to_linear
from rasterjit.scene.memory_limits import TEXEL_BYTES, MemoryBudget
from rasterjit.scene.picture_codes import read_codes
from rasterjit.scene.texture import PICTURE_FORMATS, open_picture
from rasterjit.scene.validation import needs_extra, unmasked_array

if TYPE_CHECKING:
    from PIL import Image

IMAGE_FORMATS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".gif")
"""Extensions that ``save_image`` writes."""

OPAQUE_FORMATS = (".jpg", ".jpeg", ".bmp")
"""Formats without an alpha channel."""

ENCODER_OPTIONS: dict[str, dict[str, Any]] = {
    ".jpg": {"quality": 95},
    ".jpeg": {"quality": 95},
    ".webp": {"lossless": True},
}
"""Options of encoders whose defaults lose visible detail."""

IS_WINDOWS = sys.platform == "win32"

WINDOWS_FORBIDDEN = frozenset('\0<>:"|?*')
"""Characters that no name of a file has on Windows. A colon would write to another stream."""

MAX_WINDOWS_NAME = 255
"""Most UTF-16 units of a name there."""

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOR_TYPES = {(): 0, (3,): 2, (4,): 6}
"""PNG's colour types, by the channels of a pixel: grey, RGB, RGBA."""
_DEFLATE_LEVEL = 2
"""Deflate level, 1..9: 6 takes four times as long, for files a quarter smaller."""
_UP_FILTER = 2
"""PNG's filter that stores the difference from the row above: smooth pictures pack better."""
_MAX_KEY_LENGTH = 79

_COMPRESSED_CHUNKS = (b"zTXt", b"iTXt", b"iCCP")
"""Chunks of a PNG file that are compressed, besides its texels."""
MAX_CHUNK_BYTES, MAX_LARGE_CHUNKS = 1 << 20, 64
"""Most bytes of such a chunk unpacked, and most chunks of that size, that Pillow accepts."""

_LONGEST_SIGNATURE = 16
"""Bytes by which Pillow tells formats."""

_TIFF_SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
MEMORY_PER_TAG_BYTE = 16
"""Memory of a byte of a TIFF file as a Python number."""
_MAX_VALUE_BYTES = 8
"""Most bytes of a value of a TIFF tag."""


def save_image(path: str | Path, image: NDArray[np.uint8]) -> None:
    """
    Write a picture; the format follows the extension.

    Parameters
    ----------
    path : str or Path
        Ends in one of ``IMAGE_FORMATS``. An existing file is replaced.
    image : (H, W, 4), (H, W, 3) or (H, W) uint8
        RGBA, RGB or grey, sRGB, rows from the top. JPEG and BMP know no transparency, GIF all or
        none: there, pixels of alpha below 128 are transparent.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is not a known one, ``image`` is not such an
        array, or a pixel is transparent and the format cannot show that. Nothing is written.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    target = check_save_path(path, IMAGE_FORMATS)
    pixels = unmasked_array("image", image)
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3) or pixels.size == 0:
        raise ValueError(
            f"image must be (H, W, 4), (H, W, 3) or (H, W) uint8, not empty; got {pixels.shape} "
            f"{pixels.dtype}"
        )
    if channels not in (1, 3, 4) or (pixels.ndim == 3 and channels == 1):
        raise ValueError(f"image must have 3 or 4 channels or no channel axis, got {pixels.shape}")
    suffix = target.suffix.lower()
    if channels == 4 and suffix in OPAQUE_FORMATS:
        transparent = int(np.count_nonzero(pixels[:, :, 3] < 255))
        if transparent:
            raise ValueError(
                f"path {str(path)!r}: {suffix} knows no transparency, and {transparent} of "
                f"{pixels.shape[0] * pixels.shape[1]} pixels are transparent; save to .png, .webp "
                "or .tif, or draw before an opaque background, such as background='white'"
            )
        pixels = pixels[:, :, :3]
    elif channels == 4 and suffix == ".gif":
        alpha = np.where(pixels[:, :, 3:] < 128, np.uint8(0), np.uint8(255))
        pixels = np.concatenate([pixels[:, :, :3], alpha], axis=2)
    with atomic_file(target) as temporary:
        _write_pixels(temporary, pixels, ENCODER_OPTIONS.get(suffix, {}))


def save_arrays(path: str | Path, **arrays: NDArray[Any]) -> None:
    """
    Write named arrays to a compressed ``.npz``.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is not ``.npz``, or no array is given.
    """
    target = check_save_path(path, (".npz",))
    if not arrays:
        raise ValueError("arrays must hold at least one array, got none")
    with atomic_file(target) as temporary:
        # Old NumPy knows no option of its own beside the arrays.
        table: dict[str, Any] = arrays
        np.savez_compressed(temporary, **table)


def _write_pixels(path: Path, pixels: NDArray[Any], options: dict[str, Any]) -> None:
    """Encode pixels, with Pillow by way of imageio save for PNG."""
    if path.suffix.lower() == ".png":
        path.write_bytes(encode_png(pixels))
        return
    import imageio.v3 as iio

    # Pillow's encoders take a write that the disk cuts short for a whole one.
    path.write_bytes(
        iio.imwrite("<bytes>", pixels, extension=path.suffix.lower(), plugin="pillow", **options)
    )


def check_save_path(path: str | os.PathLike[str], formats: Iterable[str]) -> Path:
    """Return the path if its extension and its folder are valid, or raise ``ValueError``."""
    if not isinstance(path, (str, os.PathLike)):
        raise ValueError(f"path must be a file name, got {path!r}")
    target = Path(os.fsdecode(path))
    name = str(target)
    if not _is_possible(target):
        raise ValueError(f"path must be a name that a file can have, got {name!r}")
    if target.suffix.lower() not in formats:
        raise ValueError(f"path {str(target)!r} must end in one of {', '.join(formats)}")
    try:
        if not target.parent.is_dir():
            raise ValueError(f"path {name!r}: the folder {str(target.parent)!r} does not exist")
        if target.is_dir():
            raise ValueError(f"path {name!r} is a folder")
    except OSError as error:
        raise ValueError(f"path {name!r} cannot be a file: {error.strerror}") from None
    return target


def _is_possible(path: Path) -> bool:
    """Tell whether a file of the system can have a path."""
    try:
        if not IS_WINDOWS:
            return b"\0" not in os.fsencode(path)
        str(path).encode()
        units = len(path.name.encode("utf-16-le")) // 2
        return units <= MAX_WINDOWS_NAME and WINDOWS_FORBIDDEN.isdisjoint(path.name)
    except UnicodeEncodeError:
        return False


class MissingOpenEXRError(ImportError, ValueError):
    """A file ends in ``.exr`` and OpenEXR is not installed."""


def write_exr(
    path: Path, channels: Mapping[str, NDArray[Any]], attributes: Mapping[str, str] | None = None
) -> None:
    """
    Write channels to an OpenEXR scan-line file with lossless ZIP compression, atomically.

    Parameters
    ----------
    path : Path
    channels : mapping of str to (H, W) float32 or uint32
        All of one shape; the file's data window is columns 0..W-1 and rows 0..H-1.
    attributes : mapping of str to str, optional
        Further entries of the header.

    Raises
    ------
    MissingOpenEXRError
        An ``ImportError`` and a ``ValueError``: if OpenEXR is not installed.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    with needs_extra("exr", f"path {str(path)!r}: .exr needs OpenEXR", MissingOpenEXRError):
        import OpenEXR
    header = {
        **(attributes or {}),
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    pixels = {name: np.ascontiguousarray(array) for name, array in channels.items()}
    with atomic_file(path) as temporary, OpenEXR.File(header, pixels) as file:
        try:
            file.write(str(temporary))
        except RuntimeError as error:
            raise _convert_to_os_error(error, temporary, path) from None


def _convert_to_os_error(error: RuntimeError, temporary: Path, path: Path) -> OSError:
    """Convert OpenEXR's ``RuntimeError`` to an ``OSError`` that names the target file."""
    message = str(error)
    for code in sorted(errno.errorcode):
        if os.strerror(code) in message:
            return OSError(code, os.strerror(code), str(path))
    return OSError(errno.EIO, message.replace(str(temporary), str(path)), str(path))


def encode_png(pixels: NDArray[Any], texts: Mapping[str, str] | None = None) -> bytes:
    """
    Encode pixels as a PNG file.

    Parameters
    ----------
    pixels : (H, W), (H, W, 3) or (H, W, 4) uint8 or uint16
        Grey, RGB or RGBA.
    texts : mapping of str to str, optional
        Its ``tEXt`` chunks: keys of 1 to 79 characters and values, Latin-1.

    Raises
    ------
    ValueError
        If ``pixels`` is not such an array, or ``texts`` cannot be written as Latin-1.

    References
    ----------
    Portable Network Graphics (PNG) Specification (Third Edition), W3C.
    """
    color_type = _COLOR_TYPES.get(pixels.shape[2:]) if pixels.ndim > 1 else None
    if pixels.dtype not in (np.uint8, np.uint16) or pixels.size == 0 or color_type is None:
        raise ValueError(
            "pixels must be (H, W), (H, W, 3) or (H, W, 4) uint8 or uint16, not empty; got "
            f"{pixels.shape} {pixels.dtype}"
        )
    height, width = pixels.shape[:2]
    bits = 8 * pixels.dtype.itemsize
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, color_type, 0, 0, 0))]
    chunks += [(b"tEXt", _encode_text(key, value)) for key, value in (texts or {}).items()]
    chunks += [(b"IDAT", zlib.compress(_filter_rows(pixels).data, _DEFLATE_LEVEL)), (b"IEND", b"")]
    return _PNG_SIGNATURE + b"".join(_make_chunk(kind, data) for kind, data in chunks)


def _filter_rows(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    """Apply PNG's filter Up to each row: its number, then differences from the row above."""
    stored = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder(">"))
    stored = stored.reshape(len(pixels), -1).view(np.uint8)
    rows = np.empty((len(stored), stored.shape[1] + 1), np.uint8)
    rows[:, 0] = _UP_FILTER
    rows[0, 1:] = stored[0]
    np.subtract(stored[1:], stored[:-1], out=rows[1:, 1:])
    return rows


def _encode_text(key: str, value: str) -> bytes:
    """Return the content of a ``tEXt`` chunk."""
    try:
        keyword, text = key.encode("latin-1"), value.encode("latin-1")
    except UnicodeEncodeError:
        raise ValueError(f"texts must be Latin-1, got {key!r}: {value!r}") from None
    if not 1 <= len(keyword) <= _MAX_KEY_LENGTH or b"\0" in keyword + text:
        raise ValueError(f"texts must have keys of 1..{_MAX_KEY_LENGTH} characters, got {key!r}")
    return keyword + b"\0" + text


def _make_chunk(kind: bytes, data: bytes) -> bytes:
    """Return a PNG chunk: length, type, data, and the CRC of the last two."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def decode_picture(
    content: bytes,
    label: str = "a picture",
    extra_formats: tuple[str, ...] = (),
    budget: MemoryBudget | None = None,
) -> NDArray[Any]:
    """
    Decode the content of a picture file.

    Parameters
    ----------
    content : bytes
    label : str
        What a message calls it.
    extra_formats : tuple of str
        Further formats that are allowed, by Pillow's names.
    budget : MemoryBudget, optional
        Counts what its texels take, by its header.

    Returns
    -------
    (H, W) or (H, W, 2..4) uint8 or uint16

    Raises
    ------
    ValueError
        If it is of no known format; `FileSizeError` for one larger than the budget;
        `PictureSizeError` for one with more texels than `Texture`
        takes.
    Exception
        Whatever Pillow raises about a picture that is damaged.
    """
    header_memory = _count_header_memory(content)
    if budget is not None:
        budget.take(label, header_memory)
    with _open_picture(content, extra_formats) as image:
        if budget is not None:
            # What opening took is free again.
            width, height = image.size
            budget.take(label, max(width * height * TEXEL_BYTES - header_memory, 0))
        return convert_pillow_image(image)


def _count_header_memory(content: bytes) -> int:
    """Return the most memory that opening a picture takes besides texels, by its header."""
    if content.startswith(b"\x89PNG"):
        packed = sum(map(content.count, _COMPRESSED_CHUNKS))
        return min(packed, MAX_LARGE_CHUNKS) * MAX_CHUNK_BYTES
    if content[:4] in _TIFF_SIGNATURES:
        return MEMORY_PER_TAG_BYTE * _sum_tag_bytes(content)
    return 0


def _sum_tag_bytes(content: bytes) -> int:
    """Return the most bytes of all tags of a TIFF file together; several may share bytes."""
    order = "<" if content[:1] == b"I" else ">"
    # Large files have places of 8 bytes.
    is_large = content[2:4].strip(b"\0") == b"+"
    first, count, entry = ("8xQ", "Q", "2xHQ8x") if is_large else ("4xI", "H", "2xHI4x")
    try:
        (at,) = struct.unpack_from(order + first, content)
        (tags,) = struct.unpack_from(order + count, content, at)
        at += struct.calcsize(order + count)
        rows = content[at : at + tags * struct.calcsize(order + entry)]
        sizes = (_MAX_VALUE_BYTES * n for _, n in struct.iter_unpack(order + entry, rows))
        return sum(min(size, len(content)) for size in sizes)
    except struct.error:
        # Pillow says what is wrong with it.
        return 0


def take_texel_memory(size: tuple[int, int], label: str, budget: MemoryBudget) -> None:
    """Count the memory of the texels of a picture, (width, height)."""
    budget.take(label, size[0] * size[1] * TEXEL_BYTES)


def check_picture(content: bytes) -> None:
    """Raise the error that `decode_picture` would about the header of a picture file."""
    with _open_picture(content):
        pass


def read_picture_size(file: BinaryIO, label: str) -> tuple[int, int]:
    """Return width and height by a picture's header, however large, or raise ``ValueError``."""
    from PIL import Image

    Image.init()
    start = file.read(_LONGEST_SIGNATURE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for make, accepts in (Image.OPEN[name] for name in PICTURE_FORMATS if name in Image.OPEN):
            # Pillow raises many errors about what is damaged; its own `open` refuses what is large.
            with suppress(Exception):
                if accepts is None or accepts(start) is True:
                    file.seek(0)
                    return make(file, "").size
    raise ValueError(f"{label} is no known picture")


@contextmanager
def _open_picture(content: bytes, extra_formats: tuple[str, ...] = ()) -> Iterator[Image.Image]:
    """Open a picture with Pillow, without its warnings."""
    from PIL import UnidentifiedImageError

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with open_picture("it", io.BytesIO(content), extra_formats) as image:
                yield image
        except UnidentifiedImageError:
            # Pillow names the place in memory.
            raise ValueError("it is empty" if not content else "it is no known picture") from None


def convert_pillow_image(image: Image.Image) -> NDArray[Any]:
    """Return the pixels of a Pillow image as `Texture` takes them."""
    return read_codes(image.convert("RGBA") if image.mode == "F" else image)


def quantize(linear: NDArray[np.float32], color_space: str) -> tuple[NDArray[np.uint8], bool]:
    """
    Quantize linear colours or texels to bytes.

    Parameters
    ----------
    linear : (..., 4) float32
        Linear RGBA; what lies outside 0..1 is clamped.
    color_space : {"srgb", "linear"}
        What bytes of red, green and blue are.

    Returns
    -------
    codes : (..., 4) uint8
    are_exact : bool
        Whether reading the codes gives the very same colours.
    """
    codes = np.floor(np.clip(linear, 0.0, 1.0) * np.float32(255.0) + np.float32(0.5))
    if color_space == "srgb":
        table = decoding_table().astype(np.float64)
        codes[..., :3] = np.searchsorted((table[1:] + table[:-1]) / 2.0, linear[..., :3])
    codes = codes.astype(np.uint8)
    read = codes / np.float32(255.0)
    if color_space == "srgb":
        read[..., :3] = srgb_to_linear(codes[..., :3])
    return codes, bool((read == linear).all())


def to_uint16(codes: NDArray[Any]) -> NDArray[np.uint16]:
    """Convert a picture of 8 or 16 bits to 16 bits."""
    return codes if codes.dtype == np.uint16 else codes.astype(np.uint16) * np.uint16(257)


def resize_grey(grey: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Resize a grey picture, uint8 or uint16, to (width, height)."""
    if (grey.shape[1], grey.shape[0]) == size:
        return grey
    from PIL import Image

    if grey.dtype == np.uint8:
        return np.asarray(Image.fromarray(np.ascontiguousarray(grey)).resize(size))
    # Pillow mixes pixels of 16 bits as floats alone.
    mixed = np.asarray(Image.fromarray(grey.astype(np.float32)).resize(size))
    return np.clip(np.rint(mixed), 0, 65535).astype(np.uint16)
