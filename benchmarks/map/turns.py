"""
Time all contestants in each cell, in turns, by processes that stay from cell to cell.

In a round each draws the same views, cameras that change from picture to picture, and reads each
picture back. Who begins changes from round to round. One that takes little time draws a view more
before its clock starts, for what slept or was pushed out of the caches is slow.
"""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
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
    package_environment,
    reported,
)
from benchmarks.pictures import EXACT, agreement, differs, needed, text_of
from benchmarks.rows import DIFFERS

LEAST_ROUNDS, MOST_ROUNDS = 3, 15
TURN_SECONDS = 0.02
"""What the slowest draws in a turn at least, unless its first picture takes longer."""
WARM_SECONDS = 0.05
"""Who needs longer for a picture is not warmed up."""
BATCH_VIEWS, BATCH_ROUNDS = 128, 5
"""Of ``render_batch``: views drawn together, and in how many rounds at most."""
COMPARED_VIEW = 1
SMALL_MS = 1.0
"""A cell whose faster peer takes less is judged by overhead, and by many views together."""
NEARLY = 1.3
"""How far from that a first picture may be, for views to be drawn together as well."""


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
    """A seat with its process."""

    def __init__(self, seat: Seat, folder: Path, number: int) -> None:
        self.seat, self._path = seat, folder / f"{number}.npz"
        environment = package_environment(
            {
                **contestant(seat.contestant).environment(seat.threads),
                **sets.environment(seat.instructions or sets.NATIVE),
            }
        )
        names = (seat.contestant, str(seat.threads), str(self._path))
        self._worker = Worker(
            ("-m", "benchmarks.map.worker", *names), environment, folder / f"{number}.log"
        )

    def tell(self, task: str, asked: Any) -> None:
        """Give the process something to do."""
        self._worker.tell(json.dumps({task: asked}))

    def answer(self, seconds: float = DRAW_SECONDS) -> dict[str, Any]:
        """Wait for what came out."""
        return self._worker.answer(seconds)

    def ask(self, task: str, asked: Any) -> dict[str, Any]:
        """Do both."""
        self.tell(task, asked)
        return self.answer()

    def picture(self, view: int) -> dict[str, Any]:
        """Return what a view shows."""
        self.ask("picture", view)
        with np.load(self._path) as saved:
            return dict(saved)

    def close(self) -> None:
        """End the process."""
        self._worker.close()


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


def measure(cell: Cell, present: Sequence[Participant], seconds: float) -> Measured:
    """Time a cell for about so many seconds, three rounds at least, and compare the pictures."""
    runs = [Run(who.seat.contestant, who.seat.threads, who.seat.instructions) for who in present]
    pairs = list(zip(runs, present, strict=True))
    for _, who in pairs:
        who.tell("prepare", [*cell[:3], list(cell.size)])
    for run, who in pairs:
        with reported(run):
            run.missing = who.answer(PREPARE_SECONDS).get("unable")
    firsts: dict[int, float] = {}
    for number, (run, who) in enumerate(pairs):
        with reported(run):
            if run.missing is None:
                firsts[number] = who.ask("draw", [0, 1, False])["seconds"][0]
    if firsts:
        take_turns(pairs, firsts, seconds)
    check_pictures(cell, pairs)
    return Measured(cell, runs)


def plan(firsts: dict[int, float], seconds: float) -> tuple[int, int]:
    """Return the rounds, and the views of a turn, given the seconds of each one's first picture."""
    count = max(1, min(VIEWS, int(TURN_SECONDS / max(firsts.values()))))
    each = sum((count + (first < WARM_SECONDS)) * first for first in firsts.values())
    return max(LEAST_ROUNDS, min(MOST_ROUNDS, int(seconds / each))), count


def take_turns(
    pairs: Sequence[tuple[Run, Participant]], firsts: dict[int, float], seconds: float
) -> None:
    """Draw round after round; note the milliseconds of a picture in the runs."""
    rounds, count = plan(firsts, seconds)
    peers = [first for n, first in firsts.items() if pairs[n][0].contestant != OWN]
    is_small = bool(peers) and 1e3 * min(peers) < NEARLY * SMALL_MS
    order, views = list(firsts), 0
    for turn in range(rounds):
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
                if is_small and run.contestant == OWN and turn < BATCH_ROUNDS:
                    together = who.ask("batch", BATCH_VIEWS)
                    if together:
                        run.batch_ms.append(1e3 * together["seconds"] / BATCH_VIEWS)
        views += count
    for run, _ in pairs:
        run.stages = {name: value / views for name, value in run.stages.items()}


def shown_by(run: Run, who: Participant) -> dict[str, Any] | None:
    """Return the view that is compared, or ``None`` of a run without times."""
    shown = None
    if run.missing is None:
        with reported(run):
            shown = who.picture(COMPARED_VIEW)
    return shown


def check_pictures(cell: Cell, pairs: Sequence[tuple[Run, Participant]]) -> None:
    """
    Compare one view of all with RasterJIT's first; a run whose picture differs loses its times.

    RasterJIT's own must be the same bits with any threads and instructions. If OpenGL's differs,
    RasterJIT's times go as well, for nobody knows who is right.
    """
    pictures = [shown_by(run, who) for run, who in pairs]
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
