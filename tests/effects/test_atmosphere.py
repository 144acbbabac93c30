"""Environments, fog and tone maps in whole frames: what is seen, what is left out, and why."""

from __future__ import annotations

import math

import naive_environment as naive
import numpy as np
import pytest
import skies

import rasterjit as rj
from rasterjit.scene import transforms as tf
from rasterjit.survey import facts

SIZE = (40, 30)
SKY = np.random.default_rng(1).uniform(0.0, 2.0, (8, 16, 3)).astype(np.float32)


def scene_of(mesh, shading="phong", **fields):
    """Return a scene with a white mesh that does not shine."""
    scene = rj.Scene()
    material = rj.Material(shading=shading, base_color="white", specular=0.0)
    scene.add(rj.Mesh(mesh.vertices, mesh.faces, material=material))
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


SHADINGS = "unlit", "flat", "gouraud", "phong"


def row_of(mesh, **fields):
    """Return a scene with a white mesh of each kind of shading, side by side."""
    scene = scene_of(mesh, SHADINGS[0], **fields)
    for n, shading in enumerate(SHADINGS[1:], 1):
        material = rj.Material(shading, "white", specular=0.0)
        scene.add(
            rj.Mesh(mesh.vertices, mesh.faces, material=material), tf.translate((2.2 * n, 0, 0))
        )
    return scene


def far_away(**fields):
    """Return a scene of which nothing is seen."""
    scene = scene_of(rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), **fields)
    scene.nodes[0].world_from_model = tf.translate((1e6, 1e6, 1e6))
    return scene


def draw(scene, camera, outputs=("color", "linear"), **options):
    return rj.render(scene, camera, size=SIZE, outputs=outputs, **{"threads": 1, **options})


def used(frame):
    return {effect.name: effect for effect in frame.plan.effects}


def same(one, other):
    return all((one.arrays()[name] == other.arrays()[name]).all() for name in one.arrays())


# The background.

CAMERAS = {
    "perspective": rj.PerspectiveCamera((1, 2, 3), (0, 2.5, -1), fov_y=70.0),
    "straight up": rj.PerspectiveCamera((1, 2, 3), (1, 9, 3), up=(0, 0, 1), far=50.0),
    "parallel": rj.OrthographicCamera((1, 2, 3), (0, 1, 0), height=4.0),
    "off axis": rj.MatrixCamera(
        tf.look_at((1, 2, 3), (4, 1, 0), (0, 1, 0)),
        np.array([[1.3, 0, 0.3, 0], [0, 1.8, 0.2, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]]),
    ),
    "lens shift": rj.MatrixCamera(
        tf.look_at((1, 2, 3), (4, 1, 0), (0, 1, 0)),
        np.array([[1.2, 0.1, 0.6, 0], [0, 1.5, -0.4, 0], [0, 0, -1.02, -0.2], [0, 0, -1, 0]]),
    ),
    "mirrored": rj.MatrixCamera(
        tf.look_at((1, 2, 3), (4, 1, 0), (0, 1, 0)),
        np.diag([-1.0, 1.0, 1.0, 1.0]) @ tf.perspective(60.0, 1.0, 0.5, 100.0),
    ),
    "sheared parallel": rj.MatrixCamera(
        tf.look_at((1, 2, 3), (4, 1, 0), (0, 1, 0)),
        tf.shear(xz=0.4, yz=-0.2) @ np.diag([0.5, 0.5, -0.1, 1.0]),
    ),
}  # fmt: skip


def rays(camera):
    """Return the direction seen at each pixel, (H, W, 3): from the near to the far plane."""
    world_from_clip = np.linalg.inv(camera.projection_matrix(SIZE) @ camera.view_matrix())
    x = (2.0 * np.arange(SIZE[0]) + 1.0) / SIZE[0] - 1.0
    y = 1.0 - (2.0 * np.arange(SIZE[1]) + 1.0) / SIZE[1]
    ndc = np.ones((2, SIZE[1], SIZE[0], 4))
    ndc[..., 0], ndc[..., 1] = x, y[:, None]
    ndc[0, ..., 2], ndc[1, ..., 2] = -1.0, 0.5
    near, beyond = np.einsum("ij,nhwj->nhwi", world_from_clip, ndc)
    return beyond[..., :3] / beyond[..., 3:] - near[..., :3] / near[..., 3:]


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("rotation", [0.0, 75.0])
def test_the_background_is_what_lies_along_the_rays(name, rotation):
    camera = CAMERAS[name]
    frame = draw(far_away(environment=rj.Environment(SKY, 0.5, rotation)), camera)
    assert frame.stats.pixels_covered == 0
    assert (frame.linear[:, :, 3] == 1.0).all()
    assert (frame.color[:, :, 3] == 255).all()
    directions = rays(camera)
    back = tf.rotate_y(-rotation)[:3, :3]
    for row in range(0, SIZE[1], 3):
        for column in range(0, SIZE[0], 3):
            wanted = 0.5 * naive.look_up(SKY, back @ directions[row, column])
            assert frame.linear[row, column, :3] == pytest.approx(wanted, abs=1e-4)


