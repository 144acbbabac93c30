"""
Spinning threads that make calls of machine code, from one step of a frame to the next.

Waking a thread takes longer than most steps of a small frame. The threads of a team spin in machine
code, without the GIL; the first free one takes a call. They sleep when idle for a while.

The next call and the number of calls are one word, the ticket. Taking a call is an atomic increment
of it, so no call is made twice, and none of a finished step.
"""

from __future__ import annotations

import functools
import os
import time
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.runtime.intrinsics import (
    add_atomic,
    call_at,
    compare_exchange,
    load_atomic,
    load_int64,
    pause_cpu,
    store_int64,
)
from rasterjit.runtime.jit import MACHINE_FUNCTION, MACHINE_FUNCTION_WITH_GIL, raw_kernel
from rasterjit.runtime.state_block import LINE, WORD

SPIN_SECONDS = 2e-3
"""
How long a thread waits for a call before it sleeps: longer than from the end of one picture to the
first step of the next. A processor that slept may take milliseconds to wake.
"""

TICKET, CALLS_MADE, STOP_SPINNING, CALLS = (LINE * n for n in range(4))
"""
Byte offsets of words in a team's memory, each in a cache line: the ticket; how many calls of this
step are made; whether to stop spinning; the address of the calls.
"""

SCRATCH, SCRATCH_STRIDE = CALLS + WORD, CALLS + 2 * WORD
"""Offsets of the first thread's scratch memory's address, and of the bytes to the next one."""

CALL_BYTES = 3 * WORD
"""Bytes of a call: the addresses of code and state, and what it returned."""

COUNT_BITS = 20
"""Bits of the ticket for calls taken, as many for all calls; the rest number the step."""

ONE_CALL = 1 << COUNT_BITS

MAX_CALLS = ONE_CALL - 1


@raw_kernel
def make_calls(team, member, max_polls):
    """
    Make calls until there are none.

    Parameters
    ----------
    team : int
        Address of the memory of a team.
    member : int
        Number of the thread. Thread 0 stops when all calls are made.
    max_polls : int
        Polls without a call after which the thread stops.

    Returns
    -------
    int
        Whether all calls of the step are made.
    """
    mask, polls = np.int64(MAX_CALLS), np.int64(0)
    while polls < max_polls and (member == 0 or load_atomic(team + STOP_SPINNING) == 0):
        ticket = load_atomic(team + TICKET)
        number, count = ticket & mask, (ticket >> COUNT_BITS) & mask
        if number < count:
            if compare_exchange(team + TICKET, ticket, ticket + 1) == ticket:
                at = load_int64(team + CALLS) + CALL_BYTES * number
                scratch = load_int64(team + SCRATCH) + member * load_int64(team + SCRATCH_STRIDE)
                word = call_at(load_int64(at), load_int64(at + WORD), scratch, np.int64(0))
                store_int64(at + 2 * WORD, word)
                add_atomic(team + CALLS_MADE, np.int64(1))
                polls = np.int64(0)
        elif member == 0 and load_atomic(team + CALLS_MADE) == count:
            return np.int64(1)
        else:
            pause_cpu()
            polls += 1
    return np.int64(0)


@raw_kernel
def add_call(team, first, stop):
    """Add a call, already in memory, to the step."""
    return add_atomic(team + TICKET, np.int64(ONE_CALL))


@raw_kernel
def drop_calls(team, first, stop):
    """Cancel the calls that no thread has begun; count them as made."""
    mask = np.int64(MAX_CALLS)
    while True:
        ticket = load_atomic(team + TICKET)
        not_begun = ((ticket >> COUNT_BITS) & mask) - (ticket & mask)
        if compare_exchange(team + TICKET, ticket, ticket + not_begun) == ticket:
            return add_atomic(team + CALLS_MADE, not_begun)


@functools.cache
def _machine(kernel: Any) -> Any:
    return MACHINE_FUNCTION(kernel.address())


@functools.cache
def _add_call() -> Any:
    # Python's lock, once released, might not be back soon.
    return MACHINE_FUNCTION_WITH_GIL(add_call.address())


def yield_processor() -> None:
    """Yield the processor to another thread."""
    if hasattr(os, "sched_yield"):
        os.sched_yield()
    else:
        time.sleep(1e-5)


