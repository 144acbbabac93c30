"""Sums of whole pictures, and their means: against NumPy, and what leaves every bit as it is."""

from __future__ import annotations

import numpy as np
import pytest

from rasterjit.pipeline.fragments import coverage_resolve

BEHIND = np.array([0.3, 0.2, 0.1, 0.0], np.float32)


def mean_of(pictures, behind=BEHIND):
    sums = np.zeros(pictures[0].shape, np.float64)
    for picture in pictures:
        coverage_resolve.add_picture(picture, sums)
    linear = np.full(pictures[0].shape, np.nan, np.float32)
    coverage_resolve.write_mean(sums, len(pictures), behind, linear)
    return linear


def pictures_of(seed, count, shape=(5, 23)):
    rng = np.random.default_rng(seed)
    found = rng.uniform(0.0, 3.0, (count, *shape, 4)).astype(np.float32)
    found[..., 3] = rng.choice(np.float32([0.0, 0.25, 0.7, 1.0]), (count, *shape))
    return found


@pytest.mark.parametrize("count", [1, 2, 7, 64])
def test_mean_is_of_what_is_emitted_and_of_alpha(count):
    pictures = pictures_of(count, count)
    alpha = pictures[..., 3:].astype(float)
    total = alpha.sum(axis=0)
    with np.errstate(invalid="ignore"):
        expected = (pictures[..., :3] * alpha).sum(axis=0) / total
    expected = np.where(total > 0.0, expected, BEHIND[:3])
    mean = mean_of(pictures)
    np.testing.assert_allclose(mean[..., :3], expected, rtol=1e-7)
    np.testing.assert_allclose(mean[..., 3], alpha[..., 0].mean(axis=0), rtol=1e-7)
    assert (total == 0.0).any() or count > 2


@pytest.mark.parametrize("count", [1, 4, 64, 256])
def test_mean_of_equal_pictures_keeps_every_bit(count):
    picture = pictures_of(3, 1, (16, 33))[0]
    picture[..., 3] = np.random.default_rng(4).uniform(0.01, 1.0, picture.shape[:2])
    assert mean_of([picture] * count).tobytes() == picture.tobytes()


def test_sums_go_on_where_they_were_left():
    pictures = pictures_of(5, 6)
    whole, parts = np.zeros((2, *pictures[0].shape))
    for picture in pictures:
        coverage_resolve.add_picture(picture, whole)
    for picture in pictures:
        for rows in (slice(0, 2), slice(2, None)):
            coverage_resolve.add_picture(picture[rows], parts[rows])
    assert parts.tobytes() == whole.tobytes()


def test_rows_that_are_opaque_have_the_bits_of_others():
    pictures = pictures_of(6, 5, (2, 37))
    # The last pixel of a row alone says how the row is added.
    pictures[..., 3] = 1.0
    other = pictures.copy()
    other[..., -1, 3] = 0.5
    mean, expected = mean_of(pictures), mean_of(other)
    assert mean[:, :-1].tobytes() == expected[:, :-1].tobytes()
    assert (mean[:, -1, 3] == 1.0).all()
    assert (expected[:, -1, 3] == 0.5).all()


def test_what_is_not_seen_counts_nothing_however_bright():
    pictures = np.ones((2, 1, 3, 4), np.float32)
    pictures[0] = (np.inf, np.nan, 1e30, 0.0)
    pictures[:, 0, 1] = pictures[0, 0, 0]
    pictures[1, 0, 2, 0] = np.inf
    mean = mean_of(pictures)
    assert mean[0, 0].tolist() == [1.0, 1.0, 1.0, 0.5]
    assert mean[0, 1].tolist() == BEHIND.tolist()
    assert mean[0, 2].tolist() == [np.inf, 1.0, 1.0, 0.5]
