"""One run at a time writes to the folder of a data set."""

import json
import os
import socket
import subprocess
import sys

import pytest

from rasterjit.dataset import lock, making
from rasterjit.dataset.recipe import Recipe

RECIPE = Recipe(views=1, size=(8, 6), outputs=("mask",))


@pytest.fixture
def meshes(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    for name in "ab":
        (folder / f"{name}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return folder


def lock_of(pid, host=None):
    return json.dumps({"host": host or socket.gethostname(), "pid": pid, "run": "1"})


@pytest.fixture
def sleeper():
    """Another process of this machine."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as running:
        yield running
        running.kill()


def test_a_second_run_is_refused_and_leaves_the_first_alone(meshes, tmp_path):
    place = tmp_path / "set"
    refused = []

    def report(*_):
        (place / ".partial-of-the-first").mkdir(exist_ok=True)
        with pytest.raises(ValueError, match=f"another run, process {os.getpid()} on ") as caught:
            making.make(meshes, place, RECIPE)
        assert str(place / ".lock") in str(caught.value)
        assert (place / ".partial-of-the-first").is_dir()
        refused.append(caught)

    assert making.make(meshes, place, RECIPE, report=report).made == 2
    assert len(refused) == 2
    assert not (place / ".lock").exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_the_folder_is_given_back_whatever_is_raised(meshes, tmp_path, error):
    place = tmp_path / "set"

    def report(*_):
        assert (place / ".lock").is_file()
        raise error

    with pytest.raises(error):
        making.make(meshes, place, RECIPE, report=report)
    assert not list(place.glob(".*"))
    assert making.make(meshes, place, RECIPE).made == 1


def test_the_lock_of_a_process_that_goes_on_is_kept(meshes, tmp_path, sleeper):
    place = tmp_path / "set"
    place.mkdir()
    (place / ".lock").write_text(lock_of(sleeper.pid))
    with pytest.raises(ValueError, match=f"another run, process {sleeper.pid} on "):
        making.make(meshes, place, RECIPE)
    assert [file.name for file in place.iterdir()] == [".lock"]
    sleeper.kill()
    sleeper.wait()
    assert making.make(meshes, place, RECIPE).made == 2
    assert not list(place.glob(".*"))


def test_the_lock_of_another_machine_is_kept(meshes, tmp_path):
    place = tmp_path / "set"
    place.mkdir()
    (place / ".lock").write_text(lock_of(1, "elsewhere"))
    with pytest.raises(ValueError, match="process 1 on elsewhere"):
        making.make(meshes, place, RECIPE)


@pytest.mark.parametrize("content", ["", "half", "[]", "own"])
def test_a_lock_that_is_nobodys_is_taken_over(meshes, tmp_path, monkeypatch, content):
    """A number of a process is given again, to this one for instance."""
    monkeypatch.setattr(lock, "HALF_WRITTEN", 0.01)
    place = tmp_path / "set"
    place.mkdir()
    (place / ".lock").write_text(lock_of(os.getpid()) if content == "own" else content)
    assert making.make(meshes, place, RECIPE).made == 2
    assert not list(place.glob(".*"))


KILLED = """
import os, signal, sys
from rasterjit import dataset
recipe = dataset.Recipe(views=1, size=(8, 6), outputs=("mask",))
dataset.make(sys.argv[1], sys.argv[2], recipe, report=lambda *_: os.kill(os.getpid(), 9))
"""


@pytest.mark.needs_jit
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_the_next_run_goes_on_after_one_that_was_killed(meshes, tmp_path):
    place = tmp_path / "set"
    done = subprocess.run([sys.executable, "-c", KILLED, meshes, place], check=False)
    assert done.returncode == -9
    assert (place / ".lock").is_file()
    assert making.make(meshes, place, RECIPE) == making.Summary(1, 1, {})
    assert not list(place.glob(".*"))
