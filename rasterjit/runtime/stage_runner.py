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
from rasterjit.runtime.argument_plan import make_plan
from rasterjit.runtime.intrinsics import call_at, load_int64
from rasterjit.runtime.jit import Stage, raw_kernel
from rasterjit.runtime.spinning_threads import Call, aligned_words
from rasterjit.runtime.state_block import (
    WORD,
    RecordType,
    count_block_words,
    pack_in_python,
    view_block_arrays,
)


class Step(NamedTuple):
    """A stage and its further arguments."""

    stage: Stage
    arguments: tuple[Any, ...]


@raw_kernel
def run_list(table, block, first):
    """
    Run stages over blocks of samples until the first stage returns -1.

    Parameters
    ----------
    table : int
        Address of the number of stages, then the address and the state block of each.
    block : int
        Address of a block of samples.
    first : int
        0, returned.
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
    return jit.MACHINE_FUNCTION(run_list.address())


class _Layout:
    """Layout of one state block for the arguments of several stages."""

    def __init__(self, stages: tuple[Stage, ...]) -> None:
        self.names = [stage.__name__ for stage in stages]
        self.kinds = [RecordType(tuple, stage.kind.fields[1:]) for stage in stages]
        kind = RecordType(tuple, tuple(self.kinds))
        sizes = [count_block_words(kind) for kind in self.kinds]
        self.starts = [WORD * sum(sizes[:n]) for n in range(len(sizes))]
        self.addresses = [stage.address() for stage in stages]
        self.block = ctypes.c_int64 * max(sum(sizes), 1)
        self.plan = make_plan(kind)
        self.plan_address = ctypes.addressof(self.plan)

    def pack(self, arguments: tuple[tuple[Any, ...], ...], state: Any) -> None:
        """Fill a state block, ``block()``, with all arguments, which are kept alive elsewhere."""
        if jit.get_packer()(id(arguments), self.plan_address, ctypes.addressof(state)):
            words: list[int] = []
            for name, kind, of_stage in zip(self.names, self.kinds, arguments, strict=True):
                pack_in_python(kind, of_stage, words, name)
            state[: len(words)] = words


@functools.lru_cache(512)
def _layout_of(stages: tuple[Stage, ...]) -> _Layout:
    return _Layout(stages)


class StageList:
    """
    Stages with their arguments, ready to run, also in several threads at once.

    Addresses of arrays are read when a list is created; their elements, when it runs. A part may be
    another list, so that many lists share it.
    """

    def __init__(self, parts: Sequence[Step | StageList]) -> None:
        self.parts = tuple(parts)
        if jit.DISABLED or jit.CHECKED:
            return
        steps = [part for part in self.parts if isinstance(part, Step)]
        self._layout = layout = _layout_of(tuple([step.stage for step in steps]))
        self._state = layout.block()
        layout.pack(tuple([step.arguments for step in steps]), self._state)
        self._cached_table: Any = None
        base, number = ctypes.addressof(self._state), 0
        self._words: list[int] = []
        for part in self.parts:
            if isinstance(part, Step):
                self._words += layout.addresses[number], base + layout.starts[number]
                number += 1
            else:
                self._words += part._words

    def set_arguments(self, parts: Sequence[Step | StageList]) -> None:
        """Replace the arguments of the list's own stages; parts that are lists must be the same."""
        self.parts = tuple(parts)
        if jit.DISABLED or jit.CHECKED:
            return
        arguments = [part.arguments for part in self.parts if isinstance(part, Step)]
        self._layout.pack(tuple(arguments), self._state)

    def release_arguments(self) -> None:
        """Release the arguments; the list cannot run until `set_arguments`."""
        self.parts = ()

    def steps(self) -> Iterator[Step]:
        """Yield the steps of the list and of its parts, in order."""
        for part in self.parts:
            if isinstance(part, Step):
                yield part
            else:
                yield from part.steps()

    def run(self, block: NDArray[np.int64], kind: RecordType) -> None:
        """Run the stages with this thread's block of samples, from `block_memory`."""
        if jit.DISABLED or jit.CHECKED:
            self._run_in_python(view_block_arrays(kind, block))
            return
        _runner()(ctypes.addressof(self._table()), block.ctypes.data, 0)

    def call(self) -> Call:
        """Return the call by which a thread runs the stages; its scratch memory is the block."""
        table = self._table()
        return Call(run_list.address(), ctypes.addressof(table), (self, table))

    def address_of(self, number: int) -> int:
        """Return the address of the arguments of one of the list's own steps."""
        return ctypes.addressof(self._state) + self._layout.starts[number]

    def bind(self, block: NDArray[np.int64]) -> BoundList:
        """Return the words by which machine code runs the stages with a block of samples."""
        table = self._table()
        words = run_list.address(), ctypes.addressof(table), block.ctypes.data
        return BoundList(words, (self, table, block))

    def _table(self) -> Any:
        if self._cached_table is None:
            words = self._words
            self._cached_table = (ctypes.c_int64 * (1 + len(words)))(len(words) // 2, *words)
        return self._cached_table

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
    """Words by which machine code runs stages; must stay alive while these are in use."""

    words: tuple[int, int, int]
    """Addresses of `run_list`, of its table, and of the block."""
    owners: tuple[Any, ...]
    """Owners of the memory behind the addresses."""


def block_memory(kind: RecordType) -> NDArray[np.int64]:
    """Return memory for a block of samples, (n,) int64, at the beginning of a cache line."""
    return aligned_words(count_block_words(kind))


class BlockMemory(threading.local):
    """A block of samples for each thread, reused from frame to frame."""

    def __init__(self, kind: RecordType) -> None:
        self.block = block_memory(kind)
