"""Hard cases L01 to L25: lines."""

from __future__ import annotations

import math
import time
from fractions import Fraction
from itertools import pairwise

import catalogue
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.runtime import jit

LOW, HIGH = -(2**31), 2**31 - 1
WHITE = (255, 255, 255, 255)
SMALL = (16, 16)


# --- what the cases share -------------------------------------------------------------------------


def blank(size):
    """Return a framebuffer that is transparent black everywhere."""
    framebuffer = rj.Framebuffer(*size)
    framebuffer.clear((0, 0, 0, 0))
    return framebuffer


def draw(ends, size=SMALL):
    """Return the pixels (column, row) of a line given as (x0, y0, x1, y1)."""
    framebuffer = blank(size)
    framebuffer.draw_line(ends[:2], ends[2:], WHITE)
    return pixels(framebuffer.color)


def pixels(color):
    """Return the pixels of an (H, W, 4) picture that are not transparent black."""
    return {(int(column), int(row)) for row, column in np.argwhere(color.any(axis=2))}


def backward(ends):
    return (*ends[2:], *ends[:2])


def exact_visible(ends, size=SMALL):
    """Return the pixels inside the image of a line of any length, by rational arithmetic."""
    start, end = ends[:2], ends[2:]
    major = 0 if abs(end[0] - start[0]) >= abs(end[1] - start[1]) else 1
    sign = 1 if end[major] >= start[major] else -1
    # Only steps in the image's columns, or rows, can be seen: one each.
    steps = [sign * (place - start[major]) for place in range(size[major])]
    steps = [step for step in steps if 0 <= step <= abs(end[major] - start[major])]
    listed = oracle.line_pixels(start, end, steps=steps)
    return {(x, y) for x, y in listed if 0 <= x < size[0] and 0 <= y < size[1]}


# --- pixels ---------------------------------------------------------------------------------------


@pytest.mark.case("L01")
@pytest.mark.parametrize("transpose", [False, True])
@pytest.mark.parametrize("flip_x", [1, -1])
@pytest.mark.parametrize("flip_y", [1, -1])
def test_octants_are_reflections_of_one_another(transpose, flip_x, flip_y):
    first = [(0, 0), (1, 0), (2, 1), (3, 1), (4, 2), (5, 2), (6, 3), (7, 3)]
    assert oracle.line_pixels((0, 0), (7, 3)) == first

    def place(x, y):
        x, y = (y, x) if transpose else (x, y)
        return 8 + flip_x * x, 8 + flip_y * y

    ends = (*place(0, 0), *place(7, 3))
    assert draw(ends, (17, 17)) == draw(backward(ends), (17, 17)) == {place(*p) for p in first}


@pytest.mark.case("L02")
def test_line_of_no_length_is_one_pixel_of_the_start_color():
    framebuffer = blank((3, 3))
    framebuffer.draw_line((0, 0), (0, 0), (1, 2, 3, 4), (5, 6, 7, 8))
    assert pixels(framebuffer.color) == {(0, 0)}
    assert framebuffer.color[0, 0].tolist() == [1, 2, 3, 4]


SIDE, REACH = 33, 16
VECTORS = [(dx, dy) for dy in range(-REACH, REACH + 1) for dx in range(-REACH, REACH + 1)]


def draw_panels(color, end_color, flip=False):
    """
    Draw all 1089 vectors in [-16, 16]^2 from the middle of a panel of their own, or towards it.

    Returns {vector: (33, 33, 4) picture}.
    """
    ends = []
    for dx, dy in VECTORS:
        x, y = SIDE * (dx + REACH) + REACH, SIDE * (dy + REACH) + REACH
        ends.append((x + dx, y + dy, x, y) if flip else (x, y, x + dx, y + dy))
    framebuffer = blank((SIDE * SIDE, SIDE * SIDE))
    framebuffer.draw_lines(ends, [(color, end_color)] * len(ends))
    panels = framebuffer.color.reshape(SIDE, SIDE, SIDE, SIDE, 4)
    return {(dx, dy): panels[dy + REACH, :, dx + REACH] for dx, dy in VECTORS}


