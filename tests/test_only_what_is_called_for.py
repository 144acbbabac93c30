"""A scene that uses no effect compiles nothing of any effect, in a process that starts anew."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numba
import pytest

PLAIN = """
import importlib, json, pkgutil
import rasterjit as rj
from numba.core import types
from rasterjit import kernels
from rasterjit.kernels import jit

mesh = rj.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])
scene = rj.Scene()
scene.add(mesh)
rj.render(scene, size=(96, 80))
assert not any(kernel.stats.cache_hits for kernel in jit.KERNELS)
compiled = set()
for found in pkgutil.iter_modules(kernels.__path__):
    module = importlib.import_module(f"rasterjit.kernels.{found.name}")
    for thing in vars(module).values():
        if not hasattr(thing, "overloads"):
            continue
        for arguments in thing.overloads:
            form = "absent" if types.none in arguments else "present"
            place = thing.py_func.__module__.rpartition(".")[2]
            compiled.add((place, thing.py_func.__name__, form, thing in jit.KERNELS))
print(json.dumps(sorted(compiled)))
"""

OF_EVERY_SCENE = {
    "attributes", "batches", "binning", "clipping", "gathering", "interpolation", "lighting",
    "occlusion", "projection", "resolve", "runs", "setup", "shading", "stretches", "visibility",
}  # fmt: skip
"""Kernel files that a lit mesh needs; all others belong to effects, buffers or edges."""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """(file, function, form, whether it is an entry point) of all that a plain scene compiled."""
    if numba.config.DISABLE_JIT:
        pytest.skip("NUMBA_DISABLE_JIT is set: nothing is compiled")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PLAIN], capture_output=True, text=True, check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("kernels"))},
    )  # fmt: skip
    return [tuple(row) for row in json.loads(done.stdout)]


def test_plain_scene_compiles_no_kernel_of_an_effect(compiled):
    entries = {row[:2] for row in compiled if row[3]}
    assert {("shading", "shade_rows"), ("visibility", "draw_tiles")} <= entries
    assert [row for row in entries if row[0] not in OF_EVERY_SCENE] == []


def test_helpers_of_effects_are_compiled_in_the_form_that_does_nothing(compiled):
    """A helper that is called with the record of an effect that is None returns its input."""
    helpers = [row for row in compiled if row[0] not in OF_EVERY_SCENE]
    assert [row for row in helpers if row[2] != "absent"] == []


def test_what_does_nothing_is_little(compiled):
    """No effect brings more than a few empty helpers into a scene that does not use it."""
    empty = [row for row in compiled if row[0] not in OF_EVERY_SCENE]
    assert len(empty) <= 24 < len(compiled) - len(empty)
