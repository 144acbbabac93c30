"""
Have packages of others read files, and decode what files hold, where they can do no harm.

That is in a process with limits. It is started for the first such file, waits for the next one, and
ends with this one; see `rasterjit.io.foreign.child`. One that crashed or had to be ended is
replaced.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import closing
from multiprocessing import spawn
from pathlib import Path
from typing import Any

from rasterjit import forks
from rasterjit.io.foreign.codecs import CODECS
from rasterjit.io.foreign.readers import modules_for
from rasterjit.io.foreign.wire import read_found, write_found
from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.resources import Resources, extension_of
from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.warning import warn_caller

_SECONDS, _SECONDS_OF_MEGABYTE = 10, 10
"""Of the processor: what a file may take, and what each megabyte of it adds that is read."""

_WAITING = 20.0 if sys.platform == "linux" else 4.0
"""How many times as long it may take by the clock, as others use the processor as well; by this
alone some systems are held to it."""

_STARTING = 60.0
"""Seconds in which the process must be ready, and may take to end another one."""

_SMALL = 1 << 20
"""Bytes of what is found that are not counted: names, numbers and notes."""

_IN_PROCESS = "isolate=False reads it in this process, without limits"

_NOTHING = Path(os.devnull)

_PACKAGE = Path(__file__).parents[2]

_START = """
import json, sys, types
said = json.loads(sys.stdin.buffer.readline())
sys.path[:] = said["path"]
package = types.ModuleType(said["name"])
package.__path__ = [said["package"]]
sys.modules[said["name"]] = package
from rasterjit.io.foreign.child import serve
import os
file = said["file"]
if isinstance(file, str):
    file = os.open(file, os.O_RDWR | os.O_BINARY | os.O_TEMPORARY)
serve(file)
"""
"""Imports no more than what reads: not the package's public names, which bring all else."""

_THREADS = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "MALLOC_ARENA_MAX"), "1"
)
"""Variables that let libraries start none: what forks has one."""

_LOCK = forks.lock()
_IDLE: list[_Reader] = []
_ALL: set[_Reader] = set()


class _EndedError(Exception):
    """The process ended in place of an answer, perhaps because it was too late with it."""

    def __init__(self, is_late: bool = False) -> None:
        super().__init__()
        self.is_late = is_late


