"""Damage to kept kernels is counted, and what is used in spite of it is found."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from rasterjit.runtime import store

sys.path.append(str(Path(__file__).parents[2]))
damaged = importlib.import_module("benchmarks.damaged_entries")

posix_only = pytest.mark.skipif(os.name != "posix", reason="pipes and links of POSIX")


@pytest.fixture
def entries(tmp_path, monkeypatch):
    """Four sound entries."""
    monkeypatch.setattr(store, "PRINTED_SUBJECTS", set())
    for number in range(4):
        header = store.Header("none", f"a.b{number}", "()", "0", "1", "x86_64", "cpu")
        code = np.random.default_rng(number).bytes(3000)
        store.write_entry(tmp_path / f"b{number}.1{store.SUFFIX}", header, code)
    return sorted(tmp_path.iterdir())


def test_no_damaged_entry_is_used(entries, tmp_path):
    place = tmp_path / "place"
    place.mkdir(mode=0o700)
    counts = damaged.read_damaged(entries, 140, 1, place)
    assert list(counts) == list(damaged.DAMAGES)
    for count in counts.values():
        assert count["tried"] == 20
        assert count["refused"] + count["unchanged"] == 20
        assert not count["unchanged, and refused"]
    assert sum(count["refused"] for count in counts.values()) > 100
    assert list(place.iterdir()) == []


def test_one_that_is_used_is_counted(entries, tmp_path, monkeypatch):
    place = tmp_path / "place"
    place.mkdir(mode=0o700)
    monkeypatch.setattr(damaged.store, "read_entry", lambda path: path.read_bytes())
    counts = damaged.read_damaged(entries, 70, 1, place)
    assert counts["a bit"]["used"] == 10


@posix_only
def test_some_entries_of_a_store_are_damaged_in_every_way(entries, monkeypatch):
    monkeypatch.setattr(damaged, "SHARE", 0.5)
    (folder,) = {one.parent for one in entries}
    contents = [one.read_bytes() for one in entries]
    kinds = set()
    for seed in range(60):
        for one, content in zip(entries, contents, strict=True):
            if one.is_symlink() or one.is_fifo():
                one.unlink()
            elif one.is_dir():
                one.rmdir()
            one.write_bytes(content)
        count = damaged._damage_some(folder, damaged.random.Random(seed))
        kinds |= {
            "link" if one.is_symlink() else "pipe" if one.is_fifo() else
            "folder" if one.is_dir() else "removed" if not one.exists() else "content"
            for one, content in zip(entries, contents, strict=True)
            if not one.is_file() or one.is_symlink() or one.read_bytes() != content
        }  # fmt: skip
        assert 0 <= count <= 4
    assert kinds == {"link", "pipe", "folder", "removed", "content"}


@pytest.mark.parametrize(
    ("drawn", "faults"),
    [
        ((0, "", b"x"), 0),
        ((0, f"{damaged.SAID} what cannot be used", b"x"), 1),
        ((0, "", b"y"), 2),
        ((1, "Traceback", b"x"), 2),
    ],
)
def test_what_a_run_with_damage_does_wrong_is_told(tmp_path, monkeypatch, drawn, faults):
    answers = iter([(0, "", b"x"), drawn, drawn])
    monkeypatch.setattr(damaged, "_draw", lambda cache, out: next(answers))
    assert len(damaged.run_damaged(1, 3, tmp_path)) == faults
