"""Faces mixed in 8-bit sRGB codes: each pixel as fractions say, whatever is mixed."""

from __future__ import annotations

import naive_codes
import naive_layers
import numpy as np
import pytest
from naive_layers import CAMERA, scene_of
from test_antialiasing import places
from test_layered import colors_of, meshes_of, reason, soup

import rasterjit as rj
from rasterjit.pipeline.fragments import fragment_bands, srgb_compositing
from rasterjit.rendering import supersample
from rasterjit.scene.color import srgb_to_linear

SIZE = (64, 32)

BACKGROUNDS = [(0.1, 0.2, 0.3, 1.0), (0.3, 0.2, 0.1, 0.25), (0, 0, 0, 0)]


def draw(meshes, samples=1, size=SIZE, background=BACKGROUNDS[0], **options):
    options = {"threads": 1, "outputs": ("color", "linear"), "blending": "srgb8", **options}
    quality = rj.Quality(samples=samples, blending=options.pop("blending"))
    scene = scene_of(meshes)
    scene.tone_map = options.pop("tone_map", None)
    return rj.render(scene, CAMERA, size=size, background=background, quality=quality, **options)


def twin(triangles, codes, is_blended, samples, background, size=SIZE):
    """Return the picture that the twin makes, (H, W, 4) uint8; codes are those of the faces."""
    codes = [
        code if blended else (*code[:3], 255)
        for code, blended in zip(codes, is_blended, strict=True)
    ]
    shown = np.empty((samples, size[1], size[0], 4), int)
    shown[:] = background
    centre, known = [naive_layers.CENTRE], {}
    for n, place in enumerate(centre if samples == 1 else places(samples)):
        stored = naive_layers.rounded_surfaces(triangles, size, place)
        for (column, row), found in stored.items():
            faces = tuple(naive_layers.seen_faces(found, is_blended))
            if faces not in known:
                known[faces] = naive_codes.laid([codes[f] for f in faces], background)
            shown[n, row, column] = known[faces]
    if samples == 1:
        return shown[0].astype(np.uint8)
    picture, means = np.empty((size[1], size[0], 4), np.uint8), {}
    for row, column in np.ndindex(*size[::-1]):
        here = tuple(tuple(code) for code in shown[:, row, column].tolist())
        if here not in means:
            # What is alike is not rounded again.
            means[here] = here[0] if len(set(here)) == 1 else naive_codes.mean(here)
        picture[row, column] = means[here]
    return picture


def frames_of(seed, count, samples, blended, background, size=SIZE, **options):
    """Return a frame of a soup of triangles and what the twin makes of it."""
    rng = np.random.default_rng(seed)
    triangles = soup(rng, count, size, 0.8)
    colors, is_blended = colors_of(rng, count, (0.1, 0.9)), rng.random(count) < blended
    meshes = meshes_of(triangles, colors, is_blended, size)
    frame = draw(meshes, samples, size, background, **options)
    codes = [naive_codes.coded(color) for color in colors.tolist()]
    coded = naive_codes.coded(background)
    return frame, twin(triangles, codes, is_blended, samples, coded, size)


@pytest.mark.parametrize("background", BACKGROUNDS)
def test_transparent_faces_are_laid_over_each_other_code_by_code(background):
    frame, want = frames_of(51, 16, 1, 0.8, background, (128, 64))
    np.testing.assert_array_equal(frame.color, want)


@pytest.mark.parametrize("background", BACKGROUNDS)
@pytest.mark.parametrize("samples", [2, 4, 16])
def test_samples_of_transparent_faces_are_averaged_code_by_code(samples, background):
    frame, want = frames_of(52, 14, samples, 0.7, background)
    np.testing.assert_array_equal(frame.color, want)


@pytest.mark.parametrize("background", BACKGROUNDS)
@pytest.mark.parametrize("samples", [2, 4, 8, 16])
def test_samples_of_opaque_faces_are_averaged_code_by_code(samples, background):
    frame, want = frames_of(53, 30, samples, 0.0, background, (256, 8))
    difference = np.abs(frame.color.astype(int) - want)
    if background[3] in (0.0, 1.0):
        assert not difference.any()
    # Shares of a partly transparent background are not whole: a tie may fall the other way.
    assert difference.max() <= 1
    assert (difference != 0).mean() < 0.03
    light = draw_in_light(53, 30, samples, background)
    assert (light.color != frame.color).any()


