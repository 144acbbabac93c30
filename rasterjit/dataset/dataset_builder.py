"""Build a data set: find meshes, skip finished ones, share the others, list failures."""

from __future__ import annotations

import asyncio
import itertools
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
    MANIFEST_NAME,
    PARTIAL_PREFIX,
    Cancelled,
    MeshResult,
    Recipe,
    render_mesh_file,
    write_json,
)
from rasterjit.distributed.clusters import require_dask
from rasterjit.io.meshes import mesh_files
from rasterjit.runtime.locks import Lock, lock, machine_names
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.validation import brief, existing_folder, instance_of, whole_number

LOCK_NAME = ".lock"
"""Name of the lock file in the folder."""

MAX_LOCK_ATTEMPTS = 10
"""Most attempts to create and lock the file, while other runs remove it."""


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
    file = folder / LOCK_NAME
    try:
        with _acquire_lock(file) as file_lock:
            try:
                file_lock.write(_make_lock_content().encode())
                yield
            finally:
                if file_lock.is_at(file):
                    file_lock.remove(file)
    except KeyboardInterrupt:
        # Ctrl-C may have come between creating the file and locking it.
        _remove_empty_lock(file)
        raise


def _acquire_lock(file: Path) -> Lock:
    """Create and lock the lock file, or take over a stale one, or raise ``ValueError``."""
    for _ in range(MAX_LOCK_ATTEMPTS):
        is_created = _create_lock_file(file)
        try:
            file_lock = lock(file)
        except FileNotFoundError:
            continue
        if file_lock is None:
            break
        # The run that had the lock may have removed the file meanwhile.
        if not file_lock.is_at(file):
            file_lock.close()
        elif is_created or (
            file_lock.is_exclusive and _is_lock_visible(_parse_lock(file_lock.read()))
        ):
            return file_lock
        else:
            file_lock.close()
            break
    raise _make_locked_error(file)


def _remove_empty_lock(file: Path) -> None:
    """Remove a lock file that is neither locked nor written to."""
    with suppress(OSError):
        file_lock = lock(file)
        if file_lock is not None:
            if file_lock.is_at(file) and not file_lock.read():
                file_lock.remove(file)
            file_lock.close()


def _create_lock_file(file: Path) -> bool:
    """Create the lock file; return False if it exists."""
    try:
        os.close(os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    except FileExistsError:
        return False
    return True


def _make_locked_error(file: Path) -> ValueError:
    """Return the error that names the run that has the folder."""
    owner, process = {}, ""
    # Where locks are mandatory, other processes cannot read the file.
    with suppress(OSError):
        owner = _parse_lock(file.read_bytes())
    if {"pid", "host"} <= owner.keys():
        process = f", process {owner['pid']} on {owner['host']}"
    return ValueError(
        f"output is being written by another run{process}: wait until it ends; "
        f"if there is none, remove {str(file)!r}"
    )


def _make_lock_content() -> str:
    """Return the content of this process's lock file."""
    return json.dumps({"host": platform.node(), "pid": os.getpid(), "machine": machine_names()})


def _is_lock_visible(owner: dict[str, Any]) -> bool:
    """Tell whether the lock of a live run would be visible from this machine."""
    ids = owner.get("machine")
    return not isinstance(ids, list) or any(
        own == other for own, other in zip(machine_names(), ids, strict=False)
    )


def _parse_lock(content: bytes) -> dict[str, Any]:
    """Return the content of a lock file; {} if it is damaged."""
    try:
        owner = json.loads(content.decode("utf-8", "replace"))
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}


Job = tuple[Any, ...]
Task = Callable[..., Any]

JOBS_PER_WORKER = 2
"""Most jobs submitted at a time, for each worker."""

CONNECT_TIMEOUT = 10.0
"""Seconds within which a scheduler must answer."""

_cancel_event: Any = None
"""The event that cancels the work, in a worker process."""


class LostWorkersError(ConnectionError):
    """Workers died or could not be reached; finished meshes are complete."""


def run_serially(task: Task, jobs: Iterable[Job]) -> Iterator[tuple[Job, Any]]:
    """Run jobs in this process; yield each with its result."""
    for job in jobs:
        yield job, task(*job, None)


def run_in_processes(task: Task, jobs: Sequence[Job], count: int) -> Iterator[tuple[Job, Any]]:
    """
    Share jobs among processes; yield each with its result, in the order they finish.

    When the iterator is closed, or anything is raised, the processes end after their current view.
    """
    count = min(count, len(jobs))
    if count == 0:
        return
    context = multiprocessing.get_context("spawn")
    cancel_event = context.Event()
    threads = max(1, available_processors() // count)
    pending, running = iter(jobs), {}
    pool = futures.ProcessPoolExecutor(
        count, mp_context=context, initializer=_init_worker, initargs=(cancel_event,)
    )
    try:
        while True:
            with _block_interrupts():
                for job in itertools.islice(pending, JOBS_PER_WORKER * count - len(running)):
                    running[pool.submit(_run_job, task, (*job, threads))] = job
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


def run_on_dask(task: Task, jobs: Iterable[Job], address: str) -> Iterator[tuple[Job, Any]]:
    """
    Share jobs among the workers of a Dask cluster; yield each with its result as they finish.

    The workers must see the same files under the same paths.
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
        # Jobs are not pure: they write files.
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
    """Prepare a worker process: only its parent handles Ctrl-C."""
    global _cancel_event
    _cancel_event = cancel_event
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Exit when the parent process ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_job(task: Task, arguments: Job) -> Any:
    """Run one job in a worker process, unless the work is cancelled."""
    return task(*arguments, _check_cancelled)


def _check_cancelled() -> None:
    """Raise `Cancelled` if the work is cancelled."""
    if _cancel_event is not None and _cancel_event.is_set():
        raise Cancelled


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block Ctrl-C in processes that are started inside the ``with`` block."""
    if sys.platform == "win32":
        yield
        return
    previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)


