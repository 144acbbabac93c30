"""Light that is too strong for a picture is told of, and `studio` chooses an exposure for it."""

import math
import warnings

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.rendering import notices

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
    assert "of what is seen is white: the light is too strong to be shown" in text


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
    assert "of what is seen is white" in texts[0]


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


def test_frames_in_weak_light_are_not_looked_at(monkeypatch):
    monkeypatch.delattr(notices, "white_share")
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
