"""
``python -m benchmarks.watertight``: draw millions of triangles and check every sample of them.

Two guarantees are tried:

*Watertight.* Random triangulations that cover the image are drawn twice. Once the nearest face
wins and of equal depths the first; once the farthest, and of equal depths the last. Only a sample
that exactly one face covers shows the same face in both: anything else is an overlap, or a crack
where it shows none. Each face is spelled at random (first vertex, winding), the faces come in
random order, and 1 to 3 threads draw them.

*Exact.* Exactly one face of a triangulation owns a sample, by exact arithmetic on the snapped
vertices and the top-left rule. So where the face that is seen owns the sample, and one is seen
everywhere, the coverage of every face is right at every sample. Single triangles, each in a cell
of its own, are compared at every sample as well. The arithmetic is int64, written here a second
time; on random triangles it is itself compared with ``rasterjit.oracle``.
"""

from __future__ import annotations

import secrets
import sys
from dataclasses import dataclass, field
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import rasterjit as rj
from benchmarks.tilings import KINDS, SUBPIXEL_BITS, Tiling, edge, random_tiling

BATCH = 50_000
"""Triangles of one triangulation: some ten megabytes at a time."""

CELL = 16
"""Side of the square that a single triangle is drawn into, pixels."""

CELLS = (96, 64)
"""Columns and rows of such squares."""

ORACLE_TRIANGLES, ORACLE_SAMPLES = 4, 100
"""What of each batch is also given to ``rasterjit.oracle``."""

SINGLE = "single triangles"
LISTED = 10
"""Most batches with a fault that are named one by one."""


@dataclass
class Findings:
    """What was tried, and what was wrong with it."""

    triangles: int = 0
    shared_edges: int = 0
    samples: int = 0
    """Samples whose face was compared with the exact rule."""
    oracle_samples: int = 0
    """Pairs of a triangle and a sample that ``rasterjit.oracle`` was asked about."""
    cracks: int = 0
    """Samples inside the union that show nothing."""
    overlaps: int = 0
    """Samples that more than one face covers."""
    disagreements: int = 0
    """Samples whose coverage is not what exact arithmetic says."""
    rule_errors: int = 0
    """Answers of this file's arithmetic that ``rasterjit.oracle`` contradicts."""
    faulty: list[str] = field(default_factory=list)

    @property
    def faults(self) -> int:
        """Count all that should not be."""
        return self.cracks + self.overlaps + self.disagreements + self.rule_errors

    def add(self, other: Findings, what: str) -> None:
        """Take in the findings of one batch."""
        if other.faults:
            self.faulty.append(
                f"{what}: {other.cracks} cracks, {other.overlaps} overlaps, "
                f"{other.disagreements} disagreements, {other.rule_errors} rule errors"
            )
        for name, value in vars(other).items():
            if name != "faulty":
                setattr(self, name, getattr(self, name) + value)


# --- the exact rule, in int64 ---------------------------------------------------------------------


def covers(corners: NDArray[np.int64], points: NDArray[np.int64]) -> NDArray[np.bool_]:
    """
    Tell which triangles own which points, by the top-left rule.

    Parameters
    ----------
    corners : (..., 3, 2) int64, screen, any unit
        Of either winding; differences below 2**30.
    points : (..., 2) int64, in the same unit

    Returns
    -------
    (...) bool
        False for triangles without area.
    """
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    area = edge(a, b, c)
    turned = (area < 0)[..., None]
    b, c = np.where(turned, c, b), np.where(turned, b, c)
    inside = area != 0
    for start, end in ((a, b), (b, c), (c, a)):
        value, (dx, dy) = edge(start, end, points), np.moveaxis(end - start, -1, 0)
        owns_its_points = (dy < 0) | ((dy == 0) & (dx > 0))
        inside = inside & ((value > 0) | ((value == 0) & owns_its_points))
    return inside


def centres(columns: NDArray[Any], rows: NDArray[Any], bits: int) -> NDArray[np.int64]:
    """Return pixel centres, (..., 2), in half steps of the grid, whole on every grid."""
    pixels = np.stack(np.broadcast_arrays(columns, rows), axis=-1).astype(np.int64)
    return (2 * pixels + 1) << bits


