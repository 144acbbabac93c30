"""
Draw models with MuJoCo and with its adapter, in one run: how alike, and how fast.

``python -m benchmarks.mujoco_beside``, with what the extra ``bench`` brings and Mesa's
EGL (``libegl1 libgl1-mesa-dri``), and OSMesa where the system still has it (``libosmesa6``).

Pictures: twelve models after some steps, 320x240, through the free camera and the first of their
own. Marks: in at most 20 pixels another object, or none, is seen; depth differs by 2e-5 of its
value where both see the same, but for one pixel in a thousand. A sheet shows colours side by side,
MuJoCo's left, ours in the middle, and the difference.

Times: one model, contestants in turn, processor time of all threads, so that other programs count
less; ratios are medians of the rounds' ratios. They fail nothing.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from benchmarks.mujoco_beside.models import MODELS, MODES, SIZES, cameras_of, model_of
from benchmarks.pairing import paired_ratios
from benchmarks.pyrender_beside.__main__ import Contestant

SIZE = 320, 240
MAX_PIXELS = 20
"""Most pixels that may show another object."""
MAX_DEPTH = 2e-5
"""Largest relative difference of depth, of 99.9 % of pixels."""
TIMED = "suite humanoid"
NAMES = "egl", "osmesa", "rasterjit"


class Likeness(NamedTuple):
    """How far two pictures of a model are apart."""

    pixels: int
    """In which another object, or none, is seen."""
    depth: float
    """Relative difference, 99.9 % of pixels."""
    color: float
    """Mean difference, codes."""

    def is_met(self) -> bool:
        """Tell whether the marks hold."""
        return self.pixels <= MAX_PIXELS and self.depth <= MAX_DEPTH


def compare(theirs: dict[str, Any], ours: dict[str, Any]) -> Likeness:
    """Return how far two sets of arrays are apart."""
    differs = (theirs["segmentation"] != ours["segmentation"]).any(axis=-1)
    both = ~differs & (theirs["segmentation"][..., 0] >= 0)
    apart = np.abs(theirs["depth"] - ours["depth"])[both] / theirs["depth"][both]
    color = np.abs(theirs["color"].astype(int) - ours["color"]).mean()
    depth = float(np.quantile(apart, 0.999)) if both.any() else 0.0
    return Likeness(int(differs.sum()), depth, float(color))


def pictures(
    original: Contestant, adapter: Contestant, models: Sequence[str], folder: Path
) -> Iterator[tuple[str, Any, Any]]:
    """Yield what each model came to, and its row of the sheet."""
    for name in models:
        for camera in cameras_of(model_of(name)):
            found = []
            for one in (original, adapter):
                to = folder / f"{one.name}.npz"
                order = {"size": SIZE, "camera": camera, "to": str(to)}
                told = one.ask("draw", name, "", **order)
                if "error" in told:
                    raise RuntimeError(f"{one.name}, {name}: {told['error']}")
                with np.load(to) as saved:
                    found.append(dict(saved))
            colors = [arrays["color"] for arrays in found]
            apart = np.abs(colors[0].astype(int) - colors[1]).astype(np.uint8)
            yield f"{name} {camera}", compare(*found), np.concatenate([*colors, apart], axis=1)


def times(contestants: Sequence[Contestant], rounds: int) -> Iterator[str]:
    """Yield a row for each mode and size: milliseconds, and how many times as fast it is here."""
    yield "| | size | EGL, ms | OSMesa, ms | here, ms | x EGL | x OSMesa |\n" + "|---" * 7 + "|"
    for mode in MODES:
        for size in SIZES:
            taken: dict[str, list[float]] = {one.name: [] for one in contestants}
            for turn in range(rounds):
                for shift in range(len(contestants)):
                    one = contestants[(turn + shift) % len(contestants)]
                    found = one.ask("time", TIMED, mode, size=size)
                    taken[one.name].append(1e3 * found.get("seconds", np.nan))
            own = taken["rasterjit"]
            medians = [f"{statistics.median(taken[n]):.1f}" if n in taken else "" for n in NAMES]
            ratios = [
                f"{statistics.median(paired_ratios(taken[n], own)):.1f}" if n in taken else ""
                for n in NAMES[:2]
            ]
            yield f"| {mode} | {size[0]}x{size[1]} | " + " | ".join([*medians, *ratios]) + " |"


def main(given: Sequence[str] | None = None) -> int:
    """Compare, write the sheet, and return 1 if a picture misses a mark."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.mujoco_beside", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--model", action="append", choices=MODELS, help="may be repeated")
    parser.add_argument("--rounds", type=int, default=5, help="of times; 0: pictures alone")
    parser.add_argument("--to", type=Path, default=Path(__file__).parents[1] / "results/mujoco")
    asked = parser.parse_args(given)
    asked.to.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        contestants = []
        for name in NAMES:
            one = Contestant(name, sys.executable, "benchmarks.mujoco_beside.worker")
            stack.callback(one.close)
            if one.module is None:
                print(f"{name} does not start", file=sys.stderr)
            else:
                contestants.append(one)
        by_name = {one.name: one for one in contestants}
        met, rows = [], []
        for label, like, row in pictures(
            by_name["egl"], by_name["rasterjit"], asked.model or MODELS, Path(folder)
        ):
            met.append(like.is_met())
            rows.append(row)
            print(f"{label:28} {like.pixels:4} pixels, depth {like.depth:.1e}, colours "
                  f"{like.color:.1f}{'' if met[-1] else '  missed'}", flush=True)  # fmt: skip
        Image.fromarray(np.concatenate(rows)).save(asked.to / "colors.png")
        print(f"marks hold in {sum(met)} of {len(met)}")
        if asked.rounds:
            for line in times(contestants, asked.rounds):
                print(line, flush=True)
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
