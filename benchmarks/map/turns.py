"""
Time all contestants in each cell, in turns, by processes that stay from cell to cell.

In a round each draws the same views, cameras that change from picture to picture, and reads each
picture back. Who begins changes from round to round. One that takes little time draws a view more
before its clock starts, for what slept or was pushed out of the caches is slow. There are as many
rounds as there is time for.

A process that ends, or is ended because it gave no answer, loses the cell that it was in and is
started anew for the next.
"""

from __future__ import annotations

import contextlib
import json
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import instructions as sets
from benchmarks.against_peers import unavailable
from benchmarks.contestants import contestant
from benchmarks.map.cells import LLVMPIPE, OWN, TINYDISPLAY, Cell, Measured, Run
from benchmarks.map.families import VIEWS, make_scene
from benchmarks.pairing import (
    DRAW_SECONDS,
    PREPARE_SECONDS,
    Worker,
    WorkerError,
    package_environment,
    reported,
)
from benchmarks.pictures import EXACT, agreement, differs, needed, text_of
from benchmarks.rows import DIFFERS

MIN_ROUNDS, FEWEST_ROUNDS, MAX_ROUNDS = 3, 1, 15
"""Three in any case, unless the time of the cell is up, one then."""
TURN_SECONDS = 0.02
"""What the slowest draws in a turn at least, unless its first picture takes longer."""
WARM_SECONDS = 0.05
"""Who needs longer for a picture is not warmed up."""
SLOW_SECONDS = 0.2
"""Who took longer for a picture, as all prepared theirs, is not asked alone how long it takes."""
BATCH_VIEWS, MIN_BATCH_VIEWS, BATCH_PIXELS = 128, 8, 1 << 23
"""Of ``render_batch``: most and fewest views drawn together in a round, and about how many pixels
in between, 32 MiB of colours."""
COMPARED_VIEW = 1
SMALL_MS = 1.0
"""A cell whose faster peer takes less is judged by overhead, and by many views together."""
NEARLY = 1.3
"""How far from that a first picture may be, for views to be drawn together as well."""
MAX_STARTS = 12
"""How often a process that ends is started, before it is left out of all that follows."""


@dataclass(frozen=True)
class Seat:
    """Who takes part: a contestant with so many threads, held to a set of instructions."""

    contestant: str
    threads: int
    instructions: str


def seats(threads: Sequence[int], instructions: Sequence[str]) -> list[Seat]:
    """Return who takes part; tinydisplay once, for it is the same in all of them."""
    found = [
        Seat(key, count, name)
        for name in instructions
        for count in threads
        for key in (OWN, LLVMPIPE)
    ]
    return [*found, Seat(TINYDISPLAY, 1, "")]


