"""
Count the memory that loading a file needs, before it is allocated.

A file may declare more data than any machine can hold. Readers request memory for the sizes that
they know beforehand, and the file's budget refuses too much.
"""

from __future__ import annotations

from rasterjit.scene.validation import brief

DEFAULT_MAX_BYTES = 8 << 30
"""Default limit of the memory that loading a file may use, bytes."""

TEXEL_BYTES = 48
"""Memory of a texel, bytes: decoded, as four float32, and in mip levels being computed."""


class FileSizeError(ValueError):
    """Raised if loading a file would exceed its memory budget."""


class MemoryBudget:
    """
    Budget of memory for loading one file and all that it refers to.

    After a refusal all further requests are refused, too, and ``refusal`` is the reason: readers
    that skip unreadable parts end soon, and their caller raises it.

    Parameters
    ----------
    source : str
        What messages call the file.
    max_bytes : int

    Attributes
    ----------
    source, max_bytes
        As given.
    left : int
        Bytes that may still be taken.

    Raises
    ------
    ValueError
        If ``max_bytes`` is no whole number above 0.
    """

    def __init__(self, source: str, max_bytes: int = DEFAULT_MAX_BYTES) -> None:
        if isinstance(max_bytes, bool) or not isinstance(max_bytes, int) or max_bytes <= 0:
            raise ValueError(f"max_bytes must be a whole number above 0, got {brief(max_bytes)}")
        self.source = source
        self.max_bytes = max_bytes
        self.left = max_bytes
        self.refusal: ValueError | None = None

    def take(self, what: str, count: int) -> None:
        """
        Count bytes that are about to be allocated.

        Parameters
        ----------
        what : str
            What needs them, for the message.
        count : int

        Raises
        ------
        FileSizeError
            If fewer are left, or a request was refused before.
        """
        if self.refusal is None and count > self.left:
            self.refuse(
                FileSizeError(
                    f"{self.source}: {what} needs {count:,} bytes, but {self.left:,} are left of "
                    f"max_bytes = {self.max_bytes:,}"
                )
            )
        self.check()
        self.left -= count

    def refuse(self, error: ValueError) -> None:
        """Refuse this and all further requests, and raise the error."""
        self.refusal = error
        self.check()

    def check(self) -> None:
        """Raise the error of an earlier refusal, if any."""
        if self.refusal is not None:
            raise self.refusal
