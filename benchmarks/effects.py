"""
``python -m benchmarks.effects``: what effects cost, where they are absent and where they are drawn.

The first table is about scenes without effects. It draws them by this engine and by a build in
which the effects' code is physically absent: the commit ``effects_absent.BASELINE``, the last one
before the first effect, checked out of the git history into a temporary folder and driven by
today's benchmark code. Both take turns in one run; the baseline runs against itself as well, which
shows what is noise. Then a fresh process of each draws the scene with an empty cache, which tells
how many kernels it compiles and how long that takes, and another one with the filled cache, which
tells the memory. Where there is no git history (a source distribution has none) the table says so
and is left out.

The second table draws every effect on and off, by RasterJIT and, where a twin was written, by
Mesa's llvmpipe, reading back included, in turns in one run. ``x RasterJIT`` compares the scenes
with the effect. A picture that is not RasterJIT's loses its time.
"""

from __future__ import annotations

import json
import statistics
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import click
from rich.console import Console

from benchmarks import report
from benchmarks.against_peers import unavailable
from benchmarks.compare import COLUMNS as ABSENT_COLUMNS
from benchmarks.compare import cells as absent_cells
from benchmarks.contestants import contestant
from benchmarks.effects_absent import BASELINE, LIMIT, HistoryAbsentError, measure_absent
from benchmarks.effects_scenes import EFFECTS, SMALL, TWIN, Effect, find_variant
from benchmarks.judging import Comparison
from benchmarks.pairing import Effort, Entry, Run, measure, paired_ratio
from benchmarks.pictures import EXACT, USUAL, Needed
from benchmarks.rows import UNABLE, Row, check_picture

OWN = "rasterjit_effects"
FULL, QUICK, SMOKE = Effort(7, 6.0), Effort(3, 2.0), Effort(1, 1.0)
"""Rounds, and seconds for each contestant of a variant."""

SMALL_ALIKE = 0.9
"""Most that small pictures must share: their pixels are large beside texels and borders."""

COLUMNS = (
    "effect", "contestant", "threads", "off ms", "on ms", "on / off", "ns a pixel", "rounds",
    "x RasterJIT", "target", "met", "check",
)  # fmt: skip

progress = Console(stderr=True)


@dataclass
class EffectRow(Row):
    """One contestant with an effect; ``ms`` is with it."""

    off_ms: float | None = None
    """Median without the effect."""
    factor: float | None = None
    """How many times as long it takes with the effect: median of the rounds' ratios."""
    nanoseconds: float | None = None
    """What the effect adds, for each covered pixel."""


def runs_of(effect: Effect, threads: int, is_small: bool) -> list[tuple[Run, Run]]:
    """Return the runs without and with the effect, of RasterJIT and then of each twin."""
    ending = SMALL if is_small else ""
    pairs = []
    for key in (OWN, *effect.twins):
        runs = []
        for variant in (effect.off, effect.on):
            name = variant + ending
            run = Run(Entry(key, f"effect:{name}", threads), unavailable(key))
            reason = contestant(key).draws(find_variant(name)) if run.missing is None else None
            if reason is not None:
                run.missing = f"{UNABLE}: {reason}"
            runs.append(run)
        pairs.append((runs[0], runs[1]))
    return pairs


def row_of(effect: Effect, off: Run, on: Run, own: Run, note: str) -> EffectRow:
    """Return the row of a contestant."""
    row = EffectRow(effect.title, contestant(on.entry.contestant).NAME, on.entry.threads)
    row.check = note
    if on.missing is not None:
        return row
    row.rounds = [1e3 * seconds for seconds in on.seconds]
    row.ms = 1e3 * on.median
    row.cpu_ms = 1e3 * statistics.median(on.processor_seconds)
    if off.missing is None:
        row.off_ms = 1e3 * off.median
        row.factor = paired_ratio(on, off)
        added = statistics.median(b - a for a, b in zip(off.seconds, on.seconds, strict=False))
        pixels = int(on.picture["covered"].sum())
        row.nanoseconds = 1e9 * added / pixels if pixels else None
    if on is not own and own.missing is None:
        row.ratio = paired_ratio(on, own)
    return row


