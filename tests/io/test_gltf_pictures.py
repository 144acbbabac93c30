"""KHR_texture_basisu, EXT_texture_webp, EXT_texture_avif and MSFT_texture_dds."""

import importlib.util
import io
import random
import struct
import sys
import warnings

import ktx2_samples as samples
import numpy as np
import pytest
from gltf_drafts import Draft
from PIL import Image, features

import rasterjit as rj
from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.gltf.compression import decode_ktx2
from rasterjit.scene.memory_limits import MemoryBudget

BASIS = "KHR_texture_basisu"
GREY = np.full((8, 8, 3), 128, np.uint8)

needs_transcoder = pytest.mark.skipif(
    importlib.util.find_spec("opengl_basisu") is None,
    reason="opengl_basisu is not installed",
)


def encoded(pixels, kind="PNG", **options):
    """Return a picture's file."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind, **options)
    return stream.getvalue()


def file_with(extension, content, *, plain=True, required=False):
    """Return a file with a texture of an extension, and a plain grey one in its place."""
    file = Draft().use(extension, required=required)
    texture = {"extensions": {extension: {"source": file.picture(content, "image/any")}}}
    if plain:
        texture["source"] = file.picture(encoded(GREY))
    return file.textured(**texture)


def texture_of(path):
    """Load a file that warns of nothing; return its texture."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return rj.load(path).nodes[0].mesh.material.base_color_texture


def assert_shows(texture, pixels, worst=0.03):
    """Compare linear colours."""
    wanted = rj.Texture(pixels).levels[0]
    np.testing.assert_allclose(texture.levels[0], wanted, atol=worst)


@needs_transcoder
@pytest.mark.parametrize("name", ["ETC1S", "UASTC", "UASTC_ALPHA", "UASTC_ZSTD_MIPS"])
@pytest.mark.parametrize("required", [False, True])
def test_ktx2_pictures_are_shown(tmp_path, name, required):
    content = getattr(samples, name)
    path = file_with(BASIS, content, plain=not required, required=required).save(tmp_path / "a.glb")
    alpha = np.full((8, 8, 1), 255, np.uint8)
    if name == "UASTC_ALPHA":
        alpha[4:, 4:] = 0
    texture = texture_of(path)
    assert texture.is_opaque == (name != "UASTC_ALPHA")
    shown = np.concatenate([samples.COLORS, alpha], axis=2)
    assert_shows(texture, shown)


def test_without_the_transcoder_the_plain_picture_is_shown(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    path = file_with(BASIS, samples.ETC1S).save(tmp_path / "a.glb")
    said = rf"left out {BASIS} of a texture, which has another: its picture, image 0: {BASIS} needs"
    with pytest.warns(rj.LoadWarning, match=said + ' opengl_basisu; pip install "rasterjit'):
        texture = rj.load(path).nodes[0].mesh.material.base_color_texture
    assert_shows(texture, GREY, 0.0)
    alone = file_with(BASIS, samples.ETC1S, plain=False).save(path)
    with pytest.warns(rj.LoadWarning, match="base_color_texture of material 0 that cannot be read"):
        assert rj.load(alone).nodes[0].mesh.material.base_color_texture is None
    required = file_with(BASIS, samples.ETC1S, required=True).save(path)
    with pytest.raises(
        rj.MeshFileError, match=rf"a\.glb: {BASIS} needs opengl_basisu; pip install"
    ):
        rj.load(required)


def changed(place, form, value, sample=samples.UASTC):
    """Return a picture with a number of its header changed."""
    content = bytearray(sample)
    struct.pack_into(form, content, place, value)
    return bytes(content)


@needs_transcoder
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (samples.UASTC[:20], "it ends too early"),
        (samples.UASTC[:60], "truncated KTX 2 file"),
        (samples.UASTC[:104], "not a valid Basis Universal KTX 2 file"),
        (changed(96, "<Q", 3 << 30), "not a valid Basis Universal KTX 2 file"),
        (samples.UASTC[:-9], "not a valid Basis Universal KTX 2 file"),
        (changed(12, "<I", 37), "vkFormat 37 holds no Basis Universal"),
        (changed(20, "<I", 0), "it must be 1..65536 texels wide and high, got 0×8"),
        (changed(20, "<I", 1 << 30), "it must be 1..65536 texels wide and high, got 1073741824×8"),
        (changed(36, "<I", 3), "not a valid Basis Universal KTX 2 file"),
        (
            changed(96, "<Q", 2_130_706_496, samples.UASTC_ZSTD_MIPS),
            "its largest level of 8×8 texels must have at most 64 bytes unpacked, but says 21307",
        ),
    ],
)  # fmt: skip
def test_damaged_ktx2_pictures_are_left_out_by_name(tmp_path, content, said):
    path = file_with(BASIS, content).save(tmp_path / "a.glb")
    with pytest.warns(rj.LoadWarning, match=f"image 0: .*{said}"):
        texture = rj.load(path).nodes[0].mesh.material.base_color_texture
    assert_shows(texture, GREY, 0.0)


