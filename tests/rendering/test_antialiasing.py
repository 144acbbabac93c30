"""Several samples of each pixel: exact coverage and depth at each, mixed in linear light."""

from __future__ import annotations

from fractions import Fraction
from functools import partial

import naive_layers
import numpy as np
import pytest
from naive_layers import CAMERA, mesh_of, scene_of
from test_layered import BACKGROUNDS, colors_of, meshes_of, reason, soup

import rasterjit as rj
from rasterjit.accuracy import test_scenes
from rasterjit.pipeline import srgb_encoding
from rasterjit.pipeline.fragments import a_buffer, fragment_bands

SIZE = (64, 32)
SAMPLES = (2, 4, 8, 16)

# The pictures of the specifications: x to the right and y down, in sixteenths from the upper left.
PLACES = {
    2: [(12, 12), (4, 4)],
    4: [(6, 2), (14, 6), (2, 10), (10, 14)],
    8: [(9, 5), (7, 11), (13, 9), (5, 3), (3, 13), (1, 7), (11, 15), (15, 1)],
    16: [
        (9, 9), (7, 5), (5, 10), (12, 7), (3, 6), (10, 13), (13, 11), (11, 3),
        (6, 14), (8, 1), (4, 2), (2, 12), (0, 8), (15, 4), (14, 15), (1, 0),
    ],
}  # fmt: skip


def places(samples):
    return [(Fraction(x, 16), Fraction(y, 16)) for x, y in PLACES[samples]]


def draw(meshes, samples, size=SIZE, background=(0.1, 0.2, 0.3, 1.0), **options):
    options = {"threads": 1, "outputs": ("linear",), **options}
    quality = rj.Quality(samples=samples, subpixel_bits=options.pop("subpixel_bits", 8))
    return rj.render(
        scene_of(meshes), CAMERA, size=size, background=background, quality=quality, **options
    )


def surfaces_of(triangles, samples, size=SIZE):
    """Return what each sample sees by the stored depths: a dict of its pixels' surfaces."""
    found = []
    for place in places(samples):
        exact = naive_layers.exact_surfaces(triangles, size, place)
        stored = naive_layers.rounded_surfaces(triangles, size, place)
        assert exact.keys() == stored.keys()
        for pixel, surfaces in stored.items():
            if [face for _, face in surfaces] != [face for _, face in exact[pixel]]:
                assert len({depth for depth, _ in surfaces}) < len(surfaces), "no tie of depths"
        found.append(stored)
    return found


def expected(surfaces, colors, is_blended, background, size=SIZE):
    """Return the mean of what the samples show, (H, W, 4) float64."""
    opaque = np.array([[*color[:3], color[3] if blended else 1.0]
                       for color, blended in zip(colors, is_blended, strict=True)])  # fmt: skip
    seen = partial(naive_layers.seen_faces, is_blended=is_blended)
    shown = [naive_layers.picture(each, seen, opaque, background, size) for each in surfaces]
    return naive_layers.mean(np.stack(shown, axis=2))


@pytest.mark.parametrize("samples", SAMPLES)
def test_opaque_faces_have_the_shares_of_the_samples_that_show_them(samples):
    rng = np.random.default_rng(71)
    count = 14
    triangles = soup(rng, count, SIZE, 0.8) + soup(rng, 10, SIZE, 0.51)
    # Small ones and slivers, that fall between the centres.
    small = [((rng.uniform(0, 1, 2) * SIZE + rng.uniform(-1, 1, (3, 2))), [0.0, 0.1, -0.9])
             for _ in range(20)]  # fmt: skip
    triangles += [((np.round(p * 256) / 256).tolist(), np.array(z)) for p, z in small]
    colors, is_blended = colors_of(rng, len(triangles)), np.zeros(len(triangles), bool)
    meshes = meshes_of(triangles, colors, is_blended, SIZE)
    surfaces = surfaces_of(triangles, samples)
    for background in BACKGROUNDS:
        have = draw(meshes, samples, background=background)
        want = expected(surfaces, colors, is_blended, background)
        np.testing.assert_allclose(have.linear, want, rtol=0, atol=2e-6)


