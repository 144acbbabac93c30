"""
Write what a study found as one page: the answer, a plot to look around in, tables and pictures.

The page loads nothing: pictures are in it as ``data:`` addresses, the plot as inline SVG, style and
program as text. The same study makes the same bytes.
"""

from __future__ import annotations

import html
import math
import os
import statistics
from collections.abc import Iterable, Sequence
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from rasterjit.accuracy.choice import choose
from rasterjit.accuracy.ranking import is_measured, is_slower
from rasterjit.accuracy.report.plots import DARK, LIGHT, Plot, plot_front, require_matplotlib
from rasterjit.accuracy.report.scales import duration, number
from rasterjit.accuracy.report.shots import Album, make_album, thumbnail
from rasterjit.accuracy.results import (
    COMBINATIONS,
    PROCESSOR,
    STANDARD,
    WALL,
    Study,
    Trial,
    front_trials,
    settings_of,
    standard_level,
    with_standard,
)
from rasterjit.accuracy.sentences import (
    NOT_MEASURED,
    alternatives,
    error_against,
    factor_in_words,
    figures,
    how_sure,
    options_of,
    recommendation,
)
from rasterjit.io.whole import replacing

PAGE_NAME = "index.html"

THUMBNAIL = "whole-picture"
"""Id of the small picture in which all crops are shown."""

NOTHING = "–"
"""What stands where a number has no meaning."""

