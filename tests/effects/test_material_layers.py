"""
Varnish, fibres and own mirrors: equal to the formulas of glTF's extensions, bounded by white light.

Pictures of a ball or a square, seen along -z by a parallel camera, are compared pixel by pixel with
``naive_layered``.
"""

from __future__ import annotations

import dataclasses
import itertools

import blocks
import naive_layered
import numpy as np
import pytest
import skies
from naive_layered import Layered

import rasterjit as rj
from rasterjit.pipeline.lighting import blinn_phong, layered_materials, light_stages, sheen
from rasterjit.pipeline.passes import Pass, ShadingArrays, ShadingNeeds, bind, fixed
from rasterjit.pipeline.records import Layers, Lighting, Microfacets, Surface
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.rendering import shading_passes
from rasterjit.rendering.planning import list_passes
from rasterjit.scene.material import LAYER_TEXTURES

SIZE = (20, 20)
CAMERA = rj.OrthographicCamera(eye=(0, 0, 20), target=(0, 0, 0), height=2.0, near=1.0, far=60.0)
FROM_VIEWER = np.array([0.0, 0.0, 1.0])
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
SQUARE_FACES = [[0, 1, 2], [0, 2, 3]]
UPRIGHT = (SQUARE[:, :2] + 1.0) / 2.0

MATERIALS = {
    "varnish": Layered((0.7, 0.2, 0.1), 0.0, 0.6, clearcoat=0.8, clearcoat_roughness=0.3),
    "varnished metal": Layered((0.9, 0.6, 0.2), 1.0, 0.5, clearcoat=1.0, clearcoat_roughness=0.2),
    "cloth": Layered((0.1, 0.1, 0.4), 0.0, 0.9, sheen_color=(0.8, 0.4, 0.9), sheen_roughness=0.5),
    "smooth fibres": Layered(sheen_color=(0.3, 0.3, 0.3), sheen_roughness=0.2),
    "no mirror": Layered((0.7, 0.6, 0.2), 0.2, 0.4, specular_factor=0.0),
    "coloured mirror": Layered((0.2, 0.3, 0.6), 0.1, 0.4, specular_color=(9.0, 0.5, 40.0)),
    "diamond": Layered((0.5, 0.5, 0.5), 0.0, 0.35, ior=2.4, specular_factor=0.7),
    "water": Layered(ior=1.33),
    "all mirrored": Layered(ior=0.0, roughness=0.4),
    "all": Layered(
        (0.4, 0.5, 0.3), 0.3, 0.5, 0.6, 0.25, (0.5, 0.7, 0.2), 0.6, 0.8, (1.0, 0.6, 2.0), 1.8
    ),
}  # fmt: skip

LIGHTS = {
    "directional": rj.DirectionalLight((-0.5, -0.4, -1.0), (1.0, 0.8, 0.5), 2.0),
    "grazing": rj.DirectionalLight((-1.0, 0.3, -0.1), (0.3, 1.0, 0.7), 1.5),
    "point": rj.PointLight((0.5, 1.5, 2.0), intensity=5.0),
    "spot": rj.SpotLight((1.0, 1.0, 3.0), (-0.3, -0.3, -1.0), intensity=9.0, outer_angle=40.0),
}  # fmt: skip


def material_of(own, **others):
    """Return a described material."""
    told = own._asdict()
    return rj.Material("pbr", base_color=told.pop("base"), **told, **others)


def ball(material, rows=24):
    """Return a ball of radius 1, its texture coordinates round about."""
    v, u = (part.ravel() for part in np.mgrid[0 : rows + 1, 0 : 2 * rows + 1])
    polar, around = v * (np.pi / rows), u * (np.pi / rows)
    points = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=1
    )
    a = (np.arange(rows)[:, None] * (2 * rows + 1) + np.arange(2 * rows)).ravel()
    b = a + 2 * rows + 1
    faces = np.concatenate([np.stack([a, b, a + 1], 1), np.stack([a + 1, b, b + 1], 1)])
    uv = np.stack([u / (2.0 * rows), 1.0 - v / rows], axis=1)
    return rj.Mesh(points, faces, normals=points, uv=uv, material=material, on_invalid="drop")


