"""Coverage by exact arithmetic, depth by the exact plane, and one result whatever the order."""

from __future__ import annotations

import naive
import naive_visibility
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry import triangle_batches
from rasterjit.pipeline.geometry.triangle_batches import (
    BUCKET_COUNT,
    FIRST_LISTED,
    GRID_BITS,
    LEFT_COLUMN,
    LISTED_COUNT,
    MAX_SORTED,
    PARTS_PER_BUCKET,
    PREFETCH,
    REQUEST_SIZE,
    SHIFT_X,
    SHIFT_Y,
    SORTED,
    SORTED_DRAWN,
    TOP_ROW,
    TRIANGLES_PER_BATCH,
    allocate_order_memory,
    order_triangles,
)
from rasterjit.pipeline.records import Faces, Objects, ScreenVertices
from rasterjit.pipeline.visibility import tile_rasterizer
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.pipeline.visibility.tile_rasterizer import (
    MAX_HISTORY_TRIANGLES,
    MIN_SORTED_TRIANGLES,
    RETRY_BITS,
)
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads

SCREEN = (128, 128)


def dyadic(points, bits=14):
    """Round points to 2**-bits pixel, so that they reach the kernels exactly."""
    return np.round(np.asarray(points, float) * 2**bits) / 2**bits


def draw(points, faces, size=SCREEN, bits=8, z=0.0, w=1.0, **options):
    """Rasterize faces of screen points."""
    positions = naive.clip_from_screen(dyadic(points), size, z, w)
    quality = rj.Quality(subpixel_bits=bits)
    return rj.rasterize(positions, faces, size, quality=quality, threads=1, **options)


def pixels(points, size=SCREEN, bits=8):
    """Return the pixels (column, row) that one triangle covers."""
    rows, columns = np.nonzero(draw(points, [[0, 1, 2]], size, bits).face_id == 0)
    return set(zip(columns.tolist(), rows.tolist(), strict=True))


# --- coverage against the exact oracle ------------------------------------------------------------


def random_triangles(kind, rng):
    """Yield seeded screen triangles of one kind, in a 128 x 128 image."""
    if kind == "tiny":
        for _ in range(150):
            yield rng.uniform(0, 128, 2) + rng.uniform(-1.2, 1.2, (3, 2))
    elif kind == "around eight pixels":
        # The number of pixels in the box decides which of two ways rows are filled.
        for width in (6, 7, 8, 9, 10):
            for _ in range(25):
                corner = rng.uniform(-4, 124, 2)
                box = rng.uniform(0, 1, (3, 2)) * [width, rng.uniform(2, 30)]
                box[0, 0], box[1, 0] = 0.0, width
                yield corner + box
    elif kind == "half-pixel corners":
        # Edges and corners that pass through centres, where the fill rule decides.
        for _ in range(150):
            yield rng.integers(-4, 40, (3, 2)) / 2.0
    elif kind == "across tiles":
        for _ in range(30):
            yield rng.uniform(40, 90, (3, 2))
    elif kind == "huge":
        for _ in range(10):
            angles = rng.uniform(0, 7) + np.arange(3) * 2.1 + rng.uniform(-0.9, 0.9, 3)
            reach = 10.0 ** rng.uniform(1.7, 3.9, 3)
            yield 64 + np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=1)
    elif kind == "sliver":
        for _ in range(60):
            a, b = rng.uniform(-10, 138, (2, 2))
            yield [a, b, (a + b) / 2 + rng.uniform(-0.3, 0.3, 2)]
    elif kind == "few samples in a row":
        # How many decides how many are tested at once.
        for width in (1, 2, 3, 4, 5):
            for _ in range(12):
                a = rng.uniform(-10, 138, 2)
                along = rng.uniform(-1, 1, 2) * [60, 130]
                yield [
                    a,
                    a + along,
                    a + along * rng.uniform(0, 1) + [rng.uniform(-1, 1) * width, 0],
                ]
    elif kind == "narrow and tall":
        # The largest numbers that the test of boxes, and that of rows, holds: up to the guard band.
        for width in (0.5, 3, 7, 8, 9, 40):
            for _ in range(8):
                left = rng.uniform(-4, 124)
                box = rng.uniform(0, 1, (3, 2)) * [width, 16000]
                box[:2, 0] = rng.permutation([0.0, width])
                box[:2, 1] = rng.permutation([0.0, 16000])
                yield box + [left, -7900]
    elif kind == "edges between tiles":
        # Edges and corners on the lines between tiles and around the image, or half a pixel off.
        lines = np.array([-0.5, 0, 0.5, 63.5, 64, 64.5, 127.5, 128, 128.5])
        for _ in range(60):
            yield np.where(rng.random((3, 2)) < 0.6, rng.choice(lines, (3, 2)), rng.uniform(0, 128))


