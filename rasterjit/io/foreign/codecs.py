"""
Packages of others that decode what our own readers find packed in a file: pictures and meshes.

They decode in this process, or where they can do no harm; see `rasterjit.io.foreign.door`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from rasterjit.io.gltf.compression import transcoded, unpacked_mesh, unpacked_rows
from rasterjit.io.gltf.extensions import BASIS, DRACO, LIBRARIES, MESHOPT
from rasterjit.io.images import picture_pixels
from rasterjit.scene.memory_limits import MemoryBudget

if TYPE_CHECKING:
    from rasterjit.io.foreign.door import Session

Isolation: TypeAlias = bool | Literal["all"]
"""What works in a process with limits: all packages but Pillow, none, or Pillow as well."""

_PLUGINS = ("Png", "Jpeg", "WebP", "Tiff", "Bmp", "Tga", "Gif", "Dds", "Avif")
"""What Pillow calls the formats that are opened, as parts of names of modules."""


class Codec(NamedTuple):
    """
    What decodes a kind of data.

    Parameters
    ----------
    library : str
        What messages call the package.
    decode : callable
        Given bytes, numbers and texts, and last the `MemoryBudget`, returns arrays; raises whatever
        the package does about damaged data.
    modules : tuple of str
        What it imports.
    """

    library: str
    decode: Callable[..., Any]
    modules: tuple[str, ...]


def _of_gltf(extension: str, decode: Callable[..., Any]) -> Codec:
    """Return the codec of an extension of glTF."""
    return Codec(LIBRARIES[extension], decode, (LIBRARIES[extension],))


_PICTURE = "picture"

CODECS = {
    _PICTURE: Codec("Pillow", picture_pixels,
                    ("PIL.Image", *(f"PIL.{name}ImagePlugin" for name in _PLUGINS))),
    "ktx2": _of_gltf(BASIS, transcoded),
    "draco": _of_gltf(DRACO, unpacked_mesh),
    "meshopt": _of_gltf(MESHOPT[0], unpacked_rows),
}  # fmt: skip


def _isolated_codecs(isolate: Isolation) -> frozenset[str]:
    """Return the names of those that decode in a process with limits."""
    if isolate == "all":
        return frozenset(CODECS)
    return frozenset(CODECS) - {_PICTURE} if isolate else frozenset()


class Decoder:
    """
    Decodes what one file, and all that it names, holds packed.

    Parameters
    ----------
    budget : MemoryBudget
    isolate : bool or "all"
        Which codecs decode in a process with limits.
    begin : callable, optional
        Begins a session of that process; not needed if none do.
    """

    def __init__(
        self,
        budget: MemoryBudget,
        isolate: Isolation = False,
        begin: Callable[[MemoryBudget], Session] | None = None,
    ) -> None:
        self._budget, self._begin = budget, begin
        self._isolated = _isolated_codecs(isolate)
        self._session: Session | None = None

    def decode(self, name: str, *arguments: Any) -> Any:
        """
        Return what a codec makes of its arguments.

        Raises
        ------
        ValueError
            Also, from then on, if its process crashed or reached a limit: `MeshFileError`.
        Exception
            Whatever the package raises about damaged data, if it decodes in this process.
        """
        if name not in self._isolated or self._begin is None:
            return CODECS[name].decode(*arguments, self._budget)
        self._budget.check()
        if self._session is None:
            self._session = self._begin(self._budget)
        return self._session.decode(name, arguments)

    def close(self) -> None:
        """Let others have the process, if there is one."""
        if self._session is not None:
            self._session.close()
            self._session = None
