"""Study many scenes, and choose one quality for all of them."""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from rasterjit.accuracy.choice import (
    INVISIBLE_ERROR,
    SAME_ERROR,
    Choice,
    choose,
    choose_among,
    is_timed,
)
from rasterjit.accuracy.report.files import write_report
from rasterjit.accuracy.report.many_scenes_page import write_folder_report
from rasterjit.accuracy.results import COMBINATIONS, STANDARD, Study, Trial, list_front_trials
from rasterjit.accuracy.settings_to_try import Attempt, list_preset_attempts
from rasterjit.accuracy.study import SIZE, StudyRun, begin_study, check_options
from rasterjit.accuracy.timing import Progress
from rasterjit.io.meshes import load, mesh_files
from rasterjit.scene.lens import Lens
from rasterjit.scene.quality import Quality, differences
from rasterjit.scene.validation import existing_folder

STUDIED_SHARE = 0.8
"""Share of a scene's seconds for its own study; the rest is for candidates of other scenes."""

RATIO_QUANTILES = 9
"""Number of quantiles that represent the times of a scene."""

Loader = Callable[[], Any]
"""Returns a scene, or a pair of a scene and the camera that looks at it."""


@dataclass(frozen=True)
class FolderStudy:
    """
    Result of studying many scenes: one quality for all of them.

    Attributes
    ----------
    name : str
        Name of the folder.
    studies : dict of Study
        The study of each scene, by its name, without pictures and without ``effects``.
    candidates : dict of tuple
        The trials of each quality that was tried on all scenes, in the order of ``studies``; the
        standard is among them.
    totals : tuple of Trial
        Each quality but the standard, merged over all scenes: the ratio is the geometric mean; the
        error is the largest if an error was requested, else the geometric mean.
    standard : Trial
        The standard, merged over all scenes.
    take : Choice
        The quality for all scenes: it holds the requested error on all of them, or is nowhere less
        accurate than the standard.
    max_error : float or None
        The largest error that was requested.
    failures : dict of str
        Why scenes could not be studied, by name.
    """

    name: str
    studies: dict[str, Study]
    candidates: dict[str, tuple[Trial, ...]]
    totals: tuple[Trial, ...]
    standard: Trial
    take: Choice
    max_error: float | None
    failures: dict[str, str]

    def __repr__(self) -> str:
        """Name the folder and the chosen quality."""
        return f"FolderStudy({self.name!r}, {len(self.studies)} scenes, {self.take.trial.label!r})"


