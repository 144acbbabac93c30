"""Lines of numbers, read many at once; which line is damaged is looked for only when one is."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.scene.memory_limits import MemoryBudget

_BATCH = 1 << 22
"""Bytes of a file that are taken apart at once."""

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"

_BLANKS = bytes(range(ord(" ") + 1))
_USUAL_INDENT = 64
"""Blanks before a line that are passed one by one, in all lines at once; more in each by itself."""

_SHOWN = 40
"""Characters of a damaged line that a message shows."""


LINE_BYTES, TEXT_BYTES, BINARY_BYTES = 24, 5, 3
"""What a line takes, and a byte of a text or of a binary file, as its numbers."""

ROW_BYTES, CORNER_BYTES = 64, 80
"""What a row of numbers of its own kind takes, and what a corner of a face that refers to them."""


def line_end(data: bytes) -> bytes:
    """Return what ends the first line of a text: a line feed, or a carriage return alone."""
    feed, turn = data.find(b"\n"), data.find(b"\r")
    is_turn = turn >= 0 and (feed < 0 or turn < feed - 1)
    return b"\r" if is_turn else b"\n"


class Damage:
    """
    Refuse damaged places of a file, or count them.

    Parameters
    ----------
    path : Path
        What messages name.
    on_damage : {"error", "warn"}
    left_out : LeftOut
        Notes what is damaged, in the end.
    """

    def __init__(self, path: Path, on_damage: str, left_out: LeftOut) -> None:
        self.path = path
        self._strict = on_damage == "error"
        self._left_out = left_out
        self._first: str | None = None
        self._count = 0

    def line(self, lines: TextLines, line: int, expected: str) -> None:
        """Raise `MeshFileError` about a line, or remember it."""
        if self._strict or self._first is None:
            self._say(f"{lines.where(line)}: expected {expected}, got {lines.shown(line)}")
        self._count += 1

    def end(self, expected: str, got: str) -> None:
        """Raise `MeshFileError` about a file that ends too early, or remember it."""
        if self._strict or self._first is None:
            self._say(f"its end: expected {expected}, got {got}")
        self._count += 1

    def _say(self, said: str) -> None:
        """Raise, or keep what is said about the first damaged place."""
        if self._strict:
            raise MeshFileError(
                f"{self.path} is damaged at {said}; on_damage='warn' loads what there is"
            )
        self._first = said

    def note(self) -> None:
        """Note what was remembered, once."""
        if self._first is not None:
            self._left_out.note(f"what is damaged, first {self._first}", self._count)


class TextLines:
    """
    The lines of a file.

    Parameters
    ----------
    data : bytes
        The whole file.
    budget : MemoryBudget
        Counts what its lines and numbers take.
    first : int
        Number of the byte at which the first line begins.
    original : bytes, optional
        The file as it was, if others stand in the place of some of its bytes: lines are numbered as
        there.

    Attributes
    ----------
    buffer : (B,) uint8
        The file, with a line end at its end.
    starts, ends : (L,) int64
        Where each line begins, blanks left out, and where its line end is.
    """

    def __init__(
        self, data: bytes, budget: MemoryBudget, first: int = 0, original: bytes | None = None
    ) -> None:
        if first == 0 and data.startswith(_BYTE_ORDER_MARK):
            first = len(_BYTE_ORDER_MARK)
        if data.find(b"\n", first) < 0 and b"\r" in data:
            data = original = data.replace(b"\r", b"\n")
        if len(data) <= first or not data.endswith(b"\n"):
            data += b"\n"
        count = data.count(b"\n", first)
        budget.take(f"its {count} lines", count * LINE_BYTES + len(data) * TEXT_BYTES)
        self._data = data
        self._original = data if original is None else original
        self.buffer = np.frombuffer(data, np.uint8)
        self.ends = np.flatnonzero(self.buffer[first:] == ord("\n")) + first
        self.starts = np.concatenate(([first], self.ends[:-1] + 1))
        begins = self.buffer[self.starts]
        indented = np.flatnonzero((begins <= ord(" ")) & (self.starts < self.ends))
        for _ in range(_USUAL_INDENT):
            if not len(indented):
                break
            self.starts[indented] += 1
            at = self.starts[indented]
            indented = indented[(self.buffer[at] <= ord(" ")) & (at < self.ends[indented])]
        for line in indented.tolist():
            rest = data[self.starts[line] : self.ends[line]].lstrip(_BLANKS)
            self.starts[line] = self.ends[line] - len(rest)

    def __len__(self) -> int:
        return len(self.starts)

    def text(self, line: int) -> str:
        """Return a line without the blanks around it."""
        return self._data[self.starts[line] : self.ends[line]].decode("utf-8", "replace").strip()

    def where(self, line: int) -> str:
        """Say which line it is, for messages."""
        number = self._original.count(b"\n", 0, int(self.starts[line])) + 1
        return f"line {number}"

    def shown(self, line: int) -> str:
        """Return a line as messages show it."""
        text = self.text(line)
        return repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}...")

    def note_unknown(self, which: NDArray[np.int64], left_out: LeftOut) -> None:
        """Note lines of no known kind, if there are any, and where the first one is."""
        if len(which):
            first = f"{self.where(int(which[0]))}: {self.shown(int(which[0]))}"
            left_out.note(f"lines of no known kind, first {first}", len(which))

    def char(self, offset: int) -> NDArray[np.uint8]:
        """Return the byte of every line at an offset from its start; a line end beyond its end."""
        return self.buffer[np.minimum(self.starts + offset, self.ends)]

    def batches(self, lines: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
        """Yield numbers of lines in parts of a bounded number of bytes, or single lines."""
        if not len(lines):
            return
        sizes = np.cumsum(self.ends[lines] - self.starts[lines] + 1)
        at = 0
        while at < len(lines):
            before = int(sizes[at - 1]) if at else 0
            stop = max(at + 1, int(np.searchsorted(sizes, before + _BATCH, "right")))
            yield lines[at:stop]
            at = stop

    def content(
        self, lines: NDArray[np.int64], skip: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """
        Return the bytes of some lines with their line ends, less the first ``skip`` of each.

        Those of lines that follow one another are blanks there.

        Returns
        -------
        content : (B,) uint8
        offsets : (L,) int64
            Where each line begins in it.
        """
        begins, stops = self.starts[lines], self.ends[lines] + 1
        low, high = int(begins[0]), int(stops[-1])
        if (begins[1:] == stops[:-1]).all():
            content = self.buffer[low:high].copy()
            for place in (begins + offset for offset in range(skip)):
                content[place[place < stops - 1] - low] = ord(" ")
            return content, begins - low
        begins = np.minimum(begins + skip, stops - 1)
        low = int(begins[0])
        change = np.zeros(high - low + 1, np.int8)
        change[begins - low] += 1
        change[stops - low] -= 1
        inside = np.cumsum(change[:-1], dtype=np.int8).view(bool)
        sizes = stops - begins
        return self.buffer[low:high][inside], np.cumsum(sizes) - sizes


def word_starts(content: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Mark the bytes at which a word begins."""
    blank = content <= ord(" ")
    begins = ~blank
    begins[1:] &= blank[:-1]
    return begins


