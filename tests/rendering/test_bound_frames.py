"""Small frames of a renderer, drawn by bound calls, have the bits and counts of lone ones."""

from __future__ import annotations

import dataclasses
import gc
import threading
import weakref

import batches
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.rendering import bound_frames
from rasterjit.rendering.desk import Desk

pytestmark = batches.in_groups

SIZE = (60, 44)
OUTPUTS = ("color", "linear", "depth", "distance", "position", "normal", "object_id", "face_id")
QUALITIES = {
    "": {}, "samples": {"samples": 4}, "rounded": {"interpolation": "affine"},
}  # fmt: skip


@pytest.fixture
def draws(monkeypatch):
    """The frames that bound calls drew: whether each fitted in its memory."""
    fits, draw = [], Desk.draw_one

    def noted(desk, values):
        totals = draw(desk, values)
        fits.append(totals is not None)
        return totals

    monkeypatch.setattr(Desk, "draw_one", noted)
    return fits


def scene_of(kind):
    """Return a scene of three objects with effects that bound frames may have."""
    scene = batches.mixed_scene()
    if kind == "fog and sky":
        scene.fog = rj.Fog("grey", density=0.1, mode="exp", height=0.5, falloff=0.3)
        scene.environment = rj.Environment.gradient()
    elif kind == "glass":
        mesh = scene.nodes[0].mesh
        mesh.material = dataclasses.replace(
            mesh.material, alpha_mode="blend", base_color=(1.0, 0.0, 0.0, 0.5)
        )
    elif kind == "lights":
        scene.lights = [rj.PointLight((1.0, 3.0, 2.0), intensity=20.0), rj.DirectionalLight()]
        scene.tone_map, scene.vignette = rj.ToneMap(exposure=0.5), rj.Vignette()
    return scene


def same(frame, other):
    """Tell whether two frames have the same arrays, counts and share of white."""
    counts = [
        dataclasses.replace(one.stats, seconds={}, face_id=one.stats.pixels_covered)
        for one in (frame, other)
    ]
    arrays = {name: array.tobytes() for name, array in other.arrays().items()}
    return (
        {name: array.tobytes() for name, array in frame.arrays().items()} == arrays
        and counts[0] == counts[1]
        and frame._white_share == other._white_share
    )


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("kind", ["plain", "fog and sky", "glass", "lights"])
def test_bound_frames_are_lone_ones(draws, kind, quality):
    scene, options = scene_of(kind), {"outputs": OUTPUTS}
    settings = rj.Quality(**QUALITIES[quality])
    cameras = [*batches.around(5), *batches.around(5, 0.7)]
    with rj.Renderer(SIZE, quality=settings, threads=1) as renderer:
        for n, camera in enumerate(cameras):
            # What moves, and what changes what is drawn.
            scene.nodes[1].world_from_model = rj.transforms.translate((0.1 * n, 0.0, -0.1 * n))
            options["background"] = "red" if n > 7 else None
            frame = renderer.render(scene, camera, **options)
            lone = rj.render(scene, camera, size=SIZE, quality=settings, threads=1, **options)
            assert same(frame, lone), n
    can_be = kind != "glass" or quality != "samples"
    assert (len(draws) >= 2) == can_be


def test_each_camera_has_its_own_depth(draws):
    scene = batches.mixed_scene()
    pinhole = rj.MatrixCamera.from_intrinsics(40.0, 40.0, 30.0, 22.0, SIZE)
    flat = rj.OrthographicCamera(eye=(0.0, 0.5, 4.0), target=(0.0, 0.0, 0.0), height=3.0)
    for camera in (batches.CAMERA, flat, pinhole):
        with rj.Renderer(SIZE, threads=1) as renderer:
            frames = [renderer.render(scene, camera, outputs=OUTPUTS) for _ in range(4)]
        lone = rj.render(scene, camera, size=SIZE, outputs=OUTPUTS, threads=1)
        assert all(same(frame, lone) for frame in frames)
    assert len(draws) == 6


