"""
Thread pool for rows and tasks, and memory that is reused from frame to frame.

Tasks write to disjoint memory, so the result has the same bits for any number of threads.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from operator import is_, itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit import forks
from rasterjit.runtime import (
    pack_arguments as pack_arguments,  # From now on, arguments are packed by it.
)
from rasterjit.runtime.jit import Kernel
from rasterjit.runtime.spinning_threads import PATIENCE, Call, Team
from rasterjit.runtime.sysctl import read_sysctl

MIN_BYTES = 1 << 15
"""Bytes of the smallest arrays that are reused; NumPy's allocator already reuses smaller ones."""

SIZE_STEPS = 8
"""Sizes of blocks from one power of two to the next."""

KEPT_FRAMES = 2
"""Frames that a block may stay unused before its memory is freed."""

PIXELS_PER_TASK = 1 << 15
"""About the fewest pixels of whole rows shaded by one task: small frames wake no thread."""

TASKS_PER_THREAD = 8
"""Tasks per thread: more than one, to balance uneven tasks."""


class Workers:
    """
    A pool of threads for kernels that release the GIL, and the memory that they work in.

    Parameters
    ----------
    threads : int or None
        How many; ``None`` takes the processors this process may run on.
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = available_processors() if threads is None else threads
        self.memory = Memory()
        self._pool: ThreadPoolExecutor | None = None
        self._team: Team | None = None
        self._team_lock = forks.lock()
        self._process = os.getpid()
        self._closed = 0
        self._frame = threading.local()

    @contextmanager
    def frame(self) -> Iterator[None]:
        """
        Draw a frame in this thread, with what memory the last one left.

        Raises
        ------
        RuntimeError
            In `run`, if `close` was called since the frame began.
        """
        self.memory.next_frame()
        team = self._team
        if team is not None and self._process == os.getpid():
            # There will be as much to do as in the last frame.
            with self._team_lock:
                calls = team.next_frame()
            self._wake(team, calls)
        before = getattr(self._frame, "begun_at", None)
        self._frame.begun_at = self._closed
        try:
            yield
        finally:
            self._frame.begun_at = before

    def run(self, task: Callable[..., Any], arguments: Iterable[tuple]) -> list[Any]:
        """
        Call ``task(*args)`` for each tuple, in this thread and others; return the results in order.

        If tasks fail, no other is begun, and the error of the first of them is raised.
        """
        begun_at = getattr(self._frame, "begun_at", None)
        begun_at = self._closed if begun_at is None else begun_at
        self._check(begun_at)
        calls = list(arguments)
        if self.threads == 1 or len(calls) <= 1:
            return [task(*call) for call in calls]
        if self._team is not None:
            self._team.dismiss()
        pool = self._awake_pool()
        tasks, helpers = _Tasks(task, calls), []
        try:
            for _ in range(min(self.threads, len(calls)) - 1):
                helpers.append(pool.submit(tasks.work))
            tasks.work()
        except RuntimeError:
            # Those of the tasks come later.
            self._check(begun_at)
            raise
        finally:
            tasks.waiting.clear()
            for helper in helpers:
                if not helper.cancel():
                    helper.result()
        self._check(begun_at)
        return tasks.results()

    def hold(self, owner: Any) -> None:
        """Keep what owns memory that tasks read as long as they may run: here the caller does."""

    def call(self, kernel: Any, arguments: Iterable[tuple]) -> list[Any]:
        """
        Call a kernel for each tuple, in this thread and others; return what it returned, in order.

        The same as `run`, but the threads do without Python's lock from call to call, and others
        begin while arguments are still being packed.
        """
        calls, forms = list(arguments), []
        if self.threads == 1 or len(calls) <= 1 or type(kernel) is not Kernel:
            return self.run(kernel, calls)

        def bound() -> Iterator[Call]:
            for own in calls:
                form, block = kernel.bind(own)
                forms.append(form)
                yield Call(form.address, ctypes.addressof(block), (block, own))

        words = self.call_machine(bound(), len(calls))
        return [form.returned(word) for form, word in zip(forms, words, strict=True)]

    def call_machine(self, calls: Iterable[Call], most: int, scratch: int = 0) -> list[int]:
        """
        Make calls of machine code, in this thread and others; return what they returned.

        Parameters
        ----------
        calls : iterable of Call
        most : int
            How many they are at most.
        scratch : int
            Words of each thread's scratch memory: see `Team.begin`.
        """
        begun_at = getattr(self._frame, "begun_at", None)
        begun_at = self._closed if begun_at is None else begun_at
        self._check(begun_at)
        self._awake_pool()
        with self._team_lock:
            if self._team is None:
                # Who waits for a call takes no processor from those who make one.
                is_crowded = self.threads > available_processors()
                self._team = Team(self.threads - 1, 0.0 if is_crowded else PATIENCE)
            team = self._team
            team.begin(most, scratch)
            try:
                for call in calls:
                    self._wake(team, team.add(call))
            finally:
                words = team.finish()
        self._check(begun_at)
        return words

    def _wake(self, team: Team, calls: int) -> None:
        """Wake as many of a team as so many calls keep busy; without a pool they sleep on."""
        pool = self._pool
        while pool is not None and team.awake < calls and team.asleep:
            try:
                pool.submit(team.help, team.asleep.pop())
            except (KeyError, RuntimeError):
                # Another thread wakes them, or the pool was closed.
                return

    def _awake_pool(self) -> ThreadPoolExecutor:
        """Return the pool of this process."""
        if self._process != os.getpid():
            # A forked process has the pool but none of its threads.
            self._pool, self._team, self._process = None, None, os.getpid()
            self._team_lock = forks.lock()
        pool = self._pool
        if pool is None:
            pool = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="rasterjit")
            self._pool, self._team = pool, None
        return pool

    def _check(self, begun_at: int) -> None:
        """Raise a RuntimeError if `close` was called since."""
        if begun_at != self._closed:
            raise RuntimeError("close() was called while a frame was being drawn")

    def close(self) -> None:
        """Shut the threads down without waiting; who still draws gets a ``RuntimeError``."""
        self._closed += 1
        pool, self._pool = self._pool, None
        if self._team is not None:
            self._team.dismiss()
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
        self.memory.clear()


class _Tasks:
    """Calls that several threads share: each takes the next one that waits."""

    def __init__(self, task: Callable[..., Any], calls: list[tuple]) -> None:
        self._task, self._results = task, [None] * len(calls)
        self._failed: list[tuple[int, BaseException]] = []
        self.waiting = deque(enumerate(calls))

    def work(self) -> None:
        """Call what waits until nothing does."""
        for number, call in iter(self._take, None):
            try:
                self._results[number] = self._task(*call)
            except BaseException as error:
                self.waiting.clear()
                self._failed.append((number, error))

    def _take(self) -> tuple[int, tuple] | None:
        with suppress(IndexError):
            return self.waiting.popleft()
        return None

    def results(self) -> list[Any]:
        """Return what was returned, or raise the error of the first call that failed."""
        if not self._failed:
            return self._results
        _, error = min(self._failed, key=itemgetter(0))
        try:
            raise error
        finally:
            # An error knows this frame, and would keep alive all that tasks hold.
            self._failed.clear()
            del error


def available_processors() -> int:
    """Return the number of processors this process may run on; of Apple's, the fast ones."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    # Threads share a frame evenly: the fast would wait for the slow.
    fast = read_sysctl("hw.perflevel0.logicalcpu")
    return int.from_bytes(fast or b"", sys.byteorder) or os.cpu_count() or 1


