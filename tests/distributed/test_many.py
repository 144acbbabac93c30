"""Many frames of one scene: in order, few ahead, and nothing left behind."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from own_threads import own_threads

import rasterjit as rj
from rasterjit.rendering import batch

SIZE = (24, 16)
CAMERA = rj.PerspectiveCamera(eye=(0.0, 0.0, 4.0), target=(0.0, 0.0, 0.0))
PATIENCE = 60.0
"""Seconds after which something hangs."""


def cameras(count):
    for angle in np.linspace(0.0, 5.0, count):
        eye = 4.0 * np.cos(angle), 1.5, 4.0 * np.sin(angle)
        yield rj.PerspectiveCamera(eye=eye, target=(0.0, 0.0, 0.0))


def one_by_one(mesh, count, **options):
    return [rj.render(mesh, camera, size=SIZE, **options).arrays() for camera in cameras(count)]


def are_same(frames, wanted):
    return len(frames) == len(wanted) and all(
        np.array_equal(frame.arrays()[name], array, equal_nan=True)
        for frame, arrays in zip(frames, wanted, strict=True)
        for name, array in arrays.items()
    )


@pytest.mark.parametrize(
    ("threads", "workers"), [(1, None), (2, None), (4, 2), (2, 1), (None, 3), (3, 3), (5, 3)]
)
def test_frames_are_those_of_render_in_order(cube, threads, workers):
    outputs = "color", "depth", "face_id"
    frames = rj.render_many(
        cube, cameras(7), size=SIZE, outputs=outputs, threads=threads, workers=workers
    )
    assert are_same(list(frames), one_by_one(cube, 7, outputs=outputs))
    assert not own_threads("rasterjit-many")


@pytest.mark.parametrize("prefetch", [1, 3])
def test_no_more_than_prefetch_frames_are_ahead(cube, prefetch):
    asked = 0

    def counted():
        nonlocal asked
        for camera in cameras(9):
            asked += 1
            yield camera

    frames = rj.render_many(cube, counted(), size=SIZE, threads=2, prefetch=prefetch)
    assert asked == 0
    for taken, _ in enumerate(frames, 1):
        assert asked - taken < prefetch
    assert taken == asked == 9


def test_with_one_ahead_a_camera_may_follow_from_the_frame_before(cube):
    seen = []

    def following():
        for number, camera in enumerate(cameras(4)):
            assert len(seen) == number
            yield camera

    frames = rj.render_many(cube, following(), size=SIZE, threads=2, prefetch=1)
    # One by one: a list would be filled behind the cameras' back.
    for frame in frames:
        seen += [frame]
    assert len(seen) == 4


def test_frames_without_end_can_be_taken(cube):
    def forever():
        while True:
            yield from cameras(3)

    frames = rj.render_many(cube, forever(), size=SIZE, threads=2)
    taken = [next(frames) for _ in range(6)]
    assert own_threads("rasterjit-many")
    frames.close()
    assert not own_threads("rasterjit-many")
    assert are_same(taken, one_by_one(cube, 3) * 2)


def test_forgetting_the_frames_ends_the_threads(cube):
    frames = rj.render_many(cube, cameras(9), size=SIZE, threads=2)
    next(frames)
    assert own_threads("rasterjit-many")
    del frames
    gc.collect()
    assert not own_threads("rasterjit-many")


@pytest.mark.parametrize("make", [list, iter])
def test_a_function_gets_each_frame_in_the_thread_that_drew_it(cube, make):
    # Of a list, most are drawn in groups. What is kept, or a part of it, stays as it was drawn.
    kept, given = {}, list(cameras(40))

    def crop(frame):
        kept[frame.number] = frame
        return frame.depth[4:9, 5:12], threading.current_thread().name

    options = {"size": SIZE, "outputs": ("color", "depth"), "threads": 2}
    found = list(rj.render_many(cube, make(given), then=crop, **options))
    assert {name.rsplit("_")[0] for _, name in found} == {"rasterjit-many"}
    wanted = list(rj.render_many(cube, given, **options))
    assert [frame.number for frame in wanted] == list(range(40))
    assert are_same([kept[n] for n in range(40)], [frame.arrays() for frame in wanted])
    assert all((part == kept[n].depth[4:9, 5:12]).all() for n, (part, _) in enumerate(found))


def fail_at_17(frame):
    return {}["nothing"] if frame.number == 17 else frame.number


def test_an_error_of_the_function_tells_the_camera_and_the_place(cube):
    found = []
    message = r"^then failed for cameras\[17\]: KeyError: 'nothing' \(test_many.py, line \d+\)$"
    with pytest.raises(RuntimeError, match=message) as failure:
        found.extend(rj.render_many(cube, list(cameras(40)), size=SIZE, then=fail_at_17))
    assert found == list(range(17))
    assert isinstance(failure.value.__cause__, KeyError)
    with pytest.raises(ValueError, match="then must be a function of a frame, got 'crop'"):
        rj.render_many(cube, cameras(1), size=SIZE, then="crop")


def test_no_cameras_make_no_frames(cube):
    assert list(rj.render_many(cube, [], size=SIZE)) == []


def test_what_is_wrong_with_a_camera_comes_after_the_frames_before_it(cube):
    given = [*cameras(3), "a camera", *cameras(2)]
    frames = rj.render_many(cube, iter(given), size=SIZE, threads=2)
    assert are_same([next(frames) for _ in range(3)], one_by_one(cube, 3))
    with pytest.raises(ValueError, match=r"cameras\[3\] must be a PerspectiveCamera.*got str"):
        next(frames)
    assert not own_threads("rasterjit-many")


def test_error_of_the_cameras_comes_through(cube):
    def failing():
        yield from cameras(2)
        raise OSError("no more")

    frames = rj.render_many(cube, failing(), size=SIZE, threads=2)
    next(frames)
    next(frames)
    with pytest.raises(OSError, match="no more"):
        next(frames)
    assert not own_threads("rasterjit-many")


def test_frames_of_several_sizes_are_refused(cube):
    camera = next(cameras(1))
    given = [camera, (camera, (8, 8))]
    message = r"cameras\[1\] must be a camera, got a tuple of 2: all"
    with pytest.raises(ValueError, match=message):
        rj.render_many(cube, given, size=SIZE)
    frames = rj.render_many(cube, iter(given), size=SIZE)
    next(frames)
    with pytest.raises(ValueError, match=message):
        next(frames)


@pytest.mark.parametrize("kind", [list, tuple])
@pytest.mark.parametrize("item", ["a camera", None, (CAMERA, SIZE), [CAMERA]])
def test_wrong_item_of_a_sequence_is_refused_before_anything_is_drawn(cube, kind, item):
    with pytest.raises(ValueError, match=r"cameras\[2\] must be a "):
        rj.render_many(cube, kind([CAMERA, CAMERA, item, CAMERA]), size=SIZE)


def test_workers_share_the_threads_that_there_are(monkeypatch):
    monkeypatch.setattr(batch, "available_processors", lambda: 4)
    assert batch.share_threads(None, None) == (4, 1)
    assert batch.share_threads(None, 2) == (2, 2)
    assert batch.share_threads(None, 6) == (6, 1)
    assert batch.share_threads(7, 2) == (2, 3)
    assert batch.share_threads(np.int64(3), np.int64(3)) == (3, 1)


def test_prefetch_may_be_a_number_of_numpy(cube):
    for prefetch in (np.int64(2), np.uint8(2)):
        frames = rj.render_many(cube, cameras(3), size=SIZE, threads=1, prefetch=prefetch)
        assert len(list(frames)) == 3


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cameras": 3}, "cameras must be an iterable of cameras, got int"),
        ({"cameras": CAMERA}, "cameras must be an iterable.*put a single one"),
        ({"cameras": "ab"}, "cameras must be an iterable"),
        ({"size": (0, 4)}, "size must be two whole numbers"),
        ({"outputs": ("colour",)}, "outputs has 'colour'"),
        ({"quality": "high"}, "quality must be"),
        ({"background": "no colour"}, "background"),
        ({"cull": "both"}, "cull must be one of"),
        ({"outputs": ("motion",)}, "outputs has 'motion', which needs an earlier view"),
        ({"threads": 0}, "threads must be in 1"),
        ({"workers": 1.5}, "workers must be a whole number"),
        ({"prefetch": 0}, "prefetch must be a whole number of at least 1, got 0"),
        ({"prefetch": True}, "prefetch must be a whole number of at least 1"),
        ({"prefetch": np.True_}, "prefetch must be a whole number of at least 1"),
        ({"prefetch": 2.0}, "prefetch must be a whole number of at least 1, got 2.0"),
        ({"threads": 1, "workers": 6}, "must be at most threads.*workers=6 and threads=1"),
        ({"progress": True}, "progress must be one of 'none', 'bar'"),
        ({"what": rj.Scene()}, "scene must hold at least one mesh"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused_at_once(cube, wrong, message):
    given = {"what": cube, "cameras": [], "size": SIZE, **wrong}
    with pytest.raises(ValueError, match=message):
        rj.render_many(given.pop("what"), given.pop("cameras"), **given)


def test_bar_counts_on_standard_error(cube, capfd):
    frames = rj.render_many(cube, list(cameras(3)), size=SIZE, progress="bar", threads=1)
    assert len(list(frames)) == 3
    shown = capfd.readouterr()
    assert "3/3" in shown.err
    assert not shown.out


def test_two_threads_take_frames_at_once(cube):
    wanted, taken = one_by_one(cube, 8), {}

    def take(name):
        taken[name] = list(rj.render_many(cube, cameras(8), size=SIZE, threads=2))

    takers = [threading.Thread(target=take, args=(n,), daemon=True) for n in range(2)]
    for one in takers:
        one.start()
    for one in takers:
        one.join(PATIENCE)
        assert not one.is_alive()
    assert are_same(taken[0], wanted)
    assert are_same(taken[1], wanted)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_forked_child_takes_frames_of_its_own(cube):
    wanted = one_by_one(cube, 4)
    # The parent has threads, in the middle of taking frames.
    frames = rj.render_many(cube, cameras(9), size=SIZE, threads=2)
    next(frames)
    child = os.fork()
    if child == 0:
        code = 1
        try:
            refused = False
            try:
                next(frames)
            except RuntimeError as error:
                refused = "before the process was forked" in str(error)
            own = list(rj.render_many(cube, cameras(4), size=SIZE, threads=2))
            code = 0 if refused and are_same(own, wanted) else 2
        finally:
            os._exit(code)
    deadline = time.monotonic() + PATIENCE
    done, status = os.waitpid(child, os.WNOHANG)
    while not done and time.monotonic() < deadline:
        time.sleep(0.05)
        done, status = os.waitpid(child, os.WNOHANG)
    if not done:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert done, "the child hangs"
    assert os.waitstatus_to_exitcode(status) == 0
    # The parent's frames are none the worse.
    assert len(list(frames)) == 8


def take_in_child(mesh, queue):
    frames = rj.render_many(mesh, cameras(4), size=SIZE, threads=2)
    queue.put([frame.color for frame in frames])


@pytest.mark.needs_jit
def test_spawned_child_takes_frames(cube):
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    child = context.Process(target=take_in_child, args=(cube, queue), daemon=True)
    child.start()
    colors = queue.get(timeout=PATIENCE)
    child.join(PATIENCE)
    assert child.exitcode == 0
    wanted = [arrays["color"] for arrays in one_by_one(cube, 4)]
    assert all(map(np.array_equal, colors, wanted))


INTERRUPTED = """
import itertools, signal, threading
import numpy as np
import rasterjit as rj

mesh = rj.Mesh(np.eye(3), [(0, 1, 2)])
camera = rj.PerspectiveCamera(eye=(2, 2, 2), target=(0, 0, 0))
try:
    for number, frame in enumerate(rj.render_many(mesh, itertools.repeat(camera), size=(24, 16))):
        if number == 3:
            print("ready", flush=True)
except KeyboardInterrupt:
    print("interrupted", threading.active_count(), flush=True)
"""


@pytest.mark.needs_jit
def test_interrupt_ends_the_threads():
    with subprocess.Popen(
        [sys.executable, "-W", "error", "-c", INTERRUPTED],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as child:  # fmt: skip
        try:
            assert child.stdout.readline() == "ready\n"
            child.send_signal(signal.SIGINT)
            shown, errors = child.communicate(timeout=PATIENCE)
        finally:
            child.kill()
    assert (shown, errors) == ("interrupted 1\n", "")
    assert child.returncode == 0
