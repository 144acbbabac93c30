"""
Decode what glTF files compress: meshes [1]_ with DracoPy, buffer views [3]_ with meshopt, and KTX 2
textures [4]_ of Basis Universal with opengl_basisu.

A stream of Draco says first how many faces and vertices it has. Those are compared with what the
file says in plain before the library sees the stream, so that a damaged one asks for no memory.

References
----------
.. [1] The Khronos Group, "KHR_draco_mesh_compression".
.. [2] Google, "Draco Bitstream Specification", version 2.2, sections ParseHeader, DecodeMetadata,
   DecodeSequentialConnectivityData and DecodeEdgebreakerConnectivityData.
.. [3] The Khronos Group, "EXT_meshopt_compression" and "KHR_meshopt_compression".
.. [4] The Khronos Group, "KHR_texture_basisu" and "KTX File Format Specification", version 2.0.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.extensions import BASIS, DRACO, check_library
from rasterjit.io.gltf.json_checks import get_integer, quote, require
from rasterjit.io.images import take_texel_memory
from rasterjit.io.load_warnings import reason_of
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.texture import check_texels

if TYPE_CHECKING:
    from rasterjit.io.foreign.codecs import Decoder

_DRACO_HEADER = b"DRACO\x02\x02"
"""First bytes of a stream: the format's name and its version, 2.2."""

_MESH, _EDGEBREAKER, _SEQUENTIAL = 1, 1, 0
_HAS_METADATA = 0x8000


class DracoMesh(NamedTuple):
    """The content of a Draco stream."""

    corners: NDArray[np.uint32]
    """Vertex numbers, (3 F,): three for each triangle."""
    attributes: dict[int, NDArray]
    """Rows of every vertex, (V, width), by the attribute's unique number."""


def decode_draco(stream: bytes, max_corners: int, decoder: Decoder) -> DracoMesh:
    """
    Decode a mesh.

    Parameters
    ----------
    stream : bytes
    max_corners : int
        Corners of triangles that it may have.
    decoder : Decoder

    Raises
    ------
    MissingLibraryError
        If DracoPy is not installed.
    ValueError
        If the stream is damaged, holds no mesh, or a larger one.
    """
    check_library(DRACO)
    try:
        faces, vertices = read_draco_counts(stream)
    except IndexError:
        raise ValueError(f"{DRACO}: its stream ends too early") from None
    if max(3 * faces, vertices) > max_corners:
        raise ValueError(
            f"{DRACO}: its stream has {faces} faces and {vertices} vertices, but its accessor of "
            f"indices {max_corners} corners"
        )
    try:
        corners, rows = decoder.decode("draco", stream)
    except Exception as error:
        # The library's own errors share no base.
        raise ValueError(f"{DRACO}: its stream is damaged: {reason_of(error)}") from None
    attributes = dict(rows)
    count = min((len(rows) for rows in attributes.values()), default=0)
    if len(corners) and corners.max() >= count:
        raise ValueError(
            f"{DRACO}: its stream is damaged: its faces must point at its {count} vertices, but "
            f"one points at {corners.max()}"
        )
    return DracoMesh(corners, attributes)


def decode_draco_arrays(
    stream: bytes, _: MemoryBudget
) -> tuple[NDArray[np.uint32], list[tuple[int, NDArray[Any]]]]:
    """Return the vertex numbers of a stream, and its attributes by their unique numbers."""
    import DracoPy

    mesh = DracoPy.decode(stream)
    corners = np.asarray(mesh.faces, np.uint32).reshape(-1)
    return corners, [(int(one["unique_id"]), np.asarray(one["data"])) for one in mesh.attributes]


def read_draco_counts(stream: bytes) -> tuple[int, int]:
    """
    Return how many faces and vertices a stream says that it has.

    Raises
    ------
    IndexError
        If it ends too early.
    ValueError
        If it is no mesh of version 2.2.
    """
    if not stream.startswith(_DRACO_HEADER):
        raise ValueError(f"{DRACO}: it is no Draco stream of version 2.2")
    kind, method, flags = stream[7], stream[8], stream[9] | stream[10] << 8
    if kind != _MESH or method not in (_SEQUENTIAL, _EDGEBREAKER):
        raise ValueError(f"{DRACO}: its stream is of kind {kind}, {method}, which is no mesh")
    reader = _StreamReader(stream, 11)
    if flags & _HAS_METADATA:
        for _ in range(reader.read_varint()):
            reader.read_varint()
            reader.skip_metadata()
        reader.skip_metadata()
    if method == _SEQUENTIAL:
        return reader.read_varint(), reader.read_varint()
    reader.skip(1)
    vertices = reader.read_varint()
    return reader.read_varint(), vertices


