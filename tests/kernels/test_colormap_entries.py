"""Entries of colour maps: by the kernel, by NumPy, and by norms."""

from __future__ import annotations

import numpy as np

import rasterjit as rj
from rasterjit.pipeline.surface.scalar_colors import find_entry
from rasterjit.scene.colormap import range_divisor
from rasterjit.scene.norm import Norm


def test_three_ways_to_an_entry_lead_to_one():
    rng = np.random.default_rng(4)
    table = rj.Colormap("turbo")
    ranges = [(0.0, 1.0), (-3.0, -3.0), *np.sort(rng.normal(size=(20, 2)) * 1e3).tolist()]
    for low, high in ranges:
        values = np.append(rng.uniform(low - 1.0, high + 1.0, 50), [low, high])
        entries = table.entries(values, low, high)
        ranks = Norm((low, high)).ranks(values, len(table))
        assert np.array_equal(entries, np.clip(ranks, 0, len(table) - 1))
        width = range_divisor(low, high)
        assert entries.tolist() == [find_entry(one, low, width, len(table)) for one in values]
