"""An object has the same bits whatever stands beside it, in float32 or in float64."""

from __future__ import annotations

import numpy as np
import pytest
from float32_faces import EYES, SIZE, SUN, hills

import rasterjit as rj
from rasterjit.rendering.sketch import list_stages
from rasterjit.rendering.tiles import Region, RegionRenderer
from rasterjit.survey.facts import float64_reason

POINT = rj.PointLight((0.3, 1.2, -0.4), intensity=1.5)
SPOT = rj.SpotLight((-0.8, 1.6, 0.5), (0.3, -1.0, -0.2), intensity=2.0)
NEAR = rj.PointLight((0.1, 0.2, -0.3), "orange", intensity=0.05)
SHADOWED = rj.DirectionalLight((-0.3, -1.0, -0.5), shadow=rj.Shadow(256))
LIGHTS = {
    "none": (), "sun": (SUN,), "lamps": (rj.AmbientLight(), SUN, POINT, SPOT), "near": (NEAR, SUN),
}  # fmt: skip
IMAGE = np.random.default_rng(3).integers(0, 256, (32, 32, 3), np.uint8)
PICTURE = rj.Texture(IMAGE, filter="trilinear")
EMPTY = 12
"""Columns at the left of a picture from above that show no strip."""
MATERIALS = {
    "textured": rj.Material("phong", specular=0.5, base_color_texture=PICTURE),
    "bent": rj.Material("pbr", roughness=0.5, normal_texture=rj.Texture(IMAGE / np.float32(255))),
    "gouraud": rj.Material("gouraud", specular=0.4),
    "flat": rj.Material("flat", specular=0.4),
    "unlit": rj.Material("unlit", "teal"),
    "coated": rj.Material("pbr", roughness=0.5, clearcoat=1.0),
    "fibres": rj.Material("pbr", roughness=0.5, sheen_color="white", sheen_roughness=0.5),
    "own mirror": rj.Material("pbr", roughness=0.5, ior=1.8),
    "glass": rj.Material("pbr", roughness=0.3, transmission=0.7),
    "glossy": rj.Material("pbr", roughness=0.01),
    "bright": rj.Material("phong", specular=40.0, shininess=4000.0),
    "colours": rj.Material("pbr", roughness=0.5),
    "blended": rj.Material("phong", (0.5, 0.5, 0.5, 0.5), alpha_mode="blend"),
}
"""What an object beside may be made of; the last two take float32."""


