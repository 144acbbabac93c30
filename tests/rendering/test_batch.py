"""Many views in one array: the bits of `rj.render`, whatever they show."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from own_threads import own_threads
from ways import ALL, CAMERA, MODELS, SIZE, around, check, in_groups, mixed_scene

import rasterjit as rj
from rasterjit.rendering.batch import _new_array, draw_in_threads, views_per_group


@pytest.fixture
def scene():
    """Return three objects: smooth, with colours of vertices, and with a texture."""
    return mixed_scene()


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_views_are_those_of_render(scene, threads):
    batch = check(scene, around(7), outputs=ALL, threads=threads)
    assert len(batch) == 7
    assert batch.color.shape == (7, SIZE[1], SIZE[0], 4)
    assert (batch.face_id >= 0).any(axis=(1, 2)).all()


def test_views_of_a_batch_share_its_memory(scene):
    batch = rj.render_batch(scene, around(3), size=SIZE, outputs=("color", "depth"))
    assert set(batch[1]) == {"color", "depth"}
    assert batch[-1]["depth"].tobytes() == batch.depth[2].tobytes()
    assert np.shares_memory(batch[1]["color"], batch.color)
    assert [np.shares_memory(view["depth"], batch.depth[n]) for n, view in enumerate(batch)] == (
        [True] * 3
    )
    with pytest.raises(IndexError):
        batch[3]
    with pytest.raises(rj.OutputNotRequestedError, match="this batch has color, depth"):
        _ = batch.normal
    assert repr(batch) == "Batch(3 of 40 x 28: color, depth)"


def test_a_view_that_is_not_there_is_answered_with_how_many_there_are(scene):
    batch = rj.render_batch(scene, around(2), size=(4, 4), outputs=("depth", "color"))
    for number in (2, -3, 1 << 80):
        with pytest.raises(IndexError, match="this batch has 2 views, got the number"):
            batch[number]
    for key, name in (("depth", "depth"), ("color", "color"), (slice(1), "depth"), (0.5, "depth")):
        with pytest.raises(TypeError, match=rf"a whole number, got .*; batch\.{name} is an array"):
            batch[key]
    assert batch[np.int64(-1)]["depth"] is not None


def test_no_cameras_make_empty_arrays(scene):
    batch = rj.render_batch(scene, [], size=SIZE, outputs=("color", "uv"))
    assert (len(batch), batch.color.shape, batch.uv.shape) == (0, (0, 28, 40, 4), (0, 28, 40, 2))
    assert batch.stats.triangles_in == 0


def test_attributes_have_their_columns():
    mesh = rj.Mesh(
        [(-1, -1, 0), (1, -1, 0), (0, 1, 0)], [(0, 1, 2)], attributes={"heat": np.eye(3)[:, :1]}
    )
    scene = rj.Scene()
    scene.add(mesh)
    batch = check(scene, [CAMERA, *around(2)], outputs=("attribute:heat",))
    assert batch.attribute("heat").shape == (3, 28, 40, 1)


def test_objects_stand_where_transforms_put_them(scene):
    rng = np.random.default_rng(4)
    places = np.tile(np.eye(4), (6, 3, 1, 1))
    places[..., :3, :] += rng.normal(0.0, 0.3, (6, 3, 3, 4))
    # Its radius is a share of the scene's size, which differs from view to view.
    scene.ambient_occlusion, scene.outline = rj.AmbientOcclusion(), rj.Outline()
    scene.lights = [rj.AmbientLight()]
    batch = check(scene, around(6), places, outputs=("color", "normal", "position"))
    assert np.unique(batch.color.reshape(6, -1), axis=0).shape[0] == 6


def test_transforms_of_pythons_numbers_are_those_of_their_list(scene):
    places = np.array([[node.world_from_model for node in scene.nodes]])
    wanted = rj.render_batch(scene, [CAMERA], size=SIZE, transforms=places)
    found = rj.render_batch(scene, [CAMERA], size=SIZE, transforms=places.astype(object))
    assert found.color.tobytes() == wanted.color.tobytes()
    places = places.astype(object)
    places[0, 0, 0, 0] = None
    with pytest.raises(ValueError, match="transforms must be an array of numbers"):
        rj.render_batch(scene, [CAMERA], size=SIZE, transforms=places)


@pytest.mark.parametrize("options", [{"transforms": ["x"] * 99_999}, {"size": [1] * 99_999}])
def test_messages_show_no_more_than_the_beginning_of_a_value(scene, options):
    with pytest.raises(ValueError, match=r"\.\.\.$") as told:
        rj.render_batch(scene, [CAMERA], **{"size": SIZE, **options})
    assert len(str(told.value)) < 200


def test_transforms_do_not_move_the_scene(scene):
    before = [node.world_from_model.copy() for node in scene.nodes]
    twice = np.tile(np.diag([2.0, 2.0, 2.0, 1.0]), (1, 3, 1, 1))
    rj.render_batch(scene, [CAMERA], size=SIZE, transforms=twice)
    after = [node.world_from_model for node in scene.nodes]
    assert np.array_equal(before, after)


def test_outputs_are_written_into_arrays_given(scene):
    out = {"depth": np.zeros((5, 28, 40), np.float32), "color": np.zeros((5, 28, 40, 4), np.uint8)}
    batch = check(scene, around(5), outputs=("color", "depth", "uv"), out=out)
    assert np.shares_memory(batch.depth, out["depth"])
    assert np.shares_memory(batch.color, out["color"])
    assert np.isfinite(out["depth"]).any(axis=(1, 2)).all()


SHAPE = (2, 28, 40)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"out": [1]}, "out must be a dict"),
        (
            {"out": {"uv": np.zeros(1)}},
            "out has 'uv', .*: add it to outputs, which has color, depth",
        ),
        ({"out": {"depth": 3}}, r"out\['depth'\] must be an array"),
        ({"out": {"depth": np.zeros(SHAPE)}}, r"out\['depth'\] must be a \(2, 28, 40\) float32"),
        ({"out": {"depth": np.zeros((3, 28, 40), np.float32)}}, r"got \(3, 28, 40\)"),
        ({"out": {"depth": np.zeros(SHAPE, ">f4")}}, "float32"),
        ({"out": {"depth": np.zeros((2, 28, 80), np.float32)[..., ::2]}}, "C-contiguous"),
        ({"out": {"depth": np.broadcast_to(np.float32(1), SHAPE)}}, "C-contiguous"),
        ({"transforms": np.eye(4)}, r"transforms must have shape \(2, 3, 4, 4\)"),
        ({"transforms": np.full((2, 3, 4, 4), np.nan)}, "transforms must be finite.* view 0"),
        ({"transforms": np.ones((2, 3, 4, 4))}, "transforms must be affine"),
        ({"transforms": "here"}, "transforms must be an array of numbers"),
        ({"outputs": ("motion",)}, "earlier view"),
        ({"outputs": ("detph",)}, "unknown"),
        ({"outputs": ("attribute:none",)}, "none"),
        ({"cull": "backs"}, "cull must be"),
        ({"size": (0, 3)}, "size must be"),
        ({"threads": 0}, "threads must be"),
        ({"background": "colour"}, "background"),
    ],
)
def test_what_is_wrong_is_named_before_anything_is_drawn(scene, options, message, monkeypatch):
    monkeypatch.setattr("rasterjit.rendering.renderer.draw_frame", None)
    options = {"size": SIZE, "outputs": ("color", "depth"), **options}
    with pytest.raises(ValueError, match=message):
        rj.render_batch(scene, around(2), **options)


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        (CAMERA, "cameras must be an iterable"),
        ([CAMERA, "a"], r"cameras\[1\] must be a"),
        (iter([CAMERA, None]), r"cameras\[1\] must be a"),
        (
            [CAMERA, rj.MatrixCamera.from_intrinsics(9, 9, 5, 5, (10, 10))],
            r"cameras\[1\]: size must have the aspect of 10 x 10",
        ),
    ],
)
def test_cameras_are_checked_before_anything_is_drawn(scene, cameras, message, monkeypatch):
    monkeypatch.setattr("rasterjit.rendering.renderer.draw_frame", None)
    with pytest.raises(ValueError, match=message):
        rj.render_batch(scene, cameras, size=SIZE)


def test_outputs_beyond_memory_are_named_with_their_size(scene):
    with pytest.raises(ValueError, match=r"cameras and size .* 999 views of 16384 x 16384: color"):
        rj.render_batch(scene, [CAMERA] * 999, size=(16384, 16384), threads=1)
    many = r"9999999 views .*: linear alone takes 42949668[0-9]+ bytes; render fewer at a time"
    with pytest.raises(ValueError, match=many):
        _new_array("linear", (9_999_999, 16384, 16384, 4), "float32")


@pytest.mark.parametrize("threads", [1, 2])
def test_near_planes_that_are_too_near_name_the_first_view(scene, threads):
    near = rj.PerspectiveCamera((0.0, 0.5, 4.0), (0.0, 0.0, 0.0), near=1e-45)
    with pytest.raises(ValueError, match=r"^cameras\[2\]: camera.near"):
        rj.render_batch(scene, [CAMERA, CAMERA, near, CAMERA], size=SIZE, threads=threads)


class Slotted(rj.PerspectiveCamera):
    """A camera with state of its own."""

    __slots__ = ("shift",)

    def eye_position(self):
        """Return the eye as a list, beside where it is."""
        x, y, z = self.eye
        return [x + self.shift, y, z]

    def view_matrix(self):
        """Return the view as lists."""
        return rj.transforms.look_at(self.eye_position(), self.target, self.up).tolist()


def test_cameras_of_ones_own_may_have_slots_and_return_lists(scene):
    cameras = []
    for camera in around(3):
        own = Slotted(camera.eye, camera.target)
        object.__setattr__(own, "shift", 0.4)
        cameras.append(own)
    scene.lights = []
    check(scene, cameras, outputs=("color", "depth", "distance", "position"))


def test_arrays_given_share_no_memory(scene):
    room = np.zeros((2, 28, 40, 4), np.uint8)
    out = {"color": room, "depth": room.view(np.float32)[..., 0]}
    with pytest.raises(ValueError, match=r"out\['color'\] must not share memory with out\['depth'"):
        rj.render_batch(scene, around(2), size=SIZE, outputs=("color", "depth"), out=out)
    places = np.tile(np.eye(4), (28 * 40 // 8 * 2, 3, 1, 1))
    count = len(places)
    out = {"linear": places.reshape(-1).view(np.float32)[: count * 24].reshape(count, 3, 2, 4)}
    with pytest.raises(ValueError, match="share memory with transforms"):
        rj.render_batch(
            scene, [CAMERA] * count, size=(2, 3), outputs=("linear",), out=out, transforms=places
        )


def test_what_is_not_in_view_is_told_once(scene):
    away = rj.PerspectiveCamera(eye=(0.0, 0.0, 9.0), target=(0.0, 0.0, 20.0))
    with pytest.warns(rj.ViewWarning) as told:
        rj.render_batch(scene, [away, CAMERA, away], size=SIZE, threads=1)
    assert len(told) == 1
    assert told[0].filename == __file__


def test_threads_end_with_the_call(scene):
    rj.render_batch(scene, around(9), size=SIZE, threads=3)
    assert not own_threads("rasterjit-batch")


PROGRAM = """
import signal, sys
import rasterjit as rj
from rasterjit.rendering import batch

