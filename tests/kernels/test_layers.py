"""Colours laid over each other: by Porter and Duff, and without a trace of what is not there."""

from __future__ import annotations

import naive_layers
import numpy as np

from rasterjit.pipeline.fragments import compositing


def lay(colors, background):
    """Lay rows of colours, (K, 4), the nearest first, over a background."""
    sums, linear = np.empty((1, 1, 4), np.float32), np.empty((1, 1, 4), np.float32)
    linear[0, 0] = background
    compositing.start_sums(sums)
    hidden = []
    for color in colors:
        behind = np.zeros((1, 1), np.int32)
        image = np.array(color, np.float32).reshape(1, 1, 4)
        compositing.composite_under(image, np.zeros((1, 1), np.int32), behind, sums)
        hidden.append(int(behind[0, 0]) == -1)
    compositing.finish_sums(sums, linear)
    return linear[0, 0], hidden


def test_it_is_the_over_operator():
    rng = np.random.default_rng(61)
    for _ in range(200):
        colors, background = rng.random((rng.integers(1, 9), 4)), rng.random(4)
        background[3] = rng.choice([0.0, 0.3, 1.0])
        have, _ = lay(colors, background)
        want = naive_layers.over(range(len(colors)), colors, background)
        # Sums are premultiplied: that is what rounding is small beside.
        np.testing.assert_allclose(have[3], want[3], atol=1e-6)
        np.testing.assert_allclose(have[:3] * want[3], want[:3] * want[3], atol=2e-6)
        if background[3] == 1.0:
            assert have[3] == 1.0


def test_alpha_0_and_alpha_1_leave_the_bits_of_what_is_seen():
    rng = np.random.default_rng(62)
    for _ in range(50):
        color, background = rng.random((2, 4)).astype(np.float32)
        clear = [*rng.random(3), 0.0]
        assert (lay([clear, clear], background)[0] == background).all()
        color[3] = 1.0
        assert (lay([clear, color, clear, [*rng.random(3), 0.7]], background)[0] == color).all()


def test_nothing_behind_alpha_1_is_shaded():
    assert lay([(1, 1, 1, 0.5), (1, 1, 1, 1.0), (1, 1, 1, 0.5)], (0, 0, 0, 1))[1] == [
        False, True, True,
    ]  # fmt: skip


def test_what_is_not_there_or_hidden_may_be_infinite():
    huge = [np.inf, np.inf, np.inf]
    assert np.isfinite(lay([[*huge, 0.0]], (0, 0, 0, 1))[0]).all()
    assert (lay([[0.5, 0.5, 0.5, 1.0], [*huge, 0.5]], [*huge, 1.0])[0] == [0.5, 0.5, 0.5, 1]).all()


def test_alphas_beyond_0_to_1_and_nan_are_held():
    background = np.array([0.25, 0.5, 0.75, 1.0], np.float32)
    for alpha, want in ((-1.0, background), (np.nan, background), (7.0, [1, 1, 1, 1])):
        assert (lay([(1, 1, 1, alpha)], background)[0] == want).all()
