"""Count what became of mutated files, format by format, for the terminal and for a page."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.fuzz_files.all_samples import format_of

COLUMNS = ("tried", "own error", "of these, stopped", "read", "crash", "hung", "a foreign",
           "lost without a word", "other")  # fmt: skip
"""Of the table; those behind "read" are how faults begin."""

HEADINGS = ("tried", "own error", "stopped", "read", "crash", "hang", "foreign error",
            "lost in silence", "other fault")  # fmt: skip
"""What a page calls them."""

STOPPED = re.compile(r"its reader (?:crashed|takes more)|needs more memory than max_bytes")
"""What is said of files whose readers were stopped where they could do no harm."""

BEGIN, END = "<!-- files: python -m benchmarks.fuzz_files -->", "<!-- /files -->"

LISTED = 40


def counts_of(results: list[dict[str, Any]], by_format: bool) -> dict[str, Counter[str]]:
    """Return the counts of each sample, or of each format, and last those of all."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for one in results:
        count = counts[format_of(one["sample"]) if by_format else one["sample"]]
        is_own = one["outcome"] == "refused" and not one["faults"]
        count.update({"tried": 1, "own error": int(is_own)})
        count.update({"read": int(one["outcome"] in ("loaded", "warned"))})
        count.update({"of these, stopped": int(is_own and bool(STOPPED.search(one["said"])))})
        for fault in one["faults"]:
            count.update([next((name for name in COLUMNS if fault.startswith(name)), "other")])
    counts["all"] = sum(counts.values(), Counter())
    return counts


def report(results: list[dict[str, Any]], seed: int, console: Console) -> bool:
    """Print what became of all cases; tell whether nothing is wrong."""
    table = Table(title=f"{len(results):,} mutated files, seed {seed}")
    table.add_column("sample")
    for name in COLUMNS:
        table.add_column(name, justify="right")
    for sample, count in counts_of(results, False).items():
        table.add_row(sample, *(str(count[name]) for name in COLUMNS))
    console.print(table)
    faulty = [one for one in results if one["faults"]]
    kinds = Counter(fault.split(":")[0].split(",")[0] for one in faulty for fault in one["faults"])
    slowest = max(results, key=lambda one: one["seconds"])
    largest = max(results, key=lambda one: one["peak"])
    for kind in ("crash", "hung", "a foreign exception", "lost without a word"):
        console.print(f"{kind}: {kinds.pop(kind, 0)}")
    for kind, count in kinds.items():
        console.print(f"{kind}: {count}")
    console.print(f"slowest: {slowest['seconds']:.2f} s of the processor, case {slowest['number']}")
    console.print(f"largest: {largest['peak']:,} bytes, case {largest['number']}")
    for one in faulty[:LISTED]:
        console.print(f"case {one['number']}, {one['sample']}, {one['how']}: {one['faults'][0]}")
    return not faulty


def write_page(results: list[dict[str, Any]], page: Path) -> None:
    """Put a table of all formats between the marks of a page."""
    lines = [f"| format | {' | '.join(HEADINGS)} |", f"|---|{'---:|' * len(HEADINGS)}"]
    counts = counts_of(results, True)
    total = counts.pop("all")
    for name, count in [*sorted(counts.items()), ("**all**", total)]:
        lines.append(f"| {name} | {' | '.join(f'{count[one]:,}' for one in COLUMNS)} |")
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    table = "\n".join(lines)
    page.write_text(f"{before}{BEGIN}\n\n{table}\n\n{END}{after}", encoding="utf-8")
