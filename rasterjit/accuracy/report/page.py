"""
Write a study as one HTML page: the answer, an interactive plot, tables and pictures.

The page loads nothing: pictures are in it as ``data:`` addresses, the plot as inline SVG, style and
script as text. The same study makes the same bytes. ``page.html`` is its Jinja template.
"""

from __future__ import annotations

import math
import os
import statistics
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.accuracy.choice import choose, is_measured, is_slower
from rasterjit.accuracy.report import plots
from rasterjit.accuracy.report.picture_crops import encode_webp_uri, make_album, make_thumbnail
from rasterjit.accuracy.results import (
    COMBINATIONS,
    CPU,
    STANDARD,
    WALL,
    Study,
    Trial,
    find_standard_level,
    insert_standard,
    list_front_trials,
    list_settings,
)
from rasterjit.accuracy.sentences import (
    NOT_MEASURED,
    compare_errors,
    describe_alternatives,
    describe_certainty,
    describe_choice,
    describe_factor,
    format_duration,
    format_factor,
    format_number,
    format_options,
)
from rasterjit.io.atomic_write import write_text

PAGE_NAME = "index.html"

NO_VALUE = "–"
"""Text in place of a number without meaning."""

MAX_CROP_WIDTH_DESKTOP, MAX_CROP_WIDTH_PHONE = 480, 336
"""Largest width of an enlarged crop of a picture, CSS pixels."""

TIME_NOTES = {
    WALL: "Times are medians, each over the standard’s time in the same round.",
    CPU: "Times are what all threads together worked for a frame: medians of the least half.",
}
"""How times were taken, by the clock."""

RESULT_COLUMNS = (
    ("time", "standard = 1"),
    ("ms", ""),
    ("RMSE", "linear light"),
    ("largest", "linear light"),
    ("PSNR", "dB"),
    ("FLIP", "mean"),
    ("wrong faces", "pixels"),
    ("depth", "largest, ulp"),
    ("depth", "scene units"),
    ("uv", "largest, texels"),
)
"""Columns of the table of results, with their units."""


Cell = tuple[str, str]
"""Text of a cell of a table, and its subtitle in small letters."""


class TableRow(NamedTuple):
    """A row of a table."""

    css_class: str
    name: str
    cells: list[Cell]
    trial: Trial | None = None
    """Trial whose picture a press on the name shows."""
    front_rank: int | None = None
    """Position on the Pareto front, from 1 on."""
    subtitle: str = ""
    """Small text below the name."""


class TableGroup(NamedTuple):
    """Rows of a table, with an optional title above them and small text beside it."""

    rows: list[TableRow]
    title: str = ""
    subtitle: str = ""


def write_page(study: Study, folder: str | Path, sentences: dict[str, str]) -> Path:
    """
    Write the page of a study, whole or not at all.

    Parameters
    ----------
    study : Study
        Finished or interrupted: what is missing is named.
    folder : str or Path
        Where ``index.html`` goes; made if it does not exist.
    sentences : dict of str
        For settings, what their levels cost and buy, in words.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        If ``folder`` is not a folder, or something of the extra ``accuracy`` is not installed.
    OSError
        If the folder or the file cannot be written; a page that was there is left as it was.
    """
    plots.require_extra(*plots.PAGE_MODULES)
    if not isinstance(folder, (str, os.PathLike)):
        raise ValueError(f"folder must be the name of a folder, got {folder!r}")
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"folder must be a folder, got {str(folder)!r}, which is a file")
    html = render_page(study, sentences)
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / PAGE_NAME, html)
    return folder / PAGE_NAME


def render_page(study: Study, sentences: dict[str, str]) -> str:
    """Return the page of a study as HTML; see `write_page`."""
    # Part of the extra ``accuracy``.
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(read_template), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    environment.globals |= {
        function.__name__: function
        for function in (
            count_noun, describe_alternatives, describe_certainty, describe_choice,
            describe_trial, format_css_variables, format_duration, format_number, format_options,
            split_label,
        )
    }  # fmt: skip
    return environment.get_template("page.html").render(_list_variables(study, sentences))


def read_template(name: str) -> str:
    """Return the text of a template, style sheet or script of the page."""
    return resources.files("rasterjit.accuracy.report").joinpath(name).read_text(encoding="utf-8")


