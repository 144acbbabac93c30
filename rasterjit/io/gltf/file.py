"""
Read glTF 2.0 files, ``.gltf`` and ``.glb``: JSON, accessors, buffers and images.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.6 and 4.4.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.compression import decode_meshopt
from rasterjit.io.gltf.extensions import MESHOPT
from rasterjit.io.gltf.json_checks import (
    MAX_VALUE_LENGTH,
    get_integer,
    get_list,
    get_object,
    quote,
    require,
)
from rasterjit.io.load_warnings import LeftOut
from rasterjit.io.resources import RefusedFileError, Resources

GLB_MAGIC = b"glTF"
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_GLB_HEADER_BYTES = 20
"""Bytes before the JSON of a ``.glb``: its header, and length and type of the first chunk."""

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""NumPy types of components, by their OpenGL numbers."""

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
"""Components of an element of an accessor."""

ENTRY_NAMES = {
    "accessors": "accessor", "buffers": "buffer", "bufferViews": "buffer view",
    "cameras": "camera", "images": "image", "materials": "material", "meshes": "mesh",
    "nodes": "node", "samplers": "sampler", "skins": "skin", "textures": "texture",
}  # fmt: skip
"""Names of the entries of a list of the document, for messages."""

_MEMORY_PER_JSON_BYTE = 24
"""Bytes of memory for a byte of JSON as Python objects: ``[],`` takes 64."""

_MEMORY_PER_COMPONENT = 24
"""Bytes of memory for a component of an accessor: as it is read, as float64, and in the mesh."""

_MEMORY_PER_SPARSE_ROW = 16
"""Further bytes of memory for a row of a sparse accessor: its index as int64, and its check."""

MAX_IMPLICIT_ROWS = 1 << 26
"""Most rows of an accessor without a buffer view, which limits the memory of a damaged count."""


