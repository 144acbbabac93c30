"""
The process in which packages of others read files, and decode what files hold.

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

_OURS = ("rasterjit.io.foreign.readers", "rasterjit.io.foreign.wire")
"""Modules of this package that a copy needs."""

_PAUSE = 1.0
"""Seconds between two looks at whether anybody still waits."""

_LONGEST_SLEEP = 15.0
"""Seconds in which a copy does nothing, as one does that waits for a pipe."""

_FORKS = sys.platform == "linux"
"""Other systems' libraries do not all stand a fork."""


def serve(file: int) -> None:
    """Answer requests until there are no more; ``file`` takes what is given and what is found."""
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    silent = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        # What libraries print is nobody's answer.
        os.dup2(silent, number)
    sys.dont_write_bytecode = True
    sandbox.without_network()
    sandbox.refuse_endless_reads()
    guard = sandbox.Guard()
    _answer(answers, {"ready": True})
    for line in requests:
        request = json.loads(line)
        if "end" not in request:
            _import_for(request)
            if _FORKS:
                _serve_by_copy(request, file, guard, requests, answers)
                continue
            if "hidden" in request:
                _hold(request, guard)
            _do(request, file, guard, sandbox.seconds_used())
        _answer(answers, {"status": 0})


def _answer(answers: Any, what: dict[str, Any]) -> None:
    """Write a line."""
    answers.write(json.dumps(what).encode() + b"\n")


def _import_for(request: dict[str, Any]) -> None:
    """Import what a request needs, for all copies to come."""
    sys.path[:] = request.get("sys_path", sys.path)
    for name in (*_OURS, *request["modules"]):
        # What is missing is told by who needs it.
        with contextlib.suppress(Exception):
            importlib.import_module(name)
    # Found here, it is known to the copies.
    sandbox.library_places()


def _serve_by_copy(
    request: dict[str, Any], file: int, guard: sandbox.Guard, requests: Any, answers: Any
) -> None:
    """Have a copy of this process do a request and those that follow, until it ends."""
    asked, asks = os.pipe()
    done, says = os.pipe()
    gc.freeze()
    process = os.fork()
    if process == 0:
        try:
            sandbox.die_with_parent()
            for one in (requests, answers):
                one.close()
            for number in (asks, done):
                os.close(number)
            _be_copy(request, file, guard, asked, says)
        finally:
            os._exit(1)
    os.close(asked)
    os.close(says)
    try:
        while True:
            answer = _outcome(process, done, request["longest"], requests)
            _answer(answers, answer)
            if answer["has_ended"]:
                return
            line = requests.readline()
            request = json.loads(line) if line else {"end": True}
            if "end" in request:
                _end(process)
                _answer(answers, {"status": 0})
                return
            _import_for(request)
            with contextlib.suppress(BrokenPipeError):
                os.write(asks, line)
    finally:
        os.close(asks)
        os.close(done)


def _be_copy(
    request: dict[str, Any], file: int, guard: sandbox.Guard, asked: int, says: int
) -> None:
    """Do one request after the other, within limits, and end after the last one."""
    start = sandbox.seconds_used()
    _hold(request, guard)
    with os.fdopen(asked, "rb") as following:
        while True:
            _do(request, file, guard, start)
            if request["is_last"]:
                os._exit(0)
            os.write(says, b".")
            request = json.loads(following.readline())


def _outcome(process: int, done: int, longest: float, requests: Any) -> dict[str, Any]:
    """Wait until a copy is done or has ended, and end it when it takes too long; say which."""
    begin, poll = time.monotonic(), select.poll()
    poll.register(requests, 0)
    poll.register(done, select.POLLIN)
    moved, before = begin, b""
    while True:
        events = dict(poll.poll(1000.0 * _PAUSE))
        if done in events:
            if os.read(done, 1):
                return {"status": 0, "has_ended": False}
            return {**_end(process), "is_late": False}
        now, state = time.monotonic(), _state(process)
        if state != before or state.startswith(b"R"):
            moved, before = now, state
        is_late = now - moved > _LONGEST_SLEEP or now - begin > longest
        if is_late or events:
            return {**_end(process), "is_late": is_late}


def _end(process: int) -> dict[str, Any]:
    """End a copy, if it has not ended; return how it did, and most of the memory it had, bytes."""
    os.kill(process, signal.SIGKILL)
    _, status, usage = os.wait4(process, 0)
    peak = 1024 * usage.ru_maxrss
    return {"status": os.waitstatus_to_exitcode(status), "has_ended": True, "peak": peak}


def _state(process: int) -> bytes:
    """Return whether a process runs or sleeps, and its processor time."""
    with open(f"/proc/{process}/stat", "rb") as file:
        fields = file.read().rpartition(b")")[2].split()
    return b" ".join([fields[0], *fields[11:13]])


def _hold(request: dict[str, Any], guard: sandbox.Guard) -> None:
    """Keep this process to the files that a request allows, for good where it can."""
    root, path = os.path.realpath(request["root"]), os.path.realpath(request["path"])
    places = [root, path, *sandbox.library_places()]
    # What a program hides from itself it hides from its readers.
    sys.modules.update(dict.fromkeys(request["hidden"]))
    os.chdir(request["folder"])
    sandbox.hold_to_memory(request["memory"])
    sandbox.keep_to_files(places)
    guard.keep_to(root, places)


def _do(request: dict[str, Any], file: int, guard: sandbox.Guard, start: int) -> None:
    """Do what a request asks for; leave in a file what was found, or why not."""
    from rasterjit.io.foreign.wire import read_found, write_found

    sandbox.hold_to_seconds(start + request["seconds"])
    arguments = read_found(file) if request["is_given"] else ()
    os.truncate(file, 0)
    guard.is_armed = True
    try:
        answer = _result(request, arguments)
    finally:
        guard.is_armed = False
    try:
        write_found(answer, file)
    except (OSError, MemoryError):
        os.truncate(file, 0)
        write_found({"error": "MemoryError", "said": ""}, file)


def _result(request: dict[str, Any], arguments: Any) -> dict[str, Any]:
    """Return what a reader found or a codec made, and what was said about it."""
    from rasterjit.io.foreign.codecs import CODECS
    from rasterjit.io.foreign.readers import read_file
    from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
    from rasterjit.io.resources import Resources
    from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget

    path, codec = Path(request["path"]), request.get("codec")
    budget = MemoryBudget(request["source"], request["max_bytes"])
    budget.left = request["left"]
    left_out = LeftOut()
    answer: dict[str, Any] = {"found": None, "error": None, "said": ""}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        try:
            if codec is not None:
                answer["found"] = CODECS[codec].decode(*arguments, budget)
            else:
                resources = Resources(path, Path(request["root"]), budget)
                answer["found"] = read_file(
                    path, resources, request["on_invalid"], request["on_damage"], left_out
                )
        except (MeshFileError, FileSizeError) as error:
            answer |= {"error": type(error).__name__, "said": str(error)}
        except MemoryError:
            answer["error"] = "MemoryError"
        except Exception as error:
            # Codecs raise what they like about damaged data.
            if codec is None:
                raise
            answer |= {"error": "ValueError", "said": reason_of(error)}
    if budget.refusal is not None:
        answer |= {"error": "FileSizeError", "said": str(budget.refusal)}
    said = [str(one.message) for one in told if one.category is UserWarning]
    return {**answer, "left": budget.left, "left_out": left_out.all(), "warnings": said}
