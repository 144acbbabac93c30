"""Make a data set: find the meshes, leave out what is done, share the rest, and say what failed."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import platform
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rasterjit.dataset.recipe import (
    MANIFEST,
    PARTIAL,
    Cancelled,
    MeshResult,
    Recipe,
    render_mesh_file,
    write_json,
)
from rasterjit.io.meshes import mesh_files
from rasterjit.runtime.locks import Lock, lock, machine
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.validation import existing_folder, in_short, whole_number

LOCK = ".lock"
"""Name of the lock file, in the folder."""

TRIES = 10
"""How often the lock file is made or asked for, while others remove it."""


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """
    Have a folder for oneself.

    Parameters
    ----------
    folder : Path
        An existing folder.

    Raises
    ------
    ValueError
        If another run has it.
    OSError
        If the lock file cannot be written.
    """
    file = folder / LOCK
    try:
        with _taken(file) as held:
            try:
                held.write(_myself().encode())
                yield
            finally:
                if held.is_of(file):
                    held.remove(file)
    except KeyboardInterrupt:
        # It may have come after the file was made, and before that was known.
        _remove_empty(file)
        raise


def _taken(file: Path) -> Lock:
    """Make the lock file, or take one over that is nobody's, or raise ``ValueError``."""
    for _ in range(TRIES):
        is_mine = _created(file)
        try:
            held = lock(file)
        except FileNotFoundError:
            continue
        if held is None:
            break
        # Whoever had it may have removed it meanwhile.
        if not held.is_of(file):
            held.close()
        elif is_mine or (held.is_sure and _is_near(_parsed(held.read()))):
            return held
        else:
            held.close()
            break
    raise _refusal(file)


def _remove_empty(file: Path) -> None:
    """Remove a lock file that nobody has locked or written to."""
    with suppress(OSError):
        held = lock(file)
        if held is not None:
            if held.is_of(file) and not held.read():
                held.remove(file)
            held.close()


def _created(file: Path) -> bool:
    """Make the lock file, unless there is one."""
    try:
        os.close(os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    except FileExistsError:
        return False
    return True


def _refusal(file: Path) -> ValueError:
    """Return the error that says who has the folder."""
    owner = {}
    # Where locks are mandatory, nobody else can read it.
    with suppress(OSError):
        owner = _parsed(file.read_bytes())
    who = f", process {owner['pid']} on {owner['host']}" if {"pid", "host"} <= owner.keys() else ""
    return ValueError(
        f"output is being written by another run{who}: wait until it ends; "
        f"if there is none, remove {str(file)!r}"
    )


def _myself() -> str:
    """Return what a lock file of this process says."""
    return json.dumps({"host": platform.node(), "pid": os.getpid(), "machine": machine()})


def _is_near(owner: dict[str, Any]) -> bool:
    """Tell whether a run that goes on would be seen to hold its lock."""
    names = owner.get("machine")
    return not isinstance(names, list) or any(
        mine == other for mine, other in zip(machine(), names, strict=False)
    )


def _parsed(content: bytes) -> dict[str, Any]:
    """Return what a lock file says; nothing if that is damaged."""
    try:
        owner = json.loads(content.decode("utf-8", "replace"))
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}


Job = tuple[Any, ...]
Task = Callable[..., Any]

AT_HAND = 2
"""Jobs for each worker that are handed out ahead."""

PATIENCE = 10.0
"""Seconds in which a scheduler must answer."""

_calls_off: Any = None
"""In a process of a crew: the event that calls off its work."""


class LostWorkersError(ConnectionError):
    """Those who do the work are gone, or never were there; what is done is whole."""


def run_here(task: Task, jobs: Iterable[Job]) -> Iterator[tuple[Job, Any]]:
    """Do one job after the other; yield each with its result."""
    for job in jobs:
        yield job, task(*job, None)


