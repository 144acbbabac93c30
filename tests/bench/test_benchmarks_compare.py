"""``python -m benchmarks compare``: it sees a slowdown that is there, and none that is not."""

from __future__ import annotations

import dataclasses
import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
assembly = importlib.import_module("benchmarks.assembly")
checkouts = importlib.import_module("benchmarks.checkouts")
compare = importlib.import_module("benchmarks.compare")
instructions = importlib.import_module("benchmarks.instructions")
judging = importlib.import_module("benchmarks.judging")
public_api = importlib.import_module("benchmarks.public_api")
report = importlib.import_module("benchmarks.report")

NOISE = (1.00, 1.02, 0.99, 1.01, 1.30, 0.98, 1.00, 1.03, 0.97)
BEFORE = [10.0 * noise for noise in NOISE]


def test_a_planted_slowdown_is_worse():
    row = judging.judge_times("mesh", BEFORE, [1.2 * time for time in BEFORE])
    assert row.is_worse
    assert row.ratio == pytest.approx(1.2)


@pytest.mark.parametrize(
    "after",
    [
        BEFORE,
        BEFORE[::-1],
        [1.05 * time for time in BEFORE],
        [0.5 * time for time in BEFORE],
        [9.0, 9.0, 9.0, 9.0, 40.0, 40.0, 40.0, 40.0, 40.0],  # another program began halfway
    ],
)
def test_noise_and_speed_ups_are_not_worse(after):
    assert not judging.judge_times("mesh", BEFORE, after).is_worse


def test_a_slowdown_on_one_thread_costs_processor_time_or_is_clear():
    slower = judging.judge_times("mesh", BEFORE, [1.2 * time for time in BEFORE])
    same = judging.judge_times("mesh", BEFORE, BEFORE)
    unclear = dataclasses.replace(slower, low=1.05)
    assert compare.is_confirmed(slower, same, judging.LIMIT)
    assert compare.is_confirmed(unclear, slower, judging.LIMIT)
    assert not compare.is_confirmed(unclear, same, judging.LIMIT)
    assert not compare.is_confirmed(same, slower, judging.LIMIT)


def test_a_kernel_that_lost_its_vectors_is_named():
    before = {"fill": {"instructions": 900, "wide": 80}, "bin": {"instructions": 90, "wide": 6}}
    after = {"fill": {"instructions": 700, "wide": 12}, "new": {"instructions": 5, "wide": 0}}
    found = {row.what: row for row in judging.judge_code(before, after)}
    assert found["fill"].is_worse
    assert found["fill"].note == "lost its vectors: vector instructions 80 -> 12"
    assert (found["bin"].note, found["new"].note) == ("gone", "new")
    assert not found["bin"].is_worse
    assert not any(row.is_worse for row in judging.judge_code(before, before))


def test_vector_instructions_are_counted():
    text = (
        "fill:\n"
        "\t.p2align 4, 0x90\n"
        "\tvmovups\t(%rdi), %zmm0\n"
        "\tvaddps\t%ymm1, %ymm2, %ymm3\n"
        "\tvaddss\t%xmm1, %xmm2, %xmm3\n"
        ".LBB0_1:\n"
        "\tretq\n"
    )
    assert assembly.count(text) == {"instructions": 4, "wide": 2}


@pytest.fixture
def repository(tmp_path):
    """A repository with two commits of one file, and a way to run git in it."""

    def git(*arguments):
        done = subprocess.run(
            ["git", "-c", "user.name=A", "-c", "user.email=a@example.org", *arguments],
            cwd=tmp_path / "repository", check=True, capture_output=True, text=True,
        )  # fmt: skip
        return done.stdout

    (tmp_path / "repository").mkdir()
    git("init", "--quiet")
    for text in ("old", "new"):
        (tmp_path / "repository" / "file").write_text(text)
        git("add", "file")
        git("commit", "--quiet", "-m", text)
    (tmp_path / "repository" / "file").write_text("uncommitted")
    return tmp_path / "repository", git


