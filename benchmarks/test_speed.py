"""
Speed under pytest-benchmark: ``pytest benchmarks --benchmark-enable``.

Smaller scenes than ``python -m benchmarks`` draws, the same contestants; each picture is compared
with the plain Python twin's, or RasterJIT's on one thread, before it is timed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rasterjit as rj
from benchmarks.contestants import Prepared, contestant
from benchmarks.pairing import agreement
from benchmarks.scenes import (
    TEAPOT,
    LineScene,
    Scene,
    TriangleScene,
    full_screen_quads,
    look_at,
    perspective,
    short_lines,
    teapot,
    torus,
)

Timer = Callable[..., Any]

TWINS = ("rasterjit", "numpy", "pure_python")


def small_torus() -> TriangleScene:
    """Return 100 000 triangles at 1280 by 720."""
    positions, faces = torus(250, 200)
    camera = perspective(45.0, 16 / 9, 0.5, 20.0) @ look_at((0.4, -1.6, 3.3))
    return TriangleScene(positions, faces, camera, (1280, 720), len(faces), "triangle")


def tiny_torus() -> TriangleScene:
    """Return 1600 triangles at 160 by 90."""
    positions, faces = torus(40, 20)
    camera = perspective(45.0, 16 / 9, 0.5, 20.0) @ look_at((0.4, -1.6, 3.3))
    return TriangleScene(positions, faces, camera, (160, 90), len(faces), "triangle")


def tiny_lines() -> LineScene:
    """Return 200 lines."""
    return short_lines(200)


def checked(key: str, scene: Scene, reference: str, threads: int = 1) -> Prepared:
    """Return a scene prepared by a contestant whose picture equals the reference's."""
    prepared = contestant(key).prepare(scene, threads)
    prepared.draw()
    expected = contestant(reference).prepare(scene, 1)
    expected.draw()
    shares = agreement(prepared.picture(), expected.picture())
    assert shares
    assert set(shares.values()) == {1.0}
    return prepared


@pytest.mark.parametrize("threads", [1, 2])
def test_triangles(benchmark: Timer, threads: int) -> None:
    benchmark(checked("rasterjit", small_torus(), "rasterjit", threads).draw)


@pytest.mark.parametrize("order", ["back_to_front", "front_to_back"])
def test_fill(benchmark: Timer, order: str) -> None:
    benchmark(checked("rasterjit", full_screen_quads(order), "rasterjit").draw)


def test_lines(benchmark: Timer) -> None:
    benchmark(checked("rasterjit", short_lines(100_000), "rasterjit").draw)


@pytest.mark.parametrize("key", TWINS)
def test_triangles_of_twins(benchmark: Timer, key: str) -> None:
    benchmark(checked(key, tiny_torus(), "pure_python").draw)


@pytest.mark.parametrize("key", TWINS)
def test_lines_of_twins(benchmark: Timer, key: str) -> None:
    benchmark(checked(key, tiny_lines(), "pure_python").draw)


def test_teapot_visibility(benchmark: Timer) -> None:
    benchmark(checked("rasterjit", teapot(), "numpy").draw)


def test_teapot_from_file_to_picture(benchmark: Timer, tmp_path: Path) -> None:
    def render() -> np.ndarray:
        frame = rj.render(rj.load(TEAPOT), size=(640, 480))
        frame.save(tmp_path / "teapot.png")
        return frame.color

    picture = benchmark(render)
    assert (picture != picture[0, 0]).any()
    assert (tmp_path / "teapot.png").exists()
