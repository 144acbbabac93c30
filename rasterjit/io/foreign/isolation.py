"""
Let other packages read files and decode data in a process with limits.

It is started for the first such file, waits for the next one, and
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
from rasterjit.io.foreign.readers import list_reader_modules
from rasterjit.io.foreign.serialization import read_value, write_value
from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.resources import Resources, extension_of
from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.warning import warn_caller

_BASE_CPU_SECONDS, _CPU_SECONDS_PER_MB = 10, 10
"""Processor time allowed for a file, and for each megabyte of it."""

_WALL_CLOCK_FACTOR = 20.0 if sys.platform == "linux" else 4.0
"""Wall-clock time allowed, as a multiple of the processor time, which some systems cannot
limit."""

_START_TIMEOUT_SECONDS = 60.0
"""Seconds within which the process must be ready, or kill its fork."""

_MAX_UNCOUNTED_BYTES = 1 << 20
"""Bytes of a result that are not counted: names, numbers and notes."""

_HINT = "isolate=False reads it in this process, without limits"

_NO_FILE = Path(os.devnull)

_PACKAGE = Path(__file__).parents[2]

_START_SCRIPT = """
import json, sys, types
config = json.loads(sys.stdin.buffer.readline())
sys.path[:] = config["path"]
package = types.ModuleType(config["name"])
package.__path__ = [config["package"]]
sys.modules[config["name"]] = package
from rasterjit.io.foreign.child import serve
import os
file = config["file"]
if isinstance(file, str):
    file = os.open(file, os.O_RDWR | os.O_BINARY | os.O_TEMPORARY)
serve(file)
"""
"""Imports the readers without the package's public names, which would import everything."""

_SINGLE_THREADED = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "MALLOC_ARENA_MAX"), "1"
)
"""Environment variables that keep libraries single-threaded: the process forks."""

_LOCK = forks.lock()
_IDLE_READERS: list[_ReaderProcess] = []
_ALL_READERS: set[_ReaderProcess] = set()


class _ProcessEndedError(Exception):
    """The process ended without an answer, perhaps because it was too late."""

    def __init__(self, is_late: bool = False) -> None:
        super().__init__()
        self.is_late = is_late


