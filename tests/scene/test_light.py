"""Laws of lights."""

import math

import pytest

from rasterjit.scene.light import (
    AmbientLight,
    DirectionalLight,
    PointLight,
    Shadow,
    SpotLight,
)


def point(**kw):
    return PointLight((0, 0, 0), **kw)


def spot(**kw):
    return SpotLight((0, 0, 0), **kw)


LIGHTS = [AmbientLight, DirectionalLight, point, spot]


def test_defaults_are_white():
    assert AmbientLight() == AmbientLight(color=(1.0, 1.0, 1.0), intensity=0.1)
    assert DirectionalLight((0, -1, 0)).intensity == 1.0
    assert PointLight((1, 2, 3)).position == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("light", LIGHTS)
def test_colours_are_stored_as_linear_rgb(light):
    assert light(color="#00ff00").color == (0.0, 1.0, 0.0)


@pytest.mark.parametrize("scale", [1.0, 1e-200, 1e200])
def test_a_direction_is_stored_with_unit_length(scale):
    light = DirectionalLight((0.0, -3.0 * scale, 4.0 * scale))
    assert light.direction == pytest.approx((0.0, -0.6, 0.8), abs=1e-15)
    assert math.hypot(*light.direction) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("intensity", [-1.0, float("nan"), float("inf"), "bright"])
def test_a_bad_intensity_is_refused_by_name(light, intensity):
    with pytest.raises(ValueError, match="intensity must be"):
        light(intensity=intensity)


@pytest.mark.parametrize("light", LIGHTS)
def test_a_bad_colour_is_refused_by_name(light):
    with pytest.raises(ValueError, match=r"color must lie in 0\.\.1"):
        light(color=(255, 255, 255))


def test_a_zero_direction_is_refused():
    with pytest.raises(ValueError, match="direction must not be the zero vector"):
        DirectionalLight((0, 0, 0))


@pytest.mark.parametrize("value", [(0, 0), (0, 0, float("nan")), "up"])
def test_what_is_no_vector_is_refused_by_name(value):
    with pytest.raises(ValueError, match="direction must"):
        DirectionalLight(value)
    with pytest.raises(ValueError, match="position must"):
        PointLight(value)


def test_no_light_is_allowed_to_shine():
    assert AmbientLight(intensity=0).intensity == 0.0


@pytest.mark.parametrize("light", [point, spot])
@pytest.mark.parametrize("value", [0, -1.0, float("nan"), float("inf"), "far"])
def test_a_bad_range_is_refused_by_name(light, value):
    with pytest.raises(ValueError, match="range must be"):
        light(range=value)


def test_a_spot_light_is_a_cone_of_45_degrees_down_its_axis():
    light = SpotLight((1, 2, 3), (0, -4, 0))
    assert (light.position, light.direction) == ((1.0, 2.0, 3.0), (0.0, -1.0, 0.0))
    assert (light.inner_angle, light.outer_angle, light.range) == (0.0, 45.0, None)


def test_inverted_cones_are_refused_by_both_names():
    with pytest.raises(ValueError, match="inner_angle 40 and outer_angle 30"):
        spot(inner_angle=40, outer_angle=30)
    assert spot(inner_angle=30, outer_angle=30).inner_angle == 30.0


@pytest.mark.parametrize("value", [-1, 91, float("nan"), "wide"])
@pytest.mark.parametrize("name", ["inner_angle", "outer_angle"])
def test_a_bad_angle_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f"{name} must be"):
        spot(**{name: value})


def test_a_cone_without_width_is_refused():
    with pytest.raises(ValueError, match="outer_angle must be above 0"):
        spot(outer_angle=0)


@pytest.mark.parametrize("light", LIGHTS[1:])
def test_what_is_no_shadow_is_refused(light):
    assert light(shadow=Shadow(size=512)).shadow.size == 512
    with pytest.raises(ValueError, match="shadow must be a Shadow or None, got True"):
        light(shadow=True)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"size": 15}, "size must be in 16..8192"),
        ({"size": 8193}, "size must be in 16..8192"),
        ({"size": 100.5}, "size must be a whole number of texels"),
        ({"size": True}, "size must be"),
        ({"size": "large"}, "size must be a number"),
        ({"filter": "blur"}, "filter must be one of 'hard', 'pcf', 'soft'"),
        ({"bias": -0.1}, r"bias must be in 0\.\.100"),
        ({"bias": float("nan")}, "bias must be finite"),
        ({"filter": "soft"}, "light_size must be above 0 where filter is 'soft', got None"),
        ({"filter": "soft", "light_size": 0}, "light_size must be above 0"),
        ({"filter": "pcf", "light_size": 1.0}, "light_size must be None where filter is 'pcf'"),
    ],
)
def test_a_bad_shadow_is_refused_by_name(settings, message):
    with pytest.raises(ValueError, match=message):
        Shadow(**settings)


def test_a_sun_wider_than_a_quarter_of_the_sky_is_refused():
    wide = Shadow(filter="soft", light_size=91.0)
    with pytest.raises(ValueError, match=r"shadow\.light_size must be in 0\.\.90"):
        DirectionalLight(shadow=wide)
    assert point(shadow=wide).shadow is wide


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Shadow(10), "size must be in 16..8192, got 10"),
        (lambda: Shadow(9000.5), "size must be in 16..8192, got 9000.5"),
        (lambda: PointLight((0, 0, 0), range=-2), "range must be above 0, got -2"),
    ],
)
def test_a_number_is_shown_as_it_was_given(make, words):
    with pytest.raises(ValueError, match=f"{words}$"):
        make()
