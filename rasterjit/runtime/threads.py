"""
Run tasks on a pool of threads, and reuse memory from frame to frame.

Tasks must write to disjoint memory: then the result has the same bits for any number of threads.
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
    pack_arguments as pack_arguments,  # Importing it makes it the packer of arguments.
)
from rasterjit.runtime.jit import Kernel
from rasterjit.runtime.spinning_threads import SPIN_SECONDS, Call, Team
from rasterjit.runtime.sysctl import read_sysctl

MIN_REUSED_BYTES = 1 << 15
"""Bytes of the smallest arrays that are reused; NumPy's allocator already reuses smaller ones."""

SIZES_PER_OCTAVE = 8
"""How many sizes blocks may have from one power of two to the next."""

MAX_IDLE_FRAMES = 2
"""Frames that a block may stay unused before its memory is freed."""

MIN_PIXELS_PER_TASK = 1 << 15
"""Fewest pixels of one task, rounded to whole rows: small frames wake no thread."""

TASKS_PER_THREAD = 8
"""Tasks for each thread: several, to balance uneven ones."""


class Workers:
    """
    A pool of threads for kernels that release the GIL, and memory for their arrays.

    Parameters
    ----------
    threads : int or None
        How many, this one included; ``None`` takes the processors this process may run on.
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = available_processors() if threads is None else threads
        self.memory = Memory()
        self._pool: ThreadPoolExecutor | None = None
        self._team: Team | None = None
        self._team_lock = forks.lock()
        self._process = os.getpid()
        self._close_count = 0
        self._frame_of_thread = threading.local()

    @contextmanager
    def frame(self) -> Iterator[None]:
        """
        Enclose the drawing of a frame in this thread; it reuses the memory of the last frame.

        Raises
        ------
        RuntimeError
            In `run` and the like, if `close` was called since the frame began.
        """
        self.memory.next_frame()
        team = self._team
        if team is not None and self._process == os.getpid():
            # Expect as many calls as in the last frame.
            with self._team_lock:
                call_count = team.next_frame()
            self._wake(team, call_count)
        outer = getattr(self._frame_of_thread, "close_count", None)
        self._frame_of_thread.close_count = self._close_count
        try:
            yield
        finally:
            self._frame_of_thread.close_count = outer

    def run(self, task: Callable[..., Any], arguments: Iterable[tuple]) -> list[Any]:
        """
        Call ``task(*args)`` for each tuple, in this thread and others; return the results in order.

        After an error no further task is begun, and the error of the first that failed is raised.
        """
        close_count = self._check_frame_open()
        calls = list(arguments)
        if self.threads == 1 or len(calls) <= 1:
            return [task(*call) for call in calls]
        if self._team is not None:
            self._team.dismiss()
        pool = self._open_pool()
        tasks, futures = _SharedTasks(task, calls), []
        try:
            for _ in range(min(self.threads, len(calls)) - 1):
                futures.append(pool.submit(tasks.work))
            tasks.work()
        except RuntimeError:
            # Errors of the tasks are raised by `get_results`.
            self._check_open(close_count)
            raise
        finally:
            tasks.waiting.clear()
            for future in futures:
                if not future.cancel():
                    future.result()
        self._check_open(close_count)
        return tasks.get_results()

    def keep_alive(self, owner: Any) -> None:
        """Do nothing: no task outlives its call. Recorded calls keep what owns their memory."""

    def call(self, kernel: Any, arguments: Iterable[tuple]) -> list[Any]:
        """
        Call a kernel for each tuple, in this thread and others; return the results in order.

        Like `run`, but threads need no GIL between calls, and begin while arguments are still being
        packed.
        """
        calls, forms = list(arguments), []
        if self.threads == 1 or len(calls) <= 1 or type(kernel) is not Kernel:
            return self.run(kernel, calls)

        def bind_calls() -> Iterator[Call]:
            for call in calls:
                form, block = kernel.bind(call)
                forms.append(form)
                yield Call(form.address, ctypes.addressof(block), (block, call))

        results = self.call_machine(bind_calls(), len(calls))
        return [form.convert_result(word) for form, word in zip(forms, results, strict=True)]

    def call_machine(
        self, calls: Iterable[Call], max_calls: int, scratch_words: int = 0
    ) -> list[int]:
        """
        Make calls of machine code, in this thread and others; return the 64-bit words they return.

        Parameters
        ----------
        calls : iterable of Call
        max_calls : int
            The most that ``calls`` yields.
        scratch_words : int
            64-bit words of each thread's scratch memory: see `Team.begin`.
        """
        close_count = self._check_frame_open()
        self._open_pool()
        with self._team_lock:
            if self._team is None:
                # With more threads than processors, a spinning one takes a processor from another.
                can_spin = self.threads <= available_processors()
                self._team = Team(self.threads - 1, SPIN_SECONDS if can_spin else 0.0)
            team = self._team
            team.begin(max_calls, scratch_words)
            try:
                for call in calls:
                    self._wake(team, team.add(call))
            finally:
                results = team.finish()
        self._check_open(close_count)
        return results

    def _wake(self, team: Team, call_count: int) -> None:
        """Wake a thread of a team for each call, as far as there are threads asleep."""
        pool = self._pool
        while pool is not None and team.awake < call_count and team.asleep:
            try:
                pool.submit(team.help, team.asleep.pop())
            except (KeyError, RuntimeError):
                # Another thread has just woken the last one, or the pool was closed.
                return

    def _open_pool(self) -> ThreadPoolExecutor:
        """Return the pool of this process; make it if there is none."""
        if self._process != os.getpid():
            # A forked process inherits the pool without its threads.
            self._pool, self._team, self._process = None, None, os.getpid()
            self._team_lock = forks.lock()
        pool = self._pool
        if pool is None:
            pool = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="rasterjit")
            self._pool, self._team = pool, None
        return pool

    def _check_frame_open(self) -> int:
        """Return how often `close` was called before this thread's frame; check it as below."""
        close_count = getattr(self._frame_of_thread, "close_count", None)
        close_count = self._close_count if close_count is None else close_count
        self._check_open(close_count)
        return close_count

    def _check_open(self, close_count: int) -> None:
        """Raise ``RuntimeError`` if `close` was called more often: since the frame began."""
        if close_count != self._close_count:
            raise RuntimeError("close() was called while a frame was being drawn")

    def close(self) -> None:
        """Shut the threads down without waiting; frames being drawn raise ``RuntimeError``."""
        self._close_count += 1
        pool, self._pool = self._pool, None
        if self._team is not None:
            self._team.dismiss()
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
        self.memory.clear()


