"""What alpha does to filtering: clear texels and holes have no colour, masks keep their share."""

from __future__ import annotations

from fractions import Fraction

import naive_textures as naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.scene.mip_levels import level_sizes

LEAF = (60, 200, 40)
CORNERS = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
SIDE = 64
ROWS, COLUMNS = np.mgrid[:SIDE, :SIDE]
DISC = (COLUMNS - 31.5) ** 2 + (ROWS - 31.5) ** 2 < 20**2
FILTERS = {
    "nearest": ("nearest", 1), "bilinear": ("bilinear", 1), "trilinear": ("trilinear", 1),
    "anisotropic": ("trilinear", 8),
}  # fmt: skip


def square(
    image, mode="mask", filter="trilinear", *, color="white", color_space="srgb", cutoff=0.5
):
    """Return the square [-1, 1]**2 that shows a picture."""
    kind, anisotropy = FILTERS[filter]
    texture = rj.Texture(image, filter=kind, anisotropy=anisotropy, color_space=color_space)
    material = rj.Material(
        "unlit", color, base_color_texture=texture, alpha_mode=mode, alpha_cutoff=cutoff
    )
    return rj.Mesh(CORNERS, [(0, 1, 2), (0, 2, 3)], uv=CORNERS[:, :2] / 2 + 0.5, material=material)


def seen(mesh, pixels, *, size=96, shift=(0.0, 0.0), tilt=0.0, **options):
    """Draw the square so that it is some pixels wide, moved by a part of a pixel, tilted."""
    step = 2.0 / pixels
    scene = rj.Scene()
    scene.add(mesh, rj.transforms.rotate((1, 0, 0), tilt))
    x, y = shift[0] * step, shift[1] * step
    camera = rj.OrthographicCamera((x, y, 5), (x, y, 0), height=step * size)
    return rj.render(scene, camera, size=(size, size), threads=1, **options)


def painted(shown, alpha, there=LEAF, clear=(255, 0, 255)):
    """Return a picture of one colour where it is there, another where it is not."""
    image = np.empty((*shown.shape, 4), np.uint8)
    image[..., :3] = np.where(shown[..., np.newaxis], there, clear)
    image[..., 3] = alpha
    return image


# A leaf over a wall of its own colour

CODES = 3
"""Codes that mixing and rounding twice may be off."""


@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("mode", ["blend", "mask"])
def test_a_leaf_over_its_own_colour_vanishes(mode, filter):
    mesh = square(painted(DISC, 255 * DISC), mode, filter)
    for pixels, tilt in ((260, 0), (64, 70), (20, 0), (6, 50)):
        for samples in (1, 4) if mode == "blend" else (1, 2, 16, "area"):
            quality = rj.Quality(samples=samples)
            frame = seen(mesh, pixels, tilt=tilt, background="#3cc828", quality=quality)
            assert np.abs(frame.color[..., :3].astype(int) - LEAF).max() <= CODES


@pytest.mark.parametrize("preset", ["draft", "standard", "high"])
@pytest.mark.parametrize("mode", ["blend", "mask"])
def test_a_leaf_vanishes_by_every_preset_and_factor(mode, preset):
    image = painted(DISC, 255 * DISC)
    for color_space, factor in (("srgb", (1, 1, 1, 0.8)), ("linear", (1, 1, 1, 1))):
        mesh = square(image, mode, color=factor, color_space=color_space)
        wall = (*(np.array(LEAF) / 255), 1.0) if color_space == "linear" else "#3cc828"
        frame = seen(mesh, 30, background=wall, quality=getattr(rj.Quality, preset)())
        corner = frame.color[0, 0, :3].astype(int)
        assert np.abs(frame.color[..., :3].astype(int) - corner).max() <= CODES


def test_a_kept_sample_never_shows_the_colour_of_a_hole():
    # Holes of a fifth of alpha are holes too: stripes as wide as half a pixel, a pixel, and more.
    for stripe in (1, 3):
        shown = COLUMNS // stripe % 2 == 0
        image = painted(shown, np.where(shown, 255, 51))
        for filter in FILTERS:
            for samples in (1, 2, 16, 64, "area"):
                quality = rj.Quality(samples=samples)
                frame = seen(
                    square(image, "mask", filter), 31.7, background="black", quality=quality
                )
                red, green, blue = np.moveaxis(frame.color[..., :3].astype(int), -1, 0)
                assert (blue <= green).all()
                assert (red <= green).all()


# Where nothing is to be done


@pytest.mark.parametrize("filter", FILTERS)
def test_opaque_pictures_have_the_bits_of_pictures_without_alpha(filter):
    image = np.random.default_rng(1).integers(0, 256, (SIDE, SIDE, 4), np.uint8)
    image[..., 3] = 255
    for mode in ("opaque", "blend", "mask"):
        for pixels in (200, 30):
            shown = [
                seen(square(one, mode, filter), pixels, outputs=("linear", "depth"))
                for one in (image, image[..., :3])
            ]
            assert shown[0].linear.tobytes() == shown[1].linear.tobytes()
            assert shown[0].depth.tobytes() == shown[1].depth.tobytes()


