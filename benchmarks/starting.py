"""
``python -m benchmarks startup``: how long it is to an import, and to a first picture.

Each figure is a fresh process, from starting it to its end. RasterJIT runs from this clone, from
wheels (with all that they ask for, and bare: without Numba), and from another version, if these are
given; F3D, PyVista, moderngl and Panda3D by the programs in ``starters/``. All draw the same teapot
from the same place, in turns. With ``--install``, the time from ``pip install`` to a first picture
is measured as well, in environments made for it, from packages that were downloaded before.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from PIL import Image
from rich.console import Console

from benchmarks import report
from benchmarks.checkouts import RevisionError, checkouts
from benchmarks.pairing import CACHES, ROOT, package_environment
from benchmarks.scenes import TEAPOT
from benchmarks.startup import SIZE, children_seconds, in_style

STARTERS = Path(__file__).parent / "starters"
RESULT = report.RESULTS / "startup.json"
VIEW = {
    "model": str(TEAPOT), "size": SIZE, "eye": (4.0, 5.0, 9.0), "target": (0.0, 1.5, 0.0),
    "fov_y": 40.0,
}  # fmt: skip

IMPORT, API, COMMAND, INSTALL = "import", "API", "command", "install"
PARTS = (IMPORT, API, COMMAND)
"""Measured in each round; an installation is measured once."""

MESA_CACHE = "MESA_SHADER_CACHE_DIR"
"""Where OpenGL keeps compiled shaders."""
NO_BYTECODE = "PYTHONDONTWRITEBYTECODE"
"""With it a clone would be compiled to bytecode in each process, what pip installs would not."""
LONGEST_SECONDS = 300.0
ALIKE = 0.97
"""Share of pixels that programs with the same camera cover or leave empty alike."""
SHOWN = (0.02, 0.9)
"""Shares of a command's picture, whose camera may be its own, that show something."""

COLUMNS = (
    "who", "import, s", "API, s", "command, s", "first API, s", "first command, s",
    "installed, MB", "pip install and API, s", "remarks",
)  # fmt: skip

CODE = {".so", ".dll", ".dylib", ".xz"}
"""Suffixes of files in a wheel that hold machine code or LLVM's text."""

progress = Console(stderr=True)


@dataclass(frozen=True)
class Starter:
    """Who starts, and how."""

    name: str
    python: str
    """The interpreter of the environment that it is installed in."""
    module: str
    """What it imports; empty: nothing."""
    program: Path | None = None
    """Draws by the API."""
    command: Callable[[str, str], list[str] | None] | None = None
    """Given the interpreter and the picture, the command line that draws; None: it has none."""
    environment: dict[str, str] = field(default_factory=dict)
    has_camera: bool = False
    """Whether the command line is told the camera."""
    packages: tuple[str, ...] = ()
    """What pip installs for its program; empty: it is not measured."""
    installed_bytes: int | None = None
    """What pip added to a new environment; None if the environment is another one."""

    def line(self, part: str, picture: Path) -> list[str] | None:
        """Return the command line of a part; ``None`` if there is none."""
        if part == IMPORT:
            return [self.python, "-c", f"import {self.module}" if self.module else "pass"]
        if part == API:
            view = json.dumps({**VIEW, "picture": str(picture)})
            return self.program and [self.python, str(self.program), view]
        return self.command and self.command(self.python, str(picture))


@dataclass
class Found:
    """What was measured of a starter."""

    name: str
    first: dict[str, float] = field(default_factory=dict)
    """Seconds of the very first process, which found no compiled code, by part."""
    seconds: dict[str, list[float]] = field(default_factory=dict)
    """Of those after it."""
    processor: dict[str, list[float]] = field(default_factory=dict)
    installed_bytes: int | None = None
    remarks: dict[str, str] = field(default_factory=dict)
    """Why a part has no times."""

    def median(self, part: str) -> str:
        """Return the seconds of a part as text."""
        return f"{statistics.median(self.seconds[part]):.2f}" if self.seconds.get(part) else ""