def square(material):
    """Return a square that fills the picture, u to the right and v up."""
    return rj.Mesh(SQUARE, SQUARE_FACES, uv=UPRIGHT, material=material)


def scene_of(mesh, lights=(), environment=None):
    """Return a scene; without lights it is dark."""
    scene = rj.Scene()
    scene.add(mesh)
    scene.lights = list(lights) or [rj.AmbientLight(intensity=0.0)]
    scene.environment = environment
    return scene


def drawn(scene, *outputs, **settings):
    """Return a frame, linear."""
    return rj.render(
        scene, CAMERA, size=SIZE, outputs=("linear", "face_id", *outputs), background="black",
        quality=rj.Quality(**settings),
    )  # fmt: skip


def shown(scene, **settings):
    """Return the colours of the pixels that show a face, (N, 3)."""
    frame = drawn(scene, **settings)
    return frame.linear[frame.face_id >= 0][:, :3]


def falling(light, point):
    """Return where a light comes from at a point, and how much of it arrives, linear."""
    color = np.array(light.color) * light.intensity
    if isinstance(light, rj.DirectionalLight):
        return -np.array(light.direction) / np.linalg.norm(light.direction), color
    toward = np.array(light.position) - point
    distance = np.linalg.norm(toward)
    color, toward = color / distance**2, toward / distance
    if isinstance(light, rj.SpotLight):
        axis = np.array(light.direction) / np.linalg.norm(light.direction)
        inner, outer = (
            np.cos(np.radians(angle)) for angle in (light.inner_angle, light.outer_angle)
        )
        color = color * np.clip((-toward @ axis - outer) / max(1e-3, inner - outer), 0.0, 1.0) ** 2
    return toward, color


def table_albedo(roughness, cosine):
    """The share that fibres take, from the table, in Python's own words."""
    y, x = roughness * 15.0, np.sqrt(max(cosine, 0.0)) * 15.0
    row, column = min(int(y), 14), min(int(x), 14)
    corners = sheen.ALBEDO[row : row + 2, column : column + 2].astype(float)
    across = corners[:, 0] + (x - column) * (corners[:, 1] - corners[:, 0])
    return across[0] + (y - row) * (across[1] - across[0])


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("name", MATERIALS)
def test_light_is_that_of_the_extensions(name, light):
    own, light = MATERIALS[name], LIGHTS[light]
    frame = drawn(scene_of(ball(material_of(own)), [light]), "normal", "position")
    compared = 0
    for row, column in np.argwhere(frame.face_id >= 0)[::7]:
        normal = frame.normal[row, column].astype(float)
        normal /= np.linalg.norm(normal)
        toward, color = falling(light, frame.position[row, column].astype(float))
        facing = normal @ toward
        if normal[2] < 0.05 or abs(facing) < 0.01:
            continue
        shares = naive_layered.layered_brdf(own, normal, normal, toward, FROM_VIEWER, table_albedo)
        have = frame.linear[row, column, :3]
        assert have == pytest.approx(np.array(shares) * color, rel=2e-3, abs=2e-5)
        compared += max(shares) > 0.0
    assert compared > 8


def test_the_table_of_fibres_is_the_integral_of_their_light():
    for roughness, root in itertools.product((0.0, 0.2, 0.6, 1.0), (0.2, 0.8, 1.0)):
        want = naive_layered.sheen_albedo(roughness, root * root)
        assert table_albedo(roughness, root * root) == pytest.approx(min(1.0, want), abs=0.004)


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
def test_under_white_light_from_all_sides_nothing_is_brighter_than_white(name, roughness):
    own = MATERIALS[name]._replace(base=(1.0, 1.0, 1.0), roughness=roughness)
    mesh = ball(material_of(own))
    for scene in (
        scene_of(mesh, environment=rj.Environment.constant()),
        scene_of(mesh, [rj.AmbientLight(intensity=1.0)]),
    ):
        colors = shown(scene)
        assert colors.max() <= 1.0 + 1e-5
        if max(own.sheen_color) == 0.0 and own.specular_color == (1.0, 1.0, 1.0):
            # All that goes into white comes out again.
            assert colors.min() > 1.0 - 1e-4


