"""What is compiled ahead, or beside, is what rendering calls, and no process is left behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

import rasterjit as rj
from rasterjit.cli import warmup
from rasterjit.pipeline import srgb_encoding
from rasterjit.rendering.planning import list_compile_tasks
from rasterjit.runtime import background_compile, jit, stage_runner, store
from rasterjit.runtime.background_compile import Task

pytestmark = pytest.mark.takes_long

compiled_only = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="nothing is kept")

SEES_PROCESSES = Path("/proc/self/stat").exists()


@pytest.fixture
def likely(monkeypatch):
    """`ahead` where nothing speaks against another process."""
    system = SimpleNamespace(
        executable=sys.executable, path=[*sys.path, str(Path(__file__).parent)],
        flags=SimpleNamespace(isolated=0),
    )  # fmt: skip
    monkeypatch.setattr(background_compile, "sys", system)
    monkeypatch.setattr(background_compile, "available_processors", lambda: 2)
    background_compile._BACKGROUND_WORKER.end()
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setattr(jit, "CHECKED", False)
    monkeypatch.setattr(store, "kernel_folder", lambda: Path("cache"))
    yield background_compile
    background_compile._BACKGROUND_WORKER.end()


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
    assert likely.run_tasks(tasks("touch", *paths), lambda: done.append(1), 2) == []
    assert len(done) == 5
    made_by = {path.read_text() for path in paths}
    assert 1 <= len(made_by) <= 2
    assert str(os.getpid()) not in made_by


def test_tasks_that_fail_are_returned_and_the_others_are_done(likely, tmp_path):
    wrong = tasks("fail", "a")
    right = tasks("touch", tmp_path / "b", tmp_path / "c")
    assert likely.run_tasks([right[0], *wrong, right[1]], lambda: None, 1) == wrong
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "c"]


def test_tasks_of_a_process_that_ends_are_returned(likely, tmp_path):
    all_of_them = [*tasks("end", "a"), *tasks("touch", tmp_path / "b")]
    assert likely.run_tasks(all_of_them, lambda: None, 1) == all_of_them


def test_what_a_process_that_ends_leaves_is_done_by_the_others(likely, tmp_path):
    paths = [tmp_path / str(n) for n in range(6)]
    lost = tasks("end", "a")
    assert likely.run_tasks([*lost, *tasks("touch", *paths)], lambda: None, 2) == lost
    assert all(path.exists() for path in paths)


def wait_for(path):
    for _ in range(300):
        if path.exists() and path.read_text():
            return
        time.sleep(0.05)
    pytest.fail(f"{path} is not there")


def is_running(pid):
    """Tell whether a process is there, and not only waits to be taken note of."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return stat.rsplit(")", 1)[1].split()[0] != "Z"


def wait_for_end(pid):
    for _ in range(200):
        if not is_running(pid):
            return
        time.sleep(0.1)
    pytest.fail(f"process {pid} is still there")


def note_starts(monkeypatch):
    """Return a list that gets an item for each process that would be started."""
    started = []

    def refuse(*_):
        started.append(1)
        raise OSError

    monkeypatch.setattr(background_compile, "_start_worker", refuse)
    return started


def say_that_something_compiles():
    for tell in tuple(store.BEFORE_COMPILING):
        tell()


@pytest.mark.parametrize("threads", [None, 2])
def test_another_process_works_beside_this_one_and_waits_for_more(likely, tmp_path, threads):
    path, later, last = (tmp_path / name for name in "abc")
    with likely.compile_in_background(lambda: tasks("touch", path), threads, at_once=True):
        wait_for(path)
        # The process is there: a frame's few tasks go to it.
        with likely.compile_in_background(lambda: tasks("touch", later), threads):
            say_that_something_compiles()
            wait_for(later)
    assert store.BEFORE_COMPILING == []
    with likely.compile_in_background(lambda: tasks("touch", last), threads):
        say_that_something_compiles()
        wait_for(last)
    pid = int(path.read_text())
    assert pid != os.getpid()
    assert later.read_text() == last.read_text() == str(pid)
    assert is_running(pid) or not SEES_PROCESSES
    likely._BACKGROUND_WORKER.end()
    assert not is_running(pid)


