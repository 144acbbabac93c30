"""Every hard case of the catalogue has a test."""

from __future__ import annotations

import re
from pathlib import Path

import catalogue

MARK = re.compile(r"pytest\.mark\.case\(([^)]*)\)")


def test_every_case_is_held_by_a_test():
    sources = "".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    marked = {number for ids in MARK.findall(sources) for number in re.findall(r"\w+", ids)}
    assert marked == set(catalogue.IDS)