class _Reader:
    """A process that reads files."""

    def __init__(self) -> None:
        self._results, name = _result_file()
        self._is_busy = False
        """Whether it keeps a copy for more of a file."""
        number = self._results.fileno()
        command = [spawn.get_executable(), "-I", "-S", "-c", _START]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            pass_fds=() if name else (number,), env={**os.environ, **_THREADS},
            # What interrupts this process is not for that one.
            start_new_session=os.name == "posix",
        )  # fmt: skip
        hello = {
            "path": _path(), "package": str(_PACKAGE), "name": __name__.partition(".")[0],
            "file": name or number,
        }  # fmt: skip
        with _LOCK:
            _ALL.add(self)
        try:
            self._say(hello)
            self._answer(_STARTING)
        except BaseException:
            self.end()
            raise

    def ask(
        self, request: dict[str, Any], arguments: Sequence[Any] = ()
    ) -> tuple[dict[str, Any], Any]:
        """Return how the process fared with a request, and what it found, if it did."""
        if arguments:
            write_found(arguments, self._results.fileno())
        self._say(request)
        answer = self._answer(request["longest"] + _STARTING)
        self._is_busy = not answer.get("has_ended", request["is_last"])
        found = None
        if answer["status"] == 0:
            file = self._results.fileno()
            is_large = os.fstat(file).st_size > request["left"] + _SMALL
            try:
                found = {"error": "MemoryError"} if is_large else read_found(file)
            except ValueError as error:
                raise _EndedError from error
        # Its memory is free again.
        self._results.truncate(0)
        return answer, found

    def _say(self, what: dict[str, Any]) -> None:
        """Send a line."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(what).encode() + b"\n")
            self._process.stdin.flush()
        except OSError as error:
            raise _EndedError from error

    def _answer(self, longest: float) -> dict[str, Any]:
        """Wait for a line; one that takes too long ends the process."""
        assert self._process.stdout is not None
        is_over = threading.Event()

        def end() -> None:
            """End the process when time is over."""
            is_over.set()
            self._process.kill()

        clock = threading.Timer(longest, end)
        clock.daemon = True
        clock.start()
        try:
            line = self._process.stdout.readline()
        finally:
            clock.cancel()
        if not line.endswith(b"\n"):
            raise _EndedError(is_over.is_set())
        answer: dict[str, Any] = json.loads(line)
        return answer

    def is_alive(self) -> bool:
        """Tell whether the process still waits."""
        return self._process.poll() is None

    def is_ready(self) -> bool:
        """End what the process does for a file, if it does; tell whether it waits for another."""
        if not self._is_busy:
            return True
        try:
            self._is_busy = False
            self._say({"end": True})
            return bool(self._answer(_STARTING)["status"] == 0)
        except _EndedError:
            return False

    def end(self) -> int:
        """End the process, and tell how it ended."""
        with _LOCK:
            _ALL.discard(self)
        self._process.kill()
        self.close()
        return self._process.wait()

    def close(self) -> None:
        """Let go of what leads to the process."""
        for one in (self._process.stdin, self._process.stdout, self._results):
            if one is not None:
                with contextlib.suppress(OSError):
                    one.close()

    def forget(self) -> None:
        """Leave the process to the one that this one is a copy of."""
        self.close()
        self._process.returncode = 0


def _path() -> list[str]:
    """Return where modules are found, wherever the process is."""
    folder = _folder()
    return [os.path.join(folder, one) for one in sys.path]


def _folder() -> str:
    """Return where this process is; the topmost folder if it is in one that was removed."""
    try:
        return os.getcwd()
    except OSError:
        return os.sep


def _result_file() -> tuple[Any, str | None]:
    """Return a file for what is found, and its name if that has to be told."""
    if hasattr(os, "memfd_create"):
        return open(os.memfd_create("rasterjit", os.MFD_CLOEXEC), "w+b", buffering=0), None
    file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
    return file, None if os.name == "posix" else file.name


def _end_all() -> None:
    """End all processes, as this one does."""
    for one in list(_ALL):
        one.end()


def _forget_all() -> None:
    """Let a forked child start processes of its own."""
    while _ALL:
        _ALL.pop().forget()
    _IDLE.clear()


atexit.register(_end_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)


def read_isolated(
    path: Path, resources: Resources, on_invalid: OnInvalid, on_damage: str, left_out: LeftOut
) -> Any:
    """
    Return what `read_file` does, read in a process with limits.

    Parameters
    ----------
    path : Path
    resources : Resources
        Whose folder and budget hold for the process as well.
    on_invalid : {"raise", "drop"}
    on_damage : {"error", "warn"}
    left_out : LeftOut

    Raises
    ------
    MeshFileError
        Also if the process crashes, takes too long or more memory than the budget has.
    FileSizeError
    """
    with closing(Session(resources.budget, path, resources.root, path.stat().st_size)) as one:
        found = one.do(
            "its reader", modules_for(extension_of(path)), on_damage=on_damage,
            on_invalid=on_invalid,
        )  # fmt: skip
    left_out.add_all(found["left_out"])
    for text in found["warnings"]:
        warn_caller(text)
    return found["found"]


class Session:
    """
    What a process does for one file: read it, or decode one after the other what it holds.

    Parameters
    ----------
    budget : MemoryBudget
    path, root : Path
        The file and the folder that the process may read; neither for a session that decodes.
    size : int
        Bytes of the file; those that are decoded are added.
    """

    def __init__(
        self, budget: MemoryBudget, path: Path = _NOTHING, root: Path = _NOTHING, size: int = 0
    ) -> None:
        self._budget, self._size = budget, size
        self._file = {"path": str(path), "root": str(root), "source": budget.source,
                      "max_bytes": budget.max_bytes}  # fmt: skip
        self._reader: _Reader | None = None

    def decode(self, name: str, arguments: Sequence[Any]) -> Any:
        """
        Return what a codec makes of its arguments.

        Raises
        ------
        ValueError
            Of what is said of the data. If the process crashes or reaches a limit, a
            `MeshFileError`, and the budget refuses all else.
        """
        codec = CODECS[name]
        try:
            return self.do(codec.library, codec.modules, arguments, codec=name)["found"]
        except MeshFileError as error:
            self._budget.refuse(error)

    def do(
        self, who: str, modules: Sequence[str], arguments: Sequence[Any] = (), **more: Any
    ) -> dict[str, Any]:
        """
        Return what became of a request.

        Raises
        ------
        MeshFileError
            Also if the process crashes or reaches a limit.
        ValueError
        """
        budget = self._budget
        self._size += sum(len(one) for one in arguments if isinstance(one, bytes))
        seconds = _SECONDS + _SECONDS_OF_MEGABYTE * self._size // 1_000_000
        request = {
            **self._file, **more, "modules": modules, "left": budget.left, "seconds": seconds,
            "longest": _WAITING * seconds, "is_given": bool(arguments), "is_last": not arguments,
        }  # fmt: skip
        if self._reader is None:
            request |= {
                "folder": _folder(), "sys_path": _path(), "memory": 2 * budget.left,
                "hidden": [name for name, one in sys.modules.items() if one is None],
            }  # fmt: skip
        could_not = f"{budget.source} could not be read as .{extension_of(Path(budget.source))}"
        try:
            answer, found = self._ask(request, arguments)
        except OSError as error:
            raise MeshFileError(
                f"{could_not}: no process can be started for it ({error}); {_IN_PROCESS}"
            ) from error
        if found is None:
            raise MeshFileError(f"{could_not}: {who} {_ending(answer, seconds)}; {_IN_PROCESS}")
        if found["error"] == "FileSizeError":
            budget.refuse(FileSizeError(found["said"]))
        if found["error"] == "MemoryError":
            raise MeshFileError(
                f"{could_not}: it needs more memory than max_bytes = {budget.max_bytes:,} allows"
            )
        if found["error"] is not None:
            kind = MeshFileError if found["error"] == "MeshFileError" else ValueError
            raise kind(found["said"])
        budget.left = found["left"]
        return found

    def _ask(self, request: dict[str, Any], arguments: Sequence[Any]) -> tuple[dict[str, Any], Any]:
        """Have the process answer a request: one that waits, or a new one."""
        try:
            if self._reader is None:
                self._reader = _taken()
            return self._reader.ask(request, arguments)
        except _EndedError as error:
            status = -1 if self._reader is None else self._reader.end()
            self._reader = None
            return {"status": status, "is_late": error.is_late}, None
        except BaseException:
            if self._reader is not None:
                self._reader.end()
                self._reader = None
            raise

    def close(self) -> None:
        """Let others have the process."""
        reader, self._reader = self._reader, None
        if reader is None:
            return
        if reader.is_ready():
            with _LOCK:
                _IDLE.append(reader)
        else:
            reader.end()


def _ending(answer: dict[str, Any], seconds: int) -> str:
    """Say how a process ended without an answer."""
    status = answer["status"]
    if answer["is_late"] or status == -getattr(signal, "SIGXCPU", 0):
        return f"takes more than {seconds} s"
    if status < 0:
        return f"crashed ({signal.Signals(-status).name})"
    return f"ended with status {status}"


def _taken() -> _Reader:
    """Return a process that nobody else asks."""
    while True:
        with _LOCK:
            reader = _IDLE.pop() if _IDLE else None
        if reader is None:
            return _Reader()
        if reader.is_alive():
            return reader
        reader.end()
