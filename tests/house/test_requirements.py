"""What the tests import is what ``pip install "rasterjit[test]"`` brings."""

from __future__ import annotations

import ast
import functools
import importlib.metadata
import re
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent

OWN = {"rasterjit", "benchmarks"} | {
    path.stem for folder in (TESTS, ROOT / "models") for path in folder.rglob("*.py")
}
"""Modules of this repository."""

ELSEWHERE = {
    "IPython": "ipykernel, which the extra names, requires it",
    "svg": "svg.path, which the extra names, provides it; without it what needs it is skipped",
    "PySide6": "the extra viewer-qt names it; without it what needs it is skipped",
    "gradio": "it brings two glTF files; without it their tests are left out",
    "mujoco": "the extra mujoco names it; without it what needs it is skipped",
    "pybullet": "the extra pybullet names it; without it what needs it is skipped",
    "pybullet_data": "pybullet brings it",
    "pycolmap": "it has wheels for few systems; without it what needs it is skipped",
    "pyrender": "that of PYRENDER_PYTHON; without it what it said is read",
    "pyvista": "the extra bench-large names it; what needs it is skipped before",
    "tomllib": "Python has it from 3.11 on; what needs it is skipped before",
}
"""Modules that the extra does not name, and why."""

IMPORTING = {"import_module", "importorskip", "find_spec", "__import__"}
"""Functions that take the name of a module first."""


def imported(source):
    """Return the modules that a program imports anywhere, by the first part of their names."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module)
        elif isinstance(node, ast.Call) and node.args:
            called = getattr(node.func, "attr", getattr(node.func, "id", None))
            name = node.args[0]
            if called in IMPORTING and isinstance(name, ast.Constant):
                found.add(name.value)
    return {name.split(".")[0] for name in found}


def normalized(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def requirement(text):
    """Return the distribution of a requirement, and its extras."""
    name, extras = re.match(r"([\w.-]+)\s*(?:\[([^\]]*)\])?", text).groups()
    return normalized(name), {normalized(extra.strip()) for extra in (extras or "").split(",")}


def needed_by_extras(distribution, extras):
    """Yield what an installed distribution requires for some of its extras."""
    try:
        needs = importlib.metadata.requires(distribution) or []
    except importlib.metadata.PackageNotFoundError:
        return
    for text in needs:
        for_extra = re.search(r"extra\s*==\s*['\"]([^'\"]+)", text)
        if for_extra and normalized(for_extra[1]) in extras:
            yield requirement(text)[0]


def promised(project, extra):
    """Return the distributions that a project's dependencies and one of its extras name."""
    optional = {normalized(name): needs for name, needs in project["optional-dependencies"].items()}
    waiting, found, seen = [*project["dependencies"], f"{project['name']}[{extra}]"], set(), set()
    while waiting:
        name, extras = requirement(waiting.pop())
        if name != normalized(project["name"]):
            found |= {name, *needed_by_extras(name, extras)}
            continue
        for more in extras - seen:
            seen.add(more)
            waiting += optional[more]
    return found


@functools.cache
def providers():
    """Return the distributions that provide each module installed here."""
    return importlib.metadata.packages_distributions()


def missing(modules, distributions):
    """Return the modules that none of the distributions provides, and what would."""
    found = {}
    for module in modules - OWN - ELSEWHERE.keys() - sys.stdlib_module_names:
        candidates = {normalized(name) for name in providers().get(module, [module])}
        if not candidates & distributions:
            found[module] = sorted(candidates)
    return found


def test_what_the_tests_import_is_in_the_extra():
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    distributions = promised(project, "test")
    found = {}
    for path in TESTS.rglob("*.py"):
        lacking = missing(imported(path.read_text(encoding="utf-8")), distributions)
        if lacking:
            found[path.relative_to(TESTS).as_posix()] = lacking
    assert not found


def test_the_metadata_has_addresses_and_none_that_the_pages_do_not_know():
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    own = f"https://pypi.org/project/{normalized(project['name'])}/"
    pages = "".join((ROOT / page).read_text(encoding="utf-8") for page in ("README.md", "LICENSE"))
    assert own in project["urls"].values()
    assert all(address == own or address in pages for address in project["urls"].values())


def test_imports_of_every_kind_are_seen():
    source = (
        "import one.more, two as three\nfrom four.five import six\nfrom . import seven\n"
        "def inside():\n    import eight\n"
        "nine = pytest.importorskip('nine.ten')\nimport_module('eleven')\nfind_spec(name)\n"
    )
    assert imported(source) == {"one", "two", "four", "eight", "nine", "eleven"}


def test_a_distribution_of_another_extra_is_missing():
    project = {
        "name": "RasterJIT",
        "dependencies": ["numpy>=1.26"],
        "optional-dependencies": {
            "test": ["pytest>=8", "rasterjit[large,my_video]"],
            "large": ["zarr>=3; python_version >= '3.11'"],
            "my-video": ["imageio[ffmpeg]", "rasterjit[test]"],
            "bench": ["no-such-package"],
        },
    }
    found = promised(project, "test")
    assert {"numpy", "pytest", "zarr", "imageio", "imageio-ffmpeg"} <= found
    assert missing({"zarr", "rasterjit", "math"}, found) == {}
    assert missing({"no_such_package"}, found) == {"no_such_package": ["no-such-package"]}
