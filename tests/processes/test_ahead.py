"""What is compiled ahead, or beside, is what rendering calls, and no process is left behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from rasterjit.cli import warmup
from rasterjit.runtime import ahead, jit, store
from rasterjit.runtime.ahead import Task

compiled_only = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="nothing is kept")

HERE = __name__


@pytest.fixture
def likely(monkeypatch):
    """`ahead` where nothing speaks against another process."""
    system = SimpleNamespace(
        executable=sys.executable, path=[*sys.path, str(Path(__file__).parent)],
        flags=SimpleNamespace(isolated=0),
    )  # fmt: skip
    monkeypatch.setattr(ahead, "sys", system)
    monkeypatch.setattr(ahead, "available_processors", lambda: 2)
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setattr(jit, "CHECKED", False)
    monkeypatch.setattr(store, "folder", lambda: Path("cache"))
    return ahead


def touch(path):
    """Do a task: leave a file."""
    Path(path).write_text(str(os.getpid()))


def fail(path):
    """Fail at a task."""
    raise ValueError(path)


def end(path):
    """End the process."""
    os._exit(3)


def tasks(function, *names):
    return [Task("test_ahead", function, (str(name),)) for name in names]


def test_tasks_are_done_in_other_processes(likely, tmp_path):
    paths = [tmp_path / str(n) for n in range(5)]
    done = []
    assert likely.do_all(tasks("touch", *paths), lambda: done.append(1), 2) == []
    assert len(done) == 5
    made_by = {path.read_text() for path in paths}
    assert 1 <= len(made_by) <= 2
    assert str(os.getpid()) not in made_by


def test_tasks_that_fail_are_returned_and_the_others_are_done(likely, tmp_path):
    wrong = tasks("fail", "a")
    right = tasks("touch", tmp_path / "b", tmp_path / "c")
    assert likely.do_all([right[0], *wrong, right[1]], lambda: None, 1) == wrong
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "c"]


def test_tasks_of_a_process_that_ends_are_returned(likely, tmp_path):
    all_of_them = [*tasks("end", "a"), *tasks("touch", tmp_path / "b")]
    assert likely.do_all(all_of_them, lambda: None, 1) == all_of_them


def wait_for(path):
    for _ in range(300):
        if path.exists() and path.read_text():
            return
        time.sleep(0.05)
    pytest.fail(f"{path} is not there")


@pytest.mark.parametrize("threads", [None, 2])
def test_another_process_works_beside_this_one_and_ends_with_the_context(likely, tmp_path, threads):
    path = tmp_path / "a"
    with likely.beside(tasks("touch", path), threads) as is_beside:
        assert is_beside
        wait_for(path)
    pid = int(path.read_text())
    assert pid != os.getpid()
    if Path("/proc/self/stat").exists():
        assert has_ended(pid)


ALONE = {
    "one processor": ("available_processors", lambda: 1),
    "no interpreter": ("sys.executable", ""),
    "frozen": ("sys.frozen", True),
    "isolated": ("sys.flags.isolated", 1),
    "no store": ("store.folder", lambda: None),
    "plain Python": ("jit.DISABLED", True),
    "checked indices": ("jit.CHECKED", True),
}
"""What speaks against another process: a name in `ahead`, and its value."""


@pytest.mark.parametrize("reason", ALONE)
def test_there_is_no_other_process_where_one_reason_is_enough(likely, monkeypatch, reason):
    path, value = ALONE[reason]
    *owners, name = path.split(".")
    owner = likely
    for one in owners:
        owner = getattr(owner, one)
    monkeypatch.setattr(owner, name, value, raising=False)
    monkeypatch.setattr(ahead, "_start", None)
    with likely.beside(tasks("touch", "a"), None) as is_beside:
        assert not is_beside


@pytest.mark.parametrize(("count", "threads"), [(0, None), (1, 1)])
def test_there_is_no_other_process_for_one_thread_or_for_nothing(
    likely, monkeypatch, count, threads
):
    monkeypatch.setattr(ahead, "_start", None)
    with likely.beside(tasks("touch", "a")[:count], threads) as is_beside:
        assert not is_beside


def test_an_error_here_leaves_no_process(likely, monkeypatch):
    started, start = [], ahead._start
    monkeypatch.setattr(ahead, "_start", lambda: started.append(start()) or started[0])
    with pytest.raises(KeyError), likely.beside(tasks("touch", os.devnull)):
        raise KeyError
    assert started[0].returncode is not None


STARTER = """
import sys, time
from rasterjit.runtime import ahead
start = ahead._start