def test_a_quarter_turn_brings_the_front_to_the_left():
    image = np.zeros((16, 32, 3))
    image[:, 12:20] = 1.0
    # The middle of the picture lies towards +x; turned by 90 degrees it lies towards -z.
    for rotation, target in ((0.0, (1, 0, 0)), (90.0, (0, 0, -1)), (-90.0, (0, 0, 1))):
        camera = rj.PerspectiveCamera((0, 0, 0), target, fov_y=30.0)
        frame = draw(far_away(environment=rj.Environment(image, rotation=rotation)), camera)
        assert (frame.linear[:, :, :3] > 0.99).all()


def test_columns_run_to_the_right_and_rows_down():
    image = np.zeros((64, 128, 3))
    image[:, :, 0] = (np.arange(128) + 0.5) / 128
    image[:, :, 1] = ((np.arange(64) + 0.5) / 64)[:, None]
    camera = rj.PerspectiveCamera((0, 0, 0), (1, 0, 0), fov_y=60.0)
    linear = draw(far_away(environment=rj.Environment(image)), camera).linear
    assert (np.diff(linear[:, :, 0], axis=1) > 0.0).all()
    assert (np.diff(linear[:, :, 1], axis=0) > 0.0).all()


def test_the_background_lies_behind_the_faces(cube, camera):
    environment = rj.Environment(SKY)
    frame = draw(scene_of(cube, environment=environment), camera, ("color", "linear", "face_id"))
    alone = draw(far_away(environment=environment), camera)
    empty = frame.face_id < 0
    assert 0.2 < empty.mean() < 0.9
    assert (frame.linear[empty] == alone.linear[empty]).all()
    assert (frame.color[empty] == alone.color[empty]).all()
    assert (frame.linear[~empty] != alone.linear[~empty]).any(axis=1).all()


def test_a_background_that_is_given_wins(cube, camera):
    scene = scene_of(cube, environment=rj.Environment(SKY))
    frame = draw(scene, camera, background="#123456")
    assert frame.color[0, 0].tolist() == [0x12, 0x34, 0x56, 255]
    effect = used(frame)["environment background"]
    assert (effect.used, effect.reason) == (False, "the render was given a background")
    white = draw(scene, camera, background="white")
    assert white.color[0, 0].tolist() == [255] * 4
    clear = draw(scene, camera, background="transparent")
    assert clear.color[0, 0, 3] == 0


def test_an_environment_need_not_be_seen(cube, camera):
    scene = scene_of(cube, environment=rj.Environment(SKY, background=False))
    assert draw(scene, camera).color[0, 0].tolist() == [255] * 4


def test_the_sky_is_seen_behind_edges_alone(cube, camera):
    scene = scene_of(cube, environment=rj.Environment(SKY))
    scene.wireframe = rj.Wireframe("red", "only")
    frame = draw(scene, camera, ("color",))
    alone = draw(far_away(environment=scene.environment), camera, ("color",))
    edges = (frame.color == [255, 0, 0, 255]).all(axis=2)
    assert (frame.color[~edges] == alone.color[~edges]).all()
    assert edges.any()


# Light from all around.


WIDE = rj.PerspectiveCamera((3.3, 2.0, 9.0), (3.3, 0.0, 0.0))
"""Sees all of a row."""


def test_one_colour_all_around_gives_exactly_that_colour(sphere):
    color = (0.5, 0.25, 0.125)
    scene = row_of(sphere, environment=rj.Environment.constant(color))
    frame = draw(scene, WIDE, ("linear", "object_id"))
    for number, shading in enumerate(SHADINGS):
        seen = frame.linear[frame.object_id == number][:, :3]
        assert len(seen) > 20
        if shading == "gouraud":
            # Interpolated between three vertices that all have it.
            assert seen == pytest.approx(np.broadcast_to(color, seen.shape), abs=1e-6)
        else:
            assert (seen == np.float32(color if shading != "unlit" else 1.0)).all()
    assert (frame.linear[frame.object_id < 0][:, :3] == np.float32(color)).all()


