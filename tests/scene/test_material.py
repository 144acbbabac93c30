"""Laws of materials."""

import dataclasses

import numpy as np
import pytest

from rasterjit.scene.material import LAYER_TEXTURES, SHADINGS, TEXTURE_FIELDS, Material
from rasterjit.scene.texture import Texture


def test_the_default_is_a_light_grey_with_a_soft_highlight():
    material = Material()
    assert material.shading == "phong"
    assert material.base_color is None
    assert material.base_color_over(False) == tuple(np.float32([0.8, 0.8, 0.8, 1.0]).tolist())
    assert 0.0 < material.specular < 1.0
    assert material.shininess > 1.0


def test_base_color_is_stored_as_linear_rgba():
    assert Material(base_color="#ff0000").base_color == (1.0, 0.0, 0.0, 1.0)
    assert Material(base_color=(0.5, 0.25, 0.0)).base_color == (0.5, 0.25, 0.0, 1.0)


@pytest.mark.parametrize("shading", SHADINGS)
def test_each_shading_can_be_asked_for(shading):
    assert Material(shading=shading).shading == shading


def test_an_unknown_shading_is_refused_listing_the_known_ones():
    with pytest.raises(ValueError, match="shading must be one of 'unlit', 'flat', 'gouraud', 'ph"):
        Material(shading="toon")


def test_a_choice_that_is_nearly_one_is_asked_for():
    for option, value, meant in (
        ("shading", "phon", "phong"), ("shading", "PBR", "pbr"), ("alpha_mode", "blended", "blend"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"got '{value}'; did you mean '{meant}'\\?"):
            Material(**{option: value})
    with pytest.raises(ValueError, match=r"got 'toon'$"):
        Material(shading="toon")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("specular", -0.1),
        ("specular", float("nan")),
        ("shininess", 0.0),
        ("shininess", float("inf")),
        ("base_color", (2.0, 0.0, 0.0)),
        ("metallic", 1.1),
        ("roughness", -0.1),
        ("normal_scale", 1001.0),
        ("occlusion_strength", "all"),
        ("alpha_cutoff", -1.0),
        ("alpha_mode", "holes"),
        ("double_sided", 1),
        ("emissive", (0.0, -1.0, 0.0)),
        ("emissive", (0.0, 2e30, 0.0)),
        ("emissive", (1.0, 1.0)),
        ("emissive", "glow"),
        ("normal_texture", "bumps.png"),
        ("emissive_texture", 3),
        ("clearcoat", 1.5),
        ("clearcoat_roughness", float("nan")),
        ("clearcoat_normal_scale", "deep"),
        ("clearcoat_normal_texture", "bumps.png"),
        ("sheen_color", (0.0, 1.5, 0.0)),
        ("sheen_roughness", -1.0),
        ("specular_factor", 2.0),
        ("specular_color", (0.0, -1.0, 0.0)),
        ("specular_color", (0.0, 2e6, 0.0)),
        ("ior", 0.5),
        ("ior", float("inf")),
        ("ior", 1001.0),
        ("transmission", 1.1),
        ("thickness", -0.1),
        ("thickness_texture", 1),
        ("attenuation_distance", 0.0),
        ("attenuation_distance", float("nan")),
        ("attenuation_color", (1.0, 1.0)),
    ],
)
def test_values_out_of_range_are_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        Material(**{field: value})


def test_equal_materials_are_equal_and_frozen():
    assert Material(base_color="red") == Material(base_color=(1.0, 0.0, 0.0))
    assert Material() != Material(base_color=(0.8, 0.8, 0.8))
    assert len({Material(), Material()}) == 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        Material().specular = 1.0


def test_emission_may_be_brighter_than_white_and_is_white_with_a_texture_alone():
    texture = Texture(np.ones((1, 1, 3), np.float32))
    assert Material().emissive == (0.0, 0.0, 0.0)
    assert not Material().emits
    assert Material(emissive_texture=texture).emissive == (1.0, 1.0, 1.0)
    assert Material(emissive_texture=texture, emissive="black").emissive == (0.0, 0.0, 0.0)
    assert Material(emissive=(0, 7.5, 1e6)).emissive == (0.0, 7.5, 1e6)
    assert Material(emissive=np.array([255, 0, 0], np.uint8)).emissive == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("shading", "read"),
    [
        ("unlit", [0, 4]), ("gouraud", [0, 4]), ("flat", [0, 1, 3, 4]), ("phong", [0, 1, 3, 4]),
        ("pbr", [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]),
    ],
)  # fmt: skip
def test_each_shading_reads_the_textures_that_it_says(shading, read):
    texture = Texture(np.ones((1, 1, 3), np.float32))
    textures = dict.fromkeys(TEXTURE_FIELDS, texture)
    material = Material(shading=shading, **textures, clearcoat=1.0)
    have = [n for n, found in enumerate(material.textures_read()) if found is not None]
    assert have == read


def test_layers_are_off_unless_asked_for_and_pbr_alone_has_them():
    layers = ("has_clearcoat", "has_sheen", "has_custom_specular")
    asked = {"clearcoat": 0.5, "sheen_color": "red", "ior": 1.3}
    for shading in SHADINGS:
        plain, layered = Material(shading), Material(shading, **asked)
        assert [getattr(plain, name) for name in layers] == [False] * 3
        assert [getattr(layered, name) for name in layers] == [shading == "pbr"] * 3


def test_textures_of_layers_that_are_off_are_not_read():
    texture = Texture(np.ones((1, 1, 3), np.float32))
    off = {
        **dict.fromkeys(LAYER_TEXTURES, texture), "clearcoat": 0.0, "sheen_color": "black",
        "specular_factor": 0.0,
    }  # fmt: skip
    assert Material("pbr", **off).textures_read() == (None,) * len(TEXTURE_FIELDS)


def test_colors_of_layers_are_stored_as_linear_rgb():
    texture = Texture(np.ones((1, 1, 3), np.float32))
    plain = Material()
    assert plain.sheen_color == (0.0, 0.0, 0.0)
    assert plain.specular_color == plain.attenuation_color == (1.0, 1.0, 1.0)
    assert Material(sheen_color_texture=texture).sheen_color == (1.0, 1.0, 1.0)
    assert Material(specular_color=(0, 7.5, 1e6)).specular_color == (0.0, 7.5, 1e6)
    assert Material(attenuation_color="#ff0000").attenuation_color == (1.0, 0.0, 0.0)
    assert (plain.ior, plain.attenuation_distance) == (1.5, float("inf"))
    assert Material(ior=0).ior == 0.0
