"""
A setting of the quality that holds for all textures, lights or materials does what it would do if
each of them said so itself: the same picture, bit for bit.
"""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import profile
from rasterjit.outputs.output_table import OUTPUTS as ALL_OUTPUTS
from rasterjit.scene import transforms as tf
from rasterjit.scene.material import TEXTURE_FIELDS
from rasterjit.scene.quality import LEVELS
from rasterjit.survey.quality_overrides import COARSER_SHADING, parse_filter

SIZE = (72, 56)
OUTPUTS = tuple(name for name in ALL_OUTPUTS if name not in ("uv", "scalar"))
"""Those of any scene."""
CAMERA = rj.PerspectiveCamera((2.5, 2.0, 5.0), (0, 0, 0), near=0.5, far=30.0)


def checks(side=16, **options):
    """A picture of squares of two texels, some of them seen through."""
    image = np.full((side, side, 4), 0.1, np.float32)
    image[np.indices((side, side)).sum(axis=0) % 4 < 2] = (0.9, 0.7, 0.2, 1.0)
    return rj.Texture(image, **options)


def textured(mesh, *, shading, **options):
    return rj.Mesh(
        mesh.vertices, mesh.faces, uv=mesh.vertices[:, :2] * 1.5 + 0.3,
        material=rj.Material(shading, **options),
    )  # fmt: skip


@pytest.fixture
def scene(cube, sphere):
    """Objects of all ways of shading, textures of all filters, shadows of two filters."""
    scene, shared = rj.Scene(), checks()
    floor = np.array([(-4, -1, -4), (4, -1, -4), (4, -1, 4), (-4, -1, 4)], float)
    scene.add(
        rj.Mesh(
            floor, [(0, 2, 1), (0, 3, 2)], uv=floor[:, ::2],
            material=rj.Material("flat", base_color_texture=checks(filter="nearest")),
        )
    )  # fmt: skip
    scene.add(textured(sphere, shading="phong", base_color_texture=shared))
    scene.add(
        textured(cube, shading="gouraud", base_color_texture=shared, specular=0.5),
        tf.compose(tf.translate((-1.6, -0.2, 0.8)), tf.rotate_y(30.0), tf.scale((0.6, 0.6, 0.6))),
    )
    bumps = checks(color_space="linear", filter="bilinear")
    scene.add(
        textured(sphere, shading="phong", normal_texture=bumps, emissive="#201000"),
        tf.compose(tf.translate((1.5, 0.0, 0.5)), tf.scale((0.5, 0.7, 0.5))),
    )
    scene.add(
        textured(cube, shading="unlit", base_color_texture=checks(anisotropy=4)),
        tf.compose(tf.translate((0.4, 1.2, -1.5)), tf.scale((0.4, 0.4, 0.4))),
    )
    scene.lights = [
        rj.AmbientLight(intensity=0.2),
        rj.DirectionalLight((-1, -2, -1), intensity=0.6, shadow=rj.Shadow(64)),
        rj.PointLight((2, 3, 3), intensity=6.0, shadow=rj.Shadow(32, "soft", 0.4)),
    ]
    scene.fog = rj.Fog("#a0a0b0", "linear", start=3.0, end=20.0)
    return scene


def with_materials(scene, change):
    """The scene with other materials, on copies of its meshes."""
    changed, known = copy.copy(scene), {}
    changed.nodes = []
    for node in scene.nodes:
        if node.mesh not in known:
            known[node.mesh] = mesh = copy.copy(node.mesh)
            mesh.material = change(mesh.material)
        changed.add(known[node.mesh], node.world_from_model, node.name)
    return changed


def with_shadows(scene, change):
    """The scene with other shadows."""
    changed = copy.copy(scene)
    changed.lights = [
        dataclasses.replace(light, shadow=change(light.shadow))
        if getattr(light, "shadow", None)
        else light
        for light in scene.lights
    ]
    return changed


def with_filter(setting):
    """What gives a material's textures a filter, each texture one copy."""
    known, (name, anisotropy) = {}, parse_filter(setting)

    def change(material):
        fields = {}
        for field in TEXTURE_FIELDS:
            texture = getattr(material, field)
            if texture is not None:
                other = dataclasses.replace(texture, filter=name, anisotropy=anisotropy)
                fields[field] = known.setdefault(texture, other)
        return dataclasses.replace(material, **fields)

    return change


