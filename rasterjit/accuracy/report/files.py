"""Write the files of a study: JSON, CSV, and the page."""

from __future__ import annotations

import csv
import importlib.util
import json
import math
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rasterjit.accuracy.choice import Choice, choose, is_measured
from rasterjit.accuracy.report.page import write_page
from rasterjit.accuracy.report.plots import PAGE_MODULES
from rasterjit.accuracy.results import Study, Trial
from rasterjit.accuracy.sentences import answer, format_options, sentences
from rasterjit.io.atomic_write import atomic_file, write_text

JSON_NAME, CSV_NAME = "accuracy.json", "accuracy.csv"

CSV_COLUMNS = (
    "scene", "width", "height", "threads", "cpu", "rasterjit", "setting", "level",
    "median_ms", "ratio", "ratio_low", "ratio_high", "measured", "rmse", "largest", "psnr",
    "flip", "wrong_faces", "depth_ulp", "depth_units", "uv_texels", "dominated_by", "on_front",
    "seconds",
)  # fmt: skip
"""Columns of the CSV file: ``measured`` says whether the ratio is precise enough to be a factor;
``seconds`` holds the raw times, separated by spaces."""


def prepare_folder(output: str | Path) -> Path:
    """
    Make a folder for a report, if there is none, and check that files can be written there.

    Raises
    ------
    ValueError
        If ``output`` is not a folder, or nothing can be written there.
    """
    if not isinstance(output, (str, os.PathLike)):
        raise ValueError(f"output must be a folder, got {output!r}")
    folder = Path(output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_file(folder / ".probe") as temporary:
            temporary.touch()
        (folder / ".probe").unlink()
    except FileExistsError:
        raise ValueError(f"output must be a folder, but {str(folder)!r} is a file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ValueError(
            f"output must be a folder that can be written to, but {str(folder)!r} is not: {reason}"
        ) from None
    return folder


def write_files(study: Study, output: str | Path) -> list[Path]:
    """
    Write ``accuracy.json`` and ``accuracy.csv``; return their paths.

    Raises
    ------
    ValueError
        If the folder is none, or nothing can be written there.
    OSError
        If the system refuses to write; a file that was there before is whole.
    """
    folder = prepare_folder(output)
    text = json.dumps(study_as_json(study), indent=1, allow_nan=False, ensure_ascii=False)
    write_text(folder / JSON_NAME, text + "\n")
    with (
        atomic_file(folder / CSV_NAME) as temporary,
        temporary.open("w", -1, "utf-8", "backslashreplace", newline="") as file,
    ):
        table = csv.DictWriter(file, CSV_COLUMNS)
        table.writeheader()
        table.writerows(_csv_rows(study))
    return [folder / JSON_NAME, folder / CSV_NAME]


def can_make_page() -> bool:
    """Tell whether matplotlib and Jinja, which the page needs, are installed."""
    return all(importlib.util.find_spec(module) for module in PAGE_MODULES)


def write_report(study: Study, output: str | Path) -> list[Path]:
    """
    Write all files of a report, the page among them where it can be made; return their paths.

    Raises
    ------
    ValueError, OSError
        As `write_files` does.
    """
    paths = write_files(study, output)
    if can_make_page():
        paths.append(write_page(study, output, sentences(study)))
    return paths


def study_as_json(study: Study) -> dict[str, Any]:
    """Return a study without its pictures as JSON values; an infinite PSNR is null."""
    return _without_pictures(study) | {
        "standard": _trial_as_json(study.standard, study),
        "trials": [_trial_as_json(trial, study) for trial in study.trials],
        "effects": [
            vars(cost) | {"levels": [_trial_as_json(level, study) for level in cost.levels]}
            for cost in study.effects
        ],
        "take": choice_as_json(choose(study), study.standard, study.max_error),
        "answer": answer(study),
        "sentences": sentences(study),
    }


def choice_as_json(choice: Choice, standard: Trial, max_error: float | None) -> dict[str, Any]:
    """Return the quality to take, and how sure the choice is."""
    return {
        "label": choice.trial.label,
        "options": format_options(choice.trial, standard),
        "quality": asdict(choice.trial.quality),
        "holds_max_error": choice.holds if max_error is not None else None,
        "sureness": choice.sureness,
        "better_by_at_most": choice.at_most,
    }


def _trial_as_json(trial: Trial, study: Study) -> dict[str, Any]:
    errors = trial.errors._asdict()
    if math.isinf(errors["psnr"]):
        errors["psnr"] = None
    return _without_pictures(trial) | {
        "label": trial.label,
        "quality": asdict(trial.quality),
        "median": trial.median,
        "ratio": trial.ratio,
        "spread": trial.spread,
        "errors": errors,
        "measured": is_measured(trial),
        "on_front": trial.label in study.front,
    }


def _without_pictures(result: Study | Trial) -> dict[str, Any]:
    """Return the fields of a result that are no arrays."""
    return {k: value for k, value in vars(result).items() if not isinstance(value, np.ndarray)}


def _csv_rows(study: Study) -> Iterator[dict[str, Any]]:
    """Yield the rows of the CSV file: the standard first, the levels of effects last."""
    width, height = study.size
    levels = [level for cost in study.effects for level in cost.levels]
    for trial in (study.standard, *study.trials, *levels):
        low, high = trial.spread
        yield {
            "scene": study.scene, "width": width, "height": height, "threads": study.threads,
            "cpu": study.machine.get("cpu"), "rasterjit": study.versions.get("rasterjit"),
            "setting": trial.setting, "level": trial.level, "median_ms": 1e3 * trial.median,
            "ratio": trial.ratio, "ratio_low": low, "ratio_high": high,
            "measured": is_measured(trial), **trial.errors._asdict(),
            "dominated_by": trial.dominated_by, "on_front": trial.label in study.front,
            "seconds": " ".join(f"{seconds:.6f}" for seconds in trial.seconds),
        }  # fmt: skip
