"""Time several contestants on one scene, in turns, each in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import instructions as sets
from benchmarks.contestants import contestant

ROOT = Path(__file__).parent.parent

CACHES = ("NUMBA_CACHE_DIR", "RASTERJIT_CACHE_DIR")
"""Environment variables that name the folders in which compiled code is kept."""

PREPARE_SECONDS, DRAW_SECONDS = 120.0, 60.0
"""A worker that is not ready, or gives no picture, by then is ended."""

CLOSE_SECONDS = 10.0
"""What a worker may take to end after its standard input did."""

MIN_ROUNDS = 1
"""Rounds that the slowest contestant takes part in."""


@dataclass(frozen=True)
class Entry:
    """One contestant on one scene with a number of threads."""

    contestant: str
    scene: str
    threads: int = 1
    instructions: str = sets.NATIVE
    """Of `benchmarks.instructions`: what its process is held to."""


@dataclass(frozen=True)
class Effort:
    """How often to measure."""

    rounds: int
    seconds: float
    """Of an entry in all its rounds; one that is slower takes part in fewer."""

    def rounds_of(self, picture_seconds: float, patience: float = 1.0) -> int:
        """Return the rounds of an entry that takes so long for a picture."""
        affordable = int(patience * self.seconds / (2.0 * max(picture_seconds, 1e-9)))
        return max(min(self.rounds, affordable), min(self.rounds, MIN_ROUNDS))


@dataclass
class Run:
    """What was measured of an entry, or why nothing was."""

    entry: Entry
    missing: str | None = None
    """Why it has no times: ``missing: ...``, ``failed: ...``, or how its picture differs."""
    patience: float = 1.0
    """Share of the effort's seconds that it gets."""
    seconds: list[float] = field(default_factory=list)
    """Drawing and reading back, wall clock, one for each round from the first on."""
    draw_seconds: list[float] = field(default_factory=list)
    processor_seconds: list[float] = field(default_factory=list)
    picture: dict[str, NDArray[Any]] = field(default_factory=dict, repr=False)

    @property
    def median(self) -> float:
        """Seconds of the median round."""
        return statistics.median(self.seconds)


class WorkerError(RuntimeError):
    """A worker that gave no answer, with the reason."""


class Worker:
    """
    A running worker process, which answers every line with one line of JSON.

    Parameters
    ----------
    arguments : sequence of str
        What follows ``python``.
    environment : dict
        The whole environment of the process.
    errors : Path
        File that takes its standard error.
    """

    def __init__(self, arguments: Sequence[str], environment: dict[str, str], errors: Path) -> None:
        self._errors = errors
        with errors.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                cwd=ROOT,
                env=environment,
            )

    def tell(self, command: str) -> None:
        """Send a line."""
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.write(command + "\n")
                self._process.stdin.flush()

    def ask(self, command: str) -> dict[str, Any]:
        """Send a line and return the answer; raise `WorkerError` if there is none."""
        self.tell(command)
        return self.answer(DRAW_SECONDS)

    def answer(self, seconds: float) -> dict[str, Any]:
        """Wait for a line; end the process and raise `WorkerError` if none comes in time."""
        if self._process.stdout is None:
            raise WorkerError("the worker has no pipe")
        late = threading.Event()

        def end() -> None:
            late.set()
            self._process.kill()

        timer = threading.Timer(seconds, end)
        timer.start()
        try:
            line = self._process.stdout.readline()
        finally:
            timer.cancel()
        if line:
            return json.loads(line)
        if late.is_set():
            self._process.wait()
            raise WorkerError(f"took longer than {seconds:g} s")
        raise WorkerError(f"ended with status {self._process.wait()}: {self._last_error()}")

    def _last_error(self) -> str:
        """Return the last line that the process wrote to standard error."""
        lines = self._errors.read_text(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "no message")

    @property
    def is_alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(OSError, ValueError, subprocess.TimeoutExpired):
            self._process.communicate(timeout=CLOSE_SECONDS)
        if self._process.poll() is None:
            self._process.kill()
        with contextlib.suppress(OSError), self._process:
            return


def package_environment(changes: dict[str, str], checkout: Path = ROOT) -> dict[str, str]:
    """Return this process's environment with a checkout's packages first, and changes."""
    paths = [str(checkout), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **changes}


def cache_environment(folder: Path) -> dict[str, str]:
    """Return what makes programs keep compiled code in a folder, Numba's and the package's own."""
    return dict.fromkeys(CACHES, str(folder))


class Drawer(Worker):
    """
    A worker that holds one contestant and one scene: `benchmarks.worker`.

    Parameters
    ----------
    entry : Entry
    folder : Path
        Takes its picture and its standard error.
    number : int
        Of the worker, in the names of those files.
    """

    def __init__(self, entry: Entry, folder: Path, number: int) -> None:
        self._path = folder / f"{number}.npz"
        names = (entry.contestant, entry.scene, str(entry.threads), str(self._path))
        own = contestant(entry.contestant).environment(entry.threads)
        environment = package_environment({**own, **sets.environment(entry.instructions)})
        super().__init__(("-m", "benchmarks.worker", *names), environment, folder / f"{number}.log")

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return the last picture that it drew."""
        self.ask("picture")
        with np.load(self._path) as saved:
            return dict(saved)


def start(entry: Entry, folder: Path, number: int) -> tuple[Drawer, float]:
    """Start a worker; return it and the seconds it takes for a picture."""
    worker = Drawer(entry, folder, number)
    try:
        return worker, worker.answer(PREPARE_SECONDS)["seconds"]
    except BaseException:
        worker.close()
        raise


def measure(runs: Sequence[Run], effort: Effort) -> list[Run]:
    """
    Time the runs that are not missing, in turns: all of them once, then all of them again.

    What disturbs the machine so falls on all of them. Compiling and warming up come before. The
    picture of a run is the last that was timed. A worker that fails or is late leaves a run with
    the reason and without times.
    """
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        present = []
        for number, run in enumerate(runs):
            if run.missing is not None:
                continue
            with reported(run):
                worker, seconds = start(run.entry, Path(folder), number)
                stack.callback(worker.close)
                present.append((run, worker, effort.rounds_of(seconds, run.patience)))
        for turn in range(effort.rounds):
            for run, worker, rounds in present:
                if run.missing is None and turn < rounds:
                    with reported(run):
                        answer = worker.ask("draw")
                        run.seconds.append(answer["total"])
                        run.draw_seconds.append(answer["draw"])
                        run.processor_seconds.append(answer["processor"])
        for run, worker, _ in present:
            if run.missing is None:
                with reported(run):
                    run.picture = worker.picture()
    return list(runs)


@contextlib.contextmanager
def reported(run: Any) -> Iterator[None]:
    """Note in the ``missing`` of a run, this module's or the map's, why its worker failed."""
    try:
        yield
    except WorkerError as error:
        run.missing = f"failed: {error}"


def paired_ratios(slow: Sequence[float], fast: Sequence[float]) -> list[float]:
    """Return how many times longer one takes, round by round, for the rounds that both have."""
    return [a / b for a, b in zip(slow, fast, strict=False)]


def paired_ratio(slow: Run, fast: Run) -> float:
    """Return how many times longer one takes: the median of the ratios round by round."""
    return statistics.median(paired_ratios(slow.seconds, fast.seconds))