def everything(scene, **settings):
    frame = rj.render(
        scene,
        CAMERA,
        size=SIZE,
        quality=rj.Quality(**settings),
        outputs=OUTPUTS,
        previous=rj.PreviousView(),
        threads=1,
    )
    return {name: array.tobytes() for name, array in frame.arrays().items()}


def reasons(scene, **settings):
    plan = rj.explain(scene, CAMERA, rj.Quality(**settings), size=SIZE)
    return {effect.name: effect.reason for effect in plan.effects}


# --- shading ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("level", "shading"), [("vertex", {"phong": "gouraud"}),
                           ("face", {"phong": "flat", "gouraud": "flat"})],
)  # fmt: skip
def test_a_coarser_unit_of_shading_is_that_of_the_materials(scene, level, shading):
    wanted = with_materials(
        scene,
        lambda material: dataclasses.replace(
            material, shading=shading.get(material.shading, material.shading)
        ),
    )
    found = everything(scene, shading=level)
    assert found == everything(wanted)
    standard = everything(scene)
    differing = {name for name in found if found[name] != standard[name]}
    assert differing == {"color", "linear"}
    plain = reasons(wanted)
    told, *others = plain["shading"].split(";")
    plain["shading"] = ";".join([told, f" quality.shading is {level!r}", *others])
    assert reasons(scene, shading=level) == plain


@pytest.mark.parametrize("shading", ["unlit", "flat", "pbr"])
@pytest.mark.parametrize("level", LEVELS["shading"])
def test_what_asks_for_no_more_is_shaded_as_it_asks(cube, shading, level):
    scene = rj.Scene()
    scene.add(rj.Mesh(cube.vertices, cube.faces, material=rj.Material(shading, "red")))
    assert everything(scene, shading=level)["linear"] == everything(scene)["linear"]


def test_every_level_of_shading_has_its_ways(scene):
    assert tuple(COARSER_SHADING) == tuple(reversed(LEVELS["shading"]))


def test_a_face_of_a_flat_level_has_one_colour_under_a_sun(sphere):
    scene = rj.Scene()
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=rj.Material(specular=0.0)))
    scene.lights = [rj.DirectionalLight((-1, -2, -1))]
    colors = {}
    for level in LEVELS["shading"]:
        frame = rj.render(
            scene, CAMERA, size=SIZE, quality=rj.Quality(shading=level),
            outputs=("linear", "face_id"), threads=1,
        )  # fmt: skip
        colors[level] = len(np.unique(frame.linear[frame.face_id >= 0], axis=0))
        faces = len(np.unique(frame.face_id[frame.face_id >= 0]))
    assert colors["face"] <= faces < colors["vertex"]
    assert faces < colors["pixel"]


def test_what_is_lit_at_its_vertices_looks_the_same_beside_what_is_not(cube, sphere):
    scene = rj.Scene()
    scene.add(rj.Mesh(cube.vertices, cube.faces, material=rj.Material("gouraud", "red")))
    scene.lights = [rj.AmbientLight(), rj.PointLight((2, 3, 3), intensity=9.0)]
    frames = []
    for _ in range(2):
        frames.append(
            rj.render(scene, CAMERA, size=SIZE, outputs=("linear", "object_id"), threads=1)
        )
        scene.add(sphere, tf.compose(tf.translate((-1.2, 0.4, 1.5)), tf.scale((0.6, 0.6, 0.6))))
    both = frames[1].object_id == 0
    assert 100 < both.sum() < (frames[0].object_id == 0).sum()
    # Some rows of pixels show both.
    assert (both.any(axis=1) & (frames[1].object_id == 1).any(axis=1)).any()
    assert frames[0].linear[both].tobytes() == frames[1].linear[both].tobytes()


