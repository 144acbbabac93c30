"""Light that is too strong for a picture is told of, and `studio` chooses an exposure for it."""

import math
import warnings

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.rendering import view_warnings

SQUARE = rj.Mesh(
    [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)],
    normals=[(0, 0, 1)] * 4, material=rj.Material("pbr", (0.2, 0.25, 0.3), metallic=0.0),
)  # fmt: skip
NEAR = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.5)
SUN = rj.DirectionalLight((0, 0, -1), intensity=21_740.0 / math.pi)


def lit_by(*lights, material=None):
    scene = rj.Scene()
    scene.add(SQUARE if material is None else rj.Mesh(SQUARE.vertices, SQUARE.faces,
              normals=SQUARE.normals, material=material))  # fmt: skip
    scene.lights = list(lights)
    return scene


def said(draw):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        draw()
    return [str(one.message) for one in caught if issubclass(one.category, rj.ViewWarning)]


@pytest.mark.parametrize("background", ["white", "black", None])
@pytest.mark.parametrize("height", [2.5, 12.0])
@pytest.mark.parametrize("light", [SUN, rj.PointLight((0, 0, 2), intensity=200.0)])
def test_a_picture_that_is_burnt_out_is_told_of(light, height, background):
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=height)
    scene = lit_by(light)
    (text,) = said(lambda: rj.render(scene, camera, size=(48, 32), background=background))
    assert "of what is seen in the light is white: the light is too strong to be shown" in text


