"""
Measure a million lines with a width: `rasterjit.Lines` beside Mesa's llvmpipe, in one run.

``python -m benchmarks.wide_lines [--lines N] [--width W] [--rounds N]``

Short segments in a cube, 1920 x 1080 pixels, a colour at each end, depth test, one thread each; all
pictures are read back, and they take turns, round by round. OpenGL rounds the width to whole
pixels and cuts ends off; RasterJIT covers what the width covers, with ends cut off and, once more,
with round ones. A row has the median time and the median of the rounds' ratios to the first. The
shares of pixels that both cover are printed before a time counts. Half a minute.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rasterjit as rj
from benchmarks.contestants import opengl
from benchmarks.report import machine

SIZE = (1920, 1080)
CAMERA = rj.PerspectiveCamera((0, 0, 3), (0, 0, 0), near=0.5, far=6.0)

VERTEX_SHADER = """
in vec4 position;
in vec3 color;
out vec3 mixed;
void main() {
    gl_Position = vec4(position.x, -position.y, position.zw);
    mixed = color;
}
"""

FRAGMENT_SHADER = """
in vec3 mixed;
out vec4 shown;
void main() {
    shown = vec4(mixed, 1.0);
}
"""


def make_lines(count: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return the ends of segments, (2 N, 3), in turns, and their colours, (2 N, 3)."""
    random = np.random.default_rng(1)
    starts = random.uniform(-1.0, 1.0, (count, 3))
    ends = starts + random.normal(0.0, 0.01, (count, 3))
    points = np.stack([starts, ends], axis=1).reshape(-1, 3)
    return points, random.random((2 * count, 3)).astype(np.float32)


class OpenGL:
    """The segments, uploaded."""

    def __init__(self, points: NDArray[Any], colors: NDArray[Any], width: float) -> None:
        self._target = opengl.Target(SIZE, "color", tests_depth=True)
        context = self._target.context
        program = context.program(
            vertex_shader=opengl.with_defines(VERTEX_SHADER, []),
            fragment_shader=opengl.with_defines(FRAGMENT_SHADER, []),
        )
        matrix = CAMERA.projection_matrix(SIZE) @ CAMERA.view_matrix()
        placed = np.column_stack([points, np.ones(len(points))]) @ matrix.T
        self._array = context.vertex_array(
            program,
            [
                (context.buffer(placed.astype(np.float32).tobytes()), "4f", "position"),
                (context.buffer(colors.tobytes()), "3f", "color"),
            ],
        )
        self._lines = context.LINES
        context.line_width = width

    def draw(self) -> NDArray[np.bool_]:
        """Draw a picture and return the pixels that are covered."""
        self._target.clear()
        self._array.render(self._lines)
        return self._target.read()["color"][..., 3] > 0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--lines", type=int, default=1_000_000)
    parser.add_argument("--width", type=float, default=1.5)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    # Before a context is opened that is to stay.
    print(machine())
    points, colors = make_lines(options.lines)
    segments = np.arange(len(points)).reshape(-1, 2)
    entries: dict[str, Callable[[], NDArray[Any]]] = {}
    for caps in ("butt", "round"):
        lines = rj.Lines(points, segments, colors=colors, width=options.width, caps=caps)
        renderer = rj.Renderer(SIZE, threads=1)

        def draw(lines: rj.Lines = lines, renderer: rj.Renderer = renderer) -> NDArray[Any]:
            return renderer.render(lines, CAMERA, background="transparent").color[..., 3] > 0

        entries[f"RasterJIT, {caps} ends"] = draw
    if opengl.available() is None:
        entries["llvmpipe"] = OpenGL(points, colors, options.width).draw
    pictures = {name: draw() for name, draw in entries.items()}
    first = next(iter(pictures.values()))
    for name, picture in pictures.items():
        print(
            f"{name}: {(picture == first).mean():.3%} of all pixels covered, or not, as the first"
        )
    seconds: dict[str, list[float]] = {name: [] for name in entries}
    for _ in range(options.rounds):
        for name, draw in entries.items():
            begun = time.perf_counter()
            draw()
            seconds[name].append(time.perf_counter() - begun)
    base = next(iter(seconds.values()))
    for name, times in seconds.items():
        ratios = [one / other for one, other in zip(times, base, strict=True)]
        print(
            f"{name:24} {1000 * statistics.median(times):8.1f} ms  "
            f"{statistics.median(ratios):6.2f} times"
        )


if __name__ == "__main__":
    import os

    os.environ.update(opengl.environment(1))
    main()
