"""Time several contestants on one scene, in turns, each in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import contestant

ROOT = Path(__file__).parent.parent


@dataclass(frozen=True)
class Entry:
    """One contestant on one scene with a number of threads."""

    contestant: str
    scene: str
    threads: int = 1


@dataclass
class Run:
    """What was measured of an entry, or why nothing was."""

    entry: Entry
    missing: str | None = None
    seconds: list[float] = field(default_factory=list)
    """Drawing and reading back, wall clock, one for each round."""
    draw_seconds: list[float] = field(default_factory=list)
    processor_seconds: list[float] = field(default_factory=list)
    picture: dict[str, NDArray[Any]] = field(default_factory=dict, repr=False)

    @property
    def median(self) -> float:
        """Seconds of the median round."""
        return statistics.median(self.seconds)


class Worker:
    """A running worker process."""

    def __init__(self, entry: Entry, picture: Path) -> None:
        arguments = (entry.contestant, entry.scene, str(entry.threads), str(picture))
        changes = contestant(entry.contestant).environment(entry.threads)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.worker", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=package_environment(changes),
        )
        self.ask(None)
        with np.load(picture) as saved:
            self.picture = dict(saved)

    def ask(self, command: str | None) -> dict[str, float]:
        """Send a line, if any, and return the answer."""
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("the worker has no pipes")
        if command is not None:
            self._process.stdin.write(command + "\n")
            self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"a worker ended with status {self._process.wait()}")
        return json.loads(answer)

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(OSError):
            self._process.communicate()


def package_environment(changes: dict[str, str]) -> dict[str, str]:
    """Return this process's environment with this checkout's packages first, and changes."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **changes}


def measure(entries: Sequence[Entry], rounds: int, *, awake: bool = False) -> list[Run]:
    """
    Return a run for each entry, timed in turns: all of them once, then all of them again.

    What disturbs the machine so falls on all of them. Compiling and warming up come before. If
    ``awake``, each turn draws twice and the second is timed: a second core that slept while the
    entry before had one thread is slow to start, and that is not the work of the entry behind.
    """
    runs = [Run(entry, contestant(entry.contestant).available()) for entry in entries]
    present = [run for run in runs if run.missing is None]
    with tempfile.TemporaryDirectory() as folder, open_workers(present, Path(folder)) as workers:
        for _ in range(rounds):
            for run, worker in zip(present, workers, strict=True):
                if awake:
                    worker.ask("draw")
                answer = worker.ask("draw")
                run.seconds.append(answer["total"])
                run.draw_seconds.append(answer["draw"])
                run.processor_seconds.append(answer["processor"])
    return runs


@contextlib.contextmanager
def open_workers(runs: Sequence[Run], folder: Path) -> Iterator[list[Worker]]:
    """Start the workers, one after the other, and end them in any case."""
    with contextlib.ExitStack() as stack:
        workers = []
        for number, run in enumerate(runs):
            worker = Worker(run.entry, folder / f"{number}.npz")
            stack.callback(worker.close)
            run.picture = worker.picture
            workers.append(worker)
        yield workers


def paired_ratio(slow: Run, fast: Run) -> float:
    """Return how many times longer one takes: the median of the ratios round by round."""
    return statistics.median(a / b for a, b in zip(slow.seconds, fast.seconds, strict=True))


def agreement(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> dict[str, float]:
    """Return the share of equal pixels for each array that both pictures have."""
    shares = {}
    for name in one.keys() & other.keys():
        equal = one[name] == other[name]
        shares[name] = float(equal.all(axis=-1).mean() if equal.ndim == 3 else equal.mean())
    return shares
