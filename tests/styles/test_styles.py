"""Styles change how a scene looks, and nothing else."""

import dataclasses
import math
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.cli import options as cli_options
from rasterjit.styles.shadow_catcher import MAP_SIDE, cast_shadow, find_ground

MODELS = Path(__file__).parents[2] / "models"
SIZE = (96, 72)
GROUND_TRUTH = (
    "depth", "distance", "face_id", "object_id", "instance_id", "material_id", "barycentric",
    "normal", "geometric_normal", "position",
)  # fmt: skip
GREYS = rj.styles.GREY_BACKGROUND.picture(SIZE).image


def box(low=(-1.0, 0.0, -1.0), high=(1.0, 1.0, 1.0), shading="flat", **material):
    """A closed box whose faces have vertices of their own."""
    corners = np.array([[(low, high)[n >> k & 1][k] for k in range(3)] for n in range(8)])
    sides = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    vertices = corners[np.array(sides).reshape(-1)]
    faces = [(4 * n, 4 * n + a, 4 * n + b) for n in range(6) for a, b in ((1, 2), (2, 3))]
    return rj.Mesh(vertices, faces, material=rj.Material(shading, **material))


def scene_of(*meshes):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    return scene


@pytest.fixture(scope="module")
def teapot():
    return rj.load(MODELS / "teapot.obj")


@pytest.mark.parametrize("name", rj.styles.STYLES)
def test_ground_truth_is_that_of_the_object_alone(teapot, name):
    plain = rj.render(teapot, size=SIZE, outputs=GROUND_TRUTH)
    styled = rj.styles.STYLES[name](teapot).render(size=SIZE, outputs=("color", *GROUND_TRUTH))
    for output in GROUND_TRUTH:
        same = getattr(styled, output) == getattr(plain, output)
        both = np.isnan(getattr(styled, output)) & np.isnan(getattr(plain, output))
        # Normals that are painted are no longer those of a smooth surface.
        assert (same | both).all() or (name, output) == ("normals", "normal"), output


def test_plain_is_what_render_draws(teapot):
    styled = rj.styles.plain(teapot).render(size=SIZE)
    assert np.array_equal(styled.color, rj.render(teapot, size=SIZE).color)
    assert str(rj.styles.plain(teapot).explain(size=SIZE)) == str(rj.explain(teapot, size=SIZE))


@pytest.mark.parametrize("name", rj.styles.STYLES)
def test_a_scene_stays_as_it_was(teapot, name):
    before = {**teapot.__dict__, "nodes": list(teapot.nodes), "lights": list(teapot.lights)}
    material = teapot.nodes[0].mesh.material
    rj.styles.STYLES[name](teapot).render(size=(16, 12))
    assert {**teapot.__dict__} == before
    assert teapot.nodes[0].mesh.material is material


def test_the_ground_is_the_background_but_for_a_shadow(teapot):
    camera = rj.fit_camera(teapot, zoom=0.3, aspect=SIZE[0] / SIZE[1])
    style = rj.styles.studio(teapot, camera)
    frame = style.render(size=SIZE, outputs=("color", "coverage"))
    bare = dataclasses.replace(style, ground=None).render(size=SIZE)
    open_pixels = frame.coverage == 0.0
    assert (bare.color == GREYS)[open_pixels].all()
    darker = bare.color[..., :3].astype(int) - frame.color[..., :3]
    assert darker[open_pixels].min() == 0
    assert darker[open_pixels].max() > 25
    border = np.ones(open_pixels.shape, bool)
    border[1:-1, 1:-1] = False
    assert np.array_equal(frame.color[border], GREYS[border])