@pytest.mark.case("L03")
def test_every_line_is_a_connected_run_of_the_nearest_pixels():
    for (dx, dy), panel in draw_panels(WHITE, WHITE).items():
        line = {(x - REACH, y - REACH) for x, y in pixels(panel)}
        n = max(abs(dx), abs(dy))
        assert line == set(oracle.line_pixels((0, 0), (dx, dy)))
        assert len(line) == n + 1
        assert {(0, 0), (dx, dy)} <= line
        major = 0 if abs(dx) >= abs(dy) else 1
        ordered = sorted(line, key=lambda p, k=major: p[k])
        for (x, y), (u, v) in pairwise(ordered):
            assert abs((x, y)[major] - (u, v)[major]) == 1
            assert max(abs(x - u), abs(y - v)) == 1
        slope = Fraction((dy, dx)[major], (dx, dy)[major]) if n else 0
        assert all(abs(p[1 - major] - slope * p[major]) <= Fraction(1, 2) for p in line)


@pytest.mark.case("L04")
def test_tie_goes_to_the_larger_coordinate_from_either_end():
    for ends, want in (
        ((0, 0, 2, 1), {(0, 0), (1, 1), (2, 1)}),
        ((0, 1, 2, 0), {(0, 1), (1, 1), (2, 0)}),
        ((0, 0, 1, 2), {(0, 0), (1, 1), (1, 2)}),
        ((1, 0, 0, 2), {(1, 0), (1, 1), (0, 2)}),
    ):
        assert draw(ends) == draw(backward(ends)) == want


@pytest.mark.case("L05")
def test_reversed_line_has_the_same_pixels_and_colors():
    first, last = (10, 20, 30, 40), (250, 0, 31, 255)
    there, back = draw_panels(first, last), draw_panels(last, first, flip=True)
    assert len(there) == 1089
    for vector in VECTORS:
        # A line of no length has the colour of its start.
        if vector != (0, 0):
            assert there[vector].tobytes() == back[vector].tobytes()


LONG = "0,0 1,1 2,1 3,2 4,2 5,3 6,3 7,4 8,4 9,5 10,5 11,6 12,6 13,7 14,7 15,8"
THROUGH = {
    "L06": ((-3, -1, 18, 9), LONG),
    "L07": ((5, -100, 9, 200), " ".join(f"{6 if y <= 12 else 7},{y}" for y in range(16))),
    "L08": ((20, -5, -5, 20), " ".join(f"{k},{15 - k}" for k in range(16))),
    "L09": ((LOW, -(2**30), HIGH, 2**30), LONG),
    "L10": ((LOW, LOW, HIGH, HIGH), " ".join(f"{k},{k}" for k in range(16))),
    "L11": ((LOW, HIGH, HIGH, LOW), ""),
    "L12": ((0, LOW, 15, HIGH), " ".join(f"8,{k}" for k in range(16))),
    "L13": ((LOW, 3, HIGH, 12), " ".join(f"{k},8" for k in range(16))),
    "L14": ((-1000000, 7, 1000000, 8), " ".join(f"{k},8" for k in range(16))),
    "L15 beside": ((-5, 20, 40, 20), ""),
    "L15 above": ((0, -9, 15, -1), ""),
    "L15 past the corner": ((-10, 5, 5, -10), ""),
    "L15 ends before": ((-9, 3, -1, 3), ""),
    "L15 crossing": ((-20, 7, 30, 7), " ".join(f"{k},7" for k in range(16))),
    "L15 one end inside": ((13, 4, 99, 4), "13,4 14,4 15,4"),
    "L15 last column": ((15, -3, 15, 99), " ".join(f"15,{k}" for k in range(16))),
    "L15 last row": ((-3, 15, 99, 15), " ".join(f"{k},15" for k in range(16))),
    "L15 one column beyond": ((16, -3, 16, 99), ""),
    "L15 one row beyond": ((-3, 16, 99, 16), ""),
    "L15 one column before": ((-1, -3, -1, 99), ""),
}


@pytest.mark.parametrize("name", catalogue.cases(THROUGH))
def test_clipped_line_keeps_its_pixels(name):
    ends, listed = THROUGH[name]
    want = {tuple(map(int, pair.split(","))) for pair in listed.split()}
    assert exact_visible(ends) == want
    assert draw(ends) == draw(backward(ends)) == want


