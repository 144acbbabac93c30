"""A frame that follows another is that of a fresh renderer, whatever has changed: the one law."""

from __future__ import annotations

import warnings
from contextlib import ExitStack, contextmanager
from dataclasses import replace

import numpy as np
import pytest
import ways
from changes import CHANGES, EFFECTS, FAR_OFF, SIZE, Asked, changing_scene, placed, walk

import rasterjit as rj
from rasterjit.rendering import batch_scheduler

pytestmark = pytest.mark.needs_jit

CAMERAS = {
    "inside": rj.PerspectiveCamera((0.0, 0.0, 1.1), (0.0, 0.0, 0.0)),
    "cut": rj.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), near=3.5, far=4.5),
    "away": rj.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 9.0)),
    "parallel": rj.OrthographicCamera((0.0, 3.0, 4.0), (0.0, 0.0, 0.0), height=5.0),
    "calibrated": rj.MatrixCamera.from_intrinsics(80, 90, 30, 40, SIZE, view_from_world=np.eye(4)),
}


@pytest.fixture(autouse=True)
def shelf(monkeypatch):
    """Return the shelf of batches, on which nothing lies yet."""
    own = batch_scheduler.BatchCaches()
    monkeypatch.setattr("rasterjit.rendering.batch.BATCH_CACHES", own)
    return own


class Renderers:
    """Renderers of one thread and of two, and batches: all that keeps something from a frame."""

    def __init__(self, stack):
        self.kept = {
            f"threads={threads}": stack.enter_context(rj.Renderer(SIZE, threads=threads))
            for threads in (1, 2)
        }

    def draw(self, scene, camera, asked):
        """Return a frame of each renderer."""
        options, frames = dict(asked.options), {}
        size, quality = options.pop("size"), options.pop("quality")
        for name, renderer in self.kept.items():
            renderer.size, renderer.quality = size, quality
            frames[name] = renderer.render(scene, camera, **options)
        return frames

    def check(self, scene, cameras, asked):
        """Hold frames of each renderer, and of a batch, against fresh ones, and return these."""
        frames = [ways.lone(scene, camera, **asked.options) for camera in cameras]
        for camera, wanted in zip(cameras, frames, strict=True):
            for name, frame in self.draw(scene, camera, asked).items():
                assert ways.differing(frame, wanted) == [], (name, camera)
        if not {"diagnose", "previous"} & {*asked.options}:
            ways.check_batch(scene, cameras, frames, **asked.options)
        return frames


@contextmanager
def renderers():
    with ExitStack() as stack, warnings.catch_warnings():
        # Objects are cut on purpose, open ones too.
        warnings.simplefilter("ignore", UserWarning)
        yield Renderers(stack)


@pytest.mark.parametrize("name", CHANGES)
def test_a_frame_after_a_change_is_that_of_a_fresh_renderer(name):
    scene, asked = changing_scene(), Asked()
    with renderers() as drawing:
        # The third frame of a kind binds its calls.
        for number in (0, 2, 1):
            before = drawing.draw(scene, walk(number), asked)
        drawing.check(scene, [walk(1), walk(2)], asked)
        was = {way: ways.told(frame) for way, frame in before.items()}
        CHANGES[name](scene, asked)
        after, *_ = drawing.check(scene, [walk(n) for n in (1, 2, 3)], asked)
        assert ways.told(after) not in was.values()
        # What was drawn before is not drawn over.
        assert {way: ways.told(frame) for way, frame in before.items()} == was


@pytest.mark.parametrize("field", EFFECTS)
def test_a_frame_after_another_effect_is_that_of_a_fresh_renderer(field):
    scene, asked = changing_scene(), Asked()
    without = getattr(scene, field)
    with renderers() as drawing:
        seen = set()
        for value in (*EFFECTS[field], without):
            setattr(scene, field, value)
            for _ in range(2):
                frame, _ = drawing.check(scene, [walk(1), walk(2)], asked)
            seen.add(frame.color.tobytes())
    assert len(seen) == 3


@pytest.mark.parametrize(
    ("option", "values"),
    [("background", ("red", "blue", None)), ("cull", ("back", "front", "none"))],
)
def test_a_frame_of_another_option_is_that_of_a_fresh_renderer(option, values):
    scene, asked = changing_scene(), Asked()
    with renderers() as drawing:
        for value in values:
            asked.ask(**{option: value})
            for _ in range(2):
                drawing.check(scene, [walk(1), walk(2)], asked)


@pytest.mark.parametrize("outputs", [("color", "object_id"), ("linear", "normal", "depth")])
def test_frames_after_any_changes_are_those_of_a_fresh_renderer(outputs):
    random = np.random.default_rng(6)
    with renderers() as drawing:
        for _ in range(5):
            scene, asked = changing_scene(), Asked(outputs)
            for name in random.choice([*CHANGES], 5, replace=False).tolist():
                try:
                    CHANGES[name](scene, asked)
                    rj.explain(scene, walk(1), **asked.options)
                except (IndexError, ValueError):
                    # Nothing is left to change, or it does not go with what was changed before.
                    break
                drawing.check(scene, [walk(int(random.integers(9))), walk(1)], asked)


def test_frames_of_cameras_of_all_kinds_are_those_of_a_fresh_renderer():
    scene, asked = changing_scene(), Asked(batch_scheduler.BY_KERNEL)
    with renderers() as drawing:
        for camera in CAMERAS.values():
            drawing.check(scene, [walk(1), camera, walk(2), camera, camera], asked)


def test_frames_of_one_eye_are_cut_at_the_planes_of_each():
    scene, asked = changing_scene(), Asked(batch_scheduler.BY_KERNEL)
    planes = [{}, {"near": 3.0, "far": 4.5}, {"near": 4.0, "far": 5.5}, {"near": 3.5}]
    cameras = [replace(walk(1), **own) for own in planes]
    with renderers() as drawing:
        for _ in range(2):
            frames = drawing.check(scene, [one for one in cameras for _ in range(3)], asked)
    assert len({frame.face_id.tobytes() for frame in frames}) == len(cameras)


def test_frames_of_scenes_in_turn_are_those_of_a_fresh_renderer():
    scenes, asked = [changing_scene() for _ in range(3)], Asked()
    placed(scenes[1], 0, FAR_OFF)
    scenes[2].lights = [replace(scenes[2].lights[0], intensity=9.0)]
    with renderers() as drawing:
        for _ in range(2):
            for scene in (*scenes, scenes[0].nodes[1].mesh):
                drawing.check(scene, [walk(1), walk(1), walk(2)], asked)