# --- drawing --------------------------------------------------------------------------------------


def clip_positions(
    xy: NDArray[np.int64], bits: int, size: tuple[int, int], rng: Any
) -> NDArray[np.float64]:
    """
    Return clip positions that snap to the given grid points.

    Half the time they lie on a plane that faces the eye, else each at a distance of its own.
    """
    positions = np.zeros((len(xy), 4))
    positions[:, :2] = (2.0 * xy / (np.array(size) << bits) - 1.0) * [1.0, -1.0]
    positions[:, 3] = 1.0
    if rng.random() < 0.5:
        positions[:, 2] = rng.uniform(-0.9, 0.9, len(xy))
        positions *= 10.0 ** rng.uniform(-2, 2, (len(xy), 1))
    return positions


def respell(faces: NDArray[np.int64], rng: Any) -> NDArray[np.int64]:
    """Return the faces with a random first vertex and winding each."""
    turn = rng.choice([1, -1], (len(faces), 1))
    order = (rng.integers(0, 3, (len(faces), 1)) + turn * np.arange(3)) % 3
    return np.take_along_axis(faces, order, axis=1)


def owners(
    positions: NDArray[np.float64],
    faces: NDArray[np.int64],
    size: tuple[int, int],
    bits: int,
    rng: Any,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Draw faces so that the first picture shows one face of each sample, the second another.

    Returns
    -------
    two (H, W) int64
        Face numbers, -1 where nothing is; equal wherever at most one face covers the sample.
    """
    order = rng.permutation(len(faces))
    quality = rj.Quality(subpixel_bits=bits)
    pictures = []
    for numbers, depth in ((order, "standard"), (order[::-1], "reversed")):
        seen = rj.rasterize(
            positions, respell(faces[numbers], rng), size, quality=quality, depth=depth,
            threads=int(rng.integers(1, 4)),
        ).face_id  # fmt: skip
        pictures.append(np.where(seen < 0, -1, numbers[seen]))
    return pictures[0], pictures[1]


# --- the checks -----------------------------------------------------------------------------------


def check_tiling(tiling: Tiling, rng: Any) -> Findings:
    """Draw a triangulation and check every sample of the image."""
    found = Findings(len(tiling.faces), tiling.shared_edges)
    bits, size = tiling.subpixel_bits, tiling.size
    positions = clip_positions(tiling.xy, bits, size, rng)
    one, other = owners(positions, tiling.faces, size, bits, rng)
    found.cracks = int((one < 0).sum())
    found.overlaps = int((one != other).sum())
    # Compare with the exact rule: the face that is seen owns the sample.
    corners = 2 * tiling.xy[tiling.faces]
    rows, columns = np.indices(one.shape)
    points = centres(columns, rows, bits)
    found.samples = one.size
    found.disagreements = int((~covers(corners[one], points)[one >= 0]).sum())
    # Ask the oracle about some samples: about the face that is seen, and about one beside it.
    seen = one.ravel()
    for sample in rng.integers(0, one.size, ORACLE_SAMPLES):
        point = points.reshape(-1, 2)[sample]
        for face in (seen[sample], seen[min(sample + 1, one.size - 1)]):
            exact = rj.oracle.covers(corners[face], point)
            found.rule_errors += exact != bool(covers(corners[face], point))
            found.oracle_samples += 1
    return found


def random_triangles(rng: Any, count: int, bits: int) -> NDArray[np.int64]:
    """Return triangles in a cell, (count, 3, 2) int64: any, coarse, slivers and tiny ones."""
    side = CELL << bits
    corners = rng.integers(0, side + 1, (count, 3, 2))
    kind = rng.integers(0, 4, count)
    coarse = max(bits - 1, 0)
    corners[kind == 1] = corners[kind == 1] >> coarse << coarse
    thin = kind == 2
    middle = corners[thin, 0] + rng.integers(0, 17, (thin.sum(), 1)) * (
        corners[thin, 1] - corners[thin, 0]
    ) // 16  # fmt: skip
    corners[thin, 2] = middle + rng.integers(-2, 3, middle.shape)
    tiny = kind == 3
    reach = 2 << bits
    corners[tiny, 1:] = corners[tiny, :1] + rng.integers(-reach, reach + 1, (tiny.sum(), 2, 2))
    return np.clip(corners, 0, side)


def check_single(rng: Any, cells: tuple[int, int] = CELLS) -> Findings:
    """Draw single triangles, each in a cell of its own, and compare every sample with the rule."""
    bits = int(rng.choice(SUBPIXEL_BITS))
    count = cells[0] * cells[1]
    size = (cells[0] * CELL, cells[1] * CELL)
    corners = random_triangles(rng, count, bits)
    first_pixels = CELL * np.stack([np.arange(count) % cells[0], np.arange(count) // cells[0]], -1)
    xy = (corners + (first_pixels << bits)[:, None]).reshape(-1, 2)
    faces = np.arange(3 * count).reshape(-1, 3)
    one, other = owners(clip_positions(xy, bits, size, rng), faces, size, bits, rng)
    found = Findings(triangles=count, samples=one.size)
    found.overlaps = int((one != other).sum())
    rows, columns = np.indices((CELL, CELL))
    points = centres(columns, rows, bits).reshape(1, -1, 2)
    cut = one.reshape(cells[1], CELL, cells[0], CELL).swapaxes(1, 2).reshape(count, -1)
    for band in np.array_split(np.arange(count), cells[1]):
        exact = covers(2 * corners[band, None], points)
        found.disagreements += int((np.where(exact, band[:, None], -1) != cut[band]).sum())
    # Ask the oracle about all samples of some triangles.
    for face in rng.integers(0, count, ORACLE_TRIANGLES):
        pixels = rj.oracle.covered_pixels(
            (corners[face] / (1 << bits)).tolist(), (CELL, CELL), subpixel_bits=bits
        )
        exact = covers(2 * corners[face], points[0])
        answers = [(i, j) in pixels for j in range(CELL) for i in range(CELL)]
        found.rule_errors += int((exact != answers).sum())
        found.oracle_samples += len(answers)
    return found


def check_batch(seed: int, number: int, count: int) -> tuple[Findings, str]:
    """Check one batch; the same seed and number give the same batch."""
    rng = np.random.default_rng([seed, number])
    kinds = [*KINDS, SINGLE]
    kind = kinds[number % len(kinds)]
    if kind == SINGLE:
        rows = max(min(count // CELLS[0], CELLS[1]), 1)
        return check_single(rng, (CELLS[0], rows)), f"batch {number}, {kind}"
    tiling = random_tiling(rng, kind, count)
    what = f"batch {number}, {kind}, {tiling.subpixel_bits} bits, {tiling.size}"
    return check_tiling(tiling, rng), what


def print_findings(found: Findings, seed: int, console: Console) -> None:
    """Print what was tried and found."""
    table = Table(title="Watertight and exact", show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_row("seed", str(seed))
    for name, value in vars(found).items():
        if name != "faulty":
            table.add_row(name.replace("_", " "), f"{value:,}")
    console.print(table)
    for line in found.faulty[:LISTED]:
        console.print(line)
    if len(found.faulty) > LISTED:
        console.print(f"and {len(found.faulty) - LISTED} more batches with faults")


@click.command()
@click.option(
    "--triangles", type=click.IntRange(min=1), default=10_000_000, show_default=True,
    help="How many to draw at least.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), help="Default: a new one, which is printed.")
@click.option("--batch", type=click.IntRange(min=100), default=BATCH, show_default=True,
              help="Triangles drawn at once.")  # fmt: skip
def main(triangles: int, seed: int | None, batch: int) -> None:
    """Check that triangulations are drawn without cracks or overlaps, and every sample exactly."""
    seed = secrets.randbits(32) if seed is None else seed
    found, number = Findings(), 0
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task(f"seed {seed}", total=triangles)
        while found.triangles < triangles:
            found.add(*check_batch(seed, number, batch))
            number += 1
            progress.update(task, completed=min(found.triangles, triangles))
    print_findings(found, seed, Console())
    if found.faults:
        sys.exit(1)


if __name__ == "__main__":
    main()
