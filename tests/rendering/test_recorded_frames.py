"""Small frames of a renderer, drawn by bound calls, have the bits and counts of lone ones."""

from __future__ import annotations

import dataclasses
import gc
import threading
import weakref

import numpy as np
import pytest
import ways

import rasterjit as rj
from rasterjit.rendering import recorded_frames
from rasterjit.rendering.command_buffer import CommandBuffer

pytestmark = ways.in_groups

SIZE = (60, 44)
OUTPUTS = ("color", "linear", "depth", "distance", "position", "normal", "object_id", "face_id")


@pytest.fixture
def draws(monkeypatch):
    """The frames that bound calls drew: whether each fitted in its memory."""
    fits, draw = [], CommandBuffer.draw_one

    def noted(commands, *values):
        totals = draw(commands, *values)
        fits.append(totals is not None)
        return totals

    monkeypatch.setattr(CommandBuffer, "draw_one", noted)
    return fits


def same(frame, other):
    """Tell whether two frames of one view are the same, but for their times."""
    return ways.differing(frame, other) == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fog", rj.Fog("grey", density=0.1, mode="exp", height=0.5, falloff=0.3)),
        ("environment", rj.Environment.gradient()),
        ("tone_map", rj.ToneMap(exposure=0.5)),
        ("lights", [rj.PointLight((1.0, 3.0, 2.0), intensity=20.0), rj.DirectionalLight()]),
        ("vignette", rj.Vignette()),
        ("lights", [rj.PointLight((1.0, 3.0, 2.0), intensity=20.0, shadow=rj.Shadow(64))]),
    ],
)
def test_the_third_of_small_frames_is_drawn_by_bound_calls(draws, name, value):
    scene = ways.mixed_scene()
    setattr(scene, name, value)
    with rj.Renderer(SIZE, threads=1) as renderer:
        for camera in ways.around(4):
            renderer.render(scene, camera, outputs=OUTPUTS)
    assert draws == [True] * 2


@pytest.mark.parametrize("kind", ["plain", "glass", "lights"])
@pytest.mark.parametrize("quality", [{}, {"samples": 4}, {"interpolation": "affine"}])
def test_recorded_frames_of_moving_objects_are_lone_ones(draws, kind, quality):
    scene, settings = ways.mixed_scene(), rj.Quality(**quality)
    if kind == "glass":
        mesh = scene.nodes[0].mesh
        blended = {"alpha_mode": "blend", "base_color": (1.0, 0.0, 0.0, 0.5)}
        mesh.material = dataclasses.replace(mesh.material, **blended)
    elif kind == "lights":
        scene.lights = [rj.PointLight((1.0, 3.0, 2.0), intensity=20.0), rj.DirectionalLight()]
        scene.tone_map, scene.vignette = rj.ToneMap(exposure=0.5), rj.Vignette()
    with rj.Renderer(SIZE, quality=settings, threads=1) as renderer:
        for n, camera in enumerate(ways.around(5)):
            scene.nodes[1].world_from_model = rj.transforms.translate((0.1 * n, 0.0, -0.1 * n))
            frame = renderer.render(scene, camera, outputs=OUTPUTS)
            lone = rj.render(scene, camera, size=SIZE, quality=settings, outputs=OUTPUTS)
            assert same(frame, lone), n
    # Transparent faces at several samples are mixed step by step.
    assert (len(draws) == 3) == (kind != "glass" or settings.samples == 1)


def test_each_kind_of_camera_has_its_own_depth(draws):
    scene = ways.mixed_scene()
    pinhole = rj.MatrixCamera.from_intrinsics(40.0, 40.0, 30.0, 22.0, SIZE)
    flat = rj.OrthographicCamera(eye=(0.0, 0.5, 4.0), target=(0.0, 0.0, 0.0), height=3.0)
    for camera in (ways.CAMERA, flat, pinhole):
        with rj.Renderer(SIZE, threads=1) as renderer:
            frames = [renderer.render(scene, camera, outputs=OUTPUTS) for _ in range(4)]
        lone = rj.render(scene, camera, size=SIZE, outputs=OUTPUTS, threads=1)
        assert all(same(frame, lone) for frame in frames)
    assert len(draws) == 6


def test_frames_that_do_not_fit_are_drawn_step_by_step(draws, monkeypatch):
    monkeypatch.setattr("rasterjit.rendering.command_buffer.clip_capacity", lambda faces: (1, 8))
    scene = ways.mixed_scene()
    inside = rj.PerspectiveCamera((0.0, 0.1, 0.3), (0.0, 0.0, -1.0), fov_y=110.0, near=0.25)
    with rj.Renderer(SIZE, threads=1) as renderer:
        frames = [renderer.render(scene, inside, outputs=OUTPUTS) for _ in range(5)]
    assert frames[0].stats.clipped > 1
    assert draws == [False]
    assert all(same(frame, frames[0]) for frame in frames)


def test_arrays_are_the_frames_own(draws):
    scene, (first, *others) = ways.mixed_scene(), ways.around(6)
    with rj.Renderer(SIZE, threads=1) as renderer:
        for _ in range(3):
            kept = renderer.render(scene, first)
        before = kept.color.copy()
        for camera in others:
            renderer.render(scene, camera).color[:] = 7
    assert len(draws) == 6
    assert np.array_equal(kept.color, before)


def test_large_and_watched_frames_are_drawn_step_by_step(draws, monkeypatch):
    scene, pictures = ways.mixed_scene(), []
    with rj.Renderer((300, 300), threads=1) as large, rj.Renderer(SIZE, threads=1) as watched:
        watched.on_picture = lambda: pictures.append(1)
        for _ in range(4):
            large.render(scene, ways.CAMERA)
            watched.render(scene, ways.CAMERA)
    monkeypatch.setattr(recorded_frames, "MAX_BYTES", 10_000)
    with rj.Renderer(SIZE, threads=1) as poor:
        for _ in range(4):
            poor.render(scene, ways.CAMERA)
    assert not draws
    assert len(pictures) == 4


def test_threads_that_share_a_renderer_have_frames_of_their_own(draws):
    scene, cameras, found = ways.mixed_scene(), ways.around(40), {}
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


@pytest.mark.parametrize("place", ["find_array_spec", "CommandBuffer"])
def test_a_renderer_that_is_closed_while_it_draws_keeps_nothing(monkeypatch, place):
    renderer, scene = rj.Renderer(SIZE, threads=1), ways.mixed_scene()
    original = getattr(recorded_frames, place)

    def closing(*arguments):
        renderer.close()
        return original(*arguments)

    renderer.render(scene, ways.CAMERA)
    monkeypatch.setattr(recorded_frames, place, closing)
    frames = [renderer.render(scene, ways.CAMERA) for _ in range(2)]
    assert renderer._recorded_frames._commands is None or place == "find_array_spec"
    monkeypatch.undo()
    assert all(same(frame, renderer.render(scene, ways.CAMERA)) for frame in frames)


def test_scenes_are_let_go_that_nobody_draws_any_more():
    camera, scene = ways.CAMERA, ways.mixed_scene()
    with rj.Renderer(SIZE, threads=1) as renderer:
        for _ in range(4):
            renderer.render(scene, camera)
        gone = weakref.ref(scene)
        del scene
        gc.collect()
        assert gone() is None
        renderer.size = (400, 400)
        renderer.render(ways.mixed_scene(), camera)
        assert renderer._recorded_frames._commands is None
