"""Which cells the map has, and what was measured of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

SIZES = ((64, 64), (128, 128), (256, 256), (512, 512), (1280, 720), (1920, 1080))
FACES = (200, 1_000, 5_000, 20_000, 70_000, 300_000, 1_000_000)
LOOKS = ("colors", "phong", "texture")
FAMILIES = ("knot", "terrain", "boxes")

IN_CODES = "codes"
"""The look of textures that RasterJIT mixes in 8-bit codes, as peers do; measured if asked for."""

TITLES = {
    "colors": "unlit colours", "phong": "Phong", "texture": "bilinear texture",
    IN_CODES: "bilinear texture, 8-bit codes",
}  # fmt: skip

OWN, LLVMPIPE, TINYDISPLAY = "rasterjit", "opengl", "tinydisplay"
PEERS = (LLVMPIPE, TINYDISPLAY)


class Cell(NamedTuple):
    """What is drawn: a family's mesh of about so many faces, in a look, in a picture of a size."""

    family: str
    faces: int
    look: str
    size: tuple[int, int]

    def __str__(self) -> str:
        return f"{faces_text(self.faces)} {self.family} {self.look} {size_text(self.size)}"


SLIVERS = Cell("slivers", 200_000, "colors", (1920, 1080))
"""Outside the map, but with a mark of its own."""


@dataclass
class Run:
    """What was measured of a contestant in a cell, or why nothing was."""

    contestant: str
    threads: int
    instructions: str
    """``"native"``, ``"avx2"``, or empty: the same in both."""
    missing: str | None = None
    ms: list[float] = field(default_factory=list)
    """Of a picture, in each round."""
    cpu_ms: list[float] = field(default_factory=list)
    batch_ms: list[float] = field(default_factory=list)
    """Of a view of ``render_batch``, in each round; empty where that was not tried."""
    stages: dict[str, float] = field(default_factory=dict)
    """Milliseconds of a picture in each of RasterJIT's stages."""
    check: str = ""
    """How the picture compares with the reference."""

    @property
    def seat(self) -> tuple[str, int, str]:
        """Who it is."""
        return self.contestant, self.threads, self.instructions


@dataclass
class Measured:
    """A cell with its runs."""

    cell: Cell
    runs: list[Run]

    def find(self, contestant: str, threads: int, instructions: str) -> Run | None:
        """Return the run of a contestant that counts for threads and instructions, with times."""
        for run in self.runs:
            fits = run.threads == threads or contestant == TINYDISPLAY
            if run.contestant == contestant and fits and run.instructions in (instructions, ""):
                return run if run.missing is None and run.ms else None
        return None

    def add(self, more: Measured) -> None:
        """Add the rounds of the same cell measured again; what failed then is missing now."""
        for again in more.runs:
            run = next((each for each in self.runs if each.seat == again.seat), None)
            if run is None or run.missing is not None:
                continue
            if again.missing is not None:
                run.missing = again.missing
                continue
            share = len(again.ms) / (len(run.ms) + len(again.ms))
            for name, ms in again.stages.items():
                run.stages[name] = (1.0 - share) * run.stages.get(name, 0.0) + share * ms
            run.ms += again.ms
            run.cpu_ms += again.cpu_ms
            run.batch_ms += again.batch_ms


def choose(
    sizes: Sequence[tuple[int, int]] = SIZES,
    faces: Sequence[int] = FACES,
    looks: Sequence[str] = LOOKS,
    families: Sequence[str] = FAMILIES,
    *,
    with_slivers: bool = False,
) -> list[Cell]:
    """
    Return the cells, those of one mesh together, so that it is made once.

    Slivers come first: they have marks of their own, and a map may end before its last cells.
    """
    found = [
        Cell(family, count, look, size)
        for family in families
        for count in faces
        for look in looks
        for size in sizes
    ]
    return [SLIVERS] * with_slivers + found


def faces_text(count: int) -> str:
    """Return a number of faces as short text."""
    for scale, unit in ((1_000_000, " M"), (1_000, " k")):
        if count >= scale:
            return f"{count / scale:g}{unit}"
    return str(count)


def size_text(size: tuple[int, int]) -> str:
    """Return a size in pixels as text."""
    return f"{size[0]}²" if size[0] == size[1] else f"{size[0]}×{size[1]}"