KINDS = [
    "tiny",
    "around eight pixels",
    "half-pixel corners",
    "across tiles",
    "huge",
    "sliver",
    "few samples in a row",
    "narrow and tall",
    "edges between tiles",
]


@pytest.mark.parametrize("bits", [0, 4, 8, 12])
@pytest.mark.parametrize("kind", KINDS)
def test_coverage_is_exact(kind, bits):
    rng = np.random.default_rng(100 + bits)
    drawn = 0
    for triangle in random_triangles(kind, rng):
        points = dyadic(triangle)
        have = pixels(points, bits=bits)
        assert have == oracle.covered_pixels(points, SCREEN, subpixel_bits=bits), points
        drawn += len(have)
    assert drawn > 0


coordinate = st.integers(-40 * 256, 168 * 256).map(lambda n: n / 256)
point = st.tuples(coordinate, coordinate)


@settings(max_examples=60)
@given(point, point, point)
def test_triangle_covers_what_the_oracle_says(a, b, c):
    assert pixels([a, b, c]) == oracle.covered_pixels([a, b, c], SCREEN)


@settings(max_examples=40)
@given(point, point, point, point)
def test_shared_edge_is_drawn_once(a, b, c, d):
    # c and d on different sides of the edge a b.
    p, q, r, s = [(oracle.snap(x), oracle.snap(y)) for x, y in (a, b, c, d)]
    if oracle.edge(p, q, r) > 0:
        c, d, r, s = d, c, s, r
    if not oracle.edge(p, q, r) < 0 < oracle.edge(p, q, s):
        return
    one, other = pixels([a, b, c]), pixels([b, a, d])
    assert not one & other
    on_edge = {
        (i, j)
        for i, j in oracle.covered_pixels([a, b, c], SCREEN)
        | oracle.covered_pixels([b, a, d], SCREEN)
        if oracle.edge(p, q, naive.centre(i, j)) == 0
    }
    assert on_edge <= one | other


@pytest.mark.parametrize("reach", [100, 8000])
def test_boxes_of_wide_triangles_are_cut_to_the_rows_that_they_reach(reach):
    rng, bits, batches = np.random.default_rng(27), 8, triangle_batches
    kept = all_rows = 0
    for _ in range(2):
        count = batches.TRIANGLES_PER_BATCH
        # Thin ones through the tile, far longer than it.
        middle = rng.uniform(0, 64, (count, 1, 2))
        way = rng.uniform(-1, 1, (count, 1, 2)) * reach * np.array([[-1.0], [0.3], [1.0]])
        corners = np.rint((middle + way + rng.uniform(-1, 1, (count, 3, 2))) * 2**bits)
        whole = np.zeros((batches.INT_ROWS, batches.ROW_STRIDE), np.int32)
        real = np.zeros((batches.FLOAT_ROWS, batches.ROW_STRIDE))
        shift = np.int32(70), np.int32(-90)
        for k, start in enumerate((batches.PAIRS_A, batches.PAIRS_B, batches.PAIRS_C)):
            whole.reshape(-1)[start : start + 2 * count] = (corners[:, k] - shift).ravel()
        batches.set_up_gathered_triangles(count, (0, 0, 63, 63), bits, shift, whole, real)
        for n in np.flatnonzero(whole[batches.WIDE, :count]):
            place = whole[batches.AX : batches.LEFT, n].reshape(3, 2).astype(np.int64)
            assert sorted(place.tolist()) == sorted(corners[n].tolist())
            half, rows, columns = 2 ** (bits - 1), np.arange(64), np.arange(64)
            x, y = (columns << bits) + half, ((rows << bits) + half)[:, np.newaxis]
            left, right = whole[batches.LEFT, n], whole[batches.RIGHT, n]
            best = []
            for k in range(3):
                (ax, ay), (bx, by) = place[(k + 1) % 3], place[(k + 2) % 3]
                values = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                best.append(values[:, left : right + 1].max(axis=1, initial=-(2**62)))
            first, last = place[0, 1], place[1:, 1].max()
            in_box = (y[:, 0] >= first) & (y[:, 0] <= last)
            inside = (np.array(best) >= 0).all(axis=0) & in_box
            nearly = (np.array(best) >= -2.0 * batches.EDGE_ROUNDINGS).all(axis=0) & in_box
            cut = (rows >= whole[batches.TOP, n]) & (rows <= whole[batches.BOTTOM, n])
            assert not (inside & ~cut).any()
            assert cut.sum() <= max(nearly.sum(), in_box.sum() if right < left else 0)
            kept, all_rows = kept + cut.sum(), all_rows + in_box.sum()
    assert 0 < kept < 0.8 * all_rows


