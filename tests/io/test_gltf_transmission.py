"""
Glass in glTF files: KHR_materials_transmission, KHR_materials_volume and KHR_materials_ior.

Small files made after the descriptions of Khronos' sample models TransmissionTest, where factors
and textures of transmission stand beside each other, and AttenuationTest, where bodies are thick by
a factor, by a texture, or because their node is scaled.
"""

import json
import warnings

import numpy as np
import pytest
from sample_models import Model, quad

import rasterjit as rj
from rasterjit.io.load_warnings import LoadWarning

TRANSMISSION, VOLUME, IOR = (f"KHR_materials_{name}" for name in ("transmission", "volume", "ior"))
CAMERA = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=3.0, near=0.5, far=20.0)
PLACES = (-1.0, 0.0, 1.0)
SHARES = (0.0, 128 / 255, 1.0)
SHARP = {"magFilter": 9728, "minFilter": 9728}


def square(x, y, z=0.0, half=0.4):
    return quad(x - half, y - half, x + half, y + half, z=z)


def grey(model, share):
    return model.texture(np.full((1, 1, 3), round(255 * share)), **SHARP)


def behind(model):
    model.add(
        quad(-2, -2, 2, 2, z=-1), model.material("wall", unlit=True, baseColorFactor=[1, 1, 1, 1])
    )


def transmission_test():
    """Rows: by factor, by a texture, tinted; columns: how much goes through."""
    model = Model()
    behind(model)
    for x, share in zip(PLACES, SHARES, strict=True):
        for y, told, color in (
            (1.0, {"transmissionFactor": share}, [1, 1, 1, 1]),
            (
                0.0,
                {"transmissionFactor": 1, "transmissionTexture": grey(model, share)},
                [1, 1, 1, 1],
            ),
            (-1.0, {"transmissionFactor": share}, [0.5, 0.25, 1, 1]),
        ):
            material = model.material(
                f"{x} {y}", baseColorFactor=color, metallicFactor=0, roughnessFactor=0,
                extensions={TRANSMISSION: told},
            )  # fmt: skip
            model.add(square(x, y), material)
    return model


def attenuation_test():
    """Rows: thick by factor, by texture, by scale; columns: 1/4, 1/2 and all of a unit."""
    model = Model()
    behind(model)
    color = {"attenuationColor": [0.8, 0.4, 0.2], "attenuationDistance": 0.5}
    for x, thickness in zip(PLACES, (64 / 255, 128 / 255, 1.0), strict=True):
        for y, told, scale in (
            (1.0, {"thicknessFactor": thickness}, 1),
            (0.0, {"thicknessFactor": 1, "thicknessTexture": grey(model, thickness)}, 1),
            (-1.0, {"thicknessFactor": thickness / 4}, 4),
        ):
            extensions = {
                TRANSMISSION: {"transmissionFactor": 1}, VOLUME: {**color, **told},
                IOR: {"ior": 1.25},
            }  # fmt: skip
            material = model.material(
                f"{x} {y}", baseColorFactor=[1, 1, 1, 1], metallicFactor=0, roughnessFactor=0,
                extensions=extensions,
            )  # fmt: skip
            model.add(square(x / scale, y / scale, half=0.4 / scale), material, scale=[scale] * 3)
    return model


def cells(scene):
    """Return the linear colour in the middle of each cell, (3 rows, 3 columns, 3)."""
    scene.lights = [rj.AmbientLight("black")]
    frame = rj.render(scene, CAMERA, size=(30, 30), outputs=("linear",), threads=1)
    return frame.linear[5::10, 5::10, :3].astype(float)