@pytest.mark.parametrize("name", MATERIALS)
def test_one_colour_all_around_equals_ambient_light(name):
    mesh = ball(material_of(MATERIALS[name]))
    around = shown(scene_of(mesh, environment=rj.Environment.constant((0.3, 0.5, 0.7))))
    ambient = shown(scene_of(mesh, [rj.AmbientLight((0.3, 0.5, 0.7), intensity=1.0)]))
    assert np.allclose(around, ambient, rtol=2e-4, atol=2e-5)


def test_varnish_mirrors_the_sky_sharply_over_rough_paint():
    sky = rj.Environment(skies.sunny(256, 128), background=False)
    paint = Layered((0.3, 0.02, 0.02), 0.0, 0.9)
    dull, varnished, rough = (
        shown(scene_of(ball(material_of(own)), environment=sky)).max(axis=1)
        for own in (
            paint,
            paint._replace(clearcoat=1.0, clearcoat_roughness=0.15),
            paint._replace(clearcoat=1.0, clearcoat_roughness=0.8),
        )
    )
    assert varnished.max() > 2.0 * dull.max()
    assert rough.max() < 0.7 * varnished.max()


def test_light_from_all_sides_shows_what_is_mirrored_by_its_weight():
    sky = rj.Environment(skies.sunny(128, 64), background=False)
    black = Layered((0.0, 0.0, 0.0), 0.0, 0.3)
    plain, half, green = (
        shown(scene_of(ball(material_of(own)), environment=sky))
        for own in (
            black._replace(ior=1.5 + 1e-9),
            black._replace(specular_factor=0.5),
            black._replace(specular_color=(0.0, 1.0, 0.0)),
        )
    )
    assert np.allclose(half, 0.5 * plain, rtol=1e-5, atol=1e-6)
    assert np.allclose(green[:, 1], plain[:, 1], rtol=1e-5, atol=1e-6)
    assert (green[:, 0] <= plain[:, 0]).all()


def test_fibres_take_the_sky_as_their_lobe_does_by_and_large():
    image = skies.sunny(64, 32, brightness=20.0, degrees=12.0)
    sky = rj.Environment(image, background=False)
    toward = skies.directions(64, 32).reshape(-1, 3)
    light = (image * skies.solid_angles(64, 32)[..., None]).reshape(-1, 3)
    for roughness, most in ((0.35, 0.45), (0.8, 0.3)):
        own = Layered((0.0, 0.0, 0.0), 0.0, 0.9, 0.0, 0.0, (1.0, 1.0, 1.0), roughness)
        # What lies below is black but for what it mirrors.
        material = material_of(own._replace(specular_factor=0.0))
        frame = drawn(scene_of(ball(material), environment=sky), "normal")
        found, wanted = [], []
        for row, column in np.argwhere(frame.face_id >= 0)[::21]:
            normal = frame.normal[row, column].astype(float)
            if normal[2] < 0.1:
                continue
            facing = toward @ normal
            shares = [
                naive_layered.sheen_brdf(roughness, normal, one, FROM_VIEWER) * cosine
                if cosine > 1e-3
                else 0.0
                for one, cosine in zip(toward, facing, strict=True)
            ]
            wanted.append(np.array(shares) @ light)
            found.append(frame.linear[row, column, :3])
        off = np.abs(np.array(found) - wanted).sum() / np.sum(wanted)
        assert off < most


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
@pytest.mark.parametrize(
    "light",
    [
        {"lights": [LIGHTS["directional"], LIGHTS["point"]]},
        {"lights": [rj.AmbientLight(intensity=0.7)]},
        {"environment": rj.Environment(skies.sunny(64, 32))},
    ],
    ids=["lights", "ambient", "environment"],
)
def test_a_mirror_of_its_own_that_is_that_of_glass_changes_little(metallic, light):
    plain = Layered((0.7, 0.4, 0.2), metallic, 0.35)
    want = shown(scene_of(ball(material_of(plain)), **light))
    have = shown(scene_of(ball(material_of(plain._replace(ior=1.5 + 1e-9))), **light))
    assert np.allclose(have, want, rtol=2e-4, atol=1e-5)


# Textures


def flat(*texel, **options):
    """Return a texture of one colour, linear."""
    return rj.Texture(np.full((2, 2, len(texel)), texel, np.float32), **options)


