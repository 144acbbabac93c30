"""
Write what a study found as one page: plots, sentences, tables and enlarged pictures.

The page loads nothing: pictures are in it as ``data:`` addresses, plots as inline SVG. The same
study makes the same bytes.
"""

from __future__ import annotations

import html
import math
import os
import re
import statistics
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.accuracy.report import crops
from rasterjit.accuracy.report.crops import Crop
from rasterjit.accuracy.report.plots import (
    DARK,
    LIGHT,
    plot_front,
    plot_setting,
    require_matplotlib,
)
from rasterjit.accuracy.report.scales import duration, number
from rasterjit.accuracy.results import (
    COMBINATIONS,
    STANDARD,
    Study,
    Trial,
    front_trials,
    settings_of,
    standard_level,
    with_standard,
)
from rasterjit.io.whole import replacing
from rasterjit.scene.quality import differences

PAGE_NAME = "index.html"

THUMBNAIL = "whole-picture"
"""Id of the small picture in which all crops are shown."""

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


class Section(NamedTuple):
    """A part of the page: its anchor, its heading as text, and what follows as HTML."""

    anchor: str
    title: str
    body: str


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
        If ``folder`` is not a folder, or matplotlib is not installed.
    OSError
        If the folder or the file cannot be written; a page that was there is left as it was.
    """
    require_matplotlib()
    if not isinstance(folder, (str, os.PathLike)):
        raise ValueError(f"folder must be the name of a folder, got {folder!r}")
    place = Path(folder)
    if place.exists() and not place.is_dir():
        raise ValueError(f"folder must be a folder, got {str(place)!r}, which is a file")
    text = page(study, sentences)
    place.mkdir(parents=True, exist_ok=True)
    with replacing(place / PAGE_NAME) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return place / PAGE_NAME


def page(study: Study, sentences: dict[str, str]) -> str:
    """Return the page of a study as HTML; see `write_page`."""
    sections = [
        _front(study),
        _sentences(study, sentences),
        *(_setting(study, setting, sentences) for setting in settings_of(study)),
        _combinations(study),
        _without_effect(study),
        _impossible(study),
        _left_out(study),
        _variation(study),
        _machine(study),
    ]
    shown = [section for section in sections if section.body]
    title = html.escape(f"What accuracy costs: {study.scene}")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<title>{title}</title>\n'
        f"<style>\n{_style()}</style>\n</head>\n<body>\n"
        f"{_header(study, title, shown)}\n<main>\n"
        + "\n".join(_as_html(section) for section in shown)
        + "\n</main>\n</body>\n</html>\n"
    )


def _as_html(section: Section) -> str:
    heading = f"<h2>{html.escape(section.title)}</h2>"
    return f'<section id="{section.anchor}">\n{heading}\n{section.body}\n</section>'


def _anchor(name: str) -> str:
    """Return a name as an id."""
    return re.sub(r"[^A-Za-z0-9_-]", "-", name)


def _style() -> str:
    """Return the style sheet, with the colours of plots for a light and a dark page."""

    def variables(colors: dict[str, str]) -> str:
        return " ".join(f"--{name}: {color};" for name, color in colors.items())

    return (
        f":root {{ color-scheme: light dark; {variables(LIGHT)} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {variables(DARK)} }} }}\n"
        + resources.files("rasterjit.accuracy.report")
        .joinpath("page.css")
        .read_text(encoding="utf-8")
    )


def _header(study: Study, title: str, sections: Sequence[Section]) -> str:
    """Return the title, what was measured, the pictures, and links to all sections."""
    columns, rows = study.size
    links = "".join(
        f'<li><a href="#{section.anchor}">{html.escape(section.title)}</a></li>\n'
        for section in sections
    )
    small = crops.thumbnail(study.reference_color)
    pictures = _whole_picture(
        study, study.standard.color, "standard quality", duration(study.standard.median)
    ) + _whole_picture(
        study, study.reference_color, "reference of all errors", duration(study.reference_seconds)
    )
    return (
        f"<header>\n<h1>{title}</h1>\n"
        f"<p>{columns} × {rows} pixels, {_counted(study.threads, 'thread')}, "
        f"{_counted(study.rounds, 'round')}. Times are medians over the rounds, each divided by "
        "the standard's time in the same round; errors are against the reference."
        f'</p>\n<div class="whole">\n{pictures}</div>\n<nav><ul>\n{links}</ul></nav>\n'
        f'<svg width="0" height="0" style="position: absolute" aria-hidden="true"><defs>'
        f'<image id="{THUMBNAIL}" width="{columns}" height="{rows}" '
        f'href="{crops.png_uri(small)}" preserveAspectRatio="none"/></defs></svg>\n</header>'
    )


def _whole_picture(study: Study, picture: NDArray[np.uint8], name: str, took: str) -> str:
    """Return a picture that is shown no larger than it is."""
    columns, rows = study.size
    return (
        f'<figure style="max-width: {columns}px"><img src="{crops.png_uri(picture)}" '
        f'width="{columns}" height="{rows}" alt="{html.escape(study.scene)}, {name}">'
        f"<figcaption>{name.capitalize()}: {took}</figcaption></figure>\n"
    )


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _front(study: Study) -> Section:
    """Return the plot of everything, and what its numbers stand for."""
    found = front_trials(study)
    ahead = [] if study.standard in found else [study.standard]
    rows = results_table(study, [*ahead, *found])
    body = (
        "<p>Nothing that was tried is both faster, by its median, and more accurate than the "
        "numbered ones. What is called dominated further down may be one: faster, but by less "
        "than the noise.</p>\n"
        f"<figure>{plot_front(study, 'front-')}\n<figcaption>"
        '<span class="key">●</span> on the front, <span class="key standard">◆</span> standard, '
        '<span class="key dominated">○</span> all others; bars from the lower to the upper '
        f"quartile of the times.</figcaption></figure>\n{rows}"
    )
    return Section("front", "All that was tried", body)


def _sentences(study: Study, sentences: dict[str, str]) -> Section:
    """Return the sentences of settings with an effect, linked to their sections."""
    sections = {*settings_of(study), COMBINATIONS}
    items = []
    for name, sentence in sentences.items():
        if name in study.without_effect:
            continue
        shown = f"<code>{html.escape(name)}</code>"
        if name in sections:
            shown = f'<a href="#{_anchor(name)}">{shown}</a>'
        items.append(f"<li>{shown}: {html.escape(sentence)}</li>")
    body = "<ul>\n" + "\n".join(items) + "\n</ul>" if items else ""
    return Section("sentences", "In one sentence each", body)


def _setting(study: Study, setting: str, sentences: dict[str, str]) -> Section:
    """Return plot, table and crops of one setting."""
    trials = with_standard(study, setting)
    sentence = sentences.get(setting)
    lead = f'<p class="lead">{html.escape(sentence)}</p>\n' if sentence else ""
    stages = stages_table(study, trials, setting)
    if stages:
        stages = f"<details><summary>Time of each stage</summary>\n{stages}\n</details>\n"
    has_dominated = any(trial.dominated_by for trial in trials)
    dominated = (
        ', <span class="key dominated">○</span> dominated: another level is, as far as the times '
        "tell, neither slower nor less accurate"
    )
    body = (
        f"{lead}<figure>{plot_setting(study, setting, f'{_anchor(setting)}-')}\n<figcaption>"
        '<span class="key">●</span> level, <span class="key standard">◆</span> standard'
        f"{dominated if has_dominated else ''}; bars from the lower to the "
        f"upper quartile of the times.</figcaption></figure>\n"
        f"{results_table(study, trials, setting)}\n{stages}{_crops(study, setting, trials)}"
    )
    return Section(_anchor(setting), setting, body)


def _crops(study: Study, setting: str, trials: Sequence[Trial]) -> str:
    """Return enlarged parts of the reference and of each level, with their errors as colours."""
    crop = crops.choose_crop([trial.error_map for trial in trials])
    errors = [crop.of(trial.error_map) for trial in trials]
    top = crops.heat_top(errors)
    same = all(np.array_equal(trial.error_map, trials[0].error_map) for trial in trials)
    why = (
        "All levels have the same errors, most of them here"
        if same
        else "Where the levels differ most"
    )
    right, bottom = crop.column + crop.width - 1, crop.row + crop.height - 1
    where = f"columns {crop.column} to {right}, rows {crop.row} to {bottom}"
    shown = html.escape(setting)
    figures = [_reference_crop(study, crop, top)]
    for trial, error in zip(trials, errors, strict=True):
        name = html.escape(level_name(study, trial, setting))
        rms = number(float(np.sqrt(np.mean(np.square(error, dtype=np.float64)))))
        figures.append(
            f'<figure class="{"dominated" if trial.dominated_by else "level"}">'
            + _enlarged(crop.of(trial.color), f"{shown}: {name}, enlarged")
            + _enlarged(crops.heat(error, top), f"{shown}: error of {name}, enlarged")
            + f"<figcaption>{name}<br>RMS {rms}</figcaption></figure>"
        )
    return (
        f"<h3>{why}: {where}</h3>\n"
        '<p class="aside">Above the picture; below its error at each pixel, the largest difference '
        "of linear red, green and blue, with the root mean square of what is shown.</p>\n"
        f'<div class="crops" style="--columns: {crop.width}; --rows: {crop.height}">\n'
        + "\n".join(figures)
        + "\n</div>"
    )


def _reference_crop(study: Study, crop: Crop, top: float) -> str:
    """Return the reference's part, where it lies in the picture, and the scale of the errors."""
    columns, rows = study.size
    scale = crops.png_uri(crops.heat_scale())
    return (
        "<figure>" + _enlarged(crop.of(study.reference_color), "reference, enlarged")
        + f'<svg class="where" viewBox="0 0 {columns} {rows}" role="img" '
        f'aria-label="where this part lies in the picture"><use href="#{THUMBNAIL}"/>'
        f'<rect x="{crop.column}" y="{crop.row}" width="{crop.width}" height="{crop.height}" '
        f'stroke-width="{max(columns / 120.0, 1.0):.3g}"/></svg>'
        f'<figcaption>Reference, and where this is<img class="scale" src="{scale}" '
        f'alt="colours of errors from 0 to {number(top)}"><span class="ends"><span>0</span>'
        f"<span>error</span><span>{number(top)}</span></span></figcaption></figure>"
    )  # fmt: skip


