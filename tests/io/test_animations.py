"""Animations are written frame by frame, whole or not at all."""

import errno
import gc
import os
import signal
import subprocess
import sys
import time
import weakref
from contextlib import closing

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from rasterjit.animation import video
from rasterjit.animation.video import ANIMATION_FORMATS, save_animation

LOSSLESS = (".webp", ".apng")
W, H = 32, 20


def picture(number, alpha=255):
    """A band that moves over white; few colours, so that a GIF keeps them all."""
    pixels = np.full((H, W, 4), 255, np.uint8)
    pixels[5:15, number : number + 8] = (200, 10 * number, 30, 255)
    pixels[16:] = (0, 0, 0, alpha) if alpha else 0
    return pixels


def frames_of(path):
    """Read the frames of an animation, RGBA, with how long they last, ms."""
    with Image.open(path) as animation:
        found = []
        for number in range(animation.n_frames):
            animation.seek(number)
            pixels = np.array(animation.convert("RGBA"))
            found.append((pixels, animation.info.get("duration")))
        return found


@pytest.mark.parametrize("suffix", [".gif", *LOSSLESS])
@pytest.mark.parametrize("alpha", [0, 255])
def test_every_frame_is_read_back_bit_for_bit(tmp_path, suffix, alpha):
    pictures = [picture(number, alpha) for number in range(7)]
    path = tmp_path / f"a{suffix}"
    save_animation(path, pictures, fps=10)
    found = frames_of(path)
    assert len(found) == 7
    for (pixels, _), given in zip(found, pictures, strict=True):
        shown = given[:, :, 3] > 0
        assert np.array_equal(pixels[:, :, 3], given[:, :, 3])
        assert np.array_equal(pixels[shown], given[shown])
    assert [path.name for path in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".gif", *LOSSLESS])
def test_pictures_without_alpha_are_opaque(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    save_animation(path, [picture(0)[:, :, :3], picture(1), picture(2)[:, :, :3]], fps=10)
    for number, (pixels, _) in enumerate(frames_of(path)):
        assert np.array_equal(pixels, picture(number))


# imageio-ffmpeg leaves a pipe to a process that has ended to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_video_shows_what_it_was_given(tmp_path):
    path = tmp_path / "a.mp4"
    save_animation(path, (picture(number) for number in range(9)), fps=3)
    assert imageio_ffmpeg.count_frames_and_secs(path) == (9, 3.0)
    with closing(imageio_ffmpeg.read_frames(path)) as frames:
        assert next(frames)["size"] == (W, H)
        for number, data in enumerate(frames):
            frame = np.frombuffer(data, np.uint8).reshape(H, W, 3)
            assert np.abs(frame.astype(int) - picture(number)[:, :, :3]).mean() < 12


def test_equal_frames_are_not_merged(tmp_path):
    for suffix in (".gif", *LOSSLESS):
        path = tmp_path / f"still{suffix}"
        save_animation(path, [picture(3)] * 4, fps=10)
        assert len(frames_of(path)) == 4


@pytest.mark.parametrize("fps", [7, 24, 29.97, 30, 50])
def test_a_gif_lasts_as_long_as_was_asked_for(tmp_path, fps):
    path = tmp_path / "a.gif"
    save_animation(path, (picture(number % 20) for number in range(60)), fps)
    lasted = [duration for _, duration in frames_of(path)]
    assert abs(sum(lasted) - 60_000 / fps) <= 5
    assert max(lasted) - min(lasted) <= 10


@pytest.mark.parametrize("suffix", ANIMATION_FORMATS)
def test_no_frame_is_kept(tmp_path, suffix):
    alive, most = set(), []

    class Pixels(np.ndarray):
        """An array that can be seen to go."""

    def pictures():
        for number in range(30):
            one = picture(number % 20).view(Pixels)
            alive.add(number)
            weakref.finalize(one, alive.discard, number)
            yield one
            del one
            most.append(len(alive))

    save_animation(tmp_path / f"a{suffix}", pictures(), fps=20)
    assert len(most) == 30
    assert max(most) <= 3


MEASURE = """
import resource, sys
import numpy as np
from rasterjit.animation.video import save_animation

def pictures(count):
    noise = np.random.default_rng(0)
    for number in range(count):
        pixels = np.full((128, 160, 4), 255, np.uint8)
        pixels[:4, :, :3] = noise.integers(0, 255, (4, 160, 3))
        yield pixels

peaks = []
for count in (20, 320):
    save_animation(sys.argv[1], pictures(count), fps=25)
    peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
print(peaks[1] - peaks[0])
"""
"""300 frames more are 24 MB of pixels, a quarter of it in a palette's numbers."""


@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in KiB on Linux alone")
@pytest.mark.parametrize("suffix", ANIMATION_FORMATS)
def test_memory_does_not_grow_with_the_number_of_frames(tmp_path, suffix):
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, str(tmp_path / f"a{suffix}")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert int(done.stdout) < 5_000


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, GeneratorExit])
@pytest.mark.parametrize("old", [b"an old animation", None])
@pytest.mark.parametrize("suffix", ANIMATION_FORMATS)
def test_an_interrupted_animation_leaves_what_was_there(tmp_path, suffix, old, error):
    def pictures():
        for number in range(5):
            yield picture(number)
        raise error

    path = tmp_path / f"a{suffix}"
    if old is not None:
        path.write_bytes(old)
    with pytest.raises(error):
        save_animation(path, pictures(), fps=10)
    assert [place.read_bytes() for place in tmp_path.iterdir()] == [old] * (old is not None)


