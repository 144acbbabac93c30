"""Lit samples in float32 stay within a sixteenth of a code, in whatever pieces they are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from float32_faces import EYES, SIXTEENTH, SIZE, codes, hills, pair

import rasterjit as rj
from rasterjit.pipeline.surface.samples import COUNTS
from rasterjit.rendering.sketch import list_stages
from rasterjit.rendering.stage_list import BLOCKS
from rasterjit.rendering.tiles import Region, RegionRenderer
from rasterjit.survey.facts import float64_reason

FLOAT64 = rj.Quality(interpolation_precision="float64")


@pytest.mark.needs_jit
@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("squares", [1, 9, 90])
@pytest.mark.parametrize(
    "material",
    [
        {}, {"specular": 0.0}, {"shininess": 1500.0}, {"shading": "pbr", "roughness": 0.4},
        {"shading": "pbr", "roughness": 0.25, "metallic": 1.0},
    ],
)  # fmt: skip
def test_codes_move_by_a_sixteenth_at_most(eye, squares, material):
    one, other = pair(hills(squares, **material), EYES[eye])
    assert (one.face_id == other.face_id).all()
    assert (one.face_id >= 0).mean() > 0.2
    assert np.abs(codes(one.linear) - codes(other.linear)).max() <= SIXTEENTH
    apart = np.abs(np.int32(one.color) - np.int32(other.color)).max(axis=-1)
    assert apart.max() <= 1
    assert (apart > 0).mean() < 1e-3
    assert (one.linear != other.linear).any()


@pytest.mark.needs_jit
@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("squares", [2, 90])
@pytest.mark.parametrize("samples", [4, 16, "area", 64])
def test_several_samples_move_as_little(eye, squares, samples):
    one, other = pair(hills(squares), EYES[eye], samples=samples)
    assert np.abs(codes(one.linear) - codes(other.linear)).max() <= SIXTEENTH
    assert (one.linear != other.linear).any()


@pytest.mark.parametrize("squares", [2, 90])
def test_pixels_of_one_face_have_the_bits_of_one_sample(squares):
    scene, camera = hills(squares), EYES["above"]
    shown = rj.render(scene, camera, size=(16 * 160, 16 * 120), outputs=("face_id",)).face_id
    blocks = shown.reshape(120, 16, 160, 16).transpose(0, 2, 1, 3).reshape(120, 160, -1)
    plain = (blocks == blocks[:, :, :1]).all(axis=2) & (blocks[:, :, 0] >= 0)
    assert plain.mean() > 0.05
    one = rj.render(scene, camera, size=SIZE, outputs=("linear",)).linear
    for samples in (2, 4, 8):
        many = rj.render(
            scene, camera, quality=rj.Quality(samples=samples), size=SIZE, outputs=("linear",)
        ).linear
        assert many[plain].tobytes() == one[plain].tobytes()


@pytest.mark.parametrize("bent", [2.0, 1e3])
def test_normals_that_cancel_are_found_in_float64(bent):
    # Those of vertices point anywhere: between them some are as short as can be.
    scene = hills(9, bent=bent, shininess=300.0)
    one, other = pair(scene, EYES["above"])
    assert np.abs(codes(one.linear) - codes(other.linear)).max() <= SIXTEENTH
    # Of samples that take float64 no bit differs but for their colour, of which there is one.
    white = hills(9, bent=bent, shininess=300.0, colored=False)
    one, other = pair(white, EYES["above"])
    alike = (one.linear == other.linear).all(axis=-1) & (one.face_id >= 0)
    assert alike.sum() > 0.05 * (one.face_id >= 0).sum()


@pytest.mark.parametrize("scale", [1e-6, 1e9])
def test_any_size_is_lit_alike(scale):
    scene, big = hills(), rj.Scene()
    mesh = scene.nodes[0].mesh
    big.add(mesh, rj.transforms.scale(scale))
    big.lights = scene.lights
    camera = rj.PerspectiveCamera((0.4 * scale, 1.6 * scale, 2.2 * scale), (0.0, 0.0, 0.0))
    one, other = pair(big, camera)
    assert np.abs(codes(one.linear) - codes(other.linear)).max() <= SIXTEENTH


@pytest.mark.needs_jit
@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("squares", [2, 30, 120])
@pytest.mark.parametrize("samples", [1, 4])
def test_parts_have_the_bits_of_the_whole(eye, squares, samples):
    # Narrow parts show runs of other lengths: these are worked on in other ways.
    scene, camera, quality = hills(squares), EYES[eye], rj.Quality(samples=samples)
    options = {"size": SIZE, "outputs": ("linear",), "quality": quality}
    whole = rj.render(scene, camera, **options).linear
    with RegionRenderer(scene, camera, **options) as renderer:
        for left, width in ((0, 128), (64, 5), (64, 1), (64, 17), (64, 96)):
            part = renderer.render_region(Region(left, 0, width, 90)).linear
            assert part.tobytes() == whole[:90, left : left + width].tobytes()


@pytest.mark.parametrize("threads", [1, 2])
def test_both_sides_and_turned_faces_are_alike(threads):
    scene, turned = hills(20), rj.Scene()
    mesh = scene.nodes[0].mesh
    turned.add(
        rj.Mesh(
            mesh.vertices, np.roll(mesh.faces, 1, axis=1), normals=mesh.normals,
            colors=mesh.vertex_colors[:, :3], material=mesh.material,
        )
    )  # fmt: skip
    turned.lights = scene.lights
    below = rj.PerspectiveCamera((0.4, -1.6, 2.2), (0.0, 0.0, 0.0))
    one, other = (
        rj.render(some, below, size=SIZE, outputs=("linear",), threads=threads).linear
        for some in (scene, turned)
    )
    assert one.tobytes() == other.tobytes()
    first, second = pair(scene, below)
    assert np.abs(codes(first.linear) - codes(second.linear)).max() <= SIXTEENTH


@pytest.mark.needs_jit
@pytest.mark.parametrize("garbage", [0, -1, 0x7FF0_0000_7F80_0000, 0x7FFF_FFFF_7FFF_FFFF])
@pytest.mark.parametrize("squares", [2, 120])
def test_what_a_block_held_before_changes_no_bit(garbage, squares):
    scene, camera = hills(squares), EYES["inside"]
    first = rj.render(scene, camera, size=SIZE, outputs=("linear",), threads=1).linear
    other = hills(squares, seed=5)
    rj.render(other, camera, size=SIZE, outputs=("linear",), threads=1)
    BLOCKS.block[COUNTS:] = garbage
    again = rj.render(scene, camera, size=SIZE, outputs=("linear",), threads=1).linear
    assert again.tobytes() == first.tobytes()


@pytest.mark.parametrize(
    ("scene", "quality", "words"),
    [
        (hills(), FLOAT64, "quality.interpolation_precision is 'float64'"),
        (hills(lights=(rj.DirectionalLight((0, -1, 0), intensity=50.0),)), None,
         "lights are too bright, or highlights too sharp"),
        (hills(shading="pbr", roughness=0.01), None,
         "lights are too bright, or highlights too sharp"),
        (hills(shading="gouraud"), None, "an object is lit"),
    ],
)  # fmt: skip
def test_explain_says_why_lit_samples_take_float64(scene, quality, words):
    plan = rj.explain(scene, EYES["above"], quality, size=SIZE)
    assert plan.facts.limits is None
    assert float64_reason(plan.facts) == words


def test_exposure_and_environments_call_for_float64():
    scene = hills()
    scene.tone_map = rj.ToneMap(exposure=1.0)
    assert rj.explain(scene, EYES["above"], size=SIZE).facts.limits is not None
    scene.tone_map = rj.ToneMap(exposure=1.5)
    facts = rj.explain(scene, EYES["above"], size=SIZE).facts
    assert (facts.limits, float64_reason(facts)) == (
        None, "the exposure is above 1, or the tone curve too steep",
    )  # fmt: skip
    scene = hills()
    scene.environment = rj.Environment(np.ones((4, 8, 3), np.float32))
    facts = rj.explain(scene, EYES["above"], size=SIZE).facts
    assert (facts.limits, float64_reason(facts)) == (None, "the scene has an environment")


def test_weights_in_float64_are_found_where_something_reads_them():
    def names(scene):
        plan = rj.explain(scene, EYES["above"], size=SIZE)
        return [told.name for told in list_stages(plan)]

    shown = names(hills())
    assert "float32_planes.find_float32_surface" in shown
    assert not {"weights.find_weights", "attributes.find_points"} & {*shown}
    shadowed = names(hills(lights=(rj.DirectionalLight((-0.3, -1.0, -0.5), shadow=rj.Shadow()),)))
    assert "weights.find_weights" in shadowed