@pytest.mark.parametrize("samples", [4, 16])
def test_rows_of_several_parts_are_mixed_and_encoded_like_short_ones(samples):
    # Rows are mixed in parts of 128 columns.
    rng, size, background = np.random.default_rng(73), (512, 2), (0.3, 0.2, 0.1, 0.25)
    triangles = soup(rng, 12, size, 0.8)
    for _ in range(240):
        points = rng.uniform(0, 1, 2) * size + rng.uniform(-2, 2, (3, 2))
        triangles.append(((np.round(points * 256) / 256).tolist(), np.full(3, rng.uniform(0, 0.9))))
    colors, is_blended = colors_of(rng, len(triangles)), np.zeros(len(triangles), bool)
    meshes = meshes_of(triangles, colors, is_blended, size)
    options = {"size": size, "background": background}
    both = draw(meshes, samples, outputs=("linear", "color"), **options)
    surfaces = surfaces_of(triangles, samples, size)
    want = expected(surfaces, colors, is_blended, background, size)
    np.testing.assert_allclose(both.linear, want, rtol=0, atol=2e-6)
    mixed = np.abs(both.linear - np.float32(background)).max(axis=2) > 1e-4
    assert all(mixed[:, first : first + 128].sum() > 20 for first in range(0, 512, 128))
    codes = np.searchsorted(
        srgb_encoding.find_code_thresholds(), both.linear[:, :, :3], side="right"
    )
    assert (both.color[:, :, :3] == codes).all()
    assert (both.color[:, :, 3] == np.floor(255.0 * both.linear[:, :, 3].astype(float) + 0.5)).all()
    alone = draw(meshes, samples, outputs=("color",), **options)
    assert alone.color.tobytes() == both.color.tobytes()


@pytest.mark.parametrize("samples", [2, 4, 16])
def test_every_sample_sorts_its_own_transparent_faces(samples):
    rng = np.random.default_rng(72)
    count = 12
    triangles = soup(rng, count, SIZE, 1.0)
    colors, is_blended = colors_of(rng, count, (0.1, 0.9)), rng.random(count) < 0.8
    meshes = meshes_of(triangles, colors, is_blended, SIZE)
    surfaces, order = surfaces_of(triangles, samples), rng.permutation(count)
    for background in BACKGROUNDS[:2]:
        have = draw(meshes, samples, background=background)
        want = expected(surfaces, colors, is_blended, background)
        np.testing.assert_allclose(have.linear, want, rtol=0, atol=4e-6)
        again = draw([meshes[n] for n in order], samples, background=background)
        # The faces of a pixel are numbered anew, but each sample lays them in the same order.
        assert again.linear.tobytes() == have.linear.tobytes()


@pytest.mark.parametrize("bits", [4, 8, 12])
def test_samples_lie_at_their_places_on_every_grid(bits):
    # A straight edge, moved through a pixel: how many samples are left of it.
    for edge in range(17):
        points = [(-64, -64), (edge / 16 + 3, -64), (edge / 16 + 3, 128), (-64, 128)]
        plain = mesh_of(points[:3], [0.0] * 3, SIZE, base_color="white")
        other = mesh_of([points[0], points[2], points[3]], [0.0] * 3, SIZE, base_color="white")
        for samples in SAMPLES:
            have = draw([plain, other], samples, background="black", subpixel_bits=bits)
            # A left edge is in; one on the right is not.
            count = sum(x < edge for x, _ in PLACES[samples])
            assert have.linear[5, 3, 0] == np.float32(count / samples), (edge, samples)


def test_pixels_of_one_face_and_of_none_keep_their_bits(cube, sphere, camera):
    scene = scene_of([cube, rj.Mesh(sphere.vertices * 1.3, sphere.faces)])
    options = dict(size=(70, 50), background=(0.3, 0.1, 0.7, 0.4), outputs=("linear", "color"))
    one = rj.render(scene, camera, threads=1, **options)
    shown = [rj.render(scene, camera, size=(70 * 16, 50 * 16), outputs=("face_id",)).face_id]
    blocks = shown[0].reshape(50, 16, 70, 16).transpose(0, 2, 1, 3).reshape(50, 70, -1)
    # Neighbours included: samples of the large picture lie elsewhere.
    plain = (blocks == blocks[:, :, :1]).all(axis=2)
    assert plain.sum() > 1500
    assert (~plain).sum() > 500
    for samples in SAMPLES:
        many = rj.render(scene, camera, quality=rj.Quality(samples=samples), **options)
        assert many.linear[plain].tobytes() == one.linear[plain].tobytes()
        assert many.color[plain].tobytes() == one.color[plain].tobytes()
        assert (many.linear[~plain] != one.linear[~plain]).any(axis=1).mean() > 0.3


