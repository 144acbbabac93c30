"""A picture has the same bits in every way to draw it, whatever is in it."""

from __future__ import annotations

from dataclasses import replace

import combined
import numpy as np
import pytest
import random_scenes
import ways
from ways import ALL, MODELS, around, mixed_scene

import rasterjit as rj
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.rendering import batch, batch_scheduler
from rasterjit.runtime import jit
from rasterjit.runtime import threads as sharing

pytestmark = pytest.mark.needs_jit

SIZE = (72, 44)
RANDOM = 6
"""Random scenes of a run."""

SKY = rj.Environment(np.random.default_rng(7).random((8, 16, 3), np.float32), rotation=30.0)
HIGH = rj.Fog("gray", density=0.3, mode="exp", height=0.2, falloff=0.5)
NEAR_BY = [replace(camera, near=0.01) for camera in around(2, 1.3)]
"""Cameras before which faces are cut."""

BESIDE = rj.PerspectiveCamera((1.4, 0.2, 4.0), (1.4, 0.2, 0.0), fov_y=3.0)
"""It sees one object alone."""

AROUND = [*around(2), BESIDE]
PLACE, QUALITY = rj.transforms.translate, rj.Quality


# --- scenes ---------------------------------------------------------------------------------------


def plain():
    """Return three objects, one of them single-sided."""
    scene = mixed_scene()
    mesh = scene.nodes[1].mesh
    mesh.material = replace(mesh.material, double_sided=False)
    return scene


def glassy():
    """Return objects that are seen through before one with holes."""
    scene = mixed_scene()
    knot, cube, quad = (node.mesh for node in scene.nodes)
    clear = {"base_color": (0.4, 0.6, 0.9, 0.4), "alpha_mode": "blend"}
    knot.material, quad.material = (replace(one.material, **clear) for one in (knot, quad))
    colors = np.random.default_rng(8).random((len(cube.vertices), 4))
    holed = rj.Material("flat", alpha_mode="mask", alpha_cutoff=0.4)
    scene.nodes[1].mesh = rj.Mesh(cube.vertices, cube.faces, colors=colors, material=holed)
    return scene


def panes():
    """Return the plain scene with one object that is seen through."""
    scene = plain()
    quad = scene.nodes[2].mesh
    quad.material = replace(quad.material, base_color=(0.5, 0.2, 0.1, 0.5), alpha_mode="blend")
    return scene


def holes():
    """Return holes by colours of vertices, of faces, by a texture, and all of an object."""
    scene, rng = mixed_scene(), np.random.default_rng(8)
    mask = {"alpha_mode": "mask", "alpha_cutoff": 0.6}
    cube, quad = scene.nodes[1].mesh, scene.nodes[2].mesh
    texture = rj.Texture(rng.integers(0, 255, (8, 8, 4), np.uint8))
    crop_frame = rj.Material("flat", base_color_texture=texture, **mask)
    scene.nodes[2].mesh = rj.Mesh(quad.vertices, quad.faces, uv=quad.uv, material=crop_frame)
    for n, count in enumerate((len(cube.vertices), len(cube.faces))):
        holed = rj.Mesh(
            cube.vertices, cube.faces, colors=rng.random((count, 4)), material=rj.Material(**mask)
        )
        scene.add(holed, PLACE((0.2 + n, 0.9 * n, 0.4)))
    cube.material = replace(cube.material, base_color=(0.5, 0.2, 0.1, 0.5), **mask)
    return scene


def all_shadings(lights=()):
    """Return an object of each shading, side by side."""
    scene = rj.Scene()
    knot = rj.load(MODELS / "torus_knot.obj").nodes[0].mesh
    colors = np.random.default_rng(3).random((len(knot.faces), 3))
    for n, shading in enumerate(("unlit", "flat", "gouraud", "phong", "pbr")):
        own = {"metallic": 0.5, "roughness": 0.4} if shading == "pbr" else {"specular": 0.4}
        material = rj.Material(shading, "orange", **own)
        mesh = rj.Mesh(knot.vertices, knot.faces, colors=colors, material=material)
        scene.add(mesh, PLACE((1.2 * n - 2.4, 0, 0)) @ rj.transforms.scale((0.2, 0.2, 0.2)))
    scene.lights = list(lights)
    return scene


