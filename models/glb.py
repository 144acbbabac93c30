"""
Write binary glTF files and PNG pictures byte for byte the same on every machine.

Nothing here calls zlib's compressor, whose output differs between versions.

References
----------
Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), section 4.4 for the GLB container;
extension KHR_lights_punctual. W3C, "Portable Network Graphics (PNG) Specification, third edition".
RFC 1950 (zlib) and RFC 1951 (deflate, section 3.2.4: stored blocks).
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

COMPONENT_TYPES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "float32": 5126}
ELEMENT_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
JOINTS = "JOINTS_"
"""Attributes that begin so hold whole numbers, not shares of the largest."""
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
MAX_STORED_BLOCK = 65535
"""Bytes in a stored deflate block: its length field has 16 bits."""


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode ``pixels (H,W,3)``, or 4 with alpha, as an uncompressed PNG file."""
    height, width, channels = pixels.shape
    filter_none = np.zeros((height, 1), np.uint8)
    scanlines = np.hstack([filter_none, pixels.reshape(height, width * channels)]).tobytes()
    kind = {3: 2, 4: 6}[channels]
    header = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", _store_zlib(scanlines)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(png_chunk(kind, data) for kind, data in chunks)


def png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _store_zlib(data: bytes) -> bytes:
    """Wrap ``data`` as a zlib stream of stored (uncompressed) blocks."""
    stream = b"\x78\x01"
    for start in range(0, len(data), MAX_STORED_BLOCK):
        block = data[start : start + MAX_STORED_BLOCK]
        is_last = start + MAX_STORED_BLOCK >= len(data)
        stream += struct.pack("<BHH", is_last, len(block), len(block) ^ 0xFFFF) + block
    return stream + struct.pack(">I", zlib.adler32(data))


class Channel(NamedTuple):
    """How a property of a node moves: what one channel of a glTF animation says."""

    node: int
    path: str
    """"translation", "rotation", "scale" or "weights"."""
    times: NDArray[np.float32]
    """(K,) seconds, growing."""
    values: NDArray[Any]
    """A row for each key; three for CUBICSPLINE: tangent in, value, tangent out. Weights (N,). What
    is not float32 is normalised."""
    interpolation: str = "LINEAR"


