"""Whoever does the work, and however often it is interrupted, the bytes are the same."""

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from made_meshes import BROKEN, GOOD, contents, make_meshes

from rasterjit.dataset import dataset_builder
from rasterjit.dataset.recipe import Recipe

pytestmark = [pytest.mark.takes_long, pytest.mark.needs_jit]

RECIPE = Recipe(views=3, size=(24, 16), outputs=("color", "depth", "normal", "mask"))
OPTIONS = ("--views", "3", "--size", "24x16", "--outputs", "mask,normal,depth,color")


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    return make_meshes(tmp_path_factory.mktemp("meshes"))


@pytest.fixture(scope="module")
def whole(meshes, tmp_path_factory):
    """What the data set holds that this process makes without interruption."""
    place = tmp_path_factory.mktemp("whole")
    dataset_builder.make(meshes, place, RECIPE)
    return contents(place)


def command(meshes, place, *options):
    return [
        sys.executable, "-m", "rasterjit", "dataset", str(meshes), "-o", str(place), *OPTIONS,
        *options,
    ]  # fmt: skip


def is_begun(place):
    """Tell whether a mesh is done; os.walk does not mind that folders come and go meanwhile."""
    return any(
        "transforms.json" in files and "partial" not in at for at, _, files in os.walk(place)
    )


def test_two_processes_give_the_same_bytes_as_one(meshes, whole, tmp_path):
    done = subprocess.run(
        command(meshes, tmp_path / "set", "--workers", "2"),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    # Some cannot be read, as with one process.
    assert done.returncode == 1, done.stderr
    assert f"{len(GOOD)} meshes, {3 * len(GOOD)} views" in done.stdout
    assert f"0 were there, {len(BROKEN)} failed" in done.stdout
    assert all(f"left out {name}: " in done.stderr for name in BROKEN)
    assert contents(tmp_path / "set") == whole


SLOWLY = """
import sys, time
from rasterjit import Frame
from rasterjit.cli import commands as cli

real = Frame.save

def save(self, path, *arguments, **options):
    time.sleep(0.05)
    real(self, path, *arguments, **options)

Frame.save = save
if __name__ == "__main__":
    cli.program.main(args=sys.argv[1:], prog_name="rasterjit")
"""
"""The command line, with time to be interrupted in; its worker processes read this, too."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_ctrl_c_ends_cleanly_and_the_next_run_goes_on(meshes, whole, tmp_path):
    place = tmp_path / "set"
    script = tmp_path / "slowly.py"
    script.write_text(SLOWLY)
    arguments = command(meshes, place, "--workers", "2")
    arguments[1:3] = [str(script)]
    # A group of its own: Ctrl-C in a terminal reaches every process of it.
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    ) as running:  # fmt: skip
        deadline = time.monotonic() + 200
        while not is_begun(place) and time.monotonic() < deadline:
            assert running.poll() is None, running.stderr.read()
            time.sleep(0.01)
        os.killpg(running.pid, signal.SIGINT)
        _, said = running.communicate(timeout=100)
    assert running.returncode == 130
    assert said.strip().endswith("error: interrupted")
    assert "Traceback" not in said
    found = contents(place)
    done = {name for name in found if name.endswith("transforms.json")}
    assert 1 <= len(done) < len(GOOD)
    assert found.items() <= whole.items()
    assert not list(place.glob(".*"))
    assert dataset_builder.make(meshes, place, RECIPE).present == len(done)
    assert contents(place) == whole


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no groups of processes")
def test_processes_end_with_the_one_that_is_killed(meshes, tmp_path):
    script = tmp_path / "slowly.py"
    script.write_text(SLOWLY)
    arguments = command(meshes, tmp_path / "set", "--workers", "2")
    arguments[1:3] = [str(script)]
    with subprocess.Popen(
        arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    ) as running:
        deadline = time.monotonic() + 200
        while not is_begun(tmp_path / "set") and time.monotonic() < deadline:
            assert running.poll() is None
            time.sleep(0.01)
        assert len(alive(running.pid)) > 2
        running.kill()
    deadline = time.monotonic() + 20
    while (left := alive(running.pid)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not left


def alive(group):
    """Return the processes of a group that have not ended."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(ProcessLookupError, psutil.NoSuchProcess):
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process.pid)
    return found