@pytest.mark.parametrize("seed", range(3))
def test_columns_of_a_row_are_those_of_whole_numbers(seed):
    rng = np.random.default_rng(seed)
    for _ in range(400):
        # Edges that cross a row at a sample, or miss it by the least that there is.
        across = int(2.0 ** rng.uniform(0, 27)) * int(rng.choice([-1, 1]))
        down = int(2.0 ** rng.uniform(0, 27)) * int(rng.choice([-1, 0, 1]))
        row, column, beside = (int(n) for n in rng.integers([0, -2, -2], [64, 66, 3]))
        value = -across * column - down * row + beside
        edge = np.int64(value), np.int64(across), np.int64(down)
        line = tile_rasterizer.prepare_crossing(edge)
        first, last = tile_rasterizer.bound_span(0.0, 63.0, line, np.float64(row))
        covered = [i for i in range(64) if value + across * i + down * row >= 0]
        assert [*range(int(first), int(last) + 1)] == covered


@pytest.mark.parametrize("value", [0, -1, 2**47 - 1, -(2**47)])
def test_an_edge_along_a_row_leaves_all_columns_or_none(value):
    zero = np.int64(0)
    line = tile_rasterizer.prepare_crossing((np.int64(value), zero, zero))
    first, last = tile_rasterizer.bound_span(0.0, 63.0, line, 0.0)
    assert (first, last) == (0.0, 63.0) if value >= 0 else last < first


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int32])
def test_a_tile_is_written_whatever_the_memory_held(kind):
    # One triangle in the first of four tiles; the last ones end where the picture does.
    size, empty = (100, 90), tile_rasterizer.get_empty_depth(kind)
    viewport, workers = make_viewport(size, 8), threads.Workers(1)
    points = np.array([(3, 4), (40, 9), (8, 50)]) * 2.0 / size - 1.0
    positions = np.column_stack([points * [1, -1], np.full(3, 0.5), np.ones(3)])
    screen, _ = drawing.project_to_screen(positions, (0.0, 64.0, 0.0), viewport, workers)
    faces = Faces(
        np.array([[0, 1, 2]], np.int32), np.empty((0, 3), np.int32), np.empty(0, np.int32)
    )
    drawer = tile_rasterizer.make_tile_drawer(np.zeros(1, np.int32), faces, screen, kind)
    starts, floors = np.array([0, 1, 1, 1, 1], np.int64), np.full(4, empty)
    frames = []
    for junk in (7, -3):
        drawer.scratch[0][:], drawer.scratch[1][:] = 1000 + junk, junk
        frame = np.full(size[::-1], junk, kind), np.full(size[::-1], junk, np.int32)
        tiles = np.arange(4, dtype=np.int32)
        tile_rasterizer.draw_tiles(
            tiles, tile_rasterizer.NO_COUNTER, starts, floors, viewport, frame, *drawer[:3]
        )
        frames.append(frame)
        assert ((frame[1] == 0) | (frame[1] == -1)).all()
        assert (frame[0] == np.where(frame[1] == 0, kind(32), empty)).all()
        assert 0 < (frame[1] == 0).sum() < 1000
        # Tiles without a list are written to the frame alone.
        drawer.scratch[0][:] = junk
        tile_rasterizer.draw_tiles(
            tiles[1:], tile_rasterizer.NO_COUNTER, starts, floors, viewport, frame, *drawer[:3]
        )
        assert (drawer.scratch[0] == junk).all()
    for one, other in zip(*frames, strict=True):
        assert one.tobytes() == other.tobytes()


