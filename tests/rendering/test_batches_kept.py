"""What batches keep from one call to the next: never a stale picture, and none of it for long."""

from __future__ import annotations

import copy
import gc
import threading
import weakref

import numpy as np
import pytest
from ways import MODELS, SIZE, around, check, in_groups, mixed_scene

import rasterjit as rj
from rasterjit.rendering import batch_scheduler


@pytest.fixture(autouse=True)
def shelf(monkeypatch):
    """Return a shelf on which nothing lies yet."""
    own = batch_scheduler.BatchCaches()
    monkeypatch.setattr("rasterjit.rendering.batch.BATCH_CACHES", own)
    return own


@pytest.fixture
def scene():
    """Return three objects: smooth, with colours of vertices, and with a texture."""
    return mixed_scene()


@pytest.fixture
def made(monkeypatch):
    """Return the plans that memory is made for."""
    plans, make = [], batch_scheduler.CommandBuffer.__init__

    def noted(self, plan, *others):
        plans.append(plan)
        make(self, plan, *others)

    monkeypatch.setattr(batch_scheduler.CommandBuffer, "__init__", noted)
    return plans


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
def test_what_is_kept_goes_with_a_lone_mesh(shelf, made):
    mesh = rj.load(MODELS / "torus_knot.obj").nodes[0].mesh

    def draw(one):
        return rj.render_batch(one, around(2, 12.0), size=SIZE, threads=1).color.tolist()

    for count, color in enumerate(("red", "blue"), 1):
        mesh.material = rj.Material(base_color=color)
        assert draw(mesh) == draw(mesh)
        assert (len(shelf._caches), len(made)) == (1, count)
    assert draw(mesh) == draw(copy.copy(mesh))
    gone = weakref.ref(mesh)
    gc.disable()
    del mesh
    gc.enable()
    assert gone() is None
    assert not shelf._caches


@in_groups
def test_what_is_kept_goes_with_the_scene(shelf):
    scene = mixed_scene()
    out = {"color": np.zeros((3, SIZE[1], SIZE[0], 4), np.uint8)}
    rj.render_batch(scene, around(3), size=SIZE, out=out)
    assert len(shelf._caches) == 1
    pixels = weakref.ref(out.pop("color"))
    gc.collect()
    assert pixels() is None
    del scene
    gc.collect()
    assert not shelf._caches


@in_groups
def test_of_many_scenes_the_last_are_kept(shelf, monkeypatch):
    monkeypatch.setattr(batch_scheduler, "MAX_CACHED_BYTES", 3 << 20)
    scenes = [mixed_scene() for _ in range(9)]
    for scene in scenes:
        rj.render_batch(scene, around(2), size=SIZE, threads=1)
    assert 0 < len(shelf._caches) < 9
    assert scenes[-1] in shelf._caches
    large = mixed_scene()
    rj.render_batch(large, around(2), size=(600, 600), threads=1)
    assert large not in shelf._caches


@in_groups
def test_batches_of_one_view_are_drawn_by_calls_that_are_kept(shelf, scene):
    for camera in around(5):
        check(scene, [camera])
    (kept,) = shelf._caches.values()
    assert 0 < kept.renderer.cached_bytes == kept.size


def test_what_frames_of_one_view_reuse_is_counted(shelf, scene):
    for _ in range(2):
        rj.render_batch(scene, around(1), size=(320, 240), threads=1)
    assert shelf.acquire(scene).size >= 320 * 240 * np.dtype(np.int32).itemsize


@in_groups
def test_memory_of_all_threads_is_bounded(scene, made, monkeypatch):
    monkeypatch.setattr(batch_scheduler, "MAX_COMMAND_BYTES", 1 << 10)
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
