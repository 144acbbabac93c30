"""Errors and warnings of loading and saving: what cannot be read, shown or kept."""

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
        Count of each kind of thing that is left out; empty for other warnings.
    """

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)
        self.left_out: dict[str, int] = {}


class SaveWarning(UserWarning):
    """Part of a scene was written in another form, or left out; the rest is in the file."""


class MissingFileError(ValueError):
    """A file that another one names is not there."""


MAX_REASON_LENGTH = 200
"""Most characters of a reason in a message."""

MAX_LISTED_KINDS = 3
"""Most things that a message lists for one reason."""


DAMAGED = "it is damaged or something else"

READER_ERRORS = (AttributeError, TypeError, IndexError, UnicodeError, AssertionError, StopIteration)
"""Errors of a reader's own code on unexpected input: their messages do not describe the file."""


def reason_of(error: Exception) -> str:
    """Return an error's reason in one line, for a message about something unreadable."""
    if isinstance(error, (MissingFileError, FileNotFoundError)):
        return "it is missing"
    if isinstance(error, KeyError) and error.args and isinstance(error.args[0], str):
        return f"{error.args[0]} is missing"
    if isinstance(error, READER_ERRORS):
        return DAMAGED
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split())[:MAX_REASON_LENGTH] or type(error).__name__


def make_missing_package_error(
    file: Path, extension: str, missing: object, install: str
) -> MeshFileError:
    """Return the error of a format whose package is missing; ``install``: arguments of pip."""
    return MeshFileError(
        f"{file}: reading .{extension} needs a package that is not installed ({missing}); "
        f"pip install {install} brings it"
    )


@contextmanager
def raise_mesh_file_error(file: Path, extension: str) -> Iterator[None]:
    """Convert ``OSError`` and ``MemoryError`` to `MeshFileError`."""
    try:
        yield
    except (OSError, MemoryError) as error:
        reason = reason_of(error) if isinstance(error, OSError) else "it needs too much memory"
        raise MeshFileError(f"{file} could not be read as .{extension}: {reason}") from error


class SaveNotes:
    """Collect what a file format cannot hold or rounds, to warn of everything at once."""

    def __init__(self, format_name: str) -> None:
        self._format = format_name
        self._missing: dict[str, None] = {}
        self._rounded: dict[str, None] = {}

    def note(self, what: str) -> None:
        """Add something that the format cannot hold, such as ``"fog"``."""
        self._missing[what] = None

    def note_rounded(self, what: str) -> None:
        """Add something that the format rounds noticeably."""
        self._rounded[what] = None

    def warn(self, source: str) -> None:
        """Warn, if anything was noted, of what is missing and what is rounded."""
        messages = []
        if self._missing:
            messages.append(f"{self._format} has no place for {', '.join(self._missing)}")
        if self._rounded:
            messages.append(f"rounded: {', '.join(self._rounded)}")
        if messages:
            warn_caller(f"{source}: {'; '.join(messages)}; all else is kept", SaveWarning)


class LeftOut:
    """
    Collect what of a file is left out, to warn of everything at once.

    A reader that meets what it cannot show notes it. One that could pass over things without
    meeting them counts by kind all that the file holds (`expect`) and what it makes something of
    (`mark_read`); the difference is left out as well.
    """

    def __init__(self) -> None:
        self._counts: dict[str, Counter[str]] = {}
        self._unread: Counter[str] = Counter()

    def note(self, what: str, count: int = 1, reason: str = "") -> None:
        """
        Add ``count`` things of a kind that are left out, such as ``"further camera"``.

        Of those that are left out for one reason, such as ``": it is missing"``, a few are named.
        """
        if count:
            self._counts.setdefault(reason or what, Counter())[what] += count

    def expect(self, what: str, count: int = 1) -> None:
        """Count ``count`` things of a kind as held by the file."""
        self._unread[what] += count

    def mark_read(self, what: str, count: int = 1) -> None:
        """Count ``count`` things of a kind as read."""
        self._unread[what] -= count

    def entries(self) -> list[tuple[str, str, int]]:
        """Return reason, kind and number of all that is left out, for `extend` of another one."""
        return [
            (reason, what, count)
            for reason, counts in self._by_reason().items()
            for what, count in counts.items()
        ]

    def extend(self, notes: list[tuple[str, str, int]]) -> None:
        """Add the entries of another one."""
        for reason, what, count in notes:
            self.note(what, count, reason)

    def _by_reason(self) -> dict[str, Counter[str]]:
        """Return the counts of what is left out, by reason, or by kind where it has none."""
        rest = +self._unread
        alone = {what: self._counts.get(what, Counter()) + Counter({what: rest[what]})
                 for what in rest}  # fmt: skip
        return {**self._counts, **alone}

    def counts(self) -> dict[str, int]:
        """Return how many things of each kind are left out."""
        return {
            what if reason in counts else what + reason: count
            for reason, counts in self._by_reason().items()
            for what, count in counts.items()
        }

    def __str__(self) -> str:
        return ", ".join(_describe(reason, counts) for reason, counts in self._by_reason().items())

    def warn(self, source: str) -> None:
        """Warn, if anything was left out, naming ``source`` and every kind."""
        omissions = str(self)
        if omissions:
            warning = LoadWarning(f"{source}: left out {omissions}; the rest is there")
            warning.left_out = self.counts()
            warn_caller(warning)


def _describe(reason: str, counts: Counter[str]) -> str:
    """Describe in one line the things left out for one reason, and their number."""
    names = list(counts)
    text = ", ".join(names[:MAX_LISTED_KINDS])
    if len(names) > MAX_LISTED_KINDS:
        text += f" and {len(names) - MAX_LISTED_KINDS} more"
    suffix = "" if reason in counts else reason
    return f"{text}{suffix} ({counts.total()})"
