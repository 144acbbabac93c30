"""
Plot error against time of all trials, with the Pareto front.

Both axes are logarithmic. Labels are placed so that they cover neither each other nor a point.

Plots are inline SVG whose colours are custom properties of the page's style sheet, so they follow
its light and dark scheme; letters are outlines, so they look alike everywhere.

matplotlib is imported where something is drawn, and its global state stays as it was.
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
from rasterjit.accuracy.results import Study, Trial, list_front_trials
from rasterjit.accuracy.sentences import format_duration, format_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TICK_MANTISSAS = ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7))
"""Ticks in each decade, from the sparsest choice on."""

TICK_STEPS = (1.0, 2.0, 2.5, 5.0)
"""Distances of evenly spaced ticks, times a power of ten."""

MIN_TICK_GAP = 0.135
"""Least distance of two ticks, as a share of the axis, so that labels do not touch."""

MIN_LOG_TICKS_RATIO = 3.0
"""Ratio of the ends of an axis from which ticks are multiples of powers of ten."""

TICK_FREE_END = 0.03
"""Share of the axis at each end without ticks, whose labels would stick out."""


def find_log_limits(
    values: Sequence[float], min_ratio: float, margin: float
) -> tuple[float, float]:
    """
    Return the ends of a logarithmic axis.

    Parameters
    ----------
    values : sequence of float
        Values on the axis; all above 0, at least one.
    min_ratio : float
        Least ratio of the ends, before the margin.
    margin : float
        Share of its length that is added at each end.
    """
    low, high = math.log(min(values)), math.log(max(values))
    missing = max(math.log(min_ratio) - (high - low), 0.0)
    low, high = low - 0.5 * missing, high + 0.5 * missing
    log_margin = margin * (high - low)
    return math.exp(low - log_margin), math.exp(high + log_margin)


def find_log_ticks(low: float, high: float) -> list[float]:
    """Return one to eight round numbers within a logarithmic axis, well apart."""
    length = math.log(high / low)
    low, high = low * math.exp(TICK_FREE_END * length), high * math.exp(-TICK_FREE_END * length)
    if high / low < MIN_LOG_TICKS_RATIO:
        return _find_even_ticks(low, high, MIN_TICK_GAP * length)
    choices = [_find_decade_ticks(low, high, mantissas) for mantissas in TICK_MANTISSAS]
    fitting = [ticks for ticks in choices if _are_well_spaced(ticks, MIN_TICK_GAP * length)]
    if fitting:
        return fitting[-1]
    # Too many decades for a tick at each.
    return choices[0][:: math.ceil(MIN_TICK_GAP * length / math.log(10.0))]


def _find_decade_ticks(low: float, high: float, mantissas: Sequence[float]) -> list[float]:
    """Return the given multiples of powers of ten that lie within low..high."""
    decades = range(math.floor(math.log10(low)), math.floor(math.log10(high)) + 1)
    ticks = [float(f"{mantissa}e{decade}") for decade in decades for mantissa in mantissas]
    return [tick for tick in ticks if low <= tick <= high]


def _find_even_ticks(low: float, high: float, min_log_gap: float) -> list[float]:
    """Return the multiples of the smallest round step that are well spaced."""
    decade = math.floor(math.log10(high - low)) - 1
    choices = [
        [k * step * 10.0**power for k in _multiples(low, high, step * 10.0**power)]
        for power in (decade, decade + 1)
        for step in TICK_STEPS
    ]
    fitting = [ticks for ticks in choices if _are_well_spaced(ticks, min_log_gap)]
    return [float(f"{tick:.12g}") for tick in fitting[0]]


def _multiples(low: float, high: float, step: float) -> range:
    """Return the whole numbers of steps that lie within low..high."""
    return range(math.ceil(low / step), math.floor(high / step) + 1)


def _are_well_spaced(ticks: Sequence[float], min_log_gap: float) -> bool:
    """Tell whether the logarithms of neighbours differ by at least ``min_log_gap``."""
    return all(math.log(b / a) >= min_log_gap for a, b in itertools.pairwise(ticks))


PAGE_MODULES = ("matplotlib", "jinja2")
"""Modules of the extra ``accuracy`` that the page needs: for plots, and for its template."""

LIGHT_COLORS = {
    "page": "#ffffff", "ink": "#1b1f24", "muted": "#6b7280", "grid": "#d9dde2",
    "level": "#0072b2", "standard": "#d55e00",
}  # fmt: skip
"""Colours on a light page; blue and vermilion are told apart with any colour vision."""

DARK_COLORS = {
    "page": "#14171a", "ink": "#e6e9ed", "muted": "#9aa3ae", "grid": "#363c44",
    "level": "#56b4e9", "standard": "#ff9a4d",
}  # fmt: skip
"""Colours on a dark page."""

PLOT_SIZE = (360.0, 290.0)
"""Width and height of the plot, points: letters stay legible on the width of a phone."""

MARGIN_LEFT, MARGIN_RIGHT, MARGIN_BOTTOM, MARGIN_TOP = 52.0, 12.0, 40.0, 26.0
"""Margins around the axes, points."""

MIN_TIME_RATIO, MIN_ERROR_RATIO = 1.25, 3.0
"""Least ratio of an axis' end to its start, so that noise does not look large."""

