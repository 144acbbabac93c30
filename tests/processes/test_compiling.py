"""What is compiled, from what, for what: in fresh processes."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from small import HERE, RESULTS, use

import rasterjit as rj
from rasterjit.runtime import jit

MODELS = Path(__file__).parents[2] / "models"

PACKAGE = Path(rj.__file__).parent
TEAPOT = PACKAGE.parent / "models" / "teapot.obj"
pytestmark = [
    pytest.mark.takes_long,
    pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="no machine code of ours"),
]


def run(code, *arguments, cwd=None, **environment):
    """Run Python code; return the last line it printed."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1], done.stderr


PROJECT = """
import json
import numpy as np
from rasterjit.effects.wireframe import stage as wireframe
from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.records import Viewport
from rasterjit.runtime import clocks, store

positions = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -3.0, 1.0]])
ends, depths = np.zeros((1, 4), np.int32), np.zeros((1, 2))
vertices = positions, np.array([0, 16], np.uint8), np.zeros((2, 2), np.int32)
edges = np.array([[0, 1]], np.int32)
view = Viewport(64, 64, 1.0, 1.0, 8, 8)
count = wireframe.project_edges(edges, vertices, (0.0, 1.0, 0.0), view, ends, depths)
color = np.empty((1, 1), np.uint32)
table = srgb_encoding.make_encoding_table()
srgb_encoding.encode_rows(np.ones((1, 1, 4), np.float32), table, color)
compiled = [name.rpartition(".")[2] for name in store.USED_KERNELS.compiled]
ran = [clock.seconds > 0.0 for clock in (clocks.COMPILER_CLOCK, clocks.COMPILE_CLOCK)]
print(json.dumps([count, round(depths[0, 1], 6), hex(color[0, 0]), compiled, ran]))
"""


def test_an_edit_compiles_what_imports_it_and_no_more(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "rasterjit", ignore=shutil.ignore_patterns("__pycache__"))
    place = tmp_path / "cache"
    environment = {"RASTERJIT_CACHE_DIR": str(place), "PYTHONPATH": str(tmp_path)}

    def project():
        return json.loads(run(PROJECT, cwd=tmp_path, **environment)[0])

    everything = ["project_edges", "encode_rows"]
    *found, compiled, clocks = project()
    assert found == [1, -1.0, "0xffffffff"]
    assert sorted(compiled) == sorted(everything)
    assert clocks == [True, True]
    # Unchanged sources load from disk.
    assert project() == [*found, [], [False, True]]
    helper = tmp_path / "rasterjit" / "pipeline" / "geometry" / "clipping.py"
    source = helper.read_text()
    before, after = "return vertex[3] + vertex[2]", "return vertex[3] + 0.5 * vertex[2]"
    assert source.count(before) == 1
    helper.write_text(source.replace(before, after))
    assert project() == [1, -2.0, "0xffffffff", ["project_edges"], [True, True]]
    assert len(list(place.glob("*.kernel"))) == len(everything) + 1
    # The old sources find the old entries.
    helper.write_text(source)
    assert project() == [*found, [], [False, True]]


DRAW = """
import hashlib, sys
import rasterjit as rj
from rasterjit.runtime import store

scene = rj.load(sys.argv[1]) if sys.argv[1:] else rj.Scene()
if not sys.argv[1:]:
    scene.add(rj.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]]))
names = sys.argv[2:] or ("color", "linear", "face_id")
frame = rj.render(scene, size=(48, 36), threads=1, outputs=names)
assert (frame.face_id >= 0).sum() > 100
total = hashlib.sha256()
for name in names:
    total.update(getattr(frame, name).tobytes())
print(total.hexdigest(), len(store.USED_KERNELS.compiled), "numba" in sys.modules)
"""


def test_a_filled_store_draws_the_same_bits_without_numba(tmp_path):
    tmp_path.chmod(0o700)
    first = run(DRAW, RASTERJIT_CACHE_DIR=str(tmp_path))[0].split()
    assert int(first[1]) > 5
    assert first[2] == "True"
    again = run(DRAW, RASTERJIT_CACHE_DIR=str(tmp_path))[0].split()
    assert again == [first[0], "0", "False"]
    blocked = "import sys; sys.modules['numba'] = None\n" + DRAW
    assert run(blocked, RASTERJIT_CACHE_DIR=str(tmp_path))[0].split()[:2] == [first[0], "0"]


x86_only = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="names processors of x86"
)