WIDE, NARROW = 480, 336
"""Columns of the screen that an enlarged picture takes at most, on a desktop and on a phone."""

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""What the page may load: nothing but what is in it."""

TIMES = {
    WALL: "Times are medians, each over the standard’s time in the same round.",
    PROCESSOR: "Times are what all threads together worked for a frame: medians of the least half.",
}
"""What is said of times, by the clock."""

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
    """A part of the page: its anchor, its heading as text, what follows as HTML, and its fold."""

    anchor: str
    title: str
    body: str
    is_folded: bool = False


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
    album = make_album(study)
    sections = [
        Section("front", "Worth choosing", front_table(study)),
        Section("effects", "What each effect costs", effects_table(study)),
        _everything(study),
        _sentences(study, sentences),
        _pictures(study, album),
        _measuring(study),
    ]
    title = html.escape(f"What accuracy costs: {study.scene}")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<link rel="icon" href="data:,">\n<title>{title}</title>\n'
        f"<style>\n{_style(album)}</style>\n</head>\n<body>\n"
        f"{_header(study, title)}\n<main>\n{_plot(study, album)}\n"
        + "\n".join(_as_html(section) for section in sections if section.body)
        + f'\n</main>\n<script type="module">\n{_file("page.js")}</script>\n</body>\n</html>\n'
    )


def _as_html(section: Section) -> str:
    heading = f"<h2>{html.escape(section.title)}</h2>"
    body = f"{heading}\n{section.body}"
    if section.is_folded:
        body = f"<details>\n<summary>{heading}</summary>\n{section.body}\n</details>"
    return f'<section id="{section.anchor}">\n{body}\n</section>'


def _file(name: str) -> str:
    """Return the text of a file beside this one."""
    return resources.files("rasterjit.accuracy.report").joinpath(name).read_text(encoding="utf-8")


def _style(album: Album) -> str:
    """Return the style sheet, with the colours of plots and how far pictures are enlarged."""

    def variables(colors: dict[str, str]) -> str:
        return " ".join(f"--{name}: {color};" for name, color in colors.items())

    columns, rows = album.size
    return (
        f":root {{ color-scheme: light dark; {variables(LIGHT)} --columns: {columns}; "
        f"--rows: {rows}; --wide: {max(WIDE // columns, 1)}; "
        f"--narrow: {max(NARROW // columns, 1)}; }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {variables(DARK)} }} }}\n"
        + _file("page.css")
    )


def _header(study: Study, title: str) -> str:
    """Return the title, the answer, and what its numbers mean."""
    columns, rows = study.size
    seconds = study.standard.seconds
    varied = ""
    if len(seconds) > 1:
        low, _, high = statistics.quantiles(seconds, n=4, method="inclusive")
        varied = f"; frames of the standard took {_from_to(low, high)} (the middle half)"
    small = thumbnail(study)
    return (
        f'<header>\n<h1>{title}</h1>\n<p class="answer">'
        f"{html.escape(recommendation(study))}</p>\n{_asked_for(study)}"
        f'<p class="sure">{html.escape(how_sure(study))}</p>\n'
        f"<p>{html.escape(alternatives(study))}</p>\n"
        f'<p class="aside">{columns} × {rows} pixels, {_counted(study.threads, "thread")}, '
        f"{_counted(study.rounds, 'round')}{varied}. The error is the root mean square difference "
        f"of linear light from a reference of {study.reference_samples} samples a pixel. "
        f"{TIMES[study.clock]}</p>\n"
        '<svg class="store" width="0" height="0" aria-hidden="true"><defs>'
        f'<image id="{THUMBNAIL}" width="{columns}" height="{rows}" '
        f'href="{small}" preserveAspectRatio="none"/></defs></svg>\n</header>'
    )


def _asked_for(study: Study) -> str:
    """Return what the quality to take is asked for with."""
    options = options_of(choose(study).trial, study.standard)
    return f'<p class="take"><code>{_breakable(options)}</code></p>\n' if options else ""


def _from_to(low: float, high: float) -> str:
    """Return two times, once if they print alike."""
    return duration(low) if duration(low) == duration(high) else (
        f"{duration(low)} to {duration(high)}"
    )  # fmt: skip


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _plot(study: Study, album: Album) -> str:
    """Return the plot, a button on each of its points, and what shows the picture of one."""
    plot = plot_front(study, "front-")
    return (
        '<section id="plot">\n<h2>Error against time</h2>\n<div class="beside">\n'
        '<figure class="chart">\n<div class="points" role="radiogroup" '
        f'aria-label="Qualities, from the fastest on">\n{plot.svg}\n{_points(study, album, plot)}'
        "\n</div>\n<figcaption>Rest the mouse on a point, tap it or use the arrow keys to see its "
        "picture. "
        '<span class="key">●</span> worth choosing, with the middle half of its times; '
        '<span class="key standard">◆</span> standard; <span class="key other">○</span> all '
        f'others; <span class="key other">×</span> {NOT_MEASURED}. Lower is more accurate, '
        "further left is faster.</figcaption>\n</figure>\n"
        f"{_viewer(study)}\n</div>\n</section>"
    )


def _points(study: Study, album: Album, plot: Plot) -> str:
    """Return a radio button for each trial, from the fastest on, at its place in the plot."""
    front = set(study.front)
    trials = sorted((study.standard, *study.trials), key=lambda one: (one.ratio, one.label))
    buttons = []
    for trial in trials:
        x, y = plot.places[trial.label]
        kind = STANDARD if trial.setting == STANDARD else "other"
        kind = "level" if kind != STANDARD and trial.label in front else kind
        checked = " checked" if trial.setting == STANDARD else ""
        found = html.escape(in_words(study, trial))
        name = html.escape(trial.label)
        buttons.append(
            f'<input type="radio" name="point" class="{kind}" value="{album.ids[trial.label]}" '
            f'style="left: {100.0 * x:.2f}%; top: {100.0 * y:.2f}%" aria-label="{name}: {found}" '
            f'data-name="{name}" data-found="{found}" '
            f'data-options="{html.escape(options_of(trial, study.standard))}"{checked}>'
        )
    return "\n".join(buttons)


def _viewer(study: Study) -> str:
    """Return what the program of the page fills: a picture against the reference."""
    columns, rows = study.size
    return (
        '<figure id="viewer" hidden>\n<div class="split">'
        '<img class="pixels" id="reference" src="data:," alt="reference">'
        '<img class="pixels" id="chosen" src="data:," alt="">'
        '<span class="divider" aria-hidden="true"></span>'
        '<input type="range" id="share" min="0" max="100" value="50" '
        'aria-label="Share of the picture on the left; the rest is the reference"></div>\n'
        '<p class="ends" aria-hidden="true"><span id="left"></span><span>reference</span></p>\n'
        '<figcaption><strong id="name"></strong>: <span id="found"></span> '
        '<code id="options"></code></figcaption>\n'
        '<div class="small"><figure><svg class="where" '
        f'viewBox="0 0 {columns} {rows}" role="img" '
        f'aria-label="where this part lies in the picture"><use href="#{THUMBNAIL}"/>'
        f'<rect id="part" stroke-width="{columns / 80.0:.3g}"/></svg>'
        "<figcaption>Where this part lies</figcaption></figure>"
        '<figure><img class="pixels" id="error" src="data:," alt="error of each pixel">'
        '<figcaption>Error: black is 0, yellow <span id="top"></span></figcaption></figure>'
        "</div>\n</figure>"
    )


def in_words(study: Study, trial: Trial) -> str:
    """Return what a trial costs and how far it is from the reference, for a line beside it."""
    error = f"error {number(trial.errors.rmse)}"
    if trial.setting == STANDARD:
        return f"{duration(trial.median)}, {error}."
    against = error_against(trial, study.standard)
    if not is_measured(trial):
        rounds = _counted(len(trial.ratios), "round")
        return f"about {duration(trial.median)} ({NOT_MEASURED}, {rounds}); {error}, {against}."
    time = f"{factor_in_words(trial)} the time"
    if not is_slower(trial, study.standard) and not is_slower(study.standard, trial):
        time = "the standard’s time, as far as can be told"
    return f"{time}, {duration(trial.median)}; {error}, {against}."


def front_table(study: Study) -> str:
    """Return the qualities on the front and the standard, from the fastest on, as a table."""
    front = front_trials(study)
    shown = front if study.standard in front else sorted(
        [*front, study.standard], key=lambda trial: trial.ratio
    )  # fmt: skip
    rows = []
    for trial in shown:
        name = _button(trial, trial.label, front.index(trial) + 1 if trial in front else None)
        if "=" not in trial.label:
            name += f"<small>{_breakable(options_of(trial, study.standard))}</small>"
        cells = [
            _factor(trial),
            "" if trial.setting == STANDARD else html.escape(error_against(trial, study.standard)),
            duration(trial.median),
            number(trial.errors.rmse),
        ]
        rows.append(_row(STANDARD if trial.setting == STANDARD else "level", name, cells))
    units = ("standard = 1", "against it", "", "linear light")
    columns = list(zip(("time", "error", "a frame", "RMSE"), units, strict=True))
    lead = (
        "<p>Each is more accurate than all faster ones, and their times can be told apart. "
        "Where several take the same time, the most accurate stands for all. Press a name to see "
        "its picture; ask for it with "
        '<code class="word">--set NAME=LEVEL</code> for each change.</p>\n'
    )
    return lead + _table("quality", columns, rows)


def effects_table(study: Study) -> str:
    """Return what each effect costs, and how far it is from its own reference, as a table."""
    if not study.effects:
        return ""
    bodies = []
    for cost in study.effects:
        bodies.append(
            f'<tr class="setting"><th scope="rowgroup" colspan="4">{html.escape(cost.effect)}'
            f"<small>reference: {html.escape(cost.reference)}</small></th></tr>"
        )
        own = "as the scene says (standard)"
        known = NOTHING if cost.rmse is None else number(cost.rmse)
        bodies.append(_row(STANDARD, own, ["1×", duration(study.standard.median), known]))
        for level in cost.levels:
            cells = [_factor(level), duration(level.median), number(level.errors.rmse)]
            bodies.append(_row("level", html.escape(level.level), cells))
    columns = [("time", "standard = 1"), ("a frame", ""), ("RMSE", "linear light")]
    lead = (
        "<p>Each effect of the scene, left out or changed, in the standard quality but for that. "
        "Its error is against a reference of its own, so what edges and textures lack is no part "
        "of it. Where there is no reference, the error is how far the picture changes.</p>\n"
    )
    return lead + _table("effect", columns, bodies)


def _breakable(text: str) -> str:
    """Return a label, or options, as HTML whose lines end between changes, not within one."""
    words = html.escape(text).split(" ")
    if text.startswith("--"):
        words = [f"{option} {value}" for option, value in zip(words[::2], words[1::2], strict=True)]
    return " ".join(f'<span class="word">{word}</span>' for word in words)


def _factor(trial: Trial) -> str:
    """Return a time over the standard's, and below it how far it is known, as HTML."""
    factor, _, known = factor_in_words(trial).partition(" (")
    return f"{factor}<small>{known[:-1]}</small>" if known else factor


