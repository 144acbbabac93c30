"""All ways of the benchmark of skinning move vertices to the same places."""

import pytest

from benchmarks import skinning


@pytest.mark.parametrize("influences", [1, 4, 8])
def test_all_ways_find_the_same_vertices(influences):
    rows = skinning.measure(skinning.make(300, influences), rounds=1)
    assert len(rows) == 4
    assert {row["check"] for row in rows} == {"same"}
    assert rows[0]["ratio"] == 1.0


@pytest.mark.takes_long
def test_compiling_is_measured():
    processor, wall = skinning.compile_cost()
    assert 0.0 < processor < 60.0
    assert wall > 0.0
