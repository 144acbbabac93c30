"""
Serialize the results of readers as JSON and raw arrays, and back.

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

from rasterjit.io.primitives import Cloud, LineSet
from rasterjit.io.text.mesh_builder import MeshData, NodeRecord, SceneRecord
from rasterjit.io.urdf import JointRecord, RobotRecord, VisualRecord
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.light import DirectionalLight, PointLight, SpotLight
from rasterjit.scene.material import Material
from rasterjit.scene.texture import Texture

_CLASSES = {
    kind.__name__: kind
    for kind in (
        MeshData, Cloud, LineSet, SceneRecord, NodeRecord, Material, Texture, PerspectiveCamera,
        DirectionalLight, PointLight, SpotLight, RobotRecord, VisualRecord, JointRecord,
    )
}  # fmt: skip

_NUMBER_KINDS = "biufc"
"""NumPy kinds of arrays that are sent."""

_HEADER = struct.Struct("<8sQQ")
_MAGIC = b"rjfound\n"
"""First bytes of a file; the header then has offset and length of the JSON, behind the arrays."""

_ALIGNMENT = 64
"""Alignment of arrays in the file, bytes."""


def write_value(value: Any, file: int) -> None:
    """
    Serialize a value into an empty file.

    Parameters
    ----------
    value : None, bool, int, float, str, bytes, tuple, list, dict, array, object of a known class
        Arrays of anything but numbers become bytes of the same shape.
    file : int
        A descriptor.

    Raises
    ------
    OSError
        If the file gets larger than it may.
    """
    writer = _Encoder(file)
    text = json.dumps(writer.encode(value)).encode()
    at = writer.append(memoryview(text))
    _write_all(file, memoryview(_HEADER.pack(_MAGIC, at, len(text))), 0)


class _Encoder:
    """Encodes values as types of JSON; arrays go to a file, shared objects once."""

    def __init__(self, file: int) -> None:
        self._file, self._end = file, _HEADER.size
        self._object_numbers: dict[int, int] = {}
        self._objects: list[Any] = []

    def append(self, content: memoryview) -> int:
        """Append bytes to the file; return their offset."""
        at = -(-self._end // _ALIGNMENT) * _ALIGNMENT
        _write_all(self._file, content, at)
        self._end = at + len(content)
        return at

    def encode(self, value: Any) -> Any:
        """Return a value as types of JSON."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, str):
            return str(value)
        if isinstance(value, bytes):
            return ["bytes", self.append(memoryview(value)), len(value)]
        if isinstance(value, (list, tuple)):
            return ["list" if isinstance(value, list) else "tuple", *map(self.encode, value)]
        if isinstance(value, dict):
            return ["dict", *([str(key), self.encode(one)] for key, one in value.items())]
        if id(value) in self._object_numbers:
            return ["same", self._object_numbers[id(value)]]
        if dataclasses.is_dataclass(value) and type(value).__name__ in _CLASSES:
            fields = [
                [one.name, self.encode(getattr(value, one.name))]
                for one in dataclasses.fields(value)
            ]
            encoded = ["object", type(value).__name__, *fields]
        else:
            encoded = self._encode_array(np.asarray(value))
        self._object_numbers[id(value)] = len(self._objects)
        self._objects.append(value)
        return encoded

    def _encode_array(self, values: Any) -> Any:
        """Append an array; return its type, offset and shape as JSON."""
        if values.dtype.kind not in _NUMBER_KINDS or values.dtype.itemsize > 16:
            values = np.zeros(values.shape, "S1")
        values = np.ascontiguousarray(values).reshape(values.shape)
        at = self.append(memoryview(values.reshape(-1).view(np.uint8)))
        return ["array", values.dtype.str, at, *values.shape]


def _write_all(file: int, content: memoryview, at: int) -> None:
    """Write bytes at an offset of a file."""
    os.lseek(file, at, os.SEEK_SET)
    while content:
        content = content[os.write(file, content[: 1 << 30]) :]


def read_value(file: int) -> Any:
    """
    Return the value that `write_value` wrote into a file.

    Raises
    ------
    ValueError
        If the file is not as `write_value` writes it, or an object cannot be.
    """
    magic, at, length = _HEADER.unpack(_read_at(file, 0, _HEADER.size))
    if magic != _MAGIC:
        raise ValueError("nothing was found")
    try:
        return _Decoder(file).decode(json.loads(_read_at(file, at, length)))
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"what was found cannot be read: {error}") from error


class _Decoder:
    """Decodes values that `_Encoder` encoded."""

    def __init__(self, file: int) -> None:
        self._file, self._size = file, os.fstat(file).st_size
        self._left = self._size
        """Bytes that may still be read: the writer writes each once."""
        self._objects: list[Any] = []

    def decode(self, encoded: Any) -> Any:
        """Return the value of its JSON encoding."""
        if not isinstance(encoded, list):
            return encoded
        kind, *rest = encoded
        if kind in ("list", "tuple"):
            values = map(self.decode, rest)
            return list(values) if kind == "list" else tuple(values)
        if kind == "dict":
            return {str(key): self.decode(one) for key, one in rest}
        if kind == "same":
            return self._objects[rest[0]]
        if kind == "bytes":
            return bytes(self._content(rest[0], rest[1]))
        if kind == "object":
            decoded = self._object(rest[0], dict(rest[1:]))
        else:
            decoded = self._decode_array(rest[0], rest[1], tuple(rest[2:]))
        self._objects.append(decoded)
        return decoded

    def _object(self, name: str, fields: dict[str, Any]) -> Any:
        """Return an object of a known class."""
        return _CLASSES[name](**{key: self.decode(one) for key, one in fields.items()})

    def _decode_array(self, form: str, at: int, shape: tuple[int, ...]) -> Any:
        """Return an array with memory of its own."""
        kind = np.dtype(form)
        if kind.kind not in _NUMBER_KINDS + "S" or any(one < 0 for one in shape):
            raise ValueError(f"what was found must be numbers, got {kind} of {shape}")
        return np.ndarray(shape, kind, self._content(at, math.prod(shape) * kind.itemsize))

    def _content(self, at: int, size: int) -> bytearray:
        """Return bytes of the file, or raise ``ValueError`` if all reads exceed its size."""
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
