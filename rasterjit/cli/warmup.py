"""Compile ahead what the store lacks: for the command ``warmup``, and for a picture to come."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from rasterjit.classics import framebuffer as framebuffer  # Its kernels are in the list, too.
from rasterjit.pipeline.surface import listing, weights
from rasterjit.runtime import ahead, driver, jit, packing
from rasterjit.runtime.ahead import Task


def first_tasks() -> list[Task]:
    """Return tasks that compile what every picture in colour needs, and takes long."""
    return ahead.compiling((listing.list_samples, weights.find_weights))


def compile_all(tell: Callable[[int, int], None]) -> None:
    """
    Fill the store with every form of every kernel and stage.

    Parameters
    ----------
    tell : callable
        Called with how many are done, and how many there are.

    Raises
    ------
    Exception
        What could not be compiled.
    """
    # What has several forms takes longest: first, so that no process ends long after the others.
    kernels = sorted(jit.KERNELS, key=lambda kernel: -len(kernel.declared))
    tasks = ahead.compiling((packing.pack, driver.run_list, *kernels, *jit.STAGES))
    done = itertools.count(1)
    tell(0, len(tasks))
    failed = tasks
    if ahead.is_possible():
        failed = ahead.do_all(tasks, lambda: tell(next(done), len(tasks)))
    # Here, what went wrong shows.
    for task in failed:
        ahead.compile_one(*task.arguments)
