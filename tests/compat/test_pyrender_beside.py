"""
Pictures beside those of the original, by the marks of ``benchmarks/pyrender_beside``.

``PYRENDER_PYTHON`` names the interpreter of an environment that has pyrender 0.1.45; see there.
"""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

sys.path.append(str(Path(__file__).parents[2]))
beside = importlib.import_module("benchmarks.pyrender_beside.__main__")
sheet = importlib.import_module("benchmarks.pyrender_beside.sheet")
likeness = importlib.import_module("benchmarks.pyrender_beside.likeness")

PYTHON = os.environ.get("PYRENDER_PYTHON")


FAILS_THERE = ("SHADOWS_POINT", "SHADOWS_ALL")
"""Flags whose shader the original cannot use on Mesa."""


def picture(color, depth):
    """Return a picture as the workers write it."""
    return {"color": color, "depth": depth, "near": 0.05, "far": np.inf}


def a_disc(middle=(20, 20), code=100, depth=2.0):
    rows, columns = np.indices((40, 40))
    covered = (rows - middle[0]) ** 2 + (columns - middle[1]) ** 2 < 144
    color = np.where(covered[..., None], code, 255) + np.zeros(3)
    return picture(color.astype(np.uint8), np.where(covered, depth, 0.0).astype(np.float32))


@pytest.mark.parametrize(
    ("ours", "missed"),
    [
        (a_disc(), []),
        (a_disc(code=102), []),
        (a_disc(code=103), ["colour 3.0"]),
        (a_disc(depth=2.0 * (1.0 + 3e-5)), ["depth 3.0e-05, 100.0% beyond"]),
        (a_disc(depth=2.0 * (1.0 + 9e-6)), []),
    ],
)
def test_the_measure_finds_what_differs(ours, missed):
    assert likeness.compare(a_disc(), ours).failures() == missed


def test_the_measure_finds_masks_that_differ_beside_their_outline():
    by_a_pixel, by_four = a_disc((21, 20)), a_disc((24, 20))
    found = likeness.compare(a_disc(), by_a_pixel)
    assert found.outline > 0.05
    assert found.far == 0.0
    assert any("mask" in text for text in likeness.compare(a_disc(), by_four).failures())


def test_what_one_of_them_refuses_is_told():
    row = {"scene": "plain", "flag": "NONE", "theirs": "ValueError: there", "ours": a_disc()}
    assert beside.verdict(row) == "yes: the original fails (ValueError: there)"
    row |= {"theirs": a_disc(), "ours": "ValueError: here"}
    assert beside.verdict(row) == "refused: ValueError: here"
    assert not beside.is_met(row)
    assert "| NONE | plain |" in beside.table_of_pictures([row])


def test_a_known_difference_has_an_end():
    row = {"scene": "lines", "flag": "SEG", "theirs": a_disc(), "ours": a_disc(code=105)}
    row["like"] = likeness.compare(row["theirs"], row["ours"])
    assert beside.verdict(row) == "yes: known to differ (colour 5.0)"
    assert beside.verdict(row | {"flag": "NONE"}) == "colour 5.0"
    row["like"] = likeness.compare(row["theirs"], a_disc(code=110))
    assert beside.verdict(row) == "colour 10.0"


def test_times_are_told_as_the_documentation_tells_them():
    row = {"flag": "RGBA", "egl_warm": 200.0, "osmesa_warm": 100.0, "rasterjit_warm": 25.0}
    row |= {"ratio_warm": 4.0, "egl_cold": 400.0, "rasterjit_cold": 50.0, "ratio_cold": 8.0}
    head, rule, line = beside.table_of_times([row]).splitlines()
    page = (Path(__file__).parents[2] / "docs/coming_from/pyrender.md").read_text()
    assert f"{head}\n{rule}\n" in page
    assert line == "| `RGBA` | 5.0 | 10.0 | 40.0 | 4.0 | 2.5 | fails | 20.0 | 8.0 |"
    rows = page[page.index(rule) :].splitlines()[1:]
    flags = [one.split("`")[1] for one in rows if one.startswith("| `")]
    assert flags == list(beside.PAGE_FLAGS)


def test_a_sheet_shows_both_and_their_difference(tmp_path):
    row = {"scene": "disc", "flag": "NONE", "theirs": a_disc(), "ours": a_disc(code=110)}
    sheet.draw_sheet([row], tmp_path / "sheet.png")
    shown = np.asarray(Image.open(tmp_path / "sheet.png"))
    middle = sheet.BAR + sheet.CELL[1] // 2
    columns = [n * sheet.CELL[0] + sheet.CELL[0] // 2 for n in range(3)]
    assert [shown[middle, column].tolist() for column in columns] == [
        [100] * 3,
        [110] * 3,
        [80] * 3,
    ]


@pytest.fixture(scope="module")
def contestants():
    """Return the original on EGL, and the adapter."""
    if not PYTHON:
        pytest.skip("PYRENDER_PYTHON does not name an interpreter that has pyrender")
    found = [beside.Contestant("egl", PYTHON), beside.Contestant("rasterjit", sys.executable)]
    yield found
    for one in found:
        one.close()


@pytest.mark.parametrize("scene", beside.SCENES)
def test_pictures_are_the_originals(scene, contestants, tmp_path):
    rows = list(beside.pictures(*contestants, [scene], beside.FLAGS, tmp_path))
    assert len([row for row in rows if "like" in row]) >= len(beside.FLAGS) - len(FAILS_THERE)
    assert {row["flag"]: beside.verdict(row) for row in rows if not beside.is_met(row)} == {}