def draw_in_light(seed, count, samples, background):
    return frames_of(seed, count, samples, 0.0, background, (256, 8), blending="linear")[0]


def test_areas_are_averaged_code_by_code():
    rng, size, count = np.random.default_rng(54), (16, 8), 9
    triangles = soup(rng, count, size, 0.8)
    colors, is_blended = colors_of(rng, count), np.zeros(count, bool)
    frame = draw(meshes_of(triangles, colors, is_blended, size), "area", size)
    codes = [naive_codes.coded([*color[:3], 1.0]) for color in colors.tolist()]
    background = np.array(naive_codes.coded(BACKGROUNDS[0]))
    mixed = 0
    for row, column in np.ndindex(size[1], size[0]):
        shares = naive_layers.exact_shares(triangles, column, row)
        want = (1.0 - float(sum(shares.values()))) * background
        for face, share in shares.items():
            want = want + float(share) * np.array(codes[face])
        assert (np.abs(frame.color[row, column] - want) < 0.501).all()
        mixed += len(shares) > 1
    assert mixed > 20


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("curve", ["reinhard", "aces"])
def test_tones_of_every_colour_are_mapped_before_it_is_mixed(curve, samples):
    tone_map = rj.ToneMap(curve, exposure=0.5)
    rng, count = np.random.default_rng(55), 12
    triangles = soup(rng, count, SIZE, 0.8)
    colors, is_blended = colors_of(rng, count, (0.1, 0.9)), rng.random(count) < 0.7
    frame = draw(meshes_of(triangles, colors, is_blended, SIZE), samples, tone_map=tone_map)
    # The tones of one colour are those of a frame that shows nothing else.
    full = [[(-128, -64), (384, -64), (-128, 192)]] * count
    codes = []
    for points, color in zip(full, colors, strict=True):
        mesh = meshes_of([(points, np.zeros(3))], [color], [False], (128, 64))[0]
        alone = draw([mesh], 1, (128, 64), tone_map=tone_map).color[5, 5].tolist()
        codes.append((*alone[:3], naive_codes.coded(color)[3]))
    # The background is shown as it is.
    background = naive_codes.coded(BACKGROUNDS[0])
    want = twin(triangles, codes, is_blended, samples, background)
    np.testing.assert_array_equal(frame.color, want)


@pytest.mark.parametrize("samples", [1, 4, "area"])
@pytest.mark.parametrize("tone_map", [None, rj.ToneMap("aces")])
def test_linear_output_is_what_the_codes_stand_for(samples, tone_map):
    rng, count = np.random.default_rng(56), 10
    triangles = soup(rng, count, SIZE, 0.8)
    is_blended = np.zeros(count, bool) if samples == "area" else rng.random(count) < 0.7
    meshes = meshes_of(triangles, colors_of(rng, count), is_blended, SIZE)
    options = {"tone_map": tone_map, "background": BACKGROUNDS[1]}
    both = draw(meshes, samples, **options)
    np.testing.assert_array_equal(both.linear[..., :3], srgb_to_linear(both.color[..., :3]))
    alpha = both.color[..., 3].astype(np.float32) / np.float32(255.0)
    np.testing.assert_array_equal(both.linear[..., 3], alpha)
    # Each output alone is the same.
    for name in ("linear", "color"):
        alone = draw(meshes, samples, outputs=(name,), **options)
        assert alone.arrays()[name].tobytes() == both.arrays()[name].tobytes()


@pytest.mark.parametrize("samples", [1, 4])
def test_order_of_insertion_threads_and_bands_change_no_bit(samples, monkeypatch):
    rng, count, size = np.random.default_rng(57), 14, (128, 128)
    triangles = soup(rng, count, size)
    colors, is_blended = colors_of(rng, count), rng.random(count) < 0.8
    meshes = meshes_of(triangles, colors, is_blended, size)
    first = draw(meshes, samples, size)
    order = rng.permutation(count)
    assert draw([meshes[n] for n in order], samples, size).color.tobytes() == first.color.tobytes()
    assert draw(meshes, samples, size, threads=3).color.tobytes() == first.color.tobytes()
    monkeypatch.setattr(fragment_bands, "MAX_BYTES", size[0] * 8 * 40 * samples)
    assert draw(meshes, samples, size).color.tobytes() == first.color.tobytes()


