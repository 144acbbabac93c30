"""Views drawn in groups: the bits of `rj.render`, whatever is seen, from wherever it is."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from batches import MODELS, around, check, in_groups, mixed_scene

import rasterjit as rj
from rasterjit.outputs.table import MOTION_OUTPUTS, OUTPUTS
from rasterjit.rendering import batch, desk, together
from rasterjit.runtime import jit
from rasterjit.scene import transforms
from rasterjit.survey import placement
from rasterjit.survey.many_views import place_many, view_many


@pytest.fixture
def scene():
    """Return three objects: smooth, with colours of vertices, and with a texture."""
    return mixed_scene()


HIGH = rj.Fog("gray", density=0.3, mode="exp", height=0.2, falloff=0.5)
SKY = rj.Environment(np.random.default_rng(7).random((8, 16, 3), np.float32), rotation=30.0)
ALL = tuple(name for name in OUTPUTS if name not in MOTION_OUTPUTS)
SHADINGS = "unlit", "flat", "gouraud", "phong", "pbr"


@pytest.fixture
def alone(monkeypatch):
    """Return the numbers of the views that are drawn one by one."""
    numbers, draw = [], batch.OneByOne.__call__

    def noted(self, group):
        numbers.extend(group)
        return draw(self, group)

    monkeypatch.setattr(batch.OneByOne, "__call__", noted)
    return numbers


def random_cameras(count, seed):
    """Return cameras of all kinds: near and far, inside of things, looking anywhere."""
    rng, made = np.random.default_rng(seed), []
    for n in range(count):
        eye = rng.normal(0.0, (0.5, 2.0, 4.0)[n % 3], 3)
        target = rng.normal(0.0, 0.7, 3)
        up = rng.normal(0.0, 1.0, 3)
        near = (None, 0.3, 1e-3)[rng.integers(3)]
        far = (math.inf, 50.0, 5.0)[rng.integers(3)]
        kind = n % 5
        if kind in (0, 1):
            made.append(
                rj.PerspectiveCamera(eye, target, up, float(rng.uniform(20, 110)), near, far)
            )
        elif kind == 2:
            far = (None, 50.0)[rng.integers(2)]
            made.append(rj.OrthographicCamera(eye, target, up, float(rng.uniform(1, 5)), far=far))
        else:
            view = transforms.look_at(eye, target, up)
            own = rj.PerspectiveCamera(eye, target, up, near=near or 0.1, far=far)
            clip = own.projection_matrix((40, 28))
            if kind == 3:
                clip = rj.OrthographicCamera(eye, target, up).projection_matrix((40, 28))
            # Sheared, mirrored, off the middle.
            clip[0, 1], clip[0, 2] = rng.normal(0.0, 0.1, 2)
            clip[0] *= rng.choice((-1.0, 1.0))
            is_open = bool(kind == 4 and rng.integers(2) and near is None)
            made.append(rj.MatrixCamera(view, clip, (40, 28), is_open))
    return made


def check_quietly(*arguments, **options):
    """Hold a batch against renders of each view; given planes may cut."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rj.ViewWarning)
        return check(*arguments, **options)


@pytest.mark.parametrize(("seed", "samples"), [(0, 1), (1, 1), (2, 1), (3, 4)])
def test_any_camera_shows_the_same(scene, seed, samples, alone):
    cameras, outputs = random_cameras(90, seed), ("color", "depth", "distance", "face_id")
    quality = rj.Quality(samples=samples)
    check_quietly(scene, cameras, outputs=outputs, quality=quality, threads=2)
    if not (jit.DISABLED or jit.CHECKED):
        assert 0 < len(alone) < 80


@pytest.mark.parametrize("seed", range(2))
def test_any_camera_shows_moved_objects_the_same(scene, seed):
    rng = np.random.default_rng(seed)
    places = np.tile(np.eye(4), (60, 3, 1, 1))
    places[..., :3, :] += rng.normal(0.0, 0.4, (60, 3, 3, 4))
    places[::7, 1, :3, :3] = 0.0
    cameras = random_cameras(60, seed + 10)
    check_quietly(scene, cameras, places, outputs=("color", "depth", "normal", "position"))