def test_labels_and_buffers_are_never_mixed(cube, camera):
    uv = np.zeros((len(cube.vertices), 2))
    mesh = rj.Mesh(cube.vertices, cube.faces, uv=uv)
    outputs = ("depth", "face_id", "object_id", "barycentric", "uv", "normal", "position")
    one = rj.render(mesh, camera, size=(50, 40), outputs=outputs)
    many = rj.render(
        mesh, camera, size=(50, 40), outputs=(*outputs, "color"), quality=rj.Quality(samples=8)
    )
    for name in outputs:
        assert many.arrays()[name].tobytes() == one.arrays()[name].tobytes(), name
    assert many.stats.pixels_covered == one.stats.pixels_covered


def test_no_colour_leaves_the_range_of_its_face():
    # Slivers with strong gradients: their pixels' centres lie far beside them.
    rng = np.random.default_rng(73)
    meshes = []
    for n in range(60):
        start, along = rng.uniform(0, 1, 2) * SIZE, rng.uniform(-30, 30, 2)
        points = np.stack([start, start + along, start + 0.5 * along + rng.uniform(-0.2, 0.2, 2)])
        points = np.round(points * 256) / 256
        low, high = sorted(rng.uniform(0.2, 0.8, 2))
        colors = np.ones((3, 4))
        colors[:, 0] = rng.uniform(low, high, 3)
        colors[0, 0], colors[1, 0], colors[:, 1] = low, high, 0.0
        plain = mesh_of(points, [-0.8 + 0.01 * n] * 3, SIZE)
        meshes.append(rj.Mesh(plain.vertices, plain.faces, colors=colors, material=rj.Material(
            "unlit", "white")))  # fmt: skip
        # Alone, over black: what is seen, divided by its share, is one of its own colours.
        seen = draw(meshes[-1:], 8, background=(0, 0, 0, 0)).linear
        red = seen[..., 0][seen[..., 3] > 0.0]
        assert (red >= np.float32(low) * 0.9999).all()
        assert (red <= np.float32(high) * 1.0001).all()


def test_slivers_in_perspective_give_no_nan(sphere):
    # A ground that reaches the horizon, and a textured, shiny ball, seen from nearby.
    texture = rj.Texture(np.random.default_rng(74).random((16, 16, 3)).astype(np.float32))
    ground = rj.Mesh(
        [[-900, -1, 1], [900, -1, 1], [900, -1, -9e5], [-900, -1, -9e5]], [[0, 1, 2], [0, 2, 3]],
        uv=[[0, 0], [900, 0], [900, 9e4], [0, 9e4]],
        material=rj.Material("phong", base_color_texture=texture),
    )  # fmt: skip
    camera = rj.PerspectiveCamera(eye=(0, 0, 2.5), target=(0, 0, 0), near=0.01)
    scene = scene_of([ground, sphere])
    for samples in (4, 16):
        frame = rj.render(
            scene, camera, size=(90, 60), quality=rj.Quality(samples=samples), outputs=("linear",)
        )
        assert np.isfinite(frame.linear).all()
        assert (frame.linear[..., 3] == 1.0).all()


@pytest.mark.parametrize("mode", ["opaque", "blend"])
def test_threads_and_sizes_change_no_bit(mode):
    rng = np.random.default_rng(75)
    meshes = [
        rj.Mesh(
            rng.uniform(-1.3, 1.3, (3, 3)), [[0, 1, 2]],
            material=rj.Material("unlit", rng.uniform(0, 1, 4), alpha_mode=mode),
        )
        for _ in range(10)
    ]  # fmt: skip
    for size in ((1, 1), (65, 130), (131, 7)):
        both = ("linear", "color")
        one = draw(meshes, 4, size, outputs=both)
        other = draw(meshes, 4, size, outputs=both, threads=3)
        assert one.linear.tobytes() == other.linear.tobytes()
        assert one.color.tobytes() == other.color.tobytes()
        assert draw(meshes, 4, size, outputs=("color",)).color.tobytes() == one.color.tobytes()


