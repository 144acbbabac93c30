"""
Decode the buffer views that meshoptimizer compresses [1]_, with the library meshopt.

References
----------
.. [1] The Khronos Group, "EXT_meshopt_compression" and "KHR_meshopt_compression".
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rasterjit.io.gltf.extensions import check_library
from rasterjit.io.gltf.values import needed, shown, whole_of
from rasterjit.io.skipped import reason_of
from rasterjit.scene.memory import MemoryBudget

if TYPE_CHECKING:
    from rasterjit.io.foreign.codecs import Decoder

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
    mode, one_filter = needed(packed, "mode"), packed.get("filter", "NONE")
    for key, value, known in (("mode", mode, MODES), ("filter", one_filter, FILTERS)):
        if value not in known:
            listed = ", ".join(known)
            raise ValueError(f"{extension}: {key} must be one of {listed}, got {shown(value)}")
    count, size = whole_of(packed, "count"), whole_of(packed, "byteStride")
    if not count:
        return b""
    try:
        rows: bytes = decoder.decode("meshopt", stored, count, size, mode, one_filter)
    except Exception as error:
        raise ValueError(f"{extension}: it cannot be unpacked: {reason_of(error)}") from None
    return rows


def unpacked_rows(
    stored: bytes, count: int, size: int, mode: str, one_filter: str, _: MemoryBudget
) -> bytes:
    """Return ``count`` rows of ``size`` bytes, as meshopt unpacks them."""
    import meshopt

    rows: bytes = meshopt.decode_gltf_buffer(stored, count, size, mode, one_filter).tobytes()
    return rows
