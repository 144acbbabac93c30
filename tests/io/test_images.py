import itertools
import re
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from opengl import optional_module
from PIL import Image

from rasterjit.io import images
from rasterjit.outputs import save

LOSSLESS = (".png", ".bmp", ".tif", ".tiff", ".webp")


def picture(channels=4, seed=1):
    shape = (13, 17) if channels == 1 else (13, 17, channels)
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


def files(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("suffix", images.IMAGE_FORMATS)
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_every_format_is_written_and_nothing_else(tmp_path, suffix, channels):
    path = tmp_path / f"picture{suffix}"
    image = picture(channels)
    if suffix in images.OPAQUE_FORMATS and channels == 4:
        image[..., 3] = 255
    images.save_image(path, image)
    assert files(tmp_path) == [path.name]
    assert iio.imread(path, plugin="pillow").shape[-3:][:2] in ((13, 17), (1, 13))


@pytest.mark.parametrize("suffix", LOSSLESS)
@pytest.mark.parametrize("channels", [3, 4])
def test_lossless_formats_keep_every_color(tmp_path, suffix, channels):
    path = tmp_path / f"picture{suffix}"
    image = picture(channels)
    # WebP forgets the colour of a fully transparent pixel.
    image[..., 3:] |= 255 if suffix in images.OPAQUE_FORMATS else 1
    images.save_image(path, image)
    kept = 3 if suffix in images.OPAQUE_FORMATS else channels
    np.testing.assert_array_equal(iio.imread(path, plugin="pillow")[..., :kept], image[..., :kept])


@pytest.mark.parametrize("suffix", images.OPAQUE_FORMATS)
def test_a_transparent_picture_is_refused_where_it_would_turn_opaque(tmp_path, suffix):
    image = np.full((2, 3, 4), 255, np.uint8)
    image[1, 2, 3] = 254
    with pytest.raises(ValueError, match=rf"{suffix} knows no transparency, and 1 of 6 .* \.png"):
        images.save_image(tmp_path / f"a{suffix}", image)
    assert not files(tmp_path)


def test_a_gif_is_transparent_where_alpha_is_below_a_half(tmp_path):
    image = np.full((4, 4, 4), 200, np.uint8)
    image[..., 3] = np.array([0, 127, 128, 255], np.uint8)
    images.save_image(tmp_path / "a.gif", image)
    with Image.open(tmp_path / "a.gif") as stored:
        shown = np.array(stored.convert("RGBA"))
    assert shown[0, :, 3].tolist() == [0, 0, 255, 255]
    assert (shown[:, 2:, :3] == 200).all()


def test_extension_may_be_in_capitals_and_the_path_a_string(tmp_path):
    images.save_image(str(tmp_path / "A.PNG"), picture())
    np.testing.assert_array_equal(iio.imread(tmp_path / "A.PNG"), picture())


def test_existing_picture_is_replaced(tmp_path):
    path = tmp_path / "a.png"
    images.save_image(path, picture(seed=1))
    images.save_image(path, picture(seed=2))
    np.testing.assert_array_equal(iio.imread(path, plugin="pillow"), picture(seed=2))
    assert files(tmp_path) == ["a.png"]


def test_failed_write_leaves_the_existing_file_whole(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    images.save_image(path, picture())

    def fail(place, *_args, **_options):
        place.write_bytes(b"half a pic")
        raise OSError("disk full")

    monkeypatch.setattr(images, "_write_pixels", fail)
    with pytest.raises(OSError, match="disk full"):
        images.save_image(path, picture(seed=2))
    np.testing.assert_array_equal(iio.imread(path, plugin="pillow"), picture())
    assert files(tmp_path) == ["a.png"]


@pytest.mark.parametrize("name", ["a", "a.txt", "a.png.gz", "missing/a.png"])
def test_bad_paths_are_named_before_anything_is_written(tmp_path, name):
    with pytest.raises(ValueError, match=re.escape(repr(str(Path(name)))[1:-1])):
        images.save_image(tmp_path / name, picture())
    assert not files(tmp_path)


def test_a_folder_is_not_a_file(tmp_path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(ValueError, match="is a folder"):
        images.save_image(tmp_path / "a.png", picture())


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 4, 4), np.float32),
        np.zeros((4, 4, 2), np.uint8),
        np.zeros((4, 4, 1), np.uint8),
        np.zeros((4,), np.uint8),
        np.zeros((0, 4, 4), np.uint8),
    ],
)
def test_bad_images_are_named(tmp_path, image):
    with pytest.raises(ValueError, match="image"):
        images.save_image(tmp_path / "a.png", image)
    assert not files(tmp_path)


