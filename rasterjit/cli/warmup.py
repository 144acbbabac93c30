"""Compile kernels that the store lacks: for ``warmup``, and ahead of a picture."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from rasterjit.pipeline.surface import barycentric_weights, gather_samples
from rasterjit.runtime import background_compile
from rasterjit.runtime.background_compile import Task


def list_first_tasks() -> list[Task]:
    """Return tasks for the slowest kernels of every colour picture."""
    return background_compile.make_compile_tasks(
        (gather_samples.list_samples, barycentric_weights.find_weights)
    )


def list_missing() -> list[Task]:
    """Return tasks for every form of a kernel or stage that the store lacks."""
    return background_compile.make_compile_tasks(background_compile.find_every_kernel())


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
    tasks = list_missing()
    done = itertools.count(1)
    tell(0, len(tasks))
    failed = tasks
    if background_compile.can_start_process():
        failed = background_compile.run_tasks(tasks, lambda: tell(next(done), len(tasks)))
    # Here, what went wrong shows.
    for task in failed:
        background_compile.compile_if_missing(*task.arguments)
