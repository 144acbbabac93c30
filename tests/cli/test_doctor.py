import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rasterjit.cli import commands, doctor
from rasterjit.rendering import rasterize, renderer
from rasterjit.runtime import jit, store

ROOT = Path(__file__).parents[2]


def test_doctor_finds_this_installation_healthy():
    result = CliRunner().invoke(commands.program, ["doctor"])
    assert result.exit_code == 0, result.output
    assert "FAILED" not in result.stdout
    passed = [line for line in result.stdout.splitlines() if line.startswith("ok      ")]
    is_kept = not (jit.DISABLED or jit.CHECKED)
    assert len(passed) == len(doctor.CHECKS) + is_kept
    for word in (*doctor.PACKAGES, "python", "cpu", "threads", "extra video", "kernels"):
        assert word in result.stdout
    assert ("kernel store" in result.stdout) == is_kept


def entry(place, number, **changes):
    """Write an entry of a kernel that nobody calls; return its path."""
    triple, cpu, _ = store.host()
    source = "rasterjit.pipeline.srgb_encoding"
    header = store.Header(
        "none",
        f"{source}.nothing",
        "()",
        store.hash_sources(source),
        store.compiler_versions(),
        triple,
        cpu,
    )
    path = place / f"nothing_{number}.0.kernel"
    store.write_entry(path, header._replace(**changes), b"code")
    return path


@pytest.fixture
def place(monkeypatch, tmp_path):
    """An empty store, of a process that compiled nothing."""
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setattr(jit, "CHECKED", False)
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(store, "USED_KERNELS", store.UsedKernels([], []))
    return tmp_path


def test_doctor_lists_checks_and_mends_the_store(place):
    for number, changes in enumerate([{}, {}, {"versions": "0 0"}, {"cpu": "another"}]):
        entry(place, number, **changes)
    damaged = [entry(place, 8), entry(place, 9)]
    damaged[0].write_bytes(b"")
    damaged[1].unlink()
    (damaged[1] / "inside").mkdir(parents=True)
    left = place / ".abc.part"
    left.touch()
    os.utime(left, (0, 0))
    summary, *others = doctor._check_store()
    assert summary.passed
    assert "4 entries" in summary.text
    assert str(place) in summary.text
    said = "\n".join(finding.text for finding in others)
    assert "1 made by other versions, 1 for other processors:" in said
    assert "2 damaged removed" in said
    assert "1 temporary files removed" in said
    assert all(finding.passed is None for finding in others)
    assert sorted(path.name for path in place.iterdir()) == [
        f"nothing_{number}.0.kernel" for number in range(4)
    ]
    assert [finding.passed for finding in doctor._check_store()] == [True, None]


def test_what_cannot_be_read_or_removed_is_told(place, monkeypatch):
    paths = [entry(place, 0), entry(place, 1)]
    found = store.inspect_folder(place)._replace(unreadable=paths[:1], damaged=paths[1:])
    monkeypatch.setattr(store, "inspect_folder", lambda place: found)
    monkeypatch.setattr(store, "remove_damaged", lambda found: found.damaged)
    failed = [finding.text for finding in doctor._check_store() if finding.passed is False]
    assert failed == [
        f"{paths[1].name} cannot be removed: remove it",
        f"{paths[0].name} cannot be read: remove it",
    ]


def test_nothing_kept_is_a_failure_that_names_the_variable(place, monkeypatch):
    monkeypatch.setattr(store, "kernel_folder", lambda: None)
    (finding,) = doctor._check_store()
    assert finding.passed is False
    assert "RASTERJIT_CACHE_DIR" in finding.text
    monkeypatch.setattr(store, "kernel_folder", lambda: place)
    monkeypatch.setattr(store, "USED_KERNELS", store.UsedKernels([], ["something"]))
    monkeypatch.setattr(os, "access", lambda *arguments: False)
    (finding,) = doctor._check_store()
    assert finding.passed is False
    assert "cannot be written (set RASTERJIT_CACHE_DIR)" in finding.text


def test_a_check_that_raises_has_failed_and_so_has_the_command(monkeypatch):
    def check_of_nothing():
        raise RuntimeError("broken")

    monkeypatch.setattr(doctor, "CHECKS", (doctor.check_shared_edge, check_of_nothing))
    result = CliRunner().invoke(commands.program, ["doctor"])
    assert result.exit_code == 1
    assert "FAILED  of nothing" in result.stdout
    assert "RuntimeError: broken" in result.stdout
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("check", [doctor.check_shared_edge, doctor.check_top_left_rule])
def test_wrong_pixels_are_found(monkeypatch, check):
    original = rasterize.rasterize

    def shifted(*arguments, **options):
        visibility = original(*arguments, **options)
        visibility.face_id = np.roll(visibility.face_id, 1, axis=1)
        visibility.face_id[0, 0] = -1
        return visibility

    assert check().passed
    monkeypatch.setattr(doctor, "rasterize", shifted)
    assert not check().passed


def test_a_wrong_depth_and_a_difference_between_threads_are_found(monkeypatch):
    original = renderer.render

    def broken(*arguments, threads, **options):
        frame = original(*arguments, threads=threads, **options)
        frame.depth[...] *= np.float32(1.0 + 1e-6 * threads)
        return frame

    assert doctor.check_depth_and_color().passed
    monkeypatch.setattr(doctor, "render", broken)
    assert not doctor.check_depth_and_color().passed
    finding = doctor.check_threads()
    assert not finding.passed
    assert "depth" in finding.text


def test_a_missing_extra_is_named_and_is_no_failure(monkeypatch):
    monkeypatch.setattr(doctor, "EXTRAS", {"video": ("no_such_module",)})
    findings = {finding.name: finding for finding in doctor.examine()}
    assert findings["extra video"].passed is None
    assert "no_such_module" in findings["extra video"].text
    assert "rasterjit[video]" in findings["extra video"].text


def test_the_ball_of_the_thread_check_is_closed():
    ball = doctor._make_ball(24, 12)
    assert np.ptp(np.linalg.norm(ball.vertices, axis=1)) < 1e-12
    corners = ball.vertices[ball.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fi->f", outward, corners.mean(axis=1)) > -1e-12).all()


def test_doctor_is_healthy_without_compiling():
    done = subprocess.run(
        [sys.executable, "-m", "rasterjit", "doctor"],
        capture_output=True, text=True, cwd=ROOT, env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "NUMBA_DISABLE_JIT is set" in done.stdout


MODULES = {
    "imageio[ffmpeg]": "imageio_ffmpeg", "flip-evaluator": "flip_evaluator",
    "pyside6-essentials": "PySide6", "openexr": "OpenEXR", "pycollada": "collada",
    "dracopy": "DracoPy", "pyyaml": "yaml",
}  # fmt: skip
"""Modules that are not called as their package is."""


def test_the_extras_are_those_that_pip_knows():
    """All that a user can ask for, each with what it brings; Pillow is always there."""
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = {
        extra: {
            MODULES.get(name, name)
            for needed in needs
            if (name := re.match(r"[\w\[\]-]+", needed)[0].lower()) != "pillow"
        }
        for extra, needs in project["optional-dependencies"].items()
        if extra not in ("test", "docs", "bench", "bench-large", "wheels")
    }
    assert {extra: set(modules) for extra, modules in doctor.EXTRAS.items()} == extras