@functools.cache
def _count_polls_per_second() -> float:
    """Measure how often per second a thread polls for calls."""
    words, polls, seconds = aligned_words(4 * LINE // WORD), 2048, []
    for _ in range(3):
        started = time.perf_counter()
        _machine(make_calls)(words.ctypes.data, 1, polls)
        seconds.append(time.perf_counter() - started)
    return polls / min(seconds)


class Call(NamedTuple):
    """A call of machine code: ``code(state, scratch, 0)``, with the thread's scratch memory."""

    code: int
    state: int
    owner: Any
    """Owner of the memory behind the addresses."""


class Team:
    """
    Several threads that make calls: the caller's, which is thread 0, and helpers.

    Parameters
    ----------
    helpers : int
        Number of helpers.
    spin_seconds : float
        How long each waits for the next call before it sleeps.
    """

    def __init__(self, helpers: int, spin_seconds: float = SPIN_SECONDS) -> None:
        self._words = aligned_words(4 * LINE // WORD)
        self._address = self._words.ctypes.data
        self._helpers = helpers
        self._max_polls = 1 + int(spin_seconds * _count_polls_per_second())
        self._calls = np.zeros((0, CALL_BYTES // WORD), np.int64)
        self._scratch = np.zeros(0, np.int64)
        self._step_number, self._max_calls, self._owners = 0, 0, []
        self.asleep = set(range(1, helpers + 1))
        """Numbers of the helpers that do not spin."""

    def begin(self, max_calls: int, scratch_words: int = 0) -> None:
        """
        Begin a step.

        Parameters
        ----------
        max_calls : int
        scratch_words : int
            Each thread's scratch memory, 64-bit words, zero at first; calls must restore it.
        """
        self._finish_interrupted_step()
        if max_calls > len(self._calls):
            self._calls = np.zeros((max_calls, CALL_BYTES // WORD), np.int64)
        stride = -(-scratch_words * WORD // LINE) * LINE // WORD
        if stride * (1 + self._helpers) > len(self._scratch):
            self._scratch = aligned_words(stride * (1 + self._helpers))
        self._words[CALLS // WORD :][:3] = (
            self._calls.ctypes.data,
            self._scratch.ctypes.data,
            stride * WORD,
        )
        self._words[CALLS_MADE // WORD] = self._words[STOP_SPINNING // WORD] = 0
        self._step_number = (self._step_number + 1) % (1 << (62 - 2 * COUNT_BITS))
        self._words[TICKET // WORD] = self._step_number << (2 * COUNT_BITS)

    def add(self, call: Call) -> int:
        """Add a call; return how many calls this step has."""
        count = len(self._owners)
        self._calls[count, :2] = call[:2]
        self._owners.append(call.owner)
        _add_call()(self._address, 0, 0)
        return count + 1

    def finish(self) -> list[int]:
        """
        Make calls until all are made; return what each returned.

        After an interrupt, calls that no thread has begun are dropped.
        """
        count = len(self._owners)
        self._max_calls = max(self._max_calls, count)
        try:
            self._make_calls()
        finally:
            self._finish_interrupted_step()
        return self._calls[:count, -1].tolist()

    def _make_calls(self) -> None:
        while not _machine(make_calls)(self._address, 0, self._max_polls):
            # The thread of an unfinished call may have no processor at the moment.
            yield_processor()
        self._owners.clear()

    def _finish_interrupted_step(self) -> None:
        """End a step that was interrupted, ignoring further interrupts."""
        while self._owners:
            with suppress(KeyboardInterrupt):
                _machine(drop_calls)(self._address, 0, 0)
                self._make_calls()

    def help(self, member: int) -> None:
        """Make calls, in a helper thread, until none comes for `SPIN_SECONDS`."""
        try:
            _machine(make_calls)(self._address, member, self._max_polls)
        finally:
            self.asleep.add(member)

    @property
    def awake(self) -> int:
        """How many threads do not sleep, thread 0 included."""
        return 1 + self._helpers - len(self.asleep)

    def next_frame(self) -> int:
        """Let helpers spin again; return the most calls that a step of the last frame had."""
        self._finish_interrupted_step()
        self._words[STOP_SPINNING // WORD] = 0
        max_calls, self._max_calls = self._max_calls, 0
        return max_calls

    def dismiss(self) -> None:
        """Stop the helpers from spinning."""
        self._words[STOP_SPINNING // WORD] = 1


def aligned_words(count: int) -> NDArray[np.int64]:
    """Return 64-bit words, all 0, at the beginning of a cache line."""
    memory = np.zeros(count + LINE // WORD, np.int64)
    start = -(memory.ctypes.data // WORD) % (LINE // WORD)
    return memory[start : start + count]
