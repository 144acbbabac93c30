"""The house is as the design draws it: layers, sizes, names, docstrings."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import rasterjit as rj

PACKAGE = Path(rj.__file__).parent
ROOT = PACKAGE.parent
SOURCES = sorted(PACKAGE.rglob("*.py"))
MOST_LINES = 450
"""Lines of a file, docstrings not counted."""


def named(path):
    return path.relative_to(PACKAGE).as_posix()


def docstrings(tree):
    """Yield the nodes of all docstrings, those of attributes included."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else []:
            if (
                isinstance(statement, ast.Expr)
                and isinstance(statement.value, ast.Constant)
                and isinstance(statement.value.value, str)
            ):
                yield statement


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


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_file_is_short(path):
    source = path.read_text()
    documented = sum(node.end_lineno - node.lineno + 1 for node in docstrings(ast.parse(source)))
    assert len(source.splitlines()) - documented <= MOST_LINES


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_file_says_what_it_is_and_is_finished(path):
    source = path.read_text()
    assert ast.get_docstring(ast.parse(source)), "no module docstring"
    assert not re.search(r"\b(TODO|FIXME|XXX|HACK)\b", source)
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
        "transforms", "Framebuffer", "Pipeline",
    ):  # fmt: skip
        assert name in rj.__all__
    assert sorted(set(rj.__all__)) == sorted(rj.__all__)
    assert all(hasattr(rj, name) for name in rj.__all__)


def test_the_core_install_has_every_name():
    extras = (
        "matplotlib", "scipy", "dask", "distributed", "rendercanvas", "anywidget", "glfw",
        "OpenEXR", "tifffile", "zarr", "flip_evaluator", "embreex", "pytest",
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


@pytest.mark.parametrize("path", sorted((PACKAGE / "kernels").glob("*.py")), ids=lambda p: p.stem)
def test_kernels_neither_raise_nor_import_what_they_may_not(path):
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if path.stem != "jit":
            assert not isinstance(node, (ast.Raise, ast.Assert, ast.Try)), f"line {node.lineno}"
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("rasterjit"):
            assert node.module.startswith("rasterjit.kernels"), f"line {node.lineno}"
