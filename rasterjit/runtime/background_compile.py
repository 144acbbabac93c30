"""
Compile kernels in background processes: compilers hold the GIL, so threads would not help.

The processes share the store. Each locks there what it compiles, and the others wait for it. Only
where files cannot be locked is anything compiled twice.
"""

from __future__ import annotations

import atexit
import importlib
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from rasterjit import forks
from rasterjit.runtime import isolated_numba, jit, store
from rasterjit.runtime.progress import Progress
from rasterjit.runtime.threads import available_processors

WORKER_CODE = """
import sys
idle_seconds, *sys.path[:] = sys.argv[1:]
from rasterjit.runtime.background_compile import serve_tasks
serve_tasks(float(idle_seconds))
"""
"""Code of a worker process; it searches modules where this process does, and nowhere else."""

MIN_TASKS_FOR_PROCESS = 6
"""Fewest tasks for which starting a process pays."""

DECORATED = re.compile(r"^@(?:kernel|raw_kernel|stage)$", re.MULTILINE)
"""Matches the decorators of compiled functions."""

MAX_IDLE_SECONDS = 30.0
"""How long an idle process waits for more tasks: effects are often switched on one by one."""


class Task(NamedTuple):
    """A function of a module, called by its name."""

    module: str
    function: str
    arguments: tuple[Any, ...] = ()


def make_compile_tasks(functions: Iterable[Any], first_form_only: bool = False) -> list[Task]:
    """
    Return tasks that compile what the store lacks of some kernels and stages.

    Parameters
    ----------
    functions : iterable of kernels, raw kernels and stages
    first_form_only : bool
        Whether to leave out all forms but the first declared, the usual one.
    """
    return [
        Task(__name__, "compile_if_missing", (function.__module__, function.__name__, number))
        for function in functions
        for number, kind in enumerate(
            function.declared[:1] if first_form_only else function.declared
        )
        if not store.is_stored(function, kind)
    ]


def find_every_kernel() -> list[Any]:
    """
    Import all modules of the package; return its kernels, raw kernels and stages.

    Those of several forms take longest to compile, and come first, so that no process ends long
    after the others; then by the names of modules.
    """
    found = []
    for path in sorted(store.ROOT.rglob("*.py")):
        if DECORATED.search(path.read_text(encoding="utf-8")):
            place = path.relative_to(store.ROOT.parent).with_suffix("")
            module = importlib.import_module(".".join(place.parts).removesuffix(".__init__"))
            kinds = (jit.Kernel, jit.RawKernel, jit.Stage)
            found += [
                one for one in vars(module).values()
                if isinstance(one, kinds) and one.__module__ == module.__name__
            ]  # fmt: skip
    return sorted(found, key=lambda one: -len(one.declared))


def compile_if_missing(module: str, name: str, number: int) -> None:
    """Compile a form of a kernel, a raw kernel or a stage, unless the store has it."""
    function = getattr(importlib.import_module(module), name)
    function.load(function.declared[number])


def serve_tasks(idle_seconds: float) -> None:
    """
    Read lists of tasks from standard input, a line each; run every task and print its error.

    Tasks of the last list come first: whoever sent an earlier list has compiled meanwhile.

    Parameters
    ----------
    idle_seconds : float
        The process ends after so long without a task.
    """
    if sys.platform == "win32":
        # Numba imports SciPy, some releases of which load a library that looks at standard input:
        # it would wait for the thread that reads.
        with suppress(ImportError):
            isolated_numba.compiler()
    lists: SimpleQueue[str] = SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            lists.put(line)
        # Nobody else holds the other end: that process is done, or gone.
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    tasks: list[Task] = []
    while True:
        with suppress(Empty):
            while True:
                tasks[:0] = json.loads(lists.get(not tasks, idle_seconds))
        if not tasks:
            os._exit(0)
        module, function, arguments = tasks.pop(0)
        try:
            getattr(importlib.import_module(module), function)(*arguments)
        except Exception as error:
            print(json.dumps(f"{type(error).__name__}: {error}"), flush=True)
        else:
            print("null", flush=True)


