"""Frames that a cluster draws: the same bits in the same order, whatever becomes of the workers."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

import rasterjit as rj
from rasterjit import distributed
from rasterjit.distributed import clusters
from rasterjit.distributed import frames as frames_of_clusters

pytestmark = [pytest.mark.takes_long, pytest.mark.needs_jit]

SIZE = (32, 24)
PATIENCE = 60.0


def cameras(count):
    for angle in np.linspace(0.0, 5.0, count):
        eye = 4.0 * np.cos(angle), 1.5, 4.0 * np.sin(angle)
        yield rj.PerspectiveCamera(eye=eye, target=(0.0, 0.0, 0.0))


def are_those_of_render(frames, scene, outputs=("color",)):
    wanted = [rj.render(scene, one, size=SIZE, outputs=outputs) for one in cameras(len(frames))]
    return all(
        frame.arrays()[name].tobytes() == other.arrays()[name].tobytes()
        for frame, other in zip(frames, wanted, strict=True)
        for name in outputs
    )


def test_frames_are_those_of_render_in_order(cube, client):
    outputs = "color", "depth", "face_id"
    frames = list(
        rj.render_many(cube, cameras(9), size=SIZE, outputs=outputs, client=client)
    )  # fmt: skip
    assert len(frames) == 9
    assert are_those_of_render(frames, cube, outputs)


def test_small_views_of_a_sequence_are_drawn_several_in_a_task(cube, client):
    given, outputs = list(cameras(40)), ("color", "depth", "face_id")
    frames = list(rj.render_many(cube, given, size=SIZE, outputs=outputs, client=client))
    assert are_those_of_render(frames, cube, outputs)
    # The first of each worker are drawn alone.
    assert ["all stages" in one.stats.seconds for one in frames] == [False] * 4 + [True] * 36
    wanted = rj.render(cube, given[-1], size=SIZE)
    assert str(frames[-1].plan).split("outputs")[0] == str(wanted.plan).split("outputs")[0]
    assert frames[-1].stats.pixels_covered == wanted.stats.pixels_covered > 0
    # Of those that come as they are asked for, as many as prefetch allows.
    frames = list(rj.render_many(cube, cameras(40), size=SIZE, prefetch=12, client=client))
    assert are_those_of_render(frames, cube)
    assert sum("all stages" in one.stats.seconds for one in frames) == 36


def test_small_views_that_are_drawn_alone_share_tasks_too(cube, client, monkeypatch):
    sizes, submit = [], frames_of_clusters.FrameFarm.submit
    monkeypatch.setattr(
        frames_of_clusters.FrameFarm, "submit",
        lambda farm, some, first: (
            sizes.append((len(some), farm.pace.group_size)), submit(farm, some, first),
        )[1],
    )  # fmt: skip
    points = rj.Points(cube.vertices, size=3.0)
    frames = list(rj.render_many(points, list(cameras(40)), size=SIZE, client=client))
    assert are_those_of_render(frames, points)
    assert sizes == [(1, 1)] * 4 + [(9, 1)] * 4
    # Groups are of 32 at most, and tasks of several.
    sizes.clear()
    given = list(cameras(204))
    found = list(rj.render_many(cube, given, size=SIZE, client=client, then=lambda one: one.number))
    assert found == list(range(204))
    assert sizes == [(1, 1)] * 4 + [(50, 32)] * 4


def test_a_function_is_called_on_the_workers(cube, client):
    given = list(cameras(40))

    def crop(frame):
        return os.getpid(), frame.number, frame.color[4:9, 5:12], frame.stats.drawn

    found = list(rj.render_many(cube, given, size=SIZE, client=client, then=crop))
    assert {own for own, *_ in found} == set(client.run(os.getpid).values())
    wanted = list(rj.render_many(cube, given, size=SIZE, then=crop))
    assert [one[1] for one in found] == list(range(40))
    assert all(
        (a.tobytes(), drawn) == (b.tobytes(), others)
        for (*_, a, drawn), (*_, b, others) in zip(found, wanted, strict=True)
    )


def test_an_error_of_the_function_tells_the_camera(cube, client):
    class OwnError(Exception):
        def __init__(self, lock):
            super().__init__("no crop")
            self.lock = lock

    def fail(frame):
        if frame.number == 17:
            raise OwnError(threading.Lock())
        return frame.number

    found = []
    message = r"^then failed for cameras\[17\]: OwnError: no crop \(.*line \d+\)"
    with pytest.raises(RuntimeError, match=message):
        found.extend(rj.render_many(cube, list(cameras(40)), size=SIZE, client=client, then=fail))
    assert found == list(range(17))
    frames = rj.render_many(
        cube, list(cameras(3)), size=SIZE, client=client, then=lambda frame: threading.Lock()
    )
    with pytest.raises(RuntimeError, match=r"^then must return what .*\[0:1\]: TypeError: cannot"):
        list(frames)
    lock = threading.Lock()
    with pytest.raises(ValueError, match=r"then must pickle.* got function: TypeError: cannot"):
        rj.render_many(cube, cameras(1), size=SIZE, client=client, then=lambda frame: lock)


def test_an_error_in_a_task_comes_after_the_frames_before_it(cube, client):
    given = list(cameras(40))
    clip = given[0].projection_matrix((8, 8))
    given[17] = rj.MatrixCamera(given[0].view_matrix(), clip, (8, 8))
    frames, taken = rj.render_many(cube, given, size=SIZE, client=client), []
    with pytest.raises(ValueError, match=r"^cameras\[17\]: .*size"):
        taken.extend(frames)
    assert len(taken) == 17
    assert are_those_of_first(taken, cube, given)


def are_those_of_first(frames, scene, given):
    wanted = [rj.render(scene, one, size=SIZE) for one in given[: len(frames)]]
    return all(
        frame.color.tobytes() == other.color.tobytes()
        for frame, other in zip(frames, wanted, strict=True)
    )


def test_frame_has_its_plan_and_its_statistics(cube, client):
    (frame,) = rj.render_many(cube, cameras(1), size=SIZE, client=client)
    (other,) = rj.render_many(cube, cameras(1), size=SIZE, threads=1)
    assert str(frame.plan) == str(other.plan)
    assert repr(frame) == repr(other) == "Frame(32 x 24: color)"
    assert frame.stats.pixels_covered == other.stats.pixels_covered > 0
    assert frame.stats.drawn == other.stats.drawn


def test_no_more_than_prefetch_frames_are_under_way(cube, client):
    asked = 0

    def counted():
        nonlocal asked
        for camera in cameras(8):
            asked += 1
            yield camera

    frames = rj.render_many(cube, counted(), size=SIZE, prefetch=3, client=client)
    for taken, _ in enumerate(frames, 1):
        assert asked - taken < 3
    assert taken == asked == 8


def test_scene_goes_to_a_worker_once(cube, client):
    frames = rj.render_many(cube, cameras(6), size=SIZE, prefetch=4, client=client)
    next(frames)
    held = [key for keys in client.has_what().values() for key in keys if "Scene" in key]
    assert len(held) == len(client.has_what()) == 2
    frames.close()


def test_closing_early_leaves_nothing_on_the_cluster(cube, client):
    frames = rj.render_many(cube, cameras(9), size=SIZE, client=client)
    next(frames)
    frames.close()
    deadline = time.monotonic() + PATIENCE
    while any(client.has_what().values()) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(client.has_what().values())
    assert not client.futures


def test_workers_keep_renderers_no_longer_than_frames_are_taken(
    cube, client, wait_for_no_renderers
):
    frames = rj.render_many(cube, cameras(9), size=SIZE, client=client)
    next(frames)
    frames.close()
    assert wait_for_no_renderers(client) == 0


def test_worker_killed_in_the_middle_loses_no_frame(cube, doomed):
    frames = rj.render_many(cube, cameras(12), size=SIZE, prefetch=6, client=doomed)
    taken = [next(frames)]
    victim = next(iter(doomed.run(os.getpid).values()))
    os.kill(victim, signal.SIGKILL)
    taken += frames
    assert len(taken) == 12
    assert are_those_of_render(taken, cube)
    assert victim not in doomed.run(os.getpid).values()


def test_all_workers_killed_lose_no_frame_and_are_told_once(cube, doomed, monkeypatch):
    said = []
    monkeypatch.setattr(clusters.LOGGER, "warning", lambda text, *rest: said.append(text % rest))
    frames = rj.render_many(cube, cameras(8), size=SIZE, prefetch=6, client=doomed)
    taken = [next(frames)]
    for victim in doomed.run(os.getpid).values():
        os.kill(victim, signal.SIGKILL)
    taken += frames
    assert len(taken) == 8
    assert are_those_of_render(taken, cube)
    assert said == ["all workers that held the scene were lost: it is sent again"]


def test_error_on_a_worker_comes_through(cube, client):
    cube.material = rj.Material(base_color=(1.0, 1.0, 1.0, 0.5), alpha_mode="blend")
    quality = rj.Quality(samples="area")
    frames = rj.render_many(cube, cameras(3), size=SIZE, quality=quality, client=client)
    with pytest.raises(ValueError, match="area"):
        next(frames)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"client": "tcp://127.0.0.1:8786"}, "client must be a distributed.Client, got str"),
        ({"workers": 2}, "workers must be None where a client is given, got 2"),
        ({"prefetch": 0}, "prefetch must be a whole number of at least 1"),
    ],
)
def test_wrong_arguments_are_refused_at_once(cube, client, wrong, message):
    with pytest.raises(ValueError, match=message):
        rj.render_many(cube, cameras(1), size=SIZE, **{"client": client, **wrong})


def test_item_that_is_no_camera_is_named(cube, client):
    given = [*cameras(2), None]
    with pytest.raises(ValueError, match=r"cameras\[2\] must be a .*got NoneType"):
        rj.render_many(cube, given, size=SIZE, client=client)
    frames = rj.render_many(cube, iter(given), size=SIZE, client=client)
    assert are_those_of_render([next(frames), next(frames)], cube)
    with pytest.raises(ValueError, match=r"cameras\[2\] must be a .*got NoneType"):
        next(frames)


@contextmanager
def started(*words):
    """Start a scheduler or a worker in a process of its own, and kill it at the end."""
    command = [sys.executable, "-m", *words, "--no-dashboard"]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def remote(place, port="0"):
    """Give a scheduler's process and a client; a worker is there, too."""
    from distributed import Client

    there = "--scheduler-file", str(place)
    with (
        started("distributed.cli.dask_scheduler", "--port", port, *there) as scheduler,
        Client(scheduler_file=str(place), timeout=PATIENCE, set_as_default=False) as client,
        started("distributed.cli.dask_worker", "--no-nanny", *there),
    ):
        client.wait_for_workers(1, timeout=PATIENCE)
        yield scheduler, client


