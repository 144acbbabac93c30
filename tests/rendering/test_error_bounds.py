"""The error of what ``max_error`` chooses, in pictures of many kinds and sizes."""

from __future__ import annotations

import importlib
import statistics
import sys
from pathlib import Path

import pytest

import rasterjit as rj
from rasterjit.rendering.quality_selection import ERROR_LADDER, LADDER

sys.path.append(str(Path(__file__).parents[2]))
program = importlib.import_module("benchmarks.dial")

TIMES = dict(zip(
    (*ERROR_LADDER, LADDER[-1]), (1.0, 1.0, 2.0, 2.5, 3.5, 5.0, 6.0, 20.0, 60.0, 240.0), strict=True
))  # fmt: skip
"""What the qualities take over a standard frame: medians of the pictures. Times of single frames
would depend on what else the machine does."""

AREA = ERROR_LADDER[-2]

AREA_OF_FACES = 75.0
"""The same for areas with a face to each pixel: 53 to 102 were measured in the noisy balls."""

QUICK_PIXELS = 13_000
"""Pixels of the largest pictures that are drawn where not every test runs."""


@pytest.mark.needs_jit
@pytest.mark.parametrize(
    "picture",
    [
        pytest.param(
            picture,
            id=str(picture),
            marks=[pytest.mark.takes_long] * (picture.size[0] * picture.size[1] > QUICK_PIXELS),
        )
        for picture in program.PICTURES
    ],
)
def test_no_error_is_above_its_bound_and_no_quality_much_slower_than_the_best(picture):
    measured, ratios = program.measure_qualities(picture, turns=0), []
    scene, camera = picture.scene_and_camera()
    drawn = rj.render(scene, camera, size=picture.size, outputs="depth").stats.drawn
    share = drawn / (picture.size[0] * picture.size[1])
    times = {**TIMES, AREA: max(TIMES[AREA], AREA_OF_FACES * share)}
    for found in program.keep_to_error(picture, measured, program.bounds_of(measured)):
        assert found.holds, f"{found.error} is above {found.bound}: {found.quality}"
        fitting = [times[one] for one, known in measured.items() if known.error <= found.bound]
        ratios.append(times[found.quality] / min(fitting))
    assert statistics.median(ratios) <= 1.5
    assert max(ratios) <= 3.0
