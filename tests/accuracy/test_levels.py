"""Each setting on the scene that was made for it: a higher level is not less accurate."""

import dataclasses
import itertools
import os
from functools import cache

import pytest

import rasterjit as rj
from rasterjit.accuracy import test_scenes
from rasterjit.accuracy.results import (
    PICTURE_OUTPUTS,
    list_compared_buffers,
    make_reference,
    measure_errors,
)
from rasterjit.accuracy.test_scenes import MADE_FOR, make
from rasterjit.scene.quality import LEVELS

SIZE = (72, 54)

SIZES = {"shadow_size": test_scenes.SIZE, "texture_filter": test_scenes.SIZE}
"""Sizes of pictures whose texels must be wider than pixels for the last levels to differ."""

SLACK = 1e-3
"""Share of an error by which it may grow: what else is wrong in the picture falls here or there."""

MAX_MAP = 8192 if os.environ.get("EVERY_TEST") else 2048
"""Texels: larger maps take more memory than all else."""

CHAINS = {"samples": [(1, 2, 4, 8, 16, "area"), (1, 2, 4, 8, 16, 64, 256)]}
"""Levels that are in order, where not all are: exact areas are shaded once in a pixel, 64 samples
one by one."""


@cache
def errors(setting):
    """Return the errors of each level of a setting."""
    made = make(MADE_FOR[setting])
    with rj.Renderer(SIZES.get(setting, SIZE)) as renderer:

        def draw(quality, outputs):
            renderer.quality = quality
            return renderer.render(made.scene, made.camera, outputs=outputs)

        size = min(rj.Quality.reference().shadow_size, MAX_MAP)
        best = dataclasses.replace(rj.Quality.reference(), shadow_size=size)
        buffers = list_compared_buffers(made.scene)
        reference = make_reference(
            made.scene,
            draw(best, PICTURE_OUTPUTS),
            draw(dataclasses.replace(best, samples=1), buffers),
        )
        return {
            level: measure_errors(
                draw(rj.Quality(**{setting: level}), (*PICTURE_OUTPUTS, *buffers)), reference
            )[0]
            for level in LEVELS[setting]
            if setting != "shadow_size" or level <= MAX_MAP
        }


FALL = 0.98
"""Share of the error of its least level that a setting's best may have at most."""


@pytest.mark.parametrize("setting", LEVELS)
def test_error_falls_as_the_level_rises_on_the_scene_that_shows_what_the_setting_is_for(setting):
    found = errors(setting)
    for chain in CHAINS.get(setting, [tuple(found)]):
        rmse = [found[level].rmse for level in chain]
        for lower, higher in itertools.pairwise(rmse):
            assert higher <= lower * (1.0 + SLACK), dict(zip(chain, rmse, strict=True))
    first, *_, last = found.values()
    if setting == "interpolation_precision":
        # What is left out there is far below what a code can show.
        assert abs(last.rmse - first.rmse) <= SLACK * first.rmse
    else:
        assert last.rmse < FALL * first.rmse
    assert last.wrong_faces <= first.wrong_faces


def test_finer_grids_show_fewer_wrong_faces():
    wrong = [one.wrong_faces for one in errors("subpixel_bits").values()]
    assert wrong == sorted(wrong, reverse=True)
    assert wrong[0] > 0 == wrong[-1]
