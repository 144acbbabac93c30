"""
Hard cases held on the pictures of the engine's own effects: layers, samples, shadows, fog.

The files of each stage hold the same cases by exact arithmetic; here stands what ``rj.render``
makes of them.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle

SIZE = (16, 16)
LENS = rj.MatrixCamera(np.eye(4), np.eye(4))
"""Shows -1..1 in x and y; the smaller z is in front."""
SQUARE = [(0, 1, 2), (0, 2, 3)]
WHOLE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
BITS = ("linear", "color")


def flat(points, faces, z, color, **options):
    """Return unlit faces of one colour, linear RGBA, at points of -1..1."""
    corners = [(x, y, z) for x, y in points]
    material = rj.Material("unlit", base_color=color, **options)
    return rj.Mesh(corners, faces, material=material)


def on_screen(points, size):
    """Return points of the screen, pixels, y down, as points of -1..1."""
    return [(2 * x / size[0] - 1, 1 - 2 * y / size[1]) for x, y in points]


def draw(meshes, size=SIZE, outputs=BITS, background="black", camera=LENS, scene=None, **options):
    scene = scene or rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    threads = options.pop("threads", 1)
    return rj.render(
        scene, camera, size=size, outputs=outputs, background=background, threads=threads, **options
    )


def same(one, other):
    return all(
        array.tobytes() == other.arrays()[name].tobytes() for name, array in one.arrays().items()
    )


# --- layers ---------------------------------------------------------------------------------------


def layer(z, color, alpha):
    return flat(WHOLE, SQUARE, z, (*color, alpha), alpha_mode="blend")


RED, GREEN = (1, 0, 0), (0, 1, 0)


@pytest.mark.case("K11")
@pytest.mark.parametrize(
    ("front", "back", "expected"),
    [(RED, GREEN, [0.5, 0.25, 0.0]), (GREEN, RED, [0.25, 0.5, 0.0])],
)
def test_the_nearer_layer_is_on_top_in_any_order_of_insertion(front, back, expected):
    meshes = [layer(0.0, front, 0.5), layer(0.5, back, 0.5)]
    for order in (meshes, meshes[::-1]):
        linear = draw(order).linear
        assert (linear[:, :, :3] == np.float32(expected)).all()


@pytest.mark.case("K12")
def test_of_layers_at_one_depth_the_first_object_is_on_top_for_any_number_of_threads():
    one, other = layer(0.25, RED, 0.5), layer(0.25, GREEN, 0.5)
    frames = [draw([one, other], (200, 150), threads=threads) for threads in (1, 2, 3)]
    assert (frames[0].linear[:, :, :3] == np.float32([0.5, 0.25, 0.0])).all()
    assert same(frames[0], frames[1])
    assert same(frames[0], frames[2])
    turned = draw([other, one], (200, 150))
    assert (turned.linear[:, :, :3] == np.float32([0.25, 0.5, 0.0])).all()


@pytest.mark.case("K13")
def test_a_layer_of_alpha_0_changes_nothing_and_one_of_alpha_1_replaces_all():
    behind = flat(WHOLE, SQUARE, 0.5, (0.3, 0.1, 0.7))
    color = (0.2, 0.9, 0.4)
    alone = draw([behind])
    assert same(draw([behind, layer(0.0, color, 0.0)]), alone)
    solid = draw([behind, flat(WHOLE, SQUARE, 0.0, color)])
    assert same(draw([behind, layer(0.0, color, 1.0)]), solid)


@pytest.mark.case("G08")
def test_layers_that_are_all_opaque_are_surfaces_like_others():
    random = np.random.default_rng(8)
    points = random.uniform(-1.0, 1.0, (60, 2)).tolist()
    faces = np.arange(60).reshape(-1, 3)
    depths = np.repeat(random.permutation(20) / 20.0, 3)
    corners = [(x, y, z) for (x, y), z in zip(points, depths, strict=True)]
    colors = np.repeat(random.uniform(0.0, 1.0, (20, 3)), 3, axis=0).astype(np.float32)
    frames = [
        draw(
            [
                rj.Mesh(
                    corners, faces, colors=colors,
                    material=rj.Material("unlit", "white", alpha_mode=mode),
                )
            ],
            (64, 48),
        )
        for mode in ("opaque", "blend")
    ]  # fmt: skip
    assert same(*frames)


# --- samples --------------------------------------------------------------------------------------


@pytest.mark.case("M01")
@pytest.mark.parametrize(
    ("samples", "upper"), [(1, 1), (2, 2), (4, 2), (8, 4), (16, 9)], ids=lambda n: str(n)
)
def test_a_pixel_cut_along_its_diagonal_gives_each_sample_to_one_half(samples, upper):
    half = on_screen([(0, 0), (1, 0), (1, 1)], (1, 1)), on_screen([(0, 0), (1, 1), (0, 1)], (1, 1))
    meshes = [flat(half[0], [(0, 1, 2)], 0.0, RED), flat(half[1], [(0, 1, 2)], 0.0, GREEN)]
    linear = draw(meshes, (1, 1), quality=rj.Quality(samples=samples)).linear[0, 0]
    assert (linear[:3] * samples).tolist() == [upper, samples - upper, 0.0]


def jittered(columns, rows, seed):
    """Return a triangulation of -1..1 with inner vertices moved at random, and its faces."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-1, 1, columns + 1), np.linspace(-1, 1, rows + 1))
    inner = (abs(x) < 1) & (abs(y) < 1)
    x = x + inner * random.uniform(-0.6, 0.6, x.shape) / columns
    y = y + inner * random.uniform(-0.6, 0.6, y.shape) / rows
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    a = (j * (columns + 1) + i).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    faces = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    return np.stack([x.ravel(), y.ravel()], axis=1).tolist(), faces


