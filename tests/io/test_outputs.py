"""Outputs come back from their files as what they were, and the files say what they mean."""

from __future__ import annotations

import errno
import re
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from opengl import optional_module
from PIL import Image

from rasterjit.io import images
from rasterjit.outputs import save

inf, nan = np.inf, np.nan
RNG = np.random.default_rng(7)
DEPTH = np.array([[2.5, inf, 4.0], [3.0, 9.75, 8.5]], np.float32)
IDS = np.array([[-1, 0, 5], [65534, 7, -1]], np.int32)
NORMAL = np.zeros((2, 3, 3), np.float32)
NORMAL[0, 0], NORMAL[0, 1], NORMAL[1, 2] = (0, 0, 1), (-1, 0, 0), (0.6, -0.8, 0)
MOTION = np.array([[[0, 0], [1.5, -2.25], [nan, nan]]] * 2, np.float32)


def decoded(data):
    """Decode a 16-bit PNG the slow way: the pixels, (H, W, C), and the texts."""
    assert data[:8] == bytes([137, 80, 78, 71, 13, 10, 26, 10])
    place, chunks = 8, []
    while place < len(data):
        (length,) = struct.unpack_from(">I", data, place)
        kind, content = data[place + 4 : place + 8], data[place + 8 : place + 8 + length]
        (check,) = struct.unpack_from(">I", data, place + 8 + length)
        assert check == zlib.crc32(kind + content)
        chunks.append((kind, content))
        place += 12 + length
    assert (chunks[0][0], chunks[-1]) == (b"IHDR", (b"IEND", b""))
    width, height, bits, color, *rest = struct.unpack(">IIBBBBB", chunks[0][1])
    assert (bits, rest) == (16, [0, 0, 0])
    channels = {0: 1, 2: 3}[color]
    rows = zlib.decompress(b"".join(c for k, c in chunks if k == b"IDAT"))
    length, above, image = 2 * channels * width, bytes(2 * channels * width), []
    for row in range(height):
        line = rows[row * (length + 1) : (row + 1) * (length + 1)]
        assert line[0] == 2
        above = bytes((a + b) % 256 for a, b in zip(line[1:], above, strict=True))
        image.append(struct.unpack(f">{channels * width}H", above))
    texts = dict(c.decode("latin-1").split("\0") for k, c in chunks if k == b"tEXt")
    return np.array(image).reshape(height, width, channels), texts


def saved(folder, name, array, scale=None):
    """Save one output as PNG; return its codes, its values by the file's own words, its texts."""
    path = folder / "a.png"
    save.save_outputs(path, {name: array}, scale=scale)
    assert [place.name for place in folder.iterdir()] == ["a.png"]
    codes, texts = decoded(path.read_bytes())
    assert texts["Title"] == name
    assert Image.open(path).text == texts
    return codes, codes * float(texts["scale"]) + float(texts["offset"]), texts


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (1, 9, 3), (6, 1, 3), (33, 20, 3)])
def test_sixteen_bits_come_back(shape):
    pixels = RNG.integers(0, 65536, shape).astype(np.uint16)
    codes, texts = decoded(images.encode_png(pixels, {"a": "b", "unit": "é"}))
    assert np.array_equal(codes.reshape(shape), pixels)
    assert texts == {"a": "b", "unit": "é"}


@pytest.mark.parametrize("shape", [(13, 17), (13, 17, 3)])
def test_other_decoders_read_sixteen_bits(shape, tmp_path):
    pixels = RNG.integers(0, 65536, shape).astype(np.uint16)
    (tmp_path / "a.png").write_bytes(images.encode_png(pixels, {"a": "b"}))
    with Image.open(tmp_path / "a.png") as image:
        image.load()
        assert image.text == {"a": "b"}
        if len(shape) == 2:
            assert np.array_equal(np.array(image), pixels)
        else:
            # Pillow keeps the high byte of each.
            assert np.array_equal(np.array(image), pixels >> 8)
    cv2 = pytest.importorskip("cv2")
    read = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(read[..., ::-1] if len(shape) == 3 else read, pixels)


@pytest.mark.parametrize(
    ("pixels", "texts"),
    [
        (np.zeros((2, 2), np.int16), {}), (np.zeros((2, 2, 2), np.uint16), {}),
        (np.zeros((0, 2), np.uint16), {}), (np.zeros((2, 2), np.uint16), {"": "a"}),
        (np.zeros((2, 2), np.uint16), {"a": "→"}), (np.zeros((2, 2), np.uint16), {"a": "\0"}),
    ],
)  # fmt: skip
def test_what_no_png_holds_is_refused(pixels, texts):
    with pytest.raises(ValueError, match=r"pixels|texts"):
        images.encode_png(pixels, texts)