class Participant:
    """A seat with its process, which is started when it is first told something, and again."""

    def __init__(self, seat: Seat, folder: Path, number: int) -> None:
        self.seat = seat
        self._path, self._log = folder / f"{number}.npz", folder / f"{number}.log"
        self._starts = 0
        self._worker: Worker | None = None

    def _start(self) -> Worker:
        """Start the process; raise `WorkerError` if it has ended too often."""
        if self._starts == MAX_STARTS:
            raise WorkerError(f"ended {MAX_STARTS} times")
        self._starts += 1
        environment = package_environment(
            {
                **contestant(self.seat.contestant).environment(self.seat.threads),
                **sets.environment(self.seat.instructions or sets.NATIVE),
            }
        )
        names = (self.seat.contestant, str(self.seat.threads), str(self._path))
        return Worker(("-m", "benchmarks.map.worker", *names), environment, self._log)

    def tell(self, task: str, asked: Any) -> None:
        """Give the process something to do; a new one, if it has ended, to prepare a scene."""
        if self._worker is None or (task == "prepare" and not self._worker.is_alive):
            self.close()
            self._worker = self._start()
        self._worker.tell(json.dumps({task: asked}))

    def answer(self, seconds: float = DRAW_SECONDS) -> dict[str, Any]:
        """Wait for what came out."""
        if self._worker is None:
            raise WorkerError("was told nothing")
        return self._worker.answer(seconds)

    def ask(self, task: str, asked: Any) -> dict[str, Any]:
        """Do both."""
        self.tell(task, asked)
        return self.answer()

    def picture(self) -> dict[str, Any]:
        """Wait until a view is saved, as it was told, and return what it shows."""
        self.answer()
        with np.load(self._path) as saved:
            return dict(saved)

    def close(self) -> None:
        """End the process."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None


@contextlib.contextmanager
def participants(wanted: Sequence[Seat], say: Callable[[str], None]) -> Iterator[list[Participant]]:
    """Start the processes of those that can draw here; say of the others why they are missing."""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        found = []
        for number, seat in enumerate(wanted):
            reason = unavailable(seat.contestant)
            if reason is None:
                found.append(Participant(seat, Path(folder), number))
                stack.callback(found[-1].close)
            elif seat.contestant not in {other.contestant for other in wanted[:number]}:
                say(f"{contestant(seat.contestant).NAME}: {reason}")
        yield found


def measure(
    cell: Cell, present: Sequence[Participant], seconds: float, end: float = math.inf
) -> Measured:
    """
    Time a cell and compare the pictures.

    Rounds are drawn for about so many seconds, three at least; but none begins, except for the
    first, after ``time.monotonic()`` has reached the end.
    """
    runs = [Run(who.seat.contestant, who.seat.threads, who.seat.instructions) for who in present]
    pairs = list(zip(runs, present, strict=True))
    for run, who in pairs:
        with reported(run):
            who.tell("prepare", [*cell[:3], list(cell.size)])
    firsts: dict[int, float] = {}
    for number, (run, who) in enumerate(pairs):
        with reported(run):
            if run.missing is None:
                answer = who.answer(PREPARE_SECONDS)
                run.missing = answer.get("unable")
                firsts[number] = answer.get("seconds", 0.0)
    for number, (run, who) in enumerate(pairs):
        with reported(run):
            if run.missing is None and firsts[number] < SLOW_SECONDS:
                firsts[number] = who.ask("draw", [0, 1, False])["seconds"][0]
    firsts = {number: first for number, first in firsts.items() if pairs[number][0].missing is None}
    if firsts:
        take_turns(cell, pairs, firsts, seconds, end)
    check_pictures(cell, pairs)
    return Measured(cell, runs)


def measure_safely(
    cell: Cell, present: Sequence[Participant], seconds: float, end: float = math.inf
) -> Measured:
    """Do the same; whatever goes wrong here is noted in all runs, and all start anew after it."""
    try:
        return measure(cell, present, seconds, end)
    except Exception as error:
        for who in present:
            who.close()
        reason = f"failed: {type(error).__name__}: {error}"
        return Measured(cell, [Run(*astuple(who.seat), missing=reason) for who in present])


def batch_views(size: tuple[int, int]) -> int:
    """Return how many views of a size, pixels, ``render_batch`` draws together in a round."""
    return max(MIN_BATCH_VIEWS, min(BATCH_VIEWS, BATCH_PIXELS // (size[0] * size[1])))


def take_turns(
    cell: Cell,
    pairs: Sequence[tuple[Run, Participant]],
    firsts: dict[int, float],
    seconds: float,
    end: float,
) -> None:
    """Draw round after round, as long as told; note the milliseconds of a picture in the runs."""
    count = max(1, min(VIEWS, int(TURN_SECONDS / max(firsts.values()))))
    peers = [first for n, first in firsts.items() if pairs[n][0].contestant != OWN]
    is_small = bool(peers) and 1e3 * min(peers) < NEARLY * SMALL_MS
    order, turn, took = list(firsts), 0, 0.0
    usual_end, views = min(time.monotonic() + seconds, end), batch_views(cell.size)
    while needs_round(turn, took, usual_end, end):
        began = time.monotonic()
        for number in order[turn % len(order) :] + order[: turn % len(order)]:
            run, who = pairs[number]
            if run.missing is not None:
                continue
            with reported(run):
                done = who.ask("draw", [turn * count % VIEWS, count, firsts[number] < WARM_SECONDS])
                run.ms.append(1e3 * sum(done["seconds"]) / count)
                run.cpu_ms.append(1e3 * done["processor"] / count)
                for name, value in done["stages"].items():
                    run.stages[name] = run.stages.get(name, 0.0) + 1e3 * value
                if is_small and run.contestant == OWN:
                    together = who.ask("batch", views)
                    if together:
                        run.batch_ms.append(1e3 * together["seconds"] / views)
        turn, took = turn + 1, time.monotonic() - began
    for run, _ in pairs:
        run.stages = {name: value / (turn * count) for name, value in run.stages.items()}


def needs_round(turn: int, took: float, usual_end: float, end: float) -> bool:
    """Tell whether one more round is drawn, after so many, the last of which took some seconds."""
    if turn < MIN_ROUNDS:
        return turn < FEWEST_ROUNDS or time.monotonic() < end
    return turn < MAX_ROUNDS and time.monotonic() + took <= usual_end


def shown_by(pairs: Sequence[tuple[Run, Participant]]) -> list[dict[str, Any] | None]:
    """Return the view that is compared of all, at the same time; ``None`` of runs without times."""
    for run, who in pairs:
        with reported(run):
            if run.missing is None:
                who.tell("picture", COMPARED_VIEW)
    pictures: list[dict[str, Any] | None] = []
    for run, who in pairs:
        pictures.append(None)
        with reported(run):
            if run.missing is None:
                pictures[-1] = who.picture()
    return pictures


def check_pictures(cell: Cell, pairs: Sequence[tuple[Run, Participant]]) -> None:
    """
    Compare one view of all with RasterJIT's first; a run whose picture differs loses its times.

    RasterJIT's own must be the same bits with any threads and instructions. If OpenGL's differs,
    RasterJIT's times go as well, for nobody knows who is right.
    """
    pictures = shown_by(pairs)
    own = [shown for (run, _), shown in zip(pairs, pictures, strict=True) if run.contestant == OWN]
    reference = next((shown for shown in own if shown is not None), None)
    if reference is None:
        return
    scene = make_scene(*cell)
    for (run, _), shown in zip(pairs, pictures, strict=True):
        if shown is None:
            continue
        is_own = run.contestant == OWN
        least = EXACT if is_own else needed(scene, contestant(run.contestant))
        shares = agreement(shown, reference)
        run.check = text_of(shares)
        if differs(shares, least):
            run.missing = f"{DIFFERS}: {run.check}"
    llvmpipe = [run.missing or "" for run, _ in pairs if run.contestant == LLVMPIPE]
    if any(reason.startswith(DIFFERS) for reason in llvmpipe):
        for run, _ in pairs:
            if run.contestant == OWN and run.missing is None:
                run.missing = f"{DIFFERS} from {contestant(LLVMPIPE).NAME}'s"