@pytest.mark.parametrize("size", [(96, 72), (13, 1), (5, 300)])
def test_greys_are_dithered_evenly(size):
    width, height = size
    codes = rj.styles.Gradient(10, 23).picture((width, height)).image
    assert codes.shape == (height, width, 4)
    assert (codes[..., :3] == codes[..., :1]).all()
    exact = 10 + 13 * np.arange(height)[:, None] / max(height - 1, 1)
    assert np.abs(codes[..., 0] - exact).max() < 1.0
    if min(size) >= 8:
        blocks = (codes[..., 0] - exact)[: height // 8 * 8, : width // 8 * 8]
        means = blocks.reshape(height // 8, 8, width // 8, 8).mean(axis=(1, 3))
        assert np.abs(means).max() < 0.1
        assert len(np.unique(codes[height // 2, :, 0])) == 2
    even = rj.styles.Gradient(77, 77).picture(size).image[..., :3]
    assert (even == 77).all()


@pytest.mark.parametrize("background", ["white", "#204060", (0.1, 0.2, 0.3)])
def test_a_colour_behind_keeps_its_bits_beside_the_shadow(teapot, background):
    camera = rj.fit_camera(teapot, zoom=0.3, aspect=SIZE[0] / SIZE[1])
    frame = rj.styles.studio(teapot, camera).render(size=SIZE, background=background)
    plain = rj.render(teapot, camera, size=SIZE, background=background)
    assert (frame.color[0] == plain.color[0]).all()
    assert (frame.color[:, :, 0].astype(int) < plain.color[-1, 0, 0]).any()


@pytest.mark.parametrize(
    "camera",
    [
        rj.PerspectiveCamera((4.0, -2.0, 8.0), (0.0, 1.5, 0.0)),
        rj.OrthographicCamera((4.0, -2.0, 8.0), (0.0, 1.5, 0.0), height=9.0),
        rj.PerspectiveCamera((4.0, 9.0, 8.0), (40.0, 90.0, 80.0)),
    ],
    ids=["below", "parallel from below", "past it"],
)
def test_there_is_no_ground_where_none_is_seen(teapot, camera):
    style = rj.styles.studio(teapot, camera)
    bare = dataclasses.replace(style, ground=None)
    assert np.array_equal(style.render(size=SIZE).color, bare.render(size=SIZE).color)
    assert np.array_equal(style.options(SIZE)["background"].image, GREYS)


@pytest.mark.parametrize("option", [{"background": "transparent"}, {"background": GREYS}])
def test_what_is_seen_through_or_a_photograph_gets_no_ground(teapot, option):
    style = rj.styles.studio(teapot)
    bare = dataclasses.replace(style, ground=None)
    frames = [one.render(size=SIZE, **option).color for one in (style, bare)]
    assert np.array_equal(*frames)


def test_a_floor_is_ground_enough():
    floor = rj.Mesh([[-4, 0, -4], [-4, 0, 4], [4, 0, 4], [4, 0, -4]], [[0, 1, 2], [0, 2, 3]])
    assert find_ground(scene_of(box(), floor), None) is None
    upside_down = rj.Mesh(floor.vertices, floor.faces[:, ::-1])
    assert find_ground(scene_of(box(), upside_down), None) is not None
    assert find_ground(scene_of(box()), None) is not None
    assert find_ground(scene_of(floor), None) is None


def test_the_shadow_lies_where_the_light_is_kept_off():
    """A plate in the air, below a lamp straight overhead and below one from aside."""
    plate = box((-1.0, 4.0, -1.0), (1.0, 4.1, 1.0))
    foot = box((9.0, 0.0, 9.0), (9.1, 0.1, 9.1))
    scene = scene_of(plate, foot)
    for key in ((0.0, 1.0, 0.0), (0.6, 0.8, 0.0)):
        ground = find_ground(scene, key)
        shade = cast_shadow(ground, scene, (1.0, 0.0), 1).shade
        x, z = -4.0 * key[0] / key[1], 0.0
        place = np.array([[x, 0.0, z], [x + 2.5, 0.0, z], [x, 0.0, z - 2.5]])
        u, v = (
            (place @ axis - low) / ground.extent
            for axis, low in zip(ground.frame, ground.corner, strict=False)
        )
        found = shade[(v * MAP_SIDE).astype(int), (u * MAP_SIDE).astype(int)]
        assert found[0] > 0.95
        assert found[1:].max() < 0.05
        assert shade.min() >= 0.0
        assert shade.max() <= 1.0


def test_a_white_and_a_black_object_stand_out():
    shown = {}
    for color in ("white", "black", "#808080"):
        scene = scene_of(box(base_color=color, specular=0.0))
        frame = rj.styles.studio(scene).render(size=SIZE, outputs=("color", "face_id", "coverage"))
        shown[color] = np.where(frame.coverage == 1.0, frame.color[..., 0].astype(int), -1)
        assert shown[color].max() < 254
    assert shown["white"].max() < 245
    for color, sign in (("white", 1), ("black", -1)):
        inside = shown[color] >= 0
        # The lit sides of the box, and of the black one all.
        ahead = sign * (shown[color] - GREYS[..., 0].astype(int))[inside]
        assert np.median(ahead) > 25
    assert shown["black"].max() < GREYS[..., 0].min() - 60


def test_lights_of_a_file_are_kept(teapot):
    scene = rj.load(MODELS / "scene.glb")
    style = rj.styles.studio(scene)
    assert style.scene.lights == scene.lights
    assert style.scene.environment is scene.environment
    assert style.ground.key is None
    with_sky = rj.load(MODELS / "teapot.obj")
    with_sky.environment = rj.Environment.gradient()
    seen = rj.styles.studio(with_sky)
    assert seen.background is None
    assert seen.scene.lights == []


def textured(**settings):
    """A square with a texture that has stripes."""
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[::4] = 255
    return rj.Mesh(
        [[-1, 0, -9], [-1, 0, 9], [1, 0, 9], [1, 0, -9]], [[0, 1, 2], [0, 2, 3]],
        uv=[[0, 0], [0, 1], [1, 1], [1, 0]],
        material=rj.Material(base_color_texture=rj.Texture(stripes, **settings)),
    )  # fmt: skip


def test_textures_that_blur_aslant_are_sharpened():
    scene = scene_of(textured(), box())
    for style in (rj.styles.studio(scene), rj.styles.studio(scene, rj.fit_camera(scene))):
        assert style.scene.nodes[0].mesh.material.base_color_texture.anisotropy == 8
        assert style.scene.nodes[1] is scene.nodes[1]
    assert scene.nodes[0].mesh.material.base_color_texture.anisotropy == 1
    rows = str(rj.styles.studio(scene).explain(size=SIZE)).splitlines()
    assert any(row.startswith("textures ") and "style studio: sharp" in row for row in rows)
    blurred = rj.Quality(samples=4, texture_filter="bilinear")
    told = str(rj.styles.studio(scene).explain(size=SIZE, quality=blurred))
    assert "style studio: sharp" not in told
    assert "style studio: 4 samples" in told


@pytest.mark.parametrize(
    "settings", [{"filter": "nearest"}, {"filter": "bilinear"}, {"anisotropy": 2}]
)
def test_textures_keep_a_filter_of_their_own(settings):
    scene = scene_of(textured(**settings))
    style = rj.styles.studio(scene)
    assert style.scene.nodes == scene.nodes
    assert "textures" not in style.adds


def test_all_pictures_are_seen_from_one_place(teapot):
    camera = rj.fit_camera(teapot, aspect=SIZE[0] / SIZE[1])
    assert rj.render(teapot, size=SIZE).plan.camera == camera
    assert rj.styles.studio(teapot).explain(size=SIZE).camera == camera
    framing = rj.animation.turntable(teapot)(0.0)
    assert framing.fov_y == camera.fov_y == cli_options.DEFAULT_FOV
    turned = rj.orbit_direction(cli_options.DEFAULT_AZIMUTH, cli_options.DEFAULT_ELEVATION)
    for seen in (camera, framing):
        towards = seen.view_matrix()[2, :3]
        assert towards @ np.array(turned) > math.cos(math.radians(0.5))


def test_effects_of_a_scene_are_kept(teapot):
    scene = rj.load(MODELS / "teapot.obj")
    scene.tone_map, scene.ambient_occlusion = rj.ToneMap("aces"), rj.AmbientOcclusion(strength=0.1)
    made = rj.styles.studio(scene).scene
    assert made.tone_map is scene.tone_map
    assert made.ambient_occlusion is scene.ambient_occlusion


def cloud(**given):
    return rj.Points(np.random.default_rng(3).random((50, 3)), **given)


def test_studio_tells_points_of_a_bare_cloud_apart_by_their_depths():
    assert rj.styles.studio(cloud()).scene.eye_dome == rj.EyeDome()
    own = scene_of(cloud())
    own.eye_dome = rj.EyeDome(0.2)
    assert rj.styles.studio(own).scene.eye_dome == rj.EyeDome(0.2)
    said = str(rj.styles.studio(cloud()).explain(size=SIZE))
    assert "style studio: points have neither colours nor normals" in said


def test_studio_leaves_points_with_colours_and_meshes_as_they_are(teapot):
    directions = np.eye(3)[np.arange(50) % 3]
    for told in (
        cloud(colors=np.full((50, 3), 0.5)), cloud(scalars=np.arange(50.0)),
        cloud(normals=directions), scene_of(cloud(), teapot.nodes[0].mesh),
    ):  # fmt: skip
        assert rj.styles.studio(told).scene.eye_dome is None


def test_the_style_is_the_reason_of_what_it_adds(teapot):
    said = str(rj.styles.studio(teapot).explain(size=SIZE)).splitlines()
    rows = {line.split("  ")[0]: line for line in said if "style studio" in line}
    assert set(rows) == {
        "lights", "shadows", "environment light", "background image", "tone mapping",
        "ambient occlusion", "anti-aliasing",
    }  # fmt: skip
    assert "4 samples" in rows["anti-aliasing"]
    assert "shadow on the ground" in rows["background image"]
    below = rj.PerspectiveCamera((4.0, -2.0, 8.0), (0.0, 1.5, 0.0))
    told = str(rj.styles.studio(teapot, below).explain(size=SIZE))
    assert "shadow on the ground" not in told
    assert "in  (" in told


def reasons(plan):
    """Return the rows of a plan that say why an effect is in or out, by their names."""
    return {effect.name: line for effect in plan.effects for line in str(plan).splitlines()
            if line.startswith(f"{effect.name}  ")}  # fmt: skip


BELOW = rj.PerspectiveCamera((4.0, -2.0, 8.0), (0.0, 1.5, 0.0))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "style studio: greys, with the shadow on the ground"),
        ({"background": "white"}, "style studio: the shadow on the ground"),
        ({"background": "transparent"}, "out ("),
        ({"background": GREYS}, None),
        ({"camera": BELOW}, "style studio: greys)"),
        ({"lens": rj.PinholeDistortion(k1=0.1)}, "out ("),
        ({"outputs": ("depth",)}, "out ("),
        ({"outputs": "color"}, "style studio: greys, with the shadow on the ground"),
        ({"quality": rj.Quality(samples=8)}, "style studio: greys, with the shadow on the ground"),
    ],
    ids=["as it is", "white", "transparent", "photograph", "below", "lens", "depth", "one", "8"],
)
def test_reasons_are_true_and_those_of_the_frame(teapot, options, said):
    style = rj.styles.studio(teapot)
    told = reasons(style.explain(size=SIZE, **options))
    assert told == reasons(style.render(size=SIZE, **options).plan)
    if said is None:
        assert "style" not in told["background image"]
    else:
        assert said in told["background image"]
    has_own = "quality" in options or options.get("outputs") == ("depth",)
    assert ("style studio: 4 samples" in told["anti-aliasing"]) != has_own


def test_a_copy_with_another_quality_tells_of_its_own_samples(teapot):
    style = dataclasses.replace(rj.styles.studio(teapot), quality=rj.Quality(samples=8))
    assert "style studio: 8 samples" in reasons(style.explain(size=SIZE))["anti-aliasing"]


def test_a_shadow_that_is_out_of_view_is_not_told_of(teapot):
    away = rj.PerspectiveCamera((4.0, 9.0, 8.0), (40.0, 90.0, 80.0))
    style = rj.styles.studio(teapot, away)
    with pytest.warns(rj.ViewWarning):
        frame = style.render(size=SIZE)
    assert "shadow on the ground" not in str(frame.plan)
    assert "shadow on the ground" not in str(style.explain(size=SIZE))


@pytest.mark.parametrize("name", rj.styles.STYLES)
def test_a_style_has_lists_of_its_own(teapot, name):
    scene = scene_of(box())
    made = rj.styles.STYLES[name](scene).scene
    made.add(box())
    made.lights.append(rj.AmbientLight())
    assert len(scene.nodes) == 1
    assert scene.lights == []


def test_tiles_and_pickles_have_the_same_bits(teapot, tmp_path):
    from imageio.v3 import imread

    style = rj.styles.studio(teapot)
    # It looks at pixels of other tiles.
    style.scene.ambient_occlusion = None
    expected = style.render(size=SIZE).color
    assert np.array_equal(pickle.loads(pickle.dumps(style)).render(size=SIZE).color, expected)
    path = tmp_path / "tiles.tif"
    rj.distributed.render_large(style.scene, size=SIZE, path=path, tile=64, **style.options(SIZE))
    assert np.array_equal(imread(path), expected)


@pytest.mark.parametrize("name", [name for name in rj.styles.STYLES if name != "plain"])
def test_each_style_tells_of_rows_that_there_are(teapot, name):
    style = rj.styles.STYLES[name](teapot)
    plan = style.explain(size=SIZE)
    used = {effect.name for effect in plan.effects if effect.used}
    assert set(style.adds) <= used
    assert f"style {name}" in str(plan)


def test_what_is_unlit_has_no_lamp_in_it():
    scene = scene_of(rj.Mesh(box().vertices, box().faces, material=rj.Material(shading="unlit")))
    plan = rj.styles.studio(scene).explain(size=SIZE)
    used = {effect.name for effect in plan.effects if effect.used}
    assert not {"shadows", "environment light", "ambient occlusion"} & used


def test_bits_are_the_same_with_any_number_of_threads(teapot):
    frames = [rj.styles.studio(teapot).render(size=SIZE, threads=n).color for n in (1, 2)]
    assert np.array_equal(*frames)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        (name, kind)
        for name in rj.styles.STYLES
        for kind in ("texture", "vertices", "faces", "base")
        # Between vertices film fades out, where a mask is cut.
        if (name, kind) != ("xray", "vertices")
    ],
)
def test_holes_of_an_alpha_mask_are_there_in_every_style(name, kind):
    random = np.random.default_rng(0)
    vertices = [(x, y, 0) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    faces = [(0, 1, 4), (0, 4, 3), (4, 5, 8), (4, 8, 7)]
    alphas = random.integers(0, 256, (5, 5, 4), np.uint8)
    texture = rj.Texture(alphas, filter="nearest") if kind == "texture" else None
    counts = {"vertices": len(vertices), "faces": len(faces)}
    colors = random.random((counts[kind], 4)) if kind in counts else None
    base_color = (1.0, 0.5, 0.2, 0.4 if kind == "base" else 0.9)
    material = rj.Material(base_color=base_color, alpha_mode="mask", base_color_texture=texture)
    uv = [vertex[:2] for vertex in vertices]
    holed = rj.Mesh(vertices, faces, colors=colors, uv=uv, material=material)
    camera = rj.OrthographicCamera((0.1, 0.2, 4.0), (0.0, 0.0, 0.0), height=2.4)
    wanted = rj.render(holed, camera, size=(60, 60), outputs=("face_id",)).face_id >= 0
    assert wanted.any() != (kind == "base")
    options = {"size": (60, 60), "quality": rj.Quality.standard()}
    frame = rj.styles.STYLES[name](holed, camera).render(outputs=("color", "face_id"), **options)
    shown = frame.face_id >= 0
    if name == "xray":
        # Film has faces where it is all clear.
        shown = (frame.color != frame.color[0, 0]).any(axis=-1)
    assert (shown == wanted).all()


def test_up_turns_lamp_sky_and_ground(teapot):
    turned = rj.Scene()
    turned.up = (0.0, 0.0, 1.0)
    turned.add(teapot.nodes[0].mesh, rj.transforms.rotate_x(90.0))
    frames = [rj.styles.studio(one).render(size=SIZE).color for one in (teapot, turned)]
    differences = np.abs(frames[0].astype(int) - frames[1])
    assert np.median(differences) == 0
    assert np.quantile(differences, 0.98) <= 6


def test_options_go_before_the_style(teapot):
    style = rj.styles.studio(teapot)
    made = style.options(SIZE, quality=rj.Quality.draft(), background="red", outputs=("depth",))
    assert (made["quality"], made["background"]) == (rj.Quality.draft(), "red")
    frame = style.render(size=SIZE, quality=rj.Quality.draft())
    assert frame.plan.quality == rj.Quality.draft()
    assert "style studio: 4 samples" not in str(frame.plan)
    assert "style studio: nothing is too bright to show" in str(frame.plan)
    drawn = rj.render(style.scene, size=SIZE, **style.options(SIZE))
    assert np.array_equal(drawn.color, style.render(size=SIZE).color)


def test_depth_is_the_nearest_white_and_even(teapot):
    frame = rj.styles.depth(teapot).render(size=SIZE, outputs=("color", "depth", "coverage"))
    inside = (frame.coverage == 1.0) & np.isfinite(frame.depth)
    greys, depth = frame.color[inside][:, 0].astype(float), frame.depth[inside].astype(float)
    order = np.argsort(depth)
    assert greys.max() > 200
    assert np.corrcoef(greys, depth)[0, 1] < -0.99
    assert greys[order[0]] > greys[order[-1]]


def test_depth_is_that_of_points_and_lines_too():
    points = rj.Points([(-1, 0, 0), (1, 0, -4)], colors=np.eye(3)[:2], size=9)
    lines = rj.Lines([(-1, 1, -1), (1, 1, -3)], width=5)
    style = rj.styles.depth(scene_of(points, lines))
    camera = rj.PerspectiveCamera(eye=(0, 0, 6), target=(0, 0, 0), near=0.1)
    outputs = ("color", "depth", "coverage")
    frame = style.render(camera, size=SIZE, outputs=outputs)
    assert frame.plan.camera.eye == camera.eye
    inside = (frame.coverage == 1.0) & np.isfinite(frame.depth)
    colors, depth = frame.color[inside], frame.depth[inside]
    assert (colors[:, 0] == colors[:, 1]).all()
    assert np.ptp(depth) > 3.5
    assert np.corrcoef(colors[:, 0].astype(float), depth)[0, 1] < -0.9


def test_a_camera_goes_before_the_style_s(teapot):
    camera = rj.fit_camera(teapot, rj.orbit_direction(70, 10))
    style = rj.styles.plain(teapot)
    by_place = style.render(camera, size=SIZE)
    assert np.array_equal(by_place.color, style.render(size=SIZE, camera=camera).color)
    assert not np.array_equal(by_place.color, style.render(size=SIZE).color)
    assert style.explain(camera, size=SIZE).camera is camera


def test_normals_are_codes_of_directions():
    scene = scene_of(box())
    frame = rj.styles.normals(scene).render(size=SIZE, outputs=("color", "normal", "coverage"))
    inside = frame.coverage == 1.0
    codes = np.floor(frame.normal[inside] * 127.5 + 128.0).clip(0, 255)
    # At edges a pixel shows two faces.
    assert np.quantile(np.abs(frame.color[inside][:, :3] - codes), 0.95) <= 1


def run(*arguments):
    return CliRunner().invoke(commands.program, [str(one) for one in arguments])


def test_the_command_line_draws_studio_and_takes_others(tmp_path, teapot):
    from imageio.v3 import imread

    for words, style in (((), "studio"), (("--style", "plain"), "plain")):
        done = run(
            "render", MODELS / "teapot.obj", "-o", tmp_path / "a.png", "--size", "96x72", *words
        )
        assert done.exit_code == 0, done.output
        expected = rj.styles.STYLES[style](teapot).render(size=SIZE).color
        assert np.array_equal(imread(tmp_path / "a.png"), expected)
    assert tuple(rj.styles.STYLES) == cli_options.STYLES
    assert rj.styles.RECOLORED_STYLES == cli_options.STYLES_WITH_COLORS
    told = run("explain", MODELS / "teapot.obj").output
    assert "style studio: 4 samples" in told


def test_options_of_lines_change_the_outlines_of_a_style(tmp_path, cube):
    file, out = MODELS / "cube.ply", tmp_path / "a.png"
    told = run(
        "explain", file, "--style", "technical", "--outline-width", 2.5, "--hidden-lines",
        "--samples", 16,
    ).output  # fmt: skip
    rows = {line.split("  ")[0]: line for line in told.splitlines()}
    # Samples leave lines smooth, as the style has them.
    assert "2.5 wide, by coverage" in rows["outline"]
    assert "dashes of 5" in rows["hidden lines"]
    assert "16 samples" in rows["anti-aliasing"]
    told = run("explain", file, "--style", "plain", "--outline-width", 3).output
    rows = {line.split("  ")[0]: line for line in told.splitlines()}
    assert rows["outline"].endswith("3 wide)")
    ink = run(file, "-o", out, "--style", "technical", "--outline", "red", "--size", "60x60")
    assert ink.exit_code == 0, ink.output
    from imageio.v3 import imread

    seen = imread(out).astype(int)
    assert ((seen[..., 0] > 200) & (seen[..., 1] < 100)).sum() > 20
    assert run("explain", file, "--outline-width", 0).exit_code == 2


def test_explicit_options_win(tmp_path):
    file, out = MODELS / "cube.ply", tmp_path / "a.png"
    told = run("explain", file, "--samples", 8, "--tone-map", "aces", "--light", "headlight").output
    rows = {line.split("  ")[0]: line for line in told.splitlines()}
    assert "8 samples" in rows["anti-aliasing"]
    assert "style" not in rows["anti-aliasing"]
    assert "aces" in rows["tone mapping"]
    assert "style" not in rows["tone mapping"] + rows["lights"]
    assert "out (" in rows["shadows"]
    for words in (("--style", "clay", "--color", "red"), ("--style", "studoi")):
        done = run("render", file, "-o", out, *words)
        assert done.exit_code == 2
    assert "did you mean studio?" in done.stderr


def test_previews_are_in_studio(teapot):
    frame = rj.styles.studio(teapot).render(size=(320, 240))
    import io

    import imageio.v3 as iio

    assert np.array_equal(iio.imread(io.BytesIO(teapot._repr_png_())), frame.color)


@pytest.mark.parametrize("name", rj.styles.STYLES)
def test_anything_that_is_drawn_has_every_style(name):
    """Points, lines, nothing at all, a plane edge on, and far away."""
    style = rj.styles.STYLES[name]
    plane = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 2, 1]])
    far = rj.Mesh(box().vertices * 1e-3 + 1e6, box().faces)
    for what in (
        rj.Points([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]),
        rj.Lines([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], [[0, 1]]),
        plane,
        far,
    ):
        frame = style(what).render(size=(32, 24))
        assert frame.color.shape == (24, 32, 4)
        assert math.isfinite(frame.color.mean())
    with pytest.raises(ValueError, match="scene"):
        style(rj.Scene()).render(size=(32, 24))