@pytest.mark.case("L15")
def test_clipped_line_is_the_whole_line_inside():
    rng = np.random.default_rng(3)
    drawn = 0
    for ends in rng.integers(-40, 60, (400, 4)).tolist():
        whole = set(oracle.line_pixels(ends[:2], ends[2:]))
        seen = draw(ends, (23, 17))
        assert seen == {(x, y) for x, y in whole if 0 <= x < 23 and 0 <= y < 17}
        drawn += bool(seen)
    assert drawn > 100


@pytest.mark.case("L09", "L10", "L12", "L13", "L15")
def test_time_is_bounded_by_what_is_seen():
    # 2**32 steps each: at a nanosecond a step, walking them would take a day.
    bound_s, count = 5.0, 200 if jit.DISABLED else 20000
    huge = [THROUGH[name][0] for name in ("L09", "L10", "L12", "L13")]
    ends = np.array(huge * (count // len(huge)))
    framebuffer = blank(SMALL)
    framebuffer.draw_lines(ends[:1], WHITE)
    start = time.thread_time()
    framebuffer.draw_lines(ends, WHITE)
    assert time.thread_time() - start < bound_s


@pytest.mark.case("L16")
def test_nothing_is_written_beyond_the_right_or_lower_edge():
    framebuffer = blank((4, 4))
    framebuffer.draw_line((0, 1), (4, 1), WHITE)
    assert pixels(framebuffer.color) == {(0, 1), (1, 1), (2, 1), (3, 1)}
    before = framebuffer.color.copy()
    for x, y in ((4, 1), (0, 4), (4, 4), (-1, 0), (0, -1), (-1, -1), (2**40, 0), (0, -(2**40))):
        framebuffer.put_pixel(x, y, (9, 9, 9))
    for ends in ((4, 0, 4, 3), (0, 4, 3, 4), (4, 4, 4, 4), (-1, 0, -1, 3), (0, -1, 3, -1)):
        framebuffer.draw_line(ends[:2], ends[2:], (9, 9, 9))
    assert framebuffer.color.tobytes() == before.tobytes()


# --- colours --------------------------------------------------------------------------------------


def ramp(first, last, width):
    """Return the values of a channel along a line of so many pixels, drawn from both ends."""
    framebuffer = rj.Framebuffer(width, 1)
    framebuffer.draw_line((0, 0), (width - 1, 0), (first, last, 0, 255), (last, first, 0, 255))
    there = framebuffer.color.copy()
    framebuffer.clear()
    framebuffer.draw_line((width - 1, 0), (0, 0), (last, first, 0, 255), (first, last, 0, 255))
    assert framebuffer.color.tobytes() == there.tobytes()
    return there[0, :, 0].tolist()


RAMPS = {
    "L17": (0, 255, [0, 26, 51, 77, 102, 128, 153, 179, 204, 230, 255]),
    "L18": (0, 255, list(range(256))),
    "L19": (10, 20, [10, 11, 13, 14, 16, 17, 19, 20]),
}


@pytest.mark.parametrize("name", catalogue.cases(RAMPS))
def test_ramp_is_rounded_half_up(name):
    first, last, want = RAMPS[name]
    exact = oracle.line_colors((0, 0), (len(want) - 1, 0), (first,), (last,))
    assert [value for (value,) in exact] == want
    assert ramp(first, last, len(want)) == want


@pytest.mark.case("L20")
@pytest.mark.parametrize(("first", "last"), [(0, 255), (0, 1), (254, 255), (255, 3), (7, 7)])
def test_longest_ramp_is_monotone_with_exact_ends(first, last):
    width = 16384
    values = ramp(first, last, width)
    assert (values[0], values[-1]) == (first, last)
    assert values == sorted(values, reverse=last < first)
    n = width - 1
    assert values == [first + (2 * k * (last - first) + n) // (2 * n) for k in range(width)]


# --- polylines ------------------------------------------------------------------------------------


@pytest.mark.case("L21")
def test_closed_polyline_visits_each_corner_twice_and_all_else_once():
    # Both ends of a line are drawn, and there is no mode that leaves one out.
    corners = [(1, 1), (5, 1), (5, 5), (1, 5)]
    sides = [(*corner, *corners[(k + 1) % 4]) for k, corner in enumerate(corners)]
    visits = [pixel for side in sides for pixel in draw(side)]
    twice = {pixel for pixel in visits if visits.count(pixel) == 2}
    outline = {(x, y) for x in range(1, 6) for y in range(1, 6) if {x, y} & {1, 5}}
    assert twice == set(corners)
    assert set(visits) == outline
    assert len(visits) == 16 + 4
    # To visit each once, as combining by exclusive or needs, leave out each line's last pixel.
    halves = [pixel for side in sides for pixel in draw(side) - {side[2:]}]
    assert sorted(halves) == sorted(outline)


@pytest.mark.case("L21")
def test_outline_of_a_triangle_is_its_three_inclusive_sides():
    corners = [(2, 1), (13, 6), (5, 14)]
    framebuffer = blank(SMALL)
    framebuffer.draw_triangle(*corners, WHITE)
    sides = [draw((*a, *b)) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    assert pixels(framebuffer.color) == set.union(*sides)
    visits = [pixel for side in sides for pixel in side]
    assert all(visits.count(corner) == 2 for corner in corners)


# The strip of the conformance tests, in units of 1/127 of half an image of 256 x 256.
STRIP = [
    (-120, -120), (-119, 120), (120, 119), (10, 20), (-80, 20), (-80, 95), (-83, 95), (-83, -95),
    (-85, 95),
]  # fmt: skip


def connected(drawn):
    """Return what a flood fill over eight neighbours reaches from some pixel."""
    reached, front = set(), {next(iter(drawn))}
    while front:
        reached |= front
        front = {
            (x + i, y + j) for x, y in front for i in (-1, 0, 1) for j in (-1, 0, 1)
        } & drawn - reached  # fmt: skip
    return reached


@pytest.mark.case("L24")
def test_line_strip_is_one_connected_component():
    size = (256, 256)
    pixel = [
        (math.floor((1 + Fraction(x, 127)) * 128), math.floor((1 - Fraction(y, 127)) * 128))
        for x, y in STRIP
    ]
    framebuffer = blank(size)
    pieces = [(*a, *b) for a, b in pairwise(pixel)]
    framebuffer.draw_lines(pieces, WHITE)
    drawn = pixels(framebuffer.color)
    assert drawn == {p for piece in pieces for p in oracle.line_pixels(piece[:2], piece[2:])}
    assert connected(drawn) == drawn
    # The same strip in 3-D, as the edges of faces.
    vertices = np.array([(x / 127, y / 127, 0) for x, y in STRIP])
    assert edges_drawn(vertices, [(k, k + 1) for k in range(8)], FLAT, size) == drawn


# --- lines in space -------------------------------------------------------------------------------

FLAT = rj.MatrixCamera(np.eye(4), np.eye(4))
"""World space is normalized device coordinates; w is 1 everywhere."""

WIDE = {"eye": (0, 0, 0), "target": (0, 0, -1), "fov_y": 90.0}


def edges_drawn(vertices, edges, camera, size=(64, 64)):
    """Return the pixels of edges in the wireframe of a scene; each is a face without area."""
    scene = rj.Scene()
    scene.add(rj.Mesh(vertices, [(a, b, b) for a, b in edges]))
    scene.wireframe = rj.Wireframe("white", "only")
    return pixels(rj.render(scene, camera, size=size, background="transparent", threads=1).color)


def exact_edge(start, end, planes, size):
    """Return the pixels of a segment in clip space, cut exactly."""
    # As a polygon without area; each of its ends may be listed twice.
    left = list(dict.fromkeys(oracle.clip_polygon([start, end, end], planes)))
    if not left:
        return set()
    a, b = (tuple(map(math.floor, oracle.screen_position(v, size))) for v in (left[0], left[-1]))
    return {(x, y) for x, y in oracle.line_pixels(a, b) if 0 <= x < size[0] and 0 <= y < size[1]}


@pytest.mark.case("L22")
def test_segment_that_passes_the_eye_is_cut_at_the_near_plane():
    camera = rj.PerspectiveCamera(**WIDE, near=1.0)
    # Clip (0, 0, 0, 2) to (0, 1, -4, -2) with an infinite far plane: t = 1/4 leaves w = 1.
    start, end = (0, 0, 0, 2), (0, 1, -4, -2)
    quarter = (0, Fraction(1, 4), -1, 1)
    assert oracle.clip_polygon([start, end, end], oracle.VIEW_VOLUME) == [start, quarter, quarter]
    drawn = edges_drawn([(0, 0, -2), (0, 1, 2)], [(0, 1)], camera)
    assert drawn == {(32, row) for row in range(24, 33)}
    assert edges_drawn([(0, 0, -2), (0, 1, 2)], [(1, 0)], camera) == drawn


@pytest.mark.case("L22")
@pytest.mark.parametrize("far", [10.0, np.inf])
def test_segment_behind_the_near_plane_is_not_drawn(far):
    camera = rj.PerspectiveCamera(**WIDE, near=1.0, far=far)
    for ends in ([(0, 0, 2), (1, 1, 0.5)], [(0, 0, 0), (0, 0.1, -0.5)], [(0, 0, 1), (0, 0, 2)]):
        assert not edges_drawn(ends, [(0, 1)], camera)


@pytest.mark.case("L23")
def test_depth_along_an_edge_is_that_of_perspective():
    # Lines carry no attribute of their own but depth, and u is linear in it: from w = 1, u = 0 to
    # w = 3, u = 1, the middle of the screen has u = 1/4, w = 3/2. So a surface at depth 3/2 hides
    # the farther half of the edge; were depth linear on the screen, it would hide three quarters.
    u = (Fraction(0, 1) + Fraction(1, 3)) / (Fraction(1, 1) + Fraction(1, 3))
    assert u == Fraction(1, 4)
    camera = rj.PerspectiveCamera(**WIDE, near=0.5)
    first, last, row = 8, 56, 20
    x, y = [(2 * c + 1) / 64 - 1 for c in (first, last)], 1 - (2 * row + 1) / 64
    vertices = [(x[0], y, -1), (3 * x[1], 3 * y, -3)]
    edge = rj.Mesh(vertices, [(0, 1, 1)], material=rj.Material("unlit", "white"))
    for depth, seen in ((1 + 2 * float(u), 24), (2.0, 36), (3.5, 48), (0.75, -1)):
        scene = rj.Scene()
        scene.add(edge)
        # One face that is larger than the view: its own edges are outside.
        wall = [(-9 * depth, -9 * depth, -depth), (9 * depth, -9 * depth, -depth),
                (0, 9 * depth, -depth)]  # fmt: skip
        scene.add(rj.Mesh(wall, [(0, 1, 2)], material=rj.Material("unlit", "white")))
        scene.wireframe = rj.Wireframe("red")
        color = rj.render(scene, camera, size=(64, 64), threads=1).color
        drawn = {(int(i), int(j)) for j, i in np.argwhere(color[..., 1] == 0)}
        assert drawn == {(column, row) for column in range(first, first + seen + 1)}


@pytest.mark.case("L23")
def test_attribute_on_the_edge_of_a_face_is_that_of_perspective():
    # The top edge of a face, through the centres of a row: w = 1, u = 0 to w = 3, u = 1.
    points = np.array([(8.5, 20.5), (56.5, 20.5), (8.5, 60.5)])
    w = np.array([1.0, 3.0, 1.0])
    positions = np.column_stack([points[:, 0] / 32 - 1, 1 - points[:, 1] / 32, np.zeros(3), w / w])
    positions *= w[:, None]
    seen = rj.rasterize(positions, [(0, 1, 2)], (64, 64), threads=1)
    assert seen.face_id[20, 8:56].tolist() == [0] * 48
    middle = Fraction(65, 2), Fraction(41, 2)
    weights = oracle.perspective_weights(points.tolist(), w.tolist(), middle)
    assert weights[1] == Fraction(1, 4)
    assert seen.barycentric[20, 32, 1] == 0.25


@pytest.mark.case("L25")
@pytest.mark.parametrize("size", [(256, 256), (64, 48)])
@pytest.mark.parametrize("d3d", [True, False])
@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((-41000, -40000, -1e6), (41000, 40000, 1e6)),
        ((0.5, -40000, 1e5), (0.5, 40000, -1e5)),
    ],
)
def test_very_long_line_is_what_exact_clipping_leaves(start, end, d3d, size):
    # Depth 0..1 becomes -1..1.
    ends = np.array([start, end], float)
    ends[:, 2] = 2 * ends[:, 2] - 1 if d3d else ends[:, 2]
    a, b = (tuple(row) for row in np.column_stack([ends, np.ones(2)]).tolist())
    want = exact_edge(a, b, oracle.guard_band(size), size)
    assert len(want) > 1
    assert edges_drawn(ends, [(0, 1)], FLAT, size) == want
    assert edges_drawn(ends, [(1, 0)], FLAT, size) == want
