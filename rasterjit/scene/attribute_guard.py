"""Answer assignments that would do nothing, or are refused, with what to write instead."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

AnyClass = TypeVar("AnyClass", bound=type)
Given = TypeVar("Given")
Kept = TypeVar("Kept")


class Converted(Generic[Given, Kept]):
    """
    For type checkers: a field of a dataclass that is given as one type and kept as another.

    At run time it is its default.
    """

    def __new__(cls, default: Given) -> Any:
        """Return the default."""
        return default

    if TYPE_CHECKING:

        def __get__(self, owner: object, kind: Any = None) -> Kept: ...

        def __set__(self, owner: object, value: Given) -> None: ...


class Guarded:
    """
    Takes assignments to the attributes of its class, and refuses others by name.

    Names that begin with an underscore are the object's own, or those of a class made from it. A
    class lists in ``_FIELDS`` what can be assigned, apart from properties with a setter, and says
    in ``_INSTEAD`` what to do about what it only shows. ``_CHECKS`` has functions of fields' names
    and values that return what is kept, or raise ``ValueError``.
    """

    _FIELDS: ClassVar[tuple[str, ...]] = ()
    _INSTEAD: ClassVar[str] = ""
    _CHECKS: ClassVar[Mapping[str, Callable[[str, Any], Any]]] = MappingProxyType({})

    # A type checker that saw this would let every name pass.
    if not TYPE_CHECKING:

        def __setattr__(self, name: str, value: Any) -> None:
            if not name.startswith("_"):
                if name not in self._FIELDS:
                    _check_attribute(self, name)
                check = self._CHECKS.get(name)
                if check is not None:
                    value = check(name, value)
            super().__setattr__(name, value)


def _check_attribute(owner: Guarded, name: str) -> None:
    """Raise ``AttributeError`` if an attribute cannot be assigned, saying what can."""
    kind, member = type(owner).__name__, getattr(type(owner), name, None)
    instead = f": {owner._INSTEAD}" if owner._INSTEAD else ""
    if isinstance(member, property):
        if member.fset is not None:
            return
        raise AttributeError(f"{kind}.{name} cannot be assigned{instead}")
    if callable(member):
        raise AttributeError(f"{kind}.{name} is a method: call it")
    if not owner._FIELDS:
        raise AttributeError(f"{kind} has no {name!r}, and nothing to assign{instead}")
    raise AttributeError(_no_such(kind, name, owner._FIELDS, "what can be assigned is"))


def store(owner: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass: what its checks made of the values that were given."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)


def says_replace(kind: AnyClass) -> AnyClass:
    """Have a frozen dataclass answer an assignment with how to make a changed copy instead."""
    changed: Any = kind
    refuse = changed.__setattr__

    @functools.wraps(refuse)
    def answer(self: Any, name: str, value: Any) -> None:
        try:
            refuse(self, name, value)
        except dataclasses.FrozenInstanceError:
            raise dataclasses.FrozenInstanceError(_how_to_replace(self, name)) from None

    changed.__setattr__ = answer
    return kind


def _how_to_replace(owner: Any, name: str) -> str:
    """Return what a message says of an assignment to a frozen object."""
    kind, fields = type(owner).__name__, [field.name for field in dataclasses.fields(owner)]
    if not fields:
        return f"{kind} has no {name!r}, nor any field"
    meant, head = name, f"{kind} is never changed"
    if name not in fields:
        meant = (similar(name, fields) or fields)[0]
        head = f"{_no_such(kind, name, fields, 'its fields are')}, and it is never changed"
    return f"{head}: make another with dataclasses.replace(old, {meant}=...), and assign that"


def _no_such(kind: str, name: str, names: Sequence[str], heading: str) -> str:
    """Say that an object has no such attribute, which one may be meant, and which there are."""
    near, listed = similar(name, names), ", ".join(names)
    if near:
        return f"{kind} has no {name!r}; did you mean {near[0]!r}? {heading.capitalize()} {listed}"
    return f"{kind} has no {name!r}; {heading} {listed}"


def similar(name: str, names: Iterable[str]) -> list[str]:
    """Return those of ``names`` that hold ``name`` or are held in it, then those spelt alike."""
    import difflib

    bare = {one.replace("_", "").lower(): one for one in names}
    asked = name.replace("_", "").lower()
    holding = [
        one for one in bare if min(len(one), len(asked)) >= 3 and (asked in one or one in asked)
    ]
    return [
        bare[one] for one in [*holding, *difflib.get_close_matches(asked, list(bare), cutoff=0.65)]
    ]
