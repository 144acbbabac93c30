"""The examples of docstrings run, and print what stands there."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj

FOLDER = Path(rj.__file__).parent
TAKES_LONG = {"rasterjit.accuracy"}
"""Examples that measure for half a minute."""


def modules_with_examples():
    """Return the names of modules whose docstrings have examples."""
    found = []
    for path in sorted(FOLDER.rglob("*.py")):
        if ">>> " in path.read_text(encoding="utf-8"):
            place = path.relative_to(FOLDER.parent).with_suffix("")
            name = ".".join(place.parts).removesuffix(".__init__")
            marks = [pytest.mark.takes_long] if name in TAKES_LONG else []
            found.append(pytest.param(name, marks=marks))
    return found


@pytest.mark.parametrize("name", modules_with_examples())
def test_examples_of_a_module_run(name, tmp_path, monkeypatch):
    (tmp_path / "models").symlink_to(FOLDER.parent / "models")
    monkeypatch.chdir(tmp_path)
    found = doctest.testmod(
        importlib.import_module(name), extraglobs={"rj": rj, "np": np},
        optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE,
    )  # fmt: skip
    assert found.attempted > 0
    assert found.failed == 0


def test_most_of_the_house_has_examples():
    assert len(modules_with_examples()) > 20