def test_frames_that_do_not_fit_are_drawn_step_by_step(draws, monkeypatch):
    monkeypatch.setattr("rasterjit.rendering.desk.room_to_cut", lambda faces: (1, 8))
    scene = batches.mixed_scene()
    inside = rj.PerspectiveCamera((0.0, 0.1, 0.3), (0.0, 0.0, -1.0), fov_y=110.0, near=0.25)
    with rj.Renderer(SIZE, threads=1) as renderer:
        frames = [renderer.render(scene, inside, outputs=OUTPUTS) for _ in range(5)]
    assert frames[0].stats.clipped > 1
    assert draws == [False]
    assert all(same(frame, frames[0]) for frame in frames)


def test_arrays_are_the_frames_own(draws):
    scene, (first, *others) = batches.mixed_scene(), batches.around(6)
    with rj.Renderer(SIZE, threads=1) as renderer:
        for _ in range(3):
            kept = renderer.render(scene, first)
        before = kept.color.copy()
        for camera in others:
            renderer.render(scene, camera).color[:] = 7
    assert len(draws) == 6
    assert np.array_equal(kept.color, before)


def test_large_and_watched_frames_are_drawn_step_by_step(draws, monkeypatch):
    scene, pictures = batches.mixed_scene(), []
    with rj.Renderer((300, 300), threads=1) as large, rj.Renderer(SIZE, threads=1) as watched:
        watched.on_picture = lambda: pictures.append(1)
        for _ in range(4):
            large.render(scene, batches.CAMERA)
            watched.render(scene, batches.CAMERA)
    monkeypatch.setattr(bound_frames, "MOST_MEMORY", 10_000)
    with rj.Renderer(SIZE, threads=1) as poor:
        for _ in range(4):
            poor.render(scene, batches.CAMERA)
    assert not draws
    assert len(pictures) == 4


def test_threads_that_share_a_renderer_have_frames_of_their_own(draws):
    scene, cameras, found = batches.mixed_scene(), batches.around(40), {}
    lone = [rj.render(scene, camera, size=SIZE, threads=1) for camera in cameras]
    with rj.Renderer(SIZE, threads=1) as renderer:

        def some(first):
            for n in range(first, len(cameras), 3):
                found[n] = renderer.render(scene, cameras[n])

        threads = [threading.Thread(target=some, args=(first,)) for first in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert all(same(found[n], frame) for n, frame in enumerate(lone))
    assert draws


CHANGES = {
    "diagnose": {"diagnose": True}, "cull": {"cull": "back"}, "background": {"background": "red"},
    "outputs": {"outputs": ("color", "uv")},
}  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_asked_for_later_is_not_missing(draws, change):
    scene, camera = batches.mixed_scene(), batches.CAMERA
    with rj.Renderer(SIZE, threads=1) as renderer:
        for _ in range(4):
            renderer.render(scene, camera)
        assert draws == [True] * 2
        frame = renderer.render(scene, camera, **CHANGES[change])
    lone = rj.render(scene, camera, size=SIZE, threads=1, **CHANGES[change])
    assert same(frame, lone)
    assert hasattr(frame, "diagnostics") == (change == "diagnose")


@pytest.mark.parametrize("place", ["shape_of", "Desk"])
def test_a_renderer_that_is_closed_while_it_draws_keeps_nothing(monkeypatch, place):
    renderer, scene = rj.Renderer(SIZE, threads=1), batches.mixed_scene()
    original = getattr(bound_frames, place)

    def closing(*arguments):
        renderer.close()
        return original(*arguments)

    renderer.render(scene, batches.CAMERA)
    monkeypatch.setattr(bound_frames, place, closing)
    frames = [renderer.render(scene, batches.CAMERA) for _ in range(2)]
    assert renderer._bound._desk is None or place == "shape_of"
    monkeypatch.undo()
    assert all(same(frame, renderer.render(scene, batches.CAMERA)) for frame in frames)


def test_scenes_are_let_go_that_nobody_draws_any_more():
    camera, scene = batches.CAMERA, batches.mixed_scene()
    with rj.Renderer(SIZE, threads=1) as renderer:
        for _ in range(4):
            renderer.render(scene, camera)
        gone = weakref.ref(scene)
        del scene
        gc.collect()
        assert gone() is None
        renderer.size = (400, 400)
        renderer.render(batches.mixed_scene(), camera)
        assert renderer._bound._desk is None
