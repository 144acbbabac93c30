"""The table of docs/guides/gltf.md: each row's file is loaded, and becomes what the row says."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from gltf_extension_files import FILES
from PIL import features

import rasterjit as rj
from rasterjit.io.gltf.extensions import LIBRARIES, SUPPORTED_EXTENSIONS

PAGE = (Path(__file__).parents[2] / "docs/guides/gltf.md").read_text()
ROWS = dict(re.findall(r"^\| `(\w+)` \| (drawn|in part|nothing to show|left out) \|", PAGE, re.M))


def saved(name, tmp_path, **header):
    """Write the file of an extension; return its path."""
    if name in LIBRARIES:
        pytest.importorskip(LIBRARIES[name])
    try:
        draft = FILES[name].make()
    except KeyError:
        assert (name, features.check("avif")) == ("EXT_texture_avif", False)
        pytest.skip("Pillow writes no AVIF")
    assert name in draft.header["extensionsUsed"]
    draft.header.update(header)
    return draft.save(tmp_path / f"{name}.glb")


def load(path):
    """Return a file's scene and what its warning says."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = rj.load(path)
    assert len(caught) <= 1
    return scene, "".join(str(one.message) for one in caught)


def test_each_row_has_a_file_and_each_file_a_row():
    assert set(ROWS) == set(FILES)


def test_what_is_understood_is_what_the_table_says():
    shown = {name for name, outcome in ROWS.items() if outcome != "left out"}
    assert shown == SUPPORTED_EXTENSIONS


@pytest.mark.parametrize("name", FILES)
def test_a_file_loads_as_its_row_says(tmp_path, name):
    scene, said = load(saved(name, tmp_path))
    assert FILES[name].check(scene)
    outcome = ROWS[name]
    assert (f"left out extension {name} (1)" in said) == (outcome == "left out")
    assert bool(said) == (outcome in ("in part", "left out"))


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_requires_what_is_left_out_is_refused(tmp_path, name):
    path = saved(name, tmp_path, extensionsRequired=[name])
    if ROWS[name] != "left out":
        assert FILES[name].check(load(path)[0])
        return
    with pytest.raises(rj.MeshFileError, match=f"extensionsRequired names {name}"):
        rj.load(path)


MATERIALS = [
    name for name in FILES if name.startswith("KHR_materials_") and ROWS.get(name) == "drawn"
]


@pytest.mark.parametrize("name", MATERIALS)
def test_a_material_looks_otherwise_without_its_extension(tmp_path, name):
    """What is said to be drawn is seen in the picture."""
    path = saved(name, tmp_path)
    with_it, _ = load(path)
    draft = FILES[name].make()
    for entry in draft.header["materials"]:
        entry.get("extensions", {}).pop(name, None)
    without, _ = load(draft.save(tmp_path / "without.glb"))
    with_it.variant = next(iter(with_it.variants), None)
    pictures = [
        rj.render(scene, size=(24, 24), outputs=("linear",), background="white", threads=1).linear
        for scene in (with_it, without)
    ]
    assert np.abs(pictures[0] - pictures[1]).max() > 1e-3
