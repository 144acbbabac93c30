"""Texture lookup equals its exact twin; a white one changes no bit; nothing leaves a texture."""

from __future__ import annotations

import math
from fractions import Fraction

import naive_textures as naive
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from naive_textures import (
    DETAIL_ERROR,
    MIX_ROUNDINGS,
    NOISE,
    SIZE,
    TRIANGLES,
    box,
    draw,
    draw_triangle,
    square,
)

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.runtime.intrinsics import HALVES
from rasterjit.scene.material import SHADINGS
from rasterjit.scene.texture import FILTERS
from rasterjit.survey.packed_scene import WRAP_CODES

BITS = ("linear", "color")
WHITE = np.ones((1, 1))


def lit_scene(*meshes):
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    scene.lights = [
        rj.AmbientLight("white", 0.15),
        rj.DirectionalLight((-1, -2, -1.5), color=(1.0, 0.9, 0.7), intensity=0.6),
        rj.PointLight((2.0, 1.0, 3.0), color=(0.4, 0.5, 1.0), intensity=4.0),
    ]
    return scene


def remake(mesh, material, colors=None, shift=0.0):
    """Return a mesh with uv that follow its positions, and another material."""
    vertices = mesh.vertices + (shift, 0.0, 0.0)
    uv = mesh.vertices[:, :2] * 1.7
    return rj.Mesh(vertices, mesh.faces, colors=colors, uv=uv, material=material)


def shade(scene, camera, **options):
    return rj.render(scene, camera, size=SIZE, outputs=BITS, threads=1, **options)


def same(one, other):
    """Tell whether two frames have the same bits."""
    return all(
        a.tobytes() == b.tobytes()
        for a, b in ((one.linear, other.linear), (one.color, other.color))
    )


# Absent equals neutral


@pytest.mark.parametrize("shading", SHADINGS)
@pytest.mark.parametrize("kind", FILTERS)
@pytest.mark.parametrize("specular", [0.0, 0.5])
def test_a_white_texture_changes_no_bit(sphere, camera, shading, kind, specular):
    options = {"shading": shading, "base_color": (0.8, 0.5, 0.3), "specular": specular}
    colors = np.random.default_rng(1).uniform(0.2, 1.0, (len(sphere.vertices), 4))
    plain = remake(sphere, rj.Material(**options), colors)
    white = remake(
        sphere, rj.Material(**options, base_color_texture=rj.Texture(WHITE, filter=kind)), colors
    )
    # Without the texture, unlit colours of vertices would take float32.
    exact = rj.Quality(interpolation_precision="float64")
    frames = [shade(lit_scene(mesh), camera, quality=exact) for mesh in (plain, white)]
    assert same(*frames)


@pytest.mark.parametrize("shading", SHADINGS)
def test_an_object_beside_a_textured_one_keeps_its_bits(sphere, camera, shading):
    plain = remake(sphere, rj.Material(shading, "orange", specular=0.5), shift=-0.8)
    noise, white = (
        remake(sphere, rj.Material(shading, specular=0.5, base_color="white",
                                   base_color_texture=texture), shift=0.8)
        for texture in (rj.Texture(NOISE), None)
    )  # fmt: skip
    frames = [
        rj.render(lit_scene(plain, other), camera, size=SIZE, threads=1,
                  outputs=("linear", "object_id"))
        for other in (noise, white)
    ]  # fmt: skip
    there = frames[0].object_id == 0
    assert there.sum() > 50
    assert (frames[0].linear[there] == frames[1].linear[there]).all()
    assert (frames[0].linear[~there] != frames[1].linear[~there]).any()


@pytest.mark.parametrize("shading", ["unlit", "flat", "phong"])
def test_a_texture_of_one_colour_is_a_base_colour(sphere, camera, shading):
    color = np.float32([0.75, 0.25, 0.5])
    plain = remake(sphere, rj.Material(shading, color, specular=0.5))
    texture = rj.Texture(color[np.newaxis, np.newaxis])
    textured = remake(
        sphere, rj.Material(shading, "white", specular=0.5, base_color_texture=texture)
    )
    # Without the texture, lit colours would take float32.
    exact = rj.Quality(interpolation_precision="float64")
    frames = [shade(lit_scene(mesh), camera, quality=exact) for mesh in (plain, textured)]
    assert same(*frames)


