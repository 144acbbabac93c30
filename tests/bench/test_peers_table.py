"""``python -m benchmarks.peers_table``: what a check finds, and what the table makes of it."""

from __future__ import annotations

import importlib
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
command = importlib.import_module("benchmarks.peers_table.__main__")
shapes = importlib.import_module("benchmarks.peers_table.shapes")

PROGRAMS = ROOT / "benchmarks" / "peers_table"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    command.make_files(folder)
    return folder


@pytest.mark.parametrize("peer", command.PEERS)
def test_every_peer_has_a_check_for_each_row(peer):
    text = (PROGRAMS / f"{peer}_.py").read_text(encoding="utf-8")
    defined = set(re.findall(r"^def (\w+)\(", text, re.MULTILINE))
    derived = {"headless", "alone", "threads", "gpu", "first", "megabytes"}
    assert set(command.ROWS) - derived <= defined
    assert "picture" in defined
    assert "DISTRIBUTIONS = " in text


@pytest.mark.parametrize(
    "row", ["face_id", "masks", "normals", "motion", "lens", "shadows", "transparency", "animation"]
)
def test_rasterjit_has_what_the_table_says(files, row, monkeypatch):
    monkeypatch.syspath_prepend(PROGRAMS)
    assert getattr(importlib.import_module("benchmarks.peers_table.rasterjit_"), row)(files) is True


def test_a_picture_comes_with_its_hash_and_the_libraries_that_drew_it(files):
    found = command.ask(sys.executable, "rasterjit", "picture", files)
    assert len(found["value"]["hash"]) == 64
    assert found["value"]["libraries"] == []
    assert found["seconds"] > 0.0


def test_depth_of_the_wall_is_that_of_float32(files):
    assert command.ask(sys.executable, "rasterjit", "depth", files)["value"] < 1e-7


def test_what_fails_is_told_with_its_reason(files):
    assert "AttributeError" in command.ask(sys.executable, "rasterjit", "colour", files)["reason"]


def test_names_that_a_package_has_are_not_called_absent():
    assert shapes.absent("json", "ray_?cast") is False
    with pytest.raises(LookupError, match=r"json has .*decode"):
        shapes.absent("json", "decode")


def panes(left, right):
    picture = np.zeros((10, 100, 3), np.uint8)
    picture[:, :50], picture[:, 50:] = left, right
    return picture


RED, BLUE = (128, 0, 64), (64, 0, 128)


def test_panes_cross_where_each_half_shows_its_own_in_front_in_both_orders():
    right = panes(RED, BLUE)
    assert shapes.crosses(right, right.copy())
    assert not shapes.crosses(right, panes(RED, RED))
    assert not shapes.crosses(panes(RED, RED), panes(RED, RED))
    assert not shapes.crosses(panes(BLUE, RED), panes(BLUE, RED))
    hides = panes((128, 0, 0), BLUE)
    assert not shapes.crosses(hides, hides.copy())


def test_an_edge_is_smooth_where_values_lie_between():
    hard = np.zeros((100, 100, 3), np.uint8)
    hard[:, 50:] = 200
    soft = hard.copy()
    soft[:, 49] = 100
    assert not shapes.is_smooth(hard)
    assert shapes.is_smooth(soft)


def test_the_error_of_depth_is_relative_and_the_largest():
    depth = np.full((4, 4), shapes.WALL_DEPTH)
    depth[1, 2] *= 1.001
    assert shapes.depth_error(depth) == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("row", "found", "text"),
    [
        ("masks", {"value": True}, "✓"),
        ("masks", {"value": False}, "–"),
        ("masks", {"value": "rays"}, "rays"),
        ("masks", {"reason": "no display"}, "?"),
        ("depth", {"value": 3.2e-8}, "3e-8"),
        ("depth", {"value": 5.31e-4}, "5e-4"),
        ("depth", {"value": False}, "–"),
        ("megabytes", {"value": {"bytes": 286_970_693}}, "287"),
        ("first", {"value": 0.279}, "0.3"),
    ],
)
def test_a_cell_says_what_was_found(row, found, text):
    assert command.cell(row, found) == text


def test_the_table_of_a_file_of_results_names_versions_and_what_has_no_answer(
    tmp_path, monkeypatch
):
    version = {"value": {"bytes": 2e6, "version": "1.2"}}
    found = {"f3d": {"masks": {"value": False}, "megabytes": version, "lens": {"reason": "broke"}}}
    path = tmp_path / "found.json"
    path.write_text(json.dumps(found))
    monkeypatch.setattr(command, "check_peer", lambda python, peer, folder, rows: {})
    done = CliRunner().invoke(
        command.main, ["--peer", "f3d", "--row", "masks", "--results", str(path)]
    )
    assert done.exit_code == 0, done.output
    assert "|  | F3D 1.2 |" in done.output
    assert "| Object masks | – |" in done.output
    assert "f3d, lens: broke" in done.output


def test_a_python_that_is_none_is_refused():
    done = CliRunner().invoke(command.main, ["--python", "f3d=/no/such/file"])
    assert done.exit_code == 2
    assert "is not PEER=PATH of a Python" in done.output


def test_what_all_have_is_a_line_below_the_table():
    found = {
        "f3d": {"lens": {"value": True}, "masks": {"value": True}},
        "pyvista": {"lens": {"value": True}, "masks": {"value": "rays"}},
    }
    text = command.table(found, ["lens", "masks"])
    assert "| Object masks | ✓ | rays |" in text
    assert "| Lens" not in text
    assert text.endswith("\nAll have: lens distortion.\n")


def test_the_readme_has_the_rows_of_the_program():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (shared,) = re.findall(r"All have: (.*?)\.\n", text.replace("\n", " ").replace(". ", ".\n"))
    named = shared.split("; ")
    for name in command.ROWS.values():
        in_table = text.count(f"| {name} |") == 1
        assert in_table != (name[0].lower() + name[1:] in named), name
