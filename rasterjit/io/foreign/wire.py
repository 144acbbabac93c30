"""
Write what a reader found as JSON and plain arrays, and make it anew of these.

What comes from another process is not trusted: nothing is unpickled. Objects are of a few classes,
whose constructors check their arguments, and arrays hold numbers alone.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import struct
from typing import Any

import numpy as np

from rasterjit.io.primitives import Cloud, LineDrawing
from rasterjit.io.text.mesh_builder import Assembly, Part, Place
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.light import DirectionalLight, PointLight, SpotLight
from rasterjit.scene.material import Material
from rasterjit.scene.texture import Texture

_CLASSES = {
    kind.__name__: kind
    for kind in (
        Part, Cloud, LineDrawing, Assembly, Place, Material, Texture, PerspectiveCamera,
        DirectionalLight, PointLight, SpotLight,
    )
}  # fmt: skip

_NUMBERS = "biufc"
"""Kinds of arrays that are sent."""

_HEAD = struct.Struct("<8sQQ")
_MARK = b"rjfound\n"
"""How a file begins: a mark, then where its JSON begins and how long it is; arrays are before."""

_ALIGNED = 64
"""Bytes: the first of each array is a multiple of them away from that of the file."""


def write_found(found: Any, file: int) -> None:
    """
    Write a value into an empty file.

    Parameters
    ----------
    found : None, bool, int, float, str, bytes, tuple, list, dict, array, object of a known class
        Arrays of anything but numbers become bytes of the same shape.
    file : int
        A descriptor.

    Raises
    ------
    OSError
        If the file gets larger than it may.
    """
    writer = _Encoder(file)
    text = json.dumps(writer.plain(found)).encode()
    at = writer.append(memoryview(text))
    _write_all(file, memoryview(_HEAD.pack(_MARK, at, len(text))), 0)


class _Encoder:
    """Writes arrays, and remembers where what was seen before is."""

    def __init__(self, file: int) -> None:
        self._file, self._end = file, _HEAD.size
        self._known: dict[int, int] = {}
        self._kept: list[Any] = []

    def append(self, content: memoryview) -> int:
        """Write bytes behind all others; return where."""
        at = -(-self._end // _ALIGNED) * _ALIGNED
        _write_all(self._file, content, at)
        self._end = at + len(content)
        return at

    def plain(self, value: Any) -> Any:
        """Return a value in types of JSON."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, str):
            return str(value)
        if isinstance(value, bytes):
            return ["bytes", self.append(memoryview(value)), len(value)]
        if isinstance(value, (list, tuple)):
            return ["list" if isinstance(value, list) else "tuple", *map(self.plain, value)]
        if isinstance(value, dict):
            return ["dict", *([str(key), self.plain(one)] for key, one in value.items())]
        if id(value) in self._known:
            return ["same", self._known[id(value)]]
        if dataclasses.is_dataclass(value) and type(value).__name__ in _CLASSES:
            fields = [
                [one.name, self.plain(getattr(value, one.name))]
                for one in dataclasses.fields(value)
            ]
            made = ["object", type(value).__name__, *fields]
        else:
            made = self._array(np.asarray(value))
        self._known[id(value)] = len(self._kept)
        self._kept.append(value)
        return made

    def _array(self, values: Any) -> Any:
        """Write an array; return where it is and how to read it."""
        if values.dtype.kind not in _NUMBERS or values.dtype.itemsize > 16:
            values = np.zeros(values.shape, "S1")
        values = np.ascontiguousarray(values).reshape(values.shape)
        at = self.append(memoryview(values.reshape(-1).view(np.uint8)))
        return ["array", values.dtype.str, at, *values.shape]


def _write_all(file: int, content: memoryview, at: int) -> None:
    """Write bytes at a place of a file."""
    os.lseek(file, at, os.SEEK_SET)
    while content:
        content = content[os.write(file, content[: 1 << 30]) :]


def read_found(file: int) -> Any:
    """
    Return the value that was written into a file.

    Raises
    ------
    ValueError
        If the file is not as `write_found` writes it, or an object cannot be.
    """
    mark, at, length = _HEAD.unpack(_read_at(file, 0, _HEAD.size))
    if mark != _MARK:
        raise ValueError("nothing was found")
    try:
        return _Decoder(file).value(json.loads(_read_at(file, at, length)))
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"what was found cannot be read: {error}") from error


class _Decoder:
    """Makes values anew."""

    def __init__(self, file: int) -> None:
        self._file, self._size = file, os.fstat(file).st_size
        self._left = self._size
        """Bytes that may still be taken: the writer writes each once."""
        self._kept: list[Any] = []

    def value(self, said: Any) -> Any:
        """Return what types of JSON stand for."""
        if not isinstance(said, list):
            return said
        kind, *rest = said
        if kind in ("list", "tuple"):
            values = map(self.value, rest)
            return list(values) if kind == "list" else tuple(values)
        if kind == "dict":
            return {str(key): self.value(one) for key, one in rest}
        if kind == "same":
            return self._kept[rest[0]]
        if kind == "bytes":
            return bytes(self._content(rest[0], rest[1]))
        if kind == "object":
            made = self._object(rest[0], dict(rest[1:]))
        else:
            made = self._array(rest[0], rest[1], tuple(rest[2:]))
        self._kept.append(made)
        return made

    def _object(self, name: str, fields: dict[str, Any]) -> Any:
        """Return an object of a known class."""
        return _CLASSES[name](**{key: self.value(one) for key, one in fields.items()})

    def _array(self, form: str, at: int, shape: tuple[int, ...]) -> Any:
        """Return an array of its own memory."""
        kind = np.dtype(form)
        if kind.kind not in _NUMBERS + "S" or any(one < 0 for one in shape):
            raise ValueError(f"what was found must be numbers, got {kind} of {shape}")
        return np.ndarray(shape, kind, self._content(at, math.prod(shape) * kind.itemsize))

    def _content(self, at: int, size: int) -> bytearray:
        """Return bytes of the file, or raise ``ValueError`` if they are more than it has."""
        self._left -= size
        return _read_at(self._file, at, size, self._size if self._left >= 0 else 0)


def _read_at(file: int, at: int, size: int, end: int | None = None) -> bytearray:
    """Return bytes of a file, or raise ``ValueError`` if it has fewer."""
    end = os.fstat(file).st_size if end is None else end
    if not 0 <= at <= at + size <= end:
        raise ValueError("what was found is cut short")
    content = bytearray(size)
    view = memoryview(content)
    with open(os.dup(file), "rb", buffering=0) as opened:
        opened.seek(at)
        while view:
            count = opened.readinto(view)
            if not count:
                raise ValueError("what was found is cut short")
            view = view[count:]
    return content
