import io
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.accuracy import compiling
from rasterjit.accuracy.compiling import COLD, Companion, Job


class Process:
    """Stands for the other process."""

    started = ()

    def __init__(self, arguments, stdin, **options):
        self.arguments, self.stdin, self.is_killed = arguments, io.BytesIO(), False
        Process.started = (*Process.started, self)

    def kill(self):
        self.is_killed = True

    def communicate(self):
        assert self.is_killed


@pytest.fixture(autouse=True)
def two_processors(monkeypatch, tmp_path):
    monkeypatch.setattr(Process, "started", ())
    monkeypatch.setattr(compiling.subprocess, "Popen", Process)
    monkeypatch.setattr(compiling, "available_processors", lambda: 2)
    monkeypatch.setattr(compiling, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(compiling, "is_cached", lambda kernel: True)


def job():
    scene = rj.Scene()
    scene.add(rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]))
    camera = rj.fit_camera(scene)
    return Job(scene, camera, (16, 12), [rj.Quality(), rj.Quality(subpixel_bits=4)], [("color",)])


def test_another_process_is_sent_the_job_once_and_ended():
    with Companion(None) as companion:
        companion.help(COLD + 1.0, job)
        companion.help(COLD + 1.0, job)
        (process,) = Process.started
        assert not process.is_killed
        sent = compiling.read_job(io.BytesIO(process.stdin.getvalue()))
        assert sent.qualities == job().qualities
        assert np.array_equal(sent.scene.nodes[0].mesh.faces, [[0, 1, 2]])
    assert process.is_killed


def test_with_nothing_cached_it_starts_at_once(monkeypatch):
    monkeypatch.setattr(compiling, "is_cached", lambda kernel: False)
    with Companion(None) as companion:
        companion.help(0.0, job)
    assert len(Process.started) == 1


def test_with_all_cached_there_is_none():
    with Companion(None) as companion:
        companion.help(COLD, job)
    assert Process.started == ()


@pytest.mark.parametrize("lack", ["threads", "processor", "cache", "python"])
def test_where_it_is_of_no_use_there_is_none(lack, monkeypatch):
    if lack == "processor":
        monkeypatch.setattr(compiling, "available_processors", lambda: 1)
    if lack == "cache":
        monkeypatch.setattr(compiling, "cache_folder", lambda: None)
    if lack == "python":
        monkeypatch.setattr(compiling.sys, "executable", "")
    with Companion(1 if lack == "threads" else None) as companion:
        companion.help(COLD + 1.0, job)
    assert Process.started == ()


def test_what_cannot_be_sent_is_left_to_this_process():
    camera = job()._replace(camera=lambda: None)
    with Companion(None) as companion:
        companion.help(COLD + 1.0, lambda: camera)
    assert Process.started == ()


def test_a_process_that_has_failed_is_no_error(monkeypatch):
    class Broken(io.BytesIO):
        def write(self, data):
            raise BrokenPipeError

    monkeypatch.setattr(io, "BytesIO", Broken)
    with Companion(None) as companion:
        companion.help(COLD + 1.0, job)
    assert len(Process.started) == 1


def test_the_other_process_draws_every_quality():
    drawn = []

    class Renderer(rj.Renderer):
        def render(self, what, camera=None, **options):
            drawn.append((self.quality, options["outputs"]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiling, "Renderer", Renderer)
        compiling.draw(pickle.loads(pickle.dumps(job())))
    assert drawn == [(rj.Quality(), ("color",)), (rj.Quality(subpixel_bits=4), ("color",))]


def test_the_other_process_runs_what_is_there():
    for line in compiling.OTHER_PROCESS.splitlines():
        for name in ("read_job", "draw"):
            if f"compiling.{name}" in line:
                assert callable(getattr(compiling, name))
    compile(compiling.OTHER_PROCESS, "other", "exec")