@pytest.mark.parametrize("name", rj.styles.STYLES)
def test_stray_vertices_and_huge_scenes_have_every_style(name):
    stray = np.vstack([box().vertices, [(math.nan, 0.0, 0.0), (math.inf, 1.0, 1e300)]])
    with_stray = rj.Mesh(stray, box().faces, on_invalid="drop", material=box().material)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        style, clean = (rj.styles.STYLES[name](one) for one in (with_stray, box()))
        wanted = clean.render(size=SIZE).color
        assert np.array_equal(style.render(size=SIZE).color, wanted)
        huge = rj.Mesh(box().vertices * 2.0**60, box().faces, material=box().material)
        same = rj.styles.STYLES[name](huge).render(size=SIZE).color == wanted
    assert same.all(axis=2).mean() > 0.9


def test_shadows_that_are_asked_for_are_those_of_the_lamp():
    told = run("explain", MODELS / "teapot.obj", "--shadows").output
    assert "style studio: a lamp over the left shoulder" in told
    sun = run("explain", MODELS / "teapot.obj", "--shadows", "--style", "plain").output
    assert "1 map of" in sun
    assert "style" not in sun


def test_thumbnails_are_in_the_style(tmp_path):
    from imageio.v3 import imread

    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "a.ply").write_bytes((MODELS / "cube.ply").read_bytes())
    for name in ("studio", "wireframe"):
        done = run("render", folder, "-o", tmp_path / name, "--size", "96x72", "--style", name)
        assert done.exit_code == 0, done.output
        expected = rj.styles.STYLES[name](rj.load(folder / "a.ply")).render(size=SIZE).color
        assert np.array_equal(imread(tmp_path / name / "a.ply.png"), expected)


@pytest.mark.parametrize("up", [None, (0.0, 0.0, 1.0)])
def test_pictures_of_one_process_filter_the_sky_once(monkeypatch, up):
    from rasterjit.effects.environment import prefilter

    filtered = []
    filters = prefilter._compute_irradiance, prefilter._filter_reflections
    for own in filters:
        monkeypatch.setattr(
            prefilter, own.__name__, lambda *given, own=own: filtered.append(own) or own(*given)
        )
    rj.styles._make_sky.cache_clear()
    for color in ("red", "blue"):
        scene = scene_of(box(base_color=color, shading="pbr", metallic=1.0))
        scene.up = up
        rj.styles.studio(scene).render(size=(32, 24))
    assert filtered == [*filters]
