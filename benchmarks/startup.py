"""Time the command line in fresh processes: the very first run, and runs with cached kernels."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.pairing import ROOT, package_environment
from benchmarks.scenes import TEAPOT

SIZE = "640x480"


def time_command(cache: Path, picture: Path) -> float:
    """Return the seconds from starting Python to its end, the picture written."""
    arguments = ("render", str(TEAPOT), "-o", str(picture), "--size", SIZE)
    started = time.perf_counter()
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
    return seconds


def measure_startup(rounds: int) -> tuple[float, list[float]]:
    """Return the seconds of the run that finds an empty cache, and of those after it."""
    with tempfile.TemporaryDirectory() as folder:
        cache, picture = Path(folder) / "cache", Path(folder) / "teapot.png"
        first = time_command(cache, picture)
        return first, [time_command(cache, picture) for _ in range(rounds)]
