"""
Those who draw in the benchmarks: that they draw the same picture, and say what they cannot.

RasterJIT's own rivals draw small scenes here; peers draw in a process of their own, as they do when
they are timed. On continuous integration a rival that is missing is a failure, and so is a peer
where ``PEERS`` is set, for then the extra ``bench`` is installed. Else, and where it is too large
to install, its tests are skipped with its own reason.
"""

from __future__ import annotations

import functools
import importlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opengl import skip_or_fail

if not os.environ.get("EVERY_TEST"):
    # Which of them draws which scene is asked of the scenes, which take memory.
    pytest.skip("takes long: set EVERY_TEST=true to run it", allow_module_level=True)
pytestmark = pytest.mark.takes_long

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
contestants = importlib.import_module("benchmarks.contestants")
needs = importlib.import_module("benchmarks.contestants.needs")
open3d_ = importlib.import_module("benchmarks.contestants.open3d_")
pairing = importlib.import_module("benchmarks.pairing")
pictures = importlib.import_module("benchmarks.pictures")
scenes = importlib.import_module("benchmarks.scenes")
screen = importlib.import_module("benchmarks.contestants.screen")
trimesh_offscreen = importlib.import_module("benchmarks.contestants.trimesh_offscreen")

contestant = contestants.contestant

HERE = (
    "opengl", "opengl_color", "embreex", "float_edges", "single_vertices",
    "standard_depth", "checked_bounds", "numpy", "pure_python", "full_screen",
    "rasterjit_batch",
)  # fmt: skip
LARGE = ("open3d", "pyvista")
"""Peers of some hundred megabytes, which the extra ``bench`` leaves out."""
PEERS = sorted(contestants.MODULES.keys() - {*HERE, "rasterjit"})

PEER_SCENES = (
    "fill:64",
    "triangles:2000",
    "mesh_70k_phong",
    "small_images_quick",
    "wireframe",
    "instances_10k",
    "culled",
    "fill_sample",
    "short_lines_sample",
)
"""By the names that a worker takes."""

WORKER_SECONDS = 300


def small_scenes():
    """Return one small scene of every kind."""
    mesh = scenes.colored_torus(16, 8, (96, 54), 60.0)
    images, places = scenes.small_images(3), scenes.instances()
    return {
        "fill": scenes.smooth_quads("back_to_front", (64, 48), 4),
        "faces of a fill": scenes.full_screen_quads("front_to_back", (64, 48), 4),
        "mesh": mesh,
        "faces of a mesh": replace(mesh, colors=None),
        "phong": replace(scenes.mesh_70k_phong(), size=(160, 90)),
        "views": images,
        "instances": replace(places, instances=places.instances[::40], size=(320, 180)),
        "culled": replace(scenes.culled(), size=(160, 90)),
        "edges": replace(mesh, colors=None, mode="edges"),
        "slivers": scenes.slivers(40),
        "lines": scenes.short_lines(300),
    }


SMALL = small_scenes()


def pairs(keys, names, find):
    """Return the pairs of contestants and scenes of which the first says it draws the second."""
    found = {name: find(name) for name in names}
    return [
        (key, name) for key in keys for name in names if contestant(key).draws(found[name]) is None
    ]


def drawn_by(key, scene):
    """Return a contestant's picture of a scene, drawn twice and read back."""
    prepared = contestant(key).prepare(scene, 1)
    prepared.draw()
    prepared.draw()
    prepared.read()
    return prepared.picture()


@functools.cache
def small_reference(name):
    """Return RasterJIT's picture of a small scene."""
    return drawn_by("rasterjit", SMALL[name])


@functools.cache
def reference(name):
    """Return RasterJIT's picture of a scene of the suite."""
    return drawn_by("rasterjit", scenes.find_scene(name))


def check(key, scene, picture, expected):
    """Assert that a picture is that of the reference, as far as the contestant's rules allow."""
    least = pictures.needed(scene, contestant(key))
    shares = pictures.agreement(picture, expected)
    shares["near"] = pictures.nearness(picture["covered"], expected["covered"])
    assert expected["covered"].any()
    assert picture["covered"].dtype == bool
    assert not pictures.differs(shares, least), (shares, least)