threads, drawn, sent = int(sys.argv[1]), [], []
draw = batch.GroupedViewDrawer.__call__

def noted(self, group):
    drawn.append(group)
    if len(drawn) == 10:
        print("begun", flush=True)
    return draw(self, group)

def end(*_):
    sent.append(len(drawn))
    raise KeyboardInterrupt

batch.GroupedViewDrawer.__call__ = noted
signal.signal(signal.SIGINT, end)
scene = rj.load(sys.argv[2])
camera = rj.PerspectiveCamera((0, 1, 9), (0, 0, 0))
try:
    rj.render_batch(scene, [camera] * 400_000, size=(64, 64), threads=threads)
except KeyboardInterrupt:
    print(len(drawn) - sent[0], flush=True)
"""


@in_groups
@pytest.mark.skipif(os.name == "nt", reason="Windows sends no SIGINT to one process")
@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_ends_it_after_the_groups_at_hand(threads):
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(threads), MODELS / "torus_knot.obj"],
        stdout=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stdout.readline() == "begun\n"
        running.send_signal(signal.SIGINT)
        # Each thread may just take another when it is told.
        assert int(running.stdout.readline()) <= threads
    assert running.returncode == 0


def test_out_at_an_address_that_pixels_do_not_start_at_is_refused(scene):
    room = np.zeros(2 * SIZE[0] * SIZE[1] * 4 + 4, np.uint8)
    first = -room.ctypes.data % 4 + 1
    own = room[first : first + 2 * SIZE[0] * SIZE[1] * 4].reshape(2, SIZE[1], SIZE[0], 4)
    with pytest.raises(ValueError, match=r"out\['color'\] must be .* a multiple of 4"):
        rj.render_batch(scene, around(2), size=SIZE, out={"color": own})


def test_an_error_in_one_thread_ends_the_others():
    drawn, groups = [], [range(n, n + 1) for n in range(5000)]

    class Draws:
        def __call__(self, group):
            if group.start == 1:
                raise ValueError("view 1")
            time.sleep(0.005)
            drawn.append(group)

        def close(self):
            drawn.append(None)

    with pytest.raises(ValueError, match="view 1"):
        list(draw_in_threads(Draws, groups, 2))
    assert len(drawn) < 2500
    assert drawn.count(None) == 2


@pytest.mark.parametrize(
    ("count", "workers", "most"),
    [
        (1, 1, 1),
        (40, 1, 40),
        (1000, 1, 128),
        (40, 2, 20),
        (128, 2, 32),
        (400, 2, 50),
        (9999, 2, 128),
    ],
)
def test_large_groups_where_each_thread_has_several(count, workers, most):
    assert views_per_group(count, workers) == most
