"""Print the rows as one table, and write them as JSON and Markdown."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rich.console import Console
from rich.table import Table

import rasterjit
from benchmarks.contestants import opengl
from benchmarks.first_mark import Row

RESULTS = Path(__file__).parent / "results"
COLUMNS = (
    "what",
    "who",
    "threads",
    "ms",
    "CPU ms",
    "rate",
    "x RasterJIT",
    "target",
    "met",
    "check",
)
RIGHT = frozenset(("threads", "ms", "CPU ms", "rate", "x RasterJIT"))
PACKAGES = ("numpy", "numba", "llvmlite", "moderngl")
CPU_INFO = Path("/proc/cpuinfo")


def machine() -> dict[str, str]:
    """Return what the figures depend on."""
    facts = {
        "rasterjit": rasterjit.__version__,
        "processor": processor_name(),
        "processors": str(processors()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "OpenGL": opengl.version() or "missing",
    }
    for name in PACKAGES:
        try:
            facts[name] = version(name)
        except PackageNotFoundError:
            facts[name] = "not installed"
    return facts


def processors() -> int:
    """Return how many processors this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def processor_name() -> str:
    """Return the processor's name."""
    if CPU_INFO.exists():
        for line in CPU_INFO.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "unknown"


def cells(row: Row) -> list[str]:
    """Return a row as text."""
    return [
        row.what,
        row.who,
        "" if row.threads is None else str(row.threads),
        number(row.milliseconds),
        number(row.processor_milliseconds),
        row.rate,
        "" if row.ratio is None else f"{row.ratio:.4g}",
        row.target,
        "" if row.met is None else ("yes" if row.met else "NO"),
        row.check,
    ]


def number(value: float | None) -> str:
    """Return milliseconds as text."""
    return "" if value is None else f"{value:.1f}"


def print_table(rows: Sequence[Row], console: Console) -> None:
    """Print the rows."""
    table = Table(title="First mark")
    for name in COLUMNS:
        side = "right" if name in RIGHT else "left"
        table.add_column(name, justify=side, overflow="fold")
    for n, row in enumerate(rows):
        ends = n + 1 == len(rows) or rows[n + 1].what != row.what
        table.add_row(*cells(row), end_section=ends)
    console.print(table)


def write(rows: Sequence[Row], rounds: int) -> None:
    """Write ``first_mark.json`` and ``first_mark.md``."""
    RESULTS.mkdir(exist_ok=True)
    facts = machine()
    content = {"machine": facts, "rounds": rounds, "rows": [asdict(row) for row in rows]}
    (RESULTS / "first_mark.json").write_text(json.dumps(content, indent=2) + "\n")
    lines = ["# First mark", ""]
    lines += [f"- {name}: {value}" for name, value in facts.items()]
    lines += [f"- medians of {rounds} interleaved rounds", ""]
    lines += ["| " + " | ".join(COLUMNS) + " |"]
    lines += ["|" + "|".join("---:" if name in RIGHT else "---" for name in COLUMNS) + "|"]
    lines += ["| " + " | ".join(cells(row)) + " |" for row in rows]
    (RESULTS / "first_mark.md").write_text("\n".join(lines) + "\n")
