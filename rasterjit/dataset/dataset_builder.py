"""Build a data set: find meshes, skip finished ones, share the others, list failures."""

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
from rasterjit.scene.validation import brief, existing_folder, whole_number

LOCK = ".lock"
"""Name of the lock file in the folder."""

MAX_ATTEMPTS = 10
"""Attempts to create and lock the file, while other runs remove it."""


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """
    Lock a folder for this run.

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
        with _acquire_lock(file) as held:
            try:
                held.write(_lock_content().encode())
                yield
            finally:
                if held.is_of(file):
                    held.remove(file)
    except KeyboardInterrupt:
        # It may have come after the file was made, and before that was known.
        _remove_empty(file)
        raise


def _acquire_lock(file: Path) -> Lock:
    """Create and lock the lock file, or take over a stale one, or raise ``ValueError``."""
    for _ in range(MAX_ATTEMPTS):
        is_created = _create_lock_file(file)
        try:
            held = lock(file)
        except FileNotFoundError:
            continue
        if held is None:
            break
        # Whoever had it may have removed it meanwhile.
        if not held.is_of(file):
            held.close()
        elif is_created or (held.is_sure and _is_lock_visible(_parse(held.read()))):
            return held
        else:
            held.close()
            break
    raise _locked_error(file)


def _remove_empty(file: Path) -> None:
    """Remove a lock file that nobody has locked or written to."""
    with suppress(OSError):
        held = lock(file)
        if held is not None:
            if held.is_of(file) and not held.read():
                held.remove(file)
            held.close()


def _create_lock_file(file: Path) -> bool:
    """Create the lock file; return False if it exists."""
    try:
        os.close(os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    except FileExistsError:
        return False
    return True


def _locked_error(file: Path) -> ValueError:
    """Return the error that says who has the folder."""
    owner = {}
    # Where locks are mandatory, nobody else can read it.
    with suppress(OSError):
        owner = _parse(file.read_bytes())
    who = f", process {owner['pid']} on {owner['host']}" if {"pid", "host"} <= owner.keys() else ""
    return ValueError(
        f"output is being written by another run{who}: wait until it ends; "
        f"if there is none, remove {str(file)!r}"
    )


def _lock_content() -> str:
    """Return the content of this process's lock file."""
    return json.dumps({"host": platform.node(), "pid": os.getpid(), "machine": machine()})


def _is_lock_visible(owner: dict[str, Any]) -> bool:
    """Tell whether the lock of a live run would be visible from this machine."""
    names = owner.get("machine")
    return not isinstance(names, list) or any(
        own == other for own, other in zip(machine(), names, strict=False)
    )


def _parse(content: bytes) -> dict[str, Any]:
    """Return the content of a lock file; {} if it is damaged."""
    try:
        owner = json.loads(content.decode("utf-8", "replace"))
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}


Job = tuple[Any, ...]
Task = Callable[..., Any]

JOBS_EACH = 2
"""Jobs for each worker that are handed out ahead."""

CONNECT_TIMEOUT = 10.0
"""Seconds within which a scheduler must answer."""

_cancel_event: Any = None
"""In a worker process: the event that cancels the work."""


class LostWorkersError(ConnectionError):
    """Workers died or could not be reached; finished meshes are complete."""


def run_serially(task: Task, jobs: Iterable[Job]) -> Iterator[tuple[Job, Any]]:
    """Run jobs one after the other; yield each with its result."""
    for job in jobs:
        yield job, task(*job, None)


