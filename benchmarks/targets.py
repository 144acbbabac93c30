"""What must be reached: how many times as long as RasterJIT a contestant has to take."""

from __future__ import annotations

from typing import NamedTuple


class Target(NamedTuple):
    """A bound that must hold, and a better one to aim at."""

    least: float
    goal: float | None = None


OPENGL, TINYDISPLAY = "opengl", "tinydisplay"

PEERS: dict[tuple[str, str], Target] = {
    ("fill_back_to_front", OPENGL): Target(4.0, 10.0),
    ("fill_back_to_front", TINYDISPLAY): Target(3.0, 7.0),
    ("fill_front_to_back", OPENGL): Target(4.0, 10.0),
    ("fill_front_to_back", TINYDISPLAY): Target(3.0, 7.0),
    ("mesh_70k", OPENGL): Target(3.0, 5.0),
    ("mesh_70k", TINYDISPLAY): Target(1.6, 3.0),
    ("mesh_1m", OPENGL): Target(4.0, 6.0),
    ("mesh_1m", TINYDISPLAY): Target(2.0, 3.0),
    ("mesh_5m", OPENGL): Target(6.0, 10.0),
    ("mesh_5m", TINYDISPLAY): Target(3.0, 5.0),
    ("mesh_70k_phong", OPENGL): Target(3.0, 6.0),
    ("slivers", OPENGL): Target(4.0, 10.0),
    ("slivers", TINYDISPLAY): Target(2.0, 5.0),
    ("short_lines", OPENGL): Target(8.0, 13.0),
    ("short_lines", TINYDISPLAY): Target(1.1, 1.6),
    ("long_lines", OPENGL): Target(7.0, 12.0),
    ("long_lines", TINYDISPLAY): Target(0.8, 1.1),
    ("small_images", OPENGL): Target(3.0, 8.0),
    ("small_images", TINYDISPLAY): Target(1.6, 4.0),
}
"""By scene and contestant, with the same number of threads, reading back included."""

PYTHON_TRIANGLES, PYTHON_LINES = Target(1000.0), Target(200.0)
"""Plain Python, one thread."""

SCALING = Target(1.8)
"""How many times faster two threads are than one."""
SCALED = ("fill_back_to_front", "fill_front_to_back", "mesh_1m")
"""Scenes that must reach it."""

EXACTNESS = Target(1 / 1.10)
"""RasterJIT with float edge functions: being exact may cost a tenth."""

FIRST_EVER_SECONDS = Target(8.0)
FIRST_FRAME_SECONDS = Target(1.3, 0.9)
"""Most seconds of the first run ever, and of a fresh process that finds compiled kernels."""

FRAME_BYTES = Target(300e6)
"""Most memory of a frame of five million triangles above the mesh's own arrays, bytes."""
LIMIT_BYTES = 4 << 30
"""Memory that a process gets to draw ten million triangles."""
GROWTH_BYTES = Target(2e6)
"""Most memory that a process may gain by drawing frame after frame, bytes."""