class _SharedTasks:
    """Calls that several threads share: each takes the next one that is waiting."""

    def __init__(self, task: Callable[..., Any], calls: list[tuple]) -> None:
        self._task, self._results = task, [None] * len(calls)
        self._failed: list[tuple[int, BaseException]] = []
        self.waiting = deque(enumerate(calls))

    def work(self) -> None:
        """Make calls until none is waiting."""
        for number, call in iter(self._pop_waiting, None):
            try:
                self._results[number] = self._task(*call)
            except BaseException as error:
                self.waiting.clear()
                self._failed.append((number, error))

    def _pop_waiting(self) -> tuple[int, tuple] | None:
        """Return the number and arguments of the next call; None if there is none."""
        with suppress(IndexError):
            return self.waiting.popleft()
        return None

    def get_results(self) -> list[Any]:
        """Return the results in order, or raise the error of the first call that failed."""
        if not self._failed:
            return self._results
        _, error = min(self._failed, key=itemgetter(0))
        try:
            raise error
        finally:
            # Break the cycle: the error's traceback refers to this stack frame, which refers to it.
            self._failed.clear()
            del error


def available_processors() -> int:
    """Return how many processors this process may run on; of Apple's, the fast ones alone."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    # Threads share a frame evenly, so fast processors would wait for slow ones.
    fast = read_sysctl("hw.perflevel0.logicalcpu")
    return int.from_bytes(fast or b"", sys.byteorder) or os.cpu_count() or 1


class Memory:
    """
    A pool of memory blocks, reused from frame to frame.

    New memory is slow: the system clears every page of it when it is first touched. An array from
    here is an ordinary array. Once nothing refers to it or to a view of it, its block serves
    another array of about the same size.
    """

    def __init__(self) -> None:
        self._blocks_by_size: dict[int, list[_Block]] = {}
        self.bytes = 0
        """Bytes of all blocks."""
        self._frame_number = 0
        self._lock = forks.lock()

    def empty(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return a C-contiguous array, not initialized."""
        dtype = np.dtype(dtype)
        size = math.prod(shape) * dtype.itemsize
        if size < MIN_REUSED_BYTES:
            return np.empty(shape, dtype)
        block_size = _round_up_to_block_size(size)
        with self._lock:
            blocks = self._blocks_by_size.setdefault(block_size, [])
            for block in blocks:
                if _count_references(block) == IDLE_REFERENCES:
                    break
            else:
                block = _Block(block_size)
                blocks.append(block)
                self.bytes += block_size
            block.last_frame = self._frame_number
            return block.bytes[:size].view(dtype).reshape(shape)

    def next_frame(self) -> None:
        """
        Begin a frame: forget blocks that the last `MAX_IDLE_FRAMES` frames did not take.

        Also those whose arrays are still in use: their memory is freed with the arrays.
        """
        with self._lock:
            self._frame_number += 1
            oldest = self._frame_number - MAX_IDLE_FRAMES
            for block_size, blocks in list(self._blocks_by_size.items()):
                recent = [block for block in blocks if block.last_frame >= oldest]
                if len(recent) == len(blocks):
                    continue
                self.bytes -= block_size * (len(blocks) - len(recent))
                if recent:
                    self._blocks_by_size[block_size] = recent
                else:
                    del self._blocks_by_size[block_size]

    def clear(self) -> None:
        """Forget all blocks; arrays that are in use stay valid."""
        with self._lock:
            self._blocks_by_size.clear()
            self.bytes = 0


