"""Time the command line in fresh processes: the very first run, and runs with cached kernels."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.pairing import ROOT, package_environment
from benchmarks.scenes import TEAPOT

SIZE = "640x480"


def time_command(cache: Path, picture: Path) -> tuple[float, float]:
    """
    Time a run from starting Python to its end, the picture written.

    Returns the seconds by the wall clock, and those of the processor.
    """
    arguments = ("render", str(TEAPOT), "-o", str(picture), "--size", SIZE)
    started, processor = time.perf_counter(), children_seconds()
    subprocess.run(
        [sys.executable, "-m", "rasterjit", *arguments],
        check=True,
        capture_output=True,
        cwd=ROOT,
        env=package_environment({"NUMBA_CACHE_DIR": str(cache)}),
    )
    seconds = time.perf_counter() - started
    if not picture.exists():
        raise RuntimeError("rasterjit render wrote no picture")
    return seconds, children_seconds() - processor


def children_seconds() -> float:
    """Return the processor seconds of all processes that were started and have ended."""
    times = os.times()
    return times.children_user + times.children_system


def measure_startup(rounds: int) -> tuple[tuple[float, float], list[tuple[float, float]]]:
    """Return the times of the run that finds an empty cache, and of those after it."""
    with tempfile.TemporaryDirectory() as folder:
        cache, picture = Path(folder) / "cache", Path(folder) / "teapot.png"
        first = time_command(cache, picture)
        return first, [time_command(cache, picture) for _ in range(rounds)]