def row_of_cubes(lights, shadings=("phong", "gouraud", "pbr")):
    """Return cubes far apart, so that each camera of `ALONG` sees others, and other lights."""
    cube, scene = rj.load(MODELS / "cube.ply").nodes[0].mesh, rj.Scene()
    for n, shading in enumerate(shadings):
        made = rj.Mesh(cube.vertices, cube.faces, material=rj.Material(shading))
        scene.add(made, PLACE((5.0 * (n - 1), 0.0, 0.0)))
    scene.lights = lights
    return scene


ALONG = [
    rj.PerspectiveCamera((x, 1.0, 6.0), (x, 0.0, 0.0), fov_y=fov_y)
    for x in (-5.0, 5.0)
    for fov_y in (20.0, 70.0)
]


def on_a_floor():
    """Return objects on a textured floor of many faces that reaches behind every eye."""
    scene, side = mixed_scene(), 20
    x, z = np.meshgrid(*(np.linspace(-30.0, 30.0, side + 1),) * 2)
    corners = np.stack([x, np.full_like(x, -1.0), z], axis=-1).reshape(-1, 3)
    first = (np.arange(side)[:, np.newaxis] * (side + 1) + np.arange(side)).reshape(-1, 1)
    quads = first + (0, side + 1, side + 2, 1)
    texture = rj.Texture(np.random.default_rng(2).integers(0, 255, (16, 16, 3), np.uint8))
    scene.add(
        rj.Mesh(
            corners, np.concatenate((quads[:, :3], quads[:, (0, 2, 3)])), uv=corners[:, ::2],
            colors=np.random.default_rng(8).random((len(corners), 3)),
            material=rj.Material("phong", base_color_texture=texture),
        )
    )  # fmt: skip
    return scene


def in_shadow(make_scene=on_a_floor):
    """Return objects in the shadows of lights of each kind with each filter."""
    scene = make_scene()
    scene.lights = [rj.DirectionalLight((1, -1, 0), intensity=0.1)]
    for kind in ("hard", "pcf", "soft"):
        shadow = rj.Shadow(32, filter=kind, light_size=0.5 if kind == "soft" else None)
        scene.lights += [
            rj.DirectionalLight((-1, -2, -1), intensity=0.2, shadow=shadow),
            rj.PointLight((2, 3, 1), shadow=shadow),
            rj.SpotLight((-2, 4, 2), (1, -2, -1), shadow=shadow),
        ]
    return scene


def beyond_the_light():
    """Return a cube in the sun, of which a lamp lights one side alone, that some views show."""
    lamp = rj.SpotLight(
        (0, 0, 3), (0, 0, -1), outer_angle=60.0, range=2.5, intensity=9.0, shadow=rj.Shadow(32)
    )
    sun = rj.DirectionalLight((-1, -2, 1), shadow=rj.Shadow(32))
    scene = row_of_cubes([lamp, sun], ["flat"] * 3)
    scene.nodes = scene.nodes[1:2]
    return scene


def posters(count=4):
    """Return pictures on unlit objects, of which the first reaches behind the eyes, and others."""
    scene, rng = rj.Scene(), np.random.default_rng(5)
    corners = [(-30, -1, -30), (30, -1, -30), (30, -1, 30), (-30, -1, 30)]
    for n in range(count):
        picture = rj.Texture(
            rng.integers(0, 255, (9, 7, 3), np.uint8), filter=("nearest", "bilinear")[n % 2],
            wrap=("repeat", "mirror", "clamp")[n % 3],
        )  # fmt: skip
        shading = "phong" if n == 2 else "unlit"
        material = rj.Material(shading, (1.0, 1.0, 0.5 + n / 8), base_color_texture=picture)
        uv = np.array(corners)[:, ::2] * 0.3 + 0.4
        place = rj.transforms.scale(0.04 ** (n > 0)) @ rj.transforms.rotate_x(40.0 * n)
        scene.add(rj.Mesh(corners, [(0, 2, 1), (0, 3, 2)], uv=uv, material=material), place)
    return scene


def lines_and_points():
    """Return lines and points of all shapes, in pixels and in units of the scene."""
    scene, rng = mixed_scene(), np.random.default_rng(4)
    for shape in ("square", "disc", "sphere"):
        unit = "world" if shape == "sphere" else "pixel"
        size = 0.3 if unit == "world" else 4.0
        scene.add(rj.Points(rng.normal(size=(9, 3)), size=size, unit=unit, shape=shape))
    for unit, width in (("pixel", 3.0), ("world", 0.1)):
        scene.add(rj.Lines(rng.normal(size=(6, 3)), width=width, unit=unit))
    return scene