@pytest.mark.parametrize("count", [1, 2, 24])
def test_a_batch_tells_which_view_is_the_first(count):
    scene = lit_by(SUN)
    # From behind, where no light falls.
    dark = rj.OrthographicCamera((0, 0, -5), (0, 0, 0), height=2.5)
    cameras = [*[dark] * (count // 2), *[NEAR] * (count - count // 2)]
    for size in ((32, 32), (48, 20)):
        (text,) = said(lambda: rj.render_batch(scene, cameras, size=size))  # noqa: B023
        (alone,) = said(lambda: rj.render(scene, NEAR, size=size))  # noqa: B023
        assert text == f"{alone} (cameras[{count // 2}])"
    assert said(lambda: rj.render_batch(scene, [dark] * count, size=(32, 32))) == []
    assert said(lambda: rj.render_batch(scene, cameras, size=(32, 32), outputs="depth")) == []


def test_frames_of_a_sequence_tell_of_a_later_one_too():
    dark = rj.OrthographicCamera((0, 0, -5), (0, 0, 0), height=2.5)
    cameras = [*[dark] * 40, *[NEAR] * 20]
    texts = said(lambda: list(rj.render_many(lit_by(SUN), cameras, size=(32, 32), threads=2)))
    assert len(texts) == 1
    assert "of what is seen in the light is white" in texts[0]


def test_a_renderer_says_it_once():
    with rj.Renderer((32, 32)) as renderer:
        texts = said(lambda: [renderer.render(lit_by(SUN), NEAR) for _ in range(3)])
    assert len(texts) == 1
    assert "of about -12.8 stops" in texts[0]


@pytest.mark.parametrize(
    "scene",
    [
        lit_by(),
        lit_by(material=rj.Material("unlit", "white")),
        lit_by(SUN, material=rj.Material("unlit", "white")),
        lit_by(rj.DirectionalLight((0, 0, -1)), material=rj.Material("phong", "white")),
        lit_by(rj.PointLight((0, 0, 2), intensity=4.0)),
        lit_by(
            rj.DirectionalLight((0, 0, -1), intensity=3.0),
            material=rj.Material("phong", "#606060", specular=0.0),
        ),
    ],
)
def test_usual_light_is_not_told_of(scene):
    assert said(lambda: rj.render(scene, NEAR, size=(32, 32))) == []


BESIDE = np.eye(4)
BESIDE[0, 3] = 2.0
"""Where a second square stands: right of the first."""

BOTH = rj.OrthographicCamera((1, 0, 5), (1, 0, 0), height=4.0)

BLUE = rj.Environment(np.tile(np.float32([0.1, 0.2, 0.6]), (16, 32, 1)))
WHITE = rj.Environment(np.ones((16, 32, 3), np.float32), intensity=0.1)
LAMP = rj.PointLight((0.5, 0, 2), intensity=1.0)


def both(material, *lights, environment=None, placed=BESIDE):
    """Return a scene of the dark square, and of another one, of a material, beside it."""
    scene = lit_by(*lights)
    scene.add(rj.Mesh(SQUARE.vertices, SQUARE.faces, normals=SQUARE.normals, material=material),
              placed)  # fmt: skip
    scene.environment = environment
    return scene


def half_white(parts):
    """Return a scene whose squares of white, 0..1 of all, are burnt out: ten in a row."""
    scene = lit_by(rj.DirectionalLight((0, 0, -1), intensity=30.0))
    scene.nodes.clear()
    for n in range(10):
        color = (1.0, 1.0, 1.0) if n < 10 * parts else (0.001, 0.001, 0.001)
        scene.add(rj.Mesh(0.2 * (SQUARE.vertices + (2.0 * n - 9.0, 0, 0)), SQUARE.faces,
                  normals=SQUARE.normals,
                  material=rj.Material("flat", color, specular=0.0)))  # fmt: skip
    return scene


ROUGHLY = 5.0
"""Percent: of so few pixels."""

WAYS = {
    "render": lambda scene, camera, **k: rj.render(scene, camera, size=(96, 64), **k),
    "samples": lambda scene, camera, **k: rj.render(
        scene, camera, size=(96, 64), quality=rj.Quality(samples=4), **k
    ),
    "pictures": lambda scene, camera, **k: rj.render(
        scene, camera, size=(48, 32), quality=rj.Quality(samples=64), **k
    ),
    "batch": lambda scene, camera, **k: rj.render_batch(scene, [camera] * 3, size=(96, 64), **k),
    "samples of a batch": lambda scene, camera, **k: rj.render_batch(
        scene, [camera] * 3, size=(48, 32), quality=rj.Quality(samples=4), **k
    ),
    "many": lambda scene, camera, **k: list(
        rj.render_many(scene, [camera] * 3, size=(48, 32), **k)
    ),
    "refine": lambda scene, camera, **k: rj.render(
        scene, camera, size=(48, 32), max_error=0.2, **k
    ),
}  # fmt: skip
"""Ways to draw a scene."""


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("background", ["white", "black"])
@pytest.mark.parametrize(("parts", "is_told"), [(0.4, False), (0.6, True)])
def test_more_than_half_of_what_is_lit_is_told_of(way, background, parts, is_told):
    scene = half_white(parts)
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0)
    texts = said(lambda: WAYS[way](scene, camera, background=background))
    assert len(texts) == is_told
    for text in texts:
        assert abs(float(text.partition("%")[0]) - 100.0 * parts) < ROUGHLY


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("environment", [BLUE, WHITE])
def test_a_burnt_out_part_is_told_of_before_any_sky(way, environment):
    scene = lit_by(SUN)
    scene.environment = environment
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=5.0)
    assert len(said(lambda: WAYS[way](scene, camera))) == 1


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "scene",
    [
        both(rj.Material("unlit", "white"), LAMP),
        both(rj.Material("unlit", "white"), LAMP, placed=np.eye(4)),
        both(rj.Material("phong", (1, 1, 1, 0.02), alpha_mode="blend"), LAMP),
        both(rj.Material("pbr", "white", transmission=1.0, metallic=0.0), LAMP),
        both(rj.Material("unlit", "white"), LAMP, environment=WHITE),
    ],
    ids=["a page", "a page before it", "a faint pane", "glass", "a page and a sky"],
)
def test_white_that_light_did_not_make_is_not_told_of(way, scene):
    assert said(lambda: WAYS[way](scene, BOTH)) == []


def test_a_picture_behind_is_not_counted():
    white = np.full((64, 96, 3), 255, np.uint8)
    assert said(lambda: WAYS["render"](lit_by(LAMP), BOTH, background=white)) == []
    (text,) = said(lambda: WAYS["render"](lit_by(SUN), BOTH, background=white))
    assert text.startswith("100%")


def test_what_a_lens_shows_is_counted():
    camera = rj.PerspectiveCamera((0, 0, 5), (0, 0, 0))
    lens = rj.FisheyeLens(24.0, 24.0, 24.0, 24.0)
    told = {
        bright: said(lambda scene=scene: rj.render(scene, camera, size=(48, 48), lens=lens))
        for bright, scene in (("sun", lit_by(SUN)), ("lamp", lit_by(LAMP)))
    }
    assert (len(told["sun"]), told["lamp"]) == (1, [])