class GltfFile:
    """
    A glTF file.

    Parameters
    ----------
    path : Path
    resources : Resources
        The files that it may name.

    Attributes
    ----------
    document : dict
        The file's JSON.
    budget : MemoryBudget
        Counts the memory of what is read.
    decoder : Decoder
    required : frozenset of str
        Extensions that the file requires.

    Raises
    ------
    ValueError
        If it ends too early, or holds no JSON object, or one of glTF 1.0.
    """

    def __init__(self, path: Path, resources: Resources) -> None:
        self._resources = resources
        self.budget, self.decoder = resources.budget, resources.decoder
        self._buffers: dict[int, bytes] = {}
        self._unpacked_views: dict[int, bytes] = {}
        """Decompressed buffer views, by their numbers."""
        self._overrides: Mapping[int, NDArray[Any]] = {}
        content = resources.read_mesh_file(path)
        text, self._chunk = _split_chunks(content)
        self.budget.take("its JSON", len(text) * _MEMORY_PER_JSON_BYTE)
        try:
            self.document: dict[str, Any] = json.loads(text)
        except ValueError as error:
            if path.suffix.lower() == ".glb" and not content.startswith(GLB_MAGIC):
                begin = content[: len(GLB_MAGIC)]
                raise ValueError(
                    f"it is no GLB, which begins with {GLB_MAGIC!r}, got {begin!r}"
                ) from None
            raise ValueError(f"its JSON is damaged or ends too early: {error}") from None
        if not isinstance(self.document, dict):
            raise ValueError("the JSON is not an object")
        asset = get_object(self.document, "asset")
        version = str(asset.get("version", "2.0"))
        if version.split(".")[0] != "2":
            raise ValueError(f"it is of glTF {version[:MAX_VALUE_LENGTH]}, not 2.0")
        min_version = str(asset.get("minVersion", "2.0"))
        if min_version != "2.0":
            raise ValueError(f"it needs a reader of glTF {min_version[:MAX_VALUE_LENGTH]}, not 2.0")
        self.required = frozenset(map(str, get_list(self.document, "extensionsRequired")))

    def get_entry(self, section: str, number: Any) -> dict[str, Any]:
        """
        Return an entry of a list of the document.

        Raises
        ------
        LookupError
            If there is none of this number.
        ValueError
            If it is no object, or the list no list.
        """
        entries = get_list(self.document, section)
        kind = ENTRY_NAMES.get(section, section)
        if type(number) is not int or not 0 <= number < len(entries):
            raise LookupError(f"the file has no {kind} {quote(number)} (it has {len(entries)})")
        if not isinstance(entries[number], dict):
            raise ValueError(f"{kind} {number} must be an object, got {quote(entries[number])}")
        return entries[number]

    def read_array(self, number: Any) -> NDArray[Any]:
        """
        Return the rows of an accessor, (count, width); normalized whole numbers as float64.

        Raises
        ------
        ValueError, TypeError, LookupError, OSError
            If the accessor is incomplete or points beyond the file.
        """
        accessor = self.get_entry("accessors", number)
        try:
            return self._read_accessor(number, accessor)
        except RefusedFileError:
            raise
        except (ValueError, LookupError) as error:
            raise ValueError(f"accessor {number}: {error}") from error

    def _read_accessor(self, number: int, accessor: dict[str, Any]) -> NDArray[Any]:
        """Return the rows of an accessor, or raise ``ValueError`` without its number."""
        dtype = _get_component_type(accessor)
        width = WIDTHS[_get_enum(accessor, "type", tuple(WIDTHS))]
        if number in self._overrides:
            return _convert_rows(accessor, self._overrides[number], dtype, width)
        count = get_integer(accessor, "count")
        memory = f"accessor {number}", count * width * _MEMORY_PER_COMPONENT
        if "bufferView" in accessor:
            # Without a copy; raises if the buffer does not hold so many rows.
            rows = self._view_rows(accessor, count, width, dtype)
            self.budget.take(*memory)
        elif count <= MAX_IMPLICIT_ROWS:
            self.budget.take(*memory)
            rows = np.zeros((count, width), dtype)
        else:
            raise ValueError(f"it has {count} rows and no bytes")
        if "sparse" in accessor:
            sparse = get_object(accessor, "sparse")
            changes = get_integer(sparse, "count")
            if changes > count:
                raise ValueError(f"sparse: count must be at most {count}, got {changes}")
            self.budget.take(f"sparse accessor {number}", changes * _MEMORY_PER_SPARSE_ROW)
            rows = self._apply_sparse(rows, sparse, changes, dtype)
        return _convert_rows(accessor, rows, dtype, width)

    def read_vertex_rows(
        self, number: Any, count: int, widths: tuple[int, ...], label: str, left_out: LeftOut
    ) -> NDArray[np.float64] | None:
        """Return an accessor's rows as float64; None, with a note, if vertices cannot use them."""
        with np.errstate(invalid="ignore"):
            # A signalling NaN.
            values = self.read_array(number).astype(np.float64)
        if len(values) != count or values.shape[1] not in widths:
            left_out.note(f"{label}, which does not fit the vertices")
            return None
        if not np.isfinite(values).all():
            left_out.note(f"{label}, which has NaN or infinity")
            return None
        return values

    @contextmanager
    def override_accessors(self, overrides: Mapping[int, NDArray[Any]]) -> Iterator[None]:
        """Let arrays, (count, width), replace accessors, by their numbers, in a ``with`` block."""
        self._overrides = overrides
        try:
            yield
        finally:
            self._overrides = {}

    def is_overridden(self, number: Any) -> bool:
        """Tell whether an array replaces an accessor: its codec may have rounded it."""
        return number in self._overrides

    def _apply_sparse(
        self, rows: NDArray[Any], sparse: dict[str, Any], count: int, dtype: np.dtype
    ) -> NDArray[Any]:
        """Return rows with the ``count`` replacements of a sparse accessor."""
        indices = get_object(sparse, "indices")
        row_numbers = self._view_rows(indices, count, 1, _get_component_type(indices))[:, 0]
        wrong = row_numbers[~((row_numbers >= 0) & (row_numbers < len(rows)))]
        if len(wrong):
            raise ValueError(f"sparse indices must be below {len(rows)}, got {wrong[0]}")
        result = rows.copy()
        values = self._view_rows(get_object(sparse, "values"), count, rows.shape[1], dtype)
        result[row_numbers.astype(np.int64)] = values
        return result

    def _view_rows(
        self, entry: dict[str, Any], count: int, width: int, dtype: np.dtype
    ) -> NDArray[Any]:
        """Return rows of a buffer view, or raise ``ValueError`` if it does not hold them."""
        number = require(entry, "bufferView")
        view = self.get_entry("bufferViews", number)
        stride, offset = get_integer(view, "byteStride", 0), get_integer(entry, "byteOffset", 0)
        stride = stride or width * dtype.itemsize
        content = self._get_view(number)
        end = offset + (count - 1) * stride + width * dtype.itemsize if count else offset
        if end > len(content):
            raise ValueError(
                f"{count} rows, the first at byte {offset}, {stride} bytes each, must end within "
                f"the {len(content)} bytes of buffer view {number}, but end at {end}"
            )
        return np.ndarray((count, width), dtype, content, offset, (stride, dtype.itemsize))

    def read_view(self, number: Any) -> bytes:
        """
        Return the bytes of a buffer view, decompressed if needed.

        Where the file has uncompressed bytes as well and does not require the extension, it returns
        those.

        Raises
        ------
        ValueError, LookupError, OSError
            If they are damaged, or not there.
        """
        return bytes(self._get_view(number))

    def _get_view(self, number: Any) -> bytes | memoryview:
        """Return the bytes of a buffer view, decompressed where needed, else without a copy."""
        view = self.get_entry("bufferViews", number)
        extensions = get_object(view, "extensions")
        name = next((name for name in MESHOPT if name in extensions), None)
        if name is None or (name not in self.required and self._has_bytes(require(view, "buffer"))):
            return self._get_stored_bytes(view)
        if number not in self._unpacked_views:
            packed = get_object(extensions, name)
            count, size = get_integer(packed, "count"), get_integer(packed, "byteStride")
            max_size = get_integer(view, "byteLength")
            if count * size > max_size:
                raise ValueError(
                    f"{name}: {count} rows of {size} bytes must be no more than the {max_size} "
                    f"bytes of buffer view {number}"
                )
            self.budget.take(f"buffer view {number}", count * size)
            stored = bytes(self._get_stored_bytes(packed))
            self._unpacked_views[number] = decode_meshopt(name, packed, stored, self.decoder)
        return self._unpacked_views[number]

    def _get_stored_bytes(self, view: dict[str, Any]) -> memoryview:
        """Return the bytes of a buffer that an entry refers to, without a copy."""
        start, length = get_integer(view, "byteOffset", 0), get_integer(view, "byteLength")
        number = require(view, "buffer")
        content = memoryview(self._get_buffer(number))[start : start + length]
        if len(content) < length:
            raise ValueError(f"buffer {number} is cut short")
        return content

    def _has_bytes(self, number: Any) -> bool:
        """Tell whether a buffer has a URI or is the binary chunk."""
        buffer = self.get_entry("buffers", number)
        return "uri" in buffer or (number == 0 and self._chunk is not None)

    def _get_buffer(self, number: Any) -> bytes:
        """Return the bytes of a buffer, read on first use."""
        buffer = self.get_entry("buffers", number)
        if number not in self._buffers:
            if "uri" in buffer:
                self._buffers[number] = self._read_uri(buffer["uri"])
            elif number == 0 and self._chunk is not None:
                self._buffers[number] = self._chunk
            else:
                raise ValueError(f"buffer {number} has no bytes")
        return self._buffers[number]

    def read_image(self, number: Any) -> bytes:
        """
        Return the content of an image file.

        Raises
        ------
        ValueError, TypeError, LookupError, OSError
            If the image is missing, or may not be opened.
        """
        image = self.get_entry("images", number)
        if "bufferView" in image:
            return self.read_view(image["bufferView"])
        return self._read_uri(image["uri"])

    def describe_image(self, number: Any) -> str:
        """Return an image's number with its name or file, for messages."""
        image = self.get_entry("images", number)
        uri = image.get("uri")
        file = uri if isinstance(uri, str) and not uri.startswith("data:") else None
        name = file or image.get("name")
        return f"image {number}" + (f", {str(name)[:80]!r}" if name else "")

    def _read_uri(self, uri: Any) -> bytes:
        """Return the content of a data URI, or of a file beside this one."""
        if not isinstance(uri, str):
            raise ValueError(f"uri must be text, got {quote(uri)}")
        if uri.startswith("data:"):
            kind, _, content = uri.partition(",")
            self.budget.take("a data URI", len(content))
            if kind.endswith(";base64"):
                return base64.b64decode(content)
            return unquote_to_bytes(content)
        return self._resources.read(unquote_to_bytes(uri).decode("utf-8"))