def _enlarged(picture: NDArray[np.uint8], described: str) -> str:
    """Return an image whose pixels the style sheet enlarges; ``described`` is HTML."""
    height, width = picture.shape[:2]
    return (
        f'<img class="pixels" src="{crops.png_uri(picture)}" width="{width}" height="{height}" '
        f'alt="{described}">'
    )


def _combinations(study: Study) -> Section:
    """Return the table of what changes several settings."""
    trials = study.of(COMBINATIONS)
    body = results_table(study, [study.standard, *trials]) if trials else ""
    return Section(COMBINATIONS, "Several settings at once", body)


def _without_effect(study: Study) -> Section:
    """Return the settings that change nothing, with the reasons."""
    return Section("without-effect", "Settings without effect here", _list(study.without_effect))


def _impossible(study: Study) -> Section:
    """Return what cannot be rendered, with the reasons."""
    return Section("impossible", "What cannot be rendered here", _list(study.impossible))


def _list(described: dict[str, str], tag: str = "code") -> str:
    """Return names with what is said of each, or nothing if there are none."""
    items = "\n".join(
        f"<dt><{tag}>{html.escape(name)}</{tag}></dt><dd>{html.escape(said)}</dd>"
        for name, said in described.items()
    )
    return f"<dl>\n{items}\n</dl>" if items else ""


