"""
Draw error against time of all that was tried, with the Pareto front.

Both axes are logarithmic. Labels are placed so that they cover neither each other nor a point.

Plots for the page are inline SVG whose colours are custom properties of the page's style sheet, so
they follow its light and dark scheme; letters are outlines, so they look alike everywhere.

matplotlib is imported where something is drawn, and none of its state is kept.
"""

from __future__ import annotations

import html
import importlib.util
import io
import itertools
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from rasterjit.accuracy.choice import is_measured
from rasterjit.accuracy.results import Study, Trial, front_trials

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MANTISSAS = ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7))
"""Ticks of each decade, from the sparsest choice on."""

STEPS = (1.0, 2.0, 2.5, 5.0)
"""Distances of evenly spaced ticks, times a power of ten."""

MIN_APART = 0.135
"""Least distance of two ticks, as a share of the axis: their labels must not touch."""

MIN_LOGARITHMIC = 3.0
"""Ratio of the ends of an axis from which multiples of powers of ten are its ticks."""

END = 0.03
"""Share of the axis at its ends where no tick is: its label would stand out."""


def number(value: float) -> str:
    """Return a number with three digits, or all before the point: ``0.0213``, ``1,234``."""
    if 999.5 <= abs(value) < 999_999.5:
        return f"{value:,.0f}"
    text = f"{value:.3g}"
    mantissa, letter, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if letter else text


def duration(seconds: float) -> str:
    """Return a time with its unit: ``12.3 ms``, ``3.04 s``."""
    if seconds < 0.9995:
        return f"{number(1000.0 * seconds)} ms"
    return f"{seconds:.3g} s" if seconds < 999.5 else f"{seconds:,.0f} s"


def log_limits(values: Sequence[float], least: float, margin: float) -> tuple[float, float]:
    """
    Return the ends of a logarithmic axis.

    Parameters
    ----------
    values : sequence of float
        What must lie on it; all above 0, at least one.
    least : float
        Least ratio of the ends, before the margin.
    margin : float
        Share of its length that is added at each end.
    """
    low, high = math.log(min(values)), math.log(max(values))
    missing = max(math.log(least) - (high - low), 0.0)
    low, high = low - 0.5 * missing, high + 0.5 * missing
    more = margin * (high - low)
    return math.exp(low - more), math.exp(high + more)


def log_ticks(low: float, high: float) -> list[float]:
    """Return one to eight round numbers within a logarithmic axis, well apart."""
    length = math.log(high / low)
    low, high = low * math.exp(END * length), high * math.exp(-END * length)
    if high / low < MIN_LOGARITHMIC:
        return _evenly_spaced(low, high, MIN_APART * length)
    choices = [_of_decades(low, high, mantissas) for mantissas in MANTISSAS]
    fitting = [ticks for ticks in choices if _are_apart(ticks, MIN_APART * length)]
    if fitting:
        return fitting[-1]
    # Too many decades for a tick at each.
    return choices[0][:: math.ceil(MIN_APART * length / math.log(10.0))]


def _of_decades(low: float, high: float, mantissas: Sequence[float]) -> list[float]:
    """Return the given multiples of powers of ten that lie within low..high."""
    decades = range(math.floor(math.log10(low)), math.floor(math.log10(high)) + 1)
    ticks = [float(f"{mantissa}e{decade}") for decade in decades for mantissa in mantissas]
    return [tick for tick in ticks if low <= tick <= high]


def _evenly_spaced(low: float, high: float, least: float) -> list[float]:
    """Return multiples of the smallest round step that are apart on a logarithmic axis."""
    decade = math.floor(math.log10(high - low)) - 1
    choices = [
        [k * size * 10.0**power for k in _multiples(low, high, size * 10.0**power)]
        for power in (decade, decade + 1)
        for size in STEPS
    ]
    fitting = [ticks for ticks in choices if _are_apart(ticks, least)]
    return [float(f"{tick:.12g}") for tick in fitting[0]]


def _multiples(low: float, high: float, step: float) -> range:
    """Return the whole numbers of steps that lie within low..high."""
    return range(math.ceil(low / step), math.floor(high / step) + 1)


def _are_apart(ticks: Sequence[float], least: float) -> bool:
    """Tell whether neighbours are in no smaller ratio than ``exp(least)``."""
    return all(math.log(b / a) >= least for a, b in itertools.pairwise(ticks))


