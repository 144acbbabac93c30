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
import itertools
import os
import platform
import struct
from pathlib import Path

import numpy as np
import pytest
from machine_code import MATH, WIDTHS, cpu_dependent, look_at

import rasterjit as rj
from rasterjit.cli import shared_libraries
from rasterjit.runtime import code_generation, jit, store, targets
from rasterjit.runtime.isolated_numba import compiler

PACKAGE = Path(rj.__file__).parent
TEAPOT = PACKAGE.parent / "models" / "teapot.obj"
compiled_only = pytest.mark.skipif(
    jit.DISABLED, reason="NUMBA_DISABLE_JIT is set: there is no machine code"
)

ARM = "aarch64-unknown-linux-gnu"
ARM_CPUS = ("generic", "neoverse-v1")
"""Two that code is made for: with 128 bits of NEON alone, and with SVE, of any length."""

IMAGE_REL_AMD64_ADDR64 = 1
"""Relocation of 64 bits in object files of Windows (PE format specification)."""

GENERIC = os.environ.get("NUMBA_CPU_NAME") == "generic"
"""Code is made for any CPU."""

EVERY_KERNEL = bool(os.environ.get("EVERY_KERNEL"))
"""Look at all kernels, not at a few."""

A_FEW = (
    "rasterjit.pipeline.visibility.tile_rasterizer.draw_tiles",
    "rasterjit.pipeline.lighting.light_stages.add_blinn_phong_lights",
)
"""Kernels that are looked at in any case: with vectors, with powers."""


def vectors_of(names, forms):
    """Return how often kernels name vector registers; fail if their bits depend on the CPU."""
    assert {form.kernel for form in forms} == set(names), "a kernel that declares no form"
    assert [form[:3] for form in forms if form.dependent] == []
    return {kind: sum(form.vectors[kind] for form in forms) for kind in WIDTHS}


@pytest.mark.takes_long
@pytest.mark.compiles_first
@compiled_only
def test_kernels_fuse_nothing_call_no_math_library_and_are_for_the_cpu_that_was_asked_for():
    # Those that the teapot needs, or all.
    names, forms = look_at(model="" if EVERY_KERNEL else str(TEAPOT))
    assert len(names) >= (100 if EVERY_KERNEL else 15)
    used = vectors_of(names, forms)
    assert [form for form in forms if not {*form.needed} <= code_generation.ALLOWED_CALLS] == []
    if platform.machine().lower() not in ("x86_64", "amd64"):
        assert used["neon"] > 0
        return
    assert used["xmm"] > 0
    if GENERIC:
        assert used["ymm"] == used["zmm"] == 0
        return
    if "avx512f" not in store.host_cpu_features()[1]:
        pytest.skip("this CPU has no AVX-512")
    assert used["zmm"] > 0


@compiled_only
@pytest.mark.parametrize(
    "cpu", [pytest.param(ARM_CPUS[0], marks=pytest.mark.takes_long), ARM_CPUS[1]]
)
def test_kernels_fuse_nothing_and_call_no_math_library_on_the_arm_that_was_asked_for(cpu):
    names, forms = look_at((ARM, cpu, ""), () if EVERY_KERNEL else A_FEW)
    assert len(names) >= (100 if EVERY_KERNEL else len(A_FEW))
    used = vectors_of(names, forms)
    assert [form for form in forms if not {*form.needed} <= code_generation.ALLOWED_CALLS] == []
    assert used["neon"] > 0
    assert (used["sve"] > 0) == (cpu != "generic")
    assert used["xmm"] == used["ymm"] == used["zmm"] == 0


LIBRARIES = {
    target: [
        one for platform in targets.PLATFORMS.values() for one in platform.targets()
        if (one[1:], targets.split_triple(one.triple)[0]) == (target[1:], name)
    ]
    for name in ("x86_64", "aarch64") for target in targets.PLATFORMS[name].targets()
}  # fmt: skip
"""What wheels bring for each CPU, by the target that it is compiled for."""