def bent():
    """Return a strip that the upper of two joints bends."""
    corners = [(x, y, 0) for y in (-1, 0, 1) for x in (-1, 1)]
    strip = rj.Mesh(
        corners, [(0, 1, 3), (0, 3, 2), (2, 3, 5), (2, 5, 4)],
        joints=[(0, 1)] * 6, weights=[(1, 0), (1, 0), (0.5, 0.5), (0.5, 0.5), (0, 1), (0, 1)],
    )  # fmt: skip
    scene = rj.Scene()
    lower, upper = (scene.add(rj.Node(None, name=name)) for name in ("lower", "upper"))
    scene.add(rj.Node(strip, skin=rj.Skin([lower, upper])))
    upper.transform = rj.transforms.rotate_x(70.0)
    return scene


# --- the table ------------------------------------------------------------------------------------


def case(scene=plain, change=None, cameras=AROUND, outputs=("color", "depth"), **asked):
    """Return a function that holds all ways to draw a scene, with a change, against each other."""

    def check():
        made = scene()
        for name, value in (change or {}).items():
            setattr(made, name, value)
        ways.check_every_way(made, cameras, outputs=outputs, **{"size": SIZE, **asked})

    return check


LIGHT = ("linear", "color")
SAMPLES = QUALITY(samples=4)
CODES = QUALITY(texture_mixing="srgb8")
EVERYTHING = tuple(batch_scheduler.BY_KERNEL)
CUT = [*NEAR_BY, *around(1)]
LAMPS = [
    rj.PointLight((2, 3, 1), "red"), rj.DirectionalLight(intensity=0.0),
    rj.PointLight((-1e30, 3, 1), intensity=0.4),
]  # fmt: skip
SUN = [rj.DirectionalLight((1, -2, -1)), rj.AmbientLight(intensity=0.2)]
TONES = {"tone_map": rj.ToneMap()}

