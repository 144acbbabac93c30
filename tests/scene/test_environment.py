"""Laws of environments, fog and tone maps: what they keep, what they refuse, what files hold."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import struct

import numpy as np
import pytest
from PIL import Image

import rasterjit as rj
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.environment import Panorama, SkyGradient


def test_a_panorama_is_frozen_and_owns_its_picture():
    pixels = np.ones((4, 8, 3))
    environment = rj.Environment(pixels, rotation=30)
    pixels[:] = 0.0
    assert environment.sky.image.dtype == np.float32
    assert environment.sky.image.min() == 1.0
    assert not environment.sky.image.flags.writeable
    assert (environment.intensity, environment.rotation, environment.background) == (
        1.0,
        30.0,
        True,
    )
    with pytest.raises(dataclasses.FrozenInstanceError):
        environment.intensity = 2.0
    for again in (copy.deepcopy(environment), pickle.loads(pickle.dumps(environment))):
        assert (again.sky.image == environment.sky.image).all()
        assert not again.sky.image.flags.writeable
    assert repr(environment.sky) == "Panorama(8×4)"


def test_a_turned_environment_shares_its_sky():
    environment = rj.Environment(np.ones((2, 4, 3)))
    assert dataclasses.replace(environment, rotation=90.0).sky is environment.sky


def test_colours_are_linear_and_lose_alpha():
    environment = rj.Environment.gradient("#0000ff80", (0.5, 0.5, 0.5), "black")
    assert environment.sky == SkyGradient((0.0, 0.0, 1.0), (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
    assert rj.Environment.constant("red").sky.zenith == (1.0, 0.0, 0.0)
    assert rj.Environment.constant("red", intensity=3, background=False).intensity == 3.0


def test_what_gives_no_light_is_known():
    assert rj.Environment.constant("red").lights
    assert not rj.Environment.constant("black").lights
    assert not rj.Environment.constant("red", intensity=0.0).lights
    assert not rj.Environment(np.ones((2, 4, 3)), intensity=0.0).lights


@pytest.mark.parametrize(
    ("sky", "message"),
    [
        (np.ones((4, 8)), r"sky must have shape \(H, W, 3\), got \(4, 8\)"),
        (np.ones((4, 8, 4)), r"sky must have shape \(H, W, 3\)"),
        (np.ones((4, 8, 3), np.uint8), "sky must hold floats"),
        (np.ones((0, 8, 3)), "sky must be 1..65536 texels wide and high"),
        (np.full((4, 8, 3), np.nan), r"sky must hold linear light in 0\.\.1e\+30"),
        (np.full((4, 8, 3), np.inf), "NaN or infinity in 32 of 32 texels"),
        (np.full((4, 8, 3), 1e31), r"got numbers up to 1e\+31"),
        ([[1.0], [1.0, 2.0]], "rows of unequal length"),
        ("sky.hdr", "sky must hold floats"),
    ],
)
def test_a_bad_sky_is_refused(sky, message):
    with pytest.raises(ValueError, match=message):
        rj.Environment(sky)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("intensity", -1.0), ("intensity", math.nan), ("intensity", "bright"), ("intensity", 1e31),
        ("rotation", math.inf), ("rotation", "left"), ("background", "white"), ("background", 1),
    ],
)  # fmt: skip
def test_a_bad_field_of_an_environment_is_refused(field, value):
    with pytest.raises(ValueError, match=f"{field} must"):
        rj.Environment(np.ones((2, 4, 3)), **{field: value})


def test_light_times_intensity_is_what_float32_holds():
    sky = Panorama(np.full((2, 4, 3), 1e12))
    assert rj.Environment(sky, intensity=1e18).sky.brightest == pytest.approx(1e12)
    with pytest.raises(ValueError, match=r"intensity must be at most 1e\+18 for a sky whose"):
        rj.Environment(sky, intensity=1e19)


@pytest.mark.parametrize(
    ("bad", "becomes", "said"),
    [
        (-1e-4, 0.0, "below 0 in 1 of 32 texels"),
        (-math.inf, 0.0, "NaN or infinite in 1 of 32 texels"),
        (math.nan, 0.0, "NaN or infinite in 1 of 32 texels"),
        (math.inf, 7.0, "NaN or infinite in 1 of 32 texels"),
    ],
)
def test_a_bad_texel_of_a_sky_is_clamped_and_told(bad, becomes, said):
    image = np.full((4, 8, 3), 2.0)
    image[0, 0], image[1, 2, 1] = 7.0, bad
    with pytest.warns(UserWarning, match=f"^sky: light is {said}, and was clamped"):
        sky = rj.Environment(image).sky.image
    assert sky[1, 2, 1] == becomes
    image[1, 2, 1] = becomes
    assert np.array_equal(sky, image.astype(np.float32))


def test_all_texels_below_0_are_counted_and_a_file_is_named(tmp_path):
    exr = pytest.importorskip("OpenEXR")
    image = np.ones((4, 8, 3), np.float32)
    image[2] = -0.001
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    with exr.File(header, {"RGB": image}) as file:
        file.write(str(tmp_path / "sky.exr"))
    with pytest.warns(UserWarning, match=r"sky\.exr: light is below 0 in 8 of 32") as caught:
        sky = rj.Environment.from_file(tmp_path / "sky.exr").sky
    assert len(caught) == 1
    assert (sky.image.min(), sky.image.max()) == (0.0, 1.0)


@pytest.mark.parametrize("name", ["zenith", "horizon", "ground"])
def test_a_bad_colour_of_a_gradient_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} must"):
        rj.Environment.gradient(**{name: (255, 0, 0)})


def radiance(rgbe, packed):
    """Return the bytes of a Radiance file."""
    height, width = rgbe.shape[:2]
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    if not packed:
        return head + rgbe.tobytes()
    rows = b""
    for row in rgbe:
        rows += struct.pack(">BBH", 2, 2, width)
        for channel in row.T:
            start = 0
            while start < width:
                run = 1
                while start + run < width and run < 127 and channel[start + run] == channel[start]:
                    run += 1
                if run > 2:
                    rows += bytes([128 + run, channel[start]])
                else:
                    run = min(3, width - start)
                    rows += bytes([run]) + channel[start : start + run].tobytes()
                start += run
    return head + rows


def shared_exponents(rng, height, width):
    rgbe = rng.integers(0, 256, (height, width, 4)).astype(np.uint8)
    rgbe[:, :, 3] = rng.integers(120, 140, (height, width))
    rgbe[: height // 2] = rgbe[0, 0]
    rgbe[-1, -1] = 7, 7, 7, 0
    return rgbe


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("width", [8, 31, 300])
def test_a_radiance_file_is_read(tmp_path, packed, width):
    rgbe = shared_exponents(np.random.default_rng(width), 6, width)
    rgbe[:, :, 0] |= 2
    path = tmp_path / "sky.hdr"
    path.write_bytes(radiance(rgbe, packed))
    image = rj.Environment.from_file(path).sky.image
    scale = np.where(rgbe[:, :, 3:] == 0, 0.0, 2.0 ** (rgbe[:, :, 3:].astype(float) - 136.0))
    assert (image == rgbe[:, :, :3] * scale).all()


@pytest.mark.parametrize("names", ["RGB", "RGBA", "Y"])
@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_an_exr_file_is_read(tmp_path, names, kind):
    exr = pytest.importorskip("OpenEXR")
    rng = np.random.default_rng(1)
    channels = {name: rng.uniform(0, 9, (4, 8)).astype(kind) for name in names}
    path = tmp_path / "sky.exr"
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    with exr.File(header, dict(channels)) as file:
        file.write(str(path))
    image = rj.Environment.from_file(str(path), rotation=10.0).sky.image
    for k, name in enumerate("YYY" if names == "Y" else "RGB"):
        assert (image[:, :, k] == channels[name].astype(np.float32)).all()


def test_an_ordinary_picture_is_decoded(tmp_path):
    pixels = np.random.default_rng(2).integers(0, 256, (4, 8, 4)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "sky.png")
    image = rj.Environment.from_file(tmp_path / "sky.png").sky.image
    assert (image == srgb_to_linear(pixels[:, :, :3])).all()


GOOD = radiance(shared_exponents(np.random.default_rng(3), 6, 32), True)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.hdr", b"#?RADIANCE\n"),
        ("a.hdr", b"not a picture at all"),
        ("a.hdr", GOOD[:-9]),
        ("a.hdr", GOOD[:70]),
        ("a.hdr", GOOD.replace(b"rgbe", b"xyze")),
        ("a.hdr", GOOD.replace(b"-Y 6", b"+Y 6")),
        ("a.hdr", GOOD.replace(b"-Y 6", b"-Y 9999999")),
        ("a.hdr", b"#?RADIANCE\n\n-Y 2 +X 2\n" + b"\1\1\1\5" * 4),
        ("a.exr", b"not a picture at all"),
        ("a.png", b"not a picture at all"),
    ],
)
def test_a_broken_file_is_refused_by_name(tmp_path, name, content):
    if name.endswith("exr"):
        pytest.importorskip("OpenEXR")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=f"path must be a picture, but .*{name}"):
        rj.Environment.from_file(tmp_path / name)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match=r"sky\.hdr' does not exist"):
        rj.Environment.from_file(tmp_path / "sky.hdr")


def test_panoramas_are_told_apart():
    one, other = Panorama(np.ones((2, 4, 3))), Panorama(np.ones((2, 4, 3)))
    assert one != other
    assert len({one, other}) == 2


# Fog.


def test_fog_keeps_what_its_mode_needs():
    fog = rj.Fog("red", "linear", end=5)
    assert (fog.color, fog.start, fog.end, fog.density) == ((1.0, 0.0, 0.0), 0.0, 5.0, None)
    assert rj.Fog(density=2).density == 2.0
    assert rj.Fog(mode="exp", density=0.5, height=3, falloff=1).height == 3.0


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mode": "thick"}, "mode must be one of"),
        ({"mode": "linear"}, "end must be given"),
        ({"mode": "linear", "start": 2.0, "end": 1.0}, "end must be above start, 2.0; got 1.0"),
        ({"mode": "linear", "start": 2.0, "end": 2.0}, "end must be above start"),
        ({"mode": "linear", "start": -1.0, "end": 2.0}, "start must be in"),
        ({"mode": "linear", "end": math.inf}, "end must be finite"),
        ({"mode": "linear", "end": 2.0, "density": 1.0}, "density must be None"),
        ({"mode": "exp"}, "density must be given"),
        ({"mode": "exp", "density": -1.0}, "density must be in"),
        ({"mode": "exp2", "density": math.nan}, "density must be finite"),
        ({"mode": "exp", "density": 1.0, "start": 0.0}, "start must be None"),
        ({"mode": "exp2", "density": 1.0, "height": 0.0}, "height must be None for mode 'exp2'"),
        ({"mode": "exp", "density": 1.0, "height": 0.0}, "falloff must be given"),
        ({"mode": "exp", "density": 1.0, "falloff": 1.0}, "falloff must be None"),
        ({"mode": "exp", "density": 1.0, "height": 0.0, "falloff": 0.0}, "falloff must be above 0"),
        ({"mode": "exp", "density": 1.0, "height": 0.0, "falloff": -1.0}, "falloff must be in"),
        ({"mode": "exp", "density": 1.0, "height": "top", "falloff": 1.0}, "height must be a num"),
        ({"density": 1.0, "color": (2.0, 0.0, 0.0)}, "color must lie in"),
    ],
)
def test_bad_fog_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        rj.Fog(**fields)


# Tone maps.


def test_a_tone_map_keeps_its_numbers():
    tone = rj.ToneMap("reinhard", exposure=1, white=4)
    assert (tone.curve, tone.exposure, tone.white) == ("reinhard", 1.0, 4.0)
    assert rj.ToneMap().curve == "neutral"
    assert rj.ToneMap("none").is_neutral
    assert not rj.ToneMap("none", 1.0).is_neutral
    assert not rj.ToneMap("aces").is_neutral


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"curve": "filmic"}, "curve must be one of"),
        ({"exposure": 127.0}, "exposure must be in"),
        ({"exposure": math.nan}, "exposure must be finite"),
        ({"curve": "aces", "white": 2.0}, "white must be inf for curve 'aces'"),
        ({"curve": "reinhard", "white": 0.0}, "white must be in"),
        ({"curve": "reinhard", "white": "bright"}, "white must be a number"),
    ],
)
def test_a_bad_tone_map_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        rj.ToneMap(**fields)


@pytest.mark.parametrize("exponent", [0, 255])
def test_a_file_that_is_no_light_is_named(tmp_path, exponent):
    path = tmp_path / "bright.hdr"
    width = 4 if exponent else 70_000
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X %d\n" % width
    path.write_bytes(head + bytes([255, 255, 255, exponent]) * width)
    with pytest.raises(ValueError, match=r"^path must be a picture") as caught:
        rj.Environment.from_file(path)
    assert str(caught.value).count(path.name) == 1


def test_an_exr_with_channels_of_several_sizes_is_named(tmp_path, monkeypatch):
    path = tmp_path / "a.exr"
    path.write_bytes(b"something")

    def read(path, max_bytes):
        raise ValueError("all input arrays must have the same shape")

    monkeypatch.setattr("rasterjit.scene.environment.read_hdr_image", read)
    with pytest.raises(ValueError, match=r"a\.exr.*same shape"):
        rj.Environment.from_file(path)