def _button(trial: Trial, name: str, place: int | None = None) -> str:
    """Return the name of a trial as what shows its picture; plain text without the program."""
    mark = "" if place is None else f'<span class="key">{place}</span> '
    return (
        f'<button type="button" class="pick" data-name="{html.escape(trial.label)}" disabled>'
        f"{mark}{_breakable(name)}</button>"
    )


def _everything(study: Study) -> Section:
    """Return the table of all trials, and what was not tried."""
    count = len(study.trials)
    groups = [(setting, with_standard(study, setting)) for setting in settings_of(study)]
    if study.of(COMBINATIONS):
        groups.append((COMBINATIONS, [study.standard, *study.of(COMBINATIONS)]))
    body = results_table(study, groups) if groups else ""
    missing = {f"not possible: {name}": why for name, why in study.impossible.items()}
    body += _list(missing, tag="span")
    if study.left_out:
        names = ", ".join(f"<code>{html.escape(name)}</code>" for name in study.left_out)
        why = "The study was interrupted before" if study.interrupted else "No time was left for"
        body += f"<p>{why}: {names}.</p>"
    return Section("everything", f"All that was tried ({count})", body, is_folded=True)


def _sentences(study: Study, sentences: dict[str, str]) -> Section:
    """Return a sentence for each setting, those without effect last."""
    said = {name: text for name, text in sentences.items() if name not in study.without_effect}
    for name, why in study.without_effect.items():
        said[name] = f"changes nothing here: {why}."
    return Section("sentences", "Each setting in a sentence", _list(said), is_folded=True)