@in_groups
def test_cameras_outside_are_all_drawn_in_groups(scene, alone):
    outputs = tuple(together.BY_KERNEL)
    check(scene, around(40), outputs=outputs, threads=2)
    assert alone == []


@in_groups
def test_cameras_that_look_away_from_some_objects_are(scene, alone):
    # Objects behind the eye have vertices that would have to be cut, if they were in view.
    for n in range(12):
        turn = transforms.rotate_y(30.0 * n)
        scene.add(
            scene.nodes[0].mesh,
            transforms.compose(turn, transforms.translate((9, 0, 0)), transforms.scale((0.3,) * 3)),
        )
    cameras = [
        rj.PerspectiveCamera((0.0, 4.0, 0.0), (9 * math.cos(a), 3.0, 9 * math.sin(a)), fov_y=30.0)
        for a in np.linspace(0.0, 6.0, 20).tolist()
    ]
    check(scene, cameras, outputs=("color", "depth"))
    assert len(alone) < 4


def robots(floor_faces=2):
    """Return objects on a floor that reaches behind every eye, of so many faces."""
    scene = mixed_scene()
    side = math.isqrt(floor_faces // 2)
    x, z = np.meshgrid(*(np.linspace(-30.0, 30.0, side + 1),) * 2)
    corners = np.stack([x, np.full_like(x, -1.0), z], axis=-1).reshape(-1, 3)
    first = (np.arange(side)[:, np.newaxis] * (side + 1) + np.arange(side)).reshape(-1, 1)
    quads = first + (0, side + 1, side + 2, 1)
    colors = np.random.default_rng(8).random((len(corners), 3))
    texture = rj.Texture(np.random.default_rng(2).integers(0, 255, (16, 16, 3), np.uint8))
    scene.add(
        rj.Mesh(
            corners, np.concatenate((quads[:, :3], quads[:, (0, 2, 3)])), colors=colors,
            uv=corners[:, ::2], material=rj.Material("phong", base_color_texture=texture),
        )
    )  # fmt: skip
    return scene


@in_groups
@pytest.mark.parametrize(("faces", "near"), [(2, None), (2, 0.5), (800, 0.5), (60_000, 0.5)])
def test_faces_are_cut_in_groups(faces, near, alone):
    scene = robots(faces)
    cameras = [replace(camera, near=near) for camera in around(9, 3.0)]
    outputs = tuple(together.BY_KERNEL)
    batch = check_quietly(scene, cameras, outputs=outputs, size=(64, 48), threads=2)
    assert batch.stats.clipped >= 5
    assert alone == []


@in_groups
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_faces_before_given_planes_are_cut_in_groups(scene, precision, alone):
    cameras = [replace(camera, near=3.5, far=4.2) for camera in around(8)]
    quality = rj.Quality(precision=precision)
    batch = check_quietly(scene, cameras, outputs=ALL[:3], quality=quality)
    assert batch.stats.clipped > 100
    assert alone == []


@in_groups
@pytest.mark.parametrize("samples", [1, 4])
def test_views_without_and_with_cuts_follow_each_other(samples, alone):
    scene, quality = robots(800), rj.Quality(samples=samples)
    away = [replace(camera, target=(20.0, 40.0, 0.0)) for camera in around(4, 3.0)]
    cameras = [
        one for pair in zip(around(4, 3.0), around(4, 100.0), away, strict=True) for one in pair
    ]
    check_quietly(scene, cameras, outputs=("color", "uv", "depth"), quality=quality, threads=1)
    rng = np.random.default_rng(4)
    places = np.tile(np.eye(4), (12, 4, 1, 1))
    places[..., :3, :] += rng.normal(0.0, 0.1, (12, 4, 3, 4))
    check_quietly(
        scene, cameras, places, outputs=("color", "uv", "depth"), quality=quality, threads=1
    )
    assert alone == []


@in_groups
def test_more_faces_to_cut_than_there_is_room_for_are_drawn_one_by_one(alone, monkeypatch):
    monkeypatch.setattr(desk, "room_to_cut", lambda faces: (1, 28))
    cameras = [
        replace(camera, near=near) for camera, near in zip(around(4), (0.1, 3.9) * 2, strict=True)
    ]
    check_quietly(mixed_scene(), cameras, outputs=("color",))
    assert sorted(alone) == [1, 3]


def test_planes_that_cut_name_the_first_view(scene):
    cameras = [
        replace(camera, near=near)
        for camera, near in zip(around(4), (0.1, 0.1, 3.5, 3.6), strict=True)
    ]
    with pytest.warns(rj.ViewWarning, match=r"camera\.near = 3\.5 cuts .* \(cameras\[2\]\)"):
        rj.render_batch(scene, cameras, size=(40, 28), threads=2)


@in_groups
@pytest.mark.parametrize("shading", SHADINGS)
@pytest.mark.parametrize("lights", ["none", "sun", "lamps", "dark"])
def test_every_shading_and_light_is_drawn_in_groups(shading, lights, alone):
    scene = rj.Scene()
    knot = rj.load(MODELS / "torus_knot.obj").nodes[0].mesh
    colors = np.random.default_rng(3).random((len(knot.faces), 3))
    material = rj.Material(shading, "orange", specular=0.4) if shading != "pbr" else rj.Material(
        "pbr", "orange", metallic=0.5, roughness=0.4
    )  # fmt: skip
    scene.add(rj.Mesh(knot.vertices, knot.faces, colors=colors, material=material))
    scene.lights = {
        "none": [],
        "sun": [rj.DirectionalLight((1, -2, -1)), rj.AmbientLight(intensity=0.2)],
        "lamps": [
            rj.PointLight((2, 3, 1), "red"), rj.DirectionalLight(intensity=0.0),
            rj.PointLight((-1e30, 3, 1), intensity=0.4),
        ],
        "dark": [rj.AmbientLight(intensity=0.0)],
    }[lights]  # fmt: skip
    cameras = [*around(7, 12.0), rj.OrthographicCamera((3, 9, 9), (0, 0, 0), height=9.0)]
    check(scene, cameras, outputs=("color", "linear"))
    assert alone == []


@in_groups
@pytest.mark.parametrize(
    "lights",
    [
        [rj.SpotLight((-5, 3, 0), (0, -1, 0), outer_angle=20.0), rj.AmbientLight(intensity=0.2)],
        [rj.PointLight((0, 2, 0), "blue", range=2.0), rj.DirectionalLight((1, -1, -1))],
        [rj.PointLight((5, 2, 0), range=2.0), rj.SpotLight((-9, 1, 0), (1, 0, 0), range=5.0)],
        [rj.DirectionalLight(intensity=0), rj.SpotLight((9, 0, 0), (-1, 0.3, 0), range=4.0)],
    ],
)
def test_lights_that_reach_some_views_are_drawn_in_groups(lights, alone):
    cube = rj.load(MODELS / "cube.ply").nodes[0].mesh
    scene = rj.Scene()
    scene.lights = lights
    for n, shading in enumerate(("phong", "gouraud", "pbr")):
        made = rj.Mesh(cube.vertices, cube.faces, material=rj.Material(shading))
        scene.add(made, rj.transforms.translate((5.0 * (n - 1), 0.0, 0.0)))
    # Each camera sees other cubes, which other lights reach.
    cameras = [
        rj.PerspectiveCamera((x, 1.0, 6.0), (x, 0.0, 0.0), fov_y=fov_y)
        for x in (-5.0, 0.0, 5.0)
        for fov_y in (20.0, 70.0)
    ]
    reaching = {rj.explain(scene, camera, size=(40, 28)).facts.lights.numbers for camera in cameras}
    assert len(reaching) > 1
    check(scene, cameras, outputs=("color", "linear"))
    places = np.array([[node.world_from_model for node in scene.nodes]] * len(cameras))
    places[:, :, :3, 3] += np.random.default_rng(1).normal(0.0, 0.6, (len(cameras), 3, 3))
    check(scene, cameras, places, outputs=("color",))
    assert alone == []


@in_groups
@pytest.mark.parametrize("mode", ["here", "moved"])
def test_fog_that_some_views_are_before_is_drawn_in_groups(scene, mode, alone):
    scene.fog = rj.Fog("white", mode="linear", start=5.0, end=9.0)
    cameras = [*around(3, 2.0), *around(3, 6.0), rj.OrthographicCamera((0, 3, 3), (0, 0, 0))]
    places = None
    if mode == "moved":
        places = np.array([[node.world_from_model for node in scene.nodes]] * len(cameras))
        places[:, :, :3, 3] += np.random.default_rng(1).normal(0.0, 0.3, (len(cameras), 3, 3))
    found = {rj.explain(scene, camera, size=(40, 28)).has("fog") for camera in cameras}
    assert found == {False, True}
    check(scene, cameras, places, outputs=("color", "linear"))
    assert alone == []


@in_groups
@pytest.mark.parametrize(
    ("quality", "options", "change"),
    [
        (rj.Quality(precision="float32"), {}, {}),
        (rj.Quality(interpolation="affine"), {"outputs": ("color", "uv", "barycentric")}, {}),
        (rj.Quality(subpixel_bits=0), {}, {}),
        (rj.Quality.draft(), {}, {}),
        (None, {"cull": "back"}, {}),
        (None, {"cull": "front", "background": "transparent"}, {}),
        (None, {"background": (0.2, 0.4, 0.6)}, {"tone_map": rj.ToneMap("neutral", 0.5)}),
        (None, {"outputs": ("object_id",)}, {}),
        (None, {"outputs": ("distance", "normal"), "size": (131, 67)}, {}),
        (None, {"outputs": ("depth", "color"), "size": (200, 150)}, {}),
        (None, {"size": (1, 1)}, {}),
        (None, {"size": (131, 67)}, {"vignette": rj.Vignette()}),
        (None, {"outputs": ("linear", "color")}, {"environment": rj.Environment.gradient()}),
        (None, {"outputs": ("linear",)}, {"environment": SKY, "tone_map": rj.ToneMap()}),
        (
            None,
            {"outputs": ("color", "linear"), "size": (64, 33)},
            {"environment": SKY, "tone_map": rj.ToneMap(), "fog": HIGH, "vignette": rj.Vignette()},
        ),
        (None, {"background": "red"}, {"environment": rj.Environment(SKY.sky, background=False)}),
        (rj.Quality(samples=2), {"size": (64, 64)}, {}),
        (rj.Quality(samples=4), {"outputs": ("color", "linear", "uv", "face_id")}, {"fog": HIGH}),
        (rj.Quality(samples=4), {"size": (131, 67)}, {"vignette": rj.Vignette()}),
        (rj.Quality(samples=4), {"background": "transparent"}, {"tone_map": rj.ToneMap()}),
        (
            rj.Quality(samples=4),
            {"outputs": ("linear", "color"), "size": (90, 100)},
            {"environment": SKY, "tone_map": rj.ToneMap()},
        ),
        (rj.Quality(samples=8), {"outputs": ("color",), "cull": "back"}, {"environment": SKY}),
        (rj.Quality(samples=16), {"size": (200, 150)}, {}),
        (rj.Quality(samples=16), {"outputs": ("linear",)}, {"tone_map": rj.ToneMap()}),
        (rj.Quality(samples=4), {"outputs": ("depth",)}, {}),
        (rj.Quality(samples=4, precision="float32", interpolation="affine"), {}, {}),
        (None, {}, {"fog": HIGH}),
        (None, {}, {"fog": rj.Fog(density=0.2, mode="exp2")}),
        (None, {"outputs": ("depth",)}, {"fog": HIGH}),
    ],
)
def test_settings_are_kept_in_groups(scene, quality, options, change, alone):
    for name, value in change.items():
        setattr(scene, name, value)
    scene.nodes[1].mesh.material = replace(scene.nodes[1].mesh.material, double_sided=False)
    check(scene, around(6), quality=quality, **{"outputs": ("color", "depth"), **options})
    assert alone == []


@pytest.mark.parametrize(
    ("quality", "change", "options"),
    [
        (rj.Quality(samples="area"), {}, {}),
        (rj.Quality(samples=4, blending="srgb8"), {}, {}),
        (rj.Quality(samples=4), {"glass": 0.5}, {}),
        (rj.Quality(samples=64), {}, {}),
        (rj.Quality(depth_format="float64"), {}, {}),
        (rj.Quality(depth_format="unorm24"), {}, {}),
        (rj.Quality(renormalize=False), {}, {}),
        (None, {"outline": rj.Outline()}, {}),
        (None, {"wireframe": rj.Wireframe()}, {}),
        (None, {"ambient_occlusion": rj.AmbientOcclusion()}, {}),
        (None, {"eye_dome": rj.EyeDome()}, {}),
        (None, {"lights": [rj.DirectionalLight((0, -1, -1), shadow=rj.Shadow(64))]}, {}),
        (rj.Quality(samples=2), {"glass": 0.5, "environment": SKY}, {}),
        (rj.Quality(transparency_layers=1), {"glass": 0.5}, {}),
        (rj.Quality(blending="srgb8"), {"glass": 0.5}, {}),
        (None, {}, {"background": np.full((28, 40, 3), 99, np.uint8)}),
    ],
)
def test_what_is_drawn_one_by_one_is_the_same(scene, quality, change, options):
    for name, value in change.items():
        if name in ("glass", "mask"):
            own = {"alpha_mode": "blend" if name == "glass" else "mask"}
            mesh = scene.nodes[2].mesh
            mesh.material = replace(mesh.material, base_color=(0.5, 0.2, 0.1, value), **own)
        else:
            setattr(scene, name, value)
    check(scene, around(3), quality=quality, outputs=("color", "depth"), **options)


@in_groups
@pytest.mark.parametrize("kind", ["colors", "texture", "faces", "all of it"])
@pytest.mark.parametrize("quality", [None, rj.Quality(samples=4), rj.Quality(precision="float32")])
def test_holes_are_drawn_in_groups(scene, kind, quality, alone):
    rng = np.random.default_rng(8)
    mask = {"alpha_mode": "mask", "alpha_cutoff": 0.6}
    cube, quad = scene.nodes[1].mesh, scene.nodes[2].mesh
    own = {"vertices": cube.vertices, "faces": cube.faces}
    if kind == "colors":
        scene.nodes[1].mesh = rj.Mesh(
            **own, colors=rng.random((len(cube.vertices), 4)), material=rj.Material(**mask)
        )
    if kind == "faces":
        scene.nodes[1].mesh = rj.Mesh(
            **own, colors=rng.random((len(cube.faces), 4)), material=rj.Material(**mask)
        )
    if kind == "texture":
        texture = rj.Texture(rng.integers(0, 255, (8, 8, 4), np.uint8))
        quad.material = rj.Material("flat", base_color_texture=texture, **mask)
        scene.nodes[2].mesh = rj.Mesh(quad.vertices, quad.faces, uv=quad.uv, material=quad.material)
    if kind == "all of it":
        cube.material = replace(cube.material, base_color=(0.5, 0.2, 0.1, 0.5), **mask)
    near = [replace(camera, near=0.01) for camera in around(4, 1.3)]
    away = rj.PerspectiveCamera((0.0, 0.5, 4.0), (-1.2, 0.0, -1.0), fov_y=8.0)
    outputs = "color", "linear", "depth", "face_id", "uv"
    check(scene, [*around(5), away, *near], outputs=outputs, quality=quality, size=(90, 70))
    assert alone == []


def make_glassy(scene, alpha=0.4):
    """Let the first object and the last be seen through, and the second have holes."""
    knot, cube, quad = (node.mesh for node in scene.nodes)
    clear = {"base_color": (0.4, 0.6, 0.9, alpha), "alpha_mode": "blend"}
    knot.material, quad.material = (replace(one.material, **clear) for one in (knot, quad))
    colors = np.random.default_rng(8).random((len(cube.vertices), 4))
    holed = rj.Material("flat", alpha_mode="mask", alpha_cutoff=0.4)
    scene.nodes[1].mesh = rj.Mesh(cube.vertices, cube.faces, colors=colors, material=holed)


@in_groups
@pytest.mark.parametrize(
    ("options", "change"),
    [
        ({"outputs": ("color", "linear", "depth", "face_id"), "size": (131, 90)}, {}),
        ({"outputs": ("color",), "background": "transparent"}, {"tone_map": rj.ToneMap()}),
        ({"outputs": ("linear", "color")}, {"tone_map": rj.ToneMap("reinhard"), "fog": HIGH}),
        ({"outputs": ("color",), "cull": "back"}, {"vignette": rj.Vignette()}),
        ({"outputs": ("linear",)}, {"lights": [rj.SpotLight((0, 4, 0), (0, -1, 0))]}),
        ({"outputs": ("color", "linear"), "size": (131, 90)}, {"environment": SKY}),
        ({"size": (131, 90)}, {"environment": SKY, "tone_map": rj.ToneMap()}),
        ({"outputs": ("depth", "object_id")}, {}),
    ],
)
def test_what_is_seen_through_is_laid_in_groups(scene, options, change, alone):
    make_glassy(scene)
    for name, value in change.items():
        setattr(scene, name, value)
    near = [replace(camera, near=0.01) for camera in around(4, 1.3)]
    # One of them sees nothing that is seen through.
    away = rj.PerspectiveCamera((1.4, 0.2, 4.0), (1.4, 0.2, 0.0), fov_y=3.0)
    check(scene, [*around(5), away, *near], **options)
    assert alone == []
    alpha_one = replace(scene.nodes[0].mesh.material, base_color=(0.4, 0.6, 0.9))
    scene.nodes[0].mesh.material = alpha_one
    check(scene, around(3), **options)
    assert alone == []


@in_groups
def test_any_camera_sees_through_the_same(scene):
    make_glassy(scene)
    check_quietly(scene, random_cameras(60, 7), outputs=("color", "depth"), threads=2)


@in_groups
def test_more_layers_than_there_is_room_for_are_drawn_one_by_one(alone):
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    glass = rj.Material("unlit", (0.9, 0.5, 0.2, 0.2), alpha_mode="blend")
    scene = rj.Scene()
    for n in range(desk.MOST_LAYERS):
        pane = rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=glass)
        scene.add(pane, rj.transforms.translate((0.1 * n, 0.0, -0.1 * n)))
    camera = rj.PerspectiveCamera((0.4, 0.1, 4.0), (0.4, 0.0, 0.0))
    check(scene, [camera], outputs=("color", "linear"), size=(80, 70))
    assert alone == []
    scene.add(rj.Mesh(corners - (0, 0, 3), [(0, 1, 2), (0, 2, 3)], material=glass))
    check(scene, [camera], outputs=("color", "linear"), size=(80, 70))
    assert alone == [0]


