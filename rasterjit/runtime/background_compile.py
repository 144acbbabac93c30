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

WORKER = """
import sys
patience, *sys.path[:] = sys.argv[1:]
from rasterjit.runtime.background_compile import work
work(float(patience))
"""
"""Code of a worker process; it searches modules where this process does, and nowhere else."""

WORTH_A_PROCESS = 6
"""Fewest tasks for which starting a process pays."""

DECORATED = re.compile(r"^@(?:kernel|raw_kernel|stage)$", re.MULTILINE)
"""Matches the decorators of compiled functions."""

LINGER = 30.0
"""Seconds that an idle process waits for more tasks: effects are often switched on one by one."""


class Task(NamedTuple):
    """A function of a module, called by its name."""

    module: str
    function: str
    arguments: tuple[Any, ...] = ()


def compiling(functions: Iterable[Any], usual: bool = False) -> list[Task]:
    """
    Return tasks that compile what the store lacks of some kernels and stages.

    Parameters
    ----------
    functions : iterable of kernels, raw kernels and stages
    usual : bool
        Of each the usual form alone.
    """
    return [
        Task(__name__, "compile_one", (one.__module__, one.__name__, number))
        for one in functions
        for number, kind in enumerate(one.declared[:1] if usual else one.declared)
        if not store.is_kept(one, kind)
    ]


def every_kernel() -> list[Any]:
    """
    Return every kernel, raw kernel and stage of the package; it imports the modules of all.

    What has several forms takes longest to compile, and comes first, so that no process ends long
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


def compile_one(module: str, name: str, number: int) -> None:
    """Compile a form of a kernel, a raw kernel or a stage, unless the store has it."""
    function = getattr(importlib.import_module(module), name)
    function.obtain(function.declared[number])


def work(patience: float) -> None:
    """
    Read lists of tasks from standard input, a line each, do every task and answer it with a line.

    Those of the last list come first: who asked before has compiled meanwhile.

    Parameters
    ----------
    patience : float
        Seconds without a task after which the process ends.
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
                tasks[:0] = json.loads(lists.get(not tasks, patience))
        if not tasks:
            os._exit(0)
        module, function, arguments = tasks.pop(0)
        try:
            getattr(importlib.import_module(module), function)(*arguments)
        except Exception as error:
            print(json.dumps(f"{type(error).__name__}: {error}"), flush=True)
        else:
            print("null", flush=True)


def is_possible() -> bool:
    """Tell whether another process could import the same code and share the store."""
    return (
        not (jit.DISABLED or jit.CHECKED)
        # A program that holds Python inside is no interpreter.
        and Path(sys.executable or "").name.lower().startswith(("python", "pypy"))
        and not getattr(sys, "frozen", False)
        and not sys.flags.isolated
        and store.folder() is not None
    )


def _start(
    answers: int = subprocess.PIPE, patience: float = threading.TIMEOUT_MAX
) -> subprocess.Popen[str]:
    places = [one for one in sys.path if isinstance(one, str)]
    return subprocess.Popen(
        [sys.executable, "-c", WORKER, repr(patience), *places], encoding="utf-8",
        stdin=subprocess.PIPE, stdout=answers, stderr=subprocess.DEVNULL,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )  # fmt: skip


def do_all(
    tasks: Sequence[Task], tell: Callable[[], None], processes: int | None = None
) -> list[Task]:
    """
    Do tasks in other processes, each as soon as one has nothing else to do.

    Parameters
    ----------
    tasks : sequence of Task
    tell : callable
        Called after each, from several threads, by one at a time.
    processes : int or None
        How many at most; ``None`` takes the processors this process may run on.

    Returns
    -------
    list of Task
        Those that failed, or that no process did.
    """
    waiting: SimpleQueue[Task] = SimpleQueue()
    for task in tasks:
        waiting.put(task)
    failed: list[Task] = []
    telling = forks.lock()

    def follow(process: subprocess.Popen[str]) -> None:
        # One that has ended does no more: what waits is for the others.
        with suppress(Empty):
            while process.poll() is None:
                task = waiting.get_nowait()
                if _do(process, task) is not None:
                    failed.append(task)
                with telling:
                    tell()

    count = available_processors() if processes is None else processes
    others: list[subprocess.Popen[str]] = []
    try:
        for _ in range(min(count, len(tasks))):
            others.append(_start())
        threads = [threading.Thread(target=follow, args=(one,), daemon=True) for one in others]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        for one in others:
            _end(one)
    while not waiting.empty():
        failed.append(waiting.get())
    return failed