def require(key):
    """Skip the test of a contestant that cannot draw here; where CI installs it, fail."""
    reason = contestant(key).available()
    if reason is not None:
        is_installed = key in HERE or (key not in LARGE and os.environ.get("PEERS"))
        (skip_or_fail if is_installed else pytest.skip)(f"{contestant(key).NAME}: {reason}")


@pytest.mark.parametrize(("key", "name"), pairs(HERE, SMALL, SMALL.get))
def test_picture_is_that_of_rasterjit(key, name):
    require(key)
    check(key, SMALL[name], drawn_by(key, SMALL[name]), small_reference(name))


@pytest.mark.parametrize(("key", "name"), pairs(PEERS, PEER_SCENES, scenes.find_scene))
def test_picture_of_a_peer_is_that_of_rasterjit(key, name, tmp_path):
    require(key)
    path = tmp_path / "picture.npz"
    ended = subprocess.run(
        [sys.executable, "-m", "benchmarks.worker", key, name, "1", str(path)],
        env=pairing.package_environment(contestant(key).environment(1)),
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=WORKER_SECONDS,
    )
    assert ended.returncode == 0, ended.stderr
    with np.load(path) as saved:
        check(key, scenes.find_scene(name), dict(saved), reference(name))


@pytest.mark.parametrize("key", ["numpy", "pure_python", "full_screen"])
def test_textbook_rules_give_the_very_pixels(key):
    for name in ("faces of a fill", "faces of a mesh"):
        drawn = drawn_by(key, SMALL[name])
        np.testing.assert_array_equal(drawn["face_id"], small_reference(name)["face_id"])


@pytest.mark.parametrize("name", SMALL)
def test_rasterjit_and_opengl_draw_every_scene(name):
    for key in ("rasterjit", "opengl", "lavapipe"):
        assert contestant(key).draws(SMALL[name]) is None


@pytest.mark.parametrize("key", contestants.MODULES)
def test_what_cannot_be_drawn_is_said_in_words(key):
    for scene in SMALL.values():
        reason = contestant(key).draws(scene)
        assert reason is None or " " in reason


@pytest.mark.parametrize(
    "key", sorted(contestants.MODULES.keys() - {"numpy", "pure_python", "full_screen"})
)
def test_a_package_that_is_not_installed_is_named(key, monkeypatch):
    module = importlib.import_module(contestant(key).available.__module__)
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    reason = contestant(key).available()
    assert reason is not None
    assert "is not installed" in reason


def test_more_pixels_than_plain_python_can_visit_are_refused():
    assert "too many" in contestant("pure_python").draws(scenes.find_scene("slivers"))
    assert "too many" in contestant("full_screen").draws(scenes.find_scene("mesh_70k"))


def test_needs_of_scenes():
    assert needs.needs(SMALL["lines"]) == ["lines"]
    assert needs.needs(SMALL["edges"]) == ["edges"]
    assert needs.needs(SMALL["faces of a mesh"]) == ["triangles", "faces"]
    assert needs.needs(SMALL["instances"]) == ["triangles", "colors", "instances"]
    assert needs.needs(SMALL["phong"]) == ["triangles", "lighting"]
    assert needs.needs(SMALL["culled"]) == ["triangles", "colors", "culling"]


def test_edges_are_listed_once():
    edges = screen.find_unique_edges(np.array([(0, 1, 2), (2, 1, 3)], np.int32))
    assert edges.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]


def test_a_painter_draws_far_faces_first_and_of_equal_ones_the_first_last():
    faces = np.array([(0, 1, 2), (3, 4, 5), (0, 2, 1)], np.int32)
    depths = np.array([0.1, 0.1, 0.1, 0.5, 0.5, 0.5])
    assert screen.far_to_near(faces, depths).tolist() == [1, 2, 0]


def test_a_perspective_taken_apart_is_the_same_camera():
    scene = SMALL["instances"]
    intrinsic, extrinsic = open3d_.pinhole(scene.clip_from_model, scene.size)
    point = np.array([0.3, -0.2, 0.1, 1.0])
    clip = scene.clip_from_model @ point
    pixel = intrinsic @ (extrinsic @ point)[:3]
    half = 0.5 * np.array(scene.size)
    np.testing.assert_allclose(pixel[:2] / pixel[2], half * (1 + clip[:2] / clip[3] * (1, -1)))
    np.testing.assert_allclose(trimesh_offscreen.depth_range(scene.clip_from_model), (0.5, 20.0))
