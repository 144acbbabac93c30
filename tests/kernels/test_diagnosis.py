"""Samples, ties and fates are counted exactly; no interpolated value is off by more than said."""

from __future__ import annotations

import math
from fractions import Fraction

import naive
import numpy as np
import pytest

from rasterjit.inspect import oracle
from rasterjit.outputs import diagnostics_stage
from rasterjit.pipeline.geometry import barycentric, setup
from rasterjit.pipeline.geometry.barycentric import compute_sample_weights, interpolate
from rasterjit.pipeline.geometry.setup import CLIPPED, get_face_vertices
from rasterjit.pipeline.records import Geometry, Objects
from rasterjit.pipeline.visibility import tile_rasterizer
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads
from rasterjit.runtime.jit import kernel
from rasterjit.runtime.state_block import float64, int32, int64

SIZE = (24, 16)
WIDE = (100, 70)
"""Four tiles."""

LOOSEST = 50.0
"""Random faces reach a seventh of the bound where they are not clipped and a tenth where they are;
a bound that none comes near by this factor would be of no use."""


def draw(clip_positions, faces=((0, 1, 2),), size=SIZE, bits=8, turn=0):
    """Return a coverage with its lists, its geometry, and the objects record."""
    positions = np.ascontiguousarray(clip_positions, np.float64)
    faces = np.array(faces, np.int32)
    viewport = make_viewport(size, bits)
    objects = Objects(np.array([0, len(faces)]), np.array([turn], np.int8))
    coverage = drawing.run_visibility(
        drawing.Drawable(positions, faces, objects, (0.0, -1.0, 0.0), viewport),
        drawing.VisibilityOptions(lists=True), threads.Workers(1), lambda _: None,
    )  # fmt: skip
    geometry = Geometry(
        faces, coverage.screen.xy, coverage.screen.codes, coverage.screen.w, positions, viewport
    )
    return coverage, geometry, objects


def count(coverage, geometry):
    """Return the samples of each triangle and the pixels with a tie of each tile."""
    lists = coverage.lists
    starts, binned, faces = lists.starts, lists.binned, lists.faces
    side = setup.TILE_SIZE
    drawer = tile_rasterizer.make_tile_drawer(binned, faces, coverage.screen)
    counts = np.zeros(len(binned), np.int32), np.zeros(len(starts) - 1, np.int64)
    tiles = np.arange(len(starts) - 1, dtype=np.int32)
    frame = coverage.depth, coverage.face_id
    diagnostics_stage.count_samples(
        tiles, starts, geometry.viewport, frame, *drawer[:2], np.zeros((side, side), np.uint8),
        counts,
    )  # fmt: skip
    samples = np.zeros(len(faces.faces) + len(faces.pieces), np.int64)
    np.add.at(samples, binned, counts[0])
    return samples, counts[1]