@pytest.mark.case("M02", "M09")
@pytest.mark.parametrize("samples", [2, 4, 8, 16])
def test_a_watertight_mesh_covers_every_sample_once(samples):
    points, faces = jittered(13, 9, seed=samples)
    # Were a sample seen twice or never, the background would be mixed in or missing.
    for background in ("black", "white"):
        white = flat(points, faces, 0.0, (1, 1, 1))
        quality = rj.Quality(samples=samples)
        linear = draw([white], (40, 30), background=background, quality=quality).linear
        assert (linear == 1.0).all()


@pytest.mark.case("M03", "G05")
@pytest.mark.parametrize("samples", [2, 4, 8, 16, "area"])
def test_inside_one_face_samples_change_no_bit(samples):
    color = (0.3, 0.6, 0.1)
    points = on_screen([(-5, -5), (150, -5), (-5, 150)], (64, 64))
    frames = [
        draw([flat(points, [(0, 1, 2)], 0.0, color)], (64, 64), quality=rj.Quality(samples=number))
        for number in (1, samples)
    ]
    assert same(*frames)


@pytest.mark.case("G05")
def test_a_pixel_whose_centre_alone_is_inside_takes_all_its_samples():
    # x + y = 127.125 leaves out two of the four samples of the last pixel, not its centre.
    points = on_screen([(0, 0), (0, 127.125), (127.125, 0)], (64, 64))
    mesh = flat(points, [(0, 1, 2)], 0.0, (1, 1, 1))
    linear = draw([mesh], (64, 64), quality=rj.Quality(samples=4)).linear[:, :, 0]
    assert linear[63, 63] == 0.5
    assert (linear == 1.0).sum() == 64 * 64 - 1


AREA_ROUNDING = 2.0**-22
"""Areas are kept in float32, some sums of products deep."""


