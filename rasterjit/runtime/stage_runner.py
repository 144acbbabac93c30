"""
Run a list of stages over blocks of samples, in machine code, without the GIL.

The first stage of a list fills a block and returns how many samples it holds, or -1 when there are
no more. The others follow, one after the other, as long as the block holds any.
"""

from __future__ import annotations

import ctypes
import functools
import threading
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.runtime import jit
from rasterjit.runtime.argument_plan import plan_of
from rasterjit.runtime.intrinsics import call_at, load_int64
from rasterjit.runtime.jit import Stage, raw_kernel
from rasterjit.runtime.spinning_threads import Call
from rasterjit.runtime.state_block import WORD, RecordType, arrays_of_block, pack_slowly, size_of


class Step(NamedTuple):
    """A stage and its further arguments."""

    stage: Stage
    arguments: tuple[Any, ...]


@raw_kernel
def run_list(table, block, first):
    """
    Run a list of stages until the first of them finds no more samples.

    Parameters
    ----------
    table : int
        Address of the number of stages, then the address and the state block of each.
    block : int
        Address of a block of samples.
    first : int
        0.
    """
    stages = load_int64(table)
    while True:
        count = call_at(load_int64(table + WORD), load_int64(table + 2 * WORD), block, np.int64(0))
        if count < 0:
            return first
        if count > 0:
            for k in range(1, stages):
                at = table + WORD * (1 + 2 * k)
                call_at(load_int64(at), load_int64(at + WORD), block, count)


@functools.cache
def _runner() -> Any:
    return jit.MACHINE(run_list.address())


class _Layout:
    """Layout of one state block for the arguments of several stages."""

    def __init__(self, stages: tuple[Stage, ...]) -> None:
        self.names = [stage.__name__ for stage in stages]
        self.kinds = [RecordType(tuple, stage.kind.fields[1:]) for stage in stages]
        kind = RecordType(tuple, tuple(self.kinds))
        sizes = [size_of(own) for own in self.kinds]
        self.starts = [WORD * sum(sizes[:n]) for n in range(len(sizes))]
        self.addresses = [stage.address() for stage in stages]
        self.block = ctypes.c_int64 * max(sum(sizes), 1)
        self.plan = plan_of(kind)
        self.plan_address = ctypes.addressof(self.plan)

    def pack(self, arguments: tuple[tuple[Any, ...], ...], state: Any) -> None:
        """Fill a state block, ``block()``, by the arguments of all stages; it keeps none alive."""
        if jit.packer()(id(arguments), self.plan_address, ctypes.addressof(state)):
            words: list[int] = []
            for name, kind, own in zip(self.names, self.kinds, arguments, strict=True):
                pack_slowly(kind, own, words, name)
            state[: len(words)] = words


@functools.lru_cache(512)
def _layout_of(stages: tuple[Stage, ...]) -> _Layout:
    return _Layout(stages)


class StageList:
    """
    Stages with their arguments, ready to run; several threads may run one.

    The arguments are read when it is made: arrays may change their elements later, not their place.
    A part of it may be a list that was made before, so that many lists share what they have in
    common.
    """

    def __init__(self, parts: Sequence[Step | StageList]) -> None:
        self.parts = tuple(parts)
        if jit.DISABLED or jit.CHECKED:
            return
        own = [part for part in self.parts if isinstance(part, Step)]
        self._layout = layout = _layout_of(tuple([step.stage for step in own]))
        self._state = layout.block()
        layout.pack(tuple([step.arguments for step in own]), self._state)
        self._own_table: Any = None
        base, number = ctypes.addressof(self._state), 0
        self._words: list[int] = []
        for part in self.parts:
            if isinstance(part, Step):
                self._words += layout.addresses[number], base + layout.starts[number]
                number += 1
            else:
                self._words += part._words

    def renew(self, parts: Sequence[Step | StageList]) -> None:
        """Read other arguments, of the same stages; the lists that are parts of it stay as is."""
        self.parts = tuple(parts)
        if jit.DISABLED or jit.CHECKED:
            return
        own = [part.arguments for part in self.parts if isinstance(part, Step)]
        self._layout.pack(tuple(own), self._state)

    def let_go(self) -> None:
        """Release the arguments; it cannot run until `renew`."""
        self.parts = ()

    def steps(self) -> Iterator[Step]:
        """Yield its steps, in order."""
        for part in self.parts:
            if isinstance(part, Step):
                yield part
            else:
                yield from part.steps()

    def run(self, block: NDArray[np.int64], kind: RecordType) -> None:
        """Run the stages with a block of samples, `block_memory`, that no other thread uses."""
        if jit.DISABLED or jit.CHECKED:
            self._run_in_python(arrays_of_block(kind, block))
            return
        _runner()(ctypes.addressof(self._table()), block.ctypes.data, 0)

    def call(self) -> Call:
        """Return how a thread runs the stages, with a block of samples as its scratch memory."""
        table = self._table()
        return Call(run_list.address(), ctypes.addressof(table), (self, table))

    def place_of(self, number: int) -> int:
        """Return the address of the arguments of a step of its own, in machine code."""
        return ctypes.addressof(self._state) + self._layout.starts[number]

    def bound(self, block: NDArray[np.int64]) -> BoundList:
        """Return how machine code runs the stages with a block of samples."""
        table = self._table()
        words = run_list.address(), ctypes.addressof(table), block.ctypes.data
        return BoundList(words, (self, table, block))

    def _table(self) -> Any:
        if self._own_table is None:
            words = self._words
            self._own_table = (ctypes.c_int64 * (1 + len(words)))(len(words) // 2, *words)
        return self._own_table

    def _run_in_python(self, block: Any) -> None:
        first, *others = self.steps()
        while True:
            count = first.stage.run_in_python(block, 0, first.arguments)
            if count < 0:
                return
            if count:
                for step in others:
                    step.stage.run_in_python(block, count, step.arguments)


class BoundList(NamedTuple):
    """Stages that machine code runs; keep it alive while its words are in use."""

    words: tuple[int, int, int]
    """Address of `run_list`, and what it takes: the addresses of its table and of the block."""
    called: tuple[Any, ...]
    """Owners of the memory behind the addresses."""


def block_memory(kind: RecordType) -> NDArray[np.int64]:
    """Return memory for a block of samples, (n,) int64, at the beginning of a cache line."""
    words = size_of(kind)
    room = np.empty((words + 8,), np.int64)
    start = -(room.ctypes.data // WORD) % 8
    return room[start : start + words]


class BlockMemory(threading.local):
    """A block of samples for each thread, kept from one frame to the next."""

    def __init__(self, kind: RecordType) -> None:
        self.block = block_memory(kind)
