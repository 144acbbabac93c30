"""
Tell which versions of other packages are supported, as ``pyproject.toml`` asks for them.

Where one is too old, importing this file, and with it the package, ends with a line that says so.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from rasterjit import interrupts


class SupportedRange(NamedTuple):
    """Versions that are supported."""

    name: str
    """As people write it."""
    lowest: str
    limit: str | None = None
    """The first that is not known; None if any newer one will do."""


SUPPORTED = {
    "numpy": SupportedRange("NumPy", "1.26"),
    "numba": SupportedRange("Numba", "0.62", "0.69"),
    "llvmlite": SupportedRange("llvmlite", "0.45", "0.51"),
    "trimesh": SupportedRange("trimesh", "5.0"),
    "pillow": SupportedRange("Pillow", "10.3"),
}
"""By the name of the distribution; a limit where any release may change: Numba and llvmlite."""

METADATA_FOLDER = re.compile(
    rf"({'|'.join(SUPPORTED)})-(\d[^-]*?)(?:-py[\d.]+)?\.(?:dist|egg)-info", re.I
)
"""What installers call the folder that tells a distribution's version."""


def installed(folders: Sequence[str]) -> dict[str, str]:
    """Return versions by distribution, of the first folder that has it; without importing it."""
    found: dict[str, str] = {}
    for folder in folders:
        try:
            names = os.listdir(folder or os.curdir)
        except OSError:
            continue
        here = [match for name in names if (match := METADATA_FOLDER.fullmatch(name))]
        # Where an update left the old one's folder, the newer counts.
        for match in sorted(here, key=lambda match: numbers_of(match[2]), reverse=True):
            found.setdefault(match[1].lower(), match[2])
    return found


def numbers_of(version: str) -> tuple[int, ...]:
    """Return the numbers of a release, such as (1, 26) of 1.26.0rc1, without trailing zeros."""
    release = re.match(r"\d+(?:\.\d+)*", version)
    numbers = [int(part) for part in release[0].split(".")] if release else []
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def explain_too_old(found: Mapping[str, str] | None = None) -> str | None:
    """Return a line that says which package is too old for RasterJIT; None if none is."""
    for distribution, version in (installed(sys.path) if found is None else found).items():
        name, lowest, _ = SUPPORTED[distribution]
        if numbers_of(version) < numbers_of(lowest):
            return (
                f"RasterJIT needs {name} {lowest} or newer, found {version}; "
                f'pip install "{distribution}>={lowest}"'
            )
    return None


def explain_too_new(found: Mapping[str, str] | None = None) -> str | None:
    """Return a line that says which package is newer than what RasterJIT knows; None if none."""
    for distribution, version in (installed(sys.path) if found is None else found).items():
        name, lowest, limit = SUPPORTED[distribution]
        if limit is not None and numbers_of(version) >= numbers_of(limit):
            return (
                f"RasterJIT knows {name} up to {limit} (not included), found {version}; "
                f'pip install "{distribution}>={lowest},<{limit}"'
            )
    return None


interrupts.refuse(explain_too_old())
