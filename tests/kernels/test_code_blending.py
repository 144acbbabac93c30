"""Codes laid over each other and averaged: as fractions say, rounded half up."""

from __future__ import annotations

import naive_codes
import numpy as np
import pytest

from rasterjit.pipeline.fragments import srgb_compositing
from rasterjit.scene.color import decoding_table


def packed(codes):
    """Return pixels (...) uint32 of codes (..., 4)."""
    return np.ascontiguousarray(codes, np.uint8).view(np.uint32)[..., 0]


def unpacked(color):
    """Return the codes, as tuples, of a row of pixels."""
    return [tuple(code) for code in color.reshape(-1, 1).view(np.uint8).tolist()]


def lay(layers, background):
    """Lay rows of codes, (K, W, 4), the nearest first, over a row of them, (W, 4)."""
    stack = packed(np.concatenate([layers, [background]]))[:, np.newaxis]
    color = np.empty(stack.shape[1:], np.uint32)
    srgb_compositing.composite_codes(stack, color)
    return unpacked(color)


def random_codes(rng, *shape):
    """Return random codes, (..., 4), many of them clear or opaque."""
    codes = rng.integers(0, 256, (*shape, 4))
    alpha = rng.choice([0, 255, 1, 254, 128, -1], shape)
    codes[..., 3] = np.where(alpha < 0, codes[..., 3], alpha)
    return codes


@pytest.mark.parametrize("under", ["opaque", "any"])
def test_every_layer_is_laid_over_and_rounded_half_up(under):
    rng = np.random.default_rng(81)
    for levels in (0, 1, 2, 5):
        layers, background = random_codes(rng, levels, 150), random_codes(rng, 150)
        if under == "opaque":
            background[:, 3] = 255
        want = [
            naive_codes.laid(
                [tuple(code) for code in layers[:, i].tolist()], tuple(background[i].tolist())
            )
            for i in range(150)
        ]
        assert lay(layers, background) == want


@pytest.mark.needs_jit
def test_every_alpha_mixes_every_code_exactly():
    codes, alphas = (axis.ravel() for axis in np.meshgrid(np.arange(256), np.arange(256)))
    for other in (0, 1, 100, 255):
        layers = np.stack([codes, codes, codes, alphas], axis=1)[np.newaxis]
        background = np.full((len(codes), 4), (other, other, other, 255))
        have = np.array(lay(layers, background))[:, 0]
        exact = codes * alphas + other * (255 - alphas)
        np.testing.assert_array_equal(have, (2 * exact + 255) // 510)


def test_alpha_0_and_alpha_255_leave_every_bit():
    rng = np.random.default_rng(82)
    clear, color, background = random_codes(rng, 3, 60)
    clear[:, 3], color[:, 3] = 0, 255
    everything = [tuple(code) for code in background.tolist()]
    assert lay(np.array([clear, clear]), background) == everything
    assert lay(np.array([clear, color, clear]), background) == [tuple(c) for c in color.tolist()]


def test_nothing_behind_alpha_255_is_shaded_and_nobody_sees_the_difference():
    rng = np.random.default_rng(83)
    layers, background = random_codes(rng, 4, 200), random_codes(rng, 200)
    stack = packed(np.concatenate([layers, [background]]))[:, np.newaxis]
    want, have = np.empty((2, 1, 200), np.uint32)
    srgb_compositing.composite_codes(stack, want)
    hidden = np.zeros((4, 200), bool)
    for level in range(4):
        behind = np.zeros((1, 200), np.int32)
        srgb_compositing.mark_hidden(stack, level, behind)
        hidden[level] = behind[0] < 0
    np.testing.assert_array_equal(hidden, np.cumsum(layers[..., 3] == 255, axis=0) > 0)
    # What is hidden is not shaded: anything may be there.
    srgb_compositing.composite_codes(stack, have)
    np.testing.assert_array_equal(have, want)


@pytest.mark.parametrize("samples", [2, 4, 8, 16])
def test_samples_are_averaged_and_rounded_half_up(samples):
    rng = np.random.default_rng(84)
    width, faces, levels = 120, 5, 3
    colors, behind = random_codes(rng, faces, width), random_codes(rng, width)
    opaque = rng.integers(-1, faces, (samples, 1, width)).astype(np.int32)
    transparent = rng.integers(-1, faces, (samples, levels, 1, width)).astype(np.int32)
    # In some pixels all samples are alike.
    opaque[:, :, :20], transparent[:, :, :, :20] = opaque[:1, :, :20], transparent[:1, :, :, :20]
    colors[..., 3] = np.where(rng.random((faces, width)) < 0.5, 255, colors[..., 3])
    color = np.empty((1, width), np.uint32)
    srgb_compositing.mix_codes(
        opaque, transparent, packed(colors)[:, np.newaxis], packed(behind)[np.newaxis], color
    )
    for i, have in enumerate(unpacked(color)):
        shown = []
        for n in range(samples):
            seen = behind[i] if opaque[n, 0, i] < 0 else colors[opaque[n, 0, i], i]
            own = [tuple(colors[f, i].tolist()) for f in transparent[n, :, 0, i] if f >= 0]
            shown.append(naive_codes.laid(own, tuple(seen.tolist())))
        assert have == (shown[0] if i < 20 else naive_codes.mean(shown)), i


def test_codes_stand_for_light():
    codes = np.arange(256)
    pixels = packed(np.stack([codes, codes[::-1], codes, codes], axis=1))[np.newaxis]
    linear = np.empty((1, 256, 4), np.float32)
    srgb_compositing.decode_rows(pixels, decoding_table().copy(), linear)
    np.testing.assert_array_equal(linear[0, :, 0], decoding_table())
    np.testing.assert_array_equal(linear[0, :, 1], decoding_table()[::-1])
    np.testing.assert_array_equal(linear[0, :, 3], (codes / 255.0).astype(np.float32))
