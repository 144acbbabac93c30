"""Guarantee: each sample of a triangulation is covered exactly once, however it is spelled."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj

sys.path.append(str(Path(__file__).parents[2]))
tilings = importlib.import_module("benchmarks.tilings")
watertight = importlib.import_module("benchmarks.watertight")

BITS = tilings.SUBPIXEL_BITS
SIZES = [(1, 1), (63, 65), (64, 64), (65, 63), (127, 1), (130, 200)]


def grid_tiling(seed, size, bits=8, count=4000, kind="jittered grid"):
    """Return a tiling of an image of the given size, with vertices on the grid of ``bits``."""
    rng = np.random.default_rng(seed)
    xy, faces = tilings.KINDS[kind](rng, (np.array(size) << bits, bits), count)
    return tilings.Tiling(kind, xy, faces, bits, size)


def clockwise(tiling):
    """Return the faces, all of them clockwise on the screen."""
    areas = tilings.doubled_area(tiling.xy, tiling.faces)
    return np.where(areas[:, None] < 0, tiling.faces[:, ::-1], tiling.faces)


def draw(tiling, faces, threads=1, **options):
    """Return the face numbers of a tiling at one depth."""
    size, bits = tiling.size, tiling.subpixel_bits
    positions = np.zeros((len(tiling.xy), 4))
    positions[:, :2] = (2.0 * tiling.xy / (np.array(size) << bits) - 1.0) * [1.0, -1.0]
    positions[:, 3] = 1.0
    quality = rj.Quality(subpixel_bits=bits)
    return rj.rasterize(positions, faces, size, quality=quality, threads=threads, **options).face_id


def covered_once(positions, faces, size, **options):
    """Return where exactly one face covers the sample, and where none does."""
    order = np.arange(len(faces))[::-1]
    first = rj.rasterize(positions, faces, size, depth="standard", threads=1, **options).face_id
    last = rj.rasterize(positions, faces[order], size, depth="reversed", threads=1, **options)
    last = np.where(last.face_id < 0, -1, order[last.face_id])
    return (first == last) & (first >= 0), (first < 0) & (last < 0)


# --- many edges -----------------------------------------------------------------------------------

EDGES = 200_000
"""Shared edges of each kind: a million in all."""


@pytest.mark.parametrize("kind", tilings.KINDS)
def test_triangulation_is_covered_once_and_by_its_owners(kind):
    found = watertight.Findings()
    seed = 0
    while found.shared_edges < EDGES:
        rng = np.random.default_rng([7, seed])
        tiling = tilings.random_tiling(rng, kind, 40_000, largest_side=200)
        found.add(watertight.check_tiling(tiling, rng), f"seed {seed}")
        seed += 1
    assert found.faulty == []
    assert found.samples > 10_000
    assert found.oracle_samples > 100


def test_single_triangles_own_their_samples_and_no_others():
    found = watertight.Findings()
    for seed in range(4):
        rng = np.random.default_rng([8, seed])
        found.add(watertight.check_single(rng, (32, 24)), f"seed {seed}")
    assert found.faulty == []
    assert found.triangles == 4 * 32 * 24


@pytest.mark.parametrize("kind", tilings.KINDS)
def test_tilings_have_no_gaps_or_overlaps_themselves(kind):
    # What the tests above rest on: one turn throughout, no edge of three faces, and the count.
    for seed in range(6):
        tiling = tilings.random_tiling(np.random.default_rng(seed), kind, 3000)
        areas = tilings.doubled_area(tiling.xy, tiling.faces)
        assert (areas >= 0).all() or (areas <= 0).all()
        edges = np.sort(tiling.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, uses = np.unique(edges, axis=0, return_counts=True)
        assert uses.max() == 2
        assert (uses == 2).sum() == tiling.shared_edges
        assert (tiling.xy.min(axis=0) <= 0).all()
        assert (tiling.xy.max(axis=0) >= np.array(tiling.size) << tiling.subpixel_bits).all()


# --- however it is spelled ------------------------------------------------------------------------


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("size", SIZES)
def test_every_size_and_grid_is_covered_once(size, bits):
    tiling = grid_tiling(sum(size), size, bits)
    found = watertight.check_tiling(tiling, np.random.default_rng(bits))
    assert found.faults == 0
    assert found.samples == size[0] * size[1]


SPELLINGS = {
    "winding": lambda faces, rng: np.where(
        rng.random((len(faces), 1)) < 0.5, faces[:, ::-1], faces
    ),
    "first vertex": lambda faces, rng: np.take_along_axis(
        faces, (rng.integers(0, 3, (len(faces), 1)) + np.arange(3)) % 3, axis=1
    ),
    "both": watertight.respell,
}


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_spelling_of_a_face_does_not_matter(spelling, threads):
    tiling = grid_tiling(1, (130, 200))
    rng = np.random.default_rng(2)
    expected = draw(tiling, tiling.faces)
    spelled = SPELLINGS[spelling](tiling.faces, rng)
    assert (spelled != tiling.faces).any(axis=1).mean() > 0.4
    assert (draw(tiling, spelled, threads) == expected).all()


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_order_of_faces_does_not_matter(threads):
    tiling = grid_tiling(3, (130, 200))
    order = np.random.default_rng(4).permutation(len(tiling.faces))
    assert (order[draw(tiling, tiling.faces[order], threads)] == draw(tiling, tiling.faces)).all()


def test_numbers_of_vertices_do_not_matter():
    tiling = grid_tiling(5, (130, 200))
    order = np.random.default_rng(6).permutation(len(tiling.xy))
    numbers = np.argsort(order)
    renumbered = tiling._replace(xy=tiling.xy[order], faces=numbers[tiling.faces])
    assert (draw(renumbered, renumbered.faces) == draw(tiling, tiling.faces)).all()


@pytest.mark.parametrize("kind", tilings.KINDS)
def test_faces_left_out_leave_exactly_their_samples(kind):
    tiling = grid_tiling(7, (100, 90), kind=kind)
    whole = draw(tiling, tiling.faces)
    kept = np.flatnonzero(np.random.default_rng(8).random(len(tiling.faces)) < 0.5)
    part = draw(tiling, tiling.faces[kept])
    shown = np.where(part < 0, -1, kept[part])
    assert (shown == np.where(np.isin(whole, kept), whole, -1)).all()
    assert 0 < (shown < 0).sum() < shown.size


@pytest.mark.parametrize("cull", ["back", "front"])
def test_faces_turned_away_leave_exactly_their_samples(cull):
    tiling = grid_tiling(9, (100, 90))
    whole = draw(tiling, tiling.faces)
    away = np.random.default_rng(10).random(len(tiling.faces)) < 0.5
    faces = clockwise(tiling)  # back faces on a screen with y down
    faces[~away] = faces[~away, ::-1]
    culled = away if cull == "back" else ~away
    assert (draw(tiling, faces, cull=cull) == np.where(culled[whole], -1, whole)).all()


@pytest.mark.parametrize("offset", [0, 1])
@pytest.mark.parametrize("pitch", [1, 2, 3])
def test_vertices_on_centres_and_half_way_between_cover_once(pitch, offset):
    # Every vertex at a multiple of half a pixel, either diagonal: ties at most samples.
    half = 128
    n = 2 * 80 // pitch + 3
    xy = (np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2) - 1) * pitch
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    one = np.stack([a, a + 1, a + n + 1, a, a + n + 1, a + n], axis=1)
    other = np.stack([a, a + 1, a + n, a + 1, a + n + 1, a + n], axis=1)
    either = np.random.default_rng(pitch).random((len(a), 1)) < 0.5
    faces = np.where(either, one, other).reshape(-1, 3)
    tiling = tilings.Tiling("halves", (xy - offset) * half, faces, 8, (80, 77))
    assert watertight.check_tiling(tiling, np.random.default_rng(11)).faults == 0


# --- seen by a camera -----------------------------------------------------------------------------


def room(rng, n):
    """Return the vertices and faces of a box [-1, 1]**3, each side an uneven n x n grid."""
    steps = np.linspace(-1.0, 1.0, n + 1)
    steps[1:-1] += rng.uniform(-0.3, 0.3, n - 1) / n
    numbers, faces = {}, []
    for axis in range(3):
        for side in (-1.0, 1.0):
            for i, j in np.ndindex(n, n):
                corners = []
                for u, v in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)):
                    point = [steps[u], steps[v]]
                    point.insert(axis, side)
                    corners.append(numbers.setdefault(tuple(point), len(numbers)))
                a, b, c, d = np.roll(corners, rng.integers(0, 2))  # either diagonal
                faces += [[a, b, c], [a, c, d]]
    return np.array(list(numbers)), np.array(faces)


@pytest.mark.parametrize("seed", range(6))
def test_room_around_the_eye_covers_every_sample_once(seed):
    # Faces beside and behind the eye are cut; neighbours must be cut alike.
    rng = np.random.default_rng(seed)
    vertices, faces = room(rng, 9)
    eye, target = rng.uniform(-0.8, 0.8, (2, 3))
    camera = rj.PerspectiveCamera(
        eye=eye, target=target, fov_y=rng.uniform(20, 120), near=0.01, far=100.0
    )
    size = (150, 117)
    clip_from_world = camera.projection_matrix(size) @ camera.view_matrix()
    positions = rj.transforms.transform_points(clip_from_world, vertices)
    once, nothing = covered_once(positions, faces, size)
    assert (positions[:, 3] <= 0).any()
    assert once.all()
    assert not nothing.any()


@pytest.mark.parametrize("seed", range(4))
def test_fan_that_reaches_beyond_the_guard_band_covers_every_sample_once(seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 40))
    angles = np.concatenate([angles, np.arange(8) * np.pi / 4])
    angles.sort()
    # The guard band ends at some hundred. Far ends cancel if an edge is not cut from its near one.
    far = 10.0 ** rng.uniform(2, 15, len(angles))
    ring = np.stack([far * np.cos(angles), far * np.sin(angles)], axis=1)
    hub = rng.uniform(-0.9, 0.9, (1, 2))
    positions = np.zeros((len(ring) + 1, 4))
    positions[:, :2] = np.concatenate([hub, hub + ring])
    positions[:, 3] = 1.0
    spokes = np.arange(1, len(positions))
    faces = np.stack([np.zeros_like(spokes), spokes, np.roll(spokes, -1)], axis=1)
    size = (120, 75)
    assert rj.rasterize(positions, faces, size, threads=1).totals.clipped > 20
    once, _ = covered_once(positions, faces, size)
    assert once.all()


def test_front_and_back_of_a_closed_mesh_have_one_outline(sphere):
    camera = rj.PerspectiveCamera(eye=(0.3, 0.7, 2.5), target=(0, 0, 0), near=0.1, far=10.0)
    for size in ((64, 64), (33, 97), (200, 150)):
        sides = [
            rj.render(sphere, camera, size=size, outputs=("face_id",), cull=cull).face_id >= 0
            for cull in ("back", "front")
        ]
        assert sides[0].any()
        assert (sides[0] == sides[1]).all()


# --- the script that tries millions ---------------------------------------------------------------


def run_script(*arguments):
    return CliRunner().invoke(watertight.main, [*arguments], catch_exceptions=False)


def test_script_reports_a_run_without_faults():
    done = run_script("--triangles", "6000", "--seed", "3", "--batch", "1000")
    assert done.exit_code == 0
    counts = dict(re.findall(r"(\w[\w ]*\w)\W+([\d,]+)", done.output))
    assert counts["seed"] == "3"
    assert [counts[name] for name in ("cracks", "overlaps", "disagreements")] == ["0"] * 3
    assert int(counts["triangles"].replace(",", "")) >= 6000


def spoil(monkeypatch, change):
    """Let every picture be changed before it is looked at."""
    rasterize = rj.rasterize

    def spoiled(positions, faces, size, **options):
        seen = rasterize(positions, faces, size, **options)
        change(seen.face_id, options)
        return seen

    monkeypatch.setattr(rj, "rasterize", spoiled)


def empty_a_sample(face_id, options):
    face_id[3, 5] = -1


def show_two_faces(face_id, options):
    if options["depth"] == "reversed":
        face_id[3, 5] += 1 if face_id[3, 5] == 0 else -1


def shift_a_row(face_id, options):
    face_id[10] = np.roll(face_id[10], 9)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (empty_a_sample, "cracks"), (show_two_faces, "overlaps"), (shift_a_row, "disagreements"),
    ],
)  # fmt: skip
def test_check_finds_what_is_wrong(monkeypatch, change, fault):
    tiling = grid_tiling(12, (60, 50), count=600)
    assert watertight.check_tiling(tiling, np.random.default_rng(0)).faults == 0
    spoil(monkeypatch, change)
    found = watertight.check_tiling(tiling, np.random.default_rng(0))
    assert getattr(found, fault) > 0


def test_script_fails_where_a_sample_is_not_covered(monkeypatch):
    spoil(monkeypatch, empty_a_sample)
    done = run_script("--triangles", "2000", "--seed", "3", "--batch", "1000")
    assert done.exit_code == 1
    assert "batch 0, jittered grid" in done.output
    assert "1 cracks" in done.output