def test_gouraud_shading_is_a_base_colour_too_with_the_highlight_on_top(sphere, camera):
    color = np.float32([0.75, 0.25, 0.0])
    texture = rj.Texture(color[np.newaxis, np.newaxis])
    frames = []
    for options in ({"base_color": color}, {"base_color": "white", "base_color_texture": texture}):
        material = rj.Material("gouraud", specular=0.5, shininess=5.0, **options)
        frames.append(shade(lit_scene(remake(sphere, material)), camera))
    # The highlight alone is seen in blue: there is no other light of that colour.
    assert frames[0].linear[..., 2][frames[0].linear[..., 2] < 1.0].max() > 0.05
    assert np.abs(frames[0].linear - frames[1].linear).max() <= 8 * 2.0**-24


@pytest.mark.parametrize("kind", ["vertex", "face"])
def test_texture_colours_and_base_colour_are_multiplied(kind):
    texture = rj.Texture(NOISE, filter="nearest")
    texels = draw(square(texture, box((0, 0), (1, 1))), (16, 16))
    tints = [(0.5, 0.25, 1.0)] * (4 if kind == "vertex" else 2)
    material = rj.Material("unlit", (0.5, 1.0, 0.25), base_color_texture=texture)
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    mesh = rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], colors=tints, uv=box((0, 0), (1, 1)),
                   material=material)  # fmt: skip
    shown = draw(mesh, (16, 16))
    assert (shown[..., :3] == texels[..., :3] * np.float32([0.25, 0.25, 0.25])).all()


def test_alpha_of_a_texture_is_not_drawn():
    pixels = np.concatenate([NOISE, np.full((16, 16, 1), 0.25)], axis=2)
    assert (
        draw(square(rj.Texture(pixels), box((0, 0), (1, 1))), (16, 16))
        == draw(square(rj.Texture(NOISE), box((0, 0), (1, 1))), (16, 16))
    ).all()


# The exact twin in perspective


@pytest.mark.parametrize("name", TRIANGLES)
def test_coordinates_in_whole_numbers_are_those_of_the_oracle(name):
    points, ws, _ = TRIANGLES[name]
    uvs = [(0.0, 0.25), (3.0, 0.5), (1.0, 4.0)]
    triangle = [tuple(map(Fraction, point)) for point in points]
    exact = [Fraction(w) for w in ws], [tuple(map(Fraction, uv)) for uv in uvs]
    planes = naive.planes_of(triangle, *exact)
    inside = 0
    for column, row in np.ndindex(*SIZE):
        point = column + naive.HALF, row + Fraction(1, 3)
        weights = oracle.perspective_weights(triangle, ws, point)
        assert naive.coordinates_at(point, planes) == oracle.interpolate(weights, uvs)
        inside += min(weights) > 0
    assert inside > 200


