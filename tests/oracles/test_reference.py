"""
The reference is right: its faces, its shadows, and the light that it adds up.

Its faces are held against exact arithmetic at every one of its samples, and against Embree's rays;
its shadows against Embree's; and what it shows of edges, colours and textures against integrals
that are known, which the error to falls as samples are added.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace

import naive_layers
import numpy as np
import pytest
from test_against_embree import (
    CAMERAS,
    NEAR_EDGE,
    SIZE,
    distance_to_edges,
    make_scene,
    make_view,
    trace,
    world_triangles,
)

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.rendering.supersample import MovedCamera, sample_offsets

REFERENCE = rj.Quality.reference()
PICTURE = replace(REFERENCE, samples=1)
"""One of the pictures that the reference is the mean of."""
SIDE = 16
"""Samples lie on a grid of so many a side."""


def every_face(scene, camera, size):
    """Return the face at each sample of each pixel, (H * SIDE, W * SIDE), in their places."""
    found = np.empty((size[1] * SIDE, size[0] * SIDE), np.int32)
    with rj.Renderer(size, quality=PICTURE, threads=1) as renderer:
        for x, y in sample_offsets(SIDE * SIDE):
            column, row = int((x + 0.5) * SIDE), int((y + 0.5) * SIDE)
            moved = renderer.render(scene, MovedCamera(camera, (x, y)), outputs=("face_id",))
            found[row::SIDE, column::SIDE] = moved.face_id
    return found


def exact_faces(mesh, camera, size):
    """Return the same by exact arithmetic: the centres of the pixels of a larger picture."""
    clip = camera.projection_matrix(size) @ camera.view_matrix()
    positions = (np.hstack([mesh.vertices, np.ones((len(mesh.vertices), 1))]) @ clip.T).tolist()
    large = size[0] * SIDE, size[1] * SIDE
    bits = REFERENCE.subpixel_bits - SIDE.bit_length() + 1
    shown = oracle.render_faces(positions, mesh.faces.tolist(), large, subpixel_bits=bits)
    found = np.full(large[::-1], -1, np.int32)
    for (column, row), (face, _) in shown.items():
        found[row, column] = face
    return found


def loose_triangles(seed, count, spread, **material):
    """Return triangles anywhere in a cube of half a side, each with a colour."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-spread, spread, (count, 3, 3)).reshape(-1, 3)
    colors = rng.uniform(0.0, 1.0, (count, 3))
    return rj.Mesh(points, np.arange(3 * count).reshape(-1, 3), colors=colors,
                   material=rj.Material("unlit", "white", **material))  # fmt: skip


AMID = rj.PerspectiveCamera((0.2, 0.3, 1.4), (0.0, 0.1, 0.0), fov_y=60.0, near=0.3, far=4.0)
"""Stands so near that faces cross its near plane."""
BESIDE = rj.OrthographicCamera((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), height=2.2, near=1.0, far=6.0)


@functools.cache
def loose_scene():
    return loose_triangles(11, 24, 1.2)


@pytest.fixture(scope="module", params=[AMID, BESIDE], ids=["perspective", "parallel"])
def exact(request):
    """Return a camera, the size of its picture, and the exact faces of the loose scene."""
    size = (9, 7)
    return request.param, size, exact_faces(loose_scene(), request.param, size)


def test_every_sample_shows_the_face_that_exact_arithmetic_finds(exact):
    camera, size, want = exact
    have = every_face(loose_scene(), camera, size)
    assert (want >= 0).mean() > 0.4
    assert len(np.unique(want)) > 10
    # A pixel of many faces is no rare one.
    blocks = want.reshape(size[1], SIDE, size[0], SIDE).transpose(0, 2, 1, 3).reshape(-1, SIDE**2)
    assert np.mean([len(set(block)) > 2 for block in blocks.tolist()]) > 0.3
    np.testing.assert_array_equal(have, want)


def test_a_pixel_is_the_mean_of_what_exact_arithmetic_finds(exact):
    camera, size, faces = exact
    mesh, background = loose_scene(), (0.1, 0.2, 0.3)
    colors = np.vstack([mesh.face_colors[:, :3].astype(float), background])
    expected = colors[faces].reshape(size[1], SIDE, size[0], SIDE, 3).mean(axis=(1, 3))
    frame = rj.render(mesh, camera, size=size, quality=REFERENCE, outputs=("linear",),
                      background=background)  # fmt: skip
    np.testing.assert_allclose(frame.linear[..., :3], expected, rtol=0, atol=1e-6)


# Against rays


