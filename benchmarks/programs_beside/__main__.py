"""
Run public programs of trimesh, MuJoCo and PyBullet as published, and with RasterJIT, in one run.

``xvfb-run -a python -m benchmarks.programs_beside``, with what the extra ``bench`` brings and
Mesa's EGL (``libegl1 libgl1-mesa-dri``): trimesh draws in a window of Xvfb, MuJoCo and dm_control
with EGL, PyBullet with TinyRenderer (whose pictures are compared with those at its places, the
lower left corners of pixels). One program needs ``panda_gym`` (``pip install --no-deps``).

Programs are those of ``programs/``, shortened and typed anew: tutorials, examples of repositories
and of wheels. ``changes.py`` says what changes in them, and counts the lines.

Pictures: shares of pixels, of all frames, that show another object (of pictures without numbers on
a white background: that are background in one and not in the other), and how far depth is apart,
relative, in 99 of 100 pixels; mean difference of colours, codes. A sheet for each program shows
some of its frames: the original's, ours, the difference. Marks: of objects and of depth.

Times: whole programs, simulation included, processor time of all threads, contestants in turn,
after a first run of each. ``--page trimesh`` prints a table as the documentation has it.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from benchmarks.pairing import paired_ratios
from benchmarks.programs_beside.changes import PROGRAMS, count_changes, find_source
from benchmarks.pyrender_beside.__main__ import Contestant

NAMES = "original", "rasterjit"
LIBRARIES = "trimesh", "mujoco", "pybullet"
MAX_OBJECTS = 0.005
"""Largest share of pixels that may show another object."""
MAX_DEPTH = 1e-4
"""Largest relative difference of depth, of 99 % of pixels."""
SHEET_FRAMES = 4
SHEET_WIDTH = 400


class Likeness(NamedTuple):
    """How far what two runs drew is apart."""

    objects: float | None
    """Share of pixels in which another object, or none, is seen."""
    depth: float | None
    """Relative difference, 99 % of pixels."""
    color: float | None
    """Mean difference, codes."""

    def is_met(self) -> bool:
        """Tell whether the marks hold."""
        return (self.objects or 0.0) <= MAX_OBJECTS and (self.depth or 0.0) <= MAX_DEPTH

    def describe(self) -> str:
        """Return a sentence for the table."""
        parts = (
            (self.objects, "{:.2%} other objects"), (self.depth, "depth {:.0e}"),
            (self.color, "colours {:.1f}"),
        )  # fmt: skip
        return ", ".join(text.format(value) for value, text in parts if value is not None)


def compare(theirs: dict[str, Any], ours: dict[str, Any]) -> Likeness:
    """Return how far two sets of arrays are apart."""
    shapes = [{kind: array.shape for kind, array in one.items()} for one in (theirs, ours)]
    if shapes[0] != shapes[1]:
        raise ValueError(f"shapes must be those of the original, {shapes[0]}, got {shapes[1]}")
    objects = depth = color = None
    if "frames" in ours:
        color = float(np.abs(theirs["frames"].astype(int) - ours["frames"]).mean())
        if (theirs["frames"][:, 0, 0] == 255).all():
            drawn = [(one["frames"] != 255).any(axis=-1) for one in (theirs, ours)]
            objects = float((drawn[0] != drawn[1]).mean())
    if "numbers" in ours:
        objects = float((theirs["numbers"] != ours["numbers"]).mean())
    if "depths" in ours:
        a, b = (one["depths"].astype(np.float64) for one in (theirs, ours))
        both = np.isfinite(a) & np.isfinite(b)
        if objects is None:
            objects = float((np.isfinite(a) != np.isfinite(b)).mean())
        depth = float(np.quantile(np.abs(a[both] - b[both]) / np.abs(a[both]), 0.99))
    return Likeness(objects, depth, color)


def make_sheet(theirs: dict[str, Any], ours: dict[str, Any]) -> Image.Image:
    """Return some frames of both and their differences, a row each."""
    kind = "frames" if "frames" in ours else "depths"
    count = len(ours[kind])
    rows = []
    for n in sorted({*np.linspace(0, count - 1, min(count, SHEET_FRAMES)).astype(int).tolist()}):
        pair = [_as_codes(one[kind][n]) for one in (theirs, ours)]
        pair.append(np.abs(pair[0].astype(int) - pair[1]).astype(np.uint8))
        rows.append(np.concatenate(pair, axis=1))
    sheet = Image.fromarray(np.concatenate(rows))
    share = min(1.0, 3 * SHEET_WIDTH / sheet.width)
    return sheet.resize((round(sheet.width * share), round(sheet.height * share)))


def _as_codes(picture: Any) -> Any:
    """Return colours, (H, W, 3) uint8, also of depth."""
    if picture.ndim == 3:
        return picture
    seen = picture[np.isfinite(picture)]
    grey = 255 * np.clip((picture - seen.min()) / max(np.ptp(seen), 1e-9), 0, 1)
    return np.repeat(np.nan_to_num(grey)[..., None], 3, axis=2).astype(np.uint8)


def measure(
    name: str, contestants: Sequence[Contestant], rounds: int, to: Path
) -> tuple[Likeness, float]:
    """Return how alike a program's pictures are, and how many times as long the original takes."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for one in contestants:
            path = Path(folder) / f"{one.name}.npz"
            told = one.ask("draw", name, "", to=str(path))
            if "error" in told:
                raise RuntimeError(f"{name}, {one.name}: {told['error']}")
            if told["told"]:
                print(f"{name}: {'; '.join(told['told'])}", file=sys.stderr)
            with np.load(path) as saved:
                found.append(dict(saved))
    make_sheet(*found).save(to / f"{name}.png")
    taken: dict[str, list[float]] = {one.name: [] for one in contestants}
    for turn in range(rounds):
        for one in contestants[:: 1 if turn % 2 else -1]:
            taken[one.name].append(one.ask("time", name, "").get("seconds", np.nan))
    ratios = paired_ratios(taken[NAMES[0]], taken[NAMES[1]])
    return compare(*found), statistics.median(ratios) if rounds else np.nan


