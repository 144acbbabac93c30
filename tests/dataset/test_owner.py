"""One run at a time writes to the folder of a data set."""

import errno
import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from rasterjit.dataset import dataset_builder
from rasterjit.dataset.recipe import Recipe
from rasterjit.runtime import locks

RECIPE = Recipe(views=1, size=(8, 6), outputs=("mask",))


@pytest.fixture
def meshes(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    for name in "ab":
        (folder / f"{name}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return folder


HOLDING = """
import sys
from pathlib import Path
from rasterjit.dataset.dataset_builder import lock_folder
with lock_folder(Path(sys.argv[1])):
    print(flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    """Another process that has the folder of the set."""
    (tmp_path / "set").mkdir()
    words = [sys.executable, "-c", HOLDING, str(tmp_path / "set")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        running.stdout.readline()
        yield running
        running.kill()


def test_a_second_run_is_refused_and_leaves_the_first_alone(meshes, tmp_path):
    place = tmp_path / "set"
    refused = []

    def report(*_):
        (place / ".partial-of-the-first").mkdir(exist_ok=True)
        with pytest.raises(ValueError, match=f"another run, process {os.getpid()} on ") as caught:
            dataset_builder.make(meshes, place, RECIPE)
        assert str(place / ".lock") in str(caught.value)
        assert (place / ".partial-of-the-first").is_dir()
        refused.append(caught)

    assert dataset_builder.make(meshes, place, RECIPE, report=report).made == 2
    assert len(refused) == 2
    assert not (place / ".lock").exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_the_folder_is_given_back_whatever_is_raised(meshes, tmp_path, error):
    place = tmp_path / "set"

    def report(*_):
        assert (place / ".lock").is_file()
        raise error

    with pytest.raises(error):
        dataset_builder.make(meshes, place, RECIPE, report=report)
    assert not list(place.glob(".*"))
    assert dataset_builder.make(meshes, place, RECIPE).made == 1


def test_the_lock_of_a_process_that_goes_on_is_kept(meshes, tmp_path, holder):
    place = tmp_path / "set"
    with pytest.raises(ValueError, match=f"another run, process {holder.pid} on "):
        dataset_builder.make(meshes, place, RECIPE)
    assert [file.name for file in place.iterdir()] == [".lock"]
    holder.kill()
    holder.wait()
    assert (place / ".lock").is_file()
    assert dataset_builder.make(meshes, place, RECIPE).made == 2
    assert not list(place.glob(".*"))


def left_lock(place, change):
    """A lock file that a killed process left, with another content."""
    content = json.loads(dataset_builder._make_lock_content())
    change(content)
    place.mkdir()
    (place / ".lock").write_text(json.dumps(content))


def test_the_number_of_its_process_tells_nothing(meshes, tmp_path):
    """Containers that share a folder have processes of the same number: this one, for instance."""
    place = tmp_path / "set"
    left_lock(place, lambda content: None)
    assert dataset_builder.make(meshes, place, RECIPE).made == 2


@pytest.mark.parametrize("shared", [0, 1])
def test_a_lock_is_seen_on_the_same_host_or_the_same_system(meshes, tmp_path, shared):
    place = tmp_path / "set"
    left_lock(place, lambda content: content["machine"].__setitem__(1 - shared, "0"))
    assert dataset_builder.make(meshes, place, RECIPE).made == 2


def test_the_lock_of_another_machine_is_kept(meshes, tmp_path):
    place = tmp_path / "set"
    left_lock(place, lambda it: it.update(machine=["0", "1"], pid=1, host="elsewhere"))
    with pytest.raises(ValueError, match="process 1 on elsewhere"):
        dataset_builder.make(meshes, place, RECIPE)
    assert (place / ".lock").is_file()


def test_a_lock_that_cannot_be_asked_is_kept(meshes, tmp_path, monkeypatch):
    place = tmp_path / "set"
    monkeypatch.setattr(locks, "_lock", lambda descriptor: False)
    left_lock(place, lambda content: None)
    with pytest.raises(ValueError, match="if there is none, remove"):
        dataset_builder.make(meshes, place, RECIPE)
    (place / ".lock").unlink()
    assert dataset_builder.make(meshes, place, RECIPE).made == 2
    assert not list(place.glob(".*"))


@pytest.mark.parametrize("content", ["", "half", "[]"])
def test_a_lock_that_is_nobodys_is_taken_over(meshes, tmp_path, content):
    place = tmp_path / "set"
    place.mkdir()
    (place / ".lock").write_text(content)
    assert dataset_builder.make(meshes, place, RECIPE).made == 2
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
    assert dataset_builder.make(meshes, place, RECIPE) == dataset_builder.Summary(1, 1, {})
    assert not list(place.glob(".*"))


def forbid_by_path(monkeypatch):
    """Files that are locked refuse other descriptors, as on SMB shares under Linux."""

    def refuse(self, *_, **named):
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    for name in ("open", "read_bytes", "read_text", "write_text", "write_bytes"):
        monkeypatch.setattr(dataset_builder.Path, name, refuse)


def test_where_locks_forbid_others_to_write_the_holder_does(tmp_path, monkeypatch):
    (tmp_path / ".lock").write_text(dataset_builder._make_lock_content() + " " * 99)
    with monkeypatch.context() as patch:
        forbid_by_path(patch)
        with dataset_builder.lock_folder(tmp_path):
            patch.undo()
            assert (tmp_path / ".lock").read_text() == dataset_builder._make_lock_content()


def test_the_lock_of_another_machine_is_read_by_who_holds_it(tmp_path, monkeypatch):
    other = json.dumps({"host": "elsewhere", "pid": 1, "machine": ["0", "1"]})
    (tmp_path / ".lock").write_text(other)
    forbid_by_path(monkeypatch)
    with (
        pytest.raises(ValueError, match="another run: wait"),
        dataset_builder.lock_folder(tmp_path),
    ):
        pass
    monkeypatch.undo()
    assert (tmp_path / ".lock").read_text() == other


def test_a_refusal_names_no_process_that_cannot_be_read(tmp_path, monkeypatch, holder):
    forbid_by_path(monkeypatch)
    with (
        pytest.raises(ValueError, match=r"another run: wait .*\.lock"),
        dataset_builder.lock_folder(tmp_path / "set"),
    ):
        pass


def test_a_lock_file_that_seems_to_be_another_is_refused(tmp_path, monkeypatch):
    """Some file systems give another number of a file by its path than when it is open."""
    monkeypatch.setattr(locks.Lock, "is_at", lambda self, path: False)
    with pytest.raises(ValueError, match="another run"), dataset_builder.lock_folder(tmp_path):
        pass


def test_a_lock_file_that_another_takes_while_it_is_removed_is_its(tmp_path, monkeypatch):
    """Windows removes no file that is open."""

    def refuse(self, **_):
        raise PermissionError(errno.EACCES, "open", str(self))

    monkeypatch.setattr(dataset_builder.Path, "unlink", refuse)
    with dataset_builder.lock_folder(tmp_path):
        pass
    assert (tmp_path / ".lock").is_file()
    monkeypatch.undo()
    with dataset_builder.lock_folder(tmp_path):
        pass
    assert not (tmp_path / ".lock").exists()


@pytest.mark.parametrize(
    ("number", "expected"),
    [(errno.EACCES, None), (errno.EDEADLK, None), (errno.EINVAL, False), (errno.ENOSYS, False)],
)
def test_what_windows_says_of_a_lock(tmp_path, monkeypatch, number, expected):
    def locking(descriptor, mode, count):
        raise OSError(number, os.strerror(number))

    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
    with open(tmp_path / "a", "wb") as file:
        assert locks._lock(file.fileno()) is expected


@pytest.mark.parametrize("name", ["lock", "_create_lock_file"])
def test_an_interrupt_while_the_lock_is_made_leaves_no_file(tmp_path, monkeypatch, name):
    original = getattr(dataset_builder, name)

    def interrupt(file):
        monkeypatch.undo()
        if name == "_create_lock_file":
            original(file)
        raise KeyboardInterrupt

    monkeypatch.setattr(dataset_builder, name, interrupt)
    with pytest.raises(KeyboardInterrupt), dataset_builder.lock_folder(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_leaves_the_lock_of_another_run_alone(tmp_path, monkeypatch):
    with dataset_builder.lock_folder(tmp_path):
        monkeypatch.setattr(
            dataset_builder, "_acquire_lock", lambda file: (_ for _ in ()).throw(KeyboardInterrupt)
        )
        with pytest.raises(KeyboardInterrupt), dataset_builder.lock_folder(tmp_path):
            pass
        assert (tmp_path / dataset_builder.LOCK_NAME).read_bytes()
