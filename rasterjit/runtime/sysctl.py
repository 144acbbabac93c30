"""Ask macOS about the machine: its ``sysctlbyname``."""

from __future__ import annotations

import ctypes
import sys


def read_sysctl(name: str) -> bytes | None:
    """
    Return what macOS says of a name, such as ``hw.perflevel0.logicalcpu``.

    None on other systems, and where the name is unknown.
    """
    if sys.platform != "darwin":
        return None
    answer = ctypes.create_string_buffer(64)
    size = ctypes.c_size_t(len(answer))
    failed = ctypes.CDLL(None).sysctlbyname(name.encode(), answer, ctypes.byref(size), None, 0)
    return None if failed else answer.raw[: size.value]
