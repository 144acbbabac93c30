"""One place decides about compilation, and every kernel has as few forms as it can."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from kernel_files import kernel_files

import rasterjit as rj
from rasterjit.pipeline.visibility import tile_rasterizer
from rasterjit.runtime import clocks, jit

PACKAGE = Path(rj.__file__).parent
RUNTIME = PACKAGE / "runtime"
compiled_only = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="no machine code of ours")

COMPILERS = {
    RUNTIME / f"{name}.py"
    for name in ("array_type", "compiler", "intrinsics_ir", "numba_internals")
}
"""The files that import Numba."""


def sources():
    return sorted(PACKAGE.rglob("*.py"))


def code_of(path):
    """Return a source without texts and comments."""
    code = re.sub(r'""".*?"""', "", path.read_text(), flags=re.S)
    return re.sub(r"#.*", "", code)


def test_only_the_compiler_knows_numba():
    pattern = re.compile(r"\bnjit\b|\bjit\(|@jit\b|\bvectorize\(|\bprange\b|(import|from) numba\b")
    known = set(kernel_files())
    for path in sources():
        if path not in COMPILERS:
            assert not pattern.search(code_of(path)), path
            decorated = re.search(r"^@(kernel|stage|helper)\b", code_of(path), re.M)
            assert not decorated or path in known, path


def test_private_numba_stands_in_one_short_file_with_reasons():
    public = re.compile(r"\s*(import numba|from numba import types|from numba\.extending .*)$")
    for path in COMPILERS:
        imports = re.findall(r"^\s*(?:import|from) numba.*$", path.read_text(), re.M)
        private = [line for line in imports if not public.match(line)]
        if path.stem == "numba_internals":
            assert private
            assert all(re.search(r"  # [A-Z].*\.$", line) for line in private), private
            assert len(path.read_text().splitlines()) <= 150
        else:
            assert private == [], path


def test_no_kernel_uses_fastmath():
    for path in sources():
        assert "fastmath=" not in path.read_text(), path


def test_a_clock_counts_once_what_is_nested_and_what_is_under_way():
    clock = clocks.CompileClock()
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
def test_layout_of_a_mesh_makes_no_new_form(cube, camera):
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
    counts = [len(kernel.forms) for kernel in jit.KERNELS]
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
    assert [len(kernel.forms) for kernel in jit.KERNELS] == counts
    assert not frozen[0].flags.writeable


@compiled_only
def test_every_stage_has_one_type_and_a_state_that_packs_natively():
    packer = jit.get_packer()
    assert packer.__class__ is jit.MACHINE_FUNCTION_WITH_GIL, (
        "this Python keeps its objects elsewhere"
    )
    assert len(jit.STAGES) > 5
    for stage in jit.STAGES:
        assert len(stage.kind.fields) == 1 + len(stage.names)


@compiled_only
def test_a_wrong_argument_is_named_by_the_form_that_the_others_suit():
    numbers = [np.zeros(1, kind) for kind in (np.int32, np.int64)]
    for depths in map(np.dtype, ("float32", "float64", "int32")):
        with pytest.raises(TypeError, match=r"draw_tiles\.4 must be Viewport\(.*\), got 3"):
            tile_rasterizer.draw_tiles(*numbers, numbers[1], np.zeros(1, depths), 3, 4, 5, 6, 7)
