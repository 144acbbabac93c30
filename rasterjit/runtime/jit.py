"""
Define the decorators of compiled functions (kernels, stages, helpers), and how they are called.

``@kernel``
    A function that Python calls, or another kernel by its address (`Bound`): compiled once for each
    form of its arguments, kept as machine code on disk (``store``), called without Python's lock.
``@stage``
    A step of shading, which ``stage_runner`` calls by its address; compiled once.
``@raw_kernel``
    A function of three whole numbers, called by its address.
``@helper``
    A function that is compiled into the kernels that call it.
``@disjoint_helper``
    A helper whose array arguments never overlap, so that its loops vectorize.
``@intrinsic``
    A helper that ``intrinsics_ir`` writes in LLVM's language.

Decorating only remembers the function: nothing imports Numba before something compiles
(``compiler``), and what is in the store needs no compiler.

With ``NUMBA_DISABLE_JIT=1`` all are the plain Python functions; like compiled ones, they do not
warn about overflow and NaN. With ``NUMBA_BOUNDSCHECK=1`` Numba compiles kernels with checked
indices, which raise ``IndexError``; the store keeps none of these.

Kernels allocate nothing: callers pass scratch memory. No kernel uses
``fastmath``: coverage, clipping and depth rest on exact ties and on NaN comparing false, and
without it LLVM neither reorders nor contracts floating-point arithmetic.
"""

from __future__ import annotations

import ctypes
import functools
import inspect
import os
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from rasterjit import forks
from rasterjit.forks import cached_property
from rasterjit.runtime import isolated_numba
from rasterjit.runtime.argument_plan import make_plan
from rasterjit.runtime.clocks import COMPILE_CLOCK
from rasterjit.runtime.state_block import (
    WORD,
    NumberType,
    RecordType,
    count_block_words,
    expand_forms,
    infer_type,
    pack_in_python,
    type_from_annotation,
)


def _is_enabled(name: str) -> bool:
    """Tell whether an environment variable is a number other than 0, as Numba reads it."""
    try:
        return bool(int(os.environ.get(name, "0") or "0"))
    except ValueError:
        return False


DISABLED = _is_enabled("NUMBA_DISABLE_JIT")
"""Whether kernels run as plain Python."""

CHECKED = _is_enabled("NUMBA_BOUNDSCHECK")
"""Whether kernels check their indices."""

KERNELS: list[Any] = []
"""Every function decorated with ``@kernel``, in order of definition."""

STAGES: list[Any] = []
"""Every function decorated with ``@stage``, in order of definition."""

MACHINE_FUNCTION = ctypes.CFUNCTYPE(*[ctypes.c_int64] * 4)
"""Type of compiled functions, called without the GIL."""

MACHINE_FUNCTION_WITH_GIL = ctypes.PYFUNCTYPE(*[ctypes.c_int64] * 4)
"""Type of compiled functions, called with the GIL: `pack_arguments.pack` reads Python objects."""


class Form:
    """The machine code of a kernel for one combination of argument types."""

    def __init__(self, kind: RecordType, code: Any) -> None:
        self.kind = kind
        self.address: int = code.address
        self._code = code
        self._run = MACHINE_FUNCTION(code.address)
        self._convert = {"none": lambda word: None, "int": None, "bool": bool}[code.returns]
        self._plan, self._call_plan = make_plan(kind), make_plan(kind, code.address)
        self._plan_address, self.call_address = map(ctypes.addressof, (self._plan, self._call_plan))
        self.block = ctypes.c_int64 * max(count_block_words(kind), 1)

    def pack(self, arguments: tuple[Any, ...]) -> Any:
        """Return a state block, or None if the arguments are of other types."""
        block = self.block()
        if get_packer()(id(arguments), self._plan_address, ctypes.addressof(block)):
            return None
        return block

    def pack_in_python(self, arguments: tuple[Any, ...]) -> Any:
        """Return a state block; raise TypeError if the arguments are of other types."""
        words: list[int] = []
        pack_in_python(self.kind, arguments, words)
        return self.block(*words)

    def run(self, block: Any) -> Any:
        """Run the machine code with a state block."""
        return self.convert_result(self._run(ctypes.addressof(block), 0, 0))

    def convert_result(self, word: int) -> Any:
        """Convert the word that the machine code returned to the kernel's result."""
        return word if self._convert is None else self._convert(word)