def render_line(python: str, picture: str) -> list[str]:
    """Return RasterJIT's command line."""
    eye, target = (",".join(map(str, VIEW[name])) for name in ("eye", "target"))
    return [
        python, "-m", "rasterjit", "render", str(TEAPOT), "-o", picture,
        "--size", "x".join(map(str, SIZE)), f"--position={eye}", f"--target={target}",
        f"--fov={VIEW['fov_y']}",
    ]  # fmt: skip


def plain_line(python: str, picture: str) -> list[str]:
    """Return the same of versions that have styles."""
    return [*render_line(python, picture), *in_style(ROOT, "plain")]


def f3d_line(python: str, picture: str) -> list[str] | None:
    """Return F3D's command line; its package has none, other ways to install it have."""
    program = shutil.which("f3d", path=beside(python))
    eye, target = (",".join(map(str, VIEW[name])) for name in ("eye", "target"))
    return program and [
        program, str(TEAPOT), "--output", picture, "--no-config",
        "--resolution", ",".join(map(str, SIZE)), f"--camera-position={eye}",
        f"--camera-focal-point={target}", f"--camera-view-angle={VIEW['fov_y']}",
    ]  # fmt: skip


def pyvista_line(python: str, picture: str) -> list[str] | None:
    """Return PyVista's command line, whose camera is its own."""
    program = shutil.which("pyvista", path=beside(python))
    return program and [
        program, "plot", str(TEAPOT), "--off-screen", "--screenshot", picture,
        "--window-size", *map(str, SIZE),
    ]  # fmt: skip


def beside(python: str) -> str:
    """Return where programs of an interpreter's environment are looked for."""
    return os.pathsep.join([str(Path(python).parent), os.environ.get("PATH", os.defpath)])


PEERS: dict[str, tuple[str, str, Callable[[str, str], list[str] | None] | None, bool]] = {
    "f3d": ("F3D", "f3d", f3d_line, True),
    "pyvista": ("PyVista", "pyvista", pyvista_line, False),
    "moderngl": ("moderngl", "moderngl", None, False),
    "panda3d": ("Panda3D tinydisplay", "panda3d.core", None, False),
}
"""By key, also of ``--python`` and of the file in ``starters/``: name, module, command, camera."""

PACKAGES = {
    "f3d": ("f3d",), "pyvista": ("pyvista",), "moderngl": ("moderngl", "numpy", "pillow"),
    "panda3d": ("panda3d",),
}  # fmt: skip
"""What pip installs for the program of a peer."""


class Environment(click.ParamType):
    """A peer and the interpreter of the environment that it is installed in."""

    name = "peer"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str]:
        """Return both."""
        key, _, python = str(value).partition("=")
        if key not in PEERS:
            self.fail(f"{key!r} is no peer; possible are {', '.join(PEERS)}", param, ctx)
        if not os.access(python, os.X_OK) or Path(python).is_dir():
            self.fail(
                f"{python!r} is no program; expected {key}=ENVIRONMENT/bin/python", param, ctx
            )
        return key, python