def test_what_a_coarser_level_does_not_read_is_not_asked_for(sphere):
    bumpy = rj.Material(normal_texture=checks(color_space="linear"))
    scene = rj.Scene()
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=bumpy))
    with pytest.raises(ValueError, match="normal_texture"):
        rj.explain(scene, CAMERA)
    plan = rj.explain(scene, CAMERA, rj.Quality(shading="vertex"))
    assert not plan.facts.needs_material_maps
    # Flat materials read them.
    with pytest.raises(ValueError, match="normal_texture"):
        rj.explain(scene, CAMERA, rj.Quality(shading="face"))


def test_faces_alone_need_no_normals_of_vertices(scene):
    plan = rj.explain(scene, CAMERA, rj.Quality(shading="face"), size=SIZE)
    assert not plan.facts.needs_normals
    assert not plan.facts.needs_gouraud
    assert plan.facts.visible.flat == 4
    assert rj.explain(scene, CAMERA, size=SIZE).facts.needs_gouraud


# --- textures ---------------------------------------------------------------------------------


@pytest.mark.parametrize("level", LEVELS["texture_filter"])
def test_a_filter_for_all_is_that_of_each_texture(scene, level):
    wanted = with_materials(scene, with_filter(level))
    found = everything(scene, texture_filter=level)
    assert found == everything(wanted)
    assert found["color"] != everything(scene)["color"]
    plain = reasons(wanted)
    plain["textures"] += f"; quality.texture_filter is {level!r}"
    assert reasons(scene, texture_filter=level) == plain


@pytest.mark.parametrize("level", LEVELS["texture_filter"])
def test_mip_levels_are_made_for_filters_that_read_them(cube, level):
    texture = checks()
    scene = rj.Scene()
    scene.add(textured(cube, shading="unlit", base_color_texture=texture))
    everything(scene, texture_filter=level)
    has_levels = len(texture.pyramid._texels) > 16 * 16
    assert has_levels == (level not in ("nearest", "bilinear"))


def test_a_texture_filtered_otherwise_shares_its_texels():
    texture = checks(wrap="clamp", anisotropy=4).with_transform((0.5, 0.0))
    other = texture.with_filter("nearest")
    assert other.pyramid is texture.pyramid
    assert (other.filter, other.anisotropy) == ("nearest", 1)
    assert (texture.filter, texture.anisotropy) == ("trilinear", 4)
    assert (other.wrap, other.transform) == (texture.wrap, texture.transform)
    assert other.with_filter("trilinear", 16).anisotropy == 16
    for wrong in (("linear", 1), ("nearest", 2), ("trilinear", 3)):
        with pytest.raises(ValueError, match=r"filter|anisotropy"):
            texture.with_filter(*wrong)


@pytest.mark.parametrize("level", ["nearest", "trilinear", "anisotropic4"])
def test_holes_are_where_the_filter_of_all_shows_them(level):
    square = np.array([(-3, -1, 4), (3, -1, 4), (3, -1, -12), (-3, -1, -12)], float)
    cut = rj.Material("unlit", base_color_texture=checks(filter="bilinear"), alpha_mode="mask")
    scene = rj.Scene()
    scene.add(rj.Mesh(square, [(0, 1, 2), (0, 2, 3)], uv=square[:, ::2], material=cut))
    found = everything(scene, texture_filter=level)
    assert found == everything(with_materials(scene, with_filter(level)))
    assert found["face_id"] != everything(scene)["face_id"]


# --- shadows ----------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [16, 256])
def test_a_size_for_all_is_that_of_each_shadow(scene, size):
    wanted = with_shadows(scene, lambda shadow: dataclasses.replace(shadow, size=size))
    found = everything(scene, shadow_size=size)
    assert found == everything(wanted)
    assert found["color"] != everything(scene)["color"]
    plain = reasons(wanted)
    plain["shadows"] += f"; quality.shadow_size is {size}"
    assert reasons(scene, shadow_size=size) == plain
    assert f"{size} x {size}" in plain["shadows"]


@pytest.mark.parametrize(("taps", "name"), [(1, "hard"), (9, "pcf")])
def test_taps_for_all_are_those_of_each_shadow(scene, taps, name):
    wanted = with_shadows(
        scene, lambda shadow: dataclasses.replace(shadow, filter=name, light_size=None)
    )
    found = everything(scene, shadow_taps=taps)
    assert found == everything(wanted)
    assert found["color"] != everything(scene)["color"]
    assert reasons(scene, shadow_taps=taps)["shadows"].endswith(f"; quality.shadow_taps is {taps}")


