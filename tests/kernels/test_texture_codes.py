"""Pictures kept as codes of 8 bits show the bits that the same light shows as floats."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from naive_textures import NOISE, draw, square

import rasterjit as rj
from rasterjit.scene import texture as textures
from rasterjit.scene.texture import COLOR_SPACES, FILTERS, MAX_FLOAT_TEXELS, WRAPS
from rasterjit.survey.packed_scene import join_textures

SHAPES = [(64, 64, 3), (37, 20, 4), (33, 64, 1), (16, 17), (16, 16, 2), (1, 1, 3), (1, 9, 4)]
CAMERA = rj.PerspectiveCamera((0, 0, 2), (0, 0, 0), fov_y=55)
CORNERS = np.float64([[-2, -1.2, -3], [2, -1.2, -3], [2, 1.2, 0.9], [-2, 1.2, 0.9]])
CENTRED = 0.5 * CORNERS[:, :2]
"""Texture coordinates: pixels are smaller than texels on one side, and larger on the other."""


@pytest.fixture
def _codes_of_all(monkeypatch):
    """Keep codes of pictures of any size."""
    monkeypatch.setattr(textures, "MAX_FLOAT_TEXELS", 0)


as_codes = pytest.mark.usefixtures("_codes_of_all")


def pictures(shape, color_space="srgb", **options):
    """Return a texture of random codes, and one of the light that they stand for."""
    codes = np.random.default_rng(len(shape)).integers(0, 256, shape, np.uint8)
    texture = rj.Texture(codes, color_space=color_space, **options)
    assert texture.pyramid.codes is not None
    return texture, rj.Texture(texture.image, **options)


def shown(*meshes):
    """Return the linear light of a tilted plane, and of others beside it."""
    scene = rj.Scene()
    for n, mesh in enumerate(meshes):
        scene.add(mesh, rj.transforms.translate((0.0, 0.5 * n, -0.1 * n)))
    return rj.render(scene, CAMERA, size=(97, 61), outputs="linear", threads=1).linear


def plane(texture, zoom, **options):
    """Return the plane under a texture."""
    material = rj.Material("unlit", base_color_texture=texture, **options)
    return rj.Mesh(CORNERS, [[0, 1, 2], [0, 2, 3]], uv=zoom * CENTRED, material=material)


@as_codes
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("color_space", COLOR_SPACES)
@pytest.mark.parametrize("filter", FILTERS)
def test_codes_show_the_bits_of_their_light(shape, color_space, filter):
    for wrap in WRAPS:
        coded, light = pictures(shape, color_space, filter=filter, wrap=wrap)
        for zoom in (0.1, 1.0, 3.0, 40.0):
            assert (shown(plane(coded, zoom)) == shown(plane(light, zoom))).all()


@as_codes
@pytest.mark.parametrize("limit", [4, 16])
def test_taps_of_codes_show_the_bits_of_their_light(limit):
    coded, light = (
        texture.with_transform((0.25, 0.5), 20.0, (1.5, 0.25))
        for texture in pictures((64, 32, 3), anisotropy=limit)
    )
    for zoom in (1.0, 8.0):
        assert (shown(plane(coded, zoom)) == shown(plane(light, zoom))).all()


@as_codes
def test_codes_and_floats_are_read_in_one_scene():
    two = [pictures((48, 20, 4), wrap="mirror"), pictures((31, 64, 1), filter="bilinear")]
    floats = rj.Texture(NOISE)
    scenes = [
        [
            plane(texture, zoom)
            for texture, zoom in zip([one, floats, other], (2, 1, 4), strict=True)
        ]
        for one, other in zip(*two, strict=True)
    ]
    assert (shown(*scenes[0]) == shown(*scenes[1])).all()
    record = join_textures(scenes[0])
    assert record.codes.size == 48 * 20 * 4 + 31 * 64


@as_codes
@pytest.mark.parametrize("alpha", [{"alpha_mode": "blend"}, {"alpha_cutoff": 0.5}], ids=str)
def test_codes_with_alpha_show_the_bits_of_their_light(alpha):
    coded, light = pictures((37, 20, 4))
    for zoom in (0.3, 4.0):
        assert (shown(plane(coded, zoom, **alpha)) == shown(plane(light, zoom, **alpha))).all()


@as_codes
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_codes_have_the_levels_and_alphas_of_their_light(shape):
    coded, light = pictures(shape)
    assert len(coded.levels) == len(light.levels)
    for one, other in zip(coded.levels, light.levels, strict=True):
        assert (one == other).all()
        assert not one.flags.writeable
    assert coded.lowest_alpha == light.lowest_alpha
    for cutoff in (0.0, 0.3, 1.0):
        found = coded.pyramid.min_alpha_above(cutoff)
        assert found == light.pyramid.min_alpha_above(cutoff)


def test_large_pictures_are_kept_as_codes_and_small_ones_as_floats():
    side = int(MAX_FLOAT_TEXELS**0.5)
    codes = np.zeros((side, side + 1, 3), np.uint8)
    assert rj.Texture(codes[:, :side]).pyramid.codes is None
    for channels, kept in ((4, 3), (3, 3), (2, 1), (1, 1)):
        # An alpha that is opaque everywhere is not kept.
        opaque = np.full((side, side + 1, channels), 255, np.uint8)
        texture = rj.Texture(opaque)
        assert texture.pyramid.codes.shape == (side, side + 1, kept)
        assert texture.is_opaque
    mesh = square(rj.Texture(codes), [[0, 0], [1, 0], [1, 1], [0, 1]])
    record = join_textures([mesh])
    assert record.codes.nbytes == codes.nbytes
    assert 0.3 * codes.size / 3 < len(record.texels) < 0.34 * codes.size / 3


@as_codes
@pytest.mark.parametrize(
    "make", [copy.copy, copy.deepcopy, lambda t: pickle.loads(pickle.dumps(t))]
)
def test_copies_keep_codes(make):
    coded, _ = pictures((16, 16, 3), "linear")
    other = make(coded)
    assert (other.pyramid.codes == coded.pyramid.codes).all()
    assert not other.pyramid.codes.flags.writeable
    assert (other.image == coded.image).all()


@as_codes
def test_a_texture_owns_its_codes():
    codes = np.full((2, 3, 3), 255, np.uint8)
    texture = rj.Texture(codes, filter="nearest")
    codes[:] = 0
    assert (draw(square(texture, [[0, 0], [1, 0], [1, 1], [0, 1]]), (4, 4))[..., 0] == 1.0).all()
