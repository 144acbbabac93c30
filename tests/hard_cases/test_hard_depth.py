"""Hard cases of depth and visibility, Z01 to Z16."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import catalogue
import numpy as np
import pytest
import screen

import rasterjit as rj

NEAR, FAR = Fraction(1, 10), Fraction(10**5)
QUAD = [(0, 0), (8, 0), (8, 8), (0, 8)]


def standard(distance):
    """Return the exact depth 0..1 of a distance, 0 at the near plane and 1 at the far plane."""
    return FAR * (distance - NEAR) / (distance * (FAR - NEAR))


def code(depth, bits):
    """Return the fixed-point code of an exact depth 0..1."""
    return math.floor(depth * (2**bits - 1) + Fraction(1, 2))


def reversed_bits(distance, far=None):
    """Return the bits that the engine stores for a plane at some distance, reversed."""
    w = float(distance)
    z = float(NEAR) if far is None else float(NEAR * (far - distance) / (far - NEAR))
    positions = [[-w, -w, z, w], [3 * w, -w, z, w], [-w, 3 * w, z, w]]
    seen = rj.rasterize(positions, [[0, 1, 2]], (2, 2), depth="reversed", threads=1)
    assert (seen.depth == seen.depth[0, 0]).all()
    return screen.bits(seen.depth[0, 0])


def nearest(z_of_faces, depth):
    """Return the face the engine shows of full-screen triangles, each at one z."""
    one = [[-1, -1], [3, -1], [-1, 3]]
    positions = [[x, y, z, 1] for z in z_of_faces for x, y in one]
    faces = np.arange(3 * len(z_of_faces)).reshape(-1, 3)
    seen = rj.rasterize(positions, faces, (3, 2), depth=depth, threads=1)
    assert (seen.face_id == seen.face_id[0, 0]).all()
    return int(seen.face_id[0, 0])


TABLE = {
    # distances, float32 standard, D24, float32 reversed with the far plane at infinity
    "Z01": (
        "10000",
        "10001",
        (0x3F7FFF69, 0x3F7FFF69),
        (16777064, 16777064),
        (0x3727C5AC, 0x3727C161),
    ),
    "Z02": ("50000", "50001", (0x3F7FFFEF, 0x3F7FFFEF), None, (0x360637BD, 0x3606370D)),
    "Z03": ("99999", "100000", (0x3F800000, 0x3F800000), None, (0x35863815, 0x358637BD)),
    "Z04": ("1000", "1000.5", (0x3F7FF983, 0x3F7FF984), (16775554, 16775555), None),
}


@pytest.mark.parametrize("name", catalogue.cases(TABLE))
def test_reversed_depth_orders_what_standard_depth_ties(name):
    near, far, float_bits, d24, reversed_infinite = TABLE[name]
    distances = Fraction(near), Fraction(far)
    exact = [standard(distance) for distance in distances]
    assert tuple(screen.bits(float(depth)) for depth in exact) == float_bits
    if d24 is not None:
        assert tuple(code(depth, 24) for depth in exact) == d24
    stored = tuple(reversed_bits(distance) for distance in distances)
    if reversed_infinite is not None:
        assert stored == reversed_infinite
    # Drawn in the wrong order, the nearer plane is seen only where the depths differ.
    ties = float_bits[0] == float_bits[1]
    assert nearest([float(depth) for depth in exact[::-1]], "standard") == (0 if ties else 1)
    assert nearest([float(NEAR / d) for d in distances[::-1]], "reversed") == 1


@pytest.mark.case("Z03")
def test_reversed_depth_with_a_finite_far_plane_ends_at_zero():
    assert reversed_bits(Fraction(99999), far=FAR) == 0x2D2FEC7E
    assert reversed_bits(Fraction(100000), far=FAR) == 0


@pytest.mark.case("Z04")
def test_half_a_metre_at_a_kilometre_is_beyond_16_bits():
    assert {code(standard(Fraction(d)), 16) for d in ("1000", "1000.5")} == {65529}
    # Reversed, the two are thousands of steps apart.
    assert reversed_bits(Fraction(1000)) - reversed_bits(Fraction("1000.5")) > 1000


def card(distance, color):
    """Return a square card facing an eye at the origin that looks down -z, all over the image."""
    x, y, z = 2.0 * distance, 2.0 * distance, -float(distance)
    return rj.Mesh(
        [[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]],
        [[0, 1, 2], [0, 2, 3]],
        material=rj.Material(shading="unlit", base_color=color),
    )


@pytest.mark.parametrize("name", catalogue.cases(TABLE))
def test_a_camera_sees_the_nearer_plane_in_either_order(name):
    near, far = TABLE[name][:2]
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_y=60.0, near=0.1, far=math.inf)
    cards = [card(float(near), "red"), card(float(far), "blue")]
    for order in ((0, 1), (1, 0)):
        scene = rj.Scene()
        for n in order:
            scene.add(cards[n])
        frame = rj.render(
            scene, camera, size=(9, 7), outputs=("color", "depth", "object_id"), threads=1
        )
        assert (frame.object_id == order.index(0)).all()
        assert (frame.color == [255, 0, 0, 255]).all()
        # The metric depth is that of the stored one: near / (near / w), each rounded once.
        stored = np.float32(0.1 / float(near))
        assert (frame.depth == np.float32(0.1 / np.float64(stored))).all()


def soup(seed, count, size, reach):
    """Return screen points on the grid, depths of their vertices and faces."""
    rng = np.random.default_rng(seed)
    middles = np.repeat(rng.uniform(0, size, (count, 2)), 3, axis=0)
    points = np.round((middles + rng.uniform(-reach, reach, (3 * count, 2))) * 256) / 256
    return points, rng.uniform(0.1, 0.9, 3 * count), np.arange(3 * count).reshape(-1, 3)


@pytest.mark.case("Z05")
def test_second_pass_finds_its_own_depth_at_every_pixel():
    size = (128, 64)
    points, depths, faces = soup(5, 24, size, 40)
    first = screen.draw(points, faces, size, z=depths)
    seen = 0
    for face in range(len(faces)):
        # Alone, and spelled from another vertex and in the other direction.
        for spelling in (faces[face], faces[face][[1, 2, 0]], faces[face][[0, 2, 1]]):
            second = screen.draw(points, [spelling], size, z=depths)
            shown = first.face_id == face
            equal = (second.face_id == 0) & (second.depth == first.depth)
            assert equal[shown].all()
        seen += shown.sum()
    assert seen == (first.face_id >= 0).sum() > 1000


@pytest.mark.case("Z05")
def test_triangle_drawn_again_writes_as_many_equal_depths_as_pixels():
    size = (128, 128)
    points, depths, _ = soup(25, 1, size, 90)
    once = screen.draw(points, [[0, 1, 2]], size, z=depths)
    twice = screen.draw(points, [[0, 1, 2], [2, 0, 1], [0, 2, 1]], size, z=depths)
    assert set(np.unique(twice.face_id)) <= {-1, 0}
    assert (once.face_id == 0).sum() > 100
    assert once.depth.tobytes() == twice.depth.tobytes()


@pytest.mark.case("Z06")
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_first_of_coplanar_duplicates_is_seen_everywhere(threads):
    size = (256, 64)
    points, w = [(3, 2), (247, 20), (40, 63)], [1.0, 4.0, 2.0]
    colors = {"red": [255, 0, 0, 255], "green": [0, 255, 0, 255]}
    red, green = (
        screen.mesh(points, [[0, 1, 2]], size, w, colors=np.array([rgb[:3]] * 3, np.uint8))
        for rgb in colors.values()
    )
    for meshes, winner in (((red, green), "red"), ((green, red), "green")):
        scene = rj.Scene()
        for mesh in meshes:
            scene.add(mesh)
        frame = rj.render(
            scene, screen.camera(0.5), size=size, outputs=("color", "face_id"), threads=threads
        )
        hit = frame.face_id >= 0
        assert hit.sum() == len(rj.oracle.covered_pixels(points, size))
        assert (frame.color[hit] == colors[winner]).all()


@pytest.mark.case("Z07")
@pytest.mark.parametrize("square", [QUAD, [(3, 3), (120, 5), (118, 121), (4, 119)]])
def test_coplanar_quads_along_other_diagonals_tie_to_the_lower_face(square):
    faces = [[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]]
    seen = screen.draw(square, faces, (128, 128), z=0.1)
    assert set(np.unique(seen.face_id)) == {-1, 0, 1}
    assert (seen.depth[seen.face_id >= 0] == np.float32(0.1)).all()


@pytest.mark.case("Z08")
@pytest.mark.parametrize(
    ("square", "slope", "diagonal_ulps"),
    [
        ([(0, 0), (64, 0), (64, 64), (0, 64)], Fraction(1, 64), 0),
        # Its depths are no short binary numbers, so that the two may be rounded apart.
        ([(0, 0), (63, 0), (63, 61), (0, 61)], Fraction(1, 67), 1),
    ],
)
def test_quads_along_other_diagonals_fight_only_where_their_depths_differ(
    square, slope, diagonal_ulps, record_property
):
    z = [float(x * slope) for x, _ in square]
    one, other = [[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]
    first, second = (screen.draw(square, faces, (64, 64), z=z) for faces in (one, other))
    assert first.face_id.shape == (64, 64)
    hit = first.face_id >= 0
    assert (hit == (second.face_id >= 0)).all()
    steps = np.abs(first.depth[hit].view(np.int32) - second.depth[hit].view(np.int32))
    assert steps.max() <= diagonal_ulps
    together = screen.draw(square, one + other, (64, 64), z=z)
    fights = int((together.face_id >= 2).sum())
    record_property("pixels that fight", fights)
    assert fights <= np.count_nonzero(steps)
    if diagonal_ulps == 0:
        columns = np.nonzero(hit)[1]
        assert (first.depth[hit] == np.float32((columns + 0.5) / 64)).all()


@pytest.mark.case("Z09")
@pytest.mark.parametrize("depth", ["standard", "reversed"])
@pytest.mark.parametrize("w", [1.0, (1.0, 4.0, 0.5)])
@pytest.mark.parametrize(
    "points",
    [
        [(2.25, 1.75), (9.0, 3.25), (4.5, 10.5)],
        [(-50, -80), (300, 7), (20, 400)],
        [(1, 1), (120, 2), (5, 1.75)],
        [(-7000, 64), (8000, 60), (8000, 70)],
    ],
)
def test_equal_depths_stay_exactly_equal(points, w, depth):
    seen = screen.draw(points, [[0, 1, 2]], (128, 128), z=0.1, w=w, depth=depth)
    drawn = seen.depth[seen.face_id == 0]
    assert len(drawn)
    assert (drawn == np.float32(0.1)).all()


@pytest.mark.case("Z10")
def test_slivers_have_the_depth_of_their_plane():
    ring = [(64, 64 * k / 1000) for k in range(1001)]
    points = np.round(np.array([(0, 0), *ring]) * 2**14) / 2**14
    z = np.ones(1002)
    z[0] = 0.0
    seen = screen.draw(points, [[0, k, k + 1] for k in range(1, 1001)], (64, 64), z=z)
    rows, columns = np.nonzero(seen.face_id >= 0)
    drawn = seen.depth[rows, columns].astype(float)
    assert len(drawn) == 2080
    assert ((drawn >= 0.0) & (drawn <= 1.0)).all()
    assert np.abs(drawn - (columns + 0.5) / 64).max() <= 2.0**-20
    # Every face of the fan lies in the plane z = x / 64, whatever its snapped vertices.
    assert (drawn == (columns + 0.5) / 64).all()


@pytest.mark.case("Z11")
@pytest.mark.parametrize("w", [1.0, 0.1, 7.0])
@pytest.mark.parametrize("depth", ["standard", "reversed"])
def test_near_and_far_planes_are_inclusive(w, depth):
    for plane in (-w, w):
        outside = math.nextafter(plane, 2 * plane)
        for z, is_drawn in ((plane, True), (outside, False)):
            positions = [[-w, -w, z, w], [3 * w, -w, z, w], [-w, 3 * w, z, w]]
            seen = rj.rasterize(positions, [[0, 1, 2]], (8, 8), depth=depth, threads=1)
            assert (seen.face_id == (0 if is_drawn else -1)).all()
            assert (seen.depth == (plane / w if is_drawn else np.inf)).all()


@pytest.mark.case("Z11")
def test_face_that_just_crosses_a_plane_keeps_its_depth_inside():
    for plane in (-1.0, 1.0):
        outside = math.nextafter(plane, 2 * plane)
        positions = [[-1, -1, 0.0, 1], [3, -1, outside, 1], [-1, 3, outside, 1]]
        seen = rj.rasterize(positions, [[0, 1, 2]], (8, 8), threads=1)
        assert seen.totals.clipped == 1
        assert (seen.face_id == 0).all()
        assert (np.abs(seen.depth) <= 1.0).all()


@pytest.mark.case("Z12")
def test_half_of_a_quad_before_the_near_plane_is_left_out():
    # Depth 0..1 of -1/2..1/2 is z = -2..0 here. There is no depth clamp: what would be drawn with
    # depth 0 is not drawn.
    points = [(0, 0), (64, 0), (64, 16), (0, 16)]
    seen = screen.draw(points, [[0, 1, 2], [0, 2, 3]], (64, 16), z=[-2.0, 0.0, 0.0, -2.0])
    assert (seen.face_id[:, :32] == -1).all()
    assert (seen.face_id[:, 32:] >= 0).all()
    assert np.isinf(seen.depth[:, :32]).all()
    exact = (np.arange(32, 64) + 0.5) / 32 - 2.0
    assert (seen.depth[:, 32:] == exact.astype(np.float32)).all()


SLOPED = [(0, 0), (256, 0), (256, 4), (0, 4)], [[0, 1, 2], [0, 2, 3]], (256, 4)


@pytest.mark.case("Z13")
def test_depth_of_a_sloped_quad_has_the_slope_of_its_plane():
    # There is no depth bias: this is m, what a bias with slope factor 1 would add.
    seen = screen.draw(*SLOPED, z=[0.3, 0.5, 0.5, 0.3])
    slope = 0.2 / 256
    assert slope == 0.00078125
    steps = np.diff(seen.depth.astype(float), axis=1)
    # Two depths below 1/2, each rounded by at most half a float32 ulp.
    assert np.abs(steps - slope).max() <= 2 * (0.5 * np.spacing(np.float32(0.49)))
    assert (np.diff(seen.depth, axis=0) == 0.0).all()


@pytest.mark.case("Z13")
@pytest.mark.parametrize("step", [2.0**-16, 2.0**-15])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_quad_moved_by_a_depth_step_is_stored_that_much_deeper(step, sign):
    z = np.array([0.3, 0.5, 0.5, 0.3])
    unbiased, biased = (screen.draw(*SLOPED, z=depths).depth for depths in (z, z + sign * step))
    moved = biased.astype(float) - unbiased.astype(float)
    assert np.abs(moved - sign * step).max() <= 1e-5
    # Far less, in fact: each of the two is rounded by at most half a float32 ulp.
    assert np.abs(moved - sign * step).max() <= np.spacing(np.float32(0.49))


@pytest.mark.case("Z14")
@pytest.mark.parametrize("points", [[(1, 1), (60, 30.5), (119, 60)], [(8, 8), (8, 8), (90, 9)]])
def test_edge_on_triangle_stores_no_depth(points):
    # Its slope is infinite, and 0 times it NaN. There is no depth bias that could multiply it.
    seen = screen.draw(points, [[0, 1, 2]], (128, 64), z=[0.0, 1.0, 0.5])
    assert seen.totals.degenerate == 1
    assert (seen.face_id == -1).all()
    assert (seen.depth == np.inf).all()


@pytest.mark.case("Z14")
def test_nearly_edge_on_triangle_has_a_finite_depth():
    # One grid unit from a line through pixel centres: slopes of some 10**5 a pixel.
    points = [(0.5, 0.5), (120.5, 60.5), (60.5 + 1 / 256, 30.5)]
    seen = screen.draw(points, [[0, 1, 2]], (128, 64), z=[-1.0, 1.0, 1.0])
    drawn = seen.depth[seen.face_id == 0]
    assert len(drawn) == len(rj.oracle.covered_pixels(points, (128, 64))) > 0
    assert np.isfinite(drawn).all()
    assert (np.abs(drawn) <= 1.0).all()


@pytest.mark.case("Z15")
def test_every_draw_order_of_distinct_depths_gives_one_image():
    size = (64, 64)
    shapes = [
        ([(2, 2), (62, 5), (30, 60)], "red"), ([(5, 58), (63, 62), (40, 3)], "yellow"),
        ([(0, 30), (64, 20), (35, 50)], "blue"), ([(10, 10), (60, 12), (50, 63)], "white"),
    ]  # fmt: skip
    images = set()
    for order in itertools.permutations(range(4)):
        scene = rj.Scene()
        for n in order:
            points, color = shapes[n]
            mesh = screen.mesh(points, [[0, 1, 2]], size, 2.0**n)
            mesh.material = rj.Material(shading="unlit", base_color=color)
            scene.add(mesh)
        frame = rj.render(
            scene, screen.camera(0.5), size=size, outputs=("color", "depth"), background="black",
            threads=1,
        )  # fmt: skip
        images.add((frame.color.tobytes(), frame.depth.tobytes()))
    assert len(images) == 1
    depths = np.unique(np.frombuffer(images.pop()[1], np.float32))
    assert depths.tolist() == [1.0, 2.0, 4.0, 8.0, np.inf]


@pytest.mark.case("Z15")
def test_order_of_interpenetrating_faces_does_not_matter():
    size = (128, 128)
    points, depths, faces = soup(27, 40, size, 30)
    first = screen.draw(points, faces, size, z=depths)
    order = np.random.default_rng(27).permutation(40)
    second = screen.draw(points, faces[order], size, z=depths)
    assert first.depth.tobytes() == second.depth.tobytes()
    # Only where two faces have one float32 depth may the lower number be another face.
    renamed = np.where(second.face_id >= 0, order[second.face_id], -1)
    for row, column in np.argwhere(renamed != first.face_id):
        pair = [
            screen.draw(points, [faces[face[row, column]]], size, z=depths).depth[row, column]
            for face in (renamed, first.face_id)
        ]
        assert pair[0] == pair[1]


@pytest.mark.case("Z16")
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("corner", range(3))
@pytest.mark.parametrize("axis", range(4))
@pytest.mark.parametrize("depth", ["standard", "reversed"])
def test_face_without_a_depth_stores_none(bad, corner, axis, depth):
    good = np.array([[-1, -1, 0.5, 1], [3, -1, 0.5, 1], [-1, 3, 0.5, 1]])
    invalid = good.copy()
    invalid[corner, axis] = bad
    for order in ([[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]):
        positions = np.concatenate([good, invalid])
        seen = rj.rasterize(positions, order, (8, 8), depth=depth, threads=1)
        assert seen.totals.invalid == 1
        assert (seen.face_id == order.index([0, 1, 2])).all()
        assert (seen.depth == 0.5).all()


@pytest.mark.case("Z16")
@pytest.mark.parametrize(
    "corner",
    [(0, 0, 0, 0), (1, 0, 0, 0), (0, 0, 1, 0), (0, 0, -1, 0), (0, 0, 0, -1), (0, 0, 0, 5e-324)],
)
def test_vertex_that_divides_zero_by_zero_stores_no_nan(corner):
    positions = [[-1, -1, 0.5, 1], [1, -1, 0.5, 1], corner]
    for depth in ("standard", "reversed"):
        seen = rj.rasterize(positions, [[0, 1, 2]], (16, 16), depth=depth, threads=1)
        assert not np.isnan(seen.depth).any()
        assert (np.isinf(seen.depth) == (seen.face_id < 0)).all()
        drawn = seen.depth[seen.face_id == 0]
        assert (np.abs(drawn) <= 1.0).all()
