"""
No operation between a mesh file and a pixel has a result that depends on the CPU.

IEEE 754 fixes addition, multiplication, division and the square root. It does not fix sines,
logarithms and powers, which a math library rounds as it likes and NumPy computes with whatever
instructions it finds; nor in which order a library sums; nor whether a compiler fuses a product
and a sum. So the compiled kernels must call nothing and fuse nothing, and the Python around them
may use nothing of the kind.
"""

from __future__ import annotations

import ast
import json
import os
import platform
import re
import struct
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from kernel_files import kernel_modules

import rasterjit as rj
from rasterjit.runtime import compiler, store

PACKAGE = Path(rj.__file__).parent
TEAPOT = PACKAGE.parent / "models" / "teapot.obj"
compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set: there is no machine code"
)

FUSED = re.compile(
    # x86, with the order of its operands.
    r"\bv?fn?m(?:add|sub)(?:add|sub)?(?:132|213|231)?[ps][sdh]\b"
    # ARM: numbers, vectors of NEON, those of SVE, and the steps to a quotient or a root.
    r"|\bfn?m(?:add|sub|ad|sb|l[as](?:l[bt]?2?)?)\b|\bfcmla\b|\bb?fmmla\b|\bbf(?:dot|ml[as]l?[bt]?)\b"
    r"|\bfr(?:ecp|sqrt)s\b|\bftmad\b"
)
"""A product and a sum in one instruction, on x86 or ARM."""

ESTIMATED = re.compile(
    r"\bv?r(?:cp|sqrt)(?:14|28)?[ps][sdh]\b|\bv?exp2[ps][sd]\b"
    r"|\b[fu]r(?:ecp|sqrt)e\b|\bfrecpx\b|\bfexpa\b"
)
"""An estimate, whose bits are the maker's affair, on x86 or ARM."""

MATH = [
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "exp2",
    "expm1", "log", "log2", "log10", "log1p", "pow", "powi", "cbrt", "hypot", "fma", "sincos",
    "fmod",
]  # fmt: skip
CALLED_MATH = re.compile(
    r"(?:__svml_|_ZGV|amd_vr|npy_|numba_)?\b_*(?:" + "|".join(MATH) + r")[fl]?\d*(?:_\w+)?$"
)
"""A function of a math library, of its vector version, or of Numba's own."""

CALL = re.compile(r"^\s+(?:callq?|jmpq?|bl?)\s+\*?(?:\[?rip \+ )?([A-Za-z_.][\w.$]*)")
ADDRESS = re.compile(
    r"\bmovabsq?\s+\$([A-Za-z_.][\w.$]*)|\b([A-Za-z_.][\w.$]*)@GOT"
    r"|^\s+adrp\s+\w+, ([A-Za-z_.][\w.$]*)|:(?:got|got_lo12|lo12|abs_g3):([A-Za-z_.][\w.$]*)"
)
"""Where code of x86 or ARM names a function: it calls it, or loads its address first."""

WIDTHS = {
    "xmm": r"%xmm", "ymm": r"%ymm", "zmm": r"%zmm",
    "neon": r"\bv\d+\.(?:16b|8h|4s|2d)\b|\bq\d+\b", "sve": r"\bz\d+\.[bhsdq]\b|\bz\d+\b",
}  # fmt: skip
"""Vector registers: of x86, 128, 256 and 512 bits; of ARM, 128 bits and as many as there are."""


def names_called(assembly):
    """Return the functions that the assembly names as something to call."""
    found = set()
    for line in assembly.splitlines():
        found.update(CALL.findall(line))
        found.update(name for names in ADDRESS.findall(line) for name in names if name)
    return found


def cpu_dependent(assembly):
    """Return the fused operations, the estimates and the math functions in the assembly."""
    found = {*FUSED.findall(assembly), *ESTIMATED.findall(assembly)}
    return sorted(found) + sorted(
        name for name in names_called(assembly) if CALLED_MATH.match(name)
    )


def vectors_used(code):
    """Return how often the assembly of kernels names vector registers of each kind."""
    whole = "".join(assembly for _, _, assembly, _ in code)
    return {kind: len(re.findall(pattern, whole)) for kind, pattern in WIDTHS.items()}