@compiled_only
@pytest.mark.parametrize("target", LIBRARIES, ids=lambda target: target.cpu)
def test_shipped_kernels_fuse_nothing_and_call_nothing_but_memory_functions(target):
    names, forms = look_at(target, () if EVERY_KERNEL else A_FEW, libraries=LIBRARIES[target])
    assert len(names) >= (100 if EVERY_KERNEL else len(A_FEW))
    assert len(forms) >= len(names) * len(LIBRARIES[target])
    used = vectors_of(names, forms)
    allowed = frozenset.union(*map(shared_libraries.allowed_in, LIBRARIES[target]))
    assert {name for form in forms for name in form.needed} <= allowed
    widest = {"x86-64-v2": "xmm", "x86-64-v3": "ymm", "x86-64-v4": "zmm", "generic": "neon"}
    assert used[widest[target.cpu]] > 0
    assert used["sve"] == 0
    assert (used["ymm"] == 0) == (target.cpu in ("x86-64-v2", "generic"))
    assert (used["zmm"] == 0) == (target.cpu != "x86-64-v4")


# What the look at machine code must find, planted.

MACHINES = {
    "x86": store.Target("x86_64-unknown-linux-gnu", "x86-64-v3", ""),
    "x86 of 512 bits": store.Target("x86_64-unknown-linux-gnu", "x86-64-v4", ""),
    **{f"ARM {cpu}": store.Target(ARM, cpu, "") for cpu in ARM_CPUS},
}


def every_machine(test):
    """Run a test for each machine where what LLVM keeps of it is given back."""
    each = pytest.mark.parametrize("machine", MACHINES)(test)
    return pytest.mark.usefixtures("own_process")(each)


def code_for(machine, kind, text, result="%r", more=""):
    """Return assembly and object code of a function of three arguments x, y and z of a kind."""
    from llvmlite import binding

    made = code_generation.target_machine(MACHINES[machine])
    module = binding.parse_assembly(
        f"define {kind} @planted({kind} %x, {kind} %y, {kind} %z) "
        f"{{\n{text}\nret {kind} {result}\n}}\n{more}"
    )
    module.triple = MACHINES[machine].triple
    compiler().optimize(module, made)
    return made.emit_assembly(module), made.emit_object(module)