PAGE_MODULES = ("matplotlib", "jinja2")
"""What the extra ``accuracy`` brings for the page: plots, and its template."""

LIGHT = {
    "page": "#ffffff", "ink": "#1b1f24", "muted": "#6b7280", "grid": "#d9dde2",
    "level": "#0072b2", "standard": "#d55e00",
}  # fmt: skip
"""Colours on a light page; blue and vermilion are told apart with any colour vision."""

DARK = {
    "page": "#14171a", "ink": "#e6e9ed", "muted": "#9aa3ae", "grid": "#363c44",
    "level": "#56b4e9", "standard": "#ff9a4d",
}  # fmt: skip
"""The same on a dark page."""

FRONT_POINTS = (360.0, 290.0)
"""Width and height of the plot, points: letters stay legible on the width of a phone."""

LEFT, RIGHT, BOTTOM, TOP = 52.0, 12.0, 40.0, 26.0
"""What is left around the axes, points."""

MIN_TIMES, MIN_ERRORS = 1.25, 3.0
"""Least ratio of an axis' end to its start: below it, noise would look like much."""

ZERO_BAND = 0.16
"""Share of the height below the logarithmic axis where errors of zero are shown."""

ERROR_TITLE = "RMSE against the reference, linear light"
TIME_TITLE = "time of a frame, standard = 1"

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


class Point(NamedTuple):
    """One trial in a plot: its times over the standard's, its error, and how it is drawn."""

    time: float
    low: float
    high: float
    error: float
    kind: str
    label: str

    @property
    def is_on_front(self) -> bool:
        """Whether it has a number."""
        return self.label[:1].isdigit()


class Plot(NamedTuple):
    """A plot for a page, and where in it each trial is marked, as shares of width and height."""

    svg: str
    places: dict[str, tuple[float, float]]


class Mark(NamedTuple):
    """How one kind of point is drawn: marker, diameter in points, colours by name, opacity."""

    marker: str
    points: float
    edge: str
    fill: str
    text: str
    bar_alpha: float


MARKS = {
    "rough": Mark("x", 4.5, "muted", "muted", "muted", 0.0),
    "other": Mark("o", 4.5, "muted", "page", "muted", 0.0),
    "level": Mark("o", 6.5, "level", "level", "ink", 1.0),
    "standard": Mark("D", 7.0, "standard", "standard", "ink", 1.0),
}
"""The kinds of points, from the one at the back on."""


def require_extra(*modules: str) -> None:
    """Raise ``ValueError`` saying what to install where a module of the extra is missing."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise ValueError(
                f'the report of an accuracy study needs {module}; pip install "rasterjit[accuracy]"'
            )


def plot_front(study: Study, prefix: str) -> Plot:
    """
    Return error against time of all trials, those on the front numbered.

    Parameters
    ----------
    study : Study
    prefix : str
        What the ids in it start with.

    Returns
    -------
    Plot
        Inline SVG, and the place of each trial in it by label, from the upper left corner.
    """
    points = front_points(study)
    width, height = FRONT_POINTS
    with new_figure(FRONT_POINTS) as figure:
        axes = add_axes(figure, width)
        heights = draw_points(axes, points, study.standard.median)
        trials = (*study.trials, study.standard)
        places = {}
        for trial, point in zip(trials, points, strict=True):
            x, y = axes.transData.transform((point.time, heights[point]))
            places[trial.label] = float(x) / width, 1.0 - float(y) / height
        found = f"Error against time of {len(points)} qualities; those on the front are numbered"
        return Plot(_as_svg(figure, prefix, found), places)


def front_points(study: Study) -> list[Point]:
    """Return all trials, the standard last: those on the front labelled with their number."""
    numbers = {id(trial): str(n) for n, trial in enumerate(front_trials(study), 1)}
    points = []
    for trial in study.trials:
        label = numbers.get(id(trial), "")
        measured = "other" if is_measured(trial) else "rough"
        points.append(_point(trial, "level" if label else measured, label))
    label = f"{numbers.get(id(study.standard), '')} standard".strip()
    points.append(_point(study.standard, "standard", label))
    return points


def _point(trial: Trial, kind: str, label: str) -> Point:
    low, high = trial.spread
    return Point(trial.ratio, low, high, trial.errors.rmse, kind, label)


def _front_of(points: Sequence[Point]) -> list[Point]:
    """Return the points on the front, from the fastest on."""
    found = (point for point in points if point.is_on_front)
    return sorted(found, key=lambda point: (point.time, point.error))


@contextmanager
def new_figure(points: tuple[float, float]) -> Iterator[Figure]:
    """Give an empty figure of so many points, drawn with matplotlib's own defaults."""
    require_extra("matplotlib")
    import matplotlib
    import matplotlib.style
    from matplotlib.figure import Figure

    own = {"svg.fonttype": "path", "svg.hashsalt": "rasterjit", "font.size": 9.0}
    with warnings.catch_warnings(), matplotlib.style.context("default"), matplotlib.rc_context(own):
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        # One point is one dot, so what is measured of letters is in points.
        yield Figure(figsize=(points[0] / 72.0, points[1] / 72.0), dpi=72.0, facecolor="none")