def run_in_processes(task: Task, jobs: Sequence[Job], count: int) -> Iterator[tuple[Job, Any]]:
    """
    Share jobs among some processes; yield each with its result, in the order they are done.

    When the iterator is closed, or anything is raised, the processes end after the view at hand.
    """
    count = min(count, len(jobs))
    if count == 0:
        return
    context = multiprocessing.get_context("spawn")
    calls_off = context.Event()
    threads = max(1, available_processors() // count)
    waiting, running = iter(jobs), {}
    pool = futures.ProcessPoolExecutor(
        count, mp_context=context, initializer=_follow, initargs=(calls_off,)
    )
    try:
        while True:
            with _interrupts_for_this_process_alone():
                while len(running) < AT_HAND * count and (job := next(waiting, None)) is not None:
                    running[pool.submit(_call, task, (*job, threads))] = job
            if not running:
                return
            done, _ = futures.wait(running, return_when=futures.FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), future.result()
    except BrokenProcessPool:
        raise LostWorkersError(
            "a worker process died, perhaps for want of memory; run again to go on, "
            "with fewer workers"
        ) from None
    finally:
        calls_off.set()
        pool.shutdown(wait=True, cancel_futures=True)


def need_dask() -> Any:
    """Return ``dask.distributed``, or raise ``ImportError`` naming what to install."""
    try:
        from dask import distributed
    except ImportError:
        raise ImportError(
            'a scheduler\'s workers need Dask; pip install "rasterjit[distributed]"'
        ) from None
    return distributed


def run_on_dask(task: Task, jobs: Iterable[Job], address: str) -> Iterator[tuple[Job, Any]]:
    """
    Share jobs among the workers of a Dask cluster, which see the same files under the same paths.

    Yields each job with its result, in the order in which they are done.
    """
    distributed = need_dask()
    try:
        client = distributed.Client(address, timeout=PATIENCE)
    except (OSError, ValueError, asyncio.TimeoutError) as error:
        said = " ".join(str(error).split()).splitlines()
        raise LostWorkersError(
            f"no scheduler answers at {address}" + (f": {said[0]}" if said else "")
        ) from None
    with client:
        # Whatever has been done before is not kept: the files are what counts.
        submitted = {client.submit(task, *job, 1, pure=False): job for job in jobs}
        try:
            for future in distributed.as_completed(list(submitted)):
                yield submitted[future], future.result()
        except (futures.CancelledError, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            raise LostWorkersError(
                f"the scheduler at {address} was lost; run again to go on"
            ) from None
        except distributed.scheduler.KilledWorker:
            raise LostWorkersError(
                f"workers of {address} died, perhaps for want of memory; run again to go on"
            ) from None
        finally:
            if client.status == "running":
                client.cancel(list(submitted), force=True)


def _follow(calls_off: Any) -> None:
    """Prepare a process of a crew: Ctrl-C is for the one who gave it its work."""
    global _calls_off
    _calls_off = calls_off
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the one that gave it its work is gone, however that ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(task: Task, arguments: Job) -> Any:
    """Do one job in a process of a crew, unless it is called off."""
    return task(*arguments, _check)


def _check() -> None:
    """Raise `Cancelled` if the work has been called off."""
    if _calls_off is not None and _calls_off.is_set():
        raise Cancelled


@contextmanager
def _interrupts_for_this_process_alone() -> Iterator[None]:
    """Let processes that are started now never see Ctrl-C, not even while they are starting."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


SETTINGS = "dataset.json"
"""The file that says how a data set is made."""

FAILURES = "failures.json"
"""The file that says which meshes could not be rendered, and why."""

MAX_WORKERS = 256


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
    source = existing_folder("folder", folder).resolve()
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
    crew: Callable[..., Iterator[tuple[Any, MeshResult]]],
    report: Callable[[Outcome, int, int], None] | None,
) -> Summary:
    """Render the meshes that are not done, and list those that fail."""
    todo = [name for name in names if not (place / name / MANIFEST).is_file()]
    jobs = [(names[name], name, place, recipe) for name in todo]
    results: dict[str, MeshResult] = {}
    # Closing it lets the workers go, whatever happens here.
    with closing(crew(render_mesh_file, jobs)) as done:
        for number, (job, made) in enumerate(done, start=1):
            results[job[1]] = made
            if report is not None:
                report(Outcome(job[1], *made), number, len(todo))
    in_order = {name: results[name] for name in todo if name in results}
    failures = {name: made.failure for name, made in in_order.items() if made.failure is not None}
    warned = {name: made.warnings for name, made in in_order.items() if made.warnings}
    _list_failures(place, failures)
    return Summary(len(todo) - len(failures), len(names) - len(todo), failures, warned)


def _crew(workers: Any) -> Callable[..., Iterator[tuple[Any, MeshResult]]]:
    """Return who does the work, or raise ``ValueError``."""
    if isinstance(workers, str):
        if "://" not in workers:
            raise ValueError(
                f"workers must be a number, or an address such as tcp://host:8786, got {workers!r}"
            )
        need_dask()
        return lambda task, jobs: run_on_dask(task, jobs, workers)
    count = whole_number("workers", workers, 1, MAX_WORKERS)
    if count == 1:
        return run_here
    return lambda task, jobs: run_in_processes(task, jobs, count)


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
