"""
Draw scenes with pyrender 0.1.45 and with its adapter, in one run: how alike, and how fast.

``python -m benchmarks.pyrender_beside --python ENVIRONMENT/bin/python``

The environment has the original: ``pip install pyrender "numpy<2" "pyglet<2"``, then
``pip install "PyOpenGL>=3.1.7"``. Its pictures are those of Mesa's EGL, its times those of EGL and
OSMesa (``libegl1``, ``libosmesa6``). Each contestant is a process of its own, with as many threads
as it takes by itself.

Pictures: every scene under every flag, 640x480, one after the other by one renderer. The mask is
where depth is not 0. Colours count inside objects: where both cover a pixel and all beside it. The
original takes depth at the first of its four samples, (0.375, 0.875) of a pixel from its left and
upper side, and under ``SEG`` at the centre; so does the adapter. Its buffer of depth has 24 bits,
and Mesa snaps vertices to 1/256 of a pixel: one step of each is allowed beside the mark.

Times: one scene of 70 000 faces, flag by flag, contestants in turn: ``warm`` is a further picture
of a scene and a renderer that are kept, ``cold`` a first one of scene, meshes and renderer that are
all made anew, in a process that has drawn before. A ratio is the median of the rounds' ratios, of
the faster of EGL and OSMesa. ``--page`` prints those of ``docs/coming_from/pyrender.md`` as they
stand there.

It ends with status 1 if a picture misses a mark. Ratios below theirs are told and no more: they are
a claim about a quiet machine.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.pairing import ROOT, package_environment, paired_ratios
from benchmarks.pyrender_beside.likeness import COLOR_CODES, MASK_SHARE, Likeness, compare
from benchmarks.pyrender_beside.scenes import SCENES
from benchmarks.pyrender_beside.sheet import draw_sheet

FLAGS = (
    "NONE", "DEPTH_ONLY", "FLIP_WIREFRAME", "ALL_WIREFRAME", "ALL_SOLID", "SHADOWS_DIRECTIONAL",
    "SHADOWS_SPOT", "SHADOWS_POINT", "SHADOWS_ALL", "VERTEX_NORMALS", "FACE_NORMALS",
    "SKIP_CULL_FACES", "RGBA", "FLAT", "SEG", "RGBA|SKIP_CULL_FACES", "RGBA|ALL_WIREFRAME",
    "FLAT|ALL_WIREFRAME",
)  # fmt: skip
PAGE_FLAGS = (
    "NONE", "RGBA", "FLAT", "SEG", "DEPTH_ONLY", "ALL_WIREFRAME", "SHADOWS_DIRECTIONAL"
)  # fmt: skip
"""Flags whose times the documentation tells."""
TIMED = "plain"
FASTER = 3.0
"""The mark: how many times as fast as the faster of EGL and OSMesa."""

Row = dict[str, Any]


class Known(NamedTuple):
    """A difference that stays, and how large it may be."""

    scene: str
    flags: tuple[str, ...]
    color: float
    """Codes, inside objects."""
    outline: float
    """Share of a mask's pixels at outlines."""


KNOWN = (
    # A pixel's normal is a quotient of two differences there, which along a line are rounding
    # errors: dark dots in one pixel of three.
    Known("all_maps", ("FLIP_WIREFRAME", "ALL_WIREFRAME", "RGBA|ALL_WIREFRAME"), 22.0, MASK_SHARE),
    # Without several samples Mesa draws a pixel for each column or row of a line; here a line is
    # an area that is one pixel wide.
    Known("lines", ("SEG",), 6.0, 0.025),
)


