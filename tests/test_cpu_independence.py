"""
No operation between a mesh file and a pixel has a result that depends on the CPU.

IEEE 754 fixes addition, multiplication, division and the square root. It does not fix sines,
logarithms and powers, which a math library rounds as it likes and NumPy computes with whatever
instructions it finds; nor in which order a library sums; nor whether a compiler fuses a product
and a sum. So the compiled kernels must call nothing and fuse nothing, and the Python around them
may use nothing of the kind. Whoever asks for the math library, by ``Quality(math="library")``, gets
it, for powers and exponentials alone.
"""

from __future__ import annotations

import ast
import json
import platform
import re
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.kernels import jit

PACKAGE = Path(rj.__file__).parent
HARD_CASES = Path(__file__).parent / "hard_cases"
compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set: there is no machine code"
)

FUSED = re.compile(r"\bv?fn?m(?:add|sub)(?:add|sub)?(?:132|213|231)?[ps][sdh]\b|\bfmadd\b|\bfmla\b")
"""A product and a sum in one instruction, on x86 or Arm."""

MATH = [
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "exp2",
    "expm1", "log", "log2", "log10", "log1p", "pow", "powi", "cbrt", "hypot", "fma",
]  # fmt: skip
CALLED_MATH = re.compile(
    r"(?:__svml_|_ZGV|amd_vr|npy_|numba_)?\b_*(?:"
    + "|".join(MATH)
    + r")[fl]?\d*(?:_\w+)?(?:@PLT)?$"
)
"""A function of a math library, of its vector version, or of Numba's own."""

CALL = re.compile(r"\b(?:callq?|jmpq?)\s+\*?(?:\[?rip \+ )?([A-Za-z_.][\w.$@]*)")
ADDRESS = re.compile(r"\bmovabsq?\s+\$([A-Za-z_.][\w.$@]*)")
"""Where x86 code names a function: it calls it, or loads its address first."""

WIDTHS = ("xmm", "ymm", "zmm")
"""Vector registers of x86: 128, 256 and 512 bits."""


def names_called(assembly):
    """Return the functions that the assembly names as something to call."""
    return {
        name.removesuffix("@PLT")
        for line in assembly.splitlines()
        for name in (*CALL.findall(line), *ADDRESS.findall(line))
    }


def cpu_dependent(assembly):
    """Return the fused operations and the math functions in the assembly."""
    return sorted(set(FUSED.findall(assembly))) + sorted(
        name for name in names_called(assembly) if CALLED_MATH.match(name)
    )


COMPILE = """
import json
import frames
import rasterjit
from rasterjit.kernels import jit

for kernel in jit.KERNELS:
    kernel._cache.load_overload = lambda *signature: None
for name in {names!r}:
    frames.FRAMES[name]().draw()
triangle = rasterjit.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
rasterjit.explain_pixel(triangle, None, (16, 16), 8, 8)
assert not any(kernel.stats.cache_hits for kernel in jit.KERNELS)
code = [(k.__name__, str(s), k.inspect_asm(s)) for k in jit.KERNELS for s in k.signatures]
drawing = [k.__name__ for k in jit.KERNELS if not k.py_func.__module__.endswith(".diagnosis")]
print(json.dumps([drawing, code]))
"""
"""
Kernels that come from the disk cache show no assembly: compile them once more, and leave them there
for the other tests. Those of ``diagnosis`` count and explain, and make no pixel.
"""

FRAMES_OF_ALL_KERNELS = (
    "gltf_scene", "flat_face_colours", "gouraud_vertex_colours", "wireframe_overlay",
    "occluded_and_outlined", "soup", "lines_and_curves", "many_lines", "filled_triangles",
    "materials_under_a_sky", "shadows_of_all_lights", "layers_of_glass",
    "layers_in_four_samples",
    "edges_in_eight_samples", "ground_truth", "layers_peeled", "many_pictures", "areas",
    "codes_of_glass", "codes_in_four_samples",
    "codes_of_many_pictures", "lines_by_coverage", "coarse_geometry",
)  # fmt: skip


@pytest.fixture(scope="module")
def compiled():
    """The names of the kernels that draw, and (name, signature, assembly) of all compiled."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", COMPILE.format(names=FRAMES_OF_ALL_KERNELS)],
        cwd=HARD_CASES, capture_output=True, text=True, check=True,
    )  # fmt: skip
    names, code = json.loads(done.stdout)
    return names, code


@pytest.mark.compiles_first
@compiled_only
def test_no_kernel_fuses_or_calls_a_math_library(compiled):
    names, code = compiled
    assert {name for name, _, _ in code} >= set(names), "a kernel that no frame uses"
    for name, signature, assembly in code:
        assert name in assembly
        assert cpu_dependent(assembly) == [], (name, signature)


COMPILE_WITH_LIBRARY = """
import json
import rasterjit as rj
from rasterjit.kernels import jit

for kernel in jit.KERNELS:
    kernel._cache.load_overload = lambda *signature: None
