"""Write what studies of many scenes found as one page and one file of numbers."""

from __future__ import annotations

import html
import json
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rasterjit.accuracy.choice import choose
from rasterjit.accuracy.report.files import JSON_NAME
from rasterjit.accuracy.report.plots import number
from rasterjit.accuracy.results import STANDARD, Trial
from rasterjit.accuracy.sentences import digits, folder_summary, options_of, time_in_words
from rasterjit.io.atomic_write import write_text

if TYPE_CHECKING:
    from rasterjit.accuracy.many_scenes import FolderStudy

PAGE_NAME = "index.html"

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""What the page may load: nothing but what is in it."""

STYLE = """:root { color-scheme: light dark; --page: Canvas; --ink: CanvasText; --muted: GrayText;
        --grid: #8884; --level: #0072b2; --standard: #d55e00; }"""
"""Colours, in either scheme."""


def write_together(found: FolderStudy, folder: Path) -> list[Path]:
    """Write ``accuracy.json`` and ``index.html``, whole or not at all; return their paths."""
    text = json.dumps(as_json(found), indent=1, allow_nan=False, ensure_ascii=False)
    places = {JSON_NAME: text + "\n", PAGE_NAME: page(found)}
    for name, content in places.items():
        write_text(folder / name, content)
    return [folder / name for name in places]


def as_json(found: FolderStudy) -> dict[str, Any]:
    """Return what was found, as what JSON can hold."""
    taken = found.take.trial
    return {
        "folder": found.name,
        "max_error": found.max_error,
        "take": {
            "label": taken.label,
            "options": options_of(taken, found.standard),
            "quality": asdict(taken.quality),
            "holds_max_error": None if found.max_error is None else found.take.holds,
            "sureness": found.take.sureness,
            "better_by_at_most": found.take.at_most,
        },
        "answer": " ".join(folder_summary(found)),
        "scenes": {
            name: {
                label: {"ratio": trials[row].ratio, "rmse": trials[row].errors.rmse}
                for label, trials in found.candidates.items()
            }
            for row, name in enumerate(found.studies)
        },
        "failures": found.failures,
    }


def page(found: FolderStudy) -> str:
    """Return the page as HTML."""
    style = resources.files("rasterjit.accuracy.report").joinpath("page.css").read_text("utf-8")
    title = html.escape(f"What accuracy costs: {found.name}")
    take, sure = (html.escape(text) for text in folder_summary(found))
    options = html.escape(options_of(found.take.trial, found.standard))
    failed = "".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(why)}</dd>"
        for name, why in found.failures.items()
    )
    sections = {
        "Each scene": _scenes(found),
        "What was compared": _qualities(found),
        "Not studied": failed and f"<dl>{failed}</dl>\n",
    }
    body = "".join(
        f"<section>\n<h2>{heading}</h2>\n{text}</section>\n"
        for heading, text in sections.items()
        if text
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<link rel="icon" href="data:,">\n<title>{title}</title>\n'
        f"<style>\n{STYLE}\n{style}</style>\n</head>\n<body>\n<header>\n<h1>{title}</h1>\n"
        f'<p class="answer">{take}</p>\n<p class="take"><code>{options}</code></p>\n'
        f'<p class="sure">{sure}</p>\n</header>\n<main>\n{body}</main>\n</body>\n</html>\n'
    )


def _scenes(found: FolderStudy) -> str:
    """Return what the quality costs and buys on each scene, as a table."""
    taken, usual = found.candidates[found.take.trial.label], found.candidates[STANDARD]
    rows = []
    for (name, study), one, standard in zip(found.studies.items(), taken, usual, strict=True):
        cells = [
            time_in_words(standard.median),
            number(standard.errors.rmse),
            f"{digits(one.ratio)}×",
            number(one.errors.rmse),
            html.escape(choose(study).trial.label),
        ]
        link = f'<a href="{quote(name)}/{PAGE_NAME}">{html.escape(name)}</a>'
        rows.append(_row(link, cells))
    head = "scene", "standard", "its RMSE", "time of the choice", "its RMSE", "best here alone"
    return _table(head, rows)


def _qualities(found: FolderStudy) -> str:
    """Return the qualities that were tried on all scenes, as a table."""
    rows = []
    for one in sorted((found.standard, *found.totals), key=lambda trial: trial.ratio):
        trials: tuple[Trial, ...] = found.candidates[one.label]
        ratios = [each.ratio for each in trials]
        cells = [
            f"{digits(one.ratio)}×",
            f"{digits(min(ratios))} to {digits(max(ratios))}",
            number(max(each.errors.rmse for each in trials)),
        ]
        name = html.escape(one.label)
        is_taken = one.label == found.take.trial.label
        rows.append(_row(f"<mark>{name}</mark>" if is_taken else name, cells))
    return _table(("quality", "time, geometric mean", "from scene to scene", "largest RMSE"), rows)


def _row(name: str, cells: list[str]) -> str:
    values = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr><th scope="row">{name}</th>{values}</tr>'


def _table(head: tuple[str, ...], rows: list[str]) -> str:
    cells = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in head)
    body = "\n".join(rows)
    return (
        f'<div class="scroll" tabindex="0">\n<table>\n<thead><tr>{cells}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table>\n</div>\n"
    )
