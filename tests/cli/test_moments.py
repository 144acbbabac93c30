"""Commands show a file at a time of its animation, play it, and name what it has."""

from __future__ import annotations

import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image, ImageSequence

import rasterjit as rj
from rasterjit.animation import render_animation, tracks
from rasterjit.cli import commands

MODELS = Path(__file__).parents[2] / "models"
FIGURE, CUBE = MODELS / "figure.glb", MODELS / "cube.ply"
SIZE = (48, 36)
SMALL = ("--size", "48x36", "--quiet")


def run(*arguments):
    words = [str(argument) for argument in arguments]
    return CliRunner().invoke(commands.program, words, default_map={"render": {"style": "plain"}})


def render(tmp_path, *options):
    path = tmp_path / "out.png"
    result = run("render", FIGURE, "-o", path, *SMALL, *options)
    assert (result.exit_code, result.output) == (0, "")
    return iio.imread(path)


def drawn(scene):
    return rj.render(scene, size=SIZE).color[..., :3]


@pytest.mark.parametrize(
    ("options", "time", "animation"),
    [
        (("--time", 0.3), 0.3, 0),
        (("--time", 0.3, "--animation", "wave"), 0.3, "wave"),
        (("--time", 0.3, "--animation", 1), 0.3, "wave"),
        (("--animation", "wave"), 0.0, "wave"),
        (("--time", 99), 1.2, "walk"),
    ],
)
def test_a_picture_is_of_the_scene_at_that_time(tmp_path, options, time, animation):
    found = render(tmp_path, *options)[..., :3]
    assert (found == drawn(rj.load(FIGURE).at(time, animation))).all()
    assert (found != drawn(rj.load(FIGURE))).any()


def test_without_a_time_it_is_posed_as_the_file_has_it(tmp_path):
    assert (render(tmp_path)[..., :3] == drawn(rj.load(FIGURE))).all()


def test_a_name_goes_before_a_number(tmp_path):
    """An animation may be called "0", and not be the first."""
    scene = rj.load(FIGURE)
    walk, wave = scene.animations
    walk.name, wave.name = "1", "0"
    scene.save(tmp_path / "named.glb")
    for name, number in (("0", 1), ("1", 0)):
        path = tmp_path / "out.png"
        run("render", tmp_path / "named.glb", "-o", path, *SMALL, "--animation", name)
        assert (iio.imread(path)[..., :3] == drawn(rj.load(FIGURE).at(0.0, number))).all()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((FIGURE, "--time", -1), "--time"),
        ((FIGURE, "--time", "nan"), "must be finite"),
        ((FIGURE, "--time", "inf"), "must be finite"),
        ((CUBE, "--time", 1), "--time: cube.ply has no animation"),
        ((CUBE, "--animation", "walk"), "--animation: cube.ply has no animation"),
        ((FIGURE, "--animation", "wlak"), "0: 'walk', 1: 'wave'; did you mean 'walk'?"),
        ((FIGURE, "--animation", 2), "has no '2', but 0: 'walk', 1: 'wave'"),
        ((FIGURE, "--animation", -1), "has no '-1'"),
    ],
)
def test_a_time_that_there_is_not_is_refused_in_one_line(tmp_path, arguments, told):
    result = run("render", *arguments, "-o", tmp_path / "out.png", *SMALL)
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert told in result.stderr
    assert not (tmp_path / "out.png").exists()


def test_a_folder_has_no_time(tmp_path):
    result = run("render", MODELS, "-o", tmp_path / "all", *SMALL, "--time", 1)
    assert result.exit_code == 2
    assert "--time has no effect here" in result.stderr


def test_explain_tells_of_the_pose(tmp_path):
    standing, walking = (
        run("explain", FIGURE, *options).stdout for options in ((), ("--time", 0.3))
    )
    assert standing
    assert walking != standing
    assert run("explain", CUBE, "--time", 1).exit_code == 2


def animate(tmp_path, *options, file=FIGURE):
    """Write an animation that must succeed; return its frames."""
    path = tmp_path / "out.webp"
    result = run("turntable", file, "-o", path, *SMALL, "--fps", 10, *options)
    assert result.exit_code == 0, result.output
    with Image.open(path) as picture:
        return [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(picture)]


def expected(times, turns, count, animation="walk"):
    """Return frames of the figure from a camera that goes around it."""
    scene = rj.load(FIGURE)
    turn = tracks.turntable(scene, aspect=4 / 3, animation=animation)
    cameras = [turn(turns * number / count) for number in range(count)]
    return [
        rj.render(scene.at(time, animation), camera, size=SIZE).color[..., :3]
        for time, camera in zip(times, cameras, strict=True)
    ]


def test_a_turntable_plays_the_animation_in_its_own_time(tmp_path):
    """1.2 seconds at 10 frames a second are 12 frames, in one turn."""
    found = animate(tmp_path, "--animate")
    for one, other in zip(found, expected(np.arange(12) / 10, 1.0, 12), strict=True):
        assert (one == other).all()


def test_more_frames_begin_the_animation_again_and_the_camera_may_stay(tmp_path):
    found = animate(tmp_path, "--animate", "--frames", 14, "--turns", 0)
    assert len(found) == 14
    assert (found[0] != found[1]).any()
    # The animation's end is float32(1.2), and so after 1.2 by 5e-8 seconds.
    times = [number / 10 % float(np.float32(1.2)) for number in range(14)]
    for one, other in zip(found, expected(times, 0.0, 14), strict=True):
        assert (one == other).all()


