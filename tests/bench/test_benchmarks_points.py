"""The benchmark of points draws small clouds, and leaves out who is not there."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.takes_long

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
points = importlib.import_module("benchmarks.points")


def test_all_who_are_there_cover_the_same_pixels(tmp_path):
    told = tmp_path / "rows.json"
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.points", "--points", "2000", "--rounds", "2",
         "--output", str(told)],
        cwd=ROOT, capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    rows = json.loads(told.read_text())["rows"]
    assert rows[0]["name"] == points.OWN
    assert rows[0]["ratio"] == 1.0
    assert rows[0]["pixels"] > 1500
    missing = {line.split()[0] for line in done.stdout.splitlines() if "left out" in line}
    assert {row["name"] for row in rows} | missing == set(points.NAMES)
    assert {row["check"] for row in rows} == {"alike"}


def test_who_cannot_be_started_is_left_out(capsys):
    assert points.start("nobody", 10, 1, [sys.executable]) is None
    assert "left out" in capsys.readouterr().out
