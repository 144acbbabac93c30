"""
Time fresh processes: the very first run, runs that find compiled kernels, and steady frames.

``python -m benchmarks.startup`` renders the teapot again and again with one ``Renderer`` and prints
JSON, seconds: what the imports take, the first frame, the part of it that went into compiling
kernels or loading them from disk, and the median of the frames after it.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.pairing import ROOT, cache_environment, package_environment
from benchmarks.scenes import TEAPOT

SIZE = (640, 480)
STEADY_FRAMES = 50


def time_command(cache: Path, picture: Path) -> tuple[float, float]:
    """
    Time ``rasterjit render`` from starting Python to its end, the picture written.

    Returns the seconds by the wall clock, and those of the processor.
    """
    environment = package_environment(cache_environment(cache))
    times = time_program(render_arguments(picture), environment, ROOT)
    if not picture.exists():
        raise RuntimeError("rasterjit render wrote no picture")
    return times


def render_arguments(picture: Path, checkout: Path = ROOT, style: str = "plain") -> tuple[str, ...]:
    """Return the arguments with which a checkout's command line draws the teapot."""
    size = "x".join(map(str, SIZE))
    return "render", str(TEAPOT), "-o", str(picture), "--size", size, *in_style(checkout, style)


def in_style(checkout: Path, style: str) -> tuple[str, ...]:
    """Return the option of a style; none for versions that have one look alone, the plain one."""
    return ("--style", style) if (checkout / "rasterjit" / "styles").is_dir() else ()


def time_program(
    arguments: Sequence[str], environment: dict[str, str], checkout: Path
) -> tuple[float, float]:
    """Time a checkout's command line: seconds by the wall clock, and of the processor."""
    started, processor = time.perf_counter(), children_seconds()
    subprocess.run(
        [sys.executable, "-m", "rasterjit", *arguments],
        check=True,
        capture_output=True,
        cwd=checkout,
        env=environment,
    )
    return time.perf_counter() - started, children_seconds() - processor


def children_seconds() -> float:
    """Return the processor seconds of all processes that were started and have ended."""
    times = os.times()
    return times.children_user + times.children_system


def measure_commands(rounds: int) -> tuple[tuple[float, float], list[tuple[float, float]]]:
    """Return the times of the run that finds an empty cache, and of those after it."""
    with tempfile.TemporaryDirectory() as folder:
        cache, picture = Path(folder) / "cache", Path(folder) / "teapot.png"
        first = time_command(cache, picture)
        return first, [time_command(cache, picture) for _ in range(rounds)]


def measure_parts(rounds: int) -> tuple[dict[str, float], list[dict[str, float]]]:
    """Return what ``main`` prints with an empty cache, and in the processes after it."""
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for _ in range(rounds + 1):
            result = subprocess.run(
                [sys.executable, "-m", "benchmarks.startup"],
                check=True,
                capture_output=True,
                text=True,
                cwd=ROOT,
                env=package_environment(cache_environment(Path(folder))),
            )
            found.append(json.loads(result.stdout))
        return found[0], found[1:]


def main() -> None:
    """Render and print the figures."""
    started = time.perf_counter()
    import rasterjit as rj

    imported = time.perf_counter()
    scene = rj.load(TEAPOT)
    loaded = time.perf_counter()
    with rj.Renderer(SIZE) as renderer:
        frame = renderer.render(scene)
        first = time.perf_counter() - loaded
        steady = []
        for _ in range(STEADY_FRAMES):
            began = time.perf_counter()
            renderer.render(scene)
            steady.append(time.perf_counter() - began)
    print(
        json.dumps(
            {
                "import": imported - started,
                "kernels": frame.stats.seconds["compile"],
                "first": first,
                "steady": statistics.median(steady),
            }
        )
    )


if __name__ == "__main__":
    main()