class GlbFile:
    """A glTF document with one binary buffer; every ``add`` returns the new entry's index."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "RasterJIT models/make_models.py"},
            "scene": 0,
        }

    def add(self, section: str, entry: dict[str, Any]) -> int:
        """Append ``entry`` to a top-level array such as ``nodes`` or ``materials``."""
        entries = self._document.setdefault(section, [])
        entries.append(entry)
        return len(entries) - 1

    def use(self, extension: str) -> None:
        """List an extension as used."""
        used = self._document.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def add_light(self, light: dict[str, Any]) -> int:
        """Append a light of the extension KHR_lights_punctual."""
        self.use("KHR_lights_punctual")
        extensions = self._document.setdefault(
            "extensions", {"KHR_lights_punctual": {"lights": []}}
        )
        lights = extensions["KHR_lights_punctual"]["lights"]
        lights.append(light)
        return len(lights) - 1

    def add_texture(self, png: bytes, name: str, sampler: dict[str, int] | None = None) -> int:
        """Append a PNG file, an image of it, a sampler and a texture that shows it."""
        entry = {"source": self.add_image(png, name)}
        if sampler is not None:
            entry["sampler"] = self.add("samplers", sampler)
        return self.add("textures", entry)

    def add_image(self, png: bytes, name: str) -> int:
        """Append a PNG file to the buffer and an image that points at it."""
        view = self._add_view(png, {})
        return self.add("images", {"name": name, "mimeType": "image/png", "bufferView": view})

    def add_mesh(
        self,
        name: str,
        attributes: dict[str, NDArray[Any]],
        faces: NDArray[np.uint16],
        material: int,
        targets: Sequence[dict[str, NDArray[Any]]] = (),
        **more: Any,
    ) -> int:
        """
        Append a mesh of one indexed primitive.

        Parameters
        ----------
        name : str
        attributes : dict of str to ndarray
            glTF attribute name to ``(V,2..4)`` float32, or uint8 or uint16 (normalised, but for
            joints).
        faces : ndarray (F,3) uint16
        material : int
        targets : sequence of dict, optional
            Morph targets: what each adds to attributes, ``(V,3)`` float32. Those that leave most
            vertices alone are stored as sparse accessors.
        **more
            Further properties of the mesh, such as ``weights``.
        """
        accessors = {
            key: self.add_accessor(
                data,
                target=ARRAY_BUFFER,
                bounds=key == "POSITION",
                normalized=data.dtype.kind == "u" and not key.startswith(JOINTS),
            )
            for key, data in attributes.items()
        }
        primitive = {
            "attributes": accessors,
            "indices": self.add_accessor(faces.reshape(-1), target=ELEMENT_ARRAY_BUFFER),
            "material": material,
        }
        if targets:
            primitive["targets"] = [
                {
                    key: self._add_difference(data, bounds=key == "POSITION")
                    for key, data in one.items()
                }
                for one in targets
            ]
        return self.add("meshes", {"name": name, "primitives": [primitive], **more})

    def add_skin(
        self, name: str, joints: Sequence[int], inverse_binds: NDArray[np.float32], skeleton: int
    ) -> int:
        """Append a skin of nodes; ``inverse_binds (J,4,4)`` as matrices of column vectors."""
        columns = inverse_binds.transpose(0, 2, 1).reshape(len(joints), 16)
        skin = {
            "name": name,
            "joints": list(joints),
            "inverseBindMatrices": self.add_accessor(columns),
            "skeleton": skeleton,
        }
        return self.add("skins", skin)

    def add_animation(self, name: str, channels: Sequence[Channel]) -> int:
        """Append an animation; channels of the same array of times share its accessor."""
        inputs: dict[int, int] = {}
        samplers, targets = [], []
        for channel in channels:
            key = id(channel.times)
            if key not in inputs:
                inputs[key] = self.add_accessor(channel.times, bounds=True)
            output = self.add_accessor(channel.values, normalized=channel.values.dtype.kind != "f")
            sampler = {"input": inputs[key], "interpolation": channel.interpolation}
            samplers.append({**sampler, "output": output})
            target = {"node": channel.node, "path": channel.path}
            targets.append({"sampler": len(samplers) - 1, "target": target})
        entry = {"name": name, "samplers": samplers, "channels": targets}
        return self.add("animations", entry)

    def add_accessor(
        self,
        data: NDArray[Any],
        *,
        target: int | None = None,
        bounds: bool = False,
        normalized: bool = False,
    ) -> int:
        """
        Append an array and an accessor that describes it.

        Parameters
        ----------
        data : ndarray (N,) or (N,2..4) or (N,16)
        target : int, optional
            What its buffer view is for, as glTF numbers it.
        bounds : bool
            Whether the accessor says the least and greatest values.
        normalized : bool
            Whether whole numbers stand for shares of the largest.
        """
        extra = {} if target is None else {"target": target}
        view = self._add_view(np.ascontiguousarray(data).tobytes(), extra)
        accessor = {"bufferView": view, **_described(data, bounds)}
        if normalized:
            accessor["normalized"] = True
        return self.add("accessors", accessor)

    def _add_difference(self, data: NDArray[np.float32], bounds: bool) -> int:
        """Append what a morph target adds, the rows that are not zero alone if they are few."""
        rows = np.flatnonzero((data != 0).any(axis=1)).astype(np.uint16)
        if not len(rows) or len(rows) * (data.strides[0] + rows.itemsize) >= data.nbytes:
            return self.add_accessor(data, target=ARRAY_BUFFER, bounds=bounds)
        sparse = {
            "count": len(rows),
            "indices": {
                "bufferView": self._add_view(rows.tobytes(), {}),
                "componentType": COMPONENT_TYPES[rows.dtype.name],
            },
            "values": {"bufferView": self._add_view(data[rows].tobytes(), {})},
        }
        return self.add("accessors", {**_described(data, bounds), "sparse": sparse})

    def _add_view(self, data: bytes, extra: dict[str, int]) -> int:
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data), **extra}
        self._binary += _padded(data, b"\0")
        return self.add("bufferViews", view)

    def save(self, path: Path) -> None:
        """Write header, JSON chunk and binary chunk, each padded to four bytes."""
        document = {**self._document, "buffers": [{"byteLength": len(self._binary)}]}
        text = _padded(json.dumps(document, separators=(",", ":")).encode("ascii"), b" ")
        body = struct.pack("<II", len(text), JSON_CHUNK) + text
        body += struct.pack("<II", len(self._binary), BINARY_CHUNK) + bytes(self._binary)
        path.write_bytes(struct.pack("<III", GLB_MAGIC, 2, 12 + len(body)) + body)


def _described(data: NDArray[Any], bounds: bool) -> dict[str, Any]:
    """Return what an accessor says of the numbers of an array."""
    columns = data.reshape(len(data), -1)
    said: dict[str, Any] = {
        "componentType": COMPONENT_TYPES[data.dtype.name],
        "count": len(data),
        "type": ELEMENT_TYPES[columns.shape[1]],
    }
    if bounds:
        said["min"] = columns.min(axis=0).tolist()
        said["max"] = columns.max(axis=0).tolist()
    return said


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % 4)