def study_folder(
    folder: str | Path | Mapping[str, Any],
    *,
    size: tuple[int, int] = SIZE,
    knobs: Iterable[str] | None = None,
    budget: float | None = None,
    max_error: float | None = None,
    lens: Lens | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    output: str | Path | None = None,
    name: str | None = None,
) -> FolderStudy:
    """
    Study every scene of a folder, and choose one quality for all of them.

    Each scene is studied as by `study`. What is worth choosing on any of them is then tried on all.

    Parameters
    ----------
    folder : str, Path or mapping
        A folder of mesh files; or scenes by their names, or functions that return them, each alone
        or in a pair with a camera. Names may have folders, but no "..".
    size, knobs, max_error, lens, threads, progress
        As `study` takes them.
    budget : float, optional
        Seconds for each scene. Default 75.
    output : str or Path, optional
        Folder for a report of all, and in it a folder for the report of each scene.
    name : str, optional
        What the report calls it. Default: the folder's name.

    Returns
    -------
    FolderStudy

    Raises
    ------
    ValueError
        Naming the argument that is wrong, or where no scene can be studied.
    KeyboardInterrupt
        On Ctrl-C before there is anything to compare.
    """
    # Study each scene by itself.
    loaders, folder_name = _make_loaders(folder)
    title = folder_name if name is None else name
    options = check_options(size, knobs, budget, max_error, threads, output)
    scene_runs: dict[str, StudyRun] = {}
    studies: dict[str, Study] = {}
    failures: dict[str, str] = {}
    for number, (scene_name, loader) in enumerate(loaders.items()):
        notify = _prefix_progress(progress, f"{number + 1} of {len(loaders)}, {scene_name}: ")
        try:
            scene_run = begin_study(_load(loader), options, STUDIED_SHARE, lens, notify)
            with scene_run.studio:
                scene_run.run()
        except (ValueError, OSError) as error:
            failures[scene_name] = str(error)
            continue
        study = scene_run.result(scene_name, options.max_error)
        if options.folder is not None:
            write_report(study, options.folder / scene_name)
        scene_runs[scene_name], studies[scene_name] = scene_run, _drop_pictures(study)
        if scene_run.interrupted:
            break
    if not studies:
        why = "; ".join(f"{name}: {error}" for name, error in failures.items())
        raise ValueError(f"folder must hold scenes, got {title!r}, which has none to study: {why}")
    # Try the best qualities of any scene on all scenes.
    qualities = _list_candidates(studies, options.knobs)
    trials_by_label: dict[str, list[Trial]] = {label: [] for label in qualities}
    seconds = (1.0 - STUDIED_SHARE) * options.seconds
    for scene_name, scene_run in scene_runs.items():
        tried = _try_candidates(scene_run, studies[scene_name], qualities, seconds)
        for label, trial in tried.items():
            trials_by_label[label].append(trial)
    count = len(studies)
    candidates = {label: tuple(t) for label, t in trials_by_label.items() if len(t) == count}
    # Choose the quality that suits all.
    max_error = options.max_error
    error_floor = max(INVISIBLE_ERROR, *(study.reference_error for study in studies.values()))
    totals = {
        label: _merge_trials(
            label, qualities[label], trials, candidates[STANDARD], max_error, error_floor
        )
        for label, trials in candidates.items()
    }
    standard = totals.pop(STANDARD)
    usable = [total for total in totals.values() if max_error or _is_never_worse(total, candidates)]
    take = choose_among(standard, usable, max_error, error_floor)
    take = take._replace(untried=(len(qualities) - len(candidates)) / len(qualities))
    # Write the page of all scenes.
    folder_study = FolderStudy(
        title, studies, candidates, tuple(totals.values()), standard, take, max_error, failures
    )
    if options.folder is not None:
        write_folder_report(folder_study, options.folder)
    return folder_study


def _make_loaders(folder: str | Path | Mapping[str, Any]) -> tuple[dict[str, Loader], str]:
    """Return a loader for each scene, by name, and the name of the folder."""
    if isinstance(folder, Mapping):
        if not folder:
            raise ValueError("folder must hold scenes, got an empty mapping")
        # The report of a scene goes into a folder of its name.
        for name in map(str, folder):
            path = PurePath(name)
            if path.is_absolute() or not path.parts or ".." in path.parts:
                raise ValueError(f"folder must have names of scenes without '..', got {name!r}")
        return {str(name): _make_scene_loader(scene) for name, scene in folder.items()}, "scenes"
    path = existing_folder("folder", folder).resolve()
    files = mesh_files(path)
    if not files:
        raise ValueError(f"folder must hold mesh files, got {os.fspath(folder)!r}, without any")
    return {file.relative_to(path).as_posix(): _make_file_loader(file) for file in files}, path.name


def _make_scene_loader(scene: Any) -> Loader:
    return scene if callable(scene) else lambda: scene


def _make_file_loader(file: Path) -> Loader:
    return lambda: load(file, isolate="all")


def _load(loader: Loader) -> tuple[Any, Any]:
    """Return a scene and its camera, or None."""
    loaded = loader()
    return loaded if isinstance(loaded, tuple) else (loaded, None)


def _prefix_progress(progress: Progress | None, prefix: str) -> Progress | None:
    """Return a progress function that prefixes its texts."""
    if progress is None:
        return None
    return lambda text, done, count: progress(prefix + text, done, count)


def _drop_pictures(study: Study) -> Study:
    """Return a study without its pictures, which would take much memory for many scenes."""
    color, error_map = np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), np.float32)
    trials = (study.standard, *study.trials)
    bare = [replace(t, color=color, error_map=error_map) for t in trials]
    study = replace(study, standard=bare[0], trials=tuple(bare[1:]))
    return replace(study, reference_color=color, effects=())


