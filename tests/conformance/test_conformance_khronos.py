"""
Re-creation of the rasterization and clipping tests of the Khronos conformance suites.

Source: KhronosGroup/VK-GL-CTS, ``modules/gles3/functional/es3fRasterizationTests.cpp`` (read at
0d2b8ae; fill rules, triangles, lines, culling, interpolation), ``es3fClippingTests.cpp`` beside it
(read at 2a27c34; polygons, edges, vertices, lines), and
``external/vulkancts/modules/vulkan/clipping/vktClippingTests.cpp`` (read at 7246b45: inside and
outside; the halves and the cull-distance case are re-made from their description).

What it checks: rotated squares of two triangles, added up, must have no pixel twice, and none
missing where the square fills the picture; triangles, strips and fans have the pixels that exact
edges give them, also if 30000 to 100000 times larger than the picture, cut by one to three
vertices, or with any w; values between vertices are right on the screen and in space; faces turned
away are left out.

What differs
- The suites allow for any snapping: a pixel may be one off, and 6 of a picture wrong altogether.
  RasterJIT says where it snaps, so each face alone must have the oracle's pixels, all of them.
- Their random numbers are those of their own generator; here NumPy draws from the same ranges.
- A RasterJIT image is the whole viewport, so their reduced viewports are smaller images.
- Vulkan's depth 0..1 becomes -1..1. There are no user clip planes, no depth clamp, no points and no
  wide lines in RasterJIT, and culling both sides at once is drawing nothing.
- Their lines follow the diamond rule; RasterJIT's are Bresenham's between the pixels of the ends.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from drawn import PRIMITIVES, covered, draw, exactly_covered, flat, hits_as_exact, triangle_list

import rasterjit as rj
from rasterjit.inspect import oracle

FULL = (256, 256)
MEDIUM = (128, 128)
QUARTER = (64, 64)
CANVAS = (200, 200)
CENTRE_VIEWPORT = (100, 100)
SMALL = (32, 32)
"""Where the number of triangles is what counts."""

HALF_ULP = 2.0**-24
"""Rounding of a float32 in 1/2..1 is at most half of 2**-24; the sum before it is in float64."""

ORDERS = {"basic": (0, 1, 2, 2, 0, 3), "reversed": (0, 1, 2, 0, 2, 3)}


def float32(values):
    """Return what is left of numbers in the suites' own precision."""
    return np.asarray(values, np.float32).astype(float)


# --- fill rules -----------------------------------------------------------------------------------


