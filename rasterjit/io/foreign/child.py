"""
The child process in which other packages read files and decode data.

It waits for requests, lines of JSON on standard input. For the first of a file it forks, where the
system can: the copy holds itself to its limits for good, does what is asked, leaves what it found
in a file that both know, and ends; if more is to come it first waits for that. It speaks to this
process alone. What this one imported before serves the next copy. A line on standard output says
how each request ended.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import select
import signal
import sys
import time
import warnings
from pathlib import Path
from typing import Any

from rasterjit.io.foreign import sandbox

_READER_MODULES = ("rasterjit.io.foreign.readers", "rasterjit.io.foreign.serialization")
"""Modules of this package that a fork needs."""

_POLL_SECONDS = 1.0
"""Seconds between two checks of whether the parent still waits."""

_MAX_IDLE_SECONDS = 15.0
"""Seconds after which a fork that does nothing is killed."""

_FORKS = sys.platform == "linux"
"""Whether a fork serves each file: other systems' libraries may not survive one."""


def serve(file: int) -> None:
    """Serve requests until standard input ends; ``file`` carries arguments and results."""
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    silent = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        # What libraries print is nobody's answer.
        os.dup2(silent, number)
    sys.dont_write_bytecode = True
    sandbox.isolate_network()
    sandbox.limit_empty_reads()
    guard = sandbox.Guard()
    _send(answers, {"ready": True})
    for line in requests:
        request = json.loads(line)
        if "end" not in request:
            _import_modules(request)
            if _FORKS:
                _serve_by_fork(request, file, guard, requests, answers)
                continue
            if "hidden" in request:
                _apply_limits(request, guard)
            _run_request(request, file, guard, sandbox.measure_cpu_seconds())
        _send(answers, {"status": 0})


def _send(answers: Any, what: dict[str, Any]) -> None:
    """Write a value as a line of JSON."""
    answers.write(json.dumps(what).encode() + b"\n")


def _import_modules(request: dict[str, Any]) -> None:
    """Import the modules of a request, for all forks to come."""
    sys.path[:] = request.get("sys_path", sys.path)
    for name in (*_READER_MODULES, *request["modules"]):
        # What is missing is told by who needs it.
        with contextlib.suppress(Exception):
            importlib.import_module(name)
    # Found here, it is known to the copies.
    sandbox.list_library_paths()


def _serve_by_fork(
    request: dict[str, Any], file: int, guard: sandbox.Guard, requests: Any, answers: Any
) -> None:
    """Let a fork of this process serve a request and those that follow, until it ends."""
    child_in, to_child = os.pipe()
    from_child, child_out = os.pipe()
    gc.freeze()
    process = os.fork()
    if process == 0:
        try:
            sandbox.die_with_parent()
            for one in (requests, answers):
                one.close()
            for number in (to_child, from_child):
                os.close(number)
            _run_fork(request, file, guard, child_in, child_out)
        finally:
            os._exit(1)
    os.close(child_in)
    os.close(child_out)
    try:
        while True:
            answer = _wait_for(process, from_child, request["timeout"], requests)
            _send(answers, answer)
            if answer["has_ended"]:
                return
            line = requests.readline()
            request = json.loads(line) if line else {"end": True}
            if "end" in request:
                _kill(process)
                _send(answers, {"status": 0})
                return
            _import_modules(request)
            with contextlib.suppress(BrokenPipeError):
                os.write(to_child, line)
    finally:
        os.close(to_child)
        os.close(from_child)


def _run_fork(
    request: dict[str, Any], file: int, guard: sandbox.Guard, child_in: int, child_out: int
) -> None:
    """Run one request after the other within limits, and exit after the last one."""
    start = sandbox.measure_cpu_seconds()
    _apply_limits(request, guard)
    with os.fdopen(child_in, "rb") as following:
        while True:
            _run_request(request, file, guard, start)
            if request["is_last"]:
                os._exit(0)
            os.write(child_out, b".")
            request = json.loads(following.readline())


