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
    add_shared,
    call_at,
    load_int64,
    load_shared,
    rest,
    store_int64,
    swap_shared,
)
from rasterjit.runtime.jit import LOCKED_MACHINE, MACHINE, raw_kernel
from rasterjit.runtime.state_block import LINE, WORD

PATIENCE = 2e-3
"""
Seconds that a thread waits for a call before it sleeps: from the end of a picture to the first step
of the next, where these follow each other. A processor that slept may take milliseconds to wake.
"""

TICKET, DONE, LEAVE, CALLS = (LINE * n for n in range(4))
"""
Where, in the memory of a team, words lie, each in a cache line: the ticket; how many calls of this
step are made; whether to stop waiting; the address of the calls.
"""

SCRATCH, STRIDE = CALLS + WORD, CALLS + 2 * WORD
"""Where the address of the first thread's scratch memory lies, and the way to the next one's."""

CALL = 3 * WORD
"""Bytes of a call: the addresses of code and state, and what it returned."""

COUNT_BITS = 20
"""Bits of the ticket that count calls taken, then as many for all calls, then the step."""

ONE_CALL = 1 << COUNT_BITS

MAX_CALLS = ONE_CALL - 1


@raw_kernel
def make_calls(team, member, patience):
    """
    Make calls until there are none.

    Parameters
    ----------
    team : int
        Address of the memory of a team.
    member : int
        Which thread this is. The first one, 0, stops when all calls are made.
    patience : int
        How many times to look in vain before it stops.

    Returns
    -------
    int
        Whether all calls of the step are made.
    """
    mask, looks = np.int64(MAX_CALLS), np.int64(0)
    while looks < patience and (member == 0 or load_shared(team + LEAVE) == 0):
        ticket = load_shared(team + TICKET)
        number, count = ticket & mask, (ticket >> COUNT_BITS) & mask
        if number < count:
            if swap_shared(team + TICKET, ticket, ticket + 1) == ticket:
                at = load_int64(team + CALLS) + CALL * number
                scratch = load_int64(team + SCRATCH) + member * load_int64(team + STRIDE)
                word = call_at(load_int64(at), load_int64(at + WORD), scratch, np.int64(0))
                store_int64(at + 2 * WORD, word)
                add_shared(team + DONE, np.int64(1))
                looks = np.int64(0)
        elif member == 0 and load_shared(team + DONE) == count:
            return np.int64(1)
        else:
            rest()
            looks += 1
    return np.int64(0)


@raw_kernel
def add_call(team, first, stop):
    """Let one more call be made."""
    return add_shared(team + TICKET, np.int64(ONE_CALL))


@raw_kernel
def drop_calls(team, first, stop):
    """Cancel the calls that no thread has begun; they count as made."""
    mask = np.int64(MAX_CALLS)
    while True:
        ticket = load_shared(team + TICKET)
        left = ((ticket >> COUNT_BITS) & mask) - (ticket & mask)
        if swap_shared(team + TICKET, ticket, ticket + left) == ticket:
            return add_shared(team + DONE, left)


@functools.cache
def _machine(kernel: Any) -> Any:
    return MACHINE(kernel.address())


@functools.cache
def _add_call() -> Any:
    # Python's lock, once released, might not be back soon.
    return LOCKED_MACHINE(add_call.address())


def give_way() -> None:
    """Let another thread have the processor."""
    if hasattr(os, "sched_yield"):
        os.sched_yield()
    else:
        time.sleep(1e-5)


