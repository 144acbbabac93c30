"""What one frame of a renderer leaves for the next is found again, and frames are their own."""

from __future__ import annotations

import dataclasses
import gc
import threading

import numpy as np
import pytest
import ways
from changes import SIZE, changing_scene, material, placed, walk

import rasterjit as rj
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.rendering import resolve_layers
from rasterjit.runtime.threads import FrameCache, Memory, are_same
from rasterjit.scene.camera import near_far
from rasterjit.survey import clip_planes, object_transforms


@pytest.fixture
def scene():
    return changing_scene()


def alone(renderer, scene, camera, **options):
    return ways.lone(scene, camera, size=renderer.size, quality=renderer.quality, **options)


def test_plans_of_frames_stay_as_they_are(scene):
    with rj.Renderer(SIZE, threads=1) as renderer:
        frames = [renderer.render(scene, walk(n)) for n in range(4)]
        for number, frame in enumerate(frames):
            one = alone(renderer, scene, walk(number))
            assert ways.differing(frame, one) == []
            for own, other in zip(frame.plan.lighting[:2], one.plan.lighting[:2], strict=True):
                assert own.tobytes() == other.tobytes()


def test_a_frame_within_a_frame_is_its_own(scene):
    inner = []
    with rj.Renderer(SIZE, threads=1) as renderer:
        renderer.render(scene, walk(0))

        def draw_another():
            renderer.on_picture = None
            inner.append(renderer.render(scene, walk(3)))

        renderer.on_picture = draw_another
        outer = renderer.render(scene, walk(2))
        assert ways.differing(outer, alone(renderer, scene, walk(2))) == []
        assert ways.differing(inner[0], alone(renderer, scene, walk(3))) == []


def test_frames_of_several_threads_are_their_own(scene):
    found = {}
    with rj.Renderer(SIZE, threads=1) as renderer:

        def draw_some(first):
            for number in range(first, first + 8):
                found[number] = renderer.render(scene, walk(number))

        drawing = [threading.Thread(target=draw_some, args=(first,)) for first in (0, 8, 16)]
        for one in drawing:
            one.start()
        for one in drawing:
            one.join()
        for number in range(24):
            assert ways.differing(found[number], alone(renderer, scene, walk(number))) == []


def counted(monkeypatch, module, name):
    """Count the calls of a function."""
    original, calls = getattr(module, name), []

    def count(*arguments, **options):
        calls.append(1)
        return original(*arguments, **options)

    monkeypatch.setattr(module, name, count)
    return calls


def test_stages_and_drawers_are_made_once_for_many_cameras(monkeypatch):
    scene = changing_scene()
    # Light on vertices is found anew for each camera.
    material(scene, 2, shading="phong", alpha_mode="opaque")
    shadings = counted(monkeypatch, resolve_layers, "Shading")
    drawers = counted(monkeypatch, tile_rasterizer, "make_tile_drawer")
    screens = counted(monkeypatch, visibility_pass, "allocate_screen")
    with rj.Renderer.timed(SIZE, rj.Quality(), 1) as renderer:
        for number in range(5):
            # All is in view, and no face is cut.
            eye = 7.0 * np.sin(number), 1.0, 7.0 * np.cos(number)
            renderer.render(scene, rj.PerspectiveCamera(eye, (0.0, 0.0, 0.0)))
            placed(scene, 0, rj.transforms.translate((0.01 * number, 0.0, 0.0)))
        assert len(shadings) == len(screens) == 1
        # Another one if a list of triangles is longer than those before.
        assert len(drawers) <= 3
        material(scene, 0, base_color=(0.0, 1.0, 0.0))
        renderer.render(scene, rj.PerspectiveCamera(eye, (0.0, 0.0, 0.0)))
        assert len(shadings) == 2
        assert len(screens) == 1


def test_large_scenes_leave_nothing(scene, monkeypatch):
    monkeypatch.setattr("rasterjit.rendering.renderer.MAX_CACHED_ELEMENTS", 10)
    screens = counted(monkeypatch, visibility_pass, "allocate_screen")
    with rj.Renderer(SIZE, threads=1) as renderer:
        for number in range(3):
            frame = renderer.render(scene, walk(number))
            assert ways.differing(frame, alone(renderer, scene, walk(number))) == []
            assert not renderer._frame_cache._entries
    assert len(screens) == 6


