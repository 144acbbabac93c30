"""A vignette darkens a picture towards its corners, and nothing else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene.color import linear_to_srgb, srgb_to_linear

SIZE = (61, 40)


def darkened(color, strength, start):
    """Return a picture, (H, W, 4) uint8, with darker corners: the slow twin."""
    height, width, _ = color.shape
    x = np.arange(width) + 0.5 - width / 2.0
    y = np.arange(height)[:, None] + 0.5 - height / 2.0
    radius = np.hypot(x, y) / np.hypot(width / 2.0, height / 2.0)
    t = np.clip((radius - start) / (1.0 - start), 0.0, 1.0)
    share = 1.0 - strength * t * t * (3.0 - 2.0 * t)
    light = srgb_to_linear(color[..., :3]) * share[..., None]
    return np.dstack([np.floor(255.0 * linear_to_srgb(light) + 0.5), color[..., 3]])


def shown(cube, camera, vignette=None, **options):
    scene = rj.Scene()
    scene.add(cube)
    scene.vignette = vignette
    options = {"size": SIZE, "background": (0.9, 0.4, 0.1, 0.5), "threads": 1, **options}
    return rj.render(scene, camera, **options)


@pytest.mark.parametrize(("strength", "start"), [(1.0, 0.0), (0.5, 0.3), (0.25, 0.9)])
def test_it_is_its_slow_twin(cube, camera, strength, start):
    plain, vignette = shown(cube, camera).color, rj.Vignette(strength, start)
    found = shown(cube, camera, vignette).color.astype(int)
    assert np.abs(found - darkened(plain, strength, start)).max() <= 1
    assert (found < plain).any()


@pytest.mark.parametrize("vignette", [rj.Vignette(0.0), rj.Vignette(0.5, 1.0)])
def test_what_darkens_nothing_is_left_out(cube, camera, vignette):
    assert not shown(cube, camera, vignette).plan.has("vignette")


@pytest.mark.parametrize("start", [0.0, 0.9])
def test_absent_is_neutral_bit_for_bit(cube, camera, start, monkeypatch):
    plain = shown(cube, camera).color
    monkeypatch.setattr(rj.Vignette, "is_neutral", False)
    frame = shown(cube, camera, rj.Vignette(0.0, start))
    assert frame.plan.has("vignette")
    assert np.array_equal(frame.color, plain)


def test_light_and_alpha_stay(cube, camera):
    outputs = ("color", "linear", "depth")
    plain = shown(cube, camera, outputs=outputs)
    frame = shown(cube, camera, rj.Vignette(1.0, 0.0), outputs=outputs)
    assert np.array_equal(frame.linear, plain.linear)
    assert np.array_equal(frame.depth, plain.depth)
    assert np.array_equal(frame.color[..., 3], plain.color[..., 3])


@pytest.mark.parametrize("samples", [4, "area", 64])
def test_any_way_of_sampling_is_darkened_alike(cube, camera, samples):
    quality = dataclasses.replace(rj.Quality.standard(), samples=samples)
    plain = shown(cube, camera, quality=quality).color
    found = shown(cube, camera, rj.Vignette(), quality=quality).color.astype(int)
    assert np.abs(found - darkened(plain, 0.5, 0.3)).max() <= 1


def test_threads_and_parts_give_the_bits_of_the_whole(cube, camera):
    scene = rj.Scene()
    scene.add(cube)
    scene.vignette = rj.Vignette(0.8, 0.1)
    whole = rj.render(scene, camera, size=(200, 150), threads=1).color
    assert np.array_equal(rj.render(scene, camera, size=(200, 150), threads=3).color, whole)
    from rasterjit.rendering.regions import RegionRenderer

    with RegionRenderer(scene, camera, size=(200, 150), threads=1) as renderer:
        part = renderer.render_region((128, 64, 72, 86)).color
    assert np.array_equal(part, whole[64:150, 128:200])


@pytest.mark.parametrize(("name", "value"), [("strength", 1.5), ("start", -0.1)])
def test_a_share_beyond_its_range_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        rj.Vignette(**{name: value})