ZERO_BAND = 0.16
"""Share of the height below the logarithmic axis where errors of zero are shown."""

ERROR_TITLE = "RMSE against the reference, linear light"
TIME_TITLE = "time of a frame, standard = 1"

LABEL_DISTANCES = (7.0, 13.0, 21.0, 32.0, 46.0, 62.0, 80.0)
"""Distances from a point to the edge of its label, points, from the best on."""

LABEL_DIRECTIONS = (
    (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1),
    (2, 1), (2, -1), (-2, 1), (-2, -1), (1, 2), (1, -2), (-1, 2), (-1, -2),
)  # fmt: skip
"""Directions from a point to its label, from the best on."""

MIN_LEADER_LENGTH = 12.0
"""Least distance from which a thin line leads to the label, points."""

MARKER_HALF_SIZE, BAR_HALF_HEIGHT = 5.0, 2.5
"""Half the side of a marker's box, and half the height of a bar's, points."""

LINE_BOX_SPACING = 4.0
"""Distance of the boxes along a line that labels keep clear of, points."""

COVERING_COST, CROSSING_COST = 1000.0, 30.0
"""Costs of a label that covers another label, a marker or the frame, and of one that crosses a bar
or the line."""


class PlotPoint(NamedTuple):
    """One trial in a plot."""

    time: float
    """Median time over the standard's."""
    low: float
    """Lower quartile of these times."""
    high: float
    """Upper quartile."""
    error: float
    kind: str
    """Key of `MARKER_STYLES`."""
    label: str

    @property
    def is_on_front(self) -> bool:
        """Whether its label is a rank on the front."""
        return self.label[:1].isdigit()


class Plot(NamedTuple):
    """A plot for a page."""

    svg: str
    positions: dict[str, tuple[float, float]]
    """Marker of each trial, by label: shares of width and height from the upper left corner."""


class MarkerStyle(NamedTuple):
    """Style of one kind of point; colours are keys of `LIGHT_COLORS`."""

    marker: str
    diameter: float
    """Points of length."""
    edge: str
    fill: str
    text: str
    bar_alpha: float


MARKER_STYLES = {
    "rough": MarkerStyle("x", 4.5, "muted", "muted", "muted", 0.0),
    "other": MarkerStyle("o", 4.5, "muted", "page", "muted", 0.0),
    "level": MarkerStyle("o", 6.5, "level", "level", "ink", 1.0),
    "standard": MarkerStyle("D", 7.0, "standard", "standard", "ink", 1.0),
}
"""Styles of the kinds of points, from the one at the back on."""


