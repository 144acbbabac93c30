"""Know the hard cases: check their numbers and say how many were run."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import catalogue
import pytest

HERE = Path(__file__).parent
collected = pytest.StashKey[tuple[set[Path], set[str]]]()
"""The files of this folder that were collected, and the cases that their tests hold."""
held: Counter[str] = Counter()
passed: Counter[str] = Counter()


def pytest_configure(config):
    config.addinivalue_line("markers", "case(*ids): the hard cases that a test holds")


def case_ids(item):
    return [number for mark in item.iter_markers("case") for number in mark.args]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    here = [item for item in items if item.path.parent == HERE]
    config.stash[collected] = {item.path for item in here}, {n for i in here for n in case_ids(i)}
    for item in items:
        ids = case_ids(item)
        unknown = set(ids) - set(catalogue.IDS)
        if unknown:
            raise pytest.UsageError(f"{item.nodeid}: no such hard case: {sorted(unknown)}")
        item.user_properties.append(("hard_cases", ids))


def pytest_runtest_logreport(report):
    ids = dict(report.user_properties).get("hard_cases", ())
    if report.when == "call":
        held.update(ids)
        passed.update(ids if report.passed else ())


def pytest_terminal_summary(terminalreporter):
    if not held:
        return
    failed = sorted(number for number in held if passed[number] < held[number])
    terminalreporter.write_line(
        f"hard cases: {len(held)} of {len(catalogue.IDS)} run, {len(held) - len(failed)} hold, "
        f"in {held.total()} tests" + (f"; broken: {' '.join(failed)}" if failed else "")
    )