def _split_chunks(content: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON of a file and its binary chunk, if it has one."""
    if content[:4] != GLB_MAGIC:
        return content, None
    if len(content) < _GLB_HEADER_BYTES:
        raise ValueError(f"it ends too early, after {len(content)} bytes")
    _, version, file_size, length, kind = struct.unpack_from("<4sIIII", content)
    if version != 2:
        raise ValueError(f"it is of glTF {version}, not 2.0")
    if kind != JSON_CHUNK:
        raise ValueError("the first chunk is not JSON")
    end = _GLB_HEADER_BYTES + length
    if len(content) < end:
        raise ValueError(
            f"it ends too early, in its JSON: it has {len(content)} of {max(file_size, end)} bytes"
        )
    if len(content) < end + 8:
        return content[_GLB_HEADER_BYTES:end], None
    length, kind = struct.unpack_from("<II", content, end)
    binary = content[end + 8 : end + 8 + length] if kind == BINARY_CHUNK else None
    return content[_GLB_HEADER_BYTES:end], binary


def _get_component_type(accessor: dict[str, Any]) -> np.dtype:
    """Return the component type of an accessor, or raise ``ValueError``."""
    return np.dtype(COMPONENTS[_get_enum(accessor, "componentType", tuple(COMPONENTS))])


def _convert_rows(
    accessor: dict[str, Any], rows: NDArray[Any], dtype: np.dtype, width: int
) -> NDArray[Any]:
    """Return rows in an accessor's component type; normalized integers as float64."""
    if rows.dtype != dtype or rows.shape[1] != width:
        rows = _cast_rows(rows, dtype, width)
    if accessor.get("normalized") and dtype.kind in "ui":
        return np.maximum(rows / float(np.iinfo(dtype).max), -1.0)
    return rows


def _cast_rows(rows: NDArray[Any], dtype: np.dtype, width: int) -> NDArray[Any]:
    """Convert decoded rows to an accessor's component type, or raise ``ValueError``."""
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"type must have {width} numbers, got {rows.shape[1:]} in its stream")
    if rows.size and dtype.kind in "ui" and rows.dtype.kind in "ui":
        info = np.iinfo(dtype)
        wrong = [int(one) for one in (rows.min(), rows.max()) if not info.min <= one <= info.max]
        if wrong:
            raise ValueError(f"componentType must hold {wrong[0]}, which is in its stream")
    with np.errstate(invalid="ignore"):
        return rows.astype(dtype)


def _get_enum(values: dict[str, Any], key: str, allowed: tuple[Any, ...]) -> Any:
    """Return a value that is one of the allowed ones, or raise ``ValueError``."""
    value = require(values, key)
    if not isinstance(value, (int, str)) or isinstance(value, bool) or value not in allowed:
        listed = ", ".join(map(str, allowed))
        raise ValueError(f"{key} must be one of {listed}, got {quote(value)}")
    return value