@compiled_only
@every_machine
def test_look_at_machine_code_finds_what_is_fused(machine):
    kinds = "float", "double", "<8 x float>", "<3 x double>"
    operations = "fadd {0} %p, %z", "fsub {0} %p, %z", "fsub {0} %z, %p"
    for kind, operation, sign in itertools.product(kinds, operations, ("", "\n%n = fneg {0} %r")):
        fused = f"%p = fmul contract {kind} %x, %y\n%r = {operation} {sign}"
        fused = fused.replace("fadd", "fadd contract").replace("fsub", "fsub contract").format(kind)
        result = "%n" if sign else "%r"
        assert cpu_dependent(code_for(machine, kind, fused, result)[0]), fused
        apart = fused.replace("contract", "")
        assert cpu_dependent(code_for(machine, kind, apart, result)[0]) == [], apart


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
    """What `code_generation.generate_code` refuses, by `needed_symbols`."""
    called = "%r = call double @llvm.sin.f64(double %x)"
    declared = "declare double @llvm.sin.f64(double)"
    assembly, code = code_for(machine, "double", called, more=declared)
    assert cpu_dependent(assembly) == ["sin"]
    assert "sin" in code_generation.find_undefined_symbols(code) - code_generation.ALLOWED_CALLS
    assert (
        code_generation.find_undefined_symbols(
            code_for(machine, "double", "%r = fadd double %x, %y")[1]
        )
        == set()
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
    assert "memset" in code_generation.find_undefined_symbols(code)
    assert relocations(code)
    assert relocations(code) <= FAR[machine.split()[0]]


@compiled_only
@pytest.mark.usefixtures("own_process")
def test_code_for_windows_takes_addresses_of_64_bits():
    from llvmlite import binding

    windows = store.Target("x86_64-pc-windows-msvc", "x86-64-v3", "")
    made = code_generation.target_machine(windows)
    module = binding.parse_assembly(
        "define double @planted(double %x) {\n"
        "%p = fmul double %x, 1.1\n%r = call double @other(double %p)\nret double %r\n}\n"
        "declare double @other(double)"
    )
    module.triple = windows.triple
    code = made.emit_object(module)
    sections, header = struct.unpack_from("<2xH12xH", code)
    found = set()
    for k in range(sections):
        name, at, count = struct.unpack_from("<8s16xI4xH", code, 20 + header + 40 * k)
        if name.startswith(b".text"):
            entries = code[at : at + 10 * count]
            found |= {type_ for _, _, type_ in struct.iter_unpack("<IIH", entries)}
    assert found == {IMAGE_REL_AMD64_ADDR64}


def test_an_update_of_macos_changes_no_target(monkeypatch):
    from llvmlite import binding

    for triple in ("arm64-apple-darwin23.1.0", "x86_64-apple-macosx14.0"):
        monkeypatch.setattr(binding, "get_process_triple", lambda triple=triple: triple)
        assert targets.process_triple() == triple.rstrip("0123456789.")
    monkeypatch.setattr(binding, "get_process_triple", lambda: "x86_64-unknown-linux-gnu")
    assert targets.process_triple() == "x86_64-unknown-linux-gnu"


@compiled_only
def test_look_at_machine_code_finds_math_functions():
    import numba

    @numba.njit
    def curve(x):
        return np.exp(x) + np.sin(x) + x**2.4

    curve(0.5)
    found = cpu_dependent(curve.inspect_asm(curve.signatures[0]))
    assert {"exp", "sin", "pow"} <= {name.removeprefix("numba_") for name in found}


@compiled_only
@pytest.mark.skipif("fma" not in store.host_cpu_features()[1], reason="this CPU fuses nothing")
@pytest.mark.skipif(GENERIC, reason="compiled for a CPU without FMA")
def test_look_at_machine_code_finds_fused_operations():
    import numba

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
    ("io/foreign/isolation.py", "sum"): "of whole numbers: the bytes of a request",
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
    ("runtime/state_block.py", "sum"): "whole numbers: words of a block",
    ("runtime/state_block.py", "prod"): "whole numbers: words of a block",
    ("runtime/stage_runner.py", "sum"): "whole numbers: words of a block",
    ("runtime/store.py", "sum"): "whole numbers: counts of files",
    ("pipeline/surface/texture_filters.py", "log2"): "that of runtime/float_math.py",
    ("effects/environment/stage.py", "log2"): "that of runtime/float_math.py",
    ("pipeline/srgb_encoding.py", "**"): "whole numbers of Python, without bound",
    ("pipeline/visibility/visibility_pass.py", "sum"): "whole numbers: counts of triangles",
    ("pipeline/visibility/primitive_expansion.py", "sum"): "whole numbers: counts of pieces",
    ("pipeline/visibility/primitive_expansion.py", "dot"): "our own, three terms of Python",
    ("outputs/frame.py", "sum"): "seconds, for a text",
    ("outputs/contact_sheet.py", "sum"): "whole numbers: codes of a colour",
    ("survey/cross_sections.py", "fsum"): "rounded once, in whatever order",
    ("survey/cap_overlaps.py", "fsum"): "rounded once, in whatever order",
    ("survey/cap_overlaps.py", "sum"): "whole numbers: counts of vertices",
    ("scene/dimensions.py", "dot"): "our own, three terms of Python",
    ("inspect/exploded_view.py", "dot"): "our own, three terms of Python",
    ("inspect/cross_section.py", "fsum"): "rounded once, in whatever order",
    ("hidden_lines/helvetica.py", "sum"): "whole numbers: widths of characters",
    ("hidden_lines/cells.py", "sum"): "whole numbers: counts of cells",
    ("hidden_lines/occlusion.py", "sum"): "fractions",
    ("scene/mip_levels.py", "sum"): "whole numbers: counts of texels",
    ("scene/points.py", "sum"): "whole numbers: counts for a message",
    ("classics/framebuffer.py", "sum"): "whole numbers: pixels of lines",
    ("rendering/batch.py", "sum"): "whole numbers: counts of faces and pixels",
    ("rendering/batch.py", "prod"): "whole numbers: lengths of arrays",
    ("rendering/renderer_pool.py", "sum"): "whole numbers: bytes",
    ("rendering/renderer_pool.py", "prod"): "whole numbers: lengths of arrays",
    ("rendering/batch_scheduler.py", "sum"): "whole numbers: counts of faces and pixels",
    ("rendering/command_buffer.py", "prod"): "whole numbers: lengths of arrays",
    ("distributed/sort_last.py", "sum"): "whole numbers: counts of faces",
    ("distributed/clusters.py", "sum"): "whole numbers: threads of a cluster",
    ("viewer/browser.py", "sum"): "whole numbers: bytes",
    ("io/foreign/serialization.py", "prod"): "whole numbers of Python",
    ("io/primitives.py", "hypot"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/primitives.py", "atan2"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/primitives.py", "arctan2"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/primitives.py", "asin"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/primitives.py", "cos"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/primitives.py", "sin"): "curves of drawings, as trimesh and ezdxf cut them",
    ("io/primitives.py", "@"): "curves of drawings, as trimesh and ezdxf cut them",
    ("runtime/threads.py", "prod"): "whole numbers of Python",
    ("outputs/masks.py", "sum"): "whole numbers: counts of pixels",
    ("survey/object_counts.py", "sum"): "whole numbers: counts of objects",
    ("survey/facts.py", "sum"): "whole numbers: counts of objects",
    ("scene/mesh.py", "sum"): "whole numbers: counts for a message",
    ("scene/validation.py", "sum"): "whole numbers: counts for a message",
    ("scene/color.py", "sum"): "whole numbers: counts for a message",
    ("scene/norm.py", "**"): "of decimals, whose 40 digits are those of any CPU",
    ("scene/norm.py", "log10"): "of decimals, whose 40 digits are those of any CPU",
    **{
        (f"{name}.py", "norm"): "a field: how values are spread over colours"
        for name in (
            "scene/scalar_field",
            "outputs/colorbar",
            "outputs/ticks",
            "cli/options",
        )
    },
    ("scene/reference_shader.py", "**"): "whole numbers of Python, without bound",
    ("scene/color.py", "**"): "whole numbers and fractions",
    ("scene/camera_fitting.py", "dot"): "our own, three terms of Python",
    ("survey/clip_planes.py", "dot"): "our own, three terms of Python",
    ("scene/vectors.py", "dot"): "our own, three terms of Python",
    ("scene/transforms.py", "dot"): "our own, three terms of Python",
    ("scene/decomposed_transform.py", "dot"): "our own, three terms of Python",
    ("rendering/lens_views.py", "dot"): "our own, three terms of Python",
    ("styles/__init__.py", "dot"): "our own, three terms of Python",
    ("styles/shadow_catcher.py", "dot"): "our own, three terms of Python",
    ("styles/shadow_catcher.py", "sum"): "whole numbers: counts of faces",
    ("styles/style.py", "dot"): "our own, three terms of Python",
    ("scene/validation.py", "dot"): "our own, three terms of Python",
    ("survey/batched_views.py", "dot"): "our own, three terms",
    ("io/camera_files/yaml_files.py", "sum"): "whole numbers: counts of values",
    ("io/dxf.py", "sum"): "whole numbers: counts of entities and corners",
    ("animation/tracks.py", "sum"): "between two keys all is SciPy's affair",
    ("animation/tracks.py", "@"): "between two keys all is SciPy's affair",
    ("animation/tracks.py", "log"): "between two keys all is SciPy's affair",
    ("animation/tracks.py", "exp"): "between two keys all is SciPy's affair",
    ("scene/hdr_image.py", "sum"): "whole numbers: bytes",
    ("io/binvox.py", "sum"): "whole numbers: counts of voxels",
    ("io/images.py", "sum"): "whole numbers: bytes of tags",
    ("io/resources.py", "sum"): "whole numbers: counts of members",
    ("io/primitives.py", "sum"): "whole numbers: counts of values",
    ("io/point_clouds/pcd.py", "sum"): "whole numbers: bytes and counts of values",
    ("io/point_clouds/pcd.py", "prod"): "whole numbers of Python",
    ("effects/shadows/__init__.py", "sum"): "whole numbers: counts of texels, and for a text",
    ("survey/packed_scene.py", "sum"): "whole numbers: counts of rows",
    ("scene/texture.py", "sum"): "whole numbers: counts of texels",
    ("survey/object_transforms.py", "sum"): "three terms: NumPy splits sums from eight terms on",
    ("dataset/object_views.py", "sum"): "whole numbers: counts of pixels",
    ("dataset/recipe.py", "random"): "Python's own numbers, the same for a text everywhere",
    ("io/trimesh/scene.py", "sum"): "three terms in a row, and counts",
    ("io/text/mtl.py", "mean"): "three terms: NumPy splits sums from eight terms on",
    ("io/text/mesh_builder.py", "sum"): "whole numbers: counts of values",
    ("io/text/number_parser.py", "sum"): "whole numbers: counts of words",
    ("io/text/obj.py", "sum"): "whole numbers: counts of corners and vertices",
    ("io/text/off.py", "sum"): "whole numbers: counts of corners",
    ("io/text/ply.py", "sum"): "whole numbers: counts of values and bytes",
    ("compat/pyrender/material.py", "sum"): "whole numbers: flags",
    ("compat/pyrender/node.py", "sum"): "four terms: NumPy splits sums from eight terms on",
    ("compat/pyrender/node.py", "dot"): "our own, three terms of Python",
    ("compat/pyrender/primitive.py", "sum"): "whole numbers: flags; and three terms",
    ("compat/pyrender/viewer.py", "**"): "follows a hand, at the wheel",
    ("compat/pyrender/viewer.py", "sum"): "whole numbers: keys; and three terms, for a yes or no",
    ("compat/pyrender/conversion.py", "dot"): "our own, three terms of Python",
    ("pipeline/lighting/pyrender.py", "power"): "that of runtime/float_math.py",
    ("pipeline/visibility/hashed_alpha.py", "**"): "a power of two of a whole number",
    ("rendering/view_warnings.py", "mean"): "whole numbers: a share of pixels",
    ("rendering/view_warnings.py", "log2"): "for a text",
    ("io/fonts.py", "sum"): "whole numbers: bytes and codes",
    ("io/fonts.py", "@"): "two terms",
    ("io/foreign/objects.py", "sum"): "whole numbers: counts of cells",
    ("io/threemf/parts.py", "sum"): "counts of triangles; over each column, row by row",
    ("io/threemf/parts.py", "mean"): "three terms: NumPy splits sums from eight terms on",
}
"""Uses in (file, name), with why their bits are the same everywhere."""

OFF_THE_PATH = {
    "cli/doctor.py": "checks an installation, draws nothing for anybody",
    "viewer/viewer.py": "what a person clicks, and text",
    "viewer/overlay.py": "text",
    "viewer/terminal.py": "text for terminals",
    "viewer/browser_session.py": "text about what a page shows",
    "compat/matplotlib.py": "works in the matrices of matplotlib, which come from BLAS",
    "compat/mujoco/model_scene.py": "works with places that MuJoCo finds, in its own arithmetic",
    "compat/mujoco/renderer.py": "works with the places that MuJoCo finds, in its own arithmetic",
    "compat/mujoco/shapes.py": "works with sizes that MuJoCo finds, in its own arithmetic",
    "compat/unit_shapes.py": "shapes of simulators, whose places come of their own arithmetic",
    "compat/pybullet/world_scene.py": "works with places that PyBullet finds, in its arithmetic",
    "compat/pybullet/camera_image.py": "takes matrices that PyBullet computed",
    "compat/mujoco/environments.py": "looks where MuJoCo has the bodies",
    "compat/pyrender/live_view.py": "follows a hand, as viewer/controls.py does; and text",
    "compat/pyrender/trackball.py": "follows a hand, as viewer/controls.py does",
    "viewer/controls.py": "follows a hand: where a person leaves the camera is in no file",
    "cli/warmup.py": "compiles kernels, keeps no picture",
    "inspect/oracle.py": "whole numbers and fractions",
    "inspect/pixel_report.py": "text",
    "outputs/diagnostics.py": "pictures of a frame's cost, not of its scene",
    "survey/view_summary.py": "text about a camera",
    "inspect/pixel.py": "text about one pixel",
    "inspect/pixel_color.py": "text about one pixel",
    "runtime/jit.py": "compiles",
    "cli/report.py": "text",
    "cli/info.py": "text",
    "__main__.py": "nothing but a call",
    "rendering/quality_selection.py": "compares pictures and times",
    "accuracy/report/picture_crops.py": "a page about pictures",
    "accuracy/results.py": "compares pictures, makes none",
    "accuracy/report/files.py": "text",
    "accuracy/report/plots.py": "a page about pictures",
    "accuracy/report/page.py": "a page about pictures",
    "accuracy/choice.py": "compares times and errors",
    "accuracy/effect_references.py": "pictures to compare with, which nobody keeps",
    "accuracy/effects.py": "compares times and errors",
    "accuracy/many_scenes.py": "compares times and errors",
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


def test_sources_use_nothing_that_a_cpu_decides_but_what_is_allowed():
    found = {(name, what) for name, source in on_the_path() for _, what in uses(source)}
    assert found == {*ALLOWED}


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
