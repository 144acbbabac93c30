"""Write the study of a folder of scenes as one page and one JSON file."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rasterjit.accuracy.choice import choose
from rasterjit.accuracy.report.files import JSON_NAME, choice_as_json
from rasterjit.accuracy.report.page import PAGE_NAME, read_template
from rasterjit.accuracy.results import STANDARD, Trial
from rasterjit.accuracy.sentences import (
    format_duration,
    format_factor,
    format_number,
    format_options,
    summarize_folder,
)
from rasterjit.io.atomic_write import write_text

if TYPE_CHECKING:
    from rasterjit.accuracy.many_scenes import FolderStudy

CONTENT_SECURITY_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""Lets the page load nothing but what is in it."""

COLORS = """:root { color-scheme: light dark; --page: Canvas; --ink: CanvasText; --muted: GrayText;
        --grid: #8884; --level: #0072b2; --standard: #d55e00; }"""
"""Style of colours, in the light and the dark scheme."""


def write_folder_report(folder_study: FolderStudy, folder: Path) -> list[Path]:
    """Write ``accuracy.json`` and ``index.html``, whole or not at all; return their paths."""
    text = json.dumps(folder_as_json(folder_study), indent=1, allow_nan=False, ensure_ascii=False)
    contents = {JSON_NAME: text + "\n", PAGE_NAME: render_page(folder_study)}
    for name, content in contents.items():
        write_text(folder / name, content)
    return [folder / name for name in contents]


def folder_as_json(folder_study: FolderStudy) -> dict[str, Any]:
    """Return a study as JSON values."""
    max_error = folder_study.max_error
    return {
        "folder": folder_study.name,
        "max_error": max_error,
        "take": choice_as_json(folder_study.take, folder_study.standard, max_error),
        "answer": " ".join(summarize_folder(folder_study)),
        "scenes": {
            name: {
                label: {"ratio": trials[row].ratio, "rmse": trials[row].errors.rmse}
                for label, trials in folder_study.candidates.items()
            }
            for row, name in enumerate(folder_study.studies)
        },
        "failures": folder_study.failures,
    }


def render_page(folder_study: FolderStudy) -> str:
    """Return the page as HTML."""
    style = read_template("page.css")
    title = html.escape(f"What accuracy costs: {folder_study.name}")
    answer, certainty = (html.escape(text) for text in summarize_folder(folder_study))
    options = html.escape(format_options(folder_study.take.trial, folder_study.standard))
    failures = "".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(reason)}</dd>"
        for name, reason in folder_study.failures.items()
    )
    sections = {
        "Each scene": _scenes_table(folder_study),
        "What was compared": _qualities_table(folder_study),
        "Not studied": failures and f"<dl>{failures}</dl>\n",
    }
    body = "".join(
        f"<section>\n<h2>{heading}</h2>\n{text}</section>\n"
        for heading, text in sections.items()
        if text
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{CONTENT_SECURITY_POLICY}">\n'
        f'<link rel="icon" href="data:,">\n<title>{title}</title>\n'
        f"<style>\n{COLORS}\n{style}</style>\n</head>\n<body>\n<header>\n<h1>{title}</h1>\n"
        f'<p class="answer">{answer}</p>\n<p class="take"><code>{options}</code></p>\n'
        f'<p class="sure">{certainty}</p>\n</header>\n<main>\n{body}</main>\n</body>\n</html>\n'
    )


def _scenes_table(folder_study: FolderStudy) -> str:
    """Return time and error of the chosen quality on each scene, as an HTML table."""
    candidates, rows = folder_study.candidates, []
    chosen_trials = candidates[folder_study.take.trial.label]
    trials = zip(folder_study.studies.items(), chosen_trials, candidates[STANDARD], strict=True)
    for (name, study), chosen_trial, standard in trials:
        cells = [
            format_duration(standard.median),
            format_number(standard.errors.rmse),
            f"{format_factor(chosen_trial.ratio)}×",
            format_number(chosen_trial.errors.rmse),
            html.escape(choose(study).trial.label),
        ]
        link = f'<a href="{quote(name)}/{PAGE_NAME}">{html.escape(name)}</a>'
        rows.append(_format_row(link, cells))
    head = "scene", "standard", "its RMSE", "time of the choice", "its RMSE", "best here alone"
    return _format_table(head, rows)


def _qualities_table(folder_study: FolderStudy) -> str:
    """Return the qualities that were tried on all scenes, as an HTML table."""
    totals, rows = (folder_study.standard, *folder_study.totals), []
    for total in sorted(totals, key=lambda trial: trial.ratio):
        trials: tuple[Trial, ...] = folder_study.candidates[total.label]
        ratios = [trial.ratio for trial in trials]
        cells = [
            f"{format_factor(total.ratio)}×",
            f"{format_factor(min(ratios))} to {format_factor(max(ratios))}",
            format_number(max(trial.errors.rmse for trial in trials)),
        ]
        name = html.escape(total.label)
        is_chosen = total.label == folder_study.take.trial.label
        rows.append(_format_row(f"<mark>{name}</mark>" if is_chosen else name, cells))
    head = "quality", "time, geometric mean", "from scene to scene", "largest RMSE"
    return _format_table(head, rows)


def _format_row(name: str, cells: list[str]) -> str:
    values = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr><th scope="row">{name}</th>{values}</tr>'


def _format_table(head: tuple[str, ...], rows: list[str]) -> str:
    cells = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in head)
    body = "\n".join(rows)
    return (
        f'<div class="scroll" tabindex="0">\n<table>\n<thead><tr>{cells}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table>\n</div>\n"
    )