@x86_only
@pytest.mark.parametrize("cpu", ["x86-64-v2", "x86-64-v3"])
def test_entries_for_an_older_processor_draw_the_same_bits(tmp_path, cpu):
    tmp_path.chmod(0o700)
    here = run(DRAW)[0].split()[0]
    options = {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": ""}
    made = run(DRAW, RASTERJIT_CACHE_DIR=str(tmp_path), **options)[0].split()
    assert made[0] == here
    assert int(made[1]) > 5


LACKING = """
import numba.core.compiler
del numba.core.compiler.CompilerBase
"""
"""A release of Numba in which something private is gone."""

CHANGED = """
from rasterjit.runtime import numba_internals
numba_internals._Draft.add_llvm_module = None
"""
"""One in which something private is called otherwise."""


@pytest.mark.parametrize("release", [LACKING, CHANGED], ids=["lacking", "changed"])
def test_another_numba_compiles_the_stock_way_with_one_warning(tmp_path, release):
    tmp_path.chmod(0o700)
    names = ("add_lines", "draw_line")
    results, compiled, has_numba, said = use(tmp_path, names, release)
    assert results == [RESULTS[name] for name in names]
    assert {*names} <= {*compiled}
    assert has_numba
    assert said.count("RuntimeWarning") == said.count("is not as RasterJIT knows it") == 1
    assert use(tmp_path, names)[:3] == (results, [], False)


@pytest.mark.needs_jit
def test_the_stock_way_draws_the_teapot(tmp_path):
    tmp_path.chmod(0o700)
    # The stock way takes long: its shading is looked at where all kernels are.
    outputs = () if os.environ.get("EVERY_KERNEL") else ("depth", "face_id")
    found, said = run(LACKING + DRAW, TEAPOT, *outputs, RASTERJIT_CACHE_DIR=str(tmp_path))
    assert said.count("RuntimeWarning") == 1
    assert found.split()[0] == run(DRAW, TEAPOT, *outputs)[0].split()[0]


HELPERS = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
import small_kernels

row, out = np.arange(3.0), np.zeros(3)
line = small_kernels.Line(2.0, 1.0)
found = []
for call in {order}:
    getattr(small_kernels, call)(line, row, out)
    found.append(out.tolist())
print(found == [[1.0, 3.0, 5.0]] * 2)
"""
"""Calls a kernel and a helper that calls another, which the kernel calls, too."""


@pytest.mark.parametrize("order", [("draw_line", "shared"), ("shared", "draw_line")])
def test_python_calls_helpers_of_helpers_beside_a_kernel_that_has_them(tmp_path, order):
    code = HELPERS.format(order=order)
    said, _ = run(code, HERE, RASTERJIT_CACHE_DIR=str(tmp_path))
    assert said == "True"


def test_a_mistake_in_a_kernel_is_told_and_not_blamed_on_numba(tmp_path):
    (tmp_path / "wrong.py").write_text(
        "from rasterjit.runtime.jit import kernel\n\n"
        "@kernel\ndef wrong(row):\n    row[0] = row.colour\n"
    )
    code = "import numpy as np, wrong\nwrong.wrong(np.zeros(3))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
    )  # fmt: skip
    assert done.returncode == 1
    assert "colour" in done.stderr
    assert "RuntimeWarning" not in done.stderr


BAD_INDEX = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
import small_kernels
from rasterjit.runtime.jit import Bound

def by_address(n):
    bound = Bound(small_kernels.has_index, np.ones(3), n)
    return small_kernels.call(bound.words)

for call in (
    lambda: small_kernels.has_index(np.ones(3), 7),
    lambda: by_address(7),
    # Two helpers deep, one of them disjoint.
    lambda: small_kernels.draw_line(small_kernels.Line(2.0, 1.0), np.ones(4), np.zeros(3)),
    lambda: small_kernels.add_lines(small_kernels.Line(2.0, 1.0), np.ones(4), np.zeros(3)),
):
    try:
        call()
    except IndexError:
        print("caught", end=" ")
print(small_kernels.has_index(np.ones(3), 2), by_address(2))
"""


@pytest.mark.parametrize("lane", ["NUMBA_BOUNDSCHECK", "NUMBA_DISABLE_JIT"])
def test_a_bad_index_is_caught_where_indices_are_checked(tmp_path, lane):
    environment = {lane: "1", "RASTERJIT_CACHE_DIR": str(tmp_path)}
    assert run(BAD_INDEX, HERE, **environment)[0] == "caught caught caught caught True 1"
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_draws_in_plain_python_where_nothing_is_kept(tmp_path):
    picture = tmp_path / "cube.png"
    subprocess.run(
        [sys.executable, "-m", "rasterjit", "render", MODELS / "cube.ply", "-o", picture,
         "--size", "8x6"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "RASTERJIT_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert picture.stat().st_size > 50
    assert [path.name for path in tmp_path.iterdir()] == ["cube.png"]