def test_an_opaque_material_shows_the_colours_of_clear_texels():
    image = painted(DISC, 255 * DISC)
    opaque, plain = (square(one, "opaque") for one in (image, image[..., :3]))
    for pixels in (200, 30):
        one, other = (seen(mesh, pixels, outputs="linear").linear for mesh in (opaque, plain))
        assert one.tobytes() == other.tobytes()


def test_alpha_of_other_textures_than_that_of_base_colours_weighs_nothing():
    light = painted(DISC, 255 * DISC)
    frames = []
    for image in (light, light[..., :3]):
        mesh = square(painted(DISC, 255 * DISC), "blend")
        mesh.material = rj.Material(
            "pbr", base_color_texture=mesh.material.base_color_texture, alpha_mode="blend",
            emissive="white", emissive_texture=rj.Texture(image),
        )  # fmt: skip
        frames.append(seen(mesh, 20, outputs="linear").linear)
    assert frames[0].tobytes() == frames[1].tobytes()


# The twin of what is weighted by alpha


@pytest.mark.parametrize("filter", ["bilinear", "trilinear"])
def test_weighted_texels_equal_the_exact_twin(filter):
    rng = np.random.default_rng(2)
    image = rng.random((8, 8, 4)).astype(np.float32)
    image[..., 3] *= rng.random((8, 8)) < 0.6
    size = 5 if filter == "trilinear" else 23
    shown = seen(
        square(image, "blend", filter), size, size=size, outputs="linear", background="transparent"
    ).linear
    alphas, detail = naive.exact_image(image[..., 3]), float(np.log2(8 / size))
    chains = [alphas]
    for k in range(3):
        channel = naive.exact_image(image[..., k])
        chains.append(
            [
                [color * alpha for color, alpha in zip(*two, strict=True)]
                for two in zip(channel, alphas, strict=True)
            ]
        )
    chains = [naive.mip_chain(chain) for chain in chains]
    for row in range(size):
        for column in range(size):
            u, v = Fraction(2 * column + 1, 2 * size), 1 - Fraction(2 * row + 1, 2 * size)
            alpha, *color = (
                naive.bilinear(chain[0], u, v, ("repeat", "repeat"))
                if filter == "bilinear"
                else naive.trilinear(chain, u, v, ("repeat", "repeat"), detail)
                for chain in chains
            )
            assert abs(shown[row, column, 3] - float(alpha)) < 1e-5
            if alpha > Fraction(1, 1000):
                straight = [float(part / alpha) for part in color]
                assert np.abs(shown[row, column, :3] - straight).max() < 1e-3


# Masks


def far_masks():
    """Return masks of different kinds: chance, a fence whose levels are even, a crown, lines."""
    rng = np.random.default_rng(3)
    rows, columns = np.mgrid[:256, :256]
    cells = [np.kron(rng.random((64, 64)) < share, np.ones((4, 4))) > 0 for share in (0.2, 0.8)]
    fence = ((rows + columns) % 16 < 3) | ((rows - columns) % 16 < 3)
    crown = (
        np.kron(rng.random((64, 64)), np.ones((4, 4))) > np.hypot(rows - 128, columns - 128) / 128
    )
    return {"sparse": cells[0], "dense": cells[1], "fence": fence, "crown": crown,
            "lines": columns % 8 < 2}  # fmt: skip


@pytest.mark.parametrize("filter", ["trilinear", "anisotropic"])
@pytest.mark.parametrize("kind", far_masks())
def test_a_mask_keeps_its_share_however_far_it_is(kind, filter):
    shown = far_masks()[kind]
    cutoff = 0.3 if filter == "trilinear" else 0.9
    mesh = square(painted(shown, 255 * shown), filter=filter, cutoff=cutoff)
    for pixels, off in ((128, 0.05), (90, 0.1), (64, 0.1), (32, 0.12), (16, 0.2), (8, 0.5)):
        found = [
            seen(mesh, pixels, size=pixels + 8, shift=shift, outputs="coverage").coverage.sum()
            for shift in ((0, 0), (0.3, 0.6))
        ]
        assert np.abs(np.array(found) / pixels**2 / shown.mean() - 1.0).max() < off, pixels


def test_a_mask_from_far_is_what_256_samples_show():
    shown = far_masks()["crown"]
    mesh = square(painted(shown, 255 * shown))
    for pixels in (64, 32, 16):
        few, many = (
            seen(mesh, pixels, size=72, outputs="linear", background="transparent",
                 quality=rj.Quality(samples=samples)).linear[..., 3]
            for samples in (16, 256)
        )  # fmt: skip
        assert abs(few.sum() / many.sum() - 1.0) < 0.02
        # Pixel by pixel: the noise of 16 samples, and texels as large as pixels that are mixed.
        assert np.sqrt(((few - many) ** 2).mean()) < 0.2


