"""Every hard case of the catalogue has a test."""

from __future__ import annotations

from pathlib import Path

import catalogue
import conftest
import pytest


def test_every_case_is_held_by_a_test(request):
    files, marked = request.config.stash[conftest.collected]
    if files != set(Path(__file__).parent.glob("test_*.py")):
        pytest.skip("counts the tests of all files of this folder, and some were not asked for")
    assert marked == set(catalogue.IDS)
