"""
Measure skinning: the kernel beside NumPy, and what compiling it costs.

``python -m benchmarks.skinning [--vertices N] [--influences N] [--rounds N] [--output FILE]``

Positions and normals of random vertices are moved by the blended matrices of random joints, by
turns: by the kernel that `rasterjit.Scene.posed` runs, on one thread and on all; by the equation
as one writes it down with ``numpy.einsum``; and by NumPy at its best, which gathers and adds up
one influence after the other and has no array of all matrices of all influences. A row has the
median of the rounds, and the median of the rounds' ratios to the kernel on one thread. All must
find the same vertices, but for roundings. Then a process with an empty cache of kernels compiles
the kernel after another one, whose time holds what Numba's own start takes.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import processors
from rasterjit.pipeline.geometry.skinning import skin_vertices

KERNEL = "kernel"
JOINTS = 64
ROUNDING = 1e-9
"""Greatest difference of positions, whose size is about 1; normals are float32."""
NORMAL_ROUNDING = 1e-6
PIECES = 4
"""Runs of vertices for each thread, so that one that is held up does not hold up all."""

COMPILING = """
import json, os, time
import numpy as np

def seconds():
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system

from rasterjit.pipeline.geometry import skinning
import rasterjit as rj

mesh = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
rj.rasterize(np.c_[mesh.vertices, np.ones(3)], mesh.faces, (8, 8))
start, clock = seconds(), time.perf_counter()
skinning.skin_vertices(
    (0, 1), np.eye(4)[None], np.zeros((1, 4), np.int32), np.ones((1, 4)) / 4.0, np.zeros((1, 3)),
    np.zeros((1, 3), np.float32), np.zeros((0, 4), np.float32),
)
print(json.dumps([seconds() - start, time.perf_counter() - clock]))
"""
"""A program that prints the processor and wall seconds of the kernel's first call."""


class Skinned(NamedTuple):
    """What is moved, and by what."""

    matrices: NDArray[np.float64]
    """(J, 4, 4)"""
    joints: NDArray[np.int32]
    """(V, K)"""
    weights: NDArray[np.float64]
    positions: NDArray[np.float64]
    normals: NDArray[np.float32]


Moved = tuple[NDArray[np.floating], NDArray[np.floating]]


def make(count: int, influences: int) -> Skinned:
    """Return random vertices, and joints that turn, stretch a little and move."""
    random = np.random.default_rng(1)
    matrices = np.tile(np.eye(4), (JOINTS, 1, 1))
    turns, _ = np.linalg.qr(random.normal(size=(JOINTS, 3, 3)))
    turns *= np.linalg.det(turns)[:, None, None]
    matrices[:, :3, :3] = turns * random.uniform(0.8, 1.2, (JOINTS, 1, 3))
    matrices[:, :3, 3] = random.normal(size=(JOINTS, 3))
    weights = random.uniform(0.1, 1.0, (count, influences))
    normals = random.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Skinned(
        matrices,
        random.integers(0, JOINTS, (count, influences)).astype(np.int32),
        weights / weights.sum(axis=1, keepdims=True),
        random.uniform(-1.0, 1.0, (count, 3)),
        normals.astype(np.float32),
    )


def by_kernel(data: Skinned, pool: ThreadPoolExecutor | None, threads: int) -> Moved:
    """Move vertices by the kernel, in one go or in pieces for threads."""
    positions, normals = data.positions.copy(), data.normals.copy()
    tangents = np.empty((0, 4), np.float32)

    def run(first: int, last: int) -> None:
        skin_vertices(
            (first, last), data.matrices, data.joints, data.weights, positions, normals, tangents
        )

    count = len(positions)
    if pool is None:
        run(0, count)
    else:
        edges = np.linspace(0, count, PIECES * threads + 1).astype(int).tolist()
        list(pool.map(run, edges[:-1], edges[1:]))
    return positions, normals