SCENE_LIGHTS = {
    "lights": [rj.AmbientLight(intensity=0.3), LIGHTS["directional"]],
    "environment": rj.Environment.constant((0.2, 0.3, 0.4)),
}


@pytest.mark.parametrize(
    ("textured", "plain"),
    [
        (
            {"clearcoat": 0.8, "clearcoat_texture": flat(0.5, 0.9, 0.9)},
            {"clearcoat": 0.4},
        ),
        (
            {"clearcoat": 1.0, "clearcoat_roughness": 0.8,
             "clearcoat_roughness_texture": flat(0.9, 0.5, 0.9)},
            {"clearcoat": 1.0, "clearcoat_roughness": 0.4},
        ),
        (
            {"sheen_color": (1.0, 0.5, 0.5), "sheen_roughness": 0.4,
             "sheen_color_texture": flat(0.5, 1.0, 0.2)},
            {"sheen_color": (0.5, 0.5, 0.1), "sheen_roughness": 0.4},
        ),
        (
            {"sheen_color": "white", "sheen_roughness": 0.8,
             "sheen_roughness_texture": flat(0.9, 0.9, 0.9, 0.5)},
            {"sheen_color": "white", "sheen_roughness": 0.4},
        ),
        (
            {"specular_factor": 0.8, "specular_factor_texture": flat(0.9, 0.9, 0.9, 0.5)},
            {"specular_factor": 0.4},
        ),
        (
            {"specular_color": (4.0, 2.0, 1.0), "specular_color_texture": flat(0.5, 0.5, 0.2)},
            {"specular_color": (2.0, 1.0, 0.2)},
        ),
    ],
    ids=[name for name in LAYER_TEXTURES[:7] if "normal" not in name],
)  # fmt: skip
@pytest.mark.parametrize("uv_set", [0, 1])
def test_textures_multiply_factors(textured, plain, uv_set):
    if uv_set:
        # The first set is that of another texture.
        textured = {
            name: value.with_uv_set(1) if isinstance(value, rj.Texture) else value
            for name, value in textured.items()
        } | {"occlusion_texture": flat(1.0, 1.0, 1.0)}
    looks = []
    for options in (textured, plain):
        mesh = ball(rj.Material("pbr", base_color=(0.5, 0.4, 0.3), **options))
        if uv_set:
            mesh = rj.Mesh(
                mesh.vertices, mesh.faces, normals=mesh.normals, uv=mesh.uv, uv1=mesh.uv[:, ::-1],
                material=mesh.material,
            )  # fmt: skip
        looks.append(shown(scene_of(mesh, **SCENE_LIGHTS)))
    assert np.allclose(*looks, rtol=1e-5, atol=1e-6)


def test_a_texture_is_moved_as_it_says():
    halves = np.zeros((2, 2, 3), np.float32)
    halves[:, 1] = 1.0
    picture = rj.Texture(halves, filter="nearest")
    own = {"base_color": "black", "roughness": 1.0, "clearcoat": 1.0, "clearcoat_roughness": 0.5}
    light = [rj.DirectionalLight((0, 0, -1))]
    left, right = (
        drawn(scene_of(square(rj.Material("pbr", **own, clearcoat_texture=texture)), light)).linear[
            :, :, 0
        ]
        for texture in (picture.with_transform((0.5, 0.0)), picture)
    )
    assert (left[:, :10] > 2.0 * left[:, 10:]).all()
    assert np.array_equal(left, right[:, ::-1])


def test_varnish_has_normals_of_its_own():
    own = Layered((0.5, 0.2, 0.1), 0.0, 0.5, clearcoat=1.0, clearcoat_roughness=0.3)
    tilted, other = np.array([0.3, -0.2, 0.9]), np.array([-0.4, 0.1, 0.8])
    light = LIGHTS["directional"]
    toward, color = falling(light, np.zeros(3))

    def seen(**textures):
        frame = drawn(scene_of(square(material_of(own, **textures)), [light]))
        return frame.linear[10, 10, :3]

    up = FROM_VIEWER
    for below, above, scale in itertools.product((None, other), (None, tilted), (1.0, 0.5)):
        textures, normals = {}, [up, up]
        if below is not None:
            textures["normal_texture"] = flat(*(below / 2.0 + 0.5))
            normals[0] = below / np.linalg.norm(below)
        if above is not None:
            textures["clearcoat_normal_texture"] = flat(*(above / 2.0 + 0.5))
            textures["clearcoat_normal_scale"] = scale
            bent = above * (scale, scale, 1.0)
            normals[1] = bent / np.linalg.norm(bent)
        want = naive_layered.layered_brdf(own, *normals, toward, FROM_VIEWER, table_albedo)
        assert seen(**textures) == pytest.approx(np.array(want) * color, rel=1e-3, abs=1e-5)


