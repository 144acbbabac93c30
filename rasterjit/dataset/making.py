"""Make a data set: find the meshes, leave out what is done, share the rest, and say what failed."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rasterjit.dataset import crews
from rasterjit.dataset.lock import LOCK, owned
from rasterjit.dataset.mesh import DONE, PARTIAL, Made, make_mesh, write_json
from rasterjit.dataset.recipe import Recipe
from rasterjit.io.folders import existing_folder, mesh_files
from rasterjit.scene.validation import (
    in_short,
    whole_number,
)

SETTINGS = "dataset.json"
"""The file that says how a data set is made."""

FAILURES = "failures.json"
"""The file that says which meshes could not be rendered, and why."""

MOST_WORKERS = 256


@dataclass(frozen=True)
class Outcome:
    """
    What became of a mesh.

    Attributes
    ----------
    name : str
        Of its file, below the folder of meshes, with ``/``.
    failure : str or None
        Why it could not be read or rendered.
    warnings : tuple of str
        What reading and rendering it warned of, a line each; of a view with its number.
    """

    name: str
    failure: str | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Summary:
    """
    What became of all meshes.

    Attributes
    ----------
    made : int
        Meshes rendered now.
    present : int
        Meshes that were done before.
    failures : dict of str to str
        Why some could not be, by name, in order.
    warnings : dict of str to tuple of str
        What there was to warn of, by name, in order; nothing of meshes that were done before.
    """

    made: int
    present: int
    failures: dict[str, str]
    warnings: dict[str, tuple[str, ...]] = field(default_factory=dict)


def make(
    folder: str | Path,
    output: str | Path,
    recipe: Recipe | None = None,
    *,
    workers: int | str = 1,
    report: Callable[[Outcome, int, int], None] | None = None,
) -> Summary:
    """
    Render every mesh file below a folder from all sides.

    Each mesh gets the folder ``output / <its path>``, with a ``transforms.json``: intrinsics, and
    for each view its files and ``transform_matrix``, from the camera's axes (x right, y up, z
    backwards) to the mesh's own. Neither units nor axes of a mesh are changed: its cameras are
    fitted to it. Depth is ``integer_depth_scale`` times the code in the PNG, in the units of the
    mesh along the viewing axis, and nothing is at code 0.

    What is done is left as it is, so that a data set that was interrupted is gone on with; it then
    has the same bytes as one that was not. Meshes that cannot be read or rendered are listed in
    ``failures.json``, and tried again next time.

    Parameters
    ----------
    folder : str or Path
        Where the meshes are.
    output : str or Path
        An empty folder, a new one, or that of a data set made with the same recipe.
    recipe : Recipe, optional
        Default ``Recipe()``.
    workers : int or str
        How many processes share the work; or the address of a Dask scheduler, such as
        ``"tcp://host:8786"``, whose workers see the same files. The bytes are the same for any.
        With more than one process, a script must keep its own work under
        ``if __name__ == "__main__"``.
    report : callable, optional
        Called with each mesh's outcome, how many have one, and how many will.

    Raises
    ------
    ValueError
        If an argument is wrong, there is no mesh, ``output`` holds something else, or another run
        is writing to it. No folder is made then, nor where Dask is missing.
    ImportError
        If a scheduler is given and the extra ``rasterjit[distributed]`` is not installed.
    LostWorkersError
        If worker processes die or a scheduler does not answer.
    OSError
        If a file cannot be written, as on a full disk.

    Notes
    -----
    Whatever is raised, and on Ctrl-C: what was done is whole, and what was not is not there.
    """
    recipe = Recipe() if recipe is None else recipe
    if not isinstance(recipe, Recipe):
        raise ValueError(f"recipe must be a Recipe, got {in_short(recipe)}")
    crew = _crew(workers)
    source = existing_folder("folder", folder)
    place = _checked_output(output, source)
    names = {file.relative_to(source).as_posix(): file for file in mesh_files(source)}
    names = {name: file for name, file in names.items() if not file.is_relative_to(place)}
    if not names:
        raise ValueError(f"folder must hold mesh files, got none in {str(source)!r}")
    if report is not None and not callable(report):
        raise ValueError(f"report must be a function, got {in_short(report)}")
    _check_settings(place, recipe)
    place.mkdir(parents=True, exist_ok=True)
    with owned(place):
        _begin(place, recipe)
        return _make_all(names, place, recipe, crew, report)


def _make_all(
    names: dict[str, Path],
    place: Path,
    recipe: Recipe,
    crew: Callable[..., Iterator[tuple[Any, Made]]],
    report: Callable[[Outcome, int, int], None] | None,
) -> Summary:
    """Render the meshes that are not done, and list those that fail."""
    todo = [name for name in names if not (place / name / DONE).is_file()]
    jobs = [(names[name], name, place, recipe) for name in todo]
    results: dict[str, Made] = {}
    # Closing it lets the workers go, whatever happens here.
    with closing(crew(make_mesh, jobs)) as done:
        for number, (job, made) in enumerate(done, start=1):
            results[job[1]] = made
            if report is not None:
                report(Outcome(job[1], *made), number, len(todo))
    in_order = {name: results[name] for name in todo if name in results}
    failures = {name: made.failure for name, made in in_order.items() if made.failure is not None}
    warned = {name: made.warnings for name, made in in_order.items() if made.warnings}
    _list_failures(place, failures)
    return Summary(len(todo) - len(failures), len(names) - len(todo), failures, warned)


def _crew(workers: Any) -> Callable[..., Iterator[tuple[Any, Made]]]:
    """Return who does the work, or raise ``ValueError``."""
    if isinstance(workers, str):
        if "://" not in workers:
            raise ValueError(
                f"workers must be a number, or an address such as tcp://host:8786, got {workers!r}"
            )
        crews.need_dask()
        return lambda task, jobs: crews.run_on_dask(task, jobs, workers)
    count = whole_number("workers", workers, 1, MOST_WORKERS)
    if count == 1:
        return crews.run_here
    return lambda task, jobs: crews.run_in_processes(task, jobs, count)


def _checked_output(output: Any, source: Path) -> Path:
    """Return the full path of the folder to write to, or raise ``ValueError``."""
    if not isinstance(output, (str, os.PathLike)):
        raise ValueError(f"output must be a folder, got {in_short(output)}")
    place = Path(output).resolve()
    if place == source or source.is_relative_to(place):
        raise ValueError(f"output must not hold the meshes, got {str(output)!r}")
    if place.exists() and not place.is_dir():
        raise ValueError(f"output must be a folder, but {str(output)!r} is a file")
    is_full = place.is_dir() and any(not one.name.startswith(LOCK) for one in place.iterdir())
    if is_full and not (place / SETTINGS).is_file():
        raise ValueError(f"output must be empty or a data set, but {str(output)!r} holds files")
    return place


def _begin(place: Path, recipe: Recipe) -> None:
    """Note how the data set is made, or see that it is the same; clear away what was not ended."""
    wanted = _check_settings(place, recipe)
    if not (place / SETTINGS).is_file():
        write_json(place / SETTINGS, wanted)
    for leftover in place.glob(f"{PARTIAL}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def _check_settings(place: Path, recipe: Recipe) -> dict[str, Any]:
    """Return how the data set is to be made; raise ``ValueError`` if it was made otherwise."""
    # Importing the package by name would make all of it something that this module needs.
    version = sys.modules["rasterjit"].__version__
    wanted = {"rasterjit": version, **recipe.describe()}
    settings = place / SETTINGS
    if settings.is_file():
        try:
            found = json.loads(settings.read_text(encoding="utf-8"))
            changed = sorted(k for k in {*found, *wanted} if found.get(k) != wanted.get(k))
        except (ValueError, TypeError) as error:
            raise ValueError(f"output has a {SETTINGS} that cannot be read: {error}") from None
        if changed:
            shown = ", ".join(f"{k} {found.get(k)!r}, not {wanted.get(k)!r}" for k in changed)
            raise ValueError(f"output holds a data set made otherwise: {shown}")
    return wanted


def _list_failures(place: Path, failures: dict[str, str]) -> None:
    """Write why meshes failed; no file if none did."""
    if not failures:
        (place / FAILURES).unlink(missing_ok=True)
        return
    listed = [{"file": name, "reason": reason} for name, reason in failures.items()]
    write_json(place / FAILURES, listed)
