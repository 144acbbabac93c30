"""Tone curves equal their formulas, keep what they promise, and meet published values."""

from __future__ import annotations

import math

import naive_environment as naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.tone_map import make_tone_record
from rasterjit.effects.tone_map import stage as tone_map_stage

CURVES = ["none", "reinhard", "aces", "neutral"]


def mapped(tone, colors):
    """Return colours, (N, 3), as they are shown."""
    colors = np.ascontiguousarray(np.array(colors, np.float32).T)
    shown = np.empty_like(colors)
    # Without the compiler NumPy warns where a colour overflows on purpose.
    with np.errstate(over="ignore"):
        tone_map_stage.map_tones(make_tone_record(tone), *colors, *shown)
    return shown.T


def lights(count=200):
    rng = np.random.default_rng(1)
    return np.concatenate(
        [
            rng.uniform(0, 1, (count, 3)),
            rng.uniform(0, 1, (count, 3)) * 10.0 ** rng.uniform(-4, 4, (count, 1)),
            [[0, 0, 0], [1, 1, 1], [0, 0, 5], [0.04, 0.04, 0.04], [0.08, 0.5, 0.9]],
        ]
    ).astype(np.float32)


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("exposure", [0.0, -2.0, 1.5])
def test_a_curve_equals_its_formula(curve, exposure):
    colors = lights()
    shown = mapped(rj.ToneMap(curve, exposure), colors)
    wanted = np.array([naive.tone(curve, color, exposure) for color in colors.astype(np.float64)])
    assert (np.abs(shown - wanted) <= np.maximum(3e-6 * np.abs(wanted), 2e-6)).all()


@pytest.mark.parametrize("white", [1.0, 4.0])
def test_reinhard_reaches_white(white):
    tone = rj.ToneMap("reinhard", white=white)
    assert mapped(tone, [[white] * 3])[0] == pytest.approx(1.0, abs=1e-6)
    for color, got in zip(lights(50).astype(np.float64), mapped(tone, lights(50)), strict=True):
        assert got == pytest.approx(naive.tone("reinhard", color, white=white), rel=3e-6, abs=2e-6)


@pytest.mark.parametrize("curve", CURVES)
def test_one_colour_alone_is_mapped_like_a_row(curve):
    tone = make_tone_record(rj.ToneMap(curve, 0.5))
    shown = mapped(rj.ToneMap(curve, 0.5), lights(40))
    for color, got in zip(lights(40), shown, strict=True):
        assert (np.array(tone_map_stage.map_pixel(tone, *color)) == got).all()


def test_a_colour_that_is_not_mapped_stays():
    color = np.array([1.0, -2.0, 3e38], np.float32)
    assert tone_map_stage.map_pixel(tone_map_stage.NO_TONES, *color) == tuple(color)


@pytest.mark.parametrize("curve", CURVES)
def test_grey_grows_with_light_from_black(curve):
    greys = np.concatenate([[0.0], np.geomspace(1e-5, 1e5, 4000)])
    shown = mapped(rj.ToneMap(curve), np.repeat(greys[:, None], 3, axis=1))
    # Hill's fit starts a little below zero, and its matrices leave grey to three digits.
    assert np.abs(shown[0]).max() < 1e-3
    assert (np.diff(shown, axis=0) >= -1e-6).all()
    if curve != "none":
        assert shown.max() <= (1.02 if curve == "aces" else 1.0)


def test_reinhard_has_known_values():
    shown = mapped(rj.ToneMap("reinhard"), [[1, 1, 1], [3, 3, 3], [0.18, 0.18, 0.18]])
    assert shown[:, 1] == pytest.approx([0.5, 0.75, 0.18 / 1.18], abs=1e-6)


def test_neutral_keeps_base_colours():
    # A surface of this base colour sends 0.04 of white light on by mirroring it.
    bases = np.random.default_rng(2).uniform(0.05, 0.75, (200, 3))
    assert mapped(rj.ToneMap("neutral"), bases + 0.04) == pytest.approx(bases, abs=1e-6)


def test_neutral_has_known_values():
    # The start of the compression stays; an infinite light is white.
    shown = mapped(rj.ToneMap("neutral"), [[0.8, 0.8, 0.8], [1e11, 1e11, 1e11], [0.08, 0.08, 0.08]])
    assert shown[:, 0] == pytest.approx([0.76, 1.0, 0.04], abs=1e-6)
    # Grey 1 has the peak 0.96: 1 - 0.24**2 / (0.96 + 0.24 - 0.76).
    assert mapped(rj.ToneMap("neutral"), [[1, 1, 1]])[0] == pytest.approx(
        1.0 - 0.24**2 / 0.44, abs=1e-6
    )


def test_aces_has_known_values():
    # Middle grey at about a tenth, as the reference transform has it; 1 at about 0.62.
    shown = mapped(rj.ToneMap("aces"), [[0.18] * 3, [1.0] * 3, [1e9] * 3])
    assert shown[:, 1] == pytest.approx([0.1055, 0.6191, 1.0165], abs=2e-3)


def test_exposure_is_in_stops():
    colors = lights(20)
    for stops in (-3, 1, 5):
        shown = mapped(rj.ToneMap("none", stops), colors)
        assert (shown == colors * np.float32(2.0**stops)).all()


@pytest.mark.parametrize("curve", CURVES)
def test_what_is_no_light_is_black(curve):
    black = mapped(rj.ToneMap(curve), [[0, 0, 0]])[0]
    for bad in (np.nan, -1.0, -np.inf):
        assert (mapped(rj.ToneMap(curve), [[bad] * 3])[0] == black).all()
    bright = mapped(rj.ToneMap(curve, 32.0), [[np.inf, 1e30, 3e38]])[0]
    assert np.isfinite(bright).all()
    assert not math.isnan(bright.sum())
