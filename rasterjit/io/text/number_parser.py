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

_BATCH_BYTES = 1 << 22
"""Bytes of a file that are parsed at once."""

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"

_BLANKS = bytes(range(ord(" ") + 1))
_MAX_COMMON_INDENT = 64
"""Blanks before a line that are skipped in all lines at once; further ones line by line."""

_MAX_LINE_LENGTH = 40
"""Most characters of a damaged line in a message."""


MEMORY_PER_LINE, MEMORY_PER_TEXT_BYTE, MEMORY_PER_BINARY_BYTE = 24, 5, 3
"""Bytes of memory for a line, and for a byte of a text or of a binary file."""

MEMORY_PER_ROW, MEMORY_PER_CORNER = 64, 80
"""Bytes of memory for a row of numbers, and for a corner of a face."""


def find_line_ending(data: bytes) -> bytes:
    """Return the line ending of a text: a line feed, or a carriage return alone."""
    feed, carriage_return = data.find(b"\n"), data.find(b"\r")
    uses_carriage_return = carriage_return >= 0 and (feed < 0 or carriage_return < feed - 1)
    return b"\r" if uses_carriage_return else b"\n"


def parse_float(word: str) -> float | None:
    """Return a word as a number; None if it is none."""
    try:
        return float(word)
    except ValueError:
        return None


class Damage:
    """
    Reports damaged places of a file: raises, or counts them for one warning.

    Parameters
    ----------
    path : Path
        Named in messages.
    on_damage : {"error", "warn"}
    left_out : LeftOut
        Collects the warning.
    """

    def __init__(self, path: Path, on_damage: str, left_out: LeftOut) -> None:
        self.path = path
        self._is_strict = on_damage == "error"
        self._left_out = left_out
        self._first_message: str | None = None
        self._count = 0

    def report_line(self, lines: TextLines, line: int, expected: str) -> None:
        """Report a damaged line."""
        if self._is_strict or self._first_message is None:
            self._report(f"{lines.line_label(line)}: expected {expected}, got {lines.quote(line)}")
        self._count += 1

    def report_end(self, expected: str, got: str) -> None:
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

    def add_to_left_out(self) -> None:
        """Note all damaged places as one entry of the warning."""
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
        Counts the memory of the lines and numbers.
    begin : int
        Offset of the first line, bytes.
    original : bytes, optional
        The unchanged file, if some bytes of ``data`` were replaced: lines are numbered as there.

    Attributes
    ----------
    buffer : (B,) uint8
        The file, ending with a line ending.
    starts, ends : (L,) int64
        Offsets of each line's first byte that is no blank, and of its line ending.
    """

    def __init__(
        self, data: bytes, budget: MemoryBudget, begin: int = 0, original: bytes | None = None
    ) -> None:
        if begin == 0 and data.startswith(_BYTE_ORDER_MARK):
            begin = len(_BYTE_ORDER_MARK)
        if data.find(b"\n", begin) < 0 and b"\r" in data:
            data = original = data.replace(b"\r", b"\n")
        if len(data) <= begin or not data.endswith(b"\n"):
            data += b"\n"
        count = data.count(b"\n", begin)
        budget.take(
            f"its {count} lines", count * MEMORY_PER_LINE + len(data) * MEMORY_PER_TEXT_BYTE
        )
        self._data = data
        self._original = data if original is None else original
        self.buffer = np.frombuffer(data, np.uint8)
        self.ends = np.flatnonzero(self.buffer[begin:] == ord("\n")) + begin
        self.starts = np.concatenate(([begin], self.ends[:-1] + 1))
        is_blank = self.buffer[self.starts] <= ord(" ")
        indented = np.flatnonzero(is_blank & (self.starts < self.ends))
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

    def byte_at(self, offset: int) -> NDArray[np.uint8]:
        """Return the byte of each line at an offset from its start, or its line ending."""
        return self.buffer[np.minimum(self.starts + offset, self.ends)]

    def split_batches(self, lines: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
        """Yield batches of lines, each of a bounded number of bytes or a single line."""
        if not len(lines):
            return
        sizes = np.cumsum(self.ends[lines] - self.starts[lines] + 1)
        at = 0
        while at < len(lines):
            before = int(sizes[at - 1]) if at else 0
            stop = max(at + 1, int(np.searchsorted(sizes, before + _BATCH_BYTES, "right")))
            yield lines[at:stop]
            at = stop

    def gather_bytes(
        self, lines: NDArray[np.int64], keyword_length: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """
        Return the bytes of lines with their endings, without the keyword of each.

        In consecutive lines the keyword is replaced by blanks.

        Returns
        -------
        content : (B,) uint8
        offsets : (L,) int64
            Where each line begins in ``content``.
        """
        begins, stops = self.starts[lines], self.ends[lines] + 1
        first, last = int(begins[0]), int(stops[-1])
        if (begins[1:] == stops[:-1]).all():
            content = self.buffer[first:last].copy()
            for offsets_of_byte in (begins + offset for offset in range(keyword_length)):
                content[offsets_of_byte[offsets_of_byte < stops - 1] - first] = ord(" ")
            return content, begins - first
        begins = np.minimum(begins + keyword_length, stops - 1)
        first = int(begins[0])
        change = np.zeros(last - first + 1, np.int8)
        change[begins - first] += 1
        change[stops - first] -= 1
        inside = np.cumsum(change[:-1], dtype=np.int8).view(bool)
        sizes = stops - begins
        return self.buffer[first:last][inside], np.cumsum(sizes) - sizes


def mark_word_starts(content: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Mark the bytes at which a word begins."""
    blank = content <= ord(" ")
    begins = ~blank
    begins[1:] &= blank[:-1]
    return begins


