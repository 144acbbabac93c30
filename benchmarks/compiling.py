"""
``python -m benchmarks.compiling``: what compiling costs, from an empty cache.

Each part of the table begins with an empty cache and a fresh process. ``--against CHECKOUT`` takes
the same steps in a folder with another version, or in a commit, and prints both side by side.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import click
from rich.console import Console

from benchmarks import report
from benchmarks.checkouts import RevisionError, checkouts
from benchmarks.compiling_worker import compiled_forms
from benchmarks.pairing import ROOT, WorkerError, cache_environment, package_environment
from benchmarks.scenes import TEAPOT
from benchmarks.startup import in_style, render_arguments, time_program

WORKER = ROOT / "benchmarks" / "compiling_worker.py"

progress = Console(stderr=True)


class Version(NamedTuple):
    """A version of the package: its name and the folder that holds ``rasterjit/``."""

    name: str
    folder: Path


@dataclass
class Cost:
    """What one step took."""

    what: str
    wall: float
    """Seconds of waiting."""
    processor: float
    """Seconds of the process and of those that it started."""
    clock: float | None = None
    """Seconds by the program's own clock of compiling, where it tells."""
    compiled: list[str] = field(default_factory=list)
    """The kernel of each file that was added to the cache."""


class Mark(NamedTuple):
    """What a step may cost at most."""

    wall: float | None = None
    processor: float | None = None
    compiled: int | None = None


SWITCHED_ON, SWITCHED_ON_LARGE = Mark(wall=1.5), Mark(wall=3.0)
LARGE = ("shadow", "environment", "4 samples")
"""What may take longer to switch on."""
IN_STUDIO, AGAIN_IN_STUDIO = "first teapot in the style studio", "the same again"
"""The first may take the mark of the teapot, and those of what its style switches on."""
MARKS = {
    "first teapot by the command line": Mark(wall=8.0),
    IN_STUDIO: Mark(wall=8.0 + 3 * 3.0 + 2 * 1.5),
    AGAIN_IN_STUDIO: Mark(compiled=0),
    "first teapot by rj.render": Mark(wall=14.0),
    "models/scene.glb after the teapot": Mark(wall=5.0),
    "rasterjit warmup": Mark(processor=60.0),
}


def mark_of(what: str) -> Mark:
    """Return what a step may cost; a sum of switching on has no mark."""
    if what.endswith(" on") and what != "all on":
        return SWITCHED_ON_LARGE if what[: -len(" on")] in LARGE else SWITCHED_ON
    if what.endswith((" off", " after warmup")):
        return Mark(compiled=0)
    return MARKS.get(what, Mark())


def by_command(what: str, arguments: Sequence[str], version: Version, cache: Path) -> Cost:
    """Run a version's command line."""
    before = compiled_forms(cache)
    environment = package_environment(cache_environment(cache), version.folder)
    wall, processor = time_program(arguments, environment, version.folder)
    added = [form for path, form in compiled_forms(cache).items() if path not in before]
    return Cost(what, wall, processor, compiled=sorted(added))


def by_worker(part: str, version: Version, cache: Path) -> Iterator[Cost]:
    """Take the steps of a part in one process; raise `WorkerError` if it fails."""
    environment = package_environment(cache_environment(cache), version.folder)
    command = [sys.executable, str(WORKER), part, str(TEAPOT.parent), str(cache)]
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, text=True, cwd=version.folder,
            env=environment,
        ) as worker,
    ):  # fmt: skip
        for line in worker.stdout or ():
            yield Cost(**json.loads(line))
        if worker.wait() != 0:
            errors.seek(0)
            raise WorkerError((errors.read().strip().splitlines() or ["no message"])[-1])


def first_command(version: Version, cache: Path) -> Iterator[Cost]:
    """Draw the teapot by the command line."""
    arguments = render_arguments(cache.with_name("teapot.png"), version.folder)
    yield by_command("first teapot by the command line", arguments, version, cache)


def first_in_studio(version: Version, cache: Path) -> Iterator[Cost]:
    """Draw the teapot in the command line's own style, and again."""
    if not in_style(version.folder, "studio"):
        return
    arguments = render_arguments(cache.with_name("teapot.png"), version.folder, "studio")
    for what in (IN_STUDIO, AGAIN_IN_STUDIO):
        yield by_command(what, arguments, version, cache)


def switching(version: Version, cache: Path) -> Iterator[Cost]:
    """Draw the teapot, then switch effects on and off, in one process."""
    yield from by_worker("switching", version, cache)


def scene_after_teapot(version: Version, cache: Path) -> Iterator[Cost]:
    """Draw the glTF scene after the teapot."""
    yield from by_worker("scene", version, cache)


def by_pyrender(version: Version, cache: Path) -> Iterator[Cost]:
    """Draw by the adapter for pyrender, in one process."""
    yield from by_worker("pyrender", version, cache)


def everything(version: Version, cache: Path) -> Iterator[Cost]:
    """Compile ahead; then draw all there is, with what was compiled."""
    yield by_command("rasterjit warmup", ["warmup", "--quiet"], version, cache)
    for cost in by_worker("everything", version, cache):
        cost.what += " after warmup"
        yield cost


PARTS: dict[str, Callable[[Version, Path], Iterator[Cost]]] = {
    "command": first_command,
    "studio": first_in_studio,
    "switching": switching,
    "scene": scene_after_teapot,
    "pyrender": by_pyrender,
    "everything": everything,
}


