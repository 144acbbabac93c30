"""
A scene that uses no effect compiles nothing of any effect, in a process that starts anew; and one
that uses all but one calls for all the others as before, and for nothing of that one.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest
import switched_off

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
    "occlusion", "patches", "projection", "resolve", "runs", "setup", "shading", "stretches",
    "visibility",
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


SHADE, DRAW = "shade_rows.", "draw_tiles."

GONE = {
    "textures": {
        "surface.textures", "surface.matt_vertices", "scratch.2", "scratch.3",
    },
    "texture transforms": {"surface.textures.transforms"},
    "anisotropic filter": {"surface.textures.anisotropic"},
    "maps and emission": {"surface.maps"},
    # One kind of map of several is data, not code.
    "normal maps": set(),
    "alpha masks": {"draw_tiles.cutouts"},
    # Holes are where the colours of vertices say so.
    "vertex colors": {"surface.vertex_colors", "draw_tiles.cutouts"},
    "face colors": {"surface.face_colors", "draw_tiles.cutouts.face_colors"},
    "highlights": {"lighting.highlights", "surface.matt_vertices"},
    # Facets alone mirror what is around.
    "microfacets": {"lighting.microfacets", "lighting.environment.reflections"},
    "Gouraud": {"surface.lit_vertices", "surface.matt_vertices"},
    "flat": {"lighting.fog.flat"},
    "shadows": {"lighting.shadows"},
    "environment light": {"lighting.environment"},
    "environment background": set(),
    "environment": {"lighting.environment"},
    "fog": {"lighting.fog"},
    "tone mapping": {"encoding.tone"},
    "ambient occlusion": {"lighting.occlusion"},
    "outline": set(),
    "wireframe": set(),
    "transparency": {"surface.alphas"},
    "anti-aliasing": {"geometry.viewport.reach"},
}  # fmt: skip
"""What becomes None without each effect, of what is given to ``shade_rows`` or as said."""

FILTERED = {"prefiltering.add_ring", "prefiltering.average_columns"}
MIXED = {"layers.list_faces", "layers.mix_samples"}
LAID = {"layers.start_sums", "layers.lay_under", "layers.finish_sums"}

KERNELS_GONE = {
    "microfacets": FILTERED,
    "Gouraud": {"shading.light_vertices"},
    "shadows": {"shadow_receivers.find_depth_ranges"},
    "environment light": FILTERED,
    "environment background": {"backgrounds.show_environment"},
    "environment": {*FILTERED, "backgrounds.show_environment"},
    "tone mapping": {"backgrounds.show_over"},
    "ambient occlusion": {
        "ambient_occlusion.find_occlusion", "ambient_occlusion.smooth_occlusion",
    },
    "outline": {"outlines.find_edges", "outlines.draw_marks"},
    "wireframe": {
        "projection.transform_positions", "wireframe.draw_edges", "wireframe.fill_slack",
        "wireframe.find_pixels", "wireframe.project_edges",
    },
    "transparency": {
        *LAID, "transparency.split_lists", "transparency.find_layers", "backgrounds.show_over",
    },
    "anti-aliasing": MIXED,
}  # fmt: skip
"""Kernels that are not called without an effect; none where it is not named."""

KERNELS_INSTEAD = {
    "tone mapping": {"resolve.encode_rows"},
    "anti-aliasing": LAID,
}  # fmt: skip
"""Simpler ones that do in their place."""


@pytest.fixture(scope="module")
def recorded():
    """What `switched_off` prints: forms and kernels, by the effect that is absent."""
    done = subprocess.run(
        [sys.executable, switched_off.__file__], capture_output=True, text=True, check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, cwd=Path(switched_off.__file__).parent,
    )  # fmt: skip
    return json.loads(done.stdout)


def with_and_without(recorded, name):
    """What is called for with an effect and without it; where faces blend, with one sample."""
    return recorded["anti-aliasing" if name == "transparency" else ""], recorded[name]


def test_every_effect_is_in_the_full_scene(recorded):
    forms = recorded[""]["forms"]
    absent = {path for path, kind in forms.items() if kind is None}
    # The picture's cutouts have no texture, and are drawn at the centres of pixels. Nobody asks for
    # the math library.
    assert absent == {
        "draw_tiles.viewport.reach", "draw_tiles.cutouts.geometry.viewport.reach",
        "draw_tiles.cutouts.textures", "shade_rows.lighting.library",
        "shade_rows.lighting.fog.library", "shade_rows.encoding.tone.library",
    }  # fmt: skip
    assert recorded.keys() - {""} == GONE.keys() == {*switched_off.WITHOUT, "anti-aliasing"}


@pytest.mark.parametrize("name", GONE)
def test_without_an_effect_its_records_alone_are_none(recorded, name):
    before, after = (found["forms"] for found in with_and_without(recorded, name))
    gone = {path if path.startswith(DRAW) else SHADE + path for path in GONE[name]}
    within = tuple(f"{path}." for path in gone)
    assert {path for path in before if before[path] and path in after and not after[path]} == gone
    # All that lay in those records is gone with them, and nothing else is of another kind.
    assert {path for path in before if path not in after} == {
        path for path in before if path.startswith(within)
    }
    unchanged = {path: kind for path, kind in before.items() if path in after.keys() - gone}
    assert {path: after[path] for path in after.keys() - gone} == unchanged


@pytest.mark.parametrize("name", GONE)
def test_without_an_effect_its_kernels_alone_are_not_called(recorded, name):
    before, after = ({*found["kernels"]} for found in with_and_without(recorded, name))
    assert before - after == KERNELS_GONE.get(name, set())
    new = after - before
    if name == "transparency":
        # What is no longer seen through casts a shadow, wherever its map ends.
        new = {kernel for kernel in new if "clip" not in kernel}
    assert new == KERNELS_INSTEAD.get(name, set())
