"""What a map says: ratios to the faster peer, the marks and whether they hold, the worst cells."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from benchmarks.map.cells import (
    LLVMPIPE,
    OWN,
    PEERS,
    SLIVERS,
    TINYDISPLAY,
    Cell,
    Measured,
    Run,
    faces_text,
    size_text,
)
from benchmarks.map.turns import SMALL_MS
from benchmarks.pairing import paired_ratios

HELD, SHORT, NOTHING = "held", "fell short", "not measured"

MIN_RATIO = 1.0
MEDIANS = {LLVMPIPE: 2.0, TINYDISPLAY: 1.4}
MIN_70K = {LLVMPIPE: 2.4, TINYDISPLAY: 1.3}
MIN_SMALL_PICTURE = {LLVMPIPE: 2.0, TINYDISPLAY: 1.4}
MIN_1M = {LLVMPIPE: 3.0, TINYDISPLAY: 1.6}
MIN_SLIVERS = {LLVMPIPE: 3.0, TINYDISPLAY: 2.0}
MIN_SCALING, SCALED_PIXELS, SCALED_FACES = 1.7, 512 * 512, 20_000
"""How many times faster two threads are than one, from so many pixels and faces on."""
MAX_OVERHEAD_MS = 0.15

NAMES = {LLVMPIPE: "llvmpipe", TINYDISPLAY: "tinydisplay"}
WORST = 5

OUTSIDE = ("plan", "compile")
"""Stages that are counted as overhead, with what no stage was charged for."""


@dataclass(frozen=True)
class Verdict:
    """How RasterJIT stands in a cell, with some threads under some instructions."""

    cell: Cell
    own: Run
    ratios: dict[str, float]
    """How many times as long each peer takes that draws it."""
    batch_ratios: dict[str, float]
    """The same for a view of many drawn together; empty where that was not measured."""
    faster_ms: float
    """Of the faster peer."""

    @property
    def ms(self) -> float:
        """Milliseconds of the median round."""
        return statistics.median(self.own.ms)

    @property
    def ratio(self) -> float:
        """How many times as long the faster peer takes."""
        return min(self.ratios.values())

    @property
    def is_small(self) -> bool:
        """Whether it is judged by overhead, and by many views drawn together."""
        return self.faster_ms < SMALL_MS

    @property
    def overhead_ms(self) -> float:
        """Milliseconds of a picture outside the stages that draw it."""
        inside = sum(ms for name, ms in self.own.stages.items() if name not in OUTSIDE)
        return max(statistics.fmean(self.own.ms) - inside, 0.0)


@dataclass(frozen=True)
class Mark:
    """Something to reach, and what was reached."""

    name: str
    needed: str
    found: str
    verdict: str
    where: str = ""


def judge(measured: Measured, threads: int, instructions: str) -> Verdict | None:
    """Return how RasterJIT stands in a cell; ``None`` if it or all peers have no times."""
    own = measured.find(OWN, threads, instructions)
    peers = {key: measured.find(key, threads, instructions) for key in PEERS}
    present = {key: run for key, run in peers.items() if run is not None}
    if own is None or not present:
        return None
    ratios = {key: ratio_of(run.ms, own.ms) for key, run in present.items()}
    batch = {key: ratio_of(run.ms, own.batch_ms) for key, run in present.items() if own.batch_ms}
    fastest = min(statistics.median(run.ms) for run in present.values())
    return Verdict(measured.cell, own, ratios, batch, fastest)


def ratio_of(slow: Sequence[float], fast: Sequence[float]) -> float:
    """Return the median of the rounds' ratios."""
    return statistics.median(paired_ratios(slow, fast))


def verdicts(measured: Iterable[Measured], threads: int, instructions: str) -> list[Verdict]:
    """Return how RasterJIT stands in each cell that has times."""
    found = (judge(each, threads, instructions) for each in measured)
    return [verdict for verdict in found if verdict is not None]


def on_map(found: Iterable[Verdict]) -> list[Verdict]:
    """Return those of the map that are judged by their ratio."""
    return [each for each in found if each.cell.family != SLIVERS.family and not each.is_small]


def worst(found: Iterable[Verdict], count: int = WORST) -> list[Verdict]:
    """Return the cells with the lowest ratios among those that are judged by it, lowest first."""
    return sorted(on_map(found), key=lambda each: each.ratio)[:count]