class _ReaderProcess:
    """A process that reads files."""

    def __init__(self) -> None:
        self._results, name = _open_result_file()
        self._is_busy = False
        """Whether it keeps a fork for further requests of a file."""
        number = self._results.fileno()
        command = [spawn.get_executable(), "-I", "-S", "-c", _START_SCRIPT]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            pass_fds=() if name else (number,), env={**os.environ, **_SINGLE_THREADED},
            # Ctrl-C must not interrupt the child.
            start_new_session=os.name == "posix",
        )  # fmt: skip
        configuration = {
            "path": _get_module_path(), "package": str(_PACKAGE),
            "name": __name__.partition(".")[0], "file": name or number,
        }  # fmt: skip
        with _LOCK:
            _ALL_READERS.add(self)
        try:
            self._send(configuration)
            self._receive(_START_TIMEOUT_SECONDS)
        except BaseException:
            self.kill()
            raise

    def ask(
        self, request: dict[str, Any], arguments: Sequence[Any] = ()
    ) -> tuple[dict[str, Any], Any]:
        """Send a request; return the status of the process and the result, if any."""
        if arguments:
            write_value(arguments, self._results.fileno())
        self._send(request)
        status = self._receive(request["timeout"] + _START_TIMEOUT_SECONDS)
        self._is_busy = not status.get("has_ended", request["is_last"])
        result = None
        if status["status"] == 0:
            file = self._results.fileno()
            is_large = os.fstat(file).st_size > request["left"] + _MAX_UNCOUNTED_BYTES
            try:
                result = {"error": "MemoryError"} if is_large else read_value(file)
            except ValueError as error:
                raise _ProcessEndedError from error
        # Its memory is free again.
        self._results.truncate(0)
        return status, result

    def _send(self, what: dict[str, Any]) -> None:
        """Write a value as a line of JSON to the process."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(what).encode() + b"\n")
            self._process.stdin.flush()
        except OSError as error:
            raise _ProcessEndedError from error

    def _receive(self, timeout: float) -> dict[str, Any]:
        """Return the next line of the process; kill it after a time limit."""
        assert self._process.stdout is not None
        is_over = threading.Event()

        def end() -> None:
            """End the process when time is over."""
            is_over.set()
            self._process.kill()

        clock = threading.Timer(timeout, end)
        clock.daemon = True
        clock.start()
        try:
            line = self._process.stdout.readline()
        finally:
            clock.cancel()
        if not line.endswith(b"\n"):
            raise _ProcessEndedError(is_over.is_set())
        status: dict[str, Any] = json.loads(line)
        return status

    def is_alive(self) -> bool:
        """Tell whether the process still runs."""
        return self._process.poll() is None

    def finish_file(self) -> bool:
        """End the requests of a file; tell whether the process can serve another one."""
        if not self._is_busy:
            return True
        try:
            self._is_busy = False
            self._send({"end": True})
            return bool(self._receive(_START_TIMEOUT_SECONDS)["status"] == 0)
        except _ProcessEndedError:
            return False

    def kill(self) -> int:
        """Kill the process; return its exit status."""
        with _LOCK:
            _ALL_READERS.discard(self)
        self._process.kill()
        self.close()
        return self._process.wait()

    def close(self) -> None:
        """Close the pipes and the file of results."""
        for one in (self._process.stdin, self._process.stdout, self._results):
            if one is not None:
                with contextlib.suppress(OSError):
                    one.close()

    def detach(self) -> None:
        """Close the pipes in a forked child; the process belongs to the parent."""
        self.close()
        self._process.returncode = 0


def _get_module_path() -> list[str]:
    """Return ``sys.path`` with absolute paths."""
    folder = _get_working_folder()
    return [os.path.join(folder, one) for one in sys.path]


def _get_working_folder() -> str:
    """Return the current folder; the root if it was removed."""
    try:
        return os.getcwd()
    except OSError:
        return os.sep


def _open_result_file() -> tuple[Any, str | None]:
    """Return a file for results, and its name if the process must open it by name."""
    if hasattr(os, "memfd_create"):
        return open(os.memfd_create("rasterjit", os.MFD_CLOEXEC), "w+b", buffering=0), None
    file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
    return file, None if os.name == "posix" else file.name


def _kill_all() -> None:
    """Kill all processes at exit."""
    for one in list(_ALL_READERS):
        one.kill()


def _detach_all() -> None:
    """Detach a forked child from the processes of its parent."""
    while _ALL_READERS:
        _ALL_READERS.pop().detach()
    _IDLE_READERS.clear()


atexit.register(_kill_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_detach_all)


def read_isolated(
    path: Path, resources: Resources, on_invalid: OnInvalid, on_damage: str, left_out: LeftOut
) -> Any:
    """
    Read a file with `read_file` in an isolated process.

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
    with closing(Session(resources.budget, path, resources.root, path.stat().st_size)) as session:
        result = session.request(
            "its reader", list_reader_modules(extension_of(path)), on_damage=on_damage,
            on_invalid=on_invalid,
        )  # fmt: skip
    left_out.extend(result["left_out"])
    for text in result["warnings"]:
        warn_caller(text)
    return result["value"]


