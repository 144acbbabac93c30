"""What commands print besides their results: progress, and the table at the end of a render."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from rasterjit.inspect.measure import Measurement
    from rasterjit.outputs.diagnostics import Diagnostics
    from rasterjit.outputs.frame import Frame

Item = TypeVar("Item")

STAGE_NAMES = {"compile": "compile, or load compiled"}
"""What the table calls a stage whose own name is not plain enough."""


PATIENCE = 2.0
"""Seconds of compiling that are not spoken of."""

LOOKS = 0.1
"""Seconds between two looks at the clock."""


@contextmanager
def compile_notice(quiet: bool, shown: Any = None) -> Iterator[None]:
    """
    Say that kernels are compiled, if that takes long.

    Parameters
    ----------
    quiet : bool
        Say nothing.
    shown : rich.status.Status or None
        The line on a terminal that says how far it is. Without one, say it once on standard error.
    """
    if quiet:
        yield
        return
    done = threading.Event()
    watch = threading.Thread(target=_watch_compiler, args=(done, shown), daemon=True)
    watch.start()
    try:
        yield
    finally:
        done.set()
        watch.join()


def _watch_compiler(done: threading.Event, shown: Any = None) -> None:
    """Tell of the compiler once it has run for some time, unless all is done before."""
    # What the command imports is imported by the command: not by two threads at once.
    while "rasterjit.runtime.store" not in sys.modules:
        if done.wait(LOOKS):
            return
    from rasterjit.runtime import jit, store

    start = jit.COMPILER_CLOCK.read()
    while jit.COMPILER_CLOCK.read() - start < PATIENCE:
        if done.wait(LOOKS):
            return
    kept = "kept on disk" if store.folder() else "not kept: no folder can be written"
    if shown is None:
        click.echo(f"compiling kernels, which takes seconds ({kept})", err=True)
        return
    text = shown.status
    while not done.wait(LOOKS):
        shown.update(f"{text}: compiling kernels ({kept}): {store.progress()}")
    shown.update(text)


@contextmanager
def status(text: str, quiet: bool) -> Iterator[Any]:
    """Show that something is going on, if somebody is looking; yield the line, or None."""
    if quiet or not sys.stderr.isatty():
        # Without the 50 ms that the import of rich takes.
        yield None
        return
    from rich.console import Console

    console = Console(stderr=True)
    with console.status(text) if console.is_terminal else nullcontext() as shown:
        yield shown


@contextmanager
def progress_bar(text: str, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Yield what shows how far something is, if somebody is looking: how many, of how many."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    hidden = quiet or not console.is_terminal
    with Progress(console=console, disable=hidden, transient=True) as progress:
        bar = progress.add_task(text)
        yield lambda done, total: progress.update(bar, completed=done, total=total)


def with_progress(items: Iterable[Item], count: int, text: str, quiet: bool) -> Iterator[Item]:
    """Yield the items, with a progress bar on standard error if somebody is looking."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    hidden = quiet or not console.is_terminal
    yield from track(items, text, total=count, console=console, disable=hidden, transient=True)


def print_stats(frame: Frame, seconds: dict[str, float], total: float) -> None:
    """
    Print what became of the triangles and where the time went.

    Parameters
    ----------
    frame : Frame
    seconds : dict of float
        By stage, in order.
    total : float
        Seconds from the start to the end.
    """
    from rich.console import Console
    from rich.table import Table

    stats, (width, height) = frame.stats, frame.plan.size
    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_row("triangles in", f"{stats.triangles_in:,}")
    for label, count in (
        ("outside the view", stats.outside),
        ("turned away", stats.culled),
        ("without area", stats.degenerate),
        ("between pixel centres", stats.unsampled),
        ("invalid", stats.invalid),
        ("drawn", stats.drawn),
    ):
        table.add_row(f"  {label}", f"{count:,}")
    table.add_row("clipped", f"{stats.clipped:,}")
    if frame.plan.facts.finds_faces:
        share = stats.pixels_covered / (width * height)
        table.add_row("pixels covered", f"{stats.pixels_covered:,} ({share:.1%})")
    table.add_section()
    for stage, duration in seconds.items():
        table.add_row(STAGE_NAMES.get(stage, stage), f"{1000.0 * duration:,.1f} ms")
    table.add_section()
    table.add_row("total", f"{1000.0 * total:,.1f} ms")
    Console(highlight=False).print(table)


def print_measurement(measured: Measurement) -> None:
    """Print the time of each stage, and what each effect costs."""
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    table = Table(title=f"{measured.rounds} frames each, {measured.threads} threads; medians")
    table.add_column("stage")
    table.add_column("time", justify="right")
    for stage, seconds in measured.stages.items():
        table.add_row(STAGE_NAMES.get(stage, stage), f"{1000.0 * seconds:,.2f} ms")
    table.add_section()
    table.add_row("frame", f"{1000.0 * measured.total:,.2f} ms")
    console.print(table)
    if not measured.changes:
        return
    table = Table()
    for name in ("effect", "changed to", "frame", "difference"):
        table.add_column(name, justify="right" if name in ("frame", "difference") else "left")
    for change in measured.changes:
        table.add_row(
            change.name, change.what, f"{1000.0 * change.seconds:,.2f} ms",
            f"{1000.0 * change.difference:+,.2f} ms",
        )  # fmt: skip
    console.print(table)


def print_diagnostics(diagnostics: Diagnostics) -> None:
    """Print what became of every face, and how precise the numbers are."""
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for name, text in diagnostics.rows():
        table.add_row(name, text)
    Console(highlight=False).print(table)


def shows_anything(frame: Frame) -> bool:
    """Tell whether a face covers a pixel or, of edges alone, whether any may be in view."""
    stats = frame.stats
    if frame.plan.facts.finds_faces:
        return stats.pixels_covered > 0
    return stats.drawn + stats.unsampled + stats.degenerate > 0