def areas(points, size):
    """Return the share of each pixel that a fan of faces shows, (H, W)."""
    faces = [(0, n, n + 1) for n in range(1, len(points) - 1)]
    mesh = flat(on_screen(points, size), faces, 0.0, (1, 1, 1))
    return draw([mesh], size, quality=rj.Quality(samples="area")).linear[:, :, 0]


@pytest.mark.case("M05", "M06", "M07")
@pytest.mark.parametrize(
    ("points", "size"),
    [
        ([(0, 0), (1, 0), (0, 1)], (2, 2)),
        ([(0, 0.25), (4, 1.25), (4, 4), (0, 4)], (4, 4)),
        ([(1.25, 1.5), (6.75, 2.25), (3.5, 6.75)], (8, 8)),
    ],
    ids=["M05", "M06", "M07"],
)
def test_areas_are_exact_but_for_float32(points, size):
    found = areas(points, size)
    exact = [tuple(map(Fraction, point)) for point in points]
    for row in range(size[1]):
        for column in range(size[0]):
            area = float(oracle.pixel_area(exact, column, row))
            assert abs(float(found[row, column]) - area) <= AREA_ROUNDING


@pytest.mark.case("M05", "M06", "M07")
def test_areas_are_those_of_the_catalogue():
    assert areas([(0, 0), (1, 0), (0, 1)], (2, 2))[0, 0] == 0.5
    found = areas([(0, 0.25), (4, 1.25), (4, 4), (0, 4)], (4, 4))
    np.testing.assert_allclose(found[0], [5 / 8, 3 / 8, 1 / 8, 0], atol=AREA_ROUNDING)
    np.testing.assert_allclose(found[1], [1, 1, 1, 7 / 8], atol=AREA_ROUNDING)
    found = areas([(1.25, 1.5), (6.75, 2.25), (3.5, 6.75)], (8, 8))
    for (column, row), area in {
        (1, 1): 1395 / 4928, (2, 1): 29 / 88, (3, 3): 1.0, (6, 2): 35 / 88, (3, 6): 939 / 2912,
        (5, 4): 1225 / 7488, (2, 3): 197 / 224,
    }.items():  # fmt: skip
        assert abs(found[row, column] - area) <= AREA_ROUNDING
    assert abs(found.astype(float).sum() - 435 / 32) <= 64 * AREA_ROUNDING


@pytest.mark.case("M08")
def test_the_areas_of_a_tiling_sum_to_one():
    points, faces = jittered(13, 9, seed=8)
    white = flat(points, faces, 0.0, (1, 1, 1))
    linear = draw([white], (40, 30), quality=rj.Quality(samples="area")).linear
    assert np.abs(linear[:, :, :3] - 1.0).max() <= AREA_ROUNDING


# --- lights and shadows ---------------------------------------------------------------------------

DOWN = rj.OrthographicCamera((0, 5, 0), (0, 0, 0), up=(0, 0, -1), height=4.0, near=0.1, far=10.0)
FLOOR = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]
MATT = rj.Material("phong", base_color="white", specular=0.0)


@pytest.mark.case("N09")
@pytest.mark.parametrize("inner", [0.0, 20.0, 30.0])
def test_a_cone_falls_from_all_its_light_to_none(inner):
    scene = rj.Scene()
    scene.lights = [rj.SpotLight((0, 2, 0), (0, -1, 0), "white", 4.0, inner, 30.0)]
    floor = rj.Mesh(FLOOR, SQUARE, normals=[(0, 1, 0)] * 4, material=MATT)
    frame = draw([floor], (65, 65), (*BITS, "position"), camera=DOWN, scene=scene)
    x, _, z = frame.position[32, 32:].astype(np.float64).T
    squared = x * x + z * z + 4.0
    cosine = 2.0 / np.sqrt(squared)
    share = frame.linear[32, 32:, 0] / (4.0 / squared * cosine)
    assert (np.diff(share) <= 1e-5).all()
    outer = np.cos(np.radians(30.0))
    assert (share[cosine < outer] == 0.0).all()
    assert (share <= 1.0 + 1e-5).all()
    np.testing.assert_allclose(share[cosine > np.cos(np.radians(inner))], 1.0, rtol=1e-5)
    assert (cosine < outer).any()