STEADY = """
import sys, time
import numpy as np
from rasterjit.animation.video import save_animation

def pictures():
    while True:
        yield np.full((20, 32, 4), 255, np.uint8)
        print("frame", flush=True)
        time.sleep(0.01)

save_animation(sys.argv[1], pictures(), fps=10)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
@pytest.mark.parametrize("suffix", ANIMATION_FORMATS)
def test_ctrl_c_leaves_no_file(tmp_path, suffix):
    with subprocess.Popen(
        [sys.executable, "-c", STEADY, str(tmp_path / f"a{suffix}")],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    ) as running:  # fmt: skip
        for _ in range(5):
            assert running.stdout.readline() == "frame\n"
        running.send_signal(signal.SIGINT)
        running.stdout.read()
        assert running.wait(30) != 0
    for _ in range(100):
        if not list(tmp_path.iterdir()):
            break
        time.sleep(0.05)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ffmpeg_that_fails_is_an_error_and_leaves_no_file(tmp_path, monkeypatch):
    options = {".webp": {"quality": None, "codec": "no_such_codec"}}
    monkeypatch.setattr(video, "FFMPEG_OPTIONS", options)
    with pytest.raises(OSError, match="ffmpeg"):
        save_animation(tmp_path / "a.webp", (picture(number % 20) for number in range(300)), 10)
    assert list(tmp_path.iterdir()) == []
    gc.collect()


@pytest.mark.parametrize("kept", [60, 0.5, 0.99])
@pytest.mark.parametrize("suffix", [".mp4", *LOSSLESS])
def test_what_ffmpeg_could_not_end_is_an_error(tmp_path, monkeypatch, suffix, kept):
    """As on a full disk: what has been written is cut off."""
    whole = imageio_ffmpeg.write_frames

    def cut(path, *arguments, **options):
        yield from whole(path, *arguments, **options)

    def short(path, *arguments, **options):
        try:
            yield from cut(path, *arguments, **options)
        finally:
            with open(path, "r+b") as file:
                size = file.seek(0, os.SEEK_END)
                file.truncate(kept if kept > 1 else int(kept * size))

    monkeypatch.setattr(imageio_ffmpeg, "write_frames", short)
    with pytest.raises(OSError, match="fewer than 3 frames"):
        save_animation(tmp_path / f"a{suffix}", [picture(number) for number in range(3)], 10)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("pictures", "name", "fps", "message"),
    [
        ([], "a.gif", 10, "pictures must hold at least one"),
        ([picture(0)], "a.png", 10, "must end in one of"),
        ([picture(0)], "nowhere/a.gif", 10, "does not exist"),
        ([picture(0)], "a.gif", 60, "fps must be in 1..50"),
        ([picture(0)], "a.webp", 0.5, "fps must be in 1..120"),
        ([picture(0)], "a.gif", "10", "fps must be"),
        ([picture(0)], "a.gif", float("nan"), "fps must be"),
        ([picture(0)[:, :, :2]], "a.gif", 10, "picture 0 must be"),
        ([picture(0)[:, :, 0]], "a.gif", 10, "picture 0 must be"),
        ([picture(0) / 255.0], "a.webp", 10, "picture 0 must be"),
        ([None], "a.gif", 10, "picture 0 must be"),
        ([picture(0), picture(0)[1:]], "a.gif", 10, "picture 1 must be of the first"),
        ([picture(0), picture(0)[1:]], "a.webp", 10, "picture 1 must be of the first"),
        ([picture(0)[1:]], "a.mp4", 10, "size must have even sides"),
        ([picture(0), picture(1, 200)], "a.mp4", 10, "picture 1 is transparent"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, pictures, name, fps, message):
    with pytest.raises(ValueError, match=message):
        save_animation(tmp_path / name, pictures, fps)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".mp4", *LOSSLESS])
def test_without_ffmpeg_the_extra_is_named(tmp_path, monkeypatch, suffix):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r'pip install "rasterjit\[video\]"'):
        save_animation(tmp_path / f"a{suffix}", [picture(0)], 10)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_names_the_file(tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("PIL.GifImagePlugin.getdata", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*a\.gif'"):
        save_animation(tmp_path / "a.gif", [picture(0)], 10)
    assert list(tmp_path.iterdir()) == []