class Kernel:
    """A function in machine code, with one form for each combination of argument types."""

    def __init__(self, function: Callable) -> None:
        self.function = function
        self.__name__, self.__qualname__ = function.__name__, function.__qualname__
        self.__module__, self.__doc__ = function.__module__, function.__doc__
        self.forms: list[Form] = []
        """The forms that this process has used."""
        self._lock = forks.reentrant_lock()

    @cached_property
    def declared(self) -> list[RecordType]:
        """The argument types of each form, if all parameters are annotated."""
        names = inspect.signature(self.function).parameters
        annotations = inspect.get_annotations(self.function, eval_str=True)
        if not all(name in annotations for name in names):
            return []
        return expand_forms(
            RecordType(tuple, tuple(type_from_annotation(annotations[name]) for name in names))
        )

    def __call__(self, *arguments: Any) -> Any:
        """
        Run the kernel; compile or load it first if this process has not yet done so.

        Raises
        ------
        TypeError
            An argument is of another type than the kernel declares.
        """
        for form in self.forms:
            block = form.block()
            if not get_packer()(id(arguments), form.call_address, ctypes.addressof(block)):
                return form.convert_result(block[0])
        form, block = self.bind(arguments)
        return form.run(block)

    def bind(self, arguments: tuple[Any, ...]) -> tuple[Form, Any]:
        """Return the form for some arguments, and a state block, which does not keep them alive."""
        for form in self.forms:
            block = form.pack(arguments)
            if block is not None:
                return form, block
        form = self.get_form(self._choose_types(arguments))
        return form, form.pack_in_python(arguments)

    def _choose_types(self, arguments: tuple[Any, ...]) -> RecordType:
        if not self.declared:
            return RecordType(tuple, tuple(map(infer_type, arguments)))
        most_words, best_error = -1, TypeError()
        for kind in self.declared:
            words: list[int] = []
            try:
                pack_in_python(kind, arguments, words, self.__name__)
                return kind
            except TypeError as error:
                # Report the error of the form that fits most arguments.
                if len(words) > most_words:
                    most_words, best_error = len(words), error
        raise best_error

    def load(self, kind: RecordType) -> int:
        """Return the address of the machine code of a form, compiled or loaded first."""
        return self.get_form(kind).address

    def get_form(self, kind: RecordType) -> Form:
        """Return the form for some argument types; load or compile it first if necessary."""
        with self._lock:
            for form in self.forms:
                if form.kind == kind:
                    return form
            from rasterjit.runtime.store import load

            with COMPILE_CLOCK.running():
                form = Form(kind, load(self, kind))
            self.forms = [*self.forms, form]
            return form


class _CallErrors(threading.local):
    """Errors of kernels that this thread called by address: C cannot pass them on."""

    def __init__(self) -> None:
        self.errors: list[BaseException] = []


_CALL_ERRORS = _CallErrors()


def raise_call_error() -> None:
    """Raise the error, if any, of a kernel that was called by address."""
    if _CALL_ERRORS.errors:
        raise _CALL_ERRORS.errors.pop()