def shadowed_floor(slope, shadow, caster=True):
    """Return a frame of a floor that rises with x and z, lit from above, under a small square."""
    corners = [(x, slope[0] * x + slope[1] * z, z) for x, _, z in FLOOR]
    normal = (-slope[0], 1.0, -slope[1])
    scene = rj.Scene()
    scene.lights = [rj.DirectionalLight((-0.1, -1, -0.05), shadow=shadow)]
    meshes = [rj.Mesh(corners, SQUARE, normals=[normal] * 4, material=MATT)]
    if caster:
        square = [(0.25 * x, 2.0, 0.25 * z) for x, _, z in FLOOR]
        meshes.append(rj.Mesh(square, SQUARE, normals=[(0, 1, 0)] * 4, material=MATT))
    camera = replace(DOWN, near=-5.0)
    return draw(meshes, (97, 89), (*BITS, "object_id"), camera=camera, scene=scene)


@pytest.mark.case("S01", "S02", "S05")
@pytest.mark.parametrize("filter", ["hard", "pcf"])
@pytest.mark.parametrize("slope", [(0, 0), (1, 0), (0, -1), (0.9, 0.9), (3, 2)], ids=str)
def test_a_lit_slope_is_lit_in_full_and_the_shadow_on_it_is_whole(slope, filter):
    """No acne at any slope, within the map and outside of it; and the shadow is there."""
    frame = shadowed_floor(slope, rj.Shadow(size=64, filter=filter))
    plain = shadowed_floor(slope, None)
    is_floor = frame.object_id == 0
    lit = frame.linear[:, :, 0] == plain.linear[:, :, 0]
    dark = frame.linear[:, :, 0] == 0.0
    assert (dark & is_floor).any()
    # A map of 64 texels is fitted to the caster or to more; its borders blur two texels at most.
    seam = is_floor & ~lit & ~dark
    assert lit.sum() > 0.8 * lit.size
    assert seam.sum() <= (0 if filter == "hard" else 600)
    # Nothing is dark but next to the square, which hides the most of its own shadow.
    rows, columns = np.nonzero(is_floor & ~lit)
    assert rows.max() - rows.min() < 50
    assert columns.max() - columns.min() < 50


@pytest.mark.case("S05")
def test_what_casts_nothing_makes_no_map():
    with_shadow = shadowed_floor((0.5, 0.5), rj.Shadow(size=64), caster=False)
    assert same(with_shadow, shadowed_floor((0.5, 0.5), None, caster=False))


# --- coefficients of zero -------------------------------------------------------------------------


@pytest.mark.case("G11")
@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("fog", rj.Fog("red", mode="exp", density=0.0)),
        ("fog", rj.Fog("red", mode="exp2", density=0.0)),
        ("fog", rj.Fog("red", mode="linear", start=50.0, end=60.0)),
        ("tone_map", rj.ToneMap("none", 0.0)),
        ("environment", rj.Environment.constant("red", intensity=0.0, background=False)),
    ],
    ids=["exp", "exp2", "linear", "tone map", "environment"],
)
def test_an_effect_that_does_nothing_equals_none(field, value):
    floor = rj.Mesh(FLOOR, SQUARE, normals=[(0.1, 1, 0), (0, 1, 0), (0, 1, 0.2), (0, 1, 0)],
                    material=MATT)  # fmt: skip
    frames = []
    for setting in (None, value):
        scene = rj.Scene()
        scene.lights = [rj.DirectionalLight((-1, -2, -1))]
        setattr(scene, field, setting)
        frames.append(draw([floor], (33, 33), camera=DOWN, scene=scene))
    assert same(*frames)