class Contestant:
    """
    A process of `benchmarks.pyrender_beside.worker`.

    Parameters
    ----------
    name : str
        "egl", "osmesa" or "rasterjit".
    python : str
        Its interpreter.
    worker : str
        The module that it runs.
    """

    def __init__(
        self, name: str, python: str, worker: str = "benchmarks.pyrender_beside.worker"
    ) -> None:
        self.name = name
        self._process = subprocess.Popen(
            [python, "-m", worker, name],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            cwd=ROOT, env=environment(name),
        )  # fmt: skip
        self.module = self._answer().get("module")

    def ask(self, task: str, scene: str, flag: str, **more: Any) -> dict[str, Any]:
        """Send an order and return the answer, with ``error`` if it failed."""
        if self._process.stdin is None or self._process.poll() is not None:
            return {"error": f"{self.name} has ended"}
        order = {"task": task, "scene": scene, "flag": flag, **more}
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def draw(self, scene: str, flag: str, to: Path) -> Any:
        """Return the arrays of a picture, or the text of the error."""
        found = self.ask("draw", scene, flag, to=str(to))
        if "error" in found:
            return found["error"]
        with np.load(to) as saved:
            return dict(saved)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()

    def _answer(self) -> dict[str, Any]:
        line = self._process.stdout.readline() if self._process.stdout is not None else ""
        return json.loads(line) if line else {"error": f"{self.name} has ended"}


def environment(name: str) -> dict[str, str]:
    """Return the environment of a contestant; the original finds its own packages alone."""
    found = package_environment({})
    return found if name == "rasterjit" else {**os.environ, "PYTHONPATH": str(ROOT)}


def pictures(
    original: Contestant,
    adapter: Contestant,
    scenes: Sequence[str],
    flags: Sequence[str],
    folder: Path,
) -> Iterator[Row]:
    """Yield what each scene under each flag came to, with both pictures; flags take turns."""
    for scene in scenes:
        for flag in flags:
            theirs = original.draw(scene, flag, folder / "theirs.npz")
            ours = adapter.draw(scene, flag, folder / "ours.npz")
            row: Row = {"scene": scene, "flag": flag, "theirs": theirs, "ours": ours}
            if not isinstance(theirs, str) and not isinstance(ours, str):
                row["like"] = compare(theirs, ours)
            yield row


def verdict(row: Row) -> str:
    """Return in a few words whether a row's marks hold."""
    if "like" in row:
        missed = ", ".join(row["like"].failures())
        if missed and not row["like"].failures(*allowed(row)):
            return f"yes: known to differ ({missed})"
        return missed or "yes"
    if isinstance(row["theirs"], str) and isinstance(row["ours"], str):
        return "yes: both refuse"
    if isinstance(row["theirs"], str):
        return f"yes: the original fails ({row['theirs'][:60]})"
    return f"refused: {row['ours'][:70]}"


def allowed(row: Row) -> tuple[float, float]:
    """Return how far a row's colours and mask may be off, where that is known."""
    for known in KNOWN:
        if row["scene"] == known.scene and row["flag"] in known.flags:
            return known.color, known.outline
    return COLOR_CODES, MASK_SHARE


def is_met(row: Row) -> bool:
    """Tell whether a row's marks hold."""
    return verdict(row).startswith("yes")


def times(contestants: Sequence[Contestant], flags: Sequence[str], rounds: int) -> Iterator[Row]:
    """Yield the milliseconds of each contestant, warm and cold, for each flag."""
    for flag in flags:
        taken: dict[tuple[str, str], list[float]] = {}
        for kind in ("warm", "cold"):
            for turn in range(rounds):
                for shift in range(len(contestants)):
                    one = contestants[(turn + shift) % len(contestants)]
                    found = one.ask(kind, TIMED, flag)
                    if "seconds" in found:
                        taken.setdefault((one.name, kind), []).append(1e3 * found["seconds"])
        row: Row = {"flag": flag}
        for (name, kind), values in taken.items():
            row[f"{name}_{kind}"] = statistics.median(values)
        for kind in ("warm", "cold"):
            own = taken.get(("rasterjit", kind), [])
            ratios = [
                statistics.median(paired_ratios(taken[name, kind], own))
                for name in ("egl", "osmesa")
                if own and (name, kind) in taken
            ]
            row[f"ratio_{kind}"] = min(ratios, default=None)
        yield row


