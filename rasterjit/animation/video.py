"""
Write animations atomically, one frame at a time.

No frame is held longer than it takes to encode it, so that the length of an animation is bounded by
the disk and not by memory. Pillow encodes the frames of a GIF one by one. Its writers of animated
WebP and PNG hold all frames, so the ffmpeg of the extra ``rasterjit[video]`` encodes those and MP4.
"""

from __future__ import annotations

import importlib.util
import itertools
import os
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.images import check_save_path
from rasterjit.scene.validation import brief

if TYPE_CHECKING:
    from PIL import Image

Pictures = Iterator[NDArray[np.uint8]]

ANIMATION_FORMATS = (".gif", ".mp4", ".webp", ".apng")
"""Extensions that ``save_animation`` writes."""

MAX_FPS = {".gif": 50, ".mp4": 120, ".webp": 120, ".apng": 120}
"""Most frames a second: players slow GIFs down whose frames last less than 1/50 s."""

GIF_COLORS = 255
"""Colours of one frame; the last entry of the palette is transparency."""

GIF_TICKS_PER_SECOND = 100
"""Resolution of the durations of a GIF's frames."""

GIF_DISPOSAL_CLEAR = 2
"""A GIF's disposal method: clear a frame before the next one."""

MIN_MP4_BOX, MP4_SIZE_IS_64_BITS = 8, 1
"""Bytes of the smallest box of an MP4, and the size field of boxes with a size of 64 bits."""

PNG_LAST_CHUNK = b"\0\0\0\0IEND\xaeB`\x82"
"""The last chunk of a PNG."""

FFMPEG_OPTIONS: dict[str, dict[str, Any]] = {
    # H.264 at no visible blocks around edges, about a tenth of the GIF's size.
    ".mp4": {"quality": 8, "codec": "libx264", "macro_block_size": 2},
    ".webp": {
        "quality": None, "codec": "libwebp", "pix_fmt_out": "bgra",
        "output_params": ["-lossless", "1", "-loop", "0", "-f", "webp"],
    },
    ".apng": {
        "quality": None, "codec": "apng", "pix_fmt_out": "rgba",
        "output_params": ["-plays", "0", "-f", "apng"],
    },
}  # fmt: skip
"""Options of ffmpeg by format: WebP and PNG are lossless; 0 loops or plays repeat for ever."""


def check_animation(path: str | Path, size: tuple[int, int], fps: float, opaque: bool) -> Path:
    """
    Check the arguments of `save_animation` before anything is rendered; return the path.

    Parameters
    ----------
    path : str or Path
    size : (width, height) of int, pixels
    fps : float
    opaque : bool
        Whether the frames have no transparent pixels.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is unknown, ``fps`` is not in 1..50 (GIF) or
        1..120; for MP4 also if a side is odd, or ``opaque`` is false.
    ImportError
        If the format needs ffmpeg and the extra ``rasterjit[video]`` is not installed.
    """
    target = check_save_path(path, ANIMATION_FORMATS)
    suffix = target.suffix.lower()
    check_fps(fps, suffix)
    if suffix in FFMPEG_OPTIONS and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ImportError(f'{suffix} needs imageio-ffmpeg; pip install "rasterjit[video]"')
    if suffix == ".mp4":
        if size[0] % 2 or size[1] % 2:
            raise ValueError(f"size must have even sides for .mp4, got {size[0]}x{size[1]}")
        if not opaque:
            raise ValueError(
                ".mp4 cannot be transparent: choose another background, .gif, .webp or .apng"
            )
    return target


def check_fps(fps: float, suffix: str) -> None:
    """Raise ``ValueError`` if a format cannot show that many frames a second."""
    is_number = isinstance(fps, (int, float, np.number)) and not isinstance(fps, bool)
    if not is_number or not 1 <= fps <= MAX_FPS[suffix]:
        raise ValueError(f"fps must be in 1..{MAX_FPS[suffix]} for {suffix}, got {fps!r}")


def save_animation(
    path: str | Path, pictures: Iterable[NDArray[np.uint8]], fps: float = 24.0
) -> None:
    """
    Write an animation that repeats for ever; the format follows the extension.

    Parameters
    ----------
    path : str or Path
        Ends in one of ``ANIMATION_FORMATS``. An existing file is replaced at the end.
    pictures : iterable of (H, W, 4) or (H, W, 3) uint8
        At least one, all of one size; opaque where there is no alpha; taken one at a time, and none
        is kept. GIF has at most 255 colours of each and makes pixels of alpha below 128
        transparent.
    fps : float
        Frames a second; a GIF's frames last whole hundredths of a second, some one longer than
        others where the mean is not one.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is unknown, ``fps`` is out of range, there is no
        picture, or one is no such array or of another size than the first; for MP4 also if a side
        is odd or a pixel is transparent.
    ImportError
        If the format needs ffmpeg and the extra ``rasterjit[video]`` is not installed.
    OSError
        If the file cannot be written. Whatever is raised, by ``pictures`` as well, an existing file
        is left as it was, and no other remains.
    """
    target = check_save_path(path, ANIMATION_FORMATS)
    suffix = target.suffix.lower()
    check_fps(fps, suffix)
    if not isinstance(pictures, Iterable):
        raise ValueError(f"pictures must be an iterable of pictures, got {brief(pictures)}")
    pictures = iter(pictures)
    missing = object()
    first = next(pictures, missing)
    if first is missing:
        raise ValueError("pictures must hold at least one picture, got none")
    shape = np.shape(first)
    check_animation(target, (*shape[1::-1], 0, 0)[:2], fps, opaque=True)
    checked_pictures = _check_pictures(itertools.chain([first], pictures), shape, suffix)
    with atomic_file(target) as temporary:
        if suffix == ".gif":
            _write_gif(temporary, checked_pictures, fps)
        else:
            _write_with_ffmpeg(temporary, checked_pictures, fps, (shape[1], shape[0]))


