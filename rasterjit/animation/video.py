"""
Write animations, whole or not at all, one frame at a time.

No frame is kept longer than it takes to encode it, so that the length of an animation is bounded by
the disk and not by memory. Pillow encodes the frames of a GIF one by one; what it has for animated
WebP and PNG holds all frames until the last is there, so those and MP4 are encoded by the ffmpeg
that the extra ``rasterjit[video]`` brings.
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
from rasterjit.io.images import checked_path
from rasterjit.scene.validation import brief

if TYPE_CHECKING:
    from PIL import Image

Pictures = Iterator[NDArray[np.uint8]]

ANIMATION_FORMATS = (".gif", ".mp4", ".webp", ".apng")
"""Extensions that ``save_animation`` writes."""

FASTEST = {".gif": 50, ".mp4": 120, ".webp": 120, ".apng": 120}
"""Most frames a second: players slow a GIF down whose frames last less than 1/50 s."""

GIF_COLORS = 255
"""Colours of one frame: the palette's last place is left to transparency."""

GIF_TICKS = 100
"""A GIF's frames last whole hundredths of a second."""

CLEAR_BEFORE_NEXT = 2
"""A GIF's disposal method: a frame is cleared away before the next one is shown."""

SHORTEST_BOX, LONG_BOX = 8, 1
"""Bytes of the smallest box of an MP4, and the size that stands for one of 64 bits."""

PNG_END = b"\0\0\0\0IEND\xaeB`\x82"
"""The last chunk of a PNG."""