def test_commits_are_checked_out_beside_each_other_and_removed(repository, tmp_path):
    root, git = repository
    with checkouts.checkouts(("HEAD~1", "HEAD", "."), tmp_path, root) as found:
        folders = [folder for _, folder in found]
        assert [(folder / "file").read_text() for folder in folders] == [
            "old",
            "new",
            "uncommitted",
        ]
    assert not folders[0].exists()
    assert len(git("worktree", "list").splitlines()) == 1
    assert (root / "file").read_text() == "uncommitted"


def leave_early(root, folder):
    """Fail while two commits are checked out."""
    with checkouts.checkouts(("HEAD~1", "HEAD"), folder, root):
        raise KeyboardInterrupt


def test_checkouts_are_removed_when_the_comparison_fails(repository, tmp_path):
    root, git = repository
    with pytest.raises(KeyboardInterrupt):
        leave_early(root, tmp_path)
    assert len(git("worktree", "list").splitlines()) == 1


def test_an_unknown_commit_is_refused(repository, tmp_path):
    root, git = repository
    with (
        pytest.raises(checkouts.RevisionError, match="Needed a single revision"),
        checkouts.checkouts(("HEAD", "no-such-commit"), tmp_path, root),
    ):
        raise AssertionError("it was checked out")
    assert len(git("worktree", "list").splitlines()) == 1


def test_workers_use_the_package_of_the_other_folder(tmp_path):
    (tmp_path / "rasterjit").mkdir()
    (tmp_path / "rasterjit" / "__init__.py").write_text("")
    code = (
        "import sys; from benchmarks.compare_worker import use_package; use_package(sys.argv[1]); "
        "import rasterjit; print(rasterjit.__file__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert Path(done.stdout.strip()).parent.parent == tmp_path


@pytest.mark.parametrize(("factor", "status"), [(1.0, 0), (1.2, 1)])
def test_a_slowdown_ends_the_command_with_status_1(monkeypatch, tmp_path, factor, status):
    def compare_trees(trees, scenes, threads, limit, timed):
        after = [factor * time for time in BEFORE]
        return [judging.judge_times(scene, BEFORE, after, limit) for scene in scenes]

    monkeypatch.setattr(compare, "compare_trees", compare_trees)
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    monkeypatch.setattr(report, "machine", dict)
    done = CliRunner().invoke(compare.compare, [".", "WORKTREE", "--only", "mesh_70k"])
    assert done.exit_code == status, done.output
    (row,) = json.loads((tmp_path / "compare.json").read_text())["rows"]
    assert row["is_worse"] == bool(status)
    assert len(row["rounds"]) == len(BEFORE)


@pytest.mark.parametrize("has_avx512", [True, False])
def test_workers_are_held_to_avx2_where_there_is_more(monkeypatch, tmp_path, has_avx512):
    trees = []

    def compare_trees(found, scenes, threads, limit, timed):
        trees.extend(found)
        return []

    monkeypatch.setattr(compare, "compare_trees", compare_trees)
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    monkeypatch.setattr(report, "machine", dict)
    features = {"avx2": True, "fma": True, "avx512f": has_avx512, "avx512vl": has_avx512}
    monkeypatch.setattr(instructions, "features", lambda: features)
    done = CliRunner().invoke(compare.compare, [".", ".", "--instructions", "avx2"])
    if not has_avx512:
        assert done.exit_code == 1
        assert "no AVX-512" in done.output
        return
    assert done.exit_code == 0, done.output
    for tree in trees:
        asked = tree.environment()["NUMBA_CPU_FEATURES"].split(",")
        assert {"+avx2", "+fma", "-avx512f", "-avx512vl"} <= set(asked)
    assert json.loads((tmp_path / "compare.json").read_text())["instructions"] == "AVX2"


def test_small_scenes_draw_by_public_names():
    for scene in public_api.small_scenes():
        picture = public_api.drawer(scene, 1)()
        assert any(array.any() for array in picture)
