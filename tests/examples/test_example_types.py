"""mypy passes the examples."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.takes_long,
    *(
        pytest.mark.skipif(
            importlib.util.find_spec(name) is None, reason=f"{name} is not installed"
        )
        for name in ("mypy", "gymnasium")
    ),
]


def test_mypy_passes_every_example(tmp_path):
    programs = sorted(path.name for path in (ROOT / "docs/examples").glob("*.py"))
    assert len(programs) > 7
    done = subprocess.run(
        [
            sys.executable, "-m", "mypy", "--check-untyped-defs", "--follow-imports=silent",
            "--config-file=", "--disable-error-code=import-untyped", "--cache-dir", tmp_path,
            *programs,
        ],
        cwd=ROOT / "docs/examples", capture_output=True, text=True,
        env=os.environ | {"MYPYPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