def _list_candidates(studies: Mapping[str, Study], knobs: Sequence[str]) -> dict[str, Quality]:
    """Return the qualities to compare on all scenes: presets, and the best of each scene."""
    qualities = {STANDARD: Quality.standard()}
    qualities |= {attempt.label: attempt.quality for attempt in list_preset_attempts(knobs)}
    for study in studies.values():
        for trial in (choose(study).trial, *list_front_trials(study)):
            if trial.quality not in qualities.values():
                qualities[trial.label] = trial.quality
    return qualities


def _try_candidates(
    scene_run: StudyRun, study: Study, candidates: Mapping[str, Quality], seconds: float
) -> dict[str, Trial]:
    """Return a trial of each candidate on a scene, drawing missing ones while there is time."""
    trial_by_quality = {trial.quality: trial for trial in (study.standard, *study.trials)}
    standard, trials = Quality.standard(), {}
    deadline = time.perf_counter() + seconds
    for label, quality in candidates.items():
        unchanged = {name: getattr(standard, name) for name in study.without_effect}
        effective = replace(quality, **unchanged)
        if effective not in trial_by_quality and time.perf_counter() < deadline:
            attempt = Attempt(COMBINATIONS, label, effective)
            if scene_run.studio.refusal_reason(attempt) is None:
                contestant = scene_run.studio.prepare(attempt, scene_run.reference)
                trial_by_quality[effective] = contestant.trial(scene_run.standard, study.clock)
        if effective in trial_by_quality:
            trials[label] = replace(trial_by_quality[effective], quality=quality)
    scene_run.studio.close()
    return trials


def _is_never_worse(total: Trial, candidates: Mapping[str, Sequence[Trial]]) -> bool:
    """Tell whether a quality is at least as accurate as the standard on every scene."""
    pairs = zip(candidates[total.label], candidates[STANDARD], strict=True)
    return all(trial.errors.rmse <= SAME_ERROR * standard.errors.rmse for trial, standard in pairs)


def _merge_trials(
    label: str,
    quality: Quality,
    trials: Sequence[Trial],
    standards: Sequence[Trial],
    max_error: float | None,
    error_floor: float,
) -> Trial:
    """Merge the trials of a quality on all scenes into one."""
    rmses = [trial.errors.rmse for trial in trials]
    rmse = max(rmses)
    if max_error is None:
        rmse = _geometric_mean(max(error, error_floor) for error in rmses)
    quantiles = (_quantiles(trial.ratios) for trial in trials)
    ratios = [_geometric_mean(values) for values in zip(*quantiles, strict=True)]
    if not all(map(is_timed, trials)):
        # A single ratio marks the time as not measured.
        ratios = [statistics.median(ratios)]

    def largest_excess(name: str) -> float:
        """Return the largest difference of an error to the standard's, over all scenes."""
        pairs = zip(trials, standards, strict=True)
        errors = [[getattr(trial.errors, name) or 0.0 for trial in pair] for pair in pairs]
        return max(max(0.0, error - standard_error) for error, standard_error in errors)

    worst = trials[int(np.argmax(rmses))]
    merged_errors = worst.errors._replace(
        rmse=rmse,
        wrong_faces=int(largest_excess("wrong_faces")),
        depth_units=largest_excess("depth_units"),
        uv_texels=largest_excess("uv_texels"),
    )
    is_single = len(differences(quality, Quality.standard())) == 1
    setting, _, level = label.partition("=") if is_single else (COMBINATIONS, "", label)
    if label == STANDARD:
        setting = level = STANDARD
        ratios = [1.0] * len(ratios)
    seconds = (_geometric_mean(trial.median for trial in trials),)
    return replace(
        worst, setting=setting, level=level, quality=quality, seconds=seconds,
        ratios=tuple(ratios), stages={}, errors=merged_errors, dominated_by=None,
    )  # fmt: skip


def _quantiles(ratios: Sequence[float]) -> list[float]:
    """Return evenly spaced quantiles of ratios."""
    positions = (np.arange(RATIO_QUANTILES) + 0.5) / RATIO_QUANTILES
    return np.quantile(np.asarray(ratios), positions).tolist()


def _geometric_mean(values: Iterable[float]) -> float:
    """Return the geometric mean of numbers of at least 0."""
    return math.exp(statistics.fmean(math.log(max(value, 1e-30)) for value in values))