BATCHED_EFFECTS = {
    "visible alpha": case(glassy, quality=QUALITY(visible_alpha=0.5), outputs=ALL[:6]),
    "all outputs": case(outputs=EVERYTHING),
    "float32": case(quality=QUALITY(precision="float32"), cameras=CUT),
    "affine": case(quality=QUALITY(interpolation="affine"), outputs=("color", "uv", "barycentric")),
    "whole pixels": case(quality=QUALITY(subpixel_bits=0)),
    "draft": case(quality=QUALITY.draft()),
    "texture codes": case(posters, quality=CODES, cameras=CUT),
    "texture codes alone": case(
        lambda: posters(1), quality=CODES, cameras=around(2), outputs=("color",)
    ),
    "back faces": case(cull="back", change={"vignette": rj.Vignette()}),
    "front faces": case(cull="front", background="transparent"),
    "background": case(
        background=(0.2, 0.4, 0.6), change={"tone_map": rj.ToneMap("neutral", 0.5)}
    ),
    "numbers": case(outputs=("object_id",)),
    "many tiles": case(outputs=("distance", "normal"), size=(131, 67)),
    "one pixel": case(size=(1, 1)),
    "gradient": case(outputs=LIGHT, change={"environment": rj.Environment.gradient()}),
    "sky": case(
        outputs=LIGHT, change={"environment": SKY, "fog": HIGH, "vignette": rj.Vignette(), **TONES}
    ),
    "unseen sky": case(change={"environment": rj.Environment(SKY.sky, background=False)}),
    "two samples": case(quality=QUALITY(samples=2)),
    "samples": case(quality=SAMPLES, outputs=(*LIGHT, "uv", "face_id"), change={"fog": HIGH}),
    "samples in the sky": case(
        quality=QUALITY(samples=8), outputs=LIGHT, change={"environment": SKY, **TONES},
        cull="back",
    ),
    "many samples": case(quality=QUALITY(samples=16), background="transparent"),
    "samples, rounded": case(
        quality=QUALITY(samples=4, precision="float32", interpolation="affine"),
        change={"vignette": rj.Vignette()},
    ),
    "fog": case(change={"fog": rj.Fog(density=0.2, mode="exp2")}),
    "fog behind some": case(
        change={"fog": rj.Fog("white", mode="linear", start=5.0, end=9.0)}, outputs=LIGHT,
        cameras=[*around(1, 2.0), *around(1, 6.0), rj.OrthographicCamera((0, 3, 3), (0, 0, 0))],
    ),
    "a floor": case(on_a_floor, outputs=EVERYTHING, cameras=[*CUT, *around(1, 3.0)]),
    "a floor, samples": case(on_a_floor, quality=SAMPLES, cameras=CUT),
    "given planes": case(
        cameras=[replace(camera, near=3.5, far=4.2) for camera in around(3)], outputs=ALL[:3]
    ),
    "in the dark": case(lambda: all_shadings([rj.AmbientLight(intensity=0.0)])),
    "headlight": case(all_shadings, outputs=LIGHT),
    "sun": case(lambda: all_shadings(SUN), outputs=LIGHT),
    "lamps": case(lambda: all_shadings(LAMPS), outputs=LIGHT),
    "a cone": case(
        lambda: row_of_cubes([rj.SpotLight((-5, 3, 0), (0, -1, 0), outer_angle=20.0), SUN[1]]),
        cameras=ALONG, outputs=LIGHT,
    ),
    "lamps that end": case(
        lambda: row_of_cubes([
            rj.PointLight((5, 2, 0), range=2.0), rj.SpotLight((-9, 1, 0), (1, 0, 0), range=5.0),
        ]),
        cameras=ALONG, outputs=LIGHT,
    ),
    "holes": case(holes, cameras=CUT, outputs=(*LIGHT, "depth", "face_id", "uv")),
    "holes, samples": case(holes, cameras=CUT, quality=SAMPLES),
    "holes, float32": case(holes, quality=QUALITY(precision="float32")),
    "glass": case(glassy, cameras=[*CUT, BESIDE], outputs=(*LIGHT, "depth", "face_id")),
    "glass in fog": case(
        glassy, outputs=LIGHT, change={"tone_map": rj.ToneMap("reinhard"), "fog": HIGH}
    ),
    "glass in the sky": case(
        glassy, outputs=LIGHT, change={"environment": SKY, "vignette": rj.Vignette(), **TONES}
    ),
    "glass in a cone": case(
        glassy, outputs=("linear",), change={"lights": [rj.SpotLight((0, 4, 0), (0, -1, 0))]},
        cull="back",
    ),
    "outline": case(change={"outline": rj.Outline(width=3)}, outputs=(*LIGHT, "face_id")),
    "smooth outline": case(
        cameras=CUT, change={"outline": rj.Outline(width=2.5)}, outputs=(*LIGHT, "face_id"),
        quality=QUALITY(lines="coverage"),
    ),
    "smooth outline, samples": case(
        change={"outline": rj.Outline()}, outputs=("color",),
        quality=QUALITY(lines="coverage", samples=4),
    ),
    "outline of glass": case(
        glassy, cameras=[*CUT, BESIDE], outputs=("color",),
        change={"outline": rj.Outline(), "ambient_occlusion": rj.AmbientOcclusion(strength=0.7)},
    ),
    "occlusion": case(
        lambda: all_shadings(SUN), cameras=[*CUT, rj.OrthographicCamera((0, 3, 3), (0, 0, 0))],
        change={"ambient_occlusion": rj.AmbientOcclusion()}, outputs=LIGHT,
    ),
    "occlusion, samples": case(
        on_a_floor, quality=SAMPLES, change={"ambient_occlusion": rj.AmbientOcclusion(0.5)},
    ),
    "shadows": case(in_shadow, outputs=LIGHT),
    "shadows of samples": case(in_shadow, quality=SAMPLES),
    "shadows at vertices": case(
        lambda: row_of_cubes(
            [rj.DirectionalLight((-1, -0.05, -0.1), shadow=rj.Shadow(32))], ["gouraud"] * 5
        ),
        cameras=[
            rj.PerspectiveCamera((x, 2.0, 7.0), (x, 0.0, 0.0), fov_y=fov_y)
            for x in (-3, 0, 3, 8, 13) for fov_y in (25, 60)
        ],
        outputs=LIGHT,
    ),
    "shadows under glass": case(lambda: in_shadow(glassy), outputs=LIGHT),
    "shadows of holes": case(lambda: in_shadow(holes), outputs=LIGHT),
    "nothing of glass": case(glassy, outputs=("depth", "object_id")),
}  # fmt: skip
"""What batches draw in groups, if they may."""