class Bound:
    """
    A kernel and its arguments, which other kernels call by `words` (``intrinsics.call_bound``).

    Must stay alive while the words are in use: they are addresses of its memory.
    """

    def __init__(self, kernel: Any, *arguments: Any) -> None:
        self._kernel, self._arguments = kernel, arguments  # Their memory must stay.
        if DISABLED or CHECKED:
            self._machine = MACHINE_FUNCTION(self._run)
            address, state = ctypes.cast(self._machine, ctypes.c_void_p).value, 0
        else:
            self._form, self._block = kernel.bind(arguments)
            address, state = self._form.address, ctypes.addressof(self._block)
        self.words = np.array([address, state], np.int64)
        """(2,) int64: the addresses of the machine code and of the state block."""

    def address_of(self, number: int) -> int:
        """Return the address of the words of an argument, by its number, in the state block."""
        return int(self.words[1]) + WORD * sum(
            map(count_block_words, self._form.kind.fields[:number])
        )

    def _run(self, *_: int) -> int:
        """Run the kernel as Python calls it; store its error for `raise_call_error`."""
        try:
            return int(self._kernel(*self._arguments) or 0)
        except BaseException as error:
            _CALL_ERRORS.errors.append(error)
            return 0


class _SingleForm:
    """A function of one form, called by its address."""

    def __init__(self, function: Callable) -> None:
        self.function = function
        self.__name__, self.__module__ = function.__name__, function.__module__
        self.__doc__ = function.__doc__
        self._lock = forks.lock()
        self._code: Any = None

    @property
    def is_in_use(self) -> bool:
        """Whether its machine code is in memory."""
        return self._code is not None

    @property
    def declared(self) -> list[RecordType]:
        """The types of the only form."""
        return [self.kind]

    def load(self, kind: RecordType) -> int:
        """Return the address of the only form."""
        return self.address()

    def address(self) -> int:
        """Return the address of the machine code, compiled or loaded first."""
        with self._lock:
            if self._code is None:
                from rasterjit.runtime.store import load

                with COMPILE_CLOCK.running():
                    self._code = load(self, self.kind)
            return self._code.address


class RawKernel(_SingleForm):
    """A function ``int64 kernel(int64, int64, int64)``, called by address."""

    kind = RecordType(tuple, (NumberType("int64"),) * 3)


