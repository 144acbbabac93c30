"""All that commands print: lines, warnings and errors, progress, tables at the end of a render."""

from __future__ import annotations

import re
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from rasterjit.inspect.profile import FrameProfile
    from rasterjit.outputs.diagnostics import Diagnostics
    from rasterjit.outputs.frame import Frame
    from rasterjit.scene.scene import Scene
    from rasterjit.styles import Style

Item = TypeVar("Item")

STAGE_NAMES = {"compile": "compile, or load compiled"}
"""Plainer names of stages for the table."""


_UNSAFE_CHARACTERS = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters that terminals obey, such as ESC, and undecodable bytes."""

_LINE_BREAK = re.compile(r"\s*\n\s*")


def let_streams_escape() -> None:
    """Let standard output and standard error escape what their encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def escape_controls(text: str) -> str:
    """Return a line whose control characters are escaped as in JSON."""
    return _UNSAFE_CHARACTERS.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def say(*lines: str, err: bool = False) -> None:
    """Print lines, each without control characters, on standard output or standard error."""
    stream = sys.stderr if err else sys.stdout
    for line in lines:
        # Given none, click encodes by its own rules.
        click.echo(escape_controls(line), file=stream)


def say_error(message: str) -> None:
    """Print an error as one line on standard error."""
    say("error: " + _LINE_BREAK.sub(" ", message.strip()), err=True)


def warn(message: str, quiet: bool) -> None:
    """Print a warning as one line on standard error."""
    if not quiet:
        say("warning: " + _LINE_BREAK.sub(" ", message.strip()), err=True)


@contextmanager
def collect_warnings() -> Iterator[list[warnings.WarningMessage]]:
    """Yield the list of those warnings for users that are given meanwhile."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        yield caught


@contextmanager
def show_compile_progress(quiet: bool, shown: Any = None) -> Iterator[None]:
    """
    Show progress of compiling and of a frame's sub-pictures, if they take long.

    Parameters
    ----------
    quiet : bool
        Say nothing.
    shown : rich.status.Status or None
        The line on a terminal that says how far it is. Without one, say it once on standard error.
    """
    from rasterjit.runtime.progress import (
        MIN_SECONDS,
        count_pictures_by,
        describe_storage,
        format_bar,
        show_progress_by,
    )

    is_told = False
    text = shown.status if shown is not None else ""

    def tell(progress: str) -> None:
        nonlocal is_told
        if quiet:
            return
        if shown is not None:
            shown.update(f"{text}: {progress}" if progress else text)
        elif not is_told:
            is_told = True
            say(f"compiling kernels, which takes seconds ({describe_storage()})", err=True)

    began: list[float] = []

    def count(done: int, total: int) -> None:
        began.append(time.monotonic())
        seconds = began[-1] - began[0]
        if shown is not None and seconds >= MIN_SECONDS:
            shown.update(f"{text}: {format_bar(done, total, seconds)}")

    with show_progress_by(tell), count_pictures_by(count):
        yield


@contextmanager
def show_spinner(text: str, quiet: bool) -> Iterator[Any]:
    """Show a spinner if standard error is a terminal; yield the line, or None."""
    if quiet or not sys.stderr.isatty():
        # Without the 50 ms that the import of rich takes.
        yield None
        return
    from rich.console import Console
    from rich.markup import escape

    console = Console(stderr=True)
    with (
        console.status(escape(escape_controls(text)))
        if console.is_terminal
        else nullcontext() as shown
    ):
        yield shown


@contextmanager
def show_progress_bar(
    text: str, quiet: bool, is_told: bool = False
) -> Iterator[Callable[[int, int], None]]:
    """
    Show a progress bar on a terminal; else nothing, or one line at the start.

    Parameters
    ----------
    text : str
    quiet : bool
        Say nothing.
    is_told : bool
        Whether that line is printed, for what a log would be silent about for minutes.

    Yields
    ------
    callable
        Takes how many are done, and how many there are.
    """
    console = _find_console()

    def begin(done: int, total: int) -> None:
        if is_told and not quiet and done == 0 and total > 0:
            say(f"{text} ({total} to do)", err=True)

    if quiet or console is None:
        yield begin
        return
    from rich.progress import Progress

    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task(text)
        yield lambda done, total: progress.update(bar, completed=done, total=total)


def iterate_with_progress(
    items: Iterable[Item], count: int, text: str, quiet: bool
) -> Iterator[Item]:
    """Yield the items, with a progress bar if standard error is a terminal."""
    console = _find_console()
    if quiet or console is None:
        yield from items
        return
    from rich.progress import track

    yield from track(items, text, total=count, console=console, transient=True)


def _find_console() -> Any:
    """Return rich's console of standard error; None if that is no terminal, or without rich."""
    try:
        from rich.console import Console
    except ModuleNotFoundError:
        return None
    console = Console(stderr=True)
    return console if console.is_terminal else None


def format_frame(frame: Frame, total: float) -> str:
    """Return a line on a picture: its size, counts, and seconds."""
    width, height = frame.plan.size
    return f"  {width}x{height}  {frame.counted}  {total:.2f} s"


def format_exposure(scene: Scene, style: Style) -> str:
    """Return a note on the exposure that a style chose; "" if it chose none."""
    tones = style.scene.tone_map
    if scene.tone_map is not None or tones is None or tones.exposure == 0.0:
        return ""
    return f"exposure {tones.exposure:+g} stops, chosen for what is seen; --exposure sets another"


def print_stats(frame: Frame, seconds: dict[str, float], total: float) -> None:
    """
    Print counts of triangles and the time of each stage.

    Parameters
    ----------
    frame : Frame
    seconds : dict of float
        By stage, in order.
    total : float
        Seconds from the start to the end.
    """
    from rich.console import Console
    from rich.table import Column, Table

    stats, (width, height) = frame.stats, frame.plan.size
    table = Table(Column(), Column(justify="right"), show_header=False)
    table.add_row(f"{frame.counted.partition(' ')[2]} in", f"{stats.triangles_in:,}")
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


def print_profile(measured: FrameProfile) -> None:
    """Print the time of each stage, and what each effect costs."""
    from rich.console import Console
    from rich.table import Column, Table

    console = Console(highlight=False)
    title = f"{measured.rounds} frames each, {measured.threads} threads; medians"
    table = Table("stage", Column("time", justify="right"), title=title)
    for stage, seconds in measured.stages.items():
        table.add_row(STAGE_NAMES.get(stage, stage), f"{1000.0 * seconds:,.2f} ms")
    table.add_section()
    table.add_row("frame", f"{1000.0 * measured.total:,.2f} ms")
    console.print(table)
    if not measured.changes:
        return
    times = (Column(name, justify="right") for name in ("frame", "difference"))
    table = Table("effect", "changed to", *times)
    for change in measured.changes:
        table.add_row(
            change.name, change.what, f"{1000.0 * change.seconds:,.2f} ms",
            f"{1000.0 * change.difference:+,.2f} ms",
        )  # fmt: skip
    console.print(table)


def print_diagnostics(diagnostics: Diagnostics) -> None:
    """Print why faces are not seen, and the precision of coordinates."""
    from rich.console import Console
    from rich.table import Column, Table

    table = Table(Column(), Column(justify="right"), show_header=False)
    for name, text in diagnostics.rows():
        table.add_row(name, text)
    Console(highlight=False).print(table)