def add_axes(figure: Figure, width: float, above: float = 0.0) -> Axes:
    """Return axes with fixed margins in the left ``width`` points of a figure."""
    total, height = (72.0 * inches for inches in figure.get_size_inches())
    inner = width - LEFT - RIGHT, height - BOTTOM - TOP - above
    box = LEFT / total, BOTTOM / height, inner[0] / total, inner[1] / height
    axes = figure.add_axes(box, facecolor="none")
    axes.set_axisbelow(True)
    return axes


def draw_points(axes: Axes, points: Sequence[Point], seconds: float) -> dict[Point, float]:
    """
    Draw points, a line through the front with the spread of its times, axes and labels.

    Returns
    -------
    dict
        At which error each point is drawn: none is zero, which a logarithmic axis does not have.
    """
    low, high, zero = _error_scale([point.error for point in points])
    heights = [point.error if point.error > 0.0 else zero for point in points]
    places = dict(zip(points, heights, strict=True))
    _scale_times(axes, points, seconds)
    _scale_errors(axes, low, high, zero if min(p.error for p in points) <= 0.0 else None)
    line = [(point.time, places[point]) for point in _front_of(points)]
    if len(line) > 1:
        axes.plot(*zip(*line, strict=True), color=LIGHT["level"], linewidth=0.9, alpha=0.55)
    kinds = list(MARKS)
    for point in sorted(points, key=lambda p: kinds.index(p.kind)):
        _draw_point(axes, point, places[point])
    place_labels(
        axes,
        [(p.time, places[p], p.label, LIGHT[MARKS[p.kind].text]) for p in points],
        bars=[(p.low, p.high, places[p]) for p in points if MARKS[p.kind].bar_alpha > 0.0],
        line=line,
        halo=LIGHT["page"],
    )
    return places


def _draw_point(axes: Axes, point: Point, height: float) -> None:
    """Draw one marker, and a bar from the lower to the upper quartile of its times."""
    mark = MARKS[point.kind]
    order = 2.0 + 0.1 * list(MARKS).index(point.kind)
    if mark.bar_alpha > 0.0:
        axes.plot(
            [point.low, point.high], [height, height], color=LIGHT[mark.edge], linewidth=1.0,
            marker="|", markersize=mark.points, zorder=order, alpha=mark.bar_alpha,
        )  # fmt: skip
    axes.plot(
        [point.time], [height], color=LIGHT[mark.edge], marker=mark.marker, markersize=mark.points,
        markeredgecolor=LIGHT[mark.edge], markerfacecolor=LIGHT[mark.fill], zorder=order + 0.05,
    )  # fmt: skip


def _error_scale(errors: Sequence[float]) -> tuple[float, float, float]:
    """Return the limits of errors above zero, and where below them those of zero are shown."""
    positive = [error for error in errors if error > 0.0]
    low, high = log_limits(positive or [1e-3], MIN_ERRORS, 0.1)
    return low, high, low * (high / low) ** (-0.5 * ZERO_BAND)


