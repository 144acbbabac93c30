"""Fresh processes that use the small kernels."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent

USE = """
import json, sys
sys.path.insert(0, sys.argv[1])
import numpy as np
import small_kernels
from rasterjit.runtime import store

{before}
row, out = np.arange(-3.0, 5.0), np.zeros(8)
line = small_kernels.Line(2.0, 1.0)
CALLS = dict(
    draw_line=lambda: small_kernels.draw_line(line, row, out),
    add_lines=lambda: small_kernels.add_lines(line, row, out),
    sum_image=lambda: small_kernels.sum_image(np.ones((3, 4)), out),
    has_index=lambda: small_kernels.has_index(row, 5),
)
found = [(CALLS[name](), out.tolist()) for name in {names!r}]
compiled = [name.rpartition(".")[2] for name in store.USED_KERNELS.compiled]
print(json.dumps([found, compiled, "numba" in sys.modules]))
"""
"""Calls kernels; prints their results, the kernels it compiled, and whether it imported Numba."""

RESULTS = {
    "draw_line": [None, [-5.0, -3.0, -1.0, 1.0, 3.0, 5.0, 7.0, 9.0]],
    "add_lines": [5, [-8.0, -5.0, -2.0, 1.0, 4.0, 7.0, 10.0, 13.0]],
    "has_index": [True, [0.0] * 8],
}
"""What each gives, called first."""


def start(place, names=("has_index",), before="", **environment):
    """Start a process that calls kernels, with a store."""
    code = USE.format(names=tuple(names), before=before)
    return subprocess.Popen(
        [sys.executable, "-c", code, str(HERE)], text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "RASTERJIT_CACHE_DIR": str(place), **environment},
    )  # fmt: skip


def use(place, names=("has_index",), before="", **environment):
    """Call kernels in a fresh process; return results, what it compiled, if Numba, its warnings."""
    process = start(place, names, before, **environment)
    out, said = process.communicate()
    assert process.returncode == 0, said
    return (*json.loads(out), said)


def entries(place):
    """Return the entries of a store by the names of their kernels."""
    return {path.name.rpartition("_")[0]: path for path in Path(place).glob("*.kernel")}
