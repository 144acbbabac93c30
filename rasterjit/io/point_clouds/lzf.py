"""
Unpack LZF [1]_, by which PCD files are compressed.

References
----------
.. [1] M. Lehmann, "LibLZF", 2000-2008: a control byte below 32 stands before so many bytes and one
   more, as they are; another one has the length and, with the byte or two behind it, the distance
   of bytes that were there before.
"""

from __future__ import annotations

_LITERALS = 32
"""Control bytes below stand before bytes as they are."""

_LONG = 7
"""The length that says that a further byte has the rest of it."""


def unpack_lzf(packed: bytes, size: int) -> bytes:
    """
    Return what was packed.

    Parameters
    ----------
    packed : bytes
    size : int
        Bytes of the result.

    Raises
    ------
    ValueError
        If it is damaged, or its result is of another size.
    """
    made, at, end = bytearray(), 0, len(packed)
    try:
        while at < end and len(made) <= size:
            control = packed[at]
            at += 1
            if control < _LITERALS:
                made += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == _LONG:
                length += packed[at]
                at += 1
            distance = ((control & 31) << 8) + packed[at] + 1
            at += 1
            length += 2
            begin = len(made) - distance
            if begin < 0:
                raise ValueError("it refers to bytes before its first")
            if distance >= length:
                made += made[begin : begin + length]
            else:
                # The bytes repeat themselves.
                made += (made[begin:] * (length // distance + 1))[:length]
    except IndexError:
        raise ValueError("it is cut short") from None
    if len(made) != size or at > end:
        raise ValueError(f"it unpacks to {len(made)} bytes in place of {size}")
    return bytes(made)