def measure_effect(
    effect: Effect, threads: Sequence[int], effort: Effort, is_small: bool
) -> list[EffectRow]:
    """Time an effect, off and on, with each number of threads."""
    rows, first = [], None
    for count in threads:
        pairs = runs_of(effect, count, is_small)
        progress.print(f"measuring {effect.title}, {count} thread(s) ...", markup=False)
        measure([run for pair in pairs for run in pair], effort)
        own = pairs[0][1]
        first = first or own
        for off, on in pairs:
            least = min(effect.alike, SMALL_ALIKE) if is_small else effect.alike
            needed = EXACT if on is own else Needed(USUAL.covered, least)
            note = check_picture(on, first if on is own else own, needed)
            row = row_of(effect, off, on, own, note)
            if effect.target is not None and on.entry.contestant == TWIN:
                row.aim_above(row.ratio, effect.target)
            rows.append(row)
    return rows


def cells(row: EffectRow) -> list[str]:
    """Return a row as text."""
    return [
        row.scene,
        row.contestant,
        str(row.threads),
        report.number(row.off_ms),
        report.number(row.ms),
        "" if row.factor is None else f"{row.factor:.2f}",
        "" if row.nanoseconds is None else f"{row.nanoseconds:.1f}",
        "" if row.rounds is None else str(len(row.rounds)),
        "" if row.ratio is None else f"{row.ratio:.3g}",
        row.target,
        row.met,
        row.check,
    ]


def show_absent(threads: Sequence[int], is_quick: bool) -> list[Comparison] | str:
    """Print and return the table of scenes without effects, or the reason why there is none."""
    progress.print(f"comparing with {BASELINE}, which has no effects ...")
    try:
        rows = measure_absent(threads, is_quick)
    except HistoryAbsentError as error:
        progress.print(f"left out: {error}", markup=False)
        return str(error)
    title = f"Scenes without effects; A: {BASELINE}, which has none, B: this; limit {LIMIT:g}"
    report.print_table(title, ABSENT_COLUMNS, [absent_cells(row) for row in rows])
    return rows


def write(absent: list[Comparison] | str | None, rows: Sequence[EffectRow]) -> None:
    """Write ``effects.json`` and ``effects.md``."""
    compared = absent if isinstance(absent, list) else []
    content = {
        "machine": report.machine(),
        "baseline": BASELINE,
        "absent": [asdict(row) for row in compared] or absent,
        "effects": [asdict(row) for row in rows],
    }
    report.write_text(report.RESULTS / "effects.json", json.dumps(content, indent=2) + "\n")
    lines = ["# What effects cost", ""]
    lines += [f"- {name}: {value}" for name, value in report.machine().items()]
    if compared:
        lines += ["", f"Scenes without effects; A: {BASELINE}, which has none, B: this", ""]
        lines += report.markdown_table(ABSENT_COLUMNS, [absent_cells(row) for row in compared])
    lines += ["", *report.markdown_table(COLUMNS, [cells(row) for row in rows])]
    report.write_text(report.RESULTS / "effects.md", "\n".join(lines) + "\n")


@click.command()
@click.option("--quick", is_flag=True, help="Fewer rounds, and one scene without effects.")
@click.option(
    "--only", multiple=True, type=click.Choice([effect.on for effect in EFFECTS]),
    metavar="EFFECT", help="One effect; may be repeated.",
)  # fmt: skip
@click.option(
    "--threads", multiple=True, type=click.IntRange(1, 1024), default=(1, 2), show_default=True
)
@click.option("--no-baseline", is_flag=True, help="Leave out the scenes without effects.")
@click.option("--no-effects", is_flag=True, help="Leave out the effects.")
@click.option("--smoke", is_flag=True, help="Small pictures, one round: whether it runs at all.")
def main(
    quick: bool, only: tuple[str, ...], threads: tuple[int, ...], no_baseline: bool,
    no_effects: bool, smoke: bool,
) -> None:  # fmt: skip
    """Measure what effects cost where there are none, and where they are drawn."""
    effort = SMOKE if smoke else QUICK if quick else FULL
    counts = sorted(set(threads))
    absent = None if no_baseline else show_absent(counts, quick or smoke)
    chosen = [effect for effect in EFFECTS if not only or effect.on in only]
    rows: list[EffectRow] = []
    for effect in () if no_effects else chosen:
        rows += measure_effect(effect, counts, effort, smoke)
    if rows:
        report.print_table("Effects, off and on", COLUMNS, [cells(row) for row in rows])
    write(absent, rows)
    own = contestant(OWN).NAME
    wrong = [row for row in rows if row.contestant == own and row.ms is None]
    for row in wrong:
        progress.print(f"{row.scene}: {row.check}", markup=False)
    if wrong:
        sys.exit(1)


if __name__ == "__main__":
    main()
