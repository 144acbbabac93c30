"""
Read mutated files of every format in a process that is watched.

``python -m benchmarks.fuzz_files --files 20000 --seed 1`` ends with status 1 if a file ended the
process, took longer than it may, more memory than it may, raised something else than a
``ValueError`` that names it, or was loaded without a word and without all of its triangles.
``--case 123 --keep FOLDER`` reads one of them again and keeps it.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any, TextIO

import click
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from benchmarks.fuzz_files.judging import judge, read_sound_files, sample_of
from benchmarks.pairing import ROOT, package_environment

LONGEST_SECONDS, WAITING_SECONDS = 10.0, 300.0
"""For one file: of the processor, and by the clock, as others use the processor as well."""

ADDRESS_SPACE = 16 << 30
"""Bytes that the process may map: what asks for more ends."""

STARTING_SECONDS = 600.0
"""In which the process must have read the sound files; kernels may have to be compiled for it."""

LISTED = 40

COLUMNS = ("tried", "own error", "of these, stopped", "read", "crash", "hung", "a foreign",
           "lost without a word", "other")  # fmt: skip
"""Of the table; those behind "read" are how faults begin."""

STOPPED = re.compile(r"its reader (?:crashed|takes more)|needs more memory than max_bytes")
"""What is said of files whose readers were stopped where they could do no harm."""


class Reader:
    """A process that reads cases by their numbers; it is started again when one ends it."""

    def __init__(self, seed: int, log: TextIO) -> None:
        self._seed, self._log = seed, log
        self._process: subprocess.Popen[str] | None = None

    def read(self, number: int) -> dict[str, Any]:
        """Return what became of a case."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.fuzz_files", "--serve", "--seed",
                 str(self._seed)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True,
                cwd=ROOT, env=package_environment({}),
            )  # fmt: skip
            if self._answer(STARTING_SECONDS) is None:
                self._log.seek(0)
                raise RuntimeError(f"the process does not start: {self._log.read()[-2000:]}")
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(f"{number}\n")
            self._process.stdin.flush()
        answer = self._answer(WAITING_SECONDS)
        if answer is None:
            status = self._process.poll()
            fault = "hung" if status is None else f"crash: the process ended with status {status}"
            self.close()
            return {"number": number, "sample": sample_of(number), "how": "", "said": "",
                    "outcome": "ended", "faults": [fault], "seconds": 0.0, "peak": 0}  # fmt: skip
        if answer["seconds"] > LONGEST_SECONDS:
            answer["faults"].append(f"hung: it took {answer['seconds']:.1f} s")
        return answer

    def _answer(self, seconds: float) -> Any:
        """Return the next answer, or None if the process gives none in time."""
        stream = self._process.stdout
        ready, _, _ = select.select([stream], [], [], seconds)
        line = stream.readline() if ready else ""
        if ready and not line:
            self._process.wait()
        return json.loads(line) if line else None

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process.stdin.close()
            self._process.stdout.close()
            self._process = None


def serve(seed: int, answers: TextIO) -> None:
    """Answer the numbers of cases that stand on standard input."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        read_sound_files(Path(folder))
    print("true", file=answers, flush=True)
    for line in sys.stdin:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            answer = judge(seed, int(line), Path(folder))
        print(json.dumps(answer), file=answers, flush=True)


def report(results: list[dict[str, Any]], seed: int, console: Console) -> bool:
    """Print what became of all cases; tell whether nothing is wrong."""
    table = Table(title=f"{len(results):,} mutated files, seed {seed}")
    table.add_column("sample")
    for name in COLUMNS:
        table.add_column(name, justify="right")
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for one in results:
        count = counts[one["sample"]]
        is_own = one["outcome"] == "refused" and not one["faults"]
        count.update({"tried": 1, "own error": int(is_own)})
        count.update({"read": int(one["outcome"] in ("loaded", "warned"))})
        count.update({"of these, stopped": int(is_own and bool(STOPPED.search(one["said"])))})
        for fault in one["faults"]:
            count.update([next((name for name in COLUMNS if fault.startswith(name)), "other")])
    counts["all"] = sum(counts.values(), Counter())
    for sample, count in counts.items():
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


@click.command()
@click.option("--files", type=click.IntRange(1), default=2000, show_default=True)
@click.option("--first", type=click.IntRange(0), default=0, show_default=True, help="First case.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option("--case", type=click.IntRange(0), help="Read this case alone, in this process.")
@click.option("--keep", type=click.Path(path_type=Path), help="Folder for the file of --case.")
@click.option("--output", type=click.Path(path_type=Path), help="JSON of all cases with faults.")
@click.option("--serve", "is_server", is_flag=True, hidden=True)
def main(
    files: int, first: int, seed: int, case: int | None, keep: Path | None, output: Path | None,
    is_server: bool,
) -> None:  # fmt: skip
    """Read mutated files of every format that is read."""
    if is_server:
        # Nothing that a library prints comes between the answers.
        answers = os.fdopen(os.dup(1), "w")
        os.dup2(2, 1)
        serve(seed, answers)
        return
    if case is not None:
        folder = Path(tempfile.mkdtemp(prefix="fuzz-")) if keep is None else keep
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="fuzz-") as other:
            read_sound_files(Path(other))
        Console().print_json(data={**judge(seed, case, folder), "folder": str(folder)})
        return
    results, start = [], time.perf_counter()
    with tempfile.TemporaryFile("w+") as log, Progress(console=Console(stderr=True)) as progress:
        reader = Reader(seed, log)
        try:
            for number in progress.track(range(first, first + files), description=f"seed {seed}"):
                results.append(reader.read(number))
        finally:
            reader.close()
    is_good = report(results, seed, Console(width=160))
    click.echo(f"{time.perf_counter() - start:.0f} s")
    if output is not None:
        output.write_text(json.dumps([one for one in results if one["faults"]], indent=1))
    sys.exit(0 if is_good else 1)


if __name__ == "__main__":
    main()
