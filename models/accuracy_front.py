"""Draw the Pareto front of an accuracy study as a picture of its own, with a list of its points."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rasterjit.accuracy.report.plots import (
    LIGHT_COLORS,
    MARGIN_BOTTOM,
    MARGIN_LEFT,
    MARGIN_TOP,
    add_axes,
    draw_points,
    make_plot_points,
    new_figure,
    require_extra,
)
from rasterjit.accuracy.results import Study, list_front_trials
from rasterjit.accuracy.sentences import describe_factor, format_number
from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.images import check_save_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE_POINTS = (440.0, 370.0)
"""Width and least height of the part with the plot, points."""

KEY_POINTS = 280.0
"""Width of the list beside the plot, points."""

KEY_LINE, KEY_LETTERS = 12.5, 50
"""Height of a line of the list, points, and the letters that fit in it."""

DOTS_PER_INCH = 160

TITLE = 24.0
"""Height of the title above the plot, points."""


class KeyLine(NamedTuple):
    """A line of the list beside the front: a number or nothing, text, and its colour by name."""

    number: str
    text: str
    color: str


def save_front(study: Study, path: str | Path) -> Path:
    """
    Write the Pareto front of a study as a picture with a list of what its numbers stand for.

    Parameters
    ----------
    study : Study
    path : str or Path
        Ends in ``.png``. An existing file is replaced, or left as it was on failure.

    Raises
    ------
    ValueError
        If the folder does not exist, the extension is another, or matplotlib is not installed.
    OSError
        If the file cannot be written.
    """
    require_extra("matplotlib")
    place = check_save_path(path, (".png",))
    points = make_plot_points(study)
    lines = _key_lines(study)
    width, height = PICTURE_POINTS
    height = max(height, len(lines) * KEY_LINE + MARGIN_TOP + TITLE + MARGIN_BOTTOM + 30.0)
    with new_figure((width + KEY_POINTS, height)) as figure:
        figure.patch.set_facecolor(LIGHT_COLORS["page"])
        axes = add_axes(figure, width, above=TITLE)
        draw_points(axes, points, study.standard.median)
        _write_key(figure, study, lines)
        with atomic_file(place) as temporary:
            figure.savefig(temporary, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
    return place


def _key_lines(study: Study) -> list[KeyLine]:
    """Return the lines of the list beside the front."""
    lines = []
    for n, trial in enumerate(list_front_trials(study), 1):
        named = textwrap.wrap(trial.label, KEY_LETTERS, break_on_hyphens=False)
        for first, text in enumerate(named):
            lines.append(KeyLine("" if first else str(n), text, "ink"))
        found = f"{describe_factor(trial)} the time, RMSE {format_number(trial.errors.rmse)}"
        lines.append(KeyLine("", found, "muted"))
    return lines


def _write_key(figure: Figure, study: Study, lines: Sequence[KeyLine]) -> None:
    """Write the title, the list of what numbers stand for, and what the marks mean."""
    total, height = (72.0 * inches for inches in figure.get_size_inches())

    def write(x: float, y: float, text: str, color: str, **options: Any) -> None:
        at = x / total, 1.0 - y / height
        figure.text(
            *at, text, color=LIGHT_COLORS[color], parse_math=False, va="baseline", **options
        )

    columns, rows = study.size
    scene = textwrap.shorten(study.scene, 40)
    title = f"Error against time: {scene}, {columns} × {rows}, {study.threads} threads"
    write(MARGIN_LEFT, 20.0, title, "ink", fontsize=11.0)
    left, y = PICTURE_POINTS[0] + 20.0, MARGIN_TOP + TITLE + 8.0
    for line in lines:
        write(left - 6.0, y, line.number, "level", ha="right", fontweight="bold")
        write(left, y, line.text, line.color, fontsize=8.0)
        y += KEY_LINE
    for below, text in (
        (40.0, "numbered: each is more accurate than all faster ones"),
        (28.0, "circles: all else; crosses: times not measured well enough"),
        (16.0, "bars: lower to upper quartile of the times"),
    ):
        write(left, height - below, text, "muted", fontsize=7.0)