@kernel
def fill_unrounded(
    face_id: int32[:, ::1], rows: (int64, int64), geometry: Geometry, values: float64[:, ::1],
    computed: float64[:, :, ::1],
):  # fmt: skip
    """Interpolate as ``fill_attribute`` does, and store in float64."""
    for row in range(rows[0], rows[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            if face >= 0:
                a, b, c = get_face_vertices(geometry.faces, face)
                weights = compute_sample_weights(a, b, c, column, row, geometry)
                for k in range(values.shape[1]):
                    computed[row, column, k] = interpolate(
                        weights, values[a, k], values[b, k], values[c, k]
                    )


def test_values_are_interpolated_so_and_rounded():
    rng = np.random.default_rng(2)
    clip = naive.clip_from_screen([(2, 2), (30, 3), (4, 14)], (32, 16), w=[1, 2, 4])
    coverage, geometry, _ = draw(clip, size=(32, 16))
    values, shown = rng.uniform(-1, 1, (3, 4)).astype(np.float32), coverage.face_id == 0
    unrounded, filled = (np.empty((*shown.shape, 4), kind) for kind in (np.float64, np.float32))
    given = coverage.face_id, (0, len(shown)), geometry
    fill_unrounded(*given, values.astype(np.float64), unrounded)
    barycentric.fill_attribute(*given, values, filled)
    assert shown.sum() > 50
    assert (unrounded[shown].astype(np.float32) == filled[shown]).all()


def find_largest_error(face_id, rows, geometry):
    bound = np.zeros(1)
    diagnostics_stage.find_largest_error(face_id, rows, geometry, bound)
    return bound[0]


def fates(coverage, geometry, objects):
    faces = coverage.lists.faces
    samples, _ = count(coverage, geometry)
    shown = np.isin(np.arange(len(faces.faces)), coverage.face_id).astype(np.uint8)
    found = np.full(len(faces.faces), 99, np.uint8)
    diagnostics_stage.find_fates(
        faces, objects, coverage.screen, geometry.viewport, (samples, shown), found
    )
    return found.tolist()


def fate(points, size=SIZE, turn=0):
    return fates(*draw(naive.clip_from_screen(points, size), size=size, turn=turn))[0]


def dyadic(points):
    return np.round(np.asarray(points) * 1024) / 1024


# --- samples --------------------------------------------------------------------------------------


@pytest.mark.parametrize("reach", [4.0, 30.0, 200.0])
def test_samples_are_those_of_exact_coverage_whether_seen_or_not(reach):
    rng = np.random.default_rng(3)
    middles = rng.uniform((0, 0), WIDE, (60, 1, 2))
    points = dyadic(middles + rng.uniform(-reach, reach, (60, 3, 2)))
    clip = naive.clip_from_screen(
        points.reshape(-1, 2), (128, 64), np.repeat(rng.uniform(-0.9, 0.9, 60), 3)
    )
    coverage, geometry, _ = draw(clip, np.arange(180).reshape(-1, 3), (128, 64))
    samples, _ = count(coverage, geometry)
    exact = [len(oracle.covered_pixels(triangle, (128, 64))) for triangle in points.tolist()]
    assert samples.tolist() == exact
    assert sum(exact) > (coverage.face_id >= 0).sum()


def test_pieces_of_a_clipped_face_cover_what_the_face_shows_alone():
    clip = [(-3.0, -0.5, 0.4, 0.6), (0.5, -0.5, -3.2, -3.0), (0.3, 1.5, 1.8, 2.0)]
    coverage, geometry, _ = draw(clip, size=WIDE)
    samples, _ = count(coverage, geometry)
    assert len(samples) > 2
    assert samples[0] == 0
    assert samples.sum() == (coverage.face_id == 0).sum() > 0


# --- ties -----------------------------------------------------------------------------------------


def test_a_face_drawn_twice_ties_at_every_pixel():
    clip = naive.clip_from_screen([(1, 1), (90, 5), (20, 60)], (128, 64), [0.1, 0.7, -0.3])
    coverage, geometry, _ = draw(clip, [(0, 1, 2), (1, 2, 0), (0, 2, 1)], (128, 64))
    _, ties = count(coverage, geometry)
    assert len(ties) == 2
    assert ties.min() > 0
    assert ties.sum() == (coverage.face_id >= 0).sum()


def test_faces_behind_one_another_do_not_tie():
    points = [(1, 1), (90, 5), (20, 60)]
    clip = [naive.clip_from_screen(points, (128, 64), z) for z in (0.25, 0.25 + 2.0**-20)]
    coverage, geometry, _ = draw(np.concatenate(clip), [(0, 1, 2), (3, 4, 5)], (128, 64))
    assert count(coverage, geometry)[1].sum() == 0


def test_a_tie_behind_the_visible_face_is_none():
    points = [(1, 1), (90, 5), (20, 60)]
    clip = [naive.clip_from_screen(points, (128, 64), z) for z in (0.25, 0.0)]
    coverage, geometry, _ = draw(np.concatenate(clip), [(0, 1, 2), (0, 1, 2), (3, 4, 5)], (128, 64))
    assert count(coverage, geometry)[1].sum() == 0


def test_neighbours_do_not_tie():
    clip = naive.clip_from_screen([(0, 0), (128, 0), (128, 64), (0, 64)], (128, 64))
    coverage, geometry, _ = draw(clip, [(0, 1, 2), (0, 2, 3)], (128, 64))
    samples, ties = count(coverage, geometry)
    assert samples.sum() == 128 * 64
    assert ties.sum() == 0


# --- fates ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([(2, 2), (12, 3), (4, 12)], diagnostics_stage.VISIBLE),
        ([(2, 2), (12, 2), (7, 2)], diagnostics_stage.DEGENERATE),
        ([(2.0, 2.0), (2.001, 2.0), (2.0, 2.001)], diagnostics_stage.DEGENERATE),
        # Between centres, and a sliver whose box holds centres that it passes by.
        ([(2.6, 2.6), (3.4, 2.6), (2.6, 3.4)], diagnostics_stage.SUB_PIXEL),
        ([(2.25, 2), (12.25, 12), (12.375, 12)], diagnostics_stage.SUB_PIXEL),
        # Beside a side; past a corner, its box over the image; with an edge along a side.
        ([(-9, 2), (-1, 3), (-4, 12)], diagnostics_stage.OUTSIDE),
        ([(-8, 4), (4, -8), (-8, -8)], diagnostics_stage.OUTSIDE),
        ([(-8, 2), (0, 2), (0, 8)], diagnostics_stage.OUTSIDE),
        # Touches the image too little to reach a centre.
        ([(-8, 2), (0.25, 2), (0.25, 8)], diagnostics_stage.SUB_PIXEL),
        ([(-4, 4.25), (4.25, -4), (-4, -4)], diagnostics_stage.SUB_PIXEL),
    ],
)  # fmt: skip
def test_fate_of_a_face(points, expected):
    for order in ((0, 1, 2), (2, 1, 0)):
        assert fate(dyadic([points[k] for k in order]), (32, 16)) == expected