def test_environment_behind_everything_is_mixed_in_codes():
    rng, count = np.random.default_rng(58), 8
    triangles = soup(rng, count, SIZE, 0.6)
    colors = colors_of(rng, count, (0.1, 0.9))
    for samples, is_blended in ((1, np.ones(count, bool)), (4, np.zeros(count, bool))):
        pictures = {}
        for shown in ("alone", "with"):
            meshes = meshes_of(triangles, colors, is_blended, SIZE)
            scene = scene_of(meshes if shown == "with" else meshes[:1])
            if shown == "alone":
                # Where this one is not.
                scene.nodes[0].world_from_model = rj.transforms.translate((50.0, 0.0, 0.0))
            scene.environment = rj.Environment.gradient()
            quality = rj.Quality(samples=samples, blending="srgb8")
            frame = rj.render(scene, CAMERA, size=SIZE, quality=quality, threads=1)
            pictures[shown] = frame.color
        sky, codes = pictures["alone"], [naive_codes.coded(c) for c in colors.tolist()]
        picture = np.empty_like(sky)
        where = [naive_layers.CENTRE] if samples == 1 else places(samples)
        surfaces = [naive_layers.rounded_surfaces(triangles, SIZE, place) for place in where]
        for row, column in np.ndindex(*SIZE[::-1]):
            shown = [each.get((column, row), []) for each in surfaces]
            background = tuple(sky[row, column].tolist())
            picture[row, column] = twin_of_pixel(shown, codes, is_blended, background)
        np.testing.assert_array_equal(pictures["with"], picture)


def twin_of_pixel(surfaces, codes, is_blended, background):
    """Return the codes that the twin gives to a pixel, of the surfaces at each of its samples."""
    shown = []
    for each in surfaces:
        faces = naive_layers.seen_faces(each, is_blended)
        own = [codes[f] if is_blended[f] else (*codes[f][:3], 255) for f in faces]
        shown.append(naive_codes.laid(own, background))
    return shown[0] if len(set(shown)) == 1 else naive_codes.mean(shown)


def test_alpha_1_is_opaque_and_alpha_0_is_nothing():
    rng, count = np.random.default_rng(59), 10
    triangles, colors = soup(rng, count, SIZE, 0.8), colors_of(rng, count)
    opaque = np.zeros(count, bool)
    plain = draw(meshes_of(triangles, colors, opaque, SIZE), outputs=("color",))
    # One face far off, with an alpha below 1, so that all of the mesh is blended.
    colors[:, 3] = 1.0
    veil = meshes_of(
        [([(0, 0), (64, 0), (0, 32)], [-0.95] * 3)], np.array([[1, 0, 0, 0.0]]), [True], SIZE
    )
    veiled = draw(meshes_of(triangles, colors, opaque, SIZE) + veil, outputs=("color",))
    assert veiled.plan.layers is not None
    assert plain.plan.layers is None
    assert veiled.color.tobytes() == plain.color.tobytes()


@pytest.mark.parametrize("outputs", [("color",), ("color", "linear"), ("depth", "color")])
def test_where_nothing_is_mixed_codes_change_nothing(cube, camera, monkeypatch, outputs):
    def refuse(*_):
        raise AssertionError("nothing is mixed")

    for name in ("composite_codes", "mark_hidden", "mix_codes", "decode_rows"):
        monkeypatch.setattr(srgb_compositing, name, refuse)
    scene = scene_of([cube])
    scene.tone_map = rj.ToneMap("aces")
    light, codes = (
        rj.render(
            scene, camera, size=(48, 32), outputs=outputs, threads=1,
            quality=rj.Quality(blending=blending),
        )
        for blending in ("linear", "srgb8")
    )  # fmt: skip
    assert codes.plan.layers is None
    assert str(codes.plan) == str(light.plan)
    for name in outputs:
        assert codes.arrays()[name].tobytes() == light.arrays()[name].tobytes()