def test_arrays_come_back_by_name(tmp_path):
    arrays = {
        "face_id": np.arange(6, dtype=np.int32).reshape(2, 3),
        "depth": np.ones(4, np.float32),
    }
    images.save_arrays(tmp_path / "a.npz", **arrays)
    assert files(tmp_path) == ["a.npz"]
    with np.load(tmp_path / "a.npz") as loaded:
        assert set(loaded) == set(arrays)
        for name, array in arrays.items():
            np.testing.assert_array_equal(loaded[name], array)
            assert loaded[name].dtype == array.dtype


def test_arrays_need_a_name_and_npz(tmp_path):
    with pytest.raises(ValueError, match="npz"):
        images.save_arrays(tmp_path / "a.png", a=np.ones(2))
    with pytest.raises(ValueError, match="arrays"):
        images.save_arrays(tmp_path / "a.npz")
    assert not files(tmp_path)


def test_a_refused_file_is_named_as_it_was_asked_for(tmp_path):
    path = tmp_path / "a.png"

    def write(temporary):
        raise PermissionError(13, "Permission denied", str(temporary))

    with pytest.raises(PermissionError) as refusal, images.atomic_file(path) as temporary:
        write(temporary)
    assert refusal.value.filename == str(path)
    assert temporary.name not in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", ["x" * 300 + ".png", "a\0b.png", "\ud800.png"])
def test_a_path_that_cannot_be_is_named(path, tmp_path):
    with pytest.raises(ValueError, match="path "):
        images.save_image(tmp_path / path, picture())


@pytest.mark.parametrize("name", ["name:stream.png", "what?.png", "\U0001f986" * 126 + ".png"])
def test_a_name_that_windows_cannot_have_is_refused_there(name, tmp_path, monkeypatch):
    monkeypatch.setattr(images, "IS_WINDOWS", True)
    with pytest.raises(ValueError, match="path must be a name that a file can have"):
        images.save_image(tmp_path / name, picture())
    images.save_image(tmp_path / "größe 1.png", picture())


FULL = """
import resource, sys
import numpy as np
from rasterjit.io import images
from rasterjit.outputs.save import save_outputs
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
chance = np.random.default_rng(1)
for place, kind in zip(sys.argv[1::2], sys.argv[2::2]):
    try:
        if kind == "depth":
            save_outputs(place, {"depth": chance.random((64, 64), np.float32)})
        else:
            images.save_image(place, chance.integers(0, 256, (64, 64, 3), np.uint8))
        print("saved")
    except OSError as error:
        print(error.filename == place and place in str(error))
"""
"""The system lets no file grow beyond 4 kB, as on a disk that is full."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows limits no file's size")
def test_a_file_that_the_disk_does_not_hold_is_named(tmp_path):
    optional_module("OpenEXR")
    # Pillow takes a JPEG that is cut short for a whole one.
    asked = [
        *((str(tmp_path / f"depth{suffix}"), "depth") for suffix in save.FORMATS),
        *((str(tmp_path / f"picture{suffix}"), "picture") for suffix in images.IMAGE_FORMATS),
    ]
    done = subprocess.run(
        [sys.executable, "-c", FULL, *itertools.chain(*asked)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    said = dict(zip(asked, done.stdout.splitlines(), strict=True))
    assert {one: text for one, text in said.items() if text != "True"} == {}, done.stderr
    assert files(tmp_path) == []
