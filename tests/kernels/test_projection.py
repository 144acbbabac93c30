"""Vertices reach the screen in one pass with the bits of the stages one after the other."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline.geometry import projection, setup
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads as sharing
from rasterjit.scene.transforms import perspective, rotate, scale, transform_points, translate

COEFFICIENTS = (0.25, -1.0, 0.125)
CLIP_FROM_RELATIVE = perspective(60.0, 1.5, 0.1, 100.0)
IMAGE = make_viewport((96, 64), 8)


def naive_outcode(x, y, z, w, viewport):
    """Return the outcode, plane by plane."""
    if not all(abs(value) <= setup.MAX_COORDINATE for value in (x, y, z, w)):
        return setup.INVALID
    code = 0
    for outside, bit in (
        (x < -w, setup.LEFT), (x > w, setup.RIGHT), (y < -w, setup.BOTTOM), (y > w, setup.TOP),
        (z < -w, setup.NEAR), (z > w, setup.FAR),
    ):  # fmt: skip
        code |= bit if outside else 0
    is_near = abs(x) <= viewport.guard_x * w and abs(y) <= viewport.guard_y * w
    return code if w > 0.0 and is_near else code | setup.GUARD


def naive_project(clip_positions, viewport):
    """Return codes, and of each vertex inside the guard band x, y, depth and w, else ``None``."""
    codes, places = [], []
    step, shift = 2.0**viewport.subpixel_bits, viewport.grid_bits - viewport.subpixel_bits
    c0, c1, c2 = COEFFICIENTS
    for x, y, z, w in clip_positions.tolist():
        codes.append(naive_outcode(x, y, z, w, viewport))
        places.append(None)
        if not codes[-1] & (setup.GUARD | setup.INVALID):
            # Python's round is exact and rounds half to even.
            column = round((x / w + 1.0) * (0.5 * viewport.width) * step)
            row = round((1.0 - y / w) * (0.5 * viewport.height) * step)
            depth = (c0 + c1 * z + c2 * w) / w
            places[-1] = column << shift, row << shift, depth.hex(), w.hex()
    return codes, places


def listed(screen, count):
    """Return screen vertices in the form of `naive_project`."""
    codes = screen.codes[:count].tolist()
    places = [
        None
        if code & (setup.GUARD | setup.INVALID)
        else (*screen.xy[n].tolist(), float(screen.depth[n]).hex(), float(screen.w[n]).hex())
        for n, code in enumerate(codes)
    ]
    return codes, places


def hard_positions(count, rng):
    """Return positions of which most can be seen and many are huge, tiny, NaN or infinite."""
    positions = rng.normal(size=(count, 3))
    positions[::11] *= 10.0 ** rng.integers(-300, 300, (len(positions[::11]), 1))
    positions[::13] = rng.integers(-2, 3, (len(positions[::13]), 3))
    some = positions[::7]
    some[np.arange(len(some)), rng.integers(0, 3, len(some))] = rng.choice(
        [np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, 1e150, -1e308, 1.7e308], len(some)
    )
    return positions


def matrices(rng):
    """Return ways from model space to the eye: moved, turned, mirrored, flat, behind the eye."""
    away = translate((0.25, -0.5, -4.0))
    turned = away @ rotate((1.0, 2.0, -0.5), 35.0)
    rough = away.copy()
    rough[:3, :3] = rng.normal(size=(3, 3))
    unsure = away.copy()
    unsure[1, 1] = np.nan
    flat = away @ np.diag((1.0, 0.0, 2.0, 1.0))
    minus_zero = away.copy()
    minus_zero[:2, 3] = minus_zero[1, 0] = -0.0
    return np.stack([
        away, np.eye(4), turned, turned @ scale((-1.0, 1.0, 1.0)), flat,
        translate((0.0, 0.0, 3.0)), rough, unsure, minus_zero, away @ scale(1e200),
    ])  # fmt: skip


def scene_of_vertices(counts, seed):
    """Return vertices of objects with these many vertices each."""
    rng = np.random.default_rng(seed)
    ways = matrices(rng)
    relative_from_model = ways[rng.permutation(len(counts)) % len(ways)]
    starts = np.concatenate(([0], np.cumsum(counts)))
    positions = hard_positions(int(starts[-1]), rng)
    return visibility_pass.ModelVertices(positions, starts, relative_from_model, CLIP_FROM_RELATIVE)


def by_hand(vertices):
    """Return the clip positions of all vertices, object by object."""
    clip = np.empty((len(vertices.positions), 4))
    for owner, matrix in enumerate(vertices.relative_from_model):
        own = slice(vertices.vertex_starts[owner], vertices.vertex_starts[owner + 1])
        with np.errstate(all="ignore"):
            relative = vertices.positions[own] + matrix[:3, 3]
        if (matrix[:3, :3] != np.eye(3)).any():
            relative = transform_points(matrix, vertices.positions[own])[:, :3]
        clip[own] = transform_points(vertices.clip_from_relative, relative)
    return clip


@pytest.mark.parametrize("size", [(96, 64), (1, 16384), (1920, 1080)])
@pytest.mark.parametrize("bits", [0, 4, 8, 12])
def test_one_pass_equals_naive(size, bits):
    vertices = scene_of_vertices([300, 0, 1, 257, 60, 60, 0, 700, 3, 512, 255], bits)
    viewport, count = make_viewport(size, bits), len(vertices.positions)
    want = naive_project(by_hand(vertices), viewport)
    screen, seen = visibility_pass.transform_and_project(
        vertices, COEFFICIENTS, viewport, sharing.Workers(1)
    )
    assert listed(screen, count) == want
    assert seen == np.bitwise_or.reduce(want[0])
    assert seen == 255
    assert sum(place is not None for place in want[1]) > 300
    # So do the two stages, one after the other.
    clip = visibility_pass.transform_to_clip(*vertices[:4], sharing.Workers(1))
    screen, seen = visibility_pass.project_to_screen(
        clip, COEFFICIENTS, viewport, sharing.Workers(1)
    )
    assert listed(screen, count) == want
    assert seen == 255


@pytest.mark.parametrize("step", [1, 7, 256, 300, 100_000])
@pytest.mark.parametrize("threads", [1, 3])
def test_tasks_and_threads_change_no_bit(step, threads, monkeypatch):
    vertices = scene_of_vertices([0, 5, 0, 0, 400, 1, 1, 1, 77, 300, 0], 5)
    want = naive_project(by_hand(vertices), IMAGE)
    monkeypatch.setattr(visibility_pass, "VERTICES_PER_TASK", step)
    workers = sharing.Workers(threads)
    screen, _ = visibility_pass.transform_and_project(vertices, COEFFICIENTS, IMAGE, workers)
    workers.close()
    assert listed(screen, len(vertices.positions)) == want


def test_nothing_else_is_written():
    vertices = scene_of_vertices([300, 20], 6)
    screen, _ = visibility_pass.transform_and_project(
        vertices, COEFFICIENTS, IMAGE, sharing.Workers(1)
    )
    assert len(screen.codes) == 320 + visibility_pass.SPARE_VERTICES
    packed = screen.xy.base.view(np.float64).reshape(-1, 2)
    packed[:] = screen.w[:, np.newaxis] = np.pi
    screen.codes[:] = setup.INVALID
    some = projection.allocate_scratch()
    objects = vertices.vertex_starts, vertices.relative_from_model
    projection.transform_vertices(
        (10, 310), vertices.positions, objects, CLIP_FROM_RELATIVE, COEFFICIENTS, IMAGE, screen,
        some,
    )  # fmt: skip
    written = np.zeros(len(packed), bool)
    written[10:310] = True
    assert ((packed != np.pi).any(axis=1) == written).all()
    assert ((screen.w != np.pi) == written).all()
    assert ((screen.codes != setup.INVALID) <= written).all()


def test_no_vertices_are_nothing():
    vertices = visibility_pass.ModelVertices(
        np.empty((0, 3)), np.zeros(2, np.int64), np.eye(4)[np.newaxis], CLIP_FROM_RELATIVE
    )
    screen, seen = visibility_pass.transform_and_project(
        vertices, COEFFICIENTS, IMAGE, sharing.Workers(1)
    )
    assert seen == 0
    assert len(screen.codes) == visibility_pass.SPARE_VERTICES


def test_clip_positions_are_made_only_where_they_are_read(cube, camera, monkeypatch):
    made = []
    transform = visibility_pass.transform_to_clip

    def watched(*arguments):
        made.append(transform(*arguments))
        return made[-1]

    monkeypatch.setattr(visibility_pass, "transform_to_clip", watched)
    size, outputs = (24, 16), ("color", "barycentric", "normal", "position")
    rj.render(cube, camera, size=size, outputs=outputs, threads=1)
    assert not made
    near = rj.PerspectiveCamera((1.4, 0.2, 1.3), (0, 0, 0), near=0.5)
    rj.render(cube, near, size=size, outputs=outputs, threads=1)
    assert [array.shape for array in made] == [(8, 4)]
    rj.render(cube, camera, size=size, diagnose=True, threads=1)
    scene = rj.Scene()
    scene.add(cube)
    scene.wireframe = rj.Wireframe()
    rj.render(scene, camera, size=size, threads=1)
    assert [array.shape for array in made] == [(8, 4)] * 3
