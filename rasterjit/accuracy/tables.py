"""Write the trials of a study as tables of a page."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from rasterjit.accuracy.results import STANDARD, Study, Trial
from rasterjit.accuracy.rows import front_trials, standard_level
from rasterjit.accuracy.scales import number
from rasterjit.scene.quality import differences

NOTHING = "–"
"""What stands where a number has no meaning."""

RESULTS = (
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


def results_table(study: Study, trials: Sequence[Trial], setting: str | None = None) -> str:
    """
    Return time and errors of trials as a table, without columns in which nothing has a meaning.

    Parameters
    ----------
    study : Study
    trials : sequence of Trial
        One row each.
    setting : str, optional
        Whose levels they are: the dominated ones are grey and name what dominates them. Default:
        rows are called by their full labels, numbered if they are on the front, else grey.
    """
    cells = [_results(trial) for trial in trials]
    shown = [n for n in range(len(RESULTS)) if any(row[n] != NOTHING for row in cells)]
    rows = []
    for trial, row in zip(trials, cells, strict=True):
        kind = _kind(trial)
        if setting is None and kind != STANDARD:
            kind = "level" if trial.label in study.front else "other"
        rows.append(_row(kind, _row_name(study, trial, setting), [row[n] for n in shown]))
    first = "level" if setting else "changed from the standard"
    return _table(first, [RESULTS[n] for n in shown], rows)


def stages_table(study: Study, trials: Sequence[Trial], setting: str) -> str:
    """Return the median milliseconds of each stage as a table, or nothing if there are none."""
    stages = list(dict.fromkeys(stage for trial in trials for stage in trial.stages))
    if not stages:
        return ""
    rows = []
    for trial in trials:
        values = [trial.stages.get(stage) for stage in stages]
        cells = [NOTHING if value is None else milliseconds(value) for value in values]
        rows.append(_row(_kind(trial), _row_name(study, trial, setting), cells))
    return _table("level", [(stage, "ms") for stage in stages], rows)


def milliseconds(seconds: float) -> str:
    """Return seconds as milliseconds: three digits, or all before the point."""
    return number(1000.0 * seconds) if seconds < 0.9995 else f"{1000.0 * seconds:,.0f}"


def level_name(study: Study, trial: Trial, setting: str) -> str:
    """Return what a trial is called among the levels of a setting."""
    if trial.setting == STANDARD:
        return f"{standard_level(study, setting)} (standard)"
    return trial.level


def _row_name(study: Study, trial: Trial, setting: str | None) -> str:
    """Return the heading of a trial's row."""
    if setting is not None:
        name = html.escape(level_name(study, trial, setting))
        if trial.dominated_by is None:
            return name
        return f"{name}<small>dominated by {html.escape(trial.dominated_by)}</small>"
    labels = [other.label for other in front_trials(study)]
    name = html.escape(trial.label)
    if trial.label in labels:
        name = f'<span class="key">{labels.index(trial.label) + 1}</span> {name}'
    changes = differences(trial.quality, study.standard.quality)
    if changes and "=" not in trial.label:
        shown = " ".join(f"{setting}={level}" for setting, level in changes.items())
        name += f"<small>{html.escape(shown)}</small>"
    return name


def _results(trial: Trial) -> list[str]:
    """Return the cells of a trial's row, in the order of `RESULTS`."""
    low, high = trial.spread
    errors = trial.errors
    spread = f"<small>{low:.3g}–{high:.3g}</small>" if low < high else ""
    return [
        f"{trial.ratio:.3g}×{spread}",
        milliseconds(trial.median),
        number(errors.rmse),
        number(errors.largest),
        "∞" if math.isinf(errors.psnr) else f"{errors.psnr:.1f}",
        _or_nothing(errors.flip),
        f"{errors.wrong_faces:,}",
        _or_nothing(errors.depth_ulp),
        _or_nothing(errors.depth_units),
        _or_nothing(errors.uv_texels),
    ]


def _or_nothing(value: float | None) -> str:
    return NOTHING if value is None else number(value)


def _kind(trial: Trial) -> str:
    """Return the class of a trial's row."""
    if trial.setting == STANDARD:
        return STANDARD
    return "level" if trial.dominated_by is None else "dominated"


def _row(kind: str, name: str, cells: Sequence[str]) -> str:
    """Return a row; name and cells are HTML."""
    values = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr class="{kind}"><th scope="row">{name}</th>{values}</tr>'


def _table(first: str, columns: Sequence[tuple[str, str]], rows: Sequence[str]) -> str:
    """Return a table that scrolls sideways where the page is narrow."""
    head = "".join(
        f'<th scope="col">{html.escape(name)}<small>{html.escape(unit)}</small></th>'
        for name, unit in columns
    )
    body = "\n".join(rows)
    return (
        f'<div class="scroll" tabindex="0">\n<table>\n<thead><tr><th scope="col">{first}</th>{head}'
        f"</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</div>"
    )