def test_one_picture_with_two_cutoffs_keeps_two_shares():
    levels = np.random.default_rng(4).random((64, 64))
    image = painted(levels > 0, (255 * np.kron(levels, np.ones((4, 4)))).astype(int)[:64, :64])
    image = np.kron(image[:64, :64], np.ones((4, 4, 1), np.uint8))
    texture = rj.Texture(image)
    scene = rj.Scene()
    for n, cutoff in enumerate((0.25, 0.75)):
        material = rj.Material(
            "unlit", base_color_texture=texture, alpha_mode="mask", alpha_cutoff=cutoff
        )
        mesh = rj.Mesh(
            CORNERS, [(0, 1, 2), (0, 2, 3)], uv=CORNERS[:, :2] / 2 + 0.5, material=material
        )
        scene.add(mesh, rj.transforms.translate((2 * n - 1, 0, 0)))
    camera = rj.OrthographicCamera((0, 0, 5), (0, 0, 0), height=2.0)
    frame = rj.render(scene, camera, size=(128, 64), outputs="object_id", threads=1)
    for n, cutoff in enumerate((0.25, 0.75)):
        share = (image[..., 3] >= 255 * cutoff).mean()
        assert abs((frame.object_id == n).sum() / 64**2 / share - 1.0) < 0.05
    assert "levels keep the share of alpha from 0.25 on" in str(rj.explain(scene, camera))


def test_the_factors_alpha_counts_with_the_cutoff():
    # Of texels from 0 to 1 a cutoff of .4 and a factor of .5 keep those from .8 on.
    alphas = np.random.default_rng(5).integers(0, 256, (256, 256))
    mesh = square(painted(alphas >= 0, alphas), color=(1, 1, 1, 0.5), cutoff=0.4)
    share = (alphas >= 0.8 * 255).mean()
    for pixels in (128, 64, 32):
        found = seen(mesh, pixels, size=136, outputs="coverage").coverage.sum() / pixels**2
        assert abs(found / share - 1.0) < 0.1


def test_colour_depth_ids_and_shadows_have_the_same_holes():
    shown = far_masks()["crown"]
    mesh = square(painted(shown, 255 * shown))
    outputs = "color", "depth", "face_id", "normal", "coverage"
    frame = seen(mesh, 24, outputs=outputs, background="transparent")
    there = frame.face_id >= 0
    assert 0.2 < there.sum() / 24**2 < 0.6
    assert (np.isfinite(frame.depth) == there).all()
    assert ((frame.color[..., 3] > 0) == there).all()
    assert ((frame.coverage > 0) == there).all()
    # The shadow of the far crown on a floor behind it is as dark as its share.
    scene = rj.Scene()
    scene.add(mesh)
    scene.add(
        rj.Mesh(4 * CORNERS - (0, 0, 1), [(0, 1, 2), (0, 2, 3)], material=rj.Material("flat"))
    )
    scene.lights.append(rj.DirectionalLight(direction=(0.001, 0, -1), shadow=rj.Shadow(size=64)))
    camera = rj.OrthographicCamera((0, 0, -0.5), (0, 0, -1), height=8.0)
    lit = rj.render(scene, camera, size=(96, 96), outputs="linear", threads=1).linear[..., 0]
    dark = (1.0 - lit / lit.max()).sum() / 24**2
    assert abs(dark / shown.mean() - 1.0) < 0.2


def test_levels_of_a_mask_hold_shares_and_no_colour_of_a_hole():
    rng = np.random.default_rng(6)
    for width, height in ((8, 8), (7, 5), (1, 6)):
        alphas = rng.random((height, width)).astype(np.float32)
        there = alphas >= 0.5
        there[0, 0] = True
        alphas[0, 0] = 0.9
        image = np.empty((height, width, 4), np.float32)
        image[...] = np.where(there[..., np.newaxis], (0.1, 0.9, 0.2, 0), (5, 5, 5, 0))
        image[..., 3] = alphas
        texels = rj.Texture(image).pyramid.prepare_chain(0.5, True)
        exact = naive.mip_chain(naive.exact_image(there))
        start = 0
        for level, (columns, rows) in enumerate(level_sizes(width, height)):
            own = texels[start : start + columns * rows].reshape(rows, columns, 4)
            start += columns * rows
            assert np.allclose(own[..., :3], (0.1, 0.9, 0.2), rtol=0, atol=1e-6)
            want = alphas if level == 0 else np.array(exact[level], float)
            assert np.allclose(own[..., 3], want, rtol=0, atol=1e-6)