class Stage(_SingleForm):
    """
    A step of shading, compiled once: ``stage(block, count, ...)``.

    Takes a block of samples, their count, and further arguments, whose types are annotations.
    Machine code calls it (``stage_runner``), with the addresses of a state block, which holds the
    further arguments, and of a block of samples.
    """

    def __init__(self, function: Callable) -> None:
        super().__init__(function)
        self._checked: Any = None

    @cached_property
    def kind(self) -> RecordType:
        """The types of the block and of the further arguments."""
        annotations = inspect.get_annotations(self.function, eval_str=True)
        parameters = [
            name for name in inspect.signature(self.function).parameters if name != "count"
        ]
        for name in parameters:
            if name not in annotations:
                raise TypeError(f"stage {self.__name__}: its parameter {name!r} needs a type")
        return RecordType(
            tuple, tuple(type_from_annotation(annotations[name]) for name in parameters)
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the further parameters."""
        return tuple(inspect.signature(self.function).parameters)[2:]

    @cached_property
    def _argument_layout(self) -> tuple[RecordType, Any, Any, int]:
        kind = RecordType(tuple, self.kind.fields[1:])
        plan = make_plan(kind)
        return kind, ctypes.c_int64 * max(count_block_words(kind), 1), plan, ctypes.addressof(plan)

    def pack(self, *arguments: Any) -> Any:
        """
        Return a state block of the further arguments, which does not keep them alive.

        Raises
        ------
        TypeError
            An argument is of another type than the stage declares.
        """
        kind, row, _, plan_address = self._argument_layout
        block = row()
        if get_packer()(id(arguments), plan_address, ctypes.addressof(block)):
            words: list[int] = []
            pack_in_python(kind, arguments, words, self.__name__)
            block[: len(words)] = words
        return block

    def run_in_python(self, block: Any, count: int, arguments: tuple[Any, ...]) -> Any:
        """Run as plain Python, or as Numba compiles it with checked indices."""
        if not CHECKED:
            with np.errstate(all="ignore"):
                return self.function(block, count, *arguments)
        if self._checked is None:
            self._checked = isolated_numba.compiler().compile_checked(self.function)
        return self._checked(block, count, *arguments)


class CheckedKernel:
    """A kernel with checked indices, as Numba compiles and calls it."""

    def __init__(self, function: Callable) -> None:
        self.function = function
        self.__name__, self.__module__ = function.__name__, function.__module__
        self.__doc__ = function.__doc__
        self._dispatcher: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Run the kernel; compile it first if this process has not yet done so."""
        if self._dispatcher is None:
            self._dispatcher = isolated_numba.compiler().compile_checked(self.function)
        try:
            return self._dispatcher(*arguments)
        finally:
            raise_call_error()


class Helper:
    """A function that is compiled into kernels. Tests call it from Python, compiled alone."""

    def __init__(self, function: Callable, is_disjoint: bool) -> None:
        self.function, self.is_disjoint = function, is_disjoint
        self.__name__, self.__module__ = function.__name__, function.__module__
        self.__doc__ = function.__doc__
        self._caller: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Run the helper, compiled into a function that only calls it."""
        if self._caller is None:
            self._caller = isolated_numba.compiler().compile_caller(self)
        return self._caller(*arguments)


class Intrinsic:
    """A helper whose machine code is generated by the same name in ``intrinsics_ir``."""

    def __init__(self, function: Callable) -> None:
        self.function = function
        self.__name__, self.__module__ = function.__name__, function.__module__
        self.__doc__ = function.__doc__


def kernel(function: Callable) -> Any:
    """Compile a function that Python calls."""
    if DISABLED:
        compiled: Any = np.errstate(all="ignore")(function)
    else:
        compiled = CheckedKernel(function) if CHECKED else Kernel(function)
    KERNELS.append(compiled)
    return compiled


def helper(function: Callable) -> Any:
    """Compile a function into the kernels that call it."""
    return function if DISABLED else Helper(function, is_disjoint=False)


def disjoint_helper(function: Callable) -> Any:
    """
    Compile a helper whose array arguments never overlap.

    LLVM vectorizes a loop over many arrays only if it knows that no store changes a later load;
    checking at run time gives up beyond a handful of arrays. Only for helpers that are given
    distinct rows of scratch memory.
    """
    return function if DISABLED else Helper(function, is_disjoint=True)


def intrinsic(function: Callable) -> Any:
    """Compile a function as ``intrinsics_ir`` says; plain Python runs the function itself."""
    return function if DISABLED else Intrinsic(function)


def stage(function: Callable) -> Stage:
    """Compile a step of shading."""
    made = Stage(function)
    STAGES.append(made)
    return made


def raw_kernel(function: Callable) -> Any:
    """Compile a function that is called by its address, with three whole numbers."""
    return function if DISABLED else RawKernel(function)


def set_packer(pack: Any, is_valid: Callable[[Callable[[int, int, int], int]], bool]) -> None:
    """
    Set the compiled packer of arguments; until then `pack_in_python` does its work.

    Parameters
    ----------
    pack : RawKernel
        `pack_arguments.pack`.
    is_valid : callable
        Tells whether the packer reads this Python's objects correctly; if not, it is not used.
    """
    _PACKERS[:] = [(pack, is_valid)]
    get_packer.cache_clear()


_PACKERS: list[tuple[Any, Callable[[Callable[[int, int, int], int]], bool]]] = []


@functools.cache
def get_packer() -> Callable[[int, int, int], int]:
    """Return the compiled packer of arguments; without it, a function that always fails."""
    for pack, is_valid in _PACKERS:
        run = MACHINE_FUNCTION_WITH_GIL(pack.address())
        if is_valid(run):
            return run
    return lambda *_: 1
