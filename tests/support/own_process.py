"""
Run tests of a module in one process of their own, with ``usefixtures("own_process")``.

For what keeps much memory until its process ends: Mesa's OpenGL, LLVM.
"""

from __future__ import annotations

import importlib
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest


def begin(filters):
    """Treat warnings as the process of the tests does."""
    for action, message, category, *_ in reversed(filters):
        warnings.filterwarnings(action, message.pattern if message else "", category)


def run(module, name, arguments):
    """Run a test."""
    getattr(importlib.import_module(module), name)(**arguments)


@pytest.fixture(scope="module")
def own_process():
    """Start the process that the tests of a module share."""
    context = get_context("spawn")
    with ProcessPoolExecutor(1, context, begin, (warnings.filters,)) as pool:
        yield pool


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem):
    """Run the tests that ask for it there."""
    given = dict(pyfuncitem.funcargs)
    pool = given.pop("own_process", None)
    if pool is None:
        return None
    pool.submit(run, pyfuncitem.module.__name__, pyfuncitem.originalname, given).result()
    return True