class Memory:
    """
    A pool of memory blocks, reused from frame to frame.

    New memory is slow: the system clears every page of it when it is first touched. An array from
    here is an ordinary array that owns its numbers for as long as anyone holds it or a view of it;
    after that its block serves another array of about the same size.
    """

    def __init__(self) -> None:
        self._shelves: dict[int, list[_Block]] = {}
        self.bytes = 0
        """How much it keeps."""
        self._frame = 0
        self._lock = forks.lock()

    def empty(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return a C-contiguous array of any contents."""
        kind = np.dtype(dtype)
        size = math.prod(shape) * kind.itemsize
        if size < MIN_BYTES:
            return np.empty(shape, kind)
        room = _block_size(size)
        with self._lock:
            shelf = self._shelves.setdefault(room, [])
            for block in shelf:
                if _references(block) == IDLE_REFERENCES:
                    break
            else:
                block = _Block(room)
                shelf.append(block)
                self.bytes += room
            block.frame = self._frame
            return block.room[:size].view(kind).reshape(shape)

    def next_frame(self) -> None:
        """
        Free blocks that the last frames did not use.

        Some may be held, by frames that are kept: they would be looked at in vain ever after.
        """
        with self._lock:
            self._frame += 1
            for room, shelf in list(self._shelves.items()):
                if all(block.frame + KEPT_FRAMES >= self._frame for block in shelf):
                    continue
                left = [block for block in shelf if block.frame + KEPT_FRAMES >= self._frame]
                self.bytes -= room * (len(shelf) - len(left))
                if left:
                    self._shelves[room] = left
                else:
                    del self._shelves[room]

    def clear(self) -> None:
        """Let go of everything; arrays that are held stay as they are."""
        with self._lock:
            self._shelves.clear()
            self.bytes = 0


class ReusedMemory:
    """Memory for recorded calls: each part of a picture reuses that of the part before."""

    def __init__(self) -> None:
        self._rooms: list[NDArray[Any]] = []
        self._taken = 0

    def begin(self) -> None:
        """Begin the next part."""
        self._taken = 0

    def empty(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return an array, as ``Memory.empty`` does; bytes of the one before at this turn."""
        number, kind = self._taken, np.dtype(dtype)
        self._taken += 1
        size = math.prod(shape) * kind.itemsize
        if number == len(self._rooms):
            self._rooms.append(np.empty(0, np.float64))
        if self._rooms[number].nbytes < size:
            self._rooms[number] = np.empty(-(-size // 8), np.float64)
        return self._rooms[number].view(np.uint8)[:size].view(kind).reshape(shape)


class Kept:
    """
    Cache of arrays and other things from one picture to the next, by name.

    An entry is valid while all its inputs are the same (`are_same`). It serves one picture at a
    time: the next one writes to the same arrays.

    Parameters
    ----------
    memory : Memory
        Where new arrays come from.
    lasts : bool
        Whether anything is kept; else all is made anew.
    """

    def __init__(self, memory: Memory, lasts: bool = True) -> None:
        self.memory = memory
        self.lasts = lasts
        self._made: dict[str, tuple[tuple[Any, ...], Any]] = {}

    def made(self, name: str, make: Callable[..., Any], *parts: Any) -> Any:
        """Return ``make(*parts)``, or what it returned before, of the same parts."""
        if not self.lasts:
            return make(*parts)
        found = self._made.get(name)
        if found is not None and are_same(found[0], parts):
            return found[1]
        return self._keep(name, parts, make(*parts))

    def empty(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return an array of any contents: the one of before, if shape and type are the same."""
        if not self.lasts:
            return self.memory.empty(shape, dtype)
        found = self._made.get(name)
        if found is not None and found[0] == (shape, dtype):
            return found[1]
        return self._keep(name, (shape, dtype), self.memory.empty(shape, dtype))

    def at_least(self, name: str, count: int, dtype: Any) -> NDArray[Any]:
        """Return an array of ``count`` numbers or more: the one of before, if it is that long."""
        if not self.lasts:
            return self.memory.empty((count,), dtype)
        found = self._made.get(name)
        if found is not None and found[0] == (dtype,) and len(found[1]) >= count:
            return found[1]
        # The next one may be a little longer.
        return self._keep(name, (dtype,), self.memory.empty((count + count // 4,), dtype))

    def copied(self, name: str, values: NDArray[Any], dtype: Any = None) -> NDArray[Any]:
        """Return a copy of an array, C-contiguous: at the place of the one before, if alike."""
        array = self.empty(name, values.shape, values.dtype if dtype is None else dtype)
        array[...] = values
        return array

    def _keep(self, name: str, parts: tuple[Any, ...], thing: Any) -> Any:
        self._made[name] = parts, thing
        return thing

    def clear(self) -> None:
        """Let go of everything."""
        self._made.clear()


PLAIN = frozenset((bool, int, str, bytes, np.int64))
"""Types that are compared by value."""


def are_same(one: Any, other: Any) -> bool:
    """
    Tell whether two things are one, or plain and equal; or tuples of such things.

    Two arrays of the same numbers are not: one may be written to.
    """
    if one is other:
        return True
    kind = type(one)
    if kind is not type(other):
        return False
    if issubclass(kind, tuple):
        if len(one) != len(other):
            return False
        # Mostly all of them are: they are not asked one by one.
        return all(map(is_, one, other)) or all(map(are_same, one, other))
    # Zeros have signs.
    return one == other if kind in PLAIN else kind is float and one == other != 0.0


def _block_size(size: int) -> int:
    """Return the next of the sizes that blocks have, bytes."""
    step = max((1 << (size - 1).bit_length()) // (2 * SIZE_STEPS), 1)
    return -(-size // step) * step


class _Block:
    """A block of memory, and the frame that took it last."""

    __slots__ = ("frame", "room")

    def __init__(self, size: int) -> None:
        self.room = np.empty(size, np.uint8)
        self.frame = 0


def _references(block: _Block) -> int:
    return sys.getrefcount(block.room)


IDLE_REFERENCES = _references(_Block(1))
"""Reference count of a block that only its shelf holds; each view adds one."""


def count_per_task(count: int, least: int, workers: Workers, tasks: int = TASKS_PER_THREAD) -> int:
    """
    Return how much of something one task does, where each thread has about so many tasks.

    At least the least; all of it on one thread.
    """
    if workers.threads == 1:
        return max(count, 1)
    return max(least, -(-count // (tasks * workers.threads)))


def rows_per_task(shape: tuple[int, ...], workers: Workers) -> int:
    """Return how many rows of a frame, (H, W), one task does."""
    return count_per_task(shape[0], -(-PIXELS_PER_TASK // shape[1]), workers)


def fill_rows(kernel: Any, face_id: NDArray[np.int32], arguments: tuple, workers: Workers) -> None:
    """Call a kernel for bands of rows."""
    height, per_task = len(face_id), rows_per_task(face_id.shape, workers)
    workers.run(
        kernel,
        [
            (face_id, (first, min(first + per_task, height)), *arguments)
            for first in range(0, height, per_task)
        ],
    )