def _pictures(study: Study, album: Album) -> Section:
    """Return the enlarged parts of all pictures, each with its errors."""
    columns, rows = study.size
    groups = []
    for group in album.groups:
        crop = group.crop
        title = html.escape(group.title)
        right, bottom = crop.column + crop.width - 1, crop.row + crop.height - 1
        figures_of = "\n".join(
            f'<figure id="{shot.name}"><img class="pixels" src="{shot.color}" '
            f'alt="{html.escape(shot.caption)}, enlarged">'
            f'<img class="pixels" src="{shot.error}" '
            f'alt="error of {html.escape(shot.caption)}, enlarged">'
            f"<figcaption>{html.escape(shot.caption)}</figcaption></figure>"
            for shot in group.shots
        )
        groups.append(
            f'<div class="group" data-column="{crop.column}" data-row="{crop.row}" '
            f'data-top="{number(group.top)}">\n<h3>{title}: columns {crop.column} to {right}, rows '
            f'{crop.row} to {bottom}</h3>\n<div class="crops">\n'
            f'<figure class="true"><img class="pixels" src="{group.reference}" '
            f'alt="reference, enlarged"><svg class="where" viewBox="0 0 {columns} {rows}" '
            'role="img" aria-label="where this part lies in the picture">'
            f'<use href="#{THUMBNAIL}"/><rect x="{crop.column}" y="{crop.row}" '
            f'width="{crop.width}" height="{crop.height}" '
            f'stroke-width="{columns / 80.0:.3g}"/></svg>'
            f"<figcaption>Reference; errors from 0 (black) to {number(group.top)} (yellow)"
            f"</figcaption></figure>\n{figures_of}\n</div>\n</div>"
        )
    lead = (
        '<p class="aside">Each part is where the qualities beside it differ most. Below a picture: '
        "the largest difference of linear red, green and blue at each pixel. Qualities with the "
        "same picture share one.</p>\n"
    )
    return Section("pictures", "All pictures, enlarged", lead + "\n".join(groups), is_folded=True)


