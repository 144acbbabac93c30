"""The house is as the design draws it: layers, imports, names, docstrings."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from kernel_files import kernel_files, kernel_modules

import rasterjit as rj
from rasterjit.rendering.effect_registry import EFFECTS

PACKAGE = Path(rj.__file__).parent
ROOT = PACKAGE.parent
SOURCES = sorted(PACKAGE.rglob("*.py"))
FOLDERS = {
    ".".join(("rasterjit", *path.parent.relative_to(PACKAGE).parts))
    for path in PACKAGE.rglob("__init__.py")
}

BESIDE_KERNELS = {"__future__", "bisect", "functools", "math", "typing", "numpy"}
"""What files of kernels import from elsewhere; tables for kernels are made beside them."""

FOR_KERNELS = {
    "rasterjit.runtime.jit",
    "rasterjit.runtime.intrinsics",
    "rasterjit.runtime.state_block",
    "rasterjit.pipeline.records",
    "rasterjit.pipeline.surface.sample_block",
}
"""Files without kernels that they import: how to compile, instructions, types, records."""

RAISING = ast.Raise, ast.Assert, ast.Try
PUBLIC = {name: getattr(rj, name) for name in rj.__all__}
COMPILED = {"kernel", "raw_kernel", "stage", "helper", "disjoint_helper"}
"""Decorators of what is compiled."""


def imports(tree):
    """Yield (line, module) of all that a file imports; what comes from a folder is a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            names = [node.module]
            if node.module in FOLDERS:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from ((node.lineno, name) for name in names)


@pytest.mark.skipif(importlib.util.find_spec("importlinter") is None, reason="no import-linter")
def test_layers_hold():
    done = subprocess.run(
        [
            sys.executable, "-c",
            "from importlinter.cli import lint_imports_command; lint_imports_command()",
            "--config", str(ROOT / "pyproject.toml"), "--no-cache",
        ],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout
    assert "0 kept" not in done.stdout


def test_no_circles_no_name_twice_no_long_signature_and_no_long_function_without_headings():
    code = (
        "import json, pathlib; from benchmarks import house\n"
        "files = house.read(pathlib.Path.cwd())\n"
        "bare = sorted(name for name, has in house.headings(files).items() if not has)\n"
        "checks = house.circles, house.repeated_classes, house.long_signatures\n"
        "print(json.dumps([*(check(files) for check in checks), bare]))"
    )
    # The trees of all sources take 200 MB, which would stay with all other tests.
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [[], [], [], []]


def test_files_say_what_they_are_and_are_finished():
    for path in SOURCES:
        source = path.read_text()
        assert ast.get_docstring(ast.parse(source)), f"{path}: no module docstring"
        assert not re.search(r"\b(TODO|FIXME|XXX|HACK)\b", source), path
        # One name is pyrender's.
        if path.parent.name != "pyrender":
            assert path.stem not in {"utils", "util", "helpers", "misc", "common"}


def test_public_names_are_described():
    for name, thing in PUBLIC.items():
        assert inspect.getdoc(thing), name
        for attribute, member in vars(thing).items() if inspect.isclass(thing) else ():
            assert thing.__doc__, name
            if not attribute.startswith("_") and (callable(member) or isinstance(member, property)):
                assert inspect.getdoc(member), f"{name}.{attribute}"


def test_public_signatures_are_typed():
    functions = {name: thing for name, thing in PUBLIC.items() if inspect.isfunction(thing)}
    for name, thing in PUBLIC.items():
        for attribute, member in vars(thing).items() if inspect.isclass(thing) else ():
            if inspect.isfunction(member) and not attribute.startswith("_"):
                functions[f"{name}.{attribute}"] = member
    for name, function in functions.items():
        hints = function.__annotations__
        wanted = set(inspect.signature(function).parameters) - {"self", "cls"}
        assert wanted <= set(hints), f"{name}: {sorted(wanted - set(hints))}"
        assert "return" in hints, name


def test_contract_of_names_is_kept():
    for name in (
        "load", "render", "explain", "rasterize", "Renderer", "Frame", "Mesh", "Scene", "Material",
        "AmbientLight", "DirectionalLight", "PointLight", "SpotLight", "Shadow",
        "PerspectiveCamera", "OrthographicCamera", "MatrixCamera", "Quality", "fit_camera",
        "transforms", "Framebuffer", "ClassicPipeline", "MeshFileError", "LoadWarning",
    ):  # fmt: skip
        assert name in rj.__all__
    assert sorted(set(rj.__all__)) == sorted(rj.__all__)
    assert all(hasattr(rj, name) for name in rj.__all__)


def test_the_core_install_has_every_name():
    extras = (
        "matplotlib", "scipy", "dask", "distributed", "rendercanvas", "anywidget", "glfw",
        "OpenEXR", "tifffile", "zarr", "jinja2", "flip_evaluator", "embreex", "pytest",
    )  # fmt: skip
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({extras})); import pydoc, rasterjit\n"
        "from rasterjit import *\n"
        "print(pydoc.render_doc(rasterjit)[:12], render_layers.__name__, animation.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("render_layers rasterjit.animation\n")