def rotated_square(centre, half_side, turn):
    """Return the corners of a square, turned by a share of 90 degrees; the order is theirs."""
    angle = turn * math.pi / 2
    across = half_side * np.array([math.cos(angle), math.sin(angle)])
    along = np.array([across[1], -across[0]])
    centre = np.array(centre, float)
    return float32(
        [centre + s * across + t * along for s, t in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    )


def squares(iteration):
    """Return the 16 squares of one picture; none touches another."""
    for column, row in itertools.product(range(4), range(4)):
        centre = (row + 0.5) / 2 - 1, (column + 0.5) / 2 - 1
        yield rotated_square(centre, 0.15, (iteration * 16 + column * 4 + row) / 32)


@pytest.mark.parametrize("iteration", [0, 1])
@pytest.mark.parametrize("order", ORDERS)
def test_rotated_squares_have_no_pixel_twice(order, iteration):
    positions = np.concatenate(
        [flat(corners)[list(ORDERS[order])] for corners in squares(iteration)]
    )
    hits = hits_as_exact(positions, triangle_list(len(positions)), FULL)
    assert hits.max() == 1
    # Where the diagonal is cut does not show: the square cut the other way has the same pixels.
    other_way = np.concatenate(
        [flat(corners)[[1, 2, 3, 3, 1, 0]] for corners in squares(iteration)]
    )
    whole = draw(other_way, triangle_list(len(other_way)), FULL).face_id >= 0
    assert (whole == (hits == 1)).all()


@pytest.mark.parametrize("iteration", [0, 1])
def test_projected_squares_have_no_pixel_twice(iteration):
    rng = np.random.default_rng(0xABCD)
    corners = []
    for square in squares(iteration):
        ws = float32(rng.uniform(0.1, 4.0, 4))
        corners.append(float32(flat(square) * ws[:, None])[list(ORDERS["basic"])])
    positions = np.concatenate(corners)
    assert hits_as_exact(positions, triangle_list(len(positions)), FULL).max() == 1


@pytest.mark.parametrize("step", range(15))
def test_square_that_is_clipped_on_all_sides_fills_the_picture_once(step):
    positions = flat(rotated_square((0, 0), 2.0, step / 14))[list(ORDERS["basic"])]
    assert (hits_as_exact(positions, triangle_list(6), QUARTER) == 1).all()


@pytest.mark.parametrize("step", range(15))
def test_square_that_is_clipped_on_two_sides_has_no_pixel_twice(step):
    positions = flat(rotated_square((0.5, 0.5), 1.0, step / 14))[list(ORDERS["basic"])]
    hits = hits_as_exact(positions, triangle_list(6), QUARTER)
    assert hits.max() == 1
    if step in (0, 14):
        # Upright, it is three quarters of the picture wide and high, in the upper right corner.
        assert (hits == np.pad(np.ones((48, 48), int), ((0, 16), (16, 0)))).all()


# --- primitives -----------------------------------------------------------------------------------

TRIANGLES = {
    "list": [
        [(0.2, 0.8), (0.5, 0.2), (0.5, 0.3), (-0.5, 0.2), (-1.5, -0.4), (-0.4, 0.2)],
        [(-0.499, 0.128), (-0.501, -0.3), (0.11, -0.2), (0.11, 0.2), (0.88, 0.9), (0.4, 1.2)],
        [(-0.9, -0.3), (1.1, -0.9), (-1.1, -0.1), (-0.11, 0.2), (0.88, 0.7), (-0.4, 0.4)],
    ],
    "strip": [
        [(-0.504, 0.8), (-0.2, -0.2), (-0.2, 0.199), (0.5, 0.201), (1.5, 0.4)],
        [(-0.499, 0.129), (-0.501, -0.3), (0.11, -0.2), (0.11, -0.31), (0.88, 0.9)],
        [(-0.9, -0.3), (1.1, -0.9), (-0.87, -0.1), (-0.11, 0.19), (0.88, 0.7)],
    ],
    "fan": [
        [(0.01, 0.0), (0.5, 0.2), (0.46, 0.3), (-0.5, 0.2), (-1.5, -0.4)],
        [(-0.499, 0.128), (-0.501, -0.3), (0.11, -0.2), (0.11, 0.2), (0.88, 0.9)],
        [(-0.9, -0.3), (1.1, -0.9), (0.7, -0.1), (0.11, 0.2), (0.88, 0.7)],
    ],
}
LINES = [
    [(0.01, 0.0), (0.5, 0.2), (0.46, 0.3), (-0.3, 0.2), (-1.5, -0.4), (0.1, 0.5)],
    [(-0.499, 0.128), (-0.501, -0.3), (0.11, -0.2), (0.11, 0.2), (0.88, 0.9), (0.18, -0.2)],
    [(-0.9, -0.3), (1.1, -0.9), (0.7, -0.1), (0.11, 0.2), (0.88, 0.7), (0.8, -0.7)],
]
LINE_ENDS = {
    "list": lambda n: [(k, k + 1) for k in range(0, n - 1, 2)],
    "strip": lambda n: [(k, k + 1) for k in range(n - 1)],
    "loop": lambda n: [(k, (k + 1) % n) for k in range(n)],
}


@pytest.mark.parametrize("iteration", [0, 1, 2])
@pytest.mark.parametrize("primitive", TRIANGLES)
def test_triangles_have_exactly_their_pixels(primitive, iteration):
    positions = flat(float32(TRIANGLES[primitive][iteration]))
    faces = PRIMITIVES[primitive](len(positions))
    hits = hits_as_exact(positions, faces, FULL)
    # All at once, every pixel shows the first face that covers it, since all depths are equal.
    seen = draw(positions, faces, FULL).face_id
    masks = [covered(positions, face, FULL) for face in faces]
    assert (seen == np.where(hits > 0, np.argmax(masks, axis=0), -1)).all()


@pytest.mark.parametrize("iteration", [0, 1, 2])
@pytest.mark.parametrize("primitive", LINE_ENDS)
def test_lines_take_one_pixel_a_step_along_the_longer_axis(primitive, iteration):
    points = float32(LINES[iteration])
    pixels = [(math.floor((1 + x) * 128), math.floor((1 - y) * 128)) for x, y in points]
    framebuffer = rj.Framebuffer(*FULL)
    together = set()
    for a, b in LINE_ENDS[primitive](len(points)):
        start, end = pixels[a], pixels[b]
        framebuffer.clear()
        framebuffer.draw_line(start, end, (255, 255, 255))
        drawn = {(i, j) for j, i in np.argwhere(framebuffer.color[..., 0] > 0).tolist()}
        assert drawn == {
            (x, y) for x, y in oracle.line_pixels(start, end) if 0 <= x < 256 and 0 <= y < 256
        }
        together |= drawn
        # Without the oracle: no step has two pixels, and none is more than half a pixel off.
        (dx, dy) = (end[0] - start[0], end[1] - start[1])
        longer = int(abs(dy) > abs(dx))
        assert len({pixel[longer] for pixel in drawn}) == len(drawn)
        for x, y in drawn:
            off = abs(dx * (y - start[1]) - dy * (x - start[0]))
            assert 2 * off <= max(abs(dx), abs(dy))
    framebuffer.clear()
    ends = [(*pixels[a], *pixels[b]) for a, b in LINE_ENDS[primitive](len(points))]
    framebuffer.draw_lines(ends, (255, 255, 255))
    assert {(i, j) for j, i in np.argwhere(framebuffer.color[..., 0] > 0).tolist()} == together


# --- interpolation --------------------------------------------------------------------------------


@pytest.mark.parametrize("projected", [False, True])
@pytest.mark.parametrize("primitive", PRIMITIVES)
@pytest.mark.parametrize("iteration", [0, 1, 2])
def test_red_green_and_blue_corners_mix_by_the_exact_weights(iteration, primitive, projected):
    rng = np.random.default_rng([123, iteration, list(PRIMITIVES).index(primitive)])
    positions = flat(float32(rng.uniform(-0.9, 0.9, (6, 2))))
    if projected:
        positions = float32(positions * float32(rng.uniform(0.2, 4.0, (6, 1))))
    for face in PRIMITIVES[primitive](6):
        mask = exactly_covered(positions, face, MEDIUM)
        # With corners of pure red, green and blue the colour is the weights.
        colors = draw(positions, [face], MEDIUM).barycentric
        assert colors[mask].min() >= 0
        assert colors[mask].max() <= 1
        assert not colors[~mask].any()
        corners = [oracle.screen_position(positions[n].tolist(), MEDIUM) for n in face]
        snapped = [(Fraction(x, 256), Fraction(y, 256)) for x, y in oracle.snap_triangle(corners)]
        ws = positions[list(face), 3].tolist()
        for row, column in np.argwhere(mask)[::37].tolist():
            centre = column + Fraction(1, 2), row + Fraction(1, 2)
            want = [float(w) for w in oracle.perspective_weights(snapped, ws, centre)]
            assert (abs(colors[row, column] - want) <= HALF_ULP).all()


# --- culling --------------------------------------------------------------------------------------


@pytest.mark.parametrize("front", ["ccw", "cw"])
@pytest.mark.parametrize("cull", ["none", "back", "front"])
@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_faces_that_are_culled_are_those_turned_away(primitive, cull, front):
    rng = np.random.default_rng(543210)
    positions = flat(float32(rng.uniform(-0.9, 0.9, (6, 2))))
    faces = PRIMITIVES[primitive](6)
    if front == "cw":
        # RasterJIT's front is counter-clockwise; turning each face round says the other.
        faces = [(a, c, b) for a, b, c in faces]
    for face in faces:
        a, b, c = positions[list(face), :2].tolist()
        # y points up here, so a positive turn is counter-clockwise.
        is_front = oracle.edge(a, b, c) > 0
        kept = cull == "none" or is_front == (cull == "back")
        want = exactly_covered(positions, face, QUARTER) & kept
        assert (covered(positions, face, QUARTER, cull=cull) == want).all()
        assert draw(positions, [face], QUARTER, cull=cull).totals.culled == (not kept)


def test_front_and_back_share_out_the_faces_of_a_fan():
    # The six vertices of the culling case turn both ways in a fan.
    rng = np.random.default_rng(543210)
    positions = flat(float32(rng.uniform(-0.9, 0.9, (6, 2))))
    faces = PRIMITIVES["fan"](6)
    culled = [
        draw(positions, faces, QUARTER, cull=cull).totals.culled for cull in ("back", "front")
    ]
    assert min(culled) > 0
    assert sum(culled) == len(faces)


# --- clipping of polygons -------------------------------------------------------------------------

LARGE = 100000.0
OFFSET = 0.9
POLYGONS = {
    "viewport": [
        [(-0.8, -0.2, 0), (-0.8, 0.2, 0), (-1.3, 0.05, 0)],
        [(-0.6, -1.2, 0), (-1.2, -0.6, 0), (-0.6, -0.6, 0)],
        [(-1.1, 0.6, 0), (-1.1, 1.1, 0), (-0.6, 1.1, 0)],
        [(0.8, 1.1, 0), (0.95, -1.1, 0), (3.0, 0.0, 0)],
    ],
    "depth": [
        [(-0.2, 0.7, 0), (0.2, 0.7, 0), (0.0, 0.9, 2.0)],
        [(0.9, 0.4, -1.5), (0.9, -0.4, -1.5), (0.6, 0.0, 0)],
        [(-0.9, 0.6, -2.0), (-0.9, -0.6, -2.0), (-0.4, 0.0, 2.0)],
        [(0.0, -1.2, 0), (0.0, 0.5, -1.5), (1.2, -0.9, 0)],
    ],
    "large": [
        [(-0.2, -0.3, 0), (0.2, -0.3, 0), (0.0, -LARGE, 2.0)],
        [(0.5, 0.5, 0), (LARGE, 0.5, 0), (0.5, LARGE, 0)],
        [(-0.9, -LARGE, 0), (-1.1, -LARGE, 0), (-0.9, LARGE, 0)],
    ],
    "large depth": [
        [(-0.2, -0.3, 0), (0.2, -0.3, 0), (0.0, -LARGE, LARGE)],
        [(0.5, 0.5, 0), (0.9, LARGE / 2, -LARGE), (LARGE / 4, 0.0, -LARGE)],
        [(-0.9, LARGE / 4, LARGE), (-0.5, -LARGE / 4, -LARGE), (-0.2, LARGE / 4, LARGE)],
    ],
    "special depth": [
        [(0.0, -0.7, -0.9), (0.8, 0.0, -0.7), (-0.9, 0.9, 3.0)],
        [(0.0, -0.7, 0.9), (0.4, 0.0, 0.7), (-0.9, 0.9, -3.0)],
    ],
    "attributes": [
        [(-0.2, -0.3, 0), (0.2, -0.3, 0), (0.0, -OFFSET, 2.0)],
        [(-0.2, -0.3, 0), (0.2, -0.3, 0), (0.0, -OFFSET, -2.0)],
        [(0.3, 0.2, 0), (0.3, -0.2, 0), (OFFSET, 0.0, 2.0)],
        [(-0.3, 0.2, 0), (-0.3, -0.2, 0), (-OFFSET, 0.0, 2.0)],
        [(-0.9, OFFSET / 4, OFFSET), (-0.5, -OFFSET / 4, -OFFSET), (-0.2, OFFSET / 4, OFFSET)],
        [(0.6, 1.2, 0), (1.2, 0.6, 0), (0.6, 0.6, 0)],
    ],
}
SHARED_CORNER = [
    [(0.6 * x, 1.2 * y, 0, 1), (1.2 * x, 0.6 * y, 0, 1), (9.6 * x, 9.6 * y, 0, 16)]
    for x, y in itertools.product((-1, 1), (-1, 1))
]
"""Two vertices beyond the sides, the third with w = 16."""


def in_space(corners):
    """Return points (x, y, z) as clip positions with w = 1, in the suites' precision."""
    return float32([(*corner, 1.0) for corner in corners])


ALL_POLYGONS = [in_space(corners) for group in POLYGONS.values() for corners in group]
ALL_POLYGONS += [float32(corners) for corners in SHARED_CORNER]


@pytest.mark.parametrize("size", [CENTRE_VIEWPORT, CANVAS, (97, 61)])
def test_clipped_polygons_have_exactly_their_pixels(size):
    for positions in ALL_POLYGONS:
        assert hits_as_exact(positions, [(0, 1, 2)], size).any()


@pytest.mark.parametrize("number", range(len(ALL_POLYGONS)))
def test_clipping_does_not_change_what_lies_between_the_vertices(number):
    positions = ALL_POLYGONS[number]
    size = CENTRE_VIEWPORT
    seen = draw(positions, [(0, 1, 2)], size)
    corners = positions.tolist()
    if oracle.clip_polygon(corners, oracle.guard_band(size)) == [tuple(c) for c in corners]:
        # Not cut, only beyond the sides: the vertices are snapped, and that is what is seen.
        screen = oracle.snap_triangle([oracle.screen_position(c, size) for c in corners])
        snapped = [(Fraction(x, 256), Fraction(y, 256)) for x, y in screen]
        ws = [c[3] for c in corners]

        def exact(point):
            return oracle.perspective_weights(snapped, ws, point)
    else:

        def exact(point):
            return oracle.clip_weights(corners, point, size)

    for row, column in np.argwhere(seen.face_id == 0)[::23].tolist():
        want = [float(w) for w in exact((column + Fraction(1, 2), row + Fraction(1, 2)))]
        # A centre that snapping took in may lie outside the face: then the weight is brought in.
        want = np.clip(want, 0.0, 1.0)
        assert (abs(seen.barycentric[row, column] - want) <= HALF_ULP).all()


# --- clipping: huge quads and a fan ---------------------------------------------------------------

QUADS = [
    ((1, 1, 1), (1, -1, 1), (0, 0, 0)),
    ((1, 1, 1), (-1, 1.1, 1), (0, 0, 0)),
    ((1, 1, 0), (-1, 1, 0), (0, 0, 0)),
    ((0, 1, 0), (1, 0, 0), (0, 0, 0)),
    ((0, 1, 0), (1, 0.1, 0), (0, 0, 0)),
    ((1, 0.01, 0), (0, 0.01, 0), (0, 0.99, 0)),
    ((0.01, 1, 0), (0.01, 0, 0), (0.99, 0, 0)),
    ((1, 1, 0.01), (0.01, -0.01, 0), (0, 0, 0.99)),
]
"""Tangent, second tangent and centre; the half sides are 40000 times the tangents."""

FAN_CORNERS = [
    # The corner that a quarter circle is around, where it begins and where it ends.
    ((1, 1, 1), (0, 1, 1), (1, 0, 1)),
    ((1, -1, 1), (1, 0, 1), (1, -1, 0)),
    ((1, -1, -1), (1, -1, 0), (0, -1, -1)),
    ((-1, -1, -1), (0, -1, -1), (-1, 0, -1)),
    ((-1, 1, -1), (-1, 0, -1), (-1, 1, 0)),
    ((-1, 1, 1), (-1, 1, 0), (0, 1, 1)),
]


def huge_quad(first, second, centre):
    """Return the two triangles of a quad, as six clip positions."""
    first, second, centre = (float32(v) for v in (first, second, centre))
    first, second = 40000 * first, 40000 * second
    corners = [centre + s * first + t * second for s, t in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    return in_space([corners[n] for n in (0, 1, 2, 0, 2, 3)])


@pytest.mark.parametrize("quad", QUADS)
def test_quad_of_40000_half_sides_fills_the_picture_once(quad):
    hits = hits_as_exact(huge_quad(*quad), triangle_list(6), CENTRE_VIEWPORT)
    assert (hits == 1).all()


def rim():
    """Return the 240 points around the fan, on six quarter circles that meet."""
    points = []
    for corner, entry, leave in np.array(FAN_CORNERS, float):
        for step in range(40):
            toward = (entry - corner) * (1 - step / 40) + (leave - corner) * (step / 40)
            points.append(corner + toward / np.linalg.norm(toward))
    return points


def test_fan_of_radius_70000_through_all_six_planes_has_no_pixel_twice():
    points = [np.zeros(3), *(70000 * float32(rim()))]
    positions = in_space(points)
    faces = [(0, n, n % 240 + 1) for n in range(1, 241)]
    hits = hits_as_exact(positions, faces, CENTRE_VIEWPORT)
    assert hits.max() == 1
    # Around its hub it is whole, and all of its slices can be seen in one picture.
    assert (hits[45:55, 45:55] == 1).all()
    assert (draw(positions, faces, CENTRE_VIEWPORT).face_id >= 0).sum() == hits.sum()


# --- clipping: one, two and three vertices outside ------------------------------------------------

FAR = 30000.0
OUTSIDE = [d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)]
INSIDE = [(0.2, 0.3, 0.0), (-0.3, -0.4, 0.0)]


def with_w(corners, rng):
    """Return points as clip positions, each with a random w."""
    return float32(in_space(corners) * rng.uniform(0.2, 16.0, (3, 1)))


def far(direction):
    return tuple(FAR * c for c in direction)


def test_triangle_with_one_vertex_outside_has_exactly_its_pixels():
    rng = np.random.default_rng(0xABCDEF)
    assert len(OUTSIDE) == 26
    for direction in OUTSIDE:
        positions = with_w([*INSIDE, far(direction)], rng)
        hits = hits_as_exact(positions, [(0, 1, 2)], CENTRE_VIEWPORT)
        # Straight ahead or behind, the triangle is cut so close to its edge that it may be missed.
        assert hits.any() or direction[:2] == (0, 0)


def test_triangle_with_two_vertices_outside_has_exactly_its_pixels():
    rng = np.random.default_rng(0xABCDEF)
    seen = 0
    for pair in itertools.combinations(OUTSIDE, 2):
        positions = with_w([INSIDE[0], *map(far, pair)], rng)
        seen += hits_as_exact(positions, [(0, 1, 2)], SMALL).any()
    assert seen > 200


def test_triangle_with_three_vertices_outside_has_exactly_its_pixels():
    rng = np.random.default_rng(0xABCDEF)
    seen = 0
    for triple in list(itertools.combinations(OUTSIDE, 3))[::8]:
        positions = with_w(list(map(far, triple)), rng)
        seen += hits_as_exact(positions, [(0, 1, 2)], SMALL).any()
    assert seen > 30


# --- clip volume and culling by distance, of Vulkan -----------------------------------------------

SIXTEEN = (16, 16)
WHOLE = {
    "list": [(1, -1), (-1, -1), (-1, 1), (-1, 1), (1, 1), (1, -1)],
    "strip": [(-1, -1), (-1, 1), (1, -1), (1, 1)],
    "fan": [(1, -1), (-1, -1), (-1, 1), (1, 1)],
}


def sloped(points, left, right):
    """Return points as clip positions whose depth, 0..1 at the planes, goes from left to right."""
    depth = [left + (right - left) * (x + 1) / 2 for x, _ in points]
    return np.array([(x, y, 2 * d - 1, 1) for (x, y), d in zip(points, depth, strict=True)], float)


@pytest.mark.parametrize("primitive", PRIMITIVES)
@pytest.mark.parametrize(("depth", "hit"), [(0, 1), (0.5, 1), (1, 1), (-0.5, 0), (1.5, 0)])
def test_near_and_far_plane_belong_to_the_clip_volume(primitive, depth, hit):
    positions = sloped(WHOLE[primitive], depth, depth)
    faces = PRIMITIVES[primitive](len(positions))
    assert (hits_as_exact(positions, faces, SIXTEEN) == hit).all()


@pytest.mark.parametrize("primitive", PRIMITIVES)
@pytest.mark.parametrize(("left", "right", "first", "last"), [(-0.5, 0.5, 8, 16), (0.5, 1.5, 0, 8)])
def test_half_picture_outside_in_depth_is_empty(primitive, left, right, first, last):
    positions = sloped(WHOLE[primitive], left, right)
    hits = hits_as_exact(positions, PRIMITIVES[primitive](len(positions)), SIXTEEN)
    want = np.zeros((16, 16), int)
    want[:, first:last] = 1
    assert (hits == want).all()


AXES = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]


