"""
``python -m benchmarks.soak --minutes 10``: changing scenes for long, and whether anything grows.

Cases come from a seed: a scene of our own or from a file, with materials and effects, in some size
and quality. Each is drawn again and again, each time in another way: by a renderer that is kept or
a fresh one, with one thread or several, alone or while another thread draws another case, after
frames that were called off. Its bits must be those of the first time.

Now and then all renderers are closed, and memory, descriptors, threads and processes are counted.
What is counted late may not exceed what was counted early, once each case was drawn. Growth and
changed bits end this with status 1.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import hashlib
import os
import random
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.table import Table

import rasterjit as rj
from benchmarks import meshes
from benchmarks.compiling_worker import checks, effects
from benchmarks.memory import resident
from benchmarks.pairing import ROOT

MODELS = ("scene.glb", "teapot.obj", "torus_knot.obj", "cube.ply", "pyramid.off")

SIZES = ((64, 48), (160, 120), (320, 200), (333, 77))

QUALITIES: tuple[dict[str, Any], ...] = (
    {}, {}, {"samples": 4}, {"samples": 16}, {"samples": "area"}, {"shading": "vertex"},
    {"precision": "float32"}, {"texture_filter": "trilinear"}, {"depth_format": "unorm24"},
)  # fmt: skip

OUTPUTS = (("color",), ("color", "depth", "face_id"), ("depth", "normal"), ("linear", "object_id"))

THREADS = (1, 2, 3)

SETTLED = 3
"""Samples are compared in as many parts: the first with the last."""

MAX_ARENAS = -8
"""What glibc's mallopt calls the number of its heaps (M_ARENA_MAX)."""

QUIET = 1.0
"""Seconds in which threads that are let go must end."""

KINDS = ("memory, MB", "descriptors", "threads", "processes")

SLACK = {"memory, MB": 8.0}
"""What may be gained without a leak: allocators keep some of what they were once given."""


class Sample(NamedTuple):
    """What the process holds while nothing is drawn."""

    pictures: int
    """Drawn until then."""
    held: dict[str, float]
    """By kind."""


class Growth(NamedTuple):
    """How much is held early and late, of one kind: the most, and the least."""

    early: float
    late: float
    slack: float

    @property
    def is_fault(self) -> bool:
        """Whether all that was counted late exceeds all that was counted early."""
        return self.late - self.early > self.slack


def growth(samples: Sequence[Sample], settled: int) -> dict[str, Growth]:
    """
    Return how much more is held late than early, by kind.

    Parameters
    ----------
    samples : sequence of Sample
    settled : int
        The first that counts; earlier ones where fewer than three would be left.
    """
    chosen = samples[min(settled, max(len(samples) - SETTLED, 0)) :]
    part = max(len(chosen) // SETTLED, 1)
    return {
        kind: Growth(
            max(one.held[kind] for one in chosen[:part]),
            min(one.held[kind] for one in chosen[-part:]),
            SLACK.get(kind, 0.0),
        )
        for kind in KINDS
    }


def count_held() -> dict[str, float]:
    """Return what this process holds, once threads that were let go have ended."""
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):
        # What glibc keeps for later differs by tens of megabytes from sample to sample.
        ctypes.CDLL(None).malloc_trim(0)
    end = time.monotonic() + QUIET
    while any(one.name.startswith("rasterjit") for one in threading.enumerate()):
        if time.monotonic() > end:
            break
        time.sleep(0.01)
    return {
        "memory, MB": resident("VmRSS") / 1e6,
        "descriptors": float(len(os.listdir("/proc/self/fd"))),
        "threads": float(threading.active_count()),
        "processes": float(len(_children())),
    }


