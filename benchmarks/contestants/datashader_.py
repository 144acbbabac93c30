"""
datashader: ``Canvas.line`` and ``Canvas.trimesh``, compiled with Numba as RasterJIT is.

Vertices are put on the screen and listed by face beforehand. A face's depth is interpolated and
the least one kept, which is a depth test, but no colours are drawn; of lines it is kept whether
there is one. ``Canvas`` is timed from data frames to the array of its result.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import TAKES_PIXELS, refusal
from benchmarks.contestants.screen import edge_lines, screen_points
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "datashader"


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("datashader") is None:
        return 'the package datashader is not installed (pip install ".[bench]")'
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, TAKES_PIXELS)


def alike(scene: Scene) -> tuple[float, float]:
    """Return the shares of pixels alike that its rules allow for: ties may fall elsewhere."""
    if isinstance(scene, LineScene):
        return 0.99, 0.0
    return (0.85, 0.0) if scene.mode == "edges" else (0.99, 0.0)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw, what it draws with compiled by a first picture."""
    ready: Prepared
    if isinstance(scene, LineScene):
        ready = Lines(scene)
    elif scene.mode == "edges":
        ready = Lines(edge_lines(scene))
    else:
        ready = Faces(scene)
    ready.draw()
    return ready


def canvas_of(size: tuple[int, int]) -> Any:
    """Return a canvas of pixels whose rows run down."""
    import datashader

    width, height = size
    return datashader.Canvas(width, height, x_range=(0, width), y_range=(0, height))


class Faces:
    """The least depth at every pixel."""

    def __init__(self, scene: TriangleScene) -> None:
        import datashader
        import pandas
        from datashader.utils import mesh

        points, depths = screen_points(scene)
        frame = {"x": points[:, 0], "y": points[:, 1], "depth": depths}
        self._vertices = pandas.DataFrame(frame)
        self._faces = pandas.DataFrame(scene.faces, columns=["a", "b", "c"])
        self._mesh = mesh(self._vertices, self._faces)
        self._canvas = canvas_of(scene.size)
        self._nearest = datashader.min("depth")

    def draw(self) -> None:
        """Aggregate the depths."""
        self._depth = self._canvas.trimesh(
            self._vertices, self._faces, mesh=self._mesh, agg=self._nearest, interpolate="linear"
        )

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the depth, NaN where nothing is."""
        return {"depth": self._depth.values}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {"covered": ~np.isnan(self._depth.values)}


class Lines:
    """Whether there is a line at every pixel."""

    def __init__(self, scene: LineScene) -> None:
        import datashader
        import pandas

        self._lines = pandas.DataFrame(scene.ends + 0.5, columns=["x0", "y0", "x1", "y1"])
        self._canvas = canvas_of(scene.size)
        self._any = datashader.any()

    def draw(self) -> None:
        """Aggregate the lines."""
        self._drawn = self._canvas.line(
            self._lines, x=["x0", "x1"], y=["y0", "y1"], agg=self._any, axis=1
        )

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the pixels."""
        return {"drawn": self._drawn.values}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {"covered": self._drawn.values}