def test_an_error_leaves_nothing(scene):
    with rj.Renderer(SIZE, threads=1) as renderer:
        renderer.render(scene, walk(1))
        assert renderer._frame_cache._entries
        renderer.on_picture = lambda: 1 / 0
        with pytest.raises(ZeroDivisionError):
            renderer.render(scene, walk(2))
        assert not renderer._frame_cache._entries
        renderer.on_picture = None
        assert (
            ways.differing(renderer.render(scene, walk(2)), alone(renderer, scene, walk(2))) == []
        )


def test_close_lets_go_of_what_is_kept(scene):
    with rj.Renderer(SIZE, threads=1) as renderer:
        first = renderer.render(scene, walk(1))
        assert renderer._frame_cache._entries
        renderer.close()
        assert not renderer._frame_cache._entries
        assert ways.differing(renderer.render(scene, walk(1)), first) == []


# --- the parts ------------------------------------------------------------------------------------


def test_things_are_the_same_if_they_are_one_or_plain_and_equal():
    one, other = np.zeros(2), np.zeros(2)
    record = visibility_pass.Region(1, 2, 3, 4)
    assert are_same((one, 1, "a", (one, None)), (one, 1, "a", (one, None)))
    assert are_same(record, visibility_pass.Region(1, 2, 3, 4))
    assert are_same(0.5, 0.5)
    assert not are_same(one, other)
    assert not are_same((one,), (one, one))
    assert not are_same((1,), (True,))
    assert not are_same(0.0, -0.0)
    assert not are_same(record, (1, 2, 3, 4))
    assert not are_same([1], [1])


def test_what_is_made_is_kept_as_long_as_its_parts():
    frame_cache, calls = FrameCache(Memory()), []
    part = np.zeros(3)

    def make(*parts):
        calls.append(parts)
        return [*parts]

    first = frame_cache.get_or_make("a", make, part, 1)
    assert frame_cache.get_or_make("a", make, part, 1) is first
    assert frame_cache.get_or_make("a", make, part, 2) is not first
    assert frame_cache.get_or_make("b", make, part, 2) is not frame_cache.get_or_make(
        "a", make, part, 2
    )
    assert len(calls) == 3
    frame_cache.clear()
    frame_cache.get_or_make("a", make, part, 2)
    assert len(calls) == 4


def test_arrays_are_kept_at_their_places():
    frame_cache = FrameCache(Memory())
    array = frame_cache.get_or_allocate("a", (3, 4), np.int32)
    assert frame_cache.get_or_allocate("a", (3, 4), np.int32) is array
    assert frame_cache.get_or_allocate("a", (4, 3), np.int32).shape == (4, 3)
    assert frame_cache.get_or_allocate("a", (4, 3), np.float32).dtype == np.float32
    long = frame_cache.get_or_allocate_at_least("b", 10, np.int32)
    assert frame_cache.get_or_allocate_at_least("b", 4, np.int32) is long
    assert len(frame_cache.get_or_allocate_at_least("b", 11, np.int32)) >= 11
    values = np.arange(12.0).reshape(3, 4)[:, ::2]
    copy = frame_cache.copy_into("c", values)
    assert copy.flags.c_contiguous
    assert frame_cache.copy_into("c", values + 1.0) is copy
    assert np.array_equal(copy, values + 1.0)
    assert frame_cache.copy_into("c", values, np.float32).dtype == np.float32


def test_nothing_is_kept_where_nothing_lasts():
    frame_cache = FrameCache(Memory(), is_enabled=False)
    assert frame_cache.get_or_allocate("a", (3,), np.int32) is not frame_cache.get_or_allocate(
        "a", (3,), np.int32
    )
    assert frame_cache.get_or_make("b", list) is not frame_cache.get_or_make("b", list)
    assert frame_cache.copy_into("c", np.ones(2)) is not frame_cache.copy_into("c", np.ones(2))


def random_boxes(rng):
    """Return boxes around some objects, some of them around nothing, and the camera's views."""
    count = int(rng.integers(1, 9))
    bounds = np.sort(rng.normal(size=(count, 2, 3)), axis=1)
    bounds[rng.integers(6, size=count) == 0] = np.nan
    matrices = [np.eye(4) for _ in range(count)]
    for matrix in matrices:
        matrix[:3] = rng.normal(size=(3, 4))
        matrix[:3, 3] *= 3.0
    camera = rj.PerspectiveCamera(rng.normal(size=3) * 9.0, rng.normal(size=3))
    if rng.integers(2):
        camera = rj.OrthographicCamera(camera.eye, camera.target, height=8.0, near=-3.0)
    places = object_transforms.transform_objects(matrices)
    views = object_transforms.transform_to_view(places, camera, SIZE)

    def boxes():
        return object_transforms.Boxes(
            bounds, camera.eye_position(), views.relative_from_model, views.clip_from_relative
        )

    return camera, views, boxes


