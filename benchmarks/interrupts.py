"""
``python -m benchmarks.interrupts``: Ctrl-C and kills at any moment of seven command lines.

Each run begins in an empty folder, and a third of them with a cache that lacks an eighth of its
entries, so that compilers and their second process are hit, too. At a moment that the seed chooses
comes SIGINT, to the process or to all of its group as from a terminal, or SIGKILL. What must be
then:

- after SIGINT: status 130, or 0 of a run that had said its last words; no traceback; no file but
  whole ones;
- after SIGKILL: the same command, run again, ends well and leaves whole files alone;
- no process of the run for more than a moment.

An interrupt that comes before the first line of ours runs, while Python starts, is Python's: it is
counted apart. Any fault ends this with status 1.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

import click
from rich.console import Console
from rich.table import Table

from benchmarks.pairing import ROOT, cache_environment, package_environment
from rasterjit.runtime import store

INTERRUPTED = 130

FIRST = 0.02
"""The earliest moment, seconds after the start."""

IMPORTS = 1.5
"""Seconds in which half of the moments lie: while modules are imported."""

COLD = 1 / 3
"""Share of the runs that compile."""

MISSING = 1 / 8
"""Share of the entries that their cache lacks."""

A_MOMENT = 1.0
"""Seconds that processes of a run may stay after it."""

PATIENCE = 30.0
"""Seconds in which a run must end after a signal."""

WHOLE_RUN = 600.0
"""Seconds in which a run must end that nothing disturbs."""

OURS = os.path.join("rasterjit", "")
"""What a traceback names that is about files of ours."""

RESULTS = ROOT / "benchmarks" / "results" / "interrupts.json"


class Command(NamedTuple):
    """A command line, and what is true of it."""

    name: str
    words: tuple[str, ...]
    """``{models}`` and ``{out}`` stand for folders."""
    is_endless: bool = False
    """Whether it goes on until it is interrupted; then it may end with 0."""
    compiles: bool = False
    """Whether its cache always lacks entries."""
    last_words: str = "wrote "
    """What it prints when all is done: then nothing is left to be interrupted."""


COMMANDS = (
    Command("render", ("render", "{models}/scene.glb", "-o", "{out}/a.png", "--size", "640x360",
                       "--outputs", "color,depth,normal")),
    Command("turntable gif", ("turntable", "{models}/scene.glb", "-o", "{out}/a.gif", "--frames",
                              "24", "--size", "160x120")),
    Command("turntable mp4", ("turntable", "{models}/scene.glb", "-o", "{out}/a.mp4", "--frames",
                              "60", "--size", "320x240")),
    Command("accuracy", ("accuracy", "--scene", "wires", "--knobs", "samples", "--budget", "5",
                         "--size", "96x72", "-o", "{out}/report")),
    Command("dataset", ("dataset", "{models}", "-o", "{out}/set", "--views", "2", "--size", "64",
                        "--workers", "2")),
    Command("warmup", ("warmup",), compiles=True, last_words="entries in "),
    Command("view", ("view", "{models}/teapot.obj", "--backend", "browser", "--port", "0"),
            is_endless=True),
)  # fmt: skip


@dataclass
class Run:
    """What became of one run."""

    command: str
    signal: str
    to_group: bool
    is_cold: bool
    moment: float
    """Seconds after the start at which the signal was sent, if the run was not over."""
    seed: int = 0
    """Of what the cache lacks."""
    status: int | None = None
    """None if it did not end."""
    seconds: float = 0.0
    """From the signal to the end."""
    is_done: bool = False
    """Whether it had said its last words."""
    errors: str = ""
    """Standard error."""
    files: list[str] = field(default_factory=list)
    """Files that are not whole, or have no business there."""
    processes: list[str] = field(default_factory=list)
    """Command lines of those that stayed."""
    left: list[str] = field(default_factory=list)
    """Of a kill: files that it left, which the next run removes."""
    again: int | None = None
    """Of a kill: the status of the next run."""

    @property
    def is_before_ours(self) -> bool:
        """Whether Python answered, for nothing of ours had run."""
        was_python = "Traceback" in self.errors or self.status == -signal.SIGINT
        return self.signal == "SIGINT" and was_python and OURS not in self.errors

    def faults(self, is_endless: bool = False) -> list[str]:
        """Return what is wrong, in words."""
        found = []
        if self.status is None:
            found.append("did not end")
        elif self.signal == "SIGINT" and not self.is_before_ours:
            may_be_done = is_endless or self.is_done
            if self.status != INTERRUPTED and not (self.status == 0 and may_be_done):
                found.append(f"status {self.status}")
            if "Traceback" in self.errors:
                found.append("traceback")
        if self.files:
            found.append(f"files {', '.join(self.files)}")
        if self.processes:
            found.append(f"processes {len(self.processes)}")
        if self.again:
            found.append(f"the next run ended with {self.again}")
        return found


class Length(NamedTuple):
    """How long a command takes with a full cache, and with one that lacks entries, seconds."""

    warm: float
    cold: float


def moment(chance: random.Random, length: float) -> float:
    """Return when a signal comes: half of the time while modules are imported."""
    end = min(IMPORTS, length) if chance.random() < 0.5 else length
    return chance.uniform(FIRST, max(end, FIRST))


def not_whole(out: Path) -> list[str]:
    """Return the files below a folder that are not whole, or are nobody's."""
    found = []
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if any(part.startswith(".") for part in name.split("/")):
            found.append(name)
        elif path.is_file():
            try:
                READERS.get(path.suffix, lambda path: None)(path)
            except Exception as error:
                found.append(f"{name} ({type(error).__name__})")
    return found


