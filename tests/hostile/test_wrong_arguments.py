"""Errors about wrong arguments name the argument, whatever is public and whatever is wrong."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj

sys.path.append(str(Path(__file__).parents[2]))
wrong = importlib.import_module("benchmarks.wrong_arguments")

SLOW = ("profile", "render_many", "dataset.make", "distributed.")
"""What draws long, or starts processes, with what it takes for sound."""

STEP = len(wrong.WRONG) - 1
"""Each parameter is tried once, with each wrong value in its turn."""


def test_errors_about_wrong_arguments_name_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tries = [one for one in wrong.all_tries(tmp_path) if not one.name.startswith(SLOW)]
    said = []
    counts = wrong.count(tries, said.append, STEP)
    assert not said
    assert counts["named"] > 600
    assert not counts["unsound"]


@pytest.mark.parametrize(
    ("call", "is_named"),
    [
        (lambda size: rj.Points(np.zeros((2, 3)), size=size), True),
        (lambda size: float(size), False),
        (lambda size: {}[size], False),
        (lambda size: [].index(size), False),
    ],
)
def test_an_error_that_names_nothing_is_counted(call, is_named):
    said = []
    one = wrong.Try("call", lambda size=None: None if size is None else call(size), {})
    counts = wrong.count([one], said.append)
    assert counts["named" if is_named else "other"] > 10
    assert bool(said) != is_named


@pytest.mark.parametrize(
    "make",
    [
        lambda huge: rj.Lines(np.zeros((2, 3)), width=huge),
        lambda huge: rj.Points(np.zeros((2, 3)), size=huge),
        lambda huge: rj.Mesh(np.eye(3), [[0, 1, 2]], scalars=[0, 1, 2], range=(0, huge)),
        lambda huge: rj.Mesh([[0, 0, huge]] * 3, [[0, 1, 2]]),
        lambda huge: rj.FisheyeLens().project([[0, 0, huge]]),
        lambda huge: rj.Quality(shadow_size=huge),
        lambda huge: rj.transforms.translate([0, 0, huge]),
    ],
)
def test_a_whole_number_too_large_for_a_float_is_a_value_error(make):
    with pytest.raises(ValueError, match=r"must (be|fit|hold|have)"):
        make(10**400)


def nested():
    """Return a list in lists, too deep to be written."""
    value = 1.0
    for _ in range(10 * sys.getrecursionlimit()):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("call", "value"),
    [
        (lambda value: rj.AmbientOcclusion(strength=value), nested()),
        (lambda value: rj.Material(shading=value), nested()),
        (lambda value: rj.load(value), nested()),
        (lambda value: rj.Arrow(value, (0, 0, 1)), np.broadcast_to(np.float32(1.0), (1 << 50, 3))),
        (lambda value: rj.Framebuffer(4, 4).draw_triangle((0, 0), (1, 0), (0, 1), value),
         np.array(None)),
    ],
)  # fmt: skip
def test_what_cannot_be_written_or_made_an_array_is_named(call, value):
    with pytest.raises(ValueError, match=r"\b(strength|shading|path|start|color) must "):
        call(value)