def require_extra(*modules: str) -> None:
    """Raise ``ValueError`` saying what to install where a module of the extra is missing."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise ValueError(
                f'the report of an accuracy study needs {module}; pip install "rasterjit[accuracy]"'
            )


def plot_front(study: Study, prefix: str) -> Plot:
    """
    Plot error against time of all trials, those on the front numbered.

    Parameters
    ----------
    study : Study
    prefix : str
        Start of the ids of the SVG.

    Returns
    -------
    Plot
    """
    points = make_plot_points(study)
    width, height = PLOT_SIZE
    with new_figure(PLOT_SIZE) as figure:
        axes = add_axes(figure, width)
        heights = draw_points(axes, points, study.standard.median)
        trials = (*study.trials, study.standard)
        positions = {}
        for trial, point in zip(trials, points, strict=True):
            x, y = axes.transData.transform((point.time, heights[point]))
            positions[trial.label] = float(x) / width, 1.0 - float(y) / height
        text = f"Error against time of {len(points)} qualities; those on the front are numbered"
        return Plot(_format_svg(figure, prefix, text), positions)


def make_plot_points(study: Study) -> list[PlotPoint]:
    """Return a point for each trial, the standard last; the label is the rank on the front."""
    numbers = {id(trial): str(n) for n, trial in enumerate(list_front_trials(study), 1)}
    points = []
    for trial in study.trials:
        label = numbers.get(id(trial), "")
        kind = "level" if label else "other" if is_measured(trial) else "rough"
        points.append(_make_point(trial, kind, label))
    label = f"{numbers.get(id(study.standard), '')} standard".strip()
    points.append(_make_point(study.standard, "standard", label))
    return points


def _make_point(trial: Trial, kind: str, label: str) -> PlotPoint:
    low, high = trial.spread
    return PlotPoint(trial.ratio, low, high, trial.errors.rmse, kind, label)


def _sort_front_points(points: Sequence[PlotPoint]) -> list[PlotPoint]:
    """Return the points on the front, from the fastest on."""
    front = (point for point in points if point.is_on_front)
    return sorted(front, key=lambda point: (point.time, point.error))


@contextmanager
def new_figure(size: tuple[float, float]) -> Iterator[Figure]:
    """Yield an empty figure, size in points, drawn with matplotlib's defaults."""
    require_extra("matplotlib")
    import matplotlib
    import matplotlib.style
    from matplotlib.figure import Figure

    rc = {"svg.fonttype": "path", "svg.hashsalt": "rasterjit", "font.size": 9.0}
    with warnings.catch_warnings(), matplotlib.style.context("default"), matplotlib.rc_context(rc):
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        # One point is one dot, so extents of texts are in points.
        yield Figure(figsize=(size[0] / 72.0, size[1] / 72.0), dpi=72.0, facecolor="none")


def add_axes(figure: Figure, width: float, above: float = 0.0) -> Axes:
    """Return axes with fixed margins in the left ``width`` points of a figure."""
    total, height = (72.0 * inches for inches in figure.get_size_inches())
    inner = width - MARGIN_LEFT - MARGIN_RIGHT, height - MARGIN_BOTTOM - MARGIN_TOP - above
    box = MARGIN_LEFT / total, MARGIN_BOTTOM / height, inner[0] / total, inner[1] / height
    axes = figure.add_axes(box, facecolor="none")
    axes.set_axisbelow(True)
    return axes


def draw_points(axes: Axes, points: Sequence[PlotPoint], seconds: float) -> dict[PlotPoint, float]:
    """
    Draw points, a line through the front with the spread of its times, axes and labels.

    Returns
    -------
    dict
        Error at which each point is drawn: above zero, which a logarithmic axis does not have.
    """
    low, high, zero = _find_error_limits([point.error for point in points])
    heights = {point: point.error if point.error > 0.0 else zero for point in points}
    _set_up_time_axis(axes, points, seconds)
    _set_up_error_axis(axes, low, high, zero if min(p.error for p in points) <= 0.0 else None)
    line = [(point.time, heights[point]) for point in _sort_front_points(points)]
    if len(line) > 1:
        axes.plot(*zip(*line, strict=True), color=LIGHT_COLORS["level"], linewidth=0.9, alpha=0.55)
    kinds = list(MARKER_STYLES)
    for point in sorted(points, key=lambda p: kinds.index(p.kind)):
        _draw_point(axes, point, heights[point])
    place_labels(
        axes,
        [(p.time, heights[p], p.label, LIGHT_COLORS[MARKER_STYLES[p.kind].text]) for p in points],
        bars=[(p.low, p.high, heights[p]) for p in points if MARKER_STYLES[p.kind].bar_alpha > 0.0],
        line=line,
        halo=LIGHT_COLORS["page"],
    )
    return heights


def _draw_point(axes: Axes, point: PlotPoint, height: float) -> None:
    """Draw one marker, and a bar from the lower to the upper quartile of its times."""
    style = MARKER_STYLES[point.kind]
    edge, fill = LIGHT_COLORS[style.edge], LIGHT_COLORS[style.fill]
    order = 2.0 + 0.1 * list(MARKER_STYLES).index(point.kind)
    if style.bar_alpha > 0.0:
        axes.plot(
            [point.low, point.high], [height, height], color=edge, linewidth=1.0,
            marker="|", markersize=style.diameter, zorder=order, alpha=style.bar_alpha,
        )  # fmt: skip
    axes.plot(
        [point.time], [height], color=edge, marker=style.marker, markersize=style.diameter,
        markeredgecolor=edge, markerfacecolor=fill, zorder=order + 0.05,
    )  # fmt: skip