def test_another_process_ends_when_nothing_is_asked_of_it(likely, tmp_path, monkeypatch):
    monkeypatch.setattr(background_compile, "MAX_IDLE_SECONDS", 0.5)
    with likely.compile_in_background(lambda: tasks("touch", tmp_path / "a"), at_once=True):
        wait_for(tmp_path / "a")
        assert background_compile._BACKGROUND_WORKER._process.wait(20) == 0


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no process is forked")
def test_a_forked_process_leaves_the_other_process_alone(likely, tmp_path):
    path, own = tmp_path / "a", tmp_path / "b"
    with likely.compile_in_background(lambda: tasks("touch", path), at_once=True):
        wait_for(path)
        background_compile._BACKGROUND_WORKER._lock.acquire()  # As another thread may.
        child = os.fork()
        if child == 0:
            is_clean = (
                background_compile._BACKGROUND_WORKER._process is None
                and store.BEFORE_COMPILING == []
            )
            with (
                suppress(BaseException),
                likely.compile_in_background(lambda: tasks("touch", own), at_once=True),
            ):
                wait_for(own)
                background_compile._BACKGROUND_WORKER.end()
                os._exit(0 if is_clean else 1)
            os._exit(2)
        background_compile._BACKGROUND_WORKER._lock.release()
        for _ in range(300):
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                break
            time.sleep(0.1)
        else:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            pytest.fail("the forked process hangs")
        assert os.waitstatus_to_exitcode(status) == 0
        assert own.read_text() != path.read_text()
        assert background_compile._BACKGROUND_WORKER._process.poll() is None


def test_another_process_starts_when_this_one_compiles_and_is_asked_for_much(
    likely, tmp_path, monkeypatch
):
    listed, paths = [], [tmp_path / str(n) for n in range(background_compile.MIN_TASKS_FOR_PROCESS)]

    def list_many():
        listed.append(1)
        return tasks("touch", *paths)

    with likely.compile_in_background(list_many):
        pass
    assert listed == []
    with likely.compile_in_background(list_many):
        say_that_something_compiles()
        say_that_something_compiles()
        wait_for(paths[-1])
    assert listed == [1]
    background_compile._BACKGROUND_WORKER.end()
    started = note_starts(monkeypatch)
    with likely.compile_in_background(lambda: tasks("touch", *paths[1:])):
        say_that_something_compiles()
    assert started == []
    with likely.compile_in_background(lambda: tasks("touch", *paths)):
        say_that_something_compiles()
    assert started == [1]


def test_an_error_of_a_list_ends_nothing(likely):
    listed = []

    def list_wrongly():
        listed.append(1)
        raise KeyError

    with (
        likely.compile_in_background(list_wrongly),
        likely.compile_in_background(lambda: listed.append(2) or []),
    ):
        say_that_something_compiles()
    assert sorted(listed) == [1, 2]


def test_what_is_asked_for_last_is_done_first(likely, tmp_path):
    paths = [tmp_path / name for name in "abcd"]
    slow = Task("time", "sleep", (1.0,))
    with likely.compile_in_background(lambda: [slow, *tasks("touch", *paths[:2])], at_once=True):
        pass
    with likely.compile_in_background(lambda: tasks("touch", *paths[2:]), at_once=True):
        wait_for(paths[1])
    done = sorted(paths, key=lambda path: path.stat().st_mtime_ns)
    assert [path.name for path in done] == ["c", "d", "a", "b"]


@pytest.mark.skipif(not SEES_PROCESSES, reason="processes are seen in /proc")
def test_one_that_ended_leaves_no_entry_in_the_table_of_processes(likely, tmp_path):
    with likely.compile_in_background(lambda: tasks("end", "a"), at_once=True):
        pid = background_compile._BACKGROUND_WORKER._process.pid
        for _ in range(200):
            if not Path(f"/proc/{pid}").exists():
                break
            time.sleep(0.05)
        else:
            pytest.fail("nobody took note of its end")


def test_one_that_ended_is_replaced(likely, tmp_path):
    path = tmp_path / "a"
    with likely.compile_in_background(lambda: tasks("end", path), at_once=True):
        for _ in range(300):
            if background_compile._BACKGROUND_WORKER._process.poll() is not None:
                break
            time.sleep(0.05)
        else:
            pytest.fail("it has not ended")
        with likely.compile_in_background(lambda: tasks("touch", path), at_once=True):
            wait_for(path)


def test_a_system_that_starts_no_process_is_no_error(likely, monkeypatch):
    def refuse(*_, **options):
        raise OSError

    monkeypatch.setattr(background_compile.subprocess, "Popen", refuse)
    with likely.compile_in_background(lambda: tasks("touch", "a"), at_once=True):
        assert background_compile._BACKGROUND_WORKER._process is None


