"""
What glTF's extensions lay over materials, in files after the description of Khronos' samples.

ClearCoatTest (rows of balls: base alone, varnish alone, both, parts of it, rough, with normals of
its own), SheenChair (cloth of colour and roughness by textures), SpecularTest (factors, colours,
textures of both) and CompareIor (pairs that differ in ior alone).
"""

from __future__ import annotations

import numpy as np
import pytest
from sample_models import Model, ball_arrays, quad

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning

COAT, SHEEN = "KHR_materials_clearcoat", "KHR_materials_sheen"
SPECULAR, IOR = "KHR_materials_specular", "KHR_materials_ior"


def materials_of(model, path):
    """Return the materials that a file is read with, without a warning."""
    return [node.mesh.material for node in rj.load(model.save(path)).nodes]


def model_of(*materials, **textures):
    """Return a model with a square for each of some materials, each a dictionary of extensions."""
    model = Model()
    used = {name: model.texture(pixels) for name, pixels in textures.items()}
    for n, extensions in enumerate(materials):
        told = extensions(used) if callable(extensions) else extensions
        model.add(quad(n, 0, n + 1, 1), model.material(f"m{n}", extensions=told))
    return model


def test_clear_coat_test_has_its_varnish(tmp_path):
    grey = np.full((2, 2, 3), (128, 64, 255), np.uint8)
    full = {"clearcoatFactor": 1.0}
    moved = {"offset": [0.25, 0.5], "scale": [2.0, 3.0]}
    model = model_of(
        {COAT: {}},
        {COAT: full},
        {COAT: {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25}},
        lambda used: {COAT: {**full, "clearcoatTexture": used["grey"]}},
        lambda used: {
            COAT: {
                **full,
                "clearcoatRoughnessFactor": 1.0,
                "clearcoatRoughnessTexture": {
                    **used["grey"],
                    "extensions": {"KHR_texture_transform": moved},
                },
            }
        },
        lambda used: {COAT: {**full, "clearcoatNormalTexture": {**used["grey"], "scale": 0.5}}},
        grey=grey,
    )
    plain, coated, half, masked, rough, bumpy = materials_of(model, tmp_path / "a.glb")
    assert not plain.has_clearcoat
    assert (coated.clearcoat, coated.clearcoat_roughness) == (1.0, 0.0)
    assert (half.clearcoat, half.clearcoat_roughness) == (0.5, 0.25)
    # Numbers, not sRGB.
    assert masked.clearcoat_texture.image[0, 0, 0] == pytest.approx(128 / 255)
    assert rough.clearcoat_roughness_texture.scale == (2.0, 3.0)
    assert rough.clearcoat_roughness == 1.0
    assert bumpy.clearcoat_normal_texture.color_space == "linear"
    assert bumpy.clearcoat_normal_scale == 0.5
    assert bumpy.normal_texture is None


def test_sheen_chair_has_its_cloth(tmp_path):
    cloth = np.full((2, 2, 4), (128, 64, 255, 51), np.uint8)
    model = model_of(
        {SHEEN: {}},
        {SHEEN: {"sheenColorFactor": [0.25, 0.5, 1.0], "sheenRoughnessFactor": 0.5}},
        lambda used: {
            SHEEN: {
                "sheenColorFactor": [1.0, 1.0, 1.0], "sheenColorTexture": used["cloth"],
                "sheenRoughnessFactor": 1.0, "sheenRoughnessTexture": used["cloth"],
            }
        },
        # The factor is black where the file does not say.
        lambda used: {SHEEN: {"sheenColorTexture": used["cloth"]}},
        cloth=cloth,
    )  # fmt: skip
    plain, velvet, damask, dark = materials_of(model, tmp_path / "a.glb")
    assert not plain.has_sheen
    assert (velvet.sheen_color, velvet.sheen_roughness) == ((0.25, 0.5, 1.0), 0.5)
    assert damask.sheen_color_texture.color_space == "srgb"
    assert damask.sheen_roughness_texture.image[0, 0, 3] == pytest.approx(0.2)
    assert not dark.has_sheen


def test_specular_test_and_compare_ior_have_their_mirrors(tmp_path):
    picture = np.full((2, 2, 4), (255, 128, 64, 102), np.uint8)
    model = model_of(
        {SPECULAR: {}},
        {SPECULAR: {"specularFactor": 0.25}},
        {SPECULAR: {"specularColorFactor": [4.0, 0.5, 0.0]}},
        lambda used: {
            SPECULAR: {"specularTexture": used["picture"], "specularColorTexture": used["picture"]}
        },
        {IOR: {"ior": 1.33}},
        {IOR: {"ior": 2.42}, SPECULAR: {"specularFactor": 0.5}},
        {IOR: {"ior": 0}},
        {IOR: {"ior": 0.5}},
        {IOR: {}},
        picture=picture,
    )
    plain, weak, tinted, textured, water, diamond, all_, thin, glass = materials_of(
        model, tmp_path / "a.glb"
    )
    assert not plain.has_custom_specular
    assert not glass.has_custom_specular
    assert weak.specular_factor == 0.25
    assert tinted.specular_color == (4.0, 0.5, 0.0)
    assert textured.specular_factor_texture.image[0, 0, 3] == pytest.approx(0.4)
    assert textured.specular_color_texture.color_space == "srgb"
    assert (water.ior, diamond.ior, diamond.specular_factor) == (1.33, 2.42, 0.5)
    assert (all_.ior, thin.ior) == (0.0, 1.0)