def measure(versions: Sequence[Version], parts: Sequence[str]) -> list[list[Cost]]:
    """Return the costs of each version; they take turns, part by part."""
    found: list[list[Cost]] = [[] for _ in versions]
    for version in versions:
        # Python's own files of compiled modules are no part of it.
        subprocess.run(
            [sys.executable, "-m", "compileall", "-q", str(version.folder / "rasterjit")],
            check=True,
        )
    for part in parts:
        for costs, version in zip(found, versions, strict=True):
            progress.print(f"{version.name}: {part} ...")
            with tempfile.TemporaryDirectory() as folder:
                cache = Path(folder) / "cache"
                cache.mkdir()
                for cost in PARTS[part](version, cache):
                    progress.print(f"  {cost.what}: {cost.wall:.1f} s", highlight=False)
                    costs.append(cost)
    return found


def summed(costs: Sequence[Cost], part: str) -> Cost | None:
    """Return the sum of the steps whose names end alike."""
    some = [cost for cost in costs if cost.what.endswith(part)]
    if not some:
        return None
    clocks = [cost.clock for cost in some if cost.clock is not None]
    return Cost(
        f"all {part.strip()}", sum(cost.wall for cost in some),
        sum(cost.processor for cost in some), sum(clocks) if clocks else None,
        [name for cost in some for name in cost.compiled],
    )  # fmt: skip


def with_sums(costs: Sequence[Cost]) -> list[Cost]:
    """Return the costs, and the sums of what was switched and of what was drawn after warmup."""
    sums = [summed(costs, part) for part in (" on", " off", " after warmup")]
    return [*costs, *filter(None, sums)]


FIGURES: dict[str, Callable[[Cost], float | None]] = {
    "wall s": lambda cost: cost.wall,
    "CPU s": lambda cost: cost.processor,
    "compiling s": lambda cost: cost.clock,
    "compiled": lambda cost: len(cost.compiled),
}
"""The figures of a step, by the title of their column."""


def text_of(figure: float | None) -> str:
    """Return a figure as text: counts whole, seconds with two digits after the point."""
    if figure is None:
        return ""
    return str(figure) if isinstance(figure, int) else f"{figure:.2f}"


def verdict(cost: Cost) -> str:
    """Return what a step may cost at most, and whether it costs more."""
    mark = mark_of(cost.what)
    bounds = {
        "s": (mark.wall, cost.wall),
        "CPU s": (mark.processor, cost.processor),
        "compiled": (mark.compiled, len(cost.compiled)),
    }
    return ", ".join(
        f"{most:g} {unit}{': NO' if found > most else ''}"
        for unit, (most, found) in bounds.items()
        if most is not None
    )


def columns(versions: Sequence[Version]) -> list[str]:
    """Return the titles of the table's columns."""
    titles = ["what"]
    for title in FIGURES:
        titles += [title] if len(versions) == 1 else [f"{title}: A", "B", "B / A"]
    return [*titles, "at most"]


def table(found: Sequence[Sequence[Cost]]) -> list[list[str]]:
    """Return the rows as text: those of the last version, beside another's if there are two."""
    *others, last = map(with_sums, found)
    earlier = {cost.what: cost for costs in others for cost in costs}
    rows = []
    for cost in last:
        before = earlier.get(cost.what)
        row = [cost.what]
        for figure in FIGURES.values():
            after = figure(cost)
            if others:
                past = figure(before) if before else None
                ratio = after / past if past and after is not None else None
                row += [text_of(past), text_of(after), text_of(ratio)]
            else:
                row.append(text_of(after))
        rows.append([*row, verdict(cost)])
    return rows


def finish(versions: Sequence[Version], found: Sequence[Sequence[Cost]]) -> None:
    """Print and write everything."""
    letters = "AB" if len(versions) == 2 else "B"
    names = {letter: one.name for letter, one in zip(letters, versions, strict=True)}
    title = "Compiling, from an empty cache"
    if len(versions) == 2:
        title += f"; A: {names['A']}, B: {names['B']}"
    report.print_table(title, columns(versions), table(found))
    content: dict[str, Any] = {
        "machine": report.machine(),
        "versions": [one.name for one in versions],
        "costs": [list(map(asdict, costs)) for costs in found],
    }
    report.write_text(report.RESULTS / "compiling.json", json.dumps(content, indent=2) + "\n")


@click.command()
@click.option(
    "--against", metavar="CHECKOUT",
    help="A folder with another version, or a commit: it is measured as well.",
)  # fmt: skip
@click.option("--only", multiple=True, type=click.Choice(list(PARTS)), metavar="PART")
def main(against: str | None, only: tuple[str, ...]) -> None:
    """Measure what compiling costs, from an empty cache."""
    own, parts = Version("working tree", ROOT), only or tuple(PARTS)
    try:
        if against is None:
            versions = [own]
            found = measure(versions, parts)
        elif (Path(against) / "rasterjit").is_dir():
            versions = [Version(against, Path(against).resolve()), own]
            found = measure(versions, parts)
        else:
            with (
                tempfile.TemporaryDirectory() as folder,
                checkouts((against, "."), Path(folder)) as pair,
            ):
                versions = [Version(*one) for one in pair]
                found = measure(versions, parts)
    except (RevisionError, WorkerError) as error:
        raise click.ClickException(str(error)) from None
    finish(versions, found)


if __name__ == "__main__":
    main()