class ReusedMemory:
    """Memory for recorded calls: each part of a picture reuses the memory of the part before."""

    def __init__(self) -> None:
        self._blocks: list[NDArray[Any]] = []
        self._used = 0

    def begin(self) -> None:
        """Begin the next part."""
        self._used = 0

    def empty(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return a C-contiguous array, not initialized, in the memory of the last part's Nth."""
        number, dtype = self._used, np.dtype(dtype)
        self._used += 1
        size = math.prod(shape) * dtype.itemsize
        if number == len(self._blocks):
            self._blocks.append(np.empty(0, np.float64))
        if self._blocks[number].nbytes < size:
            self._blocks[number] = np.empty(-(-size // 8), np.float64)
        return self._blocks[number].view(np.uint8)[:size].view(dtype).reshape(shape)


class FrameCache:
    """
    Cache of arrays and other values from one picture to the next, by name.

    An entry is valid while all its inputs are the same (`are_same`). Pictures that are drawn at the
    same time must not share a cache: they would write to the same arrays.

    Parameters
    ----------
    memory : Memory
        Where new arrays come from.
    is_enabled : bool
        Whether anything is cached; else every value is made anew.
    """

    def __init__(self, memory: Memory, is_enabled: bool = True) -> None:
        self.memory = memory
        self.is_enabled = is_enabled
        self._entries: dict[str, tuple[tuple[Any, ...], Any]] = {}

    def get_or_make(self, name: str, make: Callable[..., Any], *inputs: Any) -> Any:
        """Return ``make(*inputs)``, or the cached result of the same inputs."""
        if not self.is_enabled:
            return make(*inputs)
        entry = self._entries.get(name)
        if entry is not None and are_same(entry[0], inputs):
            return entry[1]
        return self._store(name, inputs, make(*inputs))

    def get_or_allocate(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return an array, not initialized: the cached one, if shape and type are the same."""
        return self.get_or_make(name, self.memory.empty, shape, dtype)

    def get_or_allocate_at_least(self, name: str, count: int, dtype: Any) -> NDArray[Any]:
        """Return an array of at least ``count`` numbers: the cached one, if long enough."""
        if not self.is_enabled:
            return self.memory.empty((count,), dtype)
        entry = self._entries.get(name)
        if entry is not None and entry[0] == (dtype,) and len(entry[1]) >= count:
            return entry[1]
        # With room for a next one that is a little longer.
        return self._store(name, (dtype,), self.memory.empty((count + count // 4,), dtype))

    def copy_into(self, name: str, values: NDArray[Any], dtype: Any = None) -> NDArray[Any]:
        """Copy an array, C-contiguous, into the cached one if shape and type are the same."""
        array = self.get_or_allocate(name, values.shape, values.dtype if dtype is None else dtype)
        array[...] = values
        return array

    def _store(self, name: str, inputs: tuple[Any, ...], value: Any) -> Any:
        """Cache a value with its inputs, and return it."""
        self._entries[name] = inputs, value
        return value

    def clear(self) -> None:
        """Drop all entries."""
        self._entries.clear()


COMPARED_BY_VALUE = frozenset((bool, int, str, bytes, np.int64))
"""Types that `are_same` compares by value."""


def are_same(a: Any, b: Any) -> bool:
    """
    Tell whether two values are one object, equal plain values, or tuples of such values.

    Two arrays of equal numbers are not the same: one may be written to.
    """
    if a is b:
        return True
    kind = type(a)
    if kind is not type(b):
        return False
    if issubclass(kind, tuple):
        if len(a) != len(b):
            return False
        # The fast path: all items are the same objects.
        return all(map(is_, a, b)) or all(map(are_same, a, b))
    # 0.0 and -0.0 are equal but not the same; to take equal zeros for different ones does no harm.
    return a == b if kind in COMPARED_BY_VALUE else kind is float and a == b != 0.0


def _round_up_to_block_size(size: int) -> int:
    """Round a size, bytes, up to one of `SIZES_PER_OCTAVE` sizes in each octave."""
    step = max((1 << (size - 1).bit_length()) // (2 * SIZES_PER_OCTAVE), 1)
    return -(-size // step) * step


class _Block:
    """A block of memory, and the number of the last frame that took it."""

    __slots__ = ("bytes", "last_frame")

    def __init__(self, size: int) -> None:
        self.bytes = np.empty(size, np.uint8)
        self.last_frame = 0


def _count_references(block: _Block) -> int:
    """Return the reference count of a block's memory, those of this call included."""
    return sys.getrefcount(block.bytes)


IDLE_REFERENCES = _count_references(_Block(1))
"""Reference count of a block without views; each view adds one."""


def choose_task_size(
    count: int, min_size: int, workers: Workers, tasks_per_thread: int = TASKS_PER_THREAD
) -> int:
    """Return how many of ``count`` items one task processes; all of them on one thread."""
    if workers.threads == 1:
        return max(count, 1)
    return max(min_size, -(-count // (tasks_per_thread * workers.threads)))


def rows_per_task(shape: tuple[int, ...], workers: Workers) -> int:
    """Return how many rows of an (H, W) frame one task processes."""
    return choose_task_size(shape[0], -(-MIN_PIXELS_PER_TASK // shape[1]), workers)


def split_range(end: int, step: int, start: int = 0) -> list[tuple[int, int]]:
    """Split start .. end - 1 into parts of ``step`` numbers: (first, last + 1) of each."""
    return [(first, min(first + step, end)) for first in range(start, end, step)]


def split_into_bands(shape: tuple[int, ...], workers: Workers) -> list[tuple[int, int]]:
    """Split the rows of an (H, W) frame into a band for each task: (first, last + 1)."""
    return split_range(shape[0], rows_per_task(shape, workers))


def fill_rows(kernel: Any, face_id: NDArray[np.int32], arguments: tuple, workers: Workers) -> None:
    """Call ``kernel(face_id, (first, last + 1), *arguments)`` for each band of rows, in threads."""
    bands = split_into_bands(face_id.shape, workers)
    workers.run(kernel, [(face_id, rows, *arguments) for rows in bands])