def least(name: str, needed: float, values: Sequence[tuple[float, Cell]], note: str = "") -> Mark:
    """Return a mark that the lowest of some values has to reach."""
    if not values:
        return Mark(name, f">= {needed:g}", "", NOTHING, note)
    lowest, where = min(values, key=lambda pair: pair[0])
    below = sum(value < needed for value, _ in values)
    place = f"{where}; below in {below} of {len(values)}" if below else str(where)
    return Mark(
        name, f">= {needed:g}", f"{lowest:.2f}", SHORT if below else HELD,
        f"{place}; {note}" if note else place,
    )  # fmt: skip


def against(
    found: Sequence[Verdict],
    title: str,
    needed: dict[str, float],
    counts: Callable[[Cell], bool],
) -> list[Mark]:
    """Return a mark for each peer over some cells; of small ones by views drawn together."""
    marks = []
    for key, value in needed.items():
        values, alone = [], False
        for each in found:
            if not counts(each.cell) or key not in each.ratios:
                continue
            is_together = each.is_small and key in each.batch_ratios
            alone |= each.is_small and not is_together
            ratios = each.batch_ratios if is_together else each.ratios
            values.append((ratios[key], each.cell))
        note = "small ones frame by frame: render_batch was not measured" if alone else ""
        marks.append(least(f"{title}, to {NAMES[key]}", value, values, note))
    return marks


def medians(found: Sequence[Verdict]) -> list[Mark]:
    """Return the marks of the median over the map, for each peer."""
    marks = []
    for key, needed in MEDIANS.items():
        ratios = [each.ratios[key] for each in on_map(found) if key in each.ratios]
        name = f"median, to {NAMES[key]}"
        if not ratios:
            marks.append(Mark(name, f">= {needed:g}", "", NOTHING))
            continue
        middle = statistics.median(ratios)
        marks.append(
            Mark(
                name, f">= {needed:g}", f"{middle:.2f}", HELD if middle >= needed else SHORT,
                f"{len(ratios)} cells",
            )
        )  # fmt: skip
    return marks


def small_cells(found: Sequence[Verdict]) -> list[Mark]:
    """Return the marks of cells that the faster peer draws in under a millisecond."""
    small = [each for each in found if each.is_small and each.cell.family != SLIVERS.family]
    together = [(min(each.batch_ratios.values()), each.cell) for each in small if each.batch_ratios]
    name = f"under {SMALL_MS:g} ms: overhead, ms"
    over = Mark(name, f"<= {MAX_OVERHEAD_MS:g}", "", NOTHING)
    if small:
        most = max(small, key=lambda each: each.overhead_ms)
        above = sum(each.overhead_ms > MAX_OVERHEAD_MS for each in small)
        note = f"; above in {above} of {len(small)}" if above else ""
        over = Mark(
            name, over.needed, f"{most.overhead_ms:.2f}", SHORT if above else HELD,
            f"{most.cell}{note}",
        )  # fmt: skip
    batch = least(f"under {SMALL_MS:g} ms: render_batch, to the faster", MIN_RATIO, together)
    return [batch, over]


def marks_of(measured: Sequence[Measured], instructions: str) -> list[Mark]:
    """Return the marks with one thread under a set of instructions."""
    found = verdicts(measured, 1, instructions)
    lowest = [(each.ratio, each.cell) for each in on_map(found)]
    return [
        least("every cell, to the faster", MIN_RATIO, lowest),
        *medians(found),
        *against(found, "70 k faces, 1280×720", MIN_70K,
                 lambda cell: (cell.faces, cell.size) == (70_000, (1280, 720))),
        *against(found, "5 k faces, 128²", MIN_SMALL_PICTURE,
                 lambda cell: (cell.faces, cell.size) == (5_000, (128, 128))),
        *against(found, "1 M faces", MIN_1M, lambda cell: cell.faces == 1_000_000),
        *against(found, "200 k slivers", MIN_SLIVERS, lambda cell: cell == SLIVERS),
        *small_cells(found),
    ]  # fmt: skip


def scaling(measured: Sequence[Measured], threads: int, instructions: str) -> Mark:
    """Return the mark of more threads against one."""
    values = []
    for each in measured:
        pixels = each.cell.size[0] * each.cell.size[1]
        one, more = (each.find(OWN, count, instructions) for count in (1, threads))
        if one and more and pixels >= SCALED_PIXELS and each.cell.faces >= SCALED_FACES:
            values.append((ratio_of(one.ms, more.ms), each.cell))
    name = f"{threads} threads, from {size_text((512, 512))} and {faces_text(SCALED_FACES)} faces"
    return least(name, MIN_SCALING, values)
