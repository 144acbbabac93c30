"""Refuse assignments that would do nothing, with a message that says what to write instead."""

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
    Type a field of a dataclass that is given as one type and stored as another.

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
    Refuse assignments to attributes that the class does not list.

    Names that begin with an underscore are the object's own, or those of a class made from it. A
    class lists in ``_FIELDS`` what can be assigned, apart from properties with a setter, and says
    in ``_ADVICE`` what to do about what it only shows. ``_CHECKS`` has functions of fields' names
    and values that return what is kept, or raise ``ValueError``.
    """

    _FIELDS: ClassVar[tuple[str, ...]] = ()
    _ADVICE: ClassVar[str] = ""
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
    hint = f": {owner._ADVICE}" if owner._ADVICE else ""
    if isinstance(member, property):
        if member.fset is not None:
            return
        raise AttributeError(f"{kind}.{name} cannot be assigned{hint}")
    if callable(member):
        raise AttributeError(f"{kind}.{name} is a method: call it")
    if not owner._FIELDS:
        raise AttributeError(f"{kind} has no {name!r}, and nothing to assign{hint}")
    raise AttributeError(_unknown_name(kind, name, owner._FIELDS, "what can be assigned is"))


def store(owner: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass, such as values that its checks converted."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)


def suggests_replace(kind: AnyClass) -> AnyClass:
    """Make a frozen dataclass name `dataclasses.replace` in the error for an assignment."""
    patched: Any = kind
    original = patched.__setattr__

    @functools.wraps(original)
    def set_attribute(self: Any, name: str, value: Any) -> None:
        try:
            original(self, name, value)
        except dataclasses.FrozenInstanceError:
            raise dataclasses.FrozenInstanceError(_replace_hint(self, name)) from None

    patched.__setattr__ = set_attribute
    return kind


def _replace_hint(owner: Any, name: str) -> str:
    """Return the message for an assignment to a frozen object."""
    kind, fields = type(owner).__name__, [field.name for field in dataclasses.fields(owner)]
    if not fields:
        return f"{kind} has no {name!r}, nor any field"
    field, reason = name, f"{kind} is never changed"
    if name not in fields:
        field = (similar_names(name, fields) or fields)[0]
        reason = f"{_unknown_name(kind, name, fields, 'its fields are')}, and it is never changed"
    return f"{reason}: make another with dataclasses.replace(old, {field}=...), and assign that"


def _unknown_name(kind: str, name: str, names: Sequence[str], heading: str) -> str:
    """Return the message for an unknown attribute: similar names, and those there are."""
    near, known = similar_names(name, names), ", ".join(names)
    if near:
        return f"{kind} has no {name!r}; did you mean {near[0]!r}? {heading.capitalize()} {known}"
    return f"{kind} has no {name!r}; {heading} {known}"


def similar_names(name: str, names: Iterable[str]) -> list[str]:
    """Return the ``names`` that contain ``name`` or lie in it, then those of similar spelling."""
    import difflib

    keys = {one.replace("_", "").lower(): one for one in names}
    key = name.replace("_", "").lower()
    nested = [one for one in keys if min(len(one), len(key)) >= 3 and (key in one or one in key)]
    return [
        keys[one] for one in [*nested, *difflib.get_close_matches(key, list(keys), cutoff=0.65)]
    ]