def noted():
    other = start()
    print(other.pid, flush=True)
    return other

ahead._start = noted
ahead.available_processors = lambda: 2
with ahead.beside([ahead.Task("time", "sleep", (60,))]):
    time.sleep(60)
"""


def has_ended(pid):
    """Tell whether a process is gone, or waits for nothing but to be taken note of."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


@compiled_only
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are seen in /proc")
def test_another_process_ends_with_this_one_even_if_it_is_killed():
    with subprocess.Popen(
        [sys.executable, "-c", STARTER], stdout=subprocess.PIPE, text=True
    ) as starter:
        other = int(starter.stdout.readline())
        assert not has_ended(other)
        starter.kill()
    # Far less than it would sleep, far more than noticing.
    for _ in range(200):
        if has_ended(other):
            return
        time.sleep(0.1)
    pytest.fail(f"process {other} is still there")


COMPILE_TWO = """
import json
from rasterjit.cli import warmup
from rasterjit.runtime import ahead, jit, store

stages = [one for one in jit.STAGES if one.__name__ in {names!r}]
tasks = ahead.compiling(stages)
told = []
failed = ahead.do_all(tasks, lambda: told.append(1), 2)
left = len(ahead.compiling(stages))
for stage in stages:
    stage.address()
print(json.dumps([len(tasks), failed, len(told), left, *store.USED]))
"""


@compiled_only
def test_stages_are_compiled_from_their_list_without_drawing(tmp_path):
    tmp_path.chmod(0o700)
    names = [one.__name__ for one in jit.STAGES[:2]]
    assert len(names) == 2
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", COMPILE_TWO.format(names=names)],
        env={**os.environ, "RASTERJIT_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    count, failed, told, left, loaded, compiled = json.loads(done.stdout)
    assert (count, failed, told, left, compiled) == (2, [], 2, 0, [])
    assert sorted(name.rpartition(".")[2] for name in loaded) == sorted(names)


def test_warmup_does_all_stages_then_all_scenes_and_here_what_failed(monkeypatch):
    done, told, here = [], [], []

    def do_all(given, tell, processes):
        done.append([task.function for task in given])
        for _ in given:
            tell()
        return given[-1:]

    steps = [warmup.Step(name, lambda name=name: here.append(name)) for name in "abc"]
    monkeypatch.setattr(warmup, "steps", lambda: steps)
    monkeypatch.setattr(ahead, "is_possible", lambda: True)
    monkeypatch.setattr(ahead, "do_all", do_all)
    monkeypatch.setattr(ahead, "compiling", lambda stages: tasks("touch", "x"))
    monkeypatch.setattr(ahead, "compile_one", lambda *arguments: here.append(arguments))
    warmup.compile_all(lambda *what: told.append(what))
    assert done == [["touch"], 3 * ["run_step"]]
    assert here == [("x",), "c"]
    assert told == [
        ("stages", 0, 1), ("stages", 1, 1),
        ("scenes", 0, 3), ("scenes", 1, 3), ("scenes", 2, 3), ("scenes", 3, 3),
    ]  # fmt: skip


def test_every_usual_stage_is_one_of_the_list():
    modules = {stage.__module__ for stage in jit.STAGES}
    for begin in warmup.USUAL:
        assert any(module.startswith(begin) for module in modules), begin