def test_a_worker_that_dies_is_told_and_the_next_run_goes_on(meshes, whole, tmp_path):
    """As when memory runs out and the system kills a process."""
    place = tmp_path / "set"
    script = tmp_path / "deadly.py"
    script.write_text(
        "import os, sys\n"
        "from rasterjit import Frame\n"
        "from rasterjit.cli import commands as cli\n"
        "if __name__ != '__main__':\n"
        "    Frame.save = lambda *arguments, **options: os._exit(9)\n"
        "else:\n"
        "    cli.program.main(args=sys.argv[1:], prog_name='rasterjit')\n"
    )
    arguments = command(meshes, place, "--workers", "2")
    arguments[1:3] = [str(script)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, timeout=200)
    assert done.returncode == 1
    assert done.stderr.startswith("error: a worker process died")
    assert contents(place).items() <= whole.items()
    dataset_builder.make(meshes, place, RECIPE)
    assert contents(place) == whole


needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None and not os.environ.get("CI"),
    reason="Dask is not installed",
)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """A scheduler and a worker, each a process, as on two machines."""
    place = tmp_path_factory.mktemp("dask")
    told = place / "scheduler.json"
    environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__DAEMON": "false"}
    start = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    run = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": place}
    with subprocess.Popen(
        [*start, "--port", "0", "--no-dashboard", "--scheduler-file", str(told)],
        env=environment, **run,
    ) as first:  # fmt: skip
        deadline = time.monotonic() + 60
        while not told.is_file():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        address = json.loads(told.read_text())["address"]
        with subprocess.Popen(
            [
                sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-dashboard",
                "--nthreads", "1", "--no-nanny", "--local-directory", str(place),
            ],
            env=environment, **run,
        ) as second:  # fmt: skip
            yield address, first
            second.terminate()
        first.terminate()


@needs_dask
def test_a_dask_cluster_gives_the_same_bytes(meshes, whole, tmp_path, scheduler):
    done = subprocess.run(
        command(meshes, tmp_path / "set", "--workers", scheduler[0]),
        capture_output=True, text=True, check=False, timeout=200,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert contents(tmp_path / "set") == whole


@needs_dask
def test_a_scheduler_that_is_lost_is_told_and_the_next_run_goes_on(
    meshes, whole, tmp_path, scheduler
):
    place = tmp_path / "set"
    environment = {
        **os.environ,
        "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s",
        "DASK_DISTRIBUTED__COMM__RETRY__COUNT": "0",
    }
    arguments = command(meshes, place, "--workers", scheduler[0])
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as running:
        deadline = time.monotonic() + 200
        while not is_begun(place) and time.monotonic() < deadline:
            assert running.poll() is None, running.stderr.read()
            time.sleep(0.001)
        scheduler[1].kill()
        _, said = running.communicate(timeout=100)
    if running.returncode == 0:
        pytest.skip("the work was done before the scheduler was gone")
    assert running.returncode == 1
    assert "run again to go on" in said
    dataset_builder.make(meshes, place, RECIPE)
    assert contents(place) == whole


@needs_dask
def test_no_scheduler_is_an_error_that_names_the_address(meshes, tmp_path, monkeypatch):
    monkeypatch.setattr("rasterjit.dataset.dataset_builder.CONNECT_TIMEOUT", 0.3)
    with pytest.raises(dataset_builder.LostWorkersError, match="no scheduler answers at tcp://127"):
        dataset_builder.make(meshes, tmp_path / "set", RECIPE, workers="tcp://127.0.0.1:9")


def test_without_dask_the_extra_is_named(meshes, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r'pip install "rasterjit\[distributed\]"'):
        dataset_builder.make(meshes, tmp_path / "set", RECIPE, workers="tcp://127.0.0.1:9")
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("options", "code", "text"),
    [
        (("--workers", "0"), 2, "neither a number"),
        (("--workers", "many"), 2, "neither a number"),
        (("--views", "0"), 2, "--views"),
        (("--outputs", "color,smell"), 2, "smell"),
        (("--size", "0"), 2, "1..16384"),
        (("--cameras", "cube"), 2, "--cameras"),
        (("--fov", "180"), 2, "--fov"),
        (("--up", "0,0,0"), 1, "up"),
    ],
)
def test_a_wrong_option_is_one_line(meshes, tmp_path, options, code, text):
    from click.testing import CliRunner

    from rasterjit.cli import commands

    result = CliRunner().invoke(
        commands.program, [*command(meshes, tmp_path / "set")[3:], *options]
    )
    assert result.exit_code == code
    assert text in result.stderr
    assert result.stderr.count("\n") == 1
    assert not Path(tmp_path / "set").exists()
