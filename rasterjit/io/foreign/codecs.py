"""
Codecs of other packages for compressed pictures and meshes in files.

They decode in this process, or isolated; see `rasterjit.io.foreign.isolation`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from rasterjit.io.gltf.compression import decode_draco_arrays, decode_meshopt_rows, transcode_ktx2
from rasterjit.io.gltf.extensions import BASIS, DRACO, LIBRARIES, MESHOPT
from rasterjit.io.images import decode_picture
from rasterjit.scene.memory_limits import MemoryBudget

if TYPE_CHECKING:
    from rasterjit.io.foreign.isolation import Session

Isolation: TypeAlias = bool | Literal["all"]
"""Which packages run in an isolated process: all but Pillow, none, or Pillow as well."""

_PILLOW_PLUGINS = ("Png", "Jpeg", "WebP", "Tiff", "Bmp", "Tga", "Gif", "Dds", "Avif")
"""Pillow's plugins for the formats that are opened."""


class Codec(NamedTuple):
    """
    A decoder of one kind of data.

    Parameters
    ----------
    library : str
        Name of the package in messages.
    decode : callable
        Given bytes, numbers and texts, and last the `MemoryBudget`, returns arrays; raises whatever
        the package does about damaged data.
    modules : tuple of str
        Modules that it imports.
    """

    library: str
    decode: Callable[..., Any]
    modules: tuple[str, ...]


def _make_gltf_codec(extension: str, decode: Callable[..., Any]) -> Codec:
    """Return the codec of an extension of glTF."""
    return Codec(LIBRARIES[extension], decode, (LIBRARIES[extension],))


_PICTURE_CODEC = "picture"

CODECS = {
    _PICTURE_CODEC: Codec("Pillow", decode_picture,
                    ("PIL.Image", *(f"PIL.{name}ImagePlugin" for name in _PILLOW_PLUGINS))),
    "ktx2": _make_gltf_codec(BASIS, transcode_ktx2),
    "draco": _make_gltf_codec(DRACO, decode_draco_arrays),
    "meshopt": _make_gltf_codec(MESHOPT[0], decode_meshopt_rows),
}  # fmt: skip


def _list_isolated(isolate: Isolation) -> frozenset[str]:
    """Return the names of the codecs that run in an isolated process."""
    if isolate == "all":
        return frozenset(CODECS)
    return frozenset(CODECS) - {_PICTURE_CODEC} if isolate else frozenset()


class Decoder:
    """
    Decodes the compressed data of one file and the files that it refers to.

    Parameters
    ----------
    budget : MemoryBudget
    isolate : bool or "all"
        Which codecs run in an isolated process.
    begin : callable, optional
        Starts a session of that process; unused if no codec does.
    """

    def __init__(
        self,
        budget: MemoryBudget,
        isolate: Isolation = False,
        begin: Callable[[MemoryBudget], Session] | None = None,
    ) -> None:
        self._budget, self._begin = budget, begin
        self._isolated = _list_isolated(isolate)
        self._session: Session | None = None

    def decode(self, name: str, *arguments: Any) -> Any:
        """
        Return the result of a codec.

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
        """Release the process, if there is one."""
        if self._session is not None:
            self._session.close()
            self._session = None