def use_one_heap() -> None:
    """
    Let all threads share one heap, where the system's allocator is glibc's.

    By default threads have heaps of their own, which come and go with holes in them: memory then
    wanders by tens of megabytes where nothing is lost. With one, it stays the same to the megabyte.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(MAX_ARENAS, 1)


def _children() -> list[int]:
    """Return the processes that this one started and that go on."""
    found = []
    for task in Path("/proc/self/task").iterdir():
        try:
            found += [int(number) for number in (task / "children").read_text().split()]
        except OSError:
            continue
    return found


class Case(NamedTuple):
    """Something to draw."""

    scene: Any
    size: tuple[int, int]
    quality: Any
    options: dict[str, Any]


def make_case(seed: int, number: int) -> Case:
    """Return a case, made anew: the same for the same numbers."""
    chance = random.Random(f"{seed} {number}")
    scene = rj.load(ROOT / "models" / chance.choice(MODELS)) if chance.random() < 0.5 else None
    if scene is None:
        scene = _torus_scene(chance)
    for name, (switch_on, _) in effects().items():
        if chance.random() < 0.25 and (name != "transparency" or chance.random() < 0.5):
            switch_on(scene)
    quality = chance.choice(QUALITIES)
    if any(node.mesh.material.alpha_mode == "blend" for node in scene.nodes):
        # Areas are not for what blends.
        quality = {key: value for key, value in quality.items() if value != "area"}
    background = chance.choice([None, "black", "transparent"])
    options = {
        "outputs": chance.choice(OUTPUTS), "background": background,
        "cull": chance.choice(["none", "back"]),
    }  # fmt: skip
    direction = rj.orbit_direction(chance.uniform(0.0, 360.0), chance.uniform(-60.0, 60.0))
    size = chance.choice(SIZES)
    options["camera"] = rj.fit_camera(scene, direction=direction, aspect=size[0] / size[1])
    return Case(scene, size, rj.Quality(**quality), options)


def _torus_scene(chance: random.Random) -> Any:
    """Return a scene of some tori of one mesh, with a material."""
    rings, sides = meshes.torus_size(chance.choice([200, 2_000, 20_000]))
    points, faces = meshes.torus(rings, sides)
    angles = np.stack(meshes.ring_angles(rings, sides), axis=1) / (2.0 * np.pi)
    texture = checks() if chance.random() < 0.4 else None
    material = rj.Material(
        shading=chance.choice(["unlit", "flat", "gouraud", "phong", "pbr"]),
        base_color=tuple(chance.uniform(0.1, 1.0) for _ in range(3)),
        specular=chance.choice([0.0, 0.25]),
        base_color_texture=texture,
    )
    mesh = rj.Mesh(points, faces, uv=angles, material=material)
    scene = rj.Scene()
    for _ in range(chance.randint(1, 4)):
        place = tuple(chance.uniform(-1.0, 1.0) for _ in range(3))
        scene.add(mesh, rj.transforms.translate(place))
    return scene


def digest_of(frame: Any) -> str:
    """Return a hash of all arrays of a frame."""
    digest = hashlib.sha256()
    for name, array in frame.arrays().items():
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array))
    return digest.hexdigest()


class Drawer:
    """
    Draws cases in changing ways.

    Parameters
    ----------
    seed : int
    folder : Path
        Takes pictures that are saved.
    """

    def __init__(self, seed: int, folder: Path) -> None:
        self._seed, self._folder = seed, folder
        self._kept: dict[tuple[tuple[int, int], int], Any] = {}
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="beside")

    def draw(self, number: int, chance: random.Random) -> str:
        """Draw a case in a way that chance decides; return a hash of what came of it."""
        case, threads = make_case(self._seed, number), chance.choice(THREADS)
        way = chance.choice([self._by_kept, self._by_fresh, self._alone, self._with_another])
        frame = way(case, threads, chance)
        if chance.random() < 0.2 and "color" in case.options["outputs"]:
            frame.save(self._folder / "picture.png", "color")
        return digest_of(frame)

    def rest(self) -> None:
        """Let go of all renderers: each holds its threads and the scene that it drew last."""
        while self._kept:
            self._kept.popitem()[1].close()

    def close(self) -> None:
        """End the other thread, too."""
        self.rest()
        self._beside.shutdown()

    def _by_kept(self, case: Case, threads: int, chance: random.Random) -> Any:
        key = case.size, threads
        if key not in self._kept:
            self._kept[key] = rj.Renderer(case.size, threads=threads)
        renderer = self._kept[key]
        renderer.quality = case.quality
        return renderer.render(case.scene, **case.options)

    def _by_fresh(self, case: Case, threads: int, chance: random.Random) -> Any:
        with rj.Renderer(case.size, quality=case.quality, threads=threads) as renderer:
            if chance.random() < 0.3:
                # A frame that is called off, and steps that nobody takes.
                next(renderer.refine(case.scene, case.options["camera"]))
            return renderer.render(case.scene, **case.options)

    def _alone(self, case: Case, threads: int, chance: random.Random) -> Any:
        return rj.render(
            case.scene, size=case.size, quality=case.quality, threads=threads, **case.options
        )

    def _with_another(self, case: Case, threads: int, chance: random.Random) -> Any:
        other = make_case(self._seed, chance.randrange(1 << 30) % 8)
        beside = self._beside.submit(self._alone, other, threads, chance)
        frame = self._alone(case, threads, chance)
        beside.result()
        return frame


class Soak:
    """
    Draws for a time, and notes what changed.

    Parameters
    ----------
    draw : callable
        Given the number of a case and a source of chance, returns the hash of a picture.
    rest : callable
        Called before what is held is counted.
    cases, seed : int
    told : callable, optional
        Called with each sample.
    """

    def __init__(
        self, draw: Callable[[int, random.Random], str], rest: Callable[[], None], cases: int,
        seed: int, told: Callable[[Sample], None] | None = None,
    ) -> None:  # fmt: skip
        self._draw, self._rest, self._cases, self._told = draw, rest, cases, told
        self._chance = random.Random(seed)
        self._hashes: dict[int, str] = {}
        self._again: set[int] = set()
        self.samples: list[Sample] = []
        self.settled = 0
        """The first sample after each case was drawn."""
        self.pictures = self.compared = 0
        self.changed: list[int] = []
        """Cases whose bits were others than the first time."""

    def run(
        self, seconds: float, every: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Draw until a time is over and each case was drawn twice."""
        due = start = clock()
        while (now := clock()) < start + seconds or len(self._again) < self._cases:
            if now >= due:
                self._count()
                due = now + every
            self._next(is_late=now >= start + seconds)
        self._count()

    def _next(self, is_late: bool) -> None:
        known = len(self._hashes)
        is_new = known < self._cases and (not known or is_late or self._chance.random() < 0.5)
        if is_new:
            number = known
        elif is_late:
            number = next(n for n in range(self._cases) if n not in self._again)
        else:
            number = self._chance.randrange(known)
        found = self._draw(number, self._chance)
        self.pictures += 1
        if is_new:
            self._hashes[number] = found
            if len(self._hashes) == self._cases:
                self.settled = len(self.samples)
            return
        self.compared += 1
        self._again.add(number)
        if found != self._hashes[number]:
            self.changed.append(number)

    def _count(self) -> None:
        self._rest()
        self.samples.append(Sample(self.pictures, count_held()))
        if self._told is not None:
            self._told(self.samples[-1])

    def table(self) -> Table:
        """Return what was counted."""
        table = Table(
            title=f"{self.pictures:,} pictures of {self._cases} cases, {self.compared:,} compared "
            f"with the first; changed: {len(self.changed)}"
        )
        for name in ("held at rest", "first", "when each was drawn", "last", "most early",
                     "least late", "grows"):  # fmt: skip
            table.add_column(name, justify="left" if name == "held at rest" else "right")
        settled = self.samples[min(self.settled, len(self.samples) - 1)]
        for kind, grown in growth(self.samples, self.settled).items():
            values = [one.held[kind] for one in (self.samples[0], settled, self.samples[-1])]
            table.add_row(
                kind, *(f"{value:.0f}" for value in (*values, grown.early, grown.late)),
                "YES" if grown.is_fault else "no",
            )  # fmt: skip
        return table

    @property
    def is_fault(self) -> bool:
        """Whether bits changed or something grows."""
        faults = (grown.is_fault for grown in growth(self.samples, self.settled).values())
        return bool(self.changed) or any(faults)


