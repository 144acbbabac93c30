"""Small views are drawn several in one go: the same frames, errors and warnings in order."""

from __future__ import annotations

import itertools
import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest
from ways import ALL, around, in_groups, mixed_scene

import rasterjit as rj
from rasterjit.rendering import batch, batch_scheduler, renderer_pool
from rasterjit.rendering.batch import FRAMES_AHEAD_PER_WORKER, check_arguments
from rasterjit.rendering.planning import FrameRequest
from rasterjit.rendering.renderer_pool import LazyFrame
from rasterjit.survey.cache import update_cache

SIZE = (40, 28)
COUNTED = batch_scheduler.COUNTED


@pytest.fixture
def groups(monkeypatch):
    """Return how many views each call drew in a group, and how many of them had no place there."""
    found, draw = [], batch_scheduler.GroupRenderer.draw

    def noted(self, numbers, *arguments):
        outcome = draw(self, numbers, *arguments)
        found.append((len(numbers), int((~outcome.is_drawn).sum())))
        return outcome

    monkeypatch.setattr(batch_scheduler.GroupRenderer, "draw", noted)
    return found


def same(frame, scene, camera, **options):
    """Tell whether a frame is that of one render: arrays, plan and statistics."""
    wanted = rj.render(scene, camera, **options)
    arrays = frame.arrays()
    return (
        list(arrays) == list(wanted.arrays())
        and all(
            arrays[name].dtype == array.dtype and arrays[name].tobytes() == array.tobytes()
            for name, array in wanted.arrays().items()
        )
        and str(frame.plan) == str(wanted.plan)
        and frame.plan.camera == wanted.plan.camera
        and all(getattr(frame.stats, name) == getattr(wanted.stats, name) for name in COUNTED)
    )


@in_groups
@pytest.mark.parametrize(
    ("size", "outputs", "count", "expected"),
    [
        # The first of each thread are drawn alone, and what is left as one.
        ((1, 1), ("color",), 37, [9, 9, 9, 6]),
        ((40, 28), tuple(batch_scheduler.BY_KERNEL), 37, [9, 9, 9, 6]),
        ((40, 28), ("color", "depth"), 150, [32, 32, 32, 32, 18]),
        ((131, 67), tuple(batch_scheduler.BY_KERNEL), 21, [5, 5, 5, 2]),
        ((256, 200), ("color", "uv"), 32, [7, 7, 7, 7]),
        ((256, 200), tuple(batch_scheduler.BY_KERNEL), 12, []),
        ((40, 28), ("color",), 5, []),
        ((40, 28), ("color",), 8, []),
        ((40, 28), ("color",), 9, [2, 2]),
    ],
)
def test_frames_of_groups_are_those_of_render(size, outputs, count, expected, groups):
    scene, cameras = mixed_scene(), around(count)
    options = {"size": size, "outputs": outputs}
    frames = list(rj.render_many(scene, cameras, threads=2, **options))
    assert len(frames) == count
    for frame, camera in zip(frames[::4], cameras[::4], strict=True):
        assert same(frame, scene, camera, **options)
    assert sorted(groups, reverse=True) == [(many, 0) for many in expected]


@in_groups
def test_a_generator_is_asked_no_further_ahead_than_prefetch(groups):
    cameras, asked = around(60), itertools.count()
    counted = (camera for camera in cameras if next(asked) >= 0)
    scene = mixed_scene()
    frames = rj.render_many(scene, counted, size=SIZE, threads=2, prefetch=17)
    for taken, frame in enumerate(frames, 1):
        # What count() shows next is how many were asked for.
        assert int(repr(asked)[6:-1]) - taken < 17
        assert taken % 5 or same(frame, scene, cameras[taken - 1], size=SIZE)
    assert taken == 60
    # Of 17, each of two threads may have two groups of 4.
    assert {many for many, _ in groups[:-1]} == {4}


@in_groups
def test_a_generator_without_prefetch_is_drawn_view_by_view(groups):
    assert len(list(rj.render_many(mixed_scene(), iter(around(30)), size=SIZE, threads=2))) == 30
    assert groups == []