def parse(content: NDArray[np.uint8], count: int, kind: Any) -> NDArray[Any] | None:
    """Return so many numbers that stand between blanks, or None if they are not there."""
    if count == 0:
        return np.zeros(0, kind)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.fromstring(content.tobytes(), kind, sep=" ")
    except (ValueError, OverflowError, DeprecationWarning):
        return None
    return values if len(values) == count else None


def number_rows(
    lines: TextLines,
    which: NDArray[np.int64],
    skip: int,
    least: int,
    what: str,
    damage: Damage,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """
    Read the numbers of some lines.

    Parameters
    ----------
    lines : TextLines
    which : (L,) int64
        Numbers of lines, ascending.
    skip : int
        Bytes at the beginning of each that are no number.
    least : int
        Numbers that a line must have.
    what : str
        What messages call such a line.
    damage : Damage
        Told of lines with others; these have no number in the result.

    Returns
    -------
    values : (N,) float64
    counts : (L,) int64
        How many of them each line has.
    """
    values, counts = [np.zeros(0)], [np.zeros(0, np.int64)]
    for batch in lines.batches(which):
        content, offsets = lines.content(batch, skip)
        found = np.add.reduceat(word_starts(content), offsets, dtype=np.int64)
        numbers = parse(content, int(found.sum()), np.float64) if (found >= least).all() else None
        if numbers is None:
            numbers, found = _careful_rows(lines, batch, skip, least, what, damage)
        values.append(numbers)
        counts.append(found)
    return np.concatenate(values), np.concatenate(counts)


def _careful_rows(
    lines: TextLines,
    which: NDArray[np.int64],
    skip: int,
    least: int,
    what: str,
    damage: Damage,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read what `number_rows` cannot read at once, line by line."""
    values: list[float] = []
    counts = []
    for line in which.tolist():
        words = lines.text(line)[skip:].split("#", 1)[0].split()
        try:
            numbers = [_number(word) for word in words]
        except ValueError:
            numbers = []
        if len(numbers) < least:
            damage.line(lines, line, f"{least} numbers of {what}")
            numbers = []
        values += numbers
        counts.append(len(numbers))
    return np.array(values, np.float64), np.array(counts, np.int64)


def _number(word: str) -> float:
    """Return a number; also those that some C libraries write, such as ``-nan(ind)``."""
    plain = word.split("(")[0] if word.lstrip("+-").lower().startswith("nan") else word
    if "_" in plain:
        raise ValueError(word)
    return float(plain)


def columns(
    values: NDArray[np.float64], counts: NDArray[np.int64], most: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """
    Return rows of numbers as a table, as wide as the shortest row, and which rows are there.

    Rows without numbers are NaN.
    """
    there = counts > 0
    width = min(most, int(counts[there].min())) if there.any() else 0
    begins = (np.cumsum(counts) - counts)[there]
    table = np.full((len(counts), width), np.nan)
    table[there] = values[begins[:, np.newaxis] + np.arange(width)]
    return table, there