def test_depth_comes_back_to_half_a_code_and_nothing_is_zero(tmp_path):
    codes, values, texts = saved(tmp_path, "depth", DEPTH)
    seen = np.isfinite(DEPTH)
    assert ((codes[..., 0] == 0) == ~seen).all()
    assert codes.max() == 65535
    assert float(texts["offset"]) == 0.0
    assert abs(values[..., 0] - DEPTH)[seen].max() <= 0.5001 * float(texts["scale"])
    assert texts["unit"] == "scene units along the viewing axis"
    assert texts["zero"] == "nothing is there"


def test_a_scale_is_kept_as_given(tmp_path):
    codes, _, texts = saved(tmp_path, "depth", DEPTH, scale=0.001)
    assert codes[..., 0].tolist() == [[2500, 0, 4000], [3000, 9750, 8500]]
    assert (texts["scale"], texts["offset"]) == ("0.001", "0.0")


@pytest.mark.parametrize(
    "array",
    [
        np.array([[-3.0, 5.0, nan]]), np.array([[0.0, 1e-7, inf]]), np.array([[4.0, 4.0, nan]]),
        np.array([[0.0, 0.0, nan]]), np.array([[-2.0, -2.0, -inf]]), np.array([[1e-9, 1e9, nan]]),
    ],
)  # fmt: skip
def test_any_range_of_an_unknown_output_fits(tmp_path, array):
    array = array.astype(np.float32)
    codes, values, texts = saved(tmp_path, "temperature", array)
    seen = np.isfinite(array)
    assert ((codes[..., 0] > 0) == seen).all()
    error = abs(values[..., 0] - array)[seen].max()
    assert error <= 0.5001 * float(texts["scale"])
    span = np.ptp(array[seen])
    assert span == 0.0 or float(texts["scale"]) <= span / 65533


def test_an_empty_picture_is_all_zero(tmp_path):
    codes, _, _ = saved(tmp_path, "distance", np.full((2, 3), inf, np.float32))
    assert not codes.any()


def test_numbers_are_one_more_and_nothing_is_zero(tmp_path):
    codes, values, _ = saved(tmp_path, "object_id", IDS)
    assert np.array_equal(codes[..., 0], IDS + 1)
    assert np.array_equal(values[..., 0], IDS)


def test_normals_come_back_to_half_a_code(tmp_path):
    codes, values, texts = saved(tmp_path, "geometric_normal", NORMAL)
    assert texts["unit"] == "unit vector, world space"
    seen = NORMAL.any(axis=2)
    assert ((codes != 0).all(axis=2) == seen).all()
    assert not codes[~seen].any()
    assert codes[0, 0].tolist() == [32768, 32768, 65535]
    assert codes[0, 1].tolist() == [1, 32768, 32768]
    assert abs(values - NORMAL)[seen].max() <= 0.5001 / 32767


def test_positions_share_one_scale(tmp_path):
    position = RNG.normal(size=(4, 5, 3)).astype(np.float32) * [1, 10, 0.1]
    position[1, 2] = nan
    codes, values, texts = saved(tmp_path, "position", position.astype(np.float32))
    seen = np.isfinite(position).all(axis=2)
    assert not codes[1, 2].any()
    assert codes[seen].min() == 1
    assert abs(values - position)[seen].max() <= 0.51 * float(texts["scale"])


def test_motion_is_stored_as_kitti_stores_flow(tmp_path):
    codes, _, _ = saved(tmp_path, "motion", MOTION)
    valid = codes[..., 2].astype(bool)
    assert np.array_equal(valid, np.isfinite(MOTION[..., 0]))
    assert set(codes[..., 2].ravel().tolist()) == {0, 1}
    assert np.array_equal((codes[valid][:, :2] - 2.0**15) / 64.0, MOTION[valid])


def test_two_channels_tell_in_blue_where_something_is(tmp_path):
    uv = np.array([[[0.25, 1.0], [nan, nan]]], np.float32)
    codes, values, texts = saved(tmp_path, "uv", uv)
    assert codes[0, :, 2].tolist() == [65535, 0]
    assert values[0, 0, :2] == pytest.approx(uv[0, 0], abs=1e-5)
    assert texts["zero"] == "nothing is there, where blue is 0"