def test_no_corner_in_view_is_beyond_what_is_found_fast():
    rng, sure = np.random.default_rng(7), 0
    for _ in range(300):
        camera, views, boxes = random_boxes(rng)
        own = boxes()
        corners = own.corners[own.is_known].reshape(-1, 3)
        if not len(corners):
            continue
        w = corners @ views.clip_from_relative[3, :3] + views.clip_from_relative[3, 3]
        assert np.abs(w).max() <= own.estimate_max_w()
        row = [*(-camera.view_matrix()[2, :3]).tolist(), 0.0]
        depths = corners @ row[:3]
        middle, half = (depths.max() + depths.min()) / 2.0, np.ptp(depths) / 2.0
        for wider in (0.0, 0.9, 1.0 + 1e-6, 4.0):
            near, far = middle - wider * half, middle + wider * half
            if own.are_between(row, near, far):
                assert near <= depths.min() <= depths.max() <= far
                sure += 1
    assert sure > 200


def test_planes_are_looked_at_with_the_same_result_at_once_or_box_by_box(scene, monkeypatch):
    rng, found = np.random.default_rng(9), []
    cache = object_transforms.transform_objects([node.world_from_model for node in scene.nodes])
    bounds = object_transforms.compute_mesh_boxes([node.mesh for node in scene.nodes])
    for _ in range(150):
        camera = rj.PerspectiveCamera(rng.normal(size=3) * 4.0, rng.normal(size=3))
        if rng.integers(3) == 0:
            near, far = np.sort(rng.uniform(0.1, 12.0, 2)).tolist()
            camera = dataclasses.replace(camera, near=near, far=far + 1.0)
        views = object_transforms.transform_to_view(cache, camera, SIZE)
        boxes = object_transforms.Boxes(
            bounds, camera.eye_position(),
            views.relative_from_model, views.clip_from_relative,
        )  # fmt: skip
        known = boxes, scene.nodes, views.clip_from_relative, rj.Quality.standard()
        at_once = clip_planes.find_plane_needs(camera, *known)
        monkeypatch.setattr(object_transforms.Boxes, "are_between", lambda *_: False)
        assert clip_planes.find_plane_needs(camera, *known) == at_once
        monkeypatch.undo()
        planes = near_far(camera)
        row = [*(-camera.view_matrix()[2, :3]).tolist(), 0.0]
        found.append(boxes.are_between(row, planes.near, planes.far))
    assert 20 < sum(found) < 130


def test_projections_that_are_remembered_are_those_of_the_camera():
    rng = np.random.default_rng(2)
    places = object_transforms.transform_objects([np.eye(4)])
    for _ in range(40):
        camera = rj.PerspectiveCamera(
            rng.normal(size=3), rng.normal(size=3), fov_y=float(rng.choice([20.0, 45.0, 90.0])),
            near=rng.choice([None, 0.1, 0.5]), far=float(rng.choice([np.inf, 9.0])),
            min_aspect=float(rng.choice([0.0, 1.0, 2.0])),
        )  # fmt: skip
        size = (int(rng.integers(1, 4)) * 20, 30)
        # What is known by its matrices alone is worked out each time.
        plain = rj.MatrixCamera(camera.view_matrix(), camera.projection_matrix(size))
        views, wanted = (
            object_transforms.transform_to_view(places, each, size) for each in (camera, plain)
        )
        assert views.screen_winding == wanted.screen_winding
        assert np.allclose(views.clip_from_relative, wanted.clip_from_relative, 1e-12, 1e-12)


def test_frames_leave_nothing_for_the_garbage_collector():
    scene = changing_scene()
    cameras = [rj.fit_camera(scene, rj.orbit_direction(angle, 20.0)) for angle in (0.0, 40.0, 80.0)]
    with rj.Renderer(SIZE, threads=1) as renderer:
        renderer.render(scene, cameras[0])
        gc.collect()
        gc.disable()
        try:
            left = []
            for _ in range(3):
                for camera in cameras:
                    renderer.render(scene, camera)
                left.append(gc.collect())
            # Another thread of the process may leave something now and then.
            assert min(left) < len(cameras)
        finally:
            gc.enable()