@pytest.fixture
def silent(monkeypatch):
    """Let Dask say nothing of a scheduler that is lost, and be soon sure of it."""
    monkeypatch.setattr(clusters, "RECONNECT_TIMEOUT", 3.0)
    logger = logging.getLogger("distributed")
    level = logger.level
    yield lambda: logger.setLevel(logging.CRITICAL)
    logger.setLevel(level)


def kill(process):
    process.kill()
    process.wait(PATIENCE)


def test_lost_scheduler_is_a_clear_error_and_a_new_one_works(cube, tmp_path, silent):
    with remote(tmp_path / "first.json") as (scheduler, client):
        frames = rj.render_many(cube, cameras(4), size=SIZE, prefetch=1, client=client)
        next(frames)
        address = client.scheduler.address
        silent()
        kill(scheduler)
        began = time.monotonic()
        with pytest.raises(ConnectionError, match=f"scheduler at {address} is lost"):
            next(frames)
        assert time.monotonic() - began < PATIENCE
        # It stays lost for the same client.
        with pytest.raises(ConnectionError, match=f"scheduler at {address} is lost"):
            rj.render_many(cube, cameras(4), size=SIZE, client=client)
        # Started again at the same place, it works for another client.
        with remote(tmp_path / "second.json", address.rsplit(":", 1)[1]) as (_, other):
            assert other.scheduler.address == address
            frames = list(rj.render_many(cube, cameras(4), size=SIZE, client=other))
            assert are_those_of_render(frames, cube)