def test_one_colour_all_around_equals_ambient_light(sphere, camera):
    lit = scene_of(sphere, environment=rj.Environment.constant("orange", background=False))
    ambient = scene_of(sphere, lights=[rj.AmbientLight("orange", 1.0)])
    assert same(draw(lit, camera), draw(ambient, camera))


def test_one_colour_all_around_equals_ambient_light_on_microfacets(sphere, camera):
    def lit_by(**fields):
        scene = rj.Scene()
        for n, (metallic, roughness) in enumerate(((0.0, 0.2), (1.0, 0.6), (0.5, 1.0))):
            material = rj.Material("pbr", "orange", metallic=metallic, roughness=roughness)
            scene.add(
                rj.Mesh(sphere.vertices, sphere.faces, material=material),
                tf.translate((0.5 * n, 0.3 * n, -n)),
            )
        for name, value in fields.items():
            setattr(scene, name, value)
        return draw(scene, camera, ("linear",), background="white").linear

    around = lit_by(environment=rj.Environment.constant("#88aaff", intensity=0.7))
    ambient = lit_by(lights=[rj.AmbientLight("#88aaff", 0.7)])
    assert around == pytest.approx(ambient, abs=1e-6)


def test_microfacets_mirror_the_sky_and_white_stays_white(sphere, camera):
    scene = scene_of(sphere, "pbr", environment=rj.Environment.constant("white"))
    assert draw(scene, camera).linear == pytest.approx(1.0, abs=2e-6)
    scene = rj.Scene()
    mirror = rj.Material("pbr", "white", metallic=1.0, roughness=0.0)
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=mirror))
    scene.environment = rj.Environment.gradient("blue", "black", "red")
    frame = draw(scene, rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.2))
    assert "mirrored by pbr" in used(frame)["environment light"].reason
    top, bottom = frame.linear[8, 20], frame.linear[21, 20]
    assert top[2] > 0.5 > 0.1 > top[0]
    assert bottom[0] > 0.5 > 0.1 > bottom[2]


def test_unlit_objects_get_no_light(sphere, camera):
    scene = scene_of(sphere, "unlit", environment=rj.Environment(SKY, background=False))
    frame = draw(scene, camera)
    assert same(frame, draw(scene_of(sphere, "unlit"), camera))
    effect = used(frame)["environment light"]
    assert (effect.used, effect.reason) == (False, "every material in view is unlit")


def test_an_environment_takes_the_place_of_the_headlight(sphere, camera):
    scene = scene_of(sphere, environment=rj.Environment.constant("black"))
    frame = draw(scene, camera, ("linear",))
    assert not frame.linear[:, :, :3].any()
    effects = used(frame)
    assert effects["lights"].reason == "no headlight, for the scene has an environment"
    light = effects["environment light"]
    assert (light.used, light.reason) == (False, "the environment is black")


def test_a_black_environment_changes_no_bit(sphere, monkeypatch):
    lights = [rj.DirectionalLight((-1, -2, -1)), rj.AmbientLight(intensity=0.2)]
    # Without an environment, plain objects take float32.
    alike = {"quality": rj.Quality(interpolation_precision="float64")}
    without = draw(row_of(sphere, lights=lights), WIDE, **alike)
    black = rj.Environment(np.zeros((4, 8, 3)), background=False)
    scene = row_of(sphere, lights=lights, environment=black)
    monkeypatch.setattr(rj.Environment, "lights", True)
    frame = draw(scene, WIDE, **alike)
    assert used(frame)["environment light"].used
    assert same(frame, without)


def test_the_brighter_side_faces_the_light(sphere):
    sky = skies.sunny(64, 32, sun=(1, 0.2, 0), brightness=30.0, degrees=15.0)
    scene = scene_of(sphere, environment=rj.Environment(sky))
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.2)
    frame = draw(scene, camera, ("linear", "face_id"), background="black")
    left, right = frame.linear[:, :20, 0].sum(), frame.linear[:, 20:, 0].sum()
    assert right > 2.0 * left


# Fog.