def loaded(model, path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return rj.load(model.save(path / "model.glb"))


def test_transmission_test(tmp_path):
    seen = cells(loaded(transmission_test(), tmp_path))
    # Straight on, 4 % are mirrored, about; without light nothing else is seen but what is behind.
    full = seen[0, 2, 0]
    assert full == pytest.approx(0.96, abs=0.03)
    assert seen[0, :, 0] / full == pytest.approx(np.array(SHARES), abs=1e-5)
    assert seen[1] == pytest.approx(seen[0], abs=1e-5)
    assert seen[2] == pytest.approx(seen[0] * [0.5, 0.25, 1.0], abs=1e-5)


def test_attenuation_test(tmp_path):
    scene = loaded(attenuation_test(), tmp_path)
    assert {node.mesh.material.ior for node in scene.nodes[1:]} == {1.25}
    seen = cells(scene)
    for row in seen:
        assert row / seen[0, 2] == pytest.approx(seen[0] / seen[0, 2], rel=1e-4)
    ways = np.array([64 / 255, 128 / 255, 1.0]) / 0.5
    want = np.array([0.8, 0.4, 0.2]) ** ways[:, np.newaxis]
    assert seen[0] / seen[0, 2] == pytest.approx(want / want[2], rel=1e-4)
    assert seen[0, 2] == pytest.approx(want[2], rel=0.04)


@pytest.mark.parametrize("model", [transmission_test, attenuation_test])
@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_what_is_saved_is_glass_again(tmp_path, model, suffix):
    scene = loaded(model(), tmp_path)
    scene.save(tmp_path / f"again{suffix}")
    again = rj.load(tmp_path / f"again{suffix}")
    for one, other in zip(scene.nodes, again.nodes, strict=True):
        for field in (
            "transmission", "thickness", "ior", "attenuation_distance", "attenuation_color",
        ):  # fmt: skip
            assert getattr(one.mesh.material, field) == getattr(other.mesh.material, field)
    assert (cells(scene) == cells(again)).all()


def test_what_is_no_glass_is_saved_without_a_word_of_it(tmp_path):
    scene = rj.Scene()
    scene.add(rj.Mesh(np.eye(3), [[0, 1, 2]], material=rj.Material("pbr")))
    scene.save(tmp_path / "plain.gltf")
    header = json.loads((tmp_path / "plain.gltf").read_text())
    assert not any(
        "transmission" in name or "volume" in name for name in header.get("extensionsUsed", [])
    )


def one_pane(extensions):
    model = Model()
    model.add(square(0, 0), model.material("glass", extensions=extensions))
    return model


@pytest.mark.parametrize(("told", "field", "want"), [
    ({TRANSMISSION: {"transmissionFactor": 7}}, "transmission", 1.0),
    ({TRANSMISSION: {"transmissionFactor": -1}}, "transmission", 0.0),
    ({TRANSMISSION: {}}, "transmission", 0.0),
    ({VOLUME: {"thicknessFactor": -2}}, "thickness", 0.0),
    ({VOLUME: {"attenuationDistance": 0}}, "attenuation_distance", 1e-6),
    ({VOLUME: {}}, "attenuation_distance", np.inf),
    ({VOLUME: {"attenuationColor": [2, 0.5, -1]}}, "attenuation_color", (1.0, 0.5, 0.0)),
])  # fmt: skip
def test_numbers_are_held_to_what_they_may_be(tmp_path, told, field, want):
    scene = loaded(one_pane(told), tmp_path)
    assert getattr(scene.nodes[0].mesh.material, field) == want


@pytest.mark.parametrize(("told", "said"), [
    ({TRANSMISSION: {"transmissionFactor": "all"}}, "transmissionFactor must be a number"),
    ({VOLUME: {"thicknessFactor": None}}, "thicknessFactor must be a number"),
    ({VOLUME: {"attenuationColor": [1, 1]}}, "attenuationColor must be 3 numbers"),
    ({VOLUME: 5}, "KHR_materials_volume must be an object"),
    ({TRANSMISSION: {"transmissionTexture": {"index": 9}}}, "transmission_texture .*cannot be"),
])  # fmt: skip
def test_damage_is_named(tmp_path, told, said):
    with pytest.warns(LoadWarning, match=said):
        rj.load(one_pane(told).save(tmp_path / "model.glb"))


def test_dispersion_is_named_as_left_out(tmp_path):
    told = {TRANSMISSION: {"transmissionFactor": 1}, "KHR_materials_dispersion": {"dispersion": 1}}
    with pytest.warns(LoadWarning, match="left out extension KHR_materials_dispersion"):
        scene = rj.load(one_pane(told).save(tmp_path / "model.glb"))
    assert scene.nodes[0].mesh.material.transmission == 1.0


def test_points_are_drawn_without_transmission():
    material = rj.Material("pbr", transmission=1.0)
    scene = rj.Scene()
    scene.add(rj.Points([(0, 0, 0)], size=9, material=material))
    assert "transmission             out" in str(rj.explain(scene, CAMERA, size=(30, 30)))