def lattice(material, colored=False):
    """Return slanted strips, so that rows of a picture show them and what lies behind in turns."""
    corners, faces, uv = [], [], []
    for x in np.linspace(-0.3, 1.3, 9):
        first = len(corners)
        corners += [(x, -0.1, 0.9), (x + 0.08, -0.1, 0.9), (x + 0.4, 0.9, 0.2), (x + 0.3, 0.9, 0.2)]
        uv += [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
        faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    random = np.random.default_rng(5)
    normals = random.normal(0.0, 0.3, (len(corners), 3)) + (0.0, 0.5, 1.0)
    colors = random.uniform(0.0, 1.0, (len(corners), 3)) if colored else None
    return rj.Mesh(corners, faces, normals=normals, uv=uv, colors=colors, material=material)


def beside(material, lights, squares=12, colored=False):
    """Return a bumpy ground with strips above it, near and far."""
    scene, strips = hills(squares, lights=lights), lattice(material, colored)
    scene.add(strips)
    scene.add(strips, rj.transforms.translate((-1.2, 0.0, -1.8)))
    return scene


def drawn(scene, camera, threads=1, **settings):
    """Return a picture, and which object its pixels show."""
    return rj.render(
        scene, camera, size=SIZE, outputs=("linear", "color", "object_id"), threads=threads,
        quality=rj.Quality(**settings),
    )  # fmt: skip


def exactly(frame, there):
    """Return the bits of some pixels of a picture."""
    return frame.linear[there].tobytes(), frame.color[there].tobytes()


@pytest.mark.needs_jit
@pytest.mark.parametrize("lights", LIGHTS)
@pytest.mark.parametrize("kind", MATERIALS)
def test_objects_keep_their_bits_beside_any_other(kind, lights):
    shone = LIGHTS[lights]
    for eye, squares, colored in (("above", 12, False), ("inside", 3, True), ("flat", 60, True)):
        camera = EYES[eye]
        alone, both = hills(squares, lights=shone), beside(MATERIALS[kind], shone, squares, colored)
        frame, exact = drawn(both, camera), drawn(both, camera, interpolation_precision="float64")
        ground = frame.object_id == 0
        if kind == "blended":
            # Nearest faces are not all that a pixel shows.
            ground &= (frame.linear == drawn(alone, camera).linear).all(axis=-1)
        assert ground.sum() > 1000
        assert exactly(frame, ground) == exactly(drawn(alone, camera), ground)
        if kind not in ("colours", "blended", "glass", "unlit"):
            strips = frame.object_id > 0
            assert strips.sum() > 50
            assert exactly(frame, strips) == exactly(exact, strips)


@pytest.mark.needs_jit
@pytest.mark.parametrize("lights", ["sun", "lamps"])
@pytest.mark.parametrize("kind", ["textured", "gouraud", "coated", "unlit"])
def test_threads_and_regions_change_nothing_of_that(kind, lights):
    camera, both = EYES["above"], beside(MATERIALS[kind], LIGHTS[lights])
    for samples in (1, 4, "area"):
        quality = rj.Quality(samples=samples)
        options = {"size": SIZE, "outputs": ("linear",), "quality": quality}
        whole = rj.render(both, camera, **options, threads=1).linear
        assert rj.render(both, camera, **options, threads=2).linear.tobytes() == whole.tobytes()
        with RegionRenderer(both, camera, **options) as renderer:
            for left, width in ((0, 128), (64, 5), (64, 40)):
                part = renderer.render_region(Region(left, 0, width, 90)).linear
                assert part.tobytes() == whole[:90, left : left + width].tobytes()


@pytest.mark.needs_jit
@pytest.mark.parametrize("lights", ["sun", "lamps"])
def test_what_shadows_read_is_found_of_all(lights):
    # All strips cast the same shadows, whatever they are of.
    camera, shone = EYES["above"], (*LIGHTS[lights], SHADOWED)
    plain = drawn(beside(MATERIALS["colours"], shone), camera)
    ground = plain.object_id == 0
    bright = drawn(beside(MATERIALS["colours"], LIGHTS[lights]), camera)
    assert (plain.linear != bright.linear)[ground].any()
    for kind in ("textured", "bent", "gouraud", "coated", "unlit"):
        assert exactly(drawn(beside(MATERIALS[kind], shone), camera), ground) == exactly(
            plain, ground
        )


@pytest.mark.needs_jit
@pytest.mark.parametrize("lights", ["sun", "lamps"])
@pytest.mark.parametrize("kind", ["textured", "flat", "unlit", "gouraud"])
def test_fog_over_others_is_no_other(kind, lights):
    camera, shone = EYES["above"], LIGHTS[lights]
    alone, both = hills(12, lights=shone), beside(MATERIALS[kind], shone)
    alone.fog = both.fog = rj.Fog("gray", density=0.4)
    frame, exact = drawn(both, camera), drawn(both, camera, interpolation_precision="float64")
    ground = frame.object_id == 0
    assert exactly(frame, ground) == exactly(drawn(alone, camera), ground)
    assert exactly(frame, ~ground) == exactly(exact, ~ground)


@pytest.mark.needs_jit
@pytest.mark.parametrize("samples", [4, "area", 64])
@pytest.mark.parametrize("lights", ["sun", "lamps"])
def test_pixels_of_several_samples_keep_their_bits(samples, lights):
    camera, shone = EYES["above"], LIGHTS[lights]
    alone = drawn(hills(12, lights=shone), camera, samples=samples)
    for kind in ("textured", "gouraud", "coated"):
        both = drawn(beside(MATERIALS[kind], shone), camera, samples=samples)
        # No strip comes near.
        assert both.linear[:, :EMPTY].tobytes() == alone.linear[:, :EMPTY].tobytes()
        assert both.linear.tobytes() != alone.linear.tobytes()


@pytest.mark.needs_jit
@pytest.mark.parametrize("lights", ["sun", "lamps"])
def test_batches_have_the_bits_of_pictures(lights):
    cameras = [
        rj.PerspectiveCamera((0.4, 1.6, 2.2), (x, 0.0, 0.0)) for x in (-3.0, -1.0, 0.0, 1.0, 4.0)
    ]
    for kind in ("textured", "unlit", "glossy"):
        scene = beside(MATERIALS[kind], LIGHTS[lights], 6)
        far = lattice(MATERIALS[kind])
        scene.add(far, rj.transforms.translate((4.0, 0.0, 0.0)))
        batch = rj.render_batch(scene, cameras, size=(80, 60), outputs=("linear",))
        for n, camera in enumerate(cameras):
            one = rj.render(scene, camera, size=(80, 60), outputs=("linear",))
            assert batch.linear[n].tobytes() == one.linear.tobytes()


def stages(scene, camera=EYES["above"]):
    """Return the stages of a frame."""
    return {told.name for told in list_stages(rj.explain(scene, camera, size=SIZE))}


def test_stages_of_float32_run_where_an_object_in_view_takes_it():
    both = beside(MATERIALS["textured"], (SUN,))
    quick = "float32_planes.find_float32_surface"
    assert {quick, "set_aside.set_aside_sure", "attributes.find_points"} <= stages(both)
    # The ground lies behind.
    up = rj.PerspectiveCamera((0.4, 0.5, 2.2), (0.4, 0.5, 0.0), fov_y=1.0)
    alone = rj.Scene()
    alone.add(lattice(MATERIALS["textured"]))
    alone.add(hills(3).nodes[0].mesh, rj.transforms.translate((0.0, -50.0, 0.0)))
    assert quick not in stages(alone, up)
    # The strips are out of view.
    apart = hills(12)
    apart.add(lattice(MATERIALS["textured"]), rj.transforms.translate((0.0, 50.0, 0.0)))
    assert quick in stages(apart)
    assert "set_aside.set_aside_sure" not in stages(apart)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("textured", "an object has a texture"),
        ("coated", "a material has a clearcoat, sheen, ior or specular_ field"),
        ("glass", "a material has a transmission"),
        ("unlit", "an object is not shaded 'phong' or 'pbr'"),
        ("glossy", "lights are too bright, or highlights too sharp"),
    ],
)
def test_explain_says_which_objects_take_float64(kind, words):
    plan = rj.explain(beside(MATERIALS[kind], (SUN,)), EYES["above"], size=SIZE)
    assert float64_reason(plan.facts) is None
    assert f"colours, normals and points in float32, others in float64: {words}" in str(plan)
