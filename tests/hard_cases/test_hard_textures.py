"""Hard cases of textures: wrapping, filtering, mip levels, orientation."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import product

import naive_textures as naive
import numpy as np
import pytest
from naive_textures import box, draw, probe, square

import rasterjit as rj
from rasterjit.pipeline.surface import texture_filters
from rasterjit.scene.mip_levels import level_sizes
from rasterjit.scene.texture import FILTERS, WRAPS

# Light in whole numbers shows exactly what is mixed.
pytestmark = pytest.mark.filterwarnings("ignore:image holds floats that are whole numbers")

WRAP_NUMBERS = {
    "repeat": texture_filters.REPEAT,
    "clamp": texture_filters.CLAMP,
    "mirror": texture_filters.MIRROR,
}

WHOLE = box((0, 0), (1, 1))

FLOAT32 = 2.0**-24
"""Relative rounding of float32."""

MIX_ROUNDINGS = 8
"""Roundings of float32 in a bilinear mix: a difference, a product and a sum, thrice."""

LOG_ERROR = 2.4e-7
"""Error of the level of detail per 1 + its size: that of ``float_math.log2``, and its rounding."""


def row_of(values, wrap="repeat", filter="bilinear"):
    return rj.Texture(np.float32([values]), wrap=wrap, filter=filter)


def numbers(size):
    """Return a row of texels that show their own number."""
    return list(range(size))


def red(colors):
    return colors[..., 0].tolist()


@pytest.mark.case("T01")
@pytest.mark.parametrize(
    ("wrap", "shown"),
    [
        ("repeat", [0, 127.5, 127.5, 127.5, 255]),
        ("clamp", [0, 127.5, 0, 255, 0]),
        ("mirror", [0, 127.5, 0, 255, 0]),
    ],
)
def test_four_texels_are_mixed_at_their_border_as_they_wrap(wrap, shown):
    places = [(u, 0.5) for u in (1 / 8, 1 / 2, 0.0, 1.0, -1 / 8)]
    assert red(probe(row_of([0, 85, 170, 255], wrap), places)) == shown


@pytest.mark.case("T02")
@pytest.mark.parametrize("size", [1, 2, 4, 7, 64])
def test_the_nearest_texel_at_the_end_and_before_the_start(size):
    places = [(1.0, 0.5), (-1 / (2 * size), 0.5)]
    last = size - 1
    for wrap, shown in {"repeat": [0, last], "clamp": [last, 0], "mirror": [last, 0]}.items():
        assert red(probe(row_of(numbers(size), wrap, "nearest"), places)) == shown


@pytest.mark.case("T03")
def test_a_coordinate_a_hair_below_zero_stays_on_the_texture():
    tiny = -1e-20
    assert tiny - math.floor(tiny) == tiny % 1.0 == 1.0  # the trap: texel n of n
    for size, wrap in product((1, 4, 5, 256), WRAPS):
        texture = row_of(numbers(size), wrap, "nearest")
        # It is nearer to the border than 2**-25 texel, so it lies on it: texel 0.
        assert red(probe(texture, [(tiny, 0.5)])) == [0]
    assert red(probe(row_of(numbers(4), "repeat"), [(tiny, 0.5)])) == [1.5]
    assert red(probe(row_of(numbers(4), "clamp"), [(tiny, 0.5)])) == [0]


@pytest.mark.case("T04")
@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("kind", ["nearest", "bilinear"])
def test_far_coordinates_are_reduced_before_they_are_scaled(wrap, kind):
    far = [1e6 + 1 / 8, 1e15, 2.0**53, -1e6 - 1 / 8, -1e15, 3e38, -3e38]
    image = np.float32([numbers(7)])
    shown = red(probe(rj.Texture(image, wrap=wrap, filter=kind), [(u, 0.5) for u in far]))
    look_up = getattr(naive, kind)
    for u, value in zip(far, shown, strict=True):
        exact = look_up(
            naive.exact_image(image), Fraction(float(np.float32(u))), naive.HALF, (wrap, "clamp")
        )
        assert value == pytest.approx(float(exact), abs=6 * MIX_ROUNDINGS * FLOAT32)


@pytest.mark.case("T04")
@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("u", [math.inf, -math.inf, math.nan])
def test_infinity_and_nan_show_texel_0(wrap, u):
    # No mesh holds them: they are given to the stage itself.
    with pytest.raises(ValueError, match="uv must be finite"):
        square(None, box((u, 0), (1, 1)))
    number = WRAP_NUMBERS[wrap]
    level = (0, 5, 1)
    for offset in (0.0, 0.5):
        (first, *_), shares = naive.texels_around(level, u, 0.5, (number, number), offset)
        assert (first, *shares) == (0, 0.5 - offset, 0.5 - offset)


@pytest.mark.case("T05")
@pytest.mark.parametrize(
    ("wrap", "texels"),
    [
        ("repeat", [3, 0, 3, 0, 3, 0]),
        ("mirror", [0, 3, 3, 3, 0, 0]),
        ("clamp", [0, 0, 0, 3, 3, 3]),
    ],
)
def test_whole_numbers_wrap_by_floor_division(wrap, texels):
    indices = [-1, -4, -5, 4, 7, 8]
    places = [((i + 0.5) / 4, 0.5) for i in indices]
    assert red(probe(row_of(numbers(4), wrap, "nearest"), places)) == texels
    assert red(probe(row_of(numbers(4), wrap, "bilinear"), places)) == texels


@pytest.mark.case("T06")
def test_a_linear_ramp_is_reproduced_exactly_between_texels():
    size, pixels = 8, 64
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    ramp = np.float32(3 * x + 5 * y)
    shown = draw(square(rj.Texture(ramp, filter="bilinear"), WHOLE), (pixels, pixels))[..., 0]
    centre = (np.arange(pixels) + 0.5) * size / pixels - 0.5
    inside = (centre >= 0) & (centre <= size - 1)
    exact = 3 * centre[inside] + 5 * centre[inside, np.newaxis]
    assert inside.sum() == 56
    assert (shown[np.ix_(inside, inside)] == exact).all()


def corner_levels(size):
    """
    Return an image whose lower left texel is 3 k on mip level k, exactly.

    The corner square of side 2**k has the mean 3 k if the texels around that of side 2**(k-1)
    are 3 k + 1. Coordinates below 0 show that texel alone where they are clamped.
    """
    x, y = np.meshgrid(np.arange(size), np.arange(size)[::-1])
    ring = np.array([int(n).bit_length() for n in range(size)])[np.maximum(x, y)]
    return np.where(ring > 0, 3 * ring + 1, 0).astype(np.float32)


def detail_shown(pixels, size=256):
    """Return the level of detail at which a texture of 256 texels is drawn on n pixels."""
    texture = rj.Texture(corner_levels(size), wrap="clamp", filter="trilinear")
    assert [float(level[-1, 0, 0]) for level in texture.levels] == [3.0 * k for k in range(9)]
    shown = draw(square(texture, box((-1, -1), (0, 0))), (pixels, pixels))[..., 0]
    assert np.ptp(shown) <= 3 * LOG_ERROR * 9
    return float(shown[0, 0]) / 3.0


@pytest.mark.case("T07")
@pytest.mark.parametrize(
    ("pixels", "detail", "level"),
    [
        (256, 0.0, 0), (200, 0.356, 0), (128, 1.0, 1), (100, 1.356, 1), (64, 2.0, 2), (1, 8.0, 8),
        (182, 0.4922, 0), (181, 0.5001, 1),
    ],
)  # fmt: skip
def test_the_level_of_detail_is_the_logarithm_of_texels_a_pixel(pixels, detail, level):
    shown = detail_shown(pixels)
    assert shown == pytest.approx(math.log2(256 / pixels), abs=LOG_ERROR * 9)
    assert round(shown, 3) == round(detail, 3)
    # There is no filter for the nearest level alone; both rules for it give this one.
    assert math.ceil(shown + 0.5) - 1 == math.floor(shown + 0.5) == level
    if math.log2(256 / pixels).is_integer():
        assert shown == detail


@pytest.mark.case("T07")
def test_half_a_level_is_exactly_the_middle_of_two():
    # One pixel is one texel along both axes of the texture: a step of sqrt(2) texels.
    pixels = 8
    texture = rj.Texture(corner_levels(256), wrap="clamp", filter="trilinear")
    corners = [(-2 * pixels, -pixels), (-pixels, 0), (-2 * pixels, pixels), (-3 * pixels, 0)]
    uv = np.array(corners) / 256 - 1.0
    shown = draw(square(texture, uv), (pixels, pixels))[..., 0]
    assert (shown == 1.5).all()
    # Of the two rules for a nearest level, one would take level 0 and one level 1.
    assert math.ceil(0.5 + 0.5) - 1 == 0
    assert math.floor(0.5 + 0.5) == 1


@pytest.mark.case("T08")
def test_the_mix_of_two_levels_is_linear_in_the_level_of_detail():
    for pixels in (255, 160, 129, 90, 33, 10, 3):
        assert detail_shown(pixels) == pytest.approx(math.log2(256 / pixels), abs=LOG_ERROR * 9)


@pytest.mark.case("T08")
@pytest.mark.parametrize("pixels", [256, 257, 300, 400])
def test_magnification_shows_level_0_alone(pixels):
    assert detail_shown(pixels) == 0.0


SMALL = np.random.default_rng(9).integers(0, 256, (5, 7)).astype(np.float32)
CELLS = [
    ((-0.1, 0.1), (0.8, 1.0)), ((-0.3, -0.6), (0.7, 0.4)), ((1.0, -1.0), (-1.3, 1.0)),
    ((-1.5, 1.6), (1.7, -1.4)), ((-0.8, -6.6), (6.0, -0.9)), ((-8.0, 9.0), (8.3, -7.0)),
    ((30.2, 55.0), (-24.3, -1.6)), ((-33.2, 64.1), (32.1, -64.1)),
]  # fmt: skip


def exact_coordinates(uv, size):
    """Yield each pixel of a square with its exact texture coordinates."""
    low, high = (
        [Fraction(float(np.float32(value))) for value in corner] for corner in (uv[0], uv[2])
    )
    for row, column in np.ndindex(size[1], size[0]):
        x = (column + naive.HALF) / size[0]
        y = 1 - (row + naive.HALF) / size[1]
        yield row, column, low[0] + x * (high[0] - low[0]), low[1] + y * (high[1] - low[1])


@pytest.mark.case("T09")
@pytest.mark.parametrize("wraps", list(product(WRAPS, WRAPS)), ids="-".join)
@pytest.mark.parametrize(
    ("low", "high"), [((-1.5, -3.0), (1.5, 2.5)), ((-0.5, 0.75), (0.25, 1.25))]
)
def test_wrapped_lookups_equal_exact_ones(low, high, wraps):
    size, uv = (32, 16), box(low, high)
    image = naive.exact_image(SMALL)
    near = draw(square(rj.Texture(SMALL, wrap=wraps, filter="nearest"), uv), size)[..., 0]
    mixed = draw(square(rj.Texture(SMALL, wrap=wraps, filter="bilinear"), uv), size)[..., 0]
    for row, column, u, v in exact_coordinates(uv, size):
        assert near[row, column] == naive.nearest(image, u, v, wraps)
        exact = float(naive.bilinear(image, u, v, wraps))
        assert abs(mixed[row, column] - exact) <= 255 * MIX_ROUNDINGS * FLOAT32


@pytest.mark.case("T09")
@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize(("low", "high"), CELLS)
def test_mipmapped_lookups_equal_exact_ones(low, high, wrap):
    size, uv = (8, 8), box(low, high)
    image = np.random.default_rng(8).integers(0, 256, (32, 16)).astype(np.float32)
    levels = naive.mip_chain(naive.exact_image(image))
    shown = draw(square(rj.Texture(image, wrap=wrap), uv), size)[..., 0]
    spans = np.abs(np.float32(uv[2]).astype(float) - np.float32(uv[0])) / size * [16, 32]
    detail = math.log2(max(spans))
    for row, column, u, v in exact_coordinates(uv, size):
        exact = float(naive.trilinear(levels, u, v, (wrap, wrap), detail))
        error = MIX_ROUNDINGS * FLOAT32 + LOG_ERROR * (1 + abs(detail))
        assert abs(shown[row, column] - exact) <= 255 * error


@pytest.mark.case("T10")
def test_the_levels_of_five_by_three_are_two_by_one_and_one_by_one():
    assert level_sizes(5, 3) == [(5, 3), (2, 1), (1, 1)]
    texture = rj.Texture(np.zeros((3, 5)))
    assert [level.shape[:2] for level in texture.levels] == [(3, 5), (1, 2), (1, 1)]


@pytest.mark.case("T10")
@pytest.mark.parametrize("shape", [(3, 5), (7, 13), (1, 31), (64, 1), (100, 75)])
def test_a_constant_texture_is_the_same_constant_on_every_level(shape):
    constant = np.float32(1 / 3)
    texture = rj.Texture(np.full(shape, constant))
    assert all((level[..., :3] == constant).all() for level in texture.levels)
    shown = draw(square(texture, box((-3.3, 0.1), (9.7, 5.9))), (9, 7))
    assert (shown[..., :3] == constant).all()


@pytest.mark.case("T10")
@pytest.mark.parametrize("shape", [(16, 16), (32, 8), (1, 64)])
def test_the_last_level_of_a_power_of_two_is_the_exact_mean(shape):
    image = np.random.default_rng(3).integers(0, 1 << 12, shape).astype(np.float32)
    mean = Fraction(int(image.sum()), image.size)
    shown = draw(square(rj.Texture(image), box((0, 0), (1000, 1000))), (2, 2))
    assert all(Fraction(float(value)) == mean for value in shown[..., :3].ravel())


@pytest.mark.case("T11")
@pytest.mark.parametrize("size", [(1, 1), (2, 2), (5, 3), (16, 16), (7, 100)])
@pytest.mark.parametrize("kind", FILTERS)
def test_a_texture_as_large_as_its_square_is_copied(size, kind):
    codes = np.random.default_rng(4).integers(0, 256, (size[1], size[0], 3)).astype(np.uint8)
    texture = rj.Texture(codes, filter=kind)
    assert (draw(square(texture, WHOLE), size) == texture.image).all()
    # Row 0 of the picture is on top, where v is 1: in 8 bits it is the picture itself.
    scene = rj.Scene()
    scene.add(square(texture, WHOLE), rj.transforms.scale((size[0] / size[1], 1, 1)))
    frame = rj.render(scene, naive.FRONT, size=size, threads=1)
    assert (frame.color[..., :3] == codes).all()