def test_maps_that_a_quality_asks_for_are_of_bounded_size(scene):
    # Lights at points have six maps: nineteen of 8192 with that of the sun, where sixteen fit.
    scene.lights += [
        rj.PointLight((float(n), 4.0, 2.0), intensity=1.0, shadow=rj.Shadow(16)) for n in range(2)
    ]
    everything(scene, shadow_size=32)
    with pytest.raises(ValueError, match=r"quality\.shadow_size"):
        rj.explain(scene, CAMERA, rj.Quality(shadow_size=8192), size=SIZE)


def test_a_light_without_shadow_gets_none(scene):
    bare = with_shadows(scene, lambda _: None)
    assert everything(bare, shadow_size=64, shadow_taps=1) == everything(bare)
    assert reasons(bare, shadow_size=64)["shadows"] == "no light casts them"


# --- with what is kept, told and measured -----------------------------------------------------

SETTINGS = (
    {}, {"shading": "face"}, {"shading": "vertex"}, {"texture_filter": "nearest"},
    {"texture_filter": "anisotropic4"}, {"shadow_size": 16}, {"shadow_taps": 1},
)  # fmt: skip


def test_a_renderer_follows_its_quality(scene):
    with rj.Renderer(SIZE, threads=1) as renderer:
        for settings in (*SETTINGS, *reversed(SETTINGS)):
            renderer.quality = rj.Quality(**settings)
            frame = renderer.render(scene, CAMERA, outputs=OUTPUTS, previous=rj.PreviousView())
            found = {name: array.tobytes() for name, array in frame.arrays().items()}
            assert found == everything(scene, **settings)


def test_a_renderer_looks_through_unchanged_meshes_once(scene):
    with rj.Renderer(SIZE, quality=rj.Quality(shading="vertex"), threads=1) as renderer:
        renderer.render(scene, CAMERA)
        looks = renderer._scene_cache.tables
        renderer.render(scene, CAMERA)
        assert renderer._scene_cache.tables is looks


def test_normals_of_vertices_are_kept_by_the_mesh(sphere):
    everything(sphere, shading="vertex")
    assert sphere._vertex_normals is not None


@pytest.mark.parametrize("settings", SETTINGS[1:], ids=str)
def test_the_pixel_told_is_that_of_the_frame(scene, settings):
    quality = rj.Quality(**settings)
    outputs = ("color", "linear", "object_id")
    scene.fog = None
    frame = rj.render(scene, CAMERA, size=SIZE, quality=quality, outputs=outputs, threads=1)
    shown = {"face": "flat", "vertex": "gouraud"}.get(settings.get("shading"), "phong")
    for number in range(3):
        y, x = np.argwhere(frame.object_id == number)[20]
        told = rj.explain_pixel(scene, CAMERA, SIZE, int(x), int(y), quality=quality)
        assert told.linear.tobytes() == frame.linear[y, x].tobytes()
        assert told.color.tolist() == frame.color[y, x].tolist()
        assert number != 1 or told.light.shading == shown
        parts = [part.diffuse + part.specular for part in told.light.lights]
        total = told.light.ambient + np.sum(parts, axis=0)
        assert total == pytest.approx(frame.linear[y, x, :3], rel=1e-4, abs=1e-6)


def test_measuring_offers_what_the_quality_leaves_open(scene):
    scene.lights[1] = rj.DirectionalLight((-1, -2, -1))

    def found(**settings):
        quality = rj.Quality(**settings)
        plan = rj.explain(scene, CAMERA, quality, size=SIZE)
        return {what for _, what, _, _ in profile.list_variations(plan, scene, quality)}

    levels = "mip levels for 2 of them"
    assert levels in found()
    assert levels not in found(texture_filter="bilinear")
    assert "of 1 more light, maps of 1024 x 1024" in found()
    assert "of 1 more light, maps of 128 x 128" in found(shadow_size=128)