def main(given: Sequence[str] | None = None) -> int:
    """Run the programs, print the table, write the sheets; return 1 if one fails."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.programs_beside", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--program", action="append", choices=PROGRAMS, help="may be repeated")
    parser.add_argument("--page", choices=LIBRARIES, help="the programs of one library")
    parser.add_argument("--rounds", type=int, default=3, help="of times; 0: pictures alone")
    parser.add_argument("--to", type=Path, default=Path(__file__).parents[1] / "results/programs")
    asked = parser.parse_args(given)
    asked.to.mkdir(parents=True, exist_ok=True)
    failed = 0
    print("| program | changed lines | pictures | times as fast |\n|---|---|---|---|")
    for library in LIBRARIES if asked.page is None else (asked.page,):
        # A process for each library, as an extension of one may disturb another.
        with ExitStack() as stack:
            contestants = [
                Contestant(name, sys.executable, "benchmarks.programs_beside.worker")
                for name in NAMES
            ]
            for one in contestants:
                stack.callback(one.close)
            for name in asked.program or PROGRAMS:
                if not name.startswith(library):
                    continue
                try:
                    like, ratio = measure(name, contestants, asked.rounds, asked.to)
                except (RuntimeError, ValueError) as error:
                    # A program may need a package that is not here.
                    failed += "ModuleNotFoundError" not in str(error)
                    print(error, file=sys.stderr, flush=True)
                    continue
                if not like.is_met():
                    failed += 1
                    print(f"{name} misses a mark", file=sys.stderr, flush=True)
                title = name.removeprefix(f"{library}_").replace("_", " ")
                print(f"| [{title}]({find_source(name)}) | {count_changes(name)} | "
                      f"{like.describe()} | {ratio:.1f} |", flush=True)  # fmt: skip
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
