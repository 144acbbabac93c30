"""Kernels read and write arrays as NumPy does."""

from __future__ import annotations

import array_kernels
import numpy as np
import pytest

from rasterjit.runtime import jit


def image():
    return np.arange(24, dtype=np.float64).reshape(2, 3, 4)


def strided():
    return np.arange(80, dtype=np.int32).reshape(8, 10)[1:7:2, ::3]


def for_indices():
    numbers = np.array([1, 2]), np.array([2, 1, 3], np.uint8)
    return image(), strided(), *numbers, np.zeros(6)


def for_cuts():
    return image(), strided(), np.array([-9, -2, 0, 1, 3, 9]), np.zeros(74)


@pytest.mark.skipif(jit.DISABLED, reason="plain Python is what it is compared with")
@pytest.mark.parametrize(
    ("kernel", "arguments"),
    [(array_kernels.index, for_indices), (array_kernels.cut, for_cuts)],
)
def test_a_kernel_indexes_as_numpy_does(kernel, arguments):
    found, expected = arguments(), arguments()
    kernel(*found)
    kernel.function(*expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.count_nonzero(found[-1]) > 3


def test_a_kernel_writes_to_parts_of_rows():
    rows, out = np.arange(24, dtype=np.float64).reshape(2, 12), np.zeros(2)
    expected = rows.copy()
    expected[1, [2, 5]] = 3.0, 4.0
    expected[0, 1:9] = 8.0
    array_kernels.share(rows, out)
    np.testing.assert_array_equal(rows, expected)
    assert out.tolist() == [24.0, 13.0]


@pytest.mark.skipif(not (jit.DISABLED or jit.CHECKED), reason="indices are not checked")
@pytest.mark.parametrize("where", [(2, 0, 1), (-1, 0, 1), (0, -1, 1), (0, 0, 5), (0, 3, 2)])
def test_a_part_that_ends_beyond_its_row_is_an_error(where):
    with pytest.raises(IndexError, match="beyond the row"):
        array_kernels.fill_part(np.zeros((2, 4)), *where)


@pytest.mark.parametrize("where", [(1, 1, 4), (0, 4, 4), (0, 0, 0)])
def test_a_part_of_a_row_is_filled_and_nothing_else(where):
    number, start, stop = where
    rows, wanted = np.zeros((2, 4)), np.zeros((2, 4))
    array_kernels.fill_part(rows, *where)
    wanted[number, start:stop] = 1.0
    np.testing.assert_array_equal(rows, wanted)