# --- depth ----------------------------------------------------------------------------------------


def stored(points, depths, size=SCREEN, bits=8):
    """Return the depths that one triangle stores."""
    viewport, workers = make_viewport(size, bits), threads.Workers(1)
    positions = naive.clip_from_screen(points, size, depths, 1.0)
    screen, _ = drawing.project_to_screen(positions, (0.0, 1.0, 0.0), viewport, workers)
    faces = Faces(
        np.array([[0, 1, 2]], np.int32), np.empty((0, 3), np.int32), np.empty(0, np.int32)
    )
    objects = Objects(np.array([0, 1], np.int64), np.zeros(1, np.int8))
    starts, binned, tile_depths, _ = drawing.set_up_and_bin(
        faces, objects, screen, viewport, workers
    )
    frame = np.empty(size[::-1], np.float32), np.empty(size[::-1], np.int32)
    drawing.draw_tiles(starts, binned, tile_depths, faces, screen, viewport, frame, workers)
    assert ((frame[0] > -np.inf) == (frame[1] == 0)).all()
    return frame[0]


@pytest.mark.parametrize("bits", [0, 8, 12])
@pytest.mark.parametrize("kind", KINDS)
def test_depth_has_the_bits_of_the_naive_twin(kind, bits):
    rng = np.random.default_rng(200 + bits)
    drawn = 0
    for triangle in list(random_triangles(kind, rng))[::3]:
        points = dyadic(triangle)
        depths = np.round(rng.uniform(0.1, 0.9, 3) * 2**40) / 2**40
        have = stored(points, depths, bits=bits)
        assert (
            have.tobytes() == naive_visibility.stored_depths(points, depths, SCREEN, bits).tobytes()
        )
        drawn += (have > -np.inf).sum()
    assert drawn > 0


@pytest.mark.parametrize("reach", [4, 60, 700])
def test_rotation_and_winding_change_no_bit(reach):
    rng = np.random.default_rng(23)
    for _ in range(15):
        points = rng.uniform(64 - reach, 64 + reach, (3, 2))
        depths = rng.uniform(0.1, 0.9, 3)
        spellings = ([0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0], [1, 0, 2], [0, 2, 1])
        drawn = [draw(points, [spelling], z=depths) for spelling in spellings]
        for other in drawn[1:]:
            assert other.face_id.tobytes() == drawn[0].face_id.tobytes()
            assert other.depth.tobytes() == drawn[0].depth.tobytes()


def test_moving_the_vertices_to_other_numbers_changes_no_bit():
    rng = np.random.default_rng(24)
    points, depths = rng.uniform(0, 128, (3, 2)), rng.uniform(0.1, 0.9, 3)
    order = [2, 0, 1]
    one = draw(points, [[0, 1, 2]], z=depths)
    other = draw(points[order], [[0, 1, 2]], z=depths[order])
    assert one.depth.tobytes() == other.depth.tobytes()


def soup(rng, count, reach):
    """Return points and depths of random triangles in the image."""
    middles = np.repeat(rng.uniform(0, 128, (count, 2)), 3, axis=0)
    points = dyadic(middles + rng.uniform(-reach, reach, (3 * count, 2)))
    return points, np.round(rng.uniform(0.1, 0.9, 3 * count) * 2**20) / 2**20


@pytest.mark.parametrize("bits", [0, 4, 8, 12])
def test_nearest_face_is_seen(bits):
    rng = np.random.default_rng(26)
    size = (64, 64)
    points, depths = soup(rng, 60, 12)
    points = points / 2
    # Some faces lie at one depth, so that there are exact ties.
    depths[: 3 * 20] = np.repeat(rng.choice([0.25, 0.5], 20), 3)
    faces = np.arange(180).reshape(-1, 3)
    seen = draw(points, faces, size, bits, z=depths)
    triangles = [dyadic(points[face]).tolist() for face in faces]
    expected = oracle.visible_faces(triangles, depths[faces].tolist(), size, subpixel_bits=bits)
    have = {(int(i), int(j)): int(seen.face_id[j, i]) for j, i in np.argwhere(seen.face_id >= 0)}
    assert have == {pixel: face for pixel, (face, _) in expected.items()}