DISASSEMBLE = """
import json, sys
from importlib import import_module

import rasterjit as rj
from rasterjit.runtime import compiler, driver, jit, packing, store

target, some, model = json.loads(sys.argv[1])
target = store.Target(*target) if target else store.host()
if model:
    rj.render(rj.load(model), size=(32, 24), threads=1)
used = {{*store.USED.loaded, *store.USED.compiled, *some}}
for name in {names!r}:
    import_module(name)
every = (driver.run_list, packing.pack, *jit.KERNELS, *jit.STAGES)
compiled = [one for one in every if not used or store.full_name(one) in used]
names = [one.__name__ for one in compiled]
code = []
for one in compiled:
    for kind in one.declared:
        returns, module = compiler.lower(one, kind, one.__name__, target)
        machine = compiler.machine_of(target)
        needed = sorted(compiler.needed_symbols(machine.emit_object(module)))
        code.append((one.__name__, str(kind), machine.emit_assembly(module), needed))
print(json.dumps([names, code]))
"""
"""An entry of the store has no assembly: compile once more all that there is, or a file needs."""

ARM = "aarch64-unknown-linux-gnu"
ARM_CPUS = ("generic", "neoverse-v1")
"""Two that code is made for: with 128 bits of NEON alone, and with SVE, of any length."""

EVERY_KERNEL = bool(os.environ.get("EVERY_KERNEL"))


def disassembled(target=None, some=(), model=""):
    """Return the names of kernels, and (name, signature, assembly, symbols) of all their forms."""
    asked = json.dumps([target, some, model])
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", DISASSEMBLE.format(names=kernel_modules()), asked],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def compiled():
    """
    The kernels as this machine runs them.

    Those that the teapot needs; ``EVERY_KERNEL`` in the environment asks for all.
    """
    names, code = disassembled(model="" if EVERY_KERNEL else str(TEAPOT))
    assert len(names) >= (100 if EVERY_KERNEL else 15)
    return names, code


@pytest.mark.takes_long
@pytest.mark.compiles_first
@compiled_only
def test_no_kernel_fuses_or_calls_a_math_library(compiled):
    check_independence(*compiled)


def check_independence(names, code):
    """Fail if a kernel has no form, or a form whose bits depend on the CPU."""
    assert {name for name, *_ in code} >= set(names), "a kernel that declares no form"
    for name, signature, assembly, needed in code:
        assert name in assembly
        assert cpu_dependent(assembly) == [], (name, signature)
        assert set(needed) <= compiler.ALLOWED, (name, signature)


@pytest.mark.takes_long
@pytest.mark.compiles_first
@compiled_only
def test_kernels_are_compiled_for_the_cpu_that_was_asked_for(compiled):
    used = vectors_used(compiled[1])
    if platform.machine().lower() not in ("x86_64", "amd64"):
        assert used["neon"] > 0
        return
    assert used["xmm"] > 0
    if numba.config.CPU_NAME == "generic":
        assert used["ymm"] == used["zmm"] == 0
        return
    if "avx512f" not in store.cpu_features()[1]:
        pytest.skip("this CPU has no AVX-512")
    assert used["zmm"] > 0


A_FEW = (
    "rasterjit.pipeline.visibility.nearest.draw_tiles",
    "rasterjit.pipeline.lighting.light_stages.add_shiny_lights",
)
"""Kernels that are looked at in any case: with vectors, with powers."""


@pytest.fixture(scope="module", params=ARM_CPUS)
def compiled_for_arm(request):
    """The kernels as an ARM machine runs them: a few, or all with ``EVERY_KERNEL``."""
    names, code = disassembled((ARM, request.param, ""), () if EVERY_KERNEL else A_FEW)
    assert len(names) >= (100 if EVERY_KERNEL else len(A_FEW))
    return request.param, names, code


@compiled_only
def test_no_kernel_fuses_or_calls_a_math_library_on_arm(compiled_for_arm):
    _, names, code = compiled_for_arm
    check_independence(names, code)