def test_what_a_varnished_surface_sends_out_is_dimmed_as_it_is():
    own = material_of(Layered((0.0, 0.0, 0.0), clearcoat=0.5), emissive=(2.0, 1.0, 0.5))
    have = drawn(scene_of(square(own))).linear[10, 10, :3]
    assert have == pytest.approx(np.array([2.0, 1.0, 0.5]) * (1.0 - 0.5 * 0.04), rel=1e-6)


# What stays as it is


@pytest.mark.parametrize("samples", [1, 4, "area"])
def test_other_objects_keep_their_bits(samples):
    shades = ("pbr", "phong", "gouraud", "flat", "unlit")
    sky = rj.Environment(skies.sunny(64, 32))
    shadow = rj.Shadow(64)

    def picture(layered):
        scene = rj.Scene()
        for n, shading in enumerate(shades):
            place = rj.transforms.translate((n * 0.4 - 0.8, 0.5, 0.0))
            size = rj.transforms.scale((0.2, 0.2, 0.2))
            scene.add(
                ball(rj.Material(shading, base_color="#a06040", metallic=0.3), 8), place @ size
            )
        for n, own in enumerate(("cloth", "all")):
            place = rj.transforms.translate((n - 0.5, -0.5, 0.0)) @ rj.transforms.scale((0.4,) * 3)
            material = material_of(MATERIALS[own]) if layered else rj.Material("pbr")
            scene.add(ball(material, 8), place)
        scene.lights = [
            rj.AmbientLight(intensity=0.1), rj.DirectionalLight((-1, -1, -1), shadow=shadow),
            LIGHTS["point"],
        ]  # fmt: skip
        scene.environment = sky
        frame = rj.render(
            scene, CAMERA, size=(60, 60), outputs=("linear", "object_id"),
            quality=rj.Quality(samples=samples),
        )  # fmt: skip
        return frame

    one, other = picture(True), picture(False)
    upper = np.arange(60) < 29
    assert np.array_equal(one.linear[upper], other.linear[upper])
    assert not np.array_equal(one.linear, other.linear)
    assert set(one.object_id.ravel().tolist()) >= set(range(7))


def test_layers_that_are_off_change_no_bit():
    texture = flat(0.3, 0.5, 0.7)
    sky = rj.Environment(skies.sunny(64, 32))
    plain = rj.Material("pbr", base_color="#a06040", metallic=0.3, roughness=0.4)
    off = dataclasses.replace(
        plain, clearcoat_roughness=0.7, clearcoat_texture=texture, sheen_roughness=0.3,
        clearcoat_normal_texture=texture, sheen_color="black", sheen_color_texture=texture,
        ior=1.5, specular_factor=1.0, specular_color="white",
    )  # fmt: skip
    lights = [rj.AmbientLight(intensity=0.2), LIGHTS["directional"]]
    one, other = (shown(scene_of(ball(own), lights, sky)) for own in (plain, off))
    assert np.array_equal(one, other)


@pytest.mark.parametrize("shading", ["unlit", "flat", "gouraud", "phong"])
def test_other_shadings_have_no_layers(shading):
    lights = [rj.AmbientLight(intensity=0.2), LIGHTS["directional"]]
    plain = rj.Material(shading, base_color="#a06040")
    layered = dataclasses.replace(plain, clearcoat=1.0, sheen_color="white", ior=2.0)
    one, other = (shown(scene_of(ball(own), lights)) for own in (plain, layered))
    assert np.array_equal(one, other)


