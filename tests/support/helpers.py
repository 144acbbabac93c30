"""Call helpers of kernels from Python: each inside a kernel of its own, which the store keeps."""

from __future__ import annotations

import base64
import ctypes
import functools
import hashlib
import importlib
import json
import pickle
from pathlib import Path

import numpy as np

from rasterjit.runtime import background_compile, store
from rasterjit.runtime.jit import Helper, Kernel

MAX_WORDS = 256
"""Words of a result at most: the address of what describes it, and its numbers."""

OF_THIS_FILE = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:8]
"""Part of the names of kernels made here: whoever edits this file makes others."""

READ = {"f": np.float64, "i": np.int64, "u": np.uint64, "b": np.int64}
MADE = {"f": float, "i": int, "u": int, "b": bool}
"""The numbers of results, by letter: how they are read, and what Python gets."""


class Called(Kernel):
    """A kernel that calls a helper, and writes what it returns to a place in memory."""

    def __init__(self, helper: Helper) -> None:
        self.helper = helper
        super().__init__(self._function_of(helper.function.__code__.co_argcount))
        self.__name__ = f"called_{helper.__name__}_{OF_THIS_FILE}"
        self.__module__ = helper.__module__

    def _function_of(self, count):
        names = ", ".join(f"given{k}" for k in range(count))
        known = {"helper": self.helper, "__name__": __name__}
        exec(f"def call(place, {names}):\n    keep(place, helper({names}))\n", known)
        return known["call"]

    def get_form(self, kind):
        """Return a form: what the store lacks is compiled where its memory is given back."""
        if all(form.kind != kind for form in self.forms) and not store.is_stored(self, kind):
            packed = base64.b85encode(pickle.dumps(kind)).decode()
            own = self.helper.__module__, self.helper.__name__, packed
            error = background_compile._run_task(
                compiler(), background_compile.Task(__name__, "compile_one", own)
            )
            assert error is None, error
        return super().get_form(kind)

    def run(self, *given):
        """Call the helper."""
        words = np.empty(MAX_WORDS, np.int64)
        self(words.ctypes.data, *given)
        return made(shape_at(int(words[0])), words[1:])[0]


def call(helper: Helper, *arguments):
    """Run a helper: in place of `Helper.__call__`."""
    if helper._caller is None:
        helper._caller = Called(helper).run
    return helper._caller(*arguments)


@functools.cache
def compiler():
    """Return the process that compiles for this one."""
    return background_compile._start_worker()


def end() -> None:
    """End the process that compiles, if there is one."""
    if compiler.cache_info().currsize:
        background_compile._kill(compiler())
        compiler.cache_clear()


def compile_one(module: str, name: str, packed: str) -> None:
    """Compile a form of what calls a helper: the task of the process that compiles."""
    called = Called(getattr(importlib.import_module(module), name))
    called.function.__globals__["keep"] = importlib.import_module("results").keep
    Kernel.get_form(called, pickle.loads(base64.b85decode(packed)))


@functools.cache
def shape_at(address: int):
    """Return the description of a result, from the text at an address: see `results.shape_of`."""
    return json.loads(ctypes.string_at(address))


def made(shape, words):
    """Return the first result in a row of words, and the words behind it."""
    if shape is None:
        return None, words
    if isinstance(shape, str):
        return MADE[shape](words[:1].view(READ[shape])[0]), words[1:]
    module, name, shapes = shape
    values = []
    for one in shapes:
        value, words = made(one, words)
        values.append(value)
    if name is None:
        return tuple(values), words
    return getattr(importlib.import_module(module), name)(*values), words
