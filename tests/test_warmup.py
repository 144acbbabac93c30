"""Kernels compiled ahead are those that rendering calls, in whichever process they were made."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest

import rasterjit as rj
from rasterjit import edge_lines, stages, warmup
from rasterjit.kernels import jit, setup
from rasterjit.kernels.shading import shade_rows
from rasterjit.kernels.visibility import draw_tiles
from rasterjit.plan import OUTPUTS

compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set"
)

SCRIPT = """
import sys
import rasterjit as rj
from rasterjit import warmup
from rasterjit.kernels import jit
from rasterjit.kernels.shading import shade_rows
from rasterjit.kernels.visibility import draw_tiles

def main():
    scene = warmup._square()
    warmup.available_processors = lambda: 2
    with warmup.two_processes(None) as compile_all:
        compile_all(scene, None)
    assert jit.is_cached(draw_tiles) and jit.is_cached(shade_rows)
    frame = rj.render(scene, size=(32, 24))
    made = [k.__name__ for k in jit.KERNELS if sum(k.stats.cache_misses.values())]
    loaded = [k.__name__ for k in jit.KERNELS if sum(k.stats.cache_hits.values())]
    assert made == ["shade_rows"], made
    assert "draw_tiles" in loaded and "transform_vertices" in loaded, loaded
    assert all(len(k.signatures) <= 1 for k in jit.KERNELS)
    with warmup.two_processes(None) as compile_all:
        assert compile_all is None
    print(frame.stats.pixels_covered)

main()
"""


@compiled_only
def test_two_processes_compile_each_kernel_once(tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SCRIPT],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    expected = rj.render(warmup._square(), size=(32, 24)).stats.pixels_covered
    assert int(done.stdout) == expected > 0


class StartedError(Exception):
    """Another process was started."""


@pytest.fixture
def two(monkeypatch):
    """`warmup` where nothing speaks against another process; to start one raises `StartedError`."""

    def start(*arguments, **options):
        raise StartedError

    system = SimpleNamespace(
        executable=sys.executable, path=sys.path, flags=SimpleNamespace(isolated=0)
    )
    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(warmup, "sys", system)
    monkeypatch.setattr(warmup, "available_processors", lambda: 2)
    monkeypatch.setattr(warmup, "cache_folder", lambda: Path("cache"))
    monkeypatch.setattr(warmup, "is_cached", lambda kernel: False)
    return warmup


@pytest.mark.parametrize("threads", [None, 2])
def test_another_process_is_started_where_nothing_speaks_against_it(two, threads):
    with pytest.raises(StartedError), two.two_processes(threads):
        pass


ONE_PROCESS = {
    "one processor": ("available_processors", lambda: 1),
    "no interpreter": ("sys.executable", ""),
    "frozen": ("sys.frozen", True),
    "isolated": ("sys.flags.isolated", 1),
    "no cache": ("cache_folder", lambda: None),
    "visibility is cached": ("is_cached", lambda kernel: kernel is draw_tiles),
    "shading is cached": ("is_cached", lambda kernel: kernel is shade_rows),
}
"""What speaks against another process: a name in `warmup`, and its value."""


@pytest.mark.parametrize("reason", ONE_PROCESS)
def test_nothing_is_compiled_elsewhere_where_one_reason_is_enough(two, monkeypatch, reason):
    path, value = ONE_PROCESS[reason]
    *owners, name = path.split(".")
    owner = two
    for one in owners:
        owner = getattr(owner, one)
    monkeypatch.setattr(owner, name, value, raising=False)
    with two.two_processes(None) as compile_all:
        assert compile_all is None


def test_nothing_is_compiled_elsewhere_for_one_thread(two):
    with two.two_processes(1) as compile_all:
        assert compile_all is None


@compiled_only
def test_another_process_that_fails_or_an_error_here_leaves_no_process(monkeypatch):
    monkeypatch.setattr(warmup, "available_processors", lambda: 2)
    monkeypatch.setattr(warmup, "is_cached", lambda kernel: False)
    monkeypatch.setattr(warmup, "OTHER_PROCESS", "raise SystemExit(1)")
    with warmup.two_processes(None) as compile_all:
        compile_all(warmup._square(), None)
    assert rj.render(warmup._square(), size=(8, 8)).stats.pixels_covered > 0
    started = []
    popen = subprocess.Popen

    def start(*arguments, **options):
        started.append(popen(*arguments, **options))
        return started[0]

    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(warmup, "OTHER_PROCESS", "import time; time.sleep(60)")
    with pytest.raises(KeyError), warmup.two_processes(None):
        raise KeyError
    assert started[0].returncode is not None


BEFORE_SHADING = [
    (stages.projection, "transform_vertices"),
    (stages.projection, "project_vertices"),
    (stages.setup, "set_up_triangles"),
    (stages.binning, "bin_triangles"),
    (stages.occlusion, "find_floors"),
    (stages.visibility, "draw_tiles"),
]


STARTER = """
import subprocess, time
from rasterjit import warmup