ONE_BY_ONE = {
    "areas": case(quality=QUALITY(samples="area"), outputs=(*LIGHT, "coverage")),
    "codes": case(panes, quality=QUALITY(samples=4, blending="srgb8")),
    "codes of layers": case(panes, quality=QUALITY(blending="srgb8")),
    "glass, samples": case(panes, quality=SAMPLES, change={"environment": SKY}),
    "two layers": case(glassy, quality=QUALITY(transparency_layers=2)),
    "64 samples": case(quality=QUALITY(samples=64), cameras=AROUND[:2], size=(24, 20)),
    "float64 depth": case(quality=QUALITY(depth_format="float64")),
    "fixed-point depth": case(quality=QUALITY(depth_format="unorm24")),
    "lengths": case(quality=QUALITY(renormalize=False)),
    "wireframe": case(change={"wireframe": rj.Wireframe()}),
    "eye dome": case(change={"eye_dome": rj.EyeDome()}, outputs=("color",)),
    "section": case(change={"section": rj.SectionPlane((0.1, 0, 0), (1, 0.2, 0.1), lines=True)}),
    "shadows of some": case(
        lambda: row_of_cubes([
            rj.PointLight((-4, 1, 2), range=6.0, shadow=rj.Shadow(32)),
            rj.DirectionalLight((-1, -2, -1), shadow=rj.Shadow(32)),
        ]),
        cameras=ALONG, outputs=LIGHT,
    ),
    "shadows on one side": case(
        beyond_the_light, outputs=LIGHT,
        cameras=[rj.PerspectiveCamera((0.1, 0, z), (0, 0, 0)) for z in (2.2, 2.3, -4, 2.1)],
    ),
    "picture behind": case(background=np.full((44, 72, 3), 99, np.uint8)),
    "lines and points": case(lines_and_points, outputs=("color", "depth", "face_id")),
    "lines and points, areas": case(lines_and_points, quality=QUALITY(samples="area")),
    "joints": case(bent),
}  # fmt: skip
"""What batches draw view by view."""


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    """Share small frames among threads, and return the views of batches drawn one by one."""
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", 256)
    monkeypatch.setattr(visibility_pass, "TILES_PER_TASK", 1)
    numbers, draw_alone = [], batch.SingleViewDrawer.__call__

    def noted(self, group):
        numbers.extend(group)
        return draw_alone(self, group)

    monkeypatch.setattr(batch.SingleViewDrawer, "__call__", noted)
    return numbers


@pytest.mark.parametrize("name", BATCHED_EFFECTS)
def test_what_is_drawn_in_groups_has_the_same_bits_in_every_way(name, alone):
    BATCHED_EFFECTS[name]()
    assert alone == [] or jit.CHECKED


@pytest.mark.parametrize("name", ONE_BY_ONE)
def test_what_is_drawn_view_by_view_has_the_same_bits_in_every_way(name, alone):
    ONE_BY_ONE[name]()
    assert alone


@pytest.mark.filterwarnings("ignore::rasterjit.ViewWarning")
@pytest.mark.parametrize("kind", ["plain", "samples", "moved", "glass"])
def test_any_camera_sees_in_a_batch_what_it_sees_alone(kind, alone):
    cameras, places = ways.random_cameras(40, 3), None
    if kind == "moved":
        places = np.tile(np.eye(4), (40, 3, 1, 1))
        places[..., :3, :] += np.random.default_rng(0).normal(0.0, 0.4, (40, 3, 3, 4))
        places[::7, 1, :3, :3] = 0.0
    quality = SAMPLES if kind == "samples" else None
    scene = glassy() if kind == "glass" else mixed_scene()
    outputs = ("color", "depth", "normal", "face_id")
    ways.check(scene, cameras, places, outputs=outputs, quality=quality)
    assert len(alone) < 35 or jit.CHECKED


@pytest.mark.parametrize(
    "row", [combined.settings_of(*row) for row in combined.ROWS], ids=combined.named
)
def test_every_two_effects_have_the_same_bits_in_every_way(row):
    scene, camera, quality = combined.scene_of(row)
    cameras = [replace(camera, eye=(1.6, 0.4, 5.0)), camera]
    frames = ways.check_every_way(
        scene, cameras, quality=quality, size=combined.SIZE, outputs=(*LIGHT, *ALL[1:8])
    )
    assert all((frame.face_id >= 0).any() for frame in frames)


@pytest.mark.parametrize("number", range(RANDOM))
def test_random_scenes_have_the_same_bits_in_every_way(number):
    random = np.random.default_rng([random_scenes.seed_of_run(), number])
    quality = random_scenes.perhaps_codes(random, random_scenes.random_quality(random))
    scene = random_scenes.random_scene(random, True, sees_through=quality.samples != "area")
    cameras = [random_scenes.random_camera(random) for _ in range(2)]
    ways.check_every_way(
        scene, cameras, quality=quality, size=random_scenes.SIZE,
        outputs=random_scenes.random_outputs(random),
    )  # fmt: skip