def parse_numbers(content: NDArray[np.uint8], count: int, dtype: Any) -> NDArray[Any] | None:
    """Return exactly ``count`` blank-separated numbers, or None."""
    if count == 0:
        return np.zeros(0, dtype)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.fromstring(content.tobytes(), dtype, sep=" ")
    except (ValueError, OverflowError, DeprecationWarning):
        return None
    return values if len(values) == count else None


def parse_rows(
    lines: TextLines,
    line_numbers: NDArray[np.int64],
    keyword_length: int,
    min_count: int,
    row_name: str,
    damage: Damage,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """
    Parse the numbers of lines.

    Parameters
    ----------
    lines : TextLines
    line_numbers : (L,) int64
        Numbers of lines, ascending.
    keyword_length : int
        Bytes at the beginning of each that are no number.
    min_count : int
        Numbers that a line must have.
    row_name : str
        Name of a row in messages.
    damage : Damage
        Reports lines with fewer numbers or words that are none; they have no number in the result.

    Returns
    -------
    values : (N,) float64
    counts : (L,) int64
        Numbers of each line.
    """
    values, counts = [np.zeros(0)], [np.zeros(0, np.int64)]
    for batch in lines.split_batches(line_numbers):
        content, offsets = lines.gather_bytes(batch, keyword_length)
        counts_of_batch = np.add.reduceat(mark_word_starts(content), offsets, dtype=np.int64)
        numbers = None
        if (counts_of_batch >= min_count).all():
            numbers = parse_numbers(content, int(counts_of_batch.sum()), np.float64)
        if numbers is None:
            numbers, counts_of_batch = _parse_line_by_line(
                lines, batch, keyword_length, min_count, row_name, damage
            )
        values.append(numbers)
        counts.append(counts_of_batch)
    return np.concatenate(values), np.concatenate(counts)


def _parse_line_by_line(
    lines: TextLines,
    line_numbers: NDArray[np.int64],
    keyword_length: int,
    min_count: int,
    row_name: str,
    damage: Damage,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Parse lines one by one, where `parse_rows` cannot parse a batch at once."""
    values: list[float] = []
    counts = []
    for line in line_numbers.tolist():
        words = lines.text(line)[keyword_length:].split("#", 1)[0].split()
        try:
            numbers = [_number(word) for word in words]
        except ValueError:
            numbers = []
        if len(numbers) < min_count:
            damage.report_line(lines, line, f"{min_count} numbers of {row_name}")
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


def parse_equal_rows(
    lines: TextLines,
    line_numbers: NDArray[np.int64],
    count: int,
    row_name: str,
    damage: Damage,
) -> NDArray[np.float64]:
    """
    Return the numbers of lines, (R, count), without the lines that have fewer or more.

    Parameters are those of `parse_rows`; other lines are reported to ``damage``.
    """
    values, counts = parse_rows(lines, line_numbers, 0, count, row_name, damage)
    for row in np.flatnonzero(counts > count).tolist():
        damage.report_line(lines, int(line_numbers[row]), f"{count} numbers of {row_name}")
    return _first_numbers(values, counts, counts == count, count)


def _first_numbers(
    values: NDArray[np.float64], counts: NDArray[np.int64], selected: NDArray[np.bool_], width: int
) -> NDArray[np.float64]:
    """Return the first ``width`` numbers of the selected rows as a table."""
    begins = (np.cumsum(counts) - counts)[selected]
    return values[begins[:, np.newaxis] + np.arange(width)]


def make_row_table(
    values: NDArray[np.float64], counts: NDArray[np.int64], max_width: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """
    Return rows of numbers as a table, as wide as the shortest row, and a mask of non-empty rows.

    Empty rows are NaN.
    """
    has_numbers = counts > 0
    width = min(max_width, int(counts[has_numbers].min())) if has_numbers.any() else 0
    table = np.full((len(counts), width), np.nan)
    table[has_numbers] = _first_numbers(values, counts, has_numbers, width)
    return table, has_numbers