def _do(process: subprocess.Popen[str], task: Task) -> str | None:
    """Let a process do a task; return its error, or None."""
    try:
        process.stdin.write(json.dumps([task]) + "\n")
        process.stdin.flush()
        answer = process.stdout.readline()
        if not answer:
            process.wait()
            return "the process ended"
        return json.loads(answer)
    except (OSError, ValueError) as error:
        _end(process)
        return str(error)


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    with suppress(OSError):
        process.communicate()


class _Beside:
    """The background process that compiles; it ends when idle for long."""

    def __init__(self) -> None:
        self._lock = forks.lock()
        self._process: subprocess.Popen[str] | None = None

    def take(self, tasks: Sequence[Task], least: int) -> None:
        """Let the process do tasks, in order; do not start it for fewer than ``least``."""
        with self._lock:
            process = self._process
            if process is None or process.poll() is not None:
                if len(tasks) < least:
                    return
                self._end()
                try:
                    process = self._process = _start(subprocess.DEVNULL, LINGER)
                except OSError:
                    return
                # Take note of its end at once: it may be long before anybody asks again.
                threading.Thread(target=process.wait, daemon=True).start()
            # Whether they are done shows in the store: nobody reads the answers.
            with suppress(OSError):
                process.stdin.write(json.dumps(tasks) + "\n")
                process.stdin.flush()

    def end(self) -> None:
        """End the process, if there is one."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self._process is not None:
            _end(self._process)
            self._process = None

    def forget(self) -> None:
        """Leave the process to the one that this was forked from."""
        process, self._process = self._process, None
        self._lock = forks.lock()
        if process is not None:
            # Who holds its input keeps it waiting for more.
            with suppress(OSError):
                process.stdin.close()
            process.returncode = 0


_BESIDE = _Beside()
atexit.register(_BESIDE.end)


def _after_fork() -> None:
    """Reset state in a forked process, which lacks the threads."""
    store.BEFORE_COMPILING.clear()
    _BESIDE.forget()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def beside(
    list_tasks: Callable[[], Sequence[Task]], threads: int | None = None, *, at_once: bool = False
) -> AbstractContextManager[None]:
    """
    Run tasks in a background process while this one compiles, within a ``with`` block.

    There is one such process, whoever asks. It starts with the first kernel that this process
    compiles, since most frames compile nothing; what follows soon finds it ready.

    Parameters
    ----------
    list_tasks : callable
        Returns the tasks; called at most once, and only if something is compiled. What it raises
        is not told: this process then compiles everything.
    threads : int or None
        What the user allows; with 1 everything is left to this process.
    at_once : bool
        Do not wait until this process compiles something.
    """
    return _Asking(list_tasks, threads, at_once)


class _Asking:
    """Asks for tasks when something is about to be compiled, within a ``with`` block."""

    def __init__(
        self, list_tasks: Callable[[], Sequence[Task]], threads: int | None, at_once: bool
    ) -> None:
        self._list_tasks, self._threads, self._at_once = list_tasks, threads, at_once
        self._asking = forks.lock()
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
        """Ask for the tasks, as something is about to be compiled."""
        # One of several threads that compile asks; the others go on.
        if self._asking.acquire(blocking=False):
            tasks, entries = _listed(self._list_tasks)
            self._progress = Progress(entries)
            if tasks and self._is_shared() and is_possible():
                _BESIDE.take(tasks, 1 if self._at_once else WORTH_A_PROCESS)
        # The frame that began last tells.
        if self._progress is not None and store.BEFORE_COMPILING[-1:] == [self]:
            self._progress.tell()

    def _leave(self) -> None:
        # In a process that was forked within, there is nothing to remove.
        with suppress(ValueError):
            store.BEFORE_COMPILING.remove(self)
        if self._progress is not None:
            self._progress.end()

    def _is_shared(self) -> bool:
        return self._threads != 1 and available_processors() > 1


def _entry(task: Task) -> tuple[str, Path | None]:
    """Return the name of what a task compiles, and the file that will keep it."""
    module, name, number = task.arguments
    function, place = getattr(sys.modules[module], name), store.folder()
    if place is None:
        return f"{module}.{name}", None
    kind = function.declared[number]
    return f"{module}.{name}", store.path_of(place, store.name_of(function, kind, store.host()))


def _listed(
    list_tasks: Callable[[], Sequence[Task]],
) -> tuple[Sequence[Task], dict[str, Path | None]]:
    """Return the tasks, and what they compile; none on errors: they must not end a frame."""
    try:
        tasks = list_tasks()
        return tasks, dict(_entry(task) for task in tasks if task.module == __name__)
    except Exception:
        return (), {}
