"""Files are written whole or not at all, and what killed processes left is removed."""

import builtins
import errno
import multiprocessing
import os
import signal
import subprocess
import sys
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from rasterjit.io import atomic_write
from rasterjit.runtime import locks

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="Windows locks and kills in other ways"
)

WAITING = """
import sys
from pathlib import Path
from rasterjit.io import atomic_write
with getattr(atomic_write, sys.argv[1])(Path(sys.argv[2])) as temporary:
    place = temporary / "chunk" if temporary.is_dir() else temporary
    place.write_bytes(b"half")
    print(temporary.name, flush=True)
    sys.stdin.read()
"""
"""Writes half of a file or folder, and waits."""


def files(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(params=["atomic_file", "atomic_folder"])
def way(request):
    return request.param


@contextmanager
def writing(way, place):
    """Another process that writes; yields it and the name of what it writes to."""
    words = [sys.executable, "-c", WAITING, way, str(place)]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def sweep(folder):
    atomic_write.remove_stale_files.cache_clear()
    atomic_write.remove_stale_files(folder)


def make_old(path):
    for one in (*path.rglob("*"), path):
        os.utime(one, (1.0, 1.0))


def test_only_what_a_killed_process_left_is_removed(tmp_path, way):
    with writing(way, tmp_path / "a.bin") as (process, name):
        sweep(tmp_path)
        assert files(tmp_path) == [name]
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert files(tmp_path) == [name]
        sweep(tmp_path)
    assert files(tmp_path) == []


def test_whoever_was_there_long_ago_or_elsewhere(tmp_path, way):
    """A lock that another machine holds may not be seen from here."""
    name = f"{atomic_write.PREFIX}00000000-00000000-{'0' * 32}.bin"
    with writing(way, tmp_path / "a.bin") as (process, held):
        (tmp_path / held).rename(tmp_path / name)
        process.kill()
        process.wait()
    sweep(tmp_path)
    assert files(tmp_path) == [name]
    make_old(tmp_path / name)
    sweep(tmp_path)
    assert files(tmp_path) == []


@pytest.mark.parametrize("shared", [0, 1])
def test_containers_share_the_system_and_replicas_the_name(tmp_path, monkeypatch, shared):
    with writing("atomic_file", tmp_path / "a.bin"):
        pass
    with writing("atomic_file", tmp_path / "a.bin") as (_, live):
        names = [*locks.machine_names()]
        names[1 - shared] = "0" * 8
        monkeypatch.setattr(atomic_write, "machine_names", lambda: tuple(names))
        sweep(tmp_path)
        assert files(tmp_path) == [live]


def test_where_nothing_can_be_locked_age_tells(tmp_path, monkeypatch, way):
    with writing(way, tmp_path / "a.bin") as (_, name):
        pass
    monkeypatch.setattr(locks, "_lock", lambda descriptor: False)
    sweep(tmp_path)
    assert files(tmp_path) == [name]
    make_old(tmp_path / name)
    sweep(tmp_path)
    assert files(tmp_path) == []


def test_files_of_others_are_kept(tmp_path):
    names = [
        ".mine.png",
        ".rasterjit-0-1-0123.png",
        f"{atomic_write.PREFIX}x-y-z.png",
        atomic_write.PREFIX,
    ]
    for name in names:
        (tmp_path / name).touch()
    os.mkfifo(tmp_path / f"{atomic_write.PREFIX}{'-'.join(locks.machine_names())}-{'1' * 32}")
    (tmp_path / "kept").touch()
    link = f"{atomic_write.PREFIX}{'-'.join(locks.machine_names())}-{'2' * 32}"
    (tmp_path / link).symlink_to(tmp_path / "kept")
    sweep(tmp_path)
    assert files(tmp_path) == sorted([*names, "kept", link])


def test_a_file_that_is_taken_for_nobodys_before_it_is_held(tmp_path, monkeypatch, way):
    """Another process may look between the making of a file and its lock."""
    seen = []

    def lock_late(path):
        if not seen:
            seen.append(path)
            sweep(tmp_path)
        return locks.lock(path)

    monkeypatch.setattr(atomic_write, "lock", lock_late)
    place = tmp_path / "a.bin"
    with getattr(atomic_write, way)(place) as temporary:
        assert len(seen) == 1
        assert temporary != seen[0]
        sweep(tmp_path)
        assert temporary.exists()
    assert files(tmp_path) == ["a.bin"]


def write_again_and_again(folder, number):
    for turn in range(100):
        atomic_write.remove_stale_files.cache_clear()
        with atomic_write.atomic_file(Path(folder, f"{number}.txt")) as temporary:
            temporary.write_text(f"{turn}")


def test_processes_that_write_and_clear_away_at_once(tmp_path):
    context = multiprocessing.get_context("spawn")
    crew = [
        context.Process(target=write_again_and_again, args=(str(tmp_path), number))
        for number in range(3)
    ]
    for one in crew:
        one.start()
    for one in crew:
        one.join()
    assert [one.exitcode for one in crew] == [0, 0, 0]
    assert files(tmp_path) == ["0.txt", "1.txt", "2.txt"]


def folder_at(place, content):
    place.mkdir()
    (place / "chunk").write_text(content)


def test_a_folder_is_replaced_or_kept(tmp_path):
    place = tmp_path / "a.zarr"
    folder_at(place, "old")
    with suppress(KeyError), atomic_write.atomic_folder(place) as temporary:
        (temporary / "chunk").write_text("new")
        raise KeyError
    assert (place / "chunk").read_text() == "old"
    with atomic_write.atomic_folder(place) as temporary:
        (temporary / "chunk").write_text("new")
    assert (place / "chunk").read_text() == "new"
    assert files(tmp_path) == ["a.zarr"]


@pytest.mark.parametrize("name", ["a.zarr", f"{'long' * 60}.zarr"])
def test_a_folder_of_any_name_is_replaced(tmp_path, name):
    folder_at(tmp_path / name, "old")
    with atomic_write.atomic_folder(tmp_path / name):
        pass
    assert files(tmp_path) == [name]
    assert files(tmp_path / name) == []


KILLED = """
import os, sys
from pathlib import Path
from rasterjit.io import atomic_write
place = Path(sys.argv[1])
plain = os.replace
def kill(source, target):
    if sys.argv[2] == "after":
        plain(source, target)
    print(flush=True)
    sys.stdin.read()
    os.replace = plain
    plain(source, target)
os.replace = kill
with atomic_write.atomic_folder(place) as temporary:
    (temporary / "chunk").write_text("new")
"""
"""Replaces a folder, and waits before or after the last step."""


@contextmanager
def moving(place, when):
    """Another process that has moved a folder aside."""
    words = [sys.executable, "-c", KILLED, str(place), when]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            process.stdout.readline()
            yield process
        finally:
            process.kill()


@pytest.fixture(params=["a.zarr", "link.zarr", f"{'long' * 60}.zarr"])
def old(request, tmp_path):
    """A folder, or a link to one, that is there."""
    place = tmp_path / "here" / request.param
    place.parent.mkdir()
    folder_at(tmp_path / "target" if "link" in request.param else place, "old")
    if "link" in request.param:
        place.symlink_to("../target")
    return place


@pytest.mark.parametrize(("when", "content"), [("before", "old"), ("after", "new")])
def test_what_was_moved_aside_before_a_kill_is_moved_back(old, when, content):
    with moving(old, when):
        assert len(files(old.parent)) == 2
    sweep(old.parent)
    assert files(old.parent) == [old.name]
    assert (old / "chunk").read_text() == content
    assert old.is_symlink() == (content == "old" and "link" in old.name)


def test_what_is_moved_aside_by_who_goes_on_stays_there(old):
    with moving(old, "before") as process:
        there = files(old.parent)
        sweep(old.parent)
        assert files(old.parent) == there
        process.communicate()
    assert process.returncode == 0
    assert files(old.parent) == [old.name]
    assert (old / "chunk").read_text() == "new"


def test_what_cannot_be_replaced_is_moved_back(old, monkeypatch):
    def refuse(source, target):
        raise PermissionError(errno.EACCES, "open", str(source), None, str(target))

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(PermissionError, match=old.name), atomic_write.atomic_folder(old):
        pass
    assert files(old.parent) == [old.name]
    assert (old / "chunk").read_text() == "old"


def test_files_named_nearly_like_ours_stop_no_save(tmp_path, way):
    begin = f"{atomic_write.PREFIX}{'-'.join(locks.machine_names())}-{'1' * 32}"
    for end in (".", "..", "-was-.", "-was-..", "-was-", "-was", "-was-a"):
        (tmp_path / f"{begin}{end}").touch()
    atomic_write.remove_stale_files.cache_clear()
    with getattr(atomic_write, way)(tmp_path / "b.bin"):
        pass
    assert (tmp_path / "b.bin").exists()


def test_a_folder_is_as_old_as_the_newest_in_it(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "_lock", lambda descriptor: False)
    folder = atomic_write._make_temporary_path(tmp_path / "a.zarr", ".zarr")
    (folder / "deep").mkdir(parents=True)
    (folder / "deep/chunk").touch()
    for one in (folder / "deep", folder):
        os.utime(one, (1.0, 1.0))
    sweep(tmp_path)
    assert (folder / "deep/chunk").exists()
    os.utime(folder / "deep/chunk", (1.0, 1.0))
    sweep(tmp_path)
    assert files(tmp_path) == []


def test_errors_name_what_was_asked_for(tmp_path, way):
    with (
        pytest.raises(OSError, match="No such file") as caught,
        getattr(atomic_write, way)(tmp_path / "none" / "a.bin"),
    ):
        pass
    assert caught.value.filename == str(tmp_path / "none" / "a.bin")
    assert atomic_write.PREFIX not in str(caught.value)
    (tmp_path / "b").mkdir()
    (tmp_path / "b/full").touch()
    with pytest.raises(OSError, match=r"b'$") as caught, atomic_write.atomic_file(tmp_path / "b"):
        pass
    assert files(tmp_path) == ["b"]


@pytest.fixture
def mandatory(monkeypatch):
    """Files that are locked refuse other descriptors, as on SMB shares under Linux."""
    fcntl = pytest.importorskip("fcntl")
    plain = open

    def refusing(path, mode="r", *words, **named):
        file = plain(path, "r+b" if mode == "wb" else mode, *words, **named)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise PermissionError(errno.EACCES, "Permission denied", str(path)) from None
        fcntl.flock(file, fcntl.LOCK_UN)
        return file

    monkeypatch.setattr(builtins, "open", refusing)


def test_where_locks_forbid_others_to_write_nothing_is_held(tmp_path, mandatory):
    with atomic_write.atomic_file(tmp_path / "a.bin") as temporary:
        assert files(tmp_path) == [temporary.name]
        with open(temporary, "wb") as file:
            file.write(b"whole")
        # Others must not take it for left, nor lock it: that would disturb who writes.
        sweep(tmp_path)
        assert temporary.exists()
    assert (tmp_path / "a.bin").read_bytes() == b"whole"
    assert files(tmp_path) == ["a.bin"]


def test_what_is_not_held_is_left_when_it_is_old(tmp_path):
    old = atomic_write._make_temporary_path(tmp_path / "a.bin", ".bin", atomic_write.UNLOCKED_NAMES)
    old.touch()
    sweep(tmp_path)
    assert old.exists()
    os.utime(old, (1.0, 1.0))
    sweep(tmp_path)
    assert files(tmp_path) == []


def test_files_that_seem_to_be_others_do_not_stop_a_save(tmp_path, monkeypatch, way):
    """Some file systems give another number of a file by its path than when it is open."""
    monkeypatch.setattr(locks.Lock, "is_at", lambda self, path: False)
    with getattr(atomic_write, way)(tmp_path / "a.bin") as temporary:
        assert files(tmp_path) == [temporary.name]
        sweep(tmp_path)
        assert temporary.exists()
    assert files(tmp_path) == ["a.bin"]


def test_where_files_cannot_be_open_age_tells(tmp_path, monkeypatch, way):
    """Windows removes no file that is open, and opens no folders."""

    def refuse(path):
        raise PermissionError(errno.EACCES, "open", str(path))

    with writing(way, tmp_path / "a.bin") as (_, name):
        pass
    monkeypatch.setattr(atomic_write, "USES_LOCKS", False)
    monkeypatch.setattr(atomic_write, "lock", refuse)
    sweep(tmp_path)
    assert files(tmp_path) == [name]
    make_old(tmp_path / name)
    sweep(tmp_path)
    assert files(tmp_path) == []
