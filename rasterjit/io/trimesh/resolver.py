"""What trimesh's readers ask for besides the file itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rasterjit.io.resources import RefusedFileError, Resources
from rasterjit.io.skipped import LeftOut, reason_of


def resolver_of(resources: Resources, left_out: LeftOut) -> Any:
    """
    Return what trimesh reads further files with.

    Parameters
    ----------
    resources : Resources
    left_out : LeftOut
        Notes what was refused.
    """
    import trimesh.resolvers

    class Resolver(trimesh.resolvers.Resolver):
        """Opens what a mesh file may name."""

        def __init__(self, namespace: str = "") -> None:
            self._namespace = namespace

        def get(self, key: Any) -> bytes:
            """Return the content of a file."""
            name = f"{self._namespace}{str(key).strip()}"
            try:
                return resources.read(name)
            except RefusedFileError as error:
                left_out.note(f"a file that it names: {reason_of(error)}")
                raise

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
