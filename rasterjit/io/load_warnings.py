"""Say what of a file or scene is not shown: all of it, or once and in one line, a part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rasterjit.scene.warning import warn_caller


class MeshFileError(ValueError):
    """A file is missing, unreadable, of no known format, or holds nothing to draw."""


class LoadWarning(UserWarning):
    """
    Part of a file or scene was left out; the rest is there.

    Attributes
    ----------
    left_out : dict of str to int
        How many things of each kind; empty for a warning of another thing.
    """

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)
        self.left_out: dict[str, int] = {}


class SaveWarning(UserWarning):
    """Part of a scene was written in another form, or left out; the rest is in the file."""


class MissingFileError(ValueError):
    """A file that another one names is not there."""


LONGEST_REASON = 200
"""Characters of a reason that a message shows."""

MAX_NAMED = 3
"""Things that a message names that are left out for the same reason."""


DAMAGED = "it is damaged or something else"

OF_READERS = (AttributeError, TypeError, IndexError, UnicodeError, AssertionError, StopIteration)
"""Errors of a reader that met what it does not expect: they speak of it, not of the file."""


def reason_of(error: Exception) -> str:
    """Return in one line why something cannot be read, whatever was raised about it."""
    if isinstance(error, (MissingFileError, FileNotFoundError)):
        return "it is missing"
    if isinstance(error, KeyError) and error.args and isinstance(error.args[0], str):
        return f"{error.args[0]} is missing"
    if isinstance(error, OF_READERS):
        return DAMAGED
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split())[:LONGEST_REASON] or type(error).__name__


@contextmanager
def as_mesh_file_error(file: Path, extension: str) -> Iterator[None]:
    """Raise `MeshFileError` about what the system refuses, or has too little memory for."""
    try:
        yield
    except (OSError, MemoryError) as error:
        reason = reason_of(error) if isinstance(error, OSError) else "it needs too much memory"
        raise MeshFileError(f"{file} could not be read as .{extension}: {reason}") from error


class NotSaved:
    """Collect what is saved otherwise than it is, to warn about everything at once."""

    def __init__(self, form: str) -> None:
        self._form = form
        self._lost: dict[str, None] = {}
        self._rounded: dict[str, None] = {}

    def note(self, what: str) -> None:
        """Add what the form has no place for, such as ``"fog"``."""
        self._lost[what] = None

    def note_rounded(self, what: str) -> None:
        """Add what the form keeps with fewer digits than would do."""
        self._rounded[what] = None

    def warn(self, source: str) -> None:
        """Warn, if anything was noted, of what is lost and, apart from it, what is rounded."""
        said = []
        if self._lost:
            said.append(f"{self._form} has no place for {', '.join(self._lost)}")
        if self._rounded:
            said.append(f"rounded: {', '.join(self._rounded)}")
        if said:
            warn_caller(f"{source}: {'; '.join(said)}; all else is kept", SaveWarning)


class LeftOut:
    """
    Tell what a file holds from what is made of it, to warn of the rest at once.

    A reader that meets what it cannot show notes it. One that could pass over things without
    meeting them counts by kind all that the file holds (`found`) and what it makes something of
    (`read`); what is left between the two is left out as well.
    """

    def __init__(self) -> None:
        self._noted: dict[str, Counter[str]] = {}
        self._unread: Counter[str] = Counter()

    def note(self, what: str, count: int = 1, reason: str = "") -> None:
        """
        Add ``count`` things of a kind that are left out, such as ``"further camera"``.

        Of those that are left out for one reason, such as ``": it is missing"``, a few are named.
        """
        if count:
            self._noted.setdefault(reason or what, Counter())[what] += count

    def found(self, what: str, count: int = 1) -> None:
        """Add ``count`` things of a kind that the file holds."""
        self._unread[what] += count

    def read(self, what: str, count: int = 1) -> None:
        """Add ``count`` things of a kind that something is made of."""
        self._unread[what] -= count

    def all(self) -> list[tuple[str, str, int]]:
        """Return reason, kind and number of all that is left out, for `add_all` of another one."""
        return [
            (reason, what, count)
            for reason, counts in self._by_reason().items()
            for what, count in counts.items()
        ]

    def add_all(self, notes: list[tuple[str, str, int]]) -> None:
        """Add what another one noted."""
        for reason, what, count in notes:
            self.note(what, count, reason)

    def _by_reason(self) -> dict[str, Counter[str]]:
        """Return what is left out: by reason, or by its name if it has none."""
        rest = +self._unread
        alone = {what: self._noted.get(what, Counter()) + Counter({what: rest[what]})
                 for what in rest}  # fmt: skip
        return {**self._noted, **alone}

    def counts(self) -> dict[str, int]:
        """Return how many things of each kind are left out."""
        return {
            what if reason in counts else what + reason: count
            for reason, counts in self._by_reason().items()
            for what, count in counts.items()
        }

    def __str__(self) -> str:
        return ", ".join(_told(reason, counts) for reason, counts in self._by_reason().items())

    def warn(self, source: str) -> None:
        """Warn, if anything was left out, naming ``source`` and every kind."""
        said = str(self)
        if said:
            warning = LoadWarning(f"{source}: left out {said}; the rest is there")
            warning.left_out = self.counts()
            warn_caller(warning)


def _told(reason: str, counts: Counter[str]) -> str:
    """Return in one line what is left out for a reason, and how much of it."""
    names = list(counts)
    said = ", ".join(names[:MAX_NAMED])
    if len(names) > MAX_NAMED:
        said += f" and {len(names) - MAX_NAMED} more"
    because = "" if reason in counts else reason
    return f"{said}{because} ({counts.total()})"