def _scale_errors(axes: Axes, low: float, high: float, zero: float | None) -> None:
    """Set up the logarithmic axis of errors, with a band below it where some are zero."""
    ticks = log_ticks(low, high)
    labels = [number(tick) for tick in ticks]
    axes.set_yscale("log")
    if zero is not None:
        ticks, labels = [zero, *ticks], ["0", *labels]
        axes.axhline(low, color=LIGHT["muted"], linewidth=0.8, linestyle=(0, (2, 2)))
    axes.set_ylim(low if zero is None else low * (high / low) ** -ZERO_BAND, high)
    axes.set_yticks(ticks, labels=labels)
    axes.set_yticks([], minor=True)
    axes.set_ylabel(ERROR_TITLE, color=LIGHT["ink"])
    _style_axis(axes)


def _scale_times(axes: Axes, points: Sequence[Point], seconds: float) -> None:
    """Set up the logarithmic axis of times: over the standard's below, milliseconds above."""
    times = [point.time for point in points]
    for point in points:
        if MARKS[point.kind].bar_alpha > 0.0:
            times += point.low, point.high
    low, high = log_limits(times, MIN_TIMES, 0.1)
    ticks = log_ticks(low, high)
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.set_xticks(ticks, labels=[f"{number(tick)}×" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlabel(TIME_TITLE, color=LIGHT["ink"])
    above = axes.secondary_xaxis("top")
    above.set_xticks(ticks, labels=[duration(float(f"{seconds * tick:.2g}")) for tick in ticks])
    above.set_xticks([], minor=True)
    _style_axis(above)


def _style_axis(axes: Any) -> None:
    """Give an axis the colours of the page, thin lines, and a grid."""
    axes.tick_params(colors=LIGHT["muted"], labelcolor=LIGHT["ink"], which="both", width=0.8)
    for spine in axes.spines.values():
        spine.set(color=LIGHT["muted"], linewidth=0.8)
    axes.grid(visible=True, color=LIGHT["grid"], linewidth=0.6)


def _as_svg(figure: Figure, prefix: str, described: str) -> str:
    """Return a figure as an SVG element for a page: its ids prefixed, its colours variables."""
    buffer = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(buffer, format="svg", metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    box = re.search(r'viewBox="[^"]*"', text)
    inside = text[text.index(">") + 1 : text.rindex("</svg>")]
    inside = re.sub(r"<(metadata|style).*?</\1>|<!--.*?-->", "", inside, flags=re.DOTALL)
    inside = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{prefix}", inside)
    for name, color in LIGHT.items():
        inside = inside.replace(color, f"var(--{name})")
    inside = re.sub(r">\s+<", ">\n<", inside)
    spoken = html.escape(described)
    return f'<svg class="plot" {box.group(0)} role="img" aria-label="{spoken}">{inside}</svg>'


class PlotArea(NamedTuple):
    """A rectangle, points from the lower left of the figure."""

    left: float
    bottom: float
    right: float
    top: float

    def common(self, other: PlotArea) -> bool:
        """Return whether two boxes share some area."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.bottom < other.top
            and other.bottom < self.top
        )

    def within(self, other: PlotArea) -> bool:
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
) -> list[PlotArea]:
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
    list of PlotArea
        What the labels take, for each point that has one.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    renderer = FigureCanvasAgg(axes.figure).get_renderer()
    to_points = axes.transData.transform
    frame = PlotArea(*axes.bbox.extents)
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
    frame: PlotArea,
    solid: Sequence[PlotArea],
    soft: Sequence[PlotArea],
) -> tuple[float, PlotArea]:
    """Return the place beside (x, y) that costs least, and its distance."""
    best = math.inf, 0.0, PlotArea(x, y, x, y)
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
) -> PlotArea:
    """Return the box of a label whose nearest edge or corner is ``distance`` from a point."""
    length = math.hypot(*direction)
    centre_x = x + distance * direction[0] / length + _sign(direction[0]) * 0.5 * size[0]
    centre_y = y + distance * direction[1] / length + _sign(direction[1]) * 0.5 * size[1]
    return _around(centre_x, centre_y, 0.5 * size[0], 0.5 * size[1])


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)


def _around(x: float, y: float, half_width: float, half_height: float) -> PlotArea:
    return PlotArea(x - half_width, y - half_height, x + half_width, y + half_height)


def _bar(start: Sequence[float], end: Sequence[float]) -> PlotArea:
    """Return what a horizontal bar takes."""
    return PlotArea(start[0], start[1] - BAR, end[0], end[1] + BAR)


def _along(corners: Sequence[tuple[float, float]]) -> list[PlotArea]:
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
    box: PlotArea,
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