def test_plan_says_that_codes_are_mixed(cube, camera):
    glass = rj.Mesh(
        cube.vertices, cube.faces,
        material=rj.Material("unlit", (1, 0, 0, 0.5), alpha_mode="blend"),
    )  # fmt: skip
    plan = rj.explain(scene_of([cube, glass]), camera, rj.Quality(blending="srgb8", samples=4))
    assert plan.layers.blends_srgb8
    assert reason(plan, "transparency") == (True, "1 blended object, mixed in 8-bit sRGB codes")
    assert reason(plan, "anti-aliasing")[1].endswith("face and pixel, mixed in 8-bit sRGB codes")
    plan = rj.explain(scene_of([cube, glass]), camera, rj.Quality(samples=4))
    assert not plan.layers.blends_srgb8
    assert "codes" not in str(plan)


def test_codes_are_darker_between_bright_and_dark_than_light_is():
    # Half white over black is 188 in light, 128 in codes: what old programs show.
    full = [[(-128, -64), (384, -64), (-128, 192)]]
    veil = meshes_of([(full[0], np.zeros(3))], np.array([[1, 1, 1, 0.5]]), [True], SIZE)
    for blending, want in (("linear", 188), ("srgb8", 128)):
        frame = draw(veil, background="black", outputs=("color",), blending=blending)
        assert (frame.color == (want, want, want, 255)).all()


def test_many_pictures_are_averaged_code_by_code():
    rng, size, count = np.random.default_rng(61), (16, 8), 9
    background = BACKGROUNDS[1]
    triangles = soup(rng, count, size, 0.8)
    colors, is_blended = colors_of(rng, count, (0.1, 0.9)), rng.random(count) < 0.6
    meshes = meshes_of(triangles, colors, is_blended, size)
    quality = rj.Quality(samples=64, blending="srgb8", subpixel_bits=12)
    tone_map = rj.ToneMap("reinhard")
    frame = draw_with(meshes, quality, size, background, tone_map)
    # Each picture alone, by a camera that is moved to its samples.
    sums = np.zeros((size[1], size[0], 4), int)
    one = rj.Quality(blending="srgb8", subpixel_bits=12)
    for x, y in supersample.sample_offsets(64):
        camera = supersample.MovedCamera(CAMERA, (x, y))
        moved = rj.MatrixCamera(camera.view_matrix(), camera.projection_matrix(size))
        codes = draw_with(meshes, one, size, background, tone_map, moved).color.astype(int)
        sums[..., :3] += codes[..., :3] * codes[..., 3:]
        sums[..., 3] += codes[..., 3]
    want = np.empty_like(sums)
    want[..., :3] = (2 * sums[..., :3] + sums[..., 3:]) // (2 * sums[..., 3:])
    want[..., 3] = (2 * sums[..., 3] + 64) // 128
    np.testing.assert_array_equal(frame.color, want)
    np.testing.assert_array_equal(frame.linear[..., :3], srgb_to_linear(frame.color[..., :3]))


def draw_with(meshes, quality, size, background, tone_map, camera=CAMERA):
    scene = scene_of(meshes)
    scene.tone_map = tone_map
    return rj.render(
        scene, camera, size=size, background=background, quality=quality, threads=1,
        outputs=("color", "linear"),
    )  # fmt: skip


def test_where_nothing_covers_a_pixel_the_mean_of_pictures_keeps_the_colour_behind():
    mesh = meshes_of([([(0, 0), (4, 0), (0, 4)], [0.0] * 3)], np.ones((1, 4)), [False], (16, 8))
    for behind, want in (((0, 0, 0, 0), (0, 0, 0, 0)), ((1, 0, 0, 0), (255, 0, 0, 0))):
        quality = rj.Quality(samples=64, blending="srgb8")
        frame = draw_with(mesh, quality, (16, 8), behind, None)
        assert tuple(frame.color[7, 15].tolist()) == want
        assert tuple(frame.color[0, 0].tolist()) == (255, 255, 255, 255)