def run_in_processes(task: Task, jobs: Sequence[Job], count: int) -> Iterator[tuple[Job, Any]]:
    """
    Share jobs among processes; yield each with its result, in the order they finish.

    When the iterator is closed, or anything is raised, the processes end after the view at hand.
    """
    count = min(count, len(jobs))
    if count == 0:
        return
    context = multiprocessing.get_context("spawn")
    cancel_event = context.Event()
    threads = max(1, available_processors() // count)
    waiting, running = iter(jobs), {}
    pool = futures.ProcessPoolExecutor(
        count, mp_context=context, initializer=_init_worker, initargs=(cancel_event,)
    )
    try:
        while True:
            with _block_interrupts():
                while len(running) < JOBS_EACH * count and (job := next(waiting, None)) is not None:
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
        cancel_event.set()
        pool.shutdown(wait=True, cancel_futures=True)


def require_dask() -> Any:
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
    distributed = require_dask()
    try:
        client = distributed.Client(address, timeout=CONNECT_TIMEOUT)
    except (OSError, ValueError, asyncio.TimeoutError) as error:
        message = " ".join(str(error).split()).splitlines()
        raise LostWorkersError(
            f"no scheduler answers at {address}" + (f": {message[0]}" if message else "")
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


def _init_worker(cancel_event: Any) -> None:
    """Prepare a process of a crew: Ctrl-C is for the one who gave it its work."""
    global _cancel_event
    _cancel_event = cancel_event
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Exit when the parent process ends, however it ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(task: Task, arguments: Job) -> Any:
    """Run one job in a worker process, unless the work is cancelled."""
    return task(*arguments, _check_cancelled)


def _check_cancelled() -> None:
    """Raise `Cancelled` if the work has been called off."""
    if _cancel_event is not None and _cancel_event.is_set():
        raise Cancelled


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block Ctrl-C in processes that are started inside the ``with`` block."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


SETTINGS = "dataset.json"
"""File with the recipe of a data set."""

FAILURES = "failures.json"
"""File with the meshes that could not be rendered, and the reasons."""

MAX_WORKERS = 256


@dataclass(frozen=True)
class Outcome:
    """
    The result of one mesh.

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
    The results of all meshes.

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
        raise ValueError(f"recipe must be a Recipe, got {brief(recipe)}")
    runner = _job_runner(workers)
    source = existing_folder("folder", folder).resolve()
    target = _check_output(output, source)
    names = {file.relative_to(source).as_posix(): file for file in mesh_files(source)}
    names = {name: file for name, file in names.items() if not file.is_relative_to(target)}
    if not names:
        raise ValueError(f"folder must hold mesh files, got none in {str(source)!r}")
    if report is not None and not callable(report):
        raise ValueError(f"report must be a function, got {brief(report)}")
    _check_settings(target, recipe)
    target.mkdir(parents=True, exist_ok=True)
    with lock_folder(target):
        _prepare_output(target, recipe)
        return _make_all(names, target, recipe, runner, report)


def _make_all(
    names: dict[str, Path],
    target: Path,
    recipe: Recipe,
    runner: Callable[..., Iterator[tuple[Any, MeshResult]]],
    report: Callable[[Outcome, int, int], None] | None,
) -> Summary:
    """Render the meshes that are not done, and list those that fail."""
    pending = [name for name in names if not (target / name / MANIFEST).is_file()]
    jobs = [(names[name], name, target, recipe) for name in pending]
    results: dict[str, MeshResult] = {}
    # Closing it lets the workers go, whatever happens here.
    with closing(runner(render_mesh_file, jobs)) as results_of_jobs:
        for number, (job, result) in enumerate(results_of_jobs, start=1):
            results[job[1]] = result
            if report is not None:
                report(Outcome(job[1], *result), number, len(pending))
    in_order = {name: results[name] for name in pending if name in results}
    failures = {name: job.failure for name, job in in_order.items() if job.failure is not None}
    warnings = {name: job.warnings for name, job in in_order.items() if job.warnings}
    _list_failures(target, failures)
    return Summary(len(pending) - len(failures), len(names) - len(pending), failures, warnings)


def _job_runner(workers: Any) -> Callable[..., Iterator[tuple[Any, MeshResult]]]:
    """Return the function that runs jobs, or raise ``ValueError``."""
    if isinstance(workers, str):
        if "://" not in workers:
            raise ValueError(
                f"workers must be a number, or an address such as tcp://host:8786, got {workers!r}"
            )
        require_dask()
        return lambda task, jobs: run_on_dask(task, jobs, workers)
    count = whole_number("workers", workers, 1, MAX_WORKERS)
    if count == 1:
        return run_serially
    return lambda task, jobs: run_in_processes(task, jobs, count)


def _check_output(output: Any, source: Path) -> Path:
    """Return the full path of the folder to write to, or raise ``ValueError``."""
    if not isinstance(output, (str, os.PathLike)):
        raise ValueError(f"output must be a folder, got {brief(output)}")
    target = Path(output).resolve()
    if target == source or source.is_relative_to(target):
        raise ValueError(f"output must not hold the meshes, got {str(output)!r}")
    if target.exists() and not target.is_dir():
        raise ValueError(f"output must be a folder, but {str(output)!r} is a file")
    is_full = target.is_dir() and any(not one.name.startswith(LOCK) for one in target.iterdir())
    if is_full and not (target / SETTINGS).is_file():
        raise ValueError(f"output must be empty or a data set, but {str(output)!r} holds files")
    return target


def _prepare_output(target: Path, recipe: Recipe) -> None:
    """Write or compare the settings of the data set; remove unfinished folders."""
    settings = _check_settings(target, recipe)
    if not (target / SETTINGS).is_file():
        write_json(target / SETTINGS, settings)
    for leftover in target.glob(f"{PARTIAL}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def _check_settings(target: Path, recipe: Recipe) -> dict[str, Any]:
    """Return the settings of the data set; raise ``ValueError`` if it has others."""
    # Importing the package by name would make all of it something that this module needs.
    version = sys.modules["rasterjit"].__version__
    expected = {"rasterjit": version, **recipe.describe()}
    settings = target / SETTINGS
    if settings.is_file():
        try:
            stored = json.loads(settings.read_text(encoding="utf-8"))
            changed = sorted(k for k in {*stored, *expected} if stored.get(k) != expected.get(k))
        except (ValueError, TypeError) as error:
            raise ValueError(f"output has a {SETTINGS} that cannot be read: {error}") from None
        if changed:
            changes = ", ".join(f"{k} {stored.get(k)!r}, not {expected.get(k)!r}" for k in changed)
            raise ValueError(f"output holds a data set made otherwise: {changes}")
    return expected


def _list_failures(target: Path, failures: dict[str, str]) -> None:
    """Write why meshes failed; no file if none did."""
    if not failures:
        (target / FAILURES).unlink(missing_ok=True)
        return
    listed = [{"file": name, "reason": reason} for name, reason in failures.items()]
    write_json(target / FAILURES, listed)