def test_holes_are_there_for_every_sample():
    image = np.ones((1, 2, 4), np.float32)
    image[0, 0, 3] = 0.0
    texture = rj.Texture(image, filter="nearest")
    points = [(-64, -64), (192, -64), (-64, 192)]
    plain = mesh_of(points, [0.0] * 3, SIZE)
    # The left half of the picture shows the left texel, which is a hole.
    uv = [(x / SIZE[0], 0.5) for x, _ in points]
    leaf = rj.Mesh(plain.vertices, plain.faces, uv=uv, material=rj.Material(
        "unlit", base_color_texture=texture, alpha_mode="mask"))  # fmt: skip
    veil = mesh_of(points, [-0.5] * 3, SIZE, base_color=(1, 0, 0, 0.5), alpha_mode="blend")
    for meshes, red in (([leaf], (0.0, 1.0)), ([leaf, veil], (0.5, 1.0))):
        for samples in (1, 4):
            seen = draw(meshes, samples, background="black").linear[..., 0]
            assert (seen[:, :32] == red[0]).all()
            assert (seen[:, 32:] == red[1]).all()


@pytest.mark.parametrize(("samples", "edge"), [(1, {1.0}), (4, {0.75}), ("area", {1.0})])
def test_edges_of_holes_are_as_soft_as_the_samples_and_hard_with_areas(samples, edge):
    image = np.ones((1, 2, 4), np.float32)
    image[0, 0, 3] = 0.0
    texture = rj.Texture(image, filter="nearest", wrap="clamp")
    points = [(-16, -16), (48, -16), (-16, 48)]
    plain = mesh_of(points, [0.0] * 3, (16, 16))
    # The hole ends in column 8, a quarter of a pixel behind its left edge.
    uv = [((x - 0.25) / 16, 0.5) for x, _ in points]
    leaf = rj.Mesh(plain.vertices, plain.faces, uv=uv, material=rj.Material(
        "unlit", base_color_texture=texture, alpha_mode="mask"))  # fmt: skip
    seen = draw([leaf], samples, (16, 16), background="black").linear[..., 0]
    assert (seen[:, :8] == 0.0).all()
    assert set(seen[:, 8].tolist()) == edge
    assert (seen[:, 9:] == 1.0).all()


def test_more_layers_than_fit_are_an_error(monkeypatch):
    monkeypatch.setattr(fragment_bands, "MAX_LAYERS", 3)
    veils = [mesh_of([(0, 0), (64, 0), (0, 64)], [0.1 * n] * 3, SIZE, base_color=(1, 0, 0, 0.5),
                     alpha_mode="blend") for n in range(4)]  # fmt: skip
    assert draw(veils[:3], 4).linear.any()
    with pytest.raises(ValueError, match=r"4 transparent surfaces .* with 4 samples"):
        draw(veils, 4)


@pytest.mark.parametrize("samples", [0, 3, 32, -4, "areas", None, 2.5])
def test_wrong_number_of_samples_is_an_error(samples):
    with pytest.raises(ValueError, match="samples must be"):
        rj.Quality(samples=samples)


def test_samples_need_a_finer_grid_than_whole_pixels():
    with pytest.raises(ValueError, match="samples must be 1 where subpixel_bits is 0, got 4"):
        rj.Quality(subpixel_bits=0, samples=4)
    assert rj.Quality(subpixel_bits=0).samples == 1


def test_plan_says_why_edges_are_smoothed(cube, camera, monkeypatch):
    four = rj.Quality(samples=4)
    assert reason(rj.explain(cube, camera), "anti-aliasing") == (False, "quality.samples is 1")
    assert reason(rj.explain(cube, camera, four), "anti-aliasing") == (
        True, "4 samples a pixel, shaded once per face and pixel",
    )  # fmt: skip
    plan = rj.explain(cube, camera, four, outputs=("depth",))
    assert plan.layers is None
    assert reason(plan, "anti-aliasing") == (False, "nothing is shaded")

    def refuse(*_):
        raise AssertionError("there is nothing to smooth")

    monkeypatch.setattr(a_buffer, "find_layers", refuse)
    options = dict(size=(20, 20), quality=four, outputs=("depth",))
    assert np.isfinite(rj.render(cube, camera, **options).depth).any()


def test_slivers_are_shaded_near_the_pixels_that_show_them():
    """A sliver's ends are far from most of its pixels, and have another hue."""
    made = test_scenes.make("slivers")
    one, several, best = (
        rj.render(
            made.scene, made.camera, size=(96, 72), outputs=("linear",), quality=quality
        ).linear
        for quality in (
            rj.Quality(subpixel_bits=12),
            rj.Quality(subpixel_bits=12, samples=8),
            rj.Quality.reference(),
        )
    )
    error, errors = ((frame - best)[:, :, :3].std() for frame in (one, several))
    assert errors < 0.6 * error