@pytest.mark.parametrize(
    "fog",
    [
        rj.Fog("red", "linear", start=3.0, end=9.0),
        rj.Fog("red", "exp", density=0.2),
        rj.Fog("red", "exp2", density=0.2),
        rj.Fog("red", "exp", density=0.5, height=0.0, falloff=1.0),
    ],
)
def test_fog_covers_every_kind_of_surface(cube, fog):
    scene = row_of(cube, lights=[rj.AmbientLight(intensity=1.0)], fog=fog)
    frame = draw(scene, WIDE, ("linear", "position", "object_id"))
    eye = WIDE.eye_position()
    for number in range(len(SHADINGS)):
        places = np.argwhere(frame.object_id == number)
        assert len(places) > 20
        for row, column in places[::7]:
            share = naive.fog_share(fog, frame.position[row, column], eye)
            assert frame.linear[row, column, 1] == pytest.approx(share, abs=1e-5)
            assert frame.linear[row, column, 0] == pytest.approx(1.0, abs=1e-6)
    assert (frame.linear[frame.object_id < 0] == 1.0).all()


FOG_OUT = [
    (None, "scene.fog is None"),
    (rj.Fog(density=0.0), "its density is 0"),
    (rj.Fog(mode="linear", start=50.0, end=60.0), "it begins beyond everything"),
]


@pytest.mark.parametrize(("fog", "reason"), FOG_OUT)
def test_fog_that_covers_nothing_is_left_out(cube, camera, fog, reason):
    frame = draw(scene_of(cube, fog=fog), camera)
    effect = used(frame)["fog"]
    assert (effect.used, effect.reason) == (False, reason)
    assert not frame.plan.has("fog")
    assert same(frame, draw(scene_of(cube), camera))


@pytest.mark.parametrize("fog", [fog for fog, _ in FOG_OUT[1:]])
def test_fog_that_covers_nothing_changes_no_bit(cube, monkeypatch, fog):
    without = draw(row_of(cube), WIDE)
    monkeypatch.setattr(facts, "may_fog_cover", lambda *_: True)
    frame = draw(row_of(cube, fog=fog), WIDE)
    assert used(frame)["fog"].used
    assert same(frame, without)


def test_fog_reaches_as_far_as_anything_is_seen(cube, camera):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    reach = float(np.linalg.norm(corners - camera.eye_position(), axis=1).max())
    for start, expected in ((reach * 0.999, True), (reach * 1.001, False)):
        fog = rj.Fog(mode="linear", start=start, end=start + 1.0)
        assert used(draw(scene_of(cube, fog=fog), camera))["fog"].used is expected


# Tone mapping.


@pytest.mark.parametrize("curve", ["none", "reinhard", "aces", "neutral"])
def test_a_frame_is_tone_mapped_before_it_is_encoded(sphere, camera, curve):
    tone = rj.ToneMap(curve, 1.0)
    scene = scene_of(sphere, lights=[rj.DirectionalLight((-1, -1, -2), "orange", 3.0)])
    plain = draw(scene, camera, ("linear", "face_id"))
    scene.tone_map = tone
    frame = draw(scene, camera, ("color", "linear", "face_id"))
    assert (frame.linear == plain.linear).all()
    for row, column in np.argwhere(frame.face_id >= 0)[::23]:
        shown = np.clip(naive.tone(curve, frame.linear[row, column, :3].astype(float), 1.0), 0, 1)
        code = 255.0 * rj.scene.color.linear_to_srgb(shown)
        assert np.abs(frame.color[row, column, :3] - code).max() <= 0.51


def test_a_background_that_is_given_is_shown_as_given(sphere, camera):
    scene = scene_of(sphere, tone_map=rj.ToneMap("reinhard", 2.0))
    frame = draw(scene, camera, background="#804020")
    assert frame.color[0, 0].tolist() == [0x80, 0x40, 0x20, 255]


def test_the_sky_is_tone_mapped(camera):
    scene = far_away(environment=rj.Environment.constant("white", intensity=3.0))
    scene.tone_map = rj.ToneMap("reinhard")
    frame = draw(scene, camera)
    assert (frame.linear[:, :, :3] == 3.0).all()
    shown = naive.tone("reinhard", (3.0, 3.0, 3.0))[0]
    code = math.floor(255.0 * float(rj.scene.color.linear_to_srgb(shown)) + 0.5)
    assert (frame.color[:, :, :3] == code).all()


def test_a_tone_map_that_changes_nothing_is_left_out(sphere, camera, monkeypatch):
    without = draw(scene_of(sphere), camera)
    scene = scene_of(sphere, tone_map=rj.ToneMap("none"))
    frame = draw(scene, camera)
    assert not frame.plan.has("tone mapping")
    assert used(frame)["tone mapping"].reason == "curve none, exposure 0"
    monkeypatch.setattr(rj.ToneMap, "is_neutral", False)
    mapped = draw(scene, camera)
    assert mapped.plan.has("tone mapping")
    assert same(mapped, without)
    assert same(frame, without)