def _wait_for(process: int, from_child: int, limit: float, requests: Any) -> dict[str, Any]:
    """Wait until a fork has answered or ended; kill it after the time limit; return which."""
    begin, poll = time.monotonic(), select.poll()
    poll.register(requests, 0)
    poll.register(from_child, select.POLLIN)
    last_active, before = begin, b""
    while True:
        events = dict(poll.poll(1000.0 * _POLL_SECONDS))
        if from_child in events:
            if os.read(from_child, 1):
                return {"status": 0, "has_ended": False}
            return {**_kill(process), "is_late": False}
        now, state = time.monotonic(), _read_state(process)
        if state != before or state.startswith(b"R"):
            last_active, before = now, state
        is_late = now - last_active > _MAX_IDLE_SECONDS or now - begin > limit
        if is_late or events:
            return {**_kill(process), "is_late": is_late}


def _kill(process: int) -> dict[str, Any]:
    """Kill a fork if it still runs; return its exit status and peak memory, bytes."""
    os.kill(process, signal.SIGKILL)
    _, status, usage = os.wait4(process, 0)
    peak = 1024 * usage.ru_maxrss
    return {"status": os.waitstatus_to_exitcode(status), "has_ended": True, "peak": peak}


def _read_state(process: int) -> bytes:
    """Return a process's state letter and processor time, of /proc."""
    with open(f"/proc/{process}/stat", "rb") as file:
        fields = file.read().rpartition(b")")[2].split()
    return b" ".join([fields[0], *fields[11:13]])


def _apply_limits(request: dict[str, Any], guard: sandbox.Guard) -> None:
    """Restrict this process to the files and memory that a request allows."""
    root, path = os.path.realpath(request["root"]), os.path.realpath(request["path"])
    paths = [root, path, *sandbox.list_library_paths()]
    # What a program hides from itself it hides from its readers. Where nothing forks, this process
    # has run requests before.
    for name in [name for name, module in sys.modules.items() if module is None]:
        del sys.modules[name]
    sys.modules.update(dict.fromkeys(request["hidden"]))
    os.chdir(request["folder"])
    sandbox.limit_memory(request["memory"])
    sandbox.restrict_files(paths)
    guard.restrict(root, paths)


def _run_request(request: dict[str, Any], file: int, guard: sandbox.Guard, start: int) -> None:
    """Run a request; write its result, or the reason for none, to a file."""
    from rasterjit.io.foreign.serialization import read_value, write_value

    sandbox.limit_cpu_time(start + request["seconds"])
    arguments = read_value(file) if request["has_arguments"] else ()
    os.truncate(file, 0)
    guard.is_armed = True
    try:
        result = _compute_result(request, arguments)
    finally:
        guard.is_armed = False
    try:
        write_value(result, file)
    except (OSError, MemoryError):
        os.truncate(file, 0)
        write_value({"error": "MemoryError", "message": ""}, file)


def _compute_result(request: dict[str, Any], arguments: Any) -> dict[str, Any]:
    """Return the result of a reader or codec, with its errors, warnings and notes."""
    from rasterjit.io.foreign.codecs import CODECS
    from rasterjit.io.foreign.readers import read_file
    from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
    from rasterjit.io.resources import Resources
    from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget

    path, codec = Path(request["path"]), request.get("codec")
    budget = MemoryBudget(request["source"], request["max_bytes"])
    budget.left = request["left"]
    left_out = LeftOut()
    result: dict[str, Any] = {"value": None, "error": None, "message": ""}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        try:
            if codec is not None:
                result["value"] = CODECS[codec].decode(*arguments, budget)
            else:
                resources = Resources(path, Path(request["root"]), budget)
                result["value"] = read_file(
                    path, resources, request["on_invalid"], request["on_damage"], left_out
                )
        except (MeshFileError, FileSizeError) as error:
            result |= {"error": type(error).__name__, "message": str(error)}
        except MemoryError:
            result["error"] = "MemoryError"
        except Exception as error:
            # Codecs raise what they like about damaged data.
            if codec is None:
                raise
            result |= {"error": "ValueError", "message": reason_of(error)}
    if budget.refusal is not None:
        result |= {"error": "FileSizeError", "message": str(budget.refusal)}
    messages = [str(one.message) for one in caught if one.category is UserWarning]
    return {**result, "left": budget.left, "left_out": left_out.entries(), "warnings": messages}