def _tell(sample: Sample) -> None:
    """Print a sample on standard error."""
    held = ", ".join(f"{kind} {value:.0f}" for kind, value in sample.held.items())
    click.echo(f"{sample.pictures} pictures: {held}", err=True)


@click.command()
@click.option("--minutes", type=click.FloatRange(0.0, min_open=True), default=10.0,
              show_default=True, help="At least: each case is drawn twice.")  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True, help="Of all cases.")
@click.option("--cases", type=click.IntRange(1), default=150, show_default=True)
@click.option("--samples", type=click.IntRange(3), default=60, show_default=True,
              help="How many times what is held is counted.")  # fmt: skip
def main(minutes: float, seed: int, cases: int, samples: int) -> None:
    """Draw changing scenes, and tell whether memory, descriptors, threads or bits change."""
    seconds = 60.0 * minutes
    use_one_heap()
    with tempfile.TemporaryDirectory(prefix="rasterjit-soak-") as folder:
        drawer = Drawer(seed, Path(folder))
        soak = Soak(drawer.draw, drawer.rest, cases, seed, _tell)
        try:
            soak.run(seconds, seconds / samples)
        finally:
            drawer.close()
    Console(width=None if sys.stdout.isatty() else 120).print(soak.table())
    for number in sorted(set(soak.changed)):
        click.echo(f"case {number} of seed {seed} changed {soak.changed.count(number)} times")
    sys.exit(soak.is_fault)


if __name__ == "__main__":
    main()
