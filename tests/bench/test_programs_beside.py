"""Public programs: what changes in them, and how pictures are compared."""

from __future__ import annotations

import ast
import importlib

import numpy as np
import pytest

from benchmarks.programs_beside import changes

beside = importlib.import_module("benchmarks.programs_beside.__main__")


@pytest.mark.parametrize("name", changes.PROGRAMS)
def test_programs_change_in_few_lines_and_say_where_they_are_from(name):
    ast.parse(changes.change(name))
    assert 1 <= changes.count_changes(name) <= 7
    assert changes.find_source(name).startswith("https://")


def test_five_programs_of_each_package_at_least():
    for library in beside.LIBRARIES:
        assert sum(name.startswith(library) for name in changes.PROGRAMS) >= 5


def test_likeness_counts_other_objects_and_depth():
    frames = np.full((2, 4, 5, 3), 255, np.uint8)
    depths = np.ones((2, 4, 5), np.float32)
    numbers = np.zeros((2, 4, 5), np.int32)
    theirs = {"frames": frames, "depths": depths, "numbers": numbers}
    assert beside.compare(theirs, theirs) == (0.0, 0.0, 0.0)
    other = numbers.copy()
    other[0, 0, :2] = 1
    like = beside.compare(theirs, {**theirs, "depths": 1.5 * depths, "numbers": other})
    assert (like.objects, like.depth) == (2 / 40, 0.5)
    assert not like.is_met()
    darker = frames.copy()
    darker[0, 1, 1] = 0
    assert beside.compare({"frames": frames}, {"frames": darker}).objects == 1 / 40
    with pytest.raises(ValueError, match="shapes must be those of the original"):
        beside.compare(theirs, {"frames": frames})