def _find_error_limits(errors: Sequence[float]) -> tuple[float, float, float]:
    """Return the limits of errors above zero, and the height below them for errors of zero."""
    positive = [error for error in errors if error > 0.0]
    low, high = find_log_limits(positive or [1e-3], MIN_ERROR_RATIO, 0.1)
    return low, high, low * (high / low) ** (-0.5 * ZERO_BAND)


def _set_up_error_axis(axes: Axes, low: float, high: float, zero: float | None) -> None:
    """Set up the logarithmic axis of errors, with a band below it for errors of zero, if any."""
    ticks = find_log_ticks(low, high)
    labels = [format_number(tick) for tick in ticks]
    axes.set_yscale("log")
    if zero is not None:
        ticks, labels = [zero, *ticks], ["0", *labels]
        axes.axhline(low, color=LIGHT_COLORS["muted"], linewidth=0.8, linestyle=(0, (2, 2)))
    axes.set_ylim(low if zero is None else low * (high / low) ** -ZERO_BAND, high)
    axes.set_yticks(ticks, labels=labels)
    axes.set_yticks([], minor=True)
    axes.set_ylabel(ERROR_TITLE, color=LIGHT_COLORS["ink"])
    _style_axis(axes)


def _set_up_time_axis(axes: Axes, points: Sequence[PlotPoint], seconds: float) -> None:
    """Set up the logarithmic axes of times: over the standard's below, durations above."""
    times = [point.time for point in points]
    for point in points:
        if MARKER_STYLES[point.kind].bar_alpha > 0.0:
            times += point.low, point.high
    low, high = find_log_limits(times, MIN_TIME_RATIO, 0.1)
    ticks = find_log_ticks(low, high)
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.set_xticks(ticks, labels=[f"{format_number(tick)}×" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlabel(TIME_TITLE, color=LIGHT_COLORS["ink"])
    top_axis = axes.secondary_xaxis("top")
    durations = [format_duration(float(f"{seconds * tick:.2g}")) for tick in ticks]
    top_axis.set_xticks(ticks, labels=durations)
    top_axis.set_xticks([], minor=True)
    _style_axis(top_axis)


def _style_axis(axes: Any) -> None:
    """Give an axis the colours of the page, thin lines, and a grid."""
    axes.tick_params(
        colors=LIGHT_COLORS["muted"], labelcolor=LIGHT_COLORS["ink"], which="both", width=0.8
    )
    for spine in axes.spines.values():
        spine.set(color=LIGHT_COLORS["muted"], linewidth=0.8)
    axes.grid(visible=True, color=LIGHT_COLORS["grid"], linewidth=0.6)


def _format_svg(figure: Figure, prefix: str, description: str) -> str:
    """Return a figure as an SVG element with prefixed ids and colours from the style sheet."""
    buffer = io.StringIO()
    no_metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(buffer, format="svg", metadata=no_metadata)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    view_box = re.search(r'viewBox="[^"]*"', svg)
    inner = svg[svg.index(">") + 1 : svg.rindex("</svg>")]
    inner = re.sub(r"<(metadata|style).*?</\1>|<!--.*?-->", "", inner, flags=re.DOTALL)
    inner = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{prefix}", inner)
    for name, color in LIGHT_COLORS.items():
        inner = inner.replace(color, f"var(--{name})")
    inner = re.sub(r">\s+<", ">\n<", inner)
    label = html.escape(description)
    return f'<svg class="plot" {view_box.group(0)} role="img" aria-label="{label}">{inner}</svg>'


class PlotBox(NamedTuple):
    """A rectangle, points from the lower left of the figure."""

    left: float
    bottom: float
    right: float
    top: float

    def overlaps(self, other: PlotBox) -> bool:
        """Return whether two boxes have common area."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.bottom < other.top
            and other.bottom < self.top
        )

    def lies_within(self, other: PlotBox) -> bool:
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
) -> list[PlotBox]:
    """
    Write the labels of points beside them.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With its final limits, in a figure of 72 dots per inch.
    points : sequence of (x, y, label, color)
        All markers, in data coordinates; a label may be empty.
    bars : sequence of (low, high, y)
        Horizontal bars that labels avoid.
    line : sequence of (x, y)
        Corners of a line that labels avoid.
    halo : str
        Colour around the letters.

    Returns
    -------
    list of PlotBox
        The box of each label that is not empty.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    renderer = FigureCanvasAgg(axes.figure).get_renderer()
    to_points = axes.transData.transform
    frame = PlotBox(*axes.bbox.extents)
    centres = [tuple(to_points((x, y))) for x, y, _, _ in points]
    obstacles = [_centered_box(x, y, MARKER_HALF_SIZE, MARKER_HALF_SIZE) for x, y in centres]
    crossings = [_bar_box(to_points((low, y)), to_points((high, y))) for low, high, y in bars]
    crossings += _line_boxes([tuple(to_points(corner)) for corner in line])
    label_boxes = []
    for (x, y), (_, _, label, color) in zip(centres, points, strict=True):
        if label:
            size = _measure_text(axes, renderer, label)
            distance, box = _find_best_box(x, y, size, frame, obstacles, crossings)
            _write_label(axes, (x, y), box, label, color, halo, distance >= MIN_LEADER_LENGTH)
            obstacles.append(box)
            label_boxes.append(box)
    return label_boxes


def _measure_text(axes: Axes, renderer: object, label: str) -> tuple[float, float]:
    """Return width and height of a text, points."""
    text = axes.text(0.0, 0.0, label, parse_math=False)
    extent = text.get_window_extent(renderer)
    text.remove()
    return extent.width, extent.height


def _find_best_box(
    x: float,
    y: float,
    size: tuple[float, float],
    frame: PlotBox,
    obstacles: Sequence[PlotBox],
    crossings: Sequence[PlotBox],
) -> tuple[float, PlotBox]:
    """Return distance and box of the cheapest label beside the point (x, y)."""
    best = math.inf, 0.0, PlotBox(x, y, x, y)
    for distance in LABEL_DISTANCES:
        for rank, direction in enumerate(LABEL_DIRECTIONS):
            box = _label_box(x, y, size, distance, direction)
            cost = distance + 0.25 * rank
            if cost < best[0]:
                cost += COVERING_COST * (not box.lies_within(frame))
                cost += COVERING_COST * sum(box.overlaps(other) for other in obstacles)
                cost += CROSSING_COST * any(box.overlaps(other) for other in crossings)
                best = min(best, (cost, distance, box), key=lambda candidate: candidate[0])
    return best[1:]


def _label_box(
    x: float, y: float, size: tuple[float, float], distance: float, direction: tuple[int, int]
) -> PlotBox:
    """Return the box of a label whose nearest edge or corner is ``distance`` from a point."""
    length = math.hypot(*direction)
    centre_x = x + distance * direction[0] / length + _sign(direction[0]) * 0.5 * size[0]
    centre_y = y + distance * direction[1] / length + _sign(direction[1]) * 0.5 * size[1]
    return _centered_box(centre_x, centre_y, 0.5 * size[0], 0.5 * size[1])


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)


def _centered_box(x: float, y: float, half_width: float, half_height: float) -> PlotBox:
    return PlotBox(x - half_width, y - half_height, x + half_width, y + half_height)


def _bar_box(start: Sequence[float], end: Sequence[float]) -> PlotBox:
    return PlotBox(start[0], start[1] - BAR_HALF_HEIGHT, end[0], end[1] + BAR_HALF_HEIGHT)


def _line_boxes(corners: Sequence[tuple[float, float]]) -> list[PlotBox]:
    """Return small boxes along a line through some corners."""
    boxes = []
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        steps = 1 + int(math.hypot(x1 - x0, y1 - y0) / LINE_BOX_SPACING)
        for k in range(steps + 1):
            share = k / steps
            boxes.append(_centered_box(x0 + share * (x1 - x0), y0 + share * (y1 - y0), 1.0, 1.0))
    return boxes


def _write_label(
    axes: Axes,
    point: tuple[float, float],
    box: PlotBox,
    label: str,
    color: str,
    halo: str,
    with_leader: bool,
) -> None:
    """Write a label into its box, with a thin line from its point if ``with_leader``."""
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