def _check_pictures(pictures: Iterable[Any], shape: tuple[int, ...], suffix: str) -> Pictures:
    """Yield pictures as RGBA, or raise ``ValueError`` if one cannot be encoded."""
    for number, picture in enumerate(pictures):
        pixels = np.asarray(picture)
        is_picture = pixels.ndim == 3 and pixels.shape[2] in (3, 4) and pixels.size > 0
        if pixels.dtype != np.uint8 or not is_picture:
            raise ValueError(
                f"picture {number} must be (H, W, 4) or (H, W, 3) uint8, got {pixels.shape} "
                f"{pixels.dtype}"
            )
        if pixels.shape[:2] != shape[:2]:
            raise ValueError(
                f"picture {number} must be of the first one's size, {shape[1]}x{shape[0]}, got "
                f"{pixels.shape[1]}x{pixels.shape[0]}"
            )
        if pixels.shape[2] == 3:
            pixels = np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
        if suffix == ".mp4" and pixels[:, :, 3].min() < 255:
            raise ValueError(f"picture {number} is transparent, which .mp4 cannot be")
        yield pixels


def _write_gif(path: Path, pictures: Pictures, fps: float) -> None:
    """Encode each frame with Pillow as it comes; its writer of whole files would hold all."""
    from PIL.GifImagePlugin import getdata, getheader

    with path.open("wb") as file:
        for number, pixels in enumerate(pictures):
            picture = _make_palette_image(pixels)
            start, end = (round(GIF_TICKS_PER_SECOND * n / fps) for n in (number, number + 1))
            options = {"duration": 1000 // GIF_TICKS_PER_SECOND * (end - start)}
            if "transparency" in picture.info:
                options["transparency"] = picture.info["transparency"]
            if number == 0:
                file.writelines(getheader(picture, info={"loop": 0})[0])
            file.writelines(
                getdata(picture, disposal=GIF_DISPOSAL_CLEAR, include_color_table=True, **options)
            )
        file.write(b";")


def _make_palette_image(frame: NDArray[np.uint8]) -> Image.Image:
    """Return a frame as indices into its own palette, with transparency if it has any."""
    from PIL import Image

    clear = frame[:, :, 3] < 128
    picture = Image.fromarray(np.ascontiguousarray(frame[:, :, :3])).quantize(
        GIF_COLORS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    # Extend palettes of fewer colours to the entry of transparency.
    palette = (picture.getpalette() or [])[: 3 * GIF_COLORS]
    picture.putpalette([*palette, *[0] * (3 * (GIF_COLORS + 1) - len(palette))])
    if clear.any():
        picture.paste(GIF_COLORS, mask=Image.fromarray(clear))
        picture.info["transparency"] = GIF_COLORS
    return picture


def _write_with_ffmpeg(path: Path, pictures: Pictures, fps: float, size: tuple[int, int]) -> None:
    """Send each frame to ffmpeg as it comes, and check that all were written."""
    import imageio_ffmpeg

    options = {"macro_block_size": 1, **FFMPEG_OPTIONS[path.suffix.lower()]}
    # Hide warnings of ffmpeg; failures are found below.
    writer = imageio_ffmpeg.write_frames(
        str(path), size, pix_fmt_in="rgba", fps=fps, ffmpeg_log_level="fatal", **options
    )
    count = 0
    # Closing waits for ffmpeg to end, after an error as well: only then can the file be removed.
    with closing(writer):
        writer.send(None)
        for count, pixels in enumerate(pictures, start=1):  # noqa: B007
            try:
                writer.send(np.ascontiguousarray(pixels))
            except OSError as error:
                reason = str(error).splitlines()[0]
                raise OSError(f"ffmpeg ended early ({reason}); the disk may be full") from None
    if not _is_complete(path, count):
        raise OSError(f"ffmpeg wrote fewer than {count} frames; the disk may be full")


def _is_complete(path: Path, count: int) -> bool:
    """Tell whether ffmpeg finished a file of ``count`` frames."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".mp4":
            import imageio_ffmpeg

            if not _ends_with_box(path):
                return False
            return imageio_ffmpeg.count_frames_and_secs(str(path))[0] == count
        if suffix == ".webp":
            # Pillow would read the whole file; a RIFF begins with its size.
            with path.open("rb") as file:
                head = file.read(len(b"RIFF") + 4)
            size = int.from_bytes(head[len(b"RIFF") :], "little")
            return size + len(head) == path.stat().st_size
        from PIL import Image

        # The number of frames stands at the beginning, the last chunk at the end.
        with path.open("rb") as file:
            file.seek(-len(PNG_LAST_CHUNK), os.SEEK_END)
            if file.read() != PNG_LAST_CHUNK:
                return False
        with Image.open(path) as picture:
            return getattr(picture, "n_frames", 1) == count
    except (OSError, RuntimeError, SyntaxError):
        return False


def _ends_with_box(path: Path) -> bool:
    """Tell whether the last box of an MP4 ends at the end of the file."""
    position, end = 0, path.stat().st_size
    with path.open("rb") as file:
        while position < end:
            file.seek(position)
            size = int.from_bytes(file.read(4), "big")
            if size == MP4_SIZE_IS_64_BITS:
                # The size of 64 bits follows the name, of four letters.
                size = int.from_bytes(file.read(12)[4:], "big")
            if size < MIN_MP4_BOX:
                return False
            position += size
    return position == end
