"""
The same bits for every thread count, tile size, spelling of a face, run, process and CPU.

The hashes of the frames (``frames.py``) are in ``frame_hashes.json``. A change that is meant
to change bits writes them anew with ``python tests/hard_cases/frames.py``.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import frames
import numpy as np
import pytest
from kernel_files import kernel_files
from strict import STRICT

import rasterjit as rj

PACKAGE = Path(rj.__file__).parent
NAMES = list(frames.FRAMES)
PARALLEL = [name for name in NAMES if not isinstance(frames.FRAMES[name](), frames.Canvas)]
OTHER_TILE_BITS = (4, 5)
"""Tiles of 16 and 32 pixels. Larger ones than the 64 of everyday do not fit a thread's scratch."""


@cache
def first_digests(name):
    """Return the hashes of a frame, drawn once by one thread."""
    return frames.digests(frames.FRAMES[name]().draw(threads=1))


def differing(want, got):
    """Return the outputs whose hashes differ."""
    assert want.keys() == got.keys()
    return [name for name in want if want[name] != got[name]]


def run_frames(arguments=(), **environment):
    """Return the hashes that a fresh process finds."""
    done = subprocess.run(
        [sys.executable, *STRICT, str(frames.HERE / "frames.py"), "--print", *arguments],
        env={**os.environ, **environment}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def test_recorded_frames_are_those_of_the_module():
    assert len(NAMES) == 54
    assert list(frames.recorded()) == NAMES


# The lanes of .ci/run draw them again: with checked bounds, in plain Python, for any CPU.
@pytest.mark.case("P01")
@pytest.mark.every_case
@pytest.mark.parametrize("name", NAMES)
def test_frame_has_its_recorded_bits(name):
    assert differing(frames.recorded()[name], first_digests(name)) == []


@pytest.mark.needs_jit
@pytest.mark.parametrize("name", NAMES)
def test_drawing_again_with_any_number_of_threads_gives_the_same_bits(name):
    threads = 3 if name in PARALLEL else 1
    assert frames.digests(frames.FRAMES[name]().draw(threads)) == first_digests(name)


@pytest.mark.needs_jit
@pytest.mark.parametrize("threads", [1, 3])
def test_large_frame_of_many_tasks_has_the_same_bits_for_any_number_of_threads(threads):
    # Many tiles, bands and rows: more tasks than threads in every stage but vertices.
    shot = replace(frames.teapot(), size=(700, 500), outputs=("color", "depth", "normal"))
    assert frames.digests(shot.draw(threads)) == frames.digests(shot.draw(5))


@pytest.mark.needs_jit
@pytest.mark.parametrize("name", NAMES)
def test_spelling_a_face_from_another_vertex_changes_no_bit(name):
    # A new mesh normalizes its normals again, so the one to compare with is new as well.
    want = frames.digests(frames.FRAMES[name]().rotated(0).draw())
    turn = 1 + NAMES.index(name) % 2
    drawn = dict(frames.FRAMES[name]().rotated(turn).draw())
    if "barycentric" in drawn:
        # The weights are named by corner, and the corners were renamed.
        drawn["barycentric"] = np.roll(drawn["barycentric"], turn, axis=2)
    assert differing(want, frames.digests(drawn)) == []


def test_order_of_faces_changes_nothing_but_their_numbers():
    # Flat shading and faces' normals: those of vertices are sums, whose last bit has an order.
    mesh = frames.colored(frames.ball(5), "vertex", "flat")
    order = np.argsort(frames.numbers(7, len(mesh.faces), 0, 2**20), kind="stable")
    assert not np.array_equal(order, np.arange(len(order)))
    shuffled = frames.with_faces(mesh, mesh.faces[order])
    camera = frames.looking(fov_y=35.0)
    outputs = [name for name in frames.EVERYTHING if name != "normal"] + ["geometric_normal"]
    plain, other = (
        frames.Shot(frames.scene_of(one), camera, outputs=tuple(outputs)).draw()
        for one in (mesh, shuffled)
    )
    # No two faces share a depth at a sample of a convex body seen from outside.
    seen = other["face_id"] >= 0
    other["face_id"][seen] = order[other["face_id"][seen]]
    assert differing(frames.digests(plain), frames.digests(other)) == []


@pytest.mark.needs_jit
def test_fresh_process_gives_the_same_bits_with_any_linear_algebra_library():
    # OpenBLAS sums in another order on this than on CPUs of today; others ignore the wish.
    assert run_frames(OPENBLAS_CORETYPE="Prescott", PYTHONHASHSEED="1") == frames.recorded()


@pytest.mark.takes_long
@pytest.mark.needs_jit
@pytest.mark.parametrize("bits", OTHER_TILE_BITS)
def test_any_tile_size_gives_the_same_bits(bits, tmp_path):
    # Tile size is frozen into the kernels: draw with a copy of the package that has another.
    copy = tmp_path / "rasterjit"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    source = copy / "pipeline" / "geometry" / "setup.py"
    text = source.read_text()
    assert text.count("\nTILE_BITS = 6\n") == 1
    source.write_text(text.replace("\nTILE_BITS = 6\n", f"\nTILE_BITS = {bits}\n"))
    environment = {"PYTHONPATH": str(tmp_path), "RASTERJIT_CACHE_DIR": str(tmp_path / "cache")}
    tiles = "from rasterjit.pipeline.geometry import setup; print(setup.TILE_SIZE)"
    done = subprocess.run(
        [sys.executable, "-c", tiles],
        cwd=tmp_path, env={**os.environ, **environment}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert int(done.stdout) == 1 << bits
    # All other outputs follow from these two without a tile: see the test below.
    found = run_frames(("depth", "face_id"), **environment)
    wanted = {
        name: {k: v for k, v in frames.recorded()[name].items() if k in ("depth", "face_id")}
        for name in PARALLEL
    }
    assert all(wanted.values())
    assert found == wanted


def test_no_kernel_that_makes_another_output_knows_of_tiles():
    knows = {
        path.relative_to(PACKAGE).as_posix()
        for path in kernel_files()
        if re.search(r"\bTILE_(BITS|SIZE)\b", path.read_text())
    }
    # The lists of triangles, what they hide, drawing them, and counting what was drawn.
    lists = {
        "pipeline/geometry/setup.py", "pipeline/geometry/binning.py",
        "pipeline/visibility/hierarchical_z.py",
    }  # fmt: skip
    drawing = {
        "pipeline/visibility/tile_rasterizer.py", "pipeline/visibility/alpha_test.py",
        "pipeline/fragments/a_buffer.py", "pipeline/fragments/area_coverage.py",
    }  # fmt: skip
    assert knows == lists | drawing | {"outputs/diagnostics_stage.py"}
