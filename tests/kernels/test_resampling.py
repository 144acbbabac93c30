"""The filter of pictures is that of its slow twin."""

from __future__ import annotations

import naive_lens
import numpy as np
import pytest

from rasterjit.pipeline import resampling


@pytest.mark.parametrize("channels", [1, 4])
def test_filter_is_that_of_the_slow_twin(channels):
    random = np.random.default_rng(1)
    source = random.uniform(0, 2, (14, 17, channels)).astype(np.float32)
    shape = 9, 8
    number = random.integers(0, 2, shape).astype(np.uint8)
    # Some beside the picture, some wide, some thin.
    place = random.uniform(-0.3, 2.0, (*shape, 2)).astype(np.float32)
    spread = (random.normal(size=(*shape, 4)) * random.choice([0.01, 0.3, 3], (*shape, 1))).astype(
        np.float32
    )
    target = np.full((*shape, channels), -1, np.float32)
    density, origin = 8.0, (1.5, 0.25)
    for rows in ((0, 5), (5, 9)):
        resampling.filter_rows(source, number, place, spread, (1, density, *origin), rows, target)
    for row, column in np.ndindex(shape):
        if number[row, column] == 0:
            assert (target[row, column] == -1).all()
            continue
        along, down = spread[row, column].astype(float).reshape(2, 2) * density
        at = place[row, column].astype(float) * density + origin
        naive = naive_lens.filtered(source, at, along, down)
        np.testing.assert_allclose(target[row, column], naive, rtol=1e-5)


def test_one_colour_stays_what_it_is():
    source = np.full((6, 7, 4), 0.1, np.float32)
    number, place = np.zeros((4, 4), np.uint8), np.full((4, 4, 2), 0.37, np.float32)
    spread = np.random.default_rng(2).normal(size=(4, 4, 4)).astype(np.float32)
    target = np.zeros((4, 4, 4), np.float32)
    resampling.filter_rows(source, number, place, spread, (0, 5.0, 1.0, 1.0), (0, 4), target)
    assert (target == np.float32(0.1)).all()