@compiled_only
def test_kernels_are_compiled_for_the_arm_that_was_asked_for(compiled_for_arm):
    cpu, _, code = compiled_for_arm
    used = vectors_used(code)
    assert used["neon"] > 0
    assert (used["sve"] > 0) == (cpu != "generic")
    assert used["xmm"] == used["ymm"] == used["zmm"] == 0


# What the look at machine code must find, planted.

MACHINES = {
    "x86": store.Target("x86_64-unknown-linux-gnu", "x86-64-v3", ""),
    "x86 of 512 bits": store.Target("x86_64-unknown-linux-gnu", "x86-64-v4", ""),
    **{f"ARM {cpu}": store.Target(ARM, cpu, "") for cpu in ARM_CPUS},
}
every_machine = pytest.mark.parametrize("machine", MACHINES)


def code_for(machine, kind, text, result="%r", more=""):
    """Return assembly and object code of a function of three arguments x, y and z of a kind."""
    from llvmlite import binding

    made = compiler.machine_of(MACHINES[machine])
    module = binding.parse_assembly(
        f"define {kind} @planted({kind} %x, {kind} %y, {kind} %z) "
        f"{{\n{text}\nret {kind} {result}\n}}\n{more}"
    )
    module.triple = MACHINES[machine].triple
    compiler.optimize(module, made)
    return made.emit_assembly(module), made.emit_object(module)


@compiled_only
@every_machine
@pytest.mark.parametrize("kind", ["float", "double", "<8 x float>", "<3 x double>"])
@pytest.mark.parametrize("operation", ["fadd {0} %p, %z", "fsub {0} %p, %z", "fsub {0} %z, %p"])
@pytest.mark.parametrize("sign", ["", "\n%n = fneg {0} %r"])
def test_look_at_machine_code_finds_a_fused(machine, kind, operation, sign):
    fused = f"%p = fmul contract {kind} %x, %y\n%r = {operation} {sign}"
    fused = fused.replace("fadd", "fadd contract").replace("fsub", "fsub contract").format(kind)
    result = "%n" if sign else "%r"
    assert cpu_dependent(code_for(machine, kind, fused, result)[0])
    apart = fused.replace("contract", "")
    assert cpu_dependent(code_for(machine, kind, apart, result)[0]) == []


ESTIMATES = {
    "x86": ("x86.sse.rcp.ps", "x86.sse.rsqrt.ps"),
    "ARM": ("aarch64.neon.frecpe.v4f32", "aarch64.neon.frsqrte.v4f32"),
}


@compiled_only
@every_machine
@pytest.mark.parametrize("which", [0, 1])
def test_look_at_machine_code_finds_an_estimate(machine, which):
    kind, name = "<4 x float>", f"llvm.{ESTIMATES[machine.split()[0]][which]}"
    called = f"%r = call {kind} @{name}({kind} %x)"
    declared = f"declare {kind} @{name}({kind})"
    assert cpu_dependent(code_for(machine, kind, called, more=declared)[0])
    assert cpu_dependent(code_for(machine, kind, f"%r = fdiv {kind} %x, %y")[0]) == []


@compiled_only
@every_machine
def test_object_code_that_calls_a_math_library_names_it(machine):
    """What `compiler.compile_form` refuses, by `compiler.needed_symbols`."""
    called = "%r = call double @llvm.sin.f64(double %x)"
    declared = "declare double @llvm.sin.f64(double)"
    assembly, code = code_for(machine, "double", called, more=declared)
    assert cpu_dependent(assembly) == ["sin"]
    assert "sin" in compiler.needed_symbols(code) - compiler.ALLOWED
    assert (
        compiler.needed_symbols(code_for(machine, "double", "%r = fadd double %x, %y")[1]) == set()
    )


FAR = {
    "x86": {1, 24},  # R_X86_64_64, R_X86_64_PC64
    # R_AARCH64_ABS64, _PREL64 and _MOVW_UABS_G0 to _G3; LLVM's linker gives _CALL26 a stub.
    "ARM": {257, 260, *range(263, 270), 283},
}
"""Relocations that reach the whole address space, by the numbers of ELF's supplements."""


