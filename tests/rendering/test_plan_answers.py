"""What materials call for is planned where it makes a difference, and the reason is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rasterjit as rj

TEXTURE = rj.Texture(np.ones((1, 1, 3), np.float32))
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
UV = [[0, 0], [1, 0], [1, 1], [0, 1]]


def scene_of(*materials):
    scene = rj.Scene()
    for material in materials:
        scene.add(rj.Mesh(SQUARE, [[0, 1, 2], [0, 2, 3]], uv=UV, material=material))
    return scene


def told(name, *materials, **options):
    """Return whether an effect is in, and the reason."""
    plan = rj.explain(scene_of(*materials), **options)
    (effect,) = [effect for effect in plan.effects if effect.name == name]
    return effect.used, effect.reason


PLAIN = rj.Material()
PBR = rj.Material(shading="pbr")


@pytest.mark.parametrize(
    ("name", "materials", "used", "reason"),
    [
        ("microfacets", [PLAIN], False, "no material is shaded pbr"),
        ("microfacets", [PLAIN, PBR, PBR], True, "2 objects"),
        ("normal maps", [PBR], False, "no lit material has a normal_texture"),
        ("normal maps", [replace(PLAIN, normal_texture=TEXTURE)], True, "1 object"),
        ("normal maps", [replace(PLAIN, shading="unlit", normal_texture=TEXTURE)], False,
         "no lit material has a normal_texture"),
        ("normal maps", [replace(PLAIN, shading="gouraud", normal_texture=TEXTURE)], False,
         "no lit material has a normal_texture"),
        ("metallic-roughness maps", [replace(PLAIN, metallic_roughness_texture=TEXTURE)], False,
         "no lit material has a metallic_roughness_texture"),
        ("metallic-roughness maps", [replace(PBR, metallic_roughness_texture=TEXTURE)], True,
         "1 object"),
        ("occlusion maps", [replace(PLAIN, shading="flat", occlusion_texture=TEXTURE)], True,
         "1 object"),
        ("emission", [PBR], False, "no material is emissive"),
        ("emission", [replace(PBR, emissive_texture=TEXTURE, emissive="black")], False,
         "no material is emissive"),
        ("emission", [replace(PLAIN, shading="unlit", emissive=(0, 0, 1e-6))], True, "1 object"),
        ("single-sided objects", [PLAIN], False, "every material is double_sided"),
        ("single-sided objects", [PLAIN, replace(PBR, double_sided=False)], True, "1 object"),
    ],
)  # fmt: skip
def test_an_effect_is_in_where_it_makes_a_difference(name, materials, used, reason):
    assert told(name, *materials) == (used, reason)


def test_nothing_is_read_where_nothing_is_shaded():
    full = replace(PBR, normal_texture=TEXTURE, occlusion_texture=TEXTURE, emissive="red")
    for name in ("microfacets", "normal maps", "occlusion maps", "emission"):
        assert told(name, full, outputs=("depth",)) == (False, "nothing is shaded")
    plan = rj.explain(scene_of(full), outputs=("depth",))
    assert not plan.facts.needs_material_maps
    assert not plan.facts.needs_microfacets
    assert not plan.facts.needs_textures


def test_a_texture_that_is_not_read_is_no_texture():
    unread = replace(
        PLAIN, shading="gouraud", normal_texture=TEXTURE, occlusion_texture=TEXTURE,
        metallic_roughness_texture=TEXTURE, emissive_texture=TEXTURE, emissive="black",
    )  # fmt: skip
    plan = rj.explain(scene_of(unread))
    assert not plan.facts.needs_textures
    assert not plan.facts.needs_material_maps


@pytest.mark.parametrize("field", ["normal_texture", "emissive_texture", "occlusion_texture"])
def test_a_mesh_without_uv_is_refused_by_the_name_of_the_texture(field):
    scene = rj.Scene()
    material = replace(PBR, **{field: TEXTURE}, emissive="white")
    scene.add(rj.Mesh(SQUARE, [[0, 1, 2]], material=material), name="wall")
    with pytest.raises(ValueError, match=f"the mesh of 'wall' must have uv.* has an? {field}"):
        rj.render(scene, size=(8, 8))


@pytest.mark.parametrize(
    ("cull", "fronts", "backs"), [("none", 2, 1), ("back", 2, 0), ("front", 0, 2)]
)
def test_single_sided_objects_lose_their_back_faces(cull, fronts, backs):
    """Two objects seen from the front and two from the back, one of each single-sided."""
    scene = rj.Scene()
    for n, (turn, double) in enumerate([(0, True), (0, False), (180, True), (180, False)]):
        material = replace(PLAIN, double_sided=double)
        mesh = rj.Mesh(SQUARE, [[0, 1, 2], [0, 2, 3]], material=material)
        place = rj.transforms.compose(
            rj.transforms.translate((3.0 * n - 4.5, 0, 0)), rj.transforms.rotate_y(turn)
        )
        scene.add(mesh, place)
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=3, near=1, far=9)
    frame = rj.render(scene, camera, size=(48, 12), outputs=("object_id",), cull=cull, threads=1)
    seen = set(np.unique(frame.object_id).tolist()) - {-1}
    assert len(seen & {0, 1}) == fronts
    assert len(seen & {2, 3}) == backs
