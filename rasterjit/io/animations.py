"""
Write animations, whole or not at all, one frame at a time.

GIF and WebP are encoded by Pillow, which imageio brings; MP4 by the ffmpeg that the extra
``rasterjit[video]`` brings.
"""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.images import checked_path, replacing

if TYPE_CHECKING:
    from PIL import Image

ANIMATION_FORMATS = (".gif", ".mp4", ".webp")
"""Extensions that ``save_animation`` writes."""

FASTEST = {".gif": 50, ".mp4": 120, ".webp": 120}
"""Most frames a second: players slow a GIF down whose frames last less than 1/50 s."""

GIF_COLORS = 255
"""Colours of one frame: the palette's last place is left to transparency."""

VIDEO_QUALITY = 8
"""Of imageio's 0..10: no visible blocks around edges, about a tenth of the GIF's size."""


def check_animation(path: str | Path, size: tuple[int, int], fps: int, opaque: bool) -> None:
    """
    Check what `save_animation` needs, before anything is rendered.

    Parameters
    ----------
    path : str or Path
    size : (width, height) of int, pixels
    fps : int
    opaque : bool
        Whether the frames have no transparent pixels.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is unknown, ``fps`` is not in 1..50 (GIF) or
        1..120; for MP4 also if ffmpeg is not installed, a side is odd, or ``opaque`` is false.
    """
    place = checked_path(path, ANIMATION_FORMATS)
    suffix = place.suffix.lower()
    if not 1 <= fps <= FASTEST[suffix]:
        raise ValueError(f"fps must be in 1..{FASTEST[suffix]} for {suffix}, got {fps!r}")
    if suffix != ".mp4":
        return
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ValueError('.mp4 needs imageio-ffmpeg; pip install "rasterjit[video]"')
    if size[0] % 2 or size[1] % 2:
        raise ValueError(f"size must have even sides for .mp4, got {size[0]}x{size[1]}")
    if not opaque:
        raise ValueError(".mp4 cannot be transparent: choose another background, .gif or .webp")


def save_animation(path: str | Path, frames: Iterable[NDArray[np.uint8]], fps: int) -> None:
    """
    Write an animation that repeats for ever; the format follows the extension.

    Parameters
    ----------
    path : str or Path
        Ends in one of ``ANIMATION_FORMATS``. An existing file is replaced at the end.
    frames : iterable of (H, W, 4) uint8
        At least one, all of one size; taken one at a time. GIF keeps at most 255 colours of each
        and makes pixels of alpha below 128 transparent.
    fps : int
        Frames a second; a GIF's frames last whole hundredths of a second.

    Raises
    ------
    ValueError
        If the folder does not exist or the extension is unknown.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    place = checked_path(path, ANIMATION_FORMATS)
    suffix = place.suffix.lower()
    with replacing(place) as temporary:
        if suffix == ".mp4":
            _write_video(temporary, frames, fps)
            return
        options: dict[str, Any] = {"disposal": 2} if suffix == ".gif" else {"lossless": True}
        encode = _indexed if suffix == ".gif" else _full_color
        pictures = (encode(frame) for frame in frames)
        first = next(pictures)
        duration = round(100 / fps) * 10 if suffix == ".gif" else round(1000 / fps)
        first.save(
            temporary, save_all=True, append_images=pictures, duration=duration, loop=0, **options
        )


def _full_color(frame: NDArray[np.uint8]) -> Image.Image:
    """Return a frame as Pillow's picture."""
    from PIL import Image

    return Image.fromarray(frame)


def _indexed(frame: NDArray[np.uint8]) -> Image.Image:
    """Return a frame with a palette of its own, and one place for transparency if it has any."""
    from PIL import Image

    clear = frame[:, :, 3] < 128
    picture = Image.fromarray(np.ascontiguousarray(frame[:, :, :3])).quantize(
        GIF_COLORS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    if clear.any():
        picture.paste(GIF_COLORS, mask=Image.fromarray(clear))
        picture.info["transparency"] = GIF_COLORS
    return picture


def _write_video(path: Path, frames: Iterable[NDArray[np.uint8]], fps: int) -> None:
    """Encode H.264 with ffmpeg, through imageio."""
    import imageio.v2 as iio

    frames = iter(frames)
    first = next(frames)
    # ffmpeg is started by the first frame: until then nothing can be left running.
    writer = iio.get_writer(
        path, format="FFMPEG", fps=fps, quality=VIDEO_QUALITY, macro_block_size=2
    )
    # The writer's own context manager leaves ffmpeg running after an error.
    with contextlib.closing(writer):
        for frame in itertools.chain([first], frames):
            writer.append_data(np.ascontiguousarray(frame[:, :, :3]))
