"""
Speed under pytest-benchmark: ``pytest benchmarks --benchmark-enable``.

Smaller scenes than ``python -m benchmarks`` draws, the same contestants, all in this process; each
picture is compared before it is timed, with plain Python's where that can draw the scene.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rasterjit as rj
from benchmarks.contestants import Prepared, contestant
from benchmarks.pictures import EXACT, Needed, agreement, differs, needed, text_of
from benchmarks.scenes import (
    SAMPLE_SIZE,
    TEAPOT,
    Scene,
    filled,
    mesh_70k,
    mesh_70k_phong,
    short_lines,
    slivers,
    smooth_quads,
    teapot,
)

Timer = Callable[..., Any]

TWINS = ("rasterjit", "numpy", "pure_python", "full_screen")
IN_COLOR = ("rasterjit", "opengl")

COLORED: dict[str, Callable[[], Scene]] = {
    "fill": lambda: smooth_quads("back_to_front", (640, 360)),
    "mesh": mesh_70k,
    "phong": mesh_70k_phong,
    "slivers": lambda: slivers(10_000),
}


def checked(
    key: str, scene: Scene, reference: str, least: Needed | None = None, threads: int = 1
) -> Prepared:
    """Return a scene prepared by a contestant whose picture is like the reference's."""
    reason = contestant(key).available() or contestant(key).draws(scene)
    if reason is not None:
        pytest.skip(reason)
    prepared = contestant(key).prepare(scene, threads)
    prepared.draw()
    expected = contestant(reference).prepare(scene, 1)
    expected.draw()
    shares = agreement(prepared.picture(), expected.picture())
    assert not differs(shares, least or needed(scene, contestant(key))), text_of(shares)
    return prepared


@pytest.fixture
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let OpenGL draw with one thread."""
    for name, value in contestant("opengl").environment(1).items():
        monkeypatch.setenv(name, value)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("key", IN_COLOR)
@pytest.mark.parametrize("name", COLORED)
def test_triangles(benchmark: Timer, name: str, key: str) -> None:
    benchmark(checked(key, COLORED[name](), "rasterjit").draw)


def test_triangles_with_two_threads(benchmark: Timer) -> None:
    benchmark(checked("rasterjit", mesh_70k(), "rasterjit", EXACT, threads=2).draw)


def test_lines(benchmark: Timer) -> None:
    benchmark(checked("rasterjit", short_lines(100_000), "numpy", EXACT).draw)


@pytest.mark.parametrize("key", TWINS)
def test_triangles_of_twins(benchmark: Timer, key: str) -> None:
    scene = replace(filled(), size=(SAMPLE_SIZE[0] // 2, SAMPLE_SIZE[1] // 2))
    benchmark(checked(key, scene, "pure_python", EXACT).draw)


@pytest.mark.parametrize("key", TWINS)
def test_lines_of_twins(benchmark: Timer, key: str) -> None:
    benchmark(checked(key, short_lines(200), "pure_python", EXACT).draw)


def test_teapot_visibility(benchmark: Timer) -> None:
    benchmark(checked("rasterjit", teapot(), "numpy", EXACT).draw)


def test_teapot_from_file_to_picture(benchmark: Timer, tmp_path: Path) -> None:
    def render() -> np.ndarray:
        frame = rj.render(rj.load(TEAPOT), size=(640, 480))
        frame.save(tmp_path / "teapot.png")
        return frame.color

    picture = benchmark(render)
    assert (picture != picture[0, 0]).any()
    assert (tmp_path / "teapot.png").exists()
