"""
Read mutated files of every format in a process that is watched.

``python -m benchmarks.fuzz_files --files 20000 --seed 1`` ends with status 1 if a file ended the
process, took longer than it may, more memory than it may, raised something else than a
``ValueError`` that names it, or was loaded without a word and without all of its triangles.
``--results FILE`` writes down each case as it goes; run again, it goes on where that file ends.
``--case 123 --keep FOLDER`` reads one of them again and keeps it.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import resource
import select
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TextIO

import click
from rich.console import Console
from rich.progress import Progress

from benchmarks.fuzz_files.all_samples import SAMPLES, without_package
from benchmarks.fuzz_files.judging import judge, read_sound_files, sample_of
from benchmarks.fuzz_files.tables import report, write_page
from benchmarks.pairing import ROOT, package_environment
from rasterjit.io.foreign import isolation

LONGEST_SECONDS, WAITING_SECONDS = 10.0, 300.0
"""For one file: of the processor, and by the clock, as others use the processor as well."""

ADDRESS_SPACE = 16 << 30
"""Bytes that the process may map: what asks for more ends."""

STARTING_SECONDS = 600.0
"""In which the process must have read the sound files; kernels may have to be compiled for it."""

READER_SECONDS = 1
"""Of the processor, in place of ten: what packages of others may take in a process of its own."""


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
    isolation._BASE_CPU_SECONDS = READER_SECONDS
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        read_sound_files(Path(folder))
    print("true", file=answers, flush=True)
    for line in sys.stdin:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            answer = judge(seed, int(line), Path(folder))
        print(json.dumps(answer), file=answers, flush=True)


def read_all(numbers: list[int], seed: int, workers: int) -> Iterator[dict[str, Any]]:
    """Yield what became of cases as they are read, by several processes at a time."""
    waiting, found = iter(numbers), queue.SimpleQueue[Any]()
    taking, is_over = threading.Lock(), threading.Event()

    def work() -> None:
        """Read cases while there are any."""
        with tempfile.TemporaryFile("w+") as log:
            reader = Reader(seed, log)
            try:
                while not is_over.is_set():
                    with taking:
                        number = next(waiting, None)
                    if number is None:
                        break
                    found.put(reader.read(number))
            finally:
                reader.close()
                found.put(None)

    with ThreadPoolExecutor(workers) as pool:
        ends = [pool.submit(work) for _ in range(workers)]
        try:
            for _ in ends:
                while (result := found.get()) is not None:
                    yield result
        finally:
            is_over.set()
        for end in ends:
            end.result()


def _known_results(path: Path | None, seed: int) -> dict[int, dict[str, Any]]:
    """Return the results that stand in a file, by the numbers of the cases; begin it if need be."""
    if path is None:
        return {}
    head = {"seed": seed, "samples": list(SAMPLES)}
    if not path.exists():
        path.write_text(json.dumps(head) + "\n")
    first, *lines = path.read_text().splitlines()
    if json.loads(first) != head:
        raise click.ClickException(f"{path} holds results of another seed or of other samples")
    return {one["number"]: one for one in map(json.loads, lines)}


@click.command()
@click.option("--files", type=click.IntRange(1), default=2000, show_default=True)
@click.option("--first", type=click.IntRange(0), default=0, show_default=True, help="First case.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option("--case", type=click.IntRange(0), help="Read this case alone, in this process.")
@click.option("--keep", type=click.Path(path_type=Path), help="Folder for the file of --case.")
@click.option(
    "--results",
    "kept",
    type=click.Path(path_type=Path),
    help="A line of JSON for each case, which stays where it stands.",
)
@click.option(
    "--workers", type=click.IntRange(1), default=2, show_default=True, help="Processes that read."
)
@click.option(
    "--page", type=click.Path(path_type=Path, exists=True), help="Page whose table is written anew."
)
@click.option("--serve", "is_server", is_flag=True, hidden=True)
def main(
    files: int, first: int, seed: int, case: int | None, keep: Path | None, kept: Path | None,
    workers: int, page: Path | None, is_server: bool,
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
    known, start = _known_results(kept, seed), time.perf_counter()
    waiting = [number for number in range(first, first + files) if number not in known]
    click.echo(f"seed {seed}, cases {first} to {first + files - 1}, {len(waiting)} to read")
    for name, package in without_package().items():
        click.echo(f"not read: .{name}, for {package} is not installed")
    with (
        open(os.devnull if kept is None else kept, "a") as file,
        Progress(console=Console(stderr=True)) as progress,
    ):
        task = progress.add_task(f"seed {seed}", total=len(waiting))
        for result in read_all(waiting, seed, workers):
            known[result["number"]] = result
            print(json.dumps(result), file=file, flush=True)
            progress.advance(task)
    results = [known[number] for number in range(first, first + files)]
    is_good = report(results, seed, Console(width=160))
    click.echo(f"{time.perf_counter() - start:.0f} s")
    if page is not None:
        write_page(results, page)
    sys.exit(0 if is_good else 1)


if __name__ == "__main__":
    main()
