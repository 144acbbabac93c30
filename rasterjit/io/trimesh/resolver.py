"""What trimesh's readers ask for besides the file itself, and what they log, as notes of a line."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rasterjit.io.images import check_picture
from rasterjit.io.load_warnings import LeftOut, reason_of
from rasterjit.io.resources import RefusedFileError, Resources, shown_name


@contextmanager
def trimesh_told(left_out: LeftOut) -> Iterator[None]:
    """Note the warnings that trimesh logs in this thread, which would print tracebacks."""
    thread, log = threading.get_ident(), logging.getLogger("trimesh")

    def take(record: logging.LogRecord) -> bool:
        """Keep a record from handlers if it is a warning of ours."""
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


def resolver_of(resources: Resources, left_out: LeftOut, are_pictures: bool = False) -> Any:
    """
    Return what trimesh reads further files with.

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
        """Raise ``ValueError``, with a note, if a file is no picture as those of other files."""
        try:
            check_picture(content)
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            left_out.note(f"picture {shown_name(name)} that cannot be read: {reason_of(error)}")
            raise ValueError(f"{shown_name(name)} cannot be read") from error

    class Resolver(trimesh.resolvers.Resolver):
        """Opens what a mesh file may name."""

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
            """Return the names of what lies beside the file."""
            return sorted(one.name for one in Path(resources.folder).iterdir())

        def namespaced(self, namespace: str) -> Resolver:
            """Return one for names in a folder."""
            return Resolver(f"{self._namespace}{namespace}/")

        def write(self, name: str, data: Any) -> None:
            """Refuse to write: a file is only read."""
            raise RefusedFileError(f"reading a file writes none: {name[:80]!r}")

    return Resolver()
