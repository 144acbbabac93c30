"""sRGB codes are exact: the nearest, rounded half up, for every float32."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rasterjit.kernels import resolve
from rasterjit.scene.color import linear_to_srgb, srgb_to_linear

TABLES = resolve.encoding_tables()


def encode(values):
    """Return the codes of linear values, through the kernel."""
    values = np.asarray(values, np.float32).ravel()
    linear = np.zeros((1, len(values), 4), np.float32)
    linear[0, :, 0] = values
    color = np.zeros((1, len(values)), np.uint32)
    resolve.encode_rows(linear, TABLES, color)
    return color[0] & 255


def encode_alpha(values):
    values = np.asarray(values, np.float32).ravel()
    linear = np.zeros((1, len(values), 4), np.float32)
    linear[0, :, 3] = values
    color = np.zeros((1, len(values)), np.uint32)
    resolve.encode_rows(linear, TABLES, color)
    return color[0] >> 24


def around(values, steps=3):
    """Return float32 values and their neighbours on both sides."""
    low = high = np.asarray(values, np.float32)
    rows = [low]
    for _ in range(steps):
        low, high = np.nextafter(low, np.float32(-1)), np.nextafter(high, np.float32(2))
        rows += [low, high]
    return np.concatenate(rows)


def test_all_codes_come_back():
    decoded = np.array([naive.srgb_decode(code / 255.0) for code in range(256)])
    assert encode(decoded).tolist() == list(range(256))
    assert encode(srgb_to_linear(np.arange(256, dtype=np.uint8))).tolist() == list(range(256))
    assert encode_alpha(np.arange(256) / 255.0).tolist() == list(range(256))


def test_codes_equal_naive_on_both_sides_of_every_threshold():
    # Where code - 1/2 begins, as float32, and three neighbours on each side.
    thresholds = [naive.srgb_decode((code - 0.5) / 255.0) for code in range(1, 256)]
    values = around(thresholds)
    codes = encode(values)
    for value, code in zip(values.tolist(), codes.tolist(), strict=True):
        exact = 255.0 * naive.srgb_encode(value) + 0.5
        # The float64 reference itself cannot decide nearer than this to a threshold.
        if abs(exact - round(exact)) > 1e-11:
            assert code == naive.srgb_code(value)
    assert (np.diff(codes[np.argsort(values, kind="stable")].astype(int)) >= 0).all()


def test_codes_equal_naive_on_a_sweep():
    sweep = np.linspace(0.0, 1.0, 20011).astype(np.float32)
    sweep = np.concatenate([sweep, np.arange(resolve.TABLE_STEPS + 1) / resolve.TABLE_STEPS])
    sweep = around(sweep.astype(np.float32), 1)
    values = 255.0 * linear_to_srgb(sweep) + 0.5
    assert encode(sweep).tolist() == np.floor(values).astype(int).tolist()


@settings(max_examples=200, derandomize=True, deadline=None, database=None)
@given(st.floats(0.0, 1.0, width=32))
def test_code_is_the_nearest(value):
    assert encode([value])[0] == naive.srgb_code(value)


@settings(max_examples=100, derandomize=True, deadline=None, database=None)
@given(st.floats(allow_nan=True, allow_infinity=True, width=32))
def test_every_float_has_a_code(value):
    assert encode([value])[0] == naive.srgb_code(value)


def test_rounding_of_alpha_is_half_up():
    # v * 255 = n + 1/2 has no float32 solution: take the neighbours of each.
    for half, want in ((0.5, 1), (1.5, 2), (2.5, 3), (126.5, 127), (127.5, 128), (254.5, 255)):
        value = np.float32(half / 255.0)
        exact = Fraction(float(value)) * 255
        above = want if exact >= Fraction(half) else want - 1
        assert encode_alpha([value])[0] == above
        assert encode_alpha([np.nextafter(value, np.float32(2))])[0] == want
    # 128 / 256 * 255 is exactly 127.5.
    assert encode_alpha([0.5])[0] == 128


@pytest.mark.parametrize("encoder", [encode, encode_alpha])
def test_out_of_range_is_held(encoder):
    largest, tiny = np.finfo(np.float32).max, np.finfo(np.float32).smallest_subnormal
    values = [1.5, -0.2, np.inf, -np.inf, largest, -largest, -0.0, tiny, 256.0, 300.0 / 255, -1.0]
    assert encoder(values).tolist() == [255, 0, 255, 0, 255, 0, 0, 0, 255, 255, 0]


def test_nan_is_black():
    assert encode([np.nan])[0] == 0
    assert encode_alpha([np.nan])[0] == 0


def test_value_just_below_a_half_is_not_lifted():
    # floor(x + 0.5) in float32 gives 1 for x = 0.49999997.
    assert encode_alpha([np.float32(0.49999997) / np.float32(255.0)])[0] == 0


def test_known_codes():
    assert encode([0.18, 0.2, 0.5, 0.25]).tolist() == [118, 124, 188, 137]
    assert round(255 * naive.srgb_encode(0.0031308), 4) == 10.3147


def test_channels_go_to_their_bytes():
    linear = np.array([[[1.0, 0.0, 0.5, 0.25], [0.0, 1.0, 0.0, 1.0]]], np.float32)
    color = np.zeros((1, 2), np.uint32)
    resolve.encode_rows(linear, TABLES, color)
    assert color.view(np.uint8).reshape(2, 4).tolist() == [[255, 0, 188, 64], [0, 255, 0, 255]]


def test_no_rows_is_nothing():
    resolve.encode_rows(np.zeros((0, 5, 4), np.float32), TABLES, np.zeros((0, 5), np.uint32))