def _read_picture(path: Path) -> None:
    from PIL import Image, ImageSequence

    with Image.open(path) as picture:
        for frame in ImageSequence.Iterator(picture):
            frame.load()


def _read_video(path: Path) -> None:
    import imageio_ffmpeg

    if not imageio_ffmpeg.count_frames_and_secs(str(path))[0]:
        raise ValueError("no frames")


def _read_arrays(path: Path) -> None:
    import numpy as np

    with np.load(path) as arrays:
        for name in arrays:
            _ = arrays[name]


READERS: dict[str, Callable[[Path], None]] = {
    ".png": _read_picture,
    ".gif": _read_picture,
    ".mp4": _read_video,
    ".npz": _read_arrays,
    ".json": lambda path: json.loads(path.read_text()),
}


def members(session: int) -> dict[int, str]:
    """Return the processes of a session that go on, by number, with their command lines."""
    found = {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            stat = (folder / "stat").read_text().rpartition(")")[2].split()
            line = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        state, number = stat[0], int(stat[3])
        if number == session and state not in "ZX":
            found[int(folder.name)] = line[:200]
    return found


def remaining(session: int) -> list[str]:
    """Return the command lines of processes that are there after a moment, and end them."""
    end = time.monotonic() + A_MOMENT
    while (found := members(session)) and time.monotonic() < end:
        time.sleep(0.02)
    for number in found:
        try:
            os.kill(number, signal.SIGKILL)
        except ProcessLookupError:
            continue
    return list(found.values())


class Bench:
    """
    Where the runs take place.

    Parameters
    ----------
    folder : Path
        Empty; everything is in it.
    program : sequence of str
        How the command line is started.
    """

    def __init__(
        self, folder: Path, program: tuple[str, ...] = (sys.executable, "-m", "rasterjit")
    ) -> None:
        self.folder, self.program = folder, program
        self.warm = folder / "warm"
        kept = store.kernel_folder()
        if kept is None:
            self.warm.mkdir(mode=0o700)
        else:
            shutil.copytree(kept, self.warm, ignore=shutil.ignore_patterns("*.lock"))
            self.warm.chmod(0o700)

    def start(self, command: Command, out: Path, cache: Path, errors: Path) -> subprocess.Popen:
        """Start a command in a session of its own."""
        words = [word.format(models=ROOT / "models", out=out) for word in command.words]
        with errors.open("wb") as file:
            return subprocess.Popen(
                [*self.program, *words], start_new_session=True, cwd=out,
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=file,
                env=package_environment(cache_environment(cache)),
            )  # fmt: skip

    def places(self, chance: random.Random) -> tuple[Path, Path]:
        """Return an empty folder for files, and a cache that lacks entries."""
        out, cache = self.folder / "out", self.folder / "cold"
        for place in (out, cache):
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir(mode=0o700)
        for entry in sorted(self.warm.iterdir()):
            if entry.is_file() and chance.random() >= MISSING:
                shutil.copy(entry, cache)
        return out, cache

    def complete(self, command: Command, out: Path, cache: Path) -> tuple[int, float, str]:
        """Run a command to its end; return its status, its seconds and its standard error."""
        errors = self.folder / "errors"
        start = time.monotonic()
        process = self.start(command, out, cache, errors)
        try:
            if command.is_endless:
                _wait_for_page(process)
                seconds = time.monotonic() - start
                # While the first picture is compiled, and a while after that.
                seconds *= 2.0
                process.send_signal(signal.SIGINT)
            process.communicate(timeout=WHOLE_RUN)
        finally:
            process.kill()
            process.wait()
            remaining(process.pid)
        if not command.is_endless:
            seconds = time.monotonic() - start
        return process.returncode, seconds, errors.read_text(errors="replace")

    def length(self, command: Command) -> Length:
        """Return how long a command takes, once what it needs is in the cache."""
        taken = []
        for is_cold in (False, False, True):
            out, cold = self.places(random.Random(len(taken)))
            cache = cold if is_cold else self.warm
            status, seconds, errors = self.complete(command, out, cache)
            wrong = not_whole(out)
            if status not in (0, INTERRUPTED) or wrong:
                raise click.ClickException(
                    f"{command.name} alone ended with {status}: {errors}{wrong}"
                )
            taken.append(seconds)
        return Length(*taken[1:])

    def disturb(self, command: Command, run: Run) -> Run:
        """Start a command, send the signal when it is time, and look at what is left."""
        out, cold = self.places(random.Random(run.seed))
        cache = cold if run.is_cold else self.warm
        errors = self.folder / "errors"
        start = time.monotonic()
        process = self.start(command, out, cache, errors)
        try:
            time.sleep(max(0.0, start + run.moment - time.monotonic()))
            number, sent = signal.Signals[run.signal], time.monotonic()
            if process.poll() is None and run.to_group:
                os.killpg(process.pid, number)
            elif process.poll() is None:
                process.send_signal(number)
            said, _ = process.communicate(timeout=PATIENCE)
            run.is_done = command.last_words.encode() in said
            run.status, run.seconds = process.returncode, time.monotonic() - sent
        except subprocess.TimeoutExpired:
            pass
        finally:
            process.kill()
            process.communicate()
        run.processes = remaining(process.pid)
        run.errors += errors.read_text(errors="replace")
        if run.signal == "SIGINT":
            run.files = not_whole(out)
        else:
            run.left = not_whole(out)
            status, _, told = self.complete(command, out, cache)
            run.again = 0 if command.is_endless and status == INTERRUPTED else status
            run.files = not_whole(out)
            if run.again or run.files:
                run.errors += told
        return run


def _wait_for_page(process: subprocess.Popen) -> None:
    """Wait until a viewer has said where its page is."""
    for line in process.stdout or ():
        if b"http://" in line:
            return


def planned(commands: list[Command], lengths: dict[str, Length], interrupts: int, kills: int,
            seed: int) -> list[tuple[Command, Run]]:  # fmt: skip
    """Return the runs, in turns of the commands."""
    chance = random.Random(seed)
    runs = []
    for number, name in enumerate(["SIGINT"] * interrupts + ["SIGKILL"] * kills):
        command = commands[number % len(commands)]
        is_cold = chance.random() < COLD or command.compiles
        length = lengths[command.name]
        at = moment(chance, length.cold if is_cold else length.warm)
        # A kill of the group is no kill of one: nobody is left to be noticed.
        to_group = chance.random() < 0.5 and name == "SIGINT"
        runs.append((command, Run(command.name, name, to_group, is_cold, at, number)))
    return runs


def table_of(runs: list[tuple[Command, Run]]) -> Table:
    """Return what became of the runs, a row for each command and signal."""
    table = Table(title="signals at any moment")
    table.add_column("command")
    table.add_column("signal")
    for name in ("runs", "statuses", "before ours", "tracebacks", "not whole", "left, then removed",
                 "processes left", "longest end"):  # fmt: skip
        table.add_column(name, justify="right")
    groups: dict[tuple[str, str], list[Run]] = {}
    for _, run in runs:
        groups.setdefault((run.command, run.signal), []).append(run)
        groups.setdefault(("all", run.signal), []).append(run)
    for (name, kind), some in sorted(groups.items(), key=lambda item: item[0][::-1]):
        ours = [run for run in some if not run.is_before_ours]
        statuses = Counter("none" if run.status is None else str(run.status) for run in ours)
        table.add_row(
            name, kind, str(len(some)),
            ", ".join(f"{status}: {count}" for status, count in statuses.most_common()),
            str(len(some) - len(ours)),
            str(sum("Traceback" in run.errors for run in ours)),
            str(sum(bool(run.files) for run in some)),
            str(sum(bool(run.left) for run in some)),
            str(sum(bool(run.processes) for run in some)),
            f"{max(run.seconds for run in some):.2f} s",
        )  # fmt: skip
    return table


@click.command()
@click.option("--interrupts", type=click.IntRange(0), default=120, show_default=True)
@click.option("--kills", type=click.IntRange(0), default=48, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the moments.")
@click.option("--only", multiple=True, type=click.Choice([one.name for one in COMMANDS]),
              help="These commands alone.")  # fmt: skip
def main(interrupts: int, kills: int, seed: int, only: tuple[str, ...]) -> None:
    """Send Ctrl-C and kills to the command line at any moment, and look at what is left."""
    commands = [one for one in COMMANDS if not only or one.name in only]
    progress = Console(stderr=True)
    with tempfile.TemporaryDirectory(prefix="rasterjit-interrupts-") as folder:
        bench = Bench(Path(folder))
        lengths = {}
        for command in commands:
            length = lengths[command.name] = bench.length(command)
            progress.print(f"{command.name}: {length.warm:.1f} s, first {length.cold:.1f} s")
        runs = planned(commands, lengths, interrupts, kills, seed)
        for number, (command, run) in enumerate(runs, start=1):
            bench.disturb(command, run)
            told = "; ".join(run.faults(command.is_endless)) or "as it should"
            progress.print(
                f"{number} of {len(runs)}: {run.command}, {run.signal} after {run.moment:.3f} s: "
                f"{told}"
            )
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps([asdict(run) for _, run in runs], indent=1))
    Console(width=None if sys.stdout.isatty() else 160).print(table_of(runs))
    faults = [(run, run.faults(command.is_endless)) for command, run in runs]
    for run, said in faults:
        if said:
            click.echo(f"{run.command}, {run.signal} after {run.moment:.3f} s: {'; '.join(said)}")
    sys.exit(any(said for _, said in faults))


if __name__ == "__main__":
    main()