@pytest.mark.parametrize("three", list(itertools.combinations(range(6), 3)))
def test_face_whose_vertices_are_outside_different_planes_is_not_left_out(three):
    # The trap of the cull-distance case: every vertex is outside, but not of one and the same
    # plane. The planes here are those of the view volume; a small turn keeps an area.
    corners = [
        (1.5 * x + math.cos(2 * k) / 4, 1.5 * y + math.sin(2 * k) / 4, 1.5 * z)
        for k, (x, y, z) in enumerate(AXES[n] for n in three)
    ]
    positions = in_space(corners)
    assert hits_as_exact(positions, [(0, 1, 2)], SMALL).any()
    # Moved beyond the plane of the first vertex, all three are outside of it.
    beyond = positions + [*(3 * np.array(AXES[three[0]])), 0]
    assert not hits_as_exact(beyond, [(0, 1, 2)], SMALL).any()


# --- clipping of lines ----------------------------------------------------------------------------

LONG_LINES = [
    ((-41000, -40000, -1000000), (41000, 40000, 1000000)),
    ((41000, -40000, 1000000), (-41000, 40000, -1000000)),
    ((0.5, -40000, 100000), (0.5, 40000, -100000)),
    ((-0.5, 40000, 100000), (-0.5, -40000, -100000)),
]
DEPTH_LINES = [
    ((0, 0, 0), (1.3, 1.0, 2.0)),
    ((0, 0, 0), (1.3, -1.0, 2.0)),
    ((0, 0, 0), (-1.0, -1.1, -2.0)),
    ((0, 0, 0), (-1.0, 1.1, -2.0)),
]
BEYOND = 1 + 2 / 200
VIEWPORT_LINES = [
    ((0, 0, 0), (0.0, 1.5, 0)),
    ((0, 0, 0), (-1.5, 1.0, 0)),
    ((0, 0, 0), (-1.5, 0.0, 0)),
    ((0, 0, 0), (0.2, 0.4, 1.5)),
    ((0, 0, 0), (-2.0, -1.0, 0)),
    ((1.5, 0.0, 0), (0.8, -0.2, 0)),
    ((0.0, -1.5, 0), (0.9, -0.7, 0)),
    ((0.0, -1.3, 0), (1.3, 0.0, 0)),
    ((-0.8, -BEYOND, 0), (0.0, -BEYOND, 0)),
    ((-BEYOND - 1, 0.0, 0), (0.0, -BEYOND - 1, 0)),
]
FLAT = rj.MatrixCamera(np.eye(4), np.eye(4))
"""World space is normalized device coordinates; w is 1 everywhere."""