@pytest.mark.parametrize("bits", [0, 8, 12])
@pytest.mark.parametrize("kind", ["sliver", "few samples in a row", "edges between tiles"])
def test_of_equal_depths_the_lowest_face_is_seen(kind, bits):
    # Every triangle is there twice, and all lie at one of two depths.
    rng = np.random.default_rng(28)
    corners = dyadic(list(random_triangles(kind, rng)))
    corners = np.concatenate([corners, corners])[rng.permutation(2 * len(corners))]
    z = rng.choice([0.25, 0.5], len(corners))
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    seen = draw(corners.reshape(-1, 2), faces, bits=bits, z=np.repeat(z, 3)).face_id
    expected = np.full(SCREEN[::-1], -1)
    for n in np.lexsort((-np.arange(len(z)), -z)).tolist():
        for column, row in oracle.covered_pixels(corners[n], SCREEN, subpixel_bits=bits):
            expected[row, column] = n
    assert (seen == expected).all()


def hiding_soup(rng, count):
    """
    Return points and depths of triangles in one tile, many of which others hide.

    The first 128 are squares of 8 by 8 pixels, each at a depth of its own. Of the others, every
    second one lies at the depth of some square.
    """
    squares = 8 * np.stack(np.divmod(rng.permutation(64), 8), axis=1)[:, np.newaxis]
    corners = squares + 8 * np.array([(0, 0), (1, 0), (0, 1), (1, 1), (0, 1), (1, 0)])
    levels = np.round(rng.uniform(0.1, 0.9, 64) * 2**20) / 2**20
    reach = np.repeat(rng.choice([3, 12, 25], count), 3)[:, np.newaxis]
    points = np.repeat(rng.uniform(0, 64, (count, 2)), 3, axis=0)
    points = dyadic(points + rng.uniform(-1, 1, (3 * count, 2)) * reach)
    depths = np.round(rng.uniform(0.1, 0.9, 3 * count) * 2**20) / 2**20
    is_flat = np.repeat(np.arange(count) % 2 == 0, 3)
    depths = np.where(is_flat, np.repeat(rng.choice(levels, count), 3), depths)
    return (
        np.concatenate([corners.reshape(-1, 2), points]),
        np.concatenate([np.repeat(levels, 6), depths]),
    )


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int32])
def test_what_others_hide_is_passed_over_without_changing_a_bit(kind):
    count, size = 248, (64, 64)
    points, depths = hiding_soup(np.random.default_rng(29), count - 128)
    viewport, workers = make_viewport(size, 8), threads.Workers(1)
    positions = naive.clip_from_screen(points, size, depths, 1.0)
    scale = 2.0**20 if kind == np.int32 else 1.0
    screen, _ = drawing.project_to_screen(positions, (0.0, scale, 0.0), viewport, workers)
    faces = Faces(
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3), np.empty((0, 3), np.int32),
        np.empty(0, np.int32),
    )  # fmt: skip
    empty, only = tile_rasterizer.get_empty_depth(kind), np.zeros(1, np.int32)

    def drawn(first, end):
        """Return the tile with some of the triangles, and the depths of its cells at the end."""
        listed = np.arange(first, end, dtype=np.int32)
        drawer = tile_rasterizer.make_tile_drawer(listed, faces, screen, kind)
        drawer.drawing.request[SORTED_DRAWN] = 1000  # So that they are not put in order.
        frame = np.empty(size[::-1], kind), np.empty(size[::-1], np.int32)
        starts, floor = np.array([0, len(listed)], np.int64), np.full(1, empty)
        tile_rasterizer.draw_tiles(
            only, tile_rasterizer.NO_COUNTER, starts, floor, viewport, frame, *drawer[:3]
        )
        return frame, drawer.drawing.cell_depths

    (have, have_faces), cells = drawn(0, count)
    expected, expected_faces = drawn(0, 0)[0]
    passed = 0
    for n in range(count):
        (alone, numbers), untouched = drawn(n, n + 1)
        assert (untouched == empty).all()
        wins = alone > expected
        expected[wins], expected_faces[wins] = alone[wins], numbers[wins]
        if n + 1 == 2 * TRIANGLES_PER_BATCH:
            # What is hidden was found last when so many were drawn.
            least = expected.reshape(8, 8, 8, 8).min(axis=(1, 3))
        if n >= 2 * TRIANGLES_PER_BATCH:
            rows, columns = np.nonzero(numbers == n)
            if len(rows) and (alone[rows, columns] < least[rows // 8, columns // 8]).all():
                passed += 1
    assert have.tobytes() == expected.tobytes()
    assert have_faces.tobytes() == expected_faces.tobytes()
    assert (cells == least).all()
    assert (cells > empty).all()
    assert passed > 10


def soup_in_a_tile(seed, count, kind):
    """Return faces and screen vertices of a soup of which others hide much, and its viewport."""
    size = (64, 64)
    points, depths = hiding_soup(np.random.default_rng(seed), count - 128)
    # Lists hold what reaches the tile.
    points[::3] = np.clip(points[::3], 0, 64)
    viewport, workers = make_viewport(size, 8), threads.Workers(1)
    positions = naive.clip_from_screen(points, size, depths, 1.0)
    scale = 2.0**20 if kind == np.int32 else 1.0
    screen, _ = drawing.project_to_screen(positions, (0.0, scale, 0.0), viewport, workers)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    faces = faces[np.random.default_rng(seed).permutation(count)]
    none = np.empty((0, 3), np.int32), np.empty(0, np.int32)
    return Faces(faces, *none), screen, viewport


@pytest.mark.parametrize(
    ("kind", "count"), [(np.float32, MIN_SORTED_TRIANGLES + 50), (np.float64,
    MIN_SORTED_TRIANGLES + 50), (np.int32, 700), (np.float32, 2 * MAX_SORTED + 100),
    pytest.param(np.float64, 2 * MAX_SORTED + 100, marks=pytest.mark.takes_long),
    pytest.param(np.int32, 2 * MAX_SORTED + 100, marks=pytest.mark.takes_long)],
)  # fmt: skip
def test_order_changes_no_bit(kind, count):
    faces, screen, viewport = soup_in_a_tile(31, count, kind)
    listed, only = np.arange(count, dtype=np.int32), np.zeros(1, np.int32)
    starts, floor = (
        np.array([0, count], np.int64),
        np.full(1, tile_rasterizer.get_empty_depth(kind)),
    )
    frames, asked = [], []
    for seen in (0, 10 * count):
        drawer = tile_rasterizer.make_tile_drawer(listed, faces, screen, kind)
        drawer.drawing.request[SORTED_DRAWN] = seen
        frame = np.empty((64, 64), kind), np.empty((64, 64), np.int32)
        tile_rasterizer.draw_tiles(
            only, tile_rasterizer.NO_COUNTER, starts, floor, viewport, frame, *drawer[:3]
        )
        frames.append(frame)
        asked.append(drawer.drawing.request)
    assert frames[0][0].tobytes() == frames[1][0].tobytes()
    assert frames[0][1].tobytes() == frames[1][1].tobytes()
    ordered, listed = asked
    assert ordered[SORTED] == count
    assert 0 < ordered[SORTED_DRAWN] < count
    # What is not put in order counts a little, so that it is tried again.
    assert (listed[SORTED], listed[SORTED_DRAWN]) == (count >> RETRY_BITS, 10 * count)


def test_lists_are_put_in_order_again_after_a_while():
    count = 700
    faces, screen, viewport = soup_in_a_tile(31, count, np.float32)
    listed, only = np.arange(count, dtype=np.int32), np.zeros(1, np.int32)
    starts, floor = np.array([0, count], np.int64), np.full(1, -np.inf, np.float32)
    drawer = tile_rasterizer.make_tile_drawer(listed, faces, screen, np.float32)
    asked = drawer.drawing.request
    asked[SORTED], asked[SORTED_DRAWN] = 1000, 600
    frame = np.empty((64, 64), np.float32), np.empty((64, 64), np.int32)
    was_ordered = []
    for _ in range(6):
        before = asked[SORTED]
        tile_rasterizer.draw_tiles(
            only, tile_rasterizer.NO_COUNTER, starts, floor, viewport, frame, *drawer[:3]
        )
        was_ordered.append(asked[SORTED] - before == count)
    assert was_ordered == [False] * 5 + [True]
    # Long ago counts less.
    asked[SORTED], asked[SORTED_DRAWN] = 8 * MAX_HISTORY_TRIANGLES, 2 * MAX_HISTORY_TRIANGLES
    tile_rasterizer.draw_tiles(
        only, tile_rasterizer.NO_COUNTER, starts, floor, viewport, frame, *drawer[:3]
    )
    assert asked[SORTED] == 4 * MAX_HISTORY_TRIANGLES + count


@pytest.mark.parametrize("shift", [(0, 0), (70, -90)])
@pytest.mark.parametrize("spread", [0.0, 1e-13, 1.0])
def test_triangles_are_put_in_order(shift, spread):
    random, count, bits = np.random.default_rng(5), 300, 8
    corners = random.integers(-20 << bits, 260 << bits, (count, 1, 2))
    corners = corners + random.integers(-30 << bits, 30 << bits, (count, 3, 2))
    depth = 0.5 + spread * (random.random((count, 3)) - 0.5)
    packed = np.zeros((3 * count, 2))
    packed.view(np.int32)[:, :2], packed[:, 1] = corners.reshape(-1, 2), depth.ravel()
    zeros = np.zeros(3 * count)
    screen = ScreenVertices(
        packed.view(np.int32)[:, :2], packed[:, 1], zeros.astype(np.uint8), zeros
    )
    numbers = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    faces = Faces(numbers, np.empty((0, 3), np.int32), np.empty(0, np.int32))
    listed = random.permutation(count).astype(np.int32)
    origin, first, some = np.array([128, 64]), 20, 250
    asked, (order, surveyed) = np.zeros(REQUEST_SIZE, np.int64), allocate_order_memory()
    asked[[FIRST_LISTED, LISTED_COUNT, PREFETCH]] = first, some, count - first - some
    asked[[LEFT_COLUMN, TOP_ROW, GRID_BITS, SHIFT_X, SHIFT_Y]] = *origin, bits, *shift
    batch = tile_rasterizer.allocate_scratch()[2:4]
    order_triangles(asked, listed, faces, screen, *batch, surveyed, order)
    entries, ends, bounds = order
    assert ends[PARTS_PER_BUCKET * BUCKET_COUNT - 1] == some
    chosen, boxes = entries[:some] & 0xFFFFFFFF, entries[:some] >> 32
    assert sorted(chosen) == sorted(listed[first : first + some])
    # The box of cells around the pixels whose centres the box of each triangle encloses.
    moved, half = corners[chosen] + shift, 1 << (bits - 1)
    begin = (moved.min(axis=1) + half - 1 >> bits) - origin
    end = (moved.max(axis=1) - half >> bits) - origin
    begin, end = (np.clip(pixels, 0, 63) // 8 for pixels in (begin, end))
    expected = begin[:, 0] + 8 * end[:, 0] + 64 * begin[:, 1] + 512 * end[:, 1]
    assert (boxes == expected).all()
    columns, rows = tile_rasterizer.make_cell_masks()
    for n in range(0, some, 10):
        cells = np.zeros((8, 8), bool)
        cells[begin[n, 1] : end[n, 1] + 1, begin[n, 0] : end[n, 0] + 1] = True
        word = columns[boxes[n] & 63] & rows[boxes[n] >> 6]
        assert word == np.packbits(cells, bitorder="little").view(np.int64)[0]
    # Each range lies behind those before it, and none in it is nearer than is known.
    near, start, last = depth[chosen].max(axis=1), 0, np.inf
    for bucket in range(BUCKET_COUNT):
        stop = ends[PARTS_PER_BUCKET * (bucket + 1) - 1]
        assert (near[start:stop] <= bounds[bucket]).all()
        if start < stop:
            assert near[start:stop].max() <= last
            last, start = near[start:stop].min(), stop
    assert (ends[PARTS_PER_BUCKET - 1] < some) == (spread > 0.0)


def test_larger_depth_wins_when_reversed():
    points = [(0, 0), (64, 0), (0, 64)] * 2
    z = [0.25] * 3 + [0.5] * 3
    faces = [[0, 1, 2], [3, 4, 5]]
    standard = draw(points, faces, (64, 64), z=z)
    reverse = draw(points, faces, (64, 64), z=z, depth="reversed")
    assert standard.face_id.max() == 0
    assert set(np.unique(reverse.face_id)) == {-1, 1}
    assert np.isinf(standard.depth[standard.face_id == -1]).all()
    assert np.isinf(reverse.depth[reverse.face_id == -1]).all()
    assert (reverse.depth[reverse.face_id == 1] == 0.5).all()
