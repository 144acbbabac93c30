"""Parse lines of numbers in batches; look for the damaged line only if a batch fails."""

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
"""Bytes of a file that are parsed at once."""

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"

_BLANKS = bytes(range(ord(" ") + 1))
_MAX_COMMON_INDENT = 64
"""Blanks before a line that are skipped in all lines at once; further ones line by line."""

_MAX_LINE_LENGTH = 40
"""Most characters of a damaged line in a message."""


LINE_BYTES, TEXT_BYTES, BINARY_BYTES = 24, 5, 3
"""Memory of a line, and of a byte of a text or of a binary file."""

ROW_BYTES, CORNER_BYTES = 64, 80
"""Memory of a row of numbers, and of a corner of a face."""


def line_end(data: bytes) -> bytes:
    """Return the line ending of a text: a line feed, or a carriage return alone."""
    feed, carriage_return = data.find(b"\n"), data.find(b"\r")
    uses_carriage_return = carriage_return >= 0 and (feed < 0 or carriage_return < feed - 1)
    return b"\r" if uses_carriage_return else b"\n"


def parse_float(word: str) -> float | None:
    """Return the number that a word is, or None."""
    try:
        return float(word)
    except ValueError:
        return None


class Damage:
    """
    Report damaged places of a file: raise, or count them for one warning.

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
        self._is_strict = on_damage == "error"
        self._left_out = left_out
        self._first_message: str | None = None
        self._count = 0

    def line(self, lines: TextLines, line: int, expected: str) -> None:
        """Report a damaged line."""
        if self._is_strict or self._first_message is None:
            self._report(f"{lines.line_label(line)}: expected {expected}, got {lines.quote(line)}")
        self._count += 1

    def end(self, expected: str, got: str) -> None:
        """Report a file that ends too early or too late."""
        if self._is_strict or self._first_message is None:
            self._report(f"its end: expected {expected}, got {got}")
        self._count += 1

    def _report(self, message: str) -> None:
        """Raise `MeshFileError`, or keep the message of the first damaged place."""
        if self._is_strict:
            raise MeshFileError(
                f"{self.path} is damaged at {message}; on_damage='warn' loads what there is"
            )
        self._first_message = message

    def note(self) -> None:
        """Note the damaged places, once."""
        if self._first_message is not None:
            self._left_out.note(f"what is damaged, first {self._first_message}", self._count)


class TextLines:
    """
    The lines of a text file, without leading blanks.

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
        for _ in range(_MAX_COMMON_INDENT):
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
        """Return a line without surrounding blanks."""
        return self._data[self.starts[line] : self.ends[line]].decode("utf-8", "replace").strip()

    def line_label(self, line: int) -> str:
        """Return a line's number in the original file, for messages."""
        number = self._original.count(b"\n", 0, int(self.starts[line])) + 1
        return f"line {number}"

    def quote(self, line: int) -> str:
        """Return a line in quotes, shortened, for messages."""
        text = self.text(line)
        return repr(text if len(text) <= _MAX_LINE_LENGTH else f"{text[:_MAX_LINE_LENGTH]}...")

    def note_unknown(self, line_numbers: NDArray[np.int64], left_out: LeftOut) -> None:
        """Note lines of unknown statements, quoting the first."""
        if len(line_numbers):
            first = f"{self.line_label(int(line_numbers[0]))}: {self.quote(int(line_numbers[0]))}"
            left_out.note(f"lines of no known kind, first {first}", len(line_numbers))

    def char(self, offset: int) -> NDArray[np.uint8]:
        """Return the byte of each line at an offset from its start, or its line ending."""
        return self.buffer[np.minimum(self.starts + offset, self.ends)]

    def batches(self, lines: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
        """Yield batches of lines, each of a bounded number of bytes or a single line."""
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
        Return the bytes of lines with their endings, without the first ``skip`` of each.

        Those of lines that follow one another are blanks there.

        Returns
        -------
        content : (B,) uint8
        offsets : (L,) int64
            Where each line begins in it.
        """
        begins, stops = self.starts[lines], self.ends[lines] + 1
        first, last = int(begins[0]), int(stops[-1])
        if (begins[1:] == stops[:-1]).all():
            content = self.buffer[first:last].copy()
            for offsets_of_byte in (begins + offset for offset in range(skip)):
                content[offsets_of_byte[offsets_of_byte < stops - 1] - first] = ord(" ")
            return content, begins - first
        begins = np.minimum(begins + skip, stops - 1)
        first = int(begins[0])
        change = np.zeros(last - first + 1, np.int8)
        change[begins - first] += 1
        change[stops - first] -= 1
        inside = np.cumsum(change[:-1], dtype=np.int8).view(bool)
        sizes = stops - begins
        return self.buffer[first:last][inside], np.cumsum(sizes) - sizes


def word_starts(content: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Mark the bytes at which a word begins."""
    blank = content <= ord(" ")
    begins = ~blank
    begins[1:] &= blank[:-1]
    return begins


def parse(content: NDArray[np.uint8], count: int, kind: Any) -> NDArray[Any] | None:
    """Return exactly ``count`` blank-separated numbers, or None."""
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
    line_numbers: NDArray[np.int64],
    skip: int,
    least: int,
    what: str,
    damage: Damage,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """
    Parse the numbers of some lines.

    Parameters
    ----------
    lines : TextLines
    line_numbers : (L,) int64
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
    for batch in lines.batches(line_numbers):
        content, offsets = lines.content(batch, skip)
        words = np.add.reduceat(word_starts(content), offsets, dtype=np.int64)
        numbers = parse(content, int(words.sum()), np.float64) if (words >= least).all() else None
        if numbers is None:
            numbers, words = _rows_line_by_line(lines, batch, skip, least, what, damage)
        values.append(numbers)
        counts.append(words)
    return np.concatenate(values), np.concatenate(counts)


def _rows_line_by_line(
    lines: TextLines,
    line_numbers: NDArray[np.int64],
    skip: int,
    least: int,
    what: str,
    damage: Damage,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Parse lines one by one, where `number_rows` fails for a batch."""
    values: list[float] = []
    counts = []
    for line in line_numbers.tolist():
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
    """Parse a number, also as some C libraries write it, such as ``-nan(ind)``."""
    stripped = word.split("(")[0] if word.lstrip("+-").lower().startswith("nan") else word
    if "_" in stripped:
        raise ValueError(word)
    return float(stripped)


def row_table(
    values: NDArray[np.float64], counts: NDArray[np.int64], max_width: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """
    Return rows of numbers as a table, as wide as the shortest row, and which rows have numbers.

    Rows without numbers are NaN.
    """
    has_numbers = counts > 0
    width = min(max_width, int(counts[has_numbers].min())) if has_numbers.any() else 0
    begins = (np.cumsum(counts) - counts)[has_numbers]
    table = np.full((len(counts), width), np.nan)
    table[has_numbers] = values[begins[:, np.newaxis] + np.arange(width)]
    return table, has_numbers