@click.command()
@click.option(
    "--rounds", default=5, show_default=True, type=click.IntRange(1, 1000),
    help="Processes of each, after the first.",
)  # fmt: skip
@click.option(
    "--python", "pythons", multiple=True, type=Environment(), metavar="PEER=PROGRAM",
    help="The interpreter of the environment that a peer is installed in, such as "
    "f3d=env/bin/python; may be repeated.  [default: this one]",
)  # fmt: skip
@click.option(
    "--wheel", "wheels", multiple=True, metavar="FILE",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A wheel, which pip installs in new environments, with what it asks for and, if it "
    "brings code, without Numba; may be repeated.  [default: the newest for this machine in dist/, "
    "if any]",
)  # fmt: skip
@click.option("--against", metavar="COMMIT", help="A commit, which is measured as well.")
@click.option(
    "--install",
    is_flag=True,
    help="Measure once, too, what the wheel and the peers take from pip install, in a new "
    "environment, to a first picture.",
)
@click.option(
    "--results", default=RESULT, show_default=False, help="The file of results.",
    type=click.Path(dir_okay=False, path_type=Path),
)  # fmt: skip
def startup(
    rounds: int, pythons: tuple[tuple[str, str], ...], wheels: tuple[Path, ...],
    against: str | None, install: bool, results: Path,
) -> None:  # fmt: skip
    """Measure fresh processes: an import, and a first picture by API and by command line."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        try:
            starters, left_out = entrants(folder, stack, dict(pythons), wheels, against)
        except RevisionError as error:
            raise click.BadParameter(str(error), param_hint="--against") from error
        found = measure(starters, rounds, folder)
        if install:
            measure_installing(starters, found, folder)
    rows = [row_of(each) for each in found]
    report.print_table("From starting a process to its end", COLUMNS, rows)
    for name, reason in left_out.items():
        progress.print(f"left out: {name}: {reason}", markup=False)
    content = {
        "machine": report.machine(), "left_out": left_out, "found": list(map(asdict, found)),
    }  # fmt: skip
    report.write_text(results, json.dumps(content, indent=2) + "\n")
    wrong = [each for each in found if "RasterJIT" in each.name and each.remarks]
    wrong += [each for each in found if any("picture" in one for one in each.remarks.values())]
    if wrong:
        sys.exit(1)


def entrants(
    folder: Path,
    stack: ExitStack,
    pythons: dict[str, str],
    wheels: Sequence[Path],
    against: str | None,
) -> tuple[list[Starter], dict[str, str]]:
    """Return who starts, and why others are left out; raise `RevisionError` for no commit."""
    here = package_environment({})
    own = STARTERS / "rasterjit_.py"
    found = [
        Starter("Python alone", sys.executable, ""),
        Starter("NumPy alone", sys.executable, "numpy"),
        Starter(
            "RasterJIT, clone", sys.executable, "rasterjit", own, plain_line, here, True
        ),
    ]  # fmt: skip
    left_out = {}
    if against is not None:
        ((name, place),) = stack.enter_context(checkouts([against], folder))
        there = package_environment({}, place)
        line = plain_line if in_style(place, "plain") else render_line
        found.append(
            Starter(f"RasterJIT, {name}", sys.executable, "rasterjit", own, line, there, True)
        )
    newest = newest_wheel(ROOT / "dist")
    if not wheels and newest is not None:
        wheels = [newest]
    if not wheels:
        left_out["RasterJIT, wheel"] = "no wheel for this machine in dist/, and no --wheel"
    for wheel, packages in ((one, some) for one in wheels for some in package_choices(one)):
        tag = wheel.stem.rpartition("-")[2].partition(".")[0]
        name = f"RasterJIT, {wheel.resolve().parent.name}/{tag}" + ", bare" * bool(packages)
        place = Path(tempfile.mkdtemp(prefix="wheel", dir=folder))
        try:
            python, size = install_in_new(place, str(wheel.resolve()), packages)
        except subprocess.CalledProcessError as error:
            left_out[name] = f"pip failed: {last_line(error.stderr)}"
            continue
        fetched = () if packages else (str(wheel.resolve()),)
        found.append(
            Starter(name, python, "rasterjit", own, plain_line, {}, True, fetched, size)
        )  # fmt: skip
    for key, (name, module, command, has_camera) in PEERS.items():
        python = pythons.get(key, sys.executable)
        if not is_installed(python, module):
            left_out[name] = (
                f"the package {key} is not installed: pip install {key}, or in another "
                f"environment, with --python {key}=ENVIRONMENT/bin/python"
            )
            continue
        software = {"LIBGL_ALWAYS_SOFTWARE": "true"}
        program = STARTERS / f"{key}_.py"
        packages = PACKAGES[key]
        found.append(
            Starter(name, python, module, program, command, software, has_camera, packages)
        )
    return found, left_out


def newest_wheel(folder: Path) -> Path | None:
    """Return the newest wheel with machine code for this machine in a folder, if there is one."""
    wheels = folder.glob(f"rasterjit-*_{platform.machine().lower()}.whl")
    return max(wheels, key=lambda path: path.stat().st_mtime, default=None)


def new_environment(place: Path) -> str:
    """Make an environment; return its interpreter."""
    subprocess.run(
        [sys.executable, "-m", "venv", str(place)], check=True, capture_output=True, text=True
    )
    return str(place / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))


def install_in_new(place: Path, wheel: str, packages: Sequence[str]) -> tuple[str, int]:
    """
    Install a wheel in a new environment.

    Parameters
    ----------
    place : Path
        The folder of the environment.
    wheel : str
    packages : sequence of str
        What to install instead of its dependencies; empty: these.

    Returns
    -------
    python : str
        The interpreter.
    size : int
        Bytes that pip added.
    """
    progress.print(f"installing {wheel} ...")
    python = new_environment(place)
    before = size_of(place)
    if packages:
        run_pip(python, "install", *packages)
    run_pip(python, "install", *(["--no-deps"] if packages else []), wheel)
    return python, size_of(place) - before


def size_of(folder: Path) -> int:
    """Return the bytes of the files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def package_choices(wheel: Path) -> list[tuple[str, ...]]:
    """Return what to install a wheel with: what it asks for, and the least, if it brings code."""
    brings_code = False
    if zipfile.is_zipfile(wheel):
        with zipfile.ZipFile(wheel) as archive:
            brings_code = any(Path(name).suffix in CODE for name in archive.namelist())
    least = ("numpy", "pillow", "click", *(["llvmlite"] if wheel.name.endswith("-any.whl") else []))
    return [(), least] if brings_code else [()]