@needs_transcoder
def test_damage_ends_in_an_error_or_a_picture():
    rng = random.Random(3)
    outcomes = set()
    for number in range(300):
        name = ("ETC1S", "UASTC", "UASTC_ZSTD_MIPS")[number % 3]
        content = bytearray(getattr(samples, name))
        for _ in range(rng.choice((1, 2, 5))):
            content[rng.randrange(12, len(content))] = rng.randrange(256)
        try:
            budget = MemoryBudget("a", 1 << 24)
            pixels = decode_ktx2(
                bytes(content[: rng.randrange(12, 2 * len(content))]), "it", budget, Decoder(budget)
            )
            outcomes.add(f"a picture of {pixels.shape[2]} channels")
        except ValueError as error:
            outcomes.add(str(error)[:18])
    assert {"a picture of 3 channels", BASIS, "it ends too early"} <= outcomes


def test_webp_is_shown(tmp_path):
    content = encoded(samples.COLORS, "WEBP", lossless=True)
    assert_shows(texture_of(file_with("EXT_texture_webp", content).save(tmp_path / "a.glb")),
                 samples.COLORS, 0.0)  # fmt: skip


def test_dds_is_shown(tmp_path):
    path = file_with("MSFT_texture_dds", encoded(samples.COLORS, "DDS")).save(tmp_path / "a.glb")
    assert_shows(texture_of(path), samples.COLORS, 0.0)


def test_avif_is_shown_where_pillow_reads_it(tmp_path):
    name = "EXT_texture_avif"
    if "avif" in features.modules and features.check("avif"):
        content = encoded(samples.COLORS, "AVIF", quality=100, subsampling="4:4:4")
        assert_shows(texture_of(file_with(name, content).save(tmp_path / "a.glb")), samples.COLORS)
    path = file_with(name, b"\0\0\0\x1cftypavif" + bytes(16)).save(tmp_path / "b.glb")
    with pytest.warns(rj.LoadWarning, match=f"{name} of a texture, which has another"):
        assert_shows(rj.load(path).nodes[0].mesh.material.base_color_texture, GREY, 0.0)


def test_pictures_of_extensions_are_refused_elsewhere(tmp_path):
    file = Draft()
    path = file.textured(source=file.picture(encoded(GREY, "DDS"))).save(tmp_path / "a.glb")
    with pytest.warns(rj.LoadWarning, match="image 0: it is no known picture"):
        rj.load(path)


def test_a_picture_that_two_materials_show_is_named_once_and_read_once(tmp_path):
    file = file_with("EXT_texture_webp", b"RIFF")
    file.textured(**file.header["textures"][0])
    with pytest.warns(
        rj.LoadWarning, match=r"left out EXT_texture_webp of a texture, .*\(2\); the"
    ):
        one, other = (node.mesh.material for node in rj.load(file.save(tmp_path / "a.glb")).nodes)
    assert one.base_color_texture is other.base_color_texture