def test_linear_output_alone_needs_no_tone_map(sphere, camera):
    frame = draw(scene_of(sphere, tone_map=rj.ToneMap("aces")), camera, ("linear",))
    assert not frame.plan.has("tone mapping")
    assert used(frame)["tone mapping"].reason == "no output shows colour in 8 bits"


# Transparency: what comes through is fogged, and the sky is seen behind it.


def glass(alpha=0.5, **fields):
    scene = rj.Scene()
    material = rj.Material("unlit", (0.5, 0.25, 0.0, alpha), alpha_mode="blend")
    corners = [[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]]
    pane = rj.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material)
    for z in (0.0, 1.0):
        scene.add(pane, tf.translate((0, 0, z)))
    for name, value in fields.items():
        setattr(scene, name, value)
    return scene


def test_the_sky_is_seen_through_glass(camera):
    environment = rj.Environment(SKY)
    frame = draw(glass(environment=environment), camera)
    alone = draw(far_away(environment=environment), camera).linear[15, 20, :3].astype(float)
    wanted = 0.75 * np.array([0.5, 0.25, 0.0]) + 0.25 * alone
    assert frame.linear[15, 20] == pytest.approx([*wanted, 1.0], abs=1e-5)


def test_every_layer_has_its_own_fog(camera):
    fog = rj.Fog("white", "exp", density=0.3)
    frame = draw(glass(fog=fog), camera, ("linear",), background="black")
    eye, color = camera.eye_position(), np.array([0.5, 0.25, 0.0])
    ray = rays_through(camera, 15, 20)
    seen = np.zeros(3)
    for z in (0.0, 1.0):
        share = naive.fog_share(fog, eye + ray * (z - eye[2]) / ray[2], eye)
        seen = 0.5 * (share * color + (1.0 - share)) + 0.5 * seen
    assert frame.linear[15, 20, :3] == pytest.approx(seen, abs=1e-5)


def rays_through(camera, row, column):
    return rays(camera)[row, column]


@pytest.mark.parametrize("background", ["#804020", "transparent"])
def test_glass_is_tone_mapped_over_a_background_as_given(camera, background):
    tone = rj.ToneMap("reinhard", 2.0)
    frame = draw(glass(tone_map=tone), camera, background=background)
    shown = np.array(naive.tone("reinhard", (0.5, 0.25, 0.0), 2.0))
    behind = rj.scene.color.linear_color("background", background).astype(float)
    alpha = 0.75 + 0.25 * behind[3]
    wanted = (0.75 * shown + 0.25 * behind[3] * behind[:3]) / alpha
    code = 255.0 * rj.scene.color.linear_to_srgb(wanted)
    assert np.abs(frame.color[15, 20, :3] - code).max() <= 0.51
    assert frame.color[15, 20, 3] == math.floor(255.0 * alpha + 0.5)
    plain = draw(glass(), camera, ("linear",), background=background)
    assert frame.linear == pytest.approx(plain.linear, abs=1e-6)


# Single pixels.


def test_a_pixel_is_explained_with_the_colour_of_the_frame(cube, camera):
    scene = scene_of(
        cube, environment=rj.Environment(SKY), fog=rj.Fog(density=0.1), tone_map=rj.ToneMap("aces")
    )
    frame = draw(scene, camera, ("color", "linear", "face_id"))
    for row, column in ((0, 0), (15, 20)):
        told = rj.explain_pixel(scene, camera, SIZE, column, row)
        assert (told.color == frame.color[row, column]).all()
        assert (told.linear == frame.linear[row, column]).all()
        assert not told.under_wireframe
    assert frame.face_id[0, 0] < 0 <= frame.face_id[15, 20]


# Bad input.


@pytest.mark.parametrize("name", ["environment", "fog", "tone_map"])
def test_what_is_none_of_these_is_refused(cube, camera, name):
    with pytest.raises(ValueError, match=f"scene.{name} must be"):
        draw(scene_of(cube, **{name: "blue"}), camera)


def test_the_plan_says_what_is_out(cube, camera):
    effects = used(draw(scene_of(cube), camera))
    for name, reason in (
        ("environment light", "scene.environment is None"),
        ("environment background", "scene.environment is None"),
        ("fog", "scene.fog is None"),
        ("tone mapping", "scene.tone_map is None"),
    ):
        assert (effects[name].used, effects[name].reason) == (False, reason)
