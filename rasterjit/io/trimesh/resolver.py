"""Resolve the files that trimesh's readers request, and note what trimesh logs."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rasterjit.io.images import check_picture
from rasterjit.io.load_warnings import LeftOut, reason_of
from rasterjit.io.resources import RefusedFileError, Resources, quote_name


@contextmanager
def note_trimesh_warnings(left_out: LeftOut) -> Iterator[None]:
    """Note the warnings that trimesh logs in this thread, which would print tracebacks."""
    thread, log = threading.get_ident(), logging.getLogger("trimesh")

    def take(record: logging.LogRecord) -> bool:
        """Drop a warning of this thread from the log, and note it."""
        if record.levelno < logging.WARNING or record.thread != thread:
            return True
        error = record.exc_info[1] if record.exc_info else None
        reason = f": {reason_of(error)}" if isinstance(error, Exception) else ""
        left_out.note(
            f"part of which trimesh says: {' '.join(record.getMessage().split())[:80]}{reason}"
        )
        return False

    log.addFilter(take)
    try:
        yield
    finally:
        log.removeFilter(take)


def make_resolver(resources: Resources, left_out: LeftOut, are_pictures: bool = False) -> Any:
    """
    Return a resolver with which trimesh reads further files.

    Parameters
    ----------
    resources : Resources
    left_out : LeftOut
        Notes what was refused or is missing.
    are_pictures : bool
        Whether all files that it may name are pictures, so that others are noted as well.
    """
    import trimesh.resolvers

    def check(name: str, content: bytes) -> None:
        """Raise ``ValueError``, with a note, if a file is no picture that can be decoded."""
        try:
            check_picture(content)
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            left_out.note(f"picture {quote_name(name)} that cannot be read: {reason_of(error)}")
            raise ValueError(f"{quote_name(name)} cannot be read") from error

    class Resolver(trimesh.resolvers.Resolver):
        """Resolves file names by `Resources`."""

        def __init__(self, namespace: str = "") -> None:
            self._namespace = namespace

        def get(self, key: Any) -> bytes:
            """Return the content of a file."""
            name = f"{self._namespace}{str(key).strip()}"
            try:
                content = resources.read(name)
            except ValueError as error:
                left_out.note(f"a file that it names: {' '.join(str(error).split())}")
                raise
            if are_pictures:
                check(name, content)
            return content

        def keys(self) -> list[str]:
            """Return the names of the files beside the mesh file."""
            return sorted(one.name for one in Path(resources.folder).iterdir())

        def namespaced(self, namespace: str) -> Resolver:
            """Return a resolver for a subfolder."""
            return Resolver(f"{self._namespace}{namespace}/")

        def write(self, name: str, data: Any) -> None:
            """Refuse to write: a file is only read."""
            raise RefusedFileError(f"reading a file writes none: {name[:80]!r}")

    return Resolver()
