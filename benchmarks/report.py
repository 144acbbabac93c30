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
from rich.markup import escape
from rich.table import Table

import rasterjit
from benchmarks.contestants import opengl
from benchmarks.rows import Row, folded

RESULTS = Path(__file__).parent / "results"
COLUMNS = (
    "scene", "contestant", "threads", "draw ms", "ms", "CPU ms", "rounds", "rate", "x RasterJIT",
    "target",
    "goal", "met", "check",
)  # fmt: skip
RIGHT = frozenset(
    (
        "threads", "draw ms", "ms", "CPU ms", "rounds", "rate", "x RasterJIT",
        "off ms", "on ms", "on / off", "ns a pixel",
    )
)  # fmt: skip
PACKAGES = (
    "numpy", "numba", "llvmlite", "moderngl", "panda3d", "wgpu", "scikit-image",
    "opencv-python-headless", "pillow", "datashader", "embreex", "trimesh", "open3d", "pyvista",
    "matplotlib",
)  # fmt: skip
CPU_INFO, MEMORY_INFO = Path("/proc/cpuinfo"), Path("/proc/meminfo")
NOT_TERMINAL_WIDTH = 220
"""Columns of the table where the output is not a terminal."""


def machine() -> dict[str, str]:
    """Return what the figures depend on."""
    facts = {
        "rasterjit": rasterjit.__version__,
        "processor": info(CPU_INFO, "model name") or platform.processor() or "unknown",
        "processors": str(processors()),
        "memory": info(MEMORY_INFO, "MemTotal") or "unknown",
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


def info(path: Path, name: str) -> str | None:
    """Return the first value of a name in a file of ``name: value`` lines."""
    if path.exists():
        for line in path.read_text().splitlines():
            if line.startswith(name):
                return line.split(":", 1)[1].strip()
    return None


def cells(row: Row) -> list[str]:
    """Return a row as text."""
    return [
        row.scene,
        row.contestant,
        "" if row.threads is None else str(row.threads),
        number(row.draw_ms),
        number(row.ms),
        number(row.cpu_ms),
        "" if row.rounds is None else str(len(row.rounds)),
        row.rate,
        "" if row.ratio is None else f"{row.ratio:.3g}",
        row.target,
        row.goal,
        row.met,
        row.check,
    ]


def number(value: float | None) -> str:
    """Return milliseconds as text."""
    if value is None:
        return ""
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}"


def console() -> Console:
    """Return where tables are printed, wide enough if it is no terminal."""
    found = Console()
    return found if found.is_terminal else Console(width=NOT_TERMINAL_WIDTH)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows of text, those with the same first cell together."""
    table = Table(title=title)
    for name in columns:
        table.add_column(name, justify="right" if name in RIGHT else "left", overflow="fold")
    for n, row in enumerate(rows):
        ends = n + 1 == len(rows) or rows[n + 1][0] != row[0]
        table.add_row(*map(escape, row), end_section=ends)
    console().print(table)


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table."""
    lines = ["| " + " | ".join(columns) + " |"]
    lines += ["|" + "|".join("---:" if name in RIGHT else "---" for name in columns) + "|"]
    return lines + [
        "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows
    ]


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all: a reader sees the old one or the new one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_text(text)
    part.replace(path)


def write(
    rows: Sequence[Row],
    rounds: int,
    folder: Path | None = None,
) -> None:
    """Write ``table.json`` and ``table.md``."""
    facts = machine()
    content = {
        "machine": facts,
        "rounds": rounds,
        "rows": [asdict(row) for row in rows],
    }
    write_text((folder or RESULTS) / "table.json", json.dumps(content, indent=2) + "\n")
    lines = ["# RasterJIT beside other ways to draw the same pictures", ""]
    lines += [f"- {name}: {value}" for name, value in facts.items()]
    lines += [f"- medians of up to {rounds} interleaved rounds", ""]
    lines += markdown_table(COLUMNS, [cells(row) for row in folded(rows)])
    write_text((folder or RESULTS) / "table.md", "\n".join(lines) + "\n")