@functools.cache
def _looks_a_second() -> float:
    """Return how often a thread looks for calls in a second."""
    words, looks, seconds = lined_up(4 * LINE // WORD), 2048, []
    for _ in range(3):
        begun = time.perf_counter()
        _machine(make_calls)(words.ctypes.data, 1, looks)
        seconds.append(time.perf_counter() - begun)
    return looks / min(seconds)


class Call(NamedTuple):
    """A call of machine code: ``code(state, scratch, 0)``, with scratch of the thread's own."""

    code: int
    state: int
    kept: Any
    """What is behind the addresses."""


class Team:
    """
    Several threads that make calls: the one that wants them made, which is the first, and others.

    Parameters
    ----------
    others : int
        How many.
    patience : float
        Seconds that each waits for the next call before it sleeps.
    """

    def __init__(self, others: int, patience: float = PATIENCE) -> None:
        self._words = lined_up(4 * LINE // WORD)
        self._address = self._words.ctypes.data
        self._others, self._looks = others, 1 + int(patience * _looks_a_second())
        self._calls = np.zeros((0, CALL // WORD), np.int64)
        self._scratch = np.zeros(0, np.int64)
        self._step, self._most, self._kept = 0, 0, []
        self.asleep = set(range(1, others + 1))
        """The others that do not wait for calls."""

    def begin(self, most: int, scratch: int = 0) -> None:
        """
        Begin a step of at most so many calls.

        Parameters
        ----------
        most : int
        scratch : int
            Words of each thread's scratch memory, zero at first; calls leave it as they find it.
        """
        self._settle()
        if most > len(self._calls):
            self._calls = np.zeros((most, CALL // WORD), np.int64)
        stride = -(-scratch * WORD // LINE) * LINE // WORD
        if stride * (1 + self._others) > len(self._scratch):
            self._scratch = lined_up(stride * (1 + self._others))
        self._words[CALLS // WORD :][:3] = (
            self._calls.ctypes.data,
            self._scratch.ctypes.data,
            stride * WORD,
        )
        self._words[DONE // WORD] = self._words[LEAVE // WORD] = 0
        self._step = (self._step + 1) % (1 << (62 - 2 * COUNT_BITS))
        self._words[TICKET // WORD] = self._step << (2 * COUNT_BITS)

    def add(self, call: Call) -> int:
        """Let a call be made; return how many there are in this step."""
        count = len(self._kept)
        self._calls[count, :2] = call[:2]
        self._kept.append(call.kept)
        _add_call()(self._address, 0, 0)
        return count + 1

    def finish(self) -> list[int]:
        """
        Make calls until all are made; return what each returned.

        After an interrupt those that nobody has begun are dropped.
        """
        count = len(self._kept)
        self._most = max(self._most, count)
        try:
            self._make_calls()
        finally:
            self._settle()
        return self._calls[:count, -1].tolist()

    def _make_calls(self) -> None:
        while not _machine(make_calls)(self._address, 0, self._looks):
            # Another thread, in a call, may have no processor at the moment.
            give_way()
        self._kept.clear()

    def _settle(self) -> None:
        """End a step that was interrupted, whatever interrupts this."""
        while self._kept:
            with suppress(KeyboardInterrupt):
                _machine(drop_calls)(self._address, 0, 0)
                self._make_calls()

    def help(self, member: int) -> None:
        """Make calls, in another thread, as long as there are some now and then."""
        try:
            _machine(make_calls)(self._address, member, self._looks)
        finally:
            self.asleep.add(member)

    @property
    def awake(self) -> int:
        """How many threads do not sleep, with the one that wants calls made."""
        return 1 + self._others - len(self.asleep)

    def next_frame(self) -> int:
        """Let who is woken wait; return how many calls a step of the last frame had at most."""
        self._settle()
        self._words[LEAVE // WORD] = 0
        most, self._most = self._most, 0
        return most

    def dismiss(self) -> None:
        """Stop the other threads from spinning."""
        self._words[LEAVE // WORD] = 1


def lined_up(count: int) -> NDArray[np.int64]:
    """Return so many words, all 0, at the beginning of a cache line."""
    room = np.zeros(count + LINE // WORD, np.int64)
    start = -(room.ctypes.data // WORD) % (LINE // WORD)
    return room[start : start + count]
