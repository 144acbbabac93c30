"""One place decides about compilation, and the disk cache sees every edit."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.kernels import jit

PACKAGE = Path(rj.__file__).parent
compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set"
)

SCRIPT = """
import numpy as np
from rasterjit.kernels import wireframe
from rasterjit.kernels.records import Viewport

positions = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -3.0, 1.0]])
ends, depths = np.zeros((1, 4), np.int32), np.zeros((1, 2))
vertices = positions, np.array([0, 16], np.uint8), np.zeros((2, 2), np.int32)
edges = np.array([[0, 1]], np.int32)
view = Viewport(64, 64, 1.0, 1.0, 8, 8)
count = wireframe.project_edges(edges, vertices, (0.0, 1.0, 0.0), view, ends, depths)
hits = sum(wireframe.project_edges.stats.cache_hits.values())
print(count, round(depths[0, 1], 6), hits)
"""


def sources():
    return sorted(PACKAGE.rglob("*.py"))


def test_only_jit_knows_how_to_compile():
    pattern = re.compile(r"\bnjit\b|\bjit\(|@jit\b|\bvectorize\(|\bprange\b|\bnumba\b")
    for path in sources():
        if path in (PACKAGE / "kernels" / "jit.py", PACKAGE / "kernels" / "vectors.py"):
            continue
        code = re.sub(r'""".*?"""', "", path.read_text(), flags=re.S)
        code = re.sub(r"#.*", "", code)
        if path.parent.name == "kernels":
            assert not pattern.search(code), path
        else:
            assert not re.search(r"\bnjit\b|@kernel|@stage", code), path


def test_no_kernel_uses_fastmath():
    for path in sources():
        assert "fastmath=" not in path.read_text(), path
    for kernel in jit.KERNELS:
        assert not getattr(kernel, "targetoptions", {}).get("fastmath", False)


@compiled_only
def test_every_kernel_is_cached_and_releases_the_gil():
    assert len(jit.KERNELS) > 10
    for kernel in jit.KERNELS:
        assert kernel.targetoptions["nogil"]
        assert kernel.stats.cache_path is not None
        assert kernel._cache._cache_file._source_stamp == jit.SOURCES_HASH


def test_a_clock_counts_once_what_is_nested_and_what_is_under_way():
    clock = jit.CompileClock()
    with clock.running():
        with clock.running():
            first = clock.read()
        second = clock.read()
        assert clock.seconds == 0.0
    assert 0.0 < first < second <= clock.seconds == clock.read()
    with pytest.raises(KeyError), clock.running():
        raise KeyError
    assert clock.read() == clock.seconds > second


@compiled_only
def test_the_compilers_clock_runs_for_what_is_compiled_and_not_for_what_is_loaded(tmp_path):
    code = SCRIPT + "print(jit.COMPILER_CLOCK.seconds > 0, jit.COMPILE_CLOCK.seconds > 0)"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run(
            [sys.executable, "-c", "from rasterjit.kernels import jit" + code],
            capture_output=True, text=True, check=True, env=environment,
        ).stdout.splitlines()[-1]
        for _ in range(2)
    ]  # fmt: skip
    assert said == ["True True", "False True"]


@compiled_only
def test_editing_a_helper_in_another_file_is_seen(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "rasterjit", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {
        **os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path),
    }  # fmt: skip

    def run():
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", SCRIPT],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        return done.stdout.split()

    assert run() == ["1", "-1.0", "0"]
    # Unchanged sources load from disk.
    assert run() == ["1", "-1.0", "1"]
    helper = tmp_path / "rasterjit" / "kernels" / "clipping.py"
    source = helper.read_text()
    before, after = "return vertex[3] + vertex[2]", "return vertex[3] + 0.5 * vertex[2]"
    assert source.count(before) == 1
    helper.write_text(source.replace(before, after))
    assert run() == ["1", "-2.0", "0"]


@compiled_only
def test_without_a_folder_to_write_kernels_are_compiled_and_not_kept():
    code = """
import numpy as np
from numba.core import caching

def refuse(self):
    raise OSError("read-only")

caching._CacheLocator.ensure_cache_path = refuse
from rasterjit.kernels import jit, resolve

color = np.empty((1, 1), np.uint32)
resolve.encode_rows(np.ones((1, 1, 4), np.float32), resolve.encoding_table(), color)
print(jit.cache_folder(), hex(color[0, 0]))
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=PACKAGE.parent, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["None", "0xffffffff"]


@compiled_only
def test_layout_of_a_mesh_makes_no_new_variant(cube, camera):
    def render(vertices, faces, colors):
        mesh = rj.Mesh(vertices, faces, colors=colors, material=rj.Material("phong", "white"))
        frame = rj.render(
            mesh, camera, size=(24, 16), threads=1,
            outputs=("color", "depth", "normal", "position", "barycentric"),
        )  # fmt: skip
        return frame.color.tobytes()

    rng = np.random.default_rng(1)
    vertices, faces = np.float32(cube.vertices), cube.faces
    colors = rng.uniform(0, 1, (8, 4)).astype(np.float32)
    expected = render(vertices, faces, colors)
    counts = [len(kernel.signatures) for kernel in jit.KERNELS]
    strided = np.zeros((16, 6))
    strided[::2, ::2] = vertices
    frozen = [np.array(a) for a in (vertices.astype(float), faces.astype(np.int32), colors)]
    for array in frozen:
        array.flags.writeable = False
    variants = [
        (np.asfortranarray(vertices), np.asfortranarray(faces), np.asfortranarray(colors)),
        (strided[::2, ::2], faces.astype(np.uint8), colors.astype(np.float64)),
        (vertices.tolist(), faces.tolist(), colors.tolist()),
        frozen,
        (vertices.astype(">f8"), faces.astype(">i8"), colors),
        (vertices[::-1][::-1], faces.astype(np.int64), colors),
    ]
    for arrays in variants:
        assert render(*arrays) == expected
    assert [len(kernel.signatures) for kernel in jit.KERNELS] == counts
    assert not frozen[0].flags.writeable


@compiled_only
def test_clock_counts_compiling_once():
    clock = jit.CompileClock()
    outer = clock.timed(lambda: clock.timed(lambda: None)())
    outer()
    once = clock.seconds
    assert once >= 0.0
    outer()
    assert clock.seconds >= once
    assert jit.COMPILE_CLOCK.seconds > 0.0
