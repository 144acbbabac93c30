"""What batches keep from one call to the next: never a stale picture, and none of it for long."""

from __future__ import annotations

import gc
import threading
import weakref
from dataclasses import replace

import numpy as np
import pytest
from batches import MODELS, SIZE, around, check, in_groups, mixed_scene

import rasterjit as rj
from rasterjit.rendering import kept, together


@pytest.fixture(autouse=True)
def shelf(monkeypatch):
    """Return a shelf on which nothing lies yet."""
    own = kept.Shelf()
    monkeypatch.setattr("rasterjit.rendering.batch.SHELF", own)
    return own


@pytest.fixture
def scene():
    """Return three objects: smooth, with colours of vertices, and with a texture."""
    return mixed_scene()


@pytest.fixture
def made(monkeypatch):
    """Return the plans that memory is made for."""
    plans, make = [], together.Desk.__init__

    def noted(self, plan, *others):
        plans.append(plan)
        make(self, plan, *others)

    monkeypatch.setattr(together.Desk, "__init__", noted)
    return plans


def recolored(mesh, color):
    return replace(mesh.material, base_color=color, base_color_texture=None)


def give(scene, **fields):
    for name, value in fields.items():
        setattr(scene, name, value)


CHANGES = {
    "nothing": lambda scene: None,
    "an object stands elsewhere": lambda scene: give(
        scene.nodes[0], world_from_model=rj.transforms.scale((0.7, 0.2, 0.5))
    ),
    "an object is mirrored": lambda scene: give(
        scene.nodes[1], world_from_model=rj.transforms.scale((-1.0, 1.0, 1.0))
    ),
    "another material": lambda scene: give(
        scene.nodes[2].mesh, material=recolored(scene.nodes[2].mesh, (0.1, 0.9, 0.2))
    ),
    "another shading": lambda scene: give(
        scene.nodes[0].mesh, material=rj.Material("gouraud", "purple", specular=0.7)
    ),
    "one side alone": lambda scene: give(
        scene.nodes[1].mesh, material=replace(scene.nodes[1].mesh.material, double_sided=False)
    ),
    "another mesh": lambda scene: give(
        scene.nodes[1], mesh=rj.load(MODELS / "teapot.obj").nodes[0].mesh
    ),
    "an object more": lambda scene: scene.add(
        scene.nodes[0].mesh, rj.transforms.translate((0.0, 1.0, 0.0))
    ),
    "an object less": lambda scene: scene.remove(scene.nodes[-1]),
    "a light": lambda scene: scene.lights.append(rj.DirectionalLight((1, -2, -1), "red")),
    "another light": lambda scene: scene.lights.__setitem__(0, rj.PointLight((0, 3, 1), "blue")),
    "the light stands elsewhere": lambda scene: scene.lights.__setitem__(
        0, rj.PointLight((0, -3, 1), "blue")
    ),
    "ambient light": lambda scene: scene.lights.append(rj.AmbientLight(intensity=0.3)),
    "more ambient light": lambda scene: scene.lights.__setitem__(1, rj.AmbientLight()),
    "a tone curve": lambda scene: give(scene, tone_map=rj.ToneMap("neutral", 0.5)),
    "another tone curve": lambda scene: give(scene, tone_map=rj.ToneMap("reinhard", 0.9)),
    "fog": lambda scene: give(scene, fog=rj.Fog(density=0.2, mode="exp")),
    "fog by height": lambda scene: give(
        scene, fog=rj.Fog("gray", density=0.3, mode="exp", height=0.2, falloff=0.5)
    ),
    "fog that begins at a distance": lambda scene: give(
        scene, fog=rj.Fog("red", mode="linear", start=4.2, end=9.0)
    ),
    "an environment": lambda scene: give(scene, environment=rj.Environment.gradient()),
    "a brighter one": lambda scene: give(
        scene, environment=replace(scene.environment, intensity=2.0)
    ),
    "one that is not seen": lambda scene: give(
        scene, environment=replace(scene.environment, background=False)
    ),
    "a vignette": lambda scene: give(scene, vignette=rj.Vignette()),
    "a weaker vignette": lambda scene: give(scene, vignette=rj.Vignette(0.2)),
    "a section": lambda scene: give(
        scene, section=rj.SectionPlane((0.1, 0.0, 0.0), (1.0, 0.2, 0.1), cap=False)
    ),
    "another section": lambda scene: give(
        scene, section=rj.SectionPlane((0.2, 0.0, 0.0), (1.0, 0.2, 0.1), cap=False)
    ),
    "no section": lambda scene: give(scene, section=None),
    "a cone": lambda scene: scene.lights.append(rj.SpotLight((-1.2, 4, -1), (0, -1, 0))),
    "a narrower cone": lambda scene: scene.lights.__setitem__(
        -1, rj.SpotLight((-1.2, 4, -1), (0, -1, 0), outer_angle=9.0)
    ),
    "no environment": lambda scene: give(scene, environment=None, vignette=None),
    "no fog": lambda scene: give(scene, fog=None, tone_map=None),
    "no lights": lambda scene: scene.lights.clear(),
}


