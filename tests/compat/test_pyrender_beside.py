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

sys.path.append(str(Path(__file__).parents[2]))
beside = importlib.import_module("benchmarks.pyrender_beside.__main__")
likeness = importlib.import_module("benchmarks.pyrender_beside.likeness")

PYTHON = os.environ.get("PYRENDER_PYTHON")

DIFFERS: dict[str, str] = {}
"""Scenes that are drawn otherwise on purpose, and why."""

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


@pytest.fixture(scope="module")
def contestants():
    """Return the original on EGL, and the adapter."""
    if not PYTHON:
        pytest.skip("PYRENDER_PYTHON does not name an interpreter that has pyrender")
    found = [beside.Contestant("egl", PYTHON), beside.Contestant("rasterjit", sys.executable)]
    yield found
    for one in found:
        one.close()


@pytest.mark.parametrize("scene", [name for name in beside.SCENES if name not in DIFFERS])
def test_pictures_are_the_originals(scene, contestants, tmp_path):
    rows = list(beside.pictures(*contestants, [scene], beside.FLAGS, tmp_path))
    assert len([row for row in rows if "like" in row]) >= len(beside.FLAGS) - len(FAILS_THERE)
    assert {row["flag"]: beside.verdict(row) for row in rows if not beside.is_met(row)} == {}