def test_an_animation_that_is_named_is_played(tmp_path):
    found = animate(tmp_path, "--animation", "wave")
    times = np.arange(20) / 10
    for one, other in zip(found, expected(times, 1.0, 20, "wave"), strict=True):
        assert (one == other).all()


def test_turns_say_how_often_the_camera_goes_around(tmp_path):
    once = animate(tmp_path, "--frames", 6, file=CUBE)
    assert len(once) == 6
    back = animate(tmp_path, "--frames", 6, "--turns", -1, file=CUBE)
    assert (back[0] == once[0]).all()
    half = animate(tmp_path, "--frames", 6, "--turns", 0.5, file=CUBE)
    assert (half[2] == once[1]).all()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((CUBE, "--animate"), "--animate: cube.ply has no animation"),
        ((CUBE, "--turns", 0), "--turns: nothing moves without --animate"),
        ((FIGURE, "--turns", "nan"), "must be finite"),
        ((FIGURE, "--animation", "wav"), "did you mean 'wave'?"),
    ],
)
def test_what_cannot_be_played_is_refused(tmp_path, arguments, told):
    result = run("turntable", *arguments, "-o", tmp_path / "out.gif", *SMALL)
    assert result.exit_code == 2
    assert told in result.stderr
    assert not (tmp_path / "out.gif").exists()


def test_info_lists_animations():
    held = json.loads(run("info", FIGURE, "--json").stdout)
    scene = rj.load(FIGURE)
    assert held["animations"] == [
        {"name": one.name, "seconds": one.duration, "channels": len(one.channels)}
        for one in scene.animations
    ]
    assert held["attributes"]["joints"] == 1
    told = run("info", FIGURE).stdout
    assert "'walk': 1.2 s, 15 channels" in told
    assert "'wave': 2 s, 8 channels" in told
    assert json.loads(run("info", CUBE, "--json").stdout)["animations"] == []
    assert "animation" not in run("info", CUBE).stdout


def steadily_seen(scene):
    """Return the picture of a scene as frames of an animation show it by default."""
    camera = rj.fit_camera(scene, aspect=SIZE[0] / SIZE[1], steady=True)
    return rj.render(scene, camera, size=SIZE, threads=1).color


def test_frames_play_an_animation_and_put_everything_back():
    scene = rj.load(MODELS / "face.glb")
    nodes = scene.every_node()
    before = [(node.transform.copy(), node.trs, node.weights) for node in nodes]
    times = [0.0, 0.4, 1.0, 2.0, 4.0, 4.5]
    with rj.Renderer(SIZE, threads=1) as renderer:
        found = [
            frame.color.copy()
            for frame in render_animation.frames(renderer, scene, times, animation="feelings")
        ]
        again = [
            frame.color.copy()
            for frame in render_animation.frames(renderer, scene, times, animation=0, loop=True)
        ]
        still = [frame.color.copy() for frame in render_animation.frames(renderer, scene, times)]
    for time, color in zip(times, found, strict=True):
        assert (color == steadily_seen(scene.at(time, 0))).all()
    for time, color in zip(times, again, strict=True):
        assert (color == steadily_seen(scene.at(time % 4.0, 0))).all()
    assert all((color == still[0]).all() for color in still)
    for node, (transform, trs, weights) in zip(nodes, before, strict=True):
        assert (node.transform == transform).all()
        assert all(np.array_equal(one, other) for one, other in zip(node.trs, trs, strict=True))
        assert (node.weights is None) == (weights is None)


def test_tracks_act_after_the_animation():
    scene = rj.load(MODELS / "face.glb")
    face = next(node for node in scene.every_node() if node.name == "face")
    place = rj.transforms.translate((0.5, 1.0, 0.0))
    with rj.Renderer(SIZE, threads=1) as renderer:
        (frame,) = render_animation.frames(
            renderer, scene, [0.8], animation=0, transforms={face: lambda time: place}
        )
        color = frame.color.copy()
    moved = scene.at(0.8, 0)
    next(node for node in moved.every_node() if node.name == "face").transform = place
    assert (color == steadily_seen(moved)).all()


@pytest.mark.parametrize("animation", ["smile", 2, -1, 0.5, object()])
def test_an_animation_that_there_is_not_is_refused_at_once(animation):
    scene = rj.load(MODELS / "face.glb")
    with (
        rj.Renderer(SIZE, threads=1) as renderer,
        pytest.raises(ValueError, match="animation must"),
    ):
        render_animation.frames(renderer, scene, [0.0], animation=animation)


def test_a_turntable_stays_away_from_all_that_an_animation_shows():
    scene = rj.load(MODELS / "tentacle.glb")
    wide = tracks.turntable(scene, animation="sway")
    center = np.array(wide(0.0).target)
    for time in np.linspace(0.0, 4.0, 33):
        middle, radius = scene.at(time, "sway").bounding_sphere()
        inside = np.linalg.norm(np.array(wide(0.0).eye) - center) * np.sin(np.radians(22.5))
        assert np.linalg.norm(middle - center) + radius <= inside * (1 + 1e-9)
    with pytest.raises(ValueError, match="scene must be a Scene"):
        tracks.turntable(scene.nodes[0].mesh, animation="sway")
