"""The rows of starting up and of memory."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from benchmarks.against_peers import Options
from benchmarks.contestants import contestant
from benchmarks.memory import measure_memory
from benchmarks.pairing import WorkerError
from benchmarks.rows import FAILED, MISSED, Row
from benchmarks.startup import measure_commands, measure_parts
from benchmarks.targets import (
    FIRST_EVER_SECONDS,
    FIRST_FRAME_SECONDS,
    FRAME_BYTES,
    GROWTH_BYTES,
    LIMIT_BYTES,
    Target,
)

STARTUP_ROUNDS = 5
FRAMES_FIRST, FRAMES_LAST, FRAMES_MAX = 200, 2200, 10_000
"""Frames after which memory is compared; the last is the option's."""

FIVE_MILLION, TEN_MILLION = "mesh_5m", "triangles:10000000"
MEGA = 1e6

WHAT = "teapot, 640x480"


def own_row(scene: str) -> Row:
    """Return an empty row of RasterJIT."""
    return Row(scene, contestant("rasterjit").NAME)


def time_row(title: str, seconds: Sequence[float], target: Target | None = None) -> Row:
    """Return the row of some durations, and of what they may be."""
    row = own_row(title)
    row.rounds = [1e3 * each for each in seconds]
    row.ms = statistics.median(row.rounds)
    if target is not None:
        row.aim_below(row.ms / 1e3, target, " s")
    return row


def measure_startup(options: Options) -> list[Row]:
    """Time the command line and the parts of a first frame in fresh processes."""
    rounds = min(options.effort.rounds, STARTUP_ROUNDS)
    first, cached = measure_commands(rounds)
    rows = []
    for title, times, target in (
        (f"{WHAT}, file to PNG: first run ever", [first], FIRST_EVER_SECONDS),
        (f"{WHAT}, file to PNG: fresh process", cached, FIRST_FRAME_SECONDS),
    ):
        row = time_row(title, [seconds for seconds, _ in times], target)
        row.cpu_ms = 1e3 * statistics.median(seconds for _, seconds in times)
        rows.append(row)
    empty, warm = measure_parts(rounds)
    return rows + [
        time_row(f"{WHAT}: imports", [each["import"] for each in warm]),
        time_row(f"{WHAT}: compiling kernels, empty cache", [empty["kernels"]]),
        time_row(f"{WHAT}: loading kernels from the cache", [each["kernels"] for each in warm]),
        time_row(f"{WHAT}: first frame, kernels loaded", [each["first"] for each in warm]),
        time_row(f"{WHAT}: steady frame", [each["steady"] for each in warm]),
    ]


def megabytes(count: int) -> str:
    """Return bytes as text."""
    return f"{count / MEGA:.1f} MB"


def measure_costs_of_memory(options: Options, frames: int = FRAMES_LAST) -> list[Row]:
    """Measure the peak of large frames, and whether many small ones leave something behind."""
    return [large_frame(), limited_frame(), many_frames(frames)]


def large_frame() -> Row:
    """Return the row of the peak of a frame of five million triangles."""
    row = own_row("peak memory above the mesh, 5 M triangles, 1920x1080")
    try:
        found = measure_memory("frame", FIVE_MILLION)
    except WorkerError as error:
        row.check, row.met = f"{FAILED}: {error}", MISSED
        return row
    row.rate = megabytes(found["above_mesh"])
    row.aim_below(found["above_mesh"], FRAME_BYTES, " MB", MEGA)
    row.check = f"mesh {megabytes(found['mesh'])}, {found['drawn']} triangles drawn"
    return row


def limited_frame() -> Row:
    """Return the row of ten million triangles in a limited address space."""
    row = own_row(f"10 M triangles, address space of {LIMIT_BYTES >> 30} GiB (RLIMIT_AS)")
    row.target, row.met = "renders", MISSED
    try:
        found = measure_memory("limited", TEN_MILLION, str(LIMIT_BYTES))
    except WorkerError as error:
        row.check = f"{FAILED}: {error}"
        return row
    row.met = "yes"
    row.rate = f"peak {megabytes(found['peak'])}"
    row.check = f"address space {megabytes(found['address_space'])}, {found['drawn']} drawn"
    return row


def many_frames(last: int) -> Row:
    """Return the row of the memory that a renderer gains by drawing."""
    row = own_row(f"memory gained from frame {FRAMES_FIRST} to {last}, 5 k faces, 128x128")
    try:
        found = measure_memory("frames", str(FRAMES_FIRST), str(last))
    except WorkerError as error:
        row.check, row.met = f"{FAILED}: {error}", MISSED
        return row
    grown = found["last"] - found["first"]
    row.rate = megabytes(grown)
    row.aim_below(grown, GROWTH_BYTES, " MB", MEGA)
    row.check = f"{megabytes(found['last'])} in use"
    return row
