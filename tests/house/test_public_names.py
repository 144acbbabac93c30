"""``dir`` and ``help`` list what is public; arguments are typed as they are documented."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import pydoc
import re
import subprocess
import sys
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest

import rasterjit as rj
from rasterjit import types
from rasterjit.classics import framebuffer
from rasterjit.outputs.output_table import LAYER_OUTPUTS, OUTPUTS, TABLE
from rasterjit.scene.hooks import HOOKS

FOLDER = Path(rj.__file__).parent
WITHOUT_STAR = {"mpl", "types"}
"""Public modules that ``from rasterjit import *`` leaves out."""


def section(text, name):
    """Return a section of what pydoc tells, '' without one."""
    found = re.search(rf"^{name}\n(.*?)(?=^[A-Z]|\Z)", text, re.DOTALL | re.MULTILINE)
    return found[1] if found else ""


def test_dir_lists_what_is_public_and_nothing_else():
    listed = {name for name in dir(rj) if not re.fullmatch(r"__\w+__", name)}
    assert listed - WITHOUT_STAR == set(rj.__all__)
    assert "types" in listed


def test_type_checkers_are_told_the_same_names():
    stub = ast.parse((FOLDER / "__init__.pyi").read_text())
    told = {}
    for node in (node for node in stub.body if isinstance(node, ast.ImportFrom)):
        told |= {one.name: node.module for one in node.names}
    homes = {name: f"rasterjit.{home}" for name, home in rj._MODULE_OF.items()}
    assert told == homes | dict.fromkeys(rj._MODULES, "rasterjit")
    (listed,) = (node.value for node in stub.body if isinstance(node, ast.Assign))
    assert ast.literal_eval(listed) == rj.__all__


@pytest.mark.parametrize(("function", "module"), HOOKS.items())
def test_what_scenes_call_above_themselves_is_there(function, module):
    assert callable(getattr(importlib.import_module(module), function))


NAMED_AT_ONCE = """
import threading
import rasterjit
failed, names = [], rasterjit.__all__
def name(first):
    for one in (*names[first:], *names[:first]):
        try:
            getattr(rasterjit, one)
        except Exception as error:
            failed.append((one, error))
threads = [threading.Thread(target=name, args=(n,)) for n in range(0, len(names), 8)]
for one in threads:
    one.start()
for one in threads:
    one.join()
assert not failed, failed
"""


def test_threads_may_all_name_things_first():
    subprocess.run([sys.executable, "-c", NAMED_AT_ONCE], check=True)


def test_help_describes_what_is_public_and_nothing_else():
    text = pydoc.plain(pydoc.render_doc(rj))
    heads = re.findall(r"^    class (\w+)|^    (\w+)\(|^    (\w+) = ", text, re.MULTILINE)
    described = {next(filter(None, head)) for head in heads}
    expected = {name for name in rj.__all__ if not inspect.ismodule(getattr(rj, name))}
    assert described == expected | {"__all__"}
    assert not section(text, "PACKAGE CONTENTS").strip()
    assert set(section(text, "SUBMODULES").split()) - WITHOUT_STAR == set(rj.__all__) - expected


def test_tools_still_find_every_module():
    found = {one.name for one in pkgutil.iter_modules(rj.__path__)}
    assert found > {"cli", "rendering", "scene", "types"}
    assert {path.stem for path in FOLDER.glob("*.py")} <= found | {"__init__"}
    walked = {one.name for one in pkgutil.walk_packages(rj.__path__, "rasterjit.")}
    assert "rasterjit.rendering.renderer" in walked


@pytest.mark.parametrize(
    "name", ["cli", "io", "scene", "rendering.renderer", "runtime.store", "compat.pyrender"]
)
def test_what_is_inside_stays_importable(name):
    assert importlib.import_module(f"rasterjit.{name}") is sys.modules[f"rasterjit.{name}"]


def literals(kind):
    """Return the values of a literal type, also of one among others: None, a sequence of it."""
    if get_origin(kind) is Literal:
        return set(get_args(kind))
    return set().union(*(literals(one) for one in get_args(kind)))


def typed_arguments():
    """Yield (function, its documentation, argument, annotation) for all that is public."""
    modules = [
        rj,
        *(getattr(rj, name) for name in ("cameras", "dataset", "animation", "transforms")),
    ]
    for module in modules:
        for name in getattr(module, "__all__", dir(module)):
            thing = getattr(module, name)
            if not callable(thing) or not getattr(thing, "__module__", "").startswith("rasterjit"):
                continue
            for member in [thing, *(vars(thing).values() if inspect.isclass(thing) else ())]:
                function = getattr(member, "__func__", member)
                if not callable(function) or not inspect.getdoc(function):
                    continue
                if inspect.isclass(function) and issubclass(function, Exception):
                    continue
                owner = sys.modules[thing.__module__]
                for argument in inspect.signature(function).parameters.values():
                    label = f"{name}.{getattr(function, '__name__', name)}"
                    yield label, inspect.getdoc(function), argument, owner


def documented(text, name):
    """Return the choices that a docstring lists for an argument: ``name : {"a", "b"}``."""
    found = re.search(rf"^[\w, ]*\b{name}\b[\w, ]* : (\{{.*?\}})", text, re.MULTILINE | re.DOTALL)
    return eval(found[1], {}) if found else set()


CHOICES = [
    pytest.param(*row[1:], id=f"{row[0]}-{row[2].name}")
    for row in typed_arguments()
    if documented(row[1], row[2].name)
]


@pytest.mark.parametrize(("text", "argument", "owner"), CHOICES)
def test_choices_are_typed_as_they_are_documented(text, argument, owner):
    kind = eval(argument.annotation, vars(owner)) if argument.annotation else None
    assert literals(kind) == documented(text, argument.name)


def test_there_are_choices_to_compare():
    told = {param.values[1].name for param in CHOICES}
    assert {"shading", "samples", "depth_format", "wrap", "cull", "mode", "layout"} <= told
    assert len(CHOICES) > 30


def test_types_of_what_is_looked_up_hold_the_keys_of_the_tables():
    assert get_args(types.OutputName) == OUTPUTS == tuple(TABLE)
    assert set(get_args(types.IdOutput)) < set(LAYER_OUTPUTS)
    assert {TABLE[name].dtype for name in get_args(types.IdOutput)} == {"int32"}
    assert get_args(types.EdgeRule) == tuple(framebuffer.EDGE_RULES)
    assert get_args(types.FillMethod) == tuple(framebuffer.FILL_METHODS)


def test_choices_are_refused_at_run_time_as_by_type_checkers():
    assert rj.types is types
    for name in get_args(types.Shading):
        rj.Material(name)
    with pytest.raises(ValueError, match="shading must be one of 'unlit'"):
        rj.Material("phongg")
