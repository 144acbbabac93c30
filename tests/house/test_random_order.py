"""Tests may run in any order: each order is that of a seed, and compiling comes first in all."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]

SOME = """
import pytest

@pytest.mark.parametrize("number", range(20))
def test_draws(number):
    pass

@pytest.mark.compiles_first
@pytest.mark.parametrize("number", range(5))
def test_compiles(number):
    pass
"""

COLLECT = """
import json, sys
import pytest

class Order:
    def pytest_collection_finish(self, session):
        print("order", json.dumps([item.name for item in session.items]))

for options in ([], ["--random-order-seed=1"], ["--random-order-seed=2"]):
    shuffling = ["-p", "random_order.plugin", *options]
    pytest.main(["--collect-only", "-q", *shuffling, sys.argv[1]], plugins=[Order()])
"""


def test_orders_differ_and_what_compiles_for_others_is_first(tmp_path):
    pytest.importorskip("random_order")
    shutil.copy(TESTS / "conftest.py", tmp_path)
    (tmp_path / "test_some.py").write_text(SOME)
    done = subprocess.run(
        [sys.executable, "-c", COLLECT, str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, check=True,
        # The other plug-ins of these tests take longer to start than all that is tested here.
        env={
            **os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path]),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        },
    )  # fmt: skip
    lines = [line for line in done.stdout.splitlines() if line.startswith("order ")]
    written, *shuffled = (json.loads(line.removeprefix("order ")) for line in lines)
    assert len(written) == 25
    for order in shuffled:
        assert order != written
        assert sorted(order) == sorted(written)
    for order in (written, *shuffled):
        assert all(name.startswith("test_compiles") for name in order[:5])
    assert len(shuffled) == 2
    assert shuffled[0] != shuffled[1]
