"""
Write what a study found as one page: the answer, a plot to look around in, tables and pictures.

The page loads nothing: pictures are in it as ``data:`` addresses, the plot as inline SVG, style and
program as text. The same study makes the same bytes. ``page.html`` is its template, for Jinja: here
is what that shows.
"""

from __future__ import annotations

import math
import os
import statistics
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.accuracy.choice import choose, is_measured, is_slower
from rasterjit.accuracy.report.picture_crops import make_album, thumbnail, webp_uri
from rasterjit.accuracy.report.plots import (
    DARK,
    LIGHT,
    PAGE_MODULES,
    duration,
    number,
    plot_front,
    require_extra,
)
from rasterjit.accuracy.results import (
    COMBINATIONS,
    CPU,
    STANDARD,
    WALL,
    Study,
    Trial,
    front_trials,
    insert_standard,
    settings_of,
    standard_level,
)
from rasterjit.accuracy.sentences import (
    NOT_MEASURED,
    alternatives,
    certainty,
    digits,
    error_against,
    factor_in_words,
    options_of,
    recommendation,
)
from rasterjit.io.atomic_write import write_text

PAGE_NAME = "index.html"

NOTHING = "–"
"""What stands where a number has no meaning."""

WIDE, NARROW = 480, 336
"""Columns of the screen that an enlarged picture takes at most, on a desktop and on a phone."""

TIME_NOTES = {
    WALL: "Times are medians, each over the standard’s time in the same round.",
    CPU: "Times are what all threads together worked for a frame: medians of the least half.",
}
"""What is said of times, by the clock."""

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
"""Columns of what was measured, with their units."""


Cell = tuple[str, str]
"""What a cell of a table holds, and what stands small below it."""


class TableRow(NamedTuple):
    """
    A row of a table.

    Parameters
    ----------
    kind : str
        Class in the style sheet.
    name : str
    cells : list of (str, str)
    trial : Trial, optional
        Whose picture a press on the name shows.
    place : int, optional
        On the front.
    small : str
        Below the name.
    """

    kind: str
    name: str
    cells: list[Cell]
    trial: Trial | None = None
    place: int | None = None
    small: str = ""


class TableGroup(NamedTuple):
    """Rows of a table, with or without a title above them, and what stands small beside it."""

    rows: list[TableRow]
    title: str = ""
    small: str = ""


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
    require_extra(*PAGE_MODULES)
    if not isinstance(folder, (str, os.PathLike)):
        raise ValueError(f"folder must be the name of a folder, got {folder!r}")
    place = Path(folder)
    if place.exists() and not place.is_dir():
        raise ValueError(f"folder must be a folder, got {str(place)!r}, which is a file")
    text = page(study, sentences)
    place.mkdir(parents=True, exist_ok=True)
    write_text(place / PAGE_NAME, text)
    return place / PAGE_NAME