def _list(described: dict[str, str], tag: str = "code") -> str:
    """Return names with what is said of each, or nothing if there are none."""
    items = "\n".join(
        f"<dt><{tag}>{html.escape(name)}</{tag}></dt><dd>{html.escape(said)}</dd>"
        for name, said in described.items()
    )
    return f"<dl>\n{items}\n</dl>" if items else ""


def _measuring(study: Study) -> Section:
    """Return how far times lay apart, and on what they were taken."""
    body = f"<p>{_variation(study)}</p>\n{_list({**study.machine, **study.versions}, tag='span')}"
    return Section("measuring", "How it was measured", body, is_folded=True)


def _variation(study: Study) -> str:
    """Return how far the times of the rounds lay apart, in words."""
    known = "Errors do not vary: the same scene gives the same ones in every run."
    spreads = [
        ((trial.spread[1] - trial.spread[0]) / trial.ratio, trial)
        for trial in study.trials
        if len(trial.ratios) > 1
    ]
    if not spreads:
        return f"Everything was timed once, so how much times vary is not known. {known}"
    typical = statistics.median(spread for spread, _ in spreads)
    most, trial = max(spreads, key=lambda found: found[0])
    unsure = sum(not is_measured(one) for one in study.trials)
    return (
        f"The middle half of the times of a typical level spans {number(100.0 * typical)} % of "
        f"their median; {number(100.0 * most)} % for <code>{html.escape(trial.label)}</code>, "
        "which varied most. Two times count as different if they lie further apart than the "
        "uncertainty of both. A factor is given from three rounds on, if its uncertainty is at "
        f"most a quarter of it: not for {unsure} of {len(study.trials)} here. Rendering the "
        f"reference took {duration(study.reference_seconds)}. {known}"
    )


def results_table(study: Study, groups: Iterable[tuple[str, Sequence[Trial]]]) -> str:
    """
    Return time and errors of trials as a table, without columns in which nothing has a meaning.

    Parameters
    ----------
    study : Study
    groups : iterable of (str, sequence of Trial)
        Settings, each with its levels, the standard among them: the dominated ones are grey and
        name what dominates them.
    """
    found = [
        (setting, [(trial, _results(trial)) for trial in trials]) for setting, trials in groups
    ]
    cells = [row for _, rows in found for _, row in rows]
    shown = [n for n in range(len(RESULTS)) if any(row[n] != NOTHING for row in cells)]
    bodies = []
    for setting, rows in found:
        head = (
            f'<tr class="setting"><th scope="rowgroup" colspan="{len(shown) + 1}">'
            f"{html.escape(setting)}</th></tr>"
        )
        bodies.append(head)
        for trial, row in rows:
            name = _row_name(study, trial, setting)
            bodies.append(_row(_kind(trial), name, [row[n] for n in shown]))
    return _table("level", [RESULTS[n] for n in shown], bodies)


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


def _row_name(study: Study, trial: Trial, setting: str) -> str:
    """Return the heading of a trial's row."""
    labels = [other.label for other in front_trials(study)]
    has_number = trial.label in labels and trial.setting != STANDARD
    place = labels.index(trial.label) + 1 if has_number else None
    name = _button(trial, level_name(study, trial, setting), place)
    if trial.dominated_by is not None:
        return f"{name}<small>dominated by {html.escape(trial.dominated_by)}</small>"
    return name


def _results(trial: Trial) -> list[str]:
    """Return the cells of a trial's row, in the order of `RESULTS`."""
    low, high = trial.spread
    errors = trial.errors
    spread = f"<small>{figures(low)}–{figures(high)}</small>" if low < high else ""
    measured = trial.setting == STANDARD or is_measured(trial)
    return [
        f"{figures(trial.ratio)}×{spread}" if measured else f"<small>{NOT_MEASURED}</small>",
        milliseconds(trial.median) if measured else f"≈ {milliseconds(trial.median)}",
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