def test_the_brighter_of_two_balls_has_the_larger_ior(tmp_path):
    model = Model()
    for n, ior in enumerate((1.1, 1.5, 2.4)):
        material = model.material(
            f"m{n}", baseColorFactor=[0, 0, 0, 1], metallicFactor=0.0, roughnessFactor=0.4,
            extensions={IOR: {"ior": ior}},
        )  # fmt: skip
        attributes, faces = ball_arrays()
        model.add(attributes, material, faces, translation=[2.5 * n, 0, 0])
    scene = rj.load(model.save(tmp_path / "a.glb"))
    scene.lights = [rj.DirectionalLight((0, 0, -1))]
    camera = rj.OrthographicCamera(eye=(2.5, 0, 9), target=(2.5, 0, 0), height=2.2)
    frame = rj.render(scene, camera, size=(75, 22), outputs=("linear", "object_id"))
    peaks = [frame.linear[frame.object_id == n][:, 0].max() for n in range(3)]
    heads = [((ior - 1) / (ior + 1)) ** 2 for ior in (1.1, 1.5, 2.4)]
    assert np.array(peaks) / peaks[1] == pytest.approx(np.array(heads) / heads[1], rel=1e-3)


def test_unlit_materials_have_no_layers(tmp_path):
    model = model_of({"KHR_materials_unlit": {}, COAT: {"clearcoatFactor": 1.0}, IOR: {"ior": 2.0}})
    (material,) = materials_of(model, tmp_path / "a.glb")
    assert (material.shading, material.clearcoat, material.ior) == ("unlit", 0.0, 1.5)


@pytest.mark.parametrize(
    ("extensions", "named"),
    [
        ({COAT: {"clearcoatFactor": "full"}}, "clearcoatFactor must be a number"),
        ({SHEEN: {"sheenColorFactor": [1, 1]}}, "sheenColorFactor must be 3 numbers"),
        ({SPECULAR: {"specularColorFactor": [1, None, 1]}}, "specularColorFactor must be a number"),
        ({IOR: [1.3]}, "KHR_materials_ior must be an object"),
    ],
)
def test_a_damaged_layer_is_named(tmp_path, extensions, named):
    with pytest.warns(LoadWarning, match=named):
        rj.load(model_of(extensions).save(tmp_path / "a.glb"))


def test_a_layer_may_be_required_and_others_are_named(tmp_path):
    others = [
        f"KHR_materials_{name}"
        for name in ("anisotropy", "iridescence", "dispersion", "diffuse_transmission")
    ]
    model = model_of({COAT: {"clearcoatFactor": 1.0}, **{name: {} for name in others}})
    with pytest.warns(LoadWarning) as caught:
        rj.load(model.save(tmp_path / "a.glb", extensionsRequired=[COAT, SHEEN, SPECULAR, IOR]))
    (warning,) = caught
    assert all(name in str(warning.message) for name in others)
    assert COAT not in str(warning.message)


def test_what_is_saved_comes_back(tmp_path):
    texture = rj.Texture(
        np.arange(12, dtype=np.uint8).reshape(2, 2, 3) * 20, color_space="linear",
        offset=(0.25, 0.5), wrap="clamp",
    )  # fmt: skip
    color = rj.Texture(np.arange(12, dtype=np.uint8).reshape(2, 2, 3) * 20)
    look = {
        "clearcoat": 0.75, "clearcoat_roughness": 0.25, "clearcoat_normal_scale": -0.5,
        "sheen_color": (0.5, 0.25, 0.125), "sheen_roughness": 0.625, "specular_factor": 0.375,
        "specular_color": (8.0, 0.5, 0.25), "ior": 1.75,
    }  # fmt: skip
    textures = {
        name: color if "color" in name else texture
        for name in (
            "clearcoat_texture", "clearcoat_roughness_texture", "clearcoat_normal_texture",
            "sheen_color_texture", "sheen_roughness_texture", "specular_factor_texture",
            "specular_color_texture",
        )
    }  # fmt: skip
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    scene = rj.Scene()
    for material in (rj.Material("pbr", **look, **textures), rj.Material("pbr")):
        uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
        scene.add(rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uv=uv, material=material))
    scene.save(tmp_path / "a.glb")
    own, plain = (node.mesh.material for node in rj.load(tmp_path / "a.glb").nodes)
    assert {name: getattr(own, name) for name in look} == look
    for name, wanted in textures.items():
        found = getattr(own, name)
        assert np.array_equal(found.image, wanted.image), name
        assert (found.offset, found.wrap) == (wanted.offset, wanted.wrap)
    assert not plain.has_clearcoat
    assert not plain.has_custom_specular
