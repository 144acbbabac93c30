"""Laws of textures: decoding, validation, mip levels, files."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import struct
import warnings
import zlib
from fractions import Fraction
from pathlib import Path

import naive_textures as naive
import numpy as np
import pytest
from PIL import Image, PngImagePlugin

import rasterjit as rj
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.mip_levels import level_sizes
from rasterjit.scene.texture import FILTERS, MAX_LIGHT, MAX_SIDE, WRAPS


def test_codes_are_srgb_and_floats_are_linear():
    assert rj.Texture(np.uint8([[188]])).image[0, 0, 0] == np.float32(0.502886458033)
    assert rj.Texture(np.uint16([[257 * 188]])).image[0, 0, 0] == np.float32(0.502886458033)
    assert rj.Texture(np.float64([[0.3]])).image[0, 0, 0] == np.float32(0.3)


def test_sixteen_bits_hold_the_eight_bit_codes():
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    wide = rj.Texture(codes.astype(np.uint16) * np.uint16(257)).image
    assert (wide == rj.Texture(codes).image).all()
    assert (wide[:, :, 0] == srgb_to_linear(codes)).all()


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_bytes_as_floats_are_named_at_the_callers_line(kind):
    photograph = np.random.default_rng(5).integers(0, 200, (16, 16, 3), np.uint8)
    codes = (photograph, photograph[..., 0], np.uint8([[[0, 255, 0, 1]]]))
    for image in codes:
        with pytest.warns(UserWarning, match=r"whole numbers up to .* must be uint8") as caught:
            rj.Texture(image.astype(kind))
        assert (len(caught), caught[0].filename) == (1, __file__)


def test_light_that_is_brighter_than_white_is_no_mistake():
    random = np.random.default_rng(6).random((16, 16, 3))
    lamp = np.zeros((16, 16, 3))
    lamp[2, 3] = 200.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for image in (random * 300.0, lamp, lamp + 4.0, np.full((2, 2), 5.0), random.round(),
                      np.arange(300.0).reshape(30, 10)):  # fmt: skip
            rj.Texture(image)


def test_sixteen_bit_codes_are_decoded_to_float32():
    codes = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    encoded = codes.astype(np.float64) / 65535
    curve = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    linear = rj.Texture(codes).image[:, :, 0]
    assert (np.abs(linear - curve) <= np.spacing(curve.astype(np.float32)) / 2 * 1.000001).all()
    assert (np.diff(linear.ravel()) > 0).all()
    assert (linear[0, 0], linear[-1, -1]) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("pixel", "rgba"),
    [
        (255, (1, 1, 1, 1)),
        ([255], (1, 1, 1, 1)),
        ([255, 51], (1, 1, 1, 0.2)),
        ([255, 0, 0], (1, 0, 0, 1)),
        ([255, 0, 0, 51], (1, 0, 0, 0.2)),
    ],
)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_grey_and_alpha_are_filled_in(pixel, rgba, kind):
    image = np.array([[pixel]], np.float64)
    scale = {np.uint8: 1, np.uint16: 257, np.float32: 1 / 255}[kind]
    texture = rj.Texture(np.round(image * scale, 6).astype(kind))
    assert texture.image.shape == (1, 1, 4)
    assert texture.image[0, 0].tolist() == [np.float32(value) for value in rgba]
    assert texture.is_opaque == (rgba[3] == 1)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_integers_of_a_linear_picture_are_shares_of_one(kind):
    most = np.iinfo(kind).max
    codes = np.array([[[0, 1, most // 2], [most, 77, most - 1]]], kind)
    texture = rj.Texture(codes, color_space="linear")
    assert (texture.image[..., :3] == codes.astype(np.float32) / np.float32(most)).all()
    assert (rj.Texture(codes).image[0, 0, 2] != texture.image[0, 0, 2]).all()
    # Floats are linear anyway, and alpha is.
    floats = np.random.default_rng(1).random((2, 2, 4))
    assert (rj.Texture(floats, color_space="linear").image == rj.Texture(floats).image).all()
    grey = np.array([[[0, most // 3]]], kind)
    images = [rj.Texture(grey, color_space=space).image for space in ("srgb", "linear")]
    assert (images[0] == images[1]).all()


def test_a_moved_copy_shares_everything_but_the_transform():
    texture = rj.Texture(np.random.default_rng(1).random((4, 6, 4)), wrap="clamp", anisotropy=4)
    moved = texture.with_transform((0.5, 1), 30, [2, -1])
    assert (moved.offset, moved.rotation, moved.scale) == ((0.5, 1.0), 30.0, (2.0, -1.0))
    assert (moved.wrap, moved.filter, moved.anisotropy) == (("clamp", "clamp"), "trilinear", 4)
    assert np.shares_memory(texture.image, moved.image)
    assert np.shares_memory(texture.levels[1], moved.levels[1])
    assert moved != texture
    assert texture.transform is None
    assert moved.with_transform().transform is None
    sine, cosine = 0.5, np.sqrt(0.75)
    assert moved.transform == (2 * cosine, sine, 0.5, 2 * sine, -cosine, 1.0)


@pytest.mark.parametrize(
    "make", [copy.copy, copy.deepcopy, lambda t: pickle.loads(pickle.dumps(t))]
)
def test_copies_keep_every_setting(make):
    texture = rj.Texture(np.random.default_rng(1).random((4, 6, 4)), anisotropy=4).with_transform(
        (0.5, 1), 30, (2, -1)
    )
    other = make(texture)
    assert repr(other) == repr(texture)
    assert (other.image == texture.image).all()
    assert (other.levels[2] == texture.levels[2]).all()
    assert not other.image.flags.writeable


def test_the_lowest_alpha_is_that_of_any_texel():
    pixels = np.ones((3, 4, 4))
    assert rj.Texture(pixels).lowest_alpha == 1.0
    pixels[2, 1, 3] = 0.25
    assert rj.Texture(pixels).lowest_alpha == 0.25
    assert not rj.Texture(pixels).is_opaque


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (5, 3)])
@pytest.mark.parametrize("filter", FILTERS)
def test_pictures_of_any_size_are_drawn(shape, filter):
    image = np.random.default_rng(3).random(shape).astype(np.float32)
    places = [(0.0, 0.0), (0.25, 0.75), (0.5, 0.5), (1.0, 1.0), (-0.375, 2.125)]
    shown = naive.probe(rj.Texture(image, filter=filter), places)[:, 0]
    lookup = naive.nearest if filter == "nearest" else naive.bilinear
    for (u, v), value in zip(places, shown, strict=True):
        exact = lookup(naive.exact_image(image), Fraction(u), Fraction(v), ("repeat", "repeat"))
        assert abs(value - float(exact)) <= 8 * 2.0**-24


def test_a_texture_is_frozen_and_owns_its_picture():
    pixels = np.zeros((2, 3), np.float32)
    texture = rj.Texture(pixels)
    pixels[:] = 1.0
    assert texture.size == (3, 2)
    assert not texture.image[..., :3].any()
    assert not any(level.flags.writeable for level in (texture.image, *texture.levels))
    with pytest.raises(dataclasses.FrozenInstanceError):
        texture.filter = "nearest"
    # Textures are told apart as objects: comparing them reads no texels.
    other = dataclasses.replace(texture)
    assert texture != other
    assert len({texture, texture, other}) == 2


def test_another_filter_keeps_the_picture():
    texture = rj.Texture(np.uint8([[1, 2], [3, 188]]), wrap="clamp")
    other = dataclasses.replace(texture, filter="nearest")
    assert (other.image == texture.image).all()
    assert (other.wrap, other.filter) == (("clamp", "clamp"), "nearest")


def test_the_picture_is_kept_once_whether_or_not_levels_are_made():
    texture = rj.Texture(np.random.default_rng(1).random((4, 6, 4)))
    before = texture.image
    assert texture.levels[0].shape == before.shape
    assert (texture.image == before).all()
    assert np.shares_memory(texture.image, texture.levels[0])


@pytest.mark.parametrize("wrap", WRAPS)
def test_one_wrap_stands_for_both_axes(wrap):
    assert rj.Texture([[0.0]], wrap=wrap).wrap == (wrap, wrap)
    assert rj.Texture([[0.0]], wrap=("clamp", wrap)).wrap == ("clamp", wrap)
    assert rj.Texture([[0.0]], wrap=["clamp", wrap]).wrap == ("clamp", wrap)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((0, 4)), "texels wide and high"),
        (np.zeros((4, 0, 3)), "texels wide and high"),
        (np.zeros((1, MAX_SIDE + 1)), "texels wide and high"),
        (np.zeros(4), "shape"),
        (np.zeros((2, 2, 5)), "shape"),
        (np.zeros((2, 2, 0)), "shape"),
        (np.zeros((1, 2, 2, 3)), "shape"),
        ([[0.0, 1.0], [0.0]], "unequal length"),
        (np.zeros((2, 2), np.int64), "int64"),
        (np.zeros((2, 2), bool), "bool"),
        (np.zeros((2, 2), complex), "complex"),
        ("wood.png", r"uint8, .*got 'wood\.png'; Texture\.from_file reads pictures"),
        (Path("wood.png"), r"wood\.png.*; Texture\.from_file reads pictures"),
        (None, "uint8, .*got None"),
        ({}, "uint8, .*got dict"),
        (np.zeros((2, 2), object), r"got an array of object with shape \(2, 2\)"),
        ([[float("nan")]], "linear light in 0..1e.06, got 1 NaN among"),
        ([[float("inf")]], "linear light"),
        ([[-0.001]], "linear light"),
        ([[MAX_LIGHT * 1.01]], "linear light"),
        ([[[0.5, 0.5, 0.5, 1.5]]], "alpha"),
        ([[[0.5, float("nan")]]], "alpha"),
    ],
)
def test_what_is_no_picture_is_refused(image, words):
    with pytest.raises(ValueError, match=f"image must .*{words}"):
        rj.Texture(image)


@pytest.mark.parametrize(
    "options",
    [
        {"wrap": "tile"}, {"wrap": None}, {"wrap": ("repeat",)}, {"wrap": ("repeat", 3)},
        {"wrap": ("repeat", "clamp", "mirror")}, {"filter": "cubic"}, {"filter": None},
        {"color_space": "rgb"}, {"color_space": None}, {"anisotropy": 3}, {"anisotropy": 32},
        {"anisotropy": True}, {"anisotropy": "2"}, {"anisotropy": 2, "filter": "bilinear"},
        {"anisotropy": 16, "filter": "nearest"}, {"offset": 1.0}, {"offset": (0.0, float("nan"))},
        {"offset": (0.0, 1e7)}, {"rotation": float("inf")}, {"rotation": "90"}, {"scale": (1.0,)},
        {"scale": (1e7, 1.0)}, {"scale": (1.0, None)},
    ],
)  # fmt: skip
def test_unknown_options_are_refused_by_name(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        rj.Texture([[0.0]], **options)


@pytest.mark.parametrize("filter", FILTERS)
def test_a_material_takes_a_texture_and_changes_nothing_of_it(filter):
    texture = rj.Texture([[0.5]], filter=filter)
    material = rj.Material(base_color_texture=texture)
    assert material.base_color is None
    assert material.base_color_over(False) == (1.0, 1.0, 1.0, 1.0)
    assert rj.Material("phong", "red", base_color_texture=texture).base_color == (1, 0, 0, 1)
    assert material == rj.Material(base_color_texture=texture)
    with pytest.raises(ValueError, match="base_color_texture must be a Texture"):
        rj.Material(base_color_texture="wood.png")
    with pytest.raises(ValueError, match=r"got an array of float64 with shape \(4, 4, 3\)$"):
        rj.Material(base_color_texture=np.zeros((4, 4, 3)))


# Mip levels


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (3, 5), (6, 7), (1, 9), (16, 4), (13, 31)])
def test_levels_equal_exact_means_by_area(shape):
    image = np.random.default_rng(2).integers(0, 1000, shape).astype(np.float32)
    levels = rj.Texture(image).levels
    exact = naive.mip_chain(naive.exact_image(image))
    assert [level.shape[1::-1] for level in levels] == level_sizes(shape[1], shape[0])
    assert len(levels) == len(exact)
    for level, rows in zip(levels, exact, strict=True):
        assert level[..., 0].tolist() == [[float(np.float32(float(t))) for t in r] for r in rows]


@pytest.mark.parametrize("shape", [(5, 3), (100, 75), (31, 64)])
def test_every_level_has_the_mean_of_the_picture(shape):
    image = np.random.default_rng(5).random(shape)
    texture = rj.Texture(image)
    mean = texture.image.mean(axis=(0, 1), dtype=np.float64)
    # Texels are below 1 and are rounded to float32 once on every level.
    for level in texture.levels:
        assert np.abs(level.mean(axis=(0, 1), dtype=np.float64) - mean).max() <= 2.0**-24


def test_levels_are_means_of_light_not_of_codes():
    texture = rj.Texture(np.uint8([[0, 255]]))
    assert texture.levels[-1][0, 0].tolist() == [0.5, 0.5, 0.5, 1.0]


def test_the_last_level_is_rounded_once():
    image = np.random.default_rng(6).integers(0, 256, (64, 64)).astype(np.uint8)
    texture = rj.Texture(image)
    total = sum(Fraction(float(value)) for value in texture.image[..., 0].ravel())
    assert texture.levels[-1][0, 0, 0] == np.float32(float(total / image.size))


# Files


@pytest.mark.parametrize("extension", ["png", "bmp", "tif", "gif", "webp"])
def test_a_picture_file_is_a_texture(tmp_path, extension):
    codes = np.zeros((3, 5, 3), np.uint8)
    codes[0, 0] = 255
    path = tmp_path / f"a.{extension}"
    options = {"lossless": True} if extension == "webp" else {}
    Image.fromarray(codes).save(path, **options)
    texture = rj.Texture.from_file(path, wrap="mirror", filter="bilinear")
    assert (texture.image == rj.Texture(codes).image).all()
    assert (texture.wrap, texture.filter) == (("mirror", "mirror"), "bilinear")
    assert rj.Texture.from_file(str(path)).filter == "trilinear"
    moved = {"offset": (0.5, 0.25), "rotation": 30.0, "scale": (2.0, 3.0)}
    laid = rj.Texture.from_file(path, **moved)
    assert {name: getattr(laid, name) for name in moved} == moved
    flat = rj.Texture.from_file(path, color_space="linear", anisotropy=8)
    assert (flat.color_space, flat.anisotropy) == ("linear", 8)
    assert flat.image.max() == 1.0


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA"])
def test_every_kind_of_png_is_read(tmp_path, mode):
    image = Image.new("RGB", (2, 2), "white").convert(mode)
    image.save(tmp_path / "a.png")
    assert (rj.Texture.from_file(tmp_path / "a.png").image == 1.0).all()


def test_a_cmyk_picture_is_read_in_its_colours(tmp_path):
    Image.new("CMYK", (2, 2), (0, 255, 255, 0)).save(tmp_path / "a.tif")
    assert rj.Texture.from_file(tmp_path / "a.tif").image[0, 0].tolist() == [1, 0, 0, 1]


def test_sixteen_bits_of_a_file_are_kept(tmp_path):
    codes = np.uint16([[0, 1, 1000, 65535]])
    Image.fromarray(codes).save(tmp_path / "a.png")
    texture = rj.Texture.from_file(tmp_path / "a.png")
    assert (texture.image == rj.Texture(codes).image).all()


def test_a_file_that_is_no_picture_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"none\.png' does not exist"):
        rj.Texture.from_file(tmp_path / "none.png")
    (tmp_path / "text.png").write_text("no picture")
    with pytest.raises(ValueError, match=r"text\.png' is not: "):
        rj.Texture.from_file(tmp_path / "text.png")
    Image.effect_noise((64, 64), 50).save(tmp_path / "half.png")
    (tmp_path / "half.png").write_bytes((tmp_path / "half.png").read_bytes()[:2000])
    with pytest.raises(ValueError, match=r"half\.png' is not: "):
        rj.Texture.from_file(tmp_path / "half.png")
    (tmp_path / "empty.png").write_bytes(b"")
    with pytest.raises(ValueError, match=r"empty\.png' is empty"):
        rj.Texture.from_file(tmp_path / "empty.png")
    # Its header alone says so: Pillow makes a byte of each bit.
    Image.new("1", (1, 1)).save(tmp_path / "huge.png")
    content = bytearray((tmp_path / "huge.png").read_bytes())
    content[16:24] = struct.pack(">II", 30000, 30000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "huge.png").write_bytes(content)
    with pytest.raises(ValueError, match=r"huge\.png' must have at most"):
        rj.Texture.from_file(tmp_path / "huge.png")


def test_whatever_pillow_raises_about_a_file_names_it(tmp_path, monkeypatch):
    Image.new("L", (2, 2)).save(tmp_path / "odd.png")

    def fails(*arguments, **options):
        raise OverflowError

    monkeypatch.setattr(PngImagePlugin.PngImageFile, "load", fails)
    with pytest.raises(ValueError, match=r"odd\.png' is not: OverflowError"):
        rj.Texture.from_file(tmp_path / "odd.png")
