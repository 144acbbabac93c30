"""Kernels compiled ahead are those that rendering calls, in whichever process they were made."""

from __future__ import annotations

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

import rasterjit as rj
from rasterjit import warmup
from rasterjit.kernels import jit
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
        compile_all((32, 24), scene, None)
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


@compiled_only
def test_nothing_is_compiled_elsewhere_where_one_thread_or_a_cache_is(monkeypatch):
    rj.render(warmup._square(), size=(8, 8))
    monkeypatch.setattr(warmup, "available_processors", lambda: 2)
    for threads in (1, None):
        with warmup.two_processes(threads) as compile_all:
            assert compile_all is None


@compiled_only
def test_another_process_that_fails_or_an_error_here_leaves_no_process(monkeypatch):
    monkeypatch.setattr(warmup, "available_processors", lambda: 2)
    monkeypatch.setattr(warmup, "is_cached", lambda kernel: False)
    monkeypatch.setattr(warmup, "OTHER_PROCESS", "raise SystemExit(1)")
    with warmup.two_processes(None) as compile_all:
        compile_all((8, 8), warmup._square(), None)
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


def test_a_blank_frame_calls_no_kernel_of_visibility_and_shows_the_background():
    before = list(getattr(draw_tiles, "signatures", ()))
    frame = warmup.BlankRenderer((9, 7), threads=1).render(
        warmup._square(), background="red", outputs=OUTPUTS
    )
    assert list(getattr(draw_tiles, "signatures", ())) == before
    assert (frame.color == (255, 0, 0, 255)).all()
    assert (frame.face_id == -1).all()
    assert np.isinf(frame.depth).all()
    assert frame.stats.pixels_covered == 0


@compiled_only
def test_a_kernel_of_other_sources_is_not_cached(monkeypatch):
    rj.render(warmup._square(), size=(8, 8))
    assert jit.is_cached(draw_tiles)
    monkeypatch.setattr(draw_tiles._cache._cache_file, "_source_stamp", "of other sources")
    assert not jit.is_cached(draw_tiles)
