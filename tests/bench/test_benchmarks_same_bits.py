"""The comparison of random scenes by two versions."""

from __future__ import annotations

import copy
import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
program = importlib.import_module("benchmarks.same_bits")
worker = importlib.import_module("benchmarks.same_bits_worker")


@pytest.mark.needs_jit
@pytest.mark.filterwarnings("ignore")
def test_an_output_with_another_bit_is_named_and_others_are_not():
    drawn = worker.Drawn(np.random.default_rng([1, 0]))
    rows = [{"hashes": {way: worker.hashes(draw) for way, draw in drawn.ways().items()}}]
    assert "error" not in rows[0]["hashes"]["kept"]
    assert program.between_ways(rows) == {} == program.between_versions(rows, rows)
    other = copy.deepcopy(rows)
    other[0]["hashes"]["kept"]["color"] = "another"
    assert program.between_versions(rows, other) == {"kept: color": [0]}
    assert program.between_ways(other) == {"kept: color, for lone, 1 thread": [0]}