def test_shares_have_a_fixed_range(tmp_path):
    codes, values, _ = saved(tmp_path, "coverage", np.array([[0.0, 0.5, 1.0]], np.float32))
    assert codes.ravel().tolist() == [0, 32768, 65535]
    cube = np.array([[[0, 0.5, 1], [nan, nan, nan]]], np.float32)
    codes, values, _ = saved(tmp_path, "nocs", cube)
    assert codes.tolist() == [[[1, 32768, 65535], [0, 0, 0]]]
    assert values[0, 0] == pytest.approx([0, 0.5, 1])
    codes, _, _ = saved(tmp_path, "barycentric", np.array([[[1, 0, 0], [0, 0, 0]]], np.float32))
    assert codes.tolist() == [[[65535, 1, 1], [0, 0, 0]]]


def test_yes_and_no_are_white_and_black(tmp_path):
    mask = np.array([[True, False]])
    save.save_outputs(tmp_path / "a.png", {"motion_visible": mask})
    assert np.array(Image.open(tmp_path / "a.png")).tolist() == [[255, 0]]


@pytest.mark.parametrize(
    ("arrays", "suffix", "scale", "named"),
    [
        ({"depth": DEPTH}, ".png", 1e-5, "scale"), ({"depth": DEPTH}, ".png", 1e3, "scale"),
        ({"depth": DEPTH}, ".png", -1.0, "scale"), ({"depth": DEPTH}, ".png", "a", "scale"),
        ({"depth": DEPTH}, ".npz", 1.0, "scale"), ({"object_id": IDS}, ".png", 1.0, "scale"),
        ({"normal": NORMAL}, ".png", 1.0, "scale"), ({"mask": IDS > 0}, ".png", 1.0, "scale"),
        ({"face_id": IDS + 1}, ".png", None, "face_id"), ({"x": IDS - 1}, ".png", None, "outputs"),
        ({"linear": np.ones((2, 2, 4), np.float32)}, ".png", None, "linear"),
        ({"motion": MOTION * 300}, ".png", None, "motion"),
        ({"depth": DEPTH, "object_id": IDS}, ".png", None, "one output"),
        ({"depth": DEPTH, "object_id": IDS}, ".npy", None, "one output"),
        ({"x": np.ones((2, 2, 5))}, ".exr", None, "outputs"), ({}, ".npz", None, "outputs"),
        ({"x": np.ones(3)}, ".npz", None, "outputs"), ({"x": IDS - 1}, ".exr", None, "outputs"),
        ({"depth": DEPTH}, ".jpg", None, "must end in"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_and_nothing_is_written(tmp_path, arrays, suffix, scale, named):
    with pytest.raises(ValueError, match=named):
        save.save_outputs(tmp_path / f"a{suffix}", arrays, scale=scale)
    assert list(tmp_path.iterdir()) == []


def read_exr(path):
    openexr = optional_module("OpenEXR")
    with openexr.File(str(path), separate_channels=True) as file:
        return {k: c.pixels.copy() for k, c in file.channels().items()}, dict(file.header())


def test_exr_holds_every_output_under_its_usual_name(tmp_path):
    light = RNG.random((2, 3, 4)).astype(np.float32)
    arrays = {
        "linear": light, "depth": DEPTH, "normal": NORMAL, "uv": MOTION, "motion": MOTION,
        "object_id": IDS, "motion_visible": IDS > 0, "distance": DEPTH * 2,
    }  # fmt: skip
    optional_module("OpenEXR")
    save.save_outputs(tmp_path / "a.exr", arrays)
    channels, header = read_exr(tmp_path / "a.exr")
    expected = {
        "A": light[..., 3], "Z": DEPTH, "distance": DEPTH * 2,
        "uv.U": MOTION[..., 0], "uv.V": MOTION[..., 1],
        "motion.X": MOTION[..., 0], "motion.Y": MOTION[..., 1],
        **{c: light[..., i] * light[..., 3] for i, c in enumerate("RGB")},
        **{f"normal.{c}": NORMAL[..., i] for i, c in enumerate("XYZ")},
        "object_id": (IDS + 1).astype(np.uint32), "motion_visible": (IDS > 0).astype(np.float32),
    }  # fmt: skip
    assert set(channels) == set(expected)
    for name, plane in expected.items():
        assert channels[name].dtype == plane.dtype, name
        np.testing.assert_array_equal(channels[name], plane)
    low, high = header["dataWindow"]
    assert (low.tolist(), high.tolist()) == ([0, 0], [2, 1])
    assert header["rasterjit.depth"] == "scene units along the viewing axis"
    assert "0 where nothing is" in header["rasterjit.object_id"]


def test_exr_decodes_the_colour(tmp_path):
    optional_module("OpenEXR")
    color = np.array([[[255, 188, 0, 255], [255, 255, 255, 51]]], np.uint8)
    save.save_outputs(tmp_path / "a.exr", {"color": color})
    channels, _ = read_exr(tmp_path / "a.exr")
    assert sorted(channels) == ["A", "B", "G", "R"]
    assert channels["G"][0, 0] == pytest.approx(((188 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-5)
    assert [channels[c][0, 1] for c in "RGBA"] == pytest.approx([0.2] * 4)


def test_exr_without_openexr_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(ImportError, match=r"rasterjit\[exr\]"):
        save.save_outputs(tmp_path / "a.exr", {"depth": DEPTH})
    assert list(tmp_path.iterdir()) == []


def test_channels_are_named_by_their_number():
    assert save.name_channels("coverage", 1) == ("coverage",)
    assert save.name_channels("nocs", 3) == ("nocs.X", "nocs.Y", "nocs.Z")
    assert save.name_channels("color", 4) == ("color.R", "color.G", "color.B", "color.A")


FULL = """
import errno, resource, signal, sys
from pathlib import Path
import numpy as np
from rasterjit.io import images

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
pixels = np.random.default_rng(0).random((200, 200)).astype(np.float32)
try:
    images.write_exr(Path(sys.argv[1]), {"Z": pixels})
except OSError as error:
    assert error.errno == errno.EFBIG, error
    assert error.filename == sys.argv[1], error
    print("told")
"""
"""The system lets no file grow beyond 4 kB, as on a disk that is full."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows limits no file's size")
def test_an_exr_that_the_disk_does_not_hold_is_the_systems_error(tmp_path):
    optional_module("OpenEXR")
    place = tmp_path / "a.exr"
    place.write_bytes(b"before")
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(place)], capture_output=True, text=True, check=False
    )
    assert done.stdout == "told\n", done.stderr
    assert place.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [place]


@pytest.mark.parametrize(
    ("said", "code", "told"),
    [
        ("cannot write {}. No space left on device.", errno.ENOSPC, "No space left on device"),
        ("{} broke.", errno.EIO, "{} broke."),
    ],
)
def test_what_openexr_says_in_words_names_the_file_that_was_asked_for(
    tmp_path, monkeypatch, said, code, told
):
    openexr = optional_module("OpenEXR")
    place = tmp_path / "a.exr"

    def write(self, path):
        raise RuntimeError(said.format(path))

    monkeypatch.setattr(openexr.File, "write", write)
    with pytest.raises(OSError, match="exr") as caught:
        images.write_exr(place, {"Z": DEPTH})
    assert (caught.value.errno, caught.value.filename) == (code, str(place))
    assert caught.value.strerror == told.format(place)


@pytest.mark.parametrize("power", [-40, -3, 0, 4, 38])
@pytest.mark.parametrize("most", [6553.6, 6554.9, 20000.0, 65534.9, 65535.4])
def test_a_decimal_scale_is_the_smallest_that_holds_the_values(power, most):
    scale = float(f"1e{power}")
    values = np.array([[most * scale, np.inf], [np.nan, 300.0 * scale]])
    assert save.find_decimal_scale(values) == scale
    codes = save.encode_output("depth", values, scale)
    assert (codes.pixels == [[np.floor(most + 0.5), 0], [0, 300]]).all()
    with pytest.raises(ValueError, match=re.escape(f"; choose {scale:g}, .exr or .npz")):
        save.encode_output("depth", values, scale / 10.0)


@pytest.mark.parametrize("values", [(0.0, 5.0), (-1.0, 5.0), (1.0, 1e6), (5e-324, 5e-324), ()])
def test_no_decimal_scale_holds_both_small_and_large_values(values):
    values = np.array([[*values, np.inf]])
    assert save.find_decimal_scale(values) is None
    if values.size > 1:
        with pytest.raises(ValueError, match=r"; choose \.exr or \.npz"):
            save.encode_output("depth", values, 1e-2)