@pytest.mark.parametrize("name", TRIANGLES)
def test_mip_levels_in_perspective_equal_exact_ones(name):
    points, ws, repeats = TRIANGLES[name]
    uv = (np.array([(0.0, 0.25), (3.0, 0.5), (1.0, 4.0)]) * repeats).tolist()
    texture = rj.Texture(NOISE, wrap="mirror")
    frame = draw_triangle(points, ws, uv, texture)
    levels = naive.mip_chain(naive.exact_image(NOISE[..., 0]))
    triangle = [tuple(Fraction(n, 256) for n in p) for p in oracle.snap_triangle(points)]
    assert frame.stats.clipped == (name == "cut by the near plane")
    if frame.stats.clipped:
        # The weights of a clipped face are those of its vertices as they are.
        triangle = [tuple(map(Fraction, point)) for point in points]
    exact_ws, exact_uv = [Fraction(w) for w in ws], [tuple(map(Fraction, p)) for p in uv]
    planes = naive.planes_of(triangle, exact_ws, exact_uv)
    details = []
    pixels = np.argwhere(frame.face_id >= 0)
    for row, column in pixels[:: max(1, len(pixels) // 60)].tolist():
        point = (column + naive.HALF, row + naive.HALF)
        u, v = naive.coordinates_at(point, planes)
        detail = naive.level_of_detail(point, planes, (16, 16))
        exact = float(naive.trilinear(levels, u, v, ("mirror", "mirror"), detail))
        details.append(detail)
        assert abs(frame.linear[row, column, 0] - exact) <= MIX_ROUNDINGS + DETAIL_ERROR
    assert max(details) > 1.5
    assert max(details) - min(details) > 0.5


def test_a_clipped_floor_has_the_mip_levels_of_a_whole_one():
    # The same plane, once reaching behind the camera, once ending in front of it.
    camera = rj.PerspectiveCamera(eye=(0, 1, 0), target=(0, 0.6, -2), fov_y=60.0, near=0.1)
    texture = rj.Texture(NOISE)

    def floor(near):
        corners = [(-40, 0, near), (40, 0, near), (40, 0, -60), (-40, 0, -60)]
        uv = [(x / 4, -z / 4) for x, _, z in corners]
        material = rj.Material("unlit", "white", base_color_texture=texture)
        mesh = rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uv=uv, material=material)
        return rj.render(mesh, camera, size=SIZE, outputs=("linear", "face_id"), threads=1)

    whole, clipped = floor(-0.25), floor(20.0)
    assert clipped.stats.clipped > 0
    both = (whole.face_id >= 0) & (clipped.face_id >= 0)
    assert both.sum() > SIZE[0] * SIZE[1] / 2
    # A clipped vertex is not snapped: u moves by a part of a pixel, here less than 1/50 texel.
    assert np.abs(whole.linear - clipped.linear)[both].max() < 0.02


def test_rotating_faces_and_threads_change_no_bit(sphere, camera):
    material = rj.Material(base_color_texture=rj.Texture(NOISE))
    frames = []
    for turn, threads in ((0, 1), (1, 2), (2, 3)):
        mesh = rj.Mesh(
            sphere.vertices, np.roll(sphere.faces, turn, axis=1), uv=sphere.vertices[:, :2],
            normals=sphere.vertices, material=material,
        )  # fmt: skip
        frames.append(rj.render(lit_scene(mesh), camera, size=SIZE, outputs=BITS, threads=threads))
    assert same(frames[0], frames[1])
    assert same(frames[0], frames[2])


# Several objects


def test_each_object_has_its_own_texture():
    textures = [
        rj.Texture(np.full((n + 1, 2 * n + 1), n / 4), filter=FILTERS[n % 3]) for n in range(4)
    ]
    scene = rj.Scene()
    for n, texture in enumerate([*textures, textures[1]]):
        move = rj.transforms.compose(
            rj.transforms.translate((2 * n - 4, 0, 0)), rj.transforms.scale((1, 5, 1))
        )
        scene.add(square(texture, box((0, 0), (1, 1))), move)
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=10.0)
    shown = rj.render(scene, camera, size=(5, 5), outputs="linear", threads=1).linear
    assert shown[2, :, 0].tolist() == [0.0, 0.25, 0.5, 0.75, 0.25]


def test_a_renderer_shows_the_texture_of_now():
    mesh = square(rj.Texture([[0.25]]), box((0, 0), (1, 1)))
    with rj.Renderer((4, 4), threads=1) as renderer:
        first = renderer.render(mesh, naive.FRONT, outputs="linear").linear
        mesh.material = rj.Material("unlit", base_color_texture=rj.Texture([[0.5]]))
        second = renderer.render(mesh, naive.FRONT, outputs="linear").linear
    assert (first[0, 0, 0], second[0, 0, 0]) == (0.25, 0.5)


# Nothing leaves a texture

ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True, width=64)
ANY_SIZE = st.integers(1, 70)
ANY_WRAPS = st.tuples(*[st.sampled_from(sorted(WRAP_CODES.values()))] * 2)


@settings(max_examples=300)
@given(u=ANY_FLOAT, v=ANY_FLOAT, size=st.tuples(ANY_SIZE, ANY_SIZE), wraps=ANY_WRAPS)
def test_any_coordinate_reads_a_texel_of_its_level(u, v, size, wraps):
    first, (width, height) = 1000, size
    level = (first, width, height)
    for offset in (0.0, 0.5):
        texels, shares = naive.texels_around(level, u, v, wraps, offset)
        assert all(first <= n < first + width * height for n in texels)
        assert all(0.0 <= share < 1.0 for share in shares)


@settings(max_examples=300)
@given(u=ANY_FLOAT, v=ANY_FLOAT, size=st.tuples(ANY_SIZE, ANY_SIZE))
@example(u=-(2.0**-60), v=1.0 - 2.0**-53, size=(3, 5))
@example(u=0.0, v=-0.0, size=(1, 1))
@example(u=math.inf, v=math.nan, size=(7, 2))
def test_a_repeated_texture_of_one_level_is_read_as_any_other(u, v, size):
    level = (1000, *size)
    repeat = WRAP_CODES["repeat"]
    assert naive.repeated_around(level, u, v) == naive.texels_around(
        level, u, v, (repeat, repeat), 0.5
    )