@in_groups
def test_longer_lists_than_there_is_room_for_are_drawn_one_by_one(alone):
    rng = np.random.default_rng(5)
    # Every face reaches all tiles of the picture, and there are more tiles than lists have room.
    corners = rng.uniform(-1.0, 1.0, (9000, 3, 3)) * (0.1, 0.1, 0.5)
    corners += [(-9, -6, 0), (9, -6, 0), (0, 12, 0)]
    scene = rj.Scene()
    scene.add(rj.Mesh(corners.reshape(-1, 3), np.arange(27000).reshape(-1, 3)))
    camera = rj.PerspectiveCamera((0, 0, 4), (0, 0, 0))
    check(scene, [camera], outputs=("face_id",), size=(64, 64))
    assert alone == []
    check(scene, [camera], outputs=("face_id",), size=(384, 384))
    assert alone == [0]


@in_groups
def test_longer_lists_of_samples_than_there_is_room_for_are_drawn_one_by_one(alone):
    # All end below the border of two rows of tiles, before the next centres of pixels.
    corners = np.tile([(-2000, -0.3, 0), (2000, -0.3, 0), (0, 4000, 0)], (9000, 1, 1)).astype(float)
    corners[..., 2] = np.linspace(-9.0, 0.0, 9000)[:, np.newaxis]
    scene, quality = rj.Scene(), rj.Quality(samples=4)
    scene.add(rj.Mesh(corners.reshape(-1, 3), np.arange(27000).reshape(-1, 3)))
    camera = rj.OrthographicCamera((0, 0, 100), (0, 0, 0), height=128.0)
    check(scene, [camera], outputs=("color",), size=(768, 128))
    check(scene, [camera], outputs=("color",), size=(192, 128), quality=quality)
    assert alone == []
    check(scene, [camera], outputs=("color",), size=(768, 128), quality=quality)
    assert alone == [0]


