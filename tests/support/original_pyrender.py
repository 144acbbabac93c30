"""Ask pyrender itself, in an environment of its own, what it says; and what it said before."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "compat"

ORIGINAL = os.environ.get("PYRENDER_PYTHON")
"""The Python of an environment that has pyrender."""

needs_original = pytest.mark.skipif(
    not ORIGINAL, reason="PYRENDER_PYTHON names no Python that has pyrender"
)


def said_of(python, package, script):
    """Return what a script of this folder says of a package in the environment of a Python."""
    environment = dict(os.environ)
    if package == "pyrender":
        # What is on the path of these tests is not for the other environment.
        environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        [python, str(FOLDER / script), package],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def recording_of(script):
    """Return what a script said of pyrender 0.1.45 when that was recorded."""
    return json.loads((FOLDER / script).with_suffix(".json").read_text())