def table_of_pictures(rows: Sequence[Row]) -> str:
    """Return a table of the rows, Markdown."""
    head = (
        "| flag | scene | inside | 99 % | edges | outside | alpha | mask: outline | far | depth "
        "| 99 % | beyond | met |\n" + "|---" * 13 + "|"
    )
    lines = [head]
    for row in rows:
        if "like" not in row:
            cells = [""] * 10
        else:
            like: Likeness = row["like"]
            cells = [f"{v:.2f}" for v in like[:5]]
            cells += [f"{like.outline:.2%}", f"{like.far:.2%}"]
            cells += [f"{like.depth:.1e}", f"{like.depth_99:.1e}", f"{like.beyond:.2%}"]
        lines.append(
            "| "
            + " | ".join([row["flag"].replace("|", "+"), row["scene"], *cells, verdict(row)])
            + " |"
        )
    return "\n".join(lines).replace("nan%", "").replace("nan", "")


def table_of_times(rows: Sequence[Row]) -> str:
    """Return a table of the rows, Markdown: frames a second, and how many times as fast."""
    names = ("egl", "osmesa", "rasterjit")
    head = ["EGL, kept", "OSMesa", "here", "x", "EGL, new", "OSMesa", "here", "x"]
    lines = ["| flag | " + " | ".join(head) + " |", "|---" * (len(head) + 1) + "|"]
    for row in rows:
        cells = [f"`{row['flag'].replace('|', '+')}`"]
        for kind in ("warm", "cold"):
            taken = [row.get(f"{name}_{kind}") for name in names]
            cells += [f"{1e3 / ms:.1f}" if ms else "fails" for ms in taken]
            ratio = row[f"ratio_{kind}"]
            cells.append(f"{ratio:.1f}" if ratio else "")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def arguments(given: Sequence[str] | None) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.pyrender_beside", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--python", default=os.environ.get("PYRENDER_PYTHON"),
                        help="interpreter of the original; default: $PYRENDER_PYTHON")  # fmt: skip
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="may be repeated")
    parser.add_argument("--flag", action="append", help="may be repeated; parts joined by |")
    parser.add_argument("--rounds", type=int, default=5, help="of times; 0: pictures alone")
    parser.add_argument("--only-times", action="store_true")
    parser.add_argument("--page", action="store_true",
                        help="only the times that docs/coming_from/pyrender.md tells")  # fmt: skip
    parser.add_argument("--to", type=Path, default=Path(__file__).parents[1] / "results/pyrender",
                        help="folder for tables and a sheet for each flag")  # fmt: skip
    found = parser.parse_args(given)
    if not found.python:
        parser.error("--python or PYRENDER_PYTHON must name an interpreter that has pyrender")
    return found


def main(given: Sequence[str] | None = None) -> int:
    """Compare, write tables and sheets, and return 1 if a picture misses a mark."""
    asked = arguments(given)
    flags = asked.flag or (PAGE_FLAGS if asked.page else FLAGS)
    scenes = asked.scene or list(SCENES)
    asked.to.mkdir(parents=True, exist_ok=True)
    is_good = True
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        contestants = []
        for name in ("egl", "osmesa", "rasterjit"):
            python = sys.executable if name == "rasterjit" else asked.python
            one = Contestant(name, python)
            stack.callback(one.close)
            if one.module is None:
                print(f"{name} does not start", file=sys.stderr)
            else:
                contestants.append(one)
        by_name = {one.name: one for one in contestants}
        if not (asked.only_times or asked.page):
            rows = []
            for row in pictures(by_name["egl"], by_name["rasterjit"], scenes, flags, Path(folder)):
                rows.append(row)
                print(f"{row['flag']:22} {row['scene']:18} {verdict(row)}", flush=True)
            for flag in flags:
                draw_sheet(
                    [r for r in rows if r["flag"] == flag],
                    asked.to / f"{flag.replace('|', '+')}.png",
                )
            (asked.to / "pictures.md").write_text(table_of_pictures(rows) + "\n")
            met = [is_met(row) for row in rows]
            print(f"marks of pictures hold in {sum(met)} of {len(met)}")
            is_good &= all(met)
        if asked.rounds:
            timed = list(times(contestants, flags, asked.rounds))
            text = table_of_times(timed)
            (asked.to / "times.md").write_text(text + "\n")
            print(text)
            slow = [row["flag"] for row in timed if (row["ratio_warm"] or FASTER) < FASTER]
            if slow:
                print(f"less than {FASTER:g} times as fast, kept: {', '.join(slow)}")
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