class _StreamReader:
    """Reads a Draco stream from a byte on; raises ``IndexError`` at its end."""

    def __init__(self, stream: bytes, offset: int) -> None:
        self._stream = stream
        self._offset = offset

    def skip(self, count: int) -> None:
        """Skip some bytes."""
        self._offset += count
        if self._offset > len(self._stream):
            raise IndexError

    def read_varint(self) -> int:
        """Read a variable-length integer, seven bits a byte, the lowest first."""
        value = 0
        for shift in range(0, 35, 7):
            byte = self._stream[self._offset]
            self._offset += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise ValueError(f"{DRACO}: a number of its stream is too long")

    def _skip_name(self) -> None:
        self.skip(1 + self._stream[self._offset])

    def skip_metadata(self) -> None:
        """Skip metadata: names and values, and nested metadata with their names."""
        waiting, is_below = 1, False
        while waiting:
            if is_below:
                self._skip_name()
            is_below = True
            for _ in range(self.read_varint()):
                self._skip_name()
                self.skip(self.read_varint())
            waiting += self.read_varint() - 1


MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")


def decode_meshopt(
    extension: str, packed: dict[str, Any], stored: bytes, decoder: Decoder
) -> bytes:
    """
    Return the bytes that a buffer view stands for.

    Parameters
    ----------
    extension : str
        Its name, for messages.
    packed : dict
        What it says of the buffer view: ``count``, ``byteStride``, ``mode`` and ``filter``.
    stored : bytes
        The compressed bytes.
    decoder : Decoder

    Raises
    ------
    MissingLibraryError
        If meshopt is not installed.
    ValueError
        If the bytes are damaged, or are no ``count`` rows.
    """
    check_library(extension)
    mode, one_filter = require(packed, "mode"), packed.get("filter", "NONE")
    for key, value, allowed in (("mode", mode, MODES), ("filter", one_filter, FILTERS)):
        if value not in allowed:
            listed = ", ".join(allowed)
            raise ValueError(f"{extension}: {key} must be one of {listed}, got {quote(value)}")
    count, size = get_integer(packed, "count"), get_integer(packed, "byteStride")
    if not count:
        return b""
    try:
        rows: bytes = decoder.decode("meshopt", stored, count, size, mode, one_filter)
    except Exception as error:
        raise ValueError(f"{extension}: it cannot be unpacked: {reason_of(error)}") from None
    return rows


def decode_meshopt_rows(
    stored: bytes, count: int, size: int, mode: str, one_filter: str, _: MemoryBudget
) -> bytes:
    """Return ``count`` rows of ``size`` bytes, unpacked by meshopt."""
    import meshopt

    rows: bytes = meshopt.decode_gltf_buffer(stored, count, size, mode, one_filter).tobytes()
    return rows


KTX2_SIGNATURE = b"\xabKTX 20\xbb\r\n\x1a\n"

_EXTENT_OFFSET = 20
"""Offset of the width and the height in the header."""

_LEVEL_SIZE_OFFSET = 96
"""Offset of the uncompressed size of the largest level in the level index."""

_BLOCK_SIDE, _MAX_BLOCK_BYTES = 4, 16
"""Side of a block in texels, and most bytes of an uncompressed block."""


def decode_ktx2(content: bytes, what: str, budget: MemoryBudget, decoder: Decoder) -> NDArray[Any]:
    """
    Decode the largest level of a KTX 2 file.

    Parameters
    ----------
    content : bytes
        Begins with ``KTX2_SIGNATURE``.
    what : str
        What a message calls it.
    budget : MemoryBudget
        Counts what its texels take.
    decoder : Decoder

    Returns
    -------
    (H, W, 3) uint8, or (H, W, 4) with alpha

    Raises
    ------
    MissingLibraryError
        If opengl_basisu is not installed.
    ValueError
        If it is damaged, holds something else than a Basis Universal picture, or is larger than
        the budget or `Texture` allows.
    """
    check_library(BASIS)
    if len(content) < _EXTENT_OFFSET + 8:
        raise ValueError("it ends too early")
    size = struct.unpack_from("<II", content, _EXTENT_OFFSET)
    check_texels("it", *size)
    take_texel_memory(size, what, budget)
    try:
        pixels: NDArray[Any] = decoder.decode("ktx2", content)
    except Exception as error:
        raise ValueError(f"{BASIS}: {reason_of(error)}") from None
    return pixels


def transcode_ktx2(content: bytes, _: MemoryBudget) -> NDArray[Any]:
    """Return the pixels of a KTX 2 file, transcoded by opengl_basisu."""
    import opengl_basisu

    file = opengl_basisu.open(content)
    if file.faces != 1 or file.is_array or file.is_video:
        raise ValueError("it is no single picture")
    _check_level_size(content)
    pixels = file.transcode("rgba8").data
    return np.ascontiguousarray(pixels if file.has_alpha else pixels[:, :, :3])


def _check_level_size(content: bytes) -> None:
    """Raise ``ValueError`` if the declared size of the largest level exceeds that of its blocks."""
    width, height = struct.unpack_from("<II", content, _EXTENT_OFFSET)
    (declared,) = struct.unpack_from("<Q", content, _LEVEL_SIZE_OFFSET)
    max_bytes = -(-width // _BLOCK_SIDE) * -(-height // _BLOCK_SIDE) * _MAX_BLOCK_BYTES
    if declared > max_bytes:
        raise ValueError(
            f"its largest level of {width}×{height} texels must have at most {max_bytes} bytes "
            f"unpacked, but says {declared}"
        )