def can_start_process() -> bool:
    """Tell whether a worker process could import the same code and share the store."""
    return (
        not (jit.DISABLED or jit.CHECKED)
        # A program that embeds Python is no interpreter.
        and Path(sys.executable or "").name.lower().startswith(("python", "pypy"))
        and not getattr(sys, "frozen", False)
        and not sys.flags.isolated
        and store.kernel_folder() is not None
    )


def _start_worker(
    stdout: int = subprocess.PIPE, idle_seconds: float = threading.TIMEOUT_MAX
) -> subprocess.Popen[str]:
    search_path = [entry for entry in sys.path if isinstance(entry, str)]
    return subprocess.Popen(
        [sys.executable, "-c", WORKER_CODE, repr(idle_seconds), *search_path], encoding="utf-8",
        stdin=subprocess.PIPE, stdout=stdout, stderr=subprocess.DEVNULL,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )  # fmt: skip


def run_tasks(
    tasks: Sequence[Task], on_task_done: Callable[[], None], max_processes: int | None = None
) -> list[Task]:
    """
    Run tasks in worker processes, each as soon as a process is free.

    Parameters
    ----------
    tasks : sequence of Task
    on_task_done : callable
        Called after each task, from several threads, by one at a time.
    max_processes : int or None
        ``None`` takes the processors this process may run on.

    Returns
    -------
    list of Task
        Those that failed, or that no process ran.
    """
    waiting: SimpleQueue[Task] = SimpleQueue()
    for task in tasks:
        waiting.put(task)
    failed: list[Task] = []
    reporting = forks.lock()

    def feed(process: subprocess.Popen[str]) -> None:
        # A process that has ended leaves the waiting tasks to the others.
        with suppress(Empty):
            while process.poll() is None:
                task = waiting.get_nowait()
                if _run_task(process, task) is not None:
                    failed.append(task)
                with reporting:
                    on_task_done()

    count = available_processors() if max_processes is None else max_processes
    processes: list[subprocess.Popen[str]] = []
    try:
        for _ in range(min(count, len(tasks))):
            processes.append(_start_worker())
        threads = [threading.Thread(target=feed, args=(each,), daemon=True) for each in processes]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        for process in processes:
            _kill(process)
    while not waiting.empty():
        failed.append(waiting.get())
    return failed


def _run_task(process: subprocess.Popen[str], task: Task) -> str | None:
    """Let a process run a task; return its error, or None."""
    try:
        process.stdin.write(json.dumps([task]) + "\n")
        process.stdin.flush()
        answer = process.stdout.readline()
        if not answer:
            process.wait()
            return "the process ended"
        return json.loads(answer)
    except (OSError, ValueError) as error:
        _kill(process)
        return str(error)


def _kill(process: subprocess.Popen[str]) -> None:
    process.kill()
    with suppress(OSError):
        process.communicate()