SETTINGS_NAME = "dataset.json"
"""File with the recipe of a data set."""

FAILURES_NAME = "failures.json"
"""File with the meshes that could not be rendered, and the reasons."""

MAX_WORKERS = 256
"""Most processes."""


@dataclass(frozen=True)
class Outcome:
    """
    The result of one mesh.

    Attributes
    ----------
    name : str
        Path of the file below the folder of meshes, with ``/``.
    failure : str or None
        Why the mesh could not be read or rendered.
    warnings : tuple of str
        Warnings of reading and rendering, a line each; those of a view have its number.
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
        Number of meshes rendered now.
    present : int
        Number of meshes that were done before.
    failures : dict of str to str
        Why meshes could not be rendered, by name, in order.
    warnings : dict of str to tuple of str
        Warnings by name, in order; none of meshes that were done before.
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
    recipe = Recipe() if recipe is None else instance_of("recipe", recipe, Recipe)
    runner = _choose_runner(workers)
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
        return _render_meshes(names, target, recipe, runner, report)


def _render_meshes(
    names: dict[str, Path],
    target: Path,
    recipe: Recipe,
    runner: Callable[..., Iterator[tuple[Any, MeshResult]]],
    report: Callable[[Outcome, int, int], None] | None,
) -> Summary:
    """Render the meshes that are not done, and write the file of failures."""
    pending = [name for name in names if not (target / name / MANIFEST_NAME).is_file()]
    jobs = [(names[name], name, target, recipe) for name in pending]
    results: dict[str, MeshResult] = {}
    # Closing the runner releases the workers, also after an error.
    with closing(runner(render_mesh_file, jobs)) as finished_jobs:
        for number, ((_, name, *_), result) in enumerate(finished_jobs, start=1):
            results[name] = result
            if report is not None:
                report(Outcome(name, *result), number, len(pending))
    ordered = {name: results[name] for name in pending if name in results}
    failures = {name: job.failure for name, job in ordered.items() if job.failure is not None}
    warnings = {name: job.warnings for name, job in ordered.items() if job.warnings}
    _write_failures(target, failures)
    return Summary(len(pending) - len(failures), len(names) - len(pending), failures, warnings)


def _choose_runner(workers: Any) -> Callable[..., Iterator[tuple[Any, MeshResult]]]:
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
    has_files = target.is_dir() and any(not f.name.startswith(LOCK_NAME) for f in target.iterdir())
    if has_files and not (target / SETTINGS_NAME).is_file():
        raise ValueError(f"output must be empty or a data set, but {str(output)!r} holds files")
    return target


def _prepare_output(target: Path, recipe: Recipe) -> None:
    """Write or compare the settings of the data set; remove unfinished folders."""
    settings = _check_settings(target, recipe)
    if not (target / SETTINGS_NAME).is_file():
        write_json(target / SETTINGS_NAME, settings)
    for leftover in target.glob(f"{PARTIAL_PREFIX}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def _check_settings(target: Path, recipe: Recipe) -> dict[str, Any]:
    """Return the settings of the data set; raise ``ValueError`` if it has others."""
    # Not imported by name, which would make the whole package a dependency of this module.
    version = sys.modules["rasterjit"].__version__
    expected = {"rasterjit": version, **recipe.describe()}
    settings = target / SETTINGS_NAME
    if settings.is_file():
        try:
            stored = json.loads(settings.read_text(encoding="utf-8"))
            changed = sorted(k for k in {*stored, *expected} if stored.get(k) != expected.get(k))
        except (ValueError, TypeError) as error:
            raise ValueError(f"output has a {SETTINGS_NAME} that cannot be read: {error}") from None
        if changed:
            changes = ", ".join(f"{k} {stored.get(k)!r}, not {expected.get(k)!r}" for k in changed)
            raise ValueError(f"output holds a data set made otherwise: {changes}")
    return expected


def _write_failures(target: Path, failures: dict[str, str]) -> None:
    """Write the file of failures, or remove it if there are none."""
    if not failures:
        (target / FAILURES_NAME).unlink(missing_ok=True)
        return
    listed = [{"file": name, "reason": reason} for name, reason in failures.items()]
    write_json(target / FAILURES_NAME, listed)