def _left_out(study: Study) -> Section:
    """Return what there was no time for."""
    names = ", ".join(f"<code>{html.escape(name)}</code>" for name in study.left_out)
    why = "The study was interrupted before" if study.interrupted else "There was no time left for"
    return Section("left-out", "What was left out", f"<p>{why}: {names}.</p>" if names else "")


def _variation(study: Study) -> Section:
    """Return how far the times of the rounds lay apart."""
    spreads = [
        ((trial.spread[1] - trial.spread[0]) / trial.ratio, trial)
        for trial in study.trials
        if len(trial.ratios) > 1
    ]
    if not spreads:
        body = "<p>Everything was timed once, so how much times vary is not known.</p>"
        return Section("variation", "How much times varied", body)
    typical = statistics.median(spread for spread, _ in spreads)
    most, trial = max(spreads, key=lambda found: found[0])
    body = (
        f"<p>The middle half of the times of a typical level spans {number(100.0 * typical)} % of "
        f"their median; {number(100.0 * most)} % for "
        f"<code>{html.escape(trial.label)}</code>, which varied most. Frames of the standard took "
        f"{duration(min(study.standard.seconds))} to "
        f"{duration(max(study.standard.seconds))}. Smaller differences of times than these mean "
        "little. Errors do not vary: the same scene gives the same ones in every run.</p>"
    )
    return Section("variation", "How much times varied", body)


def _machine(study: Study) -> Section:
    """Return on what the times were taken."""
    body = _list({**study.machine, **study.versions}, tag="span")
    return Section("machine", "Machine and versions", body)


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
