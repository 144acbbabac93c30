"""Attributes whose values are checked whenever they are set."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

import numpy as np

from rasterjit.scene.validation import short_repr

T = TypeVar("T")


class Field(Generic[T]):
    """
    An attribute that keeps what a check returns.

    Parameters
    ----------
    check : callable
        ``check(value)`` returns what is kept, or raises an error whose message begins with a verb,
        such as "must be above 0": the attribute's name is put before it.
    doc : str
        What the attribute is.
    *default : optional
        What the constructor of a dataclass sets where it is not given; `dataclasses.MISSING` where
        it must be.
    """

    def __init__(self, check: Callable[..., T], doc: str, *default: Any) -> None:
        self._check, self.__doc__, self._default = check, doc, default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name, self._storage_name = name, "_" + name

    @overload
    def __get__(self, instance: None, owner: type) -> Field[T]: ...

    @overload
    def __get__(self, instance: object, owner: type) -> T: ...

    def __get__(self, instance: object | None, owner: type) -> Any:
        if instance is None:
            # A dataclass reads its default here.
            return self._default[0] if self._default else self
        try:
            return instance.__dict__[self._storage_name]
        except KeyError:
            raise AttributeError(f"{self._name} of {owner.__name__} was not set") from None

    def __set__(self, instance: object, value: Any) -> None:
        instance.__dict__[self._storage_name] = check_named(
            self._name, lambda unchecked: self._run_check(instance, unchecked), value
        )

    def _run_check(self, instance: object, value: Any) -> T:
        return self._check(value)


class OwnedField(Field[T]):
    """A `Field` whose check also takes the object that has it: ``check(object, value)``."""

    def _run_check(self, instance: object, value: Any) -> T:
        return self._check(instance, value)


def check_named(name: str, check: Callable[[Any], T], value: Any) -> T:
    """Return the result of a check; raise its error with the name and the value added."""
    try:
        return check(value)
    except (TypeError, ValueError) as error:
        # Some messages name the value already.
        got = "" if ", got " in str(error) else f", got {short_repr(value)}"
        raise type(error)(f"{name} {error}{got}") from None


def keep_any(value: Any) -> Any:
    """Return a value as it is."""
    return value


def to_text_or_none(value: Any) -> str | None:
    """Return a name as text; None stays."""
    return None if value is None else str(value)


def to_number(value: Any) -> float:
    """Return a number, also of an array of one, or raise ``TypeError`` or ``ValueError``."""
    try:
        return float(value.reshape(()) if isinstance(value, np.ndarray) else value)
    except TypeError:
        raise TypeError("must be a number") from None
    except ValueError:
        raise ValueError("must be a number") from None


def to_positive(value: Any) -> float:
    """Return a number above 0."""
    given = to_number(value)
    if given <= 0.0:
        raise ValueError("must be above 0")
    return given


def to_non_negative(value: Any) -> float:
    """Return a number of at least 0."""
    given = to_number(value)
    if given < 0.0:
        raise ValueError("must be at least 0")
    return given


def to_positive_or_none(value: Any) -> float | None:
    """Return a number above 0, or None."""
    return None if value is None else to_positive(value)


def to_share(value: Any) -> float:
    """Return a number in 0..1."""
    given = to_number(value)
    if not 0.0 <= given <= 1.0:
        raise ValueError("must be in 0..1")
    return given


def to_share_or_one(value: Any) -> float:
    """Return a number in 0..1; 1 for None."""
    return 1.0 if value is None else to_share(value)


def to_bool(value: Any) -> bool:
    """Return a bool, or raise ``TypeError``."""
    if not isinstance(value, bool):
        raise TypeError("must be True or False")
    return value


_INSTEAD = (
    "is a part of OpenGL, and RasterJIT draws without. In place of own shaders, "
    "OffscreenRenderer.render(scene, outputs=...) returns normals and positions "
    '("normal_camera", "position" ...), RenderFlags.SEG colours nodes and RenderFlags.FLAT leaves '
    "light out"
)


class NoOpenGLError(AttributeError):
    """A part of pyrender that belongs to OpenGL was requested; ``hasattr`` returns False for it."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} {_INSTEAD}")
