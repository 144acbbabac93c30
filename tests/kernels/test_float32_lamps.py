"""Faces in the light of lamps stay within a sixteenth of a code in float32, or take float64."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from float32_faces import EYES, SIXTEENTH, SIZE, SUN, codes, hills, pair

import rasterjit as rj
from rasterjit.pipeline.surface.lamps import LIGHT, MOST, facing_of, lamp_on_face
from rasterjit.pipeline.surface.samples import COUNTS
from rasterjit.rendering.stage_list import BLOCKS
from rasterjit.rendering.tiles import Region, RegionRenderer
from rasterjit.survey.facts import float64_reason
from rasterjit.survey.lights import lighting_of, pyramids_of
from rasterjit.survey.precision import (
    Brightness,
    gloss_of,
    lamps_among,
    limits_of,
    rows_of_lamps,
)

POINT = rj.PointLight((0.3, 1.2, -0.4), intensity=1.5)
SPOT = rj.SpotLight((-0.8, 1.6, 0.5), (0.3, -1.0, -0.2), intensity=2.0)
LAMPS = {
    "point": (POINT,),
    "spot": (SPOT,),
    "range": (rj.PointLight((0.3, 1.2, -0.4), intensity=1.5, range=1.7),),
    "narrow": (rj.SpotLight((0.0, 2.5, 0.0), (0.0, -1.0, 0.0), intensity=5.0, outer_angle=4.0),),
    "hard": (
        rj.SpotLight((-0.8, 1.6, 0.5), (0.3, -1.0, -0.2), intensity=2.0, inner_angle=30.0,
                     outer_angle=30.0, range=2.4),
    ),
    "all": (rj.AmbientLight(), SUN, POINT, SPOT),
    "bright": (rj.PointLight((0.3, 1.2, -0.4), intensity=30.0),),
    "near": (rj.PointLight((0.1, 0.2, -0.3), "orange", intensity=0.05),),
    "within": (rj.PointLight((0.0, 0.0, 0.0), intensity=0.05), SUN),
    "many": tuple(
        rj.PointLight((x, 0.8, z), intensity=0.2, range=1.5) for x in (-1, 0, 1) for z in (-1, 1)
    ),
}  # fmt: skip
MATERIALS = [
    {}, {"specular": 0.0}, {"shininess": 1500.0}, {"shading": "pbr", "roughness": 0.4},
    {"shading": "pbr", "roughness": 0.25, "metallic": 1.0},
]  # fmt: skip


def moved(one, other):
    """Return how far codes lie apart, at most, after a look at the 8-bit ones."""
    apart = np.abs(np.int32(one.color) - np.int32(other.color)).max(axis=-1)
    assert apart.max() <= 1
    assert (apart > 0).mean() < 1e-3
    return np.abs(codes(one.linear) - codes(other.linear)).max()


@pytest.mark.needs_jit
@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("squares", [1, 9, 90])
@pytest.mark.parametrize("lamps", LAMPS)
def test_codes_move_by_a_sixteenth_at_most(eye, squares, lamps):
    for material in MATERIALS if squares == 9 else MATERIALS[:1]:
        one, other = pair(hills(squares, lights=LAMPS[lamps], **material), EYES[eye])
        assert (one.face_id >= 0).mean() > 0.2
        assert moved(one, other) <= SIXTEENTH
        assert lamps == "narrow" or (one.linear != other.linear).any()


@pytest.mark.needs_jit
@pytest.mark.parametrize("squares", [2, 90])
@pytest.mark.parametrize("samples", [4, 16, "area", 64])
def test_several_samples_move_as_little(squares, samples):
    scene = hills(squares, lights=LAMPS["all"])
    one, other = pair(scene, EYES["above"], samples=samples)
    assert moved(one, other) <= SIXTEENTH


@pytest.mark.parametrize("squares", [2, 90])
@pytest.mark.parametrize("lamps", ["all", "bright", "near"])
def test_pixels_of_one_face_have_the_bits_of_one_sample(squares, lamps):
    scene, camera = hills(squares, lights=LAMPS[lamps]), EYES["above"]
    shown = rj.render(scene, camera, size=(16 * 160, 16 * 120), outputs=("face_id",)).face_id
    blocks = shown.reshape(120, 16, 160, 16).transpose(0, 2, 1, 3).reshape(120, 160, -1)
    plain = (blocks == blocks[:, :, :1]).all(axis=2) & (blocks[:, :, 0] >= 0)
    assert plain.mean() > 0.05
    one = rj.render(scene, camera, size=SIZE, outputs=("linear",)).linear
    for samples in (2, 8):
        many = rj.render(
            scene, camera, quality=rj.Quality(samples=samples), size=SIZE, outputs=("linear",)
        ).linear
        assert many[plain].tobytes() == one[plain].tobytes()


@pytest.mark.parametrize("height", [0.0, 1e-4, 0.05])
@pytest.mark.parametrize("squares", [2, 30])
def test_faces_that_lamps_touch_have_the_bits_of_float64(height, squares):
    # Without colours of vertices, these are all that float64 finds.
    scene, camera = hills(squares, colored=False), EYES["above"]
    mesh = scene.nodes[0].mesh
    shown = rj.render(scene, camera, size=SIZE, outputs=("face_id",)).face_id
    face = int(shown[60, 80])
    place = mesh.vertices[mesh.faces[face]].mean(axis=0) + (0.0, height, 0.0)
    for lamp in (
        rj.PointLight(place, intensity=0.3),
        rj.SpotLight(place, (0.1, -1.0, 0.0), intensity=0.3, outer_angle=89.0),
    ):
        scene.lights = [lamp, SUN]
        one, other = pair(scene, camera)
        assert moved(one, other) <= SIXTEENTH
        touched = shown == face
        assert one.linear[touched].tobytes() == other.linear[touched].tobytes()


def test_faces_that_are_too_bright_have_the_bits_of_float64():
    scene = hills(30, colored=False, lights=[rj.PointLight((0.3, 1.2, -0.4), intensity=1e9)])
    one, other = pair(scene, EYES["above"])
    assert one.linear.tobytes() == other.linear.tobytes()


@pytest.mark.needs_jit
@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("squares", [2, 40])
def test_any_size_is_lit_alike(scale, squares):
    mesh, scene = hills(squares).nodes[0].mesh, rj.Scene()
    scene.add(mesh, rj.transforms.scale(scale))
    scene.lights = [
        rj.PointLight((0.3 * scale, 1.2 * scale, -0.4 * scale), intensity=min(1.5 * scale**2, 1e9)),
        rj.SpotLight(
            (-0.8 * scale, 1.6 * scale, 0.5 * scale), (0.3, -1.0, -0.2),
            intensity=min(2.0 * scale**2, 1e9), range=4.0 * scale,
        ),
    ]  # fmt: skip
    camera = rj.PerspectiveCamera((0.4 * scale, 1.6 * scale, 2.2 * scale), (0.0, 0.0, 0.0))
    one, other = pair(scene, camera)
    assert moved(one, other) <= SIXTEENTH
    assert (one.linear != other.linear).any()


@pytest.mark.needs_jit
def test_lamps_are_far_from_the_eye_or_the_origin():
    mesh, scene = hills(20).nodes[0].mesh, rj.Scene()
    away = np.array([1e5, -2e5, 3e5])
    scene.add(mesh, rj.transforms.translate(away))
    scene.lights = [rj.PointLight(away + (0.3, 1.2, -0.4), intensity=1.5)]
    for distance in (3.0, 1e3):
        camera = rj.PerspectiveCamera(
            away + distance * np.array([0.2, 0.6, 0.8]), away, fov_y=150.0 / (distance + 1.0)
        )
        one, other = pair(scene, camera)
        assert moved(one, other) <= SIXTEENTH


@pytest.mark.parametrize("bent", [2.0, 1e3])
def test_normals_that_cancel_are_found_in_float64(bent):
    scene = hills(9, bent=bent, shininess=300.0, lights=LAMPS["all"])
    one, other = pair(scene, EYES["above"])
    assert np.abs(codes(one.linear) - codes(other.linear)).max() <= SIXTEENTH


@pytest.mark.needs_jit
@pytest.mark.parametrize("squares", [2, 30, 120])
@pytest.mark.parametrize("lamps", ["range", "all", "near", "many", "narrow"])
@pytest.mark.parametrize("samples", [1, 4])
def test_parts_have_the_bits_of_the_whole(squares, lamps, samples):
    # In narrow parts less is seen, so that fewer lamps shine there.
    scene, camera = hills(squares, lights=LAMPS[lamps]), EYES["inside"]
    options = {"size": SIZE, "outputs": ("linear",), "quality": rj.Quality(samples=samples)}
    whole = rj.render(scene, camera, **options, threads=1).linear
    assert rj.render(scene, camera, **options, threads=2).linear.tobytes() == whole.tobytes()
    with RegionRenderer(scene, camera, **options) as renderer:
        for left, width in ((0, 128), (64, 5), (64, 1), (64, 17), (64, 96)):
            part = renderer.render_region(Region(left, 0, width, 90)).linear
            assert part.tobytes() == whole[:90, left : left + width].tobytes()


@pytest.mark.needs_jit
@pytest.mark.parametrize("lamps", ["all", "near", "many"])
@pytest.mark.parametrize("squares", [2, 90])
def test_batches_have_the_bits_of_single_pictures(lamps, squares):
    scene = hills(squares, lights=LAMPS[lamps])
    scene.add(hills(3, seed=2).nodes[0].mesh, rj.transforms.translate((9.0, 0.0, 0.0)))
    cameras = [
        rj.PerspectiveCamera((np.cos(t), 0.4 + t, 2.0 * np.sin(t)), (1.5 * t, 0.0, 0.0))
        for t in np.linspace(0.5, 3.0, 7)
    ]
    batch = rj.render_batch(scene, cameras, size=(64, 48), outputs=("linear",))
    for number, camera in enumerate(cameras):
        one = rj.render(scene, camera, size=(64, 48), outputs=("linear",))
        assert batch.linear[number].tobytes() == one.linear.tobytes()


@pytest.mark.needs_jit
def test_frames_of_a_renderer_have_the_bits_of_single_pictures():
    scene = hills(30, lights=LAMPS["all"])
    with rj.Renderer(SIZE) as renderer:
        for t in (0.4, 0.5, 0.7):
            camera = rj.PerspectiveCamera((t, 1.6, 2.2), (0.0, 0.0, 0.0))
            scene.lights[2] = rj.PointLight((t, 1.0, -0.4), intensity=1.5)
            kept = renderer.render(scene, camera, outputs=("linear",)).linear.copy()
            one = rj.render(scene, camera, size=SIZE, outputs=("linear",)).linear
            assert kept.tobytes() == one.tobytes()


@pytest.mark.needs_jit
@pytest.mark.parametrize("garbage", [0, -1, 0x7FF0_0000_7F80_0000, 0x7FFF_FFFF_7FFF_FFFF])
@pytest.mark.parametrize("squares", [2, 120])
def test_what_a_block_held_before_changes_no_bit(garbage, squares):
    scene, camera = hills(squares, lights=LAMPS["near"]), EYES["inside"]
    first = rj.render(scene, camera, size=SIZE, outputs=("linear",), threads=1).linear
    BLOCKS.block[COUNTS:] = garbage
    again = rj.render(scene, camera, size=SIZE, outputs=("linear",), threads=1).linear
    assert again.tobytes() == first.tobytes()


@pytest.mark.needs_jit
@pytest.mark.parametrize("samples", [1, 4])
def test_what_shadows_read_is_as_it_was(samples):
    lamps = [dataclasses.replace(SPOT, shadow=rj.Shadow(256)), POINT, LAMPS["near"][0]]
    one, other = pair(hills(12, lights=lamps), EYES["above"], samples=samples)
    assert moved(one, other) <= SIXTEENTH
    assert (one.linear != other.linear).any()


@pytest.mark.parametrize("lights", [(SUN,), (SUN, POINT)])
def test_textures_take_float64(lights):
    image = np.random.default_rng(3).integers(0, 256, (32, 32, 3), np.uint8)
    mesh = hills(12, colored=False).nodes[0].mesh
    material = rj.Material("phong", base_color_texture=rj.Texture(image))
    shown = rj.Scene()
    shown.add(
        rj.Mesh(
            mesh.vertices, mesh.faces, normals=mesh.normals, uv=mesh.vertices[:, [0, 2]],
            material=material,
        )
    )  # fmt: skip
    shown.lights = list(lights)
    facts = rj.explain(shown, EYES["above"], size=SIZE).facts
    assert (facts.limits, float64_reason(facts)) == (None, "an object has a texture")


def test_the_bound_holds_at_every_point_of_a_face():
    random = np.random.default_rng(7)
    gloss = gloss_of(hills().nodes[0].mesh.material)
    limits = limits_of(gloss, Brightness(0.0), True)
    sure, f = 0, np.float32
    eye = rj.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    for number in range(3000):
        size = 10.0 ** random.uniform(-3.0, 1.0)
        first = random.normal(size=3) * 3.0
        u, v = random.normal(size=(2, 3)) * size
        if number % 3 == 0:
            # Thin faces do not tell where they face.
            v = u * random.uniform(0.3, 1.0) + random.normal(size=3) * size * 1e-5
        place = first + random.normal(size=3) * 10.0 ** random.uniform(-1.0, 1.0)
        lamp = random.choice([
            rj.PointLight(place, intensity=2.0),
            rj.PointLight(place, intensity=2.0, range=3.0),
            rj.SpotLight(place, random.normal(size=3), intensity=2.0, outer_angle=40.0),
        ])  # fmt: skip
        rows = lighting_of([lamp], eye, 0).lights
        row = rows_of_lamps(rows, pyramids_of([lamp]), 1.0)[0]
        assert row[LIGHT] == 2.0
        ways = tuple(map(f, u)), tuple(map(f, v))
        away = f(np.linalg.norm(first))
        way = f(max(np.linalg.norm(u), np.linalg.norm(v)))
        with np.errstate(all="ignore"):
            light, off = lamp_on_face(
                row, tuple(map(f, first)), ways, facing_of(*ways), away, way, limits
            )  # fmt: skip
        if not float(off) <= float(MOST):
            continue
        sure += 1
        # Move points as far as float32 may, and look at the light that falls there.
        w = random.dirichlet((0.5, 0.5, 0.5), 40)
        points = first + w[:, 1:2] * u + w[:, 2:] * v
        errors = 3.0 * np.linalg.norm(points, axis=1) + 20.0 * way
        ways = random.normal(size=points.shape)
        ways *= (2.0**-24 * errors / np.linalg.norm(ways, axis=1))[:, None]
        facing = random.normal(size=points.shape)
        facing /= np.linalg.norm(facing, axis=1)[:, None]
        here, there = (light_on(lamp, at, facing) for at in (points, points + ways))
        assert (
            np.linalg.norm(points - place, axis=1).min() ** -2 * 2.0 <= float(light) or light == 0.0
        )
        assert np.abs(codes(here[:, None]) - codes(there[:, None])).max() * 2.0**24 <= float(off)
    assert sure > 500


def light_on(lamp, points, facing):
    """Return what a white surface makes of a lamp's light at points, given its normals."""
    to = np.asarray(lamp.position) - points
    squared = (to**2).sum(axis=1)
    to /= np.sqrt(squared)[:, None]
    light = lamp.intensity / squared * np.maximum((to * facing).sum(axis=1), 0.0)
    if lamp.range is not None:
        light *= np.clip(1.0 - (squared / lamp.range**2) ** 2, 0.0, 1.0)
    if isinstance(lamp, rj.SpotLight):
        inner, outer = (np.cos(np.radians(a)) for a in (lamp.inner_angle, lamp.outer_angle))
        cosine = -(to @ np.asarray(lamp.direction))
        light *= np.clip((cosine - outer) / (inner - outer), 0.0, 1.0) ** 2
    return light


def test_explain_says_what_lamps_call_for():
    scene, camera = hills(lights=(SUN, POINT)), EYES["above"]
    facts = rj.explain(scene, camera, size=SIZE).facts
    assert facts.limits is not None
    assert (facts.lamps, float64_reason(facts)) == (lamps_among([POINT]), None)
    assert "normals and points in float32" in str(rj.explain(scene, camera, size=SIZE))
    scene.tone_map = rj.ToneMap(exposure=-2.0)
    assert "lamps in float64: the exposure is below 0" in str(rj.explain(scene, camera, size=SIZE))
    scene.lights = [SUN]
    assert "lamps in float64" not in str(rj.explain(scene, camera, size=SIZE))
