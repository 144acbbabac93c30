"""The house is as the design draws it: layers, imports, names, docstrings."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from kernel_files import kernel_files, kernel_modules

import rasterjit as rj
from rasterjit.rendering.effects import EFFECTS

PACKAGE = Path(rj.__file__).parent
ROOT = PACKAGE.parent
sys.path.append(str(ROOT))
house = importlib.import_module("benchmarks.house")
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
    "rasterjit.runtime.state",
    "rasterjit.pipeline.records",
    "rasterjit.pipeline.surface.samples",
}
"""Files without kernels that they import: how to compile, instructions, types, records."""

COMPILED = {"kernel", "raw_kernel", "stage", "helper", "disjoint_helper"}
"""Decorators of what is compiled."""


def named(path):
    return path.relative_to(PACKAGE).as_posix()


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


def public_names():
    for name in rj.__all__:
        yield name, getattr(rj, name)


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


@pytest.fixture(scope="module")
def files():
    return house.read(ROOT)


def test_no_modules_import_each_other_in_a_circle(files):
    assert house.circles(files) == []


def test_a_class_name_has_one_meaning(files):
    assert house.repeated_classes(files) == []


def test_functions_take_ten_arguments_at_most(files):
    assert house.long_signatures(files) == []


def test_long_functions_have_headings(files):
    found = {name.partition(":")[0] for name, has in house.headings(files).items() if not has}
    assert not found


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_file_says_what_it_is_and_is_finished(path):
    source = path.read_text()
    assert ast.get_docstring(ast.parse(source)), "no module docstring"
    assert not re.search(r"\b(TODO|FIXME|XXX|HACK)\b", source)
    # One name is pyrender's.
    if path.parent.name != "pyrender":
        assert path.stem not in {"utils", "util", "helpers", "misc", "common"}


@pytest.mark.parametrize(
    ("name", "thing"), list(public_names()), ids=[n for n, _ in public_names()]
)
def test_public_name_is_described(name, thing):
    assert inspect.getdoc(thing), name
    if inspect.isclass(thing):
        assert thing.__doc__
        for attribute, member in vars(thing).items():
            if not attribute.startswith("_") and (callable(member) or isinstance(member, property)):
                assert inspect.getdoc(member), f"{name}.{attribute}"


@pytest.mark.parametrize(
    ("name", "thing"), list(public_names()), ids=[n for n, _ in public_names()]
)
def test_public_signature_is_typed(name, thing):
    functions = []
    if inspect.isfunction(thing):
        functions.append(thing)
    elif inspect.isclass(thing):
        functions += [
            member
            for attribute, member in vars(thing).items()
            if inspect.isfunction(member) and not attribute.startswith("_")
        ]
    for function in functions:
        hints = function.__annotations__
        wanted = set(inspect.signature(function).parameters) - {"self", "cls"}
        assert wanted <= set(hints), f"{name}: {sorted(wanted - set(hints))}"
        assert "return" in hints, f"{name}.{function.__name__}"


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


@pytest.mark.parametrize("name", rj.__all__)
def test_the_manual_names_every_public_name(name):
    assert re.search(rf"`(?:Frame\.)?{name}`", rj.__doc__)


def test_importing_loads_nothing_heavy():
    code = (
        "import sys, rasterjit; "
        "print([m for m in ('trimesh', 'networkx', 'imageio', 'rich', 'click', 'matplotlib', "
        "'dask', 'distributed', 'rendercanvas', 'tifffile', 'zarr', 'PIL') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("path", kernel_files(), ids=named)
def test_kernels_do_not_raise(path):
    for function in ast.walk(ast.parse(path.read_text())):
        marks = {one.id for one in getattr(function, "decorator_list", ()) if hasattr(one, "id")}
        for node in ast.walk(function) if marks & COMPILED else ():
            assert not isinstance(node, (ast.Raise, ast.Assert, ast.Try)), f"line {node.lineno}"


@pytest.mark.parametrize(
    "path", [path for path in kernel_files() if path.parent != PACKAGE / "runtime"], ids=named
)
def test_files_of_kernels_neither_raise_nor_import_what_they_may_not(path):
    allowed = {*kernel_modules(), *FOR_KERNELS}
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        assert not isinstance(node, (ast.Raise, ast.Assert, ast.Try)), f"line {node.lineno}"
    for line, module in imports(tree):
        is_ours = module.partition(".")[0] == "rasterjit"
        place = module if is_ours else module.partition(".")[0]
        assert place in (allowed if is_ours else BESIDE_KERNELS), f"line {line}: {module}"


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


@pytest.mark.parametrize(
    "path", [path for path in SOURCES if path.parent == PACKAGE / "rendering"], ids=named
)
def test_rendering_names_no_effect_but_in_the_list_of_them(path):
    if path.name == "effects.py":
        return
    names, tree = {effect.name for effect in EFFECTS}, ast.parse(path.read_text())
    names |= {effect.field for effect in EFFECTS if effect.field}
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
            continue
        if id(node) in told or (path.name, node.value) in NOT_EFFECTS:
            continue
        found = [name for name in names if re.search(rf"\b{re.escape(name)}\b", node.value)]
        assert not found, f"line {node.lineno}: {found}"
    for line, module in imports(tree):
        assert not module.startswith("rasterjit.effects"), f"line {line}: {module}"
