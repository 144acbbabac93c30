"""The adapter has every public name of pyrender 0.1.45, with the same parameters and defaults."""

from __future__ import annotations

import sys

import pytest
from original_pyrender import ORIGINAL, needs_original, recording_of, said_of

from rasterjit.compat import pyrender
from rasterjit.compat.pyrender.installation import SHARED

SCRIPT = "pyrender_surface.py"

MISSING = {
    "font.Font": {"delete", "font_file", "font_pt", "render_string"},
    "font.FontCache": {"clear", "get_font"},
    "renderer.FontCache": {"clear", "get_font"},
    "platforms.egl.EGLDevice": {"get_display"},
    "shader_program.ShaderProgram": {"delete", "set_uniform"},
    "shader_program.ShaderProgramCache": {"clear", "get_program"},
    "renderer.ShaderProgramCache": {"clear", "get_program"},
    "viewer": {"Renderer"},
}
"""What is missing on purpose: what OpenGL does, and whose objects cannot be made here."""

ADDED = {"OffscreenRenderer.render": {"* outputs=None"}}
"""Parameters that the adapter has besides, of which each must be named in a call."""


@pytest.fixture(scope="module")
def recorded():
    return recording_of(SCRIPT)


@pytest.fixture(scope="module")
def ours():
    return said_of(sys.executable, "rasterjit.compat.pyrender", SCRIPT)


def test_every_name_is_there_with_its_parameters(recorded, ours):
    count = 0
    for module, names in recorded.items():
        for name, wanted in names.items():
            place = f"{module}.{name}".strip(".")
            if name in MISSING.get(module, ()):
                assert name not in ours[module], f"{place} is there"
                continue
            assert name in ours[module], f"{place} is missing"
            if name == "Viewer" and "is_active" not in ours[module][name]["names"]:
                continue
            count += same(place, wanted, ours[module][name])
    assert count > 500


def same(place, wanted, found):
    """Hold a name to what it is in pyrender; return how many names it has."""
    if not isinstance(wanted, dict):
        assert found == wanted, place
        return 1
    # A viewer is a window of pyglet's there, whose names are not recorded; what meshes and scenes
    # have of their bounds is written once here.
    bases = [one for one in found["bases"] if one not in ("Window", "Bounded")]
    assert bases == wanted["bases"], place
    missing = set(wanted["names"]) - set(found["names"])
    assert missing == MISSING.get(place, set()), f"{place} lacks {sorted(missing)}"
    for name in wanted["names"].keys() - missing:
        given = found["names"][name]
        added = ADDED.get(f"{place.rpartition('.')[2]}.{name}", set())
        if isinstance(given, list):
            given = [one for one in given if one not in added]
        assert given == wanted["names"][name], f"{place}.{name}"
    return len(wanted["names"])


@needs_original
def test_recorded_names_are_those_of_the_original(recorded):
    assert said_of(ORIGINAL, "pyrender", SCRIPT) == recorded


def test_star_brings_what_pyrenders_does(recorded):
    listed = {name for name in recorded[""] if not name.startswith("install")}
    assert set(pyrender.__all__) == listed


def test_shared_names_mean_one_thing():
    modules = {name: sys.modules[f"{pyrender.__name__}.{name}"] for name in SHARED}
    for module, sources in SHARED.items():
        for source, names in sources.items():
            home = sys.modules[f"{pyrender.__name__}.{source}"]
            for name in names:
                assert getattr(modules[module], name) is getattr(home, name), (module, name)