def test_culled_faces_are_those_of_the_culled_turn():
    clockwise = [(2, 2), (12, 3), (4, 12)]
    assert fate(clockwise, (32, 16), turn=1) == diagnostics_stage.CULLED
    assert fate(clockwise, (32, 16), turn=-1) == diagnostics_stage.VISIBLE
    assert fate(clockwise[::-1], (32, 16), turn=-1) == diagnostics_stage.CULLED


def test_a_face_that_only_loses_is_hidden():
    points = [(2, 2), (30, 3), (4, 14)]
    clip = [naive.clip_from_screen(points, (32, 16), z) for z in (0.5, 0.25)]
    drawn = draw(np.concatenate(clip), [(0, 1, 2), (3, 4, 5)], (32, 16))
    assert fates(*drawn) == [diagnostics_stage.HIDDEN, diagnostics_stage.VISIBLE]


def test_a_face_with_a_vertex_that_is_no_number_is_dropped():
    clip = naive.clip_from_screen([(2, 2), (30, 3), (4, 14)], (32, 16))
    for wrong in (math.nan, math.inf, 2e150):
        broken = np.concatenate([clip, [[0.0, wrong, 0.0, 1.0]]])
        drawn = draw(broken, [(0, 1, 2), (0, 1, 3)], (32, 16))
        assert fates(*drawn) == [diagnostics_stage.VISIBLE, diagnostics_stage.DROPPED]


def test_a_clipped_face_has_one_fate():
    behind = [(0.0, 0.0, -2.0, -1.0), (1.0, 0.0, -2.0, -1.0), (0.0, 1.0, -2.0, -1.0)]
    through = [(-3.0, -0.5, 0.4, 0.6), (0.5, -0.5, -3.2, -3.0), (0.3, 1.5, 1.8, 2.0)]
    # In front of the eye but left of the picture; its third vertex is behind.
    beside = [(-9.0, 0.0, 0.5, 1.0), (-8.0, 1.0, 0.5, 1.0), (-0.5, 0.0, -1.5, -1.0)]
    drawn = draw(np.array(behind + through + beside), np.arange(9).reshape(3, 3), WIDE)
    assert fates(*drawn) == [
        diagnostics_stage.OUTSIDE,
        diagnostics_stage.VISIBLE,
        diagnostics_stage.OUTSIDE,
    ]
    assert drawn[0].totals.clipped >= 1
    culled = {fates(*draw(np.array(through), size=WIDE, turn=turn))[0] for turn in (-1, 1)}
    assert culled == {diagnostics_stage.CULLED, diagnostics_stage.VISIBLE}


def test_a_clipped_face_of_which_nothing_is_left_is_outside():
    # Passes by the corner between the near plane and the left side of the guard band.
    clip = [(0.0, 0.0, -2.0, 1.0), (-400.0, 0.0, 0.0, 1.0), (-400.0, 1.0, -2.0, 1.0)]
    drawn = draw(np.array(clip), size=WIDE)
    assert (drawn[0].totals.clipped, len(drawn[0].lists.faces.pieces)) == (1, 0)
    assert fates(*drawn) == [diagnostics_stage.OUTSIDE]


# --- error bound ----------------------------------------------------------------------------------


