"""
Measure clouds of points: RasterJIT beside llvmpipe, datashader and Open3D, in one run.

``python -m benchmarks.points [--points N] [--threads N] [--rounds N] [--peers PYTHON]
[--output FILE]``

Each draws in a process of its own, as ``point_worker`` says, by turns; a row has the median of the
rounds, and the median of the rounds' ratios to RasterJIT. What is not installed is told and left
out; ``--peers`` is the Python of another environment that has datashader or Open3D. The pixels that
points cover must be about as many for all. Ten million points take about a minute.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

WORKER = Path(__file__).with_name("point_worker.py")
OWN = "RasterJIT"
NAMES = OWN, "llvmpipe", "datashader", "Open3D"

ALIKE = 0.02
"""Share of RasterJIT's covered pixels by which others' may differ: ties at edges of pixels."""


class Contestant(NamedTuple):
    """A process that draws when it is told to."""

    name: str
    process: subprocess.Popen[str]
    times: list[float]
    pixels: list[int]

    def draw(self) -> None:
        """Draw a picture, and note what it took."""
        self.process.stdin.write("draw\n")
        self.process.stdin.flush()
        told = json.loads(self.process.stdout.readline())
        self.times.append(told["seconds"])
        self.pixels.append(told["pixels"])


def start(name: str, count: int, threads: int, pythons: list[str]) -> Contestant | None:
    """Start a contestant with the first Python that has it; say why there is none."""
    reason = ""
    for python in pythons:
        process = subprocess.Popen(
            [python, str(WORKER), name, str(count), str(threads)], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        lines = iter(process.stdout.readline, "")
        # Libraries print lines of their own.
        told = next((json.loads(line) for line in lines if line.startswith("{")), None)
        if told is not None and not told["missing"]:
            return Contestant(name, process, [], [])
        reason = "it ended" if told is None else told["missing"]
        end(process)
    print(f"{name:<10}  left out ({reason})")
    return None


def end(process: subprocess.Popen[str]) -> None:
    """End a process, and let its pipes go."""
    process.kill()
    process.communicate()


def measure(contestants: list[Contestant], rounds: int) -> list[dict[str, Any]]:
    """Let all draw by turns; return a row each."""
    for _ in range(rounds):
        for one in contestants:
            one.draw()
    own, rows = contestants[0], []
    for one in contestants:
        ratios = [a / b for a, b in zip(one.times, own.times, strict=True)]
        is_alike = abs(one.pixels[-1] / own.pixels[-1] - 1.0) <= ALIKE
        rows.append({
            "name": one.name, "ms": 1e3 * statistics.median(one.times),
            "ratio": statistics.median(ratios), "pixels": one.pixels[-1],
            "check": "alike" if is_alike else "OTHER PIXELS",
        })  # fmt: skip
    return rows


def main() -> None:
    """Measure, print the table, write it where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", 1)[0])
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--peers", action="append", default=[])
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    pythons = [sys.executable, *options.peers]
    started = [start(name, options.points, options.threads, pythons) for name in NAMES]
    contestants = [one for one in started if one is not None]
    try:
        rows = measure(contestants, options.rounds)
    finally:
        for one in contestants:
            end(one.process)
    print(f"{'':<10}  {'ms':>8}  {'x RasterJIT':>11}  {'pixels':>9}  check")
    for row in rows:
        print(
            f"{row['name']:<10}  {row['ms']:8.1f}  {row['ratio']:11.2f}  {row['pixels']:9,}  "
            f"{row['check']}"
        )
    if options.output is not None:
        told = {"points": options.points, "threads": options.threads, "rows": rows}
        options.output.write_text(json.dumps(told, indent=1) + "\n")
    if any(row["check"] != "alike" for row in rows):
        sys.exit(1)


if __name__ == "__main__":
    main()