@in_groups
def test_kinds_of_views_beyond_those_kept_are_drawn_one_by_one(scene, alone, monkeypatch):
    monkeypatch.setattr(together, "MOST_KINDS", 1)
    cameras = [
        rj.PerspectiveCamera((1.4, 0.2, 4.0), (1.4, 0.2, 0.0), fov_y=3.0),
        rj.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0)),
    ]
    check(scene, cameras, outputs=("color",), threads=1)
    assert alone == [1]


def test_matrices_of_many_views_have_the_bits_of_each(scene):
    cameras = random_cameras(200, 4)
    rng = np.random.default_rng(6)
    moved = np.tile(np.eye(4), (200, 3, 1, 1))
    moved[..., :3, :] += rng.normal(0.0, 0.5, (200, 3, 3, 4))
    places = place_many(moved)
    views = view_many(
        moved, np.array([camera.eye_position() for camera in cameras]),
        np.array([camera.view_matrix() for camera in cameras]),
        np.array([camera.projection_matrix((40, 28)) for camera in cameras]),
    )  # fmt: skip
    bounds = placement.mesh_boxes([node.mesh for node in scene.nodes])
    extents = placement.Extents(bounds, moved)
    measures = placement.measure_boxes(extents, views.relative_from_model, views.clip_from_relative)
    largest = measures.largest_w()
    near, far = rng.normal(0.0, 2.0, (2, 200, 1))
    crosses = measures.may_cross(near, far)
    for n, camera in enumerate(cameras):
        own = placement.place_objects(list(moved[n]))
        wanted = placement.view_places(own, camera, (40, 28))
        for name in ("relative_from_model", "clip_from_relative", "toward_viewer"):
            assert getattr(views, name)[n].tobytes() == getattr(wanted, name).tobytes(), name
        assert views.screen_turn[n] == wanted.screen_turn
        assert places.normal_matrices[n].tobytes() == wanted.normal_matrices.tobytes()
        assert places.mirrored[n].tobytes() == wanted.mirrored.tobytes()
        extents = placement.Extents(bounds, moved[n])
        boxes = placement.Boxes(extents, camera.eye_position(), *wanted[:2])
        assert measures.in_view[n].tolist() == boxes.in_view.tolist()
        assert largest[n] == boxes.largest_w()
        assert crosses[n].tolist() == boxes.may_cross(near[n, 0], far[n, 0]).tolist()
        for cull in ("none", "back", "front"):
            single = np.array([False, True, False])
            turns = placement.culled_turns(
                cull, views.screen_turn[n : n + 1, np.newaxis], places.mirrored[n : n + 1], single
            )
            turned = wanted.screen_turn, wanted.mirrored
            one = placement.cull_objects(cull, *turned, np.arange(4), single)
            assert turns[0].tolist() == one.culled_turns.tolist()
    assert 0 < measures.in_view.sum() < measures.in_view.size
    assert 0 < crosses.sum() < crosses.size