@compiled_only
def test_compiling_is_told_and_loading_is_not(tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(store, "BEFORE_COMPILING", [lambda: told.append(1)])
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    store.load(stage_runner.run_list, stage_runner.run_list.kind)
    assert told
    told.clear()
    store.load(stage_runner.run_list, stage_runner.run_list.kind)
    assert told == []


@compiled_only
@pytest.mark.parametrize("pause", [0.0, 60.0])
def test_the_compiler_tells_on_its_way_that_it_goes_on(tmp_path, monkeypatch, pause):
    told = []

    def tell():
        told.append(1)
        if len(told) > 1:
            raise ValueError("this is no error of the kernel")

    monkeypatch.setattr(store, "NOTIFY_SECONDS", pause)
    monkeypatch.setattr(store, "BEFORE_COMPILING", [tell])
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    # Before the kernel, at its helpers, and before what LLVM does.
    store.load(srgb_encoding.encode_rows, srgb_encoding.encode_rows.declared[0])
    assert len(told) >= 4 if pause == 0.0 else len(told) == 1


@compiled_only
@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
def test_waiting_for_another_that_compiles_is_told(tmp_path, monkeypatch):
    import fcntl

    told = []
    path = tmp_path / "a.kernel"
    with open(path.with_suffix(store.LOCK), "ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)

        def let_go():
            told.append(1)
            fcntl.flock(file, fcntl.LOCK_UN)

        monkeypatch.setattr(store, "BEFORE_COMPILING", [let_go])
        with store.lock_entry(path):
            assert told == [1]


@pytest.mark.parametrize(
    ("platform", "order"), [("win32", ["import", "read"]), ("linux", ["read"])]
)
def test_on_windows_a_worker_imports_the_compiler_before_a_thread_reads(
    monkeypatch, platform, order
):
    done, here = [], threading.current_thread()

    def lines():
        done.append("read")
        yield "[]"

    def leave(code):
        if threading.current_thread() is here:
            raise SystemExit(code)

    system = SimpleNamespace(platform=platform, stdin=lines())
    monkeypatch.setattr(background_compile, "sys", system)
    monkeypatch.setattr(background_compile.os, "_exit", leave)
    monkeypatch.setattr(
        background_compile.isolated_numba, "compiler", lambda: done.append("import")
    )
    with pytest.raises(SystemExit):
        background_compile.serve_tasks(1.0)
    assert done == order


ALONE = {
    "one processor": ("available_processors", lambda: 1),
    "no interpreter": ("sys.executable", ""),
    "a program with Python inside": ("sys.executable", "/opt/happy/modeller-py.bin"),
    "frozen": ("sys.frozen", True),
    "isolated": ("sys.flags.isolated", 1),
    "no store": ("store.kernel_folder", lambda: None),
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
    started = note_starts(monkeypatch)
    with likely.compile_in_background(lambda: tasks("touch", "a"), at_once=True):
        say_that_something_compiles()
    assert started == []


@pytest.mark.parametrize(("count", "threads"), [(0, None), (1, 1)])
def test_there_is_no_other_process_for_one_thread_or_for_nothing(
    likely, monkeypatch, count, threads
):
    started = note_starts(monkeypatch)
    with likely.compile_in_background(lambda: tasks("touch", "a")[:count], threads, at_once=True):
        say_that_something_compiles()
    assert started == []


def test_an_error_here_leaves_nobody_who_asks(likely):
    with suppress(KeyError), likely.compile_in_background(list):
        assert len(store.BEFORE_COMPILING) == 1
        raise KeyError
    assert store.BEFORE_COMPILING == []


STARTER = """
import sys, time
from rasterjit.runtime import background_compile
start = background_compile._start_worker

def noted(*options):
    other = start(*options)
    print(other.pid, flush=True)
    return other

background_compile._start_worker = noted
background_compile.available_processors = lambda: 2
naps = lambda: [background_compile.Task("time", "sleep", (60,))]
with background_compile.compile_in_background(naps, at_once=True):
    time.sleep(60)
"""


@compiled_only
@pytest.mark.skipif(not SEES_PROCESSES, reason="processes are seen in /proc")
def test_another_process_ends_with_this_one_even_if_it_is_killed():
    with subprocess.Popen(
        [sys.executable, "-c", STARTER], stdout=subprocess.PIPE, text=True
    ) as starter:
        other = int(starter.stdout.readline())
        assert is_running(other)
        starter.kill()
    # Far less than it would sleep, far more than noticing.
    wait_for_end(other)


COMPILE_TWO = """
import importlib, json
from rasterjit.cli import warmup
from rasterjit.runtime import background_compile, jit, store

for module in {modules!r}:
    importlib.import_module(module)
stages = [one for one in jit.STAGES if one.__name__ in {names!r}]
tasks = background_compile.make_compile_tasks(stages)
told = []
failed = background_compile.run_tasks(tasks, lambda: told.append(1), 2)
left = len(background_compile.make_compile_tasks(stages))
for stage in stages:
    stage.address()
print(json.dumps([len(tasks), failed, len(told), left, *store.USED_KERNELS]))
"""


@compiled_only
def test_stages_are_compiled_from_their_list_without_drawing(tmp_path):
    tmp_path.chmod(0o700)
    names = [one.__name__ for one in jit.STAGES[:2]]
    modules = [one.__module__ for one in jit.STAGES[:2]]
    assert len(names) == 2
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", COMPILE_TWO.format(names=names, modules=modules)],
        env={**os.environ, "RASTERJIT_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    count, failed, told, left, loaded, compiled = json.loads(done.stdout)
    assert (count, failed, told, left, compiled) == (2, [], 2, 0, [])
    assert sorted(name.rpartition(".")[2] for name in loaded) == sorted(names)


def test_warmup_compiles_every_form_and_here_what_failed(monkeypatch):
    done, told, here = [], [], []

    def run_tasks(given, tell):
        done.append(given)
        for _ in given:
            tell()
        return given[-1:]

    monkeypatch.setattr(background_compile, "can_start_process", lambda: True)
    monkeypatch.setattr(background_compile, "run_tasks", run_tasks)
    monkeypatch.setattr(
        background_compile, "compile_if_missing", lambda *arguments: here.append(arguments)
    )
    monkeypatch.setattr(store, "is_stored", lambda *_: False)
    warmup.compile_all(lambda *what: told.append(what))
    (given,) = done
    own = [one for one in (*jit.KERNELS, *jit.STAGES) if one.__module__.startswith("rasterjit.")]
    assert len(own) > 100
    compiled = {task.arguments for task in given}
    assert compiled >= {
        (one.__module__, one.__name__, number) for one in own for number in range(len(one.declared))
    }
    assert here == [given[-1].arguments]
    assert told == [(n, len(given)) for n in range(len(given) + 1)]


@compiled_only
@pytest.mark.parametrize("threads", [1, 2])
def test_a_frame_that_compiles_asks_for_what_it_will_call(cube, monkeypatch, threads):
    taken = []
    monkeypatch.setattr(background_compile, "available_processors", lambda: 2)
    monkeypatch.setattr(background_compile, "can_start_process", lambda: True)
    monkeypatch.setattr(
        background_compile._BACKGROUND_WORKER,
        "submit",
        lambda tasks, min_to_start: taken.append(tasks),
    )
    monkeypatch.setattr(store, "is_stored", lambda *_: False)
    scene = rj.Scene()
    scene.add(cube)
    with rj.Renderer((16, 12), threads=threads) as renderer:
        renderer.on_picture = say_that_something_compiles
        frame = renderer.render(scene)
    assert taken == ([] if threads == 1 else [list_compile_tasks(frame.plan)])


@compiled_only
def test_what_a_frame_will_call_is_compiled_beside_it(cube, monkeypatch):
    scene, camera = rj.Scene(), rj.PerspectiveCamera(eye=(2.5, 3.0, 4.0), target=(0.0, 0.0, 0.0))
    scene.add(cube)
    monkeypatch.setattr(store, "is_stored", lambda *_: False)
    listed = [task.arguments[1] for task in list_compile_tasks(rj.explain(scene, camera))]
    assert listed[0] == "write_opaque_codes"
    assert listed[-3:] == ["transform_vertices", "measure_boxes", "place_views"]
    assert {"draw_tiles", "list_samples", "find_points"} <= {*listed}
    assert not {"clip_faces", "read_textures", "find_layers"} & {*listed}
    assert len({*listed}) == len(listed)


ON_A_TERMINAL = """
import sys
import rasterjit as rj
from rasterjit.runtime import progress
progress.MIN_SECONDS = 0.0
rj.render(rj.load(sys.argv[1]), size=(32, 24))
print("end", file=sys.stderr)
"""


@compiled_only
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there is no terminal to imitate")
@pytest.mark.parametrize("is_terminal", [True, False])
def test_on_a_terminal_a_render_says_how_far_compiling_is(tmp_path, is_terminal):
    cube = str(Path(__file__).parents[2] / "models" / "cube.ply")
    rj.render(rj.load(cube), size=(32, 24))
    # A store that lacks one kernel.
    tmp_path.chmod(0o700)
    for entry in store.kernel_folder().glob("*.kernel"):
        if not entry.name.startswith("find_points_"):
            shutil.copy(entry, tmp_path)
    ours, theirs = os.openpty() if is_terminal else os.pipe()
    with open(ours, "rb", buffering=0) as shown:
        subprocess.run(
            [sys.executable, "-c", ON_A_TERMINAL, cube], stderr=theirs, check=True,
            env={**os.environ, "RASTERJIT_CACHE_DIR": str(tmp_path)},
        )  # fmt: skip
        os.close(theirs)
        said = shown.read(4096).decode().replace("\r\n", "\n")
    *lines, last = said.split("\r")
    assert last == "end\n"
    if not is_terminal:
        assert lines == []
        return
    first, *shown, blank = lines
    assert first == blank.strip() == ""
    text, seconds = "rasterjit: compiling kernels .......... 0 of 1, ", []
    for line in shown:
        assert line.startswith(text)
        seconds.append(int(line.removeprefix(text).removesuffix(" s (kept on disk)")))
    assert seconds
    assert seconds == sorted(set(seconds))