@in_groups
def test_what_has_no_place_in_a_group_is_drawn_alone(groups):
    class Own(rj.PerspectiveCamera):
        """A camera whose depth machine code does not know."""

    scene, cameras = mixed_scene(), around(24)
    cameras[10:24:2] = [Own(one.eye, one.target, fov_y=one.fov_y) for one in cameras[10:24:2]]
    outputs = "color", "depth"
    frames = list(rj.render_many(scene, cameras, size=SIZE, outputs=outputs, threads=1))
    assert all(
        same(frame, scene, camera, size=SIZE, outputs=outputs)
        for frame, camera in zip(frames, cameras, strict=True)
    )
    assert sum(alone for _, alone in groups) == 7
    assert sum(type(frame) is LazyFrame for frame in frames) == 24 - FRAMES_AHEAD_PER_WORKER - 7


@in_groups
@pytest.mark.parametrize("wrong", [5, 12, 29])
@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_names_its_view_and_comes_after_those_before_it(wrong, threads, groups):
    scene, cameras = mixed_scene(), around(30)
    clip = rj.PerspectiveCamera((0, 0, 4), (0, 0, 0)).projection_matrix((8, 8))
    cameras[wrong] = rj.MatrixCamera(cameras[0].view_matrix(), clip, (8, 8))
    with pytest.raises(ValueError, match="size") as alone:
        rj.render(scene, cameras[wrong], size=SIZE)
    frames = rj.render_many(scene, cameras, size=SIZE, threads=threads)
    taken = []
    with pytest.raises(ValueError, match="size") as caught:
        taken.extend(frames)
    assert str(caught.value) == f"cameras[{wrong}]: {alone.value}"
    assert all(
        same(frame, scene, camera, size=SIZE) for frame, camera in zip(taken, cameras, strict=False)
    )
    assert len(taken) == wrong


@in_groups
def test_a_wrong_item_of_a_generator_comes_after_part_of_a_group(groups):
    scene, cameras = mixed_scene(), around(13)
    given = iter([*cameras, "a camera", *cameras])
    frames = rj.render_many(scene, given, size=SIZE, threads=1, prefetch=16)
    for camera in cameras:
        assert same(next(frames), scene, camera, size=SIZE)
    with pytest.raises(ValueError, match=r"^cameras\[13\] must be a PerspectiveCamera"):
        next(frames)
    assert groups


@in_groups
def test_what_fails_in_a_group_alone_is_drawn_alone(monkeypatch):
    def fail(self, *arguments):
        raise MemoryError

    monkeypatch.setattr(batch_scheduler.GroupRenderer, "draw", fail)
    scene, cameras = mixed_scene(), around(20)
    frames = list(rj.render_many(scene, cameras, size=SIZE, threads=2))
    assert all(
        same(frame, scene, camera, size=SIZE) for frame, camera in zip(frames, cameras, strict=True)
    )


@in_groups
def test_a_worker_draws_a_group_larger_than_those_before(groups):
    scene, cameras = mixed_scene(), around(24)
    checked, options = check_arguments(scene, SIZE, None, ("color", "depth"), None, "none")
    pool_worker = renderer_pool.PoolWorker(checked, options, 1)
    for count in (3, 24, 2):
        begun = pool_worker.draw(cameras[:count])
        assert len(begun) == count
        assert all(
            same(one.result, scene, camera, size=SIZE, outputs=options.outputs)
            for one, camera in zip(begun, cameras, strict=False)
        )
    pool_worker.close()
    assert len(groups) == 3


@in_groups
def test_warnings_are_those_of_views_one_by_one(groups):
    scene = mixed_scene()
    away = [replace(one, target=(99.0, 0.0, 0.0)) for one in around(40)]
    cutting = [replace(one, near=3.8) for one in around(40)]
    cameras = [*around(40)[:20], *away[20:30], *cutting[30:]]

    def told(given):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for _ in rj.render_many(scene, given, size=SIZE, threads=1):
                pass
        return [(str(one.message), one.category, one.filename) for one in caught]

    of_groups = told(cameras)
    assert groups
    assert of_groups == told(iter(cameras))
    assert [category for _, category, _ in of_groups] == [rj.ViewWarning] * 2