scene = rj.Scene()
scene.add(rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
scene.fog, scene.tone_map = rj.Fog("red", "exp", density=0.1), rj.ToneMap(exposure=0.5)
rj.render(scene, size=(16, 16), quality=rj.Quality(math="library"), threads=1)
print(json.dumps([(k.__name__, k.inspect_asm(s)) for k in jit.KERNELS for s in k.signatures]))
"""


@compiled_only
def test_the_library_is_called_where_it_is_asked_for_and_for_powers_alone():
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", COMPILE_WITH_LIBRARY],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    code = json.loads(done.stdout)
    called = {name: cpu_dependent(assembly) for name, assembly in code}
    assert [name for name, found in called.items() if found] == ["shade_rows"]
    names = {re.sub(r"^(numba_|npy_)|@PLT$", "", name) for name in called["shade_rows"]}
    assert names == {"pow", "exp2"}


@pytest.mark.compiles_first
@compiled_only
def test_kernels_are_compiled_for_the_cpu_that_was_asked_for(compiled):
    used = {width: sum(a.count(f"%{width}") for _, _, a in compiled[1]) for width in WIDTHS}
    if platform.machine().lower() not in ("x86_64", "amd64"):
        pytest.skip(f"{platform.machine()} has other registers")
    assert used["xmm"] > 0
    if numba.config.CPU_NAME == "generic":
        assert used["ymm"] == used["zmm"] == 0
        return
    if "avx512f" not in jit.cpu_features()[1]:
        pytest.skip("this CPU has no AVX-512")
    assert used["zmm"] > 0


@compiled_only
def test_look_at_machine_code_finds_math_functions():
    @numba.njit
    def curve(x):
        return np.exp(x) + np.sin(x) + x**2.4

    curve(0.5)
    found = cpu_dependent(curve.inspect_asm(curve.signatures[0]))
    assert {"exp", "sin", "pow"} <= {name.removeprefix("numba_") for name in found}


@compiled_only
@pytest.mark.skipif("fma" not in jit.cpu_features()[1], reason="this CPU fuses nothing")
@pytest.mark.skipif(numba.config.CPU_NAME == "generic", reason="compiled for a CPU without FMA")
def test_look_at_machine_code_finds_fused_operations():
    @numba.njit(fastmath={"contract"})
    def fused(x, y, z):
        for i in range(x.shape[0]):
            z[i] = x[i] * y[i] + z[i]

    fused(np.ones(9), np.ones(9), np.ones(9))
    assert cpu_dependent(fused.inspect_asm(fused.signatures[0]))


FORBIDDEN_MODULES = ("linalg", "fft", "random")
FORBIDDEN = {
    # The math library's, or NumPy's own for the CPU at hand.
    *MATH, "arcsin", "arccos", "arctan", "arctan2", "power", "float_power", "dist", "logaddexp",
    "gamma", "lgamma", "erf",
    # Sums whose order is a library's affair.
    "dot", "vdot", "inner", "matmul", "einsum", "tensordot", "convolve", "sumprod", "fsum",
    "sum", "nansum", "mean", "average", "std", "var", "prod", "cumprod", "norm", "trapezoid",
    "interp", "polyfit",
    # Built from those above.
    "geomspace", "logspace", "slerp",
}  # fmt: skip
FORBIDDEN_OPERATORS = {ast.MatMult: "@", ast.Pow: "**"}

ALLOWED = {
    ("kernels/lighting.py", "log2"): "our own polynomial, of IEEE operations alone",
    ("kernels/lighting.py", "exp2"): "our own polynomial, of IEEE operations alone",
    ("kernels/lighting.py", "power"): "our own, of the two above",
    ("kernels/texturing.py", "log2"): "that of kernels/lighting.py",
    ("kernels/environments.py", "log2"): "that of kernels/lighting.py",
    ("kernels/library_math.py", "exp2"): "for who asks for the math library",
    ("kernels/library_math.py", "power"): "for who asks for the math library",
    ("kernels/resolve.py", "**"): "whole numbers of Python, without bound",
    ("stages.py", "sum"): "whole numbers: counts of triangles",
    ("framebuffer.py", "sum"): "whole numbers: pixels of lines",
    ("distributed/layers.py", "sum"): "whole numbers: counts of faces",
    ("distributed/many.py", "sum"): "whole numbers: threads of a cluster",
    ("distributed/large.py", "sum"): "whole numbers: threads of a cluster",
    ("memory.py", "prod"): "whole numbers of Python",
    ("measurement.py", "sum"): "whole numbers: counts for a text",
    ("masks.py", "sum"): "whole numbers: counts of pixels",
    ("plan_contents.py", "sum"): "whole numbers: counts of objects",
    ("scene/mesh.py", "sum"): "whole numbers: counts for a message",
    ("scene/color.py", "sum"): "whole numbers: counts for a message",
    ("validation.py", "sum"): "whole numbers: counts for a message",
    ("scene/scene.py", "sum"): "whole numbers: counts for a repr",
    ("plan_lights.py", "sum"): "whole numbers: counts of texels",
    ("plan_arrays.py", "sum"): "whole numbers: counts of rows",
    ("plan_textures.py", "sum"): "whole numbers: counts of textures",
    ("scene/texture.py", "sum"): "whole numbers: counts of texels",
    ("plan_views.py", "sum"): "three terms: NumPy splits sums from eight terms on",
    ("dataset/views.py", "random"): "Python's own numbers, the same for a text everywhere",
    ("io/trimesh_materials.py", "sum"): "three terms in a row, and counts",
    ("io/trimesh_materials.py", "mean"): "three terms: NumPy splits sums from eight terms on",
}
"""Uses in (file, name), with why their bits are the same everywhere."""

OFF_THE_PATH = {
    "doctor.py": "checks an installation, draws nothing for anybody",
    "viewpoint.py": "places the cameras of controls.py",
    "viewer.py": "what a person clicks, and text",
    "viewer_text.py": "text",
    "mpl.py": "works in the matrices of matplotlib, which come from BLAS",
    "controls.py": "follows a hand: where a person leaves the camera is in no file",
    "warmup.py": "compiles kernels, keeps no picture",
    "oracle.py": "whole numbers and fractions",
    "explanation.py": "text",
    "diagnostics.py": "pictures of a frame's cost, not of its scene",
    "pixel.py": "text about one pixel",
    "pixel_light.py": "text about one pixel",
    "pixel_mix.py": "text about one pixel",
    "scene/srgb.py": "whole numbers and fractions",
    "kernels/jit.py": "compiles",
    "cli_report.py": "text",
    "__main__.py": "nothing but a call",
    "dial.py": "compares pictures and times",
    "animation/tracks.py": "where something is between two keys is SciPy's affair",
    "accuracy/compiling.py": "draws what nobody looks at",
    "accuracy/crops.py": "a page about pictures",
    "accuracy/errors.py": "compares pictures, makes none",
    "accuracy/files.py": "text",
    "accuracy/labels.py": "a page about pictures",
    "accuracy/page.py": "a page about pictures",
    "accuracy/plots.py": "a page about pictures",
    "accuracy/scales.py": "a page about pictures",
    "accuracy/ranking.py": "compares times and errors",
    "accuracy/timing.py": "times",
}


def uses(source):
    """Yield (line, name) of every forbidden thing that a source uses."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in FORBIDDEN_OPERATORS:
            if not is_exact_power(node):
                yield node.lineno, FORBIDDEN_OPERATORS[type(node.op)]
        elif isinstance(node, ast.Attribute) and node.attr in (*FORBIDDEN, *FORBIDDEN_MODULES):
            yield node.lineno, node.attr
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in FORBIDDEN:
                yield node.lineno, node.func.id
        elif isinstance(node, ast.ImportFrom) and node.module in ("math", "numpy", "numpy.linalg"):
            for name in node.names:
                if name.name in (*FORBIDDEN, *FORBIDDEN_MODULES):
                    yield node.lineno, name.name


def is_exact_power(node):
    """Tell ``2 ** k`` of a whole k, and squares, which are products everywhere."""
    if not isinstance(node, ast.BinOp) or not isinstance(node.op, ast.Pow):
        return False
    base, exponent = node.left, node.right
    if isinstance(exponent, ast.Constant) and exponent.value == 2:
        return True
    whole = isinstance(exponent, ast.UnaryOp) and isinstance(exponent.op, ast.USub)
    exponent = exponent.operand if whole else exponent
    return (
        isinstance(base, ast.Constant)
        and base.value == 2
        and isinstance(exponent, ast.Constant)
        and isinstance(exponent.value, int)
    )


def on_the_path():
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if name not in OFF_THE_PATH:
            yield name, path.read_text()


@pytest.mark.parametrize(
    ("name", "source"), list(on_the_path()), ids=[name for name, _ in on_the_path()]
)
def test_source_uses_nothing_that_a_cpu_decides(name, source):
    found = [(line, what) for line, what in uses(source) if (name, what) not in ALLOWED]
    assert found == []


def test_every_exception_is_still_needed():
    found = {(name, what) for name, source in on_the_path() for _, what in uses(source)}
    assert set(ALLOWED) <= found


@pytest.mark.parametrize(
    "line",
    [
        "np.sin(x)", "math.atan2(y, x)", "x ** 2.4", "x **= 0.5", "x ** n", "pow(x, y)", "a @ b",
        "a.dot(b)", "np.linalg.norm(v)", "rows.sum(axis=1)", "from math import exp", "sum(values)",
        "from numpy.linalg import svd, norm", "from numpy import linalg", "float.__pow__; math.exp",
    ],
)  # fmt: skip
def test_look_at_source_finds(line):
    assert list(uses(line))


@pytest.mark.parametrize("line", ["x * x", "2.0**-40", "x**2", "math.sqrt(x)", "np.sqrt(x) / y"])
def test_look_at_source_lets_pass(line):
    assert not list(uses(line))
