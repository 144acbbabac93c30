"""Floors are below all that is stored, and leaving out what lies below them changes no bit."""

from __future__ import annotations

import numpy as np
import pytest

from rasterjit.pipeline.geometry import setup, triangle_batches
from rasterjit.pipeline.records import Faces, Objects
from rasterjit.pipeline.visibility import hierarchical_z
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads
from rasterjit.runtime.threads import Memory

SIZE = (256, 192)
COLUMNS, ROWS = 4, 3
TILE = 64
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.needs_jit) for seed in range(1, 12))]


def lists_of(points, depths, size=SIZE, bits=8):
    """Return what `visibility_pass.draw_tiles` takes, of loose triangles on the screen."""
    viewport, workers = make_viewport(size, bits), threads.Workers(1)
    positions = np.ones((len(points), 4))
    positions[:, 0] = 2.0 * points[:, 0] / size[0] - 1.0
    positions[:, 1] = 1.0 - 2.0 * points[:, 1] / size[1]
    positions[:, 2] = depths
    screen, _ = drawing.project_to_screen(positions, (0.0, 1.0, 0.0), viewport, workers)
    faces = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    objects = Objects(np.array([0, len(faces)], np.int64), np.zeros(1, np.int8))
    everything = Faces(faces, np.empty((0, 3), np.int32), np.empty(0, np.int32))
    starts, binned, bounds, _ = drawing.set_up_and_bin(
        everything, objects, screen, viewport, workers
    )
    return starts, binned, bounds, everything, screen, viewport


def draw(starts, binned, bounds, faces, screen, viewport):
    """Return stored depth and face number of every pixel."""
    shape = viewport.height, viewport.width
    frame = np.empty(shape, np.float32), np.empty(shape, np.int32)
    drawing.draw_tiles(starts, binned, bounds, faces, screen, viewport, frame, threads.Workers(1))
    return frame


def is_large(points):
    """Tell whether the box of a triangle reaches over tiles enough to be looked at."""
    first = np.maximum(np.ceil(points.min(axis=0) - 0.5), 0.0) // TILE
    last = np.minimum(np.floor(points.max(axis=0) - 0.5), np.array(SIZE) - 1.0) // TILE
    return (last - first).sum() >= setup.MIN_LARGE_SPAN_TILES


def tiles_of(array):
    """Yield (number, part) of each tile of a picture."""
    for tile in range(COLUMNS * ROWS):
        top, left = tile // COLUMNS * TILE, tile % COLUMNS * TILE
        yield tile, array[top : top + TILE, left : left + TILE]


def triangles(rng, count):
    """Return triangles of every size, with depths at their vertices."""
    reach = np.repeat(rng.choice([3.0, 60.0, 400.0, 3000.0], count), 3)[:, np.newaxis]
    middles = np.repeat(rng.uniform((0, 0), SIZE, (count, 2)), 3, axis=0)
    points = np.round((middles + rng.uniform(-1, 1, (3 * count, 2)) * reach) * 256) / 256
    tilt = np.repeat(rng.choice([0.0, 1e-6, 0.1, 0.4], count), 3)
    depths = np.repeat(rng.uniform(-0.5, 0.5, count), 3) + tilt * rng.uniform(-1, 1, 3 * count)
    return points, depths


@pytest.mark.parametrize("seed", SEEDS)
def test_a_floor_is_the_lowest_depth_of_a_triangle_that_covers_the_tile(seed):
    rng = np.random.default_rng(seed)
    found = 0
    for _ in range(24):
        points, depths = triangles(rng, 1)
        lists = lists_of(points, depths)
        bounds = lists[2]
        depth, face_id = draw(*lists)
        for (tile, part), (_, numbers) in zip(tiles_of(depth), tiles_of(face_id), strict=True):
            if (numbers >= 0).all() and is_large(points):
                lowest = part.min()
                assert lowest - 2 * np.spacing(abs(lowest)) <= bounds[tile] <= lowest
                found += 1
            else:
                assert bounds[tile] == -np.inf
    assert found > 3


