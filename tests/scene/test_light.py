"""Laws of lights."""

import math

import pytest

from rasterjit.scene.light import AmbientLight, DirectionalLight, PointLight

LIGHTS = [AmbientLight, DirectionalLight, lambda **kw: PointLight((0, 0, 0), **kw)]


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
