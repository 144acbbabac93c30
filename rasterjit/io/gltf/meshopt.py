"""
Decode the buffer views that meshoptimizer compresses [1]_, with the library meshopt.

References
----------
.. [1] The Khronos Group, "EXT_meshopt_compression" and "KHR_meshopt_compression".
"""

from __future__ import annotations

from typing import Any

from rasterjit.io.gltf.extensions import library_of
from rasterjit.io.gltf.values import needed, shown, whole_of
from rasterjit.io.skipped import reason_of

MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")


def decode_meshopt(extension: str, packed: dict[str, Any], stored: bytes) -> bytes:
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

    Raises
    ------
    MissingLibraryError
        If meshopt is not installed.
    ValueError
        If the bytes are damaged, or are no ``count`` rows.
    """
    library = library_of(extension)
    mode, one_filter = needed(packed, "mode"), packed.get("filter", "NONE")
    for key, value, known in (("mode", mode, MODES), ("filter", one_filter, FILTERS)):
        if value not in known:
            listed = ", ".join(known)
            raise ValueError(f"{extension}: {key} must be one of {listed}, got {shown(value)}")
    count, size = whole_of(packed, "count"), whole_of(packed, "byteStride")
    if not count:
        return b""
    try:
        rows = library.decode_gltf_buffer(stored, count, size, mode, one_filter)
    except Exception as error:
        raise ValueError(f"{extension}: it cannot be unpacked: {reason_of(error)}") from None
    return rows.tobytes()
