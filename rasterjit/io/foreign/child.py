"""
The process in which packages of others read files.

It waits for requests, lines of JSON on standard input. For each it forks, where the system can: the
copy holds itself to its limits for good, reads one file, leaves what it found in a file that both
know, and ends. What it imported before serves the next one. A line on standard output says how the
copy ended.
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

from rasterjit.io.foreign.limits import (
    Guard,
    die_with_parent,
    hold_to,
    keep_to_files,
    library_places,
    without_network,
)
from rasterjit.io.foreign.truncation import refuse_endless_reads

_OURS = ("rasterjit.io.foreign.readers", "rasterjit.io.foreign.wire")
"""Modules of this package that a copy needs."""

_PAUSE = 1.0
"""Seconds between two looks at whether anybody still waits."""

_LONGEST_SLEEP = 15.0
"""Seconds in which a copy does nothing, as one does that waits for a pipe."""

_FORKS = sys.platform == "linux"
"""Other systems' libraries do not all stand a fork."""


def serve(file: int) -> None:
    """Answer requests until there are no more; ``file`` takes what is found."""
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    silent = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        # What libraries print is nobody's answer.
        os.dup2(silent, number)
    sys.dont_write_bytecode = True
    without_network()
    refuse_endless_reads()
    if _FORKS:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
    guard = Guard()
    _answer(answers, {"ready": True})
    for line in requests:
        request = json.loads(line)
        sys.path[:] = request["sys_path"]
        for name in (*_OURS, *request["modules"]):
            # What is missing is told by who needs it.
            with contextlib.suppress(Exception):
                importlib.import_module(name)
        os.truncate(file, 0)
        if not _FORKS:
            _read(request, file, guard)
            _answer(answers, {"status": 0})
            continue
        gc.freeze()
        process = os.fork()
        if process == 0:
            status = 1
            try:
                die_with_parent()
                requests.close()
                answers.close()
                _read(request, file, guard)
                status = 0
            finally:
                os._exit(status)
        _answer(answers, _outcome(process, request["longest"], requests))


def _answer(answers: Any, what: dict[str, Any]) -> None:
    """Write a line."""
    answers.write(json.dumps(what).encode() + b"\n")


def _outcome(process: int, longest: float, requests: Any) -> dict[str, Any]:
    """Wait for a copy, and end it when it takes too long; say how it ended."""
    asked, poll = time.monotonic(), select.poll()
    poll.register(requests, 0)
    moved, before = asked, b""
    while True:
        ended, status = os.waitpid(process, os.WNOHANG)
        now = time.monotonic()
        if ended:
            return {"status": os.waitstatus_to_exitcode(status), "is_late": False}
        state = _state(process)
        if state != before or state.startswith(b"R"):
            moved, before = now, state
        is_late = now - moved > _LONGEST_SLEEP or now - asked > longest
        if is_late or poll.poll(0):
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
            return {"status": -signal.SIGKILL, "is_late": is_late}
        signal.sigtimedwait({signal.SIGCHLD}, _PAUSE)


def _state(process: int) -> bytes:
    """Return whether a process runs or sleeps, and its processor time."""
    with open(f"/proc/{process}/stat", "rb") as file:
        fields = file.read().rpartition(b")")[2].split()
    return b" ".join([fields[0], *fields[11:13]])


def _read(request: dict[str, Any], file: int, guard: Guard) -> None:
    """Do what a request asks for, within limits; leave what was found, or why not, in a file."""
    from rasterjit.io.foreign.wire import write_found

    # What a program hides from itself it hides from its readers.
    sys.modules.update(dict.fromkeys(request["hidden"]))
    os.chdir(request["folder"])
    places = [request["root"], request["path"], *library_places()]
    hold_to(request["memory"], request["seconds"])
    keep_to_files(list(map(os.path.realpath, places)))
    guard.arm(os.path.realpath(request["root"]), places[1:])
    try:
        answer = _result(request)
    finally:
        guard.disarm()
    try:
        write_found(answer, file)
    except (OSError, MemoryError):
        os.truncate(file, 0)
        write_found({"error": "MemoryError", "said": ""}, file)


def _result(request: dict[str, Any]) -> dict[str, Any]:
    """Return what a reader found, and what it said."""
    from rasterjit.io.foreign.readers import read_file
    from rasterjit.io.resources import Resources
    from rasterjit.io.skipped import LeftOut, MeshFileError
    from rasterjit.scene.memory import FileSizeError, MemoryBudget

    path = Path(request["path"])
    budget = MemoryBudget(str(path), request["max_bytes"])
    budget.left = request["left"]
    left_out = LeftOut()
    resources = Resources(path, Path(request["root"]), budget)
    answer: dict[str, Any] = {"found": None, "error": None, "said": ""}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        try:
            answer["found"] = read_file(
                path, resources, request["on_invalid"], request["on_damage"], left_out
            )
        except (MeshFileError, FileSizeError) as error:
            answer |= {"error": type(error).__name__, "said": str(error)}
        except MemoryError:
            answer["error"] = "MemoryError"
    if budget.refusal is not None:
        answer |= {"error": "FileSizeError", "said": str(budget.refusal)}
    said = [str(one.message) for one in told if one.category is UserWarning]
    return {**answer, "left": budget.left, "left_out": left_out.all(), "warnings": said}
