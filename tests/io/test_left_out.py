"""What a file holds and the scene has not is named, with its number."""

from __future__ import annotations

import pickle

import pytest

from rasterjit.io.skipped import LeftOut, LoadWarning


def test_what_is_found_and_not_read_is_left_out():
    tally = LeftOut()
    tally.found("strip", 5)
    tally.read("strip", 3)
    tally.found("face", 7)
    tally.read("face", 7)
    assert str(tally) == "strip (2)"
    assert tally.counts() == {"strip": 2}


def test_what_is_noted_and_what_is_not_read_of_a_kind_is_summed():
    tally = LeftOut()
    tally.note("strip", 2)
    tally.found("strip", 3)
    tally.note("fog.png", reason=": it is missing")
    assert tally.counts() == {"strip": 5, "fog.png: it is missing": 1}
    assert str(tally) == "strip (5), fog.png: it is missing (1)"


def test_a_tally_of_what_was_all_read_warns_of_nothing(recwarn):
    tally = LeftOut()
    tally.found("face", 2)
    tally.read("face")
    tally.read("face")
    tally.warn("a.ply")
    assert not recwarn


def test_a_warning_has_kinds_and_numbers():
    tally = LeftOut()
    tally.found("strip", 2)
    with pytest.warns(LoadWarning, match=r"^a\.ply: left out strip \(2\); the rest") as said:
        tally.warn("a.ply")
    assert said[0].message.left_out == {"strip": 2}
    assert pickle.loads(pickle.dumps(said[0].message)).left_out == {"strip": 2}