class _BackgroundWorker:
    """The background process that compiles; it ends when idle for long."""

    def __init__(self) -> None:
        self._lock = forks.lock()
        self._process: subprocess.Popen[str] | None = None

    def submit(self, tasks: Sequence[Task], min_to_start: int) -> None:
        """Let the process run tasks, in order; do not start it for fewer than ``min_to_start``."""
        with self._lock:
            process = self._process
            if process is None or process.poll() is not None:
                if len(tasks) < min_to_start:
                    return
                self._end()
                try:
                    process = self._process = _start_worker(subprocess.DEVNULL, MAX_IDLE_SECONDS)
                except OSError:
                    return
                # Reap it as soon as it ends: the next call may be long after.
                threading.Thread(target=process.wait, daemon=True).start()
            # Their results are in the store: nobody reads the process's output.
            with suppress(OSError):
                process.stdin.write(json.dumps(tasks) + "\n")
                process.stdin.flush()

    def end(self) -> None:
        """End the process, if there is one."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self._process is not None:
            _kill(self._process)
            self._process = None

    def forget(self) -> None:
        """Leave the process to the one that this was forked from."""
        process, self._process = self._process, None
        self._lock = forks.lock()
        if process is not None:
            # An open end of its input would keep it waiting for more.
            with suppress(OSError):
                process.stdin.close()
            process.returncode = 0


_BACKGROUND_WORKER = _BackgroundWorker()
atexit.register(_BACKGROUND_WORKER.end)


def _after_fork() -> None:
    """Reset state in a forked process, which lacks the threads."""
    store.BEFORE_COMPILING.clear()
    _BACKGROUND_WORKER.forget()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def compile_in_background(
    list_tasks: Callable[[], Sequence[Task]], threads: int | None = None, *, at_once: bool = False
) -> AbstractContextManager[None]:
    """
    Run tasks in a background process while this one compiles, within a ``with`` block.

    All callers share one such process. It starts with the first kernel that this process compiles,
    since most frames compile nothing, and waits a while for more tasks.

    Parameters
    ----------
    list_tasks : callable
        Returns the tasks; called at most once, and only if something is compiled. If it raises,
        this process compiles everything.
    threads : int or None
        What the user allows; with 1 there is no other process.
    at_once : bool
        Whether to start before this process compiles something.
    """
    return _CompileWatcher(list_tasks, threads, at_once)


class _CompileWatcher:
    """Submits tasks when something is about to be compiled, within a ``with`` block."""

    def __init__(
        self, list_tasks: Callable[[], Sequence[Task]], threads: int | None, at_once: bool
    ) -> None:
        self._list_tasks, self._threads, self._at_once = list_tasks, threads, at_once
        self._submitting = forks.lock()
        self._progress: Progress | None = None

    def __enter__(self) -> None:
        store.BEFORE_COMPILING.append(self)
        if self._at_once and self._is_shared():
            try:
                self()
            except BaseException:
                self._leave()
                raise

    def __exit__(self, *error: object) -> None:
        self._leave()

    def __call__(self) -> None:
        """Submit the tasks, as something is about to be compiled, and report the progress."""
        # Of several threads that compile, one submits; the others go on.
        if self._submitting.acquire(blocking=False):
            tasks, files = _try_list_tasks(self._list_tasks)
            self._progress = Progress(files)
            if tasks and self._is_shared() and can_start_process():
                _BACKGROUND_WORKER.submit(tasks, 1 if self._at_once else MIN_TASKS_FOR_PROCESS)
        # Only the frame that began last reports.
        if self._progress is not None and store.BEFORE_COMPILING[-1:] == [self]:
            self._progress.report()

    def _leave(self) -> None:
        # In a process that was forked within, there is nothing to remove.
        with suppress(ValueError):
            store.BEFORE_COMPILING.remove(self)
        if self._progress is not None:
            self._progress.end()

    def _is_shared(self) -> bool:
        return self._threads != 1 and available_processors() > 1


def _name_and_file(task: Task) -> tuple[str, Path | None]:
    """Return the name of the kernel that a task compiles, and the file that will store it."""
    module, name, number = task.arguments
    function, folder = getattr(sys.modules[module], name), store.kernel_folder()
    if folder is None:
        return f"{module}.{name}", None
    kind = function.declared[number]
    return f"{module}.{name}", store.entry_path(
        folder, store.symbol_name(function, kind, store.host())
    )


def _try_list_tasks(
    list_tasks: Callable[[], Sequence[Task]],
) -> tuple[Sequence[Task], dict[str, Path | None]]:
    """Return the tasks, and the files of kernels; none on errors: they must not end a frame."""
    try:
        tasks = list_tasks()
        return tasks, dict(_name_and_file(task) for task in tasks if task.module == __name__)
    except Exception:
        return (), {}