def relocations(code):
    """Return the types of relocations of object code, sections of addends alone."""
    (start,) = struct.unpack_from("<Q", code, 0x28)
    size, count = struct.unpack_from("<HH", code, 0x3A)
    found = set()
    for k in range(count):
        _, kind, _, _, offset, length = struct.unpack_from("<IIQQQQ", code, start + size * k)
        if kind == 4:
            entries = struct.iter_unpack("<QIIq", code[offset : offset + length])
            found |= {type_ for _, type_, _, _ in entries}
    return found


@compiled_only
@every_machine
def test_constants_and_functions_may_lie_anywhere(machine):
    text = """
        %p = fmul <8 x double> %x, <double 1.5, double 2.5, double 3.5, double 4.5,
                                    double 5.5, double 6.5, double 7.5, double 8.5>
        %r = call <8 x double> @llvm.floor.v8f64(<8 x double> %p)
        call void @memset(ptr null, i32 7, i64 8)
    """
    declared = """
        declare <8 x double> @llvm.floor.v8f64(<8 x double>)
        declare void @memset(ptr, i32, i64)
    """
    _, code = code_for(machine, "<8 x double>", text, more=declared)
    assert "memset" in compiler.needed_symbols(code)
    assert relocations(code)
    assert relocations(code) <= FAR[machine.split()[0]]


@compiled_only
def test_look_at_machine_code_finds_math_functions():
    @numba.njit
    def curve(x):
        return np.exp(x) + np.sin(x) + x**2.4

    curve(0.5)
    found = cpu_dependent(curve.inspect_asm(curve.signatures[0]))
    assert {"exp", "sin", "pow"} <= {name.removeprefix("numba_") for name in found}


