"""
``python -m benchmarks.damaged_entries``: damage to the compiled kernels that are kept on disk.

First, entries are damaged, each in one of seven ways at a place that the seed chooses, and read:
each must be refused, or be what it was. Then a picture is drawn with a store of which a sixth of
the entries that it needs is damaged, removed, or exchanged for a pipe, a folder or a link: it must
have the same bytes, with at most one line on standard error, and the next run must say nothing. Any
fault ends this with status 1.
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.fuzz_files.mutations import change_bytes
from benchmarks.pairing import ROOT, cache_environment, package_environment
from rasterjit.runtime import store

Damage = Callable[[bytes, bytes, np.random.Generator], bytes]

SHARE = 1 / 6
"""Of the entries, which a run finds damaged."""

SAID = "rasterjit: compiling again"

COMMAND = ("render", str(ROOT / "models" / "teapot.obj"), "-o", "a.png", "--size", "320x240", "-q")


def _cut(content: bytes, _other: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(0, len(content)))]


def _flip(content: bytes, _other: bytes, rng: np.random.Generator) -> bytes:
    at, data = int(rng.integers(0, len(content))), bytearray(content)
    data[at] ^= 1 << int(rng.integers(0, 8))
    return bytes(data)


def _zero(content: bytes, _other: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(0, len(content)))
    length = min(len(content) - at, 1 << int(rng.integers(4, 13)))
    return content[:at] + bytes(length) + content[at + length :]


def _head(content: bytes, _other: bytes, rng: np.random.Generator) -> bytes:
    return change_bytes(content[:400], "", rng) + content[400:]


def _mix(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(0, min(len(content), len(other))))
    return content[:at] + other[at:]


DAMAGES: dict[str, Damage] = {
    "a bit": _flip, "cut short": _cut, "zeroed, as by a file system": _zero, "its head": _head,
    "any bytes": lambda content, _other, rng: change_bytes(content, "", rng),
    "another entry from a place on": _mix, "another entry": lambda _content, other, _rng: other,
}  # fmt: skip


def read_damaged(entries: list[Path], count: int, seed: int, place: Path) -> dict[str, Counter]:
    """Damage entries and read each; return how often each kind was refused, or used as what."""
    counts: dict[str, Counter] = defaultdict(Counter)
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        kind = list(DAMAGES)[number % len(DAMAGES)]
        mine, other = (entries[int(rng.integers(0, len(entries)))] for _ in "ab")
        content = mine.read_bytes()
        damaged = DAMAGES[kind](content, other.read_bytes(), rng)
        path = place / mine.name
        path.write_bytes(damaged)
        path.chmod(0o600)
        found = store.read_entry(path)
        path.unlink()
        if damaged == content:
            outcome = "unchanged"
        else:
            outcome = "refused" if found is None else "used"
        counts[kind].update([outcome, "tried"])
        if damaged == content and found is None:
            counts[kind].update(["unchanged, and refused"])
    return counts


def _damage_some(folder: Path, chance: random.Random) -> int:
    """Damage a share of the entries in a folder, each in a way of its own; return how many."""
    contents = {one: one.read_bytes() for one in sorted(folder.glob(f"*{store.SUFFIX}"))}
    chosen = [one for one in contents if chance.random() < SHARE]
    for one in chosen:
        rng = np.random.default_rng(chance.getrandbits(32))
        way = chance.choice([*DAMAGES, "removed", "folder", "pipe", "link"])
        one.unlink()
        if way == "folder":
            one.mkdir()
        elif way == "pipe":
            os.mkfifo(one)
        elif way == "link":
            one.symlink_to(chance.choice([other for other in contents if other != one]))
        elif way != "removed":
            other = contents[chance.choice(list(contents))]
            one.write_bytes(DAMAGES[way](contents[one], other, rng))
            one.chmod(0o600)
    return len(chosen)


def _draw(cache: Path, out: Path) -> tuple[int, str, bytes]:
    """Draw a picture; return the status, what was said, and the file."""
    (out / "a.png").unlink(missing_ok=True)
    done = subprocess.run(
        [sys.executable, "-m", "rasterjit", *COMMAND], cwd=out, capture_output=True, text=True,
        env=package_environment(cache_environment(cache)),
    )  # fmt: skip
    picture = out / "a.png"
    return done.returncode, done.stderr, picture.read_bytes() if picture.is_file() else b""


def run_damaged(count: int, seed: int, place: Path) -> list[str]:
    """Draw with damaged stores; return what is wrong, in words."""
    out, source = place / "out", place / "sound"
    for one in (out, source):
        one.mkdir(mode=0o700)
    # What is compiled for the picture, and nothing else.
    _, _, expected = _draw(source, out)
    faults, damaged = [], 0
    for number in range(count):
        cache = place / "store"
        shutil.rmtree(cache, ignore_errors=True)
        shutil.copytree(source, cache)
        cache.chmod(0o700)
        damaged += _damage_some(cache, random.Random(f"{seed} {number}"))
        for name in ("with damage", "again"):
            status, said, picture = _draw(cache, out)
            lines = said.splitlines()
            is_told = len(lines) <= (name == "with damage") and all(
                line.startswith(SAID) for line in lines
            )
            if status or not is_told:
                faults.append(f"run {number}, {name}: status {status}, {said}")
            if picture != expected:
                faults.append(f"run {number}, {name}: another picture")
    click.echo(f"{count} pictures drawn with {damaged} damaged entries, and again; "
               f"faults: {len(faults)}")  # fmt: skip
    return faults


@click.command()
@click.option("--entries", type=click.IntRange(1), default=20000, show_default=True)
@click.option("--runs", type=click.IntRange(0), default=5, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
def main(entries: int, runs: int, seed: int) -> None:
    """Damage kept kernels, and see that none is used."""
    source = store.kernel_folder()
    kept = [] if source is None else sorted(source.glob(f"*{store.SUFFIX}"))
    if source is None or not kept:
        raise click.ClickException("no kernels are kept here: draw something first")
    click.echo(f"seed {seed}, {len(kept)} entries in {source}")
    with tempfile.TemporaryDirectory(prefix="rasterjit-damage-") as name:
        place = Path(name)
        counts = read_damaged(kept, entries, seed, place)
        table = Table(title=f"{entries:,} damaged entries")
        columns = ("tried", "refused", "unchanged", "used", "unchanged, and refused")
        for column in ("damage", *columns):
            table.add_column(column, justify="left" if column == "damage" else "right")
        for kind, count in {**counts, "all": sum(counts.values(), Counter())}.items():
            table.add_row(kind, *(f"{count[one]:,}" for one in columns))
        Console(width=120).print(table)
        faults = run_damaged(runs, seed, place)
    for fault in faults:
        click.echo(fault)
    wrong = sum(count["used"] + count["unchanged, and refused"] for count in counts.values())
    sys.exit(1 if wrong or faults else 0)


if __name__ == "__main__":
    main()
