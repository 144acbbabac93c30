"""Every two effects together: sane numbers, and each is seen."""

from __future__ import annotations

from functools import cache

import combined
import numpy as np
import pytest
from combined import ROWS, SIZE, SWITCHES, all_pairs, named, pairs_of, scene_of, settings_of

import rasterjit as rj
from rasterjit.scene.scene import EFFECT_FIELDS

pytestmark = pytest.mark.needs_jit

BUFFERS = ("depth", "face_id", "object_id", "barycentric", "normal", "position")
COLORS = ("color", "linear")

SHAPES = {"mask", "facets", "parallel", "section"}
"""Switches that move what is seen; the others change colours alone."""

CODED = {"outline", "wireframe", "vignette", "tone", "label"}
"""Switches that 8-bit colour shows, and linear colour does not."""

SUMMED = 2e-5
"""Rounding of sums of terms in another order, of the largest of them."""


rows = pytest.mark.parametrize("row", [settings_of(*row) for row in ROWS], ids=named)


@cache
def drawn(row):
    scene, camera, quality = scene_of(row)
    return rj.render(
        scene, camera, quality=quality, size=SIZE, outputs=(*COLORS, *BUFFERS), threads=1
    ).arrays()


def flipped(row, name):
    n = SWITCHES.index(name)
    return (*row[:n], not row[n], *row[n + 1 :])


def test_every_two_settings_meet():
    found = [pairs_of(settings_of(*row)) for row in ROWS]
    assert set().union(*found) == all_pairs()
    assert all(len(bits) == len(SWITCHES) for bits, _ in ROWS)


def test_one_more_switch_is_covered(monkeypatch):
    monkeypatch.setattr(combined, "ROWS", combined.rows_for_one_more())
    monkeypatch.setattr(combined, "SWITCHES", (*SWITCHES, "one more"))
    found = [pairs_of(settings_of(*row)) for row in combined.ROWS]
    assert set().union(*found) == all_pairs()


def test_every_effect_that_a_scene_asks_for_is_switched():
    bits = "1" * len(SWITCHES)
    on = settings_of(bits, "nearest")
    scenes = [scene_of(flipped(on, name))[0] for name in SWITCHES]
    whole, again = scene_of(on)[0], scene_of(on)[0]
    for field in EFFECT_FIELDS:
        told = repr(getattr(whole, field))
        assert repr(getattr(again, field)) == told
        assert any(repr(getattr(one, field)) != told for one in scenes), field


@rows
def test_all_numbers_are_finite_and_no_light_is_negative(row):
    found = drawn(row)
    seen = found["face_id"] >= 0
    assert 0.2 < seen.mean() < 0.98
    for name in ("depth", "barycentric", "normal", "position"):
        assert np.isfinite(found[name][seen]).all(), name
    assert np.isinf(found["depth"][~seen]).all()
    linear = found["linear"]
    assert np.isfinite(linear).all()
    assert linear.min() >= 0.0
    assert linear[:, :, :3].max() < 50.0
    assert ((linear[:, :, 3] > 0.99) & (linear[:, :, 3] < 1.0 + 1e-5)).all()


@rows
def test_buffers_are_those_of_the_bare_scene(row):
    scene, camera, _ = scene_of(row)
    for name in EFFECT_FIELDS.keys() - {"section"}:
        setattr(scene, name, None)
    scene.lights = []
    # Nothing is shaded, and a pixel has one sample.
    bare = rj.render(scene, camera, size=SIZE, outputs=BUFFERS, threads=1)
    assert not any(effect.used for effect in bare.plan.effects if effect.name == "shading")
    found = drawn(row)
    for name, array in bare.arrays().items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)


@pytest.mark.parametrize("row", [settings_of(*row) for row in ROWS[::4]], ids=named)
def test_every_effect_shows_beside_the_others(row):
    found = drawn(row)
    for name in SWITCHES:
        if name == "highlight" and not (
            row[SWITCHES.index("spot")] or row[SWITCHES.index("point")]
        ):
            # No light that could be mirrored.
            continue
        other = drawn.__wrapped__(flipped(row, name))
        changed = {key for key in found if found[key].tobytes() != other[key].tobytes()}
        if name in SHAPES:
            assert {"color", "linear", "face_id"} <= changed, name
        else:
            assert changed == ({"color"} if name in CODED else {"color", "linear"}), name


@pytest.mark.parametrize(
    "row", [settings_of(*row) for row in ROWS if row[1] == "nearest"], ids=named
)
def test_the_terms_of_a_pixel_add_up(row):
    scene, camera, quality = scene_of(row)
    found, told_of = drawn(row), set()
    for y, x in np.argwhere(found["face_id"] >= 0)[40::700]:
        told = rj.explain_pixel(scene, camera, SIZE, int(x), int(y), quality=quality)
        assert told.linear.tobytes() == found["linear"][y, x].tobytes()
        assert told.color.tobytes() == found["color"][y, x].tobytes()
        light = told.light
        parts = [light.ambient, light.emission]
        parts += [part for term in light.lights for part in (term.diffuse, term.specular)]
        largest = max(float(np.abs(part).max()) for part in parts)
        total = np.sum(parts, axis=0)
        np.testing.assert_allclose(total, told.linear[:3], atol=SUMMED * largest, rtol=0.0)
        told_of |= {term.label for term in light.lights}
    lights = {"SpotLight 1, diffuse", "PointLight 2, diffuse"}
    dome = {"eye-dome lighting"} if row[SWITCHES.index("dome")] else set()
    assert told_of == {*lights, "environment", "fog", "what is seen through it", *dome}, (
        "add what a new effect is called in the light of a pixel"
    )


@pytest.mark.parametrize(
    "row", [settings_of(*row) for row in ROWS if row[1] != "nearest"], ids=named
)
def test_the_parts_of_a_mixed_pixel_add_up(row):
    scene, camera, quality = scene_of(row)
    found, mixed = drawn(row), 0
    objects = found["object_id"]
    is_edge = (objects[:, :-1] >= 0) & (objects[:, :-1] != objects[:, 1:])
    for y, x in np.argwhere(is_edge)[2::67]:
        told = rj.explain_pixel(scene, camera, SIZE, int(x), int(y), quality=quality)
        assert told.linear.tobytes() == found["linear"][y, x].tobytes()
        if told.parts:
            largest = max(float(np.abs(part.color).max()) for part in told.parts)
            total = sum(part.color for part in told.parts)
            np.testing.assert_allclose(total, told.linear[:3], atol=SUMMED * largest, rtol=0.0)
            assert sum(part.share for part in told.parts) == pytest.approx(1.0, abs=SUMMED)
            assert len(told.parts) > 1
            mixed += 1
    assert mixed
