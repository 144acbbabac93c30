"""The files of the package that kernels are written in, and the names that tests have for them."""

from __future__ import annotations

import re
from pathlib import Path

import rasterjit as rj

PACKAGE = Path(rj.__file__).parent

DECORATED = re.compile(r"^@(kernel|raw_kernel|stage|helper|disjoint_helper)$", re.MULTILINE)


def kernel_files():
    """Return the paths of all files that hold kernels or their helpers, sorted."""
    return [path for path in sorted(PACKAGE.rglob("*.py")) if DECORATED.search(path.read_text())]


def kernel_modules():
    """Return the names of those modules."""
    return [
        ".".join(("rasterjit", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in kernel_files()
    ]