def test_the_manual_names_every_public_name():
    assert {*rj.__all__} <= {*re.findall(r"`(?:Frame\.)?(\w+)`", rj.__doc__)}


def test_importing_loads_nothing_heavy():
    code = (
        "import sys, rasterjit, rasterjit.dataset.recipe, rasterjit.io.camera_files as cameras; "
        "print([m for m in ('trimesh', 'networkx', 'imageio', 'rich', 'click', 'matplotlib', "
        "'dask', 'distributed', 'rendercanvas', 'tifffile', 'zarr', 'PIL', 'yaml', "
        "*(f'{cameras.__name__}.{m}' for m, _ in cameras.WRITERS.values())) if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"


def test_kernels_do_not_raise():
    for path in kernel_files():
        for function in ast.walk(ast.parse(path.read_text())):
            marks = {getattr(one, "id", "") for one in getattr(function, "decorator_list", ())}
            for node in ast.walk(function) if marks & COMPILED else ():
                assert not isinstance(node, RAISING), f"{path}, line {node.lineno}"


def test_files_of_kernels_neither_raise_nor_import_what_they_may_not():
    allowed = {*kernel_modules(), *FOR_KERNELS}
    for path in kernel_files():
        if path.parent == PACKAGE / "runtime":
            continue
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            assert not isinstance(node, RAISING), f"{path}, line {node.lineno}"
        for line, module in imports(tree):
            is_ours = module.partition(".")[0] == "rasterjit"
            place = module if is_ours else module.partition(".")[0]
            assert place in (allowed if is_ours else BESIDE_KERNELS), f"{path}, {line}: {module}"


def test_the_oracle_imports_the_standard_library_alone():
    source = (PACKAGE / "inspect" / "oracle.py").read_text()
    for line, module in imports(ast.parse(source)):
        assert module.partition(".")[0] in sys.stdlib_module_names, f"line {line}: {module}"


def test_descriptions_of_scenes_need_no_compiler():
    for path in sorted((PACKAGE / "scene").rglob("*.py")):
        for line, module in imports(ast.parse(path.read_text())):
            assert module.partition(".")[0] != "numba", f"{path.name}, line {line}"


def test_public_modules_are_found_by_their_short_names():
    for name in ("cameras", "masks", "mpl", "oracle", "transforms"):
        module = importlib.import_module(f"rasterjit.{name}")
        assert module is getattr(rj, name)
        assert module.__name__ != f"rasterjit.{name}"
        assert inspect.getdoc(module)


def test_one_effect_at_most_says_how_light_is_shown_in_8_bits():
    for place in ("pixel", "mixed"):
        assert len([effect for effect in EFFECTS if place in effect.places]) <= 1, place
    assert [effect for effect in EFFECTS if "pixel" in effect.places] == [
        effect for effect in EFFECTS if "mixed" in effect.places
    ]


NOT_EFFECTS = {
    ("renderer.py", "diagnostics"): "a stage of the clock; Frame.diagnostics is no picture",
}
"""Strings of rendering that are the name of a row, and why they may be."""


def test_rendering_names_no_effect_but_in_the_list_of_them():
    names = {effect.name for effect in EFFECTS}
    names |= {effect.field for effect in EFFECTS if effect.field}
    named = re.compile(rf"\b(?:{'|'.join(map(re.escape, sorted(names)))})\b")
    for path in (PACKAGE / "rendering").rglob("*.py"):
        if path.name == "effect_registry.py":
            continue
        tree = ast.parse(path.read_text())
        told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
                continue
            if id(node) not in told and (path.name, node.value) not in NOT_EFFECTS:
                found = named.findall(node.value)
                assert not found, f"{path}, line {node.lineno}: {found}"
        for line, module in imports(tree):
            assert not module.startswith("rasterjit.effects"), f"{path}, line {line}: {module}"