def page(study: Study, sentences: dict[str, str]) -> str:
    """Return the page of a study as HTML; see `write_page`."""
    # Of the extra, so nobody else loads it.
    import jinja2

    pages = jinja2.Environment(
        loader=jinja2.FunctionLoader(_file), autoescape=True, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    pages.globals |= {
        one.__name__: one
        for one in (
            alternatives, counted, duration, certainty, in_words, number, options_of,
            recommendation, variables, words,
        )
    }  # fmt: skip
    return pages.get_template("page.html").render(_contents(study, sentences))


def _file(name: str) -> str:
    """Return the text of a file beside this one."""
    return resources.files("rasterjit.accuracy.report").joinpath(name).read_text(encoding="utf-8")


def _contents(study: Study, sentences: dict[str, str]) -> dict[str, Any]:
    """Return what the template shows, by its names there."""
    album, (columns, rows) = make_album(study), study.size
    wide, front = album.size[0], front_trials(study)
    columns_shown, results = results_table(study)
    without = {name: f"changes nothing here: {why}." for name, why in study.without_effect.items()}
    return {
        "study": study,
        "columns": columns,
        "rows": rows,
        "stroke": f"{columns / 80.0:.3g}",
        "thumbnail": webp_uri(thumbnail(study.reference_color)),
        "album": album,
        "wide": max(WIDE // wide, 1),
        "narrow": max(NARROW // wide, 1),
        "light": LIGHT,
        "dark": DARK,
        "style": _file("page.css"),
        "script": _file("page.js"),
        "take": options_of(choose(study).trial, study.standard),
        "varied": _quartile_range_text(study),
        "times": TIME_NOTES[study.clock],
        "plot": plot_front(study, "front-"),
        "points": sorted((study.standard, *study.trials), key=lambda one: (one.ratio, one.label)),
        "labels": [trial.label for trial in front],
        "not_measured": NOT_MEASURED,
        "front": front_table(study, front),
        "effects": effects_table(study),
        "result_columns": columns_shown,
        "results": results,
        "impossible": {f"not possible: {name}": why for name, why in study.impossible.items()},
        "sentences": {**{n: text for n, text in sentences.items() if n not in without}, **without},
        "spread": _spread_summary(study),
        "machine": {**study.machine, **study.versions},
    }


def variables(colors: dict[str, str]) -> str:
    """Return the colours of a plot as custom properties of the style sheet."""
    return " ".join(f"--{name}: {color};" for name, color in colors.items())


def counted(count: int, noun: str) -> str:
    """Return a number of things, ``2 rounds``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def words(text: str) -> list[str]:
    """Return the parts of a label, or of options, between which a line may end."""
    parts = text.split(" ")
    if not text.startswith("--"):
        return parts
    return [f"{option} {value}" for option, value in zip(parts[::2], parts[1::2], strict=True)]


def _quartile_range_text(study: Study) -> str:
    """Return between which times the middle half of the standard's frames lay; "": one frame."""
    seconds = study.standard.seconds
    if len(seconds) < 2:
        return ""
    low, _, high = statistics.quantiles(seconds, n=4, method="inclusive")
    return " to ".join(dict.fromkeys((duration(low), duration(high))))


def in_words(study: Study, trial: Trial) -> str:
    """Return what a trial costs and how far it is from the reference, for a line beside it."""
    error = f"error {number(trial.errors.rmse)}"
    if trial.setting == STANDARD:
        return f"{duration(trial.median)}, {error}."
    against = error_against(trial, study.standard)
    if not is_measured(trial):
        rounds = counted(len(trial.ratios), "round")
        return f"about {duration(trial.median)} ({NOT_MEASURED}, {rounds}); {error}, {against}."
    time = f"{factor_in_words(trial)} the time"
    if not is_slower(trial, study.standard) and not is_slower(study.standard, trial):
        time = "the standard’s time, as far as can be told"
    return f"{time}, {duration(trial.median)}; {error}, {against}."


def _factor(trial: Trial) -> Cell:
    """Return a time over the standard's, and how far it is known."""
    factor, _, known = factor_in_words(trial).partition(" (")
    return factor, known[:-1]


def front_table(study: Study, front: list[Trial]) -> TableGroup:
    """Return the qualities on the front and the standard, from the fastest on."""
    others = [] if study.standard in front else [study.standard]
    rows = []
    for trial in sorted([*front, *others], key=lambda trial: trial.ratio):
        is_standard = trial.setting == STANDARD
        cells = [
            _factor(trial),
            ("" if is_standard else error_against(trial, study.standard), ""),
            (duration(trial.median), ""),
            (number(trial.errors.rmse), ""),
        ]
        place = front.index(trial) + 1 if trial in front else None
        small = "" if "=" in trial.label else options_of(trial, study.standard)
        kind = STANDARD if is_standard else "level"
        rows.append(TableRow(kind, trial.label, cells, trial, place, small))
    return TableGroup(rows)


def effects_table(study: Study) -> list[TableGroup]:
    """Return what each effect costs, and how far it is from its own reference."""
    groups = []
    for cost in study.effects:
        own = ("1×", ""), (duration(study.standard.median), ""), (_or_nothing(cost.rmse), "")
        rows = [TableRow(STANDARD, "as the scene says (standard)", list(own))]
        for one in cost.levels:
            cells = [_factor(one), (duration(one.median), ""), (number(one.errors.rmse), "")]
            rows.append(TableRow("level", one.level, cells))
        groups.append(TableGroup(rows, cost.effect, f"reference: {cost.reference}"))
    return groups


def results_table(study: Study) -> tuple[list[Cell], list[TableGroup]]:
    """
    Return time and errors of all trials, without columns in which nothing has a meaning.

    Returns
    -------
    columns : list of (str, str)
        Of `RESULT_COLUMNS`.
    groups : list of TableGroup
        Settings, each with its levels, the standard among them: the dominated ones are grey and
        name what dominates them.
    """
    found = {setting: insert_standard(study, setting) for setting in settings_of(study)}
    if study.of(COMBINATIONS):
        found[COMBINATIONS] = [study.standard, *study.of(COMBINATIONS)]
    front = [trial.label for trial in front_trials(study)]
    groups = []
    for setting, trials in found.items():
        rows = []
        for trial in trials:
            is_standard = trial.setting == STANDARD
            kind = "level" if trial.dominated_by is None else "dominated"
            rows.append(TableRow(
                STANDARD if is_standard else kind,
                level_name(study, trial, setting),
                _results(trial),
                trial,
                front.index(trial.label) + 1 if trial.label in front and not is_standard else None,
                "" if trial.dominated_by is None else f"dominated by {trial.dominated_by}",
            ))  # fmt: skip
        groups.append(TableGroup(rows, setting))
    cells = [row.cells for group in groups for row in group.rows]
    shown = [n for n in range(len(RESULT_COLUMNS)) if any(row[n][0] != NOTHING for row in cells)]
    for group in groups:
        group.rows[:] = [row._replace(cells=[row.cells[n] for n in shown]) for row in group.rows]
    return [RESULT_COLUMNS[n] for n in shown], groups


def milliseconds(seconds: float) -> str:
    """Return seconds as milliseconds: three digits, or all before the point."""
    return number(1000.0 * seconds) if seconds < 0.9995 else f"{1000.0 * seconds:,.0f}"


def level_name(study: Study, trial: Trial, setting: str) -> str:
    """Return what a trial is called among the levels of a setting."""
    if trial.setting != STANDARD:
        return trial.level
    if setting == COMBINATIONS:
        return STANDARD
    return f"{standard_level(study, setting)} (standard)"


def _results(trial: Trial) -> list[Cell]:
    """Return the cells of a trial's row, in the order of `RESULT_COLUMNS`."""
    low, high = trial.spread
    errors, middle = trial.errors, milliseconds(trial.median)
    time, taken = ("", NOT_MEASURED), f"≈ {middle}"
    if trial.setting == STANDARD or is_measured(trial):
        spread = f"{digits(low)}–{digits(high)}" if low < high else ""
        time, taken = (f"{digits(trial.ratio)}×", spread), middle
    return [time] + [(text, "") for text in (
        taken,
        number(errors.rmse),
        number(errors.largest),
        "∞" if math.isinf(errors.psnr) else f"{errors.psnr:.1f}",
        _or_nothing(errors.flip),
        f"{errors.wrong_faces:,}",
        _or_nothing(errors.depth_ulp),
        _or_nothing(errors.depth_units),
        _or_nothing(errors.uv_texels),
    )]  # fmt: skip


def _or_nothing(value: float | None) -> str:
    return NOTHING if value is None else number(value)


def _spread_summary(study: Study) -> dict[str, Any] | None:
    """Return how far the times of the rounds lay apart; None: there was one."""
    spreads = [
        ((trial.spread[1] - trial.spread[0]) / trial.ratio, trial.label)
        for trial in study.trials
        if len(trial.ratios) > 1
    ]
    if not spreads:
        return None
    most, label = max(spreads, key=lambda found: found[0])
    unsure = sum(not is_measured(one) for one in study.trials)
    typical = statistics.median(spread for spread, _ in spreads)
    return {"typical": typical, "most": most, "label": label, "unsure": unsure}