def by_einsum(data: Skinned) -> Moved:
    """Move vertices by the equation as it is written."""
    blended = np.einsum("vk,vkij->vij", data.weights, data.matrices[data.joints])
    homogeneous = np.column_stack([data.positions, np.ones(len(data.positions))])
    positions = np.einsum("vij,vj->vi", blended, homogeneous)[:, :3]
    axes = np.linalg.inv(blended[:, :3, :3])
    normals = np.einsum("vji,vj->vi", axes, data.normals)
    return positions, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def by_numpy(data: Skinned) -> Moved:
    """Move vertices by sums of gathered matrices, products of stacks, and cofactors."""
    rows = np.ascontiguousarray(data.matrices[:, :3]).reshape(len(data.matrices), 12)
    blended = np.zeros((len(data.positions), 12))
    for joint, weight in zip(data.joints.T, data.weights.T, strict=True):
        part = rows.take(joint, axis=0)
        part *= weight[:, None]
        blended += part
    matrices = blended.reshape(-1, 3, 4)
    positions = np.matmul(matrices[:, :, :3], data.positions[:, :, None])[:, :, 0]
    positions += matrices[:, :, 3]
    a, b, c = np.ascontiguousarray(matrices[:, :, :3].transpose(2, 1, 0))
    x, y, z = data.normals.T.astype(np.float64)
    normals = np.empty((3, len(x)))
    sides = np.zeros(len(x))
    for row, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        first = b[i] * c[j] - b[j] * c[i]
        sides += a[row] * first
        normals[row] = first * x
        normals[row] += (c[i] * a[j] - c[j] * a[i]) * y
        normals[row] += (a[i] * b[j] - a[j] * b[i]) * z
    normals *= np.copysign(1.0, sides) / np.sqrt((normals * normals).sum(axis=0))
    return positions, normals.T


def measure(data: Skinned, rounds: int) -> list[dict[str, Any]]:
    """Let all move the vertices by turns; return a row each."""
    threads = processors()
    with ThreadPoolExecutor(threads) as pool:
        ways: dict[str, Callable[[], Moved]] = {
            f"{KERNEL}, one thread": lambda: by_kernel(data, None, 1),
            f"{KERNEL}, {threads} threads": lambda: by_kernel(data, pool, threads),
            "NumPy, einsum": lambda: by_einsum(data),
            "NumPy, at its best": lambda: by_numpy(data),
        }
        found = {name: way() for name, way in ways.items()}
        times: dict[str, list[float]] = {name: [] for name in ways}
        for _ in range(rounds):
            for name, way in ways.items():
                start = time.perf_counter()
                way()
                times[name].append(time.perf_counter() - start)
    first = next(iter(ways))
    rows = []
    for name, seconds in times.items():
        ratios = [a / b for a, b in zip(seconds, times[first], strict=True)]
        apart = [float(np.abs(a - b).max()) for a, b in zip(found[name], found[first], strict=True)]
        is_same = apart[0] <= ROUNDING and apart[1] <= NORMAL_ROUNDING
        rows.append({
            "name": name, "ms": 1e3 * statistics.median(seconds),
            "ratio": statistics.median(ratios), "check": "same" if is_same else "OTHER VERTICES",
        })  # fmt: skip
    return rows


def compile_cost() -> tuple[float, float]:
    """Return the processor and wall seconds that the kernel's first call takes."""
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, "-c", COMPILING], env={**os.environ, "RASTERJIT_CACHE_DIR": cache},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
    processor, wall = json.loads(done.stdout.splitlines()[-1])
    return processor, wall


def main() -> None:
    """Measure, print the table, write it where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", 1)[0])
    parser.add_argument("--vertices", type=int, default=100_000)
    parser.add_argument("--influences", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    rows = measure(make(options.vertices, options.influences), options.rounds)
    print(f"{options.vertices:,} vertices, {options.influences} joints each, with normals")
    print(f"{'':<20}  {'ms':>8}  {'x kernel':>8}  check")
    for row in rows:
        print(f"{row['name']:<20}  {row['ms']:8.2f}  {row['ratio']:8.2f}  {row['check']}")
    processor, wall = compile_cost()
    print(f"compiling the kernel, once: {processor:.2f} CPU s, {wall:.2f} s")
    if options.output is not None:
        told = {
            "vertices": options.vertices, "influences": options.influences, "rows": rows,
            "compile_cpu_seconds": processor, "compile_seconds": wall,
        }  # fmt: skip
        options.output.write_text(json.dumps(told, indent=1) + "\n")
    if any(row["check"] != "same" for row in rows):
        sys.exit(1)


if __name__ == "__main__":
    main()