def run_pip(python: str, *arguments: str) -> None:
    """Run pip; raise `subprocess.CalledProcessError` with what it says if it fails."""
    subprocess.run(
        [python, "-m", "pip", "-q", "--disable-pip-version-check", *arguments],
        check=True, capture_output=True, text=True,
    )  # fmt: skip


def measure_installing(starters: Sequence[Starter], found: Sequence[Found], folder: Path) -> None:
    """
    Time each program once from ``pip install`` to its picture, in a new environment.

    What pip installs is downloaded before: networks differ.
    """
    for place, (starter, each) in enumerate(zip(starters, found, strict=True)):
        if not starter.packages or starter.program is None:
            continue
        progress.print(f"installing for {starter.name} ...")
        downloads, picture = folder / f"{place}-downloads", folder / f"{place}-installed.png"
        try:
            python = new_environment(folder / f"{place}-environment")
            run_pip(python, "download", "-d", str(downloads), *starter.packages)
            line = replace(starter, python=python).line(API, picture)
            started = time.perf_counter()
            run_pip(
                python, "install", "--no-index", "--find-links", str(downloads), *starter.packages
            )
            took = time.perf_counter() - started
            each.first[INSTALL] = took + time_line(line or [], starter, folder / f"{place}-new")[0]
            check(picture, [], has_camera=False)
        except (OSError, subprocess.SubprocessError, ValueError) as error:
            each.first.pop(INSTALL, None)
            each.remarks[INSTALL] = why(error)


def is_installed(python: str, module: str) -> bool:
    """Tell whether an environment has a module; it is not imported, its package may be."""
    code = f"import importlib.util as u, sys; sys.exit(u.find_spec({module!r}) is None)"
    return subprocess.run([python, "-c", code], capture_output=True, check=False).returncode == 0


