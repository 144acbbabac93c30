"""Place the labels of points in a plot so that they cover neither each other nor a point."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DISTANCES = (7.0, 13.0, 21.0, 32.0, 46.0, 62.0, 80.0)
"""From a point to the edge of its label, points, from the best on."""

DIRECTIONS = (
    (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1),
    (2, 1), (2, -1), (-2, 1), (-2, -1), (1, 2), (1, -2), (-1, 2), (-1, -2),
)  # fmt: skip
"""From a point to its label, from the best on."""

LEADER = 12.0
"""Least distance from which a thin line leads to the label, points."""

MARKER, BAR = 5.0, 2.5
"""Half the side of what a marker takes, and half the height of a bar, points."""

LINE_STEP = 4.0
"""Distance of the places on a line that labels keep clear of, points."""

COVERING, CROSSING = 1000.0, 30.0
"""What a label costs that covers another label, a marker or the frame, and a bar or the line."""


class Box(NamedTuple):
    """A rectangle, points from the lower left of the figure."""

    left: float
    bottom: float
    right: float
    top: float

    def common(self, other: Box) -> bool:
        """Return whether two boxes share some area."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.bottom < other.top
            and other.bottom < self.top
        )

    def within(self, other: Box) -> bool:
        """Return whether this box lies in another."""
        return (
            self.left >= other.left
            and self.right <= other.right
            and self.bottom >= other.bottom
            and self.top <= other.top
        )


def place_labels(
    axes: Axes,
    points: Sequence[tuple[float, float, str, str]],
    bars: Sequence[tuple[float, float, float]],
    line: Sequence[tuple[float, float]],
    halo: str,
) -> list[Box]:
    """
    Write the labels of points beside them.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With its final limits, in a figure of 72 dots per inch.
    points : sequence of (x, y, label, color)
        All that is marked, in data coordinates; a label may be empty.
    bars : sequence of (low, high, y)
        Horizontal bars that labels had better not cross.
    line : sequence of (x, y)
        Corners of a line of which the same holds.
    halo : str
        Colour around the letters.

    Returns
    -------
    list of Box
        What the labels take, for each point that has one.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    renderer = FigureCanvasAgg(axes.figure).get_renderer()
    to_points = axes.transData.transform
    frame = Box(*axes.bbox.extents)
    centres = [tuple(to_points((x, y))) for x, y, _, _ in points]
    solid = [_around(x, y, MARKER, MARKER) for x, y in centres]
    soft = [_bar(to_points((low, y)), to_points((high, y))) for low, high, y in bars]
    soft += _along([tuple(to_points(corner)) for corner in line])
    placed = []
    for (x, y), (_, _, label, color) in zip(centres, points, strict=True):
        if label:
            size = _extent(axes, renderer, label)
            distance, box = _best_place(x, y, size, frame, solid, soft)
            _write(axes, (x, y), box, label, color, halo, distance >= LEADER)
            solid.append(box)
            placed.append(box)
    return placed


def _extent(axes: Axes, renderer: object, label: str) -> tuple[float, float]:
    """Return width and height of a text, points."""
    text = axes.text(0.0, 0.0, label, parse_math=False)
    extent = text.get_window_extent(renderer)
    text.remove()
    return extent.width, extent.height


def _best_place(
    x: float,
    y: float,
    size: tuple[float, float],
    frame: Box,
    solid: Sequence[Box],
    soft: Sequence[Box],
) -> tuple[float, Box]:
    """Return the place beside (x, y) that costs least, and its distance."""
    best = math.inf, 0.0, Box(x, y, x, y)
    for distance in DISTANCES:
        for rank, direction in enumerate(DIRECTIONS):
            box = _beside(x, y, size, distance, direction)
            cost = distance + 0.25 * rank
            if cost < best[0]:
                cost += COVERING * (not box.within(frame))
                cost += COVERING * sum(box.common(other) for other in solid)
                cost += CROSSING * any(box.common(other) for other in soft)
                best = min(best, (cost, distance, box), key=lambda place: place[0])
    return best[1:]


def _beside(
    x: float, y: float, size: tuple[float, float], distance: float, direction: tuple[int, int]
) -> Box:
    """Return the box of a label whose nearest edge or corner is ``distance`` from a point."""
    length = math.hypot(*direction)
    centre_x = x + distance * direction[0] / length + _sign(direction[0]) * 0.5 * size[0]
    centre_y = y + distance * direction[1] / length + _sign(direction[1]) * 0.5 * size[1]
    return _around(centre_x, centre_y, 0.5 * size[0], 0.5 * size[1])


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)


def _around(x: float, y: float, half_width: float, half_height: float) -> Box:
    return Box(x - half_width, y - half_height, x + half_width, y + half_height)


def _bar(start: Sequence[float], end: Sequence[float]) -> Box:
    """Return what a horizontal bar takes."""
    return Box(start[0], start[1] - BAR, end[0], end[1] + BAR)


def _along(corners: Sequence[tuple[float, float]]) -> list[Box]:
    """Return small boxes along a line."""
    boxes = []
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        steps = 1 + int(math.hypot(x1 - x0, y1 - y0) / LINE_STEP)
        for k in range(steps + 1):
            share = k / steps
            boxes.append(_around(x0 + share * (x1 - x0), y0 + share * (y1 - y0), 1.0, 1.0))
    return boxes


def _write(
    axes: Axes,
    point: tuple[float, float],
    box: Box,
    label: str,
    color: str,
    halo: str,
    with_leader: bool,
) -> None:
    """Write a label into its box, with a thin line from its point where it is far away."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Affine2D

    in_points = Affine2D().scale(1.0 / 72.0) + axes.figure.dpi_scale_trans
    if with_leader:
        x = min(max(point[0], box.left), box.right)
        y = min(max(point[1], box.bottom), box.top)
        axes.add_artist(
            Line2D([point[0], x], [point[1], y], transform=in_points, color=color, linewidth=0.5)
        )
    axes.text(
        box.left, box.bottom, label, transform=in_points, color=color, parse_math=False,
        va="bottom", zorder=5.0, path_effects=[withStroke(linewidth=2.0, foreground=halo)],
    )  # fmt: skip
