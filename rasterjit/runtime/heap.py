"""Return freed memory that the C library still holds to the system."""

from __future__ import annotations

import ctypes
import sys


def give_back_memory() -> None:
    """
    Give memory that was freed back to the system, where the C library can be asked to: glibc.

    By itself it keeps for each thread what threads have freed. It takes some ten milliseconds.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(ctypes.c_size_t(0))