class Session:
    """
    The requests for one file: to read it, or to decode its compressed data one by one.

    Parameters
    ----------
    budget : MemoryBudget
    path, root : Path
        The file and the folder that the process may read; neither for a session that decodes.
    size : int
        Bytes of the file; those that are decoded are added.
    """

    def __init__(
        self, budget: MemoryBudget, path: Path = _NO_FILE, root: Path = _NO_FILE, size: int = 0
    ) -> None:
        self._budget, self._size = budget, size
        self._file = {"path": str(path), "root": str(root), "source": budget.source,
                      "max_bytes": budget.max_bytes}  # fmt: skip
        self._reader: _ReaderProcess | None = None

    def decode(self, name: str, arguments: Sequence[Any]) -> Any:
        """
        Return what a codec makes of its arguments.

        Raises
        ------
        ValueError
            If the data are damaged. If the process crashes or reaches a limit, a
            `MeshFileError`, and the budget refuses all else.
        """
        codec = CODECS[name]
        try:
            return self.request(codec.library, codec.modules, arguments, codec=name)["value"]
        except MeshFileError as error:
            self._budget.refuse(error)

    def request(
        self, reader_name: str, modules: Sequence[str], arguments: Sequence[Any] = (), **more: Any
    ) -> dict[str, Any]:
        """
        Return the result of a request.

        Raises
        ------
        MeshFileError
            Also if the process crashes or reaches a limit.
        ValueError
        """
        budget = self._budget
        self._size += sum(len(one) for one in arguments if isinstance(one, bytes))
        seconds = _BASE_CPU_SECONDS + _CPU_SECONDS_PER_MB * self._size // 1_000_000
        request = {
            **self._file, **more, "modules": modules, "left": budget.left, "seconds": seconds,
            "timeout": _WALL_CLOCK_FACTOR * seconds, "has_arguments": bool(arguments),
            "is_last": not arguments,
        }  # fmt: skip
        if self._reader is None:
            request |= {
                "folder": _get_working_folder(), "sys_path": _get_module_path(),
                "memory": 2 * budget.left,
                "hidden": [name for name, one in sys.modules.items() if one is None],
            }  # fmt: skip
        could_not = f"{budget.source} could not be read as .{extension_of(Path(budget.source))}"
        try:
            answer, result = self._ask(request, arguments)
        except OSError as error:
            raise MeshFileError(
                f"{could_not}: no process can be started for it ({error}); {_HINT}"
            ) from error
        if result is None:
            raise MeshFileError(
                f"{could_not}: {reader_name} {_describe_end(answer, seconds)}; {_HINT}"
            )
        if result["error"] == "FileSizeError":
            budget.refuse(FileSizeError(result["message"]))
        if result["error"] == "MemoryError":
            raise MeshFileError(
                f"{could_not}: it needs more memory than max_bytes = {budget.max_bytes:,} allows"
            )
        if result["error"] is not None:
            kind = MeshFileError if result["error"] == "MeshFileError" else ValueError
            raise kind(result["message"])
        budget.left = result["left"]
        return result

    def _ask(self, request: dict[str, Any], arguments: Sequence[Any]) -> tuple[dict[str, Any], Any]:
        """Send a request to an idle process, or to a new one."""
        try:
            if self._reader is None:
                self._reader = _acquire_reader()
            return self._reader.ask(request, arguments)
        except _ProcessEndedError as error:
            status = -1 if self._reader is None else self._reader.kill()
            self._reader = None
            return {"status": status, "is_late": error.is_late}, None
        except BaseException:
            if self._reader is not None:
                self._reader.kill()
                self._reader = None
            raise

    def close(self) -> None:
        """Release the process for other files."""
        reader, self._reader = self._reader, None
        if reader is None:
            return
        if reader.finish_file():
            with _LOCK:
                _IDLE_READERS.append(reader)
        else:
            reader.kill()


def _describe_end(status: dict[str, Any], seconds: int) -> str:
    """Describe how a process ended without an answer."""
    exit_code = status["status"]
    if status["is_late"] or exit_code == -getattr(signal, "SIGXCPU", 0):
        return f"takes more than {seconds} s"
    if exit_code < 0:
        return f"crashed ({signal.Signals(-exit_code).name})"
    return f"ended with status {exit_code}"


def _acquire_reader() -> _ReaderProcess:
    """Return an idle process, or a new one."""
    while True:
        with _LOCK:
            reader = _IDLE_READERS.pop() if _IDLE_READERS else None
        if reader is None:
            return _ReaderProcess()
        if reader.is_alive():
            return reader
        reader.kill()
