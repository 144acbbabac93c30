"""Versions of other packages that are not supported are told in one line."""

from __future__ import annotations

import importlib.metadata
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rasterjit.runtime import isolated_numba, versions

ROOT = Path(__file__).parents[2]


def test_the_project_asks_for_what_is_supported():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    asked = re.search(r"^dependencies = \[(.*?)^\]", text, re.M | re.S)[1]
    for name, (_, lowest, limit) in versions.SUPPORTED.items():
        wanted = f"{name}>={lowest}" + (f",<{limit}" if limit else "")
        assert f'"{wanted}"' in asked
    assert asked.count("<") == sum(one.limit is not None for one in versions.SUPPORTED.values())


def test_what_is_installed_is_found_without_importing_it():
    found = versions.installed(sys.path)
    assert found == {name: importlib.metadata.version(name) for name in versions.SUPPORTED}


@pytest.mark.parametrize(
    ("version", "old", "new"),
    [
        ("0.61.2", True, False), ("0.62", False, False), ("0.62.0rc1", False, False),
        ("0.68.9", False, False), ("0.69.0", False, True), ("0.69.0dev0+1", False, True),
        ("1.0", False, True),
    ],
)  # fmt: skip
def test_bounds(version, old, new):
    found = {"numba": version, "numpy": "99.0"}
    assert bool(versions.explain_too_old(found)) == old
    assert bool(versions.explain_too_new(found)) == new


@pytest.mark.parametrize(
    ("folder", "expected"),
    [
        ("numpy-1.24.2.dist-info", {"numpy": "1.24.2"}),
        ("Pillow-9.4.0.egg-info", {"pillow": "9.4.0"}),
        ("numba-0.60.0-py3.11.egg-info", {"numba": "0.60.0"}),
        ("numpy-stubs-1.0.dist-info", {}),
    ],
)
def test_names_of_installers(tmp_path, folder, expected):
    (tmp_path / folder).mkdir()
    assert versions.installed([str(tmp_path / "missing"), str(tmp_path)]) == expected


def run(folder, *words):
    search = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": search},
    )  # fmt: skip


def test_an_old_package_is_told_in_one_line(tmp_path):
    (tmp_path / "trimesh-4.9.0.dist-info").mkdir()
    line = 'RasterJIT needs trimesh 5.0 or newer, found 4.9.0; pip install "trimesh>=5.0"'
    done = run(tmp_path, "-m", "rasterjit", "--help")
    assert (done.returncode, done.stderr) == (1, f"error: {line}\n")
    done = run(tmp_path, "-c", "import rasterjit")
    assert done.stderr.endswith(f"ImportError: {line}\n")


def test_a_compiler_that_is_too_new_is_warned_of(monkeypatch):
    monkeypatch.delitem(sys.modules, isolated_numba.COMPILER, raising=False)
    monkeypatch.setattr(isolated_numba, "explain_too_new", lambda: "RasterJIT knows Numba up to")
    monkeypatch.setattr(isolated_numba.importlib, "import_module", lambda name: name)
    with pytest.warns(RuntimeWarning, match="RasterJIT knows Numba up to"):
        assert isolated_numba.compiler() == isolated_numba.COMPILER
