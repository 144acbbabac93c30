"""
Count the memory that a file asks for, before it is taken.

A file may say that it holds more than any machine has. So each reader says what it is about to
take, by sizes that it can tell beforehand, and one budget refuses what is too much.
"""

from __future__ import annotations

from rasterjit.scene.validation import brief

DEFAULT_MAX_BYTES = 8 << 30
"""Default limit of the memory that loading a file may take, bytes."""

TEXEL_BYTES = 48
"""Memory of a texel, bytes: decoded, as four float32, and in mip levels being computed."""


class FileSizeError(ValueError):
    """Raised if loading a file would exceed its memory budget."""


class MemoryBudget:
    """
    Budget of memory for loading one file and all that it refers to.

    Once something was refused everything is, and ``refusal`` is why: readers that go on without
    what cannot be read end soon, and who asked them raises it.

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
        Count bytes that are about to be taken.

        Parameters
        ----------
        what : str
            What needs them, as a message says it.
        count : int

        Raises
        ------
        FileSizeError
            If fewer are left, or were so before.
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
        """Refuse everything from now on, and raise an error that says why."""
        self.refusal = error
        self.check()

    def check(self) -> None:
        """Raise the error that says why, if anything was refused."""
        if self.refusal is not None:
            raise self.refusal