@pytest.mark.parametrize("size", [(200, 150), (257, 129)])
def test_tiles_that_end_with_the_picture_have_floors_where_their_pixels_are_covered(size):
    rng = np.random.default_rng(41)
    columns, rows = -(-size[0] // TILE), -(-size[1] // TILE)
    found = np.zeros((rows, columns), int)
    for _ in range(40):
        # One edge lies near the right or the lower border of the picture, the others far away.
        side = int(rng.integers(2))
        border = size[side] - 0.5 + rng.integers(-256, 257) / 256
        points = np.array([[border, -5000.0], [border, 5000.0], [-7000.0, 0.0]])
        points = points if side == 0 else points[:, ::-1]
        lists = lists_of(points, np.full(3, 0.25), size)
        bounds = lists[2].reshape(rows, columns)
        _, face_id = draw(*lists)
        for row in range(rows):
            for column in range(columns):
                top, left = row * TILE, column * TILE
                is_covered = (face_id[top : top + TILE, left : left + TILE] == 0).all()
                assert bounds[row, column] == (0.25 if is_covered else -np.inf)
                found[row, column] += is_covered
    assert (found[:-1, :-1] == 40).all()
    for border in (found[:-1, -1], found[-1, :-1]):
        assert (border > 0).all()
        assert (border < 40).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_leaving_out_what_is_below_a_floor_changes_no_bit(seed):
    rng = np.random.default_rng(100 + seed)
    points, depths = triangles(rng, 60)
    starts, binned, bounds, *rest = lists_of(points, depths)
    assert (bounds > -np.inf).any()
    with_bounds = draw(starts, binned, bounds, *rest)
    without = draw(starts, binned, np.full_like(bounds, -np.inf), *rest)
    for one, other in zip(with_bounds, without, strict=True):
        assert one.tobytes() == other.tobytes()


def test_a_floor_leaves_out_all_that_lies_below_it_and_nothing_at_it():
    # Floors from elsewhere: what is drawn tells what was left out.
    points, depths = triangles(np.random.default_rng(3), 60)
    starts, binned, bounds, *rest = lists_of(points, depths)
    _, everything = draw(starts, binned, np.full_like(bounds, -np.inf), *rest)
    _, nothing = draw(starts, binned, np.full_like(bounds, np.inf), *rest)
    assert (everything >= 0).any()
    assert (nothing == -1).all()
    square = np.array([[-9, -9], [600, -9], [-9, 600]], float)
    for depth in (0.25, np.float32(0.1)):
        lists = lists_of(np.tile(square, (2, 1)), np.full(6, float(depth)))
        assert (lists[2] <= depth).all()
        at = np.full_like(lists[2], depth)
        assert (draw(*lists[:2], at, *lists[3:])[1] == 0).all()
        above = np.nextafter(at, np.float32(np.inf))
        assert (draw(*lists[:2], above, *lists[3:])[1] == -1).all()


def test_of_equal_depths_the_first_is_kept():
    square = np.array([[-9, -9], [600, -9], [-9, 600]], float)
    lists = lists_of(np.tile(square, (5, 1)), np.repeat([0.1, 0.3, 0.3, 0.2, 0.3], 3))
    assert np.ptp(lists[2]) == 0
    assert abs(lists[2][0] - np.float32(0.3)) <= np.spacing(np.float32(0.3))
    assert (draw(*lists)[1] == 1).all()


@pytest.mark.parametrize(
    ("size", "found"), [((64, 64), False), ((65, 70), False), ((250, 3), True), ((130, 70), True)]
)
def test_tiles_at_the_border_are_whole_where_the_picture_is(size, found):
    # A box that reaches less than three tiles on is not looked at: it is too small to gain from.
    square = np.array([[-900, -900], [4000, -900], [-900, 4000]], float)
    points, depths = np.tile(square, (2, 1)), np.repeat([0.5, 0.25], 3)
    lists = lists_of(points, depths, size)
    assert (lists[2] == (0.5 if found else -np.inf)).all()
    assert (draw(*lists)[1] == 0).all()


def corners_on_the_grid(rng, count, bits):
    """Return vertices of triangles of every size and winding, with ties, (N, 3, 2) int32."""
    reach = rng.choice([4, 60 << bits, 1 << (14 + bits)], (count, 1, 1))
    corners = (rng.uniform(-1, 1, (count, 3, 2)) * reach).astype(np.int32)
    for axis in range(2):
        one, other = rng.integers(0, 3, (2, count))
        tied = rng.random(count) < 0.4
        rows = np.arange(count)[tied]
        corners[rows, one[tied], axis] = corners[rows, other[tied], axis]
    sides = (corners[:, 1:] - corners[:, :1]).astype(np.int64)
    turns = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    assert (turns > 0).any()
    assert (turns < 0).any()
    return corners[turns != 0]


def drawn_planes(corners, depths, bits):
    """Return vertices and depths in the order of drawing, weights, lowest and highest depth."""
    batches, window, shift = triangle_batches, (0, 0, 63, 63), (np.int32(0), np.int32(0))
    vertices, planes = np.empty((len(corners), 6), np.int32), np.empty((len(corners), 7))
    shown = [*range(3), *range(batches.WEIGHT, batches.RANGE + 2)]
    for first in range(0, len(corners), batches.TRIANGLES_PER_BATCH):
        some = slice(first, first + batches.TRIANGLES_PER_BATCH)
        count = len(corners[some])
        whole = np.zeros((batches.INT_ROWS, batches.ROW_STRIDE), np.int32)
        real = np.zeros((batches.FLOAT_ROWS, batches.ROW_STRIDE))
        for k, start in enumerate((batches.PAIRS_A, batches.PAIRS_B, batches.PAIRS_C)):
            whole.reshape(-1)[start : start + 2 * count] = corners[some, k].ravel()
        real[:3, :count] = depths[some].T
        batches.set_up_gathered_triangles(count, window, bits, shift, whole, real)
        vertices[some] = whole[batches.AX : batches.LEFT, :count].T
        planes[some] = real[shown, :count].T
    return vertices, planes


@pytest.mark.parametrize("subpixel_bits", [0, 4, 8, 12])
def test_tile_depths_take_the_vertices_and_the_plane_that_are_drawn(subpixel_bits):
    bits = make_viewport(SIZE, subpixel_bits).grid_bits
    rng = np.random.default_rng(200 + bits)
    corners = corners_on_the_grid(rng, 150, bits)
    depths = rng.uniform(-1, 1, (len(corners), 3)) * 10.0 ** rng.integers(-30, 5, (len(corners), 1))
    drawn = drawn_planes(corners, depths, bits)
    assert (corners[:, 0, 1] == corners[:, 1, 1]).any()
    screen = drawing.allocate_screen(corners.size // 2, Memory())
    screen.xy[:], screen.depth[:] = corners.reshape(-1, 2), depths.reshape(-1)
    for n in range(len(corners)):
        order = list(hierarchical_z.sort_clockwise_from_top((3 * n, 3 * n + 1, 3 * n + 2), screen))
        xy, turned = screen.xy[order].reshape(-1), screen.depth[order]
        assert xy.tolist() == drawn[0][n].tolist()
        plane = hierarchical_z.compute_depth_plane(*turned.tolist(), *xy.tolist(), bits)
        found = np.array([*turned, plane[1], plane[2], plane[4], plane[5]])
        assert plane[0] == turned[2]
        assert found.tobytes() == drawn[1][n].tobytes()
