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
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

COMPONENT_TYPES = {"uint8": 5121, "uint16": 5123, "float32": 5126}
ELEMENT_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
LARGEST_STORED_BLOCK = 65535
"""Bytes in a stored deflate block: its length field has 16 bits."""


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode ``pixels (H,W,3)``, or 4 with alpha, as an uncompressed PNG file."""
    height, width, channels = pixels.shape
    filter_none = np.zeros((height, 1), np.uint8)
    scanlines = np.hstack([filter_none, pixels.reshape(height, width * channels)]).tobytes()
    kind = {3: 2, 4: 6}[channels]
    header = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", _store_zlib(scanlines)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(_png_chunk(kind, data) for kind, data in chunks)


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _store_zlib(data: bytes) -> bytes:
    """Wrap ``data`` as a zlib stream of stored (uncompressed) blocks."""
    stream = b"\x78\x01"
    for start in range(0, len(data), LARGEST_STORED_BLOCK):
        block = data[start : start + LARGEST_STORED_BLOCK]
        is_last = start + LARGEST_STORED_BLOCK >= len(data)
        stream += struct.pack("<BHH", is_last, len(block), len(block) ^ 0xFFFF) + block
    return stream + struct.pack(">I", zlib.adler32(data))


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
    ) -> int:
        """
        Append a mesh of one indexed primitive.

        Parameters
        ----------
        name : str
        attributes : dict of str to ndarray
            glTF attribute name to ``(V,2..4)`` float32, or uint8 (normalised, four channels).
        faces : ndarray (F,3) uint16
        material : int
        """
        accessors = {key: self._add_accessor(key, data) for key, data in attributes.items()}
        view = self._add_view(faces.tobytes(), {"target": ELEMENT_ARRAY_BUFFER})
        indices = {
            "bufferView": view,
            "componentType": COMPONENT_TYPES[faces.dtype.name],
            "count": faces.size,
            "type": "SCALAR",
        }
        primitive = {
            "attributes": accessors,
            "indices": self.add("accessors", indices),
            "material": material,
        }
        return self.add("meshes", {"name": name, "primitives": [primitive]})

    def _add_accessor(self, attribute: str, data: NDArray[Any]) -> int:
        view = self._add_view(np.ascontiguousarray(data).tobytes(), {"target": ARRAY_BUFFER})
        accessor: dict[str, Any] = {
            "bufferView": view,
            "componentType": COMPONENT_TYPES[data.dtype.name],
            "count": len(data),
            "type": ELEMENT_TYPES[data.shape[1]],
        }
        if data.dtype == np.uint8:
            accessor["normalized"] = True
        if attribute == "POSITION":
            accessor["min"] = data.min(axis=0).tolist()
            accessor["max"] = data.max(axis=0).tolist()
        return self.add("accessors", accessor)

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


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % 4)