def test_a_scene_that_is_changed_is_drawn_as_it_is(scene):
    for name, change in CHANGES.items():
        change(scene)
        for _ in range(2):
            try:
                check(scene, around(4), outputs=("color", "normal", "depth"), threads=2)
            except AssertionError as error:
                raise AssertionError(name) from error


@in_groups
def test_settings_that_change_are_those_of_the_call(scene, made):
    for options in (
        {"background": "red"},
        {"background": "blue"},
        {"quality": rj.Quality.draft()},
        {"quality": rj.Quality(precision="float32")},
        {"cull": "back"},
        {"cull": "front"},
        {"size": (33, 57)},
        {"outputs": ("depth", "object_id", "distance")},
        {"outputs": ("linear", "attribute:heat")},
        {"outputs": ("linear",)},
        {"threads": 1},
    ):
        if "attribute:heat" in options.get("outputs", ()):
            for node in scene.nodes:
                mesh = node.mesh
                heat = np.random.default_rng(3).random((len(mesh.vertices), 2))
                node.mesh = rj.Mesh(mesh.vertices, mesh.faces, attributes={"heat": heat})
        check(scene, around(5), **options)
        check(scene, around(3), **options)


@in_groups
def test_what_is_the_same_is_prepared_once(scene, made):
    for turn in range(4):
        scene.nodes[0].world_from_model = rj.transforms.rotate_y(10.0 * turn)
        check(scene, around(2 + turn), outputs=("color", "depth"), threads=1)
    assert len(made) == 1
    # Another set of objects in view may be of the same kind.
    scene.add(scene.nodes[0].mesh, rj.transforms.translate((0.0, 90.0, 0.0)))
    up = rj.PerspectiveCamera((0.0, 80.0, 0.1), (0.0, 90.0, 0.0))
    down = rj.PerspectiveCamera((0.0, 80.0, 0.1), (0.0, 0.0, 0.0))
    check(scene, [up, down], outputs=("color", "depth"), threads=1)
    count = len(made)
    for cameras in ([up], [down], [down, up]):
        check(scene, cameras, outputs=("color", "depth"), threads=1)
    assert len(made) == count


@in_groups
def test_a_lone_mesh_is_not_kept(shelf):
    mesh = rj.load(MODELS / "torus_knot.obj").nodes[0].mesh
    rj.render_batch(mesh, around(2, 12.0), size=SIZE, threads=1)
    assert not shelf._kept
    mesh = weakref.ref(mesh)
    gc.collect()
    assert mesh() is None


@in_groups
def test_what_is_kept_goes_with_the_scene(shelf):
    scene = mixed_scene()
    out = {"color": np.zeros((3, SIZE[1], SIZE[0], 4), np.uint8)}
    rj.render_batch(scene, around(3), size=SIZE, out=out)
    assert len(shelf._kept) == 1
    pixels = weakref.ref(out.pop("color"))
    gc.collect()
    assert pixels() is None
    del scene
    gc.collect()
    assert not shelf._kept


@in_groups
def test_of_many_scenes_the_last_are_kept(shelf, monkeypatch):
    monkeypatch.setattr(kept, "MOST_KEPT", 3 << 20)
    scenes = [mixed_scene() for _ in range(9)]
    for scene in scenes:
        rj.render_batch(scene, around(2), size=SIZE, threads=1)
    assert 0 < len(shelf._kept) < 9
    assert id(scenes[-1]) in shelf._kept
    large = mixed_scene()
    rj.render_batch(large, around(1), size=(600, 600), threads=1)
    assert id(large) not in shelf._kept


@in_groups
def test_memory_of_all_threads_is_bounded(scene, made, monkeypatch):
    monkeypatch.setattr(kept, "MOST_BYTES", 1 << 10)
    check(scene, around(4), threads=2)
    assert made == []


def test_threads_draw_one_scene_at_the_same_time(scene):
    cameras = around(12)
    wanted = rj.render_batch(scene, cameras, size=SIZE).color
    found = []

    def draw():
        found.extend(rj.render_batch(scene, cameras, size=SIZE, threads=1).color for _ in range(5))

    threads = [threading.Thread(target=draw) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 15
    assert all(one.tobytes() == wanted.tobytes() for one in found)