def plain(rng):
    w = rng.uniform(0.5, 50.0, 3)
    return np.column_stack([rng.uniform(-1, 1, (3, 2)) * w[:, None], np.zeros(3), w])


def grazing(rng):
    w = 10.0 ** rng.uniform(-3, 6, 3)
    return np.column_stack([rng.uniform(-1, 1, (3, 2)) * w[:, None], np.zeros(3), w])


def clipped(rng):
    w = rng.uniform(-2, 3, 3)
    return np.column_stack([rng.uniform(-3, 3, (3, 2)), w - 0.2, w])


def edge_on(rng):
    """Return a clipped face whose plane nearly goes through the eye."""
    x, y, w = rng.uniform(-3, 3, (3, 3))
    rows = np.column_stack([x, y, w])
    rows[2] = rows[:2].T @ rng.uniform(-1, 1, 2) + 10.0 ** rng.uniform(-6, -1) * rows[2]
    return np.column_stack([rows[:, :2], rows[:, 2] - 0.2, rows[:, 2]])


def exact_weights(geometry, column, row, size):
    codes = geometry.codes[:3]
    if (codes & CLIPPED).any():
        point = Fraction(2 * column + 1, 2), Fraction(2 * row + 1, 2)
        shares = oracle.clip_weights(geometry.clip_positions.tolist(), point, size)
        held = [max(share, Fraction(0)) for share in shares]
        return [share / sum(held) for share in held]
    unit = 1 << geometry.viewport.grid_bits
    point = column * unit + unit // 2, row * unit + unit // 2
    ws = geometry.clip_positions[:, 3].tolist()
    return oracle.perspective_weights(geometry.xy[:3].tolist(), ws, point)


def shares_of_bound(clip, values):
    """Return |error| / (bound * largest value) of every value at every pixel, and the bounds."""
    coverage, geometry, _ = draw(clip)
    width, height = SIZE
    computed = np.empty((height, width, values.shape[1]))
    fill_unrounded(coverage.face_id, (0, height), geometry, values, computed)
    largest = [Fraction(float(v)) for v in np.abs(values).max(axis=0)]
    shares, bounds = [], []
    for row, column in np.argwhere(coverage.face_id == 0).tolist():
        alone = np.full_like(coverage.face_id, -1)
        alone[row, column] = 0
        bounds.append(find_largest_error(alone, (row, row + 1), geometry))
        if bounds[-1] == np.inf:
            continue
        weights = exact_weights(geometry, column, row, SIZE)
        for k, most in enumerate(largest):
            exact = oracle.interpolate(weights, values[:, k].tolist())
            error = abs(Fraction(computed[row, column, k]) - exact)
            shares.append(float(error / (Fraction(bounds[-1]) * most)))
    return shares, bounds


@pytest.mark.parametrize(
    ("kind", "faces"), [(plain, 12), (grazing, 12), (clipped, 20), (edge_on, 150)]
)
def test_no_value_is_off_by_more_than_the_bound_and_some_come_near(kind, faces):
    rng = np.random.default_rng(11)
    shares, bounds = [], []
    for _ in range(faces):
        signs = np.column_stack([np.eye(3), [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]])
        values = np.column_stack([rng.uniform(-1, 1, (3, 2)), signs])
        found = shares_of_bound(kind(rng), values)
        shares += found[0]
        bounds += found[1]
    assert len(shares) > 200
    assert max(shares) <= 1.0
    assert max(shares) > 1.0 / LOOSEST
    if kind is edge_on:
        assert max(bounds) > 100.0 * diagnostics_stage.UNCLIPPED_ERROR
    elif kind in (plain, grazing):
        assert set(bounds) == {diagnostics_stage.UNCLIPPED_ERROR}


def test_a_clipped_face_seen_exactly_from_its_side_has_no_bound():
    clip = np.array([(1.0, 1.0, 0.8, 1.0), (2.0, 2.0, 1.8, 2.0), (-1.0, -1.0, -1.2, -1.0)])
    coverage, geometry, _ = draw(clip)
    face_id = np.zeros_like(coverage.face_id)
    assert find_largest_error(face_id, (0, 1), geometry) == np.inf


def test_nothing_in_view_is_off_by_nothing():
    coverage, geometry, _ = draw(naive.clip_from_screen([(2, 2), (30, 3), (4, 14)], (32, 16)))
    nothing = np.full_like(coverage.face_id, -1)
    assert find_largest_error(nothing, (0, len(nothing)), geometry) == 0.0