@settings(max_examples=300)
@given(u=ANY_FLOAT, v=ANY_FLOAT, size=st.tuples(ANY_SIZE, ANY_SIZE))
@example(u=-(2.0**-60), v=1.0 - 2.0**-53, size=(3, 5))
@example(u=0.0, v=-0.0, size=(1, 1))
@example(u=math.inf, v=math.nan, size=(7, 2))
def test_the_texel_of_a_repeated_texture_is_found_as_any_other(u, v, size):
    level, repeat = (1000, *size), WRAP_CODES["repeat"]
    wanted, _ = naive.texels_around(level, u, v, (repeat, repeat), 0.0)
    assert naive.repeated_at(level, u, v) == wanted[0]


@pytest.mark.parametrize("runs", [(32,), (16, 16), (20, 1, 11), (1,) * 32, (15, 9, 8)])
@pytest.mark.parametrize("coarser_by", [0, 1])
def test_runs_of_a_level_read_the_texels_of_each_sample(runs, coarser_by):
    rng, wraps = np.random.default_rng(len(runs)), (WRAP_CODES["repeat"],) * 2
    levels = np.array([(100, 8, 4), (132, 4, 2), (140, 2, 1), (142, 1, 1)])
    details = np.repeat(rng.permutation(np.arange(len(runs)) % 4), runs)
    u, v = rng.uniform(-3.0, 3.0, (2, 32))
    numbers, shares, *_ = texture_lookup.allocate_lookup_memory(32)
    numbers[texture_lookup.LEVEL] = details
    corners = tuple(numbers[texture_lookup.CORNERS :])
    row = np.array((0, 4, *wraps, texturing.TRILINEAR, 1, texturing.PLAIN, 0, 0, 0))
    texture_lookup.find_texels_and_weights(u, v, True, coarser_by, row, levels, numbers, shares)
    for n, detail in enumerate(details):
        level = levels[min(detail + coarser_by, 3)] - (100, 0, 0)
        texels, apart = naive.texels_around(level, u[n], v[n], wraps, 0.5)
        assert [corner[n] // HALVES for corner in corners] == list(texels)
        found = shares[[texture_lookup.RIGHT_WEIGHT, texture_lookup.UPPER_WEIGHT], n]
        assert found.tolist() == apart


@settings(max_examples=300)
@given(data=st.data(), size=ANY_SIZE, wrap=st.sampled_from(sorted(WRAP_CODES)))
def test_any_number_beside_a_period_wraps_as_the_twin(data, size, wrap):
    i = data.draw(st.integers(-1, (2 if wrap == "mirror" else 1) * size))
    rule = texture_lookup.encode_texel_wrap(WRAP_CODES[wrap])
    found = texture_lookup.wrap_texel(np.int32(i), np.int32(size), rule)
    assert found == naive.wrapped(i, size, wrap)


@settings(max_examples=30)
@given(
    corners=st.lists(
        st.tuples(*[st.floats(-(2.0**127), 2.0**127, width=32)] * 2),
        min_size=4, max_size=4,
    ),
    kind=st.sampled_from(FILTERS),
    wrap=st.sampled_from(sorted(WRAP_CODES)),
)  # fmt: skip
def test_any_coordinates_show_a_mix_of_texels(corners, kind, wrap):
    image = np.float32([[0.25, 0.75, 0.5], [0.5, 0.25, 0.75]])
    shown = draw(square(rj.Texture(image, wrap=wrap, filter=kind), corners), (7, 5))[..., 0]
    assert (shown >= 0.25 - MIX_ROUNDINGS).all()
    assert (shown <= 0.75 + MIX_ROUNDINGS).all()
    if kind == "nearest":
        assert set(np.unique(shown)) <= {0.25, 0.5, 0.75}


def test_a_step_of_any_length_has_a_finite_level_of_detail():
    for squared in (0.0, 0.5, 1.0, 1e-300, 1e300, math.inf, -math.inf, math.nan):
        assert 0.0 <= texturing.level_of_detail(squared) < 64.0
    assert texturing.level_of_detail(4.0) == 1.0


@pytest.mark.parametrize(
    ("detail", "count", "levels"),
    [
        (0.0, 9, (0, 0.0)), (0.25, 9, (0, 0.25)), (7.5, 9, (7, 0.5)), (8.0, 9, (8, 0.0)),
        (8.5, 9, (8, 0.0)), (63.0, 9, (8, 0.0)), (0.5, 1, (0, 0.0)),
    ],
)  # fmt: skip
def test_the_coarsest_level_has_none_behind_it(detail, count, levels):
    assert texturing.split_level_of_detail(np.float32(detail), count) == levels