def test_a_batch_follows_lights_that_change():
    scene = lit_by(rj.DirectionalLight((0, 0, -1)))
    counts = []
    for bright in (1.0, 1e3, 1.0, 1e4):
        scene.lights = [rj.DirectionalLight((0, 0, -1), intensity=bright)]
        counts.append(len(said(lambda: WAYS["batch"](scene, NEAR))))
    assert counts == [0, 1, 0, 1]


def test_a_batch_names_the_first_view_that_is_burnt_out():
    scene = both(rj.Material("flat", (1e-5, 1e-5, 1e-5), specular=0.0), SUN)
    away = [rj.OrthographicCamera((x, 0, 5), (x, 0, 0), height=1.0) for x in (2.0, 2.1, 0.0, 0.1)]
    (text,) = said(lambda: rj.render_batch(scene, away, size=(32, 32)))
    assert text.endswith("(cameras[2])")


def test_frames_in_weak_light_are_not_looked_at(monkeypatch):
    monkeypatch.delattr(view_warnings, "white_share")
    rj.render(lit_by(), NEAR, size=(16, 16))
    rj.render(lit_by(rj.DirectionalLight((0, 0, -1))), NEAR, size=(16, 16))


@pytest.mark.parametrize(
    "light",
    [SUN, rj.PointLight((0, 0, 2), intensity=1e15), rj.SpotLight((0, 0, 2), intensity=5e3)],
)
def test_studio_chooses_an_exposure_for_strong_lights(light):
    style = rj.styles.studio(lit_by(light), NEAR)
    assert style.scene.tone_map.exposure < -5.0
    assert "stops for what is seen" in style.adds["tone mapping"]
    frame = style.render(size=(64, 64))
    assert said(lambda: style.render(size=(64, 64))) == []
    middle = frame.color[20:44, 20:44, :3]
    assert middle.min() > 60
    assert middle.max() < 250


def test_the_exposure_follows_the_light():
    exposures = [
        rj.styles.studio(lit_by(rj.DirectionalLight((0, 0, -1), intensity=bright)), NEAR)
        .scene.tone_map.exposure
        for bright in (1e3, 4e3, 1.6e4)
    ]  # fmt: skip
    assert np.allclose(np.diff(exposures), -2.0, atol=0.11)


def open_box():
    """Return a box without a lid, of sharp edges and without normals."""
    box = trimesh.creation.box()
    return rj.Mesh(box.vertices, box.faces[2:], material=rj.Material("phong"))


@pytest.mark.parametrize(
    ("made", "section", "kinds"),
    [
        (open_box, None, ["sharp edges"]),
        (
            open_box,
            rj.SectionPlane((0.1, 0, 0), (1, 0.2, 0), cap=True),
            ["sharp edges", "is cut by"],
        ),
    ],
)
@pytest.mark.parametrize("bright", [1.0, 1e3])
def test_studio_swallows_and_repeats_no_warning_in_any_light(made, section, kinds, bright):
    scene = lit_by(rj.DirectionalLight((-1, -1, -1), intensity=bright))
    scene.nodes.clear()
    scene.add(made())
    scene.section = section
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rj.styles.studio(scene, NEAR).render(size=(32, 32))
    texts = [str(one.message) for one in caught]
    assert [sum(kind in text for text in texts) for kind in kinds] == [1] * len(kinds)
    assert len(texts) == len(kinds)


def test_usual_lights_and_tone_maps_of_ones_own_stay():
    assert rj.styles.studio(lit_by(rj.DirectionalLight()), NEAR).scene.tone_map.exposure == 0.0
    scene = lit_by(SUN)
    scene.tone_map = rj.ToneMap("aces", 1.0)
    assert rj.styles.studio(scene, NEAR).scene.tone_map == rj.ToneMap("aces", 1.0)


def test_the_command_line_says_which_exposure_it_chose(tmp_path):
    lit_by(SUN).save(tmp_path / "sun.glb")
    arguments = ["render", str(tmp_path / "sun.glb"), "-o", str(tmp_path / "a.png"), "--size=32x32"]
    told = CliRunner().invoke(commands.program, arguments)
    assert "stops, chosen for what is seen; --exposure sets another" in told.output
    again = CliRunner().invoke(commands.program, [*arguments, "--force", "--exposure", "-10"])
    assert "chosen for what is seen" not in again.output
