"""Tests may run in any order: each order is that of a seed, and compiling comes first in all."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ASKED = [f"tests/house/test_{name}.py" for name in ("versions", "requirements", "cpu_independence")]


def collected(*options):
    """Return the names of tests in the order in which they would run."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--collect-only", *options,
         *ASKED],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return [line for line in done.stdout.splitlines() if "::" in line]


def test_orders_differ_and_what_compiles_for_others_is_first():
    pytest.importorskip("random_order")
    written, *shuffled = (
        collected(*options)
        for options in ([], ["--random-order-seed=1"], ["--random-order-seed=2"])
    )
    for order in shuffled:
        assert order != written
        assert sorted(order) == sorted(written)
        assert {name.partition("::")[2] for name in order[:2]} == {
            "test_no_kernel_fuses_or_calls_a_math_library",
            "test_kernels_are_compiled_for_the_cpu_that_was_asked_for",
        }
    assert shuffled[0] != shuffled[1]