def _list_variables(study: Study, sentences: dict[str, str]) -> dict[str, Any]:
    """Return the variables of the template, by name."""
    album, (columns, rows) = make_album(study), study.size
    crop_width, front = album.size[0], list_front_trials(study)
    result_columns, results = make_results_table(study)
    without = {name: f"changes nothing here: {why}." for name, why in study.without_effect.items()}
    return {
        "study": study,
        "columns": columns,
        "rows": rows,
        "stroke": f"{columns / 80.0:.3g}",
        "thumbnail": encode_webp_uri(make_thumbnail(study.reference_color)),
        "album": album,
        "desktop_zoom": max(MAX_CROP_WIDTH_DESKTOP // crop_width, 1),
        "phone_zoom": max(MAX_CROP_WIDTH_PHONE // crop_width, 1),
        "light": plots.LIGHT_COLORS,
        "dark": plots.DARK_COLORS,
        "style": read_template("page.css"),
        "script": read_template("page.js"),
        "take": format_options(choose(study).trial, study.standard),
        "quartiles": _format_quartiles(study),
        "time_note": TIME_NOTES[study.clock],
        "plot": plots.plot_front(study, "front-"),
        "points": sorted((study.standard, *study.trials), key=lambda t: (t.ratio, t.label)),
        "labels": [trial.label for trial in front],
        "not_measured": NOT_MEASURED,
        "front": make_front_table(study, front),
        "effects": make_effects_table(study),
        "result_columns": result_columns,
        "results": results,
        "impossible": {f"not possible: {name}": why for name, why in study.impossible.items()},
        "sentences": {n: text for n, text in sentences.items() if n not in without} | without,
        "spread": _summarize_spread(study),
        "machine": {**study.machine, **study.versions},
    }


def format_css_variables(colors: dict[str, str]) -> str:
    """Return the colours of a plot as custom properties of the style sheet."""
    return " ".join(f"--{name}: {color};" for name, color in colors.items())


def count_noun(count: int, noun: str) -> str:
    """Return a count with its noun: ``1 round``, ``2 rounds``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def split_label(text: str) -> list[str]:
    """Return the parts of a label, or of options, that a line break may separate."""
    parts = text.split(" ")
    if not text.startswith("--"):
        return parts
    return [f"{option} {value}" for option, value in zip(parts[::2], parts[1::2], strict=True)]


def _format_quartiles(study: Study) -> str:
    """Return the quartiles of the standard's times: ``12 ms to 13 ms``; "" of one frame."""
    seconds = study.standard.seconds
    if len(seconds) < 2:
        return ""
    low, _, high = statistics.quantiles(seconds, n=4, method="inclusive")
    return " to ".join(dict.fromkeys((format_duration(low), format_duration(high))))


def describe_trial(study: Study, trial: Trial) -> str:
    """Return time and error of a trial, in words."""
    error = f"error {format_number(trial.errors.rmse)}"
    if trial.setting == STANDARD:
        return f"{format_duration(trial.median)}, {error}."
    against = compare_errors(trial, study.standard)
    if not is_measured(trial):
        rounds = count_noun(len(trial.ratios), "round")
        return (
            f"about {format_duration(trial.median)} ({NOT_MEASURED}, {rounds}); {error}, {against}."
        )
    time = f"{describe_factor(trial)} the time"
    if not is_slower(trial, study.standard) and not is_slower(study.standard, trial):
        time = "the standard’s time, as far as can be told"
    return f"{time}, {format_duration(trial.median)}; {error}, {against}."


def _make_factor_cell(trial: Trial) -> Cell:
    """Return a time over the standard's, and its range of uncertainty."""
    factor, _, uncertainty = describe_factor(trial).partition(" (")
    return factor, uncertainty[:-1]


def make_front_table(study: Study, front: list[Trial]) -> TableGroup:
    """Return the qualities on the front and the standard, from the fastest on."""
    standard = [] if study.standard in front else [study.standard]
    rows = []
    for trial in sorted([*front, *standard], key=lambda trial: trial.ratio):
        is_standard = trial.setting == STANDARD
        cells = [
            _make_factor_cell(trial),
            ("" if is_standard else compare_errors(trial, study.standard), ""),
            (format_duration(trial.median), ""),
            (format_number(trial.errors.rmse), ""),
        ]
        front_rank = front.index(trial) + 1 if trial in front else None
        options = "" if "=" in trial.label else format_options(trial, study.standard)
        css_class = STANDARD if is_standard else "level"
        rows.append(TableRow(css_class, trial.label, cells, trial, front_rank, options))
    return TableGroup(rows)


def make_effects_table(study: Study) -> list[TableGroup]:
    """Return times of each effect and errors against its own reference."""
    groups = []
    for cost in study.effects:
        standard_time = format_duration(study.standard.median)
        cells = [("1×", ""), (standard_time, ""), (_format_or_dash(cost.rmse), "")]
        rows = [TableRow(STANDARD, "as the scene says (standard)", cells)]
        for trial in cost.levels:
            time, error = format_duration(trial.median), format_number(trial.errors.rmse)
            cells = [_make_factor_cell(trial), (time, ""), (error, "")]
            rows.append(TableRow("level", trial.level, cells))
        groups.append(TableGroup(rows, cost.effect, f"reference: {cost.reference}"))
    return groups


def make_results_table(study: Study) -> tuple[list[Cell], list[TableGroup]]:
    """
    Return time and errors of all trials, without columns that have no values.

    Returns
    -------
    columns : list of (str, str)
        Of `RESULT_COLUMNS`.
    groups : list of TableGroup
        Settings, each with its levels and the standard; dominated levels are grey and name what
        dominates them.
    """
    by_setting = {setting: insert_standard(study, setting) for setting in list_settings(study)}
    if study.of(COMBINATIONS):
        by_setting[COMBINATIONS] = [study.standard, *study.of(COMBINATIONS)]
    front = [trial.label for trial in list_front_trials(study)]
    groups = []
    for setting, trials in by_setting.items():
        rows = []
        for trial in trials:
            is_standard = trial.setting == STANDARD
            css_class = "level" if trial.dominated_by is None else "dominated"
            rows.append(TableRow(
                STANDARD if is_standard else css_class,
                name_level(study, trial, setting),
                _make_result_cells(trial),
                trial,
                front.index(trial.label) + 1 if trial.label in front and not is_standard else None,
                "" if trial.dominated_by is None else f"dominated by {trial.dominated_by}",
            ))  # fmt: skip
        groups.append(TableGroup(rows, setting))
    cells = [row.cells for group in groups for row in group.rows]
    used = [n for n in range(len(RESULT_COLUMNS)) if any(row[n][0] != NO_VALUE for row in cells)]
    for group in groups:
        group.rows[:] = [row._replace(cells=[row.cells[n] for n in used]) for row in group.rows]
    return [RESULT_COLUMNS[n] for n in used], groups


def format_milliseconds(seconds: float) -> str:
    """Return seconds as milliseconds: three digits, or all before the point."""
    return format_number(1000.0 * seconds) if seconds < 0.9995 else f"{1000.0 * seconds:,.0f}"


def name_level(study: Study, trial: Trial, setting: str) -> str:
    """Return the name of a trial among the levels of a setting."""
    if trial.setting != STANDARD:
        return trial.level
    if setting == COMBINATIONS:
        return STANDARD
    return f"{find_standard_level(study, setting)} (standard)"


def _make_result_cells(trial: Trial) -> list[Cell]:
    """Return the cells of a trial's row, in the order of `RESULT_COLUMNS`."""
    low, high = trial.spread
    errors, median = trial.errors, format_milliseconds(trial.median)
    factor, median_text = ("", NOT_MEASURED), f"≈ {median}"
    if trial.setting == STANDARD or is_measured(trial):
        spread = f"{format_factor(low)}–{format_factor(high)}" if low < high else ""
        factor, median_text = (f"{format_factor(trial.ratio)}×", spread), median
    return [factor] + [(text, "") for text in (
        median_text,
        format_number(errors.rmse),
        format_number(errors.largest),
        "∞" if math.isinf(errors.psnr) else f"{errors.psnr:.1f}",
        _format_or_dash(errors.flip),
        f"{errors.wrong_faces:,}",
        _format_or_dash(errors.depth_ulp),
        _format_or_dash(errors.depth_units),
        _format_or_dash(errors.uv_texels),
    )]  # fmt: skip


def _format_or_dash(value: float | None) -> str:
    return NO_VALUE if value is None else format_number(value)


def _summarize_spread(study: Study) -> dict[str, Any] | None:
    """Return the relative quartile ranges of times, typical and largest; None after one round."""
    spreads = [
        ((trial.spread[1] - trial.spread[0]) / trial.ratio, trial.label)
        for trial in study.trials
        if len(trial.ratios) > 1
    ]
    if not spreads:
        return None
    largest, label = max(spreads, key=lambda pair: pair[0])
    unsure = sum(not is_measured(trial) for trial in study.trials)
    typical = statistics.median(spread for spread, _ in spreads)
    return {"typical": typical, "largest": largest, "label": label, "unsure": unsure}