def measure(starters: Sequence[Starter], rounds: int, folder: Path) -> list[Found]:
    """
    Start all of them in turns, each part with folders of its own for compiled code.

    A part that fails, or whose picture is wrong, is left out of the rounds that follow.
    """
    found = [Found(each.name, installed_bytes=each.installed_bytes) for each in starters]
    reference: list[Any] = []
    for number in range(rounds + 1):
        progress.print(f"round {number} of {rounds}" if number else "first processes")
        for place, (starter, each) in enumerate(zip(starters, found, strict=True)):
            for part in PARTS:
                picture = folder / f"{place}-{part}.png"
                line = starter.line(part, picture)
                if line is None or part in each.remarks:
                    continue
                try:
                    wall, processor = time_line(line, starter, folder / f"{place}-{part}")
                    if part != IMPORT and number == 0:
                        check(picture, reference, part == API or starter.has_camera)
                except (OSError, subprocess.SubprocessError, ValueError) as error:
                    each.remarks[part] = why(error)
                    each.seconds.pop(part, None)
                    continue
                if number == 0:
                    each.first[part] = wall
                else:
                    each.seconds.setdefault(part, []).append(wall)
                    each.processor.setdefault(part, []).append(processor)
    return found


def time_line(line: Sequence[str], starter: Starter, cache: Path) -> tuple[float, float]:
    """Run a command; return its seconds by the wall clock, and of the processor."""
    cache.mkdir(exist_ok=True)
    caches = dict.fromkeys((*CACHES, MESA_CACHE), str(cache))
    environment = {**os.environ, **starter.environment, **caches}
    environment.pop(NO_BYTECODE, None)
    if not starter.environment.get("PYTHONPATH"):
        environment.pop("PYTHONPATH", None)
    started, processor = time.perf_counter(), children_seconds()
    subprocess.run(
        line, check=True, capture_output=True, text=True, cwd=cache, env=environment,
        timeout=LONGEST_SECONDS,
    )  # fmt: skip
    return time.perf_counter() - started, children_seconds() - processor


def check(picture: Path, reference: list[Any], has_camera: bool) -> None:
    """
    Raise ``ValueError`` for a picture that is no teapot.

    The first one, of RasterJIT, becomes the reference. Whose camera is its own shows something.
    """
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB")).astype(np.int16)
    if pixels.shape != (SIZE[1], SIZE[0], 3):
        raise ValueError(f"the picture is {pixels.shape[1]}x{pixels.shape[0]}")
    # Backgrounds may have a gradient, from row to row.
    covered = (np.abs(pixels - pixels[:, :1]) > 2).any(axis=2)
    if not SHOWN[0] < covered.mean() < SHOWN[1]:
        raise ValueError(f"the picture shows something at {covered.mean():.1%} of its pixels")
    if not reference:
        reference.append(covered)
    share = float((covered == reference[0]).mean())
    if has_camera and share < ALIKE:
        raise ValueError(f"the picture differs: covered {share:.1%}")


def why(error: Exception) -> str:
    """Return why a part has no times, in a line."""
    if isinstance(error, subprocess.CalledProcessError):
        return f"failed: {last_line(error.stderr)}"
    if isinstance(error, subprocess.TimeoutExpired):
        return f"failed: it took longer than {error.timeout:g} s"
    return str(error)


def last_line(text: str) -> str:
    """Return the last line that says something."""
    return next(
        (line.strip() for line in reversed(text.splitlines()) if line.strip()), "no message"
    )


def row_of(found: Found) -> list[str]:
    """Return a starter's row of the table."""
    return [
        found.name, *map(found.median, PARTS),
        *(
            f"{found.first[part]:.2f}" if part in found.first else ""
            for part in (API, COMMAND)
        ),
        "" if found.installed_bytes is None else f"{found.installed_bytes / 1e6:.0f}",
        f"{found.first[INSTALL]:.2f}" if INSTALL in found.first else "",
        "; ".join(f"{part}: {remark}" for part, remark in found.remarks.items()),
    ]  # fmt: skip