@pytest.mark.parametrize("delay", [0.05, 0.4])
def test_scheduler_lost_at_any_moment_is_a_connection_error(cube, tmp_path, silent, delay):
    with remote(tmp_path / "place.json") as (scheduler, client):
        frames = rj.render_many(cube, cameras(4000), size=SIZE, prefetch=4, client=client)
        next(frames)
        silent()
        threading.Timer(delay, scheduler.kill).start()
        with pytest.raises(ConnectionError, match=r"scheduler at .* is lost"):
            list(frames)


def test_scheduler_lost_while_a_picture_is_written_leaves_no_file(cube, tmp_path, silent):
    pytest.importorskip("tifffile")
    path = tmp_path / "picture.tif"
    with remote(tmp_path / "place.json") as (scheduler, client):
        silent()
        threading.Timer(0.5, scheduler.kill).start()
        with pytest.raises(ConnectionError, match=r"scheduler at .* is lost"):
            distributed.render_large(cube, None, (8192, 8192), path, tile=64, client=client)
    assert [one.name for one in tmp_path.iterdir()] == ["place.json"]


def test_two_threads_share_a_client(cube, client):
    taken = {}

    def take(name):
        taken[name] = list(rj.render_many(cube, cameras(5), size=SIZE, client=client))

    takers = [threading.Thread(target=take, args=(n,), daemon=True) for n in range(2)]
    for one in takers:
        one.start()
    for one in takers:
        one.join(PATIENCE)
        assert not one.is_alive()
    assert are_those_of_render(taken[0], cube)
    assert are_those_of_render(taken[1], cube)