@compiled_only
@pytest.mark.skipif("fma" not in store.cpu_features()[1], reason="this CPU fuses nothing")
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
    ("runtime/float_math.py", "log2"): "our own polynomial, of IEEE operations alone",
    ("runtime/float_math.py", "exp2"): "our own polynomial, of IEEE operations alone",
    ("pipeline/lighting/blinn_phong.py", "power"): "that of runtime/float_math.py",
    ("pipeline/lighting/sheen.py", "power"): "that of runtime/float_math.py",
    ("pipeline/lighting/sheen.py", "exp2"): "that of runtime/float_math.py",
    ("effects/eye_dome/stage.py", "exp2"): "that of runtime/float_math.py",
    ("effects/eye_dome/stage.py", "log2"): "that of runtime/float_math.py",
    ("effects/fog/stage.py", "exp2"): "that of runtime/float_math.py",
    ("effects/tone_map/stage.py", "exp2"): "that of runtime/float_math.py",
    ("effects/transmission/stage.py", "log2"): "that of runtime/float_math.py",
    ("effects/transmission/stage.py", "power"): "that of runtime/float_math.py",
    ("runtime/state.py", "sum"): "whole numbers: words of a block",
    ("runtime/state.py", "prod"): "whole numbers: words of a block",
    ("runtime/driver.py", "sum"): "whole numbers: words of a block",
    ("runtime/store.py", "sum"): "whole numbers: counts of files",
    ("pipeline/surface/textures.py", "log2"): "that of runtime/float_math.py",
    ("effects/environment/stage.py", "log2"): "that of runtime/float_math.py",
    ("pipeline/encode.py", "**"): "whole numbers of Python, without bound",
    ("pipeline/visibility/draw.py", "sum"): "whole numbers: counts of triangles",
    ("pipeline/visibility/primitives.py", "sum"): "whole numbers: counts of pieces",
    ("pipeline/visibility/primitives.py", "dot"): "our own, three terms of Python",
    ("outputs/frame.py", "sum"): "seconds, for a text",
    ("outputs/grid.py", "sum"): "whole numbers: codes of a colour",
    ("survey/sections.py", "fsum"): "rounded once, in whatever order",
    ("scene/points.py", "sum"): "whole numbers: counts for a message",
    ("classics/framebuffer.py", "sum"): "whole numbers: pixels of lines",
    ("rendering/batch.py", "sum"): "whole numbers: counts of faces and pixels",
    ("rendering/batch.py", "prod"): "whole numbers: lengths of arrays",
    ("rendering/pool.py", "sum"): "whole numbers: bytes",
    ("rendering/pool.py", "prod"): "whole numbers: lengths of arrays",
    ("rendering/kept.py", "sum"): "whole numbers: bytes",
    ("rendering/together.py", "sum"): "whole numbers: counts of faces and pixels",
    ("rendering/desk.py", "prod"): "whole numbers: lengths of arrays",
    ("distributed/layers.py", "sum"): "whole numbers: counts of faces",
    ("distributed/clusters.py", "sum"): "whole numbers: threads of a cluster",
    ("viewer/browser.py", "sum"): "whole numbers: bytes",
    ("io/foreign/wire.py", "prod"): "whole numbers of Python",
    ("io/arcs.py", "hypot"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/arcs.py", "atan2"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/arcs.py", "arctan2"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/arcs.py", "asin"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/arcs.py", "cos"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/arcs.py", "sin"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/arcs.py", "@"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/drawings.py", "hypot"): "the extent of a drawing, by which curves are cut",
    ("runtime/threads.py", "prod"): "whole numbers of Python",
    ("outputs/masks.py", "sum"): "whole numbers: counts of pixels",
    ("survey/contents.py", "sum"): "whole numbers: counts of objects",
    ("survey/facts.py", "sum"): "whole numbers: counts of objects",
    ("scene/mesh.py", "sum"): "whole numbers: counts for a message",
    ("scene/validation.py", "sum"): "whole numbers: counts for a message",
    ("scene/color.py", "sum"): "whole numbers: counts for a message",
    ("scene/imitation.py", "**"): "whole numbers of Python, without bound",
    ("scene/color.py", "**"): "whole numbers and fractions",
    ("scene/framing.py", "dot"): "our own, three terms of Python",
    ("survey/clip_planes.py", "dot"): "our own, three terms of Python",
    ("scene/vectors.py", "dot"): "our own, three terms of Python",
    ("scene/transforms.py", "dot"): "our own, three terms of Python",
    ("scene/trs.py", "dot"): "our own, three terms of Python",
    ("rendering/lens_pictures.py", "dot"): "our own, three terms of Python",
    ("styles/__init__.py", "dot"): "our own, three terms of Python",
    ("styles/ground.py", "dot"): "our own, three terms of Python",
    ("styles/painting.py", "dot"): "our own, three terms of Python",
    ("io/cameras.py", "dot"): "our own, three terms of Python",
    ("io/dxf.py", "sum"): "whole numbers: counts of entities and corners",
    ("animation/tracks.py", "sum"): "between two keys all is SciPy's affair",
    ("animation/tracks.py", "@"): "between two keys all is SciPy's affair",
    ("animation/tracks.py", "log"): "between two keys all is SciPy's affair",
    ("animation/tracks.py", "exp"): "between two keys all is SciPy's affair",
    ("scene/hdr_image.py", "sum"): "whole numbers: bytes",
    ("io/binvox.py", "sum"): "whole numbers: counts of voxels",
    ("io/drawings.py", "sum"): "whole numbers: counts of values",
    ("io/point_clouds/cloud.py", "sum"): "whole numbers: counts of values",
    ("io/point_clouds/pcd.py", "sum"): "whole numbers: bytes and counts of values",
    ("io/point_clouds/pcd.py", "prod"): "whole numbers of Python",
    ("effects/shadows/__init__.py", "sum"): "whole numbers: counts of texels, and for a text",
    ("survey/arrays.py", "sum"): "whole numbers: counts of rows",
    ("scene/texture.py", "sum"): "whole numbers: counts of texels",
    ("survey/placement.py", "sum"): "three terms: NumPy splits sums from eight terms on",
    ("dataset/recipe.py", "random"): "Python's own numbers, the same for a text everywhere",
    ("io/trimesh/scene.py", "sum"): "three terms: NumPy splits sums from eight terms on",
    ("io/trimesh/materials.py", "sum"): "three terms in a row, and counts",
    ("io/text/mtl.py", "mean"): "three terms: NumPy splits sums from eight terms on",
    ("io/text/parts.py", "sum"): "whole numbers: counts of values",
    ("io/text/lines.py", "sum"): "whole numbers: counts of words",
    ("io/text/obj.py", "sum"): "whole numbers: counts of corners and vertices",
    ("io/text/off.py", "sum"): "whole numbers: counts of corners",
    ("io/text/ply.py", "sum"): "whole numbers: counts of values and bytes",
    ("compat/pyrender/material.py", "sum"): "whole numbers: flags",
    ("compat/pyrender/mesh.py", "mean"): "two terms",
    ("compat/pyrender/node.py", "sum"): "four terms: NumPy splits sums from eight terms on",
    ("compat/pyrender/node.py", "dot"): "our own, three terms of Python",
    ("compat/pyrender/primitive.py", "mean"): "two terms",
    ("compat/pyrender/primitive.py", "sum"): "whole numbers: flags; and three terms",
    ("compat/pyrender/viewer.py", "**"): "follows a hand, at the wheel",
    ("compat/pyrender/viewer.py", "sum"): "whole numbers: keys; and three terms, for a yes or no",
    ("compat/pyrender/wires.py", "dot"): "our own, three terms of Python",
    ("pipeline/lighting/pyrender.py", "power"): "that of runtime/float_math.py",
    ("pipeline/visibility/mask_shares.py", "**"): "a power of two of a whole number",
    ("rendering/notices.py", "mean"): "whole numbers: a share of pixels",
    ("rendering/notices.py", "log2"): "for a text",
    ("io/fonts.py", "sum"): "whole numbers: bytes and codes",
    ("io/fonts.py", "@"): "two terms",
    ("io/foreign/cells.py", "sum"): "whole numbers: counts of cells",
    ("io/threemf/parts.py", "sum"): "whole numbers: counts of triangles",
    (
        "io/threemf/properties.py",
        "sum",
    ): "one sum over each column, row by row",
    ("io/threemf/properties.py", "mean"): "three terms: NumPy splits sums from eight terms on",
}
"""Uses in (file, name), with why their bits are the same everywhere."""