@in_groups
def test_frames_are_their_own_and_can_be_pickled():
    scene, cameras = mixed_scene(), around(30)
    outputs = "color", "face_id", "barycentric", "position"
    frames = list(rj.render_many(scene, cameras, size=SIZE, outputs=outputs, threads=1))
    last = frames[-1]
    assert type(last) is LazyFrame
    before = frames[-2].color.tobytes()
    last.color[...] = 7
    assert frames[-2].color.tobytes() == before
    assert not any(np.shares_memory(last.color, one.color) for one in frames[:-1])
    sent = pickle.loads(pickle.dumps(last))
    assert str(sent.plan) == str(last.plan)
    assert len(pickle.dumps(last)) < 4 * sum(array.nbytes for array in last.arrays().values())
    # `pick` finds the face.
    wanted = rj.render(scene, cameras[-1], size=SIZE, outputs=outputs)
    assert str(last.pick(20, 14)) == str(wanted.pick(20, 14)) != "None"
    assert last.stats.seconds["all stages"] > 0.0


@in_groups
def test_a_plan_tells_what_was_drawn_though_the_scene_has_changed():
    scene, cameras = mixed_scene(), around(30)
    scene.fog = rj.Fog(density=0.1)
    frames = list(rj.render_many(scene, cameras, size=SIZE, threads=1))
    wanted = str(rj.render(scene, cameras[-1], size=SIZE).plan)
    scene.nodes[0].world_from_model = np.diag((9.0, 9.0, 9.0, 1.0))
    scene.lights.append(rj.PointLight((0, 3, 0)))
    scene.fog = rj.Fog(density=0.3)
    mesh = scene.nodes[2].mesh
    mesh.material = replace(mesh.material, shading="unlit")
    assert str(frames[-1].plan) == wanted


def decided(scene, size=SIZE, threads=1, room=32, **options):
    """Return how many views are drawn in one go."""
    chosen = FrameRequest(
        size, options.get("quality") or rj.Quality.standard(), options.get("outputs", ("color",)),
        options.get("background"), "none",
    )  # fmt: skip
    frame = rj.render(scene, around(1)[0], size=size, **options)
    cache = update_cache(scene.nodes, None, chosen.quality, scene.environment is not None)
    return renderer_pool.views_at_once(frame.plan, scene, cache, chosen, threads, room)


@in_groups
def test_the_rule_says_how_many_are_drawn_in_one_go():
    scene = mixed_scene()
    assert decided(scene) == batch.MAX_VIEWS_PER_GROUP
    assert decided(scene, room=7) == 7
    assert decided(scene, room=-3) == 1
    assert decided(scene, threads=2) == 1
    # Pictures and scenes that are large gain nothing.
    assert decided(scene, (256, 256)) == 26
    assert decided(scene, (512, 512)) == 1
    # No more than there is room for.
    assert decided(scene, (256, 256), outputs=("color", "depth", "normal")) == 6
    # What shares too little.
    assert decided(scene, quality=rj.Quality(samples=64)) == 1
    assert decided(scene, outputs=("color", "coverage")) == 1
    assert decided(scene, background=np.zeros((28, 40, 3), np.uint8)) == 1
    scene.eye_dome = rj.EyeDome()
    assert decided(scene) == 1
    scene.eye_dome, scene.fog = None, rj.Fog(density=0.2)
    assert decided(scene) == batch.MAX_VIEWS_PER_GROUP
    scene.lights = [rj.DirectionalLight(shadow=rj.Shadow(64))]
    assert decided(scene) == batch.MAX_VIEWS_PER_GROUP
    large = rj.Scene()
    large.add(rj.Mesh(np.random.default_rng(0).random((99, 3)), np.zeros((140_000, 3), int)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rj.ViewWarning)
        assert decided(large) == 1


@in_groups
@pytest.mark.parametrize("threads", [1, 2])
def test_effects_are_drawn_view_by_view(threads, groups):
    scene, cameras = mixed_scene(), around(20)
    scene.fog = rj.Fog(density=0.2)
    frames = list(rj.render_many(scene, cameras, size=SIZE, outputs=ALL, threads=threads))
    assert groups == []
    assert all(
        same(frame, scene, camera, size=SIZE, outputs=ALL)
        for frame, camera in zip(frames, cameras, strict=True)
    )