FFMPEG: dict[str, dict[str, Any]] = {
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
"""What ffmpeg is asked for. WebP and PNG keep every bit; 0 loops or plays are without end."""


def check_animation(path: str | Path, size: tuple[int, int], fps: float, opaque: bool) -> Path:
    """
    Check what `save_animation` needs, before anything is rendered.

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
    place = checked_path(path, ANIMATION_FORMATS)
    suffix = place.suffix.lower()
    check_speed(fps, suffix)
    if suffix in FFMPEG and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ImportError(f'{suffix} needs imageio-ffmpeg; pip install "rasterjit[video]"')
    if suffix == ".mp4":
        if size[0] % 2 or size[1] % 2:
            raise ValueError(f"size must have even sides for .mp4, got {size[0]}x{size[1]}")
        if not opaque:
            raise ValueError(
                ".mp4 cannot be transparent: choose another background, .gif, .webp or .apng"
            )
    return place


def check_speed(fps: float, suffix: str) -> None:
    """Raise ``ValueError`` if a format cannot show that many frames a second."""
    is_number = isinstance(fps, (int, float, np.number)) and not isinstance(fps, bool)
    if not is_number or not 1 <= fps <= FASTEST[suffix]:
        raise ValueError(f"fps must be in 1..{FASTEST[suffix]} for {suffix}, got {fps!r}")


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
    place = checked_path(path, ANIMATION_FORMATS)
    suffix = place.suffix.lower()
    check_speed(fps, suffix)
    if not isinstance(pictures, Iterable):
        raise ValueError(f"pictures must be an iterable of pictures, got {brief(pictures)}")
    pictures = iter(pictures)
    nothing = object()
    first = next(pictures, nothing)
    if first is nothing:
        raise ValueError("pictures must hold at least one picture, got none")
    shape = np.shape(first)
    check_animation(place, (*shape[1::-1], 0, 0)[:2], fps, opaque=True)
    checked = _checked(itertools.chain([first], pictures), shape, suffix)
    with atomic_file(place) as temporary:
        if suffix == ".gif":
            _write_gif(temporary, checked, fps)
        else:
            _write_with_ffmpeg(temporary, checked, fps, (shape[1], shape[0]))


def _checked(pictures: Iterable[Any], shape: tuple[int, ...], suffix: str) -> Pictures:
    """Yield pictures that are fit to be encoded, or raise ``ValueError``."""
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
    """Encode each frame with Pillow as it comes; its writer of whole files would keep them all."""
    from PIL.GifImagePlugin import getdata, getheader

    with path.open("wb") as file:
        for number, pixels in enumerate(pictures):
            picture = _indexed(pixels)
            start, end = (round(GIF_TICKS * n / fps) for n in (number, number + 1))
            options = {"duration": 1000 // GIF_TICKS * (end - start)}
            if "transparency" in picture.info:
                options["transparency"] = picture.info["transparency"]
            if number == 0:
                file.writelines(getheader(picture, info={"loop": 0})[0])
            file.writelines(
                getdata(picture, disposal=CLEAR_BEFORE_NEXT, include_color_table=True, **options)
            )
        file.write(b";")


def _indexed(frame: NDArray[np.uint8]) -> Image.Image:
    """Return a frame with a palette of its own, and one place for transparency if it has any."""
    from PIL import Image

    clear = frame[:, :, 3] < 128
    picture = Image.fromarray(np.ascontiguousarray(frame[:, :, :3])).quantize(
        GIF_COLORS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    # A palette of few colours has no last place.
    palette = (picture.getpalette() or [])[: 3 * GIF_COLORS]
    picture.putpalette([*palette, *[0] * (3 * (GIF_COLORS + 1) - len(palette))])
    if clear.any():
        picture.paste(GIF_COLORS, mask=Image.fromarray(clear))
        picture.info["transparency"] = GIF_COLORS
    return picture


def _write_with_ffmpeg(path: Path, pictures: Pictures, fps: float, size: tuple[int, int]) -> None:
    """Send each frame to ffmpeg as it comes, and see that all have arrived."""
    import imageio_ffmpeg

    options = {"macro_block_size": 1, **FFMPEG[path.suffix.lower()]}
    # What ffmpeg warns of is not for the user; what fails is found below.
    writer = imageio_ffmpeg.write_frames(
        str(path), size, pix_fmt_in="rgba", fps=fps, ffmpeg_log_level="fatal", **options
    )
    count = 0
    # Closing it waits for ffmpeg to end, after an error as well: only then can the file be removed.
    with closing(writer):
        writer.send(None)
        for count, pixels in enumerate(pictures, start=1):  # noqa: B007
            try:
                writer.send(np.ascontiguousarray(pixels))
            except OSError as error:
                reason = str(error).splitlines()[0]
                raise OSError(f"ffmpeg ended early ({reason}); the disk may be full") from None
    if not _is_whole(path, count):
        raise OSError(f"ffmpeg wrote fewer than {count} frames; the disk may be full")


def _is_whole(path: Path, count: int) -> bool:
    """Tell whether ffmpeg came to the end of a file, where it notes how much there is."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".mp4":
            import imageio_ffmpeg

            if not _boxes_fill(path):
                return False
            return imageio_ffmpeg.count_frames_and_secs(str(path))[0] == count
        if suffix == ".webp":
            # Pillow would read all of it into memory; a RIFF begins with its size.
            with path.open("rb") as file:
                head = file.read(len(b"RIFF") + 4)
            size = int.from_bytes(head[len(b"RIFF") :], "little")
            return size + len(head) == path.stat().st_size
        from PIL import Image

        # The number of frames stands at the beginning, the last chunk at the end.
        with path.open("rb") as file:
            file.seek(-len(PNG_END), os.SEEK_END)
            if file.read() != PNG_END:
                return False
        with Image.open(path) as picture:
            return getattr(picture, "n_frames", 1) == count
    except (OSError, RuntimeError, SyntaxError):
        return False


def _boxes_fill(path: Path) -> bool:
    """Tell whether the last box of an MP4 ends where the file does."""
    at, end = 0, path.stat().st_size
    with path.open("rb") as file:
        while at < end:
            file.seek(at)
            size = int.from_bytes(file.read(4), "big")
            if size == LONG_BOX:
                # The real size follows the name, of four letters.
                size = int.from_bytes(file.read(12)[4:], "big")
            if size < SHORTEST_BOX:
                return False
            at += size
    return at == end