OFF_THE_PATH = {
    "cli/doctor.py": "checks an installation, draws nothing for anybody",
    "viewer/viewer.py": "what a person clicks, and text",
    "viewer/overlay.py": "text",
    "viewer/graphics.py": "text for terminals",
    "viewer/tab.py": "text about what a page shows",
    "compat/matplotlib.py": "works in the matrices of matplotlib, which come from BLAS",
    "compat/pyrender/showing.py": "follows a hand, as viewer/controls.py does; and text",
    "compat/pyrender/trackball.py": "follows a hand, as viewer/controls.py does",
    "viewer/controls.py": "follows a hand: where a person leaves the camera is in no file",
    "cli/warmup.py": "compiles kernels, keeps no picture",
    "inspect/oracle.py": "whole numbers and fractions",
    "inspect/pixel_report.py": "text",
    "outputs/diagnostics.py": "pictures of a frame's cost, not of its scene",
    "survey/camera_view.py": "text about a camera",
    "inspect/pixel.py": "text about one pixel",
    "inspect/pixel_color.py": "text about one pixel",
    "runtime/jit.py": "compiles",
    "cli/report.py": "text",
    "cli/info.py": "text",
    "__main__.py": "nothing but a call",
    "rendering/budget.py": "compares pictures and times",
    "accuracy/report/crops.py": "a page about pictures",
    "accuracy/errors.py": "compares pictures, makes none",
    "accuracy/report/files.py": "text",
    "accuracy/report/plots.py": "a page about pictures",
    "accuracy/report/page.py": "a page about pictures",
    "accuracy/report/scales.py": "a page about pictures",
    "accuracy/report/shots.py": "a page about pictures",
    "accuracy/choice.py": "compares times and errors",
    "accuracy/effect_references.py": "pictures to compare with, which nobody keeps",
    "accuracy/effects.py": "compares times and errors",
    "accuracy/together.py": "compares times and errors",
    "accuracy/ranking.py": "compares times and errors",
    "accuracy/sentences.py": "text about times and errors",
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
