"""The table of docs/gltf.md: each row's file is loaded, and its outcome is what the row says."""

import re
import warnings
from pathlib import Path

import pytest
from gltf_extension_files import FILES
from PIL import features

import rasterjit as rj
from rasterjit.io.gltf.extensions import LIBRARIES, UNDERSTOOD

PAGE = (Path(__file__).parents[2] / "docs/gltf.md").read_text()
ROWS = dict(re.findall(r"^\| `(\w+)` \| (drawn|in part|nothing to show|left out) \|", PAGE, re.M))

SHOWN_ELSEWHERE = {
    "KHR_materials_clearcoat", "KHR_materials_ior", "KHR_materials_sheen",
    "KHR_materials_specular", "KHR_materials_transmission", "KHR_materials_variants",
    "KHR_materials_volume",
}  # fmt: skip
"""Rows whose files belong to the tests of a material's terms."""


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
    assert set(ROWS) == set(FILES) | SHOWN_ELSEWHERE
    assert not set(FILES) & SHOWN_ELSEWHERE


def test_what_is_understood_is_what_the_table_says():
    shown = {name for name, outcome in ROWS.items() if outcome != "left out"}
    assert shown - SHOWN_ELSEWHERE == UNDERSTOOD - SHOWN_ELSEWHERE


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