def test_a_varnish_has_stages_of_its_own_and_no_others():
    lights = [rj.DirectionalLight((-1, -1, -1), intensity=0.5)]
    layered = rj.explain(
        scene_of(ball(rj.Material("pbr", roughness=0.8, clearcoat=0.5)), lights), CAMERA
    )
    stages = {told.name for told in list_passes(layered)}
    assert "clearcoat.blend_clearcoats" in stages
    assert not any("sheen" in name or "dielectrics" in name for name in stages)


@pytest.mark.parametrize("name", ["varnish", "cloth", "diamond", "all"])
def test_shadows_fall_on_all_layers(name):
    light = rj.DirectionalLight((-0.05, -0.05, -1.0), shadow=rj.Shadow(64))
    scene = scene_of(square(material_of(MATERIALS[name])), [light])
    roof = rj.Mesh(SQUARE * 3.0, SQUARE_FACES, material=rj.Material("unlit"))
    scene.add(roof, rj.transforms.translate((0.0, 0.0, 30.0)))
    assert drawn(scene).linear[:, :, :3].max() == 0.0


@pytest.mark.parametrize("name", ["varnish", "cloth", "diamond", "all"])
def test_the_terms_of_a_pixel_add_up_to_its_colour(name):
    own = material_of(MATERIALS[name], emissive=(0.2, 0.1, 0.0))
    lights = [rj.AmbientLight(intensity=0.2), LIGHTS["directional"], LIGHTS["point"]]
    scene = scene_of(ball(own), lights, rj.Environment(skies.sunny(64, 32)))
    told = rj.explain_pixel(scene, CAMERA, SIZE, 9, 12)
    light = told.light
    total = light.ambient + light.emission + sum(one.diffuse + one.specular for one in light.lights)
    assert total == pytest.approx(told.linear[:3], rel=1e-4, abs=1e-5)
    assert light.base_color == pytest.approx(own.base_color[:3], rel=1e-5)


@pytest.mark.parametrize("row", [(0.4, 0.5, 0.9, 0, 1, 0.5, 0.2), (1e18, 2.0, 1e18, 1, 3, 2, 9)])
def test_what_float32_cannot_tell_is_a_number_all_the_same(row):
    rng, count = np.random.default_rng(3), 96
    samples = rng.uniform(0.1, 1.0, (rows.SAMPLE_ROWS, count)).astype(np.float32)
    samples[rows.LIT] = samples[rows.COAT_LIT] = 0.0
    samples[rows.MICROFACET] = samples[rows.IS_DIELECTRIC] = 1.0
    offs = (1e18, -4e18, 1e19, 1e30, -3e38, np.inf, -np.inf, np.nan)
    for n in range(count):
        samples[(rows.NORMAL_X, rows.POINT_X, rows.COAT_NORMAL_X)[n % 3] + n // 3 % 3, n] = offs[
            n % 8
        ]
    lights = np.zeros((1, blinn_phong.LIGHT_COLUMNS), np.float32)
    lights[0, : len(row)], lights[0, blinn_phong.CONE_OFFSET] = row, 1.0
    viewer, parts, dark = np.float32([0, 0, 0, 1]), np.ones(2, np.float32), np.zeros(3, np.float32)
    there = np.zeros((1, 1), np.float32)
    layers = Layers(there, there, None, there, there, np.zeros((1, 9), np.float32), sheen.ALBEDO)
    surface = Surface(*(None,) * 7, microfacets=Microfacets(None, parts), layers=layers)
    arrays = ShadingArrays(None, None, surface, Lighting(lights, dark, None), viewer, None, None)
    needs = ShadingNeeds(
        1, microfacets=True, layers=True, coats=True, sheens=True, dielectrics=True
    )
    normalize = fixed(light_stages.normalize_normals)
    around = Pass(light_stages.write_microfacet_ambient, lambda a: (a.lighting.ambient, a.viewer))
    passes = [
        *layered_materials.list_starting_passes(needs, normalize), normalize,
        *layered_materials.list_ambient_passes(needs, around, shading_passes.ambient_pass(),
        is_first=True), *shading_passes.add_passes(needs, 0, 1),
        *layered_materials.list_finishing_passes(needs),
    ]  # fmt: skip
    steps = bind(passes, arrays)
    blocks.run(samples, *((step.stage, *step.arguments) for step in steps))
    assert np.isfinite(samples[rows.OUT_RED : rows.OUT_RED + 3]).all()