start = subprocess.Popen

def noted(*arguments, **options):
    other = start(*arguments, **options)
    print(other.pid, flush=True)
    return other

subprocess.Popen = noted
warmup.available_processors = lambda: 2
with warmup.two_processes(2):
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
def test_another_process_ends_with_this_one_even_if_it_is_killed(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, "-c", STARTER], stdout=subprocess.PIPE, text=True, env=environment
    ) as starter:
        other = int(starter.stdout.readline())
        assert not has_ended(other)
        starter.kill()
    # Far less than compiling takes, far more than noticing.
    for _ in range(50):
        if has_ended(other):
            return
        time.sleep(0.1)
    pytest.fail(f"process {other} is still there")


@pytest.fixture
def nothing_before_shading(monkeypatch):
    """No kernel before shading can be called."""

    def refuse(*arguments):
        raise AssertionError("a kernel before shading was called")

    for module, name in BEFORE_SHADING:
        monkeypatch.setattr(module, name, refuse)


@pytest.mark.usefixtures("nothing_before_shading")
def test_a_blank_frame_calls_no_kernel_of_visibility_and_shows_the_background():
    with pytest.raises(AssertionError, match="was called"):
        rj.render(warmup._square(), size=(9, 7), threads=1)
    frame = warmup.BlankRenderer((9, 7), threads=1).render(
        warmup._square(), background="red", outputs=OUTPUTS, previous=rj.View()
    )
    assert (frame.color == (255, 0, 0, 255)).all()
    assert (frame.face_id == -1).all()
    assert np.isinf(frame.depth).all()
    assert frame.stats.pixels_covered == 0


@pytest.mark.parametrize(("alpha_mode", "samples"), [("blend", 1), ("blend", 4), ("opaque", 4)])
def test_a_blank_frame_of_layers_shows_the_background(alpha_mode, samples):
    square = warmup._square().nodes[0].mesh
    material = rj.Material(base_color=(1.0, 1.0, 1.0, 0.5), alpha_mode=alpha_mode)
    mesh = rj.Mesh(square.vertices, square.faces, material=material)
    with warmup.BlankRenderer((9, 7), quality=rj.Quality(samples=samples), threads=1) as renderer:
        frame = renderer.render(mesh, background="red", outputs=("color", "coverage"))
    assert (frame.color == (255, 0, 0, 255)).all()
    assert not frame.coverage.any()


@pytest.mark.usefixtures("nothing_before_shading")
@pytest.mark.parametrize("mode", ["only", "overlay"])
@pytest.mark.parametrize("count", [3, 2 * stages.SPARE_VERTICES])
def test_a_blank_frame_has_no_edges_and_knows_all_vertices(monkeypatch, mode, count):
    project_edges, calls = edge_lines.wireframe.project_edges, []

    def project(edges, vertices, *others):
        seen = project_edges(edges, vertices, *others)
        calls.append((edges.copy(), *(array.copy() for array in vertices), seen))
        return seen

    monkeypatch.setattr(edge_lines.wireframe, "project_edges", project)
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    vertices = np.column_stack([np.cos(around), np.sin(around), np.zeros(count)])
    last = np.arange(2, count)
    faces = np.column_stack([np.zeros(count - 2, int), last - 1, last])
    scene = rj.Scene()
    scene.wireframe = rj.Wireframe("black", mode)
    scene.add(rj.Mesh(vertices, faces))
    frame = warmup.BlankRenderer((32, 32), threads=1).render(scene, background="red")
    assert (frame.color == (255, 0, 0, 255)).all()
    assert calls
    for edges, clip_positions, codes, pixels, seen in calls:
        assert len(clip_positions) == len(pixels) == count > edges.max()
        assert len(codes) >= count
        assert (codes[:count] == setup.INVALID).all()
        assert seen == 0
    assert max(edges.max() for edges, *_ in calls) == count - 1


@compiled_only
def test_a_kernel_of_other_sources_is_not_cached(monkeypatch):
    rj.render(warmup._square(), size=(8, 8))
    assert jit.is_cached(draw_tiles)
    monkeypatch.setattr(draw_tiles._cache._cache_file, "_source_stamp", "of other sources")
    assert not jit.is_cached(draw_tiles)