def line_in_space(start, end, size):
    """Return the pixels of a segment, drawn as the edge of a face without area."""
    scene = rj.Scene()
    scene.add(rj.Mesh([start, end], [(0, 1, 1)]))
    scene.wireframe = rj.Wireframe("white", "only")
    frame = rj.render(scene, FLAT, size=size, background="transparent", threads=1)
    return {(i, j) for j, i in np.argwhere(frame.color[..., 3] > 0).tolist()}


def exact_line_in_space(start, end, size):
    """Return the pixels of a segment that is cut exactly."""
    a, b = (*start, 1.0), (*end, 1.0)
    # As a polygon without area; each of its ends may be listed twice.
    left = list(dict.fromkeys(oracle.clip_polygon([a, b, b], oracle.guard_band(size))))
    if not left:
        return set()
    ends = [
        tuple(map(math.floor, oracle.screen_position(vertex, size)))
        for vertex in (left[0], left[-1])
    ]
    pixels = oracle.line_pixels(*ends)
    return {(x, y) for x, y in pixels if 0 <= x < size[0] and 0 <= y < size[1]}


@pytest.mark.parametrize("size", [CANVAS, CENTRE_VIEWPORT, (97, 61)])
@pytest.mark.parametrize("lines", [LONG_LINES, DEPTH_LINES, VIEWPORT_LINES[:-2]])
def test_clipped_lines_are_what_exact_clipping_leaves(lines, size):
    for start, end in float32(lines):
        exact = exact_line_in_space(start.tolist(), end.tolist(), size)
        assert exact
        assert line_in_space(start, end, size) == exact
        assert line_in_space(end, start, size) == exact


@pytest.mark.parametrize("line", VIEWPORT_LINES[-2:])
def test_thin_line_one_pixel_beyond_the_picture_is_not_seen(line):
    start, end = float32(line)
    assert line_in_space(start, end, CANVAS) == set()
