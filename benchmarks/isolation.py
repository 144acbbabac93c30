"""
Measure what reading files in a process of its own costs.

``python -m benchmarks.isolation`` reads a LAZ, a VTU, a DAE and a 3MF file (which RasterJIT reads
itself) with and without it, by turns, and starts the process a few times.
"""

from __future__ import annotations

import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

import rasterjit as rj
from rasterjit.io.foreign import door

TURNS = 5


def surface(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and triangles of a bent square."""
    rows, columns = np.indices((side, side)).reshape(2, -1)
    heights = np.random.default_rng(1).random(side * side)
    first = (side * np.arange(side - 1)[:, None] + np.arange(side - 1)).reshape(-1, 1)
    faces = first + np.array([0, 1, side + 1, 0, side + 1, side])
    return np.stack([columns, rows, heights], axis=1).astype(np.float64), faces.reshape(-1, 3)


def laz(path: Path, size: int) -> None:
    """Write points."""
    import laspy

    file = laspy.create(point_format=3, file_version="1.2")
    file.x, file.y, file.z = np.random.default_rng(1).random((3, size // 12)) * 100.0
    file.write(path)


def vtu(path: Path, size: int) -> None:
    """Write triangles."""
    import meshio

    points, faces = surface(int((size / 30) ** 0.5))
    meshio.Mesh(points, [("triangle", faces)]).write(path)


def exported(path: Path, size: int) -> None:
    """Write triangles as trimesh does."""
    import trimesh

    per_vertex = 20 if path.suffix == ".3mf" else 110
    points, faces = surface(int((size / per_vertex) ** 0.5))
    trimesh.Trimesh(points, faces, process=False).export(path)


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "laz": laz, "vtu": vtu, "dae": exported, "3mf": exported,
}  # fmt: skip


def seconds_of(path: Path, isolate: bool) -> float:
    """Return how long loading a file takes."""
    start = time.perf_counter()
    rj.load(path, isolate=isolate)
    return time.perf_counter() - start


def processor() -> float:
    """Return the processor time of processes that have ended, seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@click.command()
@click.option("--megabytes", type=click.FloatRange(0.01), default=10.0, show_default=True)
def main(megabytes: float) -> None:
    """Print ratios of times with the process to times without it, and what starting it takes."""
    starts = []
    for _ in range(TURNS):
        before, start = processor(), time.perf_counter()
        reader = door._Reader()
        took = time.perf_counter() - start
        reader.end()
        starts.append((took, processor() - before))
    told = " and ".join(f"{statistics.median(one):.3f} s {what}" for one, what in
                        zip(zip(*starts, strict=True), ("by the clock", "of the processor"),
                            strict=True))  # fmt: skip
    print(f"starting the process: {told}")
    with tempfile.TemporaryDirectory() as folder:
        for kind, write in WRITERS.items():
            path = Path(folder, f"a.{kind}")
            write(path, int(megabytes * 1e6))
            first = [seconds_of(path, isolate) for isolate in (True, False)]
            turns = [[seconds_of(path, isolate) for isolate in (True, False)]
                     for _ in range(TURNS)]  # fmt: skip
            with_it, without = map(statistics.median, zip(*turns, strict=True))
            print(
                f"{kind}, {path.stat().st_size / 1e6:.1f} MB: {with_it:.3f} s with, "
                f"{without:.3f} s without, ratio {with_it / without:.2f}; "
                f"first file {first[0]:.3f} s"
            )


if __name__ == "__main__":
    main()
