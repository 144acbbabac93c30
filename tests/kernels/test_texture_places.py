"""Coordinates straight from edge functions are exact to rounding, and pictures keep their bits."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry.setup import CLIPPED, GUARD, NEAR
from rasterjit.pipeline.passes import Pass, ShadingNeeds
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import uv_derivatives, uv_interpolation
from rasterjit.pipeline.surface.gather_samples import list_samples
from rasterjit.pipeline.surface.sample_block import (
    COLUMN,
    COUNT_ELEMENTS,
    END_PATCH,
    FIRST_PATCH,
    FIRST_SAMPLE,
    INTERVAL_COLUMN,
    INTERVAL_COUNT,
    INTERVAL_ROW,
    INTERVAL_START,
    INTERVAL_STOP,
    KIND,
    PATCH_COUNT,
    ROW,
    SEGMENT_COUNT,
    SPAN,
    SPAN_COLUMN,
    SPAN_ROW,
    A,
    B,
    Block,
    C,
)
from rasterjit.pipeline.surface.texture_filters import read_vertex_uvs
from rasterjit.pipeline.surface.texture_lookup import U, V
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.rendering import shading_passes
from rasterjit.rendering.pass_runner import BLOCK, THREAD_BLOCK
from rasterjit.rendering.planning import list_passes
from rasterjit.rendering.regions import Region, RegionRenderer
from rasterjit.runtime import threads
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import stage
from rasterjit.runtime.stage_runner import StageList, Step
from rasterjit.runtime.state_block import float32, float64

ROUNDINGS = Fraction(2) ** -48
"""Error of a coordinate, as a share of the largest way between vertices."""


@stage
def take_places(block: Block, count, taken: float64[:, :, ::1]):
    """Write the coordinates of a block to the pixels of its samples."""
    for k in range(block.counts[INTERVAL_COUNT]):
        interval = block.intervals[k]
        row, column = interval[INTERVAL_ROW], interval[INTERVAL_COLUMN]
        start = interval[INTERVAL_START]
        for n in range(interval[INTERVAL_STOP] - start):
            taken[row, column + n, 0] = block.uv_rows[U, start + n]
            taken[row, column + n, 1] = block.uv_rows[V, start + n]


@stage
def place_slowly(block: Block, count, uv: float32[:, ::1], geometry: Geometry):
    """Write all coordinates exactly: the twin of `interpolate_uv_from_edges`."""
    whole = block.ints
    for k in range(block.counts[SEGMENT_COUNT]):
        segment = block.segments[k]
        for r in range(np.uintp(segment[FIRST_PATCH]), np.uintp(segment[END_PATCH])):
            first, end = (
                np.int64(whole[FIRST_SAMPLE, r]),
                np.int64(whole[FIRST_SAMPLE, r + np.uintp(1)]),
            )
            a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
            column, row = np.int64(segment[SPAN_COLUMN]), np.int64(segment[SPAN_ROW])
            if segment[KIND] != SPAN:
                column, row = np.int64(whole[COLUMN, first]), np.int64(whole[ROW, first])
            ends = read_vertex_uvs(uv, a, b, c)
            uv_interpolation.interpolate_uv_exactly(
                part(block.uv_rows, U, first, end), part(block.uv_rows, V, first, end),
                end - first, (a, b, c), ends, column, row, geometry,
            )  # fmt: skip


@stage
def step_slowly(block: Block, count, uv: float32[:, ::1], geometry: Geometry):
    """Write the steps of samples on clipped faces one by one, over those of `find_uv_steps`."""
    whole, codes = block.ints, geometry.codes
    for r in range(np.uintp(block.counts[PATCH_COUNT])):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        if np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED) != 0:
            for n in range(whole[FIRST_SAMPLE, r], whole[FIRST_SAMPLE, r + np.uintp(1)]):
                uv_derivatives.write_clipped_uv_step(
                    block.uv_rows, n, a, b, c, whole[COLUMN, n], whole[ROW, n], uv,
                    geometry.clip_positions, geometry.viewport,
                )  # fmt: skip


def take(positions, uv, face_id, viewport, by=uv_interpolation.interpolate_uv_from_edges):
    """Return the coordinates where one triangle is seen, and its vertices on the screen."""
    screen, _ = visibility_pass.project_to_screen(
        positions, (0.0, -1.0, 0.0), viewport, threads.Workers(1)
    )
    faces = np.array([(0, 1, 2)], np.int32)
    geometry = Geometry(faces, screen.xy, screen.codes, screen.w, positions, viewport)
    taken = np.full((*face_id.shape, 2), np.nan)
    columns = face_id.shape[1]
    listed = (
        np.ascontiguousarray(face_id), 0, columns, faces, np.array([0, 1]),
        np.zeros(4, np.float32), 0, np.empty((columns, 0, 4), np.float32),
        np.empty((columns, 0), np.uint32),
    )  # fmt: skip
    THREAD_BLOCK.block[:COUNT_ELEMENTS] = 0
    steps = [
        Step(list_samples, listed), Step(by, (np.float32(uv), geometry)),
        Step(take_places, (taken,)),
    ]  # fmt: skip
    StageList(steps).run(THREAD_BLOCK.block, BLOCK)
    return taken, screen


def seen(positions, size, bits):
    """Return the face seen at each pixel, of one triangle."""
    quality, faces = rj.Quality(subpixel_bits=bits), np.array([(0, 1, 2)], np.int32)
    return rj.rasterize(positions, faces, size, quality=quality, threads=1).face_id


def place(points, w, uv, bits=8, face_id=None):
    """Return where one triangle is seen, the coordinates there, and its snapped corners."""
    size = 64, 64
    positions = naive.clip_from_screen(points, size, 0.0, w)
    if face_id is None:
        face_id = seen(positions, size, bits)
    taken, screen = take(positions, uv, face_id, make_viewport(size, bits))
    return face_id, taken, screen.xy[:3].tolist()


def check(points, w, uv, every, bits=8):
    """Compare the coordinates of one triangle with exact ones; return how many."""
    face_id, taken, corners = place(points, w, uv, bits)
    values = [[Fraction(float(part)) for part in row] for row in np.float32(uv)]
    samples = np.argwhere(face_id == 0)[::every]
    for row, column in samples:
        weights = oracle.perspective_weights(
            corners, np.float64(w).tolist(), naive.centre(int(column), int(row), bits)
        )
        for k in range(2):
            own = [value[k] for value in values]
            want = sum(weight * part for weight, part in zip(weights, own, strict=True))
            slack = ROUNDINGS * (max(own) - min(own)) + Fraction(2) ** -50 * max(map(abs, own))
            assert abs(Fraction(float(taken[row, column, k])) - want) <= slack, (points, w, row)
    return len(samples)


def random_faces(count=45):
    """Yield corners of faces, pixels, of all shapes, w, and coordinates: near and far from 0."""
    rng = np.random.default_rng(11)
    for n in range(count):
        if n % 3 == 0:
            points = rng.uniform(-30, 94, (3, 2))
        elif n % 3 == 1:
            start, way = rng.uniform(0, 64, 2), rng.normal(size=2) * rng.choice([30, 3000])
            aside = np.array([-way[1], way[0]]) / np.hypot(*way)
            points = np.array([start - way, start + way, start + aside * rng.uniform(0.3, 2)])
        else:
            points = rng.uniform(20, 40, 2) + rng.uniform(-3, 3, (3, 2))
        w = 2.0 ** rng.integers(*((-3, 4), (-40, 41), (-90, 91))[n // 3 % 3], 3)
        yield np.round(points * 256) / 256, w, rng.uniform(-1, 1, (3, 2)) * 10.0 ** (n % 5)


def test_coordinates_are_exact_to_rounding():
    assert sum(check(*own, every=29) for own in random_faces()) > 250


@pytest.mark.parametrize("w", [(1.0, 0.25, 512.0), (2.0**-460, 2.0**-455, 2.0**-450)])
def test_faces_beyond_float64_are_placed_by_exact_weights(w):
    # Ways of more than 2**26 units, whose products float64 rounds; w whose products underflow.
    wide = [(-8180.0, 31.25), (8240.0, 32.0 + 2.0**-12), (8240.0, 60.0)]
    plain = [(-7.5, -3.25), (71.0, 20.5), (10.25, 90.0)]
    uv = [(0.5, -3.0), (7.0, 0.25), (2.0, 9.0)]
    points, bits = (wide, 12) if w[0] == 1.0 else (plain, 8)
    assert check(points, np.array(w), uv, every=7, bits=bits) > 20


def clipped_faces():
    """Yield clip positions of triangles that cross the near plane or the guard band, and which."""
    rng = np.random.default_rng(7)
    for n in range(6):
        positions = np.concatenate([rng.normal(size=(3, 2)), np.zeros((3, 1)), np.ones((3, 1))], 1)
        if n % 2 == 0:
            positions[:, 2:] = np.array([(0.1, 1.0), (0.3, 0.7), (-2.0, -0.9)])
            yield positions, NEAR
        else:
            positions[n % 3, :2] *= 1e4
            yield positions, GUARD


@pytest.mark.parametrize(
    ("size", "region", "bits"),
    [
        ((64, 64), None, 8), ((150, 37), None, 12),
        *(((150, 37), Region(70, 9, 61, 23), bits) for bits in (4, 8, 12)),
    ],
)  # fmt: skip
def test_clipped_faces_are_placed_as_sample_by_sample(size, region, bits):
    viewport = make_viewport(size, bits, region)
    left, top, columns, rows = region or (0, 0, *size)
    uv, counts = [(0.5, -3.0), (7.0, 0.25), (2.0, 900.0)], {NEAR: 0, GUARD: 0}
    for positions, plane in clipped_faces():
        face_id = seen(positions, size, bits)[top : top + rows, left : left + columns]
        # Long runs, and runs of one and two samples.
        for shown in (face_id, np.where(np.arange(columns) % 7 % 3 < 2, face_id, np.int32(-1))):
            quick, screen = take(positions, uv, shown, viewport)
            slow, _ = take(positions, uv, shown, viewport, by=place_slowly)
            assert np.bitwise_or.reduce(screen.codes[:3]) & plane
            assert quick.tobytes() == slow.tobytes()
            assert not np.isnan(quick[shown == 0]).any()
            counts[plane] += int((shown == 0).sum())
    assert min(counts.values()) > 300


def test_where_a_run_is_cut_changes_no_bit():
    # In a span, beside it, in half a group, and alone.
    points, w = [(-7.5, -3.25), (71.0, 20.5), (10.25, 90.0)], 2.0 ** np.array([0, 5, -2])
    uv = [(0.5, -3.0), (7.0, 0.25), (2.0, 9.0)]
    face_id, whole, _ = place(points, w, uv)
    for step in (2, 3, 5, 17, 40):
        some = np.where(np.arange(64) % step < step - 1, face_id, np.int32(-1))
        _, taken, _ = place(points, w, uv, face_id=some)
        shown = some >= 0
        assert shown.sum() > 500
        assert taken[shown].tobytes() == whole[shown].tobytes()


def ground(filter="bilinear", shading="unlit", squares=12, side=64, repeats=300.0, **options):
    """Return a scene of a bumpy textured mesh, its texture black and white, often repeated."""
    rng = np.random.default_rng(5)
    z, x = np.mgrid[0 : squares + 1, 0 : squares + 1] / squares * 4.0 - 2.0
    first = (np.arange(squares)[:, np.newaxis] * (squares + 1) + np.arange(squares)).ravel()
    above = first + squares + 1
    faces = np.concatenate(
        [np.stack([first, above + 1, first + 1], 1), np.stack([first, above, above + 1], 1)]
    )
    points = np.stack([x, 0.2 * np.sin(5 * x) * np.cos(4 * z), z], -1).reshape(-1, 3)
    image = rng.integers(0, 2, (side, side, 3), np.uint8) * np.uint8(255)
    material = rj.Material(
        shading=shading, base_color_texture=rj.Texture(image, filter=filter, wrap="mirror")
    )
    scene = rj.Scene()
    uv = points[:, [0, 2]] * repeats
    scene.add(rj.Mesh(points, faces, uv=uv, material=material, **options))
    return scene


# From inside, so that some faces cross the near plane, and w differs much.
CAMERA = rj.PerspectiveCamera((0.1, 0.35, 1.9), (0.0, 0.0, 0.0), near=0.3)


@pytest.mark.parametrize("filter", ["nearest", "bilinear"])
@pytest.mark.parametrize("side", [3, 512])
@pytest.mark.parametrize("squares", [3, 40])
def test_pictures_are_those_by_weights(monkeypatch, squares, side, filter):
    scene = ground(filter, squares=squares, side=side)
    outputs = "color", "linear"
    quick = rj.render(scene, CAMERA, size=(160, 120), outputs=outputs)
    monkeypatch.setattr(ShadingNeeds, "reads_uv_only", False)
    slow = rj.render(scene, CAMERA, size=(160, 120), outputs=outputs)
    assert np.ptp(slow.color[..., 0]) > 100
    # Positions are rounded to 2**-24 texel: hardly any rounds otherwise.
    assert (quick.color != slow.color).sum() <= 2
    assert (quick.linear != slow.linear).sum() <= 20


@pytest.mark.parametrize("squares", [1, 2, 3])
@pytest.mark.parametrize("shading", ["unlit", "phong"])
def test_steps_on_clipped_faces_are_those_of_each_sample(monkeypatch, squares, shading):
    scene = ground("trilinear", shading, squares, repeats=30.0)
    outputs, passes = ("color", "linear"), shading_passes.coordinate_passes
    quick = rj.render(scene, CAMERA, size=(160, 120), outputs=outputs)

    def passes_and_twin(needs, kind=None):
        slow = Pass(step_slowly, lambda a: (a.surface.textures.uv, a.geometry))
        return [*passes(needs, kind), slow]

    monkeypatch.setattr(shading_passes, "coordinate_passes", passes_and_twin)
    slow = rj.render(scene, CAMERA, size=(160, 120), outputs=outputs)
    assert quick.stats.clipped > 0
    assert quick.linear.tobytes() == slow.linear.tobytes()


def test_regions_and_threads_change_no_bit():
    scene, size = ground(squares=5), (200, 150)
    whole = rj.render(scene, CAMERA, size=size, outputs=("linear",), threads=1).linear
    three = rj.render(scene, CAMERA, size=size, outputs=("linear",), threads=3).linear
    assert three.tobytes() == whole.tobytes()
    with RegionRenderer(scene, CAMERA, size=size, outputs=("linear",)) as renderer:
        region = renderer.render_region(Region(64, 64, 101, 83)).linear
    assert region.tobytes() == np.ascontiguousarray(whole[64:147, 64:165]).tobytes()


def is_quick(scene, **quality):
    plan = rj.explain(scene, CAMERA, rj.Quality(**quality), size=(64, 48))
    names = {told.name for told in list_passes(plan)}
    by_weights = {"barycentric_weights.find_weights", "uv_derivatives.interpolate_uv"}
    assert by_weights <= names or not by_weights & names
    return "uv_interpolation.interpolate_uv_from_edges" in names and not by_weights & names


def test_who_takes_no_weights():
    colors = np.full((169, 3), 0.5)
    assert is_quick(ground())
    assert is_quick(ground("nearest"), samples=64)
    assert not is_quick(ground("trilinear"))
    assert not is_quick(ground(), samples=4)
    assert not is_quick(ground(shading="phong"))
    assert not is_quick(ground(colors=colors))
