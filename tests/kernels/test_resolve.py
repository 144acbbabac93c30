"""sRGB codes are exact: the nearest, rounded half up, for every float32."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rasterjit.pipeline import srgb_encoding as resolve
from rasterjit.runtime.jit import helper
from rasterjit.scene.color import linear_to_srgb

TABLE = resolve.make_encoding_table()


def encode(values):
    """Return the codes of linear values, through the kernel."""
    values = np.asarray(values, np.float32).ravel()
    linear = np.zeros((1, len(values), 4), np.float32)
    linear[0, :, 0] = values
    color = np.zeros((1, len(values)), np.uint32)
    resolve.encode_rows(linear, TABLE, color)
    return color[0] & 255


def around(values, steps=3):
    """Return float32 values and their neighbours on both sides."""
    low = high = np.asarray(values, np.float32)
    rows = [low]
    for _ in range(steps):
        low, high = np.nextafter(low, np.float32(-1)), np.nextafter(high, np.float32(2))
        rows += [low, high]
    return np.concatenate(rows)


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


def bucket_starts():
    """Return the least value of each bucket of the table."""
    return (np.arange(len(TABLE), dtype=np.uint32) << resolve.BUCKET_BITS).view(np.float32)


def test_codes_equal_naive_on_a_sweep():
    sweep = np.linspace(0.0, 1.0, 20011).astype(np.float32)
    starts = bucket_starts()
    sweep = np.concatenate([sweep, starts[(starts >= 0.0) & (starts <= 1.0)]])
    sweep = around(sweep.astype(np.float32), 1)
    values = 255.0 * linear_to_srgb(sweep) + 0.5
    assert encode(sweep).tolist() == np.floor(values).astype(int).tolist()


def test_one_colour_has_the_code_that_rows_get():
    ends = [np.nan, np.inf, -np.inf, -0.0, 0.0, -1.0, 1e-40, 2.0]
    alphas = around((np.arange(256) + 0.5) / 255.0, 1)
    values = np.concatenate([ends, around(resolve.find_code_thresholds(), 1), alphas])
    values = values[: len(values) // 4 * 4].astype(np.float32)
    for colors in (values.reshape(-1, 4), np.roll(values, 2).reshape(-1, 4)):
        rows = np.zeros((1, len(colors)), np.uint32)
        resolve.encode_rows(np.ascontiguousarray(colors[np.newaxis]), TABLE, rows)
        assert [resolve.encode_color(color) for color in colors] == rows[0].tolist()


@settings(max_examples=200)
@given(st.floats(0.0, 1.0, width=32))
def test_code_is_the_nearest(value):
    assert encode([value])[0] == naive.srgb_code(value)


@settings(max_examples=100)
@given(st.floats(allow_nan=True, allow_infinity=True, width=32))
def test_every_float_has_a_code(value):
    assert encode([value])[0] == naive.srgb_code(value)


def test_channels_go_to_their_bytes():
    linear = np.array([[[1.0, 0.0, 0.5, 0.25], [0.0, 1.0, 0.0, 1.0]]], np.float32)
    color = np.zeros((1, 2), np.uint32)
    resolve.encode_rows(linear, TABLE, color)
    assert color.view(np.uint8).reshape(2, 4).tolist() == [[255, 0, 188, 64], [0, 255, 0, 255]]


def test_no_rows_is_nothing():
    color = np.full((2, 5), 7, np.uint32)
    resolve.encode_rows(np.zeros((0, 5, 4), np.float32), TABLE, color[1:1])
    assert (color == 7).all()


def test_every_code_begins_at_the_least_float32_that_reaches_it():
    thresholds = resolve.find_code_thresholds()
    for code in range(21, 256):
        power = ((200 * Fraction(2 * code - 1, 510) + 11) / 211) ** 12
        before = float(np.nextafter(thresholds[code - 1], np.float32(0)))
        assert Fraction(before) ** 5 < power <= Fraction(float(thresholds[code - 1])) ** 5


def test_no_bucket_holds_two_thresholds():
    buckets = resolve.find_code_thresholds().view(np.int32) >> resolve.BUCKET_BITS
    assert len(set(buckets.tolist())) == 255
    assert len(TABLE) == 2**16


def test_what_is_read_of_the_table_leaves_most_of_the_smallest_cache_to_others():
    starts = bucket_starts()
    is_read = (starts >= resolve.find_code_thresholds()[0] / 2) & (starts <= 1.0)
    assert TABLE[is_read].nbytes < 7.2e3


def codes_of_bits(first, count):
    """Return the codes of float32 values by their bits: those from ``first`` on, (count,) uint8."""
    infinity = int(np.float32(np.inf).view(np.uint32))
    starts = resolve.find_code_thresholds().view(np.uint32).astype(np.int64)
    # Above infinity and from the sign's bit on stand NaN and what is negative.
    begins, codes = [0, *starts.tolist(), infinity + 1], [*range(256), 0]
    ends = [*begins[1:], 1 << 32]
    held = np.clip(np.array([begins, ends]), first, first + count)
    return np.repeat(np.array(codes, np.uint8), held[1] - held[0])


def jumps_of_bits():
    """Return bits of float32 where codes or buckets begin."""
    one, infinity = (int(np.float32(value).view(np.uint32)) for value in (1.0, np.inf))
    jumps = [0, one, infinity, 1 << 31, (1 << 31) + infinity, (1 << 32) - 64]
    jumps += resolve.find_code_thresholds().view(np.uint32).tolist()
    return [*jumps, *bucket_starts().view(np.uint32).tolist()[::16]]


def test_codes_on_both_sides_of_every_jump_are_those_of_its_bits():
    for jump in jumps_of_bits():
        first = max(jump - 32, 0)
        bits = np.arange(first, first + 64, dtype=np.uint32)
        assert (encode(bits.view(np.float32)) == codes_of_bits(first, 64)).all()


@helper
def compiled_encode_span(red, green, blue, table, color):
    resolve.encode_span(red, green, blue, table, color)


@helper
def compiled_encode_channels(red, green, blue, alpha, table, color):
    resolve.encode_channels(red, green, blue, alpha, table, color)


@pytest.mark.parametrize("size", [0, 1, 7, 8, 9, 15, 16, 17, 64])
def test_spans_have_the_codes_that_pixels_get(size):
    random = np.random.default_rng(size)
    jumps = np.array(jumps_of_bits(), np.int64)
    for _ in range(20):
        bits = random.choice(jumps, (4, size)) + random.integers(-1, 2, (4, size))
        light = (bits % (1 << 32)).astype(np.uint32).view(np.float32)
        want = np.zeros((1, size + 2), np.uint32)
        resolve.encode_rows(np.ascontiguousarray(light.T[np.newaxis]), TABLE, want[:, 1:-1])
        have = np.zeros(size + 2, np.uint32)
        compiled_encode_channels(*light, TABLE, have[1:-1])
        assert have.tolist() == want[0].tolist()
        have[1:-1] = 7
        compiled_encode_span(*light[:3], TABLE, have[1:-1])
        want[0, 1:-1] |= 0xFF000000
        assert have.tolist() == want[0].tolist()


@pytest.mark.takes_long
@pytest.mark.needs_jit
def test_every_float32_has_the_code_of_its_bits():
    pixels = 1 << 20
    linear, color = np.zeros((1, pixels, 4), np.float32), np.empty((1, pixels), np.uint32)
    for first in range(0, 1 << 32, 3 * pixels):
        count = min(3 * pixels, (1 << 32) - first)
        bits = (first + np.arange(3 * pixels)).astype(np.uint32)
        linear[0, :, :3] = bits.view(np.float32).reshape(-1, 3)
        resolve.encode_rows(linear, TABLE, color)
        codes = color.view(np.uint8).reshape(-1, 4)[:, :3].ravel()
        assert (codes[:count] == codes_of_bits(first, count)).all()
