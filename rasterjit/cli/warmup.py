"""Compile ahead what the store lacks: for the command ``warmup``, and for a picture to come."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

from rasterjit.classics import framebuffer as framebuffer  # Its kernels are in the list, too.
from rasterjit.pipeline.surface import listing, weights
from rasterjit.rendering.plan import list_kernels
from rasterjit.rendering.sketch import list_stages, short_name
from rasterjit.runtime import ahead, driver, jit, packing
from rasterjit.runtime.ahead import Task
from rasterjit.survey.plan import RenderPlan


def first_tasks() -> list[Task]:
    """Return tasks that compile what every picture in colour needs, and takes long."""
    return ahead.compiling((listing.list_samples, weights.find_weights))


def tasks_of(plan: RenderPlan) -> list[Task]:
    """Return tasks that compile what a frame will call in any case, the last first."""
    known = {_name(one): one for one in (*jit.KERNELS, *jit.STAGES)}
    names = [told.name for told in list_kernels(plan) if not (told.variant or told.condition)]
    names += [told.name for told in list_stages(plan)]
    found = [known[name] for name in dict.fromkeys(names)]
    return ahead.compiling(found[::-1], usual=True)


def _name(function: Any) -> str:
    return f"{short_name(function.__module__)}.{function.__name__}"


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