@pytest.mark.parametrize("camera_name", CAMERAS)
@pytest.mark.parametrize("name", ["torus knot", "instances"])
def test_every_picture_shows_the_faces_that_rays_meet_first(name, camera_name):
    camera, view = CAMERAS[camera_name], make_view(CAMERAS[camera_name])
    rng = np.random.default_rng(2)
    for offset in sample_offsets(256)[:: 256 // 5]:
        chosen = rng.choice(SIZE[0] * SIZE[1], 1000, replace=False)
        rows, columns = chosen // SIZE[0], chosen % SIZE[0]
        frame = rj.render(make_scene(name), MovedCamera(camera, offset), size=SIZE,
                          quality=PICTURE, outputs=("face_id",))  # fmt: skip
        ours = frame.face_id[rows, columns]
        xy = np.stack([columns + 0.5 + offset[0], rows + 0.5 + offset[1]], axis=-1)
        theirs = trace(name, *view.rays(xy))["primID"]
        clear = np.ones(len(xy), bool)
        for faces in (theirs, ours):
            there = np.nonzero(faces >= 0)[0]
            corners = world_triangles(name)[faces[there]]
            clear[there] &= distance_to_edges(view, corners, xy[there]) > NEAR_EDGE
        assert clear.mean() > 0.97
        assert (theirs >= 0).sum() > 100
        np.testing.assert_array_equal(ours[clear], theirs[clear])


SHADOW_SIZE = 1024
TEXEL = 1.6 / SHADOW_SIZE
"""More than a texel of the map, which shows a scene of size 1, scene units."""
LIGHT = np.array((-0.5, -1.0, -0.4)) / np.linalg.norm((-0.5, -1.0, -0.4))
STARTS = (1e-4, 8.0 * TEXEL)
"""How far from a surface rays to the light begin, scene units: beyond Embree's rounding, and beyond
the depth that a map does not tell from that of the surface."""


def is_hidden(name, points, start):
    """Tell by rays which points the light does not reach."""
    directions = np.broadcast_to(-LIGHT, points.shape)
    return trace(name, points + start * directions, directions)["primID"] >= 0


def rays_to_the_light(name, points, normals):
    """
    Tell which points the light does not reach, and where that is sure.

    It is if it holds for all points of the surface's plane within a texel and a half, seen from the
    light, and wherever the rays begin.
    """
    hidden = is_hidden(name, points, STARTS[0])
    across = np.cross(LIGHT, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    down, sure = np.cross(LIGHT, across), np.ones(len(points), bool)
    for turn in np.arange(8) * np.pi / 4.0:
        aside = 1.5 * TEXEL * (np.cos(turn) * across + np.sin(turn) * down)
        along = (normals @ aside) / (normals @ LIGHT)
        for start in STARTS:
            beside = points + aside - along[:, np.newaxis] * LIGHT
            sure &= is_hidden(name, beside, start) == hidden
    return hidden, sure


def lit_scene(name, shadow):
    scene = rj.Scene()
    scene.nodes = make_scene(name).nodes
    scene.lights = [rj.DirectionalLight(tuple(LIGHT), shadow=shadow)]
    return scene


@pytest.mark.parametrize("number", [0, 1, 255])
@pytest.mark.parametrize("name", ["torus knot", "instances"])
def test_shadows_fall_where_rays_to_the_light_are_stopped(name, number):
    camera = MovedCamera(CAMERAS["perspective"], sample_offsets(256)[number])
    frame = rj.render(lit_scene(name, rj.Shadow(SHADOW_SIZE, "hard")), camera, size=(200, 150),
                      quality=replace(PICTURE, shadow_size=SHADOW_SIZE), background="black",
                      outputs=("linear", "position", "geometric_normal", "face_id"))  # fmt: skip
    facing = frame.geometric_normal.astype(float)
    chosen = (frame.face_id >= 0) & (-(facing @ LIGHT) > 0.2)
    points, normals = frame.position[chosen].astype(float), facing[chosen]
    hidden, sure = rays_to_the_light(name, points, normals)
    ours = frame.linear[chosen][:, 0] == 0.0
    print(f"{sure.mean():.2f} of {len(sure)} are sure, {hidden[sure].mean():.2f} of them dark")
    assert sure.mean() > 0.65
    assert min(hidden[sure].sum(), (~hidden)[sure].sum()) > 500
    np.testing.assert_array_equal(ours[sure], hidden[sure])


def test_a_pixel_is_the_mean_of_the_light_that_rays_find_at_its_samples():
    name, camera, size = "torus knot", CAMERAS["perspective"], (48, 36)
    bright, places, points = np.zeros((256, size[1], size[0])), [], []
    with rj.Renderer(size, quality=PICTURE) as renderer:
        for n, offset in enumerate(sample_offsets(256)):
            frame = renderer.render(lit_scene(name, None), MovedCamera(camera, offset),
                                    background="black",
                                    outputs=("linear", "position", "face_id"))  # fmt: skip
            seen = frame.face_id >= 0
            bright[n] = frame.linear[..., 0]
            places.append((np.full(seen.sum(), n), *np.nonzero(seen)))
            points.append(frame.position[seen].astype(float))
    # Embree takes the rays of all pictures at once.
    reached = np.zeros(bright.shape)
    reached[tuple(np.hstack(places))] = ~is_hidden(name, np.concatenate(points), STARTS[0])
    expected, bright = (bright * reached).mean(axis=0), bright.mean(axis=0)
    have = rj.render(lit_scene(name, rj.Shadow(SHADOW_SIZE, "hard")), camera, size=size,
                     quality=replace(REFERENCE, shadow_size=SHADOW_SIZE), outputs=("linear",),
                     background="black").linear[..., 0]  # fmt: skip
    error = np.abs(have - expected)
    is_shaded = np.abs(bright - expected) > 0.02
    print(f"{is_shaded.sum()} pixels in shadow, {error.mean():.5f} {error.max():.3f} apart")
    assert is_shaded.sum() > 100
    # A texel is a tenth of a pixel, and errors along an edge cancel out.
    assert error.mean() < 0.0003
    assert error.max() < 0.03
    one = rj.render(lit_scene(name, rj.Shadow(SHADOW_SIZE, "hard")), camera, size=size,
                    outputs=("linear",), background="black").linear[..., 0]  # fmt: skip
    assert np.abs(one - expected).mean() > 10.0 * error.mean()


# Against integrals


def errors_of_steps(scene, camera, size, exact, channel=0):
    """
    Return how far the means of 4, 16, 64 and 256 pictures are from an integral, RMS.

    Where that is NaN nobody looks.
    """
    with rj.Renderer(size) as renderer:
        frames = list(renderer.refine(scene, camera, outputs=("linear",), background="black"))[2:]
    assert [frame.plan.pictures for frame in frames] == [4, 16, 64, 256]
    apart = [frame.linear[..., channel].astype(float) - exact for frame in frames]
    return [float(np.sqrt(np.nanmean(some * some))) for some in apart]


def assert_rate(errors, exponent):
    """Hold errors against n**-exponent: over all steps, and a part of it in each."""
    print([f"{error:.2e}" for error in errors])
    assert errors[-1] < errors[0] * 64.0**-exponent
    for before, after in itertools.pairwise(errors):
        assert after < before / 1.5


def test_error_of_edges_falls_with_the_number_of_samples():
    """Areas of faces that nothing hides, their edges of all slopes: by chance it were n**-0.5."""
    size, rng = (64, 32), np.random.default_rng(7)
    scene, exact = rj.Scene(), np.zeros(size[::-1])
    for column, row in itertools.product(range(8), range(4)):
        points = rng.uniform(0.2, 7.8, (3, 2)) + (8 * column, 8 * row)
        points = np.round(points * 256) / 256
        scene.add(naive_layers.mesh_of(points.tolist(), [0.0] * 3, size, base_color="white"))
        for i, j in itertools.product(range(8), range(8)):
            place = 8 * column + i, 8 * row + j
            exact[place[::-1]] = oracle.pixel_area(points.tolist(), *place)
    errors = errors_of_steps(scene, naive_layers.CAMERA, size, exact)
    assert_rate(errors, 0.7)
    assert errors[-1] < 0.003


def bends(positions, values):
    """
    Return the second integral of a function that is linear between places, and level outside.

    A function of a place, float64 of any shape.
    """
    slopes = np.diff(values) / np.diff(positions)
    changes = np.diff(np.concatenate([[0.0], slopes, [0.0]]))

    def integral(x):
        over = np.maximum(x[..., np.newaxis] - positions, 0.0)
        return values[0] * x * x / 2.0 + (changes * over * over * over).sum(axis=-1) / 6.0

    return integral


def mean_over_pixels(positions, values, across, down, first, size):
    """
    Return the mean over each pixel of a function of ``first + across x + down y``, (H, W).

    Over a rectangle, the integral of f(a x + b y) is that of the second integral of f at its
    corners, with signs, over a b.
    """
    second = bends(positions, values)
    x, y = np.meshgrid(np.arange(size[0] + 1), np.arange(size[1] + 1))
    corners = second(first + across * x + down * y)
    total = corners[1:, 1:] - corners[1:, :-1] - corners[:-1, 1:] + corners[:-1, :-1]
    return total / (across * down)


def test_error_of_a_texture_falls_with_the_number_of_samples():
    """Texels of several pixels, mixed linearly between their middles, at a slant."""
    size, texels = (64, 32), np.float32(np.random.default_rng(8).uniform(0.0, 1.0, 8))
    image = np.repeat(texels[np.newaxis, :, np.newaxis], 3, axis=2)
    texture = rj.Texture(image, filter="bilinear", wrap="clamp", color_space="linear")
    across, down, first = 0.101, 0.083, 0.11
    corners = np.array([(0.0, 0.0), (64.0, 0.0), (64.0, 32.0), (0.0, 32.0)])
    u = (first + corners @ (across, down)) / 8.0
    halves = [
        naive_layers.mesh_of(corners[[0, 1, 2]], [0.0] * 3, size),
        naive_layers.mesh_of(corners[[0, 2, 3]], [0.0] * 3, size),
    ]
    scene = rj.Scene()
    for mesh, numbers in zip(halves, ([0, 1, 2], [0, 2, 3]), strict=True):
        uv = np.stack([u[numbers], np.full(3, 0.5)], axis=1)
        material = rj.Material("unlit", base_color_texture=texture)
        scene.add(rj.Mesh(mesh.vertices, mesh.faces, uv=uv, material=material))
    middles = np.arange(8) + 0.5
    exact = mean_over_pixels(middles, texels.astype(float), across, down, first, size)
    errors = errors_of_steps(scene, naive_layers.CAMERA, size, exact)
    assert_rate(errors, 1.0)
    assert errors[-1] < 2e-5


def test_error_of_a_colour_that_changes_in_perspective_falls_with_the_number_of_samples():
    """A floor whose colour grows with distance: its mean over rows is known."""
    # On the screen the distance along the floor is h / y, below the horizon by y.
    size, height = (6, 40), 1.0
    camera = rj.PerspectiveCamera((0, height, 0), (0, height, -1), fov_y=90.0, near=0.05)
    ends = np.array([(-400, 0, 1), (400, 0, 1), (400, 0, -64), (-400, 0, -64)], float)
    # Red is linear on the floor from 0 at z = 1 to 1 at z = -64.
    red = (1.0 - ends[:, 2]) / 65.0
    colors = np.stack([red, red, red], axis=1)
    mesh = rj.Mesh(ends, [[0, 1, 2], [0, 2, 3]], colors=colors,
                   material=rj.Material("unlit", "white"))  # fmt: skip
    rows = np.arange(size[1] + 1)
    below = np.maximum((rows - 20.0) / 20.0, 1.0 / 64.0)
    # The integral of (1 + 1 / y) / 65 is (y + log y) / 65.
    whole = (below + np.log(below)) / 65.0 * 20.0
    exact = np.diff(whole)[:, np.newaxis].repeat(6, axis=1)
    # Rows hold one edge, the horizon.
    exact[:22] = np.nan
    errors = errors_of_steps(mesh, camera, size, exact)
    # In 4, 8, 16 and 16 rows of samples; the error is of the second order.
    assert errors[1] < errors[0] / 3.0
    assert errors[2] < errors[1] / 3.0
    assert errors[3] < errors[0] / 12.0
    assert errors[3] < 5e-6


def test_reference_is_nearer_to_the_truth_than_any_samples_shaded_once():
    """Shiny spots and textures smaller than a pixel: more samples of edges do not help there."""
    image = (np.indices((64, 64)).sum(axis=0) % 2).astype(np.float32)
    texture = rj.Texture(image, filter="nearest", color_space="linear")
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    square = rj.Mesh(
        np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float),
        [[0, 1, 2], [0, 2, 3]], uv=uv,
        material=rj.Material("unlit", base_color_texture=texture),
    )  # fmt: skip
    camera = rj.OrthographicCamera((0, 0, 1), (0, 0, 0), height=2.0, far=2.0)
    quality = replace(REFERENCE, texture_filter="nearest")
    found = {
        samples: rj.render(square, camera, size=(19, 19), outputs=("linear",),
                           quality=replace(quality, samples=samples)).linear[..., 0]
        for samples in (1, 16, 256)
    }  # fmt: skip
    errors = {samples: math.sqrt(((mean - 0.5) ** 2).mean()) for samples, mean in found.items()}
    assert errors[1] == errors[16] > 0.49
    assert errors[256] < 0.06
