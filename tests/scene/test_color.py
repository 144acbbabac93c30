"""Laws of colours: what is sRGB is decoded, what is linear is taken as it is."""

import math
from fractions import Fraction

import numpy as np
import pytest
from PIL import ImageColor

from rasterjit.scene.color import (
    NAMED_COLORS,
    linear_color,
    linear_rows,
    linear_to_srgb,
    srgb_to_linear,
)


def test_decoding_keeps_the_shape():
    assert srgb_to_linear(np.zeros((2, 3, 4), dtype=np.uint8)).shape == (2, 3, 4)


@pytest.mark.parametrize(
    ("value", "rgba"),
    [
        ("white", (1.0, 1.0, 1.0, 1.0)),
        ("black", (0.0, 0.0, 0.0, 1.0)),
        ("Red", (1.0, 0.0, 0.0, 1.0)),
        ("transparent", (0.0, 0.0, 0.0, 0.0)),
        ("#f00", (1.0, 0.0, 0.0, 1.0)),
        ("#0000FF", (0.0, 0.0, 1.0, 1.0)),
        ("#ffffff33", (1.0, 1.0, 1.0, 0.2)),
        ((0.25, 0.5, 1.0), (0.25, 0.5, 1.0, 1.0)),
        ([1, 0, 0], (1.0, 0.0, 0.0, 1.0)),
        (np.array([0.1, 0.2, 0.3, 0.4]), (0.1, 0.2, 0.3, 0.4)),
        (np.array([255, 0, 255], dtype=np.uint8), (1.0, 0.0, 1.0, 1.0)),
        (np.array([255, 255, 255, 51], dtype=np.uint8), (1.0, 1.0, 1.0, 0.2)),
    ],
)
def test_a_colour_can_be_written_in_many_ways(value, rgba):
    color = linear_color("color", value)
    assert color.dtype == np.float32
    assert color.tolist() == np.float32(rgba).tolist()


def test_grey_of_strings_and_bytes_is_srgb():
    middle = np.float32(0.215860500114)
    assert linear_color("color", "grey")[0] == middle
    assert linear_color("color", np.full(3, 128, dtype=np.uint8))[0] == middle


def test_every_name_is_a_colour():
    for name in NAMED_COLORS:
        assert linear_color("color", name).shape == (4,)


def test_the_names_are_the_148_of_css_as_pillow_has_them():
    names = {name for name in NAMED_COLORS if name != "transparent"}
    assert len(names) == 148
    assert names == set(ImageColor.colormap)
    for name in names:
        codes = np.array(ImageColor.getrgb(name), np.uint8)
        assert np.array_equal(linear_color("c", name.title()), linear_color("c", codes)), name


@pytest.mark.parametrize("text", ["steelblu", "Steel Blue", "steel-blue"])
def test_a_name_that_is_nearly_one_is_answered_with_it(text):
    with pytest.raises(ValueError, match="did you mean 'steelblue'"):
        linear_color("tint", text)
    with pytest.raises(ValueError, match=r"got 'qqqq'$"):
        linear_color("tint", "qqqq")


@pytest.mark.parametrize("value", [(255, 0, 0), (0.5, -0.1, 0.0), (np.nan, 0, 0), (np.inf, 0, 0)])
def test_numbers_outside_0_to_1_are_refused_with_advice(value):
    with pytest.raises(ValueError, match=r"tint must lie in 0\.\.1.*'#rrggbb'.*uint8"):
        linear_color("tint", value)


@pytest.mark.parametrize("value", ["#12", "#12345", "#gggggg", "no such colour", "", "123456"])
def test_unknown_strings_are_refused_naming_the_known_ones(value):
    with pytest.raises(ValueError, match=r"tint must be '#rgb'.*'steelblue'"):
        linear_color("tint", value)


@pytest.mark.parametrize(
    "value", [(1.0, 0.0), 0.5, None, [True, False, True], [[1.0, 0.0, 0.0]], ["a", "b", "c"]]
)
def test_other_things_are_no_colours(value):
    with pytest.raises(ValueError, match="tint must"):
        linear_color("tint", value)


def test_rows_of_unequal_length_are_refused():
    with pytest.raises(ValueError, match="tint must be an array of numbers"):
        linear_rows("tint", [[1.0, 0.0, 0.0], [1.0, 0.0]])


def test_rows_get_an_alpha_of_one():
    assert linear_rows("tint", np.zeros((2, 3)))[:, 3].tolist() == [1.0, 1.0]


def base(encoded):
    """Return what the curve raises to the power 12/5, exactly."""
    return (200 * encoded + 11) / 211


def test_decoded_codes_are_the_nearest_float32():
    values = srgb_to_linear(np.arange(256, dtype=np.uint8))
    for code in range(11, 256):
        power = base(Fraction(code, 255)) ** 12
        value = values[code]
        below, above = np.nextafter(value, np.float32(0)), np.nextafter(value, np.float32(2))
        low, high = (Fraction(float(value)) + Fraction(float(other)) for other in (below, above))
        assert (low / 2) ** 5 < power < (high / 2) ** 5


@pytest.mark.parametrize("value", [0.0031309, 0.004, 0.018, 0.1, 0.3, 0.5, 0.9, 1.0 - 2.0**-53])
def test_encoded_light_is_the_nearest_float64(value):
    encoded = float(linear_to_srgb(value))
    neighbours = (math.nextafter(encoded, 0.0), math.nextafter(encoded, 2.0))
    low, high = ((Fraction(encoded) + Fraction(other)) / 2 for other in neighbours)
    assert base(low) ** 12 <= Fraction(value) ** 5 <= base(high) ** 12


def test_a_colour_by_name_is_the_callers_own():
    linear_color("color", "orange")[:] = 0.0
    assert linear_color("color", "orange").tolist() != [0.0, 0.0, 0.0, 0.0]
