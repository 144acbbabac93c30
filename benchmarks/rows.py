"""The rows of the table, and how a run becomes one."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.contestants import contestant
from benchmarks.pairing import Run, paired_ratio
from benchmarks.pictures import Needed, agreement, differs, nearness, text_of
from benchmarks.targets import Target

MISSED, MET, GOAL = "NO", "yes", "goal"
"""Whether a target was reached, and whether its goal was as well."""

MISSING, UNABLE, LEFT_OUT = "missing", "cannot draw", "left out of a quick run"
"""How a check begins that says why a contestant has no times."""
DIFFERS, FAILED = "the picture differs", "failed"
"""How a check begins that ends the whole run with status 1."""

SCALES = ((1e9, "G "), (1e6, "M "), (1e3, "k "), (1.0, ""))


@dataclass
class Row:
    """One line of the table; what does not apply is ``None`` or empty."""

    scene: str
    contestant: str
    threads: int | None = None
    draw_ms: float | None = None
    """Median of clearing and drawing, milliseconds."""
    ms: float | None = None
    """The same with the picture read into a NumPy array."""
    cpu_ms: float | None = None
    """Processor time of all threads, which other programs on the machine disturb less."""
    rate: str = ""
    ratio: float | None = None
    """How many times as long as RasterJIT takes, with the same number of threads."""
    gain: float | None = None
    """How many times faster several threads are than one."""
    target: str = ""
    goal: str = ""
    met: str = ""
    check: str = ""
    """How the picture compares with the reference, or why there is none."""
    rounds: list[float] | None = None
    """Milliseconds of every round, reading back included."""

    def aim_above(self, value: float | None, target: Target, unit: str = "x") -> None:
        """Note a target that a value has to reach, and whether it does."""
        self.target = f">= {target.least:.3g}{unit}"
        self.goal = "" if target.goal is None else f"{target.goal:.3g}{unit}"
        if value is not None:
            self.met = verdict(value >= target.least, target.goal, value >= (target.goal or 0.0))

    def aim_below(self, value: float | None, target: Target, unit: str, scale: float = 1.0) -> None:
        """Note a target that a value may not exceed, both shown in units of ``scale``."""
        self.target = f"<= {target.least / scale:.3g}{unit}"
        self.goal = "" if target.goal is None else f"{target.goal / scale:.3g}{unit}"
        if value is not None:
            below_goal = value <= (target.goal or 0.0)
            self.met = verdict(value <= target.least, target.goal, below_goal)


def verdict(least_met: bool, goal: float | None, goal_met: bool) -> str:
    """Return what the table says about a target."""
    if not least_met:
        return MISSED
    return GOAL if goal is not None and goal_met else MET


def rate(work: int, unit: str, milliseconds: float) -> str:
    """Return how many units a second, in words."""
    each = 1e3 * work / milliseconds
    scale, prefix = next((s for s in SCALES if each >= s[0]), SCALES[-1])
    return f"{each / scale:.3g} {prefix}{unit}s/s"


def check_picture(run: Run, reference: Run | None, least: Needed) -> str:
    """
    Compare a picture with the reference's; a time whose picture differs is thrown away.

    Returns what to print about the run.
    """
    if run.missing is not None:
        return run.missing
    if reference is None or reference.missing is not None:
        return "no reference here"
    if run is reference:
        return "reference"
    shares = agreement(run.picture, reference.picture)
    if least.near and shares["covered"] > 0.0:
        shares["near"] = nearness(run.picture["covered"], reference.picture["covered"])
    note = text_of(shares)
    if differs(shares, least):
        run.missing = note = f"{DIFFERS}: {note}"
    return note


def row_of(scene: str, run: Run, note: str, own: Run | None = None) -> Row:
    """Return the row of a run, with its ratio to RasterJIT's own run if that has times."""
    row = Row(scene, contestant(run.entry.contestant).NAME, run.entry.threads, check=note)
    if run.missing is not None:
        return row
    row.rounds = [1e3 * seconds for seconds in run.seconds]
    row.draw_ms = 1e3 * statistics.median(run.draw_seconds)
    row.ms = 1e3 * run.median
    row.cpu_ms = 1e3 * statistics.median(run.processor_seconds)
    if own is not None and own is not run and own.missing is None:
        row.ratio = paired_ratio(run, own)
    return row


def find_run(runs: Sequence[Run], key: str, threads: int) -> Run | None:
    """Return a contestant's run with a number of threads, if there is one."""
    for run in runs:
        if run.entry.contestant == key and run.entry.threads == threads:
            return run
    return None


def is_wrong(row: Row) -> bool:
    """Return whether a row must end the whole run with status 1."""
    failed = row.check.startswith(FAILED) and row.contestant == contestant("rasterjit").NAME
    return failed or row.check.startswith(DIFFERS)


def folded(rows: Sequence[Row]) -> list[Row]:
    """
    Return the rows for reading: those of one scene without times or targets become one.

    Behind them comes each missing contestant, once, with the reason.
    """
    found: list[Row] = []
    absent: dict[str, Row] = {}
    for scene, group in itertools.groupby(rows, lambda row: row.scene):
        others: dict[str, list[str]] = {}
        for row in group:
            begin, _, reason = row.check.partition(": ")
            if begin == MISSING:
                absent.setdefault(row.contestant, Row("missing", row.contestant, check=reason))
            if begin not in (MISSING, UNABLE, LEFT_OUT) or row.target:
                found.append(row)
            elif row.contestant not in others.setdefault(begin, []):
                others[begin].append(row.contestant)
        if others:
            texts = [f"{begin}: {', '.join(names)}" for begin, names in others.items()]
            found.append(Row(scene, "others", check="; ".join(texts)))
    return found + list(absent.values())
