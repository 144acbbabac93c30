"""Scale bars: as long as they say, where they say it."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj

SIZE = (200, 100)


def picture(camera):
    mesh = rj.Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])
    return rj.render(mesh, camera, size=SIZE, threads=1)


def length_of(strip):
    """Return the number of pixels of the bar."""
    row = (strip[11, :, :3] == 0).all(axis=1)
    (columns,) = np.nonzero(row)
    assert columns[-1] - columns[0] + 1 == len(columns)
    return len(columns)


@pytest.mark.parametrize(
    ("view_height", "per_unit", "pixels"),
    [(4.0, 1.0, 50), (4.0, 0.001, 50), (1000.0, 1.0, 50), (0.7, 1.0, 0.2 / 0.7 * 100)],
)
def test_bars_of_parallel_views_are_a_round_number_long(view_height, per_unit, pixels):
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=view_height)
    assert length_of(picture(camera).scale_bar("mm", per_unit=per_unit)) == round(pixels)


def test_bars_of_perspectives_are_right_at_their_depth():
    camera = rj.PerspectiveCamera((0, 0, 5), (0, 0, 0), fov_y=90.0)
    frame = picture(camera)
    # At depth 5 the picture is 10 high: 10 pixels a unit.
    assert length_of(frame.scale_bar(depth=5.0)) == 50
    assert length_of(frame.scale_bar(depth=10.0)) == 50
    assert length_of(frame.scale_bar(depth=4.0)) == round(5 * 12.5)
    with pytest.raises(ValueError, match="depth must say where"):
        frame.scale_bar()


def test_a_narrow_frame_has_a_bar():
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0)
    mesh = rj.Mesh(np.eye(3), [[0, 1, 2]])
    for width in (1, 8, 30):
        strip = rj.render(mesh, camera, size=(width, 9), threads=1).scale_bar("mm", arrow=True)
        assert strip.shape == (36, width, 4)
    for width in (6, 9, 12):
        camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=9.0)
        strip = rj.render(mesh, camera, size=(width, 9), threads=1).scale_bar()
        assert length_of(strip) == {6: 2, 9: 2, 12: 2}[width]


def test_arrows_have_heads_and_strips_are_as_wide_as_the_frame():
    frame = picture(rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0))
    bar, arrow = (frame.scale_bar("m/s", per_unit=0.5, arrow=one) for one in (False, True))
    assert bar.shape == arrow.shape == (36, 200, 4)
    assert length_of(bar) == length_of(arrow)
    heights = (arrow[:22, :, :3] == 0).all(axis=2).sum(axis=0)
    assert heights.max() == heights[8 + length_of(arrow) - 6]
    assert heights[8] == 2
    sheet = rj.grid([frame, arrow], 1, gap=0)
    assert sheet.width == 200


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"unit": 3}, "unit must be a string"), ({"per_unit": 0}, "per_unit must be above 0"),
        ({"depth": -1}, "depth must be above 0"), ({"arrow": 2}, "arrow must be"),
        ({"per_unit": 1e308}, "per_unit must give"), ({"per_unit": 5e-324}, "per_unit must give"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(options, words):
    frame = picture(rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=4.0))
    with pytest.raises(ValueError, match=words):
        frame.scale_bar(**options)
