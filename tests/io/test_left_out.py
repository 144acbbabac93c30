"""What a file holds and the scene has not is named, with its number."""

from __future__ import annotations

import pickle
import warnings

import formats_table
import pytest
from planted_files import PLANTED

import rasterjit as rj
from rasterjit.io.foreign.readers import CELL_FORMATS
from rasterjit.io.gltf.scene import GLTF_FORMATS
from rasterjit.io.load_warnings import LeftOut, LoadWarning
from rasterjit.io.meshes import BUILTIN_FORMATS
from rasterjit.io.text.xyz import XYZ_FORMATS


def test_what_is_found_and_not_read_is_left_out():
    tally = LeftOut()
    tally.expect("strip", 5)
    tally.mark_read("strip", 3)
    tally.expect("face", 7)
    tally.mark_read("face", 7)
    assert str(tally) == "strip (2)"
    assert tally.counts() == {"strip": 2}


def test_what_is_noted_and_what_is_not_read_of_a_kind_is_summed():
    tally = LeftOut()
    tally.note("strip", 2)
    tally.expect("strip", 3)
    tally.note("fog.png", reason=": it is missing")
    assert tally.counts() == {"strip": 5, "fog.png: it is missing": 1}
    assert str(tally) == "strip (5), fog.png: it is missing (1)"


def test_a_tally_of_what_was_all_read_warns_of_nothing(recwarn):
    tally = LeftOut()
    tally.expect("face", 2)
    tally.mark_read("face")
    tally.mark_read("face")
    tally.warn("a.ply")
    assert not recwarn


def test_a_warning_has_kinds_and_numbers():
    tally = LeftOut()
    tally.expect("strip", 2)
    with pytest.warns(LoadWarning, match=r"^a\.ply: left out strip \(2\); the rest") as said:
        tally.warn("a.ply")
    assert said[0].message.left_out == {"strip": 2}
    assert pickle.loads(pickle.dumps(said[0].message)).left_out == {"strip": 2}


# Every format: something is planted that no reader knows, and it is named with its number.


@pytest.mark.parametrize("form", PLANTED)
def test_what_is_planted_in_a_file_is_named_with_its_number(tmp_path, form):
    write, expected = PLANTED[form]
    path = write(tmp_path)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        rj.load(path)
    told = [one.message for one in said if isinstance(one.message, LoadWarning)]
    assert len(told) == 1, "there is one warning for a file"
    assert told[0].left_out == expected


def test_every_reader_of_ours_is_planted_with_something():
    formats = {name.partition(",")[0].split()[0] for name in PLANTED}
    alike = {
        "laz": "las", "glb": "gltf", "vrm": "gltf", **dict.fromkeys(XYZ_FORMATS, "xyz"),
        **dict.fromkeys(CELL_FORMATS, "vtu"),
    }  # fmt: skip
    ours = {*BUILTIN_FORMATS, *GLTF_FORMATS, *CELL_FORMATS, "binvox", "dxf", "svg", "3mf", "urdf"}
    assert {alike.get(form, form) for form in ours} <= formats


def test_the_table_of_the_page_is_that_of_the_script():
    page = formats_table.PAGE.read_text(encoding="utf-8")
    assert page == formats_table.with_table(page, formats_table.table())
